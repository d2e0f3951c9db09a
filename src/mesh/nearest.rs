//! The nearest triangle of a voxel, and its normal.
//!
//! The choice depends neither on the order in which triangles are asked, nor on the way in which a face is cut into
//! triangles: squared distances are rounded to 2^-28 voxel^2, far above the error of f64, so that triangles that meet
//! at the nearest point tie; of these the one wins that faces the voxel most, then the one with the smallest code.
//! Distances share the dot products of edges among voxels.

use super::lattice::{Triangle, edges};
use crate::format::normal;
use crate::geom::{Nearest as Point, cross, dot, nearest_on_triangle};

/// Number that rounds a squared distance in lattice steps to 2^-28 voxel^2 when it is added and taken away again.
const ROUNDER: f64 = 6_755_399_441_055_744.0 / 16.0;
/// Allowance for the errors of bounds of squared distances, in lattice steps squared: the square of 32 steps.
const SPARE: f64 = 1024.0;
/// Part of its terms below which a sum of products in f64 has an uncertain sign.
const UNSURE: f64 = 1e-12;

/// A triangle prepared for many voxels.
pub(crate) struct Facet {
    pub(super) a: [f64; 3],
    pub(super) ab: [f64; 3],
    pub(super) ac: [f64; 3],
    pub(super) normal: [f64; 3],
    pub(super) normal_squared: f64,
    pub(super) abab: f64,
    abac: f64,
    pub(super) acac: f64,
    /// Bounding box.
    pub(super) low: [f64; 3],
    pub(super) high: [f64; 3],
    corners: Triangle,
}

/// The best triangle of a voxel so far: squared distance, and the normal towards the outside.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Nearest {
    /// Squared distance in lattice steps, rounded.
    squared: f64,
    /// Squared distance of the triangle's plane, rounded; below 0 without a triangle.
    height: f64,
    /// Normal of any length.
    pub(crate) normal: [f32; 3],
}

impl Nearest {
    /// The state without a triangle, for those within a distance (lattice steps, squared).
    pub(crate) fn within(squared: f64) -> Self {
        Self { squared, height: -1.0, normal: [0.0; 3] }
    }

    pub(crate) fn found(&self) -> bool {
        self.height >= 0.0
    }

    /// Distance in lattice steps.
    pub(crate) fn distance(&self) -> f64 {
        self.squared.max(0.0).sqrt()
    }

    /// Distance in lattice steps beyond which no triangle would be taken.
    #[inline(always)]
    #[expect(clippy::cast_possible_truncation, reason = "a bound with room for it")]
    pub(super) fn bound(&self) -> f32 {
        (self.squared as f32 + 1.0).sqrt() + 0.5
    }

    /// Limit of [`super::prism::Row::at_least`] above which no triangle would be taken.
    #[inline(always)]
    pub(super) fn reach(&self) -> f64 {
        self.squared + SPARE
    }

    /// Takes a triangle if it comes before the best so far: nearer, or as near and facing the voxel more, or with
    /// the smaller code.
    #[inline]
    pub(crate) fn offer(&mut self, facet: &Facet, p: [f64; 3]) {
        if facet.box_distance(p) > self.squared {
            return;
        }
        let ap = [p[0] - facet.a[0], p[1] - facet.a[1], p[2] - facet.a[2]];
        let along = dot(facet.normal, ap);
        // No point of a triangle is nearer than its plane.
        if along * along > (self.squared + 1.0) * facet.normal_squared {
            return;
        }
        let squared = (facet.squared_distance(ap, along) + ROUNDER) - ROUNDER;
        if squared > self.squared {
            return;
        }
        let height = (along * along / facet.normal_squared + ROUNDER) - ROUNDER;
        let normal = facet.outward(p, along);
        if squared == self.squared {
            let behind = height < self.height;
            if behind || (height == self.height && normal::encode(normal) >= normal::encode(self.normal)) {
                return;
            }
        }
        *self = Self { squared, height, normal };
    }
}

impl Facet {
    /// The prepared triangle; `None` if it has no area.
    #[inline]
    pub(crate) fn new(t: &Triangle) -> Option<Self> {
        let [a, ab, ac] = edges(t);
        let normal = cross(ab, ac);
        let normal_squared = dot(normal, normal);
        if normal_squared == 0.0 {
            return None;
        }
        let low = std::array::from_fn(|k| f64::from(t[k].min(t[k + 3]).min(t[k + 6])));
        let high = std::array::from_fn(|k| f64::from(t[k].max(t[k + 3]).max(t[k + 6])));
        let (abab, abac, acac) = (dot(ab, ab), dot(ab, ac), dot(ac, ac));
        Some(Self { a, ab, ac, normal, normal_squared, abab, abac, acac, low, high, corners: *t })
    }

