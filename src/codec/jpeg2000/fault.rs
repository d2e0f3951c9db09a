//! Errors in a JPEG 2000 image.

use thiserror::Error;

/// Damage in a JPEG 2000 image.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum Damage {
    #[error("a code-block without bit planes has passes")]
    PassesWithoutPlanes,
    #[error("a code-block has more passes than bit planes")]
    MorePassesThanPlanes,
    #[error("a high-throughput code-block is impossible")]
    HighThroughputBlock,
    #[error("too many code-blocks")]
    ManyBlocks,
    #[error("a packet header ends early")]
    ShortPacketHeader,
    #[error("packets are missing")]
    MissingPackets,
    #[error("a packet ends early")]
    ShortPacket,
    #[error("its packets lead nowhere")]
    EndlessPackets,
    #[error("a code-block has impossible bit planes")]
    BitPlanes,
    #[error("the length of a code-block is impossible")]
    BlockLength,
    #[error("a header ends early")]
    ShortHeader,
    #[error("a marker is expected in a header, and there is none")]
    NoMarker,
    #[error("a marker segment has no length")]
    NoSegmentLength,
    #[error("it starts like neither a JPEG 2000 codestream nor a JP2 file")]
    NoStart,
    #[error("a JP2 box is shorter than its head")]
    ShortBox,
    #[error("the JP2 file holds no codestream")]
    NoCodestream,
    #[error("the codestream does not begin with its size")]
    NoSize,
    #[error("the image is empty")]
    EmptyImage,
    #[error("the first tile holds nothing of the image")]
    EmptyTile,
    #[error("a precision of more than 38 bits")]
    Precision,
    #[error("more than 65535 tiles")]
    ManyTiles,
    #[error("a sub-band has no quantisation step")]
    NoStep,
    #[error("more than 32 decomposition levels")]
    ManyLevels,
    #[error("code-blocks of more than 4096 samples")]
    LargeBlocks,
    #[error("a precinct is smaller than a sample")]
    SmallPrecinct,
    #[error("too many precincts")]
    ManyPrecincts,
    #[error("an unknown quantisation style")]
    QuantisationStyle,
    #[error("the main header is followed by no tile")]
    NoTile,
    #[error("the main header lacks the coding style or the quantisation")]
    IncompleteHeader,
    #[error("a component is not described")]
    ComponentUndescribed,
    #[error("a header is for a component that is not there")]
    ComponentUnknown,
    #[error("an unknown progression order, or no layer")]
    Progression,
    #[error("an unknown progression order, or more than 32 changes of it")]
    ProgressionChanges,
    #[error("a tile-part is expected, and there is none")]
    NoTilePart,
    #[error("a tile is outside the image")]
    TileOutside,
    #[error("a tile-part has no data")]
    EmptyTilePart,
    #[error("a tile-part is shorter than its header")]
    ShortTilePart,
    #[error("components transformed together are of different wavelets")]
    MixedWavelets,
}

/// Features of JPEG 2000 images that are not decoded.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum Feature {
    #[error("that many coding passes of a code-block")]
    CodingPasses,
    #[error("a palette")]
    Palette,
    #[error("a side of more than 2147483647 pixels")]
    LongSide,
    #[error("more than 255 components")]
    Components,
    #[error("subsampled components")]
    Subsampling,
    #[error("components of different precision or sign")]
    MixedComponents,
    #[error("code-blocks of both block coders")]
    MixedBlockCoders,
    #[error("a wavelet transform of Part 2")]
    Wavelet,
    #[error("a component transform of Part 2")]
    ComponentTransform,
    #[error("packed packet headers")]
    PackedHeaders,
    #[error("a codestream of more than 4 GiB")]
    LongCodestream,
    #[error("samples of more than 28 bits")]
    Precision,
    #[error("that many bit planes")]
    BitPlanes,
}
