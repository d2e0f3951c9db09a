//! What can be odd or wrong about slices that are numbered by the names of their files.

use std::path::PathBuf;

/// Numbers of slices that lack some.
#[derive(Clone, Debug, PartialEq)]
pub struct NumberGaps {
    /// Files that are numbered alike.
    pub files: usize,
    /// Slices that seem to be missing; `None` where the gaps are no whole multiples of the usual one.
    pub missing: Option<u64>,
    /// In how many places.
    pub places: usize,
    /// The files on both sides of the first gap.
    pub first: [PathBuf; 2],
    /// Can the missing slices be made? Not between files that are numbered in several ways.
    pub can_fill: bool,
}

/// Why numbered slices are refused.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq)]
pub enum NumberFault {
    /// Some numbers are missing.
    Gaps(Box<NumberGaps>),
    /// Two files have one number.
    Repeated {
        /// The first such files.
        files: Box<[PathBuf; 2]>,
    },
    /// So many slices are missing that most would be made.
    TooFar {
        /// Slices of the whole.
        slices: u64,
        /// Files.
        files: usize,
    },
}

/// What was done about numbers that are missing.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq)]
pub enum NumberNote {
    /// Missing slices were made between their neighbours.
    Filled {
        /// How many.
        made: u64,
        /// Slices of the whole.
        slices: usize,
        /// The files on both sides of the first gap.
        first: [PathBuf; 2],
    },
    /// The files were taken as if they followed each other evenly.
    Kept(NumberGaps),
}
