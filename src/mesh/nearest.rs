//! The nearest triangle of a voxel, and its normal.
//!
//! Which triangle is nearest does not depend on the order in which they are asked, nor on how a face is cut into
//! triangles: squared distances are rounded to 2^-28 voxel^2, far above the error of f64, so that triangles that
//! meet at the nearest point tie; of these the one wins that faces the voxel most, then that with the smallest code.
//! Distances: Ericson 2005, *Real-Time Collision Detection*, 5.1.5, with the dot products shared among voxels.

use super::lattice::Triangle;
use crate::format::normal;

/// Added to a squared distance in lattice steps and taken away again, it rounds to 2^-28 voxel^2.
const ROUNDER: f64 = 6_755_399_441_055_744.0 / 16.0;
/// Rounds a cosine to 2^-10, likewise.
const COSINE_ROUNDER: f64 = 6_755_399_441_055_744.0 / 1024.0;
/// Below this part of its terms a sum of products in f64 has an uncertain sign.
const UNSURE: f64 = 1e-12;

/// A triangle made ready for many voxels.
pub(super) struct Facet {
    a: [f64; 3],
    ab: [f64; 3],
    ac: [f64; 3],
    normal: [f64; 3],
    normal_squared: f64,
    abab: f64,
    abac: f64,
    acac: f64,
    /// The box around it.
    pub(super) low: [f64; 3],
    pub(super) high: [f64; 3],
    corners: Triangle,
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// The best triangle of a voxel so far: squared distance, and the normal towards the outside.
#[derive(Clone, Copy, Debug)]
pub(super) struct Nearest {
    /// Lattice steps, squared and rounded.
    pub(super) squared: f64,
    cosine: f64,
    pub(super) normal: [f32; 3],
}

impl Nearest {
    /// No triangle within a distance (lattice steps, squared).
    pub(super) fn within(squared: f64) -> Self {
        Self { squared, cosine: -1.0, normal: [0.0; 3] }
    }

    /// Was one found?
    pub(super) fn found(&self) -> bool {
        self.cosine >= 0.0
    }

    /// Takes a triangle if it comes before the best so far.
    #[inline]
    pub(super) fn offer(&mut self, facet: &Facet, p: [f64; 3]) {
        let squared = (facet.squared_distance(p) + ROUNDER) - ROUNDER;
        if squared > self.squared {
            return;
        }
        let (normal, cosine) = facet.outward(p, squared);
        if squared == self.squared {
            let behind = cosine < self.cosine;
            if behind || (cosine == self.cosine && normal::encode(normal) >= normal::encode(self.normal)) {
                return;
            }
        }
        *self = Self { squared, cosine, normal };
    }
}

impl Facet {
    /// The triangle made ready; `None` if it has no area.
    #[inline]
    pub(super) fn new(t: &Triangle) -> Option<Self> {
        let f = t.map(f64::from);
        let a = [f[0], f[1], f[2]];
        let (b, c) = ([f[3], f[4], f[5]], [f[6], f[7], f[8]]);
        let ab = [b[0] - a[0], b[1] - a[1], b[2] - a[2]];
        let ac = [c[0] - a[0], c[1] - a[1], c[2] - a[2]];
        let normal =
            [ab[1] * ac[2] - ab[2] * ac[1], ab[2] * ac[0] - ab[0] * ac[2], ab[0] * ac[1] - ab[1] * ac[0]];
        let normal_squared = dot(normal, normal);
        if normal_squared == 0.0 {
            return None;
        }
        let low = std::array::from_fn(|k| a[k].min(b[k]).min(c[k]));
        let high = std::array::from_fn(|k| a[k].max(b[k]).max(c[k]));
        let (abab, abac, acac) = (dot(ab, ab), dot(ab, ac), dot(ac, ac));
        Some(Self { a, ab, ac, normal, normal_squared, abab, abac, acac, low, high, corners: *t })
    }

