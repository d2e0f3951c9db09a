//! Memory of a batch from run to run: a record beside each model, by which a later run sees that the work is done, and
//! the journal of this run, from which reports are written.

use std::fs;
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use serde::{Deserialize, Serialize};

use crate::atomic::AtomicFile;
use crate::exit::ExitKind;
use crate::platform::PositionalFile;
use crate::scratch::Appended;
use crate::source::BurnedIn;

/// Outcome of a volume.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub enum Status {
    /// Built in this run.
    Converted,
    /// Built before, from the same files with the same options; or, without a model, left alone as asked.
    Skipped,
    /// Refused, or its build failed.
    #[default]
    Failed,
    /// Built by an earlier run, and still there; this run did not come across it.
    Kept,
}

/// Reason for a missing model, in a word without names.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub enum Cause {
    /// It has fewer slices than were asked for.
    FewSlices,
    /// It is outside the modalities or series that were asked for.
    NotAskedFor,
    /// It is a copy of the volume of this name.
    CopyOf(String),
    /// The input cannot be used.
    Input,
    /// No voxel is inside.
    Empty,
    /// It takes more memory than is available.
    Memory,
    /// The disk failed, or is full.
    Disk,
    /// The options do not fit it.
    Options,
    /// The program has a defect.
    Defect,
}

impl Cause {
    /// The cause of a failure of some kind.
    pub(super) fn of(kind: ExitKind) -> Self {
        match kind {
            ExitKind::Usage => Self::Options,
            ExitKind::Budget => Self::Memory,
            ExitKind::Io => Self::Disk,
            ExitKind::Input | ExitKind::Partial | ExitKind::Stopped => Self::Input,
        }
    }
}

/// One volume of a batch, as reported. It tells where the volume lies, and stays with the volume's owner.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Item {
    /// Outcome of the volume.
    pub status: Status,
    /// Name of the model, without .oct.
    pub name: String,
    /// File, or folder of the files, as reached from the paths searched.
    pub input: String,
    /// Kind of source: dicom, raw, nrrd, mesh, csg, synthetic, ...
    pub format: String,
    /// Kind of image, such as CT image; the format if unknown.
    pub kind: String,
    /// Part of an input that holds several volumes; else empty.
    pub part: String,
    /// Files read.
    pub files: u64,
    /// Size of these files.
    pub input_bytes: u64,
    /// Reason to think that the pixels carry text; null without one.
    pub burned_in: Option<BurnedIn>,
    /// Reason for the missing model, in a word: few_slices, not_asked_for, {copy_of: NAME}, input, empty, memory, disk,
    /// options or defect; null if there is a model.
    pub cause: Option<Cause>,
    /// Reason for the failure or the omission, in one sentence that may name files; else null.
    pub reason: Option<String>,
    /// Sentences about the input: assumptions, parts left out, oddities.
    pub warnings: Vec<String>,
    /// The model; null if there is none.
    pub model: Option<ModelFacts>,
}

impl Item {
    /// The item of an input whose opening met a defect of the program.
    pub(super) fn of_defect(at: usize) -> Self {
        Self {
            name: format!("defect-{}", at + 1),
            input: format!("entry {} of the search", at + 1),
            cause: Some(Cause::Defect),
            reason: Some("an internal error stopped the reading of its headers; please report it".into()),
            ..Self::default()
        }
    }

    /// The item without a model, for this reason.
    pub(super) fn ended(self, status: Status, cause: Cause, reason: impl Into<String>) -> Self {
        Self { status, cause: Some(cause), reason: Some(reason.into()), ..self }
    }
}

/// Facts of a finished model, as reported.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct ModelFacts {
    /// File name of the model in the output folder.
    pub file: String,
    /// File name of its thumbnail; null without.
    pub thumbnail: Option<String>,
    /// Size of the volume in voxels along x, y, z.
    pub dims: [u32; 3],
    /// Distance of neighbouring voxels along x, y, z, in mm.
    pub spacing_mm: [f64; 3],
    /// Type of the source's samples: u8, i8, u16, i16, u32, i32, f32 or f64.
    pub dtype: String,
    /// Lowest and highest value inside, in physical units; null if there is no limit.
    pub range: (f64, Option<f64>),
    /// How the range was chosen: iso, range or otsu; empty for models of older versions.
    #[serde(default)]
    pub selection: String,
    /// Skin voxels of the model.
    pub skin_voxels: u64,
    /// Number of the model's labels; 0 without.
    #[serde(default)]
    pub label_count: u64,
    /// Nodes of the octree, one infobyte each.
    pub nodes: u64,
    /// Size of the file that was written or read.
    pub bytes: u64,
    /// Seconds from start to end.
    pub wall_s: f64,
    /// Memory granted to its job.
    pub memory_bytes: u64,
    /// Most memory in use at a time by the plan of the build.
    #[serde(default)]
    pub memory_plan_bytes: u64,
    /// Size of the scratch files.
    pub scratch_bytes: u64,
}

