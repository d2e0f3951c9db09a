//! The volumes of a series, one finding for each, named without patient data.

use std::path::{Path, PathBuf};

use super::assemble::{Stack, assemble};
use super::axes::plane;
use super::group::{Group, Kind, NO_OBSTACLE, Series, Shared, Slice};
use super::split::{Part, split};
use super::survey::{folder_of, load, path_of};
use super::volume::DicomVolume;
use crate::fault::{Fault, FaultKind, bad, unfit};
use crate::source::dicom::attribute::{Attribute, List};
use crate::source::dicom::image::describe::Obstacle;
use crate::source::dicom::series::gaps::ImageName;
use crate::source::files::FileList;
use crate::source::finding::safe_name;
use crate::source::stable_hash::StableHash;
use crate::source::{Finding, InputFiles, OpenOptions, Subject};
use crate::text::{Count, shown};
use crate::volume::{Note, Result, SourceError, VolumeSource};

/// Attributes named in one note.
const NAMED: usize = 4;

/// Files of dropped images that are named in a note.
const NAMED_COPIES: usize = 32;

/// The cure for a file that breaks off, or is damaged, among others.
const WITHOUT_IT: &str = "; copy the file again, or move it away to build without it";

/// Refusal of an image for its obstacle.
pub(super) fn of_image(obstacle: &Obstacle) -> Fault {
    if obstacle.cut_short { bad!("{obstacle}{WITHOUT_IT}") } else { unfit!("{obstacle}") }
}

/// The volumes of a series, refused ones included; `facts` are size and time of change of each file.
pub(crate) fn open_series(files: FileList, facts: &[(u64, u64)], options: &OpenOptions) -> Vec<Finding> {
    let series = load(files, facts);
    let mut parts: Vec<(&Group, Part)> = Vec::new();
    let labels = group_labels(&series.groups);
    for (group, label) in series.groups.iter().zip(labels) {
        for mut part in split(group, &series.image_types) {
            part.label = format!("{label} {}", part.label).trim().to_owned();
            parts.push((group, part));
        }
    }
    make_distinct(&mut parts);
    let notes = notes(&series, &parts);
    let finding = |(group, part): &(&Group, Part)| finding(&series, group, part, &notes, options);
    let mut findings: Vec<Finding> = parts.iter().map(finding).collect();
    if findings.is_empty()
        && let Some((path, error)) = &series.lost
    {
        let error = Err(bad!("{error}; was it changed while the folders were searched?").at(path).into());
        let finding = Finding::new(path, "dicom", String::new(), InputFiles::default(), error);
        findings.push(Finding { kind: "DICOM image".into(), ..finding });
    }
    findings
}

/// The difference between each group of a series and the others.
fn group_labels(groups: &[Group]) -> Vec<String> {
    let differ = |f: &dyn Fn(&Shared) -> String| {
        let mut all = groups.iter().map(|g| f(&g.shared));
        let first = all.next();
        all.any(|other| Some(other) != first)
    };
    let kind = |s: &Shared| match s.kind {
        Kind::Image => String::new(),
        Kind::Derived => "derived".to_owned(),
        Kind::Localizer => "localizer".to_owned(),
    };
    let size = |s: &Shared| format!("{}x{}", s.size[0], s.size[1]);
    let view = |s: &Shared| s.orientation.and_then(plane).unwrap_or("unplaced").to_owned();
    let object = |s: &Shared| s.object.clone();
    let facts: [&dyn Fn(&Shared) -> String; 4] = [&object, &kind, &size, &view];
    let used: Vec<_> = facts.into_iter().filter(|f| differ(f)).collect();
    let label = |g: &Group| {
        let words: Vec<String> = used.iter().map(|f| f(&g.shared)).filter(|w| !w.is_empty()).collect();
        words.join(" ")
    };
    groups.iter().map(label).collect()
}

