//! One entrance for every kind of input.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use super::dicom::{DicomVolume, ScanError, scan};
use super::files::FileList;
use super::formats::{FORMATS, HEAD_BYTES, STACKS};
use super::raw::list_folder;
use super::{OpenOptions, RawVolume, SourceError, VolumeSource, nifti};

/// Formats by their first bytes that are not read, to say what a refused file is.
const KNOWN: [(usize, &[u8], &str); 4] = [
    (0, b"\x1f\x8b", "a gzip file, but of no volume that is read"),
    (0, b"\xff\xd8\xff", "a JPEG image"),
    (0, b"ply", "a PLY mesh"),
    (0, b"\x89OCT\r\n", "an .oct model, not a volume"),
];

/// Files of a folder, in natural order, of which one has to be a picture for a stack to be looked for.
const SAMPLED: usize = 8;

/// Opens a volume: headerless if the options say what it is, otherwise by what the files contain.
///
/// A file that holds several volumes gives its first. The pictures of a folder, or those given, are a stack
/// if they are more than half of the files.
///
/// # Errors
/// A [`SourceError`] that names the input and says what was found and what to add.
pub fn open(inputs: &[PathBuf], options: &OpenOptions) -> Result<Box<dyn VolumeSource>, SourceError> {
    if let Some(raw) = &options.raw {
        return Ok(Box::new(RawVolume::open(inputs, raw)?));
    }
    if let Some(opened) = by_format(inputs, options) {
        let opened = opened?;
        let path = inputs.first().cloned().unwrap_or_default();
        if opened.len() > 1 && (inputs.len() > 1 || path.is_dir()) {
            let reason = format!("the files hold {} volumes; give one of them", opened.len());
            return Err(SourceError::NoVolume { path, reason });
        }
        let first = opened.into_iter().next();
        return first.ok_or(SourceError::NoVolume { path, reason: "the file holds no volume".into() });
    }
    if let [path] = inputs
        && let Some(error) = refuse_foreign(path)
    {
        return Err(error);
    }
    Ok(Box::new(DicomVolume::open(inputs)?))
}

/// The volumes of files in a format of the registry; `None` for everything else.
fn by_format(
    inputs: &[PathBuf],
    options: &OpenOptions,
) -> Option<Result<Vec<Box<dyn VolumeSource>>, SourceError>> {
    if let [path] = inputs
        && !path.is_dir()
    {
        let pair = nifti::header_of_samples(path).filter(|header| nifti::recognise(&head_of(header), header));
        let path = pair.as_ref().unwrap_or(path);
        let head = head_of(path);
        if head.get(128..132) == Some(b"DICM") {
            return None;
        }
        if let Some(format) = FORMATS.iter().find(|f| (f.recognise)(&head, path)) {
            return Some((format.open)(path, options));
        }
    }
    let list = match inputs {
        [folder] if folder.is_dir() => list_folder(folder).ok()?,
        files => {
            let mut list = FileList::new(Path::new(""));
            files.iter().filter(|f| f.is_file()).for_each(|f| list.push(f));
            list
        }
    };
    let kind_of = |index: usize| {
        let path = list.path(index);
        let head = head_of(&path);
        STACKS.iter().position(|s| (s.recognise)(&head, &path))
    };
    // A few files tell whether the others are worth a look, so that a DICOM folder is not opened twice.
    (0..list.len().min(SAMPLED)).find_map(kind_of)?;
    let kinds: Vec<Option<usize>> = (0..list.len()).map(kind_of).collect();
    let counted = |kind: usize| kinds.iter().filter(|k| **k == Some(kind)).count();
    let best = (0..STACKS.len()).max_by_key(|kind| counted(*kind))?;
    let format = STACKS.get(best).filter(|_| 2 * counted(best) > kinds.len())?;
    let chosen = (0..list.len()).filter(|i| kinds.get(*i) == Some(&Some(best)));
    Some((format.open)(list.select(chosen), options))
}

/// First bytes of a regular file; none of anything else.
fn head_of(path: &Path) -> Vec<u8> {
    let mut head = Vec::new();
    if path.is_file()
        && let Ok(file) = File::open(path)
    {
        // What could be read before a failure is judged; the reader that follows meets the failure itself.
        let _ = file.take(HEAD_BYTES as u64).read_to_end(&mut head);
    }
    head
}

/// The refusal of a single file that is no DICOM; `None` for everything that is left to be judged by
/// its reader, missing files included.
fn refuse_foreign(path: &Path) -> Option<SourceError> {
    let unusable = |reason| Some(SourceError::Unusable { path: path.to_path_buf(), reason });
    if let Some(what) = known(path) {
        return unusable(format!(
            "is {what}; DICOM, NRRD, NIfTI, MetaImage, .npy, TIFF and PNG are read, and headerless voxels with --dims NXxNYxNZ and --dtype"
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
    let head = head_of(path);
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
            ("a.nrrd", b"NRRD0004\n", ExitKind::Input, "no sample type"),
            ("a.gz", b"\x1f\x8b\x08", ExitKind::Input, "a gzip file"),
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
