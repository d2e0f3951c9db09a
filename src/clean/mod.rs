//! Cleaning before the build, under the memory cap.
//!
//! The volume itself may be cropped and downsampled; both wrap the source. The other operations work on
//! the *occupancy*, one bit per voxel in an unnamed scratch file, and end in a volume whose samples agree with it:
//! the builder need not know about cleaning.
//!
//! Operations have a fixed order, whatever the order of the options:
//!
//! | | operation | extra passes | memory |
//! |---|---|---|---|
//! | 1 | crop | none | none |
//! | 2 | downsample | none, but each pass reads the whole original | 64 KiB a thread |
//! | | range test, for any of those below | the volume, once | 0.3 MiB a thread |
//! | 3 | close gaps | the occupancy, once | rows of 5 (R = 2: 10) slices; strips where they do not fit |
//! | 4 | fill cavities | the occupancy, twice | as 5 |
//! | 5 | drop components | the occupancy, twice | about 0.35 MiB and 20 bytes a column; up to 40 MiB more are used as a cache |
//!
//! Scratch: a bit a voxel (for closing two), and 4 bytes a run of voxels with 4 to 16 bytes a component for 4
//! and 5. The result does not depend on budget or threads.
#![doc = "\n"]
#![doc = include_str!("CLEANING.md")]

mod bits;
mod close;
mod components;
mod error;
mod masked;
mod paged;
mod preset;
mod stream;
mod union_find;

pub use components::ComponentConnectivity;
use error::CleanFault;
pub use error::{CleanError, MAX_LARGEST};
pub use preset::Preset;

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

use crate::budget::{Budget, MemoryCap, Reservation, TooSmall};
use crate::builder::{
    self, BuildError, BuildFault, BuildNote, BuildOptions, Progress, Threshold, choose_noted, for_each_block,
    label_count, range_test,
};
use crate::fault::{unfit, usage};
use crate::format::Selection;
use crate::geom::Dims;
use crate::text::{names::KEEP_LARGEST, some_text};
use crate::volume::{Crop, Downsample, SourceError, Treatment, VolumeSource};
use bits::BitVolume;
use components::{Component, Task, TaskMemory};
use masked::Masked;

/// Memory that cleaning leaves resident in a process of its own, because the allocator keeps it: the growth of
/// anonymous memory over [`crate::clean::CleanOptions::clean`].
const CLEANING_LEFT_OVER: u64 = 640 << 10;

/// Memory that cleaning leaves resident in a process of its own, because the allocator keeps it.
fn reserve_left_over(budget: &Budget) -> Result<Reservation, TooSmall> {
    budget.reserve(if budget.is_process() { CLEANING_LEFT_OVER } else { 0 })
}

/// Limit below which components are too small.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SizeLimit {
    /// Components of fewer voxels are dropped.
    Voxels(u64),
    /// Components below this percentage of the largest one's voxels are dropped.
    PercentOfLargest(f64),
}

/// Voxels as `500`, a percentage of the largest component as `5%`.
impl FromStr for SizeLimit {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let limit = match text.strip_suffix('%') {
            Some(percent) => {
                let percent = percent.trim().parse().ok().filter(|percent| (0.0..=100.0).contains(percent));
                percent.map(Self::PercentOfLargest)
            }
            None => text.parse().ok().map(Self::Voxels),
        };
        limit.ok_or_else(|| {
            format!("'{text}' is not a size; write a number of voxels, or a percentage such as 5%")
        })
    }
}

