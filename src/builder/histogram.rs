//! Value statistics in streamed passes: extremes, and Otsu's threshold from an exact histogram.
//!
//! Otsu's method takes values for a mixture of two kinds. Two sorts of volumes differ from that: those that a scanner has
//! padded outside the circle that it reconstructs, and maps of labels. Counts of the same pass recognise them
//! ([`Evidence`]).

use std::ops::Range;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

use super::error::BuildError;
use super::parallel::{Blocks, Share, run_workers};
use super::range::Ordered;
use crate::budget::costs::{MAPPED_FROM, MIN_WORKER};
use crate::geom::Dims;
use crate::progress::Progress;
use crate::volume::{ScalarType, VolumeInfo, VolumeSource};

/// Bins of a histogram: one for every value of the 16-bit types.
pub(super) const BINS: usize = 1 << 16;
/// Bytes that a worker reads at a time, and that its counts take.
const READ_BYTES: usize = 256 << 10;
/// Bytes that a worker reads at a time when it looks for extremes. Below the size from which the C library's
/// allocator maps a buffer of its own: freeing a mapped one raises that size, and the larger buffers of the
/// counting pass would then stay resident after it, at the expense of the scan.
const EXTREMES_READ_BYTES: usize = 64 << 10;
const _: () = assert!(EXTREMES_READ_BYTES < MAPPED_FROM);
/// Memory of one worker, and of the shared sum.
pub(super) const WORKER_BYTES: u64 = (READ_BYTES + 4 * BINS) as u64;
pub(super) const SHARED_BYTES: u64 = 8 * BINS as u64;
// The smallest plan is enough for a threshold that is still to be found, too.
const _: () = assert!(SHARED_BYTES + WORKER_BYTES <= MIN_WORKER);

/// Smallest and largest sample of a share of the volume that is a finite number, or `None` if there is none.
pub(super) fn extremes(
    source: &dyn VolumeSource,
    share: Share,
    threads: usize,
    progress: &dyn Progress,
) -> Result<Option<(f64, f64)>, BuildError> {
    let total = Mutex::new((f64::INFINITY, f64::NEG_INFINITY));
    let widen = by_type!(source.info().scalar, T => widen::<T> as fn(&mut (f64, f64), &[u8]));
    for_each_part(
        source,
        share,
        (threads, EXTREMES_READ_BYTES),
        progress,
        &|| (f64::INFINITY, f64::NEG_INFINITY),
        &|seen, _, samples| widen(seen, samples),
        &|seen| {
            let mut t = total.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
            *t = (t.0.min(seen.0), t.1.max(seen.1));
        },
    )?;
    let (min, max) = total.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner);
    Ok((min <= max).then_some((min, max)))
}

/// Widens extremes by the samples that are finite numbers.
fn widen<T: Ordered>(seen: &mut (f64, f64), samples: &[u8]) {
    for sample in bytemuck::cast_slice::<u8, T>(samples) {
        let v = sample.to_f64();
        if v.is_finite() {
            *seen = (seen.0.min(v), seen.1.max(v));
        }
    }
}

/// What a histogram says of a volume.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Split {
    /// Otsu's threshold in sample units: the sample value `t` that maximises the variance between the classes `< t` and
    /// `>= t`, padding left out.
    pub(super) at: f64,
    /// What the volume is, if it is not a mixture of two kinds of values.
    pub(super) kind: Kind,
}

/// Of what kind the values are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Kind {
    /// A mixture.
    Values,
    /// One besides a value that is outside the circle.
    Padded {
        /// The padding.
        value: f64,
    },
    /// Labels, 0 for none.
    Labels {
        /// How many there are.
        count: usize,
        /// The smallest of them.
        first: f64,
    },
}

/// Are the extremes of the samples needed before they can be counted? Types of 8 and 16 bits are counted exactly.
pub(super) fn needs_extremes(scalar: ScalarType) -> bool {
    scalar.bytes() > 2
}

/// Where the bins of a histogram lie, in samples.
#[derive(Clone, Copy)]
pub(super) enum Bins {
    /// From `low` on, each `width` wide.
    From { low: f64, width: f64 },
    /// Values so close that no bin can tell them apart: the largest is the upper class.
    TooClose { max: f64 },
    /// All values are alike, or none is a number.
    Alike,
}

