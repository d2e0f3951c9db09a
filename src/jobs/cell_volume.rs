//! Volume and area of the surface within a cell.
//!
//! A cell is cut into six tetrahedra, in each of which the surface is a plane: the very plane of a cell with one. A
//! cell with corners is cut into [`PARTS`] cubed boxes first, at whose corners the trilinear interpolation is asked.

use crate::format::cell::{CORNERS, at_corner};
use crate::geom::{cross, dot};
use crate::load::CellShape;

/// Boxes along each side of a cell with corners.
const PARTS: usize = 4;

/// Corners of the six tetrahedra of a box, corner i being the high one along x, y, z by the bits of i. Neighbouring
/// boxes are cut alike where they meet.
const TETRAHEDRA: [[usize; 4]; 6] =
    [[0, 1, 3, 7], [0, 3, 2, 7], [0, 2, 6, 7], [0, 6, 4, 7], [0, 4, 5, 7], [0, 5, 1, 7]];

/// Inside and surface of a cell.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct CellVolume {
    /// Part of the cell that is inside, 0 to 1.
    pub(super) inside: f64,
    /// Area of the surface in it, in the squared unit of the axes.
    pub(super) area: f64,
}

impl CellVolume {
    /// The surface within a cell whose edges are these axes.
    pub(super) fn of(shape: &CellShape, axes: &[[f64; 3]; 3]) -> Self {
        match shape {
            CellShape::Plane(plane) => {
                let before = |corner| f64::from(at_corner(plane.normal, corner)) - f64::from(plane.offset);
                Self::of_box(&std::array::from_fn(before), axes)
            }
            CellShape::Corners(corners) => {
                let part = axes.map(|axis| axis.map(|c| c / PARTS as f64));
                let at = |steps: [usize; 3]| {
                    (0..CORNERS).fold(0.0, |sum, corner| {
                        let weight = (0..3).fold(1.0, |weight, a| {
                            let high = steps[a] as f64 / PARTS as f64;
                            weight * if corner >> a & 1 == 1 { high } else { 1.0 - high }
                        });
                        sum - weight * f64::from(corners[corner])
                    })
                };
                let mut sum = Self::default();
                for number in 0..PARTS.pow(3) {
                    let low = [number % PARTS, number / PARTS % PARTS, number / PARTS / PARTS];
                    let corner = |corner: usize| at([0, 1, 2].map(|a| low[a] + (corner >> a & 1)));
                    let found = Self::of_box(&std::array::from_fn(corner), &part);
                    sum.inside += found.inside / PARTS.pow(3) as f64;
                    sum.area += found.area;
                }
                sum
            }
        }
    }

    /// The sums of a box, from the signed distance of each corner in front of the surface.
    fn of_box(before: &[f64; CORNERS], axes: &[[f64; 3]; 3]) -> Self {
        let mut sum = Self::default();
        if before.iter().all(|at| *at <= 0.0) {
            return Self { inside: 1.0, area: 0.0 };
        }
        for corners in TETRAHEDRA {
            sum.add(corners, before, axes);
        }
        sum
    }

    /// Adds the sums of a tetrahedron.
    fn add(&mut self, mut corners: [usize; 4], before: &[f64; CORNERS], axes: &[[f64; 3]; 3]) {
        // Corners inside come first.
        corners.sort_by(|a, b| before[*a].total_cmp(&before[*b]));
        let inside = corners.iter().filter(|corner| before[**corner] <= 0.0).count();
        // Part of the way from a corner inside to one outside at which the surface is crossed, and that place.
        let cross = |a: usize, b: usize| {
            let (a, b) = (corners[a], corners[b]);
            let along = before[a] / (before[a] - before[b]);
            let mut place = [0.0; 3];
            for (axis, edge) in axes.iter().enumerate() {
                let (low, high) = ((a >> axis & 1) as f64, (b >> axis & 1) as f64);
                let at = low + along * (high - low);
                place.iter_mut().zip(edge).for_each(|(sum, c)| *sum += at * c);
            }
            (along, place)
        };
        let (part, area) = match inside {
            0 => (0.0, 0.0),
            1 => {
                let [(p, a), (q, b), (r, c)] = [cross(0, 1), cross(0, 2), cross(0, 3)];
                (p * q * r, triangle(a, b, c))
            }
            2 => {
                let [(p, a), (q, b)] = [cross(0, 2), cross(0, 3)];
                let [(r, c), (s, d)] = [cross(1, 2), cross(1, 3)];
                (p * q + p * (1.0 - q) * s + (1.0 - p) * r * s, triangle(a, b, d) + triangle(a, d, c))
            }
            3 => {
                let [(p, a), (q, b), (r, c)] = [cross(0, 3), cross(1, 3), cross(2, 3)];
                (1.0 - (1.0 - p) * (1.0 - q) * (1.0 - r), triangle(a, b, c))
            }
            _ => (1.0, 0.0),
        };
        self.inside += part / 6.0;
        self.area += area;
    }
}

/// Area of a triangle.
fn triangle(a: [f64; 3], b: [f64; 3], c: [f64; 3]) -> f64 {
    let (p, q): ([f64; 3], [f64; 3]) =
        (std::array::from_fn(|k| b[k] - a[k]), std::array::from_fn(|k| c[k] - a[k]));
    let across = cross(p, q);
    dot(across, across).sqrt() / 2.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::cell::Plane;

    const CUBE: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

    #[test]
    fn planes_and_corners_enclose_what_they_do() {
        let of = |normal: [i32; 3], offset: i32| {
            CellVolume::of(&CellShape::Plane(Plane { normal, offset }), &CUBE)
        };
        let near = |found: CellVolume, inside: f64, area: f64| {
            assert!((found.inside - inside).abs() < 1e-12 && (found.area - area).abs() < 1e-12, "{found:?}");
        };
        near(of([127, 0, 0], 0), 0.5, 1.0);
        near(of([0, -127, 0], 127), 1.0, 0.0);
        near(of([0, 0, -127], -127), 0.0, 1.0);
        near(of([63, 64, 0], 0), 0.5, f64::hypot(1.0, 63.0 / 64.0));
        // A hexagon through the middle, and a corner cut off half way along three edges.
        let hexagon = |third: f64| third * 3.0_f64.sqrt() / 4.0 * 6.0 / 2.0;
        let third = CellVolume::of(&CellShape::Corners([3, 1, 1, -1, 1, -1, -1, -3]), &CUBE);
        near(third, 0.5, hexagon(1.0));
        let corner = CellVolume::of(&CellShape::Corners([1, 0, 0, -1, 0, -1, -1, -2]), &CUBE);
        near(corner, 1.0 / 6.0, 3.0_f64.sqrt() / 2.0);
        // Sheared and stretched: the inside part stays, the area is that of the face.
        let axes = [[2.0, 0.0, 0.0], [1.0, 3.0, 0.0], [0.0, 0.0, 5.0]];
        let found = CellVolume::of(&CellShape::Plane(Plane { normal: [0, 0, 127], offset: 0 }), &axes);
        near(found, 0.5, 6.0);
    }
}
