//! The errors of every boundary in one type, and the exit code of each kind of failure.
//!
//! An error has a kind, a path and one sentence with its remedy. The sentence is written at the place that finds the
//! fault; a fault is a variant of its own only where code branches on it. No code reads a sentence.

#![expect(missing_docs, reason = "the sentence of each variant says it")]

use std::io;
use std::path::{Path, PathBuf};

use thiserror::Error as Sentence;

use crate::builder::BuildError;
use crate::clean::CleanError;
use crate::exit::ExitKind;
use crate::fault::{Fault, usage};
use crate::format::FormatError;
use crate::load::LoadError;
use crate::progress::Stopped;
use crate::render::RenderError;
use crate::scene::SceneError;
use crate::text::names::{FORM, OUT, PORT, SKIN, VISIBLE_FROM};
use crate::text::{shown, writing};
use crate::volume::SourceError;

/// Anything that can stop a job.
#[non_exhaustive]
#[derive(Debug, Sentence)]
pub enum Error {
    #[error(transparent)]
    Source(SourceError),
    #[error(transparent)]
    Build(BuildError),
    #[error(transparent)]
    Clean(CleanError),
    #[error(transparent)]
    Format(#[from] FormatError),
    #[error(transparent)]
    Load(LoadError),
    #[error(transparent)]
    Render(RenderError),
    #[error(transparent)]
    Scene(SceneError),
    #[error(transparent)]
    Said(#[from] Fault),
    #[error("{Stopped}")]
    Stopped,
    #[error("{}: another batch is writing into this folder; wait until it has finished, or choose another folder with {OUT}", shown(.path))]
    Busy { path: PathBuf },
    #[error("{}: cannot be written ({cause}); {}", shown(.path), writing(.cause))]
    Output {
        path: PathBuf,
        #[source]
        cause: io::Error,
    },
    #[error("port {port} of 127.0.0.1 cannot be used ({cause}); choose another with {PORT}, or leave it out")]
    Port {
        port: u16,
        #[source]
        cause: io::Error,
    },
    #[error("an internal error stopped its conversion; please report it with the file")]
    Internal,
}

/// A model that keeps only what can be seen, where its inside is needed.
pub(crate) fn keeps_part(seen_from: &str, path: &Path) -> Fault {
    usage!("keeps only what can be seen ({VISIBLE_FROM} {seen_from}), so that its inside is not known; build it without {VISIBLE_FROM}, or write its skin with {FORM} points, or a mask with {SKIN}").at(path)
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

impl Error {
    /// The kind of failure, hence the exit code.
    pub fn kind(&self) -> ExitKind {
        match self {
            Self::Source(e) => e.kind(),
            Self::Build(e) => e.kind(),
            Self::Clean(e) => e.kind(),
            Self::Format(_) => ExitKind::Input,
            Self::Load(e) => e.kind(),
            Self::Render(e) => e.kind(),
            Self::Scene(e) => e.kind(),
            Self::Said(fault) => fault.exit(),
            Self::Stopped => ExitKind::Stopped,
            Self::Busy { .. } | Self::Output { .. } | Self::Port { .. } | Self::Internal => ExitKind::Io,
        }
    }
}
