//! The error of a source: a volume, a mesh or a tree of solids that cannot be read.

use std::io;
use std::path::{Path, PathBuf};

use thiserror::Error;

use crate::budget::Bytes;
use crate::exit::{ExitKind, opaque_error};
use crate::fault::{Fault, FaultKind, conversions};
use crate::progress::Stopped;
use crate::text::names::{MEMORY, SCRATCH};
use crate::text::{reading, shown, writing};

opaque_error! {
    /// A source that cannot be used: the file or folder, and the reason.
    SourceError(SourceFault)
}

/// Faults of a source, with their sentences.
#[derive(Debug, Error)]
pub(crate) enum SourceFault {
    #[error("{}: cannot be read ({cause}); {}", shown(.path), reading(.cause, "check that it exists and that you may read it"))]
    Unreadable {
        path: PathBuf,
        #[source]
        cause: io::Error,
    },
    #[error("{}: ended or failed while slice {slice} was read ({cause}); {}", shown(.path), reading(.cause, "was it changed during the build?"))]
    ReadFailed {
        path: PathBuf,
        slice: u32,
        #[source]
        cause: io::Error,
    },
    #[error(transparent)]
    Said(#[from] Fault),
    #[error("scratch file in {}: {cause}; {} ({SCRATCH})", shown(.path), writing(.cause))]
    Scratch {
        path: PathBuf,
        #[source]
        cause: io::Error,
    },
    #[error("{}: needs {} to be decoded, and {MEMORY} leaves only {}; allow at least {} more", shown(.path), Bytes(*.needed_bytes), Bytes(*.allowed_bytes), Bytes(.needed_bytes.saturating_sub(*.allowed_bytes)))]
    Memory { path: PathBuf, needed_bytes: u64, allowed_bytes: u64 },
    #[error("{}: describes so many parts that {} of memory are needed for them, and only {} are available; raise {MEMORY}, or join parts", shown(.path), Bytes(*.needed_bytes), Bytes(*.allowed_bytes))]
    Description { path: PathBuf, needed_bytes: u64, allowed_bytes: u64 },
    #[error("{}: has {images} images; sorting them takes {} of memory, and {} is left; allow at least {} more with {MEMORY}", shown(.path), Bytes(*.needed_bytes), Bytes(*.allowed_bytes), Bytes(.needed_bytes.saturating_sub(*.allowed_bytes)))]
    ManyImages { path: PathBuf, images: u64, needed_bytes: u64, allowed_bytes: u64 },
    #[error("{Stopped}")]
    Stopped,
}

impl SourceFault {
    /// Exit kind: wrong options are usage (2), everything else makes the input unusable (3).
    pub(crate) fn kind(&self) -> ExitKind {
        match self {
            Self::Said(fault) => fault.exit(),
            Self::Scratch { .. } => ExitKind::Io,
            Self::Memory { .. } | Self::ManyImages { .. } => ExitKind::Budget,
            Self::Stopped => ExitKind::Stopped,
            _ => ExitKind::Input,
        }
    }

    pub(crate) fn path(&self) -> Option<&Path> {
        match self {
            Self::Unreadable { path, .. }
            | Self::ReadFailed { path, .. }
            | Self::Scratch { path, .. }
            | Self::Memory { path, .. }
            | Self::ManyImages { path, .. }
            | Self::Description { path, .. } => Some(path),
            Self::Said(fault) => fault.path(),
            Self::Stopped => None,
        }
    }
}

impl SourceError {
    /// The file or folder `path` cannot be read: for a [`VolumeSource`](crate::VolumeSource) or a
    /// [`Solid`](crate::builder::Solid) of your own.
    pub fn unreadable(path: impl Into<PathBuf>, cause: io::Error) -> Self {
        SourceFault::Unreadable { path: path.into(), cause }.into()
    }

    /// A slice, from 0, cannot be read: for a [`VolumeSource`](crate::VolumeSource) of your own.
    pub fn read_failed(path: impl Into<PathBuf>, slice: u32, cause: io::Error) -> Self {
        SourceFault::ReadFailed { path: path.into(), slice, cause }.into()
    }

    /// The sentence without its path, if it makes sense alone.
    pub(crate) fn reason(&self) -> String {
        match self.fault() {
            SourceFault::Said(fault) => fault.text.to_string(),
            other => other.to_string(),
        }
    }

    /// Names this file in a fault that names none yet.
    pub(crate) fn in_file(mut self, path: Option<&PathBuf>) -> Self {
        if let (SourceFault::Said(fault), Some(path)) = (self.fault_mut(), path)
            && fault.path().is_none()
        {
            fault.path.clone_from(path);
        }
        self
    }

    /// The memory in bytes that reading needs, if there was too little of it.
    pub fn minimum_bytes(&self) -> Option<u64> {
        match self.fault() {
            SourceFault::Memory { needed_bytes, .. } | SourceFault::ManyImages { needed_bytes, .. } => {
                Some(*needed_bytes)
            }
            _ => None,
        }
    }

    /// True if missing or uneven slices are the only fault, so that the caller may choose their treatment.
    pub(crate) fn has_gaps(&self) -> bool {
        self.has_kind(FaultKind::Gaps)
    }

    /// True for a fault of this kind.
    pub(crate) fn has_kind(&self, kind: FaultKind) -> bool {
        matches!(self.fault(), SourceFault::Said(fault) if fault.kind == kind)
    }

    /// True if the input is broken; false if it is only of an unsupported kind.
    pub(crate) fn is_damage(&self) -> bool {
        matches!(self.fault(), SourceFault::Said(Fault { kind: FaultKind::Damage, .. }))
    }
}

conversions!(SourceError { fault: Fault => SourceFault::Said(fault).into() });
