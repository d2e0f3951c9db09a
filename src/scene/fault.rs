//! Errors in the text of a scene, as values with their sentences.

use std::fmt;
use std::path::{Path, PathBuf};

use thiserror::Error;

use crate::exit::ExitKind;
use crate::format::Channel;
use crate::render::CameraFault;
use crate::text::{Short, shown};

/// A scene that cannot be shown.
#[derive(Debug, Error)]
#[error("{}: {fault}", shown(.path))]
pub struct SceneError {
    /// The text's file.
    pub(crate) path: PathBuf,
    /// The fault.
    pub(crate) fault: SceneFault,
}

impl SceneError {
    /// Who has to act on it, hence the exit code.
    pub(crate) fn kind(&self) -> ExitKind {
        ExitKind::Input
    }

    /// The text's file.
    pub fn path(&self) -> Option<&Path> {
        Some(&self.path)
    }
}

/// A table of the text.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Table {
    /// None of them: the text's own keys.
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
    /// The table that it stands in.
    pub table: Table,
    /// Its name.
    pub name: &'static str,
}

impl fmt::Display for Key {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}{}", self.table, self.name)
    }
}

/// A fault of the text of a scene.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Error)]
pub(crate) enum SceneFault {
    #[error("{bytes} bytes are too long for a scene; write at most {most}")]
    TooLong { bytes: u64, most: u64 },
    #[error("is not text; a scene is a TOML file in UTF-8")]
    NotText,
    #[error("{}{}; SCENES.md lists every key", .line.map_or_else(String::new, |line| format!("line {line}: ")), shown(.parser))]
    Toml { line: Option<usize>, parser: String },
    #[error("names no model; add a table [[model]] with file = \"MODEL.oct\"")]
    NoModels,
    #[error("{key}: {count} are too many; write at most {most}")]
    TooMany { key: Key, count: usize, most: usize },
    #[error("{key}: {value} is out of range; choose {} to {}", Short(*.least), Short(*.most))]
    Range { key: Key, value: f64, least: f64, most: f64 },
    #[error("{key}: '{}' is not a colour; write six hex digits for red, green and blue, such as \"#e8d8b0\"", shown(.text))]
    Color { key: Key, text: String },
    #[error("{key}: '{}' is unknown; choose {}", shown(.name), any_of(.known))]
    Unknown { key: Key, name: String, known: Vec<String> },
    #[error("{key}: does not go with {other}; leave one of them out")]
    Both { key: Key, other: &'static str },
    #[error("{key}: needs {other} as well; add it")]
    Needs { key: Key, other: &'static str },
    #[error(
        "size: a picture of {width}x{height} is not possible; choose sides of 1 to {most_side} and at most {most_pixels} pixels"
    )]
    Size { width: u32, height: u32, most_side: u32, most_pixels: u64 },
    #[error("{key}: {}", if .key.name == "planes" { "a row of which the first three numbers are 0 is not a direction; write rows such as [0, 0, 1, 40]" } else { "has no length, so it is not a direction; write one such as [0, -1, 1]" })]
    NoDirection { key: Key },
    #[error(
        "{key}: leaves the model without a volume; choose factors that are not 0, or rows that are not parallel"
    )]
    Flat { key: Key },
    #[error("{key}: holds nothing; write the low corner first, as in [[-50, -50, 0], [50, 50, 90]]")]
    EmptyBox { key: Key },
    #[error("{key}: {told}")]
    Labels { key: Key, told: String },
    #[error("{key}: {value} is not a label; labels are whole numbers from 0 to 255")]
    Label { key: Key, value: f64 },
    #[error(
        "{key}: needs numbers that rise, each with its colour, as in [[-100, \"#e2b484\"], [400, \"#f0e8d8\"]]"
    )]
    Order { key: Key },
    #[error("{key}: takes its colour from the channel {}, which the model lacks; build the model with it, or choose another material", .channel.name())]
    NoChannel { key: Key, channel: Channel },
    #[error("{key}: {told}")]
    File { key: Key, told: String },
    #[error("[camera]: {0}")]
    Camera(CameraFault),
}

fn any_of(names: &[String]) -> String {
    let mut text = String::new();
    for (at, name) in names.iter().enumerate() {
        let before = match at {
            0 => "",
            _ if at + 1 == names.len() => " or ",
            _ => ", ",
        };
        text += &format!("{before}{}", shown(name));
    }
    text
}
