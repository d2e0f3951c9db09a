//! The out-of-core builder: a volume in, an `.oct` out, in a fixed amount of memory.
//!
//! ```text
//! source --rows--> column (classify, skin, gradient) --records--> swap (scratch file, lz4)
//!                                                                    |
//!        .oct <--seal (rank, CRC)-- merge (Morton order, levels) <---+-- census (sizes, places)
//! ```
//!
//! | stage | passes over | memory | order |
//! |---|---|---|---|
//! | histogram (Otsu only) | the volume, once (wide types: twice) | 0.5 MiB + 0.5 MiB a worker | any |
//! | column | the volume once, 12 % of rows twice | see plan | any |
//! | layout: census | the index | 2 KiB | Morton |
//! | merge | the scratch file | about 1 MiB a worker | groups in Morton order |
//! | seal | the output | 128 KiB | sequential |
//!
//! The result does not depend on the budget, the number of threads or the shape of columns: records are
//! functions of voxels alone, and their places follow from the census.

mod boxes;
mod brick;
mod choose;
mod classify;
mod column;
mod error;
mod flavour;
mod gradient;
mod histogram;
mod lanes;
mod layout;
mod merge;
mod occupancy;
mod parallel;
mod plan;
mod pool;
mod range;
mod seal;
mod simd;
mod skin;
mod swap;
mod value;
mod walk;

pub use choose::choose_selection;
pub use error::{BuildError, ScratchFault, Sought};
pub use gradient::ESTIMATOR;
pub use skin::Connectivity;

pub(crate) use occupancy::{RangeTest, for_each_block, range_test, worker_bytes as occupancy_worker_bytes};
pub(crate) use plan::fixed_bytes;

pub use crate::progress::{Progress, Silent};

use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

use crate::atomic::AtomicFile;
use crate::budget::{MemoryCap, peak_rss_bytes};
use crate::format::{Metadata, Selection, SourceMeta};
use crate::volume::{ScalarType, VolumeInfo, VolumeSource};
use choose::Chooser;
use column::{ColumnWorker, ScanContext, ScanTotals};
use flavour::{Depths, Direct, Flavour};
use gradient::NormalRule;
use layout::{Census, Layout, SectionChoice};
use merge::{Merge, Target};
use plan::{ColumnPlan, PlanRequest};
use range::{Ordered, SampleRange};
use swap::Scratch;
use value::ValueScale;

/// How to choose what is inside; values are physical (after rescale).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Threshold {
    /// `value >= iso`.
    Iso(f64),
    /// `lo <= value <= hi`.
    Range(f64, f64),
    /// Otsu's threshold of the volume's histogram.
    Otsu,
    /// What [`choose_selection`] has found already.
    Chosen(Selection),
}

/// What to build, and within which means.
#[derive(Clone, Debug)]
pub struct BuildOptions {
    /// What is inside.
    pub threshold: Threshold,
    /// Which neighbours make a voxel skin.
    pub connectivity: Connectivity,
    /// Store normals?
    pub normals: bool,
    /// Store values?
    pub values: bool,
    /// Store means of coarse nodes for level of detail?
    pub lod: bool,
    /// Cap on resident memory.
    pub memory: MemoryCap,
    /// Most worker threads; fewer are used when the cap is small.
    pub threads: usize,
    /// Folder of the scratch file; beside the output if not given.
    pub scratch: Option<PathBuf>,
}

impl BuildOptions {
    /// The folder of scratch files for a model: as given, or the model's own.
    pub fn scratch_folder(&self, output: &Path) -> PathBuf {
        let beside = || match output.parent() {
            Some(parent) if !parent.as_os_str().is_empty() => parent.to_path_buf(),
            _ => PathBuf::from("."),
        };
        self.scratch.clone().unwrap_or_else(beside)
    }
}

/// The smallest [`MemoryCap::Share`] within which a model of `source` can be built.
pub fn smallest_share(source: &dyn VolumeSource, options: &BuildOptions) -> u64 {
    smallest_cap(source, options, MemoryCap::Share(0))
}