/// Makes the labels of two parts of a series distinct; the first part without need of a label has none.
fn make_distinct(parts: &mut [(&Group, Part)]) {
    if parts.len() < 2 {
        return;
    }
    let mut seen = std::collections::HashMap::new();
    for (_, part) in parts.iter_mut() {
        let times: &mut u32 = seen.entry(part.label.clone()).or_insert(0);
        *times += 1;
        if *times > 1 {
            part.label = format!("{} set {times}", part.label).trim().to_owned();
        }
    }
}

fn finding(series: &Series, group: &Group, part: &Part, notes: &[Note], options: &OpenOptions) -> Finding {
    let shared = &group.shared;
    let slices: Vec<&Slice> = part.chosen.iter().filter_map(|i| group.slices.get(*i)).collect();
    let mut numbers: Vec<u32> = slices.iter().map(|s| s.file).collect();
    numbers.sort_unstable();
    numbers.dedup();
    let mut files = InputFiles::default();
    for file in &numbers {
        let (size, changed) = series.facts.get(*file as usize).copied().unwrap_or_default();
        files.add(series.files.name(*file as usize), size, changed);
    }
    let path = match numbers.as_slice() {
        [only] => series.files.path(*only as usize),
        _ => folder_of(series, &mut numbers.iter().copied()),
    };
    let id = id(shared, &part.label);
    let volume = open(series, group, part, &path, options).and_then(|stack| {
        DicomVolume::build(series, group, stack, &id, &part.label, notes)
            .map_err(|fault| SourceError::from(fault.at(&path)))
    });
    let opened = volume.as_ref().ok().map(|v| v.info().dims.to_array());
    let each = shared.mosaic.map_or(1, |mosaic| mosaic.slices);
    let images = u32::try_from(slices.len()).unwrap_or(u32::MAX).saturating_mul(each);
    let subject = volume.map(|v| Subject::Volume(Box::new(v)));
    Finding {
        kind: shared.object.clone(),
        body_part: shared.body_part.clone(),
        part: Some(part.label.clone()).filter(|label| !label.is_empty()),
        size: Some(opened.unwrap_or([shared.size[0], shared.size[1], images])),
        burned_in: shared.burned_in,
        ..Finding::new(&path, "dicom", id, files, subject)
    }
}

/// Orders the images of a part, unless one of them stands in the way.
fn open(series: &Series, group: &Group, part: &Part, path: &Path, options: &OpenOptions) -> Result<Stack> {
    let slices: Vec<&Slice> = part.chosen.iter().filter_map(|i| group.slices.get(*i)).collect();
    let refuse = |path: &Path, fault: Fault| Err(fault.at(path).into());
    let images = slices.len();
    let bad: Vec<&&Slice> = slices.iter().filter(|s| s.obstacle != NO_OBSTACLE).collect();
    if let Some(first) = bad.first() {
        let Some(fault) = series.obstacles.get(first.obstacle as usize).cloned() else {
            return refuse(path, unfit!("an image without layout or file"));
        };
        let file = path_of(series, first);
        return match bad.len() {
            1 if images == 1 => refuse(&file, of_image(&fault)),
            bad if bad == images => refuse(path, unfit!("none of its {images} images can be used: {fault}")),
            // Without it the volume would silently lack a slice.
            _ => refuse(&file, bad!("{fault}{WITHOUT_IT}")),
        };
    }
    // Another image of the series may be one of these: without it the volume would silently lack a slice.
    if let Some((file, wrong)) = &series.wrong {
        return refuse(&series.files.path(*file as usize), bad!("{wrong}{WITHOUT_IT}"));
    }
    let frames = slices.iter().any(|s| s.frame > 0);
    let name = |s: &Slice| ImageName {
        file: series.files.name(s.file as usize).to_path_buf(),
        frame: Some(s.frame).filter(|_| frames),
    };
    assemble(group, &part.chosen, options.gaps, &name).or_else(|mut fault| {
        if fault.kind == FaultKind::Gaps
            && let Some(others) = set_apart(series, group)
        {
            fault.text = format!("{}{others}", fault.text).into();
        }
        refuse(path, fault)
    })
}

