//! Counts of a pass over a volume that tell padding and maps of labels from a mixture of values.

use std::collections::BTreeSet;
use std::ops::Range;

use super::extremes::Core;
use super::range::Ordered;
use crate::geom::Dims;
use crate::volume::{ScalarType, Treatment, VolumeSource};

/// A value at an end of the range, and its number of samples.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct End {
    pub(super) value: f64,
    pub(super) count: u64,
}

impl End {
    /// Adds a sample, or several of one value; a value farther out replaces the current one.
    #[inline]
    pub(super) fn add(&mut self, other: End, is_farther: bool) {
        if is_farther {
            *self = other;
        } else if other.value == self.value {
            self.count += other.count;
        }
    }
}

/// Counts of a pass that tell padding and labels from a mixture. Counting stops for a case that has become impossible.
#[derive(Clone, Debug, Default)]
pub(super) struct Evidence {
    /// Set while the samples may still be labels, and while they may still hold padding.
    pub(super) may_be_map: bool,
    pub(super) may_be_padded: bool,
    /// True if samples were taken for 0, as they are outside whatever they are.
    pub(super) has_blanks: bool,
    /// Parts with counted neighbours.
    pub(super) parts: u64,
    /// Samples outside the ellipse inscribed in a slice: in the whole volume, and seen so far, with the ends of their
    /// range.
    pub(super) all_outside: u64,
    pub(super) outside: u64,
    pub(super) least: End,
    pub(super) most: End,
    /// The smallest value above 0.
    pub(super) first: f64,
    /// Neighbours with the same value other than 0, and neighbours with different values.
    pub(super) alike: u64,
    pub(super) differ: u64,
    /// Neighbours that differ, one of them 0 and the other not the smallest value next to a 0.
    pub(super) jumps: u64,
    pub(super) nearest: End,
    /// Samples at the ends of the volume's rows, and those among them that are 0.
    pub(super) rim: u64,
    pub(super) rim_zeros: u64,
    /// Number of pairs seen, and number of those with an equal sample next to either: not stored, as slices are read
    /// again.
    pub(super) steps: u64,
    pub(super) wide: u64,
    /// Pairs of neighbouring values, in order.
    pub(super) pairs: Vec<Pair>,
    /// Set if there are more pairs than [`MAX_PAIRS`].
    pub(super) is_crowded: bool,
}

/// Words of the evidence in a file, without its pairs.
pub(super) const EVIDENCE_WORDS: usize = 16;

/// Two values that are neighbours in a row, the lower one first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Pair {
    pub(super) values: [u64; 2],
    /// Occurrences among the first [`PAIRS_OF_PART`] of each part; and those with an equal sample next to either.
    pub(super) count: u64,
    pub(super) clean: u64,
    /// Single samples of one value between two of the other.
    pub(super) spikes: u64,
    /// Runs of the lower value between the higher one and a value below it, and their total of samples.
    pub(super) passes: u64,
    pub(super) length: u64,
}

impl Pair {
    pub(super) fn words(&self) -> [u64; 7] {
        [self.values[0], self.values[1], self.count, self.clean, self.spikes, self.passes, self.length]
    }

    pub(super) fn parse([low, high, count, clean, spikes, passes, length]: [u64; 7]) -> Self {
        Self { values: [low, high], count, clean, spikes, passes, length }
    }
}

/// Most pairs of values that are told apart, and most places of a part that are tested.
pub(super) const MAX_PAIRS: usize = 1024;
const PAIRS_OF_PART: usize = 2048;

/// Least share of padding among the outside samples, and greatest share among the inside ones.
const OUTSIDE: f64 = 0.95;
const WITHIN: f64 = 0.1;
/// Least distance of padding from all other values, as a part of the whole range. Closer padding does no harm.
const APART: f64 = 0.15;
/// One in this many samples at either end of the others is ignored.
const STRAY: u64 = 1000;
/// Least number of values of a mixture.
const FEW: usize = 16;
/// Shortest side of a slice that has a circle.
const ROUND: u32 = 16;

