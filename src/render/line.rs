//! The line of a ray against the 4 x 4 x 4 boxes of a brick: the one test of all traversals.
//!
//! For a pair of axes (a, b) and a point p let `e = (p_a - o_a) d_b - (p_b - o_b) d_a`: the distance of p from the line
//! in the projection onto a and b. A square of edge 1 around p is intersected by the line if and only if `|e| <= (d_a +
//! d_b) / 2`, and a box if and only if its three projections are. So three planes of 16 cells give 64 bits.
//!
//! This is an over-estimate in singles; at the last level [`super::mirrored_ray`] decides in integers.

use crate::cpu::{Lanes, SINGLES, Truths};

use super::mirrored_ray::MirroredRay;
use super::occupancy::{PAIRS, at_least, extrude};
use super::ray::{DIRECTION_BITS, FRACTION_BITS, Ray};

/// Error bound of an estimate, in edges of the boxes compared and for directions of at most 1: the quantisation of a
/// ray moves it by less than 2^-13, singles err by 2^-19.
pub(super) const SLACK: f32 = 1.0 / 4096.0;

/// Offset of a plane's cells from its middle along the first axis of a pair, in Morton order.
pub(super) const ALONG_A: [f32; SINGLES] = offsets(0);
/// Offset of a plane's cells from its middle along the second axis of a pair, in Morton order.
pub(super) const ALONG_B: [f32; SINGLES] = offsets(1);

const fn offsets(axis: usize) -> [f32; SINGLES] {
    let mut offsets = [0.0; SINGLES];
    let mut cell = 0;
    while cell < SINGLES {
        let at = (cell >> axis & 1) | (cell >> (axis + 1) & 2);
        offsets[cell] = at as f32 - 1.5;
        cell += 1;
    }
    offsets
}

/// Difference of e between a plane's cells and its middle, by pair, for a direction.
#[inline(always)]
pub(super) fn slopes<L: Lanes>(l: L, direction: [L::F; 3]) -> [L::F; 3] {
    let (along_a, along_b) = (l.f_load(&ALONG_A), l.f_load(&ALONG_B));
    each3!(PAIR => {
        const A: usize = PAIRS[PAIR].0;
        const B: usize = PAIRS[PAIR].1;
        along_a * direction[B] - along_b * direction[A]
    })
}

/// Boxes of a brick whose projections along one axis a line intersects, in edges of these boxes: `middle` is e of the
/// brick's middle, `half` half the width of a cell's projection. A box in the results of all three pairs is
/// intersected.
///
/// One pair at a time: computing e of all three before the first comparison costs a batch of rays a sixth of its speed.
#[inline(always)]
pub(super) fn intersected<L: Lanes>(l: L, pair: usize, middle: f32, slope: L::F, half: f32) -> u64 {
    let beside = l.f_abs(l.f(middle) + slope);
    extrude(l, pair, l.f_le(beside, l.f(half)).bits())
}

/// A ray's line for estimates: mirrored coordinates, in edges of the finest boxes tested; the direction is scaled to at
/// most 1.
#[derive(Clone, Copy, Debug)]
pub(super) struct Line {
    origin: [f64; 3],
    direction: [f64; 3],
    /// [`slopes`] in memory, and half the width of a cell's projection, by pair.
    slopes: [[f32; SINGLES]; 3],
    half: [f32; 3],
    /// The box that the ray starts in, if it starts inside the grid.
    pub(super) start: [i32; 3],
    pub(super) starts_inside: bool,
}

impl Line {
    /// Placeholder line.
    pub(super) const NONE: Self = Self {
        origin: [0.0; 3],
        direction: [0.0; 3],
        slopes: [[0.0; SINGLES]; 3],
        half: [0.0; 3],
        start: [0; 3],
        starts_inside: false,
    };

    /// The line of a ray; boxes have an edge of `2^unit` cells.
    #[inline(always)]
    #[expect(
        clippy::cast_precision_loss,
        clippy::cast_possible_truncation,
        reason = "estimates within SLACK"
    )]
    pub(super) fn new(l: impl Lanes, ray: &Ray, exact: &MirroredRay, unit: u32) -> Self {
        let per_unit = 1.0 / (1_u64.wrapping_shl(FRACTION_BITS + unit)) as f64;
        let direction = each3!(A => exact.direction[A] as f64 * (1.0 / f64::from(1_u32 << DIRECTION_BITS)));
        let mut line = Self {
            origin: each3!(A => exact.origin[A] as f64 * per_unit),
            direction,
            half: each3!(PAIR => {
                0.5 * (direction[PAIRS[PAIR].0] as f32 + direction[PAIRS[PAIR].1] as f32) + SLACK
            }),
            start: each3!(A => (exact.origin[A] >> (FRACTION_BITS + unit)) as i32),
            starts_inside: ray.entry().is_none(),
            ..Self::NONE
        };
        let slopes = slopes(l, each3!(A => l.f(direction[A] as f32)));
        for (to, slope) in line.slopes.iter_mut().zip(slopes) {
            l.f_store(slope, to);
        }
        line
    }

    /// Boxes of edge `2^edge` in the brick at `low` that the line intersects.
    #[inline(always)]
    #[expect(clippy::cast_possible_truncation, reason = "estimates within SLACK")]
    pub(super) fn intersected(&self, l: impl Lanes, low: [u32; 3], edge: u32) -> u64 {
        let half_brick = f64::from(2_u32.wrapping_shl(edge));
        let per_edge = 2.0 / half_brick;
        let from = each3!(A => f64::from(low[A]) + half_brick - self.origin[A]);
        let mut boxes = u64::MAX;
        for (pair, (a, b)) in PAIRS.into_iter().enumerate() {
            let e = (from[a] * self.direction[b] - from[b] * self.direction[a]) * per_edge;
            boxes &= intersected(l, pair, e as f32, l.f_load(&self.slopes[pair]), self.half[pair]);
        }
        boxes
    }

    /// Boxes of edge `2^edge` in the brick at `low` that are not behind the ray.
    #[inline(always)]
    pub(super) fn ahead(&self, low: [u32; 3], edge: u32) -> u64 {
        let mut boxes = u64::MAX;
        if self.starts_inside {
            for (a, (start, low)) in self.start.into_iter().zip(low).enumerate() {
                let behind = start.wrapping_sub(low.cast_signed()) >> edge;
                boxes &= at_least(a, behind.clamp(0, 4).cast_unsigned());
            }
        }
        boxes
    }
}
