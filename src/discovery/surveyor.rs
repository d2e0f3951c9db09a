//! Classifies each file below some folders, and gathers those that make one item of a [`Catalogue`].
//!
//! [`Catalogue`]: super::Catalogue

use std::collections::HashMap;
use std::fs::{self, Metadata};
use std::io;
use std::path::{Path, PathBuf};

use super::item::{Item, ItemKind, Weight};
use super::kind::{ends_in, open_with_head, solid_kind};
use super::left_out::{LeftOutFiles, NotVolume, said};
use super::log::{Log, Record, changed};
use super::order::{full_path, precedes};
use super::{placing, sidecar};
use crate::picture_mark::is_own_picture;
use crate::platform::{OsStrExt, below};
use crate::source::dicom::{Recognition, recognise};
use crate::source::{
    FORMATS, OpenOptions, STACKS, StableHash, SubjectKind, is_of_zarr_group, known, zarr_head,
};
use crate::synthetic;
use crate::text::names::{GRID, VOXEL};
use crate::text::plain_head;
use crate::volume::{Result, SourceError};

/// A catalogue in the making.
pub(super) struct Surveyor<'a> {
    inputs: &'a [PathBuf],
    options: &'a OpenOptions,
    /// Items in the order of the walk.
    pub(super) items: Vec<Item>,
    pub(super) log: Log,
    pub(super) left_out: LeftOutFiles,
    /// Items that take more than one file, by their kind and a hash of their key.
    index: HashMap<(ItemKind, u64), u32>,
}

/// Class of a file.
enum Class {
    /// A volume of its own, or with `Some` key a part of one.
    Item(ItemKind, Option<u64>, Weight),
    LeftOut(NotVolume),
    /// Part of an item that is counted elsewhere.
    Part,
}

impl<'a> Surveyor<'a> {
    /// A surveyor without findings; names will wait in an anonymous file in `scratch`.
    pub(super) fn new(inputs: &'a [PathBuf], options: &'a OpenOptions, scratch: &Path) -> Self {
        Self {
            inputs,
            options,
            items: Vec::new(),
            log: Log::new(scratch),
            left_out: LeftOutFiles::new(scratch),
            index: HashMap::new(),
        }
    }

    fn path(&self, input: u32, path: &Path) -> PathBuf {
        full_path(self.inputs, &Record::of(input, path))
    }

    fn classify(&mut self, path: &Path, meta: &Metadata, named: bool) -> Result<Class> {
        let left_out = |why: NotVolume| Ok(Class::LeftOut(why));
        if meta.len() == 0 {
            return left_out(said("empty file"));
        }
        // A file that was named must be readable; one met in a folder is only reported.
        let unreadable = |cause: io::Error| {
            if named {
                return Err(SourceError::unreadable(path, cause));
            }
            left_out(said(format!("cannot be read ({})", cause.kind())))
        };
        let (file, head) = match open_with_head(path) {
            Ok(opened) => opened,
            Err(cause) => return unreadable(cause),
        };
        match recognise(&file) {
            Recognition::Image { series, frames, opening_bytes } => {
                let folder = path.parent().unwrap_or(Path::new(""));
                let folder = folder.as_os_str().as_bytes();
                // Images that name no series belong to the others of their folder.
                let key = if series.is_empty() {
                    StableHash::new().part(b"folder").part(folder)
                } else {
                    StableHash::new().part(b"series").part(series.as_bytes())
                };
                return Ok(Class::Item(
                    ItemKind::Series,
                    Some(key.finish()),
                    Weight { images: frames, opening_bytes },
                ));
            }
            Recognition::NoImage(kind) => return left_out(said(kind.to_string())),
            Recognition::Damaged(_) => return Ok(Class::Item(ItemKind::Damaged, None, Weight::FILE)),
            Recognition::Unreadable(cause) => return unreadable(cause),
            Recognition::Foreign => {}
        }
        let index = |at: usize| u8::try_from(at).unwrap_or(u8::MAX);
        if let Some(at) = FORMATS.iter().position(|f| (f.recognise)(&plain_head(&head), path)) {
            return Ok(Class::Item(ItemKind::Format(index(at)), None, Weight::FILE));
        }
        if let Some(at) = STACKS.iter().position(|f| (f.recognise)(&head, path)) {
            // A file given by name is meant, even if the program made it.
            if !named && is_own_picture(&head) {
                return left_out(said("picture of a model"));
            }
            let folder = path.parent().map(|p| p.as_os_str().as_bytes()).unwrap_or_default();
            let key = StableHash::new().part(folder).finish();
            return Ok(Class::Item(ItemKind::Stack(index(at)), Some(key), Weight::FILE));
        }
        match solid_kind(&head, meta.len(), path) {
            Some(SubjectKind::Mesh) if self.options.meshes => {
                return Ok(Class::Item(ItemKind::Mesh, None, Weight::FILE));
            }
            Some(SubjectKind::Tree) if self.options.meshes => {
                return Ok(Class::Item(ItemKind::Tree, None, Weight::of_text(meta.len())));
            }
            Some(SubjectKind::Volume) | None => {}
            Some(kind) => {
                let what = if kind == SubjectKind::Mesh { "triangle mesh" } else { "tree of solids" };
                return left_out(said(format!("a {what}, which is taken with {GRID} N or {VOXEL} MM only")));
            }
        }
        if is_of_zarr_group(path) {
            return Ok(Class::Part);
        }
        if let Some(what) = known(&head) {
            return left_out(said(what));
        }
        if sidecar::is_named_so(path) {
            if sidecar::read(path).is_some() {
                if sidecar::is_outdone(path) {
                    return left_out(said("another side-car describes the same data"));
                }
                return Ok(Class::Item(ItemKind::Sidecar, None, Weight::FILE));
            }
            if let Some(unparsed) = sidecar::unparsed(path).or_else(|| sidecar::incomplete(path)) {
                return left_out(NotVolume::SideCar(unparsed));
            }
        }
        if sidecar::describes(path) || placing::places(path) || is_detached_data(path) {
            return Ok(Class::Part);
        }
        if let Some(raw) = &self.options.raw {
            let expected = raw.dims.voxels() * raw.scalar.bytes() as u64;
            if named || expected.checked_add(raw.skip) == Some(meta.len()) {
                return Ok(Class::Item(ItemKind::Raw, None, Weight::FILE));
            }
        }
        let is_headerless = ends_in(path, &["raw", "vol", "bin"]);
        left_out(if is_headerless { NotVolume::Headerless } else { NotVolume::Unknown })
    }

