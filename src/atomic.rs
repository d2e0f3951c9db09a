//! A file that appears whole or not at all.
//!
//! The file is written without a name where the system allows it (`O_TMPFILE`), so that even a killed
//! process leaves nothing behind; otherwise under a temporary name beside the target. On commit it is
//! synced, linked to a temporary name, renamed over the target, and the folder is synced.

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

use rustix::fs::{AtFlags, CWD, Mode, OFlags};

/// An output file that does not exist under its target's name until [`AtomicFile::commit`].
#[derive(Debug)]
pub struct AtomicFile {
    target: PathBuf,
    folder: PathBuf,
    state: State,
}

#[derive(Debug)]
enum State {
    Nameless(File),
    Named(tempfile::NamedTempFile),
}

impl AtomicFile {
    /// Opens an empty file, for reading and writing, on the file system of `target`.
    ///
    /// # Errors
    /// The folder does not exist or cannot be written.
    pub fn create(target: &Path) -> io::Result<Self> {
        if target.is_dir() {
            return Err(io::Error::new(io::ErrorKind::IsADirectory, "it is a folder"));
        }
        let folder = match target.parent() {
            Some(parent) if !parent.as_os_str().is_empty() => parent.to_path_buf(),
            _ => PathBuf::from("."),
        };
        let flags = OFlags::TMPFILE | OFlags::RDWR | OFlags::CLOEXEC;
        let mode = Mode::RUSR | Mode::WUSR | Mode::RGRP | Mode::ROTH;
        let state = match rustix::fs::open(&folder, flags, mode) {
            Ok(fd) => State::Nameless(File::from(fd)),
            Err(rustix::io::Errno::OPNOTSUPP | rustix::io::Errno::ISDIR | rustix::io::Errno::INVAL) => {
                State::Named(tempfile::Builder::new().prefix(".oct-").suffix(".tmp").tempfile_in(&folder)?)
            }
            Err(e) => return Err(e.into()),
        };
        Ok(Self { target: target.to_path_buf(), folder, state })
    }

    /// The open file.
    pub fn file(&self) -> &File {
        match &self.state {
            State::Nameless(file) => file,
            State::Named(named) => named.as_file(),
        }
    }

    /// Syncs the file and gives it its name, replacing what stood there.
    ///
    /// # Errors
    /// Writing back, linking or renaming failed; the old target is untouched then.
    pub fn commit(self) -> io::Result<()> {
        self.file().sync_all()?;
        match self.state {
            State::Nameless(file) => {
                let temporary = temporary_name(&self.target);
                link(&file, &temporary)?;
                if let Err(e) = std::fs::rename(&temporary, &self.target) {
                    let _ = std::fs::remove_file(&temporary);
                    return Err(e);
                }
            }
            State::Named(named) => {
                named.persist(&self.target).map_err(|e| e.error)?;
            }
        }
        File::open(&self.folder)?.sync_all()
    }
}

/// A name beside the target that no other process uses.
fn temporary_name(target: &Path) -> PathBuf {
    let mut name = std::ffi::OsString::from(".");
    name.push(target.file_name().unwrap_or_default());
    name.push(format!(".{}.tmp", std::process::id()));
    target.with_file_name(name)
}

/// Gives a nameless file a name, through its entry in the process's descriptor folder.
fn link(file: &File, name: &Path) -> io::Result<()> {
    use std::os::fd::AsRawFd;
    let descriptor = format!("/proc/self/fd/{}", file.as_raw_fd());
    match rustix::fs::linkat(CWD, &descriptor, CWD, name, AtFlags::SYMLINK_FOLLOW) {
        Err(rustix::io::Errno::EXIST) => {
            // Left by a killed process of the same number.
            std::fs::remove_file(name)?;
            Ok(rustix::fs::linkat(CWD, &descriptor, CWD, name, AtFlags::SYMLINK_FOLLOW)?)
        }
        other => Ok(other?),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    #[test]
    fn the_target_changes_only_on_commit_and_nothing_is_left_behind() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("a.oct");
        std::fs::write(&target, b"old").unwrap();
        let dropped = AtomicFile::create(&target).unwrap();
        dropped.file().write_all(b"half").unwrap();
        drop(dropped);
        assert_eq!(std::fs::read(&target).unwrap(), b"old");
        let kept = AtomicFile::create(&target).unwrap();
        kept.file().write_all(b"new").unwrap();
        kept.commit().unwrap();
        assert_eq!(std::fs::read(&target).unwrap(), b"new");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
        assert!(AtomicFile::create(&folder.path().join("missing/a.oct")).is_err());
        assert!(AtomicFile::create(folder.path()).is_err());
    }
}
