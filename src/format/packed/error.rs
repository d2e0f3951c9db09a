//! Errors in the coded bytes of a packed file.

use thiserror::Error;

/// A rule of SPEC 5 that coded bytes break, as the middle of a sentence. Small, because the innermost loops of the
/// decoders return it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error("{0}")]
pub(crate) struct CodingError(pub(crate) &'static str);

/// Rules that are checked at several places.
impl CodingError {
    pub(crate) const GROUP_CUT: Self = Self("a packed group ends early (SPEC 5.5)");
    pub(crate) const GROUP_SURPLUS: Self = Self("a packed group has bytes left over (SPEC 5.5)");
    pub(crate) const GROUP_SUBTREES: Self =
        Self("a packed group has an impossible number of subtrees (SPEC 5.2)");
    pub(crate) const SUBTREE_TOO_DEEP: Self = Self("a subtree is too deep (SPEC 5.2)");
    pub(crate) const SUBTREE_NODES: Self = Self("a depth has too many or too few nodes (SPEC I11)");
    pub(crate) const NORMAL_RANGE: Self = Self("a packed normal is out of range (SPEC 5.7)");
}
