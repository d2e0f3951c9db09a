//! What is wrong with the text of a scene, as values; the sentences are written in `jobs`.

use std::path::PathBuf;

use crate::exit::ExitKind;
use crate::format::Channel;
use crate::render::CameraFault;

/// A scene that cannot be shown.
#[derive(Debug)]
pub struct SceneError {
    /// The text's file.
    pub path: PathBuf,
    /// What is wrong.
    pub fault: SceneFault,
}

impl std::error::Error for SceneError {}

impl SceneError {
    /// Exit kind.
    pub fn kind(&self) -> ExitKind {
        ExitKind::Input
    }
}

/// A table of the text.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Table {
    /// None of them: the text's own keys.
    Top,
    /// The camera.
    Camera,
    /// Light from everywhere.
    Ambient,
    /// What is cut from all models.
    Clip,
    /// A model, counted from 1.
    Model(usize),
    /// What is cut from a model, counted from 1.
    ModelClip(usize),
    /// A light, counted from 1.
    Light(usize),
    /// A material.
    Material(String),
}

/// A key of the text.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Key {
    /// The table that it stands in.
    pub table: Table,
    /// Its name.
    pub name: &'static str,
}

/// What is wrong with the text of a scene.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq)]
pub enum SceneFault {
    /// It is longer than a scene may be.
    TooLong {
        /// Its bytes.
        bytes: u64,
        /// Most bytes.
        most: u64,
    },
    /// It is not text.
    NotText,
    /// It is not TOML, or a key is unknown, lacking or of the wrong kind.
    Toml {
        /// Line, counted from 1, if it is known.
        line: Option<usize>,
        /// In the words of the parser.
        parser: String,
    },
    /// It names no model.
    NoModels,
    /// It names too many of something.
    TooMany {
        /// Of what.
        key: Key,
        /// How many.
        count: usize,
        /// Most of them.
        most: usize,
    },
    /// A number is not finite or not within its limits.
    Range {
        /// Which.
        key: Key,
        /// The number.
        value: f64,
        /// Least value.
        least: f64,
        /// Most.
        most: f64,
    },
    /// Not a colour.
    Color {
        /// Which.
        key: Key,
        /// What is written.
        text: String,
    },
    /// A name that does not stand for anything.
    Unknown {
        /// Which.
        key: Key,
        /// What is written.
        name: String,
        /// What could be.
        known: Vec<String>,
    },
    /// A key that another one makes void.
    Both {
        /// Which.
        key: Key,
        /// The other.
        other: &'static str,
    },
    /// A key that does not do without another one.
    Needs {
        /// Which.
        key: Key,
        /// The other.
        other: &'static str,
    },
    /// A picture without pixels, or with too many.
    Size {
        /// Pixels in a row.
        width: u32,
        /// Rows.
        height: u32,
        /// Most of either.
        most_side: u32,
        /// Most pixels.
        most_pixels: u64,
    },
    /// A direction of no length.
    NoDirection {
        /// Which.
        key: Key,
    },
    /// A placement that leaves a model without a volume.
    Flat {
        /// The model.
        key: Key,
    },
    /// A box without an inside.
    EmptyBox {
        /// Which.
        key: Key,
    },
    /// A label that is not a whole number.
    Label {
        /// Which.
        key: Key,
        /// The number.
        value: f64,
    },
    /// Values that do not rise, or lack.
    Order {
        /// Which.
        key: Key,
    },
    /// A model lacks the channel that its colour is to come from.
    NoChannel {
        /// The model.
        key: Key,
        /// What it lacks.
        channel: Channel,
    },
    /// A model's file cannot be used.
    File {
        /// The model.
        key: Key,
        /// Why, as a sentence.
        told: String,
    },
    /// A camera that makes no sense.
    Camera(CameraFault),
}
