//! View of a deflated file as a plain one (PS3.5 A.5): the dataset behind the meta header is inflated while it is read,
//! forwards only.

use std::cell::RefCell;
use std::io;

use flate2::{Decompress, FlushDecompress, Status};

use super::window::ReadAt;
use crate::source::dicom::parse::error::DeflateFault;

/// Compressed bytes held at a time, and inflated bytes while stepping over them.
const BLOCK: usize = 8 << 10;

/// Deflate makes at most 1032 bytes out of one (RFC 1951: a match of 258 bytes takes two bits).
const MAX_EXPANSION: u64 = 1032;

/// Bytes that may be inflated in search of the pixels: no header is as long, and the search ends.
const LONGEST_SEARCH: u64 = 64 << 20;

/// Offsets before `start` are the file's own; from there on they count inflated bytes.
///
/// Reading forwards costs one pass; a step back begins again. Holds some 60 KiB.
pub(crate) struct InflateReader<'a, R: ?Sized> {
    input: &'a R,
    start: u64,
    len: u64,
    limit: u64,
    state: RefCell<State>,
}

struct State {
    inflate: Decompress,
    /// Next compressed byte to fetch from the file.
    from: u64,
    /// Offset of the next inflated byte.
    at: u64,
    block: Box<[u8]>,
    have: std::ops::Range<usize>,
    ended: bool,
}

impl<'a, R: ReadAt + ?Sized> InflateReader<'a, R> {
    /// Reader for the search of elements; ends with an error after [`LONGEST_SEARCH`] bytes.
    pub(crate) fn new(input: &'a R, start: u64) -> io::Result<Self> {
        Self::up_to(input, start, LONGEST_SEARCH)
    }

    /// Like [`InflateReader::new`] with another limit on inflated bytes.
    pub(crate) fn up_to(input: &'a R, start: u64, limit: u64) -> io::Result<Self> {
        let compressed = input.byte_len()?.saturating_sub(start);
        let len = compressed.saturating_mul(MAX_EXPANSION).saturating_add(start);
        let state = RefCell::new(State::new(input, start)?);
        Ok(Self { input, start, len, limit: limit.saturating_add(start), state })
    }
}

impl State {
    fn new<R: ReadAt + ?Sized>(input: &R, start: u64) -> io::Result<Self> {
        // The standard wants a bare stream; some programs put the zlib header before it. A bare stream may
        // begin with the same bits only as a stored block, whose length stands there twice.
        let mut head = [0; 5];
        let mut have = 0;
        while have < head.len() {
            match input.read_some_at(&mut head[have..], start + have as u64)? {
                0 => break,
                n => have += n,
            }
        }
        let [method, flags, a, b, c] = head;
        let zlib = method & 0x0f == 8 && u16::from_be_bytes([method, flags]) % 31 == 0;
        let stored = method & 7 == 0 && [flags, a] == [!b, !c];
        Ok(Self {
            inflate: Decompress::new(zlib && !stored),
            from: start,
            at: start,
            block: vec![0; BLOCK].into_boxed_slice(),
            have: 0..0,
            ended: false,
        })
    }

    /// Inflates some bytes; 0 only at the end of the stream.
    fn produce<R: ReadAt + ?Sized>(&mut self, input: &R, out: &mut [u8]) -> io::Result<usize> {
        while !self.ended && !out.is_empty() {
            if self.have.is_empty() {
                let n = input.read_some_at(&mut self.block, self.from)?;
                self.from += n as u64;
                self.have = 0..n;
            }
            let input_ended = self.have.is_empty();
            let (read, made) = (self.inflate.total_in(), self.inflate.total_out());
            let compressed = self.block.get(self.have.clone()).unwrap_or(&[]);
            let status = self
                .inflate
                .decompress(compressed, out, FlushDecompress::None)
                .map_err(|_| DeflateFault::Damaged)?;
            let read = usize::try_from(self.inflate.total_in() - read).unwrap_or(usize::MAX);
            let made = usize::try_from(self.inflate.total_out() - made).unwrap_or(0);
            self.have.start = self.have.start.saturating_add(read).min(self.have.end);
            // A stream that stops without its end is over as well: its reader notices missing bytes.
            self.ended = status == Status::StreamEnd || (input_ended && made == 0);
            self.at += made as u64;
            if made > 0 {
                return Ok(made);
            }
        }
        Ok(0)
    }
}

impl<R: ReadAt + ?Sized> ReadAt for InflateReader<'_, R> {
    /// An upper bound: the true length is known only at the end.
    fn byte_len(&self) -> io::Result<u64> {
        Ok(self.len)
    }

    fn read_some_at(&self, buf: &mut [u8], offset: u64) -> io::Result<usize> {
        if offset < self.start {
            let before = usize::try_from(self.start - offset).unwrap_or(usize::MAX).min(buf.len());
            return self.input.read_some_at(buf.get_mut(..before).unwrap_or(&mut []), offset);
        }
        let mut state = self.state.borrow_mut();
        if offset < state.at {
            *state = State::new(self.input, self.start)?;
        }
        if offset > self.limit {
            return Err(DeflateFault::LongHeader { bytes: self.limit }.into());
        }
        let mut waste = [0; BLOCK];
        while state.at < offset {
            let skip = usize::try_from(offset - state.at).unwrap_or(BLOCK).min(BLOCK);
            if state.produce(self.input, waste.get_mut(..skip).unwrap_or(&mut []))? == 0 {
                return Ok(0);
            }
        }
        state.produce(self.input, buf)
    }
}