/// Most labels of a map.
pub(super) const MAX_LABELS: usize = 1024;
/// Least share of equal pairs among neighbours outside 0 in a map of labels; and least share, among neighbours that
/// differ, of jumps to 0 from a value that is not the nearest to it. A picture in few greys has regions as wide, but in
/// sequence.
const FLAT: f64 = 0.6;
const JUMPS: f64 = 0.2;
/// Least flat share of maps of small islands in 0, and greatest share of their differences between other values; and
/// the greatest ratio of these to jumps where jumps are few, as at a core within a thin shell.
const ISLAND_FLAT: f64 = 0.25;
const TOUCHING: f64 = 0.05;
const APART_TOUCHING: f64 = 0.1;
/// Least flat share of maps whose labels are nested in any order, and least share of the differences that skip
/// intermediate values with more than a sample on either side: a picture's edges pass through these greys.
const NESTED_FLAT: f64 = 0.5;
const SKIPS: f64 = 0.1;
/// Limits for labels nested in order: greatest share of skips; least flat share where the steps between the values are
/// even, as in greys; least share of 0 at the ends of rows; and most labels.
const NO_SKIPS: f64 = 0.05;
const EVEN_FLAT: f64 = 0.73;
const RIM: f64 = 0.6;
const ORDERED: usize = 16;
/// Least share of a map's differences that have a flat side before and behind.
const HARD: f64 = 0.2;
/// Greatest value of a display's greys in even steps.
const DISPLAY: u64 = 250;
/// Greatest share of the differences next to single samples unlike both neighbours, as in noise, where little is flat;
/// greatest share of two values that meet in this way alone.
const SPIKES: f64 = 0.25;
/// Share of spikes up to which few values that are not flat may be thin labels.
const FEW_SPIKES: f64 = 0.02;
const ROUGH_FLAT: f64 = 0.75;
const ALL_SPIKES: f64 = 0.8;
const NOISE: f64 = 0.05;

/// Least number of values of a ramp of greys; greatest share of its differences that are at 0; and greatest ratio of a
/// band's width to the next one's.
const RAMP: usize = 8;
const AT_ZERO: f64 = 0.4;
const SMOOTH: f64 = 1.75;

/// Kind of a volume with few integers in flat regions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Levels {
    /// Number of labels besides 0.
    Labels(usize),
    /// Number of greys.
    Greys(usize),
}

/// True if no step between values in order is twice as large as another.
fn is_even(values: &[u64]) -> bool {
    let steps = || values.windows(2).map(|w| w[1] - w[0]);
    steps().max().unwrap_or(0) < 2 * steps().min().unwrap_or(0)
}

/// True if the samples of a source may be labels. A picture taken by a device holds none, however few its greys are,
/// and partial volumes are not labels.
pub(super) fn may_be_map(source: &dyn VolumeSource) -> bool {
    let is_fractional = source.info().description.kind.is_fractional();
    let is_averaged = |treatment: &Treatment| matches!(treatment, Treatment::Downsample(_));
    let is_mixed = is_fractional || source.info().description.treatments.iter().any(is_averaged);
    !is_mixed && source.modality().is_none_or(|modality| modality == "SEG")
}

/// True if all samples are whole numbers of at least 0.
pub(super) fn are_whole<T: Ordered>(samples: &[T]) -> bool {
    match T::TYPE {
        ScalarType::U8 | ScalarType::U16 | ScalarType::U32 => true,
        ScalarType::I8 | ScalarType::I16 | ScalarType::I32 => {
            samples.iter().fold(true, |all, sample| all & (*sample >= T::zeroed()))
        }
        ScalarType::F32 | ScalarType::F64 => samples.iter().all(|sample| {
            let v = sample.to_f64();
            v >= 0.0 && v.trunc() == v
        }),
    }
}

