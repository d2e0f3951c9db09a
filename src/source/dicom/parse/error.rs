//! Reasons why the elements of a file cannot be followed.

use std::borrow::Cow;
use std::fmt::{self, Display, Formatter};
use std::io;

use thiserror::Error;

/// A failed call of the operating system, comparable and small.
///
/// An [`io::Error`] made of it has the same text, except for texts that programs add of their own.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub struct SystemError {
    /// Kind of failure.
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

/// Reason why bytes of a file cannot be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum ReadFault {
    #[error("{0}")]
    System(SystemError),
    #[error("{0}")]
    Deflate(DeflateFault),
}

impl From<io::Error> for ReadFault {
    fn from(error: io::Error) -> Self {
        DeflateFault::inside(&error).map_or_else(|| Self::System((&error).into()), Self::Deflate)
    }
}

impl From<ReadFault> for io::Error {
    fn from(fault: ReadFault) -> Self {
        match fault {
            ReadFault::System(error) => error.into(),
            ReadFault::Deflate(fault) => fault.into(),
        }
    }
}

/// Fault in the stream of a deflated file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum DeflateFault {
    #[error("its deflate stream is damaged")]
    Damaged,
    #[error("its deflate stream is longer than {bytes} bytes before the pixels")]
    LongHeader { bytes: u64 },
}

impl DeflateFault {
    /// The fault that travels in an error of a reader, if it is one of these.
    pub(crate) fn inside(error: &io::Error) -> Option<Self> {
        error.get_ref().and_then(|inner| inner.downcast_ref::<Self>()).copied()
    }
}

impl From<DeflateFault> for io::Error {
    fn from(fault: DeflateFault) -> Self {
        Self::new(io::ErrorKind::InvalidData, fault)
    }
}

/// Reason why a file yields no header.
#[expect(missing_docs, reason = "the sentence of each variant says it")]
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum ScanError {
    #[error("cannot be read ({0})")]
    Io(ReadFault),
    #[error("is not a DICOM file")]
    NotDicom,
    #[error("is a damaged DICOM file: {damage} (at byte {offset})")]
    Damaged { offset: u64, damage: Cow<'static, str> },
}

impl From<io::Error> for ScanError {
    fn from(error: io::Error) -> Self {
        Self::Io(error.into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_system_says_comes_through() {
        let missing = io::Error::from_raw_os_error(2);
        assert_eq!(SystemError::from(&missing).to_string(), missing.to_string());
        let fault: ReadFault = io::Error::from(DeflateFault::Damaged).into();
        assert_eq!(fault, ReadFault::Deflate(DeflateFault::Damaged));
    }
}
