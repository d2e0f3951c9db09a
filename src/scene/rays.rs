//! How many lines a picture took.

use crate::render::add_counts;

/// Lines traced, by purpose.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Rays {
    /// From the eye.
    pub primary: u64,
    /// Lines from the eye that meet a body.
    pub hits: u64,
    /// Towards lights.
    pub shadow: u64,
    /// Mirrored.
    pub mirrored: u64,
    /// Bent.
    pub refracted: u64,
    /// Looking around for ambient occlusion.
    pub ambient: u64,
}

impl Rays {
    pub(super) fn plus(mut self, other: Self) -> Self {
        add_counts!(self, other: primary, hits, shadow, mirrored, refracted, ambient);
        self
    }
}
