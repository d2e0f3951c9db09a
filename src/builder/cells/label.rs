//! The surface of a label map: the level one half of the inside smoothed by a Gaussian.

use super::corner::encode;
use super::field::{EDGE, Field};
use crate::format::normal;

/// Weights of samples 1/2, 3/2 and 5/2 away: a Gaussian of 1.4 voxels.
const WEIGHTS: [f64; EDGE / 2] = [0.938_215_595_719_107_8, 0.563_279_350_501_653_5, 0.203_032_796_251_137_9];
const VARIANCE: f64 = 1.4 * 1.4;

/// Standard deviation of the weights' distribution along a line. With it a half-space comes nearest to its true place
/// (root mean square of planes .051 voxel, of balls of 36 voxels .071; with 1.4 .055 and .074; by one Newton step .107
/// and .124).
const SIGMA: f64 = 1.35;
/// Largest difference of a share from one half that is evaluated; smooth walls in a cell reach 0.3.
const MAX_SHARE: f64 = 0.45;

/// Argument at which the normal distribution's integral exceeds one half by `share`: to 4e-5, for shares up to
/// [`MAX_SHARE`].
fn quantile(share: f64) -> f64 {
    let u = 2.0 * share.clamp(-MAX_SHARE, MAX_SHARE);
    let t = u * u;
    u * (1.253_345_28 - t * (1.319_334_3 - t * 0.222_752_88)) / (1.0 - t * (1.313_690_14 - t * 0.373_589_8))
}

/// Normal code of the surface, and `normal . u` on it: the half-space that holds the same share of the weights.
pub(super) fn plane(field: &Field) -> Option<(u16, f64)> {
    let weight = |i: usize| WEIGHTS[if i < EDGE / 2 { EDGE / 2 - 1 - i } else { i - EDGE / 2 }];
    #[expect(clippy::cast_precision_loss, reason = "small")]
    let place = |i: usize| i as f64 - 2.5;
    let (mut sum, mut all, mut slope) = (0.0, 0.0, [0.0; 3]);
    for z in 0..EDGE {
        for y in 0..EDGE {
            for x in 0..EDGE {
                let w = weight(x) * weight(y) * weight(z);
                all += w;
                if field.is_inside([x, y, z]) {
                    sum += w;
                    for (slope, i) in slope.iter_mut().zip([x, y, z]) {
                        *slope += w * place(i);
                    }
                }
            }
        }
    }
    let slope = slope.map(|s| s / (VARIANCE * all));
    let square = slope.iter().map(|s| s * s).sum::<f64>();
    let code = encode(slope.map(|s| -s))?;
    // The point of the plane next to the middle of the cell, in half voxels.
    let step = -2.0 * SIGMA * quantile(sum / all - 0.5) / square.sqrt();
    let n = normal::decode_l1(code);
    let value = (0..3).fold(0.0, |v, a| v + f64::from(n[a]) * slope[a] * step);
    value.is_finite().then_some((code, value))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_the_normal_distribution() {
        // Reference: the integral in small steps.
        let (mut at, mut share, step) = (0.0, 0.0, 1e-4);
        while share < MAX_SHARE {
            let middle: f64 = at + 0.5 * step;
            share += step * (-0.5 * middle * middle).exp() / std::f64::consts::TAU.sqrt();
            at += step;
            assert!(
                (quantile(share) - at).abs() < 1e-4 && quantile(-share) == -quantile(share),
                "{share} {at}"
            );
        }
    }
}
