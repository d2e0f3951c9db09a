//! Errors in the bytes of an `.oct`.

#![expect(missing_docs, reason = "the sentence of each variant says it")]

use std::fmt;

use thiserror::Error;

use super::packed::CodingError;
use super::{Channel, SectionKind};
use crate::geom::{Level, NodeIndex, VoxelIndex};
use crate::text::names::{BUILD, UNPACK};

/// A rule of SPEC.md that is broken by the bytes of a file, or by the content to be written into one.
///
/// SPEC 6 gives phrases of the sentences of each rule, I1 to I23. A fault is a variant if it is found at several places
/// or has a place in the file that its sentence does not name.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Error)]
pub enum FormatError {
    #[error(
        "is not an infobyte .oct file (it is empty, or begins as another format does); build one with `{BUILD}`"
    )]
    BadMagic,
    #[error("is cut short: {expected} bytes are needed and {got} are there; copy or build it again")]
    Truncated { expected: u64, got: u64 },
    #[error("is packed; run `{UNPACK}` on it first")]
    Packed,
    /// The sentence is written where the fault is found.
    #[error("{0}")]
    Said(String),
    #[error("{DAMAGED}the checksum of {of} does not match{AGAIN}")]
    Checksum { of: &'static str, stated: u32, found: u32 },
    /// `section` is counted in the order of the table, from 0.
    #[error("{DAMAGED}{fault}{AGAIN}")]
    Entry { section: u16, fault: &'static str },
    #[error("{DAMAGED}{}{AGAIN}", missing(*.0))]
    MissingSection(SectionKind),
    /// `boxes` is the number of boxes in the table; `None` where the table falls.
    #[error(
        "{DAMAGED}the level table is impossible: a level has more or fewer boxes than it can have (SPEC I7){AGAIN}"
    )]
    LevelBoxes { level: Level, boxes: Option<u64> },
    #[error("{DAMAGED}bytes between sections are not zero (SPEC I9){AGAIN}")]
    PaddingNotZero { offset: u64 },
    #[error("{DAMAGED}a node at depth {} has no children (SPEC I10){AGAIN}", .level.get())]
    EmptyNode { level: Level, node: NodeIndex, corner: [u32; 3] },
    #[error("{DAMAGED}depth {} has fewer nodes than their parents have children (SPEC I11){AGAIN}", .level.get())]
    MissingNode { level: Level, corner: [u32; 3] },
    /// `found` is the number of boxes that the walk met.
    #[error("{DAMAGED}a depth has more boxes than their parents have children (SPEC I11){AGAIN}")]
    SurplusBoxes { level: Level, stated: u64, found: u64 },
    #[error("{DAMAGED}{}{AGAIN}", too_few(*.kind))]
    MissingItem { kind: SectionKind },
    #[error("{DAMAGED}a box at depth {} lies outside the volume (SPEC I12){AGAIN}", .level.get())]
    OutsideVolume { level: Level, corner: [u32; 3] },
    /// `due` is the number of set bits by the infobytes.
    #[error("{DAMAGED}{}{AGAIN}", too_few(SectionKind::Rank))]
    RankMismatch { node: NodeIndex, due: u64, found: u64 },
    /// `item` is the item found, as a little-endian number.
    #[error("{DAMAGED}{}{AGAIN}", illegal(*.channel, *.voxel))]
    IllegalItem { channel: Channel, voxel: VoxelIndex, item: u64 },
    /// `due` is the number of cells with corners before the block.
    #[error("{DAMAGED}the directory of corners does not match the offsets (SPEC I18){AGAIN}")]
    CornerRank { block: u64, due: u64 },
    #[error("{DAMAGED}the labels of cells {first} to {last} are illegal (SPEC I21){AGAIN}")]
    LabelBlocks { first: u64, last: u64 },
    /// `due` is the number of larger leaves before the block.
    #[error("{DAMAGED}the directory of larger leaves does not match the nodes (SPEC I19){AGAIN}")]
    LeafRank { block: u64, due: u64 },
    #[error("{DAMAGED}the plane of a larger leaf is illegal (SPEC I14){AGAIN}")]
    IllegalLeaf { leaf: u64 },
    /// `found` is the code found; `None` where the section has ended.
    #[error("{DAMAGED}a mean {channel} at depth {} is not that of its voxels (SPEC I15){AGAIN}", .level.get())]
    MeanNormal { channel: Channel, level: Level, node: NodeIndex, due: u16, found: Option<u16> },
    #[error("{DAMAGED}a mean {channel} at depth {} is not that of its voxels (SPEC I16){AGAIN}", .level.get())]
    MeanValue { channel: Channel, level: Level, node: NodeIndex, due: u64, found: u64 },
}

const DAMAGED: &str = "is damaged: ";
const AGAIN: &str = "; copy or build it again";

/// Damage, described in the middle of the sentence.
pub(crate) fn damaged(fault: impl fmt::Display) -> FormatError {
    FormatError::Said(format!("{DAMAGED}{fault}{AGAIN}"))
}

impl From<CodingError> for FormatError {
    fn from(cause: CodingError) -> Self {
        damaged(cause)
    }
}

fn missing(kind: SectionKind) -> String {
    match kind {
        SectionKind::Rank => "the rank section is missing, or present in a packed file (SPEC I4)".to_owned(),
        kind => format!("the {} section is missing (SPEC I4)", kind.name()),
    }
}

fn too_few(kind: SectionKind) -> String {
    match kind {
        SectionKind::Rank => "the rank directory does not belong to the nodes (SPEC I13)".to_owned(),
        kind => format!("there are more voxels than {} (SPEC I11)", kind.items_name()),
    }
}

fn illegal(channel: Channel, voxel: VoxelIndex) -> String {
    match channel {
        Channel::Normal => "a normal has the illegal component -128 (SPEC I14)".to_owned(),
        channel => format!("the {channel} of voxel {} is illegal (SPEC I14)", voxel.get()),
    }
}

// Small, because readers return it from loops over every voxel.
const _: () = assert!(size_of::<FormatError>() <= 32);
