//! The first hit of a ray, by definition: in whole numbers, over any node view, of any depth, simple and slow.
//!
//! Axes along which the ray runs backwards are mirrored, so that all components are >= 0 and the cell
//! at time t is `floor(position(t))`. From the smallest box known to hold the current cell the walk
//! descends by infobytes until a voxel, or an empty octant, whose box is then left in one step; the
//! deepest box that holds both the old and the new cell is found from their differing bits.
//!
//! Sums and shifts here wrap instead of being checked: `ray` proves that none overflows, and a view's
//! answers go into table look-ups and box numbers only, never into coordinates.

use infobyte::geom::NodeIndex;
use infobyte::load::NodeView;
use infobyte::render::ray::{FRACTION_BITS, Face, Ray};
use infobyte::render::traverse::{Hit, Trace, step_limit};

/// Levels on the path from root to voxel, rounded up to a power of two so that an index is masked
/// instead of checked.
const PATH: usize = 32;

/// `2^k` for k < 32, without the check for greater k.
#[inline(always)]
fn edge(k: u32) -> u32 {
    1_u32.wrapping_shl(k)
}

/// The ray in mirrored coordinates.
struct Walk {
    origin: [i64; 3],
    direction: [i64; 3],
    sealed: bool,
}

impl Walk {
    /// Mirrors the axes along which the ray runs backwards; returns the mask of those axes, too.
    #[inline]
    fn new(ray: &Ray, sealed: bool) -> (Self, u32) {
        let far = i64::from(edge(ray.depth())) << FRACTION_BITS;
        let (mut origin, mut direction) = (ray.origin(), ray.direction());
        let mut mirror = 0;
        for a in 0..3 {
            if direction[a] < 0 {
                origin[a] = far.wrapping_sub(origin[a]);
                direction[a] = direction[a].wrapping_neg();
                mirror |= 1 << a;
            }
        }
        let walk = Self { origin, direction, sealed };
        (walk, mirror)
    }

    /// The cell that follows the box of edge `2^level` around `cell`.
    #[expect(clippy::cast_possible_truncation, reason = "cells are at most 2^16")]
    fn next_cell(&self, cell: [u32; 3], level: u32) -> [u32; 3] {
        let within = edge(level).wrapping_sub(1);
        let plane = |a: usize| i64::from((cell[a] | within).wrapping_add(1)) << FRACTION_BITS;
        let distance: [i64; 3] = std::array::from_fn(|a| plane(a).wrapping_sub(self.origin[a]));
        // Earliest exit: n_a / d_a < n_b / d_b by cross-multiplication. Distances are > 0, so an axis with
        // d = 0 is never the earlier one. No overflow: see the assertions in `ray`.
        let mut exit = 0;
        for a in 1..3 {
            if distance[a].wrapping_mul(self.direction[exit]) < distance[exit].wrapping_mul(self.direction[a])
            {
                exit = a;
            }
        }
        let (n, d) = (distance[exit], self.direction[exit]);
        // Where each axis is at that time: from its start, `n * d_a / d` units further, rounded down.
        let mut next = [0; 3];
        let mut crossing = [false; 3];
        for a in 0..3 {
            let product = n.wrapping_mul(self.direction[a]);
            let units = self.origin[a].wrapping_add(product.checked_div(d).unwrap_or(0));
            next[a] = (units >> FRACTION_BITS) as u32;
            let to_plane = (i64::from(next[a]) << FRACTION_BITS).wrapping_sub(self.origin[a]);
            crossing[a] = self.direction[a] > 0 && to_plane > 0 && to_plane.wrapping_mul(d) == product;
        }
        if !self.sealed {
            return next;
        }
        // One crossing after the other, up to the first cell outside the box. A crossing that was taken
        // on the way into the box is not undone: its coordinate is that of `cell` already.
        let mut at: [u32; 3] =
            std::array::from_fn(|a| if crossing[a] { cell[a].max(next[a].wrapping_sub(1)) } else { next[a] });
        for a in 0..3 {
            at[a] = next[a];
            if (at[a] ^ cell[a]) > within {
                return at;
            }
        }
        next
    }

