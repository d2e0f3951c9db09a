//! One error value for every fault that no code distinguishes: its kind, its file, and one sentence with its remedy.
//!
//! The sentence is written at the place that finds the fault, with [`bad!`] where the input is broken and [`usage!`]
//! where the caller is wrong. A fault is a variant of an enum only where code branches on it: memory, missing slices,
//! a stop, and what the operating system refused. The kind decides the exit code and the kind in JSON; no code reads
//! a sentence.

use std::borrow::Cow;
use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use crate::exit::ExitKind;
use crate::text::shown;

/// The fault of a broken input, formatted as by `format!`.
macro_rules! bad {
    ($($text:tt)*) => { $crate::fault::Fault::new($crate::fault::FaultKind::Damage, format!($($text)*)) };
}

/// The fault of a request, formatted as by `format!`.
macro_rules! usage {
    ($($text:tt)*) => { $crate::fault::Fault::new($crate::fault::FaultKind::Usage, format!($($text)*)) };
}

/// The fault of an input of a kind that is not used, formatted as by `format!`.
macro_rules! unfit {
    ($($text:tt)*) => { $crate::fault::Fault::new($crate::fault::FaultKind::Unfit, format!($($text)*)) };
}

/// `From` of several types for one, each with its value.
macro_rules! conversions {
    ($to:ty { $($name:ident: $from:ty => $value:expr),+ $(,)? }) => {$(
        impl From<$from> for $to {
            fn from($name: $from) -> Self {
                $value
            }
        }
    )+};
}

pub(crate) use {bad, conversions, unfit, usage};

/// Responsibility for a fault, as far as code branches on it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum FaultKind {
    /// The caller's request is wrong.
    Usage,
    /// The input is of an unsupported kind.
    Unfit,
    /// The input is broken.
    Damage,
    /// A file that the input names is missing; some readers can do without it.
    Absent,
    /// Slices are missing or uneven, and nothing else is wrong: an option could fix it.
    Gaps,
    /// A grid is chosen for a tree of solids that has a volume's grid.
    OwnGrid,
    /// The grid of a mesh or a tree of solids would be too large.
    LongGrid,
}

/// A fault that no code distinguishes from others of its kind.
#[derive(Clone, Debug, PartialEq)]
pub struct Fault {
    pub(crate) kind: FaultKind,
    /// The file or folder at fault; empty if there is none, or until its reader is known.
    pub(crate) path: PathBuf,
    /// Cause and remedy, without the path.
    pub(crate) text: Cow<'static, str>,
}

impl Fault {
    pub(crate) fn new(kind: FaultKind, text: impl Into<Cow<'static, str>>) -> Self {
        Self { kind, path: PathBuf::new(), text: text.into() }
    }

    /// An input without a volume, after all others were ruled out.
    pub(crate) fn no_volume() -> Self {
        usage!("no volume was found")
    }

    /// A file that changed after it was opened.
    pub(crate) fn changed() -> Self {
        bad!(
            "was changed or replaced while it was read, so no output was written; start again once it is complete"
        )
    }

    /// The fault of a file or folder.
    pub(crate) fn at(self, path: impl Into<PathBuf>) -> Self {
        Self { path: path.into(), ..self }
    }

    /// The file or folder at fault, if there is one.
    pub(crate) fn path(&self) -> Option<&Path> {
        Some(self.path.as_path()).filter(|path| !path.as_os_str().is_empty())
    }

    pub(crate) fn exit(&self) -> ExitKind {
        match self.kind {
            FaultKind::Usage => ExitKind::Usage,
            _ => ExitKind::Input,
        }
    }

    /// The fault as an error of a stream, to be recovered by `io::Error::downcast`.
    pub(crate) fn in_stream(self) -> io::Error {
        io::Error::new(io::ErrorKind::InvalidData, self)
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(path) = self.path() {
            write!(f, "{}: ", shown(path))?;
        }
        f.write_str(&self.text)
    }
}

impl std::error::Error for Fault {}
