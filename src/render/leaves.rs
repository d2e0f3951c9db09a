//! A ray and a larger leaf: a plane in a box of 2 to 32 cells (SPEC 4.9).
//!
//! As with cells, a ray hits the leaf where it is inside as it enters the box, or else where it comes to be inside on
//! its way; both are decided in integers. Boxes 32 times as long raise sums from 2^53 to 2^58.

use crate::format::cell::Plane;
use crate::geom::NodeIndex;
use crate::load::ModelView;

use super::cells::{CROSSING_SLACK, HALF_CELL, meet_plane};
use super::mirrored_ray::MirroredRay;
use super::ray::Ray;
use super::surface::{Approach, Estimate};
use super::traverse::Hit;
use crate::render::cells::{larger, smaller};

/// Hit of a ray with the larger leaf of a node, whose box of edge `2^edge_log2` is at the mirrored cell `low`.
#[inline(never)]
pub(super) fn meet(
    view: &ModelView<'_>,
    ray: &Ray,
    mirrored: &MirroredRay,
    node: u64,
    low: [u32; 3],
    edge_log2: u32,
) -> Option<Hit> {
    let passage = mirrored.passage(node, low, edge_log2)?;
    meet_plane(&view.leaf_plane(NodeIndex::new(node)), ray, &passage)
}

/// The result of [`meet`] where it is certain without the times of passing through the box; `approach` is the approach
/// to the box's lowest cell, in mirrored coordinates.
#[inline(always)]
pub(super) fn predict(plane: &Plane, approach: &Approach, edge_log2: u32) -> Estimate {
    let edge = f64::from(1_u32.wrapping_shl(edge_log2));
    let half_cell = HALF_CELL as f64;
    let half_box = edge * half_cell;
    let from = each3!(A => approach.from_middle[A] - (edge - 1.0) * half_cell);
    let d = approach.direction;
    let n = each3!(A => {
        let n = f64::from(plane.normal[A]);
        if approach.mirror >> A & 1 == 1 { -n } else { n }
    });
    // Distance of the ray's start in front of the plane, and its change along the ray: integers below 2^46, exact.
    let start = n[0] * from[0] + n[1] * from[1] + n[2] * from[2] - f64::from(plane.offset) * half_box;
    let slope = n[0] * d[0] + n[1] * d[1] + n[2] * d[2];
    // Crossing with the plane, from the middle and times the slope's size.
    let at = each3!(A => d[A] * start - from[A] * slope);
    let half = half_box * slope.abs();
    let farthest = larger(larger(at[0], at[1]), at[2]);
    if farthest > half + CROSSING_SLACK {
        return Estimate::Past;
    }
    let nearest = smaller(smaller(at[0], at[1]), at[2]);
    let is_within = (farthest < half - CROSSING_SLACK) & (nearest > CROSSING_SLACK - half);
    if (slope < 0.0) & (start > 0.0) & is_within {
        return Estimate::Within { distance: start, component: -slope };
    }
    Estimate::Unsure
}