impl Bins {
    /// The bins for samples of a type with these extremes, which wide types need.
    pub(super) fn new(scalar: ScalarType, extremes: Option<(f64, f64)>) -> Self {
        let exact = |low: f64| Self::From { low, width: 1.0 };
        match (scalar, extremes) {
            (ScalarType::U8 | ScalarType::U16, _) => exact(0.0),
            (ScalarType::I8, _) => exact(-128.0),
            (ScalarType::I16, _) => exact(-32768.0),
            (_, Some((min, max))) if max > min => {
                let width = max / (BINS - 1) as f64 - min / (BINS - 1) as f64;
                if width.is_normal() { Self::From { low: min, width } } else { Self::TooClose { max } }
            }
            _ => Self::Alike,
        }
    }
}

/// Otsu's threshold, with what is known of the volume; `None` when all values are alike (or none is a number).
///
/// Types of 8 and 16 bits are counted exactly in one pass; wider ones need their extremes first, and
/// then 65,536 bins between them. Source: Otsu 1979, *A threshold selection method from gray-level
/// histograms*.
pub(super) fn otsu(
    source: &dyn VolumeSource,
    threads: usize,
    progress: &dyn Progress,
) -> Result<Option<Split>, BuildError> {
    let scalar = source.info().scalar;
    let seen = match needs_extremes(scalar) {
        true => extremes(source, Share::ALL, threads, progress)?,
        false => None,
    };
    let bins = Bins::new(scalar, seen);
    Ok(Tally::take(source, Share::ALL, bins, threads, progress)?.split(bins))
}

/// The samples of a share of a volume, counted. Tallies of all shares add up to that of the whole, whatever the shares.
#[derive(Debug)]
pub(crate) struct Tally {
    counts: Vec<u64>,
    evidence: Evidence,
}

impl Tally {
    /// Counts the samples of a share; none, if there are no bins.
    pub(super) fn take(
        source: &dyn VolumeSource,
        share: Share,
        bins: Bins,
        threads: usize,
        progress: &dyn Progress,
    ) -> Result<Self, BuildError> {
        let Bins::From { low, width } = bins else { return Ok(Self::default()) };
        let counts: Vec<AtomicU64> = (0..BINS).map(|_| AtomicU64::new(0)).collect();
        let spill = |local: &mut [u32]| {
            for (sum, n) in counts.iter().zip(local).filter(|(_, n)| **n > 0) {
                sum.fetch_add(u64::from(std::mem::take(n)), Ordering::Relaxed);
            }
        };
        let VolumeInfo { dims, scalar, .. } = *source.info();
        let count = by_type!(scalar, T => count::<T> as fn(&mut Counter, &Part, &[u8]));
        // A picture that a device has taken holds no labels, however few its greys are.
        let may_be_map = source.modality().is_none_or(|modality| modality == "SEG");
        let start = Evidence::new(may_be_map, outside_samples(dims));
        let evidence = Mutex::new(start);
        for_each_part(
            source,
            share,
            (threads, READ_BYTES),
            progress,
            &|| Counter { counts: vec![0; BINS], low, width, dims, evidence: start, seen: 0 },
            &|counter, part, samples| {
                counter.seen += (samples.len() / scalar.bytes()) as u64;
                if counter.seen > u64::from(u32::MAX) {
                    spill(&mut counter.counts);
                    counter.seen = (samples.len() / scalar.bytes()) as u64;
                }
                count(counter, part, samples);
            },
            &|mut counter| {
                spill(&mut counter.counts);
                evidence.lock().unwrap_or_else(std::sync::PoisonError::into_inner).join(&counter.evidence);
            },
        )?;
        Ok(Self {
            counts: counts.into_iter().map(AtomicU64::into_inner).collect(),
            evidence: evidence.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner),
        })
    }

    /// Adds what was counted of another share.
    pub(super) fn join(&mut self, other: &Self) {
        self.counts.iter_mut().zip(&other.counts).for_each(|(sum, n)| *sum += n);
        self.evidence.join(&other.evidence);
    }

    /// The least and the greatest value that was counted.
    pub(super) fn ends(&self, bins: Bins) -> Option<(f64, f64)> {
        let Bins::From { low, width } = bins else { return None };
        let at = |bin: usize| low + bin as f64 * width;
        let is_there = |n: &u64| *n > 0;
        Some((at(self.counts.iter().position(is_there)?), at(self.counts.iter().rposition(is_there)?)))
    }

    /// The threshold of all that was counted in these bins.
    pub(super) fn split(mut self, bins: Bins) -> Option<Split> {
        let (low, width) = match bins {
            Bins::From { low, width } => (low, width),
            Bins::TooClose { max } => return Some(Split { at: max, kind: Kind::Values }),
            Bins::Alike => return None,
        };
        let value = |bin: usize| low + bin as f64 * width;
        let mut kind = Kind::Values;
        if let Some(count) = self.evidence.labels(&self.counts) {
            kind = Kind::Labels { count, first: self.evidence.first };
        } else if let Some(bin) = self.evidence.padding(&self.counts, &value) {
            kind = Kind::Padded { value: value(bin) };
            self.counts[bin] = 0;
        }
        best_split(&self.counts).map(|bin| Split { at: value(bin), kind })
    }

    /// As words for a file: the evidence, then bin and count of every bin that is not empty.
    pub(crate) fn words(&self) -> impl Iterator<Item = u64> {
        let counted = (0_u64..).zip(&self.counts).filter(|(_, n)| **n > 0).flat_map(|(bin, n)| [bin, *n]);
        self.evidence.words().into_iter().chain(counted)
    }

    /// The tally of such words, if they are one.
    pub(crate) fn parse(words: &mut dyn Iterator<Item = u64>) -> Option<Self> {
        let mut evidence = [0; 13];
        for word in &mut evidence {
            *word = words.next()?;
        }
        let mut tally = Self { evidence: Evidence::parse(&evidence), ..Self::default() };
        while let Some(bin) = words.next() {
            *tally.counts.get_mut(usize::try_from(bin).ok()?)? = words.next()?;
        }
        Some(tally)
    }
}

