//! Reasons why a format cannot hold a model, as a value with its sentence.

#![expect(missing_docs, reason = "the sentence of each variant says it")]

use std::io;

use thiserror::Error;

use crate::text::names::{LEVELS, STRIP};

/// Reason why a format cannot hold a model.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum ExportFault {
    #[error(
        "{needed} corners, triangles or bytes are more than the format can count; leave fine levels out of the model first, with {STRIP} {LEVELS}"
    )]
    TooLong { needed: u64 },
    #[error("a side of {side} voxels is longer than NIfTI-1 can state (32767); write NRRD instead")]
    TooWide { side: u32 },
}

impl From<ExportFault> for io::Error {
    fn from(fault: ExportFault) -> Self {
        Self::other(fault)
    }
}
