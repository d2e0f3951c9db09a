//! Value statistics in streamed passes: extremes, and Otsu's threshold from an exact histogram.
//!
//! Otsu's method takes values for a mixture of two kinds. Two sorts of volumes differ from that: those padded by the
//! scanner outside its reconstruction circle, and maps of labels. Counts of the same pass recognise them
//! ([`Evidence`]).

use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use super::error::BuildError;
use super::evidence::{
    EVIDENCE_WORDS, Evidence, Levels, MAX_LABELS, MAX_PAIRS, Pair, SampleSpan, below_air, may_be_map,
    outside_samples, part,
};
use super::extremes::{Core, Extremes};
use super::parallel::{Blocks, Share, run_workers};
use super::range::Ordered;
use crate::budget::costs::{MAPPED_FROM, MIN_WORKER};
use crate::geom::Dims;
use crate::progress::{Progress, Silent};
use crate::volume::{ScalarType, VolumeInfo, VolumeSource};

/// Bins of a histogram: one for every value of the 16-bit types.
pub(super) const BINS: usize = 1 << 16;
/// Bytes that a worker reads at a time.
const READ_BYTES: usize = 256 << 10;
/// Bytes that a worker reads at a time for the extremes. Smaller than the size from which the C library's allocator
/// maps a buffer of its own: freeing a mapped one raises that size, and the larger buffers of the counting pass would
/// then stay resident after it, at the expense of the scan.
const EXTREMES_READ_BYTES: usize = 64 << 10;
const _: () = assert!(EXTREMES_READ_BYTES < MAPPED_FROM);
/// Memory of one worker, and of the shared sum.
pub(super) const WORKER_BYTES: u64 = (READ_BYTES + 4 * BINS + MAX_PAIRS * size_of::<Pair>()) as u64;
pub(super) const SHARED_BYTES: u64 = 8 * BINS as u64;
// The smallest plan also suffices for a threshold that is still to be found.
const _: () = assert!(SHARED_BYTES + WORKER_BYTES <= MIN_WORKER);

/// The outermost finite samples of a share of the volume.
pub(super) fn extremes(
    source: &dyn VolumeSource,
    share: Share,
    threads: usize,
    progress: &dyn Progress,
) -> Result<Extremes, BuildError> {
    let total = Mutex::new(Extremes::default());
    let add = by_type!(source.info().scalar, T => add::<T> as fn(&mut Extremes, &[u8]));
    for_each_part(
        source,
        share,
        (threads, EXTREMES_READ_BYTES),
        progress,
        &Extremes::default,
        &|seen, _, samples| add(seen, samples),
        &|seen| total.lock().unwrap_or_else(std::sync::PoisonError::into_inner).join(&seen),
    )?;
    Ok(total.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner))
}

fn add<T: Ordered>(seen: &mut Extremes, samples: &[u8]) {
    seen.add::<T>(bytemuck::cast_slice(samples));
}

/// The only number of a volume whose other samples are NaN, unless it is 0: a mask.
pub(super) fn number_in_nan(
    source: &dyn VolumeSource,
    threads: usize,
    progress: &dyn Progress,
) -> Result<Option<f64>, BuildError> {
    let scalar = source.info().scalar;
    let may_be_nan = matches!(scalar, ScalarType::F32 | ScalarType::F64);
    let seen = if may_be_nan { extremes(source, Share::ALL, threads, progress)?.whole() } else { None };
    let Some((number, _)) = seen.filter(|(least, most)| least == most && *least != 0.0) else {
        return Ok(None);
    };
    let has_nan = by_type!(scalar, T => has_nan::<T> as fn(&[u8]) -> bool);
    let found = AtomicBool::new(false);
    let read = (threads, EXTREMES_READ_BYTES);
    for_each_part(
        source,
        Share::ALL,
        read,
        progress,
        &|| false,
        &|own, _, all| *own |= has_nan(all),
        &|own| {
            found.fetch_or(own, Ordering::Relaxed);
        },
    )?;
    Ok(found.into_inner().then_some(number))
}

fn has_nan<T: Ordered>(samples: &[u8]) -> bool {
    bytemuck::cast_slice::<u8, T>(samples).iter().any(|sample| sample.to_f64().is_nan())
}

/// Result of a histogram.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Split {
    /// Otsu's threshold in sample units: the sample value `t` that maximises the variance between the classes `< t` and
    /// `>= t`, padding left out.
    pub(super) at: f64,
    /// Kind of the volume's values.
    pub(super) kind: Kind,
    /// The range of samples that are not padding; infinite at an end without padding.
    pub(super) within: [f64; 2],
}

