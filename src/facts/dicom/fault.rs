//! Why a DICOM input cannot be used.

use thiserror::Error;

use super::image::ImageFault;
use super::scan::{DeflateFault, ScanError};
use super::series::SeriesFault;
use crate::codec::CodecError;

/// The cure for a file that breaks off, or is damaged, among others.
const WITHOUT_IT: &str = "; copy the file again, or move it away to build without it";

/// The cure for a file that proved damaged when it was decoded.
const LEAVE_OUT: &str = "; copy the file again, or leave it out";

/// Why a DICOM file or series cannot be used.
#[non_exhaustive]
#[derive(Debug, Error)]
pub(crate) enum DicomFault {
    #[error("{0}")]
    Header(ScanError),
    #[error("{0}; was it changed while the folders were searched?")]
    Lost(ScanError),
    #[error("was changed since it was found; start again")]
    Changed,
    #[error("{}{}", .0, if .0.is_cut_short() { WITHOUT_IT } else { "" })]
    Image(ImageFault),
    #[error("{0}{WITHOUT_IT}")]
    OneImage(ImageFault),
    #[error("none of its {images} images can be used: {first}")]
    EveryImage { images: usize, first: ImageFault },
    #[error("{0}")]
    Series(SeriesFault),
    #[error("{0}{LEAVE_OUT}")]
    Elements(ScanError),
    #[error("cannot be decoded: {0}")]
    Deflate(DeflateFault),
    #[error("the pixels are cut short: {got} bytes of {needed}{LEAVE_OUT}")]
    PixelsCut { needed: u64, got: u64 },
    #[error("{}{error}", .frame.map_or_else(String::new, |frame| format!("in frame {} ", u64::from(frame) + 1)))]
    Frame {
        /// Its number, from 0, where there are several.
        frame: Option<u32>,
        error: CodecError,
    },
}

impl DicomFault {
    /// Is the input broken, rather than of a kind that is not used? Another volume is not taken in its stead
    /// in silence.
    pub(crate) fn is_damage(&self) -> bool {
        match self {
            Self::Image(fault) => fault.is_cut_short(),
            Self::EveryImage { .. } | Self::Series(_) => false,
            _ => true,
        }
    }
}
