//! What is wrong with the bytes of an `.oct`.

use std::fmt;

use crate::format::packed::CodingError;
use crate::format::{Channel, FormatError, SectionKind};

impl fmt::Display for FormatError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::BadMagic => f.write_str(
                "is not an infobyte .oct file (it is empty, or begins as another format does); build one with `oct build`",
            ),
            Self::Truncated { expected, got } => write!(
                f,
                "is cut short: {expected} bytes are needed and {got} are there; copy or build it again"
            ),
            Self::TrailingBytes { extra } => {
                write!(f, "has {extra} bytes after its end; copy or build it again")
            }
            Self::UnsupportedVersion { major } => {
                write!(f, "has format version {major}; this program reads version 1: update infobyte")
            }
            Self::Packed => f.write_str("is packed; run `oct unpack` on it first"),
            Self::AlreadyPacked => f.write_str("is packed already; there is nothing to do"),
            Self::AlreadyMapped => f.write_str("is not packed; there is nothing to unpack"),
            damage => write!(f, "is damaged: {}; copy or build it again", Damage(damage)),
        }
    }
}

/// What a section has one of for each voxel or node.
fn items_name(kind: SectionKind) -> &'static str {
    kind.channel().map_or(kind.name(), |channel| channel.row().items_name)
}

/// The middle of the sentence about a damaged file.
struct Damage<'a>(&'a FormatError);

impl fmt::Display for Damage<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        use FormatError as E;
        let text = match self.0 {
            E::Coding(cause) => return cause.fmt(f),
            E::HeaderChecksum { .. } => "the checksum of the header does not match",
            E::UnknownEncoding { code } => return write!(f, "encoding {code} is unknown"),
            E::TableChecksum { .. } => "the checksum of the section table does not match",
            E::SectionChecksum { kind, .. } => {
                let name = kind.map_or("a section of unknown kind", SectionKind::name);
                return write!(f, "the checksum of {name} does not match");
            }
            E::SectionCount { .. } => "the number of sections is outside 1..=64 (SPEC I3)",
            E::SectionGap { .. } => "sections do not follow each other without gaps",
            E::SectionSize { .. } => "a section's size is not items times bytes per item",
            E::SectionNotPlain { .. } => "an uncompressed section differs from its content",
            E::SectionOrder { .. } => "sections are repeated or out of order",
            E::LastSectionEnd { .. } => "the last section does not end where the file ends",
            E::MissingSection(SectionKind::Rank) | E::RankInPackedFile => {
                "the rank section is missing, or present in a packed file (SPEC I4)"
            }
            E::MissingSection(kind) => return write!(f, "the {} section is missing (SPEC I4)", kind.name()),
            E::LoneFine => "fine parts of normals are there without normals of skin voxels (SPEC I4)",
            E::LoneMeans { .. } => "coarse means are there without the voxels' own (SPEC I4)",
            E::NotOfSkin { kind } => {
                return write!(f, "a model of skin voxels has the {} section (SPEC I4)", kind.name());
            }
            E::ForbiddenCodec { .. } => "a section is coded that must not be (SPEC I4)",
            E::SectionTooLong { kind, .. } => {
                return write!(f, "the {} section is too long (SPEC I4)", kind.name());
            }
            E::SectionItems { kind, item_bytes, items, due } => {
                return write!(
                    f,
                    "the {} section has {items} items of {item_bytes} bytes where {due} are due (SPEC I4)",
                    kind.name()
                );
            }
            E::DimsRange { .. } => "dims are outside 1..=65536",
            E::DepthMismatch { .. } => "the depth does not belong to the dims",
            E::VoxelCount { .. } => "the number of skin voxels is impossible for the dims",
            E::NodeCount { .. } => "the number of nodes is impossible for the skin voxels",
            E::MetadataUnreadable { .. } => "metadata cannot be read",
            E::MetadataSurplus { .. } => "metadata has bytes left over",
            E::UnknownSelection { code } => return write!(f, "selection kind {code} is unknown"),
            E::MetadataCodes { .. } => "metadata names an unknown sample type or connectivity",
            E::MetadataGeometry { .. } => "metadata has a geometry that is not finite and positive",
            E::MetadataDims { .. } => "metadata and header disagree about the dims (SPEC I6)",
            E::LevelCount { .. } => "the level table is impossible: it has a wrong number of items (SPEC I7)",
            E::LevelEnds { .. } => {
                "the level table is impossible: it does not run from 0 to the number of nodes (SPEC I7)"
            }
            E::LevelBoxes { .. } => {
                "the level table is impossible: a level has more or fewer boxes than it can have (SPEC I7)"
            }
            E::HeaderReserved { .. } => "reserved header bytes are not zero",
            E::TableReserved { .. } => "reserved bytes of the section table are not zero",
            E::PaddingNotZero { .. } => "bytes between sections are not zero (SPEC I9)",
            E::EmptyNode { level, .. } => {
                return write!(f, "a node at depth {} has no children (SPEC I10)", level.get());
            }
            E::MissingNode { level, .. } => {
                return write!(
                    f,
                    "depth {} has fewer nodes than their parents have children (SPEC I11)",
                    level.get()
                );
            }
            E::SubtreeCut { .. } => "a depth has fewer nodes than their parents have children (SPEC I11)",
            E::SubtreeNodes { .. } => "a depth has too many or too few nodes (SPEC I11)",
            E::SurplusBoxes { .. } => "a depth has more boxes than their parents have children (SPEC I11)",
            E::RankMismatch { .. } | E::MissingItem { kind: SectionKind::Rank } => {
                "the rank directory does not belong to the nodes (SPEC I13)"
            }
            E::MissingItem { kind } => {
                return write!(f, "there are more voxels than {} (SPEC I11)", items_name(*kind));
            }
            E::SurplusItems { kind, .. } => {
                return write!(f, "there are more {} than voxels (SPEC I11)", items_name(*kind));
            }
            E::OutsideVolume { level, .. } => {
                return write!(f, "a box at depth {} lies outside the volume (SPEC I12)", level.get());
            }
            E::IllegalItem { channel: Channel::Normal, .. } => {
                "a normal has the illegal component -128 (SPEC I14)"
            }
            E::IllegalItem { channel, voxel, .. } => {
                return write!(f, "the {channel} of voxel {} is illegal (SPEC I14)", voxel.get());
            }
            E::CornerCount { due, found } => {
                return write!(f, "{found} cells have corners where the offsets announce {due} (SPEC I18)");
            }
            E::CornerRank { .. } => "the directory of corners does not match the offsets (SPEC I18)",
            E::MeanNormal { channel, level, .. } => {
                return write!(
                    f,
                    "a mean {channel} at depth {} is not that of its voxels (SPEC I15)",
                    level.get()
                );
            }
            E::MeanValue { channel, level, .. } => {
                return write!(
                    f,
                    "a mean {channel} at depth {} is not that of its voxels (SPEC I16)",
                    level.get()
                );
            }
            E::ChannelStated { channel, .. } => {
                let name = channel.row().items_name;
                return write!(f, "metadata and sections disagree about {name} (SPEC I17)");
            }
            E::SelectionRange { .. } => "metadata has an impossible range of values (SPEC I17)",
            E::RankApart => "a section of unknown kind parts nodes and rank",
            E::MinorApart { minor } => {
                return write!(f, "version 1.{minor} is not the lowest that suffices (SPEC 1)");
            }
            E::MetadataTooLong { .. } => "metadata is longer than 1 MiB",
            E::MetadataUnwritable => "metadata cannot be written",
            E::ValueTooLarge { .. } => "a value does not fit one byte",
            E::VoxelSet { .. } => "the voxels are none, repeated, or outside the dims",
            // Sentences of their own, above.
            E::BadMagic
            | E::Truncated { .. }
            | E::TrailingBytes { .. }
            | E::UnsupportedVersion { .. }
            | E::Packed
            | E::AlreadyPacked
            | E::AlreadyMapped => return self.0.fmt(f),
        };
        f.write_str(text)
    }
}

