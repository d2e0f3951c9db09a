//! What can be wrong with NumPy arrays.

/// Why a NumPy array is refused.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq)]
pub enum NpyFault {
    /// The file ends within its header.
    Short,
    /// A version that is not read.
    Version {
        /// Its number.
        version: u8,
    },
    /// A header too long for an array of numbers.
    LongHeader {
        /// Its bytes.
        bytes: u64,
    },
    /// Too few or too many dimensions.
    Dimensions {
        /// How many.
        count: usize,
    },
    /// The header describes no array.
    NoArray,
    /// The elements are records.
    Structured,
    /// Elements of a type that is not read.
    Type {
        /// NumPy's name of it.
        descr: String,
    },
}
