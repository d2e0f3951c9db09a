//! Surface octrees out of core: volumes in, one infobyte per node out, exact rays through them.
//!
//! The library revives M. Tsygankov's *Hierarchical Discrete Ray Tracing in Octrees*. A volume is
//! classified into inside and outside, only its *skin* is kept, and the skin lives in an octree with
//! one **infobyte** (child mask) per non-empty node. Data flows one way:
//!
//! # A volume of your own, a ray, a picture
//!
//! ```
//! use infobyte::{BuildOptions, Dims, Model, RayCaster, RenderRequest, Threshold, Voxels};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! # let folder = tempfile::tempdir()?;
//! # let (path, picture) = (folder.path().join("ball.oct"), folder.path().join("ball.png"));
//! // Distance from the centre of a ball, in voxels: inside is what is nearer than 20.
//! let dims = Dims::new(48, 48, 48).ok_or("no such size")?;
//! let ball = Voxels::from_fn(dims, |p| -p.map(|c| (c as f32 - 23.5).powi(2)).iter().sum::<f32>().sqrt());
//! let options = BuildOptions { threshold: Threshold::Iso(-20.0), ..BuildOptions::default() };
//! infobyte::build(&ball, &options, &path)?;
//!
//! let model = Model::open(&path)?;
//! let caster = RayCaster::new(&model)?;
//! let hit = caster.first_hit([23.5, 23.5, -100.0], [0.0, 0.0, 1.0])?.ok_or("no hit")?;
//! assert_eq!(hit.position_mm, [23.5, 23.5, 3.5]);
//! assert!(hit.normal.is_some_and(|n| n[2] < -0.99));
//!
//! let request = RenderRequest { width: 256, height: 256, ..RenderRequest::default() };
//! let (image, report) = infobyte::render(&model, &request)?;
//! assert!(report.hits > 10_000);
//! image.write_png(&picture)?;
//! # Ok(())
//! # }
//! ```
//!
//! # A volume on disk
//!
//! ```no_run
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! // A folder of DICOM images, a NIfTI or NRRD file, ... : what it is, is told by its content.
//! let volume = infobyte::open("series/")?;
//! println!("{} voxels of {:?} mm", volume.info().dims, volume.info().spacing_mm);
//! let options = infobyte::BuildOptions {
//!     threshold: infobyte::Threshold::Iso(300.0),
//!     // The memory that the build may add to what the process holds.
//!     memory: infobyte::MemoryCap::Share(8 << 20),
//!     ..Default::default()
//! };
//! infobyte::build(&*volume, &options, "bone.oct")?;
//! # Ok(())
//! # }
//! ```
//!
//! # A model that you have
//!
//! ```
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! # let path = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/v1.0-mapped.oct");
//! let model = infobyte::Model::open(path.as_ref())?;
//! println!("{} skin voxels in {}", model.header().voxels, model.dims());
//! infobyte::render(&model, &infobyte::RenderRequest { width: 64, height: 64, ..Default::default() })?;
//! # Ok(())
//! # }
//! ```
//!
//! What has no samples, such as an analytic body, is built from a [`Solid`](builder::Solid) by
//! [`builder::build_solid`]. Progress, scratch folders and batches are in [`builder`] and [`jobs`].
//!
//! # How data flows
//!
//! ```text
//! source --slabs--> builder (classify, skin, gradient, swap, merge) --> .oct --> load --> render
//! ```
//!
//! | module | what it owns |
//! |---|---|
//! | [`geom`] | dims, Morton codes, affine transforms |
//! | `atomic` (private) | output files that appear whole or not at all |
//! | [`budget`] | sizes in bytes, and what the system accounts to the process |
//! | `mark` (private) | what tells pictures of models from slices |
//! | [`progress`] | how a long job tells how far it is |
//! | `resident` (private) | memory and code that are done with, given back to the system |
//! | `scratch` (private) | nameless files for what does not fit into memory |
//! | [`mod@format`] | the bytes of an `.oct`: header, sections, rank directory, normals, metadata |
//! | `codec` (private) | compressed images, one frame at a time, row by row |
//! | [`facts`] | what readers find, assume and refuse, as values |
//! | [`volume`] | the trait of a volume, its facts, crop, downsample, georeference, spooling |
//! | [`source`] | where voxels come from: raw files, DICOM series, NRRD, NIfTI and others, the synthetic head |
//! | [`catalogue`] | what lies in folders: the walk, the survey, side-cars |
//! | [`builder`] | plan, classify, skin, gradient, swap, merge, atomic output |
//! | [`clean`] | what is done to the occupancy before the build: components, cavities, closing |
//! | [`load`] | a file mapped, checked and offered as a read-only view; verify |
//! | [`mod@render`] | camera, the one traversal kernel, shading, images |
//! | [`jobs`] | what the commands do, one function each |

mod atomic;
pub mod budget;
pub mod builder;
pub mod catalogue;
pub mod clean;
mod codec;
#[cfg(test)]
#[path = "../tests/support/compress.rs"]
mod compress;
mod cpu;
pub mod error;
mod exit;
pub mod facts;
pub mod format;
pub mod geom;
pub mod jobs;
pub mod load;
mod mark;
pub mod progress;
#[cfg(test)]
#[path = "../tests/support/random.rs"]
mod random;
pub mod render;
mod resident;
mod scratch;
pub mod source;
pub mod volume;

pub use budget::MemoryCap;
pub use builder::{BuildOptions, BuildReport, Connectivity, Threshold};
pub use error::{Error, UsageError};
pub use exit::ExitKind;
pub use format::{Channel, Channels};
pub use geom::{Affine, Dims};
pub use jobs::render::{RenderReport, RenderRequest};
pub use load::Model;
pub use render::{Image, RayCaster, SurfacePoint};
pub use source::OpenOptions;
pub use volume::{VolumeInfo, VolumeSource, Voxels};

use std::path::{Path, PathBuf};

/// Opens the volume in a file or a folder, ready to be built from; see [`catalogue::open`] for several files, and
/// for choices such as which of several volumes is meant.
///
/// # Errors
/// [`Error::Source`], whose text names the input and says what was found and what to add.
pub fn open(input: impl Into<PathBuf>) -> Result<Box<dyn VolumeSource>, Error> {
    Ok(catalogue::open(&[input.into()], &OpenOptions::default())?)
}

/// Builds the skin octree of a volume into the file `output`, which appears whole or not at all.
///
/// Memory: [`BuildOptions::memory`]. Temporary disk: about the size of the model.
///
/// # Errors
/// [`Error::Build`]; an old file of that name is untouched then.
pub fn build(
    volume: &dyn VolumeSource,
    options: &BuildOptions,
    output: impl AsRef<Path>,
) -> Result<BuildReport, Error> {
    Ok(builder::build_volume(volume, options, output.as_ref(), &progress::Silent)?)
}

/// Makes a picture of a model; it depends on the model and the request only, not on the machine.
///
/// # Errors
/// [`Error::Render`] for a camera or a size that makes no sense, or a model without a volume.
pub fn render<D: AsRef<[u8]> + Sync>(
    model: &Model<D>,
    request: &RenderRequest,
) -> Result<(Image, RenderReport), Error> {
    Ok(jobs::render::render_view(&model.view(), model.dims(), &model.affine(), request)?)
}
