//! The exact test of a ray passing through a box, with its crossings.
//!
//! In mirrored coordinates all components are >= 0, so a box is entered by its low planes and left by its high ones.
//! With `n = low - origin` and C the box's edge, axis a is entered after `n_a / d_a` and left after `(n_a + C) / d_a`.
//! The ray passes through the box if every axis is entered before any is left, simultaneous crossings being taken in
//! the order x, y, z (see `traverse`). For a < b that is `-C d_b < n_a d_b - n_b d_a <= C d_a`; and the box must not
//! lie behind the origin: `n > -C`. Along an axis without motion the ray must be within the box: `n <= 0`.
//!
//! Products wrap: near the ray, where the answer can be yes, they do not, as `ray` proves; far from it the preceding
//! estimate has excluded the box.

use super::ray::{FRACTION_BITS, Ray};
use super::surface::{Crossing, Passage};
use crate::render::occupancy::PAIRS;

/// A ray in mirrored coordinates.
#[derive(Clone, Copy, Debug)]
pub(super) struct MirroredRay {
    depth: u32,
    pub(super) origin: [i64; 3],
    pub(super) direction: [i64; 3],
    /// Mask of the mirrored axes, along which the ray runs backwards.
    pub(super) mirror: u32,
}

impl MirroredRay {
    /// Placeholder ray.
    pub(super) const NONE: Self = Self { depth: 0, origin: [0; 3], direction: [0; 3], mirror: 0 };

    #[inline]
    pub(super) fn new(ray: &Ray) -> Self {
        let far = 1_i64.wrapping_shl(ray.depth() + FRACTION_BITS);
        let (mut origin, mut direction) = (ray.origin(), ray.direction());
        let mut mirror = 0;
        for a in 0..3 {
            // The signs of rays without neighbours are unpredictable: -1 or 0 instead of a branch.
            let back = direction[a] >> 63;
            origin[a] = (origin[a] ^ back).wrapping_sub(back).wrapping_add(far & back);
            direction[a] = (direction[a] ^ back).wrapping_sub(back);
            mirror |= u32::from(back != 0) << a;
        }
        Self { depth: ray.depth(), origin, direction, mirror }
    }

    /// Vector from the origin to the low planes of a mirrored cell.
    #[inline(always)]
    fn to(&self, low: [u32; 3]) -> [i64; 3] {
        std::array::from_fn(|a| (i64::from(low[a]) << FRACTION_BITS).wrapping_sub(self.origin[a]))
    }

    /// True if the ray passes through the box of edge `2^edge_log2` at the mirrored cell `low`.
    #[inline]
    pub(super) fn enters(&self, low: [u32; 3], edge_log2: u32) -> bool {
        let edge = 1_i64.wrapping_shl(edge_log2 + FRACTION_BITS);
        let (d, n) = (self.direction, self.to(low));
        for a in 0..3 {
            if n[a] <= -edge || (d[a] == 0 && n[a] > 0) {
                return false;
            }
        }
        for (a, b) in PAIRS {
            if d[a] > 0 && d[b] > 0 {
                let e = n[a].wrapping_mul(d[b]).wrapping_sub(n[b].wrapping_mul(d[a]));
                if e <= -edge.wrapping_mul(d[b]) || e > edge.wrapping_mul(d[a]) {
                    return false;
                }
            }
        }
        true
    }

    /// The way through the box of edge `2^edge_log2` at the mirrored cell `low`; `None` if the ray misses it.
    #[inline]
    pub(super) fn passage(&self, box_number: u64, low: [u32; 3], edge_log2: u32) -> Option<Passage> {
        if !self.enters(low, edge_log2) {
            return None;
        }
        let edge = 1_i64.wrapping_shl(edge_log2 + FRACTION_BITS);
        let (d, n) = (self.direction, self.to(low));
        let mut enter: Option<Crossing> = None;
        let mut leave: Option<Crossing> = None;
        for axis in 0..3 {
            if d[axis] == 0 {
                continue;
            }
            let crossing = |distance| Crossing { axis, distance, component: d[axis] };
            let (into, out) = (crossing(n[axis]), crossing(n[axis].wrapping_add(edge)));
            if into.distance > 0 && enter.is_none_or(|best| best.is_before(&into)) {
                enter = Some(into);
            }
            if leave.is_none_or(|best| out.is_before(&best)) {
                leave = Some(out);
            }
        }
        let last = (1_u32.wrapping_shl(self.depth)).wrapping_sub(1_u32.wrapping_shl(edge_log2));
        let cell =
            std::array::from_fn(
                |a| if self.mirror >> a & 1 == 1 { last.wrapping_sub(low[a]) } else { low[a] },
            );
        Some(Passage { box_number, cell, edge_log2, enter, leave: leave? })
    }
}

impl Crossing {
    /// True if this crossing is earlier than another, by cross-multiplication.
    #[inline]
    pub(crate) fn is_before(&self, other: &Self) -> bool {
        self.distance.wrapping_mul(other.component) < other.distance.wrapping_mul(self.component)
    }
}
