//! The surface of a map of labels: where a Gaussian over the inside is one half.

use super::corner::encode;
use super::field::{EDGE, Field};
use crate::format::normal;

/// Weights of samples 1/2, 3/2 and 5/2 away: a Gaussian of 1.4 voxels.
const WEIGHTS: [f64; EDGE / 2] = [0.938_215_595_719_107_8, 0.563_279_350_501_653_5, 0.203_032_796_251_137_9];
const VARIANCE: f64 = 1.4 * 1.4;

/// Normal code of the surface, and the value of `normal . u` on it: one Newton step from the middle of the cell.
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
    let step = 2.0 * (0.5 - sum / all) / square;
    let n = normal::decode_l1(code);
    let value = (0..3).fold(0.0, |v, a| v + f64::from(n[a]) * slope[a] * step);
    value.is_finite().then_some((code, value))
}
