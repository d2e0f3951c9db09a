//! What a batch remembers of each volume: a record beside its model, by which a later run sees that the
//! work is done, and the journal of this run, from which reports are written.

use std::fs::{self, File};
use std::io::{self, BufReader, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use serde::{Deserialize, Serialize};

use crate::atomic::AtomicFile;
use crate::exit::ExitKind;
use crate::platform::FileExt;
use crate::scratch::nameless;
use crate::source::BurnedIn;

/// What became of a volume.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Status {
    /// Built in this run.
    Converted,
    /// Built before, from the same files with the same options; or, without a model, left alone as asked.
    Skipped,
    /// Refused, or its build failed.
    Failed,
    /// Built by an earlier run, and still there; this run did not come across it.
    Kept,
}

/// Why there is no model, in a word that names nothing.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Cause {
    /// It has fewer slices than were asked for.
    FewSlices,
    /// It is not of the modalities or series that were asked for.
    NotAskedFor,
    /// It is a copy of the volume of this name.
    CopyOf(String),
    /// The input cannot be used.
    Input,
    /// No voxel is inside.
    Empty,
    /// It takes more memory than there is.
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

/// One volume of a batch, as reported. It tells where the volume lies, and stays with whoever has that.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Item {
    /// What became of it.
    pub status: Status,
    /// Its id: the name of its files in the output folder, without extension.
    pub name: String,
    /// The file, or the folder of the files, as it was reached from what was searched.
    pub input: String,
    /// Kind of source.
    pub format: String,
    /// What it is: `CT image`, ...; the kind of source again where nothing more is known.
    pub kind: String,
    /// Which part of its input it is, where that holds several volumes; or empty.
    pub part: String,
    /// Files read.
    pub files: u64,
    /// Their bytes.
    pub input_bytes: u64,
    /// Why its pixels may carry text, if there is a reason to think so.
    pub burned_in: Option<BurnedIn>,
    /// Why it failed, or was left alone, in short.
    pub cause: Option<Cause>,
    /// The same in a sentence, which may name files.
    pub reason: Option<String>,
    /// Sentences about the input.
    pub warnings: Vec<String>,
    /// The model, if there is one.
    pub model: Option<ModelFacts>,
}

impl Item {
    /// What is reported where opening an item of the catalogue met a defect of the program.
    pub(super) fn of_defect(at: usize) -> Self {
        Self {
            status: Status::Failed,
            name: format!("defect-{}", at + 1),
            input: format!("entry {} of the search", at + 1),
            format: String::new(),
            kind: String::new(),
            part: String::new(),
            files: 0,
            input_bytes: 0,
            burned_in: None,
            cause: Some(Cause::Defect),
            reason: Some("an internal error stopped the reading of its headers; please report it".into()),
            warnings: Vec::new(),
            model: None,
        }
    }
}

/// What is reported of a finished model.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ModelFacts {
    /// File name of the model.
    pub file: String,
    /// File name of its thumbnail.
    pub thumbnail: Option<String>,
    /// Size in voxels.
    pub dims: [u32; 3],
    /// Distance of neighbours in mm.
    pub spacing_mm: [f64; 3],
    /// Type of the samples.
    pub dtype: String,
    /// Values inside, in physical units; no upper end means all from the lower one.
    pub range: (f64, Option<f64>),
    /// How these were chosen: `iso`, `range` or `otsu`; empty in records of older versions.
    #[serde(default)]
    pub selection: String,
    /// Skin voxels.
    pub skin_voxels: u64,
    /// Infobytes.
    pub nodes: u64,
    /// Bytes of the model.
    pub bytes: u64,
    /// Seconds from opening the input to the finished thumbnail.
    pub wall_s: f64,
    /// Memory that the job was granted.
    pub memory_bytes: u64,
    /// Most of it that the build had in use at a time; 0 in records of older versions.
    #[serde(default)]
    pub memory_plan_bytes: u64,
    /// Bytes of scratch files.
    pub scratch_bytes: u64,
}

