//! Why a picture cannot be made.

use std::io;
use std::path::PathBuf;

use thiserror::Error;

use crate::error::ExitKind;

/// A picture that cannot be made or written.
#[non_exhaustive]
#[derive(Debug, Error)]
pub enum RenderError {
    /// Camera or size make no sense.
    #[error("{reason}")]
    Usage {
        /// What is wrong and what to do.
        reason: String,
    },
    /// The model's affine cannot be inverted.
    #[error(
        "the model's axes are (nearly) parallel, so it has no volume to look at; check its spacing and orientation"
    )]
    SingularAffine,
    /// The image cannot be written.
    #[error("{path}: cannot be written ({cause}); check the folder and the free space", path = path.display())]
    Write {
        /// The image.
        path: PathBuf,
        /// The system's reason.
        #[source]
        cause: io::Error,
    },
}

impl RenderError {
    /// Exit kind.
    pub fn kind(&self) -> ExitKind {
        match self {
            Self::Usage { .. } => ExitKind::Usage,
            Self::SingularAffine => ExitKind::Input,
            Self::Write { .. } => ExitKind::Io,
        }
    }
}
