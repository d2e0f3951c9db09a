//! Sentences about binary headers: NIfTI, NumPy.

use std::fmt;

use crate::facts::nifti::NiftiFault;
use crate::facts::npy::NpyFault;

impl fmt::Display for NiftiFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::WithinHeader { offset } => {
                write!(f, "its samples begin at byte {offset}, within its header")
            }
            Self::NoImage => {
                f.write_str("is the header of a pair, and no .img file lies beside it; copy both")
            }
            Self::Short { bytes } => {
                write!(f, "ends after {bytes} bytes, within its NIfTI header; copy the file again")
            }
            Self::Length => {
                f.write_str("its NIfTI header is damaged: it states another length than 348 or 540")
            }
            Self::Dimensions { count } => {
                write!(f, "its NIfTI header is damaged: it has {count} dimensions")
            }
            Self::Analyze => f.write_str(
                "is ANALYZE 7.5, or a damaged NIfTI header: left and right are not told apart, so it is not read; convert it to NIfTI",
            ),
            Self::Nowhere => f.write_str("its NIfTI header is damaged: its samples begin nowhere"),
            Self::NoMagic => f.write_str("its NIfTI-2 header is damaged: it has no magic"),
            Self::TextTransfer => f.write_str(
                "its NIfTI-2 header was changed by a transfer as text; copy the file as binary",
            ),
            Self::SeveralValues { dimensions } => write!(
                f,
                "has {dimensions} dimensions, so a voxel has several values; extract one component into a file of its own"
            ),
            Self::Type { code } => {
                let what = match code {
                    1 => "single bits",
                    32 | 1792 | 2048 => "complex numbers",
                    128 | 2304 => "colours (RGB)",
                    1536 => "128-bit floats",
                    other => {
                        return write!(
                            f,
                            "its samples are of the unknown type {other}, which is not read"
                        );
                    }
                };
                write!(f, "its samples are {what}, which is not read")
            }
        }
    }
}

impl fmt::Display for NpyFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Short => f.write_str("ends within its header; copy the file again"),
            Self::Version { version } => write!(f, "is .npy of version {version}; 1 to 3 are read"),
            Self::LongHeader { bytes } => {
                write!(f, "its header of {bytes} bytes is no array of numbers")
            }
            Self::Dimensions { count } => {
                write!(f, "has {count} dimensions; arrays of 2 or 3 are read, save one volume")
            }
            Self::NoArray => f.write_str("its header is no description of an array"),
            Self::Structured => f.write_str("is a structured array, whose elements are no numbers"),
            Self::Type { descr } => write!(
                f,
                "its elements are of the type `{}`, which is not read; save real numbers of up to 64 bits",
                descr.escape_debug()
            ),
        }
    }
}
