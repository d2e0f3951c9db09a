//! The outermost values of a volume, and the range that holds all but padding and single hot samples.
//!
//! A histogram's bins divide a range evenly. A fill value of -3.4e38, or one hot sample, would leave all others in one
//! bin, so both are told apart first: the few outermost values of either end are counted.

use std::ops::Range;

use super::evidence::End;
use super::range::Ordered;

/// Values that are held at either end.
const HELD: usize = 8;
/// Samples that are looked at together.
const RUN: usize = 256;
/// Most hot samples, and the part of the volume that they may be if that is more.
const HOT: u64 = 8;
const HOT_PART: u64 = 100_000;
/// Least ratio of the whole range to the one without hot samples, and without a fill value; and least size of a fill
/// value.
const HOT_RATIO: f64 = 64.0;
const FILL_RATIO: f64 = 1024.0;
const FILL: f64 = 1e7;

/// The outermost finite samples of different values, with their counts.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Extremes {
    /// From the least one up, and from the greatest one down.
    ends: [Vec<End>; 2],
}

/// The range of the samples that count for a threshold.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Core {
    pub(super) low: f64,
    pub(super) high: f64,
    /// The values that fill what was not measured, below the range and above.
    pub(super) fill: [Option<f64>; 2],
}

impl Extremes {
    /// The least and the greatest sample; `None` without finite samples.
    pub(crate) fn whole(&self) -> Option<(f64, f64)> {
        let [least, most] = &self.ends;
        Some((least.first()?.value, most.first()?.value))
    }

    pub(super) fn add<T: Ordered>(&mut self, samples: &[T]) {
        for run in samples.chunks(RUN) {
            let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
            for sample in run {
                let v = sample.to_f64();
                if v.is_finite() {
                    (low, high) = (low.min(v), high.max(v));
                }
            }
            let last = |end: &Vec<End>, farthest: f64| end.get(HELD - 1).map_or(farthest, |end| end.value);
            let [least, most] = &self.ends;
            if low > last(least, f64::INFINITY) && high < last(most, f64::NEG_INFINITY) || low > high {
                continue;
            }
            for alike in run.chunk_by(|a, b| a == b) {
                let end = End { value: alike[0].to_f64(), count: alike.len() as u64 };
                if end.value.is_finite() {
                    self.add_value(end);
                }
            }
        }
    }

    fn add_value(&mut self, new: End) {
        for (end, sign) in self.ends.iter_mut().zip([1.0, -1.0]) {
            let at = end.partition_point(|known| known.value * sign < new.value * sign);
            match end.get_mut(at) {
                Some(known) if known.value == new.value => known.count += new.count,
                _ => {
                    end.insert(at, new);
                    end.truncate(HELD);
                }
            }
        }
    }

    pub(crate) fn join(&mut self, other: &Self) {
        let [least, most] = &other.ends;
        // A value at both ends is one.
        let only_most = most.iter().filter(|end| least.iter().all(|known| known.value != end.value));
        least.iter().chain(only_most).for_each(|end| self.add_value(*end));
    }

    /// The range without fill values and hot samples, in a volume of this many samples; `None` if it is the whole one.
    pub(super) fn core(&self, voxels: u64) -> Option<Core> {
        let most_hot = HOT.max(voxels / HOT_PART);
        let (mut from, mut fill) = ([0; 2], [None; 2]);
        while let Some(next) = self.cut(from, most_hot) {
            for side in 0..2 {
                let cut = &self.ends[side][from[side]..next[side]];
                fill[side] = fill[side].or(fill_of(cut));
            }
            from = next;
        }
        let [low, high] = [0, 1].map(|side| self.ends[side].get(from[side]).map(|end| end.value));
        low.zip(high).filter(|_| from != [0; 2]).map(|(low, high)| Core { low, high, fill })
    }

    /// The first values of both ends that stay, if a fill value or hot samples lie far beyond these.
    fn cut(&self, from: [usize; 2], most_hot: u64) -> Option<[usize; 2]> {
        let range = |[i, j]: [usize; 2]| Some(self.ends[1].get(j)?.value - self.ends[0].get(i)?.value);
        let whole = range(from)?;
        let choices = (1..2 * HELD).flat_map(|n| (0..=n).map(move |i| [from[0] + i, from[1] + n - i]));
        choices.into_iter().find(|to| {
            let ratios = [0, 1].map(|side| self.least_ratio(side, from[side]..to[side], most_hot));
            let left = range(*to).filter(|left| *left > 0.0);
            matches!((left, ratios), (Some(left), [Some(a), Some(b)]) if whole / left >= a.max(b))
        })
    }

    /// The least ratio by which the range has to shrink without some values of an end; `None` for values that count.
    fn least_ratio(&self, side: usize, cut: Range<usize>, most_hot: u64) -> Option<f64> {
        let is_mixture = self.ends[side].len() == HELD;
        let cut = self.ends[side].get(cut)?;
        if cut.is_empty() {
            return Some(1.0);
        }
        if fill_of(cut).is_some() {
            return Some(FILL_RATIO);
        }
        let are_hot = is_mixture && cut.iter().map(|end| end.count).sum::<u64>() <= most_hot;
        are_hot.then_some(HOT_RATIO)
    }