impl Default for Tally {
    fn default() -> Self {
        Self { counts: vec![0; BINS], evidence: Evidence::new(true, 1) }
    }
}

/// One worker's counts.
struct Counter {
    counts: Vec<u32>,
    low: f64,
    width: f64,
    dims: Dims,
    evidence: Evidence,
    /// Samples counted since the counts were last added to the sum.
    seen: u64,
}

/// Counts the samples of a part.
fn count<T: Ordered>(counter: &mut Counter, part: &Part, samples: &[u8]) {
    let samples: &[T] = bytemuck::cast_slice(samples);
    let Counter { counts, low, width, dims, evidence, .. } = counter;
    evidence.add_edges(samples, counts);
    evidence.add_outside(*dims, part, samples);
    let (low, width) = (*low, *width);
    let counts: &mut [u32] = counts;
    for sample in samples {
        let v = sample.to_f64();
        if v.is_finite() {
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped below")]
            let bin = (v / width - low / width) as usize;
            counts[bin.min(BINS - 1)] += 1;
        }
    }
}

/// A value at an end of the range, and how often it is there.
#[derive(Clone, Copy, Debug)]
struct End {
    value: f64,
    count: u64,
}

impl End {
    /// Another sample, or several of one value: what lies farther out takes its place.
    #[inline]
    fn add(&mut self, other: End, is_farther: bool) {
        if is_farther {
            *self = other;
        } else if other.value == self.value {
            self.count += other.count;
        }
    }
}

/// Counts of a pass that tell paddings and labels from a mixture. What has become impossible is not counted any more.
#[derive(Clone, Copy, Debug)]
struct Evidence {
    /// May there still be labels, and padding?
    may_be_map: bool,
    may_be_padded: bool,
    /// Parts whose neighbours were counted.
    parts: u64,
    /// Samples outside the circle, or ellipse, that a slice has room for, in the whole volume; those seen so far, and the
    /// ends of their range.
    all_outside: u64,
    outside: u64,
    least: End,
    most: End,
    /// The smallest value above 0.
    first: f64,
    /// Neighbours that are alike, but for those of 0; and those that differ.
    alike: u64,
    differ: u64,
    /// Of those that differ, the ones of 0 and another value than the smallest that has 0 for a neighbour.
    jumps: u64,
    nearest: End,
}

