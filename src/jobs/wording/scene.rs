//! What is wrong with the text of a scene, and what to write instead.

use std::fmt;

use super::foreign::shown;
use super::number::Short;
use crate::scene::{Key, SceneError, SceneFault, Table};

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

impl fmt::Display for Key {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}{}", self.table, self.name)
    }
}

impl fmt::Display for SceneError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", shown(&self.path), self.fault)
    }
}

impl fmt::Display for SceneFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TooLong { bytes, most } => {
                write!(f, "{bytes} bytes are too long for a scene; write at most {most}")
            }
            Self::NotText => f.write_str("is not text; a scene is a TOML file in UTF-8"),
            Self::Toml { line, parser } => {
                if let Some(line) = line {
                    write!(f, "line {line}: ")?;
                }
                write!(f, "{}; SCENES.md lists every key", shown(parser))
            }
            Self::NoModels => f.write_str("names no model; add a table [[model]] with file = \"MODEL.oct\""),
            Self::TooMany { key, count, most } => {
                write!(f, "{key}: {count} are too many; write at most {most}")
            }
            Self::Range { key, value, least, most } => {
                write!(f, "{key}: {value} is out of range; choose {} to {}", Short(*least), Short(*most))
            }
            Self::Color { key, text } => write!(
                f,
                "{key}: '{}' is not a colour; write six hex digits for red, green and blue, such as \"#e8d8b0\"",
                shown(text)
            ),
            Self::Unknown { key, name, known } => {
                write!(f, "{key}: '{}' is unknown; choose ", shown(name))?;
                for (at, name) in known.iter().enumerate() {
                    let before = match at {
                        0 => "",
                        _ if at + 1 == known.len() => " or ",
                        _ => ", ",
                    };
                    write!(f, "{before}{}", shown(name))?;
                }
                Ok(())
            }
            Self::Both { key, other } => write!(f, "{key}: does not go with {other}; leave one of them out"),
            Self::Needs { key, other } => write!(f, "{key}: needs {other} as well; add it"),
            Self::NoDirection { key: key @ Key { name: "planes", .. } } => write!(
                f,
                "{key}: a row of which the first three numbers are 0 is not a direction; write rows such as [0, 0, 1, 40]"
            ),
            Self::Size { width, height, most_side, most_pixels } => write!(
                f,
                "size: a picture of {width}x{height} is not possible; choose sides of 1 to {most_side} and at most {most_pixels} pixels"
            ),
            Self::NoDirection { key } => {
                write!(f, "{key}: has no length, so it is not a direction; write one such as [0, -1, 1]")
            }
            Self::Flat { key } => write!(
                f,
                "{key}: leaves the model without a volume; choose factors that are not 0, or rows that are not parallel"
            ),
            Self::EmptyBox { key } => {
                write!(
                    f,
                    "{key}: holds nothing; write the low corner first, as in [[-50, -50, 0], [50, 50, 90]]"
                )
            }
            Self::Label { key, value } => {
                write!(f, "{key}: {value} is not a label; labels are whole numbers from 0 to 255")
            }
            Self::Order { key } => write!(
                f,
                "{key}: needs numbers that rise, each with its colour, as in [[-100, \"#e2b484\"], [400, \"#f0e8d8\"]]"
            ),
            Self::NoChannel { key, channel } => write!(
                f,
                "{key}: takes its colour from the channel {}, which the model lacks; build the model with it, or choose another material",
                channel.name()
            ),
            Self::File { key, told } => write!(f, "{key}: {told}"),
            Self::Camera(fault) => write!(f, "[camera]: {fault}"),
        }
    }
}
