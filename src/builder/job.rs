//! One build of any solid: plan, scan, merge, seal.

use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

use super::column::{ColumnWorker, ScanContext, ScanTotals};
use super::error::BuildError;
use super::item::{ChannelForm, ItemForm};
use super::layout::{Census, Layout, StoredChannels};
use super::merge::{Merge, Target};
use super::plan::{self, ColumnPlan, PlanRequest};
use super::solid::{BRICK, Found, Solid, Tile};
use super::swap::Scratch;
use super::{BuildOptions, BuildReport, Progress, StageSeconds, parallel, seal};
use crate::atomic::AtomicFile;
use crate::budget::{MemoryCap, peak_rss_bytes};
use crate::format::{Channel, Channels, Metadata};
use crate::geom::Dims;

/// By how much the peak differs between two runs that open the same input: code that is touched then is mapped
/// with its neighbours, which depend on where the program lies in memory.
const OPENING_SPREAD: u64 = 384 << 10;

/// Builds the skin octree of a solid into `output`; [`BuildOptions::threshold`] is not asked.
///
/// Memory and temporary disk as [`super::build()`]; the solid's part is what it says of itself.
///
/// # Errors
/// [`BuildError`]; the old output, if any, is untouched then and no temporary file remains.
///
/// # Panics
/// If a worker of the solid does not give one item for every skin voxel.
pub fn build_solid<S: Solid>(
    solid: &S,
    options: &BuildOptions,
    output: &Path,
    progress: &dyn Progress,
) -> Result<BuildReport, BuildError> {
    let job = Job { options, output, progress };
    // What can be refused at once is refused before a file is made.
    job.plan_solid(solid)?;
    let files = job.open_files(solid.dims())?;
    job.run(files, solid)
}

/// The channels that are asked for, in the forms in which the solid has them before the scan.
///
/// # Errors
/// The solid does not have one of them.
pub(super) fn channel_forms(
    options: &BuildOptions,
    name: &str,
    form: impl Fn(Channel, &Found) -> Option<ItemForm>,
) -> Result<Vec<ChannelForm>, BuildError> {
    forms_of(options.channels, name, &Found::default(), form)
}

fn forms_of(
    channels: Channels,
    name: &str,
    found: &Found,
    form: impl Fn(Channel, &Found) -> Option<ItemForm>,
) -> Result<Vec<ChannelForm>, BuildError> {
    let with_form = |channel| match form(channel, found) {
        Some(form) => Ok(ChannelForm { channel, form }),
        None => Err(BuildError::NoChannel { name: name.to_owned(), channel }),
    };
    channels.iter().map(with_form).collect()
}

/// What is built, and where.
#[derive(Clone, Copy)]
pub(super) struct Job<'a> {
    pub(super) options: &'a BuildOptions,
    pub(super) output: &'a Path,
    pub(super) progress: &'a dyn Progress,
}

/// The files that a build writes.
pub(super) struct Files {
    atomic: AtomicFile,
    scratch: Scratch,
}

