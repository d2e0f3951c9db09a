//! The errors of every boundary gathered once, and the exit code that each kind of failure has.

use std::io;
use std::path::PathBuf;

use thiserror::Error;

use crate::builder::BuildError;
use crate::facts::SourceError;
use crate::format::FormatError;
use crate::load::LoadError;
use crate::render::RenderError;

/// Who has to act on a failure; each kind is one exit code of the command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExitKind {
    /// The caller is wrong: exit 2.
    Usage,
    /// The input is wrong: exit 3.
    Input,
    /// The memory budget is too small: exit 4.
    Budget,
    /// The disk or the operating system failed: exit 5.
    Io,
    /// A batch finished with some failures: exit 8.
    Partial,
}

impl ExitKind {
    /// The process exit code of this kind.
    pub fn code(self) -> u8 {
        match self {
            Self::Usage => 2,
            Self::Input => 3,
            Self::Budget => 4,
            Self::Io => 5,
            Self::Partial => 8,
        }
    }
}

/// Anything that can stop a job.
#[non_exhaustive]
#[derive(Debug, Error)]
pub enum Error {
    /// The request itself is wrong.
    #[error("{0}")]
    Usage(String),
    /// Reading the volume failed.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// Building the octree failed.
    #[error(transparent)]
    Build(#[from] BuildError),
    /// The bytes of an `.oct` are wrong.
    #[error(transparent)]
    Format(#[from] FormatError),
    /// Opening an `.oct` failed.
    #[error(transparent)]
    Load(#[from] LoadError),
    /// Making or writing a picture failed.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// Another batch writes into the output folder.
    #[error("{path}: another batch is writing into this folder; wait until it has finished, or choose another folder with --out", path = path.display())]
    Busy {
        /// The folder.
        path: PathBuf,
    },
    /// An output file cannot be written.
    #[error("{path}: cannot be written ({cause}); check the folder and its free space", path = path.display())]
    Output {
        /// The target.
        path: PathBuf,
        /// The system's reason.
        #[source]
        cause: io::Error,
    },
}

impl Error {
    /// The kind of failure, hence the exit code.
    pub fn kind(&self) -> ExitKind {
        match self {
            Self::Usage(_) => ExitKind::Usage,
            Self::Source(e) => e.kind(),
            Self::Build(e) => e.kind(),
            Self::Format(_) => ExitKind::Input,
            Self::Load(e) => e.kind(),
            Self::Render(e) => e.kind(),
            Self::Busy { .. } | Self::Output { .. } => ExitKind::Io,
        }
    }
}
