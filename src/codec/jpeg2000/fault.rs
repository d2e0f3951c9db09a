//! What can be wrong with a JPEG 2000 image.

/// What is damaged in a JPEG 2000 image.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Damage {
    /// A code-block without bit planes has passes.
    PassesWithoutPlanes,
    /// A code-block has more passes than bit planes.
    MorePassesThanPlanes,
    /// A high-throughput code-block is impossible.
    HighThroughputBlock,
    /// Too many code-blocks.
    ManyBlocks,
    /// A packet header ends early.
    ShortPacketHeader,
    /// Packets are missing.
    MissingPackets,
    /// A packet ends early.
    ShortPacket,
    /// Its packets lead nowhere.
    EndlessPackets,
    /// A code-block has impossible bit planes.
    BitPlanes,
    /// The length of a code-block is impossible.
    BlockLength,
    /// A header ends early.
    ShortHeader,
    /// A marker is expected in a header, and there is none.
    NoMarker,
    /// A marker segment has no length.
    NoSegmentLength,
    /// It starts like neither a JPEG 2000 codestream nor a JP2 file.
    NoStart,
    /// A JP2 box is shorter than its head.
    ShortBox,
    /// The JP2 file holds no codestream.
    NoCodestream,
    /// The codestream does not begin with its size.
    NoSize,
    /// The image is empty.
    EmptyImage,
    /// The first tile holds nothing of the image.
    EmptyTile,
    /// A precision of more than 38 bits.
    Precision,
    /// More than 65535 tiles.
    ManyTiles,
    /// A sub-band has no quantisation step.
    NoStep,
    /// More than 32 decomposition levels.
    ManyLevels,
    /// Code-blocks of more than 4096 samples.
    LargeBlocks,
    /// A precinct is smaller than a sample.
    SmallPrecinct,
    /// Too many precincts.
    ManyPrecincts,
    /// An unknown quantisation style.
    QuantisationStyle,
    /// The main header is followed by no tile.
    NoTile,
    /// The main header lacks the coding style or the quantisation.
    IncompleteHeader,
    /// A component is not described.
    ComponentUndescribed,
    /// A header is for a component that is not there.
    ComponentUnknown,
    /// An unknown progression order, or no layer.
    Progression,
    /// An unknown progression order, or more than 32 changes of it.
    ProgressionChanges,
    /// A tile-part is expected, and there is none.
    NoTilePart,
    /// A tile is outside the image.
    TileOutside,
    /// A tile-part has no data.
    EmptyTilePart,
    /// A tile-part is shorter than its header.
    ShortTilePart,
    /// Components transformed together are of different wavelets.
    MixedWavelets,
}

/// What a JPEG 2000 image may use that is not decoded.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Feature {
    /// That many coding passes of a code-block.
    CodingPasses,
    /// A palette.
    Palette,
    /// A side of more than 2147483647 pixels.
    LongSide,
    /// More than 255 components.
    Components,
    /// Subsampled components.
    Subsampling,
    /// Components of different precision or sign.
    MixedComponents,
    /// Code-blocks of both block coders.
    MixedBlockCoders,
    /// A wavelet transform of Part 2.
    Wavelet,
    /// A component transform of Part 2.
    ComponentTransform,
    /// Packed packet headers.
    PackedHeaders,
    /// A codestream of more than 4 GiB.
    LongCodestream,
    /// Samples of more than 28 bits.
    Precision,
    /// That many bit planes.
    BitPlanes,
}
