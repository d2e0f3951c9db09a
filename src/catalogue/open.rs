//! One entrance for every kind of input.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use super::sidecar;
use super::{Catalogue, Finding, OpenOptions};
use crate::facts::dicom::{DicomFault, ImageFault};
use crate::facts::{Note, StatedBy};
use crate::source::dicom::{Recognised, recognise};
use crate::source::{HEAD_BYTES, known};
use crate::source::{RawVolume, header_of_samples};
use crate::volume::Noted;
use crate::volume::place;
use crate::volume::{SourceError, VolumeSource};

/// How deep folders are searched below the one given.
const DEPTH: u32 = 5;

/// Files or volumes named in one warning.
const NAMED: usize = 3;

/// Opens a volume: headerless if the options say what it is, otherwise by what the files contain.
///
/// As [`open_in`], with the system's folder for temporary files.
///
/// # Errors
/// As [`open_in`].
pub fn open(inputs: &[PathBuf], options: &OpenOptions) -> Result<Box<dyn VolumeSource>, SourceError> {
    open_in(inputs, options, &std::env::temp_dir())
}

/// Opens a volume: headerless if the options say what it is, otherwise by what the files contain.
///
/// Folders are searched five levels deep. Of several volumes the largest is taken, unless
/// [`OpenOptions::volume`] chooses one; the others are listed in a warning. A single slice is a volume,
/// but only if nothing has several. More names of files than fit into some 64 KiB wait in a nameless
/// file in `scratch`. A single file or folder that is nothing by itself may be described by a side-car
/// beside it.
///
/// # Errors
/// A [`SourceError`] that names the input and says what was found and what to add: nothing that is a
/// volume, or only what must be refused; of the volume that is chosen, why it cannot be used.
pub fn open_in(
    inputs: &[PathBuf],
    options: &OpenOptions,
    scratch: &Path,
) -> Result<Box<dyn VolumeSource>, SourceError> {
    if let Some(raw) = &options.raw {
        return Ok(Box::new(RawVolume::open(inputs, raw)?));
    }
    let Some(first) = inputs.first() else {
        return Err(SourceError::Usage { path: PathBuf::new(), reason: "no input file is given".into() });
    };
    // The samples of a pair do not say what they are; their header does.
    let header = match inputs {
        [path] => header_of_samples(path),
        _ => None,
    };
    let inputs = header.as_ref().map_or(inputs, std::slice::from_ref);
    let found = Catalogue::survey_to_depth(inputs, options, scratch, DEPTH)?;
    if found.is_empty() {
        // Nothing by itself, but described beside it.
        if let [data] = inputs
            && (data.is_dir() || found.left_out().is_empty())
            && let Some(description) = sidecar::of(data)
        {
            let volume = sidecar::open(&description, options.placement)?;
            let volume = place(volume, options.placement, StatedBy::Caller)?;
            return match options.volume {
                None | Some(1) => Ok(volume),
                Some(wanted) => Err(SourceError::Usage {
                    path: data.clone(),
                    reason: format!("there is no volume {wanted}: it is a single one"),
                }),
            };
        }
        return Err(nothing(inputs, &found, first));
    }
    let mut choice = Choice { wanted: options.volume, ..Choice::default() };
    for item in 0..found.len() {
        for finding in found.open(item) {
            choice.consider(finding);
        }
    }
    choice.decide(first, &found)
}

/// How good a volume is as the one that is meant: refused, a single slice, several slices; then its size.
type Rank = (u8, u64);

/// The best of the volumes that were seen.
#[derive(Default)]
struct Choice {
    wanted: Option<usize>,
    seen: usize,
    best: Option<(Rank, usize, Finding)>,
    /// The largest refused one, with more than one slice?
    refused: Option<(u64, bool, Finding)>,
    /// What was seen, the largest first, as many as are named.
    names: Vec<(Rank, usize, String)>,
    unusable: Vec<String>,
}

