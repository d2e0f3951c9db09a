//! Read-only mapping of a finished file: the only `unsafe` of the loader.
#![allow(unsafe_code)]

use std::fs::File;
use std::io;

use crate::platform;

/// A whole file mapped read-only; dereferences to its bytes through `AsRef`. The file stays open, so that a change
/// of its bytes can be noticed.
#[derive(Debug)]
pub struct Mapping {
    map: memmap2::Mmap,
    file: File,
    then: FileIdentity,
}

/// Changes when a file is written to: its size and its time of change.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct FileIdentity {
    bytes: u64,
    changed: (i64, i64),
}

impl FileIdentity {
    /// The file as it is now.
    pub(super) fn of(file: &File) -> io::Result<Self> {
        let meta = file.metadata()?;
        Ok(Self { bytes: meta.len(), changed: platform::changed(&meta) })
    }
}

impl Mapping {
    /// Maps `file`, which must not be empty.
    ///
    /// # Errors
    /// The operating system refused.
    pub fn of(file: &File) -> io::Result<Self> {
        let file = file.try_clone()?;
        let then = FileIdentity::of(&file)?;
        Self::since(file, then)
    }

    /// Maps a file of which something was read before, when it was what `then` says.
    pub(super) fn since(file: File, then: FileIdentity) -> io::Result<Self> {
        // SAFETY: the bytes must not change while they are mapped. This program keeps that promise by
        // never writing to a finished `.oct`: every output is a new file that replaces the old name by
        // rename, so a mapped file keeps its own unchanged bytes. Other programs are asked by the
        // specification (SPEC 7) to do the same; if one does not, no reference with an invariant
        // beyond "any byte" is ever made from the mapping, [`Mapping::is_unchanged`] reports it, and a
        // file cut short raises a bus error, as every mapping of a file does: the command ends with a
        // sentence then.
        let map = unsafe { memmap2::Mmap::map(&file)? };
        Ok(Self { map, file, then })
    }

    /// Takes all pages of the mapping out of the process, for passes that go on to other parts of the file; what is
    /// looked at again comes back from the system's cache. If the system refuses, the pages stay.
    pub fn give_back(&self) {
        platform::give_back_pages(&self.map);
    }

    /// Are the bytes still those that were mapped, as far as size and time of change tell? A file that another one
    /// has replaced under its name is unchanged: the mapping keeps it.
    ///
    /// # Errors
    /// The operating system refused.
    pub(crate) fn is_unchanged(&self) -> io::Result<bool> {
        Ok(FileIdentity::of(&self.file)? == self.then)
    }
}

impl AsRef<[u8]> for Mapping {
    #[inline]
    fn as_ref(&self) -> &[u8] {
        &self.map
    }
}
