//! The output folder, which is left behind only if something is in it.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// The folders that were made for the results, the innermost first; those that are empty go when it is dropped.
#[derive(Debug)]
pub(in crate::jobs) struct NewFolders(Vec<PathBuf>);

impl NewFolders {
    /// Makes a folder, and those around it, as far as they are not there.
    pub(in crate::jobs) fn create(folder: &Path) -> io::Result<Self> {
        let is_missing = |path: &&Path| !path.as_os_str().is_empty() && !path.exists();
        let missing = folder.ancestors().take_while(is_missing).map(Path::to_path_buf).collect();
        fs::create_dir_all(folder)?;
        Ok(Self(missing))
    }
}

impl Drop for NewFolders {
    fn drop(&mut self) {
        // A folder that holds something stays.
        self.0.iter().for_each(|folder| drop(fs::remove_dir(folder)));
    }
}
