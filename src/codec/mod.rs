//! Decoders of compressed images, one frame at a time, row by row.
//!
//! A decoder reads a [`std::io::Read`] and hands rows to a [`RowSink`]; it never sees a file, a volume or a
//! DICOM element. What it holds is bounded by the memory it is given, and its time by the size that the
//! receiver accepted: nothing is allocated, and nothing looped over, because a codestream says so.

pub mod jpeg;
pub mod jpeg2000;
pub mod jpegls;
pub mod rle;

use std::io;

use thiserror::Error;

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

/// Why a frame cannot be decoded.
#[non_exhaustive]
#[derive(Debug, Error)]
pub enum CodecError {
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
