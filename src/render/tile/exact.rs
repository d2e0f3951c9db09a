//! The exact rays of a tile, made row by row when the first of a row is needed.
//!
//! For surfaces that are not solid: each box that a ray may pass through is tested at once, with the ray's own integers
//! as doubles. Certain results are taken; the rest is decided by integers, one ray alone.

use crate::cpu::{DOUBLES, Lanes, Truths};
use crate::render::cells::{larger, smaller};
use crate::render::ray::FRACTION_BITS;
use crate::render::surface::{Approach, Glance};

use super::TileHits;
use super::beam::{RAYS, TILE};
use super::larger::Planes;
use super::listed::Source;

/// Difference below which times may be equal: they are below 2^5 and come by two roundings.
const SAME_TIME: f64 = 1.0 / (1_u64 << 40) as f64;

/// Rays in mirrored coordinates, integers as doubles.
pub(super) struct ExactRays {
    origin: [[f64; RAYS]; 3],
    direction: [[f64; RAYS]; 3],
    t_start: [f64; RAYS],
    t_scale: [f64; RAYS],
    /// Finished rows, and usable rays.
    rows: u32,
    valid: u64,
    /// Rays that move along all axes.
    slanted: u64,
    /// Cached planes of larger leaves.
    pub(super) planes: Planes,
}

/// A box that a ray certainly passes through.
pub(super) struct BoxEntry {
    pub(super) glance: Glance,
    /// Axis of the face of entry.
    pub(super) axis: usize,
}

/// Result of testing a ray against a box.
pub(super) enum Passing {
    Through(BoxEntry),
    Past,
    Unsure,
}

impl ExactRays {
    pub(super) const fn new() -> Self {
        Self {
            origin: [[0.0; RAYS]; 3],
            direction: [[0.0; RAYS]; 3],
            t_start: [0.0; RAYS],
            t_scale: [0.0; RAYS],
            rows: 0,
            valid: 0,
            slanted: 0,
            planes: Planes::new(),
        }
    }

    /// Forgets the rays of the previous tile.
    pub(super) fn clear(&mut self) {
        (self.rows, self.valid, self.slanted) = (0, 0, 0);
        self.planes = Planes::new();
    }

    /// Makes the row of a ray, unless it exists.
    #[inline(always)]
    pub(super) fn prepare<L: Lanes>(
        &mut self,
        l: L,
        rays: impl Source,
        corner: (usize, usize),
        mirror: u32,
        depth: u32,
        ray: usize,
    ) {
        let row = ray / TILE % TILE;
        if self.rows >> row & 1 == 1 {
            return;
        }
        self.rows |= 1 << row;
        let exact = rays.row(l, corner, row);
        let far = l.d(f64::from(1_u32.wrapping_shl(depth)) * f64::from(1_u32 << FRACTION_BITS));
        let zero = l.d(0.0);
        let (mut origin, mut direction) = (exact.origin, exact.direction);
        let (mut valid, mut slanted) = (exact.valid, exact.valid);
        for a in 0..3 {
            if mirror >> a & 1 == 1 {
                origin[a] = far - origin[a];
                direction[a] = zero - direction[a];
            }
            // Directions against the mirror were not estimated.
            valid = valid & l.d_le(zero, direction[a]);
            slanted = slanted & l.d_lt(zero, direction[a]);
        }
        for a in 0..3 {
            l.d_store(origin[a], lanes_of(&mut self.origin[a], row));
            l.d_store(direction[a], lanes_of(&mut self.direction[a], row));
        }
        l.d_store(exact.t_start, lanes_of(&mut self.t_start, row));
        l.d_store(exact.t_scale, lanes_of(&mut self.t_scale, row));
        self.valid |= u64::from(valid.bits() & 0xff) << (TILE * row);
        self.slanted |= u64::from((valid & slanted).bits() & 0xff) << (TILE * row);
    }

    /// A ray and the box of the finest level at the mirrored cell `low`; `None` for a ray that was not estimated.
    #[inline(always)]
    pub(super) fn approach(
        &self,
        ray: usize,
        box_number: u64,
        low: [u32; 3],
        mirror: u32,
    ) -> Option<Approach> {
        let ray = ray % RAYS;
        if self.valid >> ray & 1 == 0 {
            return None;
        }
        let one_cell = f64::from(1_u32 << FRACTION_BITS);
        Some(Approach {
            box_number,
            mirror,
            from_middle: each3!(A => self.origin[A][ray] - (f64::from(low[A]) + 0.5) * one_cell),
            direction: each3!(A => self.direction[A][ray]),
        })
    }

    /// The way of a ray through the box of edge `2^unit` at the mirrored cell `low`.
    #[inline]
    pub(super) fn way(&self, ray: usize, box_number: u64, low: [u32; 3], unit: u32, mirror: u32) -> Passing {
        let ray = ray % RAYS;
        if self.slanted >> ray & 1 == 0 {
            return self.way_along_axes(ray, box_number, low, unit, mirror);
        }
        // Without branches until the end: the last face crossed is unpredictable.
        let one_cell = f64::from(1_u32 << FRACTION_BITS);
        let edge = f64::from(1_u32.wrapping_shl(unit)) * one_cell;
        let direction = each3!(A => self.direction[A][ray]);
        let inverse = each3!(A => 1.0 / direction[A]);
        let n = each3!(A => f64::from(low[A]) * one_cell - self.origin[A][ray]);
        let into = each3!(A => n[A] * inverse[A]);
        let out = each3!(A => (n[A] + edge) * inverse[A]);
        let (most, least) = (larger(into[0], into[1]), smaller(into[0], into[1]));
        let (enter, before) = (larger(most, into[2]), larger(least, smaller(most, into[2])));
        let leave = smaller(smaller(out[0], out[1]), out[2]);
        // Integers: a box is behind the ray when one of its far planes is.
        if (enter > leave + SAME_TIME) | (leave <= 0.0) {
            return Passing::Past;
        }
        // Ties, and rays that start in the box, are left to the integers.
        if (enter + SAME_TIME < leave) & (before + SAME_TIME < enter) & (enter > SAME_TIME) {
            let axis = usize::from(into[1] == enter) + 2 * usize::from(into[2] == enter);
            let from_middle = each3!(A => -n[A] - 0.5 * edge);
            let approach = Approach { box_number, mirror, from_middle, direction };
            let glance = Glance { approach, enter, leave };
            return Passing::Through(BoxEntry { glance, axis });
        }
        Passing::Unsure
    }

