//! Value statistics in streamed passes: extremes, and Otsu's threshold from an exact histogram.
//!
//! Otsu's method takes values for a mixture of two kinds. Two sorts of volumes differ from that: those that a scanner has
//! padded outside the circle that it reconstructs, and maps of labels. Counts of the same pass recognise them
//! ([`Evidence`]).

use std::collections::BTreeSet;
use std::ops::Range;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

use super::error::BuildError;
use super::parallel::{Blocks, Share, run_workers};
use super::range::Ordered;
use crate::budget::costs::{MAPPED_FROM, MIN_WORKER};
use crate::geom::Dims;
use crate::progress::{Progress, Silent};
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
pub(super) const WORKER_BYTES: u64 = (READ_BYTES + 4 * BINS + MAX_PAIRS * size_of::<Pair>()) as u64;
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

/// Slices by which a map of labels is recognised, at most.
const LOOKED: u32 = 32;

/// True if some slices hold labels, of which the middle one alone is read where it does not look like it.
///
/// Memory: 64 KiB and the pairs.
pub(super) fn is_map(source: &dyn VolumeSource) -> Result<bool, BuildError> {
    let VolumeInfo { dims, scalar, .. } = *source.info();
    if !may_be_map(source) {
        return Ok(false);
    }
    let edges = by_type!(scalar, T => add_looked::<T> as fn(&mut Evidence, Dims, &Part, &[u8]));
    let evidence = Mutex::new(Evidence::new(true, 0));
    let look = |z: u32| {
        let blocks = Blocks::new(dims, EXTREMES_READ_BYTES / scalar.bytes()).of_slices(z..z + 1);
        for_each_block(
            source,
            blocks,
            1,
            &Silent,
            &|| Evidence::new(true, 0),
            &|own, part, samples| {
                edges(own, dims, part, samples);
            },
            &|own| evidence.lock().unwrap_or_else(std::sync::PoisonError::into_inner).join(&own),
        )
    };
    let middle = dims.nz() / 2;
    look(middle)?;
    let seen = || evidence.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    let is_flat = |seen: &Evidence| part(seen.alike, seen.alike + seen.differ) >= 0.5 || seen.differ == 0;
    if !(seen().may_be_map && is_flat(&seen())) {
        return Ok(false);
    }
    let step = dims.nz().div_ceil(LOOKED);
    for z in (0..dims.nz()).step_by(step as usize).filter(|z| *z != middle) {
        look(z)?;
    }
    let seen = seen();
    let values = if seen.is_crowded { MAX_LABELS } else { seen.values().len() };
    Ok(seen.labels(values).is_some())
}