/// A part of outside samples that are padding, at least; a part of those within that are, at most.
const OUTSIDE: f64 = 0.95;
const WITHIN: f64 = 0.1;
/// Distance of padding to all other values, as a part of the whole range, at least. What is nearer does no harm.
const APART: f64 = 0.15;
/// One of so many samples at either end of the others does not count.
const STRAY: u64 = 1000;
/// Values of a mixture, at least.
const FEW: usize = 16;
/// Shortest side of a slice that has a circle.
const ROUND: u32 = 16;

/// Labels of a map, at most.
const MAX_LABELS: usize = 1024;
/// Parts of the pairs of neighbours outside 0 that are alike in a map of labels, at least; and of those that differ
/// that jump to 0 from a value that is not the nearest to it. A picture in few greys has as wide regions, but one after
/// the other.
const FLAT: f64 = 0.6;
const JUMPS: f64 = 0.2;

/// Are all samples whole numbers, and none below 0?
fn are_whole<T: Ordered>(samples: &[T]) -> bool {
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

/// How many columns at either end of a line lie outside the ellipse of a slice, one less to spare.
fn columns_outside(dims: Dims, y: u32) -> u32 {
    let down = (f64::from(y) + 0.5) / f64::from(dims.ny()) - 0.5;
    let across = f64::from(dims.nx()) * (0.5 - (0.25 - down * down).max(0.0).sqrt());
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "below a side")]
    let ends = (across as u32).saturating_sub(1);
    ends
}

/// The samples of a volume that lie outside; 0 if its slices are too narrow.
fn outside_samples(dims: Dims) -> u64 {
    if dims.nx().min(dims.ny()) < ROUND {
        return 0;
    }
    let line = |y| u64::from(2 * columns_outside(dims, y)).min(dims.nx().into());
    (0..dims.ny()).map(line).sum::<u64>() * u64::from(dims.nz())
}

impl Evidence {
    fn new(may_be_map: bool, all_outside: u64) -> Self {
        let [least, most] = [f64::INFINITY, f64::NEG_INFINITY].map(|value| End { value, count: 0 });
        Self {
            may_be_map,
            may_be_padded: all_outside > 0,
            parts: 0,
            all_outside,
            outside: 0,
            least,
            most,
            first: f64::INFINITY,
            alike: 0,
            differ: 0,
            jumps: 0,
            nearest: least,
        }
    }

    fn join(&mut self, other: &Self) {
        self.may_be_map &= other.may_be_map;
        self.may_be_padded &= other.may_be_padded;
        self.outside += other.outside;
        self.least.add(other.least, other.least.value < self.least.value);
        self.most.add(other.most, other.most.value > self.most.value);
        self.first = self.first.min(other.first);
        self.alike += other.alike;
        self.differ += other.differ;
        self.jumps += other.jumps;
        self.nearest.add(other.nearest, other.nearest.value < self.nearest.value);
    }

    fn words(&self) -> [u64; 13] {
        let Self { least, most, nearest, .. } = *self;
        let [least_count, most_count, nearest_count] = [least, most, nearest].map(|end| end.count);
        let [least, most, nearest] = [least, most, nearest].map(|end| end.value.to_bits());
        let ends = [least, least_count, most, most_count, nearest, nearest_count];
        let may_be = [u64::from(self.may_be_map), u64::from(self.may_be_padded)];
        let counts = [self.outside, self.first.to_bits(), self.alike, self.differ, self.jumps];
        let mut words = [0; 13];
        words.iter_mut().zip(may_be.into_iter().chain(ends).chain(counts)).for_each(|(word, of)| *word = of);
        words
    }

    fn parse(words: &[u64; 13]) -> Self {
        let [map, padded, rest @ ..] = *words;
        let [least, least_count, most, most_count, nearest, nearest_count, counts @ ..] = rest;
        let [outside, first, alike, differ, jumps] = counts;
        let end = |value, count| End { value: f64::from_bits(value), count };
        Self {
            may_be_map: map != 0,
            may_be_padded: padded != 0,
            outside,
            least: end(least, least_count),
            most: end(most, most_count),
            nearest: end(nearest, nearest_count),
            first: f64::from_bits(first),
            alike,
            differ,
            jumps,
            ..Self::new(true, 0)
        }
    }

