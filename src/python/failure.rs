//! Errors of the library as exceptions, whose classes are in `infobyte/_errors.py`.

use std::error::Error as _;
use std::io;
use std::path::Path;

use pyo3::prelude::*;

use crate::error::Error;
use crate::exit::ExitKind;

/// Makes the exception of an error.
pub(super) fn raised(py: Python<'_>, error: &Error) -> PyErr {
    let (path, minimum_bytes) = match error {
        Error::Source(e) => (e.path(), e.minimum_bytes()),
        Error::Build(e) => (e.path(), e.minimum_bytes()),
        Error::Clean(e) => (e.path(), e.minimum_bytes()),
        Error::Load(e) => (e.path(), None),
        Error::Render(e) => (e.path(), None),
        Error::Output { path, .. } | Error::Busy { path } => (Some(path.as_path()), None),
        _ => (None, None),
    };
    exception(py, error.kind(), &error.to_string(), errno(error), path, minimum_bytes)
}

/// The system's error number, if that is the root cause.
fn errno(error: &Error) -> Option<i32> {
    let causes = std::iter::successors(error.source(), |&cause| cause.source());
    causes.filter_map(|cause| cause.downcast_ref::<io::Error>()).find_map(io::Error::raw_os_error)
}

/// The exception of invalid arguments.
pub(super) fn usage(py: Python<'_>, sentence: &str) -> PyErr {
    exception(py, ExitKind::Usage, sentence, None, None, None)
}

fn exception(
    py: Python<'_>,
    kind: ExitKind,
    sentence: &str,
    errno: Option<i32>,
    path: Option<&Path>,
    minimum_bytes: Option<u64>,
) -> PyErr {
    let kind = match kind {
        ExitKind::Usage => "usage",
        ExitKind::Input => "input",
        ExitKind::Budget => "budget",
        ExitKind::Io | ExitKind::Partial => "system",
        ExitKind::Stopped => "stopped",
    };
    let made = py
        .import("infobyte._errors")
        .and_then(|module| module.getattr("make"))
        .and_then(|make| make.call1((kind, sentence, errno, path, minimum_bytes)));
    match made {
        Ok(exception) => PyErr::from_value(exception),
        Err(error) => error,
    }
}
