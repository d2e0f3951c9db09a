//! Reasons to refuse a plan or a part.

use std::io;

use thiserror::Error;

use super::stage::Stage;
use crate::exit::ExitKind;
use crate::fault::{Fault, conversions};
use crate::platform::is_not_regular;
use crate::text::names::{ISO, MERGE, PART, PLAN, RANGE, STAGE};

/// Reason to refuse a plan or a part.
#[derive(Debug, Error)]
pub(crate) enum PartFault {
    #[error("{0}")]
    Said(Fault),
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
    #[error(
        "is damaged, or not of this plan; remove it, and make it again with {PART} or {MERGE} and {STAGE} {stage}"
    )]
    DamagedStage { stage: Stage },
    #[error(
        "the stage '{stage}' is not done; give {STAGE} {stage} to {PART} for every part and then to {MERGE}, before what follows"
    )]
    StageMissing { stage: Stage },
    #[error("no voxel of any part is inside; choose another {ISO} or {RANGE}, and plan again")]
    NothingInside,
    #[error("cannot be read ({0})")]
    Unreadable(#[source] io::Error),
}

conversions!(PartFault { fault: Fault => Self::Said(fault) });

/// A list of numbers, and the count of those left out.
fn list(first: &[u32], all: u32) -> String {
    let numbers = first.iter().map(u32::to_string).collect::<Vec<_>>().join(", ");
    if first.len() < all as usize { format!("{numbers}, ...") } else { numbers }
}

impl PartFault {
    pub(crate) fn kind(&self) -> ExitKind {
        match self {
            Self::Said(fault) => fault.exit(),
            Self::Unreadable(cause) if !is_not_regular(cause) => ExitKind::Io,
            _ => ExitKind::Input,
        }
    }
}