    /// [`ExactRays::way`] of rays that may not move along an axis.
    #[inline(never)]
    fn way_along_axes(&self, ray: usize, box_number: u64, low: [u32; 3], unit: u32, mirror: u32) -> Passing {
        let ray = ray % RAYS;
        if self.valid >> ray & 1 == 0 {
            return Passing::Unsure;
        }
        let one_cell = f64::from(1_u32 << FRACTION_BITS);
        let edge = f64::from(1_u32.wrapping_shl(unit)) * one_cell;
        let (mut enter, mut before, mut axis) = (f64::MIN, f64::MIN, 3);
        let mut leave = f64::MAX;
        let mut from_middle = [0.0; 3];
        let mut direction = [0.0; 3];
        for a in 0..3 {
            let (d, n) = (self.direction[a][ray], f64::from(low[a]) * one_cell - self.origin[a][ray]);
            // Integers: the box is behind the ray, or off one that does not move along the axis.
            if n <= -edge || (d == 0.0 && n > 0.0) {
                return Passing::Past;
            }
            (from_middle[a], direction[a]) = (-n - 0.5 * edge, d);
            if d > 0.0 {
                let inverse = 1.0 / d;
                let into = n * inverse;
                if into > enter {
                    (before, enter, axis) = (enter, into, a);
                } else if into > before {
                    before = into;
                }
                let out = (n + edge) * inverse;
                leave = if out < leave { out } else { leave };
            }
        }
        if enter > leave + SAME_TIME {
            return Passing::Past;
        }
        // Ties, and rays that start in the box, are left to the integers.
        if enter + SAME_TIME < leave && before + SAME_TIME < enter && enter > SAME_TIME {
            let approach = Approach { box_number, mirror, from_middle, direction };
            let glance = Glance { approach, enter, leave };
            return Passing::Through(BoxEntry { glance, axis });
        }
        Passing::Unsure
    }

    /// Parameter of a ray after `distance / component`, equal to [`crate::render::ray::Ray::t_after`].
    #[inline(always)]
    pub(super) fn t_after(&self, ray: usize, distance: f64, component: f64) -> f64 {
        self.t_start[ray % RAYS] + distance / component * self.t_scale[ray % RAYS]
    }

    /// Usable rays among the finished rows.
    pub(super) fn valid(&self) -> u64 {
        self.valid
    }

    /// Hits of a row's rays with planes within their cells: the planes in `planes`, in the cells of `lows`, as in
    /// [`super::planes::Pairs`]. The same integers as for one box.
    #[inline(always)]
    pub(super) fn meet_planes<L: Lanes>(
        &self,
        l: L,
        row: usize,
        (planes, lows): (&[u64; DOUBLES], &[u64; DOUBLES]),
        hits: &mut TileHits,
    ) {
        let one_cell = l.d(f64::from(1_u32 << FRACTION_BITS));
        let normal = each3!(A => l.d_field(planes, [0, 8, 16][A], 0xff) - l.d(128.0));
        let offset = l.d_field(planes, 24, 0xff) - l.d(128.0);
        let half_edge = l.d_field(lows, 48, 0xffff) * l.d(0.5);
        // Normals never have this component: the ray meets no plane.
        let meets = l.d_lt(l.d(-127.5), normal[0]);
        let (mut start, mut component) = (l.d(0.0) - offset * half_edge * one_cell, l.d(0.0));
        for (a, shift) in [0, 16, 32].into_iter().enumerate() {
            let low = l.d_field(lows, shift, 0xffff);
            let direction = l.d_load(&self.direction[a].as_chunks().0[row]);
            let origin = l.d_load(&self.origin[a].as_chunks().0[row]);
            start = start + normal[a] * (origin - (low + half_edge) * one_cell);
            component = component - normal[a] * direction;
            let to = lanes_of(&mut hits.low[a], row);
            l.d_store(l.d_choose(meets, low, l.d_load(to)), to);
        }
        let (t_start, t_scale) = (&self.t_start.as_chunks().0[row], &self.t_scale.as_chunks().0[row]);
        let t = l.d_load(t_start) + start / component * l.d_load(t_scale);
        let to = lanes_of(&mut hits.t, row);
        l.d_store(l.d_choose(meets, t, l.d_load(to)), to);
    }

    /// Distance from a ray to the low plane of a box along an axis, and its direction there.
    #[inline(always)]
    pub(super) fn entry(&self, ray: usize, axis: usize, low: [u32; 3]) -> (f64, f64) {
        let (a, ray) = (axis % 3, ray % RAYS);
        let plane = f64::from(low[a]) * f64::from(1_u32 << FRACTION_BITS);
        (plane - self.origin[a][ray], self.direction[a][ray])
    }
}

#[inline(always)]
fn lanes_of(values: &mut [f64; RAYS], row: usize) -> &mut [f64; DOUBLES] {
    &mut values.as_chunks_mut().0[row]
}
