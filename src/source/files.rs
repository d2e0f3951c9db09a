//! The files of one volume, named compactly and opened without running out of descriptors.

use std::ffi::OsStr;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering};

use crate::platform::{OsStrExt, PositionalFile, below, open_files_limit};

use super::natural::Meaning;

/// Most files that the volumes of a process keep open together; the rest is opened for each read.
const MAX_OPEN: usize = 1024;

/// Files that are kept open now: several volumes are read at a time, and share the descriptors.
static KEPT: AtomicUsize = AtomicUsize::new(0);

/// Takes one of at most `most` places for a file that stays open.
fn keep_one(most: usize) -> bool {
    let more = |kept: usize| (kept < most).then_some(kept + 1);
    KEPT.fetch_update(Ordering::Relaxed, Ordering::Relaxed, more).is_ok()
}

/// Paths under one base folder: all names in one byte string and one end offset per file.
///
/// A thousand slices take some 30 KiB, where a thousand `PathBuf`s would take several times that.
#[derive(Debug, Default)]
pub(crate) struct FileList {
    base: PathBuf,
    names: Vec<u8>,
    ends: Vec<usize>,
}

impl FileList {
    /// An empty list; names are relative to `base` (empty: relative to the working folder).
    pub(crate) fn new(base: &Path) -> Self {
        Self { base: base.to_path_buf(), names: Vec::new(), ends: Vec::new() }
    }

    pub(crate) fn len(&self) -> usize {
        self.ends.len()
    }

    pub(crate) fn push(&mut self, name: &Path) {
        self.names.extend_from_slice(name.as_os_str().as_bytes());
        self.ends.push(self.names.len());
    }

    /// Name relative to the base; empty for an index out of range.
    pub(crate) fn name(&self, index: usize) -> &Path {
        let start = index.checked_sub(1).and_then(|i| self.ends.get(i)).copied().unwrap_or(0);
        let bytes = self.ends.get(index).and_then(|end| self.names.get(start..*end)).unwrap_or(&[]);
        Path::new(OsStr::from_bytes(bytes))
    }

    pub(crate) fn path(&self, index: usize) -> PathBuf {
        below(&self.base, self.name(index))
    }

    /// Every path, one at a time.
    pub(crate) fn for_each(&self, each: &mut dyn FnMut(&Path)) {
        (0..self.len()).for_each(|index| each(&self.path(index)));
    }

    /// Indices in natural order of the names.
    pub(crate) fn natural_order(&self) -> Vec<usize> {
        let mut order: Vec<usize> = (0..self.len()).collect();
        let meaning = self.meaning();
        crate::order::by(&mut order, |a, b| meaning.compare(self.bytes(*a), self.bytes(*b)));
        order
    }

    /// The meaning of signs and points in the names.
    pub(super) fn meaning(&self) -> Meaning {
        Meaning::of((0..self.len()).map(|index| self.bytes(index)))
    }

    /// Bytes of a name.
    pub(super) fn bytes(&self, index: usize) -> &[u8] {
        self.name(index).as_os_str().as_bytes()
    }

    /// The listed files only, in the listed order.
    pub(crate) fn select(&self, order: impl Iterator<Item = usize>) -> Self {
        let mut chosen = Self::new(&self.base);
        // A selection is not longer than the whole as a rule; grown by doubling it would take twice as much.
        chosen.names.reserve_exact(self.names.len());
        chosen.ends.reserve_exact(self.ends.len());
        order.for_each(|index| chosen.push(self.name(index)));
        chosen.names.shrink_to_fit();
        chosen.ends.shrink_to_fit();
        chosen
    }
}

/// A [`FileList`] whose first files stay open once read, as far as the descriptor limit allows: together
/// the volumes of a process keep a quarter of it.
///
/// Keeping the *first* ones open needs no lock and no eviction; every slice is read equally often, so
/// any choice of the same size saves as much. A file past the limit costs one open and close per read.
#[derive(Debug)]
pub(crate) struct FileSet {
    list: FileList,
    open: Box<[OnceLock<PositionalFile>]>,
}

impl FileSet {
    pub(crate) fn new(list: FileList) -> Self {
        let keep = list.len().min(Self::most());
        Self { list, open: (0..keep).map(|_| OnceLock::new()).collect() }
    }

    /// A quarter of the soft limit: scratch files and output need descriptors, too.
    fn most() -> usize {
        let limit = open_files_limit().map(|n| usize::try_from(n).unwrap_or(usize::MAX));
        limit.map_or(MAX_OPEN, |n| (n / 4).min(MAX_OPEN))
    }

    pub(crate) fn list(&self) -> &FileList {
        &self.list
    }

    /// Runs `read` on file `index`.
    pub(crate) fn with<R>(
        &self,
        index: usize,
        read: impl FnOnce(&PositionalFile) -> io::Result<R>,
    ) -> io::Result<R> {
        let Some(cell) = self.open.get(index) else {
            return read(&PositionalFile::open(&self.list.path(index))?);
        };
        if let Some(file) = cell.get() {
            return read(file);
        }
        let file = PositionalFile::open(&self.list.path(index))?;
        if !keep_one(Self::most()) {
            return read(&file);
        }
        // Two threads may open the same file at once; the second descriptor is closed again.
        match cell.set(file) {
            Ok(()) => {}
            Err(_second) => {
                KEPT.fetch_sub(1, Ordering::Relaxed);
            }
        }
        cell.get().map_or_else(|| Err(io::ErrorKind::NotFound.into()), read)
    }
}

impl Drop for FileSet {
    fn drop(&mut self) {
        let kept = self.open.iter().filter(|cell| cell.get().is_some()).count();
        KEPT.fetch_sub(kept, Ordering::Relaxed);
    }
}

/// Last part of a path as text, also for `.` and `..`.
pub(crate) fn base_name(path: &Path) -> String {
    let resolved = path.file_name().is_none().then(|| std::fs::canonicalize(path).ok()).flatten();
    let path = resolved.as_deref().unwrap_or(path);
    path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_come_back_and_select_reorders_them() {
        let mut list = FileList::new(Path::new("base"));
        for name in ["s10", "s9", "sub/s1"] {
            list.push(Path::new(name));
        }
        assert_eq!(list.len(), 3);
        assert_eq!(list.path(2), Path::new("base/sub/s1"));
        assert_eq!(list.name(3), Path::new(""));
        assert_eq!(list.natural_order(), [1, 0, 2]);
        let chosen = list.select([2, 0].into_iter());
        assert_eq!(
            (chosen.len(), chosen.name(0), chosen.name(1)),
            (2, Path::new("sub/s1"), Path::new("s10"))
        );
    }

    #[test]
    fn files_past_the_kept_ones_are_opened_per_read() {
        let folder = tempfile::tempdir().unwrap();
        let mut list = FileList::new(folder.path());
        for n in 0..3_u8 {
            std::fs::write(folder.path().join(format!("{n}")), [n]).unwrap();
            list.push(Path::new(&format!("{n}")));
        }
        let set = FileSet { list, open: Box::new([OnceLock::new()]) };
        for _ in 0..2 {
            for n in 0..3_u8 {
                let mut byte = [0];
                set.with(n.into(), |f| f.read_exact_at(&mut byte, 0)).unwrap();
                assert_eq!(byte, [n]);
            }
        }
        std::fs::remove_file(folder.path().join("2")).unwrap();
        assert!(set.with(0, |_| Ok(())).is_ok() && set.with(2, |_| Ok(())).is_err());
    }
}
