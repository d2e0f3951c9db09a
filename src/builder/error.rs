//! Why a build stops, as values; the sentences are written in `jobs`.

use std::error::Error;
use std::io;
use std::path::PathBuf;

use crate::exit::ExitKind;
use crate::format::{Channel, FormatError, Selection, SurfaceKind};
use crate::volume::SourceError;

/// A build that cannot be finished; the old target, if any, is untouched.
#[non_exhaustive]
#[derive(Debug)]
pub enum BuildError {
    /// The volume cannot be read.
    Source(SourceError),
    /// The cap is too small even for one thread.
    BudgetTooSmall {
        /// The input.
        name: String,
        /// The cap.
        limit_bytes: u64,
        /// The smallest cap that works.
        minimum_bytes: u64,
    },
    /// No voxel lies in the range.
    EmptyResult {
        /// The input.
        name: String,
        /// What was asked for.
        sought: Sought,
        /// Smallest value.
        min: f64,
        /// Largest value.
        max: f64,
    },
    /// No voxel of the solid is inside.
    NothingInside {
        /// The solid.
        name: String,
    },
    /// Nothing of the surface can be seen from where the model will be looked at.
    NothingVisible {
        /// The input.
        name: String,
        /// Boxes of the surface.
        boxes: u64,
    },
    /// The solid does not have a channel that was asked for.
    NoChannel {
        /// The solid.
        name: String,
        /// The channel.
        channel: Channel,
        /// What was to be built.
        surface: SurfaceKind,
    },
    /// Normals of 12 or 24 bits were asked for where there are only those of 16.
    NormalBits {
        /// The input.
        name: String,
    },
    /// Cells are one more than voxels along each axis, and the volume has as many as can be.
    NoRoomForCells {
        /// The input.
        name: String,
    },
    /// Every sample is NaN or infinite.
    NoNumbers {
        /// The input.
        name: String,
    },
    /// The range ends before it begins, or a limit is NaN.
    EmptyRange {
        /// Lowest value asked for.
        lo: f64,
        /// Highest value asked for.
        hi: f64,
    },
    /// The scratch file cannot be written.
    Scratch {
        /// The folder.
        path: PathBuf,
        /// The system's reason, or a [`ScratchFault`].
        cause: io::Error,
    },
    /// The output cannot be written.
    Output {
        /// The target.
        path: PathBuf,
        /// The system's reason.
        cause: io::Error,
    },
    /// The metadata cannot be encoded.
    Format(FormatError),
    /// Threads cannot be started.
    Threads {
        /// How many.
        threads: usize,
        /// The system's reason.
        cause: io::Error,
    },
}

impl BuildError {
    /// What the input is called, where that is told.
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

    /// The same where so much is held beside the cap that was too small.
    pub(crate) fn beside(mut self, held_bytes: u64) -> Self {
        if let Self::BudgetTooSmall { limit_bytes, minimum_bytes, .. } = &mut self {
            *limit_bytes = limit_bytes.saturating_add(held_bytes);
            *minimum_bytes = minimum_bytes.saturating_add(held_bytes);
        }
        self
    }
}

/// What a range without voxels was.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Sought {
    /// Otsu's threshold, which needs two different values.
    Split,
    /// The voxels of this range.
    Within(Selection),
}

/// What is wrong with a scratch file that can be read; held by the [`io::Error`] of [`BuildError::Scratch`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ScratchFault {
    /// Its contents are not those that were written.
    Changed,
    /// It would have more bricks than the machine can address.
    TooManyBricks,
}

impl Error for ScratchFault {}

impl From<ScratchFault> for io::Error {
    fn from(fault: ScratchFault) -> Self {
        Self::other(fault)
    }
}

impl Error for BuildError {
    fn source(&self) -> Option<&(dyn Error + 'static)> {
        match self {
            Self::Source(inner) => inner.source(),
            Self::Format(inner) => inner.source(),
            Self::Scratch { cause, .. } | Self::Output { cause, .. } | Self::Threads { cause, .. } => {
                Some(cause)
            }
            Self::BudgetTooSmall { .. }
            | Self::EmptyResult { .. }
            | Self::NothingInside { .. }
            | Self::NothingVisible { .. }
            | Self::NoChannel { .. }
            | Self::NormalBits { .. }
            | Self::NoRoomForCells { .. }
            | Self::NoNumbers { .. }
            | Self::EmptyRange { .. } => None,
        }
    }
}

impl From<SourceError> for BuildError {
    fn from(cause: SourceError) -> Self {
        Self::Source(cause)
    }
}

impl From<FormatError> for BuildError {
    fn from(cause: FormatError) -> Self {
        Self::Format(cause)
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
        }
    }
}
