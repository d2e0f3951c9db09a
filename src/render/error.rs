//! Errors of making a picture, as values with their sentences.

use std::io;
use std::path::{Path, PathBuf};

use thiserror::Error;

use super::ray::BadRay;
use crate::budget::{ExactSize, SizeArgument};
use crate::exit::{ExitKind, opaque_error};
use crate::fault::{Fault, conversions};
use crate::load::LoadError;
use crate::text::names::MEMORY;
use crate::text::{shown, writing};

opaque_error! {
    /// A picture that cannot be made or written.
    RenderError(RenderFault)
}

/// Fault of a picture, with its sentence.
#[derive(Debug, Error)]
pub(crate) enum RenderFault {
    #[error(transparent)]
    Camera(Fault),
    #[error(transparent)]
    Said(Fault),
    #[error(transparent)]
    Ray(BadRay),
    #[error(transparent)]
    Model(LoadError),
    #[error("ray {index} (from 0): {fault}")]
    RayAt { index: usize, fault: BadRay },
    #[error(
        "a picture of {width}x{height} is not possible; choose sides of 1 to {most_side} and at most {most_pixels} pixels"
    )]
    Size { width: u32, height: u32, most_side: u32, most_pixels: u64 },
    #[error("{threads} threads cannot be started ({cause}); choose fewer")]
    Threads {
        threads: usize,
        #[source]
        cause: io::Error,
    },
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
}

impl RenderFault {
    fn kind(&self) -> ExitKind {
        match self {
            Self::Camera(_)
            | Self::Ray(_)
            | Self::RayAt { .. }
            | Self::Size { .. }
            | Self::Threads { .. } => ExitKind::Usage,
            Self::Said(fault) => fault.exit(),
            Self::Model(error) => error.kind(),
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

conversions!(RenderError {
    fault: Fault => RenderFault::Said(fault).into(),
    cause: LoadError => RenderFault::Model(cause).into(),
    fault: BadRay => RenderFault::Ray(fault).into(),
});
