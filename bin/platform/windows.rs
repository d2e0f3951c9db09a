//! Windows.

use std::fs::File;
use std::io;
use std::path::Path;
use std::process::Command;

/// No-op: writing past a limit is an error on this system.
pub(crate) fn report_size_limits() {}

/// No-op: the system refuses to truncate a file that is mapped.
pub(crate) fn tell_of(_: &Path, _: bool) {}

/// Makes a file at `path`, which lies in a temporary folder.
pub(crate) fn hidden_file(path: &Path, _: &Path) -> io::Result<File> {
    File::create_new(path)
}

/// True if the other end of the pipe was closed.
pub(crate) fn is_reader_gone(cause: &io::Error) -> bool {
    /// The system's number for a pipe whose other end was closed.
    const PIPE_NOT_CONNECTED: i32 = 233;
    cause.kind() == io::ErrorKind::BrokenPipe || cause.raw_os_error() == Some(PIPE_NOT_CONNECTED)
}

/// The program that opens an address.
pub(super) fn browser() -> Option<Command> {
    let mut browser = Command::new("rundll32.exe");
    browser.arg("url.dll,FileProtocolHandler");
    Some(browser)
}
