//! One item of a catalogue: the data to open it, and its subjects.

use std::path::{Path, PathBuf};

use super::Catalogue;
use super::content::EachFile;
use super::kind::open_with_head;
use super::log::{Record, add_file};
use super::order::full_path;
use super::placing::placing_of;
use super::sidecar;
use crate::budget::costs;
use crate::csg;
use crate::fault::bad;
use crate::mesh;
use crate::platform::{OsStrExt, PositionalFile};
use crate::source::dicom::{Recognition, open_series, recognise};
use crate::source::{FORMATS, FileList, Finding, InputFiles, RawVolume, STACKS, Slices, StableHash, Subject};
use crate::synthetic;
use crate::volume::{Result, SourceError, SourceFault, VolumeSource};

/// One series, stack or file.
#[derive(Clone, Copy, Debug)]
pub(super) struct Item {
    pub(super) what: ItemKind,
    /// Head of its chain in the log.
    pub(super) last: u64,
    /// Record of its first path; items are in the order of these.
    pub(super) first: u64,
    pub(super) files: u32,
    pub(super) weight: Weight,
}

/// Cost of opening an item.
#[derive(Clone, Copy, Debug)]
pub(super) struct Weight {
    /// Files, or the frames in them.
    pub(super) images: u32,
    /// Approximate memory that is taken for a moment, in bytes.
    pub(super) opening_bytes: u64,
}

impl Weight {
    /// A file without further knowledge.
    pub(super) const FILE: Self = Self { images: 1, opening_bytes: costs::OPENING_FRAME };

    /// A text of `bytes` bytes, which is held as a tree while it is read.
    pub(super) fn of_text(bytes: u64) -> Self {
        Self { images: 1, opening_bytes: Self::FILE.opening_bytes.saturating_add(bytes.saturating_mul(8)) }
    }

