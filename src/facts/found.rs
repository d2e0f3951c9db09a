//! What files below a folder are, where they are not the volume that was looked for.

use std::fmt;
use std::sync::Arc;

use super::error::{Reason, SourceError, describe};

/// Which of several volumes was taken.
#[derive(Clone, Debug, PartialEq)]
pub struct Choice {
    /// How many there were.
    pub found: usize,
    /// Was it asked for, rather than the largest?
    pub asked_for: bool,
    /// The one that is used.
    pub used: Candidate,
    /// Some of the others.
    pub others: Vec<Candidate>,
    /// How many more there are.
    pub more: usize,
}

impl fmt::Display for Choice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { found, asked_for, used, others, more } = self;
        let why = if *asked_for { "the chosen one" } else { "the largest that forms a volume" };
        write!(f, "{found} sets of images were found; {why} is used ({used}); not used: ")?;
        for (i, other) in others.iter().enumerate() {
            write!(f, "{}{other}", if i > 0 { "; " } else { "" })?;
        }
        if *more > 0 { write!(f, "; and {more} more") } else { Ok(()) }
    }
}

/// A volume among several.
#[derive(Clone, Debug, PartialEq)]
pub struct Candidate {
    /// What it is.
    pub kind: String,
    /// Which part of its input it is, where that holds several volumes.
    pub part: Option<String>,
    /// Size in voxels, as far as it is known.
    pub size: Option<[u32; 3]>,
    /// Why it cannot be used.
    pub refused: Option<Refusal>,
}

impl fmt::Display for Candidate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        describe(f, &self.kind, self.part.as_deref(), self.size)?;
        match &self.refused {
            Some(Refusal(error)) => write!(f, ", refused: {}", Reason(error)),
            None => Ok(()),
        }
    }
}

/// Why a volume other than the used one cannot be used.
#[derive(Clone, Debug)]
pub struct Refusal(
    /// The error, which several notes may share.
    pub Arc<SourceError>,
);

impl PartialEq for Refusal {
    /// Equal if they are one and the same.
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}
