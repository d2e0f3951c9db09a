//! Noise of a volume, measured on samples away from the surface while they pass through the ring.
//!
//! Differences of samples four apart (three along z, where the ring is short) and next to each other, where all samples
//! around both lie on the same side. The standard deviation follows from the median of the differences, so that
//! occasional structure does not count; the correlation of neighbours follows from both. Samples are selected by
//! position alone, so that the result is the same for any budget and number of threads.
#![expect(clippy::cast_possible_truncation, clippy::cast_precision_loss, reason = "counts and buckets")]

use std::ops::Range;

use super::ring::SampleForm;
use super::solid::BRICK;
use crate::cpu::{Kernel, Lanes, dispatch};
use crate::format::Noise;
use crate::volume::Scalar;

/// Buckets of differences: 32 for each power of two from [`MIN_EXPONENT`] on, and one for zero.
const PARTS_BITS: u32 = 5;
const MIN_EXPONENT: i32 = -40;
const OCTAVES: usize = 80;
const BUCKETS: usize = (OCTAVES << PARTS_BITS) + 1;
/// Kinds of differences: by side, axis, and distance of the samples (next to each other or apart).
const KINDS: usize = 2 * 3 * 2;
/// Least number of differences for a median.
const MIN_COUNT: u64 = 64;
/// Median magnitude of standard normal deviates.
const MEDIAN: f64 = 0.674_489_750_196_081_7;

/// Samples needed around each of the two along x and y, of a pair along another axis also along z.
pub(super) const AROUND: u32 = 2;
/// Distance of the two samples along x and y, and along z.
pub(super) const APART: [u32; 3] = [4, 4, 3];
/// Samples of a brick along an axis that can be read.
const WIDTH: usize = BRICK as usize + 2;

/// Steps between measured positions, in voxels along x, y, z: smaller in small volumes. Some 15,000 pairs an axis and more,
/// which give the deviation within 1 %; long steps along y and z cost least, as the rows between them are not read.
pub(super) fn steps(dims: [u32; 3]) -> [u32; 3] {
    match dims.iter().map(|n| u64::from(*n)).product::<u64>() {
        0..=2_100_000 => [2, 2, 2],
        2_100_001..=8_400_000 => [4, 4, 4],
        8_400_001..=33_000_000 => [4, 16, 8],
        _ => [8, 16, 16],
    }
}

/// Samples after the first of a pair that are needed, in the direction of the pair or across it.
fn reach(is_along: bool) -> u32 {
    AROUND + if is_along { APART[0] } else { 0 }
}

/// Measured positions along x or y in the brick that begins at `origin`, where the volume has `n` samples.
pub(super) fn places(origin: u32, step: u32, n: u32, is_along: bool) -> impl Iterator<Item = u32> {
    let end = (BRICK + 2).min(n.saturating_sub(origin)).saturating_sub(reach(is_along)).min(BRICK);
    (step..end).step_by(step as usize).map(move |place| origin + place)
}

/// The samples around all of these positions.
pub(super) fn needed(origin: u32, step: u32, n: u32) -> Range<u32> {
    let last = (BRICK - 1) / step * step + reach(true);
    origin + step - AROUND..origin + (last + 1).min(BRICK + 2).min(n.saturating_sub(origin))
}

/// The sides on which the samples of a brick lie, in the slices around one.
pub(super) struct Sides([[[u8; WIDTH]; WIDTH]; 2]);

/// Codes of a side; both have no bit in common.
const INSIDE: u8 = 1;
const OUTSIDE: u8 = 2;

impl Sides {
    pub(super) fn new() -> Self {
        Self([[[0; WIDTH]; WIDTH]; 2])
    }

    /// Sets a row from its samples in the slice that only pairs along z need, and in the five around pairs along x and y.
    pub(super) fn set_row<R: Scalar>(&mut self, at: usize, rows: [&[R]; 6], zero: f32) {
        let [of_z, of_both] = dispatch(RowKernel { rows, zero });
        (self.0[0][at], self.0[1][at]) = (of_both, of_z);
    }

