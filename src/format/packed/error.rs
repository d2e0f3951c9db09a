//! What can be wrong with the coded bytes of a packed file.

use thiserror::Error;

use crate::format::SectionKind;

/// A rule of SPEC 5 that coded bytes break. Small, because the innermost loops of the decoders return it.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum CodingError {
    /// SPEC 5.1: a codec that this version does not have.
    UnknownCodec {
        /// Code found.
        codec: u8,
    },
    /// SPEC 5.1: a codec of another section, or content that the stored bytes cannot hold.
    ImplausibleSection {
        /// The section; `None` for an unknown kind.
        kind: Option<SectionKind>,
        /// Its codec.
        codec: u8,
    },
    /// SPEC 5.1: the contents add up to more than any disk holds.
    ContentTooLarge,
    /// SPEC 5.1: the stored bytes end in the middle of a number.
    SectionCut,
    /// SPEC 5.1: stored bytes are left after the content is complete.
    SectionSurplus {
        /// How many.
        left: u64,
    },
    /// SPEC 5.1: a block or payload is longer than its section or its limit.
    BlockTooLong {
        /// Length that it states.
        bytes: u32,
    },
    /// SPEC 5.8: a group's payload ends early, or a block of it otherwise than it must.
    GroupCut,
    /// SPEC 5.8: a group's payload goes on after its content.
    GroupSurplus,
    /// SPEC 5.3: a group to be written passes its limit.
    GroupTooLong {
        /// Its payload.
        bytes: u64,
    },
    /// SPEC 5.3: a group has no subtrees, or more than are left or than fill it.
    GroupSubtrees {
        /// Subtrees that it states.
        subtrees: u32,
    },
    /// SPEC 5.3: a subtree has more depths than its coder.
    SubtreeTooDeep,
    /// SPEC 5.3, I11: a depth of a subtree has other nodes than their parents have children.
    SubtreeNodes {
        /// Nodes found.
        found: u32,
        /// Children of the depth above.
        due: u32,
    },
    /// SPEC 5.9, I10: a node without children.
    EmptyNode,
    /// SPEC 5.10: a residual leads out of the range of codes.
    NormalRange,
    /// SPEC 5.11: a residual leads out of the range of offsets.
    OffsetRange,
    /// SPEC 5.5: a block is not what zstd wrote, or has another length.
    BlockUnreadable {
        /// Content bytes that are due.
        due: u32,
    },
}

const _: () = assert!(size_of::<CodingError>() <= 16);
