//! Why a plan or a part is refused, with its sentence.

use std::io;

use thiserror::Error;

use crate::exit::ExitKind;
use crate::text::names::{ERROR, ISO, LABELS, MERGE, PART, PLAN, PRESET, RANGE, VISIBLE_FROM};

/// Why a plan or a part is refused.
#[derive(Debug, Error)]
pub(crate) enum PartFault {
    #[error("{0}")]
    Unsupported(NotInParts),
    #[error("has no part {number}; its {parts} parts are numbered from 0")]
    NoSuchPart { number: u32, parts: u32 },
    #[error("is not a plan, or is damaged ({reason}); make it again with {PLAN}")]
    NotPlan { reason: String },
    #[error(
        "was made for another input, other options or another program version, or was changed since; make it again with {PLAN}"
    )]
    OtherPlan,
    #[error("{} of {parts} parts missing (numbers {}); build them with {PART}, then {MERGE} again", .missing, list(.first, *.missing))]
    Missing { parts: u32, missing: u32, first: Vec<u32> },
    #[error("is part {number} of another job, or of another plan; remove it, and build the part with {PART}")]
    Foreign { number: u32 },
    #[error(
        "is a copy of part {holds} under the name of part {number}; remove it, and build the part with {PART}"
    )]
    Doubled { number: u32, holds: u32 },
    #[error("is damaged; remove it, and build part {number} again with {PART}")]
    Damaged { number: u32 },
    #[error("no voxel of any part is inside; choose another {ISO} or {RANGE}, and plan again")]
    NothingInside,
    #[error("cannot be read ({0})")]
    Unreadable(#[source] io::Error),
}

/// What cannot be built in parts, and why.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub(crate) enum NotInParts {
    #[error("meshes and trees of solids cannot be built in parts yet; build the model at once")]
    Solid,
    #[error(
        "the threshold of parts has to be given, as Otsu's method looks at all values; add {ISO}, {RANGE} or {PRESET}"
    )]
    Otsu,
    #[error("{VISIBLE_FROM} cannot be used in parts, as rays cross all of them; leave it out")]
    Sight,
    #[error(
        "{ERROR} cannot be used in parts yet, as the distances that the model states are of all of them; leave it out"
    )]
    Leaves,
    #[error(
        "the channel 'value' of samples of 32 or 64 bits cannot be built in parts, as it is scaled by the extent of all values of the skin; leave it out"
    )]
    WideValues,
    #[error(
        "{LABELS} cannot be used in parts yet, as the table of labels is of all of them; build the model at once"
    )]
    Labels,
    #[error(
        "cleaning ({operations}) cannot be done in parts yet, as components cross the cuts; leave it out"
    )]
    Cleaning { operations: String },
}

/// Some numbers, and how many follow.
fn list(first: &[u32], all: u32) -> String {
    let numbers = first.iter().map(u32::to_string).collect::<Vec<_>>().join(", ");
    if first.len() < all as usize { format!("{numbers}, ...") } else { numbers }
}

impl PartFault {
    pub(crate) fn kind(&self) -> ExitKind {
        match self {
            Self::Unsupported(_) | Self::NoSuchPart { .. } => ExitKind::Usage,
            Self::Unreadable(_) => ExitKind::Io,
            _ => ExitKind::Input,
        }
    }
}
