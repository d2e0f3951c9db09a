//! Buffered bytes of a codestream, and the integers and marker segments made of them.

use std::io::{self, Read};

use super::super::CodecError;
use super::fault::Damage;

/// Bytes read ahead. Larger buys nothing: the sources below are memory or pieces of a file.
pub(super) const BUFFER_BYTES: usize = 8192;

/// A codestream, read once from front to back through a small buffer.
pub(super) struct Bytes<'r> {
    input: &'r mut dyn Read,
    buffer: Vec<u8>,
    at: usize,
}

impl<'r> Bytes<'r> {
    /// Nothing is read yet.
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

    /// The next byte, which must exist.
    pub(super) fn byte(&mut self) -> Result<u8, CodecError> {
        self.next()?.ok_or_else(ends_early)
    }

    /// Two bytes, the higher first.
    pub(super) fn pair(&mut self) -> Result<u16, CodecError> {
        Ok(u16::from_be_bytes([self.byte()?, self.byte()?]))
    }

    /// The next eight bytes, the first one highest, if they are buffered and none of them is 0xFF (which
    /// may open a marker). They are not taken; [`Bytes::take`] does that.
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

    /// The next marker's second byte, whatever stands before it; none at the end of the input.
    pub(super) fn marker(&mut self) -> Result<Option<u8>, CodecError> {
        let mut after_ff = false;
        while let Some(byte) = self.next()? {
            match byte {
                0xFF => after_ff = true,
                0x00 => after_ff = false,
                code if after_ff => return Ok(Some(code)),
                _ => {}
            }
        }
        Ok(None)
    }

    /// Opens a marker segment: its length comes first.
    pub(super) fn segment(&mut self) -> Result<Segment<'_, 'r>, CodecError> {
        let length = self.pair()?;
        match length.checked_sub(2) {
            Some(left) => Ok(Segment { bytes: self, left }),
            None => Err(Damage::ShortLength { length }.into()),
        }
    }

    /// One read into the empty buffer; it stays empty at the end of the input.
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

/// The inside of one marker segment; reading past its end is an error.
pub(super) struct Segment<'b, 'r> {
    bytes: &'b mut Bytes<'r>,
    left: u16,
}

impl Segment<'_, '_> {
    /// Bytes that are left.
    pub(super) fn left(&self) -> u16 {
        self.left
    }

    /// The next byte of the segment.
    pub(super) fn byte(&mut self) -> Result<u8, CodecError> {
        self.left = self.left.checked_sub(1).ok_or(Damage::ShortSegment)?;
        self.bytes.byte()
    }

    /// Two bytes, the higher first.
    pub(super) fn pair(&mut self) -> Result<u16, CodecError> {
        Ok(u16::from_be_bytes([self.byte()?, self.byte()?]))
    }

    /// A byte as its upper and lower four bits.
    pub(super) fn nibbles(&mut self) -> Result<(u8, u8), CodecError> {
        let byte = self.byte()?;
        Ok((byte >> 4, byte & 15))
    }

    /// Passes over what is left.
    pub(super) fn skip(mut self) -> Result<(), CodecError> {
        while self.left > 0 {
            self.byte()?;
        }
        Ok(())
    }
}

/// The input stops inside the image.
#[cold]
pub(super) fn ends_early() -> CodecError {
    Damage::EndsEarly.into()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Gives one byte per read, each after an interruption.
    struct Drip<'a>(&'a [u8], bool);

    impl Read for Drip<'_> {
        fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
            self.1 = !self.1;
            if self.1 {
                return Err(io::ErrorKind::Interrupted.into());
            }
            let count = self.0.len().min(1);
            out[..count].copy_from_slice(&self.0[..count]);
            self.0 = &self.0[count..];
            Ok(count)
        }
    }

    #[test]
    fn slow_inputs_and_interruptions_change_nothing() {
        let mut drip = Drip(&[1, 2, 0, 4, 9, 9, 0xFF, 0x00, 0xFF, 0xFF, 0xDA, 7], false);
        let mut bytes = Bytes::new(&mut drip);
        assert_eq!(bytes.pair().unwrap(), 0x0102);
        bytes.segment().unwrap().skip().unwrap();
        assert_eq!(bytes.marker().unwrap(), Some(0xDA));
        assert_eq!(bytes.next().unwrap(), Some(7));
        assert_eq!(bytes.next().unwrap(), None);
        assert!(bytes.byte().is_err());
    }

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

    #[test]
    fn a_segment_keeps_to_its_length() {
        let mut input = &[0, 3, 5, 6, 7][..];
        let mut bytes = Bytes::new(&mut input);
        let mut segment = bytes.segment().unwrap();
        assert_eq!((segment.byte().unwrap(), segment.left()), (5, 0));
        assert!(segment.byte().is_err());
        let mut input = &[0, 1][..];
        assert!(Bytes::new(&mut input).segment().is_err());
    }
}
