//! Reasons to stop the work on a model.

use std::io;

use crate::fault::conversions;
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

conversions!(Stop {
    fault: Fault => Self::Input(fault),
    cause: FormatError => Self::Input(Fault::Format(cause)),
    cause: CodingError => FormatError::from(cause).into(),
});
