//! Errors of cleaning, as values with their sentences.

use std::path::Path;

use thiserror::Error;

use crate::builder::BuildError;
use crate::exit::{ExitKind, opaque_error};
use crate::fault::{Fault, conversions};
use crate::text::names::DROP_BELOW;

/// Largest value of [`CleanOptions::keep_largest`](super::CleanOptions::keep_largest).
pub const MAX_LARGEST: u32 = 4000;

opaque_error! {
    /// A volume that cannot be cleaned.
    CleanError(CleanFault)
}

/// Faults of cleaning, with their sentences.
#[derive(Debug, Error)]
pub(crate) enum CleanFault {
    #[error(transparent)]
    Build(BuildError),
    #[error("{0}")]
    Said(Fault),
    #[error("{name}: no component is left; the largest has {largest} voxels: choose {DROP_BELOW} below that")]
    NothingKept { name: String, largest: u64 },
}

impl CleanFault {
    fn kind(&self) -> ExitKind {
        match self {
            Self::Build(e) => e.kind(),
            Self::Said(fault) => fault.exit(),
            Self::NothingKept { .. } => ExitKind::Input,
        }
    }

    fn path(&self) -> Option<&Path> {
        match self {
            Self::Build(e) => e.path(),
            _ => None,
        }
    }
}

impl CleanError {
    /// The smallest cap that works, in bytes, if the memory was too small.
    pub fn minimum_bytes(&self) -> Option<u64> {
        match self.fault() {
            CleanFault::Build(e) => e.minimum_bytes(),
            _ => None,
        }
    }

    /// True if no component is left.
    pub(crate) fn is_empty(&self) -> bool {
        matches!(self.fault(), CleanFault::NothingKept { .. })
    }

    /// The name of the input, where the error holds it.
    pub(crate) fn input_name(&mut self) -> Option<&mut String> {
        match self.fault_mut() {
            CleanFault::NothingKept { name, .. } => Some(name),
            CleanFault::Build(inner) => inner.input_name(),
            _ => None,
        }
    }
}

conversions!(CleanError {
    cause: BuildError => CleanFault::Build(cause).into(),
    fault: Fault => CleanFault::Said(fault).into(),
});
