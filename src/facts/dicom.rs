//! What is odd or wrong about DICOM series.

use thiserror::Error;

/// Something about a DICOM series that can be used.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq)]
pub enum DicomNote {
    /// In words.
    Text(String),
}

/// Why a DICOM file or series cannot be used.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Error)]
pub enum DicomFault {
    /// It is damaged; in words.
    Damaged(String),
    /// It forms no volume; in words.
    NoVolume(String),
}

/// What a DICOM file is that is not an image, in words.
pub type NotImage = String;

/// End of a sentence that tells of an assumed spacing.
const NO_SPACING: &str = "; 1 mm is assumed";

impl DicomNote {
    /// Does it tell of a spacing that was assumed, along one axis at least?
    pub fn assumes_spacing(&self) -> bool {
        match self {
            Self::Text(text) => text.ends_with(NO_SPACING),
        }
    }
}

impl DicomFault {
    /// Is the input broken, rather than of a kind that is not used?
    pub fn is_damage(&self) -> bool {
        matches!(self, Self::Damaged(_))
    }
}

impl From<String> for DicomNote {
    fn from(text: String) -> Self {
        Self::Text(text)
    }
}
