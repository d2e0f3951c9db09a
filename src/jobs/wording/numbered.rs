//! Sentences about slices that are numbered by the names of their files.

use std::fmt::{self, Display, Formatter};

use super::foreign::shown;
use crate::facts::numbered::{NumberFault, NumberGaps, NumberNote};

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

impl Display for NumberFault {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Gaps(gaps) => {
                let choice = if gaps.can_fill { "--gaps fill or --gaps keep" } else { "--gaps keep" };
                write!(f, "{gaps}; add the missing slices, or choose {choice}")
            }
            Self::Repeated { files } => {
                let [a, b] = &**files;
                write!(
                    f,
                    "{} and {} have the same number; rename one of them, or move it away",
                    shown(a),
                    shown(b)
                )
            }
            Self::TooFar { slices, files } => write!(
                f,
                "the numbers of {files} files span {slices} slices, so that most would be made; add the missing slices"
            ),
        }
    }
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
