//! What lies below some folders: every volume, with the reason where one cannot be used.
//!
//! Surveying reads headers only. A [`Catalogue`] holds some 50 bytes per item in memory (a DICOM series,
//! a volume file, a stack of pictures); the names of the files wait in a nameless scratch file, chained
//! per item. An item is opened when it is its turn, so that a disk full of studies needs no more memory
//! than its largest series: some 300 bytes for each of its images.

use std::collections::HashMap;
use std::fmt;
use std::fs::{File, Metadata};
use std::io::Read;
use std::os::unix::ffi::OsStrExt;
use std::path::{Path, PathBuf};

use super::dicom::{Recognised, open_series, recognise};
use super::files::FileList;
use super::formats::{FORMATS, HEAD_BYTES, STACKS};
use super::log::{Log, NONE, Record};
use super::stable_hash::StableHash;
use super::walk::{NotEntered, Visitor, changed, walk, without_repeats};
use super::{RawOptions, RawVolume, SourceError, VolumeSource, natural_cmp, sidecar};

/// How volumes are read, where they leave a choice.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OpenOptions {
    /// What headerless files hold; they are no volumes without it.
    pub raw: Option<RawOptions>,
    /// What to do where slices of a series are missing.
    pub gaps: GapPolicy,
    /// Which of several volumes [`super::open`] takes, counted from 1 over all volumes of a [`Catalogue`]
    /// in its order, refused ones included; the largest if none is chosen.
    pub volume: Option<usize>,
    /// A folder (canonical) that is not searched: that of the results.
    pub skip: Option<PathBuf>,
}

/// What to do where slices of a series are missing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum GapPolicy {
    /// Refuse the series, and say where.
    #[default]
    Error,
    /// Keep the true geometry: a missing slice is interpolated between its neighbours.
    Fill,
    /// Use the slices as if they were evenly spaced; the geometry is wrong by what the warning says.
    Keep,
}

/// One volume that was found, or why it cannot be used.
pub struct Finding {
    /// The file, or the folder of the files, as it was reached from what was searched.
    pub path: PathBuf,
    /// Suggested name of a model, without patient data and without an extension; the same for the same
    /// input wherever it lies. Not yet unique.
    ///
    /// For DICOM: modality, series number, eight hex digits of a hash of the Series Instance UID, and the
    /// part, as in `mr-012-1a2b3c4d-echo2`. For files their stem, for stacks of pictures the folder's name.
    pub stem: String,
    /// Kind of source: `dicom`, `nrrd`, `raw`, ...
    pub format: &'static str,
    /// What it is, for people: `CT image`, `localizer`, ...; the format again where nothing more is known.
    pub kind: String,
    /// Which part of its input it is, for example `echo 2`, where that holds several volumes.
    pub part: Option<String>,
    /// Size in voxels, as far as the headers state it; refused volumes have one, too.
    pub size: Option<[u32; 3]>,
    /// What the input files are, to see whether they changed.
    pub files: InputFiles,
    /// Words of the Patient's Name and Patient ID of three and more characters, so that a report can mask
    /// them where they occur in paths. Not for printing.
    pub secrets: Vec<String>,
    /// The volume, not prepared yet.
    pub volume: Result<Box<dyn VolumeSource>, SourceError>,
}

impl fmt::Debug for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let volume = self.volume.as_ref().map(|v| v.info());
        f.debug_struct("Finding")
            .field("path", &self.path)
            .field("stem", &self.stem)
            .field("part", &self.part)
            .field("size", &self.size)
            .field("volume", &volume)
            .finish_non_exhaustive()
    }
}

/// The files behind a volume.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct InputFiles {
    /// How many.
    pub count: u64,
    /// Their bytes together.
    pub bytes: u64,
    /// Depends on every name (without its folder), size and time of change; not on their order.
    pub fingerprint: u64,
}

