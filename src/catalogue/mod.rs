//! What lies below some folders: every volume, with the reason where one cannot be used.
//!
//! Surveying reads headers only. A [`Catalogue`] holds some 50 bytes per item in memory (a DICOM series,
//! a volume file, a stack of pictures); the names of the files wait in a nameless scratch file, chained
//! per item. An item is opened when it is its turn, so that a disk full of studies needs no more memory
//! than its largest series: some 400 bytes for each of its images while it is opened, a third of that after.

mod content;
mod log;
mod open;
mod placing;
mod sidecar;
mod surveyor;
mod walk;

pub use open::{open, open_unprepared, open_unprepared_in};

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use crate::budget::costs;
use crate::facts::dicom::DicomFault;
use crate::facts::{Fault, Misuse, NotVolume, Note, StatedBy};
use crate::mesh;
use crate::platform::OsStrExt;
use crate::source::dicom::{Recognised, open_series, recognise};
use crate::source::{
    FORMATS, FileList, Finding, HEAD_BYTES, InputFiles, OpenOptions, RawVolume, STACKS, Slices, StableHash,
    natural_cmp,
};
use crate::stamp::stamp;
use crate::synthetic;
use crate::volume::{Noted, Placement, SourceError, VolumeSource, Watched, place};
use content::{EachFile, hash_of, is_copy};
use log::{Log, Record};
use placing::placing_of;
use surveyor::{LeftOutFiles, Surveyor, leave_out};
use walk::{changed, walk, without_repeats};

/// Files that are no volume and no part of one: one line for each kind.
#[derive(Clone, Debug, PartialEq)]
pub struct LeftOut {
    /// What they are.
    pub why: NotVolume,
    /// How many.
    pub count: u64,
    /// The first of them, in natural order.
    pub first: PathBuf,
}

/// Everything that was found below some inputs.
#[derive(Debug)]
pub struct Catalogue {
    inputs: Vec<PathBuf>,
    items: Vec<Item>,
    log: Log,
    left_out: Vec<LeftOut>,
    left_out_files: LeftOutFiles,
    options: OpenOptions,
}

/// One series, stack or file.
#[derive(Clone, Copy, Debug)]
struct Item {
    what: What,
    /// Head of its chain in the log.
    last: u64,
    /// The record whose path comes first; items are in the order of these.
    first: u64,
    files: u32,
    weight: Weight,
}

/// What it takes to open an item.
#[derive(Clone, Copy, Debug)]
struct Weight {
    /// Files, or the frames in them.
    images: u32,
    /// Memory that is taken for a moment, about.
    opening_bytes: u64,
}

impl Weight {
    /// A file of which no more is known than that it is there.
    const FILE: Self = Self { images: 1, opening_bytes: costs::OPENING_FRAME };

