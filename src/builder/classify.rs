//! The range test: 64 samples become one word, bit i set where sample i is inside.

use super::range::SampleRange;
use crate::cpu::{Kernel, Lanes, dispatch, movemask};
use crate::volume::Scalar;

/// Classifies `samples` into `words`; bits beyond the last sample are 0.
///
/// `words` is exactly `samples.len().div_ceil(64)` long. NaN is outside.
#[inline]
pub(super) fn classify<T: Scalar>(samples: &[T], range: SampleRange<T>, words: &mut [u64]) {
    debug_assert_eq!(words.len(), samples.len().div_ceil(64));
    dispatch(Classify { samples, range, words });
}

struct Classify<'a, T> {
    samples: &'a [T],
    range: SampleRange<T>,
    words: &'a mut [u64],
}

impl<T: Scalar> Kernel for Classify<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self, isa: impl Lanes) {
        let (blocks, tail) = self.samples.as_chunks::<64>();
        for (word, block) in self.words.iter_mut().zip(blocks) {
            *word = word_of(block, self.range, isa);
        }
        if let (false, Some(last)) = (tail.is_empty(), self.words.last_mut()) {
            *last = tail
                .iter()
                .enumerate()
                .fold(0, |word, (i, v)| word | u64::from(self.range.contains(*v)) << i);
        }
    }
}

#[inline(always)]
fn word_of<T: Scalar>(block: &[T; 64], range: SampleRange<T>, isa: impl Lanes) -> u64 {
    if let Some(avx2) = isa.avx2() {
        // Comparisons become whole-byte masks, 32 at a time; the compiler packs them.
        let mut halves = [0_u32; 2];
        for (half, samples) in halves.iter_mut().zip(block.as_chunks::<32>().0) {
            let mut mask = [0_u8; 32];
            for (m, v) in mask.iter_mut().zip(samples) {
                *m = if range.contains(*v) { 0xff } else { 0 };
            }
            *half = movemask(avx2, mask);
        }
        u64::from(halves[0]) | u64::from(halves[1]) << 32
    } else {
        block.iter().enumerate().fold(0, |word, (i, v)| word | u64::from(range.contains(*v)) << i)
    }
}

#[cfg(test)]
#[expect(clippy::cast_possible_truncation, reason = "numbers made up for the test")]
mod tests {
    use super::*;

    #[test]
    fn every_length_and_both_instruction_sets_agree_with_the_definition() {
        let samples: Vec<u16> = (0..300_u32).map(|i| (i.wrapping_mul(40_503) >> 3) as u16).collect();
        let range = SampleRange { lo: 1000_u16, hi: 30_000 };
        for len in 0..samples.len() {
            let mut fast = vec![0; len.div_ceil(64)];
            let mut slow = fast.clone();
            classify(&samples[..len], range, &mut fast);
            Classify { samples: &samples[..len], range, words: &mut slow }.run(crate::cpu::Portable);
            assert_eq!(fast, slow);
            for (i, v) in samples[..len].iter().enumerate() {
                assert_eq!(fast[i / 64] >> (i % 64) & 1 == 1, (1000..=30_000).contains(v));
            }
        }
    }

    #[test]
    fn nan_is_outside_whatever_the_range() {
        let samples = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 0.0, -0.0];
        let mut words = [0];
        classify(&samples, SampleRange { lo: f32::NEG_INFINITY, hi: f32::INFINITY }, &mut words);
        assert_eq!(words, [0b11110]);
    }
}
