//! The out-of-core builder: a solid in, an `.oct` out, in a fixed amount of memory.
//!
//! ```text
//! solid --bits, items--> column (skin) --records--> swap (scratch file, lz4)
//!                                                      |
//!        .oct <--seal (rank, CRC)-- merge (levels) <---+-- census (sizes, offsets)
//! ```
//!
//! A [`Solid`] says which voxels are inside and describes its skin. A volume with a threshold is one:
//! [`build_volume`] makes it of a [`VolumeSource`] and hands it to [`build_solid`].
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
//! functions of voxels alone, and their offsets follow from the census.

mod any;
mod bits;
mod boxes;
mod brick;
mod cells;
mod choose;
mod classify;
mod column;
mod error;
mod estimator;
mod gradient;
mod histogram;
mod item;
mod job;
mod lanes;
mod layout;
mod merge;
mod occupancy;
mod options;
mod parallel;
mod plan;
mod pool;
mod range;
mod report;
mod ring;
mod seal;
mod simd;
mod skin;
mod slices;
mod solid;
mod swap;
mod visible;
mod volume;
mod walk;

pub(crate) use any::{AnySolid, volume_part};
pub(crate) use bits::{BitVolume, scratch_error};
pub use choose::choose_selection;
pub use error::{BuildError, ScratchFault, Sought};
pub use estimator::Gradient;
pub use item::ItemForm;
pub use job::build_solid;
pub use options::{BuildOptions, Threshold};
pub use report::{BuildNote, BuildReport, StageSeconds};
pub use skin::{Connectivity, Exposed};
pub use solid::{Cover, Found, LOOKAHEAD, OccupancyRows, SkinSlice, Solid, SolidWorker, Tile, VoxelBox};

pub use visible::ViewedFrom;

pub(crate) use occupancy::{RangeTest, for_each_block, range_test, worker_bytes as occupancy_worker_bytes};

pub use crate::progress::{Progress, Silent};

use std::path::Path;
use std::time::Instant;

use crate::budget::{Budget, MemoryCap, Reservation, TooSmall};
use crate::format::{Channel, Selection, SurfaceKind};
use crate::volume::{ScalarType, VolumeInfo, VolumeSource};
use cells::{AROUND_CELL, CellSolid, cell_dims, cell_form};
use choose::Chooser;
use gradient::NormalRule;
use item::ChannelForm;
use job::{Job, channel_forms};
use plan::{ColumnPlan, PlanRequest};
use range::{Ordered, SampleRange};
use ring::{Depths, RingForm, Samples};
use slices::RingShape;
use volume::{AROUND, VolumeSolid, volume_form};

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

/// Reserves what a model of `source` cannot be built without: the smallest plan for the kindest range of this
/// sample type. A plan for [`build_volume`] is found from wherever this succeeds.
///
/// # Errors
/// The budget does not have it, or the process has passed its limit before, to open the input: the cap is on the
/// peak.
pub(crate) fn reserve_least(
    source: &dyn VolumeSource,
    options: &BuildOptions,
    budget: &Budget,
) -> Result<Reservation, TooSmall> {
    ColumnPlan::smallest(&kindest_request(source, options), budget)
}

/// What a plan for the kindest range of the sample type is made for; channels that a volume does not have are
/// refused elsewhere.
fn kindest_request<'a>(source: &'a dyn VolumeSource, options: &BuildOptions) -> PlanRequest<'a> {
    let info = source.info();
    let surface = options.volume_surface();
    let (dims, reach) = match surface {
        SurfaceKind::Skin => (info.dims, AROUND),
        // A volume that is too large is refused elsewhere.
        SurfaceKind::Cells => (cell_dims(info.dims).unwrap_or(info.dims), AROUND_CELL),
    };
    let more = match surface {
        SurfaceKind::Skin => NormalRule::more_bytes(options.gradient),
        SurfaceKind::Cells => cells::WORKER_BYTES,
    };
    let shape = RingShape::kindest(info.dims, info.scalar, reach);
    let channels = options.for_surface(surface).channels;
    let form_of = |channel| {
        let form = form_on(surface, info.scalar, channel, &Found::default())?;
        Some(ChannelForm { channel, form })
    };
    PlanRequest {
        dims,
        channels: channels.iter().filter_map(form_of).collect(),
        threads: options.threads,
        solid_bytes: Box::new(move |tile| shape.bytes(tile) + more),
        input_bytes: source.resident_bytes(),
    }
}

