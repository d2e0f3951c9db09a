//! Output files that appear whole or not at all.
//!
//! The bytes go to a file next to the target that has no name yet; it is synced, given the target's name in one step,
//! and the folder is synced. A process that is killed leaves the old target, or none, and no temporary file.

use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Once, mpsc};
use std::thread;
use std::time::Duration;

use crate::platform;

use thiserror::Error;

/// A reason not to write a target that the system itself would accept; held by an [`io::Error`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub(crate) enum TargetFault {
    #[error("it is a link to a place that does not exist")]
    DanglingLink,
    #[error("it exists and is not a regular file")]
    NotRegular,
    #[error("it is the name of a device")]
    Device,
    #[error("it is not a file name")]
    NoFileName,
    #[error("no free temporary name in the folder")]
    NoFreeName,
}

impl From<TargetFault> for io::Error {
    fn from(fault: TargetFault) -> Self {
        Self::other(fault)
    }
}

/// A file being written that will become `target` on [`AtomicFile::commit`]; dropped before that, it
/// leaves nothing.
#[derive(Debug)]
pub(crate) struct AtomicFile {
    target: PathBuf,
    folder: PathBuf,
    storage: Storage,
}

#[derive(Debug)]
enum Storage {
    /// Gone with its last descriptor, even when the process is killed.
    Unnamed(File),
    /// Fallback where the file system has no unnamed files.
    Named(tempfile::NamedTempFile),
}

impl AtomicFile {
    /// Starts a file that will replace `target`. Its folder must exist and be writable; a target that
    /// is a link is followed.
    ///
    /// # Errors
    /// The folder is missing or read-only, or the target is a folder or a device.
    pub(crate) fn create(target: &Path) -> io::Result<Self> {
        let target = match fs::canonicalize(target) {
            Ok(real) => real,
            Err(_) => target.to_path_buf(),
        };
        // Checked before its links are resolved: one may lead to a pipe, which has no name.
        if fs::metadata(&target).is_ok_and(|m| !m.is_file()) {
            return Err(TargetFault::NotRegular.into());
        }
        if fs::symlink_metadata(&target).is_ok_and(|m| m.is_symlink()) {
            return Err(TargetFault::DanglingLink.into());
        }
        if platform::is_device(&target) {
            return Err(TargetFault::Device.into());
        }
        if target.file_name().is_none() {
            return Err(TargetFault::NoFileName.into());
        }
        let target = platform::of_any_length(target);
        let folder = match target.parent() {
            Some(parent) if !parent.as_os_str().is_empty() => parent.to_path_buf(),
            _ => PathBuf::from("."),
        };
        let storage = match platform::unnamed_file(&folder) {
            Ok(file) => Storage::Unnamed(file),
            // A clear refusal; anything else may be a file system without unnamed files.
            Err(cause) if is_final(&cause) => return Err(cause),
            Err(_) => Storage::Named(named(&folder).map_err(|cause| not_made(cause, &folder))?),
        };
        Ok(Self { target, folder, storage })
    }

    /// The temporary file, open for reading and writing.
    pub(crate) fn file(&self) -> &File {
        match &self.storage {
            Storage::Unnamed(file) => file,
            Storage::Named(file) => file.as_file(),
        }
    }

    /// Calls `work`, which writes the file, and syncs its bytes to the disk meanwhile: then [`Self::commit`] has little
    /// to wait for.
    ///
    /// # Errors
    /// The disk failed, which the system may report only once.
    pub(crate) fn written_behind<T>(&self, work: impl FnOnce() -> T) -> io::Result<T> {
        /// Interval between two syncs; small files are written before the first.
        const PAUSE: Duration = Duration::from_millis(50);
        thread::scope(|scope| {
            let (working, done) = mpsc::channel::<()>();
            let sync = move || {
                while done.recv_timeout(PAUSE) == Err(mpsc::RecvTimeoutError::Timeout) {
                    self.file().sync_data()?;
                }
                Ok(())
            };
            // Without another thread the commit waits for all bytes.
            let syncing = thread::Builder::new().spawn_scoped(scope, sync);
            let result = work();
            drop(working);
            let synced = syncing.map_or(Ok(()), |thread| thread.join().unwrap_or(Ok(())));
            synced.map(|()| result)
        })
    }

    /// Syncs the bytes and puts the file in the target's place.
    ///
    /// # Errors
    /// The disk or the folder failed; the old target is untouched then.
    pub(crate) fn commit(self) -> io::Result<()> {
        self.file().sync_all()?;
        match self.storage {
            Storage::Named(file) => {
                file.persist(&self.target).map_err(|e| platform::not_replaced(e.error))?;
            }
            Storage::Unnamed(file) => link(&file, &self.folder, &self.target)?,
        }
        // Some file systems cannot sync a folder; the file itself is safe by now.
        if let Ok(folder) = File::open(&self.folder) {
            let _ = folder.sync_all();
        }
        Ok(())
    }
}

/// Errors that a named file would meet as well.
fn is_final(cause: &io::Error) -> bool {
    use io::ErrorKind as Kind;
    matches!(
        cause.kind(),
        Kind::NotFound
            | Kind::PermissionDenied
            | Kind::ReadOnlyFilesystem
            | Kind::NotADirectory
            | Kind::StorageFull
    )
}