/// Operations on a volume before it is built; none by default.
#[derive(Clone, Debug, Default, PartialEq, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CleanOptions {
    /// Keep voxels with these indices along x, y, z only.
    pub roi: Option<[Range<u32>; 3]>,
    /// Take means of blocks of 2^3 or 4^3 voxels.
    pub downsample: Option<u32>,
    /// A range in HU, in place of a threshold.
    pub preset: Option<Preset>,
    /// Radius of the closing in voxels, 1 or 2; 0 for none.
    pub close: u32,
    /// True to turn cavities into inside: parts of the outside, connected through faces, that the border of the volume
    /// does not touch.
    pub fill_cavities: bool,
    /// Keep this many of the largest components; of equal ones those whose first voxel comes first in the order
    /// z, y, x.
    pub keep_largest: Option<u32>,
    /// Drop components that are too small.
    #[serde(deserialize_with = "some_text")]
    pub drop_below: Option<SizeLimit>,
    /// Neighbourhood that connects the voxels of a component.
    pub connectivity: ComponentConnectivity,
}

/// Passes that cleaning adds to a build.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct ExtraPasses {
    /// Passes over the samples of the volume.
    pub volume: u32,
    /// Passes over its occupancy, a bit a voxel.
    pub occupancy: u32,
}

impl CleanOptions {
    /// True if an operation works on the occupancy.
    pub(crate) fn works_on_bits(&self) -> bool {
        self.close > 0 || self.fill_cavities || self.drops()
    }

    fn drops(&self) -> bool {
        self.keep_largest.is_some() || self.drop_below.is_some()
    }

    /// Passes beyond the build's.
    pub(crate) fn extra_passes(&self) -> ExtraPasses {
        ExtraPasses {
            volume: u32::from(self.works_on_bits()),
            occupancy: u32::from(self.close > 0)
                + 2 * u32::from(self.fill_cavities)
                + 2 * u32::from(self.drops()),
        }
    }

    /// Operations on the volume, as on the command line, in the order in which they are done.
    fn volume_operations(&self) -> Vec<String> {
        let mut list = Vec::new();
        if let Some([x, y, z]) = &self.roi {
            list.push(format!("roi {x:?},{y:?},{z:?}"));
        }
        if let Some(factor) = self.downsample {
            list.push(format!("downsample {factor}"));
        }
        list
    }

    /// Operations on the occupancy, named in the same way.
    fn bit_operations(&self) -> Vec<String> {
        let mut list = Vec::new();
        if self.close > 0 {
            list.push(format!("close {}", self.close));
        }
        if self.fill_cavities {
            list.push("fill-cavities".into());
        }
        if let Some(count) = self.keep_largest {
            list.push(format!("keep-largest {count}"));
        }
        match self.drop_below {
            Some(SizeLimit::Voxels(voxels)) => list.push(format!("drop-below {voxels}")),
            Some(SizeLimit::PercentOfLargest(percent)) => list.push(format!("drop-below {percent}%")),
            None => {}
        }
        if self.drops() && self.connectivity != ComponentConnectivity::default() {
            list.push(format!("component-connectivity {}", self.connectivity.neighbours()));
        }
        list
    }

    /// Names of the chosen operations, as on the command line, in the order of their execution.
    pub fn operations(&self) -> Vec<String> {
        let preset = self.preset.map(|preset| format!("preset {}", preset.name()));
        self.volume_operations().into_iter().chain(preset).chain(self.bit_operations()).collect()
    }

    /// True if no operation is chosen.
    pub(crate) fn is_empty(&self) -> bool {
        self.roi.is_none() && self.downsample.is_none() && self.preset.is_none() && !self.works_on_bits()
    }