/// The form of a channel's items, of those that a volume has with this surface.
fn form_on(
    surface: SurfaceKind,
    scalar: ScalarType,
    channel: Channel,
    found: &Found,
) -> Option<item::ItemForm> {
    match surface {
        SurfaceKind::Skin => volume_form(scalar, channel, found),
        SurfaceKind::Cells => cell_form(channel),
    }
}

/// Builds the octree of `source`, of the voxels whose values lie in [`BuildOptions::threshold`], into
/// `output`.
///
/// Memory: [`BuildOptions::memory`] bounds the process as the operating system accounts it, or the build's
/// own part of it. Temporary disk: about the size of the result, in one
/// nameless file.
///
/// # Errors
/// [`BuildError`]; the old output, if any, is untouched then and no temporary file remains.
pub fn build_volume(
    source: &dyn VolumeSource,
    options: &BuildOptions,
    output: &Path,
    progress: &dyn Progress,
) -> Result<BuildReport, BuildError> {
    let options = &options.for_surface(options.volume_surface());
    let front = Front { source, job: Job { options, output, progress } };
    // What can be refused at once is refused before the volume is read.
    front.check()?;
    let files = front.job.open_files(front.dims()?)?;
    match source.info().scalar {
        ScalarType::U8 => front.build_samples::<u8>(files),
        ScalarType::I8 => front.build_samples::<i8>(files),
        ScalarType::U16 => front.build_samples::<u16>(files),
        ScalarType::I16 => front.build_samples::<i16>(files),
        ScalarType::F32 => front.build_samples::<f32>(files),
        ScalarType::U32 => front.build_depths::<u32>(files),
        ScalarType::I32 => front.build_depths::<i32>(files),
        ScalarType::F64 => front.build_depths::<f64>(files),
    }
}

/// From a volume to the solid of its threshold.
struct Front<'a> {
    source: &'a dyn VolumeSource,
    job: Job<'a>,
}

impl<'a> Front<'a> {
    /// Size of the model's grid.
    fn dims(&self) -> Result<crate::geom::Dims, BuildError> {
        let VolumeInfo { dims, description, .. } = self.source.info();
        match self.job.options.surface {
            SurfaceKind::Skin => Ok(*dims),
            SurfaceKind::Cells => {
                cell_dims(*dims).ok_or_else(|| BuildError::NoRoomForCells { name: description.name.clone() })
            }
        }
    }

    /// Does the volume have the channels, and is there a plan for the kindest range of this sample type?
    fn check(&self) -> Result<(), BuildError> {
        let info = self.source.info();
        let name = &info.description.name;
        let surface = self.job.options.surface;
        self.dims()?;
        self.job.options.check_bits(true, || name.clone())?;
        channel_forms(self.job.options, name, |c, found| form_on(surface, info.scalar, c, found))?;
        self.job.plan(name, &kindest_request(self.source, self.job.options)).map(drop)
    }

    /// Types that can stand in the ring as they are, if the range has only a lower end.
    fn build_samples<T: Ordered + lanes::RingSample>(
        &self,
        files: job::Files,
    ) -> Result<BuildReport, BuildError> {
        let (selection, range, histogram_s) = self.choose::<T>()?;
        if range.is_open_above() {
            self.build_form(files, Samples(range), selection, histogram_s)
        } else {
            self.build_form(files, Depths(range), selection, histogram_s)
        }
    }

    fn build_depths<T: Ordered>(&self, files: job::Files) -> Result<BuildReport, BuildError> {
        let (selection, range, histogram_s) = self.choose::<T>()?;
        self.build_form(files, Depths(range), selection, histogram_s)
    }

    fn build_form<F: RingForm>(
        &self,
        files: job::Files,
        form: F,
        selection: Selection,
        histogram_s: f64,
    ) -> Result<BuildReport, BuildError> {
        let solid = VolumeSolid::new(self.source, form, selection, self.job.options, self.chooser());
        let mut report = match self.job.options.surface {
            SurfaceKind::Skin => self.job.run(files, &solid)?,
            SurfaceKind::Cells => self.job.run(files, &CellSolid::new(solid, self.dims()?))?,
        };
        report.seconds.histogram = histogram_s;
        Ok(report)
    }

    /// The selection in physical units and in samples.
    fn choose<T: Ordered>(&self) -> Result<(Selection, SampleRange<T>, f64), BuildError> {
        let started = Instant::now();
        let (selection, range) = self.chooser().choose::<T>(self.job.options.threshold)?;
        Ok((selection, range, started.elapsed().as_secs_f64()))
    }

    fn chooser(&self) -> Chooser<'a> {
        let Job { options, progress, .. } = self.job;
        Chooser { source: self.source, memory: options.memory, threads: options.threads, progress }
    }
}
