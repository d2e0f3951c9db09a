//! Why a build stops, as a value with its sentence.

#![expect(missing_docs, reason = "the sentence of each variant says it")]

use std::fmt;
use std::io;
use std::path::PathBuf;

use thiserror::Error;

use crate::budget::{ExactSize, SizeArgument};
use crate::exit::ExitKind;
use crate::format::{Channel, FormatError, Selection, SurfaceKind};
use crate::progress::Stopped;
use crate::text::names::{
    DTYPE, ISO, MEMORY, NORMAL_BITS, RANGE, ROI, SCRATCH, SURFACE, THREADS, VISIBLE_FROM,
};
use crate::text::{Short, reading, shown, writing};
use crate::volume::SourceError;

/// A build that cannot be finished; the old target, if any, is untouched.
#[non_exhaustive]
#[derive(Debug, Error)]
pub enum BuildError {
    #[error(transparent)]
    Source(SourceError),
    #[error("{name}: {MEMORY} {} is too small; the smallest that works is {MEMORY} {}", ExactSize(*.limit_bytes), SizeArgument(*.minimum_bytes))]
    BudgetTooSmall { name: String, limit_bytes: u64, minimum_bytes: u64 },
    #[error("{name}: no voxel lies in {sought}; the values of this volume run from {} to {}: choose {ISO} or {RANGE} within them", Short(*.min), Short(*.max))]
    EmptyResult { name: String, sought: Criterion, min: f64, max: f64 },
    #[error("{name}: no voxel is inside; choose a finer grid, or check that the solid lies in it")]
    NothingInside { name: String },
    #[error(
        "{name}: none of the {boxes} boxes of its surface can be seen from there; give another {VISIBLE_FROM}"
    )]
    NothingVisible { name: String, boxes: u64 },
    #[error("{name}: {}", no_channel(*.channel, *.surface))]
    NoChannel { name: String, channel: Channel, surface: SurfaceKind },
    #[error(
        "{name}: only skin voxels of volumes have normals of 12 or 24 bits; leave out {NORMAL_BITS}, or use {SURFACE} skin"
    )]
    NormalBits { name: String },
    #[error(
        "{name}: a side of 65536 voxels is too long for cells; use {SURFACE} skin, or a part of the volume with {ROI}"
    )]
    NoRoomForCells { name: String },
    #[error(
        "{name}: holds no finite value; check that it is the right file, and of headerless voxels check {DTYPE}"
    )]
    NoNumbers { name: String },
    #[error("the range is empty: write it as LO..HI with LO <= HI")]
    EmptyRange {
        /// Lowest value asked for.
        lo: f64,
        /// Highest value asked for.
        hi: f64,
    },
    #[error("scratch file in {}: {cause}; {}", shown(.path), reading(.cause, format_args!("free some space or choose another folder with {SCRATCH}")))]
    Scratch {
        path: PathBuf,
        #[source]
        cause: io::Error,
    },
    #[error("{}: cannot be written ({cause}); {}", shown(.path), writing(.cause))]
    Output {
        path: PathBuf,
        #[source]
        cause: io::Error,
    },
    #[error(transparent)]
    Format(#[from] FormatError),
    #[error("worker threads cannot be started ({cause}); try {THREADS} 1")]
    Threads {
        threads: usize,
        #[source]
        cause: io::Error,
    },
    #[error("{Stopped}")]
    Stopped,
}

fn no_channel(channel: Channel, surface: SurfaceKind) -> String {
    match (channel, surface) {
        (Channel::Value, SurfaceKind::Cells) => format!(
            "cells lie where the value is the threshold, so there is no channel 'value'; leave it out, or use {SURFACE} skin"
        ),
        (Channel::Color | Channel::Material, SurfaceKind::Cells) => format!(
            "cells hold the shape of a surface alone, so there is no channel '{channel}'; leave it out, or use {SURFACE} skin"
        ),
        _ => format!("does not have the channel '{channel}'; leave it out"),
    }
}

impl BuildError {
    /// Name of the input, where the error has one.
    pub(crate) fn input_name(&mut self) -> Option<&mut String> {
        match self {
            Self::BudgetTooSmall { name, .. }
            | Self::EmptyResult { name, .. }
            | Self::NothingInside { name }
            | Self::NothingVisible { name, .. }
            | Self::NoChannel { name, .. }
            | Self::NormalBits { name }
            | Self::NoRoomForCells { name }
            | Self::NoNumbers { name } => Some(name),
            _ => None,
        }
    }

    /// The same error with so much more held outside the cap that was too small.
    pub(crate) fn beside(mut self, held_bytes: u64) -> Self {
        if let Self::BudgetTooSmall { limit_bytes, minimum_bytes, .. } = &mut self {
            *limit_bytes = limit_bytes.saturating_add(held_bytes);
            *minimum_bytes = minimum_bytes.saturating_add(held_bytes);
        }
        self
    }
}

/// A range without voxels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Criterion {
    /// Otsu's method does not give a range, because all values are equal.
    Split,
    /// No value lies within the range.
    Within(Selection),
}

impl fmt::Display for Criterion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Split => f.write_str("a range by Otsu's method, which needs two different values"),
            Self::Within(range) if range.hi.is_infinite() => {
                write!(f, "the range from {} up", Short(range.lo))
            }
            Self::Within(range) => write!(f, "the range {}..{}", Short(range.lo), Short(range.hi)),
        }
    }
}

/// Damage of a scratch file that can be read; held by the [`io::Error`] of [`BuildError::Scratch`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum ScratchFault {
    #[error("its contents were changed by someone else")]
    Changed,
    #[error("the model has too many bricks for this machine")]
    TooManyBricks,
}

impl From<SourceError> for BuildError {
    fn from(cause: SourceError) -> Self {
        match cause {
            SourceError::Stopped => Self::Stopped,
            cause => Self::Source(cause),
        }
    }
}

impl From<Stopped> for BuildError {
    fn from(_: Stopped) -> Self {
        Self::Stopped
    }
}

impl From<ScratchFault> for io::Error {
    fn from(fault: ScratchFault) -> Self {
        Self::other(fault)
    }
}

impl BuildError {
    /// Exit kind.
    pub fn kind(&self) -> ExitKind {
        match self {
            Self::Source(e) => e.kind(),
            Self::BudgetTooSmall { .. } => ExitKind::Budget,
            Self::EmptyResult { .. } | Self::NothingInside { .. } | Self::NoNumbers { .. } => ExitKind::Input,
            Self::EmptyRange { .. }
            | Self::NothingVisible { .. }
            | Self::NoChannel { .. }
            | Self::NormalBits { .. }
            | Self::NoRoomForCells { .. } => ExitKind::Usage,
            Self::Scratch { .. } | Self::Output { .. } | Self::Threads { .. } => ExitKind::Io,
            Self::Format(_) => ExitKind::Input,
            Self::Stopped => ExitKind::Stopped,
        }
    }
}
