//! The identity of a file, for inputs that must not change while they are read.

use std::fs;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::Path;

use crate::platform::{changed, file_id};

/// Hash of a file's size, time of change and identity, which changes when the file is overwritten, truncated, extended
/// or replaced. A missing file has an identity of its own. Valid within one process only.
///
/// A write within one tick of the file system's clock that keeps the size is not detected.
pub(crate) fn file_identity(path: &Path) -> u64 {
    let mut hash = DefaultHasher::new();
    if let Ok(meta) = fs::metadata(path) {
        (meta.len(), changed(&meta), file_id(path).ok()).hash(&mut hash);
    }
    hash.finish()
}
