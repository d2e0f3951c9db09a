//! Sentences about side-cars.

use std::fmt;

use super::samples::{RawKeys, raw};
use crate::facts::sidecar::{ParseFault, SideCarFault, Unparsed};

impl fmt::Display for SideCarFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Dims => f.write_str(
                "its dims are not three sizes in range; write for example [256, 256, 113]",
            ),
            Self::Dtype => f.write_str(
                "its dtype is not known; write u8, i8, u16, i16, u32, i32, f32 or f64, with le or be",
            ),
            Self::Skip => f.write_str("its skip is not a number of bytes"),
            Self::File => f.write_str("its file is not a plain name"),
            Self::Linked { data } => write!(
                f,
                "its data `{}` is a link that leads out of the folder of the side-car; put the data there, or add --follow-links",
                data.escape_debug()
            ),
            Self::Spacing => f.write_str(
                "its spacing is not three positive numbers of mm; write for example [0.5, 0.5, 1.2]",
            ),
            Self::SpacingsDiffer => {
                f.write_str("its spacing and its spacing_mm differ; keep one of them")
            }
            Self::Orientation => f.write_str("its orientation is not three letters such as LPS or RAI"),
            Self::Changed => f.write_str("is no description of a raw volume any more"),
            Self::NoData => f.write_str(
                "describes a raw volume, but no file of the same stem is beside it; name it with the key file",
            ),
            Self::Size { data, layout, expected, got, key } => write!(
                f,
                "describes {data} as {layout}, which takes {expected} bytes, but it has {got}; correct the key {key}, or copy {data} again"
            ),
            Self::Raw { data, fault } => {
                write!(f, "describes {data}, but ")?;
                raw(fault, RawKeys::SideCar, f)
            }
            Self::Unparsed(unparsed) => unparsed.fmt(f),
        }
    }
}

impl fmt::Display for Unparsed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let what = if self.raw { "side-car of raw data" } else { "side-car" };
        if let ParseFault::Lacks { key } = &self.at {
            return write!(f, "{what} without the key {key}; add it, and check how the others are spelt");
        }
        write!(f, "{what} that cannot be parsed: ")?;
        match &self.at {
            ParseFault::Value { key } => {
                write!(f, "the value of {key} is neither a string nor a number nor a list of these")
            }
            ParseFault::Lacks { .. } => Ok(()),
            ParseFault::Json(text) => f.write_str(text),
        }
    }
}
