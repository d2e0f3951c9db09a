//! What can be wrong with MetaImage headers.

/// Why a MetaImage header is refused.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq)]
pub enum MetaImageFault {
    /// A field makes no sense.
    Field {
        /// Its line.
        line: String,
    },
    /// The header does not name the samples.
    NoDataFile,
    /// A number of dimensions that is not read, or not one size for each.
    Dimensions {
        /// Dimensions.
        count: usize,
        /// Sizes.
        sizes: usize,
    },
    /// A voxel has several values.
    Channels {
        /// How many.
        count: u64,
    },
    /// A sample type that is not read.
    Type {
        /// Its name.
        name: String,
    },
    /// Spacing, offset or matrix has too few numbers.
    FewNumbers,
    /// Pictures in a list, each with a place of its own: a free-hand sweep, not slices.
    Sweep,
    /// Samples are compressed text.
    CompressedText,
    /// All but the samples is to be skipped, of samples that are packed.
    SkipAllButSamples,
}