/// The smallest cap of the kind of `none`, which allows nothing, within which a model can be built.
pub(crate) fn smallest_cap(source: &dyn VolumeSource, options: &BuildOptions, none: MemoryCap) -> u64 {
    let options = BuildOptions { memory: none, threads: 1, ..options.clone() };
    match Job::to_plan(source, &options).check_budget() {
        Err(BuildError::BudgetTooSmall { minimum_bytes, .. }) => minimum_bytes,
        _ => 0,
    }
}

/// Can a model of `source` be built within a cap?
pub(crate) fn fits(source: &dyn VolumeSource, options: &BuildOptions, memory: MemoryCap) -> bool {
    let options = BuildOptions { memory, threads: 1, ..options.clone() };
    Job::to_plan(source, &options).check_budget().is_ok()
}

/// What was built and what it took.
#[derive(Clone, Debug)]
pub struct BuildReport {
    /// What is inside, with the threshold that was found.
    pub selection: Selection,
    /// Skin voxels.
    pub skin_voxels: u64,
    /// Infobytes.
    pub nodes: u64,
    /// Length of the file.
    pub file_bytes: u64,
    /// Bytes of every section, by name.
    pub section_bytes: Vec<(&'static str, u64)>,
    /// What the plan promised to stay within.
    pub plan_bytes: u64,
    /// Bytes written to the scratch file.
    pub scratch_bytes: u64,
    /// Workers used.
    pub threads: usize,
    /// Columns (x) of a tile.
    pub tile: u32,
    /// Seconds: choosing the threshold, scanning the volume, merging, sealing, syncing and renaming.
    pub seconds: StageSeconds,
}

/// Wall time of the stages.
#[derive(Clone, Copy, Debug, Default)]
pub struct StageSeconds {
    /// Histogram passes of Otsu's method.
    pub histogram: f64,
    /// Part of the scan that one worker waited for the source, on average.
    pub read: f64,
    /// Reading, range test, skin, gradients, swapping out.
    pub scan: f64,
    /// Census and merge.
    pub merge: f64,
    /// Rank directory and checksums.
    pub seal: f64,
    /// Sync and rename.
    pub commit: f64,
}

/// Builds the skin octree of `source` into `output`.
///
/// Memory: [`BuildOptions::memory`] bounds the process as the operating system accounts it, or the build's
/// own part of it. Temporary disk: about the size of the result, in one
/// nameless file.
///
/// # Errors
/// [`BuildError`]; the old output, if any, is untouched then and no temporary file remains.
pub fn build(
    source: &dyn VolumeSource,
    options: &BuildOptions,
    output: &Path,
    progress: &dyn Progress,
) -> Result<BuildReport, BuildError> {
    let job = Job { source, options, output, progress };
    // What can be refused at once is refused before the volume is read.
    job.check_budget()?;
    let files = job.open_files()?;
    match source.info().scalar {
        ScalarType::U8 => job.run_direct::<u8>(files),
        ScalarType::I8 => job.run_direct::<i8>(files),
        ScalarType::U16 => job.run_direct::<u16>(files),
        ScalarType::I16 => job.run_direct::<i16>(files),
        ScalarType::F32 => job.run_direct::<f32>(files),
        ScalarType::U32 => job.run_depths::<u32>(files),
        ScalarType::I32 => job.run_depths::<i32>(files),
        ScalarType::F64 => job.run_depths::<f64>(files),
    }
}

/// By how much the peak differs between two runs that open the same input: code that is touched then is mapped
/// with its neighbours, which depend on where the program lies in memory.
const OPENING_SPREAD: u64 = 384 << 10;

struct Job<'a> {
    source: &'a dyn VolumeSource,
    options: &'a BuildOptions,
    output: &'a Path,
    progress: &'a dyn Progress,
}

/// The files that a build writes.
struct Files {
    atomic: AtomicFile,
    scratch: Scratch,
}

impl<'a> Job<'a> {
    /// A job that is only planned.
    fn to_plan(source: &'a dyn VolumeSource, options: &'a BuildOptions) -> Self {
        Self { source, options, output: Path::new(""), progress: &Silent }
    }

