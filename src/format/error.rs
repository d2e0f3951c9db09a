//! Errors in the bytes of an `.oct`, each a value with its sentence.

#![expect(missing_docs, reason = "the sentence of each variant says it")]

use thiserror::Error;

use super::metadata::Selection;
use super::packed::CodingError;
use super::{Channel, SectionKind};
use crate::geom::{Level, NodeIndex, VoxelIndex};
use crate::text::names::{BUILD, UNPACK};

/// A rule of SPEC.md that is broken by the bytes of a file, or by the content to be written into one.
///
/// SPEC 6 lists the variants of each rule, I1 to I18. Sections are counted in the order of the table, from 0.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Error)]
pub enum FormatError {
    #[error(
        "is not an infobyte .oct file (it is empty, or begins as another format does); build one with `{BUILD}`"
    )]
    BadMagic,
    #[error("has format version {major}; this program reads version 1: update infobyte")]
    UnsupportedVersion { major: u16 },
    #[error("{DAMAGED}the checksum of the header does not match{AGAIN}")]
    HeaderChecksum { stated: u32, found: u32 },
    #[error("{DAMAGED}encoding {code} is unknown{AGAIN}")]
    UnknownEncoding { code: u8 },
    #[error("is cut short: {expected} bytes are needed and {got} are there; copy or build it again")]
    Truncated { expected: u64, got: u64 },
    #[error("has {extra} bytes after its end; copy or build it again")]
    TrailingBytes { extra: u64 },
    #[error("{DAMAGED}the checksum of the section table does not match{AGAIN}")]
    TableChecksum { stated: u32, found: u32 },
    #[error("{DAMAGED}the number of sections is outside 1..=64 (SPEC I3){AGAIN}")]
    SectionCount { sections: u16 },
    #[error("{DAMAGED}sections do not follow each other without gaps{AGAIN}")]
    SectionGap {
        section: u16,
        /// First multiple of 64 at or after the end of the preceding section.
        expected: u64,
        /// Offset stated by the table.
        found: u64,
    },
    #[error("{DAMAGED}a section's size is not items times bytes per item{AGAIN}")]
    SectionSize { section: u16, item_bytes: u8, items: u64, content_bytes: u64 },
    /// I3: a section without a codec states other bytes or another CRC than its content's.
    #[error("{DAMAGED}an uncompressed section differs from its content{AGAIN}")]
    SectionNotPlain { section: u16, stored_bytes: u64, content_bytes: u64 },
    #[error("{DAMAGED}sections are repeated or out of order{AGAIN}")]
    SectionOrder {
        section: u16,
        kind: SectionKind,
        /// The preceding known kind.
        after: SectionKind,
    },
    #[error("{DAMAGED}the last section does not end where the file ends{AGAIN}")]
    LastSectionEnd { end: u64, file_bytes: u64 },
    #[error("{DAMAGED}{}{AGAIN}", missing(*.0))]
    MissingSection(SectionKind),
    #[error("{DAMAGED}{}{AGAIN}", missing(SectionKind::Rank))]
    RankInPackedFile,
    #[error("{DAMAGED}coarse means are there without the voxels' own (SPEC I4){AGAIN}")]
    LoneMeans { kind: SectionKind },
    #[error("{DAMAGED}a model of skin voxels has the {} section (SPEC I4){AGAIN}", .kind.name())]
    NotOfSkin { kind: SectionKind },
    #[error("{DAMAGED}a section is coded that must not be (SPEC I4){AGAIN}")]
    ForbiddenCodec {
        /// The section; `None` for an unknown kind.
        kind: Option<SectionKind>,
        codec: u8,
    },
    #[error("{DAMAGED}the {} section is too long (SPEC I4){AGAIN}", .kind.name())]
    SectionTooLong { kind: SectionKind, item_bytes: u8, stored_bytes: u64 },
    #[error("{DAMAGED}the {} section has {items} items of {item_bytes} bytes where {due} are due (SPEC I4){AGAIN}", .kind.name())]
    SectionItems { kind: SectionKind, item_bytes: u8, items: u64, due: u64 },
    #[error("{DAMAGED}dims are outside 1..=65536{AGAIN}")]
    DimsRange { dims: [u32; 3] },
    /// I5: the depth is not the least that holds the dims.
    #[error("{DAMAGED}the depth does not belong to the dims{AGAIN}")]
    DepthMismatch { stated: u8, due: u32 },
    #[error("{DAMAGED}the number of skin voxels is impossible for the dims{AGAIN}")]
    VoxelCount { voxels: u64, most: u64 },
    /// I5: more nodes than the skin voxels can have, or nodes in a grid without any, or none where some are due.
    #[error("{DAMAGED}the number of nodes is impossible for the skin voxels{AGAIN}")]
    NodeCount { nodes: u64, most: u64 },
    /// I6: the metadata's strings or lengths cannot be read.
    #[error("{DAMAGED}metadata cannot be read{AGAIN}")]
    MetadataUnreadable { bytes: u64 },
    #[error("{DAMAGED}metadata has bytes left over{AGAIN}")]
    MetadataSurplus { extra: u64 },
    #[error("{DAMAGED}selection kind {code} is unknown{AGAIN}")]
    UnknownSelection { code: u8 },
    #[error("{DAMAGED}metadata names an unknown sample type or connectivity{AGAIN}")]
    MetadataCodes { scalar: u8, connectivity: u8 },
    #[error("{DAMAGED}metadata states noise that cannot be{AGAIN}")]
    MetadataNoise,
    #[error("{DAMAGED}metadata has a geometry that is not finite and positive{AGAIN}")]
    MetadataGeometry { spacing_mm: [f64; 3] },
    #[error("{DAMAGED}metadata and header disagree about the dims (SPEC I6){AGAIN}")]
    MetadataDims { metadata: [u32; 3], header: [u32; 3] },
    #[error("{DAMAGED}the level table is impossible: it has a wrong number of items (SPEC I7){AGAIN}")]
    LevelCount {
        found: u64,
        /// L + 1.
        due: u64,
    },
    #[error(
        "{DAMAGED}the level table is impossible: it does not run from 0 to the number of nodes (SPEC I7){AGAIN}"
    )]
    LevelEnds { first: u64, last: u64, nodes: u64 },
    #[error(
        "{DAMAGED}the level table is impossible: a level has more or fewer boxes than it can have (SPEC I7){AGAIN}"
    )]
    LevelBoxes {
        level: Level,
        /// Number of boxes in the table; `None` where the table falls.
        boxes: Option<u64>,
    },
    #[error("{DAMAGED}the checksum of {} does not match{AGAIN}", .kind.map_or("a section of unknown kind", SectionKind::name))]
    SectionChecksum {
        /// The section; `None` for an unknown kind.
        kind: Option<SectionKind>,
        offset: u64,
        stated: u32,
        found: u32,
    },
    #[error("{DAMAGED}reserved header bytes are not zero{AGAIN}")]
    HeaderReserved { value: u32 },
    #[error("{DAMAGED}reserved bytes of the section table are not zero{AGAIN}")]
    TableReserved { section: u16, value: u16 },
    #[error("{DAMAGED}bytes between sections are not zero (SPEC I9){AGAIN}")]
    PaddingNotZero { offset: u64 },
    #[error("{DAMAGED}a node at depth {} has no children (SPEC I10){AGAIN}", .level.get())]
    EmptyNode { level: Level, node: NodeIndex, corner: [u32; 3] },
    #[error("{DAMAGED}depth {} has fewer nodes than their parents have children (SPEC I11){AGAIN}", .level.get())]
    MissingNode { level: Level, corner: [u32; 3] },
    #[error("{DAMAGED}a depth has more boxes than their parents have children (SPEC I11){AGAIN}")]
    SurplusBoxes {
        level: Level,
        stated: u64,
        /// Number of boxes that the walk met.
        found: u64,
    },
    #[error("{DAMAGED}{}{AGAIN}", too_few(*.kind))]
    MissingItem { kind: SectionKind },
    #[error("{DAMAGED}there are more {} than voxels (SPEC I11){AGAIN}", items_name(*.kind))]
    SurplusItems {
        kind: SectionKind,
        /// Bytes left over after the last voxel.
        room: u64,
    },
    #[error("{DAMAGED}a depth has too many or too few nodes (SPEC I11){AGAIN}")]
    SubtreeNodes {
        level: Level,
        /// Nodes left for it by the level table.
        room: u64,
        /// Nodes of the subtrees.
        brought: u64,
    },
    #[error("{DAMAGED}a depth has fewer nodes than their parents have children (SPEC I11){AGAIN}")]
    SubtreeCut { level: Level },
    #[error("{DAMAGED}a box at depth {} lies outside the volume (SPEC I12){AGAIN}", .level.get())]
    OutsideVolume { level: Level, corner: [u32; 3] },
    #[error("{DAMAGED}{}{AGAIN}", too_few(SectionKind::Rank))]
    RankMismatch {
        node: NodeIndex,
        /// Number of set bits by the infobytes.
        due: u64,
        found: u64,
    },
    #[error("{DAMAGED}{}{AGAIN}", illegal(*.channel, *.voxel))]
    IllegalItem {
        channel: Channel,
        voxel: VoxelIndex,
        /// The item found, as a little-endian number.
        item: u64,
    },
    #[error("{DAMAGED}{found} cells have corners where the offsets announce {due} (SPEC I18){AGAIN}")]
    CornerCount { due: u64, found: u64 },
    #[error("{DAMAGED}the directory of corners does not match the offsets (SPEC I18){AGAIN}")]
    CornerRank {
        block: u64,
        /// Number of cells with corners before it.
        due: u64,
    },
    #[error(
        "{DAMAGED}the labels of voxels and their table are not both there, or not as the encoding says (SPEC I4){AGAIN}"
    )]
    LabelsApart { kind: SectionKind },
    #[error("{DAMAGED}the table of labels cannot be read, or is impossible (SPEC I20){AGAIN}")]
    LabelTable { bytes: u64 },
    #[error("{DAMAGED}the quantity of the values cannot be read, or is impossible (SPEC I23){AGAIN}")]
    Quantity { bytes: u64 },
    #[error("{DAMAGED}the labels of cells {first} to {last} are illegal (SPEC I21){AGAIN}")]
    LabelBlocks { first: u64, last: u64 },
    #[error("{DAMAGED}the labels of cell {} and its walls do not agree (SPEC I22){AGAIN}", .cell.get())]
    Walls { cell: VoxelIndex },
    #[error("{DAMAGED}encoding and sections disagree about larger leaves (SPEC I4){AGAIN}")]
    LeavesApart { kind: SectionKind },
    #[error("{DAMAGED}{found} larger leaves are described where the nodes have {due} (SPEC I19){AGAIN}")]
    LeafCount { due: u64, found: u64 },
    #[error("{DAMAGED}the directory of larger leaves does not match the nodes (SPEC I19){AGAIN}")]
    LeafRank {
        block: u64,
        /// Number of larger leaves before it.
        due: u64,
    },
    #[error("{DAMAGED}the plane of a larger leaf is illegal (SPEC I14){AGAIN}")]
    IllegalLeaf { leaf: u64 },
    #[error("{DAMAGED}a mean {channel} at depth {} is not that of its voxels (SPEC I15){AGAIN}", .level.get())]
    MeanNormal {
        channel: Channel,
        level: Level,
        node: NodeIndex,
        due: u16,
        /// The code found; `None` where the section has ended.
        found: Option<u16>,
    },
    #[error("{DAMAGED}a mean {channel} at depth {} is not that of its voxels (SPEC I16){AGAIN}", .level.get())]
    MeanValue { channel: Channel, level: Level, node: NodeIndex, due: u64, found: u64 },
    /// I17: the metadata states a channel that is absent, or lacks one that is present: by the gradient's name for
    /// normals, by the scale for values.
    #[error("{DAMAGED}metadata and sections disagree about {} (SPEC I17){AGAIN}", .channel.row().items_name)]
    ChannelStated {
        channel: Channel,
        /// True if the metadata states it.
        stated: bool,
    },
    #[error("{DAMAGED}metadata has an impossible range of values (SPEC I17){AGAIN}")]
    SelectionRange { selection: Selection },
    #[error("{DAMAGED}{0}{AGAIN}")]
    Coding(#[from] CodingError),
    #[error("is packed; run `{UNPACK}` on it first")]
    Packed,
    #[error("is packed already; there is nothing to do")]
    AlreadyPacked,
    #[error("is not packed; there is nothing to unpack")]
    AlreadyMapped,
    #[error("{DAMAGED}a section of unknown kind parts nodes and rank{AGAIN}")]
    RankApart,
    #[error("{DAMAGED}metadata is longer than 1 MiB{AGAIN}")]
    MetadataTooLong { bytes: u64 },
    #[error(
        "the table of its labels would take {bytes} bytes, and 1 MiB is all that there is; shorten their names"
    )]
    LabelNames { bytes: u64 },
    #[error("{DAMAGED}metadata cannot be written{AGAIN}")]
    MetadataUnwritable,
}

const DAMAGED: &str = "is damaged: ";
const AGAIN: &str = "; copy or build it again";

fn missing(kind: SectionKind) -> String {
    match kind {
        SectionKind::Rank => "the rank section is missing, or present in a packed file (SPEC I4)".to_owned(),
        kind => format!("the {} section is missing (SPEC I4)", kind.name()),
    }
}

fn too_few(kind: SectionKind) -> String {
    match kind {
        SectionKind::Rank => "the rank directory does not belong to the nodes (SPEC I13)".to_owned(),
        kind => format!("there are more voxels than {} (SPEC I11)", items_name(kind)),
    }
}

fn illegal(channel: Channel, voxel: VoxelIndex) -> String {
    match channel {
        Channel::Normal => "a normal has the illegal component -128 (SPEC I14)".to_owned(),
        channel => format!("the {channel} of voxel {} is illegal (SPEC I14)", voxel.get()),
    }
}

/// The name of the items of a section.
fn items_name(kind: SectionKind) -> &'static str {
    kind.channel().map_or(kind.name(), |channel| channel.row().items_name)
}

// Small, because readers return it from loops over every voxel.
const _: () = assert!(size_of::<FormatError>() <= 32);
