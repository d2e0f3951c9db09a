//! Sentences about DICOM series.

use std::fmt;

use crate::facts::DicomNote;

impl fmt::Display for DicomNote {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Text(text) => f.write_str(text),
        }
    }
}
