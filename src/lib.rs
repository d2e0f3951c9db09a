//! Turns volumes into compact surface octrees in a fixed amount of memory, and traces exact rays through them.
//!
//! The library implements M. Tsygankov's *Hierarchical Discrete Ray Tracing in Octrees*. A volume is
//! classified into inside and outside, and only its *skin* is kept, in an octree with one **infobyte**
//! (child mask) per non-empty node.
//!
//! With a clone next to your crate: `infobyte = { path = "../infobyte", default-features = false }`. The default
//! feature `cli` is for the program `oct` only.
//!
//! # A volume of your own, a ray, a picture
//!
//! ```
//! use infobyte::{BuildOptions, Dims, Model, NamedView, RayCaster, RenderRequest, Threshold, ViewPoint, Voxels};
//!
//! # fn main() -> Result<(), infobyte::Error> {
//! # let folder = tempfile::tempdir().expect("a temporary folder");
//! # std::env::set_current_dir(&folder).expect("the folder exists");
//! // A ball: 20 minus the distance from its centre, at the middle of voxel (x, y, z). Inside is 0 and more.
//! let dims = Dims::new(48, 48, 48).expect("sides of 1 to 65536");
//! let ball = Voxels::from_fn(dims, |p| 20.0 - p.map(|c| (c as f32 - 23.5).powi(2)).iter().sum::<f32>().sqrt());
//! let options = BuildOptions { threshold: Threshold::Iso(0.0), ..Default::default() };
//! infobyte::build(&ball, &options, "ball.oct")?;
//!
//! let model = Model::open("ball.oct")?;
//! let hit = RayCaster::new(&model)?.first_hit([23.5, 23.5, -100.0], [0.0, 0.0, 1.0])?;
//! if let Some(point) = hit {
//!     assert!((point.position_mm[2] - 3.5).abs() < 0.05);
//!     assert!(point.normal.is_some_and(|n| n[2] < -0.99));
//! }
//!
//! let request = RenderRequest { point: Some(ViewPoint::Named(NamedView::Iso)), ..Default::default() };
//! let (image, report) = infobyte::render(&model, &request)?;
//! image.write_png("ball.png")?;
//! assert!(report.hits > 100_000);
//! # Ok(())
//! # }
//! ```
//!
//! Coordinates are in millimetres. For [`Voxels`] they are voxel indices until a spacing or a placement is given: the
//! centre of the first voxel is the origin. Patients and views use DICOM's axes: x to the left hand, y to the
//! back, z to the head; the camera of "front" looks along +y.
//!
//! # A volume on disk
//!
//! ```no_run
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! // A folder of DICOM images, a NIfTI or NRRD file, ...: the content decides the format.
//! let volume = infobyte::open("series/")?;
//! println!("{} voxels of {:?} mm", volume.info().dims, volume.info().spacing_mm);
//! let options = infobyte::BuildOptions {
//!     threshold: infobyte::Threshold::Iso(300.0),
//!     // What the build may add to the memory of this process; `Process` would bound them together.
//!     memory: infobyte::MemoryCap::Share(8 << 20),
//!     ..Default::default()
//! };
//! infobyte::build(&*volume, &options, "bone.oct")?;
//! # Ok(())
//! # }
//! ```
//!
//! # A mesh, or a tree of solids
//!
//! ```
//! use infobyte::{BuildOptions, GridOptions, OpenOptions, Subject, mesh::GridChoice};
//!
//! # fn main() -> Result<(), infobyte::Error> {
//! # let folder = tempfile::tempdir().expect("a temporary folder");
//! # let (part, model) = (folder.path().join("part.csg"), folder.path().join("part.oct"));
//! # std::fs::write(&part, "difference() { cube(10); sphere(6); }").expect("a file");
//! // STL, PLY, OBJ, OFF, glTF, 3MF or .csg: recognised by content, too.
//! let subject = Subject::open(&[part], &OpenOptions::default())?;
//! let grid = GridOptions { grid: Some(GridChoice::Side { voxels: 64, margin: 1 }), ..Default::default() };
//! let report = infobyte::build_subject(subject, &grid, &BuildOptions::default(), &model)?;
//! assert!(report.skin_voxels > 10_000);
//! # Ok(())
//! # }
//! ```
//!
//! # An existing model
//!
//! ```
//! # fn main() -> Result<(), infobyte::Error> {
//! # let path = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/v1.0-mapped.oct");
//! let model = infobyte::Model::open(path)?;
//! println!("{} skin voxels in {}", model.header().voxels, model.dims());
//! infobyte::render(&model, &infobyte::RenderRequest { size: Some([64, 64]), ..Default::default() })?;
//! # Ok(())
//! # }
//! ```
//!
//! # Data of your own
//!
//! | what a program has | what it calls |
//! |---|---|
//! | an array, in any order of its axes | [`VolumeView`], without a copy |
//! | slices that come one after the other | [`Slices`] |
//! | a function of the position, blocks, a server | implements [`VolumeSource`], as `examples/function.rs` does |
//! | a volume to crop, to close gaps in, or to reduce to its largest part | [`clean_and_build`] |
//! | a "cancel" button | [`Progress::stopped`] |
//! | a model that must not depend on its file | [`Model::read`], [`Model::from_bytes`] |
//! | millions of rays | [`RayCaster::first_hits`], [`RayCaster::any_hit`] |
//! | points whose distance from the surface is wanted | [`Model::nearest`] |
//! | a need for triangles, voxels or the bytes of a PNG | [`triangles`], [`Model::voxels`], [`Image::write_png_to`] |
//!
//! To build from a shape that has no samples, implement [`Solid`](builder::Solid) and call
//! [`builder::build_solid`]. Progress, scratch folders and batches are in [`builder`] and [`jobs`].
//!
//! Modules hidden from the documentation are for the program `oct` and the tests; they may change with any release.
//!
//! # Errors
//!
//! An [`Error`] has a kind ([`ExitKind`], which is the exit code of `oct` and the kind in its JSON), for most of them a
//! path, and one sentence that says what is wrong and what to do about it. Sentences may be improved with any release;
//! programs tell failures apart by kind.
//!
//! # How data flows
//!
//! ```text
//! source --slabs--> builder (classify, skin, gradient, swap, merge) --> .oct --> load --> render
//! ```
// Any file content leads to a model or to a sentence.
#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

