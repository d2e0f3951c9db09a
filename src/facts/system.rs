//! What the operating system said, as a plain value.

use std::fmt::{self, Display, Formatter};
use std::io;

use thiserror::Error;

/// A failed call of the operating system: comparable, and as small as it gets.
///
/// An [`io::Error`] made of it says the same, but for texts that programs add of their own.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub struct SystemError {
    /// What kind of failure it is.
    pub kind: io::ErrorKind,
    /// The system's number for it, where the system said so.
    pub code: Option<i32>,
}

impl Display for SystemError {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        io::Error::from(*self).fmt(f)
    }
}

impl From<&io::Error> for SystemError {
    fn from(error: &io::Error) -> Self {
        Self { kind: error.kind(), code: error.raw_os_error() }
    }
}

impl From<SystemError> for io::Error {
    fn from(error: SystemError) -> Self {
        error.code.map_or_else(|| error.kind.into(), Self::from_raw_os_error)
    }
}
