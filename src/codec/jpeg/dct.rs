//! The inverse discrete cosine transform of 8x8 blocks (T.81 A.3.3), in integers.
//!
//! Rows and columns are each split into even and odd frequencies; 64-bit arithmetic keeps twelve bits
//! below the sample between the two passes, so that the result is the exactly rounded one but for ties
//! closer than about 1/2000, and the same on every machine.

/// Place of each coefficient in a block by rows, in the order of the codestream (T.81, figure A.6).
pub(super) const ZIGZAG: [u8; 64] = [
    0, 1, 8, 16, 9, 2, 3, 10, 17, 24, 32, 25, 18, 11, 4, 5, 12, 19, 26, 33, 40, 48, 41, 34, 27, 20, 13, 6, 7,
    14, 21, 28, 35, 42, 49, 56, 57, 50, 43, 36, 29, 22, 15, 23, 30, 37, 44, 51, 58, 59, 52, 45, 38, 31, 39,
    46, 53, 60, 61, 54, 47, 55, 62, 63,
];

/// Quantised coefficients of one block, by rows.
pub(super) type Block = [i16; 64];

/// Steps of quantisation of the coefficients, by rows.
pub(super) type Steps = [u16; 64];

/// Bits of the constants.
const SCALE: u32 = 28;
/// Bits kept below the sample between the passes.
const KEPT: u32 = 12;

/// `cos(k pi / 16) / 2` for k = 1 ... 7, in units of 2^-28.
const C: [i64; 8] =
    [0, 131_638_772, 124_001_012, 111_597_962, 94_906_266, 74_567_374, 51_362_901, 26_184_580];

/// No coefficient of a 12-bit image comes near; damaged ones are cut, so that 2^(17 + 2) times 2^KEPT after
/// the first pass, times 2^(2 + SCALE) in the second, stays in 64 bits.
const LARGEST: i32 = 1 << 17;

/// The samples of a block, by rows, between 0 and `2^precision - 1`.
pub(super) fn samples(block: &Block, steps: &Steps, precision: u8) -> [u16; 64] {
    let half = 1_i64 << (precision - 1);
    let most = (1_i64 << precision) - 1;
    let finish = |value: i64| {
        let rounded = (value + (1 << (SCALE + KEPT - 1))) >> (SCALE + KEPT);
        u16::try_from((rounded + half).clamp(0, most)).unwrap_or(u16::MAX)
    };
    // Most blocks of smooth images have only a DC coefficient: one value, through the same two passes.
    if block[1..].iter().all(|&coefficient| coefficient == 0) {
        let once = pass_one(C[4] * coefficient(block, steps, 0));
        return [finish(C[4] * once); 64];
    }
    let mut between = [0_i64; 64];
    for x in 0..8 {
        let column: [i64; 8] = std::array::from_fn(|y| coefficient(block, steps, y * 8 + x));
        for (y, value) in transform(column).into_iter().enumerate() {
            between[y * 8 + x] = pass_one(value);
        }
    }
    let mut samples = [0; 64];
    for (row, out) in between.as_chunks::<8>().0.iter().zip(samples.as_chunks_mut::<8>().0) {
        *out = transform(*row).map(finish);
    }
    samples
}

/// Coefficient `at`, with its quantisation undone.
#[inline]
fn coefficient(block: &Block, steps: &Steps, at: usize) -> i64 {
    i64::from((i32::from(block[at]) * i32::from(steps[at])).clamp(-LARGEST, LARGEST))
}

/// Rounds a value of the first pass to [`KEPT`] fractional bits.
#[inline]
fn pass_one(value: i64) -> i64 {
    (value + (1 << (SCALE - KEPT - 1))) >> (SCALE - KEPT)
}

/// One row or column, times 2^28.
#[inline]
fn transform(f: [i64; 8]) -> [i64; 8] {
    let (sum, difference) = (C[4] * (f[0] + f[4]), C[4] * (f[0] - f[4]));
    let outer = C[2] * f[2] + C[6] * f[6];
    let inner = C[6] * f[2] - C[2] * f[6];
    let even = [sum + outer, difference + inner, difference - inner, sum - outer];
    let odd = [
        C[1] * f[1] + C[3] * f[3] + C[5] * f[5] + C[7] * f[7],
        C[3] * f[1] - C[7] * f[3] - C[1] * f[5] - C[5] * f[7],
        C[5] * f[1] - C[1] * f[3] + C[7] * f[5] + C[3] * f[7],
        C[7] * f[1] - C[5] * f[3] + C[3] * f[5] - C[1] * f[7],
    ];
    std::array::from_fn(|n| if n < 4 { even[n] + odd[n] } else { even[7 - n] - odd[7 - n] })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;
    use std::f64::consts::PI;

    #[test]
    fn the_zigzag_runs_along_the_diagonals() {
        let mut expected: Vec<(u8, u8)> = (0..64).map(|i| (i / 8, i % 8)).collect();
        expected.sort_by_key(|&(y, x)| (x + y, if (x + y) % 2 == 0 { x } else { y }));
        let found: Vec<(u8, u8)> = ZIGZAG.iter().map(|&i| (i / 8, i % 8)).collect();
        assert_eq!(found, expected);
    }

    #[test]
    fn the_constants_are_the_cosines() {
        for (k, &c) in (1..8).zip(&C[1..]) {
            let exact = (f64::from(k) * PI / 16.0).cos() / 2.0 * f64::from(1 << SCALE);
            assert!((c as f64 - exact).abs() <= 0.5, "{k}: {exact}");
        }
    }

    /// The sum of T.81 A.3.3 as it stands, before rounding.
    fn by_definition(block: &Block, steps: &Steps, x: usize, y: usize) -> f64 {
        let c = |u: usize| if u == 0 { 0.5_f64.sqrt() } else { 1.0 };
        let wave = |n: usize, u: usize| (((2 * n + 1) * u) as f64 * PI / 16.0).cos();
        let mut sum = 0.0;
        for v in 0..8 {
            for u in 0..8 {
                let value = f64::from(block[v * 8 + u]) * f64::from(steps[v * 8 + u]);
                sum += c(u) * c(v) / 4.0 * value * wave(x, u) * wave(y, v);
            }
        }
        sum
    }

    #[test]
    fn samples_are_the_rounded_sums_of_the_definition() {
        let mut random = Random(7);
        for case in 0..400 {
            let precision = if case % 2 == 0 { 8 } else { 12 };
            let largest = 1_i32 << (precision + 1);
            let mut block = [0_i16; 64];
            let mut steps = [1_u16; 64];
            for at in 0..1 + random.below(64_usize) {
                let at = if case % 5 == 0 { 0 } else { at };
                steps[at] = 1 + random.below(9);
                let value = random.below(2 * largest) - largest;
                block[at] = i16::try_from(value / i32::from(steps[at]) / 4).unwrap();
            }
            let samples = samples(&block, &steps, precision);
            for y in 0..8 {
                for x in 0..8 {
                    let half = f64::from(1_u32 << (precision - 1));
                    let exact = (by_definition(&block, &steps, x, y) + half).clamp(0.0, 2.0 * half - 1.0);
                    let error = (f64::from(samples[y * 8 + x]) - exact).abs();
                    assert!(error <= 0.5005, "case {case}: off by {error}");
                }
            }
        }
    }

    #[test]
    fn impossible_coefficients_do_no_harm() {
        for sign in [i16::MIN, i16::MAX] {
            let samples = samples(&[sign; 64], &[u16::MAX; 64], 12);
            assert!(samples.iter().all(|&s| s <= 4095));
        }
    }
}