/// Kind of a volume's values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Kind {
    /// A mixture of two kinds of values.
    Values,
    /// Few greys, which may be labels.
    Greys {
        /// Number of greys.
        count: usize,
    },
    /// A mixture, and a value that pads the outside of the circle.
    Padded {
        /// The padding.
        value: f64,
    },
    /// Labels, with 0 as background.
    Labels {
        /// Number of labels.
        count: usize,
        /// The smallest label.
        first: f64,
    },
}

/// True if samples need their extremes before they are counted. Types of 8 and 16 bits are counted exactly.
pub(super) fn needs_extremes(scalar: ScalarType) -> bool {
    scalar.bytes() > 2
}

/// Position of the bins of a histogram, in samples.
#[derive(Clone, Copy)]
pub(super) enum Bins {
    /// Bins from `low` on, each `width` wide; around a core, the first bin and the last hold what lies beyond it.
    From { low: f64, width: f64, core: Option<Core> },
    /// Values so close that no bin can tell them apart: the largest is the upper class.
    TooClose { max: f64 },
    /// All values are equal, or all are NaN.
    Alike,
}

impl Bins {
    /// The bins for samples of a volume; wide types need their extremes.
    pub(super) fn new(info: &VolumeInfo, extremes: &Extremes) -> Self {
        let exact = |low: f64| Self::From { low, width: 1.0, core: None };
        match (info.scalar, extremes.whole()) {
            (ScalarType::U8 | ScalarType::U16, _) => exact(0.0),
            (ScalarType::I8, _) => exact(-128.0),
            (ScalarType::I16, _) => exact(-32768.0),
            (_, Some((min, max))) if max > min => {
                let core = extremes.core(info.dims.voxels());
                let (min, max, inner) =
                    core.map_or((min, max, BINS - 1), |core| (core.low, core.high, BINS - 3));
                let width = max / inner as f64 - min / inner as f64;
                let low = if core.is_some() { min - 1.5 * width } else { min };
                if width.is_normal() { Self::From { low, width, core } } else { Self::TooClose { max } }
            }
            _ => Self::Alike,
        }
    }
}

/// Otsu's threshold and the kind of the volume; `None` when all values are equal or NaN.
///
/// Types of 8 and 16 bits are counted exactly in one pass; wider ones need their extremes first, and
/// then 65,536 bins between them, a fill value and hot samples left out. Source: Otsu 1979, *A threshold selection
/// method from gray-level histograms*.
pub(super) fn otsu(
    source: &dyn VolumeSource,
    threads: usize,
    progress: &dyn Progress,
) -> Result<Option<Split>, BuildError> {
    let seen = match needs_extremes(source.info().scalar) {
        true => extremes(source, Share::ALL, threads, progress)?,
        false => Extremes::default(),
    };
    let bins = Bins::new(source.info(), &seen);
    Ok(Tally::take(source, Share::ALL, bins, threads, progress)?.split(bins, source))
}

/// Most slices that are read to recognise a map of labels.
const LOOKED: u32 = 32;

/// True if some slices hold labels; only the middle one is read if it does not look like labels.
///
/// Memory: 64 KiB and the pairs.
pub(super) fn is_map(source: &dyn VolumeSource) -> Result<bool, BuildError> {
    let VolumeInfo { dims, scalar, .. } = *source.info();
    if !may_be_map(source) {
        return Ok(false);
    }
    let edges = by_type!(scalar, T => add_looked::<T> as fn(&mut Evidence, Dims, &SampleSpan, &mut [u8]));
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
    Ok(seen.is_hard() && matches!(seen.labels(values), Some(Levels::Labels(_))))
}

/// Adds samples to the evidence for a map of labels.
fn add_looked<T: Ordered>(evidence: &mut Evidence, dims: Dims, part: &SampleSpan, samples: &mut [u8]) {
    let samples: &mut [T] = bytemuck::cast_slice_mut(samples);
    evidence.blank(samples, None);
    evidence.add_edges(part, samples, &[]);
    evidence.add_rows(dims, part, samples);
}

/// Counts of a share of a volume's samples. Tallies of all shares add up to the tally of the whole, whatever the
/// shares.
pub(crate) struct Tally {
    counts: Vec<u64>,
    evidence: Evidence,
}