    fn open_files(&self) -> Result<Files, BuildError> {
        let bricks = self.source.info().dims.to_array().map(|n| u64::from(n.div_ceil(plan::BRICK)));
        Ok(Files {
            atomic: AtomicFile::create(self.output).map_err(|e| self.output_error(e))?,
            scratch: Scratch::create(&self.options.scratch_folder(self.output), bricks)?,
        })
    }

    /// Types that can stand in the ring as they are, if the range has only a lower end.
    fn run_direct<T: Ordered + lanes::RingSample>(&self, files: Files) -> Result<BuildReport, BuildError> {
        let (selection, range, histogram_s) = self.choose::<T>()?;
        if range.is_open_above() {
            self.run(files, Direct(range), selection, histogram_s)
        } else {
            self.run(files, Depths(range), selection, histogram_s)
        }
    }

    fn run_depths<T: Ordered>(&self, files: Files) -> Result<BuildReport, BuildError> {
        let (selection, range, histogram_s) = self.choose::<T>()?;
        self.run(files, Depths(range), selection, histogram_s)
    }

    /// The selection in physical units and in samples.
    fn choose<T: Ordered>(&self) -> Result<(Selection, SampleRange<T>, f64), BuildError> {
        let started = Instant::now();
        let (selection, range) = self.chooser().choose::<T>(self.options.threshold)?;
        Ok((selection, range, started.elapsed().as_secs_f64()))
    }

