//! Opening of inputs of every kind.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::path::{Path, PathBuf};

use super::kind::{ends_in, open_with_head};
use super::{Catalogue, Finding, NotVolume, OpenOptions, sidecar};
use crate::budget::Budget;
use crate::fault::{Fault, FaultKind, bad, unfit, usage};
use crate::mesh;
use crate::progress::Silent;
use crate::source::dicom::{Recognition, SEGMENTATION, recognise};
use crate::source::{RawVolume, Subject, SubjectKind, header_of_samples, known, known_folder};
use crate::synthetic;
use crate::text::names::{DIMS, DTYPE, GRID, ISO, KEEP_NAMES, RANGE, SCAN, VOLUME, VOXEL};
use crate::text::{Count, shown};
use crate::volume::{
    FileWatch, ImageKind, InfoOverride, MAX_MASKS, MaskPart, Masks, Note, Overlap, Result, SourceError,
    StatedBy, StatedLabel, VolumeSource, Workspace, place,
};

/// Depth to which folders are searched below the given one.
const DEPTH: u32 = 5;

/// Files or volumes named in one note.
const NAMED: usize = 3;

/// Memory that unrolling a packed input may take in [`open`].
const UNROLLING_BYTES: u64 = 64 << 20;

/// Opens a volume, ready to be read: headerless if the options state its layout, otherwise by the content of the files.
///
/// Packed inputs (gzip, compressed images) are unrolled into an anonymous file in the system's folder for temporary
/// files, as large as the volume, within 64 MiB of memory. Of several volumes the largest is taken, unless
/// [`OpenOptions::volume`] chooses one.
///
/// # Errors
/// A [`SourceError`] that names the input, its content and the option to add.
pub fn open(inputs: &[PathBuf], options: &OpenOptions) -> Result<Box<dyn VolumeSource>> {
    let scratch = std::env::temp_dir();
    let mut volume = open_unprepared_in(inputs, options, &scratch)?;
    let memory = Budget::new(UNROLLING_BYTES);
    volume.prepare(&Workspace { scratch: &scratch, memory, progress: &Silent })?;
    Ok(volume)
}

/// Like `open_unprepared_in`, with the system's folder for temporary files.
///
/// # Errors
/// The errors of `open_unprepared_in`.
pub fn open_unprepared(inputs: &[PathBuf], options: &OpenOptions) -> Result<Box<dyn VolumeSource>> {
    open_unprepared_in(inputs, options, &std::env::temp_dir())
}

/// Opens a volume whose rows cannot be read before [`VolumeSource::prepare`] has been called: for callers who plan
/// memory and scratch space themselves.
///
/// Folders are searched five levels deep. Of several volumes the largest is taken, unless [`OpenOptions::volume`]
/// chooses one; the others are listed in a note. A single slice is a volume only if no input has several. Names of
/// files beyond some 64 KiB wait in an anonymous file in `scratch`. A single file or folder that is nothing by itself
/// may be described by a side-car next to it.
///
/// # Errors
/// A [`SourceError`] that names the input, its content and the option to add: nothing is a volume, or all that are must
/// be refused, or the chosen volume cannot be used, with the reason.
pub(crate) fn open_unprepared_in(
    inputs: &[PathBuf],
    options: &OpenOptions,
    scratch: &Path,
) -> Result<Box<dyn VolumeSource>> {
    let mut volume = found(inputs, options, scratch)?;
    if let Some(overlap) = options.masks {
        volume = with_names(volume, overlap, options.keep_names)?;
    }
    if !options.index.is_empty() && volume.info().description.format != "zarr" {
        let path = inputs.first().cloned().unwrap_or_default();
        return Err(crate::source::unchosen(&[]).at(path).into());
    }
    Ok(volume)
}

