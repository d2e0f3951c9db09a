//! Files without a name, and reads into several buffers.

use std::fs::File;
use std::io::{self, IoSliceMut};
use std::os::fd::AsRawFd;
use std::path::Path;

use rustix::fs::{AtFlags, CWD, Mode, OFlags};

/// A file in `folder` that has no name yet, for [`give_name`]; gone with its last descriptor, even when the process
/// is killed.
///
/// # Errors
/// The folder is missing, read-only or full, or its file system or the machine has no such files.
pub(crate) fn unnamed_file(folder: &Path) -> io::Result<File> {
    let flags = OFlags::TMPFILE | OFlags::RDWR | OFlags::CLOEXEC;
    let file = rustix::fs::openat(CWD, folder, flags, Mode::from_raw_mode(0o666))?;
    // The name is given later through /proc.
    if Path::new("/proc/self/fd").exists() { Ok(file.into()) } else { Err(io::ErrorKind::Unsupported.into()) }
}

/// Gives an [`unnamed_file`] a name that is free.
///
/// # Errors
/// [`io::ErrorKind::AlreadyExists`], or the system refused.
pub(crate) fn give_name(file: &File, name: &Path) -> io::Result<()> {
    let source = format!("/proc/self/fd/{}", file.as_raw_fd());
    Ok(rustix::fs::linkat(CWD, source.as_str(), CWD, name, AtFlags::SYMLINK_FOLLOW)?)
}

/// Reads into several buffers from one place on; returns how much was read.
///
/// # Errors
/// The system refused.
pub(crate) fn read_parts(file: &File, parts: &mut [IoSliceMut<'_>], offset: u64) -> io::Result<usize> {
    Ok(rustix::io::preadv(file, parts, offset)?)
}
