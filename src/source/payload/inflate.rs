//! Compressed streams as readers with small, fixed memory.

use std::io::{self, BufRead, BufReader, Read};

use bzip2::{Decompress, Status};
use flate2::bufread::GzDecoder;

use crate::platform::PositionalFile;

/// Bytes of a file that are read at a time.
pub(super) const INPUT_BYTES: usize = 32 << 10;

/// Reads part of a file by position: the file's own offset is neither used nor moved.
pub(in crate::source) struct PositionReader<'a> {
    file: &'a PositionalFile,
    at: u64,
    end: u64,
}

impl<'a> PositionReader<'a> {
    /// Reader from `offset` on, of `length` bytes at most.
    pub(in crate::source) fn new(file: &'a PositionalFile, offset: u64, length: u64) -> Self {
        Self { file, at: offset, end: offset.saturating_add(length) }
    }
}

impl Read for PositionReader<'_> {
    fn read(&mut self, buf: &mut [u8]) -> io::Result<usize> {
        let left = usize::try_from(self.end.saturating_sub(self.at)).unwrap_or(usize::MAX);
        let most = buf.len().min(left);
        let got = self.file.read_at(buf.get_mut(..most).unwrap_or_default(), self.at)?;
        self.at = self.at.saturating_add(got as u64);
        Ok(got)
    }
}

/// A part of a file behind a small buffer.
pub(in crate::source) type Section<'a> = BufReader<PositionReader<'a>>;

/// Buffered reading of part of a file.
pub(in crate::source) fn section(file: &PositionalFile, offset: u64, length: u64) -> Section<'_> {
    let capacity = usize::try_from(length).map_or(INPUT_BYTES, |n| n.clamp(1, INPUT_BYTES));
    BufReader::with_capacity(capacity, PositionReader::new(file, offset, length))
}

/// Most empty members in a row: block-wise compression ends with one, and joined files have a few.
const MAX_EMPTY: u32 = 4096;

/// Gzip: one member after another; anything else behind the last one is ignored, as `gzip` does.
///
/// One decoder serves all members: a file of tiny ones costs little more than one of the same bytes in few.
pub(super) struct Gzip<R> {
    decoder: GzDecoder<Slot<R>>,
    /// Members in a row that held nothing.
    empty: u32,
    ended: bool,
}

impl<R: BufRead> Gzip<R> {
    pub(super) fn new(inner: R) -> Self {
        Self { decoder: GzDecoder::new(Slot(Some(inner))), empty: 0, ended: false }
    }
}

/// A reader that can be taken out of a decoder and put into it again.
struct Slot<R>(Option<R>);

impl<R: BufRead> Read for Slot<R> {
    fn read(&mut self, buf: &mut [u8]) -> io::Result<usize> {
        self.0.as_mut().map_or(Ok(0), |inner| inner.read(buf))
    }
}

impl<R: BufRead> BufRead for Slot<R> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        self.0.as_mut().map_or(Ok(&[]), BufRead::fill_buf)
    }

    fn consume(&mut self, amount: usize) {
        if let Some(inner) = &mut self.0 {
            inner.consume(amount);
        }
    }
}

impl<R: BufRead> Read for Gzip<R> {
    fn read(&mut self, buf: &mut [u8]) -> io::Result<usize> {
        if buf.is_empty() {
            return Ok(0);
        }
        while !self.ended {
            let got = self.decoder.read(buf)?;
            if got > 0 {
                self.empty = 0;
                return Ok(got);
            }
            // The member's checksum was right; another member may follow.
            let inner = self.decoder.get_mut();
            self.ended = !inner.fill_buf()?.starts_with(b"\x1f");
            if !self.ended {
                self.empty += 1;
                if self.empty > MAX_EMPTY {
                    return Err(invalid("gzip: thousands of members in a row hold nothing"));
                }
                let inner = Slot(inner.0.take());
                self.decoder.reset(inner);
            }
        }
        Ok(0)
    }
}

/// Bzip2, one stream after another, in the mode that holds 2.5 bytes per byte of a block.
pub(super) struct Bzip2<R> {
    inner: R,
    /// `None` between streams.
    state: Option<Decompress>,
    /// Largest blocks that are accepted, in units of 100,000 bytes.
    level: u8,
    first: bool,
}

impl<R: BufRead> Bzip2<R> {
    pub(super) fn new(inner: R, level: u8) -> Self {
        Self { inner, state: None, level, first: true }
    }

