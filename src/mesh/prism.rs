//! Lower bounds of the distance of rows of voxels from a triangle: from its plane, and beyond its edges within the
//! plane.
//!
//! Both parts are at right angles, and each changes evenly along a row. So most triangles that are not the nearest of a
//! voxel are ruled out by a few products, without finding their nearest part. Processor seconds of builds, one thread,
//! taken in turns with the version before; here vertices are also placed once, and rows settled only where crossed:
//!
//! | mesh at 1024^3 | before | now |
//! |---|---|---|
//! | bunny, 7 k triangles | .62 | .51 |
//! | head, 100 k | .65 | .59 |
//! | 100 parts, 115 k | 2.43 | 1.89 |
//! | torus, 1 M; 10 M | 1.49; 6.42 | 1.29; 5.41 |

use super::lattice::STEPS;
use super::nearest::Facet;
use crate::geom::{cross, dot};

/// Triangles whose area, squared, is below this part of the largest possible are not used: their normals are too
/// inexact.
const SLIVER: f64 = 1e-8;

/// The plane of a triangle, and those through its edges at right angles to it.
pub(super) struct Prism {
    /// A corner on each plane's edge, and its normal of length 1, which points outwards except for the first.
    corners: [[f64; 3]; 2],
    normals: [[f64; 3]; 4],
}

/// Distances from the planes along a row: at its first voxel, and from voxel to voxel.
pub(super) struct Row {
    first: [f64; 4],
    step: [f64; 4],
}

impl Prism {
    #[inline(always)]
    pub(super) fn around(facet: &Facet) -> Self {
        let Facet { a, ab, ac, normal, normal_squared, abab, acac, .. } = *facet;
        let corners = [a, [a[0] + ab[0], a[1] + ab[1], a[2] + ab[2]]];
        if normal_squared < SLIVER * abab * acac {
            return Self { corners, normals: [[0.0; 3]; 4] };
        }
        let bc = [ac[0] - ab[0], ac[1] - ab[1], ac[2] - ab[2]];
        // Edges are at right angles to the normal, so that lengths multiply.
        #[expect(clippy::cast_possible_truncation, reason = "bounds have room for it")]
        let roots = [normal_squared, abab, dot(bc, bc), acac].map(|squared| (squared as f32).sqrt());
        let [n, x, y, z] = roots.map(|root| f64::from(1.0 / root));
        let (x, y, z) = (n * x, n * y, n * z);
        let times = |p: [f64; 3], by: f64| p.map(|c| c * by);
        let normals = [
            times(normal, n),
            times(cross(ab, normal), x),
            times(cross(bc, normal), y),
            times(cross(normal, ac), z),
        ];
        Self { corners, normals }
    }

    /// The row that begins with this middle of a voxel.
    #[inline(always)]
    pub(super) fn row(&self, p: [f64; 3]) -> Row {
        let [a, b] = self.corners.map(|corner| [p[0] - corner[0], p[1] - corner[1], p[2] - corner[2]]);
        let [h, x, y, z] = self.normals;
        Row {
            first: [dot(h, a), dot(x, a), dot(y, b), dot(z, a)],
            step: self.normals.map(|normal| normal[0] * f64::from(STEPS)),
        }
    }
}

impl Row {
    /// Lower bound of the squared distance of voxel `x`, except for rounding.
    #[inline(always)]
    pub(super) fn at_least(&self, x: f64) -> f64 {
        let larger = |a: f64, b: f64| if a > b { a } else { b };
        let [h, a, b, c] = std::array::from_fn(|k| self.first[k] + x * self.step[k]);
        let beyond = larger(larger(a, b), larger(c, 0.0));
        h * h + beyond * beyond
    }
}

#[cfg(test)]
mod tests {
    use super::super::lattice::Triangle;
    use super::super::nearest::Nearest;
    use super::*;

    #[test]
    fn bounds_are_no_farther_than_the_distance_and_often_near_to_it() {
        let mut state = 11_u32;
        let mut next = |n: u32| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            i32::try_from((u64::from(state >> 2) * u64::from(n)) >> 30).unwrap()
        };
        let (mut near, mut all) = (0, 0);
        for round in 0..20_000 {
            // Small and very large triangles, slivers among them, far from the corner of the lattice.
            let size = [5000, 300, 7, 1 << 28][round % 4];
            let mut t: Triangle = std::array::from_fn(|_| next(size) - next(size) / 2 + (1 << 27));
            if round % 16 == 3 {
                t = std::array::from_fn(|k| if k < 6 { t[k] } else { (t[k - 6] + t[k - 3]) / 2 + next(3) });
            }
            let Some(facet) = Facet::new(&t) else { continue };
            let prism = Prism::around(&facet);
            // Near to a point of the triangle.
            let mut p: [f64; 3] =
                std::array::from_fn(|k| f64::from((t[k] + t[k + 3]) / 2 + next(16_000) - 8000));
            let row = prism.row(p);
            for x in 0..8 {
                let mut best = Nearest::within(1e18);
                best.offer(&facet, p);
                let (got, want) = (row.at_least(f64::from(x)), best.distance());
                let mut close = Nearest::within(want * want + 0.1);
                close.offer(&facet, p);
                assert!(want > 8192.0 || got <= close.reach(), "{t:?} {p:?}: {got} {want}");
                near += u32::from(got.sqrt() > 0.9 * want);
                all += 1;
                p[0] += f64::from(STEPS);
            }
        }
        assert!(all > 100_000 && near > all / 4, "{near} of {all}");
    }
}