/// The volume to open among the volumes of the inputs.
fn found(inputs: &[PathBuf], options: &OpenOptions, scratch: &Path) -> Result<Box<dyn VolumeSource>> {
    if let Some(raw) = &options.raw {
        if let Some(described) = inputs.iter().find(|input| synthetic::is_synthetic(input)) {
            return Err(synthetic::described().at(described).into());
        }
        only_one(options, inputs.first().map_or(Path::new(""), PathBuf::as_path))?;
        return Ok(FileWatch::files(Box::new(RawVolume::open(inputs, raw)?), None));
    }
    let Some(first) = inputs.first() else {
        return Err(usage!("no input file is given").into());
    };
    // A file that was given by name is never left out silently.
    let is_empty =
        |path: &&PathBuf| std::fs::metadata(path).is_ok_and(|meta| meta.is_file() && meta.len() == 0);
    if let Some(path) = inputs.iter().find(is_empty) {
        return Err(bad!("is empty; give a DICOM series or headerless voxels").at(path).into());
    }
    // The samples of a pair do not state their layout; their header does.
    let header = match inputs {
        [path] => header_of_samples(path),
        _ => None,
    };
    let inputs = header.as_ref().map_or(inputs, std::slice::from_ref);
    // Meshes and trees are not volumes.
    let options = &OpenOptions { meshes: false, ..options.clone() };
    let found = Catalogue::survey_to_depth(inputs, options, scratch, DEPTH)?;
    if found.is_empty() {
        // The input may be described by a side-car only.
        if let [data] = inputs
            && (data.is_dir() || found.left_out().is_empty())
            && let Some(description) = sidecar::of(data)
        {
            let volume =
                FileWatch::files(sidecar::open(&description, Some(data), options)?, Some(&description));
            let volume = place(volume, options.placement, StatedBy::Caller)?;
            only_one(options, data)?;
            return Ok(volume);
        }
        return Err(nothing(inputs, &found, first));
    }
    if let (Some(overlap), None) = (options.masks, options.volume)
        && let Some(masks) = masks(&found, overlap)?
    {
        return Ok(masks);
    }
    let mut choice = Chooser { wanted: options.volume, ..Chooser::default() };
    for item in 0..found.len() {
        for finding in found.open_unnamed(item) {
            choice.consider(finding);
        }
    }
    choice.decide(first, &found)
}

/// Refuses a choice of another volume than the only one of an input.
fn only_one(options: &OpenOptions, input: &Path) -> Result {
    match options.volume {
        None | Some(1) => Ok(()),
        Some(wanted) => Err(usage!("there is no volume {wanted}: the input has only one").at(input).into()),
    }
}

/// Several volumes as the masks of one map; `None` where there is one volume.
fn masks(found: &Catalogue, overlap: Overlap) -> Result<Option<Box<dyn VolumeSource>>> {
    let findings: Vec<Finding> = (0..found.len()).flat_map(|item| found.open_unnamed(item)).collect();
    let count = findings.len();
    if count < 2 {
        return Ok(None);
    }
    if count > MAX_MASKS {
        let path = findings[0].path.clone();
        let misuse = usage!("{count} masks are more than the {MAX_MASKS} that one map can be made of");
        return Err(misuse.at(path).into());
    }
    joined(findings, overlap).map(Some)
}

/// The map of masks, or of the segments of one file. Each has the label that its file states for it, unless two have
/// the same number, and otherwise the name of its part or file.
fn joined(findings: Vec<Finding>, overlap: Overlap) -> Result<Box<dyn VolumeSource>> {
    let segments = findings.iter().all(|finding| finding.path == findings[0].path);
    let mut parts: Vec<MaskPart> = Vec::new();
    for (number, finding) in (1..).zip(findings) {
        let Some(source) = finding.subject?.into_volume() else { continue };
        let mut label = match source.info().description.labels.as_slice() {
            [stated] => stated.clone(),
            _ => StatedLabel { number, ..StatedLabel::default() },
        };
        if label.name.is_empty() {
            label.name = finding.part.unwrap_or_else(|| stem(&finding.path));
        }
        parts.push(MaskPart { source, label });
    }
    let numbers: BTreeSet<u16> = parts.iter().map(|part| part.label.number).collect();
    if numbers.len() < parts.len() {
        (1..).zip(&mut parts).for_each(|(number, part)| part.label.number = number);
    }
    Ok(Box::new(Masks::of(parts, overlap, segments)?))
}