/// A record on disk, beside its model, with which it travels: facts of the model and fingerprints of its origin. It
/// names no file but the model's own and no folder, and holds no sentence.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Record {
    /// Version of the program.
    pub(super) version: String,
    /// Options and input files in one number each, in hexadecimal: JSON's own numbers end at 2^53.
    pub(super) options: String,
    pub(super) inputs: String,
    /// Bytes of the thumbnail.
    pub(super) thumbnail_bytes: u64,
    /// The item's id.
    pub(super) name: String,
    pub(super) format: String,
    pub(super) kind: String,
    pub(super) part: String,
    pub(super) burned_in: Option<BurnedIn>,
    pub(super) model: ModelFacts,
}

/// Longest record that is read.
const MAX_RECORD_BYTES: u64 = 64 << 10;

/// Path of the record of the model `name`.
pub(super) fn record_path(out: &Path, name: &str) -> PathBuf {
    out.join(format!("{name}.oct.json"))
}

impl Record {
    /// The record of an item with a model.
    pub(super) fn of(item: &Item, options: &str, inputs: &str, thumbnail_bytes: u64) -> Option<Self> {
        Some(Self {
            version: env!("CARGO_PKG_VERSION").into(),
            options: options.into(),
            inputs: inputs.into(),
            thumbnail_bytes,
            name: item.name.clone(),
            format: item.format.clone(),
            kind: item.kind.clone(),
            part: item.part.clone(),
            burned_in: item.burned_in,
            model: item.model.clone()?,
        })
    }

    /// Reads the record of `name`; `None` if it is missing or unreadable.
    pub(super) fn read(out: &Path, name: &str) -> Option<Self> {
        let file = PositionalFile::open(&record_path(out, name)).ok()?;
        let mut text = Vec::new();
        file.onwards(0).take(MAX_RECORD_BYTES).read_to_end(&mut text).ok()?;
        serde_json::from_slice(&text).ok()
    }

    /// Removes the record of `name` and leaves its files: while they are replaced, no record describes them.
    pub(super) fn take(out: &Path, name: &str) -> Option<Self> {
        let old = Self::read(out, name)?;
        let _ = fs::remove_file(record_path(out, name));
        Some(old)
    }

    /// Puts a record back whose files still fit it.
    pub(super) fn put_back(&self, out: &Path, name: &str) -> bool {
        self.name == name && self.is_whole(out) && self.write(out).is_ok()
    }

    /// True for the record of `name` whose files are there.
    pub(super) fn is_of(&self, name: &str, out: &Path) -> bool {
        self.name == name
            && !name.contains('/')
            && self.model.file == format!("{name}.oct")
            && self.is_whole(out)
    }

    /// Removes the files that it names, except those of the model that replaced it.
    pub(super) fn remove_files(&self, out: &Path, name: &str, now: Option<&ModelFacts>) {
        let files = |model: &'_ ModelFacts| [Some(model.file.clone()), model.thumbnail.clone()];
        let kept = now.map(files).unwrap_or_default();
        let is_kept = |file: &String| kept.iter().flatten().any(|kept| kept == file);
        // A record may be tampered with: names that lead elsewhere are not followed.
        let own = |file: &String| file.starts_with(name) && !file.contains('/');
        for file in files(&self.model).into_iter().flatten().filter(|file| own(file) && !is_kept(file)) {
            let _ = fs::remove_file(out.join(file));
        }
    }

    pub(super) fn write(&self, out: &Path) -> io::Result<()> {
        let file = AtomicFile::create(&record_path(out, &self.name))?;
        file.file().write_all(&serde_json::to_vec_pretty(self)?)?;
        file.commit()
    }

