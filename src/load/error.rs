//! Why a file cannot be opened as a model, as values; the sentences are written in `jobs`.

use std::io;
use std::path::PathBuf;

use thiserror::Error;

use crate::exit::ExitKind;
use crate::format::FormatError;

/// A model that cannot be used.
#[non_exhaustive]
#[derive(Debug, Error)]
pub enum LoadError {
    /// The operating system refused.
    Unreadable {
        /// The file.
        path: PathBuf,
        /// The system's reason, or [`NotRegular`].
        #[source]
        cause: io::Error,
    },
    /// Its bytes are wrong.
    Format {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        #[source]
        cause: FormatError,
    },
    /// It was written to while it was in use.
    Changed {
        /// The file.
        path: PathBuf,
    },
}

impl LoadError {
    /// A model that cannot be used is unusable input.
    pub fn kind(&self) -> ExitKind {
        ExitKind::Input
    }
}

/// A folder or a device where a file is needed; held by an [`io::Error`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub struct NotRegular;