/// The segments of one segmentation as one map of its labels, under the name of the whole; other volumes unchanged.
pub(super) fn join_segments(findings: Vec<Finding>, overlap: Overlap) -> Vec<Finding> {
    let is_segment = |finding: &Finding| {
        let volume = finding.subject.as_ref().ok().and_then(Subject::volume);
        finding.kind == SEGMENTATION
            && finding.path == findings[0].path
            && volume.is_some_and(|volume| volume.info().description.labels.len() == 1)
    };
    if !(2..=MAX_MASKS).contains(&findings.len()) || !findings.iter().all(is_segment) {
        return findings;
    }
    let Finding { path, id, format, kind, files, burned_in, body_part, .. } = &findings[0];
    let id = match id.rsplit_once('-') {
        Some((whole, part)) if part.starts_with("segment") => whole.to_owned(),
        _ => id.clone(),
    };
    let (path, kind, body_part, more) = (path.clone(), kind.clone(), body_part.clone(), findings.len() - 1);
    let (format, files, burned_in) = (*format, *files, *burned_in);
    let map = joined(findings, overlap).map(Subject::Volume);
    vec![Finding { kind, body_part, burned_in, more, ..Finding::new(&path, format, id, files, map) }]
}

/// A volume of labels with the names to be stored: the meanings of codes, or typed names.
fn with_names(
    mut volume: Box<dyn VolumeSource>,
    overlap: Overlap,
    typed: bool,
) -> Result<Box<dyn VolumeSource>> {
    let description = &volume.info().description;
    if let ImageKind::Series { .. } = &description.kind {
        if description.kind.is_fractional() {
            let path = PathBuf::from(&description.name);
            return Err(usage!("is a FRACTIONAL segmentation: its values are parts of voxels, not labels; choose a part with {ISO} V or {RANGE} LO..HI").at(path).into());
        }
        // The values of a segment are 0 and 1, whatever its number.
        if let [label] = description.labels.as_slice()
            && label.number != 1
        {
            let part = MaskPart { label: label.clone(), source: volume };
            volume = Box::new(Masks::of(vec![part], overlap, true)?);
        }
    }
    let mut info = volume.info().clone();
    let mut others = info.description.labels.iter_mut().filter(|label| !label.typed.is_empty());
    if typed {
        others.for_each(|label| label.name.clone_from(&label.typed));
    } else if others.any(|label| !label.typed.eq_ignore_ascii_case(&label.name)) {
        info.notes.push(Note::new(format!("labels are named by the meanings of their codes; free-text names may identify the patient, and {KEEP_NAMES} uses those")));
    }
    Ok(InfoOverride::boxed(volume, info))
}

/// A file's name up to its first dot: `liver` of `liver.nii.gz`.
fn stem(path: &Path) -> String {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    name.split_once('.').map_or(&*name, |(stem, _)| stem).to_owned()
}

impl Subject {
    /// Opens the files at some paths, by their content: a mesh where all are files of meshes, the tree of a single
    /// text, and a volume otherwise, like [`discovery::open_unprepared`](super::open_unprepared). Meshes and trees are
    /// not read yet.
    ///
    /// # Errors
    /// The errors of [`discovery::open_unprepared`](super::open_unprepared), and several trees.
    pub fn open(inputs: &[PathBuf], options: &OpenOptions) -> Result<Self> {
        // A stated layout is believed.
        let kind = if options.raw.is_some() { SubjectKind::Volume } else { SubjectKind::of(inputs) };
        Self::open_as(kind, inputs, options, &std::env::temp_dir())
    }

    /// Like [`Subject::open`] where the kind is known, with the folder of temporary files.
    pub(crate) fn open_as(
        kind: SubjectKind,
        inputs: &[PathBuf],
        options: &OpenOptions,
        scratch: &Path,
    ) -> Result<Self> {
        match (kind, inputs) {
            (SubjectKind::Mesh, _) => Ok(Self::Mesh(inputs.to_vec())),
            (SubjectKind::Tree, [only]) => Ok(Self::Tree(only.clone())),
            (SubjectKind::Tree, _) => {
                let path = inputs.first().cloned().unwrap_or_default();
                Err(usage!("a tree of solids (.csg) is built by itself; join several by union() {{ ... }} in one file, and meshes by import()").at(path).into())
            }
            (SubjectKind::Volume, _) => open_unprepared_in(inputs, options, scratch).map(Self::Volume),
        }
    }
}

/// Rank of a volume in the choice among several: refused, a single slice, several slices; then its size.
type Rank = (u8, u64);

