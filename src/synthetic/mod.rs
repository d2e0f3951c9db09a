//! Volumes that are computed, not read: bodies whose true surface is known, and a head.
//!
#![doc = include_str!("BODIES.md")]
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
use crate::geom::Dims;
use crate::text::names::{DIMS, DTYPE, SKIP};
use crate::volume::{ImageKind, ScalarType, SourceDescription, SourceError, VolumeSource};
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
    match parse(&input.to_string_lossy()).map_err(|fault| fault.at(input))? {
        Request::Body(spec) => Ok(Box::new(AnalyticVolume::new(*spec))),
        Request::Head(head) => Ok(head),
    }
}

/// The body that a text such as `synthetic:torus@128` describes, with its true surface.
///
/// # Errors
/// [`SourceError`], as [`open`]; also for the head, whose surface is not known in closed form.
pub fn analytic(text: &str) -> Result<AnalyticVolume, SourceError> {
    let wrong = |fault: Fault| fault.at(text);
    match parse(text).map_err(wrong)? {
        Request::Body(spec) => Ok(AnalyticVolume::new(*spec)),
        Request::Head(_) => Err(wrong(spec::no_body(spec::HEAD, &spec::bodies())).into()),
    }
}

/// The refusal of a size from the caller.
pub(crate) fn described() -> Fault {
    usage!("says itself how large it is; {DIMS}, {DTYPE} and {SKIP} are for raw volumes")
}

/// Description of a computed volume.
fn description(name: &'static str, dims: Dims, scalar: ScalarType) -> SourceDescription {
    SourceDescription {
        format: "synthetic".into(),
        name: name.into(),
        files: 0,
        bytes: dims.voxels() * scalar.bytes() as u64,
        kind: ImageKind::Synthetic(name),
        labels: Vec::new(),
        treatments: Vec::new(),
    }
}

fn parse(text: &str) -> Result<Request, Fault> {
    spec::parse(text.strip_prefix(PREFIX).unwrap_or(text))
}
