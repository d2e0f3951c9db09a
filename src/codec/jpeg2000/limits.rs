//! Limits shared by several parts.

/// Magnitude bit planes of a coefficient: one more bit holds the half for the middle of an interval, and
/// one the sign.
pub(super) const MAX_PLANES: u32 = 30;

/// Resolution levels above the lowest, by the standard.
pub(super) const MAX_LEVELS: usize = 32;
