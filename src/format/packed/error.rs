//! Errors in the coded bytes of a packed file.

#![expect(missing_docs, reason = "the sentence of each variant says it")]

use thiserror::Error;

use crate::format::SectionKind;

/// A rule of SPEC 5 that coded bytes break. Small, because the innermost loops of the decoders return it.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum CodingError {
    #[error("codec {codec} is unknown; update infobyte")]
    UnknownCodec { codec: u8 },
    #[error("a packed section is impossible (SPEC 5.1)")]
    ImplausibleSection {
        /// The section; `None` for an unknown kind.
        kind: Option<SectionKind>,
        codec: u8,
    },
    #[error("its sections are too large to be true")]
    ContentTooLarge,
    #[error("a packed section ends early (SPEC 5.1)")]
    SectionCut,
    #[error("a packed section has bytes left over (SPEC 5.1)")]
    SectionSurplus { left: u64 },
    #[error("a packed block is longer than its section or its limit (SPEC 5.1)")]
    BlockTooLong { bytes: u32 },
    #[error("a packed group ends early (SPEC 5.5)")]
    GroupCut,
    #[error("a packed group has bytes left over (SPEC 5.5)")]
    GroupSurplus,
    #[error("a packed group passes its limit (SPEC 5.2)")]
    GroupTooLong { bytes: u64 },
    #[error("a packed group has an impossible number of subtrees (SPEC 5.2)")]
    GroupSubtrees { subtrees: u32 },
    #[error("a subtree is too deep (SPEC 5.2)")]
    SubtreeTooDeep,
    #[error("a depth has too many or too few nodes (SPEC I11)")]
    SubtreeNodes { found: u32, due: u32 },
    #[error("a packed normal is out of range (SPEC 5.7)")]
    NormalRange,
    #[error("a packed offset is out of range (SPEC 5.8)")]
    OffsetRange,
    #[error("a packed block cannot be decoded (SPEC 5.3)")]
    BlockUnreadable { due: u32 },
}

const _: () = assert!(size_of::<CodingError>() <= 16);
