//! What can be wrong with NumPy arrays.

use thiserror::Error;

/// Why a NumPy array is refused.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Error)]
pub(crate) enum NpyFault {
    #[error("ends within its header; copy the file again")]
    Short,
    #[error("is .npy of version {version}; 1 to 3 are read")]
    Version { version: u8 },
    #[error("its header of {bytes} bytes is not an array of numbers")]
    LongHeader { bytes: u64 },
    #[error("has {count} dimensions; arrays of 2 or 3 are read, save one volume")]
    Dimensions { count: usize },
    #[error("its header is not a description of an array")]
    NoArray,
    #[error("is a structured array, whose elements are not numbers")]
    Structured,
    #[error("its elements are of the type `{}`, which is not read; save real numbers of up to 64 bits", .descr.escape_debug())]
    Type { descr: String },
}