    /// True if its files are still there, with unchanged lengths.
    pub(super) fn is_whole(&self, out: &Path) -> bool {
        let length = |name: &str| fs::metadata(out.join(name)).map_or(0, |meta| meta.len());
        length(&self.model.file) == self.model.bytes
            && self.model.thumbnail.as_ref().is_none_or(|file| length(file) == self.thumbnail_bytes)
    }
}

/// The items of this run, in an unnamed file; 32 bytes of memory for each.
pub(super) struct Journal(Mutex<(Appended, Vec<JournalEntry>)>);

#[derive(Clone, Copy, Debug)]
struct JournalEntry {
    /// Item of the catalogue, and volume in it: the order of reports.
    order: (usize, usize),
    offset: u64,
    len: usize,
}

/// Bytes of items that wait in memory.
const JOURNAL_BYTES: usize = 16 << 10;

impl Journal {
    pub(super) fn new(folder: &Path) -> Self {
        Self(Mutex::new((Appended::new(folder, JOURNAL_BYTES), Vec::new())))
    }

    pub(super) fn add(&self, order: (usize, usize), item: &Item) -> io::Result<()> {
        let text = serde_json::to_vec(item)?;
        let (texts, index) = &mut *self.0.lock().unwrap_or_else(PoisonError::into_inner);
        index.push(JournalEntry { order, offset: texts.push(&text)?, len: text.len() });
        Ok(())
    }

    /// Calls `work` with every item in the order of the catalogue, whatever order they were finished in.
    pub(super) fn for_each(&self, work: &mut dyn FnMut(Item) -> io::Result<()>) -> io::Result<()> {
        let (texts, places) = &mut *self.0.lock().unwrap_or_else(PoisonError::into_inner);
        crate::order::by_key(places, |place| place.order);
        for place in places {
            let mut text = vec![0; place.len];
            texts.read_at(&mut text, place.offset)?;
            work(serde_json::from_slice(&text)?)?;
        }
        Ok(())
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub(in crate::jobs::batch) fn item(name: &str) -> Item {
        Item {
            status: Status::Converted,
            name: name.into(),
            input: format!("folder/{name}.nrrd"),
            format: "nrrd".into(),
            kind: "nrrd".into(),
            files: 1,
            input_bytes: 1000,
            warnings: vec!["a \"quoted\", <odd> one".into()],
            model: Some(ModelFacts {
                file: format!("{name}.oct"),
                thumbnail: None,
                dims: [3, 4, 5],
                spacing_mm: [0.5, 0.5, 2.0],
                dtype: "i16".into(),
                range: (300.0, None),
                selection: "otsu".into(),
                skin_voxels: 10,
                label_count: 0,
                nodes: 7,
                bytes: 5,
                wall_s: 0.25,
                memory_bytes: 1 << 20,
                memory_plan_bytes: 1 << 19,
                scratch_bytes: 0,
            }),
            ..Item::default()
        }
    }

    #[test]
    fn a_record_comes_back_and_notices_missing_files() {
        let out = tempfile::tempdir().unwrap();
        let record = Record::of(&item("a"), "f", "3", 0).unwrap();
        record.write(out.path()).unwrap();
        let read = Record::read(out.path(), "a").unwrap();
        assert_eq!((&*read.options, &*read.inputs, &read.model), ("f", "3", &record.model));
        let text = fs::read_to_string(record_path(out.path(), "a")).unwrap();
        assert!(!text.contains("folder/") && !text.contains("quoted"), "{text}");
        assert!(!read.is_whole(out.path()));
        fs::write(out.path().join("a.oct"), [0; 5]).unwrap();
        assert!(read.is_whole(out.path()));
        fs::write(out.path().join("a.oct"), [0; 4]).unwrap();
        assert!(!read.is_whole(out.path()));
        fs::write(record_path(out.path(), "b"), b"{ \"version\": ").unwrap();
        assert!(Record::read(out.path(), "b").is_none() && Record::read(out.path(), "c").is_none());
    }

    #[test]
    fn the_journal_gives_items_in_order() {
        let folder = tempfile::tempdir().unwrap();
        let journal = Journal::new(folder.path());
        for (at, name) in [((2, 0), "c"), ((0, 1), "b"), ((0, 0), "a")] {
            journal.add(at, &item(name)).unwrap();
        }
        let mut names = String::new();
        journal
            .for_each(&mut |item| {
                names += &item.name;
                Ok(())
            })
            .unwrap();
        assert_eq!(names, "abc");
    }
}