/// The best volume seen so far.
struct Best {
    rank: Rank,
    number: usize,
    candidate: Candidate,
    /// `None` if it cannot be used.
    volume: Option<Box<dyn VolumeSource>>,
}

/// A volume among several.
#[derive(Clone, Debug)]
struct Candidate {
    kind: String,
    /// The part of its input, where that holds several volumes.
    part: Option<String>,
    /// Size in voxels, as far as it is known.
    size: Option<[u32; 3]>,
}

impl fmt::Display for Candidate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.kind)?;
        if let Some(part) = &self.part {
            write!(f, " {part}")?;
        }
        self.size.map_or(Ok(()), |[x, y, z]| write!(f, " {x}x{y}x{z}"))
    }
}

/// The best of the volumes that were seen. Volumes are known by their number, counted from 1.
#[derive(Default)]
struct Chooser {
    wanted: Option<usize>,
    seen: usize,
    best: Option<Best>,
    /// The largest refused one: its voxels, true for more than one slice, and its number.
    refused: Option<(u64, bool, usize)>,
    /// The largest of those that are refused for missing slices only, which a choice could mend.
    gapped: Option<(u64, usize)>,
    /// The volumes seen, the largest first, as many as are named.
    named: Vec<(Rank, usize, Candidate)>,
    /// The first damaged ones, as many as are named.
    damaged: Vec<usize>,
    /// Errors of the unusable ones among all these.
    errors: BTreeMap<usize, SourceError>,
}

impl Chooser {
    fn consider(&mut self, finding: Finding) {
        self.seen += 1;
        let number = self.seen;
        let size = finding.size.unwrap_or_default();
        let voxels = size.iter().map(|n| u64::from(*n)).product();
        let error = finding.subject.as_ref().err();
        let damaged = error.is_some_and(SourceError::is_damage);
        let has_gaps = error.is_some_and(SourceError::has_gaps);
        // A slice that is cut short is not a reason to take another volume silently.
        let usable = error.is_none() || (damaged && finding.size.is_some());
        let tier = if usable { 1 + u8::from(size[2] > 1) } else { 0 };
        let rank = (tier, voxels);
        let candidate = Candidate { kind: finding.kind, part: finding.part, size: finding.size };
        let at = self.named.iter().position(|(r, ..)| *r < rank).unwrap_or(self.named.len());
        self.named.insert(at, (rank, number, candidate.clone()));
        // One more than is named is kept, for the volume that is taken.
        self.named.truncate(NAMED + 1);
        if damaged && self.damaged.len() < NAMED {
            self.damaged.push(number);
        }
        let volume = match finding.subject {
            Ok(subject) => subject.into_volume(),
            Err(error) => {
                self.errors.insert(number, error);
                None
            }
        };
        if has_gaps && self.gapped.is_none_or(|(most, _)| voxels > most) {
            self.gapped = Some((voxels, number));
        }
        if self.wanted.is_none_or(|wanted| wanted == number) {
            if usable || self.wanted.is_some() {
                if self.best.as_ref().is_none_or(|best| rank > best.rank) {
                    self.best = Some(Best { rank, number, candidate, volume });
                }
            } else if self.refused.is_none_or(|(most, ..)| voxels > most) {
                self.refused = Some((voxels, size[2] > 1, number));
            }
        }
        self.forget();
    }

    /// Keeps only the errors that may still be reported.
    fn forget(&mut self) {
        let Self { best, refused, gapped, named, damaged, errors, .. } = self;
        errors.retain(|number, _| {
            best.as_ref().is_some_and(|best| best.number == *number)
                || refused.is_some_and(|(.., n)| n == *number)
                || gapped.is_some_and(|(_, n)| n == *number)
                || named.iter().any(|(_, n, _)| n == number)
                || damaged.contains(number)
        });
    }

