//! Hits of rays, by definition. Pictures are made by [`super::tile`], [`super::single`] and [`super::batch`], which are held
//! to [`super::reference`].
//!
//! Cells are half-open in the direction of travel, so a ray is in exactly one cell at any time; the first
//! hit is the cell that it is in at the first time when that cell is skin. Where a ray crosses planes of
//! two or three axes at once it changes all those coordinates at once: a cell touched at a point only is
//! not visited, and a ray that runs *exactly* through the common edge of two voxels passes between them. The sealed
//! traversal, which pictures use, takes such crossings one by one in the order x, y, z and so finds no tunnel in a thin
//! skin (the paper, 3.3). The two differ on no other ray.
//!
//! Departure from the paper (section 3): its 14-bit table answers for a discrete 6-connected ray and lists
//! boxes that the line does not intersect; here every box visited is intersected.

use crate::load::NodeView;

use super::ray::{Face, MAX_DEPTH};

/// The hit of a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Breadth-first number of the box: a voxel, or a node where the level of detail ends earlier.
    pub box_number: u64,
    /// Lowest cell of the box, in grid cells.
    pub cell: [u32; 3],
    /// Base-2 logarithm of the box's edge; 0 for a voxel.
    pub edge_log2: u32,
    /// Face by which the ray enters the box: of tied axes the first of x, y, z. `None` when the ray starts within it,
    /// or meets the surface within.
    pub face: Option<Face>,
    /// Parameter of the hit along the ray as it was given to [`Ray::new`](super::ray::Ray::new): of the entry, or of the
    /// surface within.
    pub t: f64,
}

impl Hit {
    /// Number of the voxel, if the box is one.
    #[inline]
    pub fn voxel<V: NodeView>(&self, view: &V) -> Option<u64> {
        (self.edge_log2 == 0).then(|| self.box_number.wrapping_sub(view.node_count()))
    }
}

/// Outcome of one ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Trace {
    /// The first hit, if any.
    pub hit: Option<Hit>,
    /// Boxes visited: empty boxes left, and the box hit.
    pub steps: u32,
}

/// Upper bound of [`Trace::steps`] for a grid of this depth: a ray leaves every plane of cells once.
#[inline]
pub fn step_limit(depth: u32) -> u32 {
    (3 << depth.min(MAX_DEPTH)) + 8
}
