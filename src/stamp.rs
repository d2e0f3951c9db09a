//! What tells that a file is not any more what it was: for inputs that must not change while they are read.

use std::fs;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::Path;

use crate::platform::{changed, file_id};

/// What tells that a file was overwritten, cut, grown or replaced: its size, its time of change, and which file it
/// is. A file that is not there has a stamp of its own. Known within one process only.
///
/// What was written within one tick of the file system's clock, and left the size as it was, is not seen.
pub(crate) fn stamp(path: &Path) -> u64 {
    let mut hash = DefaultHasher::new();
    if let Ok(meta) = fs::metadata(path) {
        (meta.len(), changed(&meta), file_id(&meta)).hash(&mut hash);
    }
    hash.finish()
}