    fn decide(self, first: &Path, found: &Catalogue) -> Result<Box<dyn VolumeSource>> {
        let Self { wanted, seen, best, refused, gapped, named, damaged, mut errors } = self;
        // A larger series that lacks a slice is likely the wanted one; a smaller one is not taken silently in its
        // place.
        if let (None, Some(best), Some((voxels, number))) = (wanted, &best, gapped)
            && voxels > best.rank.1
            && let Some(error) = errors.remove(&number)
        {
            let other = format!("{VOLUME} {} the largest of the others ({})", best.number, best.candidate);
            let text =
                format!("{}; or choose a volume: {VOLUME} {number} is this one, {other}", error.reason());
            return Err(Fault::new(FaultKind::Unfit, text).at(error.path().unwrap_or(first)).into());
        }
        let (number, taken) = match (best, refused) {
            // A scout next to a series that is refused is not mistaken for the volume.
            (Some(Best { rank: (1, _), .. }), Some((_, true, refused))) if wanted.is_none() => {
                (refused, None)
            }
            (Some(best), _) => (best.number, best.volume.map(|volume| (best.candidate, volume))),
            (None, Some((.., refused))) => (refused, None),
            (None, None) => (0, None),
        };
        let Some((used, source)) = taken else {
            let misuse = match wanted {
                Some(wanted) => {
                    usage!("there is no volume {wanted} among the {seen} that were found; {SCAN} lists them")
                }
                None => Fault::no_volume(),
            };
            let none = || SourceError::from(misuse.at(first));
            return Err(errors.remove(&number).unwrap_or_else(none));
        };
        let mut notes = Vec::new();
        if seen > 1 {
            let rank = named.iter().find(|(_, n, _)| *n == number).map(|(rank, ..)| *rank);
            let is_tie = named.iter().any(|(other, n, _)| *n != number && Some(*other) == rank);
            let others = named.into_iter().filter(|(_, n, _)| *n != number).take(NAMED);
            let others: Vec<String> = others
                .map(|(_, n, other)| match errors.get(&n) {
                    Some(error) => format!("{other}, refused: {}", error.reason()),
                    None => other.to_string(),
                })
                .collect();
            let more = match seen - 1 - others.len() {
                0 => String::new(),
                more => format!("; and {more} more"),
            };
            let why = match (wanted, is_tie) {
                (Some(_), _) => "the chosen one".to_owned(),
                (None, false) => "the largest that forms a volume".to_owned(),
                (None, true) => format!("the first of the largest that form a volume ({VOLUME} chooses)"),
            };
            notes.push(Note::new(format!(
                "{seen} sets of images were found; {why} is used ({used}); not used: {}{more}",
                others.join("; ")
            )));
        }
        notes.extend(damaged.iter().filter_map(|n| errors.get(n)).map(|error| {
            let name = error.path().and_then(Path::file_name).unwrap_or_default();
            Note::new(format!(
                "another series, which is not used, is damaged: {}: {}",
                shown(name),
                error.reason()
            ))
        }));
        for left in found.left_out().iter().take(NAMED) {
            let first = left.first.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
            let files = Count(left.count, "file");
            notes.push(Note::new(format!("{files} left out: {} (first: {first})", left.why)));
        }
        if found.left_out().len() > NAMED {
            let count: u64 = found.left_out().iter().skip(NAMED).map(|l| l.count).sum();
            notes.push(Note::new(format!("{} left out for other reasons", Count(count, "more file"))));
        }
        if notes.is_empty() {
            return Ok(source);
        }
        let mut info = source.info().clone();
        notes.append(&mut info.notes);
        info.notes = notes;
        Ok(InfoOverride::boxed(source, info))
    }
}

fn known_otherwise(what: &str) -> Fault {
    bad!(
        "is {what}; DICOM, NRRD, NIfTI, MetaImage, .npy, MRC, VTK, VGStudio, Amira, Zarr, TIFF and PNG are read, and headerless voxels with {DIMS} NXxNYxNZ and {DTYPE}"
    )
}

/// The refusal of inputs without a volume.
fn nothing(inputs: &[PathBuf], found: &Catalogue, first: &Path) -> SourceError {
    if let [path] = inputs {
        if path.is_file() {
            return refuse_file(path);
        }
        if let Some(error) = sidecar::wrong_beside(path) {
            return error;
        }
    }
    if let Some(what) = known_folder(first) {
        return known_otherwise(what).at(first).into();
    }
    let files = Count(found.left_out().iter().map(|l| l.count).sum::<u64>(), "file");
    let found = match found.left_out() {
        [] => unfit!("the folder holds no file"),
        [only] if !matches!(only.why, NotVolume::Unknown | NotVolume::Headerless) => {
            unfit!("no volume is among {files}: {}", only.why)
        }
        several => match several.iter().find(|left| matches!(left.why, NotVolume::SideCar(_))) {
            // The side-car may be the reason why nothing else is a volume.
            Some(left) => unfit!("no volume is among {files}: {}", left.why),
            None => {
                unfit!("no volume is among {files}; for headerless voxels add {DIMS} NXxNYxNZ and {DTYPE}")
            }
        },
    };
    found.at(first).into()
}