    /// Entry into the box with lowest cell `low`: the first axis of the latest crossing, with the
    /// distance along it; `None` when the ray starts in the box.
    #[inline]
    #[expect(clippy::needless_range_loop, reason = "an axis indexes several arrays")]
    fn entry_into(&self, low: [u32; 3]) -> Option<(usize, i64)> {
        let mut latest: Option<(usize, i64)> = None;
        for a in 0..3 {
            let n = (i64::from(low[a]) << FRACTION_BITS).wrapping_sub(self.origin[a]);
            let later = match latest {
                None => n > 0,
                Some((b, m)) => n.wrapping_mul(self.direction[b]) > m.wrapping_mul(self.direction[a]),
            };
            if later && self.direction[a] > 0 {
                latest = Some((a, n));
            }
        }
        latest
    }
}

/// First skin voxel on a ray; with `lod_edge_log2` = k > 0, first node with an edge of 2^k or less.
///
/// The ray must have been made for the depth of this view. Cost: one infobyte, and one rank if the octant
/// is not empty, per level descended. Any view is safe: the walk ends within
/// [`step_limit`] steps.
#[inline]
pub(crate) fn first_hit<V: NodeView>(view: &V, ray: &Ray, lod_edge_log2: u32) -> Trace {
    trace(view, ray, lod_edge_log2, false)
}

/// [`first_hit`] with simultaneous crossings taken one by one, x before y before z: no ray slips between
/// two voxels that touch by an edge, or past one that it touches at a corner of its own path.
#[inline]
pub(crate) fn first_hit_sealed<V: NodeView>(view: &V, ray: &Ray, lod_edge_log2: u32) -> Trace {
    trace(view, ray, lod_edge_log2, true)
}

#[inline(always)]
fn trace<V: NodeView>(view: &V, ray: &Ray, lod_edge_log2: u32, sealed: bool) -> Trace {
    let depth = ray.depth();
    let size = edge(depth);
    let (walk, mirror) = Walk::new(ray, sealed);
    #[expect(clippy::cast_possible_truncation, reason = "at most 2^16")]
    let mut cell = walk.origin.map(|o| (o >> FRACTION_BITS) as u32);
    if cell.iter().any(|c| *c >= size) || view.voxel_count() == 0 {
        return Trace { hit: None, steps: 0 };
    }
    let limit = step_limit(depth);
    let mut path = [0_u64; PATH];
    let mut level = depth;
    let mut node = 0_u64;
    for steps in 1..=limit {
        // Down to a box small enough, or into an empty octant of edge 2^level.
        loop {
            if level <= lod_edge_log2 {
                let hit = finish(ray, &walk, mirror, node, cell, level);
                return Trace { hit: Some(hit), steps };
            }
            level = level.wrapping_sub(1);
            let bit = |a: usize| cell[a].wrapping_shr(level) & 1;
            let octant = (bit(0) | bit(1) << 1 | bit(2) << 2) ^ mirror;
            let mask = u32::from(view.infobyte(NodeIndex::new(node)));
            if mask.wrapping_shr(octant) & 1 == 0 {
                break;
            }
            let before = (mask & edge(octant).wrapping_sub(1)).count_ones();
            node = view.first_child(NodeIndex::new(node)).after(before).get();
            path[level as usize % PATH] = node;
        }
        let next = walk.next_cell(cell, level);
        let changed = (cell[0] ^ next[0]) | (cell[1] ^ next[1]) | (cell[2] ^ next[2]);
        if changed >= size {
            return Trace { hit: None, steps };
        }
        // The smallest box that holds both cells lies on the path that led here.
        level = u32::BITS.wrapping_sub(changed.leading_zeros());
        node = path[level as usize % PATH];
        cell = next;
    }
    debug_assert!(false, "a ray took more than {limit} steps");
    Trace { hit: None, steps: limit }
}

/// Describes the box of edge `2^level` around `cell` as a hit, back in unmirrored coordinates.
#[inline]
fn finish(ray: &Ray, walk: &Walk, mirror: u32, box_number: u64, cell: [u32; 3], level: u32) -> Hit {
    let low = cell.map(|c| c & !edge(level).wrapping_sub(1));
    let last = edge(ray.depth()).wrapping_sub(edge(level));
    let mirrored = |a: usize| mirror >> a & 1 == 1;
    let entry = walk.entry_into(low);
    Hit {
        box_number,
        cell: std::array::from_fn(|a| if mirrored(a) { last.wrapping_sub(low[a]) } else { low[a] }),
        edge_log2: level,
        face: match entry {
            // In mirrored coordinates every box is entered by a low face.
            Some((a, _)) => Some(Face::new(a, mirrored(a))),
            None => ray.entry(),
        },
        t: match entry {
            Some((a, n)) => ray.t_after(n, walk.direction[a]),
            None => ray.t_start(),
        },
    }
}