    /// Crops and downsamples; to be called before [`VolumeSource::prepare`].
    ///
    /// # Errors
    /// [`SourceError`] when the box or the factor does not fit the volume.
    pub fn reshape<'a>(
        &self,
        mut source: Box<dyn VolumeSource + 'a>,
    ) -> Result<Box<dyn VolumeSource + 'a>, SourceError> {
        if let Some(roi) = &self.roi {
            source = Box::new(Crop::new(source, roi.clone())?);
        }
        if let Some(factor) = self.downsample {
            source = Box::new(Downsample::new(source, factor)?);
        }
        Ok(source)
    }

    /// Makes downsampling average the mask of a label map where the program chooses the threshold; to be called after
    /// [`VolumeSource::prepare`].
    pub(crate) fn mask_labels(
        &self,
        source: &mut dyn VolumeSource,
        options: &BuildOptions,
        progress: &dyn Progress,
    ) {
        if self.downsample.is_some() && options.threshold == Threshold::Otsu && self.preset.is_none() {
            source.average_mask(&|whole| label_count(whole, options, progress));
        }
    }

    /// The smallest [`MemoryCap::Share`] within which a (reshaped) volume can be cleaned and built.
    pub fn smallest_share(&self, source: &dyn VolumeSource, options: &BuildOptions) -> u64 {
        self.smallest_cap(source, options, MemoryCap::Share(0))
    }

    /// The smallest cap of this kind within which a (reshaped) volume can be cleaned and built.
    pub(crate) fn smallest_cap(
        &self,
        source: &dyn VolumeSource,
        options: &BuildOptions,
        kind: MemoryCap,
    ) -> u64 {
        if !self.works_on_bits() {
            return builder::smallest_cap(source, options, kind);
        }
        let dry = Budget::dry(kind);
        let _least = self.reserve_least(source, options, &dry);
        // Resident memory is read again before the build, together with the left-over memory of cleaning, which was
        // reserved.
        dry.smallest_limit(1)
    }

    /// Reserves the least memory of every operation, and then of the build after them.
    fn reserve_least(
        &self,
        source: &dyn VolumeSource,
        options: &BuildOptions,
        budget: &Budget,
    ) -> Result<(), TooSmall> {
        let _left_over = reserve_left_over(budget)?;
        let _masked = budget.reserve(Masked::thread_bytes(row_words(source.info().dims)))?;
        drop(budget.reserve(self.least_bytes(source))?);
        builder::reserve_least(source, options, budget).map(drop)
    }

    /// Least memory of every operation, without memory that is held all the time.
    fn least_bytes(&self, source: &dyn VolumeSource) -> u64 {
        let dims = source.info().dims;
        let mut least = builder::occupancy_worker_bytes(source);
        if self.close > 0 {
            least = least.max(close::bytes(row_words(dims), self.close, 1));
        }
        if self.fill_cavities || self.drops() {
            least = least.max(components::least_bytes(dims, self.largest()));
        }
        least
    }

    /// Number of the largest components that the rule must know.
    fn largest(&self) -> usize {
        self.keep_largest.unwrap_or(1).clamp(1, MAX_LARGEST) as usize
    }

    /// Cleans the occupancy of a prepared (and reshaped) volume; `None` where there is nothing to do.
    ///
    /// [`Cleaned::source`] is then built with [`builder::Threshold::Chosen`] of [`Cleaned::selection`]. Memory, threads
    /// and scratch folder are the build's.
    ///
    /// # Errors
    /// The options are out of range, the cap is too small (with the smallest that works), the volume cannot be read,
    /// scratch files fail, or no voxel is left.
    pub fn clean<'a>(
        &self,
        source: &'a dyn VolumeSource,
        options: &BuildOptions,
        output: &Path,
        progress: &dyn Progress,
    ) -> Result<Option<Cleaned<'a>>, CleanError> {
        self.check()?;
        if !self.works_on_bits() {
            return Ok(None);
        }
        self.job(source, options, output, progress).run().map(Some)
    }

    fn job<'c, 'a>(
        &'c self,
        source: &'a dyn VolumeSource,
        options: &'c BuildOptions,
        output: &Path,
        progress: &'c dyn Progress,
    ) -> CleanJob<'c, 'a> {
        CleanJob { clean: self, source, options, scratch: options.scratch_folder(output), progress }
    }

    /// Writes the occupancy of some slices of a prepared volume into `bits`, which begin with them.
    ///
    /// # Errors
    /// The errors of [`Self::clean`].
    pub(crate) fn occupancy_of(
        &self,
        source: &dyn VolumeSource,
        options: &BuildOptions,
        slices: Range<u32>,
        bits: &BitVolume,
        progress: &dyn Progress,
    ) -> Result<(), CleanError> {
        self.check()?;
        let job = self.job(source, options, Path::new(""), progress);
        job.check_budget()?;
        job.test_range(bits, &*job.choose()?.1, slices).map(drop).map_err(Into::into)
    }

    /// Cleans the occupancy of a whole volume; with the scratch files beside `output`.
    ///
    /// # Errors
    /// The errors of [`Self::clean`].
    pub(crate) fn clean_bits(
        &self,
        source: &dyn VolumeSource,
        options: &BuildOptions,
        fill: &dyn Fn(&BitVolume) -> Result<(), CleanError>,
        output: &Path,
        progress: &dyn Progress,
    ) -> Result<(BitVolume, CleanReport), CleanError> {
        self.check()?;
        let job = self.job(source, options, output, progress);
        job.check_budget()?;
        let bits = BitVolume::create(&job.scratch, source.info().dims)?;
        fill(&bits)?;
        let mut report = CleanReport { voxels: 1, passes: self.extra_passes(), ..CleanReport::default() };
        let bits = job.work(bits, &mut report)?;
        Ok((bits, report))
    }

    /// A volume with the given occupancy of cleaning; the threshold of the options has been chosen.
    ///
    /// # Errors
    /// No sample can lie within it.
    pub(crate) fn cleaned<'a>(
        &self,
        source: &'a dyn VolumeSource,
        options: &BuildOptions,
        bits: BitVolume,
        progress: &dyn Progress,
    ) -> Result<Cleaned<'a>, CleanError> {
        let job = self.job(source, options, Path::new(""), progress);
        let (selection, test, _) = job.choose()?;
        Ok(job.masked(selection, test, bits, CleanReport::default()))
    }

    fn check(&self) -> Result<(), CleanError> {
        match self.keep_largest {
            _ if self.close > 2 => Err(usage!("gaps can be closed by 1 or 2 voxels").into()),
            Some(n) if n == 0 || n > MAX_LARGEST => {
                Err(usage!("{KEEP_LARGEST}={n} is not a number of components; choose 1 to {MAX_LARGEST}")
                    .into())
            }
            _ => Ok(()),
        }
    }
}

