//! The error of a scene's text, and the names of its tables and keys.

use std::fmt;
use std::path::{Path, PathBuf};

use thiserror::Error;

use crate::exit::ExitKind;
use crate::fault::Fault;
use crate::text::shown;

/// A scene that cannot be shown.
#[derive(Debug, Error)]
#[error("{}: {fault}", shown(.path))]
pub struct SceneError {
    /// Path of the text.
    pub(crate) path: PathBuf,
    /// The fault.
    pub(crate) fault: Fault,
}

impl SceneError {
    /// Kind of the error, which decides the exit code.
    pub(crate) fn kind(&self) -> ExitKind {
        ExitKind::Input
    }

    /// Path of the text.
    pub fn path(&self) -> Option<&Path> {
        Some(&self.path)
    }
}

/// A table of the text.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Table {
    /// The text's own keys, outside all tables.
    Top,
    Camera,
    Ambient,
    Clip,
    Model(usize),
    ModelClip(usize),
    Light(usize),
    Material(String),
}

impl fmt::Display for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Top => Ok(()),
            Self::Camera => f.write_str("[camera], "),
            Self::Ambient => f.write_str("[ambient], "),
            Self::Clip => f.write_str("[clip], "),
            Self::Model(number) => write!(f, "[[model]] {number}, "),
            Self::ModelClip(number) => write!(f, "[[model]] {number}, clip, "),
            Self::Light(number) => write!(f, "[[light]] {number}, "),
            Self::Material(name) => write!(f, "[material.{}], ", shown(name)),
        }
    }
}

/// A key of the text.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Key {
    pub table: Table,
    pub name: &'static str,
}

impl fmt::Display for Key {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}{}", self.table, self.name)
    }
}
