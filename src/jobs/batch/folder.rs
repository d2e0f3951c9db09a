//! The output folder, which is removed if it stays empty.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// Folders that were made for the results, the innermost first; the empty ones are removed when it is dropped.
#[derive(Debug)]
pub(in crate::jobs) struct NewFolders(Vec<PathBuf>);

impl NewFolders {
    /// Makes a folder and its missing parents.
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
