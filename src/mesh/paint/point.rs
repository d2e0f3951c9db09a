//! The nearest point of a triangle, and the number of texels on a voxel there.

use super::super::lattice::{STEPS, Triangle, edges};
use crate::geom::{Nearest, dot, nearest_on_triangle};

/// The corners' weights at the triangle's point nearest to `p` (Ericson 2005, 5.1.5).
#[expect(clippy::cast_possible_truncation, reason = "weights are in single precision")]
pub(super) fn nearest_point(t: &Triangle, p: [f64; 3]) -> [f32; 3] {
    let [v, w] = second_and_third(t, p);
    [(1.0 - v - w) as f32, v as f32, w as f32]
}

pub(super) fn squared_distance(t: &Triangle, p: [f64; 3]) -> f64 {
    let ([a, ab, ac], [v, w]) = (edges(t), second_and_third(t, p));
    let d: [f64; 3] = std::array::from_fn(|k| p[k] - a[k] - v * ab[k] - w * ac[k]);
    dot(d, d)
}

fn second_and_third(t: &Triangle, p: [f64; 3]) -> [f64; 2] {
    let [a, ab, ac] = edges(t);
    let ap = [p[0] - a[0], p[1] - a[1], p[2] - a[2]];
    let products = [dot(ab, ab), dot(ab, ac), dot(ac, ac)];
    match nearest_on_triangle([dot(ab, ap), dot(ac, ap)], products) {
        Nearest::Border(weights) => weights,
        Nearest::Face([va, vb, vc]) => {
            let all = va + vb + vc;
            if all > 0.0 { [vb / all, vc / all] } else { [0.0, 0.0] }
        }
    }
}

/// Most texels that a step of a voxel on the triangle crosses, in any direction.
#[expect(clippy::cast_possible_truncation, reason = "a size in single precision")]
pub(super) fn texels_per_voxel(t: &Triangle, texels: &[[f32; 2]; 3]) -> f32 {
    let [_, ab, ac] = edges(t).map(|e| e.map(|c| c / f64::from(STEPS)));
    let (g11, g12, g22) = (dot(ab, ab), dot(ab, ac), dot(ac, ac));
    let area = g11 * g22 - g12 * g12;
    if area <= 0.0 {
        return 1.0;
    }
    let way = |corner: usize, k: usize| f64::from(texels[corner][k]) - f64::from(texels[0][k]);
    // J J^T of the map J from the triangle's plane to texels.
    let product = |i: usize, j: usize| {
        let (pi, qi, pj, qj) = (way(1, i), way(2, i), way(1, j), way(2, j));
        (g22 * pi * pj - g12 * (pi * qj + qi * pj) + g11 * qi * qj) / area
    };
    let (a, b, c) = (product(0, 0), product(0, 1), product(1, 1));
    let half = (a - c) / 2.0;
    let largest = (a + c) / 2.0 + (half * half + b * b).sqrt();
    if largest.is_finite() { largest.max(0.0).sqrt() as f32 } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_lead_to_the_nearest_point() {
        let t: Triangle = [0, 0, 0, 8192, 0, 0, 0, 8192, 0];
        for (p, weights) in [
            ([2048.0, 2048.0, 900.0], [0.5, 0.25, 0.25]),
            ([-50.0, -3.0, 1.0], [1.0, 0.0, 0.0]),
            ([9000.0, -10.0, 0.0], [0.0, 1.0, 0.0]),
            ([-1.0, 9999.0, 0.0], [0.0, 0.0, 1.0]),
            ([8192.0, 8192.0, 7.0], [0.0, 0.5, 0.5]),
            ([4096.0, -77.0, 0.0], [0.5, 0.5, 0.0]),
        ] {
            assert_eq!(nearest_point(&t, p), weights, "{p:?}");
        }
    }

    #[test]
    fn texels_on_a_voxel_are_those_of_the_denser_direction() {
        // Two voxels along x have 32 texels, two along y 8; a turn by 45 degrees changes nothing.
        let t: Triangle = [0, 0, 0, 8192, 0, 0, 0, 8192, 0];
        assert_eq!(texels_per_voxel(&t, &[[5.0, 5.0], [37.0, 5.0], [5.0, 13.0]]), 16.0);
        let turned: Triangle = [0, 0, 0, 4096, 4096, 0, -4096, 4096, 0];
        let rate = texels_per_voxel(&turned, &[[0.0, 0.0], [32.0, 0.0], [0.0, 8.0]]);
        assert!((rate - 16.0 * std::f32::consts::SQRT_2).abs() < 1e-3, "{rate}");
        assert_eq!(texels_per_voxel(&[0; 9], &[[0.0; 2]; 3]), 1.0);
    }
}