    /// Neighbours along rows; a row's last sample counts as that of the next one's first. `counted` is what was counted
    /// before, of which a map has few values.
    fn add_edges<T: Ordered>(&mut self, samples: &[T], counted: &[u32]) {
        let Some(first) = samples.first().filter(|_| self.may_be_map) else { return };
        self.parts += 1;
        if self.parts.is_power_of_two() {
            self.may_be_map = counted.iter().filter(|n| **n > 0).count() <= MAX_LABELS + 1;
        }
        self.may_be_map &= are_whole(samples);
        if !self.may_be_map {
            return;
        }
        let zero = T::zeroed();
        let neighbours = || samples.iter().zip(&samples[1..]);
        let is_jump = |a: &T, b: &T| (a != b) & ((*a == zero) | (*b == zero));
        // Sums of bits, without branches; a part has fewer samples than 2^32.
        let differ = neighbours().map(|(a, b)| u32::from(a != b)).sum::<u32>();
        let alike = neighbours().map(|(a, b)| u32::from((a == b) & (*a != zero))).sum::<u32>();
        let jumps = neighbours().map(|(a, b)| u32::from(is_jump(a, b))).sum::<u32>();
        self.alike += u64::from(alike) + u64::from(*first != zero);
        self.differ += u64::from(differ);
        self.jumps += u64::from(jumps);
        let above = samples.iter().filter(|sample| **sample > zero);
        let smallest = above.fold(None, |low: Option<&T>, s| low.filter(|low| *low <= s).or(Some(s)));
        self.first = smallest.map_or(self.first, |smallest| self.first.min(smallest.to_f64()));
        if jumps > 0 {
            for (a, b) in neighbours().filter(|(a, b)| is_jump(a, b)) {
                // Neither is below 0.
                let other = a.to_f64().max(b.to_f64());
                self.nearest.add(End { value: other, count: 1 }, other < self.nearest.value);
            }
        }
    }

    /// Samples of a part that lie outside.
    fn add_outside<T: Ordered>(&mut self, dims: Dims, part: &Part, samples: &[T]) {
        if !self.may_be_padded {
            return;
        }
        let nx = dims.nx();
        for (row, y) in samples.chunks(part.columns.len().max(1)).zip(part.lines.clone()) {
            let ends = columns_outside(dims, y);
            let Range { start, end } = part.columns;
            // Columns of this part at the low end, and those from the high end on.
            let low = ends.clamp(start, end) - start;
            let high = (nx - ends).clamp(start + low, end) - start;
            for samples in [row.get(..low as usize), row.get(high as usize..)].into_iter().flatten() {
                self.add_run(samples);
            }
        }
        // Too many others than either end of the range for what is wanted of all.
        let most = self.all_outside as f64 * (1.0 - OUTSIDE);
        let others = |end: &End| (self.outside - end.count) as f64;
        self.may_be_padded = others(&self.least).min(others(&self.most)) <= most + 1.0;
    }