impl Tally {
    /// Counts the samples of a share; empty without bins.
    pub(super) fn take(
        source: &dyn VolumeSource,
        share: Share,
        bins: Bins,
        threads: usize,
        progress: &dyn Progress,
    ) -> Result<Self, BuildError> {
        let Bins::From { low, width, core } = bins else { return Ok(Self::default()) };
        let counts: Vec<AtomicU64> = (0..BINS).map(|_| AtomicU64::new(0)).collect();
        let spill = |local: &mut [u32]| {
            for (sum, n) in counts.iter().zip(local).filter(|(_, n)| **n > 0) {
                sum.fetch_add(u64::from(std::mem::take(n)), Ordering::Relaxed);
            }
        };
        let VolumeInfo { dims, scalar, .. } = *source.info();
        let count = by_type!(scalar, T => count::<T> as fn(&mut Counter, &SampleSpan, &mut [u8]));
        let start = Evidence::new(may_be_map(source), outside_samples(dims));
        let evidence = Mutex::new(start.clone());
        for_each_part(
            source,
            share,
            (threads, READ_BYTES),
            progress,
            &|| Counter { counts: vec![0; BINS], low, width, core, dims, evidence: start.clone(), seen: 0 },
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

    /// Adds the counts of another share.
    pub(super) fn join(&mut self, other: &Self) {
        self.counts.iter_mut().zip(&other.counts).for_each(|(sum, n)| *sum += n);
        self.evidence.join(&other.evidence);
    }

    /// The least and the greatest counted value.
    pub(super) fn ends(&self, bins: Bins) -> Option<(f64, f64)> {
        let Bins::From { low, width, .. } = bins else { return None };
        let at = |bin: usize| low + bin as f64 * width;
        let is_there = |n: &u64| *n > 0;
        Some((at(self.counts.iter().position(is_there)?), at(self.counts.iter().rposition(is_there)?)))
    }

    /// Otsu's threshold by these counts in these bins.
    pub(super) fn split(mut self, bins: Bins, source: &dyn VolumeSource) -> Option<Split> {
        let (low, width, core) = match bins {
            Bins::From { low, width, core } => (low, width, core),
            Bins::TooClose { max } => {
                let within = [f64::NEG_INFINITY, f64::INFINITY];
                return Some(Split { at: max, kind: Kind::Values, within });
            }
            Bins::Alike => return None,
        };
        if core.is_some() {
            self.counts[0] = 0;
            self.counts[BINS - 1] = 0;
        }
        let value = |bin: usize| low + bin as f64 * width;
        let (mut kind, mut within) = (Kind::Values, [f64::NEG_INFINITY, f64::INFINITY]);
        let values = self.values(low, width);
        let fill = core.map_or([None; 2], |core| core.fill);
        let hu = |bin: usize| source.info().rescale.apply(value(bin));
        let padding =
            || self.evidence.padding(&self.counts, &value).or_else(|| below_air(&self.counts, &hu, source));
        if let Some(Core { low, high, fill: [below, above] }) = core {
            within = [below.map_or(within[0], |_| low), above.map_or(within[1], |_| high)];
        }
        if let Some(levels) = self.evidence.labels(values) {
            kind = match levels {
                Levels::Labels(count) => Kind::Labels { count, first: self.evidence.first },
                Levels::Greys(count) => Kind::Greys { count },
            };
        } else if let Some(value) = fill[0].or(fill[1]) {
            kind = Kind::Padded { value };
        } else if let Some(bin) = padding() {
            kind = Kind::Padded { value: value(bin) };
            self.counts[bin] = 0;
            match self.counts[bin..].iter().all(|n| *n == 0) {
                true => within[1] = value(bin - 1),
                false => within[0] = value(bin + 1),
            }
        } else if may_be_map(source) && self.evidence.may_be_labels(values) {
            kind = Kind::Greys { count: values };
        }
        best_split(&self.counts).map(|bin| Split { at: value(bin), kind, within })
    }

    /// Number of different values; samples that are outside whatever they are count as 0.
    fn values(&self, low: f64, width: f64) -> usize {
        let at_zero = (0.0 - low) / width;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked")]
        let has_zero = at_zero >= 0.0 && self.counts.get(at_zero as usize).is_some_and(|n| *n > 0);
        let counted = self.counts.iter().filter(|n| **n > 0).count();
        counted + usize::from(self.evidence.has_blanks && !has_zero)
    }

    /// Words for a file: the evidence, then bin and count of every bin that is not empty.
    pub(crate) fn words(&self) -> impl Iterator<Item = u64> {
        let counted = (0_u64..).zip(&self.counts).filter(|(_, n)| **n > 0).flat_map(|(bin, n)| [bin, *n]);
        let Evidence { pairs, is_crowded, .. } = &self.evidence;
        let pairs = [u64::from(*is_crowded), pairs.len() as u64]
            .into_iter()
            .chain(pairs.iter().flat_map(Pair::words));
        self.evidence.words().into_iter().chain(pairs).chain(counted)
    }

    /// Parses words of [`Self::words`]; `None` if they are invalid.
    pub(crate) fn parse(words: &mut dyn Iterator<Item = u64>) -> Option<Self> {
        let mut evidence = [0; EVIDENCE_WORDS];
        for word in &mut evidence {
            *word = words.next()?;
        }
        let mut tally = Self { evidence: Evidence::parse(&evidence), ..Self::default() };
        tally.evidence.is_crowded = words.next()? != 0;
        for _ in 0..words.next().filter(|pairs| *pairs <= MAX_PAIRS as u64)? {
            let mut pair = [0; 7];
            for word in &mut pair {
                *word = words.next()?;
            }
            tally.evidence.add_pair(Pair::parse(pair));
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
    core: Option<Core>,
    dims: Dims,
    evidence: Evidence,
    /// Samples counted since the counts were last added to the sum.
    seen: u64,
}

/// Counts the samples of a part.
fn count<T: Ordered>(counter: &mut Counter, part: &SampleSpan, samples: &mut [u8]) {
    let samples: &mut [T] = bytemuck::cast_slice_mut(samples);
    let Counter { counts, low, width, core, dims, evidence, .. } = counter;
    evidence.add_outside(*dims, part, samples);
    let (low, width) = (*low, *width);
    let counts: &mut [u32] = counts;
    for sample in &*samples {
        let v = sample.to_f64();
        if v.is_finite() {
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped below")]
            let bin = (v / width - low / width) as usize;
            counts[bin.min(BINS - 1)] += 1;
        }
    }
    evidence.blank(samples, *core);
    evidence.add_edges(part, samples, counts);
    evidence.add_rows(*dims, part, samples);
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

/// Feeds every sample of a share of the volume to workers, as in [`for_each_block`].
fn for_each_part<L>(
    source: &dyn VolumeSource,
    share: Share,
    (threads, read_bytes): (usize, usize),
    progress: &dyn Progress,
    start: &(dyn Fn() -> L + Sync),
    work: &(dyn Fn(&mut L, &SampleSpan, &mut [u8]) + Sync),
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
    work: &(dyn Fn(&mut L, &SampleSpan, &mut [u8]) + Sync),
    join: &(dyn Fn(L) + Sync),
) -> Result<(), BuildError> {
    let sample_bytes = source.info().scalar.bytes();
    run_workers(threads, progress, &|stop| {
        let mut local = start();
        // A buffer of words, which aligns the samples for every type.
        let bytes = blocks.size().iter().product::<usize>() * sample_bytes;
        let mut buffer = vec![0_u64; bytes.div_ceil(size_of::<u64>())];
        while !stop() {
            let Some((columns, lines, z)) = blocks.next() else { break };
            let count = columns.len() * lines.len();
            let samples = &mut bytemuck::cast_slice_mut(&mut buffer)[..count * sample_bytes];
            let part = SampleSpan { columns: columns.clone(), lines: lines.clone() };
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
    use super::super::evidence::{End, columns_outside};
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

    /// Reference for the evidence of a slice, sample by sample.
    fn slow_evidence<T: Ordered>(samples: &[T], dims: Dims, evidence: &mut Evidence) {
        let [nx, ny, _] = dims.to_array().map(|n| n as usize);
        for slice in samples.chunks(nx * ny) {
            let mut last = slice[0].to_f64();
            for (at, sample) in slice.iter().enumerate() {
                let v = sample.to_f64();
                last = if at % nx == 0 { v } else { last };
                evidence.may_be_map &= v >= 0.0 && v.trunc() == v;
                if v > 0.0 {
                    evidence.first = evidence.first.min(v);
                }
                if v == last {
                    evidence.alike += u64::from(v != 0.0 && (at == 0 || at % nx > 0));
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

    fn judged<T: Ordered>(samples: &[T], dims: Dims, low: f64) -> (Option<Levels>, Option<usize>) {
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
            let part = SampleSpan { columns: 0..dims.nx(), lines: 0..dims.ny() };
            let mut own = start();
            own.add_edges(&part, slice, &local);
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
                        // Labels in runs, without values between them.
                        0 => {
                            if random.below(9) == 0 {
                                value = if value == 0 { random.below(kinds) * 3 } else { 0 };
                            }
                            i16::try_from(value).unwrap()
                        }
                        // Padding, occasionally with another value.
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
