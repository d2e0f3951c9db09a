//! Why cleaning stops, as values; the sentences are written in `jobs`.

use std::error::Error;
use std::io;

use crate::builder::BuildError;
use crate::exit::ExitKind;
use crate::format::Selection;

/// A volume that cannot be cleaned.
#[non_exhaustive]
#[derive(Debug)]
pub enum CleanError {
    /// The volume cannot be read, the cap is too small, or scratch files fail: as in the build that follows.
    Build(BuildError),
    /// A closing of more than 2 voxels, or no components or too many to keep.
    Options {
        /// Radius of the closing.
        close: u32,
        /// Components to keep, if it was asked for.
        keep_largest: Option<u32>,
    },
    /// The range lies between two samples of the volume's type.
    NoSample {
        /// The range.
        selection: Selection,
    },
    /// Every component would be removed.
    NothingKept {
        /// The input.
        name: String,
        /// Voxels of the largest component.
        largest: u64,
    },
}

impl Error for CleanError {
    fn source(&self) -> Option<&(dyn Error + 'static)> {
        match self {
            Self::Build(inner) => inner.source(),
            Self::Options { .. } | Self::NoSample { .. } | Self::NothingKept { .. } => None,
        }
    }
}

impl From<BuildError> for CleanError {
    fn from(cause: BuildError) -> Self {
        Self::Build(cause)
    }
}

impl CleanError {
    /// Exit kind.
    pub fn kind(&self) -> ExitKind {
        match self {
            Self::Build(e) => e.kind(),
            Self::Options { .. } | Self::NoSample { .. } => ExitKind::Usage,
            Self::NothingKept { .. } => ExitKind::Input,
        }
    }
}

/// A slice has more than 2^32 runs; held by the [`io::Error`] of a scratch file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TooManyRuns;

impl Error for TooManyRuns {}

impl From<TooManyRuns> for io::Error {
    fn from(fault: TooManyRuns) -> Self {
        Self::other(fault)
    }
}
