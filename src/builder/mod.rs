//! The out-of-core builder: a solid in, an `.oct` out, in a fixed amount of memory.
//!
//! ```text
//! solid --bits, items--> column (skin) --records--> swap (scratch file, lz4)
//!                                                      |
//!        .oct <--seal (rank, CRC)-- merge (levels) <---+-- census (sizes, offsets)
//! ```
//!
//! A [`Solid`] determines the inside voxels and describes its skin. A volume with a threshold is such a solid:
//! [`build_volume`] makes it from a [`VolumeSource`] and passes it to [`build_solid`].
//!
//! | stage | passes over | memory | order |
//! |---|---|---|---|
//! | histogram (Otsu only) | the volume, once (wide types: twice) | 0.5 MiB + 0.5 MiB a worker | any |
//! | column | the volume once, 12 % of rows twice | see plan | any |
//! | reduce (`--error` only) | the scratch file, and back | about 1.6 MiB a worker | bricks in any order |
//! | layout: census | the index | 2 KiB | Morton |
//! | merge | the scratch file | about 1 MiB a worker | groups in Morton order |
//! | seal | the output | 128 KiB | sequential |
//!
//! | files | what they do |
//! |---|---|
//! | `typed` | from samples to a solid: start here for volumes |
//! | `solid`, `volume`, `cells`, `file_solid` | any solid; a volume's skin; a volume's cells, which `oct build` makes; one from files |
//! | `labels` | the cells between the labels of a volume |
//! | `choose`, `histogram`, `evidence`, `range`, `classify`, `occupancy` | which voxels are inside |
//! | `slices`, `ring`, `column`, `skin`, `bits` | slices in, skin records out |
//! | `noise` | noise of the samples away from the surface |
//! | `gradient`, `estimator`, `lanes`, `item` | normals and the other channels of a record |
//! | `pool`, `swap`, `brick`, `boxes`, `walk` | records of a brick: swapped out, and back in Morton order |
//! | `reduce` | cells joined into larger leaves |
//! | `layout`, `merge`, `seal` | the output |
//! | `parts` | parts of a model, and the model that is joined of them |
//! | `job`, `plan`, `options`, `parallel`, `report`, `error` | one build: memory, threads, results |
//! | `visible` | what is seen from a point |
//!
//! The result does not depend on the budget, the number of threads or the shape of columns: records are functions of
//! voxels alone, and their offsets follow from the census.

/// Evaluates an expression for the sample type of a volume: one instance for each of eight types.
macro_rules! by_type {
    ($scalar:expr, $t:ident => $body:expr) => {
        by_type!($scalar, $t => $body, U8 u8, I8 i8, U16 u16, I16 i16, U32 u32, I32 i32, F32 f32, F64 f64)
    };
    ($scalar:expr, $t:ident => $body:expr, $($kind:ident $type:ty),*) => {
        match $scalar {
            $($crate::volume::ScalarType::$kind => {
                type $t = $type;
                $body
            })*
        }
    };
}

/// Evaluates an expression for the sample type of the ring: one instance for each of five.
macro_rules! by_ring {
    ($scalar:expr, $t:ident => $body:expr) => {
        by_type!($scalar, $t => $body, U8 u8, I8 i8, U16 u16, I16 i16, U32 f32, I32 f32, F32 f32, F64 f32)
    };
}

mod bits;
mod boxes;
mod brick;
mod cells;
mod choose;
mod classify;
mod column;
mod error;
mod estimator;
mod evidence;
mod extremes;
mod file_solid;
mod gradient;
mod histogram;
mod item;
mod job;
mod labels;
mod lanes;
mod layout;
mod merge;
mod noise;
mod occupancy;
mod options;
mod parallel;
pub(crate) mod parts;
mod plan;
mod pool;
mod range;
mod reduce;
mod report;
mod ring;
mod seal;
mod skin;
mod slices;
mod solid;
mod swap;
mod typed;
mod visible;
mod volume;
mod walk;