    /// Whether all samples around a pair are inside, by the place of its first one in a row; `None` where they are on both
    /// sides.
    pub(super) fn even(&self, row: usize, axis: usize) -> impl Fn(usize) -> Option<bool> {
        let mut codes = [INSIDE | OUTSIDE; WIDTH];
        for row in &self.0[usize::from(axis == 2)][row - AROUND as usize..=row + reach(axis == 1) as usize] {
            codes.iter_mut().zip(row).for_each(|(code, of_row)| *code &= of_row);
        }
        move |place| match codes[place - AROUND as usize..=place + reach(axis == 0) as usize]
            .iter()
            .fold(INSIDE | OUTSIDE, |all, code| all & code)
        {
            0 => None,
            code => Some(code == INSIDE),
        }
    }
}

/// Codes of a row, for pairs along z and for those along x and y; samples from `zero` on are inside.
struct RowKernel<'a, R> {
    rows: [&'a [R]; 6],
    zero: f32,
}

impl<R: Scalar> Kernel for RowKernel<'_, R> {
    type Output = [[u8; WIDTH]; 2];

    #[inline(always)]
    fn run(self, _: impl Lanes) -> [[u8; WIDTH]; 2] {
        let [before, around @ ..] = self.rows;
        let mut codes = [INSIDE | OUTSIDE; WIDTH];
        for row in around {
            join(&mut codes, row, self.zero);
        }
        let of_both = codes;
        join(&mut codes, before, self.zero);
        [codes, of_both]
    }
}

#[inline(always)]
fn join<R: Scalar>(codes: &mut [u8; WIDTH], row: &[R], zero: f32) {
    for (code, sample) in codes.iter_mut().zip(row) {
        *code &= if SampleForm::depth_from(*sample, 0.0) >= zero { INSIDE } else { OUTSIDE };
    }
}

/// Counts of differences.
#[derive(Clone, Debug)]
pub(super) struct NoiseCounts(Vec<u32>);

impl NoiseCounts {
    pub(super) const BYTES: usize = KINDS * BUCKETS * size_of::<u32>();

    pub(super) fn new() -> Self {
        Self(vec![0; KINDS * BUCKETS])
    }

    /// Counts the difference of two samples on one side, next to each other along an axis or apart.
    pub(super) fn add(&mut self, inside: bool, axis: usize, apart: bool, difference: f32) {
        let kind = (usize::from(inside) * 3 + axis) * 2 + usize::from(apart);
        if let Some(count) = self.0.get_mut(kind * BUCKETS + bucket(difference)) {
            *count = count.saturating_add(1);
        }
    }

    pub(super) fn join(&mut self, other: &Self) {
        self.0.iter_mut().zip(&other.0).for_each(|(sum, count)| *sum = sum.saturating_add(*count));
    }

    /// Noise in units of the samples; `None` with too few differences. `step` is the step of the samples, 0 for floats.
    pub(super) fn noise(&self, step: f64) -> Option<Noise> {
        let deviation = |side: usize, axis: usize, apart: usize| {
            let kind = (side * 3 + axis) * 2 + apart;
            median(&self.0[kind * BUCKETS..][..BUCKETS], step)
                .map(|median| median / (MEDIAN * std::f64::consts::SQRT_2))
        };
        let mean = |values: &[f64]| {
            let square = values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64;
            (!values.is_empty()).then(|| square.sqrt())
        };
        let of_side = |side| mean(&(0..3).filter_map(|axis| deviation(side, axis, 1)).collect::<Vec<_>>());
        let (outside, inside) = (of_side(0), of_side(1));
        // Clipped values have no noise, such as air at 0.
        let most = inside.unwrap_or(0.0).max(outside.unwrap_or(0.0));
        let known = |side: Option<f64>| side.filter(|deviation| *deviation > 0.0).unwrap_or(most);
        let correlation = [0, 1, 2].map(|axis| {
            let of = |side| {
                let (near, apart) = (deviation(side, axis, 0)?, deviation(side, axis, 1)?);
                (apart > 0.0).then(|| (1.0 - (near / apart).powi(2)).clamp(0.0, 0.99))
            };
            let both: Vec<f64> = (0..2).filter_map(of).collect();
            both.iter().sum::<f64>() / both.len().max(1) as f64
        });
        (most > 0.0).then(|| Noise {
            inside: known(inside),
            outside: known(outside),
            correlation,
            steepness: 0.0,
        })
    }
}