/// The error of making a file in a folder: some systems report a file in the folder's place as missing.
fn not_made(cause: io::Error, folder: &Path) -> io::Error {
    let is_file = || folder.ancestors().any(Path::is_file);
    if cause.kind() == io::ErrorKind::NotFound && is_file() {
        io::ErrorKind::NotADirectory.into()
    } else {
        cause
    }
}

/// A file with a name that [`sweep`] recognises. A process that is killed leaves this file behind, and a later one
/// sweeps it.
fn named(folder: &Path) -> io::Result<tempfile::NamedTempFile> {
    static SWEPT: Once = Once::new();
    SWEPT.call_once(|| sweep(folder));
    loop {
        let name = temporary_name();
        let mut builder = tempfile::Builder::new();
        builder.prefix(&name).rand_bytes(0);
        if let Some(permissions) = platform::new_file_permissions() {
            builder.permissions(permissions);
        }
        match builder.tempfile_in(folder) {
            // A remainder of a process with the same number.
            Err(cause) if cause.kind() == io::ErrorKind::AlreadyExists => {}
            made => return made,
        }
    }
}

/// Removes the whole files under a second, hidden name in `folder` that processes left when they were killed in the
/// moment of replacing a target.
pub(crate) fn sweep(folder: &Path) {
    let Ok(entries) = fs::read_dir(folder) else { return };
    for entry in entries.flatten() {
        let name = entry.file_name();
        let process = name.to_str().and_then(|n| n.strip_prefix(SECOND_NAME)?.split_once('-'));
        let gone = |(id, count): (&str, &str)| {
            let digits = |text: &str| !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
            digits(id) && digits(count) && platform::has_ended(id)
        };
        if process.is_some_and(gone) {
            let _ = fs::remove_file(entry.path());
        }
    }
}

/// A hidden temporary name for a whole file of this process; [`sweep`] removes the file if the process cannot.
pub(crate) fn temporary_name() -> String {
    static COUNT: AtomicU64 = AtomicU64::new(1000);
    format!("{SECOND_NAME}{}-{}", std::process::id(), COUNT.fetch_add(1, Ordering::Relaxed))
}

/// Prefix of the second name; the process and a count follow.
const SECOND_NAME: &str = ".oct-";

/// Gives an unnamed file the target's name. A free name is taken directly; an existing target is replaced by way of a
/// second name, because a link cannot replace.
fn link(file: &File, folder: &Path, target: &Path) -> io::Result<()> {
    match platform::give_name(file, target) {
        Err(e) if e.kind() == io::ErrorKind::AlreadyExists => {}
        other => return other,
    }
    for attempt in 0..1000_u32 {
        let name = folder.join(format!("{SECOND_NAME}{}-{attempt}", std::process::id()));
        match platform::give_name(file, &name) {
            Err(e) if e.kind() == io::ErrorKind::AlreadyExists => {}
            Err(e) => return Err(e),
            Ok(()) => {
                return fs::rename(&name, target).inspect_err(|_| {
                    let _ = fs::remove_file(&name);
                });
            }
        }
    }
    Err(TargetFault::NoFreeName.into())
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use super::*;

    #[test]
    fn only_second_names_of_dead_processes_are_swept() {
        let folder = tempfile::tempdir().unwrap();
        let mine = format!(".oct-{}-0", std::process::id());
        for name in [".oct-4294967295-0", &mine, ".oct-x-0", "a.oct", ".oct-4294967295-"] {
            fs::write(folder.path().join(name), "x").unwrap();
        }
        sweep(folder.path());
        assert!(!folder.path().join(".oct-4294967295-0").exists());
        for name in [&mine, ".oct-x-0", "a.oct", ".oct-4294967295-"] {
            assert!(folder.path().join(name).exists(), "{name}");
        }
    }

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<String> =
            fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    #[test]
    fn a_committed_file_appears_and_replaces_and_a_dropped_one_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("a.oct");
        for text in ["first", "second"] {
            let file = AtomicFile::create(&target).unwrap();
            file.file().write_all(text.as_bytes()).unwrap();
            file.commit().unwrap();
            assert_eq!(fs::read_to_string(&target).unwrap(), text);
        }
        let dropped = AtomicFile::create(&target).unwrap();
        dropped.file().write_all(b"third").unwrap();
        drop(dropped);
        assert_eq!(fs::read_to_string(&target).unwrap(), "second");
        assert_eq!(names(folder.path()), ["a.oct"]);
    }

    #[test]
    fn the_named_way_behaves_alike() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("b.oct");
        for text in ["first", "second"] {
            let storage = Storage::Named(named(folder.path()).unwrap());
            let file = AtomicFile { target: target.clone(), folder: folder.path().to_path_buf(), storage };
            file.file().write_all(text.as_bytes()).unwrap();
            file.commit().unwrap();
            assert_eq!(fs::read_to_string(&target).unwrap(), text);
        }
        assert_eq!(names(folder.path()), ["b.oct"]);
    }

    #[test]
    fn impossible_targets_are_refused_at_once() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(
            AtomicFile::create(&folder.path().join("none/a.oct")).unwrap_err().kind(),
            io::ErrorKind::NotFound
        );
        assert!(AtomicFile::create(folder.path()).is_err());
        assert!(AtomicFile::create(Path::new("/dev/null")).is_err());
        assert!(AtomicFile::create(Path::new("")).is_err());
    }
}
