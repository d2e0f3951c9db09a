//! The identity of a file, for inputs that must not change while they are read.

use std::fs;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::Path;

use crate::platform::{changed, file_id};

/// Changes when a file is overwritten, cut, grown or replaced: a hash of its size, its time of change, and which file it
/// is. A missing file has an identity of its own. Known within one process only.
///
/// A write within one tick of the file system's clock that keeps the size is not seen.
pub(crate) fn file_identity(path: &Path) -> u64 {
    let mut hash = DefaultHasher::new();
    if let Ok(meta) = fs::metadata(path) {
        (meta.len(), changed(&meta), file_id(path).ok()).hash(&mut hash);
    }
    hash.finish()
}
