//! Errors of opening a file as a model, as values with their sentences.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use thiserror::Error;

use crate::exit::{ExitKind, opaque_error};
use crate::format::FormatError;
use crate::text::names::{BUILD_INPUT, RENDER};
use crate::text::{reading, shown};

opaque_error! {
    /// A model that cannot be used.
    LoadError(LoadFault)
}

/// Fault of a model, with its sentence.
#[derive(Debug, Error)]
pub(crate) enum LoadFault {
    #[error("{}: cannot be read ({cause}); {}", shown(.path), reading(.cause, "check that it exists and that you may read it"))]
    Unreadable {
        path: PathBuf,
        #[source]
        cause: io::Error,
    },
    #[error("{}: {}", shown(.path), Reason(.path, .cause))]
    Format {
        path: PathBuf,
        #[source]
        cause: FormatError,
    },
    #[error("{}: was changed while it was in use, so no output was written; start again once it is complete", shown(.path))]
    Changed { path: PathBuf },
}

/// Text of the fault of the bytes, or the kind of file by its name if it is not a model.
struct Reason<'a>(&'a Path, &'a FormatError);

impl fmt::Display for Reason<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(path, cause) = self;
        let suffix = path.extension().and_then(|name| name.to_str()).unwrap_or_default().to_ascii_lowercase();
        match (cause, suffix.as_str()) {
            (FormatError::BadMagic, "toml") => write!(
                f,
                "is not a model; a scene is shown by `{RENDER}` alone, and is not a part of another one"
            ),
            (FormatError::BadMagic, suffix) if suffix != "oct" => {
                write!(f, "is not a model; build it first, with `{BUILD_INPUT}`")
            }
            _ => cause.fmt(f),
        }
    }
}

impl LoadFault {
    fn kind(&self) -> ExitKind {
        ExitKind::Input
    }

    fn path(&self) -> Option<&Path> {
        match self {
            Self::Unreadable { path, .. } | Self::Format { path, .. } | Self::Changed { path } => Some(path),
        }
    }
}