fn row_words(dims: Dims) -> usize {
    dims.nx().div_ceil(64) as usize
}

/// Results of cleaning.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CleanReport {
    /// Passes over volume and occupancy that were added.
    pub passes: ExtraPasses,
    /// Voxels inside before.
    pub voxels: u64,
    /// Voxels that closing and filling added.
    pub voxels_added: u64,
    /// Voxels of dropped components.
    pub voxels_removed: u64,
    /// Components found; 0 when they were not counted.
    pub components: u64,
    /// Components that were kept.
    pub kept: u64,
    /// Voxels of the largest component that was dropped; 0 if none was.
    pub largest_dropped: u64,
    /// Bytes of scratch files that the occupancy takes; lists of runs come on top.
    pub scratch_bytes: u64,
    /// Wall time.
    pub seconds: f64,
    /// Note on an odd volume or threshold.
    pub note: Option<BuildNote>,
}

/// A volume with a cleaned occupancy.
pub struct Cleaned<'a> {
    masked: Masked<'a>,
    /// The inside; a threshold by Otsu's method has been chosen on the volume before it was cleaned.
    pub selection: Selection,
    /// The results.
    pub report: CleanReport,
}

impl Cleaned<'_> {
    /// The volume to build.
    pub fn source(&self) -> &dyn VolumeSource {
        &self.masked
    }
}

struct Rule {
    least_voxels: f64,
    last: Option<Component>,
}

