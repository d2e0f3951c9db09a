//! Decodes the frames of a file row by row: compressed, deflated, bits, tables and colour.

use std::fs::File;
use std::path::Path;

use super::header::DicomHeader;
use super::image::Image;
use super::pixels::Padding;
use crate::source::SourceError;

/// Receives decoded frames.
pub trait FrameSink {
    /// Is this frame wanted? Frames that are not are stepped over.
    fn wants(&mut self, frame: u32) -> bool {
        let _ = frame;
        true
    }

    /// Stored values of this frame that are to be replaced (see [`super::PixelLayout::padding`]).
    fn padding(&mut self, frame: u32) -> Option<Padding> {
        let _ = frame;
        None
    }

    /// One row, top to bottom: samples of the image's delivered type in native byte order.
    ///
    /// # Errors
    /// The samples cannot be kept.
    fn row(&mut self, frame: u32, row: u32, samples: &[u8]) -> Result<(), SourceError>;
}

/// Decodes the frames that are wanted, in the order of the file, row by row, in one pass.
///
/// # Errors
/// A frame is damaged or of a kind that is not decoded here, the memory is too little, the file failed,
/// or the sink did. The `path` is for messages.
pub fn unroll(
    file: &File,
    path: &Path,
    header: &DicomHeader,
    image: &Image,
    memory_bytes: u64,
    sink: &mut dyn FrameSink,
) -> Result<(), SourceError> {
    let _ = (file, header, image, memory_bytes, sink);
    Err(SourceError::Unusable { path: path.to_path_buf(), reason: "cannot be decoded yet".into() })
}

impl Image {
    /// Bytes of memory that [`unroll`] holds for this image at least, and as a rule at most; JPEG 2000
    /// takes what its codestream needs.
    pub fn unroll_bytes(&self) -> u64 {
        0
    }
}
