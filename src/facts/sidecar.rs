//! What can be wrong with side-cars.

use super::raw::{RawFault, RawLayout};

/// Why a side-car cannot be used.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq)]
pub enum SideCarFault {
    /// The dims are not three sizes in range.
    Dims,
    /// The dtype is not known.
    Dtype,
    /// The skip is not a number of bytes.
    Skip,
    /// The file is not a plain name.
    File,
    /// The spacing is not three positive numbers.
    Spacing,
    /// Both names of the spacing are stated, and differ.
    SpacingsDiffer,
    /// The orientation is not three letters.
    Orientation,
    /// It described a raw volume when it was found, and does not any more.
    Changed,
    /// The data is not there.
    NoData,
    /// A symbolic link leads from the data out of the folder of the side-car.
    Linked {
        /// Name of the data.
        data: String,
    },
    /// The data has another size.
    Size {
        /// Name of the data.
        data: String,
        /// What it is described as.
        layout: Box<RawLayout>,
        /// Bytes that this takes.
        expected: u64,
        /// Bytes that it has.
        got: u64,
        /// The key that is wrong, as far as can be told.
        key: &'static str,
    },
    /// The data cannot be what is said of it.
    Raw {
        /// Name of the data.
        data: String,
        /// Why.
        fault: RawFault,
    },
    /// The text cannot be parsed.
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
