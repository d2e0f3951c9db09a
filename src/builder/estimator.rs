//! The estimators of normals by name, and the weights of each.
//!
//! All are gradients by weights within 5x5x5 samples: along the differentiated axis an odd row of taps, along the
//! other two an even one. Errors by measurement (`tests/it/normals.rs`, degrees, mean and
//! 99th percentile, 16-bit normals read back from the file; point spread 0.8 voxel):
//!
//! | estimator | time of normals | ball R=40 | 2.5 % noise | binary | 1:1:2 | Marschner-Lobb 80^3 | 160^3 |
//! |---|---|---|---|---|---|---|---|
//! | `central`, 2 samples an axis | 1 | 1.86 / 3.99 | 3.90 / 9.42 | 21.5 / 45.7 | 4.74 / 15.1 | **4.27 / 10.5** | **0.98 / 2.43** |
//! | `sobel`, 3x3x3 | 1 | 0.80 / 1.57 | 1.59 / 3.90 | 7.63 / 19.6 | 1.59 / 4.12 | 4.75 / 14.3 | 1.01 / 3.49 |
//! | `isotropic5`, 5x5x5, the default | 1 | **0.31 / 0.55** | 0.77 / 1.87 | 3.82 / 12.5 | **0.44 / 1.42** | 11.4 / 29.0 | 2.05 / 7.57 |
//! | `modified`, the paper's | 1 | 2.92 / 4.88 | 2.95 / 5.15 | 4.98 / 10.4 | 4.85 / 9.08 | 30.9 / 54.1 | 4.30 / 12.5 |
//! | `label5`, 5x5x5, for two values | 1 | 0.58 / 1.12 | **0.76 / 1.72** | **2.51 / 9.32** | 1.03 / 2.16 | 21.2 / 44.1 | 3.10 / 10.9 |
//! | `auto` | 3 | **0.31 / 0.55** | 0.77 / 1.89 | **2.51 / 9.32** | **0.44 / 1.43** | **4.27 / 10.5** | **0.98 / 2.43** |
//!
//! Two more were tried and removed: Zucker's and Hummel's on 3x3x3 takes twice the time of `sobel` for larger errors
//! (1.33 / 2.61, 1.85 / 4.20, 7.23 / 18.8, 2.52 / 6.03, 5.71 / 15.5, 1.19 / 3.76: only the binary ball is 5 % better),
//! and the derivative of a Gaussian of one voxel on 5x5x5 the time of `isotropic5` (0.54 / 1.05, 0.88 / 2.09, 3.92 /
//! 12.3, 1.04 / 2.65, 11.6 / 28.7, 2.11 / 7.63: all means are larger).
//!
//! The signal at 40^3, next to its Nyquist limit: `central` and `auto` 26.0, `isotropic5` 60.6.
//!
//! So the default is the best of the fixed ones wherever a surface is smooth over some voxels and has grey levels, also
//! with noise and between thick slices; two samples an axis resolve more only where the surface bends within two or
//! three voxels, and the wider weights of `label5` only where there are two values. No fixed one is good in all of
//! these cases. `auto` distinguishes them, at three times the time of normals (about a fifth more for the whole build),
//! so it is not the default. A Gaussian over 7x7x7 has 1.94 / 7.44 on the binary ball: 29 % less than `auto` on
//! average, but the builder holds five slices.

use std::fmt;
use std::str::FromStr;

/// Estimator of normals.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Gradient {
    /// Differences of the two neighbours along each axis.
    Central,
    /// Sobel's weights on 3x3x3.
    Sobel,
    /// The separable 5x5x5 pair of least error over all directions of a blurred ball.
    #[default]
    Isotropic5,
    /// The paper's gradient over the neighbours within 5x5x5 (section 4). It states no weights; here all are equal, as
    /// in a plane of least squares.
    Modified,
    /// The separable 5x5x5 pair of least error for two values only: label maps, masks.
    Label5,
    /// [`Gradient::Label5`] for two values only, else [`Gradient::Isotropic5`] where smoothing removes noise,
    /// [`Gradient::Central`] where it would blur the surface.
    Auto,
}

impl Gradient {
    /// All estimators.
    pub const ALL: [Self; 6] =
        [Self::Central, Self::Sobel, Self::Isotropic5, Self::Modified, Self::Label5, Self::Auto];

    /// Name on the command line and in the metadata.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Central => "central",
            Self::Sobel => "sobel",
            Self::Isotropic5 => "isotropic5",
            Self::Modified => "modified",
            Self::Label5 => "label5",
            Self::Auto => "auto",
        }
    }

    /// The estimator of a name.
    pub fn by_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|g| g.name() == name)
    }
}

