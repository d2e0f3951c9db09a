//! What can be wrong with MetaImage headers.

use thiserror::Error;

/// Why a MetaImage header is refused.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Error)]
pub(crate) enum MetaImageFault {
    #[error("its field `{}` makes no sense", .line.escape_debug())]
    Field { line: String },
    #[error("its header ends without ElementDataFile, which names the samples")]
    NoDataFile,
    #[error("its header states NDims = {count} and {sizes} sizes; volumes of 2 to 4 dimensions are read")]
    Dimensions { count: usize, sizes: usize },
    #[error("has {count} channels a voxel; extract one into a file of its own")]
    Channels { count: u64 },
    #[error("its ElementType `{}` is not read", .name.escape_debug())]
    Type { name: String },
    #[error("its spacing, offset or matrix has fewer numbers than the volume has dimensions")]
    FewNumbers,
    #[error("compressed text is not read")]
    CompressedText,
    #[error("HeaderSize = -1 is for uncompressed samples only")]
    SkipAllButSamples,
}