impl Rule {
    fn keeps(&self, component: Component) -> bool {
        let voxels = component.voxels as f64;
        voxels >= self.least_voxels && self.last.is_none_or(|last| component >= last)
    }
}

struct CleanJob<'c, 'a> {
    clean: &'c CleanOptions,
    source: &'a dyn VolumeSource,
    options: &'c BuildOptions,
    scratch: PathBuf,
    progress: &'c dyn Progress,
}

impl<'a> CleanJob<'_, 'a> {
    fn run(&self) -> Result<Cleaned<'a>, CleanError> {
        let started = Instant::now();
        self.check_budget()?;
        let info = self.source.info();
        let (selection, test, note) = self.choose()?;
        let mut report = CleanReport { passes: self.clean.extra_passes(), note, ..CleanReport::default() };
        let bits = BitVolume::create(&self.scratch, info.dims)?;
        report.voxels = self.test_range(&bits, &*test, 0..info.dims.nz())?;
        let bits = self.work(bits, &mut report)?;
        report.seconds = started.elapsed().as_secs_f64();
        Ok(self.masked(selection, test, bits, report))
    }

    /// The threshold, and its test.
    #[expect(clippy::type_complexity, reason = "named by its parts")]
    fn choose(&self) -> Result<(Selection, Box<dyn builder::RangeTest>, Option<BuildNote>), CleanError> {
        let info = self.source.info();
        let BuildOptions { threshold, memory, threads, .. } = *self.options;
        let (selection, note) = choose_noted(self.source, threshold, memory, threads, self.progress)?;
        match range_test(info.scalar, &selection, info.rescale) {
            Some(test) => Ok((selection, test, note)),
            None => Err(unfit!("the range holds no sample of this volume's type").into()),
        }
    }

    /// Cleans the occupancy; `report` has the number of voxels inside.
    fn work(&self, mut bits: BitVolume, report: &mut CleanReport) -> Result<BitVolume, CleanError> {
        let info = self.source.info();
        report.scratch_bytes = bits.bytes();
        // The builder refuses a volume without any voxel inside, and names its values.
        if report.voxels > 0 {
            if self.clean.close > 0 {
                let closed = BitVolume::create(&self.scratch, info.dims)?;
                report.scratch_bytes += closed.bytes();
                let (rows, _memory) = close::reserve_strips(&bits, self.clean.close, &self.budget())
                    .map_err(|e| self.too_small(e))?;
                report.voxels_added += close::close(&bits, &closed, self.clean.close, rows, self.progress)?;
                bits = closed;
            }
            if self.clean.fill_cavities {
                let memory = self.task_memory(&bits, 0)?;
                let task = self.task(&bits, true, ComponentConnectivity::Faces6, (0, &memory));
                self.progress.stage("cavities", 2 * u64::from(info.dims.nz()));
                report.voxels_added += task.label()?.decide(&Component::touches_border)?.changed;
            }
            if self.clean.drops() {
                self.drop_components(&bits, report)?;
            }
        }
        Ok(bits)
    }

    fn masked(
        &self,
        selection: Selection,
        test: Box<dyn builder::RangeTest>,
        bits: BitVolume,
        report: CleanReport,
    ) -> Cleaned<'a> {
        let mut described = self.source.info().clone();
        described.description.treatments.push(Treatment::Cleaned(self.clean.bit_operations()));
        Cleaned { masked: Masked::new(self.source, described, test, bits), selection, report }
    }

    /// Checks that there is memory for cleaning, and for the build after it.
    fn check_budget(&self) -> Result<(), BuildError> {
        let memory = self.options.memory;
        self.clean.reserve_least(self.source, self.options, &Budget::of_job(memory)).map_err(|_| {
            BuildError::from(BuildFault::BudgetTooSmall {
                name: self.source.info().description.name.clone(),
                limit_bytes: memory.bytes(),
                minimum_bytes: self.clean.smallest_cap(self.source, self.options, memory),
            })
        })
    }

    /// Memory that one operation may hold, beyond the resident memory. Never less than the amount found to fit when
    /// cleaning began: memory left over since then is counted once, in [`CLEANING_LEFT_OVER`].
    fn budget(&self) -> Budget {
        let now = Budget::of_job(self.options.memory);
        let _left_over = reserve_left_over(&now);
        Budget::new(now.left_bytes().max(self.clean.least_bytes(self.source)))
    }

    /// The error of an operation whose least memory was not counted.
    fn too_small(&self, refused: TooSmall) -> BuildError {
        let limit_bytes = self.options.memory.bytes();
        BuildError::from(BuildFault::BudgetTooSmall {
            name: self.source.info().description.name.clone(),
            limit_bytes,
            minimum_bytes: limit_bytes.saturating_add(refused.missing_bytes()),
        })
    }

    /// The range test of slices of the volume; returns the number of voxels inside.
    fn test_range(
        &self,
        bits: &BitVolume,
        test: &dyn builder::RangeTest,
        slices: Range<u32>,
    ) -> Result<u64, BuildError> {
        let each = builder::occupancy_worker_bytes(self.source);
        let (threads, _memory) =
            self.budget().reserve_workers(each, self.options.threads).map_err(|e| self.too_small(e))?;
        let inside = AtomicU64::new(0);
        self.progress.stage("range test", u64::from(bits.dims().nz()));
        let from = slices.start;
        for_each_block(self.source, test, threads, self.progress, slices, &|z, y, first, per_row, words| {
            let set: u64 = words.iter().map(|w| u64::from(w.count_ones())).sum();
            inside.fetch_add(set, Ordering::Relaxed);
            let row = bits.row(y, z - from);
            if per_row == bits.row_words {
                return bits.write(row, 0, words);
            }
            words.chunks_exact(per_row).zip(row..).try_for_each(|(words, row)| bits.write(row, first, words))
        })?;
        Ok(inside.into_inner())
    }

    fn drop_components(&self, bits: &BitVolume, report: &mut CleanReport) -> Result<(), CleanError> {
        self.progress.stage("components", 2 * u64::from(bits.dims().nz()));
        let largest = self.clean.largest();
        let memory = self.task_memory(bits, largest)?;
        let labelled = self.task(bits, false, self.clean.connectivity, (largest, &memory)).label()?;
        let largest = &labelled.census.largest;
        let most = largest.first().map_or(0, |c| c.voxels);
        let least_voxels = match self.clean.drop_below {
            Some(SizeLimit::Voxels(voxels)) => voxels as f64,
            Some(SizeLimit::PercentOfLargest(percent)) => percent / 100.0 * most as f64,
            None => 0.0,
        };
        let rule = Rule { least_voxels, last: self.clean.keep_largest.and(largest.last().copied()) };
        if !largest.first().is_some_and(|c| rule.keeps(*c)) {
            let name = self.source.info().description.name.clone();
            return Err(CleanFault::NothingKept { name, largest: most }.into());
        }
        report.components = labelled.census.components;
        let outcome = labelled.decide(&|component| rule.keeps(component))?;
        (report.kept, report.voxels_removed) = (outcome.kept, outcome.changed);
        report.largest_dropped = outcome.largest_dropped;
        Ok(())
    }

    fn task_memory(&self, bits: &BitVolume, largest: usize) -> Result<TaskMemory, BuildError> {
        TaskMemory::reserve(bits.dims(), largest, &self.budget()).map_err(|e| self.too_small(e))
    }

    fn task<'t>(
        &'t self,
        bits: &'t BitVolume,
        inverted: bool,
        connectivity: ComponentConnectivity,
        (largest, memory): (usize, &'t TaskMemory),
    ) -> Task<'t> {
        let (folder, progress) = (&*self.scratch, self.progress);
        Task { bits, inverted, connectivity, largest, folder, memory, progress }
    }
}

#[cfg(test)]
mod tests;