    fn chooser(&self) -> Chooser<'_> {
        Chooser {
            source: self.source,
            memory: self.options.memory,
            threads: self.options.threads,
            progress: self.progress,
        }
    }

    fn run<F: Flavour>(
        &self,
        files: Files,
        flavour: F,
        selection: Selection,
        histogram_s: f64,
    ) -> Result<BuildReport, BuildError> {
        let info = self.source.info();
        let plan = self.plan(size_of::<F::Ring>(), F::DIRECT)?;
        let mut seconds = StageSeconds { histogram: histogram_s, ..StageSeconds::default() };
        let Files { atomic, scratch } = files;
        let started = Instant::now();
        let totals = self.scan(flavour, &plan, &scratch)?;
        seconds.scan = started.elapsed().as_secs_f64();
        #[expect(clippy::cast_precision_loss, reason = "a small count")]
        {
            seconds.read = totals.reading.as_secs_f64() / plan.threads as f64;
        }
        if totals.skin == 0 {
            return Err(self.chooser().empty::<F::File>(Sought::Within(selection)));
        }

        let started = Instant::now();
        let census = Census::take(info.dims, &scratch)?;
        let scale = self.options.values.then(|| ValueScale::new(info.scalar, totals.values));
        let metadata = self.metadata(selection, scale).to_bytes()?;
        let choice = SectionChoice {
            normals: self.options.normals,
            lod: self.options.lod,
            #[expect(clippy::cast_possible_truncation, reason = "1 or 2")]
            value_bytes: scale.map_or(0, |s| s.stored_bytes() as u8),
        };
        let layout = Layout::new(&census, metadata.len() as u64, choice);
        let target = Target { file: atomic.file(), path: self.output, layout: &layout, choice };
        self.merge(&target, &census, &scratch, scale, plan.threads)?;
        seconds.merge = started.elapsed().as_secs_f64();

        let started = Instant::now();
        let file_bytes = seal::seal(&target, info.dims, &census, &metadata)?;
        seconds.seal = started.elapsed().as_secs_f64();
        let started = Instant::now();
        atomic.commit().map_err(|e| self.output_error(e))?;
        seconds.commit = started.elapsed().as_secs_f64();
        Ok(BuildReport {
            selection,
            skin_voxels: census.voxels,
            nodes: census.nodes(),
            file_bytes,
            section_bytes: layout
                .entries
                .iter()
                .filter_map(|e| e.kind.map(|k| (k.name(), e.stored_bytes)))
                .collect(),
            plan_bytes: plan.total_bytes,
            scratch_bytes: scratch.written_bytes(),
            threads: plan.threads,
            tile: plan.tile,
            seconds,
        })
    }

    /// Is there a plan for the kindest range of this sample type? A cap under which none exists, or that
    /// opening the input has passed already, fails here.
    fn check_budget(&self) -> Result<(), BuildError> {
        let scalar = self.source.info().scalar;
        let direct = scalar.bytes() <= 2 || scalar == ScalarType::F32;
        let ring_bytes = if direct { scalar.bytes() } else { size_of::<f32>() };
        self.plan(ring_bytes, direct).map(|_| ())
    }

    fn plan(&self, ring_sample_bytes: usize, direct: bool) -> Result<ColumnPlan, BuildError> {
        let info = self.source.info();
        let limit_bytes = self.options.memory.bytes();
        let alone = matches!(self.options.memory, MemoryCap::Process(_));
        let plan = ColumnPlan::new(&PlanRequest {
            dims: info.dims,
            file_sample_bytes: info.scalar.bytes(),
            ring_sample_bytes,
            direct,
            normals: self.options.normals,
            swapped_value_bytes: if self.options.values { value::swapped_bytes(info.scalar) } else { 0 },
            threads: self.options.threads,
            memory: self.options.memory,
            fixed_bytes: plan::fixed_bytes(self.options.memory),
            source_bytes: self.source.resident_bytes(),
        });
        // The cap is on the peak: what the process has held before, to open the input, counts too.
        let peak = if alone { peak_rss_bytes() } else { 0 };
        let told = if peak > 0 { peak + OPENING_SPREAD } else { 0 };
        let minimum = match plan {
            Ok(plan) if peak <= limit_bytes => return Ok(plan),
            Ok(_) => told,
            Err(minimum) => minimum.max(told),
        };
        let name = info.description.name.clone();
        Err(BuildError::BudgetTooSmall {
            name,
            limit_bytes,
            minimum_bytes: minimum.next_multiple_of(1 << 16),
        })
    }

    fn scan<F: Flavour>(
        &self,
        flavour: F,
        plan: &ColumnPlan,
        scratch: &Scratch,
    ) -> Result<ScanTotals, BuildError> {
        let rule = NormalRule::new(self.source.info().spacing_mm);
        let connectivity = self.options.connectivity;
        let shared = ScanContext { source: self.source, flavour, connectivity, rule: &rule, plan, scratch };
        let count = plan.column_count();
        self.progress.stage("scan", count);
        let next = AtomicU64::new(0);
        let totals = Mutex::new(ScanTotals::NONE);
        parallel::run_workers(plan.threads, &|stop| {
            let mut worker = ColumnWorker::new(&shared);
            while !stop() {
                let at = next.fetch_add(1, Ordering::Relaxed);
                if at >= count {
                    break;
                }
                worker.scan(&plan.column(at))?;
                self.progress.advance(1);
            }
            let own = worker.finish()?;
            let mut all = totals.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
            *all = all.join(own);
            Ok(())
        })?;
        Ok(totals.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner))
    }

    fn merge(
        &self,
        target: &Target<'_>,
        census: &Census,
        scratch: &Scratch,
        scale: Option<ValueScale>,
        threads: usize,
    ) -> Result<(), BuildError> {
        self.progress.stage("merge", census.bricks);
        let merge = Merge::new(self.source.info().dims, scratch, target, census, scale)?;
        parallel::run_workers(threads, &|stop| merge.work(stop, &|bricks| self.progress.advance(bricks)))?;
        merge.crown()
    }

    fn metadata(&self, selection: Selection, scale: Option<ValueScale>) -> Metadata {
        let VolumeInfo { dims, scalar, rescale, spacing_mm, affine, description, .. } = self.source.info();
        Metadata {
            program: concat!("infobyte ", env!("CARGO_PKG_VERSION")).into(),
            source: SourceMeta {
                format: description.format.clone(),
                name: description.name.clone(),
                files: description.files,
                bytes: description.bytes,
            },
            dims: dims.to_array(),
            scalar: scalar.code(),
            spacing_mm: *spacing_mm,
            affine: affine.rows,
            rescale: [rescale.slope, rescale.intercept],
            selection,
            connectivity: self.options.connectivity.code(),
            gradient: if self.options.normals { ESTIMATOR.into() } else { String::new() },
            value_scale: scale.map_or([0.0; 2], |s| s.to_physical(*rescale)),
        }
    }

    fn output_error(&self, cause: std::io::Error) -> BuildError {
        BuildError::Output { path: self.output.to_path_buf(), cause }
    }
}