    pub(super) fn and(self, other: Self) -> Self {
        Self {
            images: self.images.saturating_add(other.images),
            opening_bytes: self.opening_bytes.saturating_add(other.opening_bytes),
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum ItemKind {
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
    /// The text of a tree of solids.
    Tree,
    /// The description of a computed volume, without a file.
    Synthetic,
}

/// The id of a subject of some format, by the content of its files.
pub(super) type Name<'a> = &'a dyn Fn(&'static str, EachFile<'_>) -> String;

/// Volumes of one file or folder.
pub(super) type Volumes = Result<Vec<Box<dyn VolumeSource>>>;

impl Catalogue {
    /// The subjects of an item.
    ///
    /// # Errors
    /// Nothing of it can be opened; with its path.
    pub(super) fn open_item(
        &self,
        item: &Item,
        name: Name<'_>,
    ) -> Result<Vec<Finding>, (PathBuf, SourceError)> {
        let first = self.log.get(item.first).map_err(|e| (PathBuf::new(), e))?;
        let path = full_path(&self.inputs, &first);
        let opening = ItemOpener { of: self, item, name, path: &path, first: &first };
        opening.open().map_err(|e| (path.clone(), e))
    }

    /// Files of an item in natural order, with size and time of change of each.
    fn list(&self, item: &Item) -> Result<(FileList, Vec<(u64, u64)>)> {
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
}

/// An item that is being opened.
struct ItemOpener<'a> {
    of: &'a Catalogue,
    item: &'a Item,
    name: Name<'a>,
    /// The file that comes first.
    path: &'a Path,
    first: &'a Record,
}

impl ItemOpener<'_> {
    fn open(&self) -> Result<Vec<Finding>> {
        let Weight { images, opening_bytes: needed_bytes } = self.item.weight;
        let allowed_bytes = self.allowed_bytes();
        // Memory for one image is always granted.
        if needed_bytes > allowed_bytes && images > 1 {
            let (path, images) = (self.path.to_path_buf(), images.into());
            return Err(SourceFault::ManyImages { path, images, needed_bytes, allowed_bytes }.into());
        }
        Ok(match self.item.what {
            ItemKind::Series => {
                let (list, facts) = self.of.list(self.item)?;
                open_series(list, &facts, &self.of.options)
            }
            ItemKind::Damaged => {
                let error = match PositionalFile::open(self.path).map(|file| recognise(&file)) {
                    Err(cause) => SourceError::unreadable(self.path, cause),
                    Ok(Recognition::Damaged(error)) => bad!("{error}").at(self.path).into(),
                    Ok(_) => changed_meanwhile(self.path),
                };
                findings(self.path, "dicom", self.id("dicom"), self.one(), Err(error))
            }
            ItemKind::Format(at) => self.format(usize::from(at)),
            ItemKind::Stack(at) => self.stack(usize::from(at))?,
            ItemKind::Sidecar => {
                let opened = sidecar::open(self.path, None, &self.of.options).map(|v| vec![v]);
                let files = self.with_samples(&opened);
                let id = (self.name)("raw", &|each| self.each_source(&opened, each));
                findings(self.path, "raw", id, files, opened)
            }
            ItemKind::Raw => match &self.of.options.raw {
                Some(raw) => {
                    let volume = RawVolume::open(&[self.path.to_path_buf()], raw);
                    let opened = volume.map(|v| vec![Box::new(v) as _]);
                    findings(self.path, "raw", self.id("raw"), self.one(), opened)
                }
                None => Vec::new(),
            },
            ItemKind::Mesh => vec![self.mesh()?],
            ItemKind::Tree => vec![self.tree()],
            ItemKind::Synthetic => {
                let hash = StableHash::new().part(self.path.as_os_str().as_bytes()).finish();
                let files = InputFiles { fingerprint: hash, ..InputFiles::default() };
                let id = format!("synthetic-{:012x}", hash >> 16);
                let opened = synthetic::open(self.path).map(|volume| vec![volume]);
                findings(self.path, "synthetic", id, files, opened)
            }
        })
    }

    fn allowed_bytes(&self) -> u64 {
        self.of.options.opening_bytes.unwrap_or(u64::MAX)
    }

    /// The id by the content of its only file.
    fn id(&self, format: &'static str) -> String {
        (self.name)(format, &|each| each(self.path))
    }

    /// The fingerprint of its only file.
    fn one(&self) -> InputFiles {
        let mut files = InputFiles::default();
        files.add(self.path, self.first.size, self.first.changed);
        files
    }

    /// The fingerprint of a header and its data files: samples may change without it.
    fn with_samples(&self, opened: &Volumes) -> InputFiles {
        let mut files = self.one();
        each_sample(self.path, opened, &mut |data| {
            // Missing samples are reported where they are read.
            let _missing = add_file(&mut files, data);
        });
        files
    }

    /// The file that leads to a volume, and its files of samples.
    fn each_source(&self, opened: &Volumes, each: &mut dyn FnMut(&Path)) {
        each(self.path);
        each_sample(self.path, opened, each);
    }

    fn format(&self, at: usize) -> Vec<Finding> {
        let Some(format) = FORMATS.get(at) else { return Vec::new() };
        let mut opened = (format.open)(self.path, &self.of.options);
        let mut files = self.with_samples(&opened);
        let stated = format.states_no_place.then(|| placing_of(&[self.path])).flatten();
        let id = (self.name)(format.name, &|each| {
            self.each_source(&opened, each);
            stated.iter().for_each(|stated| each(&stated.path));
        });
        if let Some(stated) = stated {
            opened = stated.place(opened, &mut files);
        }
        findings(self.path, format.name, id, files, opened)
    }

    fn stack(&self, at: usize) -> Result<Vec<Finding>> {
        let (list, facts) = self.of.list(self.item)?;
        let folder = self.path.parent().unwrap_or(Path::new("")).to_path_buf();
        let names = list.select(0..list.len());
        let Some(format) = STACKS.get(at) else { return Ok(Vec::new()) };
        let mut found = Vec::new();
        for Slices { files: used, volumes } in (format.open)(list, &self.of.options) {
            let mut files = InputFiles::default();
            for at in &used {
                let (size, changed) = facts.get(*at).copied().unwrap_or_default();
                files.add(names.name(*at), size, changed);
            }
            let path = match used.as_slice() {
                [only] => names.path(*only),
                _ => folder.clone(),
            };
            let stated = placing_of(&[&path, &folder]);
            let id = (self.name)(format.name, &|each| {
                used.iter().for_each(|at| each(&names.path(*at)));
                stated.iter().for_each(|stated| each(&stated.path));
            });
            let volumes = match stated {
                Some(stated) => stated.place(volumes, &mut files),
                None => volumes,
            };
            found.extend(findings(&path, format.name, id, files, volumes));
        }
        Ok(found)
    }

    fn mesh(&self) -> Result<Finding> {
        let opened = open_with_head(self.path);
        let (_, head) = opened.map_err(|cause| SourceError::unreadable(self.path, cause))?;
        // It was a mesh when its folder was searched.
        let format = mesh::format_of(&head, self.first.size, self.path);
        let format = format.ok_or_else(|| changed_meanwhile(self.path))?;
        let checked = mesh::check(self.path, self.of.options.follow_links);
        let subject = checked.map(|()| Subject::Mesh(vec![self.path.to_path_buf()]));
        let finding = Finding::new(self.path, format, self.id(format), self.one(), subject);
        Ok(Finding { kind: "triangle mesh".into(), ..finding })
    }

    fn tree(&self) -> Finding {
        let named = csg::named_files(self.path, self.allowed_bytes(), self.of.options.follow_links);
        let mut files = self.one();
        let all_there = named.and_then(|named| {
            for path in &named {
                add_file(&mut files, path).map_err(|cause| SourceError::unreadable(path, cause))?;
            }
            Ok(named)
        });
        let id = (self.name)("csg", &|each| {
            each(self.path);
            // A folder has no bytes to read.
            let named = all_there.iter().flatten().filter(|path| path.is_file());
            named.for_each(|path| each(path));
        });
        let subject = all_there.map(|_| Subject::Tree(self.path.to_path_buf()));
        let finding = Finding::new(self.path, "csg", id, files, subject);
        Finding { kind: "tree of solids".into(), ..finding }
    }
}

/// The files of samples other than the one that leads to them.
fn each_sample(path: &Path, opened: &Volumes, each: &mut dyn FnMut(&Path)) {
    if let Some(volume) = opened.as_ref().ok().and_then(|all| all.first()) {
        volume.for_each_file(&mut |data| {
            if data != path {
                each(data);
            }
        });
    }
}

/// The error of a file that changed after its folder was searched.
pub(super) fn changed_meanwhile(path: &Path) -> SourceError {
    bad!("was changed while the folders were searched; start again").at(path).into()
}

/// The volumes of one file or folder.
fn findings(
    path: &Path,
    format: &'static str,
    id: String,
    files: InputFiles,
    opened: Volumes,
) -> Vec<Finding> {
    let several = opened.as_ref().is_ok_and(|volumes| volumes.len() != 1);
    let found = match opened {
        Err(error) => vec![Err(error)],
        Ok(volumes) => volumes.into_iter().map(|volume| Ok(Subject::Volume(volume))).collect(),
    };
    let of = |(i, subject): (usize, Result<Subject>)| {
        if !several {
            return Finding::new(path, format, id.clone(), files, subject);
        }
        let part = Some(format!("volume {}", i + 1));
        Finding { part, ..Finding::new(path, format, format!("{id}-{}", i + 1), files, subject) }
    };
    found.into_iter().enumerate().map(of).collect()
}
