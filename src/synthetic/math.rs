//! Mathematical functions with the same bits on every machine: IEEE `+ - * /` and `sqrt` only, in one fixed order.
//!
//! The standard library leaves `sin`, `exp` and their like to the platform, which may round the last bits in its own
//! way; then a volume would differ between machines where a sample lies next to a threshold.

use std::sync::LazyLock;

use crate::geom::dot;

pub(super) type Vector = [f64; 3];

pub(super) fn minus(a: Vector, b: Vector) -> Vector {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// A vector of length 1; the x axis in the place of a null vector.
pub(super) fn unit(v: Vector) -> Vector {
    let length = dot(v, v).sqrt();
    if length > 0.0 { v.map(|c| c / length) } else { [1.0, 0.0, 0.0] }
}

/// Sine and cosine: Taylor's polynomials of the reduced angle. Error below 1e-14 for angles of a few hundred.
pub(super) fn sin_cos(angle: f64) -> [f64; 2] {
    use std::f64::consts::FRAC_PI_2;
    let quarters = (angle / FRAC_PI_2).round_ties_even();
    let r = angle - quarters * FRAC_PI_2;
    let square = r * r;
    // Horner's scheme: 1 - x (1 - x (1 - ...) / 20) / 6 and 1 - x (1 - ...) / 2.
    let series = |first: u32| {
        (0..8_u32).rev().fold(1.0, |sum, k| {
            let n = f64::from(2 * k + first);
            1.0 - square / (n * (n + 1.0)) * sum
        })
    };
    let (sin, cos) = (r * series(2), series(1));
    #[expect(clippy::cast_possible_truncation, reason = "a whole number far within the range")]
    let quadrant = (quarters as i64) & 3;
    match quadrant {
        0 => [sin, cos],
        1 => [cos, -sin],
        2 => [-sin, -cos],
        _ => [-cos, sin],
    }
}

/// `exp(-x)` for x >= 0: the tenth square of `exp(-x / 1024)`. Relative error below 1e-12.
fn exp_minus(x: f64) -> f64 {
    let small = x / 1024.0;
    let series = (1..=8_u32).rev().fold(1.0, |sum, k| 1.0 - small / f64::from(k) * sum);
    (0..10).fold(series, |v: f64, _| v * v)
}

/// Density of the normal distribution.
fn density(t: f64) -> f64 {
    const PER_ROOT: f64 = 0.398_942_280_401_432_7;
    PER_ROOT * exp_minus(0.5 * t * t)
}

/// Entries of the table of [`share_below`] for each unit.
const PER_UNIT: u32 = 64;
/// Beyond this many standard deviations the share is 0 or 1.
pub(super) const FAR: f64 = 6.5;

/// Shares and densities at t = 0, 1/64, ... 6.5, by Simpson's rule over sixteenths of a step.
static SHARES: LazyLock<Vec<[f64; 2]>> = LazyLock::new(|| {
    let step = 1.0 / f64::from(PER_UNIT);
    let (mut share, mut table) = (0.5, vec![[0.5, density(0.0)]]);
    for i in 0..PER_UNIT * 13 / 2 {
        let start = f64::from(i) * step;
        let part = step / 16.0;
        let sum: f64 = (0..=16_u32)
            .map(|k| {
                let weight = [2.0, 4.0][(k % 2) as usize];
                let weight = if k == 0 || k == 16 { 1.0 } else { weight };
                weight * density(start + f64::from(k) * part)
            })
            .sum();
        share += sum * part / 3.0;
        table.push([share, density(start + step)]);
    }
    table
});

/// Share of a normal distribution below `t` standard deviations: cubic interpolation, error below 1e-9; exactly
/// 1/2 at 0, exactly 0 and 1 beyond [`FAR`], and `share(t) + share(-t) = 1` but for one rounding.
pub(super) fn share_below(t: f64) -> f64 {
    let size = t.abs();
    if size >= FAR {
        return if t > 0.0 { 1.0 } else { 0.0 };
    }
    let at = size * f64::from(PER_UNIT);
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "within 0..416")]
    let entry = at as usize;
    let (Some([a, slope_a]), Some([b, slope_b])) = (SHARES.get(entry), SHARES.get(entry + 1)) else {
        return if t > 0.0 { 1.0 } else { 0.0 };
    };
    let u = at - at.floor();
    let step = 1.0 / f64::from(PER_UNIT);
    let (v, rise) = (1.0 - u, b - a);
    let (from_a, from_b) = (slope_a * step - rise, rise - slope_b * step);
    let share = a + u * rise + u * v * (v * from_a + u * from_b);
    if t < 0.0 { 1.0 - share } else { share }
}

