//! RLE Lossless (DICOM PS3.5 annex G): one run-length coded segment for each byte of a pixel.
//!
//! A frame begins with a header of 64 bytes: the number of segments and where each begins. The segments of
//! one component come from its most significant byte down, component after component, so that the bytes of
//! one sample lie far apart: all segments are read at once, each through a small buffer of its own.

use super::{CodecError, FrameBytes, FrameFormat, RowSink};
use crate::codec::{damaged, unsupported};

/// Bytes of the header: sixteen little-endian words.
const HEADER_BYTES: usize = 64;
/// Segments that a header has room for.
const MAX_SEGMENTS: usize = 15;
/// Bytes that are read ahead in each segment.
const BUFFER_BYTES: usize = 4 << 10;
/// Bytes of a plane that are decoded before they are put into the row.
const CHUNK_BYTES: usize = 1 << 10;

/// The required content of an RLE frame; only the header of the file states it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct RleFormat {
    pub(crate) columns: u32,
    pub(crate) rows: u32,
    /// Samples per pixel.
    pub(crate) components: u8,
    /// Bytes of one sample as allocated, 1 to 4.
    pub(crate) bytes_per_sample: u8,
}

/// Decodes one RLE frame.
///
/// The code does not state which bits of a sample are in use, nor whether it has a sign: every sample comes as the
/// unsigned value of all its bytes (32 bits as their pattern); the caller masks the stored bits and extends the sign.
/// Components come side by side whatever planar configuration the file states, which RLE does not follow. Runs may go
/// on from one row to the next, and bytes after the last sample of a segment are not read.
///
/// One pass over each segment, in requests of 4 KiB; held are 4 KiB for each segment (60 KiB at most) and
/// one row of 4 bytes a sample, however large the frame is.
///
/// # Errors
/// The header contradicts the format or the length of the frame, a segment ends early, or the input or
/// `sink` fails.
pub(crate) fn decode(
    input: &dyn FrameBytes,
    format: &RleFormat,
    sink: &mut dyn RowSink,
) -> Result<(), CodecError> {
    let &RleFormat { columns, rows, components, bytes_per_sample } = format;
    if !(1..=4).contains(&bytes_per_sample) {
        return Err(unsupported(format!("RLE samples of {bytes_per_sample} bytes")));
    }
    let wanted = usize::from(components) * usize::from(bytes_per_sample);
    if wanted == 0 || wanted > MAX_SEGMENTS {
        return Err(unsupported(format!("RLE pixels of {wanted} bytes")));
    }
    let mut segments = open_segments(input, wanted)?;
    sink.begin(&FrameFormat { columns, rows, components, precision: 8 * bytes_per_sample, signed: false })?;
    let samples = usize::try_from(u64::from(columns) * u64::from(components))
        .map_err(|_| unsupported(format!("lines of {columns} samples")))?;
    let mut row = vec![0_i32; samples];
    let mut chunk = [0; CHUNK_BYTES];
    for _ in 0..rows {
        row.fill(0);
        for (number, segment) in segments.iter_mut().enumerate() {
            let component = number / usize::from(bytes_per_sample);
            let below = usize::from(bytes_per_sample) - 1 - number % usize::from(bytes_per_sample);
            for pixels in row.chunks_mut(CHUNK_BYTES * usize::from(components)) {
                let count = pixels.len() / usize::from(components);
                let bytes = &mut chunk[..count];
                segment.decode(input, bytes)?;
                let to = pixels.iter_mut().skip(component).step_by(usize::from(components));
                for (sample, &byte) in to.zip(&*bytes) {
                    *sample |= i32::from(byte) << (8 * below);
                }
            }
        }
        sink.row(&row)?;
    }
    Ok(())
}

/// Reads the header, and checks it against the format and the length of the frame.
fn open_segments(input: &dyn FrameBytes, wanted: usize) -> Result<Vec<Segment>, CodecError> {
    let mut header = [0; HEADER_BYTES];
    if read_full(input, &mut header, 0)? < HEADER_BYTES {
        return Err(damaged(format!("{} bytes are too few for an RLE header", input.len())));
    }
    let mut words = header
        .chunks_exact(4)
        .map(|word| word.iter().rev().fold(0_u64, |value, &byte| value << 8 | u64::from(byte)));
    let count = words.next().unwrap_or_default();
    if count != wanted as u64 {
        return Err(damaged(format!("its RLE header has {count} segments, where the pixels need {wanted}")));
    }
    let starts: Vec<u64> = words.take(wanted).collect();
    let mut segments = Vec::with_capacity(wanted);
    for (number, &start) in starts.iter().enumerate() {
        let end = starts.get(number + 1).copied().unwrap_or(input.len());
        if start < HEADER_BYTES as u64 || start > end || end > input.len() {
            let (segment, bytes) = (number + 1, input.len());
            return Err(damaged(format!(
                "its RLE segment {segment} lies at {start} to {end} in a frame of {bytes} bytes"
            )));
        }
        segments.push(Segment::new(start, end, number + 1));
    }
    Ok(segments)
}

