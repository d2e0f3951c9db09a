//! Nameless files for what does not fit into memory: gone with their last descriptor, even when the
//! process is killed.

use std::fs::File;
use std::io;
use std::path::Path;

/// A new nameless file in `folder`, open for reading and writing.
///
/// # Errors
/// The folder is missing, read-only or full.
pub fn nameless(folder: &Path) -> io::Result<File> {
    tempfile::tempfile_in(folder)
}

/// A new nameless file that will hold about `bytes`; refused at once where the file system of `folder`
/// has less to give.
///
/// # Errors
/// As [`nameless`], and [`io::ErrorKind::StorageFull`] with both figures.
pub fn nameless_for(folder: &Path, bytes: u64) -> io::Result<File> {
    let file = nameless(folder)?;
    if let Ok(system) = rustix::fs::fstatvfs(&file) {
        let free = system.f_bavail.saturating_mul(system.f_frsize);
        if free < bytes {
            let text = format!(
                "{} are needed, and {} are free",
                crate::budget::Bytes(bytes),
                crate::budget::Bytes(free)
            );
            return Err(io::Error::new(io::ErrorKind::StorageFull, text));
        }
    }
    Ok(file)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn more_than_the_disk_has_is_refused_at_once() {
        let folder = tempfile::tempdir().unwrap();
        assert!(nameless_for(folder.path(), 1).is_ok());
        let refused = nameless_for(folder.path(), u64::MAX).unwrap_err();
        assert!(refused.kind() == io::ErrorKind::StorageFull && refused.to_string().contains("are free"));
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
