//! Files, common to every Unix.

use std::fs::{File, Metadata, OpenOptions, Permissions};
use std::io;
use std::os::unix::fs::{MetadataExt, OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};

use rustix::fs::OFlags;
use rustix::process::{Resource, getrlimit};
use thiserror::Error;

/// Names as bytes.
pub(crate) use std::os::unix::ffi::OsStrExt;
/// Reading and writing by position.
pub(crate) use std::os::unix::fs::FileExt;
#[cfg(test)]
pub(crate) use std::os::unix::fs::symlink;

#[cfg(test)]
pub(crate) use rustix::io::Errno;

/// Identity of an open file regardless of its name: the device and its number there.
///
/// # Errors
/// The system refused.
pub(crate) fn open_file_id(file: &File) -> io::Result<(u64, u64)> {
    file.metadata().map(|meta| (meta.dev(), meta.ino()))
}

/// Identity of a file or folder that a path leads to.
///
/// # Errors
/// The system refused.
pub(crate) fn file_id(path: &Path) -> io::Result<(u64, u64)> {
    std::fs::metadata(path).map(|meta| (meta.dev(), meta.ino()))
}

/// A path below a folder.
pub(crate) fn below(folder: &Path, name: &Path) -> PathBuf {
    folder.join(name)
}

/// The path itself: its form does not limit its length.
pub(crate) fn of_any_length(path: PathBuf) -> PathBuf {
    path
}

/// False: devices are not told by their names.
pub(crate) fn is_device(_: &Path) -> bool {
    false
}

/// The reason why a file is not replaced, as the system gives it.
pub(crate) fn not_replaced(cause: io::Error) -> io::Error {
    cause
}

/// False: files that others have open can be read and replaced.
pub(crate) fn is_open_elsewhere(_: &io::Error) -> bool {
    false
}

/// A path for reports.
pub(crate) fn as_reported(path: String) -> String {
    path
}

/// Time of the last change of a file's bytes: seconds and nanoseconds.
pub(crate) fn changed(meta: &Metadata) -> (i64, i64) {
    (meta.mtime(), meta.mtime_nsec())
}

/// A folder, a pipe or a device where a file is needed; held by an [`io::Error`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error("it is not a regular file")]
pub(crate) struct NotRegular;

/// Opens a regular file for reading. Opening a pipe could wait for ever, and opening a device could have any effect, so
/// both are refused before.
///
/// # Errors
/// The file is not regular ([`NotRegular`], of the kind [`io::ErrorKind::InvalidInput`]), or the system refused.
pub(in crate::platform) fn open_file(path: &Path) -> io::Result<File> {
    let regular = |meta: Metadata| {
        if meta.is_file() { Ok(()) } else { Err(io::Error::new(io::ErrorKind::InvalidInput, NotRegular)) }
    };
    regular(std::fs::metadata(path)?)?;
    let file = File::open(path)?;
    regular(file.metadata()?)?;
    Ok(file)
}

/// Permissions of a new file for the owner, the group and others, before the process's mask; `None` on systems without
/// them.
pub(crate) fn new_file_permissions() -> Option<Permissions> {
    Some(Permissions::from_mode(0o666))
}

/// True for a refusal by [`open_file`].
pub(crate) fn is_not_regular(cause: &io::Error) -> bool {
    cause.get_ref().is_some_and(|inner| inner.is::<NotRegular>())
}

/// Opens a file for reading and writing, and makes it if it is missing. A link is refused, as it would lead elsewhere;
/// a pipe is not waited for.
///
/// # Errors
/// The system refused.
pub(crate) fn open_itself(path: &Path) -> io::Result<File> {
    let mut options = OpenOptions::new();
    options.read(true).write(true).create(true).truncate(false);
    options.custom_flags((OFlags::NOFOLLOW | OFlags::NONBLOCK).bits().cast_signed()).open(path)
}

/// Free bytes of the file system of a file.
pub(crate) fn free_bytes(file: &File) -> Option<u64> {
    let system = rustix::fs::fstatvfs(file).ok()?;
    Some(system.f_bavail.saturating_mul(system.f_frsize))
}

/// Most files that this process may have open; `None` without a limit.
pub(crate) fn open_files_limit() -> Option<u64> {
    getrlimit(Resource::Nofile).current
}

/// True if a file was refused because too many are open.
pub(crate) fn is_too_many_open(cause: &io::Error) -> bool {
    use rustix::io::Errno;
    let code = cause.raw_os_error();
    [Errno::MFILE, Errno::NFILE].iter().any(|errno| code == Some(errno.raw_os_error()))
}

#[cfg(test)]
pub(crate) fn make_pipe(path: &Path) {
    assert!(std::process::Command::new("mkfifo").arg(path).status().unwrap().success());
}