    /// At most the squared distance of a point.
    #[inline]
    pub(super) fn box_distance(&self, p: [f64; 3]) -> f64 {
        let beyond = |k: usize| (self.low[k] - p[k]).max(p[k] - self.high[k]).max(0.0);
        let d = [beyond(0), beyond(1), beyond(2)];
        dot(d, d)
    }

    #[inline]
    fn squared_distance(&self, p: [f64; 3]) -> f64 {
        let ap = [p[0] - self.a[0], p[1] - self.a[1], p[2] - self.a[2]];
        let (d1, d2) = (dot(self.ab, ap), dot(self.ac, ap));
        // The nearest point is a + v ab + w ac.
        let at = |v: f64, w: f64| {
            let d: [f64; 3] = std::array::from_fn(|k| ap[k] - v * self.ab[k] - w * self.ac[k]);
            dot(d, d)
        };
        if d1 <= 0.0 && d2 <= 0.0 {
            return dot(ap, ap);
        }
        let (d3, d4) = (d1 - self.abab, d2 - self.abac);
        if d3 >= 0.0 && d4 <= d3 {
            return at(1.0, 0.0);
        }
        let vc = d1 * d4 - d3 * d2;
        if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
            return at(d1 / self.abab, 0.0);
        }
        let (d5, d6) = (d1 - self.abac, d2 - self.acac);
        if d6 >= 0.0 && d5 <= d6 {
            return at(0.0, 1.0);
        }
        let vb = d5 * d2 - d1 * d6;
        if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
            return at(0.0, d2 / self.acac);
        }
        let va = d3 * d6 - d5 * d4;
        if va <= 0.0 && d4 >= d3 && d5 >= d6 {
            let w = (d4 - d3) / ((d4 - d3) + (d5 - d6));
            return at(1.0 - w, w);
        }
        let height = dot(self.normal, ap);
        height * height / self.normal_squared
    }

    /// The normal that leads from an inside voxel through the triangle's plane, and how much it faces the voxel.
    #[inline]
    fn outward(&self, p: [f64; 3], squared: f64) -> ([f32; 3], f64) {
        let [nx, ny, nz] = self.normal;
        let terms = [nx * (self.a[0] - p[0]), ny * (self.a[1] - p[1]), nz * (self.a[2] - p[2])];
        let mut along = terms[0] + terms[1] + terms[2];
        if along.abs() <= UNSURE * (terms[0].abs() + terms[1].abs() + terms[2].abs()) {
            along = self.exact_side(p);
        }
        let sign = match along {
            a if a > 0.0 => 1.0,
            a if a < 0.0 => -1.0,
            // In the plane: the centre is moved by (-e, e^2, e^3).
            _ => [nx, -ny, -nz].into_iter().find(|c| *c != 0.0).map_or(1.0, f64::signum),
        };
        let cosine =
            if squared > 0.0 { (along * along / (self.normal_squared * squared)).min(1.0) } else { 1.0 };
        let length = self.normal_squared.sqrt();
        #[expect(clippy::cast_possible_truncation, reason = "a direction in single precision")]
        let normal = self.normal.map(|c| (sign * c / length) as f32);
        (normal, (cosine + COSINE_ROUNDER) - COSINE_ROUNDER)
    }

    /// On which side of the plane a lattice point lies, in integers.
    fn exact_side(&self, p: [f64; 3]) -> f64 {
        let t = self.corners.map(i128::from);
        #[expect(clippy::cast_possible_truncation, reason = "lattice points are whole numbers")]
        let p = p.map(|c| i128::from(c as i64));
        let (ab, ac) = ([t[3] - t[0], t[4] - t[1], t[5] - t[2]], [t[6] - t[0], t[7] - t[1], t[8] - t[2]]);
        let normal =
            [ab[1] * ac[2] - ab[2] * ac[1], ab[2] * ac[0] - ab[0] * ac[2], ab[0] * ac[1] - ab[1] * ac[0]];
        let along: i128 = (0..3).map(|k| normal[k] * (t[k] - p[k])).sum();
        #[expect(clippy::cast_precision_loss, reason = "its sign and size are wanted")]
        let along = along as f64;
        along
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
            let got = facet.squared_distance(p);
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