impl InputFiles {
    /// Takes in one more file; `changed` are bits that differ when its time of change does.
    pub(super) fn add(&mut self, path: &Path, size: u64, changed: u64) {
        let name = path.file_name().map(OsStrExt::as_bytes).unwrap_or_default();
        let hash = StableHash::new().part(name).number(size).number(changed).finish();
        self.count += 1;
        self.bytes = self.bytes.saturating_add(size);
        self.fingerprint = self.fingerprint.wrapping_add(hash);
    }
}

/// Files that are no volume and no part of one: one line for each kind.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LeftOut {
    /// What they are, for example `DICOMDIR` or `not a volume`.
    pub reason: String,
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
}

/// Different reasons that are kept apart.
const MAX_REASONS: usize = 32;

/// How deep the folders below an input are searched, if nothing else is said: deep enough for every
/// archive, and an end for a file system that contains itself.
const DEPTH: u32 = 16;

impl Catalogue {
    /// Searches the inputs: files are taken as they are, folders are searched with everything below them
    /// (hidden entries are left out, and links to folders). The result does not depend on the order in
    /// which a folder lists its files.
    ///
    /// # Errors
    /// An input cannot be read at all, or `scratch` cannot hold what does not fit into memory.
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
        let mut surveyor = Surveyor {
            inputs: &inputs,
            options,
            items: Vec::new(),
            log: Log::new(scratch),
            left_out: Vec::new(),
            index: HashMap::new(),
        };
        walk(&inputs, depth, &mut surveyor)?;
        let Surveyor { items, log, left_out, .. } = surveyor;
        let mut found = Self { inputs, items, log, left_out, options: options.clone() };
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
    pub fn open(&self, index: usize) -> Vec<Finding> {
        let Some(item) = self.items.get(index) else { return Vec::new() };
        self.open_item(item).unwrap_or_else(|(path, error)| {
            vec![Finding {
                stem: stem_of(&path),
                format: "unknown",
                kind: "unknown".into(),
                part: None,
                size: None,
                files: InputFiles::default(),
                secrets: Vec::new(),
                volume: Err(error),
                path,
            }]
        })
    }

    /// What is no volume, summed up.
    pub fn left_out(&self) -> &[LeftOut] {
        &self.left_out
    }

    fn open_item(&self, item: &Item) -> Result<Vec<Finding>, (PathBuf, SourceError)> {
        let first = self.log.get(item.first).map_err(|e| (PathBuf::new(), e))?;
        let path = full_path(&self.inputs, &first);
        let failed = |e| (path.clone(), e);
        let mut files = InputFiles::default();
        let one = |mut files: InputFiles| {
            files.add(&path, first.size, first.changed);
            files
        };
        Ok(match item.what {
            What::Series => {
                let (list, facts) = self.list(item).map_err(failed)?;
                open_series(list, &facts, &self.options)
            }
            What::Damaged => {
                let reason = File::open(&path).map(|f| recognise(&f));
                let error = match reason {
                    Err(cause) => SourceError::Unreadable { path: path.clone(), cause },
                    Ok(Recognised::Damaged(reason)) => SourceError::Unusable { path: path.clone(), reason },
                    Ok(_) => changed_meanwhile(&path),
                };
                findings(&path, "dicom", one(files), Err(error))
            }
            What::Format(at) => match FORMATS.get(usize::from(at)) {
                Some(format) => findings(&path, format.name, one(files), (format.open)(&path, &self.options)),
                None => Vec::new(),
            },
            What::Stack(at) => {
                let (list, facts) = self.list(item).map_err(failed)?;
                for (i, (size, changed)) in facts.iter().enumerate() {
                    files.add(list.name(i), *size, *changed);
                }
                let folder = path.parent().unwrap_or(Path::new("")).to_path_buf();
                match STACKS.get(usize::from(at)) {
                    Some(format) => findings(&folder, format.name, files, (format.open)(list, &self.options)),
                    None => Vec::new(),
                }
            }
            What::Sidecar => {
                let mut files = one(files);
                if let Some(data) = sidecar::data_of(&path)
                    && let Ok(meta) = std::fs::metadata(&data)
                {
                    files.add(&data, meta.len(), changed(&meta));
                }
                findings(&path, "raw", files, sidecar::open(&path).map(|v| vec![v]))
            }
            What::Raw => match &self.options.raw {
                Some(raw) => {
                    let volume = RawVolume::open(std::slice::from_ref(&path), raw);
                    findings(&path, "raw", one(files), volume.map(|v| vec![Box::new(v) as _]))
                }
                None => Vec::new(),
            },
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
                if !record.path.as_os_str().is_empty() {
                    let path = full_path(&self.inputs, &record);
                    leave_out(&mut self.left_out, "single picture, no stack".into(), path);
                    continue;
                }
            }
            kept.push(*item);
        }
        self.items = kept;
        Ok(())
    }