impl fmt::Display for Gradient {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Gradient {
    /// The unknown name.
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        Self::by_name(text).ok_or_else(|| text.to_owned())
    }
}

/// Weights of one estimator. Sums of 16-bit samples must fit 32 bits: the derivative's taps times the square of the
/// smoothing's sum is at most 32767.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Taps {
    /// Weights of the smoothing along x, y and z, at distance 0, 1 and 2.
    pub(super) smooth: [[i8; 3]; 3],
    /// Weights of the derivative at distance 1 and 2.
    pub(super) derive: [i8; 2],
}

/// This pair minimises the error over all directions on a blurred ball among separable 5-tap pairs
/// (0.013 degrees; a Gaussian of sigma 1: 0.35), rounded to small integers.
const SMOOTH: [i8; 3] = [20, 13, 2];
const DERIVE: [i8; 2] = [2, 1];
/// Smoothing along an axis with a much longer spacing than the finest: a surface passes more steeply through few slices
/// there, which suits this flatter filter better (a ball sampled 1:1:2, stored normals: mean 0.51 to 0.38 degrees, 99th
/// percentile 1.40 to 0.95).
const SMOOTH_COARSE: [i8; 3] = [20, 15, 1];
/// Least spacing of a coarse axis, in units of the finest.
const COARSE_FROM: f64 = 1.6;

impl Taps {
    pub(super) const ISOTROPIC: Self = Self::alike(SMOOTH, DERIVE);

    const fn alike(smooth: [i8; 3], derive: [i8; 2]) -> Self {
        Self { smooth: [smooth; 3], derive }
    }

    /// Sum of an axis's five smoothing taps.
    fn sum(self, axis: usize) -> f64 {
        let [middle, near, far] = self.smooth[axis].map(f64::from);
        middle + 2.0 * (near + far)
    }
}

/// One fixed estimator for one spacing.
#[derive(Clone, Copy, Debug)]
pub(super) struct Estimate {
    pub(super) taps: Taps,
    /// Reciprocal spacing of each axis, relative to the smallest: gradients in physical units. It includes the sum of
    /// the axis's own smoothing taps, as its component is the only one not smoothed by them.
    pub(super) per_spacing: [f32; 3],
}

impl Estimate {
    /// The estimate of an estimator; for [`Gradient::Auto`], the one for smooth surfaces.
    pub(super) fn new(gradient: Gradient, spacing_mm: [f64; 3]) -> Self {
        let smallest = spacing_mm.iter().copied().fold(f64::INFINITY, f64::min);
        let taps = match gradient {
            Gradient::Central => Taps::alike([1, 0, 0], [1, 0]),
            Gradient::Sobel => Taps::alike([2, 1, 0], [1, 0]),
            Gradient::Modified => Taps::alike([1, 1, 1], [1, 2]),
            // The best of 500 pairs of small integers, by the mean and the 99th percentile on balls of radius 20 and 40
            // and on random planes.
            Gradient::Label5 => Taps::alike([20, 18, 7], [1, 2]),
            Gradient::Isotropic5 | Gradient::Auto => {
                let smooth =
                    spacing_mm.map(|s| if s >= COARSE_FROM * smallest { SMOOTH_COARSE } else { SMOOTH });
                Taps { smooth, derive: DERIVE }
            }
        };
        let finest = (0..3).find(|a| spacing_mm[*a] == smallest).unwrap_or(0);
        let gain = |a: usize| smallest / spacing_mm[a] * (taps.sum(a) / taps.sum(finest));
        #[expect(clippy::cast_possible_truncation, reason = "ratios near 1 and below")]
        Self { taps, per_spacing: std::array::from_fn(|a| gain(a) as f32) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_of_16_bit_samples_fit_32_bits() {
        for gradient in Gradient::ALL {
            for spacing in [[1.0; 3], [1.0, 1.0, 5.0], [2.0, 1.0, 3.0]] {
                let estimate = Estimate::new(gradient, spacing);
                let taps = estimate.taps;
                let derive: f64 = taps.derive.iter().map(|t| f64::from(*t)).sum();
                for a in 0..3 {
                    let sum = derive * taps.sum((a + 1) % 3) * taps.sum((a + 2) % 3);
                    assert!(sum <= 32767.0, "{gradient}: {sum}");
                }
            }
        }
    }

    #[test]
    fn names_come_back() {
        for gradient in Gradient::ALL {
            assert_eq!(gradient.name().parse(), Ok(gradient));
        }
        assert_eq!("laplace".parse::<Gradient>(), Err("laplace".to_owned()));
    }
}