/// Number of columns at either end of a line outside the ellipse of a slice, one less for safety.
pub(super) fn columns_outside(dims: Dims, y: u32) -> u32 {
    let down = (f64::from(y) + 0.5) / f64::from(dims.ny()) - 0.5;
    let across = f64::from(dims.nx()) * (0.5 - (0.25 - down * down).max(0.0).sqrt());
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "below a side")]
    let ends = (across as u32).saturating_sub(1);
    ends
}

/// Number of a volume's samples outside the ellipse; 0 if its slices are too narrow.
pub(super) fn outside_samples(dims: Dims) -> u64 {
    if dims.nx().min(dims.ny()) < ROUND {
        return 0;
    }
    let line = |y| u64::from(2 * columns_outside(dims, y)).min(dims.nx().into());
    (0..dims.ny()).map(line).sum::<u64>() * u64::from(dims.nz())
}

impl Evidence {
    pub(super) fn new(may_be_map: bool, all_outside: u64) -> Self {
        let [least, most] = [f64::INFINITY, f64::NEG_INFINITY].map(|value| End { value, count: 0 });
        Self {
            may_be_map,
            may_be_padded: all_outside > 0,
            all_outside,
            least,
            most,
            first: f64::INFINITY,
            nearest: least,
            ..Self::default()
        }
    }

    pub(super) fn join(&mut self, other: &Self) {
        self.may_be_map &= other.may_be_map;
        self.may_be_padded &= other.may_be_padded;
        self.has_blanks |= other.has_blanks;
        self.outside += other.outside;
        self.least.add(other.least, other.least.value < self.least.value);
        self.most.add(other.most, other.most.value > self.most.value);
        self.first = self.first.min(other.first);
        self.alike += other.alike;
        self.differ += other.differ;
        self.jumps += other.jumps;
        self.nearest.add(other.nearest, other.nearest.value < self.nearest.value);
        self.rim += other.rim;
        self.rim_zeros += other.rim_zeros;
        self.steps += other.steps;
        self.wide += other.wide;
        self.is_crowded |= other.is_crowded;
        other.pairs.iter().for_each(|pair| self.add_pair(*pair));
    }

    /// Adds a pair, or more places of one; pairs are dropped once they are crowded.
    pub(super) fn add_pair(&mut self, pair: Pair) {
        match self.pairs.binary_search_by_key(&pair.values, |pair| pair.values) {
            Ok(at) => {
                self.pairs[at].count += pair.count;
                self.pairs[at].clean += pair.clean;
                self.pairs[at].spikes += pair.spikes;
                self.pairs[at].passes += pair.passes;
                self.pairs[at].length += pair.length;
            }
            Err(_) if self.pairs.len() == MAX_PAIRS => self.is_crowded = true,
            Err(at) => self.pairs.insert(at, pair),
        }
        if self.is_crowded {
            self.pairs.clear();
        }
    }

    pub(super) fn words(&self) -> [u64; EVIDENCE_WORDS] {
        let Self { least, most, nearest, .. } = *self;
        let [least_count, most_count, nearest_count] = [least, most, nearest].map(|end| end.count);
        let [least, most, nearest] = [least, most, nearest].map(|end| end.value.to_bits());
        let ends = [least, least_count, most, most_count, nearest, nearest_count];
        let may_be = [self.may_be_map, self.may_be_padded, self.has_blanks].map(u64::from);
        let counts = [self.outside, self.first.to_bits(), self.alike, self.differ, self.jumps];
        let counts = counts.into_iter().chain([self.rim, self.rim_zeros]);
        let mut words = [0; EVIDENCE_WORDS];
        words.iter_mut().zip(may_be.into_iter().chain(ends).chain(counts)).for_each(|(word, of)| *word = of);
        words
    }