/// A record on disk, beside its model, with which it travels: what the model is, and what it was made of. It
/// names no file but the model's own, and no folder, and holds no sentence.
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
const MOST_RECORD_BYTES: u64 = 64 << 10;

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

    /// Reads the record of `name`, if there is one that can be read.
    pub(super) fn read(out: &Path, name: &str) -> Option<Self> {
        let file = File::open(record_path(out, name)).ok()?;
        serde_json::from_reader(BufReader::new(file.take(MOST_RECORD_BYTES))).ok()
    }

    /// Takes the record of `name` away and leaves its files: while they are replaced, no record tells of them.
    pub(super) fn take(out: &Path, name: &str) -> Option<Self> {
        let old = Self::read(out, name)?;
        let _ = fs::remove_file(record_path(out, name));
        Some(old)
    }

    /// Puts a record back whose files are still what it tells of.
    pub(super) fn put_back(&self, out: &Path, name: &str) -> bool {
        self.name == name && self.is_whole(out) && self.write(out).is_ok()
    }

    /// Is it the record of `name`, and are its files there?
    pub(super) fn is_of(&self, name: &str, out: &Path) -> bool {
        self.name == name
            && !name.contains('/')
            && self.model.file == format!("{name}.oct")
            && self.is_whole(out)
    }

    /// What it tells of the model.
    pub(super) fn into_model(self) -> ModelFacts {
        self.model
    }

    /// Removes the files that a record tells of, and the record first of all; without a record, nothing.
    pub(super) fn clear(out: &Path, name: &str) {
        if let Some(old) = Self::take(out, name) {
            old.remove_files(out, name, None);
        }
    }

    /// Removes the files that it tells of, but for those that what was built in its place has, too.
    pub(super) fn remove_files(&self, out: &Path, name: &str, now: Option<&ModelFacts>) {
        let files = |model: &'_ ModelFacts| [Some(model.file.clone()), model.thumbnail.clone()];
        let kept = now.map(files).unwrap_or_default();
        let is_kept = |file: &String| kept.iter().flatten().any(|kept| kept == file);
        // A record is a file like any other: names that lead elsewhere are not followed.
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

    /// Are the files that it tells of still there, and as long as they were?
    pub(super) fn is_whole(&self, out: &Path) -> bool {
        let length = |name: &str| fs::metadata(out.join(name)).map_or(0, |meta| meta.len());
        length(&self.model.file) == self.model.bytes
            && self.model.thumbnail.as_ref().is_none_or(|file| length(file) == self.thumbnail_bytes)
    }
}

/// The items of this run, in a nameless file; 32 bytes of memory for each.
#[derive(Debug)]
pub(super) struct Journal {
    file: File,
    index: Mutex<Vec<Place>>,
}

#[derive(Clone, Copy, Debug)]
struct Place {
    /// Item of the catalogue, and volume in it: the order of reports.
    order: (usize, usize),
    offset: u64,
    len: usize,
}

impl Journal {
    pub(super) fn create(folder: &Path) -> io::Result<Self> {
        Ok(Self { file: nameless(folder)?, index: Mutex::default() })
    }

    pub(super) fn add(&self, order: (usize, usize), item: &Item) -> io::Result<()> {
        let text = serde_json::to_vec(item)?;
        let mut index = self.index.lock().unwrap_or_else(PoisonError::into_inner);
        let offset = index.last().map_or(0, |place| place.offset + place.len as u64);
        self.file.write_all_at(&text, offset)?;
        index.push(Place { order, offset, len: text.len() });
        Ok(())
    }

    /// Every item, in the order of the catalogue, whatever order they were finished in.
    pub(super) fn for_each(&self, work: &mut dyn FnMut(Item) -> io::Result<()>) -> io::Result<()> {
        let mut places = self.index.lock().unwrap_or_else(PoisonError::into_inner).clone();
        places.sort_by_key(|place| place.order);
        for place in places {
            let mut text = vec![0; place.len];
            self.file.read_exact_at(&mut text, place.offset)?;
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
            part: String::new(),
            files: 1,
            input_bytes: 1000,
            burned_in: None,
            cause: None,
            reason: None,
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
                nodes: 7,
                bytes: 5,
                wall_s: 0.25,
                memory_bytes: 1 << 20,
                memory_plan_bytes: 1 << 19,
                scratch_bytes: 0,
            }),
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
        let journal = Journal::create(folder.path()).unwrap();
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
