//! The choice of the inside: a selection as given, or by Otsu's method from a streamed histogram.

use super::error::{BuildError, Criterion};
use super::extremes::Extremes;
use super::histogram::{Bins, Kind, Split, Tally};
use super::parallel::Share;
use super::range::highest_below;
use super::report::BuildNote;
use super::ring::{FileRange, MaskRange, file_range};
use super::{BuildOptions, Progress, Threshold, histogram};
use crate::budget::costs::{MIN_WORKER, WORKER_OVERHEAD};
use crate::budget::{Budget, MemoryCap, Reservation, TooSmall};
use crate::builder::BuildFault;
use crate::fault::usage;
use crate::format::{Selection, SelectionKind};
use crate::volume::{Rescale, Treatment, VolumeInfo, VolumeSource};

/// Chooses the inside values, as [`super::build_volume`] does, and notes oddities of the volume; [`Threshold::Chosen`]
/// passes the result to it.
///
/// Passes over the volume: at most a slice, or some slices of a map of labels; for Otsu one (wide types: two). Memory:
/// 0.5 MiB and 0.5 MiB a worker, fewer workers where the cap is small.
///
/// # Errors
/// The range is empty, or no sample can lie in it; the volume cannot be read.
pub(crate) fn choose_noted(
    source: &dyn VolumeSource,
    threshold: Threshold,
    memory: MemoryCap,
    threads: usize,
    progress: &dyn Progress,
) -> Result<(Selection, Option<BuildNote>), BuildError> {
    let chooser = Chooser { source, memory, threads, progress };
    let Chosen { selection, note, .. } = chooser.choose(threshold)?;
    Ok((selection, note))
}

/// Number of labels by which [`Threshold::Otsu`] knows a volume for a map; `None` for others, of which some slices are
/// read.
pub(crate) fn label_count(
    source: &dyn VolumeSource,
    options: &BuildOptions,
    progress: &dyn Progress,
) -> Option<usize> {
    let chooser = Chooser { source, memory: options.memory, threads: options.threads, progress };
    match is_map(source).ok().filter(|is_map| *is_map).and_then(|_| chooser.by_values().ok())? {
        (_, Some(BuildNote::Labels { count })) => Some(count),
        _ => None,
    }
}

/// True if the samples are labels, judged by some slices: the same for every part of a model, and cheap for others.
///
/// # Errors
/// The volume cannot be read.
pub(crate) fn is_map(source: &dyn VolumeSource) -> Result<bool, BuildError> {
    Ok(is_unscaled(source.info().rescale) && histogram::is_map(source)?)
}

/// A selection of the inside values.
pub(super) struct Chosen {
    /// The selection in physical units.
    pub(super) selection: Selection,
    /// Its range of samples.
    pub(super) range: Box<dyn FileRange>,
    /// Oddity of the volume.
    pub(super) note: Option<BuildNote>,
}

/// True if stored samples are the values. Scaled numbers are measurements.
fn is_unscaled(rescale: Rescale) -> bool {
    rescale.apply(0.0) == 0.0 && rescale.apply(1.0) == 1.0
}

/// A volume with the means to read its values.
#[derive(Clone, Copy)]
pub(crate) struct Chooser<'a> {
    pub(crate) source: &'a dyn VolumeSource,
    pub(crate) memory: MemoryCap,
    pub(crate) threads: usize,
    pub(crate) progress: &'a dyn Progress,
}