/// The refusal of a single file that is not a volume.
fn refuse_file(path: &Path) -> SourceError {
    let unusable = |fault: Fault| SourceError::from(fault.at(path));
    let (file, head) = match open_with_head(path) {
        Ok(opened) => opened,
        Err(cause) => return SourceError::unreadable(path, cause),
    };
    if head.is_empty() {
        return unusable(bad!("is empty; give a DICOM series or headerless voxels"));
    }
    if let Recognition::NoImage(kind) = recognise(&file) {
        return unusable(unfit!("{kind}"));
    }
    if let Some(what) = known(&head) {
        return unusable(known_otherwise(what));
    }
    // A name that promises DICOM makes the file wrong; any other may be raw voxels that lack options.
    if ends_in(path, &["dcm", "dicom", "ima"]) {
        return unusable(bad!(
            "is not DICOM, in spite of its name; for headerless voxels add {DIMS} and {DTYPE}"
        ));
    }
    if mesh::is_named(path) {
        return unusable(bad!(
            "is a mesh by its name, and is not read as a volume; meshes (STL, PLY, OBJ, OFF, glTF, 3MF) are built by themselves, with {GRID} N or {VOXEL} MM"
        ));
    }
    let misuse = if ends_in(path, &["vol"]) {
        usage!(
            "contains headerless voxels, judging by its name (.vol); put the .vgi that describes it into its folder, or add {DIMS} NXxNYxNZ and {DTYPE}"
        )
    } else {
        usage!(
            "is not a file of a known kind; for headerless voxels add {DIMS} NXxNYxNZ and {DTYPE}, or put a side-car with dims and dtype beside it, as NAME.json"
        )
    };
    sidecar::wrong_beside(path).unwrap_or_else(|| unusable(misuse))
}

#[cfg(test)]
mod tests {
    use super::open_unprepared as open;
    use super::*;
    use crate::exit::ExitKind;

    #[test]
    fn the_side_car_beside_a_single_file_is_used() {
        let folder = tempfile::tempdir().unwrap();
        let data = folder.path().join("a.raw");
        std::fs::write(&data, [1; 8]).unwrap();
        let opened = || open(std::slice::from_ref(&data), &OpenOptions::default());
        let text = opened().err().unwrap().to_string();
        assert!(text.contains("add dims") && text.contains("side-car"), "{text}");
        let describe = |text: &str| std::fs::write(folder.path().join("a.json"), text).unwrap();
        describe(r#"{"dims": [1, 2, 4], "dtype": "u8", "spacing_mm": [1, 2, 3]}"#);
        let volume = opened().unwrap();
        assert_eq!((volume.info().dims.to_array(), volume.info().spacing_mm), ([1, 2, 4], [1.0, 2.0, 3.0]));
        // A wrong side-car must be reported.
        describe(r#"{"dims": [1, 2, 4], "dtype": "u7"}"#);
        let text = opened().err().unwrap().to_string();
        assert!(text.contains("a.json") && text.contains("dtype"), "{text}");
        // A side-car of other data does not count.
        describe(r#"{"dims": [1, 2, 4], "dtype": "u8", "file": "b.raw"}"#);
        assert!(opened().err().unwrap().to_string().contains("add dims"));
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
            ("a.raw", &[7; 100][..], ExitKind::Usage, "add dims"),
            ("b.raw", &[], ExitKind::Input, "is empty"),
            ("a.nrrd", b"NRRD0004\n", ExitKind::Input, "no sample type"),
            ("a.gz", b"\x1f\x8b\x08", ExitKind::Input, "a gzip file"),
        ] {
            let (got, text) = refusal(name, bytes);
            assert!(got == kind && text.contains(words), "{name}: {text}");
        }
        assert_eq!(open(&[], &OpenOptions::default()).err().unwrap().kind(), ExitKind::Usage);
    }
}
