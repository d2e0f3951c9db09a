//! One entrance for every kind of input.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use super::dicom::{DicomVolume, ScanError, scan};
use super::{OpenOptions, RawVolume, SourceError, VolumeSource};

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

/// Opens a volume: headerless if the options say what it is, otherwise by what the files contain.
///
/// # Errors
/// A [`SourceError`] that names the input and says what was found and what to add.
pub fn open(inputs: &[PathBuf], options: &OpenOptions) -> Result<Box<dyn VolumeSource>, SourceError> {
    if let Some(raw) = &options.raw {
        return Ok(Box::new(RawVolume::open(inputs, raw)?));
    }
    if let [path] = inputs
        && let Some(error) = refuse_foreign(path)
    {
        return Err(error);
    }
    Ok(Box::new(DicomVolume::open(inputs)?))
}

/// The refusal of a single file that is no DICOM; `None` for everything that is left to be judged by
/// its reader, missing files included.
fn refuse_foreign(path: &Path) -> Option<SourceError> {
    let unusable = |reason| Some(SourceError::Unusable { path: path.to_path_buf(), reason });
    if let Some(what) = known(path) {
        return unusable(format!(
            "is {what}; DICOM series are read, and headerless voxels with --dims NXxNYxNZ and --dtype"
        ));
    }
    let file = path.is_file().then(|| File::open(path).ok()).flatten()?;
    if !matches!(scan(&file), Err(ScanError::NotDicom)) {
        return None;
    }
    if file.metadata().is_ok_and(|meta| meta.len() == 0) {
        return unusable("is empty; give a DICOM series or headerless voxels".into());
    }
    // A name that promises DICOM makes the file wrong; any other may be raw voxels that lack options.
    let promises = |e: &str| path.extension().is_some_and(|x| x.eq_ignore_ascii_case(e));
    if ["dcm", "dicom", "ima"].iter().any(|e| promises(e)) {
        return unusable(
            "is not DICOM, in spite of its name; for headerless voxels add --dims and --dtype".into(),
        );
    }
    let reason = "is not DICOM; for headerless voxels add --dims NXxNYxNZ and --dtype".into();
    Some(SourceError::Usage { path: path.to_path_buf(), reason })
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::ExitKind;

    #[test]
    fn files_that_are_no_volume_are_named_for_what_they_are() {
        let folder = tempfile::tempdir().unwrap();
        let refusal = |name: &str, bytes: &[u8]| {
            let path = folder.path().join(name);
            std::fs::write(&path, bytes).unwrap();
            let error = open(&[path], &OpenOptions::default()).err().unwrap();
            (error.kind(), error.to_string())
        };
        for (name, bytes, kind, words) in [
            ("a.raw", &[7; 100][..], ExitKind::Usage, "add --dims"),
            ("a.dcm", &[7; 100], ExitKind::Input, "in spite of its name"),
            ("b.raw", &[], ExitKind::Input, "is empty"),
            ("a.nrrd", b"NRRD0004\n", ExitKind::Input, "an NRRD file"),
            ("a.oct", b"\x89OCT\r\n\x1a\n", ExitKind::Input, "an .oct model"),
        ] {
            let (got, text) = refusal(name, bytes);
            assert!(got == kind && text.contains(words), "{name}: {text}");
        }
        let missing = open(&[folder.path().join("nothing")], &OpenOptions::default()).err().unwrap();
        assert!(missing.to_string().contains("check that it exists"), "{missing}");
        let empty = folder.path().join("empty");
        std::fs::create_dir(&empty).unwrap();
        assert!(open(&[empty], &OpenOptions::default()).err().unwrap().to_string().contains("holds no file"));
        assert_eq!(open(&[], &OpenOptions::default()).err().unwrap().kind(), ExitKind::Usage);
    }
}