/// 64 well mixed bits of a place and a seed.
pub(super) fn hash([x, y, z]: [u32; 3], seed: u64) -> u64 {
    let mut h = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ (u64::from(x) | u64::from(y) << 32);
    h = mix(h);
    mix(h ^ u64::from(z).wrapping_mul(0xd6e8_feb8_6659_fd93))
}

/// Stafford's mixer 13.
fn mix(z: u64) -> u64 {
    let z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ z >> 31
}

/// A value of each place with mean 0 and deviation 1, nearly normal: the sum of eight uniform ones.
pub(super) fn noise(at: [u32; 3], seed: u64) -> f64 {
    /// Standard deviation of eight uniform values of 0..65536: 65536 sqrt(8 / 12).
    const DEVIATION: f64 = 53_509.919_8;
    let first = hash(at, seed);
    let words = [first, mix(first.wrapping_add(0x9e37_79b9_7f4a_7c15))];
    let sum: u64 = words.iter().flat_map(|w| (0..4).map(move |k| w >> (16 * k) & 0xffff)).sum();
    let sum = sum as f64;
    (sum - 4.0 * 65535.0) / DEVIATION
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn functions_agree_with_the_platforms_to_their_stated_errors() {
        for i in -4000..4000 {
            let x = f64::from(i) * 0.037;
            let [sin, cos] = sin_cos(x);
            assert!((sin - x.sin()).abs() < 1e-13 && (cos - x.cos()).abs() < 1e-13, "{x}");
            let e = x.abs() / 4.0;
            assert!((exp_minus(e) / (-e).exp() - 1.0).abs() < 1e-12, "{e}");
        }
        // Values from tables, to ten digits.
        for (t, share) in [(0.0, 0.5), (1.0, 0.841_344_746_1), (2.0, 0.977_249_868_1), (3.3, 0.999_516_575_9)]
        {
            assert!((share_below(t) - share).abs() < 1e-9, "{t}: {}", share_below(t));
            assert!((share_below(-t) - (1.0 - share)).abs() < 1e-9);
        }
        let mut last = 0.0;
        for i in -7000..7000 {
            let t = f64::from(i) * 0.001;
            let share = share_below(t);
            assert!(share >= last, "{t}");
            assert!((share + share_below(-t) - 1.0).abs() < 1e-15, "{t}");
            last = share;
        }
        assert_eq!((share_below(0.0), share_below(9.0), share_below(-9.0)), (0.5, 1.0, 0.0));
    }

    #[test]
    fn noise_has_mean_0_and_deviation_1_and_hangs_on_place_and_seed() {
        let values: Vec<f64> = (0..60_u32)
            .flat_map(|z| (0..60).flat_map(move |y| (0..60).map(move |x| noise([x, y, z], 7))))
            .collect();
        let count = f64::from(60_u32.pow(3));
        let mean = values.iter().sum::<f64>() / count;
        let variance = values.iter().map(|v| v * v).sum::<f64>() / count;
        assert!(mean.abs() < 0.01 && (variance - 1.0).abs() < 0.01, "{mean} {variance}");
        // Neighbours are uncorrelated.
        let pairs: f64 = values.windows(2).map(|w| w[0] * w[1]).sum::<f64>() / count;
        assert!(pairs.abs() < 0.01, "{pairs}");
        assert_ne!(noise([1, 2, 3], 1), noise([1, 2, 3], 2));
        assert_ne!(noise([1, 2, 3], 1), noise([2, 1, 3], 1));
    }
}
