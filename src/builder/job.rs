//! One build of any solid: plan, scan, merge, seal.

use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use super::bits::BitVolume;
use super::cells::larger::Bound;
use super::column::{ColumnWorker, ScanContext, ScanTotals};
use super::error::BuildError;
use super::item::{ChannelForm, ItemForm};
use super::layout::{Census, Layout, StoredChannels};
use super::merge::{self, Merge, Target};
use super::parts::{PartFault, PartId, PartWriter};
use super::plan::{ColumnPlan, PlanRequest};
use super::reduce::{self, Reduce};
use super::skin::{Connectivity, SkinRule};
use super::solid::{BRICK, ScanSummary, Solid, VoxelBox};
use super::swap::Scratch;
use super::visible::{self, Search};
use super::{BuildNote, BuildOptions, BuildReport, Progress, StageSeconds, parallel, seal};
use crate::atomic::AtomicFile;
use crate::budget::{Budget, Reservation};
use crate::builder::BuildFault;
use crate::fault::{Fault, unfit, usage};
use crate::format::{Channel, ErrorBound, Metadata, SectionEntry, SurfaceKind, labels_to_bytes};
use crate::geom::{Affine, Dims};
use crate::text::names::{SURFACE, UNCERTAINTY, VISIBLE_FROM};

/// Builds the skin octree of a solid into `output`; [`BuildOptions::threshold`] is ignored.
///
/// Memory and temporary disk as in [`super::build_volume`]; the solid states its own part.
///
/// # Errors
/// [`BuildError`]; the old output, if any, is untouched then and no temporary file remains.
///
/// # Panics
/// If a worker of the solid does not give one item for every skin voxel.
pub fn build_solid(
    solid: &dyn Solid,
    options: &BuildOptions,
    output: &Path,
    progress: &dyn Progress,
) -> Result<BuildReport, BuildError> {
    build_part(solid, options, output, None, progress)
}

/// Builds the model of a solid, or a part of the model: the records of the bricks of its box.
///
/// # Errors
/// The errors of [`build_solid`], and a part of another grid.
pub(super) fn build_part(
    solid: &dyn Solid,
    options: &BuildOptions,
    output: &Path,
    part: Option<&PartId>,
    progress: &dyn Progress,
) -> Result<BuildReport, BuildError> {
    let options = &options.for_surface(solid.surface());
    let spacing_mm = solid.metadata(&ScanSummary::default()).spacing_mm;
    options.check_error(spacing_mm, || solid.name())?;
    if part.is_some_and(|part| part.cuts.dims != solid.dims()) {
        let fault = BuildFault::Part { path: output.to_path_buf(), fault: PartFault::OtherPlan };
        return Err(fault.into());
    }
    let job = Job { options, output, progress, part };
    // Whatever can be refused at once is refused before a file is made.
    drop(job.plan_solid(solid)?);
    let files = job.open_files(solid.dims())?;
    job.run(files, solid)
}

fn request_of<'a>(solid: &'a dyn Solid, options: &BuildOptions) -> Result<PlanRequest<'a>, BuildError> {
    Ok(PlanRequest {
        dims: solid.dims(),
        channels: channel_forms(options, &solid.name(), |channel, found| solid.form(channel, found))?,
        threads: options.threads,
        solid_bytes: Box::new(|tile| solid.worker_bytes(tile)),
        input_bytes: solid.input_bytes(),
        with_sides: options.joins(),
    })
}

/// The requested channels, in the forms that the solid gives before the scan.
///
/// # Errors
/// The solid lacks one of the channels.
pub(super) fn channel_forms(
    options: &BuildOptions,
    name: &str,
    form: impl Fn(Channel, &ScanSummary) -> Option<ItemForm>,
) -> Result<Vec<ChannelForm>, BuildError> {
    let with_form = |channel| match form(channel, &ScanSummary::default()) {
        Some(form) => Ok(ChannelForm { channel, form }),
        None => Err(BuildFault::Said {
            name: name.to_owned(),
            fault: no_channel(channel, options.volume_surface()),
        }
        .into()),
    };
    options.channels().iter().map(with_form).collect()
}

