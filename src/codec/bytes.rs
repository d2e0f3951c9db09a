//! A codestream, read once from front to back through a small buffer.

use std::io::{self, Read};

use super::CodecError;

/// Bytes read ahead. Larger buys nothing: the inputs are memory or pieces of a file.
pub(super) const BUFFER_BYTES: usize = 8192;

pub(super) struct Bytes<'r> {
    input: &'r mut dyn Read,
    buffer: Vec<u8>,
    at: usize,
}

impl<'r> Bytes<'r> {
    pub(super) fn new(input: &'r mut dyn Read) -> Self {
        Self { input, buffer: Vec::with_capacity(BUFFER_BYTES), at: 0 }
    }

    /// The next byte, or none at the end of the input.
    pub(super) fn next(&mut self) -> Result<Option<u8>, CodecError> {
        if self.at == self.buffer.len() {
            self.fill()?;
        }
        let byte = self.buffer.get(self.at).copied();
        self.at += usize::from(byte.is_some());
        Ok(byte)
    }

    /// The next eight bytes, the first one highest, if they are buffered and none of them is 0xFF (which may open a
    /// marker). They are only peeked at; [`Bytes::take`] consumes them.
    #[inline]
    pub(super) fn eight_plain(&self) -> Option<u64> {
        let eight = self.buffer.get(self.at..)?.first_chunk::<8>()?;
        let word = u64::from_be_bytes(*eight);
        // A byte of 0xFF is a zero byte of the complement: the classic test borrows out of zero bytes.
        let zeros_at = (!word).wrapping_sub(0x0101_0101_0101_0101) & word & 0x8080_8080_8080_8080;
        (zeros_at == 0).then_some(word)
    }

    /// Takes up to `count` bytes that were seen with [`Bytes::eight_plain`].
    #[inline]
    pub(super) fn take(&mut self, count: usize) {
        self.at = (self.at + count).min(self.buffer.len());
    }

    /// Reads once into the empty buffer; it stays empty at the end of the input.
    fn fill(&mut self) -> Result<(), CodecError> {
        self.buffer.resize(BUFFER_BYTES, 0);
        self.at = 0;
        let read = loop {
            match self.input.read(&mut self.buffer) {
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                other => break other,
            }
        };
        let kept = *read.as_ref().unwrap_or(&0);
        self.buffer.truncate(kept);
        read.map(drop).map_err(CodecError::Io)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eight_plain_bytes_have_no_marker_among_them() {
        for at in 0..9 {
            let mut data = [0x80, 0x00, 0xFE, 0x7F, 0x01, 0x00, 0xFE, 0x80, 0x12];
            if at < 8 {
                data[at] = 0xFF;
            }
            let mut input = &data[..];
            let mut bytes = Bytes::new(&mut input);
            bytes.fill().unwrap();
            assert_eq!(bytes.eight_plain().is_some(), at == 8, "0xFF at {at}");
        }
    }
}