impl Choice {
    fn consider(&mut self, finding: Finding) {
        self.seen += 1;
        let number = self.seen;
        let size = finding.size.unwrap_or_default();
        let voxels = size.iter().map(|n| u64::from(*n)).product();
        // A slice that is cut short is no reason to take another volume in silence.
        let damage = finding.volume.as_ref().err().filter(|error| error.is_damage());
        let broken = damage.is_some() && finding.size.is_some();
        let usable = finding.volume.is_ok() || broken;
        let tier = if usable { 1 + u8::from(size[2] > 1) } else { 0 };
        let rank = (tier, voxels);
        let name = (rank, number, describe(&finding));
        let at = self.names.iter().position(|(r, ..)| *r < rank).unwrap_or(self.names.len());
        self.names.insert(at, name);
        // One more than is named, for the one that is taken.
        self.names.truncate(NAMED + 1);
        if let Err(SourceError::Unusable { path, .. } | SourceError::Dicom { path, .. }) = &finding.volume
            && let Some(error) = damage
        {
            let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
            if self.unusable.len() <= NAMED {
                self.unusable.push(format!("{name}, of a series that is not used: {}", reason_of(error)));
            }
        }
        if self.wanted.is_some_and(|wanted| wanted != number) {
            return;
        }
        if usable || self.wanted.is_some() {
            if self.best.as_ref().is_none_or(|(best, ..)| rank > *best) {
                self.best = Some((rank, number, finding));
            }
        } else if self.refused.as_ref().is_none_or(|(most, ..)| voxels > *most) {
            self.refused = Some((voxels, size[2] > 1, finding));
        }
    }

    fn decide(self, first: &Path, found: &Catalogue) -> Result<Box<dyn VolumeSource>, SourceError> {
        let Self { wanted, seen, best, refused, names, unusable } = self;
        let chosen = match (best, refused) {
            // A scout beside a series that is refused is not mistaken for the volume.
            (Some(((1, _), ..)), Some((_, true, refused))) if wanted.is_none() => return refused.volume,
            (Some((_, number, finding)), _) => (number, finding),
            (None, Some((.., refused))) => return refused.volume,
            (None, None) => {
                let reason = match wanted {
                    Some(wanted) => format!(
                        "there is no volume {wanted} among the {seen} that were found; oct scan lists them"
                    ),
                    None => "no volume was found".into(),
                };
                return Err(SourceError::Usage { path: first.to_path_buf(), reason });
            }
        };
        let (number, finding) = chosen;
        let mut warnings = Vec::new();
        if seen > 1 {
            let own = names.iter().find(|n| n.1 == number).map(|n| n.2.clone());
            let own = own.unwrap_or_else(|| describe(&finding));
            let others: Vec<String> =
                names.iter().filter(|n| n.1 != number).take(NAMED).map(|n| n.2.clone()).collect();
            let more = seen - 1 - others.len();
            let more = if more > 0 { format!("; and {more} more") } else { String::new() };
            let why = if wanted.is_some() { "the chosen one" } else { "the largest that forms a volume" };
            warnings.push(format!(
                "{seen} sets of images were found; {why} is used ({own}); not used: {}{more}",
                others.join("; ")
            ));
        }
        let source = finding.volume?;
        warnings.extend(unusable.into_iter().take(NAMED));
        for left in found.left_out().iter().take(NAMED) {
            let name = left.first.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
            warnings.push(format!("{} file(s) left out: {} (first: {name})", left.count, left.reason));
        }
        if found.left_out().len() > NAMED {
            let rest: u64 = found.left_out().iter().skip(NAMED).map(|l| l.count).sum();
            warnings.push(format!("{rest} more file(s) left out for other reasons"));
        }
        if warnings.is_empty() {
            return Ok(source);
        }
        let mut info = source.info().clone();
        let mut notes: Vec<Note> = warnings.into_iter().map(Note::Text).collect();
        notes.append(&mut info.notes);
        info.notes = notes;
        Ok(Box::new(Noted { source, info }))
    }
}

/// What a volume is, in a few words.
fn describe(finding: &Finding) -> String {
    let part = finding.part.as_ref().map_or_else(String::new, |part| format!(" {part}"));
    let size = finding.size.map_or_else(String::new, |[x, y, z]| format!(" {x}x{y}x{z}"));
    let fate = match &finding.volume {
        Ok(_) => String::new(),
        Err(error) => format!(", refused: {}", reason_of(error)),
    };
    format!("{}{part}{size}{fate}", finding.kind)
}

/// The sentence of a refusal without its path.
fn reason_of(error: &SourceError) -> String {
    match error {
        SourceError::NoVolume { reason, .. }
        | SourceError::Unusable { reason, .. }
        | SourceError::Usage { reason, .. } => reason.clone(),
        SourceError::Dicom { fault, .. } => fault.to_string(),
        other => other.to_string(),
    }
}