    pub(super) fn parse(words: &[u64; EVIDENCE_WORDS]) -> Self {
        let [map, padded, blanks, rest @ ..] = *words;
        let [least, least_count, most, most_count, nearest, nearest_count, counts @ ..] = rest;
        let [outside, first, alike, differ, jumps, rim, rim_zeros] = counts;
        let end = |value, count| End { value: f64::from_bits(value), count };
        Self {
            may_be_map: map != 0,
            may_be_padded: padded != 0,
            has_blanks: blanks != 0,
            outside,
            least: end(least, least_count),
            most: end(most, most_count),
            nearest: end(nearest, nearest_count),
            first: f64::from_bits(first),
            alike,
            differ,
            jumps,
            rim,
            rim_zeros,
            ..Self::new(true, 0)
        }
    }

    /// Puts 0 in place of samples that are outside whatever they are: NaN, -inf, and what lies beyond the core.
    pub(super) fn blank<T: Ordered>(&mut self, samples: &mut [T], core: Option<Core>) {
        if !self.may_be_map || T::NO_NUMBER.is_none() && core.is_none() {
            return;
        }
        let [low, high] = core.map_or([f64::NEG_INFINITY, f64::INFINITY], |core| [core.low, core.high]);
        for sample in samples {
            let v = sample.to_f64();
            if !(v >= low && v <= high) || v == f64::NEG_INFINITY {
                *sample = T::zeroed();
                self.has_blanks = true;
            }
        }
    }

    /// Counts neighbours along rows, or down a part of one column. `counted` holds the counts before, which have few
    /// values in a map.
    pub(super) fn add_edges<T: Ordered>(&mut self, part: &SampleSpan, samples: &[T], counted: &[u32]) {
        let Some(first) = samples.first().filter(|_| self.may_be_map) else { return };
        self.parts += 1;
        if self.parts.is_power_of_two() {
            self.may_be_map = counted.iter().filter(|n| **n > 0).count() <= MAX_LABELS + 1;
        }
        self.may_be_map &= are_whole(samples);
        if !self.may_be_map {
            return;
        }
        self.alike += u64::from(*first != T::zeroed());
        let width = if part.columns.len() > 1 { part.columns.len() } else { samples.len() };
        samples.chunks(width).for_each(|row| self.add_row_edges(row));
    }

    fn add_row_edges<T: Ordered>(&mut self, samples: &[T]) {
        let zero = T::zeroed();
        let neighbours = || samples.iter().zip(&samples[1..]);
        let is_jump = |a: &T, b: &T| (a != b) & ((*a == zero) | (*b == zero));
        // Sums of bits, without branches; a row has fewer samples than 2^32.
        let differ = neighbours().map(|(a, b)| u32::from(a != b)).sum::<u32>();
        let alike = neighbours().map(|(a, b)| u32::from((a == b) & (*a != zero))).sum::<u32>();
        let jumps = neighbours().map(|(a, b)| u32::from(is_jump(a, b))).sum::<u32>();
        self.alike += u64::from(alike);
        self.differ += u64::from(differ);
        self.jumps += u64::from(jumps);
        let above = samples.iter().filter(|sample| **sample > zero);
        let smallest = above.fold(None, |low: Option<&T>, s| low.filter(|low| *low <= s).or(Some(s)));
        self.first = smallest.map_or(self.first, |smallest| self.first.min(smallest.to_f64()));
        if jumps > 0 {
            for (a, b) in neighbours().filter(|(a, b)| is_jump(a, b)) {
                // Both values are at least 0.
                let other = a.to_f64().max(b.to_f64());
                self.nearest.add(End { value: other, count: 1 }, other < self.nearest.value);
            }
        }
    }

    /// Counts the pairs of values in the rows of a part, and the ends of the volume's rows.
    pub(super) fn add_rows<T: Ordered>(&mut self, dims: Dims, part: &SampleSpan, samples: &[T]) {
        let (Range { start, end }, mut left) = (part.columns.clone(), PAIRS_OF_PART);
        if !self.may_be_map {
            return;
        }
        for row in samples.chunks(part.columns.len().max(1)) {
            let first = row.first().filter(|_| start == 0);
            for sample in first.into_iter().chain(row.last().filter(|_| end == dims.nx())) {
                self.rim += 1;
                self.rim_zeros += u64::from(*sample == T::zeroed());
            }
            self.add_pairs(row, &mut left);
        }
    }

