//! What can be wrong with the bytes of an `.oct`, as values; the sentences are written in `jobs`.

use thiserror::Error;

use super::metadata::Selection;
use super::packed::CodingError;
use super::{Channel, SectionKind};
use crate::geom::{Level, NodeIndex, VoxelIndex};

/// A rule of SPEC.md that the bytes of a file, or what is to be written into one, break.
///
/// The numbers I1 to I18 are those of SPEC 6. Sections are counted in the order of the table, from 0.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Error)]
pub enum FormatError {
    /// I1: another program's file, or an empty one.
    BadMagic,
    /// I1: written by a newer program.
    UnsupportedVersion {
        /// Major version found.
        major: u16,
    },
    /// I1: the header's bytes are not those that were written.
    HeaderChecksum {
        /// CRC that the header states.
        stated: u32,
        /// CRC of its bytes.
        found: u32,
    },
    /// I1: neither mapped nor packed.
    UnknownEncoding {
        /// Code found.
        code: u8,
    },
    /// I2: too short for what its header says.
    Truncated {
        /// Bytes needed.
        expected: u64,
        /// Bytes present.
        got: u64,
    },
    /// I2: longer than its header says.
    TrailingBytes {
        /// Surplus.
        extra: u64,
    },
    /// I3: the section table's bytes are not those that were written.
    TableChecksum {
        /// CRC that the header states.
        stated: u32,
        /// CRC of the table.
        found: u32,
    },
    /// I3: a file has 1 to 64 sections.
    SectionCount {
        /// Sections that the header states.
        sections: u16,
    },
    /// I3: a section does not start where it must.
    SectionGap {
        /// Which section.
        section: u16,
        /// First multiple of 64 at or after the end of what stands before it.
        expected: u64,
        /// Where the table says it starts.
        found: u64,
    },
    /// I3: content bytes are not items times bytes per item.
    SectionSize {
        /// Which section.
        section: u16,
        /// Bytes per item.
        item_bytes: u8,
        /// Items.
        items: u64,
        /// Content bytes that the table states.
        content_bytes: u64,
    },
    /// I3: a section without a codec states other bytes or another CRC than its content's.
    SectionNotPlain {
        /// Which section.
        section: u16,
        /// Stored bytes.
        stored_bytes: u64,
        /// Content bytes.
        content_bytes: u64,
    },
    /// I3: a kind stands twice, or before one that it must follow.
    SectionOrder {
        /// Which section.
        section: u16,
        /// Its kind.
        kind: SectionKind,
        /// The known kind before it.
        after: SectionKind,
    },
    /// I3: the last section ends before or after the file.
    LastSectionEnd {
        /// End of the last section.
        end: u64,
        /// Length of the file.
        file_bytes: u64,
    },
    /// I4: a required section is not there.
    MissingSection(SectionKind),
    /// I4: a packed file has a rank directory.
    RankInPackedFile,
    /// Fine parts of normals without the normals, or of cells.
    LoneFine,
    /// I4: coarse means without the voxels' own values.
    LoneMeans {
        /// The section of means.
        kind: SectionKind,
    },
    /// I4: a model of skin voxels has a section that only cells have.
    NotOfSkin {
        /// The section.
        kind: SectionKind,
    },
    /// I4: a section has a codec that must not have one.
    ForbiddenCodec {
        /// The section; `None` for an unknown kind.
        kind: Option<SectionKind>,
        /// Its codec.
        codec: u8,
    },
    /// I4: a section that is read whole is longer than it may be, or has items of a wrong size.
    SectionTooLong {
        /// `META` or `LEVL`.
        kind: SectionKind,
        /// Bytes per item.
        item_bytes: u8,
        /// Stored bytes.
        stored_bytes: u64,
    },
    /// I4: a section has other items than the model needs.
    SectionItems {
        /// The section.
        kind: SectionKind,
        /// Bytes per item that the table states.
        item_bytes: u8,
        /// Items that the table states.
        items: u64,
        /// Items that are due.
        due: u64,
    },
    /// I5: a side of the volume is not in 1..=65536.
    DimsRange {
        /// The sides.
        dims: [u32; 3],
    },
    /// I5: the depth is not the least that holds the dims.
    DepthMismatch {
        /// Depth that the header states.
        stated: u8,
        /// Depth of the dims.
        due: u32,
    },
    /// I5: no skin voxel, or more than the volume has.
    VoxelCount {
        /// Skin voxels that the header states.
        voxels: u64,
        /// Voxels of the volume.
        most: u64,
    },
    /// I5: more nodes than the skin voxels can have, or nodes in a grid without any, or none where some are due.
    NodeCount {
        /// Nodes that the header states.
        nodes: u64,
        /// Most that there can be.
        most: u64,
    },
    /// I6: the metadata's strings or lengths cannot be read.
    MetadataUnreadable {
        /// Length of the section.
        bytes: u64,
    },
    /// I6: the metadata does not fill its section.
    MetadataSurplus {
        /// Bytes after the record.
        extra: u64,
    },
    /// I6: the way in which the range was chosen is unknown.
    UnknownSelection {
        /// Code found.
        code: u8,
    },
    /// I6: an unknown sample type or connectivity.
    MetadataCodes {
        /// Code of the sample type.
        scalar: u8,
        /// Connectivity.
        connectivity: u8,
    },
    /// I6: affine, spacing or rescale are not finite, or the spacing is not positive.
    MetadataGeometry {
        /// The spacing.
        spacing_mm: [f64; 3],
    },
    /// I6: metadata and header disagree about the dims.
    MetadataDims {
        /// Dims of the metadata.
        metadata: [u32; 3],
        /// Dims of the header.
        header: [u32; 3],
    },
    /// I7: the level table has a wrong number of items.
    LevelCount {
        /// Items found.
        found: u64,
        /// L + 1.
        due: u64,
    },
    /// I7: the level table does not run from 0 to N.
    LevelEnds {
        /// First item.
        first: u64,
        /// Last item.
        last: u64,
        /// Nodes N.
        nodes: u64,
    },
    /// I7: a depth has more or fewer boxes than it can have.
    LevelBoxes {
        /// The level.
        level: Level,
        /// Boxes that the table gives it; `None` where the table falls.
        boxes: Option<u64>,
    },
    /// I6, I7, I8: a section's stored bytes are not those that were written.
    SectionChecksum {
        /// The section; `None` for an unknown kind.
        kind: Option<SectionKind>,
        /// Where its stored bytes begin.
        offset: u64,
        /// CRC that the table states.
        stated: u32,
        /// CRC of the bytes.
        found: u32,
    },
    /// I9: the header's reserved bytes are not zero.
    HeaderReserved {
        /// Their value.
        value: u32,
    },
    /// I9: reserved bytes of the section table are not zero.
    TableReserved {
        /// Which section.
        section: u16,
        /// Their value.
        value: u16,
    },
    /// I9: a byte between the sections is not zero.
    PaddingNotZero {
        /// Where it stands in the file.
        offset: u64,
    },
    /// I10: an infobyte is 0.
    EmptyNode {
        /// Level of the node.
        level: Level,
        /// Its number.
        node: NodeIndex,
        /// Its lowest cell.
        corner: [u32; 3],
    },
    /// I11: a depth has fewer nodes than their parents have children.
    MissingNode {
        /// The level.
        level: Level,
        /// Lowest cell of the first node that is not there.
        corner: [u32; 3],
    },
    /// I11: a depth has more boxes than their parents have children.
    SurplusBoxes {
        /// The level; that of the voxels is L.
        level: Level,
        /// Boxes that the file states for it.
        stated: u64,
        /// Boxes that the walk met.
        found: u64,
    },
    /// I11: a channel ends before the voxels do, or the rank directory before the nodes.
    MissingItem {
        /// The voxels' own items or their coarse means, or `RANK`.
        kind: SectionKind,
    },
    /// I11: a packed channel goes on after the last voxel.
    SurplusItems {
        /// The channel.
        kind: SectionKind,
        /// Bytes that no voxel has filled.
        room: u64,
    },
    /// I11, in packed files: the nodes of a depth of a subtree do not belong to their parents.
    SubtreeNodes {
        /// The level.
        level: Level,
        /// Nodes that the level table leaves for it.
        room: u64,
        /// Nodes that the subtrees bring.
        brought: u64,
    },
    /// I10, I11: a subtree has an empty node, or ends before its parents' children do.
    SubtreeCut {
        /// The level.
        level: Level,
    },
    /// I12: a box lies outside the volume.
    OutsideVolume {
        /// Level of the box.
        level: Level,
        /// Its lowest cell.
        corner: [u32; 3],
    },
    /// I13: an entry of the rank directory is not what the infobytes give.
    RankMismatch {
        /// First node of the block or superblock.
        node: NodeIndex,
        /// Set bits that the infobytes give.
        due: u64,
        /// What the directory says.
        found: u64,
    },
    /// I14: an item is what none of its channel may be: a normal with a component of -128.
    IllegalItem {
        /// The channel.
        channel: Channel,
        /// Number of the voxel.
        voxel: VoxelIndex,
        /// The item found, as a little-endian number.
        item: u64,
    },
    /// I18: the corners are not as many as the offsets announce.
    CornerCount {
        /// Cells whose offset announces corners.
        due: u64,
        /// Items of corners.
        found: u64,
    },
    /// I18: the directory of corners is not that of the offsets.
    CornerRank {
        /// Block of the directory.
        block: u64,
        /// Cells with corners before it.
        due: u64,
    },
    /// I15: a mean direction is not that of its voxels.
    MeanNormal {
        /// The channel.
        channel: Channel,
        /// Level of the node.
        level: Level,
        /// Its number.
        node: NodeIndex,
        /// Code that the voxels give.
        due: u16,
        /// Code found; `None` where the section has ended.
        found: Option<u16>,
    },
    /// I16: a mean number is not that of its voxels.
    MeanValue {
        /// The channel.
        channel: Channel,
        /// Level of the node.
        level: Level,
        /// Its number.
        node: NodeIndex,
        /// Value that the voxels give.
        due: u64,
        /// Value found.
        found: u64,
    },
    /// I17: the metadata speaks of a channel that is not there, or is silent of one that is: by the gradient's
    /// name of normals, by their scale of values.
    ChannelStated {
        /// The channel.
        channel: Channel,
        /// Does the metadata speak of it?
        stated: bool,
    },
    /// I17: the range is empty or NaN, or ends although it is open.
    SelectionRange {
        /// The range found.
        selection: Selection,
    },
    /// SPEC 5: the coded bytes of a packed file are wrong.
    Coding(CodingError),
    /// A packed file where a mapped one is needed.
    Packed,
    /// A packed file where one is to be packed.
    AlreadyPacked,
    /// A mapped file where one is to be unpacked.
    AlreadyMapped,
    /// Not to be packed: a section of unknown kind stands between nodes and rank directory.
    RankApart,
    /// SPEC I19: a minor version that is not the lowest that suffices.
    MinorApart {
        /// The version.
        minor: u16,
    },
    /// Not to be written: the metadata passes 1 MiB.
    MetadataTooLong {
        /// Its length.
        bytes: u64,
    },
    /// Not to be written: the metadata cannot be encoded.
    MetadataUnwritable,
    /// Not to be assembled: a value does not fit one byte.
    ValueTooLarge {
        /// The value.
        value: u16,
    },
    /// Not to be assembled: no voxels, one twice, or one outside the dims.
    VoxelSet {
        /// How many were given.
        voxels: u64,
    },
}

impl From<CodingError> for FormatError {
    fn from(cause: CodingError) -> Self {
        Self::Coding(cause)
    }
}

// Readers return it from loops over every voxel.
const _: () = assert!(size_of::<FormatError>() <= 32);
