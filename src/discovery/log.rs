//! The names of found files on disk instead of in memory, chained per item.
//!
//! A record holds the offset of the record before it of the same item, so that an item needs to
//! remember one offset only, and its files are walked backwards from there.
//!
//! ```text
//! offset  0        8          16         24       28        32
//!         | before | size     | changed  | input  | length  | path below the input ...
//! ```

use std::ffi::OsStr;
use std::fs::{self, Metadata};
use std::io;
use std::path::{Path, PathBuf};

use crate::platform::{self, OsStrExt};
use crate::scratch::Appended;
use crate::source::InputFiles;
use crate::volume::{Result, SourceError, SourceFault};

/// No record: the end of a chain.
pub(super) const NONE: u64 = u64::MAX;

/// Bytes before the path.
const HEAD_BYTES: usize = 32;

/// Bytes held in memory; a smaller log never touches the disk.
const MEMORY_BYTES: usize = 64 << 10;

/// Longest path that is kept; the system's own limit is 4096.
const MAX_PATH_BYTES: usize = 16 << 10;

/// A found file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Record {
    /// Offset of the record before this one in its chain, or [`NONE`].
    pub(super) before: u64,
    /// Length of the file.
    pub(super) size: u64,
    /// Time of its last change, as 64 bits that differ when it does.
    pub(super) changed: u64,
    /// Index of the input below which it lies.
    pub(super) input: u32,
    /// Path below the input; empty when the input is the file.
    pub(super) path: PathBuf,
}

impl Record {
    /// A record without a chain and without facts of the file.
    pub(super) fn of(input: u32, path: &Path) -> Self {
        Self { before: NONE, size: 0, changed: 0, input, path: path.to_path_buf() }
    }
}

/// Records in an unnamed scratch file, the last ones in memory.
#[derive(Debug)]
pub(super) struct Log(Appended);

impl Log {
    /// An empty log; `folder` takes the scratch file, once there is need of one.
    pub(super) fn new(folder: &Path) -> Self {
        Self(Appended::new(folder, MEMORY_BYTES))
    }

    fn failed(&self, cause: io::Error) -> SourceError {
        SourceError::from(SourceFault::Scratch { path: self.0.folder().to_path_buf(), cause })
    }

    /// Adds a record and returns its offset.
    ///
    /// # Errors
    /// [`SourceError`] when the disk is full.
    pub(super) fn push(&mut self, record: &Record) -> Result<u64> {
        let path = record.path.as_os_str().as_bytes();
        let path = path.get(..path.len().min(MAX_PATH_BYTES)).unwrap_or(&[]);
        let mut bytes = Vec::with_capacity(HEAD_BYTES + path.len());
        for word in [record.before, record.size, record.changed] {
            bytes.extend_from_slice(&word.to_le_bytes());
        }
        bytes.extend_from_slice(&record.input.to_le_bytes());
        bytes.extend_from_slice(&u32::try_from(path.len()).unwrap_or(0).to_le_bytes());
        bytes.extend_from_slice(path);
        self.0.push(&bytes).map_err(|cause| self.failed(cause))
    }

    /// Gives back memory that no record waits in.
    pub(super) fn shrink(&mut self) {
        self.0.shrink();
    }

    /// The record at an offset that [`Log::push`] returned.
    ///
    /// # Errors
    /// [`SourceError`] when the disk fails.
    pub(super) fn get(&self, offset: u64) -> Result<Record> {
        self.read(offset).map_err(|cause| self.failed(cause))
    }

    #[expect(clippy::cast_possible_truncation, reason = "two numbers of 32 bits in one of 64")]
    fn read(&self, offset: u64) -> io::Result<Record> {
        let mut head = [0; HEAD_BYTES];
        self.0.read_at(&mut head, offset)?;
        let [before, size, changed, last] = bytemuck::cast::<_, [[u8; 8]; 4]>(head).map(u64::from_le_bytes);
        let mut path = vec![0; ((last >> 32) as usize).min(MAX_PATH_BYTES)];
        self.0.read_at(&mut path, offset + HEAD_BYTES as u64)?;
        let (input, path) = (last as u32, PathBuf::from(OsStr::from_bytes(&path)));
        Ok(Record { before, size, changed, input, path })
    }

    /// All records, in the order in which they were added.
    ///
    /// # Errors
    /// The errors of [`Log::get`], for each record.
    pub(super) fn all(&self) -> impl Iterator<Item = Result<Record>> + '_ {
        let end = self.0.len();
        let mut next = 0;
        std::iter::from_fn(move || {
            if next >= end {
                return None;
            }
            let record = self.get(next);
            next = record.as_ref().map_or(end, |r| next + (HEAD_BYTES + r.path.as_os_str().len()) as u64);
            Some(record)
        })
    }

    /// The records of a chain, last first.
    ///
    /// # Errors
    /// The errors of [`Log::get`], for each record.
    pub(super) fn chain(&self, last: u64) -> impl Iterator<Item = Result<Record>> + '_ {
        let mut next = last;
        std::iter::from_fn(move || {
            if next == NONE {
                return None;
            }
            let record = self.get(next);
            next = record.as_ref().map_or(NONE, |r| r.before);
            Some(record)
        })
    }
}

/// Time of change of a file, as bits that differ when the time does.
pub(super) fn changed(meta: &Metadata) -> u64 {
    const NANOSECONDS: i64 = 1_000_000_000;
    let (seconds, nanoseconds) = platform::changed(meta);
    seconds.wrapping_mul(NANOSECONDS).wrapping_add(nanoseconds).cast_unsigned()
}

/// Adds a file to those of a volume, with its size and time of change as they are now.
///
/// # Errors
/// It is missing.
pub(super) fn add_file(files: &mut InputFiles, path: &Path) -> io::Result<()> {
    let meta = fs::metadata(path)?;
    files.add(path, meta.len(), changed(&meta));
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chains_come_back_from_memory_and_from_the_scratch_file() {
        let folder = tempfile::tempdir().unwrap();
        let mut log = Log::new(folder.path());
        let mut last = [NONE; 3];
        let record = |i: usize, before| Record {
            before,
            size: i as u64,
            changed: !(i as u64),
            input: u32::try_from(i % 7).unwrap(),
            path: PathBuf::from(format!("folder/{i}-{}", "x".repeat(i % 90))),
        };
        for i in 0..6000 {
            let before = last[i % 3];
            last[i % 3] = log.push(&record(i, before)).unwrap();
        }
        for (part, last) in last.into_iter().enumerate() {
            let found: Vec<Record> = log.chain(last).map(Result::unwrap).collect();
            assert_eq!(found.len(), 2000);
            for (k, got) in found.iter().enumerate() {
                assert_eq!(*got, record(part + 3 * (1999 - k), got.before));
            }
        }
        assert!(log.get(u64::MAX - 1).is_err());
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "the scratch file has no name");
    }
}