pub(crate) use bits::{BitVolume, scratch_error};
pub(crate) use choose::{Chooser, choose_noted, is_map, label_count};
pub use error::BuildError;
pub(crate) use error::BuildFault;
pub use estimator::Gradient;
pub(crate) use extremes::Extremes;
#[doc(hidden)]
pub use file_solid::FileSolid;
pub use item::ItemForm;
pub use job::build_solid;
pub use labels::{LabelChoice, MAX_SMOOTH};
pub use options::{BuildOptions, Threshold, Tolerance};
pub use report::{BuildNote, BuildReport, StageSeconds};
pub use skin::{Connectivity, Exposed};
pub use solid::{
    Cover, EdgeCrossing, OccupancyRows, ScanSummary, SkinSlice, Solid, SolidWorker, Tile, VoxelBox,
};

pub use visible::ViewedFrom;

pub(crate) use occupancy::{RangeTest, for_each_block, range_test, worker_bytes as occupancy_worker_bytes};

pub use crate::progress::{Progress, Silent};

use std::path::Path;
use std::time::Instant;

use crate::budget::{Budget, MemoryCap, Reservation, TooSmall};
use crate::format::{Channel, SurfaceKind};
use crate::geom::Dims;
use crate::volume::{ScalarType, VolumeInfo, VolumeSource};
use cells::{AROUND_CELL, volume_cell_form};
pub(crate) use cells::{CellEdge, CellEdges, cell_dims};
use gradient::NormalRule;
use item::ChannelForm;
use job::{Job, channel_forms};
use parts::PartId;
use plan::{ColumnPlan, PlanRequest};
use slices::RingShape;
use typed::TypedVolume;
use volume::{AROUND, volume_form};

/// The smallest [`MemoryCap::Share`] within which a model of `source` can be built.
pub fn smallest_share(source: &dyn VolumeSource, options: &BuildOptions) -> u64 {
    smallest_cap(source, options, MemoryCap::Share(0))
}

/// The smallest cap of this kind within which a model can be built.
pub(crate) fn smallest_cap(source: &dyn VolumeSource, options: &BuildOptions, kind: MemoryCap) -> u64 {
    let dry = Budget::dry(kind);
    let _least = reserve_least(source, options, &dry);
    dry.smallest_limit(1)
}

/// Reserves the least memory of a model of `source`: the smallest plan for the most favourable range of this sample
/// type. Wherever this succeeds, [`build_volume`] finds a plan.
///
/// # Errors
/// The budget is too small, or the process exceeded its limit earlier, while it opened the input: the cap is on the
/// peak.
pub(crate) fn reserve_least(
    source: &dyn VolumeSource,
    options: &BuildOptions,
    budget: &Budget,
) -> Result<Reservation, TooSmall> {
    ColumnPlan::smallest(&kindest_request(source, options), budget)
}

/// The request for a plan with the most favourable range of the sample type; channels that a volume lacks are refused
/// elsewhere.
fn kindest_request<'a>(source: &'a dyn VolumeSource, options: &BuildOptions) -> PlanRequest<'a> {
    let info = source.info();
    if options.labels.is_some() {
        let options = options.for_surface(SurfaceKind::Cells);
        let form_of = |channel| Some(ChannelForm { channel, form: labels::label_form(channel)? });
        return PlanRequest {
            dims: cell_dims(info.dims).unwrap_or(info.dims),
            channels: options.channels().iter().filter_map(form_of).collect(),
            threads: options.threads,
            solid_bytes: Box::new(move |tile| labels::worker_bytes(info, tile)),
            input_bytes: source.resident_bytes(),
            with_sides: false,
        };
    }
    let surface = options.volume_surface();
    let (dims, reach) = match surface {
        SurfaceKind::Skin => (info.dims, AROUND),
        // A volume that is too large is refused elsewhere.
        SurfaceKind::Cells => (cell_dims(info.dims).unwrap_or(info.dims), AROUND_CELL),
    };
    let more = match surface {
        SurfaceKind::Skin => NormalRule::more_bytes(options.gradient()),
        SurfaceKind::Cells => cells::worker_bytes(options.for_surface(surface).channels()),
    };
    let shape = RingShape::kindest(info.dims, info.scalar, reach);
    let channels = options.for_surface(surface).channels();
    let form_of = |channel| {
        let form = form_on(surface, info.scalar, channel, &ScanSummary::default())?;
        Some(ChannelForm { channel, form })
    };
    PlanRequest {
        dims,
        channels: channels.iter().filter_map(form_of).collect(),
        threads: options.threads,
        solid_bytes: Box::new(move |tile| shape.bytes(tile) + more),
        input_bytes: source.resident_bytes(),
        with_sides: options.joins(),
    }
}

