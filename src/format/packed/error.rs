//! What can be wrong with the coded bytes of a packed file.

use thiserror::Error;

use crate::format::SectionKind;

/// A rule of SPEC 5 that coded bytes break. Small, because the innermost loops of the decoders return it.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum CodingError {
    /// SPEC 5.1: a codec that this version does not have.
    #[error("codec {codec} is unknown; update infobyte")]
    UnknownCodec {
        /// Code found.
        codec: u8,
    },
    /// SPEC 5.1: a codec of another section, or content that the stored bytes cannot hold.
    #[error("a packed section is impossible (SPEC 5.1)")]
    ImplausibleSection {
        /// The section; `None` for an unknown kind.
        kind: Option<SectionKind>,
        /// Its codec.
        codec: u8,
    },
    /// SPEC 5.1: the contents add up to more than any disk holds.
    #[error("its sections are too large to be true")]
    ContentTooLarge,
    /// SPEC 5.1: the stored bytes end in the middle of a number.
    #[error("a packed section ends early (SPEC 5.1)")]
    SectionCut,
    /// SPEC 5.1: stored bytes are left after the content is complete.
    #[error("a packed section has bytes left over (SPEC 5.1)")]
    SectionSurplus {
        /// How many.
        left: u64,
    },
    /// SPEC 5.1: a block or payload is longer than its section or its limit.
    #[error("a packed block is longer than its section or its limit (SPEC 5.1)")]
    BlockTooLong {
        /// Length that it states.
        bytes: u32,
    },
    /// SPEC 5.8: a group's payload ends early, or a block of it otherwise than it must.
    #[error("a packed group ends early (SPEC 5.8)")]
    GroupCut,
    /// SPEC 5.8: a group's payload goes on after its content.
    #[error("a packed group has bytes left over (SPEC 5.8)")]
    GroupSurplus,
    /// SPEC 5.3: a group to be written passes its limit.
    #[error("a packed group passes its limit (SPEC 5.3)")]
    GroupTooLong {
        /// Its payload.
        bytes: u64,
    },
    /// SPEC 5.3: a group has no subtrees, or more than are left or than fill it.
    #[error("a packed group has an impossible number of subtrees (SPEC 5.3)")]
    GroupSubtrees {
        /// Subtrees that it states.
        subtrees: u32,
    },
    /// SPEC 5.3: a subtree has more depths than its coder.
    #[error("a subtree is too deep (SPEC 5.3)")]
    SubtreeTooDeep,
    /// SPEC 5.3, I11: a depth of a subtree has other nodes than their parents have children.
    #[error("a depth has too many or too few nodes (SPEC I11)")]
    SubtreeNodes {
        /// Nodes found.
        found: u32,
        /// Children of the depth above.
        due: u32,
    },
    /// SPEC 5.9, I10: a node without children.
    #[error("a packed node has no children (SPEC I10)")]
    EmptyNode,
    /// SPEC 5.10: a residual leads out of the range of codes.
    #[error("a packed normal is out of range (SPEC 5.10)")]
    NormalRange,
    /// SPEC 5.11: a residual leads out of the range of offsets.
    #[error("a packed offset is out of range (SPEC 5.11)")]
    OffsetRange,
    /// SPEC 5.5: a block is not what zstd wrote, or has another length.
    #[error("a packed block cannot be decoded (SPEC 5.5)")]
    BlockUnreadable {
        /// Content bytes that are due.
        due: u32,
    },
}

const _: () = assert!(size_of::<CodingError>() <= 16);