/// Adds samples to what tells maps of labels.
fn add_looked<T: Ordered>(evidence: &mut Evidence, dims: Dims, part: &Part, samples: &[u8]) {
    let samples: &[T] = bytemuck::cast_slice(samples);
    evidence.add_edges(samples, &[]);
    evidence.add_rows(dims, part, samples);
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
        let start = Evidence::new(may_be_map(source), outside_samples(dims));
        let evidence = Mutex::new(start.clone());
        for_each_part(
            source,
            share,
            (threads, READ_BYTES),
            progress,
            &|| Counter { counts: vec![0; BINS], low, width, dims, evidence: start.clone(), seen: 0 },
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
        let values = self.counts.iter().filter(|n| **n > 0).count();
        if let Some(count) = self.evidence.labels(values) {
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
        let Evidence { pairs, is_crowded, .. } = &self.evidence;
        let pairs = [u64::from(*is_crowded), pairs.len() as u64]
            .into_iter()
            .chain(pairs.iter().flat_map(Pair::words));
        self.evidence.words().into_iter().chain(pairs).chain(counted)
    }

    /// The tally of such words, if they are one.
    pub(crate) fn parse(words: &mut dyn Iterator<Item = u64>) -> Option<Self> {
        let mut evidence = [0; EVIDENCE_WORDS];
        for word in &mut evidence {
            *word = words.next()?;
        }
        let mut tally = Self { evidence: Evidence::parse(&evidence), ..Self::default() };
        tally.evidence.is_crowded = words.next()? != 0;
        for _ in 0..words.next().filter(|pairs| *pairs <= MAX_PAIRS as u64)? {
            let mut pair = [0; 5];
            for word in &mut pair {
                *word = words.next()?;
            }
            let [low, high, count, clean, spikes] = pair;
            tally.evidence.add_pair(Pair { values: [low, high], count, clean, spikes });
        }
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
    evidence.add_rows(*dims, part, samples);
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
#[derive(Clone, Debug)]
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
    /// Samples at the ends of rows of the volume, and those of them that are 0.
    rim: u64,
    rim_zeros: u64,
    /// Pairs of values that are neighbours, in order.
    pairs: Vec<Pair>,
    /// True if there are more of them than [`MAX_PAIRS`].
    is_crowded: bool,
}

/// Words of the evidence in a file, without its pairs.
const EVIDENCE_WORDS: usize = 15;

/// Two values that are neighbours in a row, the lower one first.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Pair {
    values: [u64; 2],
    /// Places where they are, of the first [`PAIRS_OF_PART`] of each part; and those where the sample next to either has
    /// its value, too.
    count: u64,
    clean: u64,
    /// Single samples of one of them between two of the other.
    spikes: u64,
}

impl Pair {
    fn words(&self) -> [u64; 5] {
        [self.values[0], self.values[1], self.count, self.clean, self.spikes]
    }
}

/// Pairs of values that are told apart, and places of a part that are looked at.
const MAX_PAIRS: usize = 1024;
const PAIRS_OF_PART: usize = 2048;

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
/// Flat part of maps whose labels lie in each other in any order, and the part of the differences that skip values between
/// them with more than a sample on either side: a picture's edges pass through these greys.
const NESTED_FLAT: f64 = 0.5;
const SKIPS: f64 = 0.1;
/// The same where labels lie in each other in order: hardly any skips; the flat part where the steps between the values
/// are even, as those of greys; the part of the ends of rows that are 0; and labels, at most.
const NO_SKIPS: f64 = 0.05;
const EVEN_FLAT: f64 = 0.73;
const RIM: f64 = 0.9;
const ORDERED: usize = 16;
/// Greys of a display in even steps reach this far.
const DISPLAY: u64 = 250;
/// Part of the differences that are next to single samples unlike both neighbours, as in noise, at most where little is
/// flat; two values that meet in this way alone, and their part of the differences, at most.
const SPIKES: f64 = 0.25;
const ROUGH_FLAT: f64 = 0.75;
const ALL_SPIKES: f64 = 0.8;
const NOISE: f64 = 0.05;

/// May the samples of a source be labels? A picture that a device has taken holds none, however few its greys are, and
/// parts of voxels are not labels.
pub(super) fn may_be_map(source: &dyn VolumeSource) -> bool {
    let is_fractional = source.info().description.kind.is_fractional();
    !is_fractional && source.modality().is_none_or(|modality| modality == "SEG")
}

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
            rim: 0,
            rim_zeros: 0,
            pairs: Vec::new(),
            is_crowded: false,
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
        self.rim += other.rim;
        self.rim_zeros += other.rim_zeros;
        self.is_crowded |= other.is_crowded;
        other.pairs.iter().for_each(|pair| self.add_pair(*pair));
    }

    /// Adds a pair, or places of one; what is crowded has none.
    fn add_pair(&mut self, pair: Pair) {
        match self.pairs.binary_search_by_key(&pair.values, |pair| pair.values) {
            Ok(at) => {
                self.pairs[at].count += pair.count;
                self.pairs[at].clean += pair.clean;
                self.pairs[at].spikes += pair.spikes;
            }
            Err(_) if self.pairs.len() == MAX_PAIRS => self.is_crowded = true,
            Err(at) => self.pairs.insert(at, pair),
        }
        if self.is_crowded {
            self.pairs.clear();
        }
    }

    fn words(&self) -> [u64; EVIDENCE_WORDS] {
        let Self { least, most, nearest, .. } = *self;
        let [least_count, most_count, nearest_count] = [least, most, nearest].map(|end| end.count);
        let [least, most, nearest] = [least, most, nearest].map(|end| end.value.to_bits());
        let ends = [least, least_count, most, most_count, nearest, nearest_count];
        let may_be = [u64::from(self.may_be_map), u64::from(self.may_be_padded)];
        let counts = [self.outside, self.first.to_bits(), self.alike, self.differ, self.jumps];
        let counts = counts.into_iter().chain([self.rim, self.rim_zeros]);
        let mut words = [0; EVIDENCE_WORDS];
        words.iter_mut().zip(may_be.into_iter().chain(ends).chain(counts)).for_each(|(word, of)| *word = of);
        words
    }

    fn parse(words: &[u64; EVIDENCE_WORDS]) -> Self {
        let [map, padded, rest @ ..] = *words;
        let [least, least_count, most, most_count, nearest, nearest_count, counts @ ..] = rest;
        let [outside, first, alike, differ, jumps, rim, rim_zeros] = counts;
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
            rim,
            rim_zeros,
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

    /// The pairs of values in the rows of a part, and the ends of rows of the volume.
    fn add_rows<T: Ordered>(&mut self, dims: Dims, part: &Part, samples: &[T]) {
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
            if !self.is_crowded {
                self.add_pairs(row, &mut left);
            }
        }
    }

    /// The pairs of a row of whole numbers, `left` of them at most.
    fn add_pairs<T: Ordered>(&mut self, row: &[T], left: &mut usize) {
        for (at, w) in row.windows(2).enumerate().filter(|(_, w)| w[0] != w[1]).take(*left) {
            let before = at.checked_sub(1).map(|at| row[at]);
            let is_wide = before == Some(w[0]) && row.get(at + 2) == Some(&w[1]);
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "whole, and not below 0"
            )]
            let [a, b] = [w[0], w[1]].map(|sample| sample.to_f64() as u64);
            let (clean, spikes) = (u64::from(is_wide), u64::from(before == Some(w[1])));
            self.add_pair(Pair { values: [a.min(b), a.max(b)], count: 1, clean, spikes });
            *left -= 1;
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

    /// The number of labels, if these are some; `values` are as many as there are different samples.
    fn labels(&self, values: usize) -> Option<usize> {
        // Two values are told apart by any threshold between them.
        if !self.may_be_map || !(3..=MAX_LABELS + 1).contains(&values) {
            return None;
        }
        let flat = part(self.alike, self.alike + self.differ);
        let sum = |of: fn(&Pair) -> u64| self.pairs.iter().map(of).sum();
        let (all, spikes) = (sum(|pair| pair.count), sum(|pair| pair.spikes));
        let is_rough = part(spikes, all) > SPIKES && flat < ROUGH_FLAT;
        let touch_none = flat >= FLAT && part(self.jumps - self.nearest.count, self.differ) >= JUMPS;
        let is_map = !is_rough && (touch_none || self.are_nested(flat, all));
        is_map.then_some(values - 1)
    }

    /// True if the values lie in each other as labels do, in any order or in that of their numbers.
    fn are_nested(&self, flat: f64, all: u64) -> bool {
        let values: Vec<u64> = self.values().into_iter().collect();
        let rank = |value: &u64| values.partition_point(|other| other < value);
        let [mut skips, mut clean, mut noise] = [0; 3];
        for Pair { values: [low, high], count, clean: wide, spikes } in &self.pairs {
            if rank(high) > rank(low) + 1 {
                skips += count;
                clean += wide;
            }
            noise += if part(2 * spikes, *count) > ALL_SPIKES { *count } else { 0 };
        }
        let steps = || values.windows(2).map(|w| w[1] - w[0]);
        let (least, most) = (steps().min().unwrap_or(0), steps().max().unwrap_or(0));
        let is_even = most < 2 * least;
        let is_display = is_even && least > 1 && values.last().is_some_and(|last| last + most >= DISPLAY);
        let is_ordered = part(skips, all) <= NO_SKIPS
            && flat >= if is_even { EVEN_FLAT } else { FLAT }
            && values.len() <= ORDERED + 1
            && part(self.rim_zeros, self.rim) >= RIM
            && !(is_display && values.len() > 3);
        let is_unordered = part(clean, all) >= SKIPS && flat >= NESTED_FLAT;
        part(noise, all) <= NOISE && (is_unordered || is_ordered)
    }

    /// The values of the pairs.
    fn values(&self) -> BTreeSet<u64> {
        self.pairs.iter().flat_map(|pair| pair.values).collect()
    }

    /// The bin of a value that pads what lies outside the circle.
    fn padding(&self, counts: &[u64], value: &dyn Fn(usize) -> f64) -> Option<usize> {
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

/// One number as a part of another.
fn part(of: u64, all: u64) -> f64 {
    of as f64 / (all.max(1) as f64)
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

/// Feeds every sample of a share of the volume to workers, as [`for_each_block`].
fn for_each_part<L>(
    source: &dyn VolumeSource,
    share: Share,
    (threads, read_bytes): (usize, usize),
    progress: &dyn Progress,
    start: &(dyn Fn() -> L + Sync),
    work: &(dyn Fn(&mut L, &Part, &[u8]) + Sync),
    join: &(dyn Fn(L) + Sync),
) -> Result<(), BuildError> {
    let VolumeInfo { dims, scalar, .. } = *source.info();
    let blocks = Blocks::new(dims, read_bytes / scalar.bytes()).of(share);
    for_each_block(source, blocks, threads, progress, start, work, join)
}

/// Feeds every sample of blocks, as bytes, to workers, some rows at a time; each worker's state is joined last.
fn for_each_block<L>(
    source: &dyn VolumeSource,
    blocks: Blocks,
    threads: usize,
    progress: &dyn Progress,
    start: &(dyn Fn() -> L + Sync),
    work: &(dyn Fn(&mut L, &Part, &[u8]) + Sync),
    join: &(dyn Fn(L) + Sync),
) -> Result<(), BuildError> {
    let sample_bytes = source.info().scalar.bytes();
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
        let values = counts.iter().filter(|n| **n > 0).count();
        let of = |evidence: &Evidence| (evidence.labels(values), evidence.padding(&counts, &value));
        let start = || Evidence::new(true, outside_samples(dims));
        let mut slow = start();
        slow_evidence(samples, dims, &mut slow);
        let may_be_map = std::mem::replace(&mut slow.may_be_map, true);
        let (mut whole, mut local) = (start(), vec![0_u32; BINS]);
        let [nx, ny, _] = dims.to_array().map(|n| n as usize);
        for slice in samples.chunks(nx * ny) {
            let part = Part { columns: 0..dims.nx(), lines: 0..dims.ny() };
            let mut own = start();
            own.add_edges(slice, &local);
            own.add_rows(dims, &part, slice);
            own.add_outside(dims, &part, slice);
            whole.join(&own);
            slow.add_rows(dims, &part, slice);
            slice.iter().for_each(|s| local[(s.to_f64() - low) as usize] += 1);
        }
        slow.may_be_map = may_be_map;
        assert_eq!(of(&whole), of(&slow));
        if whole.may_be_map && slow.may_be_map {
            assert_eq!((whole.alike, whole.differ, whole.jumps), (slow.alike, slow.differ, slow.jumps));
            assert_eq!((whole.nearest.value, whole.nearest.count), (slow.nearest.value, slow.nearest.count));
            assert_eq!((whole.first, &whole.pairs), (slow.first, &slow.pairs));
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