impl fmt::Display for CodingError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::UnknownCodec { codec } => return write!(f, "codec {codec} is unknown; update infobyte"),
            Self::ImplausibleSection { .. } => "a packed section is impossible (SPEC 5.1)",
            Self::ContentTooLarge => "its sections are too large to be true",
            Self::SectionCut => "a packed section ends early (SPEC 5.1)",
            Self::SectionSurplus { .. } => "a packed section has bytes left over (SPEC 5.1)",
            Self::BlockTooLong { .. } => "a packed block is longer than its section or its limit (SPEC 5.1)",
            Self::GroupCut => "a packed group ends early (SPEC 5.8)",
            Self::GroupSurplus => "a packed group has bytes left over (SPEC 5.8)",
            Self::GroupTooLong { .. } => "a packed group passes its limit (SPEC 5.3)",
            Self::GroupSubtrees { .. } => "a packed group has an impossible number of subtrees (SPEC 5.3)",
            Self::SubtreeTooDeep => "a subtree is too deep (SPEC 5.3)",
            Self::SubtreeNodes { .. } => "a depth has too many or too few nodes (SPEC I11)",
            Self::EmptyNode => "a packed node has no children (SPEC I10)",
            Self::NormalRange => "a packed normal is out of range (SPEC 5.10)",
            Self::OffsetRange => "a packed offset is out of range (SPEC 5.11)",
            Self::BlockUnreadable { .. } => "a packed block cannot be decoded (SPEC 5.5)",
        })
    }
}