    /// Samples outside, one after the other.
    fn add_run<T: Ordered>(&mut self, samples: &[T]) {
        let Some(first) = samples.first() else { return };
        self.outside += samples.len() as u64;
        let of = |value: T| samples.iter().map(|sample| u64::from(*sample == value)).sum::<u64>();
        // What is not a number is neither.
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

    /// The number of labels, if these are some.
    fn labels(&self, counts: &[u64]) -> Option<usize> {
        let values = counts.iter().filter(|n| **n > 0).count();
        let part = |of: u64, all: u64| of as f64 / (all.max(1) as f64);
        let is_map = self.may_be_map
            // Two values are told apart by any threshold between them.
            && (3..=MAX_LABELS + 1).contains(&values)
            && part(self.alike, self.alike + self.differ) >= FLAT
            && part(self.jumps - self.nearest.count, self.differ) >= JUMPS;
        is_map.then_some(values - 1)
    }

    /// The bin of a value that pads what lies outside the circle.
    fn padding(&self, counts: &[u64], value: &dyn Fn(usize) -> f64) -> Option<usize> {
        let total: u64 = counts.iter().sum();
        let first = counts.iter().position(|n| *n > 0)?;
        let last = counts.iter().rposition(|n| *n > 0)?;
        if !self.may_be_padded || counts.iter().filter(|n| **n > 0).count() <= FEW {
            return None;
        }
        let part = |of: u64, all: u64| of as f64 / (all.max(1) as f64);
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

/// Where samples that a worker is given lie.
struct Part {
    columns: Range<u32>,
    lines: Range<u32>,
}

/// First bin of the upper class; the middle of the gap where several splits are equally good.
fn best_split(counts: &[u64]) -> Option<usize> {
    let total: f64 = counts.iter().map(|c| *c as f64).sum();
    let moment: f64 = counts.iter().enumerate().map(|(i, c)| i as f64 * *c as f64).sum();
    let (mut below, mut below_moment) = (0.0, 0.0);
    let (mut best, mut first, mut last) = (0.0, 0, 0);
    for (bin, count) in counts.iter().enumerate() {
        // Here `below` counts the bins before `bin`.
        let above = total - below;
        if below > 0.0 && above > 0.0 {
            let gap = below_moment / below - (moment - below_moment) / above;
            let between = below * above * gap * gap;
            if between > best {
                (best, first, last) = (between, bin, bin);
            } else if between == best && last + 1 == bin {
                last = bin;
            }
        }
        below += *count as f64;
        below_moment += bin as f64 * *count as f64;
    }
    (best > 0.0).then(|| first + (last - first).div_ceil(2))
}

/// Feeds every sample of a share of the volume, as bytes, to workers, some rows at a time; each worker's state is joined
/// last.
fn for_each_part<L>(
    source: &dyn VolumeSource,
    share: Share,
    (threads, read_bytes): (usize, usize),
    progress: &dyn Progress,
    start: &(dyn Fn() -> L + Sync),
    work: &(dyn Fn(&mut L, &Part, &[u8]) + Sync),
    join: &(dyn Fn(L) + Sync),
) -> Result<(), BuildError> {
    let sample_bytes = source.info().scalar.bytes();
    let blocks = Blocks::new(source.info().dims, read_bytes / sample_bytes).of(share);
    run_workers(threads, progress, &|stop| {
        let mut local = start();
        // Words, so that the samples are aligned for every type.
        let bytes = blocks.size().iter().product::<usize>() * sample_bytes;
        let mut buffer = vec![0_u64; bytes.div_ceil(size_of::<u64>())];
        while !stop() {
            let Some((columns, lines, z)) = blocks.next() else { break };
            let count = columns.len() * lines.len();
            let samples = &mut bytemuck::cast_slice_mut(&mut buffer)[..count * sample_bytes];
            let part = Part { columns: columns.clone(), lines: lines.clone() };
            source.read_rows(z, lines, columns, samples)?;
            work(&mut local, &part, samples);
            progress.advance(count as u64);
        }
        join(local);
        Ok(())
    })
}

#[cfg(test)]
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "small numbers")]
mod tests {
    use super::*;

    #[test]
    fn the_split_separates_two_peaks_in_the_middle_of_their_gap() {
        let mut counts = vec![0; 1000];
        counts[100] = 50;
        counts[101] = 60;
        counts[900] = 10;
        assert_eq!(best_split(&counts), Some(501));
        assert_eq!(best_split(&[0, 5, 0]), None);
        assert_eq!(best_split(&[3, 5]), Some(1));
        assert_eq!(best_split(&[]), None);
    }

    /// What is counted of a slice, sample by sample.
    fn slow_evidence<T: Ordered>(samples: &[T], dims: Dims, evidence: &mut Evidence) {
        let [nx, ny, _] = dims.to_array().map(|n| n as usize);
        for slice in samples.chunks(nx * ny) {
            let mut last = slice[0].to_f64();
            for (at, sample) in slice.iter().enumerate() {
                let v = sample.to_f64();
                evidence.may_be_map &= v >= 0.0 && v.trunc() == v;
                if v > 0.0 {
                    evidence.first = evidence.first.min(v);
                }
                if v == last {
                    evidence.alike += u64::from(v != 0.0);
                } else {
                    evidence.differ += 1;
                    let other = if last == 0.0 { v } else { last };
                    if last == 0.0 || v == 0.0 {
                        evidence.jumps += 1;
                        evidence.nearest.add(End { value: other, count: 1 }, other < evidence.nearest.value);
                    }
                    last = v;
                }
                let ends = columns_outside(dims, u32::try_from(at / nx).unwrap()) as usize;
                if evidence.all_outside > 0 && !(ends..nx - ends).contains(&(at % nx)) {
                    let one = End { value: v, count: 1 };
                    evidence.outside += 1;
                    evidence.least.add(one, v < evidence.least.value);
                    evidence.most.add(one, v > evidence.most.value);
                }
            }
        }
    }

