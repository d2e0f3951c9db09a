//! Why a file cannot be opened as a model.

use std::io;
use std::path::PathBuf;

use thiserror::Error;

use crate::error::ExitKind;
use crate::format::FormatError;

/// A model that cannot be used.
#[non_exhaustive]
#[derive(Debug, Error)]
pub enum LoadError {
    /// The operating system refused.
    #[error("{path}: cannot be read ({cause}); check that it exists and that you may read it", path = path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        #[source]
        cause: io::Error,
    },
    /// Its bytes are wrong.
    #[error("{path}: {cause}", path = path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        #[source]
        cause: FormatError,
    },
}

impl LoadError {
    /// A model that cannot be used is unusable input.
    pub fn kind(&self) -> ExitKind {
        ExitKind::Input
    }
}
