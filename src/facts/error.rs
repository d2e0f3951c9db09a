//! What can be wrong with an input volume.

use std::io;
use std::path::PathBuf;

use thiserror::Error;

use crate::budget::Bytes;
use crate::error::ExitKind;

/// A source that cannot be used; every message names the path and the cure.
#[non_exhaustive]
#[derive(Debug, Error)]
pub enum SourceError {
    /// The operating system refused.
    #[error("{path}: cannot be read ({cause}); check that it exists and that you may read it", path = path.display())]
    Unreadable {
        /// File or folder.
        path: PathBuf,
        /// The system's reason.
        #[source]
        cause: io::Error,
    },
    /// File size and stated dims disagree.
    #[error("{path}: has {got} bytes, but {expected} are needed for {what}; check --dims, --dtype and --skip", path = path.display())]
    SizeMismatch {
        /// The file.
        path: PathBuf,
        /// Bytes that dims, type and skip require.
        expected: u64,
        /// Bytes that are there.
        got: u64,
        /// For example `64x64x64 u16`.
        what: String,
    },
    /// The file shrank or failed while it was being read.
    #[error("{path}: ended or failed while slice {slice} was read ({cause}); was it changed during the build?", path = path.display())]
    ReadFailed {
        /// The file.
        path: PathBuf,
        /// Slice index.
        slice: u32,
        /// The system's reason.
        #[source]
        cause: io::Error,
    },
    /// A folder without a usable image.
    #[error("{path}: {reason}", path = path.display())]
    NoVolume {
        /// The folder or file.
        path: PathBuf,
        /// What was found and what to do.
        reason: String,
    },
    /// The file is damaged, or of a kind that cannot be used.
    #[error("{path}: {reason}", path = path.display())]
    Unusable {
        /// The file.
        path: PathBuf,
        /// What is wrong and what to do.
        reason: String,
    },
    /// The scratch file that a sequential input is unrolled into cannot be written.
    #[error("scratch file in {path}: {cause}; free some space or choose another folder with --scratch", path = path.display())]
    Scratch {
        /// The folder.
        path: PathBuf,
        /// The system's reason.
        #[source]
        cause: io::Error,
    },
    /// Unrolling the input needs more memory than allowed.
    #[error("{path}: needs {needed} to be decoded, and --memory leaves {allowed} for that; allow at least {more} more", path = path.display(), needed = Bytes(*needed_bytes), allowed = Bytes(*allowed_bytes), more = Bytes(needed_bytes.saturating_sub(*allowed_bytes)))]
    Memory {
        /// The file.
        path: PathBuf,
        /// Bytes that decoding takes.
        needed_bytes: u64,
        /// Bytes that it may take.
        allowed_bytes: u64,
    },
    /// Putting the images of a series in order needs more memory than allowed.
    #[error("{path}: has {images} images, which take {needed} to be put in order, where {allowed} is left for that; allow at least {more} more with --memory", path = path.display(), needed = Bytes(*needed_bytes), allowed = Bytes(*allowed_bytes), more = Bytes(needed_bytes.saturating_sub(*allowed_bytes)))]
    ManyImages {
        /// The series' first file.
        path: PathBuf,
        /// Files, or frames where files have several.
        images: u64,
        /// Bytes that ordering takes, about.
        needed_bytes: u64,
        /// Bytes that it may take.
        allowed_bytes: u64,
    },
    /// The request does not fit the input (for example no --dims for a raw file).
    #[error("{path}: {reason}", path = path.display())]
    Usage {
        /// The file or folder.
        path: PathBuf,
        /// What is missing and what to add.
        reason: String,
    },
}

impl SourceError {
    /// Exit kind: wrong options are usage (2), everything else makes the input unusable (3).
    pub fn kind(&self) -> ExitKind {
        match self {
            Self::Usage { .. } => ExitKind::Usage,
            Self::Scratch { .. } => ExitKind::Io,
            Self::Memory { .. } | Self::ManyImages { .. } => ExitKind::Budget,
            _ => ExitKind::Input,
        }
    }
}