    /// Counts the pairs in a row of whole numbers, at most `left`.
    pub(super) fn add_pairs<T: Ordered>(&mut self, row: &[T], left: &mut usize) {
        let mut last = None;
        for (at, w) in row.windows(2).enumerate().filter(|(_, w)| w[0] != w[1]).take(*left) {
            let before = at.checked_sub(1).map(|at| row[at]);
            let is_wide = before == Some(w[0]) && row.get(at + 2) == Some(&w[1]);
            #[expect(clippy::cast_possible_truncation, reason = "whole, and not below 0")]
            let [a, b] = [w[0], w[1]].map(|sample| sample.to_f64() as u64);
            let passed = last.filter(|(_, from)| (a > *from) == (b > a));
            let passed = passed.map(|(since, from)| ([a, b.max(from)], at - since));
            last = Some((at, a));
            let (clean, spikes) = (u64::from(is_wide), u64::from(before == Some(w[1])));
            self.steps += 1;
            self.wide += clean;
            if !self.is_crowded {
                let none = Pair::parse([0; 7]);
                self.add_pair(Pair { values: [a.min(b), a.max(b)], count: 1, clean, spikes, ..none });
                if let Some((values, length)) = passed {
                    self.add_pair(Pair { values, passes: 1, length: length as u64, ..none });
                }
            }
            *left -= 1;
        }
    }

    /// Counts the samples of a part that lie outside the ellipse.
    pub(super) fn add_outside<T: Ordered>(&mut self, dims: Dims, part: &SampleSpan, samples: &[T]) {
        if !self.may_be_padded {
            return;
        }
        let nx = dims.nx();
        for (row, y) in samples.chunks(part.columns.len().max(1)).zip(part.lines.clone()) {
            let ends = columns_outside(dims, y);
            let Range { start, end } = part.columns;
            // Columns of this part before the low end, and those from the high end on.
            let low = ends.clamp(start, end) - start;
            let high = (nx - ends).clamp(start + low, end) - start;
            for samples in [row.get(..low as usize), row.get(high as usize..)].into_iter().flatten() {
                self.add_run(samples);
            }
        }
        // Padding is ruled out if too many samples differ from either end of the range.
        let most = self.all_outside as f64 * (1.0 - OUTSIDE);
        let others = |end: &End| (self.outside - end.count) as f64;
        self.may_be_padded = others(&self.least).min(others(&self.most)) <= most + 1.0;
    }

    /// Counts a run of samples outside the ellipse.
    pub(super) fn add_run<T: Ordered>(&mut self, samples: &[T]) {
        let Some(first) = samples.first() else { return };
        self.outside += samples.len() as u64;
        let of = |value: T| samples.iter().map(|sample| u64::from(*sample == value)).sum::<u64>();
        // NaN is neither end.
        let is_number = |value: T| T::NO_NUMBER.is_none() || !value.to_f64().is_nan();
        let (mut low, mut high) = (*first, *first);
        for sample in samples {
            low = if *sample < low || !is_number(low) { *sample } else { low };
            high = if *sample > high || !is_number(high) { *sample } else { high };
        }
        let least = End { value: low.to_f64(), count: of(low) };
        let most = End { value: high.to_f64(), count: if low == high { least.count } else { of(high) } };
        self.least.add(least, least.value < self.least.value);
        self.most.add(most, most.value > self.most.value);
    }