/// The images of the series that went into other groups, as the missing ones may be among them. Overviews
/// are left out: they never fill a gap.
fn set_apart(series: &Series, group: &Group) -> Option<String> {
    let others: Vec<&Group> = series
        .groups
        .iter()
        .filter(|g| !std::ptr::eq(*g, group) && g.shared.kind != Kind::Localizer)
        .collect();
    let first = others.first().and_then(|g| g.slices.first())?;
    let mut by: Vec<Attribute> = Vec::new();
    for attribute in others.iter().flat_map(|g| group.shared.differences(&g.shared)) {
        if !by.contains(&attribute) {
            by.push(attribute);
        }
    }
    let images = match others.iter().map(|g| g.slices.len()).sum::<usize>() {
        1 => "1 other image of the series was".to_owned(),
        many => format!("{many} other images of the series were"),
    };
    let (by, first) = (List(&by), shown(series.files.name(first.file as usize)));
    Some(format!("; {images} set apart because of a different {by} (first: {first})"))
}

/// Modality, number and hash of the series, and the part: never a name of a file or of a patient.
fn id(shared: &Shared, label: &str) -> String {
    let hash = StableHash::new().part(shared.series_uid.as_bytes()).finish();
    let modality = if shared.modality.is_empty() { "dicom" } else { &shared.modality };
    let number = shared.series_number.map_or_else(String::new, |n| format!("-{n:03}"));
    let part: String =
        label.chars().filter(|c| c.is_ascii_alphanumeric() || *c == '.' || *c == '-').collect();
    let part = if part.is_empty() { part } else { format!("-{}", part.to_ascii_lowercase()) };
    safe_name(&format!("{}{number}-{:08x}{part}", modality.to_ascii_lowercase(), hash >> 32))
}

/// Notes of dropped images, and of the attributes by which a series was split.
fn notes(series: &Series, parts: &[(&Group, Part)]) -> Vec<Note> {
    let mut notes = Vec::new();
    if !series.duplicates.is_empty() {
        // Images of one file with many frames share its name.
        let mut named: Vec<String> = Vec::new();
        for file in series.duplicates.iter().take(NAMED_COPIES) {
            let name = shown(series.files.name(*file as usize)).to_string();
            if !named.contains(&name) {
                named.push(name);
            }
        }
        let images = series.duplicates.len();
        let more = match images.saturating_sub(NAMED_COPIES) {
            0 => String::new(),
            more => format!(" and {more} more"),
        };
        notes.push(Note::new(format!(
            "{} left out for being in the series twice: {}{more}",
            Count(images, "image"),
            named.join(", ")
        )));
    }
    if let Some(([kept, dropped], more)) = series.unlike.split_first() {
        let name = |file: &u32| shown(series.files.name(*file as usize)).to_string();
        let more =
            if more.is_empty() { String::new() } else { format!("; so it is with {} more", more.len()) };
        notes.push(Note::new(format!(
            "{} and {} have one SOP Instance UID (0008,0018) and different pixels, and the first of them is used{more}",
            name(kept),
            name(dropped)
        )));
    }
    if let Some((path, error)) = &series.lost {
        let file = path.file_name().map(PathBuf::from).unwrap_or_default();
        notes.push(Note::new(format!("{}: {error}", shown(&file))));
    }
    if parts.len() > 1 {
        let mut all: Vec<Attribute> = parts.iter().flat_map(|(_, p)| p.by.iter().copied()).collect();
        if let Some((first, others)) = series.groups.split_first() {
            all.extend(others.iter().flat_map(|other| first.shared.differences(&other.shared)));
        }
        let mut by: Vec<Attribute> = Vec::new();
        for attribute in all {
            if !by.contains(&attribute) && by.len() < NAMED {
                by.push(attribute);
            }
        }
        notes.push(Note::new(format!(
            "the series holds {} volumes, told apart by {}",
            parts.len(),
            List(&by)
        )));
    }
    notes
}
