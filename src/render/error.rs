//! Errors of making a picture, as values with their sentences.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use thiserror::Error;

use super::ray::BadRay;
use crate::budget::{ExactSize, SizeArgument};
use crate::exit::{ExitKind, opaque_error};
use crate::load::LoadError;
use crate::text::names::{EYE, LOOK_AT, MEMORY, SURFACE, TRAVERSAL, UP};
use crate::text::{shown, writing};

opaque_error! {
    /// A picture that cannot be made or written.
    RenderError(RenderFault)
}

/// Fault of a picture, with its sentence.
#[derive(Debug, Error)]
pub(crate) enum RenderFault {
    #[error(transparent)]
    Camera(CameraFault),
    #[error(transparent)]
    Ray(BadRay),
    #[error(transparent)]
    Model(LoadError),
    #[error("ray {index} (from 0): {fault}")]
    RayAt { index: usize, fault: BadRay },
    #[error("{rays} origins and {others} directions or answers; give as many of each")]
    RayCount { rays: usize, others: usize },
    #[error(
        "a picture of {width}x{height} is not possible; choose sides of 1 to {most_side} and at most {most_pixels} pixels"
    )]
    Size { width: u32, height: u32, most_side: u32, most_pixels: u64 },
    #[error("the picture was made without {0}; ask for it")]
    NoLayer(Layer),
    #[error("{threads} threads cannot be started ({cause}); choose fewer")]
    Threads {
        threads: usize,
        #[source]
        cause: io::Error,
    },
    #[error(
        "a grid of 2^{depth} cells a side is too large to be compared cell by cell; choose a model of at most 2^{most}"
    )]
    TooDeep { depth: u32, most: u32 },
    #[error(
        "discrete rays meet voxels, and this model has cells with a surface within; leave {TRAVERSAL} exact, or build it with {SURFACE} skin"
    )]
    DiscreteCells,
    #[error(
        "discrete rays meet the voxels of whole models, and this one is cut or lacks some labels; leave {TRAVERSAL} exact"
    )]
    DiscreteCut,
    #[error(
        "the model's axes are (nearly) parallel, so it has no volume to look at; check its spacing and orientation"
    )]
    SingularAffine,
    #[error("{MEMORY} {} is too small for this picture; the smallest that works is {MEMORY} {}", ExactSize(*.limit_bytes), SizeArgument(*.minimum_bytes))]
    Memory { limit_bytes: u64, minimum_bytes: u64 },
    #[error("{}: cannot be written ({cause}); {}", shown(.path), writing(.cause))]
    Write {
        path: PathBuf,
        #[source]
        cause: io::Error,
    },
    #[error("the picture was stopped by its caller")]
    Stopped,
    #[error("{0}")]
    Form(&'static str),
}

/// A fault of a camera.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Error)]
pub(crate) enum CameraFault {
    #[error("the field of view is {degrees} degrees; choose {least} to {most}")]
    FieldOfView { degrees: f64, least: f64, most: f64 },
    #[error("the magnification is {factor}; choose {least} to {most}")]
    Zoom { factor: f64, least: f64, most: f64 },
    #[error("a camera coordinate is not a finite number")]
    NotFinite,
    #[error("the eye is at the point that it looks at; move one of them ({EYE}, {LOOK_AT})")]
    EyeInTarget,
    #[error(
        "the eye is too far from the point that it looks at for any picture; give both in mm, near the model ({EYE}, {LOOK_AT})"
    )]
    TooFar,
    #[error("the up direction has no length; give another ({UP})")]
    UpWithoutLength,
    #[error("the up direction is along the line of sight; give another ({UP})")]
    UpAlongSight,
}

/// A layer of a picture besides its colours.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Layer {
    /// Depth.
    Depth,
    /// World normals.
    Normals,
    /// Numbers of boxes.
    Ids,
}

impl fmt::Display for Layer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Depth => "depth",
            Self::Normals => "normals",
            Self::Ids => "numbers of boxes",
        })
    }
}

impl RenderFault {
    fn kind(&self) -> ExitKind {
        match self {
            Self::Camera(_)
            | Self::Ray(_)
            | Self::RayAt { .. }
            | Self::RayCount { .. }
            | Self::Size { .. }
            | Self::NoLayer(_)
            | Self::DiscreteCells
            | Self::DiscreteCut
            | Self::Threads { .. }
            | Self::TooDeep { .. }
            | Self::Form(_) => ExitKind::Usage,
            Self::Model(error) => error.kind(),
            Self::SingularAffine => ExitKind::Input,
            Self::Memory { .. } => ExitKind::Budget,
            Self::Write { .. } => ExitKind::Io,
            Self::Stopped => ExitKind::Stopped,
        }
    }

    fn path(&self) -> Option<&Path> {
        match self {
            Self::Write { path, .. } => Some(path),
            Self::Model(error) => error.path(),
            _ => None,
        }
    }
}

impl RenderError {
    /// The smallest sufficient memory cap in bytes, if the memory was too small.
    pub fn minimum_bytes(&self) -> Option<u64> {
        match self.fault() {
            RenderFault::Memory { minimum_bytes, .. } => Some(*minimum_bytes),
            _ => None,
        }
    }
}

impl From<CameraFault> for RenderError {
    fn from(fault: CameraFault) -> Self {
        RenderFault::Camera(fault).into()
    }
}

impl From<LoadError> for RenderError {
    fn from(cause: LoadError) -> Self {
        RenderFault::Model(cause).into()
    }
}

impl From<BadRay> for RenderError {
    fn from(fault: BadRay) -> Self {
        RenderFault::Ray(fault).into()
    }
}
