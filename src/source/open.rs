//! One entrance for every kind of input.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use super::dicom::DicomVolume;
use super::{RawOptions, RawVolume, SourceError, VolumeSource};

/// Formats by their first bytes, to say what a refused file is.
const KNOWN: [(usize, &[u8], &str); 11] = [
    (0, b"NRRD", "an NRRD file"),
    (0, b"\x1f\x8b", "a gzip file"),
    (344, b"n+1\0", "a NIfTI file"),
    (344, b"ni1\0", "a NIfTI header"),
    (0, b"\x89PNG", "a PNG image"),
    (0, b"II*\0", "a TIFF image"),
    (0, b"MM\0*", "a TIFF image"),
    (0, b"\xff\xd8\xff", "a JPEG image"),
    (0, b"\x93NUMPY", "a NumPy array"),
    (0, b"ply", "a PLY mesh"),
    (0, b"\x89OCT\r\n", "an .oct model, not a volume"),
];

/// Opens a volume: headerless if `raw` says what it is, otherwise by what the files contain.
///
/// # Errors
/// A [`SourceError`] that names the input and says what was found and what to add.
pub fn open(inputs: &[PathBuf], raw: Option<&RawOptions>) -> Result<Box<dyn VolumeSource>, SourceError> {
    if let Some(options) = raw {
        return Ok(Box::new(RawVolume::open(inputs, options)?));
    }
    if let [path] = inputs
        && let Some(what) = known(path)
    {
        let reason = format!(
            "is {what}; DICOM series are read, and headerless voxels with --dims NXxNYxNZ and --dtype"
        );
        return Err(SourceError::Unusable { path: path.clone(), reason });
    }
    Ok(Box::new(DicomVolume::open(inputs)?))
}

/// What a file is by its first bytes, if that is known and it is not DICOM.
fn known(path: &Path) -> Option<&'static str> {
    let mut head = Vec::new();
    if !path.is_file() {
        return None;
    }
    File::open(path).ok()?.take(352).read_to_end(&mut head).ok()?;
    if head.get(128..132) == Some(b"DICM") {
        return None;
    }
    let is = |(at, magic, _): &&(usize, &[u8], &str)| head.get(*at..).is_some_and(|h| h.starts_with(magic));
    KNOWN.iter().find(is).map(|(_, _, what)| *what)
}
