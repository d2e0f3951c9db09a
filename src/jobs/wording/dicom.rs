//! Sentences about DICOM series.

use std::fmt;

use crate::facts::dicom::{DicomFault, DicomNote};

impl fmt::Display for DicomNote {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Text(text) => f.write_str(text),
        }
    }
}

impl fmt::Display for DicomFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Damaged(text) | Self::NoVolume(text) => f.write_str(text),
        }
    }
}