    /// The number of labels, or of greys that would be labels but for their even steps; `None` for a mixture. `values`
    /// is the number of different samples.
    pub(super) fn labels(&self, values: usize) -> Option<Levels> {
        // Any threshold between two values tells them apart.
        if !self.may_be_map || !(3..=MAX_LABELS + 1).contains(&values) {
            return None;
        }
        let flat = part(self.alike, self.alike + self.differ);
        let all = self.pairs.iter().map(|pair| pair.count).sum();
        let is_rough = self.spikes() > SPIKES && flat < ROUGH_FLAT;
        // Differences of labels other than the one nearest to 0, and differences among labels.
        let (far, touching) = (self.jumps - self.nearest.count, self.differ - self.jumps);
        let jump = part(far, self.differ) >= JUMPS;
        let are_apart = far > 0 && part(touching, far) <= APART_TOUCHING;
        let are_islands =
            flat >= ISLAND_FLAT && (jump || are_apart) && part(touching, self.differ) <= TOUCHING;
        let is_map = are_islands || !is_rough && (flat >= FLAT && jump || self.are_nested(flat, all));
        let levels = if self.is_ramp(all) { Levels::Greys(values) } else { Levels::Labels(values - 1) };
        is_map.then_some(levels)
    }

    /// True for few values that are flat or without noise, below 0 or not whole: they may be labels all the same.
    pub(super) fn may_be_labels(&self, values: usize) -> bool {
        let is_flat = part(self.alike, self.alike + self.differ) >= FLAT;
        (3..=ORDERED + 1).contains(&values) && (is_flat || !self.may_be_map || self.spikes() <= FEW_SPIKES)
    }

    /// Share of the differences next to single samples unlike both neighbours.
    fn spikes(&self) -> f64 {
        let sum = |of: fn(&Pair) -> u64| self.pairs.iter().map(of).sum();
        part(sum(|pair| pair.spikes), sum(|pair| pair.count))
    }

    /// True for a ramp of greys: values in even steps that follow each other in order, with hardly any but the first
    /// next to 0, in bands whose widths change little from one to the next. Few greys cannot be told from nested
    /// labels.
    fn is_ramp(&self, all: u64) -> bool {
        let values: Vec<u64> = self.values().into_iter().collect();
        let place = |value: &u64| values.partition_point(|other| other < value);
        let (mut at_zero, mut skips) = (0, 0);
        let mut bands = vec![(0, 0); values.len()];
        for Pair { values: [low, high], count, passes, length, .. } in &self.pairs {
            at_zero += if *low == 0 { *count } else { 0 };
            skips += if *low > 0 && place(high) > place(low) + 1 { *count } else { 0 };
            let (passed, samples) = &mut bands[place(low)];
            (*passed, *samples) = (*passed + passes, *samples + length);
        }
        bands.retain(|(passes, _)| *passes > 0);
        let width = |(passes, length): (u64, u64)| part(length, passes);
        // The body may end within the first band and the last.
        let inner = bands.get(1..bands.len().saturating_sub(1)).unwrap_or_default();
        let mut changes = inner.windows(2).map(|w| width(w[0]) / width(w[1]));
        values.len() >= RAMP
            && is_even(&values)
            && part(at_zero, all) <= AT_ZERO
            && part(skips, all - at_zero) <= NO_SKIPS
            && inner.len() > 1
            && changes.all(|change| (1.0 / SMOOTH..=SMOOTH).contains(&change))
    }

    /// True if values change where either side is flat, as labels do, and not through intermediate values, as at the
    /// edges of a soft mask.
    pub(super) fn is_hard(&self) -> bool {
        part(self.wide, self.steps) >= HARD
    }

    /// True if the values are nested as labels are, in any order or in the order of their numbers.
    pub(super) fn are_nested(&self, flat: f64, all: u64) -> bool {
        let values: Vec<u64> = self.values().into_iter().collect();
        let rank = |value: &u64| values.partition_point(|other| other < value);
        let [mut skips, mut clean, mut noise] = [0; 3];
        for Pair { values: [low, high], count, clean: wide, spikes, .. } in &self.pairs {
            if rank(high) > rank(low) + 1 {
                skips += count;
                clean += wide;
            }
            noise += if part(2 * spikes, *count) > ALL_SPIKES { *count } else { 0 };
        }
        let is_even = is_even(&values);
        let is_display = is_even && matches!(values[..], [.., a, b] if b - a > 1 && 2 * b - a >= DISPLAY);
        let is_ordered = part(skips, all) <= NO_SKIPS
            && flat >= if is_even { EVEN_FLAT } else { FLAT }
            && values.len() <= ORDERED + 1
            && part(self.rim_zeros, self.rim) >= RIM
            && !(is_display && values.len() > 3);
        let is_unordered = part(clean, all) >= SKIPS && flat >= NESTED_FLAT;
        part(noise, all) <= NOISE && (is_unordered || is_ordered)
    }

