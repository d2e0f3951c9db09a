//! Why cleaning stops, as a value with its sentence.

#![expect(missing_docs, reason = "the sentence of each variant says it")]

use std::io;

use thiserror::Error;

use crate::builder::BuildError;
use crate::exit::ExitKind;
use crate::format::Selection;
use crate::text::names::DROP_BELOW;

/// Most components that can be asked for by [`CleanOptions::keep_largest`](super::CleanOptions::keep_largest).
pub const MAX_LARGEST: u32 = 4000;

/// A volume that cannot be cleaned.
#[non_exhaustive]
#[derive(Debug, Error)]
pub enum CleanError {
    #[error(transparent)]
    Build(#[from] BuildError),
    #[error("gaps can be closed by 1 or 2 voxels, and 1 to {MAX_LARGEST} components kept")]
    Options {
        close: u32,
        /// Components to keep, if it was asked for.
        keep_largest: Option<u32>,
    },
    #[error("the range holds no sample of this volume's type")]
    NoSample { selection: Selection },
    #[error("{name}: no component is left; the largest has {largest} voxels: choose {DROP_BELOW} below that")]
    NothingKept { name: String, largest: u64 },
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
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error("a slice has more than 2^32 runs")]
pub struct TooManyRuns;

impl From<TooManyRuns> for io::Error {
    fn from(fault: TooManyRuns) -> Self {
        Self::other(fault)
    }
}
