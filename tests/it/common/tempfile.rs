//! Temporary folders, in memory where there is room: every model that is written is synced, which takes a disk 30 ms.

pub(crate) use ::tempfile::TempDir;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

/// Where folders are made: what `TMPDIR` names, `/dev/shm` if it has 4 GiB, or the system's choice.
static PARENT: LazyLock<PathBuf> = LazyLock::new(|| {
    let memory = Path::new("/dev/shm");
    let has_room = || free_bytes(memory).is_some_and(|free| free >= 4 << 30);
    if std::env::var_os("TMPDIR").is_none() && has_room() { memory.to_owned() } else { std::env::temp_dir() }
});

#[cfg(unix)]
fn free_bytes(folder: &Path) -> Option<u64> {
    let system = rustix::fs::statvfs(folder).ok()?;
    Some(system.f_bavail * system.f_frsize)
}

#[cfg(windows)]
fn free_bytes(_: &Path) -> Option<u64> {
    None
}

pub(crate) fn tempdir() -> io::Result<TempDir> {
    ::tempfile::tempdir_in(&*PARENT)
}
