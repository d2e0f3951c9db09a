//! The output folder, and one batch at a time in it: an advisory lock on a hidden file of the folder.
//!
//! The system gives the lock back when the process ends, however it ends. The file is removed by a batch that
//! ends by itself; a killed one leaves it, and the next batch takes it over. Only its owner removes it, while it
//! holds the lock, and each process that gets a lock makes sure that it is on the file that has the name: two batches
//! never hold a lock each, one of them on a file that is gone.

use std::fs::{self, File, TryLockError};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use crate::error::Error;
use crate::platform::{self, file_id, open_file_id};

/// Name of the file: it begins like the other hidden files of the program, and is hidden from searches.
const NAME: &str = ".oct-lock";

/// Content of the file, for somebody who finds it after a crash.
const TEXT: &str = "Held by a running `oct batch`; when none is running, this file means nothing.\n";

/// Attempts at a file that vanishes between being opened and being locked.
const ATTEMPTS: u32 = 100;

/// The right to write into a folder; given back when dropped.
#[derive(Debug)]
pub(super) struct FolderLock {
    path: PathBuf,
    /// Locked, unless `warning` is set.
    file: File,
    /// Sentence on the missing lock, where the file system has no locks.
    pub(super) warning: Option<String>,
}

impl FolderLock {
    /// Takes the lock of a folder, without waiting.
    ///
    /// # Errors
    /// [`Error::Busy`] while another batch holds it; [`Error::Output`] where the folder cannot be written.
    pub(super) fn take(folder: &Path) -> Result<Self, Error> {
        let path = folder.join(NAME);
        for _ in 0..ATTEMPTS {
            let opened = platform::open_itself(&path);
            let mut file = opened.map_err(|cause| Error::Output { path: path.clone(), cause })?;
            match file.try_lock() {
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => return Err(Error::Busy { path: folder.to_path_buf() }),
                Err(TryLockError::Error(cause)) => return Ok(Self::without(path, file, &cause)),
            }
            if is_named(&file, &path) {
                if file.metadata().is_ok_and(|meta| meta.is_file() && meta.len() == 0) {
                    // For people only; an error such as a full disk shows up where it matters.
                    let _ = file.write_all(TEXT.as_bytes());
                }
                return Ok(Self { path, file, warning: None });
            }
        }
        Err(Error::Busy { path: folder.to_path_buf() })
    }

    fn without(path: PathBuf, file: File, cause: &io::Error) -> Self {
        let warning = format!(
            "the file system of the output folder has no locks ({cause}); see to it that no other batch writes into the folder"
        );
        Self { path, file, warning: Some(warning) }
    }
}

impl Drop for FolderLock {
    fn drop(&mut self) {
        // Removed before it is unlocked, which closing does: the file of the next owner is never removed.
        if is_named(&self.file, &self.path) {
            let _ = fs::remove_file(&self.path);
        }
    }
}

/// True if `path` still names this file, and not one that has replaced it.
fn is_named(file: &File, path: &Path) -> bool {
    let is_file = fs::symlink_metadata(path).is_ok_and(|named| named.is_file());
    is_file && open_file_id(file).is_ok_and(|open| file_id(path).is_ok_and(|named| open == named))
}

/// Folders that were made for the results, the innermost first; the empty ones are removed when it is dropped.
pub(in crate::jobs) struct NewFolders(Vec<PathBuf>);

impl NewFolders {
    /// Makes a folder and its missing parents.
    pub(in crate::jobs) fn create(folder: &Path) -> io::Result<Self> {
        let is_missing = |path: &&Path| !path.as_os_str().is_empty() && !path.exists();
        let missing = folder.ancestors().take_while(is_missing).map(Path::to_path_buf).collect();
        fs::create_dir_all(folder)?;
        Ok(Self(missing))
    }
}

impl Drop for NewFolders {
    fn drop(&mut self) {
        // A folder that holds something stays.
        self.0.iter().for_each(|folder| drop(fs::remove_dir(folder)));
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU32, Ordering};

    use super::*;

    #[test]
    fn files_that_come_and_go_never_give_two_owners() {
        let folder = tempfile::tempdir().unwrap();
        let (owners, turns) = (AtomicU32::new(0), AtomicU32::new(0));
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    for _ in 0..500 {
                        let Ok(lock) = FolderLock::take(folder.path()) else { continue };
                        assert_eq!(owners.fetch_add(1, Ordering::SeqCst), 0);
                        turns.fetch_add(1, Ordering::SeqCst);
                        owners.fetch_sub(1, Ordering::SeqCst);
                        drop(lock);
                    }
                });
            }
        });
        assert!(turns.load(Ordering::SeqCst) > 100);
    }

    #[test]
    fn a_link_is_not_followed_and_a_missing_folder_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let other = folder.path().join("other");
        platform::symlink(&other, folder.path().join(NAME)).unwrap();
        assert!(matches!(FolderLock::take(folder.path()), Err(Error::Output { .. })));
        assert!(!other.exists());
        assert!(matches!(FolderLock::take(&folder.path().join("none")), Err(Error::Output { .. })));
    }

    #[test]
    fn a_file_system_without_locks_is_tolerated_and_told() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(NAME);
        let file = File::create(&path).unwrap();
        let lock = FolderLock::without(path.clone(), file, &io::ErrorKind::Unsupported.into());
        assert!(lock.warning.as_deref().is_some_and(|text| text.contains("no locks")));
        drop(lock);
        assert!(!path.exists());
    }
}
