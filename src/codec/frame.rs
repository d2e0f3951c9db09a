//! Input and output of a decoder.

use std::io;

use super::error::CodecError;

/// The format that a codestream states.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct FrameFormat {
    pub(crate) columns: u32,
    pub(crate) rows: u32,
    /// Samples per pixel.
    pub(crate) components: u8,
    /// Bits per sample.
    pub(crate) precision: u8,
    /// True for samples in two's complement; false where the codestream cannot say.
    pub(crate) signed: bool,
}

/// Receives a decoded frame, top to bottom.
pub(crate) trait RowSink {
    /// Called once, before any row and before anything of the image's size is allocated. A receiver that
    /// refuses ends the decoding with its error.
    ///
    /// # Errors
    /// The receiver expects another format.
    fn begin(&mut self, format: &FrameFormat) -> Result<(), CodecError>;

    /// One row: `columns * components` samples, the components of a pixel side by side. Unsigned samples
    /// of 32 bits come as their bit pattern.
    ///
    /// # Errors
    /// The receiver cannot take it.
    fn row(&mut self, samples: &[i32]) -> Result<(), CodecError>;
}

/// The bytes of one compressed frame, wherever its fragments lie.
pub(crate) trait FrameBytes {
    fn len(&self) -> u64;

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
