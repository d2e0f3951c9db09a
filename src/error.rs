//! The errors of every boundary gathered once, as values, and the exit code that each kind of failure has.
//! The sentences are written in `jobs`.

use std::io;
use std::path::PathBuf;

use crate::builder::BuildError;
use crate::clean::CleanError;
use crate::exit::ExitKind;
use crate::export::ExportFault;
use crate::facts::SourceError;
use crate::format::{Channel, FormatError};
use crate::load::LoadError;
use crate::render::RenderError;
use crate::scene::SceneError;

/// Anything that can stop a job.
#[non_exhaustive]
#[derive(Debug)]
pub enum Error {
    /// The request itself is wrong.
    Usage(UsageError),
    /// Reading the volume failed.
    Source(SourceError),
    /// Building the octree failed.
    Build(BuildError),
    /// Cleaning the volume failed.
    Clean(CleanError),
    /// The bytes of an `.oct` are wrong.
    Format(FormatError),
    /// Opening an `.oct` failed.
    Load(LoadError),
    /// Making or writing a picture failed.
    Render(RenderError),
    /// The text of a scene is wrong.
    Scene(SceneError),
    /// The caller stopped the job, in whichever stage it was; see
    /// [`Progress::stopped`](crate::progress::Progress::stopped).
    Stopped,
    /// Another batch writes into the output folder.
    Busy {
        /// The folder.
        path: PathBuf,
    },
    /// An output file cannot be written.
    Output {
        /// The target.
        path: PathBuf,
        /// The system's reason.
        cause: io::Error,
    },
    /// A defect of this program stopped the conversion of one volume of a batch.
    Internal,
}

/// A request that cannot be met, whatever the input holds.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum UsageError {
    /// The model keeps only what can be seen from somewhere, and its inside was asked for.
    KeepsPart {
        /// The model.
        path: PathBuf,
        /// From where.
        seen_from: String,
    },
    /// A model or packed file would take the place of its input.
    ReplacesInput {
        /// The output.
        path: PathBuf,
        /// Can the input be a folder, of which the output would be a part?
        folder: bool,
    },
    /// A picture would take the place of the model.
    ReplacesModel {
        /// The picture.
        path: PathBuf,
    },
    /// Two pictures have one name.
    NamedTwice {
        /// The picture.
        path: PathBuf,
    },
    /// What is to be left out of a model cannot be.
    Strip {
        /// The model.
        path: PathBuf,
        /// Why not.
        fault: StripFault,
    },
    /// A format cannot hold a model.
    Export {
        /// The output.
        path: PathBuf,
        /// Why not.
        fault: ExportFault,
    },
    /// A placement turns a model into something without a volume.
    FlatPlacement {
        /// The model.
        path: PathBuf,
    },
    /// A synthetic head of this size cannot be made.
    HeadSize {
        /// Voxels a side.
        side: u32,
    },
}

/// Why something cannot be left out of a model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StripFault {
    /// Of cells normals, offsets and corners are the surface, and only the finest level has them.
    Cells,
    /// The model does not have so many levels.
    Levels {
        /// Levels that were to go.
        asked: u32,
        /// Most that can.
        most: u32,
    },
    /// Coarse boxes cannot have this channel.
    NoMeans {
        /// The channel.
        channel: Channel,
    },
    /// Fine parts of normals without the normals.
    FineAlone,
    /// The model does not have this channel.
    NoChannel {
        /// The channel.
        channel: Channel,
    },
}

impl From<UsageError> for Error {
    fn from(cause: UsageError) -> Self {
        Self::Usage(cause)
    }
}

impl std::error::Error for UsageError {}

impl std::error::Error for Error {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Self::Source(inner) => inner.source(),
            Self::Build(inner) => inner.source(),
            Self::Clean(inner) => inner.source(),
            Self::Format(inner) => inner.source(),
            Self::Load(inner) => inner.source(),
            Self::Render(inner) => inner.source(),
            Self::Output { cause, .. } => Some(cause),
            Self::Usage(_) | Self::Scene(_) | Self::Stopped | Self::Busy { .. } | Self::Internal => None,
        }
    }
}

/// An error of one boundary becomes the variant of the same name, or [`Error::Stopped`].
macro_rules! gathers {
    ($($variant:ident($inner:ty)),*) => {$(
        impl From<$inner> for Error {
            fn from(cause: $inner) -> Self {
                match cause.kind() {
                    ExitKind::Stopped => Self::Stopped,
                    _ => Self::$variant(cause),
                }
            }
        }
    )*};
}

gathers!(
    Source(SourceError),
    Build(BuildError),
    Clean(CleanError),
    Load(LoadError),
    Render(RenderError),
    Scene(SceneError)
);

impl From<FormatError> for Error {
    fn from(cause: FormatError) -> Self {
        Self::Format(cause)
    }
}

impl Error {
    /// The kind of failure, hence the exit code.
    pub fn kind(&self) -> ExitKind {
        match self {
            Self::Usage(_) | Self::Internal => ExitKind::Usage,
            Self::Source(e) => e.kind(),
            Self::Build(e) => e.kind(),
            Self::Clean(e) => e.kind(),
            Self::Format(_) => ExitKind::Input,
            Self::Load(e) => e.kind(),
            Self::Render(e) => e.kind(),
            Self::Scene(e) => e.kind(),
            Self::Stopped => ExitKind::Stopped,
            Self::Busy { .. } | Self::Output { .. } => ExitKind::Io,
        }
    }
}
