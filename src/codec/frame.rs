//! What goes into a decoder, and what comes out of it.

use std::io;

use super::error::CodecError;

/// What a codestream says of its image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameFormat {
    /// Width in pixels.
    pub columns: u32,
    /// Height in pixels.
    pub rows: u32,
    /// Samples per pixel.
    pub components: u8,
    /// Bits per sample.
    pub precision: u8,
    /// Are samples two's complement? False where the codestream cannot say.
    pub signed: bool,
}

/// Receives a decoded frame, top to bottom.
pub trait RowSink {
    /// Called once, before any row and before anything of the image's size is allocated. A receiver that
    /// refuses ends the decoding with its error.
    ///
    /// # Errors
    /// The format is not what the receiver expects.
    fn begin(&mut self, format: &FrameFormat) -> Result<(), CodecError>;

    /// One row: `columns * components` samples, the components of a pixel side by side. Unsigned samples
    /// of 32 bits come as their bit pattern.
    ///
    /// # Errors
    /// The receiver cannot take it.
    fn row(&mut self, samples: &[i32]) -> Result<(), CodecError>;
}

/// The bytes of one compressed frame, wherever its fragments lie.
pub trait FrameBytes {
    /// How many there are.
    fn len(&self) -> u64;

    /// Are there none?
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Reads some bytes at `offset`; 0 at the end.
    ///
    /// # Errors
    /// The file failed.
    fn read_at(&self, buf: &mut [u8], offset: u64) -> io::Result<usize>;
}

impl FrameBytes for Vec<u8> {
    fn len(&self) -> u64 {
        self.as_slice().len() as u64
    }

    fn read_at(&self, buffer: &mut [u8], offset: u64) -> io::Result<usize> {
        let rest = usize::try_from(offset).ok().and_then(|offset| self.get(offset..)).unwrap_or_default();
        let taken = rest.len().min(buffer.len());
        if let (Some(to), Some(from)) = (buffer.get_mut(..taken), rest.get(..taken)) {
            to.copy_from_slice(from);
        }
        Ok(taken)
    }
}

/// Reads [`FrameBytes`] from its first byte to its last.
pub struct FrameReader<'a> {
    bytes: &'a dyn FrameBytes,
    at: u64,
}

impl<'a> FrameReader<'a> {
    /// Starts at the first byte.
    #[must_use]
    pub fn new(bytes: &'a dyn FrameBytes) -> FrameReader<'a> {
        FrameReader { bytes, at: 0 }
    }
}

impl io::Read for FrameReader<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let taken = self.bytes.read_at(buffer, self.at)?;
        self.at = self.at.saturating_add(taken as u64);
        Ok(taken)
    }
}
