//! Reasons to refuse a plan or a part, with their sentences.

use std::io;

use thiserror::Error;

use super::stage::Stage;
use crate::exit::ExitKind;
use crate::platform::is_not_regular;
use crate::text::names::{ERROR, ISO, LABELS, MERGE, PART, PLAN, RANGE, STAGE, UNCERTAINTY, VISIBLE_FROM};

/// Reason to refuse a plan or a part.
#[derive(Debug, Error)]
pub(crate) enum PartFault {
    #[error("{0}")]
    Unsupported(NotInParts),
    #[error("has no part {number}; its {parts} parts are numbered from 0")]
    NoSuchPart { number: u32, parts: u32 },
    #[error("is not a plan, or is damaged ({reason}); make it again with {PLAN}")]
    NotPlan { reason: String },
    #[error("is not text, and cannot be written down in a plan; rename it")]
    NotText,
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
    #[error("has no stage '{stage}': {}", stages(.of))]
    NoSuchStage { stage: Stage, of: Vec<Stage> },
    #[error("no voxel of any part is inside; choose another {ISO} or {RANGE}, and plan again")]
    NothingInside,
    #[error("cannot be read ({0})")]
    Unreadable(#[source] io::Error),
}

/// Feature that cannot be built in parts, with the reason.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub(crate) enum NotInParts {
    #[error("{VISIBLE_FROM} cannot be used in parts, as rays cross all of them; leave it out")]
    Sight,
    #[error(
        "{ERROR} cannot be used in parts yet, as the distances stated by the model cover all parts; leave it out"
    )]
    Leaves,
    #[error(
        "the channel 'value' of samples of 32 or 64 bits cannot be built in parts, as it is scaled by the extent of all values of the skin; leave it out"
    )]
    WideValues,
    #[error("{UNCERTAINTY} cannot be used in parts yet, as noise is measured over all parts; leave it out")]
    Uncertainty,
    #[error(
        "{LABELS} cannot be used in parts yet, as the table of labels covers all parts; build the model in one piece"
    )]
    Labels,
}

/// A list of numbers, and the count of those left out.
fn list(first: &[u32], all: u32) -> String {
    let numbers = first.iter().map(u32::to_string).collect::<Vec<_>>().join(", ");
    if first.len() < all as usize { format!("{numbers}, ...") } else { numbers }
}

fn stages(of: &[Stage]) -> String {
    match of {
        [] => "its threshold is given, and its parts can be built at once".into(),
        of => format!(
            "its stages are {}",
            of.iter().map(|stage| stage.name()).collect::<Vec<_>>().join(" and ")
        ),
    }
}

impl PartFault {
    pub(crate) fn kind(&self) -> ExitKind {
        match self {
            Self::Unsupported(_) | Self::NotText | Self::NoSuchPart { .. } | Self::NoSuchStage { .. } => {
                ExitKind::Usage
            }
            Self::Unreadable(cause) if !is_not_regular(cause) => ExitKind::Io,
            _ => ExitKind::Input,
        }
    }
}