    /// The values of the pairs.
    pub(super) fn values(&self) -> BTreeSet<u64> {
        self.pairs.iter().flat_map(|pair| pair.values).collect()
    }

    /// The bin of a value that pads the outside of the circle.
    pub(super) fn padding(&self, counts: &[u64], value: &dyn Fn(usize) -> f64) -> Option<usize> {
        let total: u64 = counts.iter().sum();
        let first = counts.iter().position(|n| *n > 0)?;
        let last = counts.iter().rposition(|n| *n > 0)?;
        if !self.may_be_padded || counts.iter().filter(|n| **n > 0).count() <= FEW {
            return None;
        }
        [(first, self.least), (last, self.most)].into_iter().find_map(|(bin, end)| {
            let is_outside = (value(bin) - end.value).abs() <= (value(1) - value(0)).abs()
                && part(end.count, self.outside) >= OUTSIDE
                && part(counts[bin].saturating_sub(end.count), total - self.outside) <= WITHIN;
            let stray = (total - counts[bin]) / STRAY;
            let reached = |bins: &mut dyn Iterator<Item = usize>| {
                let mut seen = 0;
                bins.filter(|at| *at != bin).find(|at| {
                    seen += counts[*at];
                    seen > stray
                })
            };
            let (low, high) = (reached(&mut (first..=last))?, reached(&mut (first..=last).rev())?);
            let (near, far) = if bin == first { (low, high) } else { (high, low) };
            let is_apart = near.abs_diff(bin) as f64 >= APART * far.abs_diff(bin) as f64;
            (is_outside && is_apart).then_some(bin)
        })
    }
}

/// Hounsfield units below the range of a CT, and the range of air; least share of padding among all samples, and least
/// share of air among the others.
const BELOW_AIR: f64 = -1100.0;
const AIR: Range<f64> = BELOW_AIR..-850.0;
const PADS: f64 = 0.01;
const HAS_AIR: f64 = 0.1;

/// The bin of a value below the range of a CT, in a volume that also holds air: it pads the unscanned region, wherever
/// that is. A body that was cut out of its picture has no air around it. `hu` is the physical value.
pub(super) fn below_air(
    counts: &[u64],
    hu: &dyn Fn(usize) -> f64,
    source: &dyn VolumeSource,
) -> Option<usize> {
    let first = counts.iter().position(|n| *n > 0)?;
    let padding = hu(first);
    if padding >= BELOW_AIR || source.modality().is_some_and(|modality| modality != "CT") {
        return None;
    }
    let all: u64 = counts.iter().sum();
    let others = all - counts[first];
    let within = |range: Range<f64>| {
        let bins = counts.iter().enumerate().skip(first + 1).filter(|(bin, _)| range.contains(&hu(*bin)));
        bins.map(|(_, n)| n).sum::<u64>()
    };
    let is_apart = within(padding..f64::midpoint(padding, AIR.end)) <= others / STRAY;
    let pads = part(counts[first], all) >= PADS && part(within(AIR), others) >= HAS_AIR;
    (is_apart && pads).then_some(first)
}

/// Ratio of two numbers.
pub(super) fn part(of: u64, all: u64) -> f64 {
    of as f64 / (all.max(1) as f64)
}

/// Position of the samples that a worker is given.
pub(super) struct SampleSpan {
    pub(super) columns: Range<u32>,
    pub(super) lines: Range<u32>,
}
