//! What can be wrong with side-cars.

use std::fmt;

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
