//! Where the real data is, for tests that can do without it.

use std::path::{Path, PathBuf};

/// Path of an item of the real data, or `None` with a note that the test is skipped.
pub(crate) fn real_data(item: &str) -> Option<PathBuf> {
    let root = std::env::var_os("INFOBYTE_DATA")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data"), PathBuf::from);
    let path = root.join(item);
    if !path.exists() {
        println!("skipped: {item} is not there (set INFOBYTE_DATA)");
        return None;
    }
    Some(path)
}