    fn and(self, other: Self) -> Self {
        Self {
            images: self.images.saturating_add(other.images),
            opening_bytes: self.opening_bytes.saturating_add(other.opening_bytes),
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum What {
    Series,
    /// DICOM that cannot be followed.
    Damaged,
    /// Index in [`FORMATS`].
    Format(u8),
    /// Index in [`STACKS`].
    Stack(u8),
    Sidecar,
    Raw,
    /// A triangle mesh.
    Mesh,
    /// Not a file: the description of a volume that is computed.
    Synthetic,
}

/// Files left out up to which their names are sorted in memory.
const MOST_SORTED: u64 = 4096;
/// Volumes of one input that are alike, and are all taken; echoes, phases and the like are fewer.
const MOST_ALIKE: usize = 16;

/// How deep the folders below an input are searched, if nothing else is said: deep enough for every
/// archive, and an end for a file system that contains itself.
const DEPTH: u32 = 16;

impl Catalogue {
    /// Searches the inputs: files are taken as they are, and descriptions of [`synthetic`] volumes; folders are
    /// searched with everything below them (hidden entries are left out, and links to folders). The result does not depend on the order in
    /// which a folder lists its files.
    ///
    /// # Errors
    /// An input cannot be read at all or describes nothing, or `scratch` cannot hold what does not fit into memory.
    pub fn survey(inputs: &[PathBuf], options: &OpenOptions, scratch: &Path) -> Result<Self, SourceError> {
        Self::survey_to_depth(inputs, options, scratch, DEPTH)
    }

    /// As [`Catalogue::survey`], but folders are entered `depth` levels deep only.
    ///
    /// # Errors
    /// As [`Catalogue::survey`].
    pub fn survey_to_depth(
        inputs: &[PathBuf],
        options: &OpenOptions,
        scratch: &Path,
        depth: u32,
    ) -> Result<Self, SourceError> {
        let inputs = without_repeats(inputs)?;
        let mut surveyor = Surveyor::new(&inputs, options, scratch);
        walk(&inputs, depth, options.follow_links, &mut surveyor)?;
        let (items, log, left_out, left_out_files) = surveyor.finish();
        let mut found = Self { inputs, items, log, left_out, left_out_files, options: options.clone() };
        found.leave_single_pictures()?;
        found.sort()?;
        found.items.shrink_to_fit();
        found.log.shrink();
        Ok(found)
    }

    /// Number of items; each may hold several volumes.
    pub fn len(&self) -> usize {
        self.items.len()
    }

    /// Was nothing found?
    pub fn is_empty(&self) -> bool {
        self.items.is_empty()
    }

    /// The volumes of item `index`, refused ones included; none for an index out of range.
    ///
    /// Cost: headers, and some 256 KiB of the content of what is no DICOM, from which it is named.
    pub fn open(&self, index: usize) -> Vec<Finding> {
        let unreadable = |format| format!("{format}-unreadable-{}", index + 1);
        let findings = self.open_named(index, &|format, files| match hash_of(files) {
            Ok(hash) => format!("{format}-{hash}"),
            // Nothing is made of what cannot be read: its name has to tell it from others in reports only.
            Err(_) => unreadable(format),
        });
        self.first_of_many(findings)
    }

    /// Of very many volumes of one input that are alike the first, unless all are wanted: a study of the brain at
    /// work has five hundred, and nobody wants as many models unasked.
    fn first_of_many(&self, findings: Vec<Finding>) -> Vec<Finding> {
        if self.options.all_volumes || findings.len() <= MOST_ALIKE {
            return findings;
        }
        let alike = |a: &Finding, b: &Finding| (a.format, &a.kind, a.size) == (b.format, &b.kind, b.size);
        let mut kept: Vec<Finding> = Vec::new();
        let mut passed_over: Vec<Vec<Finding>> = Vec::new();
        for finding in findings {
            match kept.iter().position(|known| alike(known, &finding)) {
                None => {
                    kept.push(finding);
                    passed_over.push(Vec::new());
                }
                Some(at) => {
                    // The first that can be used stands for all of them.
                    let better = kept[at].volume.is_err() && finding.volume.is_ok();
                    passed_over[at].push(if better {
                        std::mem::replace(&mut kept[at], finding)
                    } else {
                        finding
                    });
                }
            }
        }
        let mut all: Vec<Finding> = Vec::new();
        for (finding, others) in kept.into_iter().zip(passed_over) {
            if others.len() < MOST_ALIKE {
                all.push(finding);
                all.extend(others);
                continue;
            }
            let more = others.len();
            let note = Note::FirstOfMany { volumes: more + 1 };
            let volume = finding.volume.map(|source| -> Box<dyn VolumeSource> {
                let mut info = source.info().clone();
                info.notes.push(note);
                Box::new(Noted { source, info })
            });
            all.push(Finding { volume, more, ..finding });
        }
        all.sort_by_key(|finding| finding.at);
        all
    }

    /// As [`Catalogue::open`], for one that takes a volume and no names: nothing but headers is read.
    fn open_nameless(&self, index: usize) -> Vec<Finding> {
        self.open_named(index, &|format, _| format.to_owned())
    }

    fn open_named(&self, index: usize, name: Name<'_>) -> Vec<Finding> {
        let Some(item) = self.items.get(index) else { return Vec::new() };
        let refused = |(path, error): (PathBuf, SourceError)| {
            vec![Finding {
                id: name("unknown", &|each| each(&path)),
                format: "unknown",
                kind: "unknown".into(),
                part: None,
                size: None,
                files: InputFiles::default(),
                burned_in: None,
                at: 0,
                more: 0,
                mesh: false,
                volume: Err(error),
                path: path.clone(),
            }]
        };
        let before = self.stamp(item);
        let opened = self.open_item(item, name).unwrap_or_else(refused);
        let mut findings: Vec<Finding> = opened.into_iter().map(watched).collect();
        for (at, finding) in findings.iter_mut().enumerate() {
            finding.at = at;
        }
        // From here on the volumes watch their files themselves.
        if self.stamp(item) != before {
            for finding in findings.iter_mut().filter(|finding| finding.volume.is_ok() || finding.mesh) {
                finding.mesh = false;
                finding.volume = Err(changed_meanwhile(&finding.path));
            }
        }
        for finding in findings.iter_mut().filter(|finding| finding.id.is_empty()) {
            // Images that cannot be read any more do not name their series.
            finding.id = name(finding.format, &|each| each(&finding.path));
        }
        if !self.options.placement.is_empty() && self.options.raw.is_none() {
            findings = findings.into_iter().map(|finding| placed(finding, self.options.placement)).collect();
        }
        findings
    }

    /// Is a volume a copy of the volume `part` of item `index`, byte for byte and placed alike?
    ///
    /// Cost: that item is opened again, and all files of both are read, up to the first difference. One that
    /// cannot be read is no copy.
    pub fn is_copy(&self, finding: &Finding, (index, part): (usize, usize)) -> bool {
        let mut others = self.first_of_many(self.open_nameless(index)).into_iter();
        others.nth(part).is_some_and(|other| is_copy(finding, &other).unwrap_or(false))
    }

    /// Memory that opening item `index` takes for a moment, about; a third of it stays while its volumes are
    /// held.
    pub fn opening_bytes(&self, index: usize) -> u64 {
        self.items.get(index).map_or(0, |item| item.weight.opening_bytes)
    }

    /// Bounds what [`Catalogue::open`] may take for a moment; items that need more are refused.
    pub fn allow_opening(&mut self, bytes: u64) {
        self.options.opening_bytes = Some(bytes);
    }

    /// What is no volume, summed up.
    pub fn left_out(&self) -> &[LeftOut] {
        &self.left_out
    }

    /// Calls `each` for every file that is left out, with its reason: in natural order of their paths, of very many
    /// in the order in which they were met.
    ///
    /// # Errors
    /// The list is on disk and cannot be read, or `each` fails.
    pub fn for_each_left_out<E: From<SourceError>>(
        &self,
        each: &mut dyn FnMut(&NotVolume, &Path) -> Result<(), E>,
    ) -> Result<(), E> {
        let count: u64 = self.left_out.iter().map(|l| l.count).sum();
        if count > MOST_SORTED {
            for file in self.left_out_files.all() {
                let (why, path) = file?;
                each(why, &path)?;
            }
            return Ok(());
        }
        let mut files = self.left_out_files.all().collect::<Result<Vec<_>, _>>()?;
        let bytes = |path: &PathBuf| path.clone().into_os_string();
        files.sort_by(|a, b| natural_cmp(bytes(&a.1).as_bytes(), bytes(&b.1).as_bytes()));
        files.iter().try_for_each(|(why, path)| each(why, path))
    }

    /// What the files of an item are now; differs when one of them does.
    fn stamp(&self, item: &Item) -> u64 {
        // A log that cannot be read is told of where the item is opened.
        let records = self.log.chain(item.last).filter_map(Result::ok);
        let stamps = records.map(|record| stamp(&full_path(&self.inputs, &record)));
        stamps.fold(StableHash::new(), StableHash::number).finish()
    }

    fn open_item(&self, item: &Item, name: Name<'_>) -> Result<Vec<Finding>, (PathBuf, SourceError)> {
        let first = self.log.get(item.first).map_err(|e| (PathBuf::new(), e))?;
        let path = full_path(&self.inputs, &first);
        let failed = |e| (path.clone(), e);
        let Weight { images, opening_bytes: needed_bytes } = item.weight;
        let allowed_bytes = self.options.opening_bytes.unwrap_or(u64::MAX);
        // What one image takes is there always.
        if needed_bytes > allowed_bytes && images > 1 {
            let images = images.into();
            let path = path.clone();
            return Err(failed(SourceError::ManyImages { path, images, needed_bytes, allowed_bytes }));
        }
        if item.what == What::Synthetic {
            let hash = StableHash::new().part(path.as_os_str().as_bytes()).finish();
            let files = InputFiles { fingerprint: hash, ..InputFiles::default() };
            let id = format!("synthetic-{:012x}", hash >> 16);
            let opened = synthetic::open(&path).map(|volume| vec![volume]);
            return Ok(findings(&path, "synthetic", id, files, opened));
        }
        let one = || {
            let mut files = InputFiles::default();
            files.add(&path, first.size, first.changed);
            files
        };
        // A header and what it names: the samples may change without it.
        let with_samples = |mut files: InputFiles, opened: &[Box<dyn VolumeSource>]| {
            if let Some(volume) = opened.first() {
                volume.for_each_file(&mut |data| {
                    if data != path
                        && let Ok(meta) = std::fs::metadata(data)
                    {
                        files.add(data, meta.len(), changed(&meta));
                    }
                });
            }
            files
        };
        let only: EachFile<'_> = &|each| each(&path);
        Ok(match item.what {
            What::Series => {
                let (list, facts) = self.list(item).map_err(failed)?;
                open_series(list, &facts, &self.options)
            }
            What::Damaged => {
                let recognised = File::open(&path).map(|f| recognise(&f));
                let error = match recognised {
                    Err(cause) => SourceError::Unreadable { path: path.clone(), cause },
                    Ok(Recognised::Damaged(error)) => {
                        SourceError::Dicom { path: path.clone(), fault: DicomFault::Header(error) }
                    }
                    Ok(_) => changed_meanwhile(&path),
                };
                findings(&path, "dicom", name("dicom", only), one(), Err(error))
            }
            What::Format(at) => match FORMATS.get(usize::from(at)) {
                Some(format) => {
                    let mut opened = (format.open)(&path, &self.options);
                    let mut files = with_samples(one(), opened.as_deref().unwrap_or_default());
                    let stated = format.states_no_place.then(|| placing_of(&[&path])).flatten();
                    let id = name(format.name, &|each| {
                        each_source(&path, opened.as_deref().unwrap_or_default(), each);
                        stated.iter().for_each(|stated| each(stated.path()));
                    });
                    if let Some(stated) = stated {
                        stated.add_to(&mut files);
                        opened = opened.and_then(|all| all.into_iter().map(|v| stated.place(v)).collect());
                    }
                    findings(&path, format.name, id, files, opened)
                }
                None => Vec::new(),
            },
            What::Stack(at) => {
                let (list, facts) = self.list(item).map_err(failed)?;
                let folder = path.parent().unwrap_or(Path::new("")).to_path_buf();
                let names = list.select(0..list.len());
                let Some(format) = STACKS.get(usize::from(at)) else { return Ok(Vec::new()) };
                let mut found = Vec::new();
                for Slices { files: used, volume } in (format.open)(list, &self.options) {
                    let mut files = InputFiles::default();
                    for at in &used {
                        let (size, changed) = facts.get(*at).copied().unwrap_or_default();
                        files.add(names.name(*at), size, changed);
                    }
                    let path = match used.as_slice() {
                        [only] => names.path(*only),
                        _ => folder.clone(),
                    };
                    let own = used.first().map(|at| names.path(*at)).filter(|_| used.len() == 1);
                    let named: Vec<&Path> = own.iter().chain([&folder]).map(PathBuf::as_path).collect();
                    let stated = placing_of(&named);
                    let id = name(format.name, &|each| {
                        used.iter().for_each(|at| each(&names.path(*at)));
                        stated.iter().for_each(|stated| each(stated.path()));
                    });
                    let volume = match stated {
                        Some(stated) => {
                            stated.add_to(&mut files);
                            volume.and_then(|v| stated.place(v))
                        }
                        None => volume,
                    };
                    found.extend(findings(&path, format.name, id, files, volume.map(|v| vec![v])));
                }
                found
            }
            What::Sidecar => {
                let opened = sidecar::open(&path, &self.options).map(|v| vec![v]);
                let files = with_samples(one(), opened.as_deref().unwrap_or_default());
                let id = name("raw", &|each| each_source(&path, opened.as_deref().unwrap_or_default(), each));
                findings(&path, "raw", id, files, opened)
            }
            What::Raw => match &self.options.raw {
                Some(raw) => {
                    let volume = RawVolume::open(std::slice::from_ref(&path), raw);
                    findings(&path, "raw", name("raw", only), one(), volume.map(|v| vec![Box::new(v) as _]))
                }
                None => Vec::new(),
            },
            What::Mesh => {
                let format = mesh_format(&path, first.size).map_err(failed)?;
                let id = name(format, only);
                // Whoever takes meshes knows by the field that it is one.
                let no_grid = || SourceError::Usage { path: path.clone(), misuse: Misuse::NoGrid };
                let checked = mesh::check(&path, self.options.follow_links);
                let usable = checked.is_ok();
                let mut found = findings(&path, format, id, one(), checked.and_then(|()| Err(no_grid())));
                for finding in &mut found {
                    finding.kind = "triangle mesh".into();
                    finding.mesh = usable;
                }
                found
            }
            What::Synthetic => Vec::new(),
        })
    }

    /// Files of an item in natural order, with size and time of change of each.
    fn list(&self, item: &Item) -> Result<(FileList, Vec<(u64, u64)>), SourceError> {
        // Names below one folder are kept relative to it.
        let mut base: Option<PathBuf> = None;
        for record in self.log.chain(item.last) {
            let path = full_path(&self.inputs, &record?);
            let folder = path.parent().unwrap_or(Path::new(""));
            base = Some(match base {
                None => folder.to_path_buf(),
                Some(known) if folder.starts_with(&known) => known,
                Some(known) => {
                    let shared = known.ancestors().find(|a| folder.starts_with(a));
                    shared.unwrap_or(Path::new("")).to_path_buf()
                }
            });
        }
        let base = base.unwrap_or_default();
        let mut files = FileList::new(&base);
        let mut facts = Vec::with_capacity(item.files as usize);
        for record in self.log.chain(item.last) {
            let record = record?;
            let path = full_path(&self.inputs, &record);
            files.push(path.strip_prefix(&base).unwrap_or(&path));
            facts.push((record.size, record.changed));
        }
        let order = files.natural_order();
        let facts = order.iter().filter_map(|i| facts.get(*i)).copied().collect();
        Ok((files.select(order.into_iter()), facts))
    }

    /// One picture alone in a folder is no stack, unless it was given by name.
    fn leave_single_pictures(&mut self) -> Result<(), SourceError> {
        let mut kept = Vec::with_capacity(self.items.len());
        for item in &self.items {
            if matches!(item.what, What::Stack(_)) && item.files == 1 {
                let record = self.log.get(item.first)?;
                let path = full_path(&self.inputs, &record);
                let is_whole = |at: u8| STACKS.get(usize::from(at)).is_some_and(|f| (f.is_whole)(&path));
                if !record.path.as_os_str().is_empty()
                    && !matches!(item.what, What::Stack(at) if is_whole(at))
                {
                    self.left_out_files.add(&NotVolume::SinglePicture, &path)?;
                    leave_out(&mut self.left_out, NotVolume::SinglePicture, path);
                    continue;
                }
            }
            kept.push(*item);
        }
        self.items = kept;
        Ok(())
    }

    /// Items in natural order of their first paths, kinds of left-out files by their number, then likewise.
    fn sort(&mut self) -> Result<(), SourceError> {
        let (log, inputs) = (&self.log, &self.inputs);
        sort_or_stop(&mut self.items, |a, b| {
            Ok::<_, SourceError>(precedes(inputs, &log.get(a.first)?, &log.get(b.first)?))
        })?;
        let bytes = |l: &LeftOut| l.first.clone().into_os_string();
        self.left_out.sort_by(|a, b| {
            b.count.cmp(&a.count).then_with(|| natural_cmp(bytes(a).as_bytes(), bytes(b).as_bytes()))
        });
        Ok(())
    }
}

/// Sorts by an order that has to be read and may fail; equal ones keep their places. (That of the standard
/// library needs an answer to every comparison, and may panic on answers that contradict each other.)
fn sort_or_stop<T: Copy, E>(
    items: &mut Vec<T>,
    compare: impl Fn(&T, &T) -> Result<std::cmp::Ordering, E>,
) -> Result<(), E> {
    let mut merged = Vec::with_capacity(items.len());
    let mut run = 1;
    while run < items.len() {
        merged.clear();
        for pair in items.chunks(2 * run) {
            let (mut a, mut b) = pair.split_at(run.min(pair.len()));
            while let ([first, after @ ..], [second, behind @ ..]) = (a, b) {
                if compare(second, first)?.is_lt() {
                    merged.push(*second);
                    b = behind;
                } else {
                    merged.push(*first);
                    a = after;
                }
            }
            merged.extend_from_slice(a);
            merged.extend_from_slice(b);
        }
        std::mem::swap(items, &mut merged);
        run *= 2;
    }
    Ok(())
}

/// The id of a volume of some format, by the content of its files.
type Name<'a> = &'a dyn Fn(&'static str, EachFile<'_>) -> String;

/// A header, or whatever leads to a volume, and the files of samples beside it.
fn each_source(path: &Path, opened: &[Box<dyn VolumeSource>], each: &mut dyn FnMut(&Path)) {
    each(path);
    if let Some(volume) = opened.first() {
        volume.for_each_file(&mut |data| {
            if data != path {
                each(data);
            }
        });
    }
}

/// A finding whose volume notices a change of its files, of a header among them.
fn watched(finding: Finding) -> Finding {
    let path = Some(&*finding.path).filter(|path| path.is_file());
    let volume = finding.volume.map(|volume| Watched::files(volume, path));
    Finding { volume, ..finding }
}

/// A finding whose volume is where the command line says.
fn placed(finding: Finding, asked: Placement) -> Finding {
    let volume = finding.volume.and_then(|volume| place(volume, asked, StatedBy::Caller));
    Finding { volume, ..finding }
}

/// Where a record's file is.
fn full_path(inputs: &[PathBuf], record: &Record) -> PathBuf {
    let input = inputs.get(record.input as usize).map_or(Path::new(""), PathBuf::as_path);
    // Joined with nothing, a file would get a slash at its end.
    if record.path.as_os_str().is_empty() { input.to_path_buf() } else { input.join(&record.path) }
}

/// Natural order of whole paths: the order of the inputs does not matter, only their names.
fn precedes(inputs: &[PathBuf], a: &Record, b: &Record) -> std::cmp::Ordering {
    let bytes = |r: &Record| full_path(inputs, r).into_os_string();
    if a.input == b.input {
        return natural_cmp(a.path.as_os_str().as_bytes(), b.path.as_os_str().as_bytes());
    }
    natural_cmp(bytes(a).as_bytes(), bytes(b).as_bytes())
}

/// The format of a mesh, which was one when its folder was searched.
fn mesh_format(path: &Path, bytes: u64) -> Result<&'static str, SourceError> {
    let mut head = Vec::new();
    let read = File::open(path).and_then(|file| file.take(HEAD_BYTES as u64).read_to_end(&mut head));
    read.map_err(|cause| SourceError::Unreadable { path: path.to_path_buf(), cause })?;
    mesh::format_of(&head, bytes, path).ok_or_else(|| changed_meanwhile(path))
}

fn changed_meanwhile(path: &Path) -> SourceError {
    SourceError::Unusable { path: path.to_path_buf(), fault: Fault::Changed }
}

/// The volumes of one file or folder.
fn findings(
    path: &Path,
    format: &'static str,
    id: String,
    files: InputFiles,
    opened: Result<Vec<Box<dyn VolumeSource>>, SourceError>,
) -> Vec<Finding> {
    let finding =
        |volume: Result<Box<dyn VolumeSource>, SourceError>, part: Option<String>, id: String| Finding {
            path: path.to_path_buf(),
            id,
            format,
            kind: format.into(),
            part,
            size: volume.as_ref().ok().map(|v| v.info().dims.to_array()),
            files,
            burned_in: None,
            at: 0,
            more: 0,
            mesh: false,
            volume,
        };
    match opened {
        Err(error) => vec![finding(Err(error), None, id)],
        Ok(mut volumes) if volumes.len() == 1 => {
            volumes.pop().map(|v| finding(Ok(v), None, id)).into_iter().collect()
        }
        Ok(volumes) => volumes
            .into_iter()
            .enumerate()
            .map(|(i, v)| finding(Ok(v), Some(format!("volume {}", i + 1)), format!("{id}-{}", i + 1)))
            .collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sorting_keeps_equal_ones_in_place_and_stops_at_the_first_failure() {
        for count in [0, 1, 2, 3, 64, 1000_u32] {
            let mut items: Vec<(u32, u32)> =
                (0..count).map(|i| (i.wrapping_mul(2_654_435_761) % 37, i)).collect();
            let mut expected = items.clone();
            expected.sort_by_key(|item| item.0);
            sort_or_stop(&mut items, |a, b| Ok::<_, ()>(a.0.cmp(&b.0))).unwrap();
            assert_eq!(items, expected);
        }
        let asked = std::cell::Cell::new(0);
        let failing = |a: &i32, b: &i32| {
            asked.set(asked.get() + 1);
            if asked.get() == 3 { Err("disk") } else { Ok(a.cmp(b)) }
        };
        assert_eq!(sort_or_stop(&mut vec![5, 4, 3, 2, 1, 0], failing), Err("disk"));
        assert_eq!(asked.get(), 3);
    }
}
