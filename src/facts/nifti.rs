//! What can be wrong with NIfTI headers.

/// Why a NIfTI header is refused.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq)]
pub enum NiftiFault {
    /// The samples begin within the header.
    WithinHeader {
        /// At this byte.
        offset: u64,
    },
    /// The header of a pair without its samples.
    NoImage,
    /// The file ends within the header.
    Short {
        /// Bytes that are there.
        bytes: usize,
    },
    /// The header states another length than that of either version.
    Length,
    /// The number of dimensions is out of range.
    Dimensions {
        /// As stated.
        count: i64,
    },
    /// ANALYZE 7.5, or a damaged magic.
    Analyze,
    /// The offset of the samples is no offset.
    Nowhere,
    /// NIfTI-2 without its magic.
    NoMagic,
    /// NIfTI-2 whose line ends were changed.
    TextTransfer,
    /// A voxel has several values.
    SeveralValues {
        /// Dimensions of the volume.
        dimensions: i64,
    },
    /// Samples of a type that is not read.
    Type {
        /// Its code in the standard.
        code: i16,
    },
}
