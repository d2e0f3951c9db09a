//! What is odd about DICOM series.

/// Something about a DICOM series that can be used.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq)]
pub enum DicomNote {
    /// In words.
    Text(String),
}

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

impl From<String> for DicomNote {
    fn from(text: String) -> Self {
        Self::Text(text)
    }
}
