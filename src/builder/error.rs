//! Errors of a build, as values with their sentences.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use thiserror::Error;

use super::parts::PartFault;
use crate::budget::{ExactSize, SizeArgument};
use crate::exit::{ExitKind, opaque_error};
use crate::fault::{Fault, conversions, unfit, usage};
use crate::format::{FormatError, Selection};
use crate::progress::Stopped;
use crate::text::names::{DTYPE, ISO, MEMORY, RANGE, ROI, SCRATCH, SURFACE, THREADS};
use crate::text::{Short, shown, writing};
use crate::volume::{SourceError, SourceFault};

opaque_error! {
    /// A build that cannot be finished; the old target, if any, is untouched.
    BuildError(BuildFault)
}

/// Fault of a build, with its sentence.
#[derive(Debug, Error)]
pub(crate) enum BuildFault {
    #[error(transparent)]
    Source(SourceError),
    #[error("{name}: {MEMORY} {} is too small; {MEMORY} {} works", ExactSize(*.limit_bytes), SizeArgument(*.minimum_bytes))]
    BudgetTooSmall { name: String, limit_bytes: u64, minimum_bytes: u64 },
    #[error("{name}: no voxel lies in {sought}; the values of this volume run from {} to {}: choose {ISO} or {RANGE} within them", Short(*.min), Short(*.max))]
    EmptyResult { name: String, sought: Criterion, min: f64, max: f64 },
    #[error("{}{fault}", named(.name))]
    Said {
        /// Name of the input; empty for a fault of the options alone.
        name: String,
        fault: Fault,
    },
    #[error(
        "{name}: holds no finite value; check that it is the right file, and of headerless voxels check {DTYPE}"
    )]
    NoNumbers { name: String },
    #[error("scratch file in {}: {cause}; {} ({SCRATCH})", shown(.path), writing(.cause))]
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
    #[error("{}: {fault}", shown(.path))]
    Part { path: PathBuf, fault: PartFault },
    #[error(transparent)]
    Format(FormatError),
    #[error("worker threads cannot be started ({cause}); try {THREADS} 1")]
    Threads {
        threads: usize,
        #[source]
        cause: io::Error,
    },
    #[error("{Stopped}")]
    Stopped,
}

fn named(name: &str) -> String {
    if name.is_empty() { String::new() } else { format!("{name}: ") }
}

impl BuildError {
    /// A sufficient memory cap in bytes if the memory was too small: for a volume the smallest.
    pub fn minimum_bytes(&self) -> Option<u64> {
        match self.fault() {
            BuildFault::BudgetTooSmall { minimum_bytes, .. } => Some(*minimum_bytes),
            _ => None,
        }
    }

    /// The least and the greatest value of a volume that has none in the range.
    pub fn value_range(&self) -> Option<[f64; 2]> {
        match self.fault() {
            BuildFault::EmptyResult { min, max, .. } => Some([*min, *max]),
            _ => None,
        }
    }

    /// True if the input has nothing inside the range.
    pub(crate) fn is_empty(&self) -> bool {
        matches!(self.fault(), BuildFault::EmptyResult { .. } | BuildFault::NoNumbers { .. })
    }

    /// The name of the input, where the error holds it.
    pub(crate) fn input_name(&mut self) -> Option<&mut String> {
        match self.fault_mut() {
            BuildFault::BudgetTooSmall { name, .. }
            | BuildFault::EmptyResult { name, .. }
            | BuildFault::Said { name, .. }
            | BuildFault::NoNumbers { name } => Some(name),
            _ => None,
        }
    }

    /// The same error with a larger minimum, which counts the whole job.
    pub(crate) fn with_minimum(mut self, bytes: u64) -> Self {
        if let BuildFault::BudgetTooSmall { minimum_bytes, .. } = self.fault_mut() {
            *minimum_bytes = bytes.max(*minimum_bytes);
        }
        self
    }

    /// The same error with `held_bytes` more memory held outside the cap that was too small.
    pub(crate) fn beside(mut self, held_bytes: u64) -> Self {
        if let BuildFault::BudgetTooSmall { limit_bytes, minimum_bytes, .. } = self.fault_mut() {
            *limit_bytes = limit_bytes.saturating_add(held_bytes);
            *minimum_bytes = minimum_bytes.saturating_add(held_bytes);
        }
        self
    }
}

/// Criterion that leaves a range without voxels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Criterion {
    /// Otsu's method: gives no range, because all values are equal.
    Split,
    /// A range: contains none of the values.
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

impl From<SourceError> for BuildError {
    fn from(cause: SourceError) -> Self {
        match cause.fault() {
            SourceFault::Stopped => BuildFault::Stopped.into(),
            _ => BuildFault::Source(cause).into(),
        }
    }
}

conversions!(BuildError {
    cause: FormatError => BuildFault::Format(cause).into(),
    _stopped: Stopped => BuildFault::Stopped.into(),
});

impl BuildFault {
    pub(crate) fn no_room_for_cells(name: String) -> Self {
        let fault = usage!(
            "a side of 65536 voxels is too long for cells; use {SURFACE} skin, or a part of the volume with {ROI}"
        );
        Self::Said { name, fault }
    }

    pub(crate) fn nothing_inside(name: String) -> Self {
        let fault = unfit!("no voxel is inside; choose a finer grid, or check that the solid lies in it");
        Self::Said { name, fault }
    }

    fn kind(&self) -> ExitKind {
        match self {
            Self::Source(e) => e.kind(),
            Self::Part { fault, .. } => fault.kind(),
            Self::BudgetTooSmall { .. } => ExitKind::Budget,
            Self::Said { fault, .. } => fault.exit(),
            Self::EmptyResult { .. } | Self::NoNumbers { .. } => ExitKind::Input,
            Self::Scratch { .. } | Self::Output { .. } | Self::Threads { .. } => ExitKind::Io,
            Self::Format(_) => ExitKind::Input,
            Self::Stopped => ExitKind::Stopped,
        }
    }

    fn path(&self) -> Option<&Path> {
        match self {
            Self::Source(e) => e.path(),
            Self::Scratch { path, .. } | Self::Output { path, .. } | Self::Part { path, .. } => Some(path),
            _ => None,
        }
    }
}