/// Reads until the buffer is full or the frame ends.
fn read_full(input: &dyn FrameBytes, buffer: &mut [u8], offset: u64) -> Result<usize, CodecError> {
    let mut filled = 0;
    while let Some(rest) = buffer.get_mut(filled..).filter(|rest| !rest.is_empty()) {
        match input.read_at(rest, offset.saturating_add(filled as u64)) {
            Ok(0) => break,
            Ok(count) => filled = (filled + count).min(buffer.len()),
            Err(e) if e.kind() == std::io::ErrorKind::Interrupted => {}
            Err(e) => return Err(e.into()),
        }
    }
    Ok(filled)
}

/// The packet that the next bytes belong to.
#[derive(Clone, Copy)]
enum Packet {
    /// Number of bytes to copy.
    Literal(usize),
    /// Number of repetitions of one byte.
    Run(usize, u8),
}

/// One segment, decoded front to back.
struct Segment {
    number: usize,
    /// Offset in the frame that the buffer was read to, and offset of the segment's end.
    next: u64,
    end: u64,
    buffer: Vec<u8>,
    at: usize,
    filled: usize,
    packet: Packet,
}

impl Segment {
    fn new(start: u64, end: u64, number: usize) -> Segment {
        let bytes = usize::try_from(end - start).unwrap_or(BUFFER_BYTES).min(BUFFER_BYTES);
        let buffer = vec![0; bytes];
        Segment { number, next: start, end, buffer, at: 0, filled: 0, packet: Packet::Literal(0) }
    }

    /// Refills the buffer if it is empty.
    fn refill(&mut self, input: &dyn FrameBytes) -> Result<(), CodecError> {
        if self.at < self.filled {
            return Ok(());
        }
        let rest = usize::try_from(self.end - self.next).unwrap_or(BUFFER_BYTES);
        let wanted = rest.min(self.buffer.len());
        self.at = 0;
        self.filled = read_full(input, &mut self.buffer[..wanted], self.next)?;
        self.next += self.filled as u64;
        if self.filled == 0 {
            return Err(damaged(format!("its RLE segment {} ends early", self.number)));
        }
        Ok(())
    }

    fn byte(&mut self, input: &dyn FrameBytes) -> Result<u8, CodecError> {
        self.refill(input)?;
        let byte = self.buffer[self.at];
        self.at += 1;
        Ok(byte)
    }

    /// Decodes exactly as many bytes as `to` has; a packet that is longer goes on at the next call.
    fn decode(&mut self, input: &dyn FrameBytes, mut to: &mut [u8]) -> Result<(), CodecError> {
        while !to.is_empty() {
            let count = match self.packet {
                Packet::Literal(0) | Packet::Run(0, _) => {
                    self.packet = match self.byte(input)? {
                        literal @ 0..=127 => Packet::Literal(usize::from(literal) + 1),
                        // A no-op, by the standard.
                        128 => continue,
                        run => Packet::Run(257 - usize::from(run), self.byte(input)?),
                    };
                    continue;
                }
                Packet::Literal(left) => {
                    self.refill(input)?;
                    let count = left.min(to.len()).min(self.filled - self.at);
                    to[..count].copy_from_slice(&self.buffer[self.at..self.at + count]);
                    self.at += count;
                    self.packet = Packet::Literal(left - count);
                    count
                }
                Packet::Run(left, byte) => {
                    let count = left.min(to.len());
                    to[..count].fill(byte);
                    self.packet = Packet::Run(left - count, byte);
                    count
                }
            };
            to = to.get_mut(count..).unwrap_or_default();
        }
        Ok(())
    }
}

#[cfg(test)]
#[path = "../../tests/it/common/codec/rle.rs"]
mod encoder;

#[cfg(test)]
#[expect(clippy::cast_possible_truncation, reason = "bytes and sizes of small test images")]
mod tests {
    use super::super::kept::Kept;
    use super::encoder::encode;
    use super::*;
    use crate::random::Random;

    /// Hands out few bytes at a time.
    struct Trickle(Vec<u8>);

    impl FrameBytes for Trickle {
        fn len(&self) -> u64 {
            self.0.len() as u64
        }

        fn read_at(&self, buffer: &mut [u8], offset: u64) -> std::io::Result<usize> {
            let most = buffer.len().min(1 + (offset % 5) as usize);
            self.0.read_at(&mut buffer[..most], offset)
        }
    }

    fn samples(format: &RleFormat, random: &mut Random) -> Vec<u32> {
        let most = u32::MAX >> (32 - 8 * u32::from(format.bytes_per_sample));
        let mut value = 0;
        let flat = random.below(40) + 1;
        (0..format.columns * format.rows * u32::from(format.components))
            .map(|_| {
                if random.below(flat) == 0 {
                    value = random.below(u64::from(most) + 1) as u32;
                }
                value
            })
            .collect()
    }