/// The refusal of inputs among which there is nothing like a volume.
fn nothing(inputs: &[PathBuf], found: &Catalogue, first: &Path) -> SourceError {
    if let [path] = inputs
        && path.is_file()
    {
        return refuse_file(path);
    }
    let files: u64 = found.left_out().iter().map(|l| l.count).sum();
    let reason = match found.left_out() {
        [] => "the folder holds no file".into(),
        [only] if only.reason != "not a volume" => {
            format!("no volume is among the {files} file(s), but: {}", only.reason)
        }
        _ => format!(
            "no volume is among the {files} file(s); for headerless voxels add --dims NXxNYxNZ and --dtype"
        ),
    };
    SourceError::NoVolume { path: first.to_path_buf(), reason }
}

/// The refusal of a single file that is no volume.
fn refuse_file(path: &Path) -> SourceError {
    let unusable = |reason| SourceError::Unusable { path: path.to_path_buf(), reason };
    let opened = File::open(path).and_then(|file| Ok((file.metadata()?.len(), file)));
    let (length, file) = match opened {
        Ok(opened) => opened,
        Err(cause) => return SourceError::Unreadable { path: path.to_path_buf(), cause },
    };
    if length == 0 {
        return unusable("is empty; give a DICOM series or headerless voxels".into());
    }
    if let Recognised::NoImage(obstacle) = recognise(&file) {
        let fault = DicomFault::Image(ImageFault::Pixels(obstacle));
        return SourceError::Dicom { path: path.to_path_buf(), fault };
    }
    if let Some(what) = known(&head_of(&file)) {
        return unusable(format!(
            "is {what}; DICOM, NRRD, NIfTI, MetaImage, .npy, TIFF and PNG are read, and headerless voxels with --dims NXxNYxNZ and --dtype"
        ));
    }
    // A name that promises DICOM makes the file wrong; any other may be raw voxels that lack options.
    let promises = |e: &str| path.extension().is_some_and(|x| x.eq_ignore_ascii_case(e));
    if ["dcm", "dicom", "ima"].iter().any(|e| promises(e)) {
        return unusable(
            "is not DICOM, in spite of its name; for headerless voxels add --dims and --dtype".into(),
        );
    }
    if ["stl", "obj", "off", "ply", "gltf", "glb"].iter().any(|e| promises(e)) {
        return unusable("is a mesh by its name; only volumes are read so far".into());
    }
    let reason = "is of no kind that is known; for headerless voxels add --dims NXxNYxNZ and --dtype, or put a side-car with dims and dtype beside it, as NAME.json".into();
    SourceError::Usage { path: path.to_path_buf(), reason }
}

/// The first bytes of a file.
fn head_of(file: &File) -> Vec<u8> {
    let mut head = Vec::new();
    // What cannot be read is not known.
    let _ = file.take(HEAD_BYTES as u64).read_to_end(&mut head);
    head
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::ExitKind;

    #[test]
    fn the_side_car_beside_a_single_file_is_used() {
        let folder = tempfile::tempdir().unwrap();
        let data = folder.path().join("a.raw");
        std::fs::write(&data, [1; 8]).unwrap();
        let opened = || open(std::slice::from_ref(&data), &OpenOptions::default());
        let text = opened().err().unwrap().to_string();
        assert!(text.contains("add --dims") && text.contains("side-car"), "{text}");
        let describe = |text: &str| std::fs::write(folder.path().join("a.json"), text).unwrap();
        describe(r#"{"dims": [1, 2, 4], "dtype": "u8", "spacing_mm": [1, 2, 3]}"#);
        let volume = opened().unwrap();
        assert_eq!((volume.info().dims.to_array(), volume.info().spacing_mm), ([1, 2, 4], [1.0, 2.0, 3.0]));
        // One that is wrong is what the user has to hear of.
        describe(r#"{"dims": [1, 2, 4], "dtype": "u7"}"#);
        let text = opened().err().unwrap().to_string();
        assert!(text.contains("a.json") && text.contains("dtype"), "{text}");
        // It describes something else.
        describe(r#"{"dims": [1, 2, 4], "dtype": "u8", "file": "b.raw"}"#);
        assert!(opened().err().unwrap().to_string().contains("add --dims"));
    }

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
