//! Why a build stops.

use std::io;
use std::path::PathBuf;

use thiserror::Error;

use crate::budget::SizeArgument;
use crate::error::ExitKind;
use crate::format::{Channel, FormatError};
use crate::volume::SourceError;

/// A build that cannot be finished; the old target, if any, is untouched.
#[non_exhaustive]
#[derive(Debug, Error)]
pub enum BuildError {
    /// The volume cannot be read.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// The cap is too small even for one thread.
    #[error("{name}: --memory {limit} is too small; the smallest that works is --memory {minimum}", limit = SizeArgument(*limit_bytes), minimum = SizeArgument(*minimum_bytes))]
    BudgetTooSmall {
        /// The input.
        name: String,
        /// The cap.
        limit_bytes: u64,
        /// The smallest cap that works.
        minimum_bytes: u64,
    },
    /// No voxel lies in the range.
    #[error(
        "{name}: no voxel lies in {range}; the values of this volume run from {min} to {max}: choose --iso or --range within them"
    )]
    EmptyResult {
        /// The input.
        name: String,
        /// The range as text.
        range: String,
        /// Smallest value.
        min: f64,
        /// Largest value.
        max: f64,
    },
    /// No voxel of the solid is inside.
    #[error("{name}: no voxel is inside; choose a finer grid, or check that the solid lies in it")]
    NothingInside {
        /// The solid.
        name: String,
    },
    /// The solid does not have a channel that was asked for.
    #[error("{name}: does not have the channel '{channel}'; leave it out")]
    NoChannel {
        /// The solid.
        name: String,
        /// The channel.
        channel: Channel,
    },
    /// Cleaning removes every voxel.
    #[error("{name}: no component is left; the largest has {largest} voxels: choose --drop-below below that")]
    NothingKept {
        /// The input.
        name: String,
        /// Voxels of the largest component.
        largest: u64,
    },
    /// Every sample is NaN or infinite.
    #[error("{name}: holds no finite value; check --dtype")]
    NoNumbers {
        /// The input.
        name: String,
    },
    /// The options contradict each other.
    #[error("{0}")]
    Usage(String),
    /// The scratch file cannot be written.
    #[error("scratch file in {path}: {cause}; free some space or choose another folder with --scratch", path = path.display())]
    Scratch {
        /// The folder.
        path: PathBuf,
        /// The system's reason.
        #[source]
        cause: io::Error,
    },
    /// The output cannot be written.
    #[error("{path}: cannot be written ({cause}); check the folder and its free space", path = path.display())]
    Output {
        /// The target.
        path: PathBuf,
        /// The system's reason.
        #[source]
        cause: io::Error,
    },
    /// The metadata cannot be encoded.
    #[error(transparent)]
    Format(#[from] FormatError),
    /// Threads cannot be started.
    #[error("worker threads cannot be started ({0}); try --threads 1")]
    Threads(String),
}

impl BuildError {
    /// Exit kind.
    pub fn kind(&self) -> ExitKind {
        match self {
            Self::Source(e) => e.kind(),
            Self::BudgetTooSmall { .. } => ExitKind::Budget,
            Self::EmptyResult { .. }
            | Self::NothingInside { .. }
            | Self::NothingKept { .. }
            | Self::NoNumbers { .. } => ExitKind::Input,
            Self::Usage(_) | Self::NoChannel { .. } => ExitKind::Usage,
            Self::Scratch { .. } | Self::Output { .. } | Self::Threads(_) => ExitKind::Io,
            Self::Format(_) => ExitKind::Input,
        }
    }
}