/// The bucket of a difference: 0 for zero.
fn bucket(difference: f32) -> usize {
    let bits = difference.abs().to_bits() >> (f32::MANTISSA_DIGITS - 1 - PARTS_BITS);
    let first = ((127 + MIN_EXPONENT) as u32) << PARTS_BITS;
    (bits + 1).saturating_sub(first).min(BUCKETS as u32 - 1) as usize
}

/// Least and greatest difference of a bucket; an integer stands for all differences that round to it.
fn ends(bucket: usize, step: f64) -> [f64; 2] {
    let Some(number) = bucket.checked_sub(1) else { return [0.0, 0.5 * step] };
    let octave = 2.0_f64.powi((number >> PARTS_BITS) as i32 + MIN_EXPONENT);
    let part = (number & ((1 << PARTS_BITS) - 1)) as f64;
    let parts = f64::from(1_u32 << PARTS_BITS);
    let [low, high] = [1.0 + part / parts, 1.0 + (part + 1.0) / parts].map(|v| v * octave);
    if high - low < step { [low - 0.5 * step, low + 0.5 * step] } else { [low, high] }
}

/// The median of the counted differences, interpolated within its bucket.
fn median(counts: &[u32], step: f64) -> Option<f64> {
    let all = counts.iter().map(|count| u64::from(*count)).sum::<u64>();
    if all < MIN_COUNT {
        return None;
    }
    let mut before = 0;
    let half = all as f64 / 2.0;
    for (bucket, count) in counts.iter().enumerate() {
        let count = u64::from(*count);
        if (before + count) as f64 >= half {
            let [low, high] = ends(bucket, step);
            // All in the first bucket: no noise.
            return Some(if count == all {
                low
            } else {
                low + (high - low) * (half - before as f64) / count as f64
            });
        }
        before += count;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    /// Normal deviates by sums of twelve.
    fn deviate(random: &mut Random) -> f64 {
        (0..12).map(|_| random.below(1 << 20) as f64 / f64::from(1 << 20)).sum::<f64>() - 6.0
    }

    #[test]
    fn the_deviation_and_the_correlation_of_noise_are_found() {
        for (sigma, step, correlated) in
            [(0.003, 0.0, false), (7.0, 0.0, true), (1.5, 1.0, false), (1.1, 1.0, false), (250.0, 1.0, true)]
        {
            let mut random = Random(3);
            let white: Vec<f64> = (0..40_000).map(|_| sigma * deviate(&mut random)).collect();
            // Each value is the mean of two neighbours: their correlation is one half.
            let scale = if correlated { 0.5_f64.sqrt() } else { 1.0 };
            let value = |i: usize| {
                let value = if correlated { scale * (white[i] + white[i + 1]) } else { white[i] };
                if step > 0.0 { (value / step).round() * step } else { value }
            };
            let mut counts = NoiseCounts::new();
            for i in 0..39_000 {
                for axis in 0..3 {
                    counts.add(true, axis, false, (value(i) - value(i + 1)) as f32);
                    counts.add(true, axis, true, (value(i) - value(i + 4)) as f32);
                }
            }
            let found = counts.noise(step).unwrap();
            // Rounding adds noise.
            let sigma = (sigma * sigma + step * step / 12.0).sqrt();
            assert!((found.inside / sigma - 1.0).abs() < 0.03, "{sigma} {step}: {found:?}");
            assert_eq!(found.inside, found.outside);
            let due = if correlated { 0.5 } else { 0.0 };
            assert!(found.correlation.iter().all(|c| (c - due).abs() < 0.04), "{sigma} {step}: {found:?}");
        }
        assert_eq!(NoiseCounts::new().noise(1.0), None);
    }
}
