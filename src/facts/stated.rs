//! Who states what, in which form: small facts that notes and faults share.

use std::fmt;

use thiserror::Error;

use crate::text::Name;

/// What carries samples, and states or does not state where they lie.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Carrier {
    /// A header of a format that could state it.
    Header,
    /// A TIFF file; some state their spacing.
    Tiff,
    /// PNG pictures.
    Png,
    /// A NumPy array.
    Npy,
    /// A Zarr array; images of OME-Zarr state their spacing.
    Zarr,
}

/// Who states what the file does not, or otherwise.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StatedBy {
    /// The user who opens the volume.
    Caller,
    /// A side-car beside the file.
    SideCar,
}

impl StatedBy {
    /// What was stated: an option of the caller, or a key of the side-car.
    pub(crate) fn named(self, option: Name, key: &str) -> String {
        match self {
            Self::Caller => option.to_string(),
            Self::SideCar => format!("{key} of the side-car"),
        }
    }
}

/// One of the two affines of a NIfTI header.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// The one of three rows.
    Sform,
    /// The one of a quaternion.
    Qform,
}

impl fmt::Display for Form {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Sform => "sform",
            Self::Qform => "qform",
        })
    }
}

/// A number of a header that is infinite, or NaN.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
pub enum StatedNumber {
    #[error("the header states a spacing of {stated} along axis {}; 1 mm is assumed there", axis + 1)]
    Spacing {
        /// The axis, from 0.
        axis: usize,
        /// As it is stated.
        stated: f64,
    },
    #[error("the header states a slope of {stated}, which is ignored: values are as stored")]
    Slope {
        /// As it is stated.
        stated: f64,
    },
    /// A number of an affine.
    #[error("the {0} of the header has numbers that are not finite, and is not used")]
    Form(Form),
}

/// How samples are packed in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Packing {
    Raw,
    Gzip,
    Zlib,
    Bzip2,
    Text,
    Hex,
}

impl fmt::Display for Packing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Raw => "raw",
            Self::Gzip => "gzip",
            Self::Zlib => "zlib",
            Self::Bzip2 => "bzip2",
            Self::Text => "text",
            Self::Hex => "hexadecimal",
        })
    }
}