    #[test]
    fn round_trips_over_sizes_depths_and_components() {
        let mut random = Random(11);
        for (columns, rows) in [(1, 1), (1, 7), (7, 1), (3, 3), (40, 30), (1025, 2), (2, 700), (5000, 3)] {
            for components in 1..=3 {
                for bytes_per_sample in 1..=4 {
                    let format = RleFormat { columns, rows, components, bytes_per_sample };
                    let samples = samples(&format, &mut random);
                    let frame = Trickle(encode(&format, &samples, &mut random));
                    let mut kept = Kept::default();
                    decode(&frame, &format, &mut kept).unwrap();
                    assert_eq!(kept.rows.len(), rows as usize);
                    let expected: Vec<i32> = samples.iter().map(|sample| sample.cast_signed()).collect();
                    assert_eq!(kept.rows.concat(), expected, "{format:?}");
                    let precision = 8 * bytes_per_sample;
                    let begun = FrameFormat { columns, rows, components, precision, signed: false };
                    assert_eq!(kept.format, Some(begun));
                }
            }
        }
    }

    #[test]
    fn runs_go_on_in_the_next_row() {
        let mut frame = vec![0; HEADER_BYTES];
        frame[0] = 1;
        frame[4] = 64;
        // A run of seven 9s, a no-op, a literal of two bytes, and padding of an odd length.
        frame.extend([250, 9, 128, 1, 5, 6, 0]);
        let format = RleFormat { columns: 3, rows: 3, components: 1, bytes_per_sample: 1 };
        let mut kept = Kept::default();
        decode(&frame, &format, &mut kept).unwrap();
        assert_eq!(kept.rows, [[9, 9, 9], [9, 9, 9], [9, 5, 6]]);
        frame.truncate(frame.len() - 2);
        let result = decode(&frame, &format, &mut Kept::default());
        assert!(
            matches!(result, Err(CodecError::Damaged(what)) if what.to_string().contains("segment 1 ends early"))
        );
    }

    #[test]
    fn lies_of_the_header_are_found() {
        let format = RleFormat { columns: 4, rows: 4, components: 1, bytes_per_sample: 2 };
        let mut random = Random(12);
        let sound = encode(&format, &[7; 16], &mut random);
        let says = |at: usize, value: u32, words: &str| {
            let mut frame = sound.clone();
            frame[at..at + 4].copy_from_slice(&value.to_le_bytes());
            let mut kept = Kept::default();
            match decode(&frame, &format, &mut kept) {
                Err(CodecError::Damaged(what)) => assert!(what.to_string().contains(words), "{what}"),
                other => panic!("{other:?}"),
            }
            assert!(kept.format.is_none(), "found before the frame begins");
        };
        says(0, 3, "has 3 segments, where the pixels need 2");
        says(0, u32::MAX, "segments");
        says(4, 60, "segment 1 lies at 60");
        says(8, 63, "segment 1 lies at 64 to 63");
        says(8, u32::MAX, "segment 1 lies at");
        let short = sound[..63].to_vec();
        assert!(matches!(decode(&short, &format, &mut Kept::default()), Err(CodecError::Damaged(_))));
        let wide = RleFormat { components: 4, bytes_per_sample: 4, ..format };
        assert!(matches!(decode(&sound, &wide, &mut Kept::default()), Err(CodecError::Unsupported(_))));
    }

    #[test]
    fn truncations_and_changed_bytes_never_panic() {
        let mut random = Random(13);
        let mut failed = 0;
        for turn in 0..60 {
            let bytes_per_sample = [1, 2, 4][turn % 3];
            let format =
                RleFormat { columns: 19, rows: 9, components: 1 + 2 * (turn as u8 % 2), bytes_per_sample };
            let samples = samples(&format, &mut random);
            let sound = encode(&format, &samples, &mut random);
            for length in 0..sound.len() - 2 {
                let result = decode(&sound[..length].to_vec(), &format, &mut Kept::default());
                assert!(matches!(result, Err(CodecError::Damaged(_))), "{length} of {}", sound.len());
            }
            for _ in 0..200 {
                let mut changed = sound.clone();
                for _ in 0..=random.below(3) {
                    let within = if random.below(2) == 0 { HEADER_BYTES } else { changed.len() };
                    changed[random.below(within)] = random.byte();
                }
                let mut kept = Kept::default();
                let result = decode(&changed, &format, &mut kept);
                assert!(kept.rows.len() <= 9 && (result.is_err() || kept.rows.len() == 9));
                failed += usize::from(result.is_err());
            }
        }
        assert!((1000..12_000).contains(&failed), "{failed} of 12000 found out");
    }
}