    pub(super) fn words(&self) -> impl Iterator<Item = u64> {
        let [least, most] = &self.ends;
        let ends = least.iter().chain(most).flat_map(|end| [end.value.to_bits(), end.count]);
        std::iter::once(least.len() as u64).chain(ends)
    }

    /// Parses words of [`Self::words`]; `None` if they are invalid.
    pub(super) fn parse(words: &[u64]) -> Option<Self> {
        let (held, ends) = words.split_first()?;
        let (ends, []) = ends.as_chunks::<2>() else { return None };
        let ends: Vec<_> =
            ends.iter().map(|[value, count]| End { value: f64::from_bits(*value), count: *count }).collect();
        let (least, most) = ends.split_at_checked(usize::try_from(*held).ok()?)?;
        let is_sound = least.len() == most.len() && least.len() <= HELD;
        is_sound.then(|| Self { ends: [least.to_vec(), most.to_vec()] })
    }

    /// Most words of [`Self::words`].
    pub(super) const WORDS: usize = 1 + 4 * HELD;
}

/// The value of an end that is a fill value.
fn fill_of(cut: &[End]) -> Option<f64> {
    if let [only] = cut { Some(only.value).filter(|value| value.abs() >= FILL) } else { None }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(samples: &[f64]) -> Extremes {
        let mut all = Extremes::default();
        all.add(samples);
        let mut parts = Extremes::default();
        for part in samples.chunks(777) {
            let mut own = Extremes::default();
            own.add(part);
            let words: Vec<u64> = own.words().collect();
            assert!(words.len() <= Extremes::WORDS);
            parts.join(&Extremes::parse(&words).unwrap());
        }
        assert_eq!(all, parts);
        let mut sorted: Vec<f64> = samples.iter().copied().filter(|v| v.is_finite()).collect();
        sorted.sort_by(f64::total_cmp);
        assert_eq!(all.whole(), sorted.first().copied().zip(sorted.last().copied()));
        sorted.dedup();
        let values = |end: &[End]| end.iter().map(|end| end.value).collect::<Vec<_>>();
        assert_eq!(values(&all.ends[0]), sorted.iter().copied().take(HELD).collect::<Vec<_>>());
        assert_eq!(values(&all.ends[1]), sorted.iter().rev().copied().take(HELD).collect::<Vec<_>>());
        for end in all.ends.iter().flatten() {
            assert_eq!(end.count, samples.iter().filter(|v| **v == end.value).count() as u64);
        }
        all
    }

    #[test]
    fn fill_values_and_hot_samples_are_told_from_the_others() {
        let mut random = crate::random::Random(5);
        let others: Vec<f64> = (0..40_000).map(|_| random.below(3000) as f64 * 0.37 - 100.0).collect();
        let core = |more: &[f64], times: usize| {
            let more = more.iter().flat_map(|v| std::iter::repeat_n(*v, times));
            of(&others.iter().copied().chain(more).collect::<Vec<_>>()).core(40_000)
        };
        let (low, high) = of(&others).whole().unwrap();
        assert_eq!(of(&others).core(40_000), None);
        let filled = |fill: f64| if fill < 0.0 { [Some(fill), None] } else { [None, Some(fill)] };
        for fill in [f64::from(f32::MIN), -1e30, 3.4e38, -1e7, f64::from(i32::MIN)] {
            let due = Some(Core { low, high, fill: filled(fill) });
            assert_eq!(core(&[fill], 9000), due, "{fill}");
            assert_eq!(core(&[fill, f64::NAN, f64::INFINITY], 9000), due);
        }
        assert_eq!(core(&[-3e38, 3e38], 9000), Some(Core { low, high, fill: [Some(-3e38), Some(3e38)] }));
        for hot in [&[1e6][..], &[1e6, 1.1e6, -1e6], &[-4e5, -3e5]] {
            assert_eq!(core(hot, 1), Some(Core { low, high, fill: [None; 2] }), "{hot:?}");
        }
        assert_eq!(core(&[-3e38, 1e5, 9e5], 2), Some(Core { low, high, fill: filled(-3e38) }));
        // A metal of one value, and labels, are not hot.
        assert_eq!(core(&[1e6], 900), None);
        assert_eq!(of(&[0.0, 1.0, 100_000.0, 1.0, 0.0]).core(5), None);
        let labels = of(&[0.0, 1.0, 2.0, -2_147_483_648.0]).core(4);
        assert_eq!(labels, Some(Core { low: 0.0, high: 2.0, fill: filled(-2_147_483_648.0) }));
        assert_eq!(of(&[]).core(0), None);
        assert_eq!(of(&[7.0, 7.0]).core(2), None);
    }
}
