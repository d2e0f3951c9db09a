//! Volumes that are computed, not read: bodies whose true surface is known, and a head.
//!
//! `synthetic:NAME@N?key=value,key=value` is an input like a file, for every command that takes a volume:
//!
//! ```text
//! synthetic:torus@192?noise=0.025          a torus with 2.5 % noise, 192 voxels a side
//! synthetic:sphere@192?spacing=1x1x6,slab=1   a ball in slices 6 times as thick as their pixels, which they average
//! synthetic:box@256x256x128?sample=binary  a label map
//! ```
//!
//! | body | shape | its parameters, with lengths in samples of the finest spacing |
//! |---|---|---|
//! | `sphere` | a ball | `radius` |
//! | `ellipsoid` | | `radii=AxBxC`, `turn=XxYxZ` in degrees about x, then y, then z |
//! | `torus` | | `ring`, `tube`, `turn` |
//! | `box` | with sharp edges, turned | `edges=AxBxC`, `turn` |
//! | `slab` | between two planes, through the whole volume | `thickness` (6), `turn` |
//! | `gyroid` | one half of the gyroid | `period` |
//! | `marschner-lobb` | Marschner and Lobb's test signal (1994), from 1/2 on | `frequency` (6), `depth` (0.25) |
//! | `menger` | Menger's sponge | `levels` |
//! | `checkerboard`, `comb`, `salt` | every other cube; plates joined at last; cubes by chance | `cell` (1); for salt `share` (0.01) |
//! | `head` | a CT-like head in Hounsfield units ([`SyntheticHead`]) | none |
//!
//! | sampling | |
//! |---|---|
//! | `sample` | `density`, 0 in air and 1 in the body with the surface at 1/2, or `binary`: 1 inside, 0 outside |
//! | `psf` | standard deviation of the point spread in samples of the finest spacing: 0.8 |
//! | `slab` | thickness that a slice averages, as a part of the distance between slices: 0 |
//! | `noise`, `seed` | standard deviation of noise as a part of the step: 0; start of the random sequence: 1 |
//! | `bits` | bits of a sample: 16; 4 to 16, or 32 for single precision |
//! | `spacing` | in mm: 1x1x1. With `@N`, a coarser axis has proportionally fewer samples |
//!
//! [`AnalyticVolume`] gives the true surface along with the samples.
//!
//! | file | content |
//! |---|---|
//! | `spec` | the text |
//! | `volume` | samples |
//! | `body` | distances, normals, rays of any body |
//! | `smooth`, `wave`, `lattice` | the three kinds of bodies |
//! | `math` | functions with the same bits everywhere |
//! | `head` | the head |

mod body;
mod head;
mod lattice;
mod math;
mod smooth;
mod spec;
#[cfg(test)]
mod tests;
mod volume;
mod wave;

use std::path::Path;

pub use body::{Body, TrueSurface};
pub use head::SyntheticHead;
pub use volume::AnalyticVolume;

use crate::fault::{Fault, usage};
use crate::text::names::{DIMS, DTYPE, SKIP};
use crate::volume::{SourceError, VolumeSource};
use spec::{PREFIX, Request};

/// True if an input describes a synthetic volume. (`./synthetic:...` is a file.)
pub(crate) fn is_synthetic(input: &Path) -> bool {
    input.to_str().is_some_and(|text| text.starts_with(PREFIX))
}

/// The volume that an input describes: a body or the head.
///
/// # Errors
/// [`SourceError`], with the fault and the valid choices.
pub fn open(input: &Path) -> Result<Box<dyn VolumeSource>, SourceError> {
    let wrong = |fault| usage(input, fault);
    let given = input.to_string_lossy();
    match parse(&given).map_err(wrong)? {
        Request::Body(spec) => Ok(Box::new(AnalyticVolume::new(*spec))),
        Request::Head(side) => match SyntheticHead::new(side) {
            Some(head) => Ok(Box::new(head)),
            None => Err(wrong(spec::wrong_size(&side.to_string()))),
        },
    }
}

/// The body that a text such as `synthetic:torus@128` describes, with its true surface.
///
/// # Errors
/// [`SourceError`], as [`open`]; also for the head, whose surface is not known in closed form.
pub fn analytic(text: &str) -> Result<AnalyticVolume, SourceError> {
    let wrong = |fault| usage(Path::new(text), fault);
    match parse(text).map_err(wrong)? {
        Request::Body(spec) => Ok(AnalyticVolume::new(*spec)),
        Request::Head(_) => Err(wrong(spec::no_body(spec::HEAD, &spec::BODIES))),
    }
}

/// The error for a synthetic input.
pub(crate) fn usage(input: &Path, fault: Fault) -> SourceError {
    fault.at(input).into()
}

/// The refusal of a size from the caller.
pub(crate) fn described() -> Fault {
    usage!("says itself how large it is; {DIMS}, {DTYPE} and {SKIP} are for raw volumes")
}

fn parse(text: &str) -> Result<Request, Fault> {
    spec::parse(text.strip_prefix(PREFIX).unwrap_or(text))
}
