//! Reasons to stop the work on a model.

use std::io;

use crate::format::FormatError;
use crate::format::packed::CodingError;
use crate::load::Fault;

/// Why packing stopped: at the input, or at the output.
#[derive(Debug)]
pub(crate) enum Stop {
    /// The input is wrong or cannot be read.
    Input(Fault),
    /// The output cannot be written or read back.
    Output(io::Error),
}

impl From<Fault> for Stop {
    fn from(fault: Fault) -> Self {
        Self::Input(fault)
    }
}

impl From<FormatError> for Stop {
    fn from(cause: FormatError) -> Self {
        Self::Input(Fault::Format(cause))
    }
}

impl From<CodingError> for Stop {
    fn from(cause: CodingError) -> Self {
        FormatError::from(cause).into()
    }
}