impl Chooser<'_> {
    /// Chooses the inside values.
    pub(super) fn choose(&self, threshold: Threshold) -> Result<Chosen, BuildError> {
        let VolumeInfo { scalar, rescale, .. } = *self.source.info();
        let open = f64::INFINITY;
        let mut note = None;
        let selection = match threshold {
            Threshold::Iso(lo) => Selection { kind: SelectionKind::Iso, lo, hi: open },
            Threshold::Range(lo, hi) => Selection { kind: SelectionKind::Range, lo, hi },
            Threshold::Chosen(selection) => selection,
            Threshold::Otsu => {
                let by_values;
                (by_values, note) = self.by_values()?;
                by_values
            }
        };
        if selection.lo.is_nan() || selection.hi.is_nan() || selection.lo > selection.hi {
            return Err(BuildFault::Said {
                name: String::new(),
                fault: usage!("the range is empty: write it as LO..HI with LO <= HI"),
            }
            .into());
        }
        match file_range(scalar, &selection, rescale) {
            // Between labels the surface is a mask's, not one of their numbers.
            Some(range) if selection.kind != SelectionKind::Otsu && is_map(self.source)? => {
                Ok(Chosen { selection, range: Box::new(MaskRange(range)), note })
            }
            Some(range) => Ok(Chosen { selection, range, note }),
            None => Err(self.empty(Criterion::Within(selection))),
        }
    }

    /// The selection by Otsu's method, or of labels.
    fn by_values(&self) -> Result<(Selection, Option<BuildNote>), BuildError> {
        if let Some(half) = self.of_mask() {
            return Ok(half);
        }
        let VolumeInfo { dims, scalar, .. } = *self.source.info();
        let passes = 1 + u64::from(histogram::needs_extremes(scalar));
        self.progress.stage("histogram", passes * dims.voxels());
        let (threads, _memory) = self.reserve_histogram()?;
        match histogram::otsu(self.source, threads, self.progress)? {
            Some(split) => Ok(self.of_split(split)),
            None => self.of_number_in_nan(threads)?.ok_or_else(|| self.empty(Criterion::Split)),
        }
    }

    /// The selection of a mask of one number, with NaN outside.
    fn of_number_in_nan(&self, threads: usize) -> Result<Option<(Selection, Option<BuildNote>)>, BuildError> {
        let number = histogram::number_in_nan(self.source, threads, self.progress)?;
        let lo = number.map(|number| self.source.info().rescale.apply(number));
        Ok(lo.map(|lo| (Selection { kind: SelectionKind::Iso, lo, hi: f64::INFINITY }, None)))
    }

    /// One half, for averages of a mask of labels.
    fn of_mask(&self) -> Option<(Selection, Option<BuildNote>)> {
        let half = Selection { kind: SelectionKind::Iso, lo: 0.5, hi: f64::INFINITY };
        self.source.info().description.treatments.iter().find_map(|treatment| match treatment {
            Treatment::Mask(count) => Some((half, Some(BuildNote::Labels { count: *count }))),
            _ => None,
        })
    }

    /// The selection of a histogram's split, in physical units.
    fn of_split(&self, split: Split) -> (Selection, Option<BuildNote>) {
        let VolumeInfo { scalar, rescale, .. } = *self.source.info();
        // On a falling scale the samples below the split are the high values, and the split itself is
        // not one of them.
        let below = || by_type!(scalar, T => highest_below::<T>(split.at));
        let lowest = if rescale.slope > 0.0 { split.at } else { below() };
        // Padding is outside, even above all values.
        let outer = split.within[usize::from(rescale.slope > 0.0)];
        let hi = if outer.is_finite() { rescale.apply(outer) } else { f64::INFINITY };
        let selected = |kind, lo| Selection { kind, lo, hi };
        let by_otsu = selected(SelectionKind::Otsu, rescale.apply(lowest));
        match split.kind {
            Kind::Labels { count, first } if is_unscaled(rescale) => {
                let kind = if hi.is_finite() { SelectionKind::Range } else { SelectionKind::Iso };
                (selected(kind, first), Some(BuildNote::Labels { count }))
            }
            Kind::Greys { count } if is_unscaled(rescale) => (by_otsu, Some(BuildNote::Greys { count })),
            Kind::Padded { value } => (by_otsu, Some(BuildNote::Padding { value: rescale.apply(value) })),
            _ => (by_otsu, None),
        }
    }

    /// The extremes of a share of the volume, needed for wide samples.
    ///
    /// # Errors
    /// The volume cannot be read, or the memory is too small.
    pub(crate) fn extremes_of(&self, share: Share) -> Result<Extremes, BuildError> {
        let (threads, _memory) = self.reserve_histogram()?;
        let Self { source, progress, .. } = *self;
        histogram::extremes(source, share, threads, progress)
    }

    /// The histogram of a share of the volume; `extremes` come from the whole volume.
    ///
    /// # Errors
    /// The errors of [`Self::extremes_of`].
    pub(crate) fn tally_of(&self, share: Share, extremes: &Extremes) -> Result<Tally, BuildError> {
        let (threads, _memory) = self.reserve_histogram()?;
        let Self { source, progress, .. } = *self;
        let bins = Bins::new(source.info(), extremes);
        Tally::take(source, share, bins, threads, progress)
    }

    /// Chooses the inside values by the histogram of the whole volume.
    ///
    /// # Errors
    /// All values are alike.
    pub(crate) fn choose_by(
        &self,
        tally: Tally,
        extremes: &Extremes,
    ) -> Result<(Selection, Option<BuildNote>), BuildError> {
        if let Some(half) = self.of_mask() {
            return Ok(half);
        }
        let bins = Bins::new(self.source.info(), extremes);
        let seen = extremes.whole().or_else(|| tally.ends(bins));
        let Some(split) = tally.split(bins, self.source) else {
            let (threads, _memory) = self.reserve_histogram()?;
            return self.of_number_in_nan(threads)?.ok_or_else(|| self.nothing(Criterion::Split, seen));
        };
        Ok(self.of_split(split))
    }

    /// Reserves the memory of the histograms; returns the number of threads that fit the budget. Room for one worker of
    /// the scan is kept, as the allocator may not return the histograms' memory.
    fn reserve_histogram(&self) -> Result<(usize, Vec<Reservation>), BuildError> {
        let budget = Budget::of(self.memory);
        let mut memory: Vec<_> = self.least_histogram(&budget).map_err(|_| self.too_small())?.into();
        let scan = budget.reserve(self.with_source(MIN_WORKER));
        let more = match (scan, self.threads) {
            (Err(_), _) | (_, 0 | 1) => None,
            (Ok(_scan), n) => budget.reserve_workers(self.with_source(histogram::WORKER_BYTES), n - 1).ok(),
        };
        let (others, held) = more.unzip();
        memory.extend(held);
        Ok((1 + others.unwrap_or(0), memory))
    }

    /// The shared memory, and the memory of one worker.
    fn least_histogram(&self, budget: &Budget) -> Result<[Reservation; 2], TooSmall> {
        let shared = budget.reserve(histogram::SHARED_BYTES)?;
        Ok([shared, budget.reserve(self.with_source(histogram::WORKER_BYTES))?])
    }

    /// A worker's own buffers and its share of everything else.
    fn with_source(&self, own_bytes: u64) -> u64 {
        own_bytes + WORKER_OVERHEAD + self.source.resident_bytes()
    }

    fn too_small(&self) -> BuildError {
        let dry = Budget::dry(self.memory);
        let _least = self.least_histogram(&dry);
        BuildError::from(BuildFault::BudgetTooSmall {
            name: self.source.info().description.name.clone(),
            limit_bytes: self.memory.bytes(),
            minimum_bytes: dry.smallest_limit(1),
        })
    }

    /// The error for a range without voxels: states the values that exist, at the cost of one more pass.
    pub(super) fn empty(&self, sought: Criterion) -> BuildError {
        let seen = self.reserve_histogram().and_then(|(threads, _memory)| {
            histogram::extremes(self.source, Share::ALL, threads, self.progress)
        });
        seen.map_or_else(|error| error, |seen| self.nothing(sought, seen.whole()))
    }

    fn nothing(&self, sought: Criterion, seen: Option<(f64, f64)>) -> BuildError {
        let info = self.source.info();
        let name = info.description.name.clone();
        BuildError::from(match seen {
            None => BuildFault::NoNumbers { name },
            Some((a, b)) => {
                let (a, b) = (info.rescale.apply(a), info.rescale.apply(b));
                BuildFault::EmptyResult { name, sought, min: a.min(b), max: a.max(b) }
            }
        })
    }
}