    /// Begins a stream, if there is one.
    fn begin(&mut self) -> io::Result<bool> {
        // Behind the first one, anything else than a stream is ignored.
        if !self.first && !self.inner.fill_buf()?.starts_with(b"B") {
            return Ok(false);
        }
        self.first = false;
        let mut head = [0; BZIP2_HEAD];
        self.inner.read_exact(&mut head)?;
        let level = bzip2_level(&head).ok_or_else(|| invalid("bzip2: no header"))?;
        if level > self.level {
            return Err(invalid("bzip2: a later stream has larger blocks than the first"));
        }
        let mut state = Decompress::new(true);
        state.decompress(&head, &mut []).map_err(invalid)?;
        self.state = Some(state);
        Ok(true)
    }
}

/// Bytes at the head of a bzip2 stream that state the size of its blocks.
pub(super) const BZIP2_HEAD: usize = 4;

/// Size of a stream's blocks in units of 100,000 bytes.
pub(super) fn bzip2_level(head: &[u8; BZIP2_HEAD]) -> Option<u8> {
    match head {
        [b'B', b'Z', b'h', level @ b'1'..=b'9'] => Some(level - b'0'),
        _ => None,
    }
}

/// The state of a bzip2 decoder without its block, which is 2.5 times as long as its level says.
const BZIP2: u64 = 128 << 10;

/// Bytes that decoding such blocks holds: 2.5 times a block, and tables.
pub(super) fn bzip2_memory(level: u8) -> u64 {
    250_000 * u64::from(level) + BZIP2
}

fn invalid(cause: impl ToString) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, cause.to_string())
}

impl<R: BufRead> Read for Bzip2<R> {
    fn read(&mut self, buf: &mut [u8]) -> io::Result<usize> {
        if buf.is_empty() {
            return Ok(0);
        }
        loop {
            if self.state.is_none() && !self.begin()? {
                return Ok(0);
            }
            let Some(state) = &mut self.state else { return Ok(0) };
            let input = self.inner.fill_buf()?;
            let ended = input.is_empty();
            let (consumed, made) = (state.total_in(), state.total_out());
            let status = state.decompress(input, buf).map_err(invalid)?;
            // Both are at most the lengths of the two buffers.
            let made = usize::try_from(state.total_out() - made).unwrap_or(0);
            let consumed = usize::try_from(state.total_in() - consumed).unwrap_or(0);
            self.inner.consume(consumed);
            if status == Status::StreamEnd {
                self.state = None;
            } else if made == 0 && (ended || consumed == 0) {
                return Err(io::ErrorKind::UnexpectedEof.into());
            }
            if made > 0 {
                return Ok(made);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compress::{bzip2, gzip};

    #[test]
    fn members_follow_each_other_and_what_comes_after_is_ignored() {
        let (a, b) = (vec![1; 70_000], b"hello".to_vec());
        for make in [gzip, bzip2] {
            let stream = [make(&a), make(&b), b"\0\0padding".to_vec()].concat();
            for capacity in [1, 7, 4096] {
                let inner = BufReader::with_capacity(capacity, &stream[..]);
                let mut out = Vec::new();
                if stream[0] == 0x1f {
                    Gzip::new(inner).read_to_end(&mut out).unwrap();
                } else {
                    Bzip2::new(inner, 1).read_to_end(&mut out).unwrap();
                }
                assert_eq!(out, [&a[..], &b].concat());
            }
        }
    }

    #[test]
    fn members_that_hold_nothing_are_passed_over_as_long_as_they_are_few() {
        let stream = |count: usize| [gzip(b"a"), gzip(b"").repeat(count), gzip(b"b")].concat();
        let mut out = Vec::new();
        Gzip::new(&stream(MAX_EMPTY as usize - 1)[..]).read_to_end(&mut out).unwrap();
        assert_eq!(out, b"ab");
        let error = Gzip::new(&stream(500_000)[..]).read_to_end(&mut out).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::InvalidData);
        // Members that hold a byte count as usual.
        let (started, mut out) = (std::time::Instant::now(), Vec::new());
        Gzip::new(&gzip(b"c").repeat(100_000)[..]).read_to_end(&mut out).unwrap();
        assert_eq!(out.len(), 100_000);
        assert!(started.elapsed().as_secs() < 20, "{:?}", started.elapsed());
    }

    #[test]
    fn streams_that_stop_early_give_what_they_have_and_then_say_so() {
        let plain: Vec<u8> = (0..50_000_u32).map(|i| (i * i / 7).to_le_bytes()[1]).collect();
        for make in [gzip, bzip2] {
            let stream = make(&plain);
            let cut = &stream[..stream.len() / 2];
            let mut out = Vec::new();
            let error = if stream[0] == 0x1f {
                Gzip::new(cut).read_to_end(&mut out).unwrap_err()
            } else {
                Bzip2::new(cut, 9).read_to_end(&mut out).unwrap_err()
            };
            assert_eq!(error.kind(), io::ErrorKind::UnexpectedEof);
            assert!(plain.starts_with(&out) && out.len() < plain.len());
        }
    }
}