// Helpers of tests name this crate as other crates do.
#[cfg(test)]
extern crate self as infobyte;

#[cfg(test)]
#[path = "../tests/it/common/assembled.rs"]
mod assembled;
mod atomic;
pub mod budget;
pub mod builder;
pub mod clean;
mod codec;
#[cfg(test)]
#[path = "../tests/it/common/compress.rs"]
mod compress;
#[doc(hidden)]
pub mod cpu;
pub mod csg;
pub mod discovery;
pub mod error;
mod exit;
pub mod export;
mod fault;
pub mod format;
pub mod geom;
mod identity;
mod interior;
pub mod intersect;
pub mod jobs;
pub mod load;
mod measure;
#[cfg(test)]
#[path = "../tests/it/common/memory_tree.rs"]
mod memory_tree;
pub mod mesh;
mod order;
mod page;
mod picture_mark;
mod platform;
pub mod progress;
#[cfg(feature = "python")]
mod python;
#[cfg(test)]
#[path = "../tests/it/common/random.rs"]
mod random;
pub mod render;
pub mod scene;
mod scratch;
pub mod source;
#[doc(hidden)]
pub mod synthetic;
#[doc(hidden)]
pub mod text;
pub mod volume;

pub use budget::MemoryCap;
pub use builder::{BuildOptions, BuildReport, Connectivity, Threshold};
pub use clean::{CleanOptions, CleanReport};
pub use error::Error;
pub use exit::{ErrorReport, ExitKind};
pub use export::Mesh;
pub use format::{Channel, Channels};
pub use geom::{Affine, Dims};
pub use jobs::build::GridOptions;
pub use jobs::export::triangles;
pub use jobs::nearest::NearestPoints;
pub use jobs::render::{RenderReport, RenderRequest};
pub use load::Model;
pub use progress::Progress;
pub use render::{
    Hits, Image, NamedView, Projection, RayCaster, Samples, Shading, Smoothing, SurfacePoint, ViewPoint,
};
pub use source::{OpenOptions, Subject};
pub use volume::{Rescale, ScalarType, Slices, VolumeInfo, VolumeSource, VolumeView, Voxels};

use std::path::{Path, PathBuf};
use std::time::Instant;

use jobs::build::BuildJob;

use budget::Budget;
use volume::Workspace;

/// Opens the volume in a file or a folder, ready to be built from; see [`discovery::open`] for several files, or
/// to choose among several volumes.
///
/// # Errors
/// [`Error::Source`], whose text names the input and says what was found and what to add.
pub fn open(input: impl Into<PathBuf>) -> Result<Box<dyn VolumeSource>, Error> {
    Ok(discovery::open(&[input.into()], &OpenOptions::default())?)
}

/// Builds the surface octree of a volume into the file `output`, which appears whole or not at all.
///
/// To unroll or clean the volume first, or to be able to stop the build, use [`clean_and_build`].
///
/// Memory: [`BuildOptions::memory`]. Temporary disk: about the size of the model.
///
/// # Errors
/// [`Error::Build`]; an existing file of that name is left untouched.
pub fn build(
    volume: &dyn VolumeSource,
    options: &BuildOptions,
    output: impl AsRef<Path>,
) -> Result<BuildReport, Error> {
    Ok(builder::build_volume(volume, options, output.as_ref(), &progress::Silent)?)
}