fn notes(dims: Dims, surface: SurfaceKind, totals: &ScanTotals) -> Vec<BuildNote> {
    let count =
        |less: u32| dims.to_array().map(|side| u64::from(side.saturating_sub(less))).iter().product::<u64>();
    // All voxels are inside if the skin is the skin of the grid's box. Cells lie between samples, and around them.
    let all = !totals.amid && totals.skin + totals.hidden == count(0) - count(2);
    let voxels = count(u32::from(surface == SurfaceKind::Cells));
    let found = [
        (BuildNote::NotNumbers, totals.found.not_numbers),
        (BuildNote::Infinite, totals.found.infinite),
        (BuildNote::AllInside { voxels }, all),
    ];
    found.into_iter().filter(|(_, is_so)| *is_so).map(|(note, _)| note).collect()
}

/// The build's input and target.
#[derive(Clone, Copy)]
pub(super) struct Job<'a> {
    pub(super) options: &'a BuildOptions,
    pub(super) output: &'a Path,
    pub(super) progress: &'a dyn Progress,
    /// The part of the model that is built; `None` for the whole.
    pub(super) part: Option<&'a PartId>,
}

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

    pub(super) fn run(&self, files: Files, solid: &dyn Solid) -> Result<BuildReport, BuildError> {
        let (mut plan, mut forms) = self.plan_solid(solid)?;
        let region = self.part.map_or_else(|| VoxelBox::whole(solid.dims()), PartId::region);
        plan.limit(&region);
        let mut seconds = StageSeconds::default();
        let Files { atomic, scratch } = files;
        let started = Instant::now();
        let seen = self.look(solid, &forms, &plan, &scratch)?;
        seconds.sight = started.elapsed().as_secs_f64();
        let started = Instant::now();
        // Joining needs the hidden cells as well.
        let hidden_now = seen.as_ref().filter(|_| !self.options.joins());
        let mut totals = self.scan(solid, &forms, &plan, &scratch, hidden_now)?;
        seconds.scan = started.elapsed().as_secs_f64();
        {
            seconds.read = totals.found.reading.as_secs_f64() / plan.threads as f64;
        }
        if totals.skin == 0 && self.part.is_none() {
            drop(plan);
            let name = solid.name();
            return Err(match totals.hidden {
                0 => solid.nothing_inside(),
                boxes => BuildError::from(nothing_visible(name, boxes)),
            });
        }

        let started = Instant::now();
        // The same channels, in the forms that follow from the scan.
        for known in &mut forms {
            known.form = solid.form(known.channel, &totals.found).unwrap_or(known.form);
        }
        let channels = StoredChannels { forms, lod: self.options.lod, leaves: self.options.joins() };
        let mut metadata = self.metadata(solid, &totals.found);
        metadata.error = self.join_cells(solid, &channels, &plan, &scratch, (seen.as_ref(), &mut totals))?;
        let census = Census::take(solid.dims(), &region, &scratch)?;
        let selection = metadata.selection;
        let metadata = metadata.to_bytes()?;
        let labels = solid.labels()?;
        let table_bytes = if labels.is_empty() { 0 } else { labels_to_bytes(&labels)?.len() as u64 };
        let records =
            self.part.map(|part| PartWriter::new(part, solid.dims(), solid.surface(), &channels, &metadata));
        let layout = match &records {
            None => Layout::new(&census, [metadata.len() as u64, table_bytes], labels.len(), &channels),
            Some(_) => Layout::default(),
        };
        let target = Target {
            file: atomic.file(),
            path: self.output,
            layout: &layout,
            channels: &channels,
            progress: self.progress,
        };
        self.merge(solid, &target, &census, &scratch, &plan, records.as_ref())?;
        seconds.merge = started.elapsed().as_secs_f64();

        let started = Instant::now();
        let _memory = self.part(solid, &plan, seal::MEMORY_BYTES)?;
        let (file_bytes, entries) = match &records {
            None => {
                let entries =
                    seal::seal(&target, solid.dims(), solid.surface(), &census, &metadata, &labels)?;
                (entries.last().map_or(0, SectionEntry::end), entries)
            }
            Some(records) => (records.seal(&target, &scratch)?, Vec::new()),
        };
        seconds.seal = started.elapsed().as_secs_f64();
        let started = Instant::now();
        solid.check_unchanged().map_err(|cause| BuildError::from(BuildFault::Source(cause)))?;
        // Slow steps of the commit come before the last chance to stop.
        atomic.file().sync_all().map_err(|e| self.output_error(e))?;
        self.progress.check()?;
        atomic.commit().map_err(|e| self.output_error(e))?;
        seconds.commit = started.elapsed().as_secs_f64();
        Ok(BuildReport {
            selection,
            skin_voxels: census.voxels,
            hidden: seen.map(|_| totals.hidden),
            shown: totals.skin,
            nodes: census.nodes(),
            file_bytes,
            section_bytes: entries
                .iter()
                .filter_map(|e| e.kind.map(|k| (k.name(), e.stored_bytes)))
                .collect(),
            plan_bytes: plan.total_bytes,
            scratch_bytes: scratch.written_bytes(),
            threads: plan.threads,
            tile: plan.tile,
            seconds,
            notes: solid.note().into_iter().chain(notes(solid.dims(), solid.surface(), &totals)).collect(),
        })
    }

    pub(super) fn plan_solid(&self, solid: &dyn Solid) -> Result<(ColumnPlan, Vec<ChannelForm>), BuildError> {
        let request = request_of(solid, self.options)?;
        Ok((self.plan(&solid.name(), &request)?, request.channels))
    }

    /// The plan within the memory that the process does not hold yet.
    ///
    /// # Errors
    /// [`BuildError`], which names the smallest cap.
    pub(super) fn plan(&self, name: &str, request: &PlanRequest<'_>) -> Result<ColumnPlan, BuildError> {
        let memory = self.options.memory;
        ColumnPlan::new(request, &Budget::of_job(memory)).map_err(|_| {
            let dry = Budget::dry(memory);
            let _least = ColumnPlan::smallest(request, &dry);
            BuildError::from(BuildFault::BudgetTooSmall {
                name: name.to_owned(),
                limit_bytes: memory.bytes(),
                minimum_bytes: dry.smallest_limit(1),
            })
        })
    }

    /// Reserves a part of the workers' memory, for one of them or for a stage that works alone.
    fn part(&self, solid: &dyn Solid, plan: &ColumnPlan, bytes: u64) -> Result<Reservation, BuildError> {
        let limit_bytes = self.options.memory.bytes();
        plan.memory.reserve(bytes).map_err(|refused| {
            BuildError::from(BuildFault::BudgetTooSmall {
                name: solid.name(),
                limit_bytes,
                minimum_bytes: limit_bytes.saturating_add(refused.missing_bytes()),
            })
        })
    }

    fn scan(
        &self,
        solid: &dyn Solid,
        channels: &[ChannelForm],
        plan: &ColumnPlan,
        scratch: &Scratch,
        seen: Option<&BitVolume>,
    ) -> Result<ScanTotals, BuildError> {
        let progress = self.progress;
        let (kept, with_sides) = (self.kept(solid), self.options.joins());
        let shared = ScanContext { solid, channels, kept, plan, scratch, seen, progress, with_sides };
        self.progress.stage("scan", plan.column_count());
        let totals = Mutex::new(ScanTotals::default());
        self.columns(
            &shared,
            |worker, column| worker.scan(column),
            |worker| {
                let own = worker.finish()?;
                let mut all = totals.lock().unwrap_or_else(PoisonError::into_inner);
                *all = all.join(own);
                Ok(())
            },
        )?;
        Ok(totals.into_inner().unwrap_or_else(PoisonError::into_inner))
    }

    fn kept(&self, solid: &dyn Solid) -> SkinRule {
        match solid.surface() {
            SurfaceKind::Skin => SkinRule::Skin(self.options.connectivity),
            SurfaceKind::Cells => SkinRule::Cells,
        }
    }

    /// Runs `work` on every column, and `finish` on every worker.
    fn columns<'a>(
        &self,
        shared: &'a ScanContext<'a>,
        work: impl Fn(&mut ColumnWorker<'a>, &VoxelBox) -> Result<(), BuildError> + Sync,
        finish: impl Fn(ColumnWorker<'a>) -> Result<(), BuildError> + Sync,
    ) -> Result<(), BuildError> {
        let (plan, next) = (shared.plan, AtomicU64::new(0));
        parallel::run_stage(plan.threads, self.options.memory, self.progress, &|stop| {
            let _memory = self.part(shared.solid, plan, plan.scan_bytes)?;
            let mut worker = ColumnWorker::new(shared);
            while !stop() {
                let at = next.fetch_add(1, Ordering::Relaxed);
                if at >= plan.column_count() {
                    break;
                }
                work(&mut worker, &plan.column(at))?;
                self.progress.advance(1);
            }
            finish(worker)
        })
    }

    /// Finds the boxes that can be seen from the viewpoint; `None` without a viewpoint.
    fn look(
        &self,
        solid: &dyn Solid,
        channels: &[ChannelForm],
        plan: &ColumnPlan,
        scratch: &Scratch,
    ) -> Result<Option<BitVolume>, BuildError> {
        if self.options.visible_from.is_empty() {
            return Ok(None);
        }
        let (dims, folder) = (solid.dims(), self.options.scratch_folder(self.output));
        let occupancy = BitVolume::create(&folder, dims)?;
        let (kept, progress) = (self.kept(solid), self.progress);
        let shared =
            ScanContext { solid, channels, kept, plan, scratch, seen: None, progress, with_sides: false };
        self.progress.stage("occupancy", plan.column_count());
        self.columns(&shared, |worker, column| worker.store_occupancy(column, &occupancy), |_| Ok(()))?;

        let affine = Affine { rows: solid.metadata(&ScanSummary::default()).affine };
        let is_cells = solid.surface() == SurfaceKind::Cells;
        let search = Search::new(&self.options.visible_from, affine, is_cells, &occupancy);
        self.progress.stage("sight", 2 * u64::from(dims.nz()));
        let (next, seen) = (AtomicU64::new(0), Mutex::new(None));
        let lock = || seen.lock().unwrap_or_else(PoisonError::into_inner);
        parallel::run_stage(plan.threads.min(2), self.options.memory, self.progress, &|stop| {
            let _memory = self.part(solid, plan, search.group_bytes())?;
            while !stop() {
                let back = match next.fetch_add(1, Ordering::Relaxed) {
                    0 => false,
                    1 => true,
                    _ => break,
                };
                let held: Option<BitVolume> = lock().take();
                let own = held.map_or_else(|| BitVolume::create(&folder, dims), Ok)?;
                search.follow(back, &own, self.progress)?;
                let mut held = lock();
                match &*held {
                    Some(all) => visible::join(all, &own)?,
                    None => *held = Some(own),
                }
            }
            Ok(())
        })?;
        Ok(seen.into_inner().unwrap_or_else(PoisonError::into_inner))
    }

    /// Joins cells into larger leaves, if requested, and then leaves out hidden ones; returns the bound and the
    /// measured distances.
    fn join_cells(
        &self,
        solid: &dyn Solid,
        channels: &StoredChannels,
        plan: &ColumnPlan,
        scratch: &Scratch,
        (seen, totals): (Option<&BitVolume>, &mut ScanTotals),
    ) -> Result<Option<ErrorBound>, BuildError> {
        let Some(error) = self.options.error.filter(|_| channels.leaves) else { return Ok(None) };
        let bricks = solid.dims().to_array().map(|n| u64::from(n.div_ceil(BRICK)));
        self.progress.stage("join", bricks.iter().product());
        let spacing_mm = solid.metadata(&totals.found).spacing_mm;
        let bound = Bound::new(error.voxels(spacing_mm), spacing_mm);
        let stage = Reduce::new(solid.dims(), scratch, channels, bound, seen);
        parallel::run_stage(plan.threads, self.options.memory, self.progress, &|stop| {
            let _memory = self.part(solid, plan, reduce::worker_bytes(&channels.forms))?;
            stage.work(stop, self.progress)
        })?;
        self.progress.check()?;
        let (bound, hidden) = stage.found();
        totals.hidden = hidden;
        totals.skin -= hidden;
        if totals.skin == 0 && hidden > 0 {
            return Err(BuildError::from(nothing_visible(solid.name(), hidden)));
        }
        Ok(Some(bound))
    }

    fn merge(
        &self,
        solid: &dyn Solid,
        target: &Target<'_>,
        census: &Census,
        scratch: &Scratch,
        plan: &ColumnPlan,
        records: Option<&PartWriter>,
    ) -> Result<(), BuildError> {
        let forms = &target.channels.forms;
        self.progress.stage("merge", census.bricks);
        let mut merge = Merge::new(solid.dims(), scratch, target, census)?;
        if let Some(PartWriter { region, form, head }) = records {
            merge = merge.into_records(region, form, head.len() as u64);
        }
        parallel::run_stage(plan.threads, self.options.memory, self.progress, &|stop| {
            let _memory = self.part(solid, plan, merge::worker_bytes(forms))?;
            merge.work(stop, &|bricks| self.progress.advance(bricks))
        })?;
        if records.is_some() {
            return Ok(());
        }
        let _memory = self.part(solid, plan, merge::upper_bytes(forms))?;
        merge.finish_upper_levels()
    }

    fn metadata(&self, solid: &dyn Solid, found: &ScanSummary) -> Metadata {
        let mut metadata = solid.metadata(found);
        metadata.program = concat!("infobyte ", env!("CARGO_PKG_VERSION")).into();
        metadata.connectivity = match solid.surface() {
            SurfaceKind::Skin => self.options.connectivity.code(),
            SurfaceKind::Cells => Connectivity::default().code(),
        };
        if let [first, others @ ..] = &self.options.visible_from[..] {
            let more = if others.is_empty() { String::new() } else { format!(" and {} more", others.len()) };
            metadata.note_seen_from(&format!("{first}{more}"));
        }
        if !self.options.channels().contains(Channel::Normal) {
            metadata.gradient = String::new();
        }
        if !self.options.channels().contains(Channel::Value) {
            metadata.value_scale = [0.0; 2];
        }
        metadata
    }

    fn output_error(&self, cause: std::io::Error) -> BuildError {
        BuildError::from(BuildFault::Output { path: self.output.to_path_buf(), cause })
    }
}

fn no_channel(channel: Channel, surface: SurfaceKind) -> Fault {
    match (channel, surface) {
        (Channel::Value, SurfaceKind::Cells) => usage!(
            "cells lie where the value is the threshold, so there is no channel 'value'; leave it out, or use {SURFACE} skin"
        ),
        (Channel::Steepness, _) => usage!("has no noise that could be measured; leave out {UNCERTAINTY}"),
        _ => usage!("does not have the channel '{channel}'; leave it out"),
    }
}

fn nothing_visible(name: String, boxes: u64) -> BuildFault {
    let fault = unfit!(
        "none of the {boxes} boxes of its surface can be seen from there; give another {VISIBLE_FROM}"
    );
    BuildFault::Said { name, fault }
}
