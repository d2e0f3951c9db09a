//! The bytes of a finished file, mapped read-only: the only `unsafe` of the loader.
#![allow(unsafe_code)]

use std::io;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use super::{LoadError, LoadFault};
use crate::platform;
use crate::platform::PositionalFile;

/// The bytes of a file that are read in place: mapped read-only, or in memory for a small file ([`Model::open`]);
/// dereferences to them through `AsRef`.
///
/// [`Model::open`]: super::Model::open
#[derive(Debug)]
pub struct Mapping(Held);

#[derive(Debug)]
enum Held {
    Mapped(Mapped),
    Read(Vec<u8>),
}

/// True where a truncated file must not end the process: inside a host program, and in a server.
static SURVIVES: AtomicBool = AtomicBool::new(cfg!(feature = "python"));

/// Makes mappings created from now on read lost pages of a truncated file as zeros, instead of ending the process;
/// [`FileIdentity::check`] detects it afterwards.
pub(crate) fn survive_torn_files() {
    SURVIVES.store(true, Ordering::Relaxed);
}

/// A mapping.
#[derive(Debug)]
struct Mapped {
    _watched: Option<platform::Watched>,
    map: memmap2::Mmap,
    /// True once pages have been released.
    gave_back: AtomicBool,
}

/// Size and modification time of a file, which change when it is written to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct FileIdentity {
    bytes: u64,
    changed: (i64, i64),
}

impl FileIdentity {
    /// The current identity of a file.
    pub(crate) fn of(file: &PositionalFile) -> io::Result<Self> {
        let meta = file.metadata()?;
        Ok(Self { bytes: meta.len(), changed: platform::changed(&meta) })
    }

    /// Checks that the open file is unchanged. Call this before results of it are kept: a file that was overwritten in
    /// place meanwhile was neither the one model nor the other. `path` is the name in the error.
    ///
    /// # Errors
    /// The file was changed, or the operating system refused.
    pub(crate) fn check(self, file: &PositionalFile, path: &Path) -> Result<(), LoadError> {
        let path = || path.to_path_buf();
        match Self::of(file) {
            Ok(now) if now == self => Ok(()),
            Ok(_) => Err(LoadFault::Changed { path: path() }.into()),
            Err(cause) => Err(LoadFault::Unreadable { path: path(), cause }.into()),
        }
    }
}

impl Mapping {
    /// Maps `file`, which must not be empty.
    ///
    /// # Errors
    /// The operating system refused.
    pub(crate) fn of(file: &PositionalFile) -> io::Result<Self> {
        // SAFETY: the bytes must not change while they are mapped. This program keeps that promise by
        // never writing to a finished `.oct`: every output is a new file that replaces the old name by
        // rename, so a mapped file keeps its own unchanged bytes. Other programs are asked by the
        // specification (SPEC 7) to do the same; if one does not, no reference with an invariant
        // beyond "any byte" is ever made from the mapping, [`FileIdentity::check`] reports it, and a
        // file cut short raises a bus error, as every mapping of a file does: the command ends with a
        // sentence then, and Python's module and the server go on with zeros.
        let map = unsafe { memmap2::Mmap::map(file.whole())? };
        Ok(Self(Held::Mapped(Mapped {
            _watched: SURVIVES.load(Ordering::Relaxed).then(|| platform::Watched::new(&map)).flatten(),
            map,
            gave_back: AtomicBool::new(false),
        })))
    }

    /// Wraps bytes that were read.
    pub(super) fn read(bytes: Vec<u8>) -> Self {
        Self(Held::Read(bytes))
    }

    /// Releases all pages of the mapping from the process, for passes that go on to other parts of the file; pages read
    /// again come back from the system's cache. If the system refuses, the pages stay.
    pub fn give_back(&self) {
        if let Held::Mapped(mapped) = &self.0 {
            if !mapped.gave_back.swap(true, Ordering::Relaxed) {
                platform::part_mapping(&mapped.map);
            }
            platform::give_back_pages(&mapped.map);
        }
    }
}

impl AsRef<[u8]> for Mapping {
    #[inline]
    fn as_ref(&self) -> &[u8] {
        match &self.0 {
            Held::Mapped(mapped) => &mapped.map,
            Held::Read(bytes) => bytes,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use super::*;
    use crate::budget::mapped_rss_bytes;

    #[test]
    fn pages_are_resident_once_they_are_read_and_until_they_are_given_back() {
        let file = tempfile::tempfile().unwrap();
        // Written at once, so that the system's cache holds large pieces.
        (&file).write_all(&vec![0; 8 << 20]).unwrap();
        let mapping = Mapping::of(&file.into()).unwrap();
        assert_eq!(mapped_rss_bytes(mapping.as_ref()), Some(0));
        assert!(mapping.as_ref()[..3 << 20].iter().all(|byte| *byte == 0));
        // The system maps some more pages than requested.
        assert!((3 << 20..=4 << 20).contains(&mapped_rss_bytes(mapping.as_ref()).unwrap()));
        mapping.give_back();
        assert_eq!(mapped_rss_bytes(mapping.as_ref()), Some(0));
        assert_eq!(mapping.as_ref()[5 << 20], 0);
        assert!(mapped_rss_bytes(mapping.as_ref()).unwrap() <= 256 << 10);
    }
}
