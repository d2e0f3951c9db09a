//! Why a file cannot be opened as a model.

use std::fmt;

use super::foreign::shown;
use super::system::reading;
use crate::load::{LoadError, NotRegular};

impl fmt::Display for LoadError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unreadable { path, cause } => write!(
                f,
                "{}: cannot be read ({cause}); {}",
                shown(path),
                reading(cause, "check that it exists and that you may read it")
            ),
            Self::Changed { path } => write!(
                f,
                "{}: was changed while it was in use, so that nothing was made of it; start again once it is complete",
                shown(path)
            ),
            Self::Format { path, cause } => write!(f, "{}: {cause}", shown(path)),
        }
    }
}

impl fmt::Display for NotRegular {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("it is not a regular file")
    }
}