    fn add(&mut self, (what, key): (ItemKind, Option<u64>), weight: Weight, mut record: Record) -> Result {
        let known = key.and_then(|key| self.index.get(&(what, key))).copied();
        let item = known.and_then(|at| self.items.get_mut(at as usize));
        let Some(item) = item else {
            let at = self.log.push(&record)?;
            if let (Some(key), Ok(index)) = (key, u32::try_from(self.items.len())) {
                self.index.insert((what, key), index);
            }
            self.items.push(Item { what, last: at, first: at, files: 1, weight });
            return Ok(());
        };
        let comes_first = precedes(self.inputs, &record, &self.log.get(item.first)?).is_lt();
        record.before = item.last;
        item.last = self.log.push(&record)?;
        item.files = item.files.saturating_add(1);
        item.weight = item.weight.and(weight);
        if comes_first {
            item.first = item.last;
        }
        Ok(())
    }

    /// Takes in a file, by its path below the input (empty when the input itself is the file).
    ///
    /// # Errors
    /// It was named and cannot be read, or the disk failed.
    pub(super) fn file(&mut self, input: u32, path: &Path, meta: &Metadata) -> Result {
        let full = self.path(input, path);
        match self.classify(&full, meta, path.as_os_str().is_empty())? {
            Class::Part => Ok(()),
            Class::LeftOut(why) => self.left_out.add(why, full),
            Class::Item(what, key, weight) => {
                let (size, changed) = (meta.len(), changed(meta));
                let record = Record { size, changed, ..Record::of(input, path) };
                self.add((what, key), weight, record)
            }
        }
    }

    /// Takes in a volume that an input describes, without a file.
    ///
    /// # Errors
    /// The description is wrong, or the disk failed.
    pub(super) fn synthetic(&mut self, input: u32) -> Result {
        let text = self.path(input, Path::new(""));
        if self.options.raw.is_some() {
            return Err(synthetic::described().at(&text).into());
        }
        // Reported at once, like a file that is not there.
        synthetic::open(&text)?;
        self.add((ItemKind::Synthetic, None), Weight::FILE, Record::of(input, Path::new("")))
    }

    /// True for a folder that must not be entered: the one to skip, or slices of one item.
    pub(super) fn takes_folder(&self, input: u32, path: &Path) -> bool {
        let full = self.path(input, path);
        let is_skipped = self.options.skip.as_ref().is_some_and(|skip| {
            skip.file_name() == path.file_name() && full.canonicalize().is_ok_and(|real| real == *skip)
        });
        // Slice files may be described by a side-car next to their folder.
        is_skipped || sidecar::describes(&full)
    }

    /// The file that makes a folder a volume in chunks, which are not visited one by one.
    pub(super) fn chunks(&self, input: u32, path: &Path) -> Option<(PathBuf, Metadata)> {
        let head = zarr_head(&self.path(input, path))?;
        let meta = fs::metadata(&head).ok()?;
        Some((below(path, head.file_name()?.as_ref()), meta))
    }

    /// Leaves out a folder that may not be read, or that lies too deep.
    pub(super) fn not_entered(&mut self, path: &Path, why: NotVolume) {
        // The count is kept even if the name cannot be stored.
        let _ = self.left_out.add(why, path.to_path_buf());
    }
}

/// True if the file holds the voxels of a header file of the same stem.
fn is_detached_data(path: &Path) -> bool {
    ends_in(path, &["raw", "zraw", "img", "gz", "bz2", "bin", "dat"])
        && ["nhdr", "mhd", "hdr"].iter().any(|e| path.with_extension(e).is_file())
}
