//! Unnamed files for data that does not fit into memory: gone with their last descriptor, even when the process is
//! killed.
//!
//! | type | content |
//! |---|---|
//! | [`Appended`] | bytes in the order of their appending |
//! | [`Chains`] | records by key |
//! | [`PageCache`] | pages of a read-only file |
//!
//! None of them reserves memory: a stage reserves their stated need with its own. The builder's fragments
//! (`builder::swap`) are written by several threads, and triangles in bins share one pool; these have files of their
//! own kind.

mod appended;
mod cache;
mod chains;

pub(crate) use appended::Appended;
pub(crate) use cache::PageCache;
pub(crate) use chains::Chains;

use std::fs::File;
use std::io;
use std::path::Path;

use thiserror::Error;

use crate::budget::Bytes;
use crate::platform;

/// A disk with less room than a scratch file needs; held by an [`io::Error`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error("{} are needed, and {} are free", Bytes(*.needed_bytes), Bytes(*.free_bytes))]
pub(crate) struct NoRoom {
    /// Bytes that are needed.
    pub needed_bytes: u64,
    /// Bytes that are free.
    pub free_bytes: u64,
}

/// A new unnamed file in `folder`, open for reading and writing.
///
/// # Errors
/// The folder is missing, read-only or full.
pub(crate) fn unnamed(folder: &Path) -> io::Result<File> {
    tempfile::tempfile_in(folder)
}

/// A new unnamed file that will hold about `bytes`; refused at once if the file system of `folder` has less room.
///
/// # Errors
/// As [`unnamed`], and [`io::ErrorKind::StorageFull`] with both figures.
pub(crate) fn unnamed_for(folder: &Path, bytes: u64) -> io::Result<File> {
    let file = unnamed(folder)?;
    if let Some(free_bytes) = platform::free_bytes(&file)
        && free_bytes < bytes
    {
        let fault = NoRoom { needed_bytes: bytes, free_bytes };
        return Err(io::Error::new(io::ErrorKind::StorageFull, fault));
    }
    Ok(file)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_disk_is_an_error_of_whoever_writes() {
        let full = || std::fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
        let mut chains = Chains::new(full(), 1, 16);
        chains.push(0, &[0; 16]).unwrap();
        assert_eq!(chains.push(0, &[0; 16]).unwrap_err().kind(), io::ErrorKind::StorageFull);
        let mut appended = Appended::with_file(full(), 16);
        appended.push(&[0; 16]).unwrap();
        assert_eq!(appended.push(&[0; 16]).unwrap_err().kind(), io::ErrorKind::StorageFull);
    }

    #[test]
    fn more_than_the_disk_has_is_refused_at_once() {
        let folder = tempfile::tempdir().unwrap();
        assert!(unnamed_for(folder.path(), 1).is_ok());
        let refused = unnamed_for(folder.path(), u64::MAX).unwrap_err();
        let fault = refused.get_ref().and_then(|inner| inner.downcast_ref::<NoRoom>());
        assert_eq!(fault.map(|fault| fault.needed_bytes), Some(u64::MAX));
        assert_eq!(refused.kind(), io::ErrorKind::StorageFull);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