/// The form of a channel's items; `None` for channels that a volume lacks with this surface.
fn form_on(
    surface: SurfaceKind,
    scalar: ScalarType,
    channel: Channel,
    found: &ScanSummary,
) -> Option<item::ItemForm> {
    match surface {
        SurfaceKind::Skin => volume_form(scalar, channel, found),
        SurfaceKind::Cells => volume_cell_form(channel, found),
    }
}

/// Builds the octree of `source`, of the voxels whose values lie in [`BuildOptions::threshold`], into `output`.
///
/// Memory: [`BuildOptions::memory`] bounds the process as the operating system accounts it, or the build's
/// own part of it. Temporary disk: about the size of the result, in one
/// unnamed file.
///
/// # Errors
/// [`BuildError`]; the old output, if any, is untouched then and no temporary file remains.
pub fn build_volume(
    source: &dyn VolumeSource,
    options: &BuildOptions,
    output: &Path,
    progress: &dyn Progress,
) -> Result<BuildReport, BuildError> {
    if let Some(choice) = &options.labels {
        let solid = labels::label_solid(source, choice, options)?;
        let options = &options.for_surface(options.volume_surface());
        let job = Job { options, output, progress, part: None };
        drop(job.plan_solid(&*solid)?);
        return job.run(job.open_files(solid.dims())?, &*solid);
    }
    let surface = options.volume_surface();
    let options = &options.for_surface(surface);
    run_volume(source, &Job { options, output, progress, part: None })
}

/// Builds part of a model: the records of the bricks of its box.
///
/// # Errors
/// The errors of [`build_volume`].
pub(crate) fn build_volume_part(
    source: &dyn VolumeSource,
    options: &BuildOptions,
    output: &Path,
    part: &PartId,
    progress: &dyn Progress,
) -> Result<BuildReport, BuildError> {
    let surface = options.volume_surface();
    let options = &options.for_surface(surface);
    run_volume(source, &Job { options, output, progress, part: Some(part) })
}

fn run_volume(source: &dyn VolumeSource, job: &Job<'_>) -> Result<BuildReport, BuildError> {
    let Job { options, progress, .. } = *job;
    // Whatever can be refused at once is refused before the volume is read.
    let dims = check_volume(source, job)?;
    let files = job.open_files(dims)?;
    let started = Instant::now();
    let solid = volume_solid(source, options.threshold, options.volume_surface(), options, progress)?;
    let histogram_s = started.elapsed().as_secs_f64();
    let mut report = job.run(files, &*solid)?;
    report.seconds.histogram = histogram_s;
    Ok(report)
}

/// The solid of a volume's voxels that a threshold chooses.
///
/// # Errors
/// No sample can be chosen, the volume cannot be read, or it is too large for cells.
pub(crate) fn volume_solid<'a>(
    source: &'a dyn VolumeSource,
    threshold: Threshold,
    surface: SurfaceKind,
    options: &'a BuildOptions,
    progress: &'a dyn Progress,
) -> Result<Box<dyn Solid + 'a>, BuildError> {
    let chooser = Chooser { source, memory: options.memory, threads: options.threads, progress };
    TypedVolume { chooser, threshold, surface, options }.solid()
}

/// Checks that the volume has the channels, and that a plan exists for the most favourable range of its sample type.
/// Returns the size of the model's grid.
fn check_volume(source: &dyn VolumeSource, job: &Job<'_>) -> Result<Dims, BuildError> {
    let VolumeInfo { dims, scalar, description, .. } = source.info();
    let (name, surface) = (&description.name, job.options.volume_surface());
    let dims = typed::grid_dims(*dims, surface, name)?;
    job.options.check_error(source.info().spacing_mm, || name.clone())?;
    channel_forms(job.options, name, |c, found| form_on(surface, *scalar, c, found))?;
    job.plan(name, &kindest_request(source, job.options))?;
    Ok(dims)
}
