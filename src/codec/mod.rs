//! Decoders of compressed images, one frame at a time, row by row.
//!
//! A decoder reads a [`std::io::Read`] and hands rows to a [`RowSink`]; it never sees a file, a volume or a
//! DICOM element. What it holds is bounded by the memory it is given, and its time by the size that the
//! receiver accepted: nothing is allocated, and nothing looped over, because a codestream says so.

pub(crate) mod jpeg;
pub(crate) mod jpeg2000;
pub(crate) mod jpegls;
#[cfg(test)]
#[path = "../../tests/support/codec/kept.rs"]
mod kept;
pub(crate) mod rle;

use std::io;

use thiserror::Error;

/// What a codestream says of its image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct FrameFormat {
    /// Width in pixels.
    pub(crate) columns: u32,
    /// Height in pixels.
    pub(crate) rows: u32,
    /// Samples per pixel.
    pub(crate) components: u8,
    /// Bits per sample.
    pub(crate) precision: u8,
    /// Are samples two's complement? False where the codestream cannot say.
    pub(crate) signed: bool,
}

/// Receives a decoded frame, top to bottom.
pub(crate) trait RowSink {
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

/// Why a frame cannot be decoded.
#[non_exhaustive]
#[derive(Debug, Error)]
pub(crate) enum CodecError {
    /// The codestream is damaged, or ends early.
    #[error("the compressed image is damaged: {0}")]
    Damaged(String),
    /// The codestream is sound, but of a kind that is not decoded here.
    #[error("the compressed image uses {0}, which is not supported")]
    Unsupported(String),
    /// Decoding needs more memory than allowed.
    #[error("decoding the image needs {needed_bytes} bytes of memory, and {allowed_bytes} are allowed")]
    Memory {
        /// Bytes that decoding would take.
        needed_bytes: u64,
        /// Bytes that it may take.
        allowed_bytes: u64,
    },
    /// The input failed, or the receiver did.
    #[error("{0}")]
    Io(#[from] io::Error),
}

/// The bytes of one compressed frame, wherever its fragments lie.
pub(crate) trait FrameBytes {
    /// How many there are.
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
