//! Why a DICOM input cannot be used.

use thiserror::Error;

use super::image::ImageFault;
use super::scan::{DeflateFault, ScanError};
use super::series::SeriesFault;
use crate::codec::CodecError;

/// Why a DICOM file or series cannot be used.
#[non_exhaustive]
#[derive(Debug, Error)]
pub enum DicomFault {
    /// Its header cannot be read.
    Header(ScanError),
    /// It was an image when the folders were searched, and is not any more.
    Lost(ScanError),
    /// It was changed after it was found.
    Changed,
    /// The only image cannot be used.
    Image(ImageFault),
    /// One image of several cannot be used: without it the volume would lack a slice.
    OneImage(ImageFault),
    /// None of the images can be used.
    EveryImage {
        /// How many.
        images: usize,
        /// What is wrong with the first.
        first: ImageFault,
    },
    /// The images form no volume.
    Series(SeriesFault),
    /// Fragments or tables cannot be followed while frames are decoded.
    Elements(ScanError),
    /// The stream of a deflated file is wrong.
    Deflate(DeflateFault),
    /// The pixels end early.
    PixelsCut {
        /// Bytes that they need.
        needed: u64,
        /// Bytes that are there.
        got: u64,
    },
    /// A compressed frame cannot be decoded.
    Frame {
        /// Its number, from 0, where there are several.
        frame: Option<u32>,
        /// Why.
        error: CodecError,
    },
}

impl DicomFault {
    /// Is the input broken, rather than of a kind that is not used? Another volume is not taken in its stead
    /// in silence.
    pub fn is_damage(&self) -> bool {
        match self {
            Self::Image(fault) => fault.is_cut_short(),
            Self::EveryImage { .. } | Self::Series(_) => false,
            _ => true,
        }
    }
}
