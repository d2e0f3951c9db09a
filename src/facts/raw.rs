//! What is said of a file without a header, and what is impossible in it.

use crate::geom::Dims;

/// What is wrong with what is said of files without a header.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum RawFault {
    /// Not one file for each slice.
    Files {
        /// How many files.
        files: usize,
        /// Size of the volume.
        dims: Dims,
    },
    /// The spacing is not three positive numbers.
    Spacing,
    /// No file can be as long as dims and skip require.
    Length,
}

/// What a file without a header was said to hold.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RawLayout {
    /// Size of the whole volume.
    pub dims: Dims,
    /// Name of the samples' type.
    pub dtype: &'static str,
    /// Which slice file it is, from 0, and of how many, where there are several.
    pub slice: Option<[usize; 2]>,
    /// Bytes before the samples.
    pub skip: u64,
}
