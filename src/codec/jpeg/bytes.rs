//! Integers and marker segments, read byte by byte.

pub(super) use crate::codec::bytes::{BUFFER_BYTES, Bytes};
use crate::codec::{CodecError, damaged};

impl<'r> Bytes<'r> {
    /// The next byte, which must exist.
    pub(super) fn byte(&mut self) -> Result<u8, CodecError> {
        self.next()?.ok_or_else(ends_early)
    }

    /// Two bytes, the higher first.
    pub(super) fn pair(&mut self) -> Result<u16, CodecError> {
        Ok(u16::from_be_bytes([self.byte()?, self.byte()?]))
    }

    /// The next marker's second byte, after any other bytes; none at the end of the input.
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
            None => Err(damaged(format!("a marker segment claims a length of {length} bytes"))),
        }
    }
}

/// The inside of one marker segment; reading past its end is an error.
pub(super) struct Segment<'b, 'r> {
    bytes: &'b mut Bytes<'r>,
    left: u16,
}

impl Segment<'_, '_> {
    pub(super) fn left(&self) -> u16 {
        self.left
    }

    pub(super) fn byte(&mut self) -> Result<u8, CodecError> {
        self.left = self
            .left
            .checked_sub(1)
            .ok_or_else(|| damaged("a marker segment is shorter than its contents"))?;
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

    /// Skips the rest of the segment.
    pub(super) fn skip(mut self) -> Result<(), CodecError> {
        while self.left > 0 {
            self.byte()?;
        }
        Ok(())
    }
}

/// Error for input that stops inside the image.
#[cold]
pub(super) fn ends_early() -> CodecError {
    damaged("it ends early")
}

#[cfg(test)]
mod tests {
    use std::io::{self, Read};

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
