//! What can be odd or wrong about slices that are numbered by the names of their files.

use std::fmt::{self, Display, Formatter};
use std::path::PathBuf;

use crate::text::shown;

/// Numbers of slices that lack some.
#[derive(Clone, Debug, PartialEq)]
pub struct NumberGaps {
    /// Files that are numbered alike.
    pub files: usize,
    /// Slices that seem to be missing; `None` where the gaps are not whole multiples of the usual one.
    pub missing: Option<u64>,
    /// In how many places.
    pub places: usize,
    /// The files on both sides of the first gap.
    pub first: [PathBuf; 2],
    /// Can the missing slices be made? Not between files that are numbered in several ways.
    pub can_fill: bool,
}

impl Display for NumberGaps {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let Self { files, missing, places, first: [a, b], .. } = self;
        match missing {
            Some(slices) => write!(
                f,
                "{slices} slice(s) seem to be missing in {places} place(s) among {files} numbered files"
            )?,
            None => write!(f, "the numbers of {files} files do not follow each other evenly")?,
        }
        write!(f, ", first between {} and {}", shown(a), shown(b))
    }
}

/// What was done about numbers that are missing.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq)]
pub enum NumberNote {
    Filled { made: u64, slices: usize, first: [PathBuf; 2] },
    Kept(NumberGaps),
}

impl Display for NumberNote {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Filled { made, slices, first: [a, b] } => write!(
                f,
                "gaps in the numbers of the files were filled: {made} of {slices} slices were made by interpolation \
                 between neighbours, the first between {} and {}",
                shown(a),
                shown(b)
            ),
            Self::Kept(gaps) => write!(f, "{gaps}; the files are taken as evenly spaced slices"),
        }
    }
}