    /// Items in natural order of their first paths, kinds of left-out files by their number.
    fn sort(&mut self) -> Result<(), SourceError> {
        let mut failed = None;
        let (log, inputs) = (&self.log, &self.inputs);
        self.items.sort_by(|a, b| {
            let order = log.get(a.first).and_then(|a| Ok(precedes(inputs, &a, &log.get(b.first)?)));
            order.unwrap_or_else(|e| {
                failed.get_or_insert(e);
                std::cmp::Ordering::Equal
            })
        });
        self.left_out.sort_by(|a, b| b.count.cmp(&a.count).then(a.reason.cmp(&b.reason)));
        failed.map_or(Ok(()), Err)
    }
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

fn changed_meanwhile(path: &Path) -> SourceError {
    SourceError::Unusable {
        path: path.to_path_buf(),
        reason: "was changed while the folders were searched; start again".into(),
    }
}

/// The volumes of one file or folder.
fn findings(
    path: &Path,
    format: &'static str,
    files: InputFiles,
    opened: Result<Vec<Box<dyn VolumeSource>>, SourceError>,
) -> Vec<Finding> {
    let finding =
        |volume: Result<Box<dyn VolumeSource>, SourceError>, part: Option<String>, stem: String| Finding {
            path: path.to_path_buf(),
            stem,
            format,
            kind: format.into(),
            part,
            size: volume.as_ref().ok().map(|v| v.info().dims.to_array()),
            files,
            secrets: Vec::new(),
            volume,
        };
    let stem = stem_of(path);
    match opened {
        Err(error) => vec![finding(Err(error), None, stem)],
        Ok(mut volumes) if volumes.len() == 1 => {
            volumes.pop().map(|v| finding(Ok(v), None, stem)).into_iter().collect()
        }
        Ok(volumes) => volumes
            .into_iter()
            .enumerate()
            .map(|(i, v)| finding(Ok(v), Some(format!("volume {}", i + 1)), format!("{stem}-{}", i + 1)))
            .collect(),
    }
}

/// A file name from a path: its stem (`a` for `a.nii.gz`), or a folder's name.
fn stem_of(path: &Path) -> String {
    let name = super::raw::base_name(path);
    let name = if path.is_dir() { name.as_str() } else { without_ending(&name) };
    safe_name(name)
}

fn without_ending(name: &str) -> &str {
    let name = match name.rsplit_once('.') {
        Some((stem, ending)) if !stem.is_empty() && ending.eq_ignore_ascii_case("gz") => stem,
        _ => name,
    };
    name.rsplit_once('.').map_or(name, |(stem, _)| if stem.is_empty() { name } else { stem })
}

/// Letters, digits, and `-_.` of a name; everything else becomes `_`. Never empty, never hidden, no option.
pub(super) fn safe_name(name: &str) -> String {
    const LONGEST: usize = 100;
    let plain: String = name
        .chars()
        .take(LONGEST)
        .map(|c| if c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.') { c } else { '_' })
        .collect();
    let plain = plain.trim_start_matches(['.', '-']);
    if plain.is_empty() { "volume".into() } else { plain.into() }
}

/// Counts a file among those left out.
fn leave_out(left_out: &mut Vec<LeftOut>, reason: String, path: PathBuf) {
    let at = left_out.iter().position(|known| known.reason == reason);
    // Offsets and counts can make many reasons; a bound keeps a folder of junk from piling them up.
    let at = at.or_else(|| {
        (left_out.len() >= MAX_REASONS)
            .then(|| left_out.iter().position(|known| known.reason == OTHER))
            .flatten()
    });
    match at.and_then(|at| left_out.get_mut(at)) {
        Some(known) => {
            known.count += 1;
            if natural_cmp(path.as_os_str().as_bytes(), known.first.as_os_str().as_bytes()).is_lt() {
                known.first = path;
            }
        }
        None => {
            let reason = if left_out.len() >= MAX_REASONS { OTHER.to_owned() } else { reason };
            left_out.push(LeftOut { reason, count: 1, first: path });
        }
    }
}

/// Reason of those that have reasons past [`MAX_REASONS`].
const OTHER: &str = "left out for other reasons";

/// A catalogue in the making.
struct Surveyor<'a> {
    inputs: &'a [PathBuf],
    options: &'a OpenOptions,
    items: Vec<Item>,
    log: Log,
    left_out: Vec<LeftOut>,
    /// Items that take more than one file, by what they are and a hash of their key.
    index: HashMap<(What, u64), u32>,
}

/// What a file is.
enum Class {
    /// A volume of its own, or with `Some` key a part of one.
    Item(What, Option<u64>),
    LeftOut(String),
    /// Part of something that is counted elsewhere.
    Part,
}

impl Surveyor<'_> {
    fn path(&self, input: u32, path: &Path) -> PathBuf {
        let record = Record { before: NONE, size: 0, changed: 0, input, path: path.to_path_buf() };
        full_path(self.inputs, &record)
    }