impl Job<'_> {
    pub(super) fn open_files(&self, dims: Dims) -> Result<Files, BuildError> {
        let bricks = dims.to_array().map(|n| u64::from(n.div_ceil(BRICK)));
        Ok(Files {
            atomic: AtomicFile::create(self.output).map_err(|e| self.output_error(e))?,
            scratch: Scratch::create(&self.options.scratch_folder(self.output), bricks)?,
        })
    }

    pub(super) fn run<S: Solid>(&self, files: Files, solid: &S) -> Result<BuildReport, BuildError> {
        let (plan, mut forms) = self.plan_solid(solid)?;
        let mut seconds = StageSeconds::default();
        let Files { atomic, scratch } = files;
        let started = Instant::now();
        let totals = self.scan(solid, &forms, &plan, &scratch)?;
        seconds.scan = started.elapsed().as_secs_f64();
        #[expect(clippy::cast_precision_loss, reason = "a small count")]
        {
            seconds.read = totals.found.reading.as_secs_f64() / plan.threads as f64;
        }
        if totals.skin == 0 {
            return Err(solid.nothing_inside());
        }

        let started = Instant::now();
        let census = Census::take(solid.dims(), &scratch)?;
        // The same channels, in the forms that follow from what was found.
        for known in &mut forms {
            known.form = solid.form(known.channel, &totals.found).unwrap_or(known.form);
        }
        let channels = StoredChannels { forms, lod: self.options.lod };
        let metadata = self.metadata(solid, &totals.found);
        let selection = metadata.selection;
        let metadata = metadata.to_bytes()?;
        let layout = Layout::new(&census, metadata.len() as u64, &channels);
        let target = Target { file: atomic.file(), path: self.output, layout: &layout, channels: &channels };
        self.merge(solid.dims(), &target, &census, &scratch, plan.threads)?;
        seconds.merge = started.elapsed().as_secs_f64();

        let started = Instant::now();
        let file_bytes = seal::seal(&target, solid.dims(), &census, &metadata)?;
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

    fn plan_solid<S: Solid>(&self, solid: &S) -> Result<(ColumnPlan, Vec<ChannelForm>), BuildError> {
        let name = solid.metadata(&Found::default()).source.name;
        let forms = channel_forms(self.options, &name, |channel, found| solid.form(channel, found))?;
        let bytes = |tile: &Tile| solid.worker_bytes(tile);
        let plan = self.plan(solid.dims(), &name, &forms, &bytes, solid.input_bytes())?;
        Ok((plan, forms))
    }

    /// The plan for a solid of these dims, whose workers take so much.
    pub(super) fn plan(
        &self,
        dims: Dims,
        name: &str,
        channels: &[ChannelForm],
        solid_bytes: &dyn Fn(&Tile) -> u64,
        input_bytes: u64,
    ) -> Result<ColumnPlan, BuildError> {
        let limit_bytes = self.options.memory.bytes();
        let alone = matches!(self.options.memory, MemoryCap::Process(_));
        let plan = ColumnPlan::new(&PlanRequest {
            dims,
            channels,
            threads: self.options.threads,
            memory: self.options.memory,
            fixed_bytes: plan::fixed_bytes(self.options.memory),
            solid_bytes,
            input_bytes,
        });
        // The cap is on the peak: what the process has held before, to open the input, counts too.
        let peak = if alone { peak_rss_bytes() } else { 0 };
        let told = if peak > 0 { peak + OPENING_SPREAD } else { 0 };
        let minimum = match plan {
            Ok(plan) if peak <= limit_bytes => return Ok(plan),
            Ok(_) => told,
            Err(minimum) => minimum.max(told),
        };
        Err(BuildError::BudgetTooSmall {
            name: name.to_owned(),
            limit_bytes,
            minimum_bytes: minimum.next_multiple_of(1 << 16),
        })
    }

    fn scan<S: Solid>(
        &self,
        solid: &S,
        channels: &[ChannelForm],
        plan: &ColumnPlan,
        scratch: &Scratch,
    ) -> Result<ScanTotals, BuildError> {
        let connectivity = self.options.connectivity;
        let shared = ScanContext { solid, channels, connectivity, plan, scratch };
        let count = plan.column_count();
        self.progress.stage("scan", count);
        let next = AtomicU64::new(0);
        let totals = Mutex::new(ScanTotals::default());
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
        dims: Dims,
        target: &Target<'_>,
        census: &Census,
        scratch: &Scratch,
        threads: usize,
    ) -> Result<(), BuildError> {
        self.progress.stage("merge", census.bricks);
        let merge = Merge::new(dims, scratch, target, census)?;
        parallel::run_workers(threads, &|stop| merge.work(stop, &|bricks| self.progress.advance(bricks)))?;
        merge.finish_upper_levels()
    }

    fn metadata<S: Solid>(&self, solid: &S, found: &Found) -> Metadata {
        let mut metadata = solid.metadata(found);
        metadata.program = concat!("infobyte ", env!("CARGO_PKG_VERSION")).into();
        metadata.connectivity = self.options.connectivity.code();
        if !self.options.channels.contains(Channel::Normal) {
            metadata.gradient = String::new();
        }
        if !self.options.channels.contains(Channel::Value) {
            metadata.value_scale = [0.0; 2];
        }
        metadata
    }

    fn output_error(&self, cause: std::io::Error) -> BuildError {
        BuildError::Output { path: self.output.to_path_buf(), cause }
    }
}
