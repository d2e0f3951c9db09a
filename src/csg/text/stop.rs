//! What stops the reading of a text.

use crate::facts::CsgFault;

/// What stops the reading of a text.
#[derive(Debug)]
pub(in crate::csg) enum Stop {
    /// The text is wrong.
    Text(CsgFault),
    /// It cannot be read.
    Read(std::io::Error),
    /// The tree is larger than what it may take.
    Memory {
        /// What it takes so far.
        bytes: u64,
    },
}

impl From<CsgFault> for Stop {
    fn from(fault: CsgFault) -> Self {
        Self::Text(fault)
    }
}

impl From<std::io::Error> for Stop {
    fn from(cause: std::io::Error) -> Self {
        Self::Read(cause)
    }
}