    fn classify(&self, path: &Path, meta: &Metadata, named: bool) -> Result<Class, SourceError> {
        let left_out = |reason: &str| Ok(Class::LeftOut(reason.into()));
        if meta.len() == 0 {
            return left_out("empty file");
        }
        let mut head = Vec::with_capacity(HEAD_BYTES);
        let opened = File::open(path).and_then(|file| {
            (&file).take(HEAD_BYTES as u64).read_to_end(&mut head)?;
            Ok(file)
        });
        let file = match opened {
            Ok(file) => file,
            // A file that was named must be readable; one met in a folder is only reported.
            Err(cause) if named => return Err(SourceError::Unreadable { path: path.to_path_buf(), cause }),
            Err(cause) => return Ok(Class::LeftOut(format!("cannot be read ({})", cause.kind()))),
        };
        match recognise(&file) {
            Recognised::Image { series } => {
                let folder = path.parent().map(|p| p.as_os_str().as_bytes()).unwrap_or_default();
                // Images that name no series belong to those beside them.
                let key = if series.is_empty() {
                    StableHash::new().part(b"folder").part(folder)
                } else {
                    StableHash::new().part(b"series").part(series.as_bytes())
                };
                return Ok(Class::Item(What::Series, Some(key.finish())));
            }
            Recognised::NoImage(kind) => return Ok(Class::LeftOut(kind)),
            Recognised::Damaged(_) => return Ok(Class::Item(What::Damaged, None)),
            Recognised::Unreadable(cause) if named => {
                return Err(SourceError::Unreadable { path: path.to_path_buf(), cause });
            }
            Recognised::Unreadable(cause) => {
                return Ok(Class::LeftOut(format!("cannot be read ({})", cause.kind())));
            }
            Recognised::Foreign => {}
        }
        let index = |at: usize| u8::try_from(at).unwrap_or(u8::MAX);
        if let Some(at) = FORMATS.iter().position(|f| (f.recognise)(&head, path)) {
            return Ok(Class::Item(What::Format(index(at)), None));
        }
        if let Some(at) = STACKS.iter().position(|f| (f.recognise)(&head, path)) {
            if path.extension().is_some_and(|e| e == "png") && path.with_extension("oct").is_file() {
                return left_out("picture of a model");
            }
            let folder = path.parent().map(|p| p.as_os_str().as_bytes()).unwrap_or_default();
            let key = StableHash::new().part(folder).finish();
            return Ok(Class::Item(What::Stack(index(at)), Some(key)));
        }
        if let Some(what) = super::open::known(&head) {
            return left_out(what);
        }
        if sidecar::is_named_so(path) && sidecar::read(path).is_some() {
            return Ok(Class::Item(What::Sidecar, None));
        }
        if sidecar::describes(path) || is_detached_data(path) {
            return Ok(Class::Part);
        }
        if let Some(raw) = &self.options.raw {
            let expected = raw.dims.voxels() * raw.scalar.bytes() as u64;
            if named || expected.checked_add(raw.skip) == Some(meta.len()) {
                return Ok(Class::Item(What::Raw, None));
            }
        }
        left_out("not a volume")
    }