    /// Lower bound of the squared distance of a point.
    #[inline]
    pub(super) fn box_distance(&self, p: [f64; 3]) -> f64 {
        // `f64::max` would also test for NaN.
        let larger = |a: f64, b: f64| if a > b { a } else { b };
        let beyond = |k: usize| larger(larger(self.low[k] - p[k], p[k] - self.high[k]), 0.0);
        let d = [beyond(0), beyond(1), beyond(2)];
        dot(d, d)
    }

    #[inline]
    fn squared_distance(&self, ap: [f64; 3], along: f64) -> f64 {
        let along_edges = [dot(self.ab, ap), dot(self.ac, ap)];
        match nearest_on_triangle(along_edges, [self.abab, self.abac, self.acac]) {
            Point::Border([v, w]) => {
                let d: [f64; 3] = std::array::from_fn(|k| ap[k] - v * self.ab[k] - w * self.ac[k]);
                dot(d, d)
            }
            Point::Face(_) => along * along / self.normal_squared,
        }
    }

    /// The normal that leads from an inside voxel through the triangle's plane; `along` is the distance of the voxel
    /// along the normal, times the normal's length.
    #[inline]
    fn outward(&self, p: [f64; 3], along: f64) -> [f32; 3] {
        let [nx, ny, nz] = self.normal;
        let mut towards = -along;
        let terms = (nx * (self.a[0] - p[0])).abs()
            + (ny * (self.a[1] - p[1])).abs()
            + (nz * (self.a[2] - p[2])).abs();
        if towards.abs() <= UNSURE * terms {
            towards = self.exact_side(p);
        }
        let sign = if towards > 0.0 {
            1.0
        } else if towards < 0.0 {
            -1.0
        } else {
            // The centre lies in the plane: it is moved by (-e, e^2, e^3).
            [nx, -ny, -nz].into_iter().find(|c| *c != 0.0).map_or(1.0, f64::signum)
        };
        #[expect(clippy::cast_possible_truncation, reason = "a direction in single precision")]
        let normal = self.normal.map(|c| (sign * c) as f32);
        normal
    }

    /// Side of the plane on which a lattice point lies, in integers.
    fn exact_side(&self, p: [f64; 3]) -> f64 {
        let t = self.corners.map(i128::from);
        #[expect(clippy::cast_possible_truncation, reason = "lattice points are whole numbers")]
        let p = p.map(|c| i128::from(c as i64));
        let (ab, ac) = ([t[3] - t[0], t[4] - t[1], t[5] - t[2]], [t[6] - t[0], t[7] - t[1], t[8] - t[2]]);
        let normal =
            [ab[1] * ac[2] - ab[2] * ac[1], ab[2] * ac[0] - ab[0] * ac[2], ab[0] * ac[1] - ab[1] * ac[0]];
        (0..3).map(|k| normal[k] * (t[k] - p[k])).sum::<i128>() as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_are_those_of_a_dense_search() {
        let mut state = 3_u32;
        let mut next = |n: u32| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            i32::try_from((state >> 9) % n).unwrap()
        };
        for _ in 0..300 {
            let t: Triangle = std::array::from_fn(|_| next(9000));
            let Some(facet) = Facet::new(&t) else { continue };
            let p: [f64; 3] = std::array::from_fn(|_| f64::from(next(12_000) - 1500));
            let mut best = f64::INFINITY;
            let steps = 60;
            for i in 0..=steps {
                for j in 0..=steps - i {
                    let (v, w) = (f64::from(i) / f64::from(steps), f64::from(j) / f64::from(steps));
                    let d: [f64; 3] =
                        std::array::from_fn(|k| facet.a[k] + v * facet.ab[k] + w * facet.ac[k] - p[k]);
                    best = best.min(dot(d, d));
                }
            }
            let ap = [p[0] - facet.a[0], p[1] - facet.a[1], p[2] - facet.a[2]];
            let got = facet.squared_distance(ap, dot(facet.normal, ap));
            assert!(got <= best * (1.0 + 1e-9) + 1e-6, "{t:?} {p:?}: {got} {best}");
            assert!(best.sqrt() - got.sqrt() < 260.0, "{t:?} {p:?}: {got} {best}");
            assert!(facet.box_distance(p) <= got * (1.0 + 1e-12) + 1e-6);
        }
    }

    #[test]
    fn the_order_of_triangles_and_of_their_vertices_does_not_matter() {
        // A roof seen from within: the nearest point is its ridge.
        let roof = [
            [0, 0, 5000, 9000, 0, 5000, 0, 4000, 1000],
            [9000, 0, 5000, 0, 0, 5000, 0, -4000, 1000],
            [9000, 0, 5000, 0, -4000, 1000, 9000, -4000, 1000],
        ];
        let p = [4500.0, 0.0, 9000.0];
        let seek = |order: &[usize]| {
            let mut best = Nearest::within(1e9);
            order.iter().for_each(|k| best.offer(&Facet::new(&roof[*k]).unwrap(), p));
            assert!(best.found());
            best.normal
        };
        let first = seek(&[0, 1, 2]);
        for order in [[0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]] {
            assert_eq!(seek(&order), first);
        }
    }
}
