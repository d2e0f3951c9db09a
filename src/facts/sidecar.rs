//! What can be wrong with side-cars.

use std::fmt;

use thiserror::Error;

use super::raw::{BySideCar, RawFault, RawLayout};
use crate::text::names::FOLLOW_LINKS;

/// Why a side-car cannot be used.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Error)]
pub(crate) enum SideCarFault {
    #[error("its dims are not three sizes in range; write for example [256, 256, 113]")]
    Dims,
    #[error("its dtype is not known; write u8, i8, u16, i16, u32, i32, f32 or f64, with le or be")]
    Dtype,
    #[error("its skip is not a number of bytes")]
    Skip,
    #[error("its file is not a plain name")]
    File,
    #[error("its spacing is not three positive numbers of mm; write for example [0.5, 0.5, 1.2]")]
    Spacing,
    #[error("its spacing and its spacing_mm differ; keep one of them")]
    SpacingsDiffer,
    #[error("its orientation is not three letters such as LPS or RAI")]
    Orientation,
    #[error("is not a description of a raw volume any more")]
    Changed,
    #[error(
        "describes a raw volume, but no data file with the same stem is in its folder; name it with the key file"
    )]
    NoData,
    #[error("its data `{}` is a link that leads out of the folder of the side-car; put the data there, or add {FOLLOW_LINKS}", .data.escape_debug())]
    Linked { data: String },
    #[error(
        "describes {data} as {layout}, which takes {expected} bytes, but it has {got}; correct the key {key}, or copy {data} again"
    )]
    Size { data: String, layout: Box<RawLayout>, expected: u64, got: u64, key: &'static str },
    #[error("describes {data}, but {}", BySideCar(.fault))]
    Raw { data: String, fault: RawFault },
    #[error("{0}")]
    Unparsed(Unparsed),
}

/// A side-car that cannot be parsed.
#[derive(Clone, Debug, PartialEq)]
pub struct Unparsed {
    /// Does it seem to describe raw data, rather than only where data lies?
    pub raw: bool,
    /// What is wrong.
    pub at: ParseFault,
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

/// What is wrong with the text of a side-car.
#[derive(Clone, Debug, PartialEq)]
pub enum ParseFault {
    /// The value of a key in TOML.
    Value {
        /// The key.
        key: &'static str,
    },
    /// A key that has to be there is not.
    Lacks {
        /// The key.
        key: &'static str,
    },
    /// JSON that cannot be followed, in words of the parser.
    Json(String),
}