    fn judged<T: Ordered>(samples: &[T], dims: Dims, low: f64) -> (Option<usize>, Option<usize>) {
        let mut counts = vec![0_u64; BINS];
        samples.iter().for_each(|s| counts[(s.to_f64() - low) as usize] += 1);
        let value = |bin: usize| low + bin as f64;
        let of = |evidence: &Evidence| (evidence.labels(&counts), evidence.padding(&counts, &value));
        let start = || Evidence::new(true, outside_samples(dims));
        let mut slow = start();
        slow_evidence(samples, dims, &mut slow);
        let (mut whole, mut local) = (start(), vec![0_u32; BINS]);
        let [nx, ny, _] = dims.to_array().map(|n| n as usize);
        for slice in samples.chunks(nx * ny) {
            let part = Part { columns: 0..dims.nx(), lines: 0..dims.ny() };
            let mut own = start();
            own.add_edges(slice, &local);
            own.add_outside(dims, &part, slice);
            whole.join(&own);
            slice.iter().for_each(|s| local[(s.to_f64() - low) as usize] += 1);
        }
        assert_eq!(of(&whole), of(&slow));
        if whole.may_be_map && slow.may_be_map {
            assert_eq!((whole.alike, whole.differ, whole.jumps), (slow.alike, slow.differ, slow.jumps));
            assert_eq!((whole.nearest.value, whole.nearest.count), (slow.nearest.value, slow.nearest.count));
            assert_eq!(whole.first, slow.first);
        }
        of(&whole)
    }

    #[test]
    fn what_is_counted_fast_says_what_is_counted_slowly() {
        let mut random = crate::random::Random(11);
        let (mut maps, mut padded) = (0, 0);
        for round in 0..60_u64 {
            let sides = [20 + random.below(60), 20 + random.below(60), 1 + random.below(4)];
            let [nx, ny, nz] = sides.map(|n| u32::try_from(n).unwrap());
            let dims = Dims::new(nx, ny, nz).unwrap();
            let (kinds, pad) = (2 + random.below(40), [-2000, -1000, 3000][(round % 3) as usize]);
            let mut value = 0;
            let samples: Vec<i16> = (0..dims.voxels())
                .map(|at| {
                    let (x, y) = (at % sides[0], at / sides[0] % sides[1]);
                    let ends = u64::from(columns_outside(dims, u32::try_from(y).unwrap()));
                    let is_out = x < ends || x >= sides[0] - ends;
                    match round % 4 {
                        // Labels in runs, with nothing between them.
                        0 => {
                            if random.below(9) == 0 {
                                value = if value == 0 { random.below(kinds) * 3 } else { 0 };
                            }
                            i16::try_from(value).unwrap()
                        }
                        // Padding, now and then not quite.
                        1 if is_out && random.below(1 + round / 2) < 40 => pad,
                        2 if is_out => i16::try_from(random.below(30)).unwrap(),
                        3 => i16::try_from(random.below(3000)).unwrap() - 900,
                        _ => i16::try_from(random.below(1200)).unwrap() - 300,
                    }
                })
                .collect();
            let (labels, padding) = judged(&samples, dims, -32768.0);
            maps += u32::from(labels.is_some());
            padded += u32::from(padding.is_some());
            let unsigned: Vec<u8> = samples.iter().map(|s| s.unsigned_abs().min(255) as u8).collect();
            judged(&unsigned, dims, 0.0);
            let real: Vec<f32> = samples.iter().map(|s| f32::from(*s)).collect();
            judged(&real, dims, -32768.0);
        }
        assert!(maps > 5 && padded > 5, "{maps} maps, {padded} padded");
    }
}
