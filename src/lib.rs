//! Surface octrees out of core: volumes in, one infobyte per node out, exact rays through them.
//!
//! The library revives M. Tsygankov's *Hierarchical Discrete Ray Tracing in Octrees*. A volume is
//! classified into inside and outside, only its *skin* is kept, and the skin lives in an octree with
//! one **infobyte** (child mask) per non-empty node. Data flows one way:
//!
//! ```text
//! source --slabs--> builder (classify, skin, gradient, swap, merge) --> .oct --> load --> render
//! ```
//!
//! | module | what it owns |
//! |---|---|
//! | [`geom`] | dims, Morton codes, affine transforms |
//! | [`atomic`] | output files that appear whole or not at all |
//! | [`budget`] | sizes in bytes, and what the system accounts to the process |
//! | [`progress`] | how a long job tells how far it is |
//! | [`resident`] | memory and code that are done with, given back to the system |
//! | [`scratch`] | nameless files for what does not fit into memory |
//! | [`mod@format`] | the bytes of an `.oct`: header, sections, rank directory, normals, metadata |
//! | `codec` (private) | compressed images, one frame at a time, row by row |
//! | [`facts`] | what readers find, assume and refuse, as values |
//! | [`volume`] | the trait of a volume, its facts, crop, downsample, georeference, spooling |
//! | [`source`] | where voxels come from: raw files, DICOM series, NRRD, NIfTI and others, the synthetic head |
//! | [`catalogue`] | what lies in folders: the walk, the survey, side-cars |
//! | [`builder`] | plan, classify, skin, gradient, swap, merge, atomic output |
//! | [`clean`] | what is done to the occupancy before the build: components, cavities, closing |
//! | [`load`] | a file mapped, checked and offered as a read-only view; verify |
//! | [`render`] | camera, the one traversal kernel, shading, images |
//! | [`jobs`] | what the commands do, one function each |

pub mod atomic;
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
pub mod facts;
pub mod format;
pub mod geom;
pub mod jobs;
pub mod load;
pub mod progress;
#[cfg(test)]
#[path = "../tests/support/random.rs"]
mod random;
pub mod render;
pub mod resident;
pub mod scratch;
pub mod source;
pub mod volume;

pub use error::{Error, ExitKind, UsageError};
