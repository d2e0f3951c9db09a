//! A field around the middle of a cell: its gradient and second derivatives, over 4 x 4 x 4 samples.

use super::corner::{BENT, NEAR_BENT, NEAR_SMOOTH};
use crate::format::cell::CORNERS;

/// Samples of a cell's neighbourhood along an axis.
pub(super) const TAPS: usize = 4;
/// Taps of the smoothing filter for the two samples next to the cell; the other two have weight 1.
pub(super) const NEAR: i8 = 4;
/// Taps of the derivative: for the two samples next to the cell, and for the other two.
pub(super) const DERIVE: [i8; 2] = [3, 5];

/// Depths at the corners, and the gradient and second derivatives in the middle of a cell.
pub(super) struct CellSamples {
    pub(super) corners: [f32; CORNERS],
    pub(super) jet: Jet,
}

/// A gradient and the second derivatives xx, yy, zz, xy, xz, yz, in units of [`UNIT`] per voxel and square voxel.
#[derive(Clone, Copy)]
pub(super) struct Jet {
    pub(super) gradient: [f32; 3],
    pub(super) second: [f32; 6],
}

/// Sums of taps: a gradient of 1 gives 18 x 10 x 10, a pure second derivative 2 x 10 x 10, a mixed one 18 x 18 x 10.
/// The taps 1, -1, -1, 1 of the pure ones smooth less than the taps of the gradient, so their result is scaled down.
const UNIT: f32 = 1800.0;
pub(super) const PURE: f32 = UNIT / 200.0 * 0.85;
pub(super) const MIXED: f32 = UNIT / 3240.0;

impl Jet {
    /// Placeholder for cells at the border until their samples are read.
    pub(super) const UNKNOWN: Self = Self { gradient: [f32::NAN; 3], second: [0.0; 6] };

    /// The gradient at a point, in voxels from the middle of the cell.
    #[inline(always)]
    pub(super) fn at(&self, [x, y, z]: [f32; 3]) -> [f32; 3] {
        let ([gx, gy, gz], [xx, yy, zz, xy, xz, yz]) = (self.gradient, self.second);
        [gx + (x * xx + y * xy + z * xz), gy + (x * xy + y * yy + z * yz), gz + (x * xz + y * yz + z * zz)]
    }

    /// Largest distance of the smooth gradient's plane from the crossings: less where the surface bends much.
    /// `gradient` is taken at the mean of the crossings.
    #[inline(always)]
    pub(super) fn near_crossings(&self, gradient: [f32; 3]) -> f32 {
        let (across, square) = self.bend(gradient);
        if across > BENT * BENT * square { NEAR_BENT } else { NEAR_SMOOTH }
    }

    /// Squares of the second derivatives across the gradient, and of the gradient; their ratio is the squared
    /// curvature.
    #[inline(always)]
    pub(super) fn bend(&self, [gx, gy, gz]: [f32; 3]) -> (f32, f32) {
        let [xx, yy, zz, xy, xz, yz] = self.second;
        // The second derivatives across the gradient, P H P: the sum of their squares.
        let square = gx * gx + gy * gy + gz * gz;
        let along = [gx * xx + gy * xy + gz * xz, gx * xy + gy * yy + gz * yz, gx * xz + gy * yz + gz * zz];
        let once = along[0] * along[0] + along[1] * along[1] + along[2] * along[2];
        let twice = (gx * along[0] + gy * along[1] + gz * along[2]) / square;
        let all = xx * xx + yy * yy + zz * zz + 2.0 * (xy * xy + xz * xz + yz * yz);
        (all - 2.0 * (once / square) + twice * twice, square)
    }
}

/// Filters along an axis: smooth, first and second derivative.
const SMOOTH: [f32; TAPS] = [1.0, NEAR as f32, NEAR as f32, 1.0];
const FIRST: [f32; TAPS] = [-DERIVE[1] as f32, -DERIVE[0] as f32, DERIVE[0] as f32, DERIVE[1] as f32];
const SECOND: [f32; TAPS] = [1.0, -1.0, -1.0, 1.0];

/// Filters along x, y, z of the sums in a jet: gradient, pure and mixed second derivatives. The rest fills registers.
const SUMS: [[[f32; TAPS]; 3]; 12] = [
    [FIRST, SMOOTH, SMOOTH],
    [SMOOTH, FIRST, SMOOTH],
    [SMOOTH, SMOOTH, FIRST],
    [SECOND, SMOOTH, SMOOTH],
    [SMOOTH, SECOND, SMOOTH],
    [SMOOTH, SMOOTH, SECOND],
    [FIRST, FIRST, SMOOTH],
    [FIRST, SMOOTH, FIRST],
    [SMOOTH, FIRST, FIRST],
    [[0.0; TAPS]; 3],
    [[0.0; TAPS]; 3],
    [[0.0; TAPS]; 3],
];

/// Weights of a sample in [`SUMS`], samples in the order of x, y, z.
static WEIGHTS: [[f32; SUMS.len()]; TAPS.pow(3)] = {
    let mut weights = [[0.0; SUMS.len()]; TAPS.pow(3)];
    let mut at = 0;
    while at < weights.len() {
        let mut sum = 0;
        while sum < SUMS.len() {
            let [x, y, z] = SUMS[sum];
            weights[at][sum] = x[at % TAPS] * y[at / TAPS % TAPS] * z[at / TAPS / TAPS];
            sum += 1;
        }
        at += 1;
    }
    weights
};

/// The jet of 4 x 4 x 4 depths, given by x, y, z, for cells at the border of the volume.
pub(super) fn jet_of(depth: impl Fn([usize; 3]) -> f32) -> Jet {
    let mut sums = [0.0; SUMS.len()];
    for (at, weights) in WEIGHTS.iter().enumerate() {
        let depth = depth([at % TAPS, at / TAPS % TAPS, at / TAPS / TAPS]);
        for (sum, weight) in sums.iter_mut().zip(weights) {
            *sum += weight * depth;
        }
    }
    let [x, y, z, xx, yy, zz, xy, xz, yz, ..] = sums;
    Jet { gradient: [x, y, z], second: [xx * PURE, yy * PURE, zz * PURE, xy * MIXED, xz * MIXED, yz * MIXED] }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_of_one_pass_have_the_bits_of_nine() {
        let mut state = 1_u32;
        let depths: [f32; TAPS.pow(3)] = std::array::from_fn(|at| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            if at % 7 == 0 { -0.0 } else { (state >> 8) as f32 / 1e3 - 8e3 }
        });
        let depth = |[x, y, z]: [usize; 3]| depths[x + TAPS * (y + TAPS * z)];
        let one = |[along_x, along_y, along_z]: [[f32; TAPS]; 3]| {
            let mut sum = 0.0_f32;
            for (z, c) in along_z.into_iter().enumerate() {
                for (y, b) in along_y.into_iter().enumerate() {
                    for (x, a) in along_x.into_iter().enumerate() {
                        sum += a * b * c * depth([x, y, z]);
                    }
                }
            }
            sum
        };
        let jet = jet_of(depth);
        let scales = [[1.0; 3], [PURE; 3], [MIXED; 3]].concat();
        let found = jet.gradient.into_iter().chain(jet.second);
        for ((along, scale), found) in SUMS.into_iter().zip(scales).zip(found) {
            assert_eq!(found.to_bits(), (one(along) * scale).to_bits());
        }
    }
}