/// Prepares and cleans a volume and builds its surface octree into the file `output`, which appears whole or not at all.
/// It extends [`build`] to volumes of any kind and to every cleaning step of the command. The volume may be borrowed.
///
/// A volume that can only be read from front to back, such as [`Slices`], is first written to an anonymous scratch
/// file. With [`CleanOptions::default`] nothing is cleaned; [`CleanOptions::preset`] replaces
/// [`BuildOptions::threshold`]. Returns the report of the build, and of cleaning if the occupancy was cleaned.
///
/// Memory: [`BuildOptions::memory`]. Temporary disk: as for [`build`], plus the volume if it is unrolled, plus
/// what [`clean`] states.
///
/// ```
/// use infobyte::{BuildOptions, CleanOptions, Dims, Threshold, VolumeView, progress::Silent};
///
/// # fn main() -> Result<(), infobyte::Error> {
/// # let folder = tempfile::tempdir().expect("a temporary folder");
/// # let path = folder.path().join("a.oct");
/// let mut samples = vec![0_u8; 30 * 30 * 30];
/// samples[5000..20_000].fill(1);
/// // A voxel that belongs to nothing.
/// samples[26_999] = 1;
/// let mut volume = VolumeView::new(Dims::new(30, 30, 30).unwrap(), &samples).unwrap();
/// let cleaning = CleanOptions { keep_largest: Some(1), ..Default::default() };
/// let options = BuildOptions { threshold: Threshold::Iso(1.0), ..Default::default() };
/// let (_, cleaned) = infobyte::clean_and_build(&mut volume, &cleaning, &options, &path, &Silent)?;
/// assert_eq!(cleaned.map(|report| report.voxels_removed), Some(1));
/// # Ok(())
/// # }
/// ```
///
/// # Errors
/// [`Error::Source`], [`Error::Clean`] and [`Error::Build`]; [`Error::Stopped`] if `progress` says so. An old file of
/// that name is untouched then.
pub fn clean_and_build(
    volume: &mut dyn VolumeSource,
    cleaning: &CleanOptions,
    options: &BuildOptions,
    output: impl AsRef<Path>,
    progress: &dyn Progress,
) -> Result<(BuildReport, Option<CleanReport>), Error> {
    let (output, mut options) = (output.as_ref(), options.clone());
    if let Some(preset) = cleaning.preset {
        options.threshold = preset.threshold();
    }
    let mut volume = cleaning.reshape(Box::new(volume))?;
    let scratch = options.scratch_folder(output);
    volume.prepare(&Workspace { scratch: &scratch, memory: Budget::of(options.memory), progress })?;
    cleaning.mask_labels(&mut *volume, &options, progress);
    let cleaned = cleaning.clean(&*volume, &options, output, progress)?;
    let source = match &cleaned {
        Some(cleaned) => {
            options.threshold = Threshold::Chosen(cleaned.selection);
            cleaned.source()
        }
        None => &*volume,
    };
    let report = builder::build_volume(source, &options, output, progress)?;
    Ok((report, cleaned.map(|cleaned| cleaned.report)))
}

/// Builds a model from anything that can be opened: a volume, or a mesh or a tree of solids on the given grid.
///
/// Memory and temporary disk as [`build`].
///
/// # Errors
/// [`Error::Source`] from reading the subject, [`Error::Build`] from building the model; an existing file is left
/// untouched.
pub fn build_subject(
    subject: Subject,
    grid: &GridOptions,
    options: &BuildOptions,
    output: impl AsRef<Path>,
) -> Result<BuildReport, Error> {
    let (clean, output) = (clean::CleanOptions::default(), output.as_ref());
    let job = BuildJob { clean: &clean, grid, options, output, progress: &progress::Silent };
    Ok(job.build(subject, String::new(), Instant::now())?.report)
}

/// Renders a picture of a model. It depends only on the model and the request, not on the machine.
///
/// # Errors
/// [`Error::Render`] for an invalid camera or size, or a model without a volume; [`Error::Said`] for labels or a section
/// that the model has not; [`Error::Load`] if the model's file
/// changes during the call, see [`Model::open`].
pub fn render<D: AsRef<[u8]> + Sync>(
    model: &Model<D>,
    request: &RenderRequest,
) -> Result<(Image, RenderReport), Error> {
    model.unchanged_during(|| {
        jobs::scene::picture_of(Path::new("the model"), model, request, &progress::Silent)
    })
}
