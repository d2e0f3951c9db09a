//! Key that hides times of change in records: a random number for each output folder, which never leaves it.
//!
//! A record has to tell whether the input was changed, by its size, its time of change and the names of its files.
//! A plain hash of these could be found again by trying times and names. With a number in it that does not
//! travel, it cannot; where the number is lost, everything is built once more.

use std::fs::{self, File};
use std::hash::{BuildHasher, Hasher};
use std::io::{self, Read, Write};
use std::path::Path;

use super::{BatchRequest, fnv};
use crate::atomic::AtomicFile;
use crate::source::{OpenOptions, StableHash};

/// Name of the file; hidden, as the lock is.
const NAME: &str = ".oct-key";

/// The random number of an output folder.
pub(super) struct Key([u64; 2]);

impl Key {
    /// The key of a folder, made if there is none yet.
    ///
    /// # Errors
    /// The folder cannot be written.
    pub(super) fn of(folder: &Path) -> io::Result<Self> {
        let path = folder.join(NAME);
        if fs::symlink_metadata(&path).is_ok_and(|meta| meta.is_file()) {
            let mut text = String::new();
            File::open(&path)?.take(64).read_to_string(&mut text)?;
            let number = |at: usize| u64::from_str_radix(text.get(at..at + 16)?, 16).ok();
            if let (Some(a), Some(b)) = (number(0), number(16)) {
                return Ok(Self([a, b]));
            }
        }
        // Keys of hash tables are random numbers of the system.
        let random = || std::hash::RandomState::new().build_hasher().finish();
        let key = [random(), random()];
        let file = AtomicFile::create(&path)?;
        writeln!(file.file(), "{:016x}{:016x}", key[0], key[1])?;
        file.commit()?;
        Ok(Self(key))
    }

    /// Fingerprint of input files for a record, in hexadecimal.
    pub(super) fn hidden(&self, fingerprint: u64) -> String {
        let keyed = |hash: StableHash, key: &u64| hash.number(*key).number(fingerprint);
        format!("{:016x}", self.0.iter().fold(StableHash::new(), keyed).finish())
    }
}

/// One number for everything in the request that the bytes of results depend on.
pub(super) fn options_fingerprint(request: &BatchRequest) -> String {
    let b = &request.build;
    // The selection of volumes changes none of them.
    let how = OpenOptions { all_volumes: false, follow_links: false, ..request.how.clone() };
    let text = format!(
        "{:?} {} {:?} {:?} {:?} {:?} {:?} {} {} {how:?} {:?} {:?}",
        b.threshold,
        request.find_labels,
        b.surface,
        b.error,
        b.connectivity,
        b.channels,
        b.gradient,
        b.lod,
        request.thumbnails,
        request.clean,
        request.grid.stated()
    );
    format!("{:016x}", fnv(text.as_bytes()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_keeps_its_key_and_no_two_have_the_same() {
        let folders = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
        let hidden = |at: usize| Key::of(folders[at].path()).unwrap().hidden(7);
        assert_eq!(hidden(0), hidden(0));
        assert_ne!(hidden(0), hidden(1));
        let key = Key::of(folders[0].path()).unwrap();
        assert_ne!(key.hidden(7), key.hidden(8));
        // A damaged key is replaced.
        let before = hidden(0);
        fs::write(folders[0].path().join(NAME), "x").unwrap();
        assert_ne!(hidden(0), before);
    }
}
