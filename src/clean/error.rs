//! Errors of cleaning, as values with their sentences.

use std::io;
use std::path::Path;

use thiserror::Error;

use crate::builder::BuildError;
use crate::exit::{ExitKind, opaque_error};
use crate::format::Selection;
use crate::text::names::DROP_BELOW;

/// Largest value of [`CleanOptions::keep_largest`](super::CleanOptions::keep_largest).
pub const MAX_LARGEST: u32 = 4000;

opaque_error! {
    /// A volume that cannot be cleaned.
    CleanError(CleanFault)
}

/// Faults of cleaning, with their sentences.
#[derive(Debug, Error)]
pub(crate) enum CleanFault {
    #[error(transparent)]
    Build(BuildError),
    #[error("gaps can be closed by 1 or 2 voxels, and 1 to {MAX_LARGEST} components kept")]
    Options {
        close: u32,
        /// Number of components to keep, if chosen.
        keep_largest: Option<u32>,
    },
    #[error("the range holds no sample of this volume's type")]
    NoSample { selection: Selection },
    #[error("{name}: no component is left; the largest has {largest} voxels: choose {DROP_BELOW} below that")]
    NothingKept { name: String, largest: u64 },
}

impl CleanFault {
    fn kind(&self) -> ExitKind {
        match self {
            Self::Build(e) => e.kind(),
            Self::Options { .. } => ExitKind::Usage,
            Self::NoSample { .. } | Self::NothingKept { .. } => ExitKind::Input,
        }
    }

    fn path(&self) -> Option<&Path> {
        match self {
            Self::Build(e) => e.path(),
            _ => None,
        }
    }
}

impl CleanError {
    /// The smallest cap that works, in bytes, if the memory was too small.
    pub fn minimum_bytes(&self) -> Option<u64> {
        match self.fault() {
            CleanFault::Build(e) => e.minimum_bytes(),
            _ => None,
        }
    }
}

impl CleanError {
    /// True if no component is left.
    pub(crate) fn is_empty(&self) -> bool {
        matches!(self.fault(), CleanFault::NothingKept { .. })
    }

    /// The name of the input, where the error holds it.
    pub(crate) fn input_name(&mut self) -> Option<&mut String> {
        match self.fault_mut() {
            CleanFault::NothingKept { name, .. } => Some(name),
            CleanFault::Build(inner) => inner.input_name(),
            _ => None,
        }
    }
}

impl From<BuildError> for CleanError {
    fn from(cause: BuildError) -> Self {
        CleanFault::Build(cause).into()
    }
}

/// A slice has more than 2^32 runs; held by the [`io::Error`] of a scratch file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error("a slice has more than 2^32 runs")]
pub(crate) struct TooManyRuns;

impl From<TooManyRuns> for io::Error {
    fn from(fault: TooManyRuns) -> Self {
        Self::other(fault)
    }
}
