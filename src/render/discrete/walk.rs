//! The first skin voxel on a discrete ray.

use crate::geom::{NodeIndex, Octant};
use crate::load::NodeView;
use crate::render::ray::{FRACTION_BITS, Face, MAX_DEPTH, Ray};
use crate::render::traverse::{Hit, Trace, step_limit};

use super::line::{Line, POINT_BITS, Point};
use super::path::{Halves, infobyte_in_frame, octant_in_grid, path_byte};

/// Boxes on the way from the root, by the logarithm of their edge; a power of two, so that an index is masked.
const LEVELS: usize = 32;

const _: () = assert!((MAX_DEPTH as usize) < LEVELS);

/// A box whose children are being visited.
#[derive(Clone, Copy)]
struct OpenBox {
    node: NodeIndex,
    infobyte: u8,
    /// Children still to be visited, the lowest bit first.
    pending: u8,
    low: [u32; 3],
    floor: Point,
    middle: Point,
    ceiling: Point,
}

/// First skin voxel on the discrete ray of a line; with `lod_edge_log2` = k > 0, first node with an edge of 2^k or less.
///
/// The line must have been made for the depth of this view. [`Trace::steps`] counts the opened boxes. `ray` only serves
/// to place a hit along it; with `None` there is no hit.
///
/// Cost: a box, some twenty additions, shifts and comparisons of integers; one infobyte, and one rank if a child is
/// visited. Any view is safe: the walk ends within [`step_limit`] steps.
#[inline]
pub fn first_hit<V: NodeView>(
    view: &V,
    line: &Line,
    lod_edge_log2: u32,
    ray: impl FnOnce() -> Option<Ray>,
) -> Trace {
    let depth = line.depth.min(MAX_DEPTH);
    let nothing = |steps| Trace { hit: None, steps };
    if view.voxel_count() == 0 {
        return nothing(0);
    }
    if depth <= lod_edge_log2 {
        // The root alone: tests whether the line comes by.
        let side = 1_i64 << (POINT_BITS + depth);
        let beside =
            |k: usize| line.floor[k].max(line.start[k]) >= side || line.ceiling[k].max(line.start[k]) < 0;
        if beside(0) || beside(1) || line.first_storey >> depth > 0 {
            return nothing(1);
        }
        return Trace { hit: ray().map(|ray| struck(&ray, 0, [0; 3], depth)), steps: 1 };
    }
    let open = |node: NodeIndex, low: [u32; 3], half_log2: u32, floor: Point, ceiling: Point| {
        let middle = std::array::from_fn(|k| (floor[k] + ceiling[k]) >> 1);
        // Halves from the low side; the ray has no points before its start.
        let halves = |k: usize| -> Halves {
            let low = i64::from(low[k]) << POINT_BITS;
            [floor[k], middle[k], ceiling[k]].map(|point| {
                let beside = (point.max(line.start[k]) - low) >> (POINT_BITS + half_log2);
                #[expect(clippy::cast_possible_truncation, reason = "clamped")]
                {
                    beside.clamp(-1, 2) as i8
                }
            })
        };
        let mut path = path_byte(halves(0), halves(1));
        // Storeys that end before the ray starts.
        let half = 1_u32.wrapping_shl(half_log2);
        if low[2] < line.first_storey {
            path &= if low[2] + half <= line.first_storey { 0xf0 } else { 0xff };
            path &= if low[2] + half + half <= line.first_storey { 0x0f } else { 0xff };
        }
        let infobyte = view.infobyte(node);
        let pending = path & infobyte_in_frame(infobyte, line.axis);
        OpenBox { node, infobyte, pending, low, floor, middle, ceiling }
    };
    let mut level = depth - 1;
    let mut path = [open(NodeIndex::ROOT, [0; 3], level, line.floor, line.ceiling); LEVELS];
    let limit = step_limit(depth).saturating_mul(4);
    let mut steps = 1;
    while steps <= limit {
        // `level` belongs to the open box's children.
        let at = &mut path[level as usize % LEVELS];
        if at.pending == 0 {
            level += 1;
            if level >= depth {
                return nothing(steps);
            }
            continue;
        }
        let child = at.pending.trailing_zeros();
        at.pending &= at.pending - 1;
        let here = *at;
        let octant = Octant::low_bits(octant_in_grid(child, line.axis));
        let number = view.first_child(here.node).after(octant.rank_in(here.infobyte));
        let low = std::array::from_fn(|k| here.low[k] | (child >> k & 1) << level);
        if level <= lod_edge_log2 {
            let cell = line.axis.to_grid(low, (1_u32 << depth) - (1_u32 << level));
            return Trace { hit: ray().map(|ray| struck(&ray, number.get(), cell, level)), steps };
        }
        let (floor, ceiling) =
            if child < 4 { (here.floor, here.middle) } else { (here.middle, here.ceiling) };
        level -= 1;
        path[level as usize % LEVELS] = open(number.node(), low, level, floor, ceiling);
        steps += 1;
    }
    debug_assert!(false, "a ray took more than {limit} steps");
    nothing(steps)
}

/// A hit of the ray with a box. If its line only passes by the box, the hit is at the nearest point.
#[expect(clippy::cast_precision_loss, reason = "all below 2^53")]
#[expect(clippy::needless_range_loop, reason = "an axis indexes several arrays")]
fn struck(ray: &Ray, box_number: u64, cell: [u32; 3], edge_log2: u32) -> Hit {
    let edge = 1_i64 << edge_log2;
    let (mut enter, mut leave) = (None::<(usize, i64, f64)>, f64::INFINITY);
    for a in 0..3 {
        let d = ray.direction()[a];
        if d == 0 {
            continue;
        }
        let sides = [i64::from(cell[a]), i64::from(cell[a]) + edge];
        let [near, far] = if d > 0 { sides } else { [sides[1], sides[0]] };
        let distance = |plane: i64| (plane << FRACTION_BITS) - ray.origin()[a];
        let (n, t) = (distance(near), distance(near) as f64 / d as f64);
        if t > enter.map_or(0.0, |(_, _, t)| t) {
            enter = Some((a, n, t));
        }
        leave = leave.min(distance(far) as f64 / d as f64);
    }
    let (face, t) = match enter {
        Some((a, n, t)) => {
            let d = ray.direction()[a];
            let face = Face::new(a, d < 0);
            let after = ray.t_after(n, d);
            // Passed by: half way between the last plane of entry and the first plane of exit.
            let back = if leave < t { (t - leave) / 2.0 / t } else { 0.0 };
            (Some(face), after - (after - ray.t_start()) * back)
        }
        None => (ray.entry(), ray.t_start()),
    };
    Hit { box_number, cell, edge_log2, face, t }
}