    fn add(&mut self, what: What, key: Option<u64>, mut record: Record) -> Result<(), SourceError> {
        let known = key.and_then(|key| self.index.get(&(what, key))).copied();
        let item = known.and_then(|at| self.items.get_mut(at as usize));
        let Some(item) = item else {
            let at = self.log.push(&record)?;
            if let (Some(key), Ok(index)) = (key, u32::try_from(self.items.len())) {
                self.index.insert((what, key), index);
            }
            self.items.push(Item { what, last: at, first: at, files: 1 });
            return Ok(());
        };
        let comes_first = precedes(self.inputs, &record, &self.log.get(item.first)?).is_lt();
        record.before = item.last;
        item.last = self.log.push(&record)?;
        item.files = item.files.saturating_add(1);
        if comes_first {
            item.first = item.last;
        }
        Ok(())
    }
}

impl Visitor for Surveyor<'_> {
    fn file(&mut self, input: u32, path: &Path, meta: &Metadata) -> Result<(), SourceError> {
        let full = self.path(input, path);
        match self.classify(&full, meta, path.as_os_str().is_empty())? {
            Class::Part => Ok(()),
            Class::LeftOut(reason) => {
                leave_out(&mut self.left_out, reason, full);
                Ok(())
            }
            Class::Item(what, key) => {
                let record = Record {
                    before: NONE,
                    size: meta.len(),
                    changed: changed(meta),
                    input,
                    path: path.to_path_buf(),
                };
                self.add(what, key, record)
            }
        }
    }

    fn takes_folder(&mut self, input: u32, path: &Path) -> Result<bool, SourceError> {
        let full = self.path(input, path);
        if let Some(skip) = &self.options.skip
            && skip.file_name() == path.file_name()
            && full.canonicalize().is_ok_and(|real| real == *skip)
        {
            return Ok(true);
        }
        // Slice files described by a side-car beside their folder.
        Ok(sidecar::describes(&full))
    }

    fn not_entered(&mut self, path: &Path, reason: NotEntered) {
        let reason = match reason {
            NotEntered::Unreadable => "folder that cannot be read",
            NotEntered::TooDeep => "folder that lies too deep to be searched",
        };
        leave_out(&mut self.left_out, reason.into(), path.to_path_buf());
    }
}

/// Do the voxels of a header file of the same stem lie in this file?
fn is_detached_data(path: &Path) -> bool {
    let is = |e: &str| path.extension().is_some_and(|x| x.eq_ignore_ascii_case(e));
    ["raw", "zraw", "img", "gz", "bz2", "bin", "dat"].iter().any(|e| is(e))
        && ["nhdr", "mhd", "hdr"].iter().any(|e| path.with_extension(e).is_file())
}
