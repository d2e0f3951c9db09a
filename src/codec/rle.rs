//! RLE Lossless (DICOM PS3.5 annex G): one run-length coded segment for each byte of a pixel.
//!
//! A frame begins with a header of 64 bytes: the number of segments and where each begins. The segments of
//! one component come from its most significant byte down, component after component, so that the bytes of
//! one sample lie far apart: all segments are read at once, each through a small buffer of its own.

use super::{CodecError, FrameBytes, FrameFormat, RowSink};

/// Bytes of the header: sixteen little-endian words.
const HEADER_BYTES: usize = 64;
/// Segments that a header has room for.
const MOST_SEGMENTS: usize = 15;
/// Bytes that are read ahead in each segment.
const BUFFER_BYTES: usize = 4 << 10;
/// Bytes of a plane that are decoded before they are put into the row.
const CHUNK_BYTES: usize = 1 << 10;

/// What an RLE frame must hold; only the header of the file knows it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RleFormat {
    /// Width in pixels.
    pub columns: u32,
    /// Height in pixels.
    pub rows: u32,
    /// Samples per pixel.
    pub components: u8,
    /// Bytes of one sample as allocated, 1 to 4.
    pub bytes_per_sample: u8,
}

/// Decodes one RLE frame.
///
/// The code does not know which bits of a sample are in use, nor whether it has a sign: every sample comes
/// as the unsigned value of all its bytes (32 bits as their pattern), and masking to the stored bits and
/// extending the sign are left to the caller. Components come side by side whatever the planar configuration
/// of the file says, which RLE does not follow. Runs may go on from one row to the next, and bytes after the
/// last sample of a segment are not looked at.
///
/// One pass over each segment, in requests of 4 KiB; held are 4 KiB for each segment (60 KiB at most) and
/// one row of 4 bytes a sample, however large the frame is.
///
/// # Errors
/// The header contradicts the format or the length of the frame, a segment ends early, or the input or
/// `sink` fails.
pub fn decode(input: &dyn FrameBytes, format: &RleFormat, sink: &mut dyn RowSink) -> Result<(), CodecError> {
    let &RleFormat { columns, rows, components, bytes_per_sample } = format;
    if !(1..=4).contains(&bytes_per_sample) {
        return Err(CodecError::Unsupported(format!("RLE samples of {bytes_per_sample} bytes")));
    }
    let wanted = usize::from(components) * usize::from(bytes_per_sample);
    if wanted == 0 || wanted > MOST_SEGMENTS {
        return Err(CodecError::Unsupported(format!("RLE pixels of {wanted} bytes")));
    }
    let mut segments = open_segments(input, wanted)?;
    sink.begin(&FrameFormat { columns, rows, components, precision: 8 * bytes_per_sample, signed: false })?;
    let samples = usize::try_from(u64::from(columns) * u64::from(components))
        .map_err(|_| CodecError::Unsupported(format!("lines of {columns} samples")))?;
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

/// Reads the header, and compares it with what the format asks for and the frame has.
fn open_segments(input: &dyn FrameBytes, wanted: usize) -> Result<Vec<Segment>, CodecError> {
    let damaged = |what: String| Err(CodecError::Damaged(what));
    let mut header = [0; HEADER_BYTES];
    if read_full(input, &mut header, 0)? < HEADER_BYTES {
        return damaged(format!("{} bytes are too few for an RLE header", input.len()));
    }
    let mut words = header
        .chunks_exact(4)
        .map(|word| word.iter().rev().fold(0_u64, |value, &byte| value << 8 | u64::from(byte)));
    let count = words.next().unwrap_or_default();
    if count != wanted as u64 {
        return damaged(format!("its RLE header has {count} segments, where the pixels need {wanted}"));
    }
    let starts: Vec<u64> = words.take(wanted).collect();
    let mut segments = Vec::with_capacity(wanted);
    for (number, &start) in starts.iter().enumerate() {
        let end = starts.get(number + 1).copied().unwrap_or(input.len());
        if start < HEADER_BYTES as u64 || start > end || end > input.len() {
            return damaged(format!(
                "its RLE segment {} lies at {start} to {end} in a frame of {} bytes",
                number + 1,
                input.len()
            ));
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

/// What the bytes that come next are.
#[derive(Clone, Copy)]
enum Packet {
    /// That many bytes as they stand.
    Literal(usize),
    /// That many times one byte.
    Run(usize, u8),
}

/// One segment, decoded front to back.
struct Segment {
    number: usize,
    /// Where in the frame the buffer was read to, and where the segment ends.
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

    /// Has the buffer hold at least one byte.
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
            return Err(CodecError::Damaged(format!("its RLE segment {} ends early", self.number)));
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
                        // No packet, by the standard.
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
