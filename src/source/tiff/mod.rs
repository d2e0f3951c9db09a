//! TIFF pictures as slices: the pages of one file, or one page in each of several.
//!
//! Classic and BigTIFF, either byte order; grey values of 8, 16, 32 or 64 bits in strips or tiles, packed
//! with LZW, deflate, PackBits or not at all. Pages whose strips lie side by side are read by position, and
//! so is the one long strip of an ImageJ stack over 4 GiB; all others are unrolled row by row, so that even
//! a page in one strip takes no more memory than a few of its rows. (The `tiff` crate decodes a strip at
//! once, which is a page for many writers; hence a reader of our own.)
//!
//! x runs along the rows, y down, z with the pages. Spacing comes from ImageJ's or OME's description; a bare
//! resolution is a guess of the writer about paper, and is not used.

mod directory;
mod notes;
mod raster;

use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::OpenOptions;
use super::files::{FileList, FileSet, base_name};
use super::formats::Slices;
use super::header::{unreadable, unusable};
use super::numbered::judge;
use super::payload::{DirectSamples, Samples, SliceOffsets, StoredVolume, Target, Unroll};
use crate::fault::{Fault, bad};
use crate::geom::{Affine, Dims};
use crate::platform::PositionalFile;
use crate::text::{Short, shown};
use crate::volume::{
    Endian, InfoOverride, Note, Rescale, Result, SourceDescription, SourceError, VolumeInfo, VolumeSource,
};
use directory::{Directory, Tiff, damaged};
use notes::Notes;
use raster::Raster;

/// Most directories of a file, thumbnails included.
const MAX_PAGES: usize = 2 * Dims::MAX_SIDE as usize;

/// Longest part of a description that is read; spacing and counts are at its start.
const MAX_DESCRIPTION: u64 = 64 << 10;

/// Greatest difference of spacings that are the same, as a part of them.
const SAME_SPACING: f64 = 1e-3;

/// Greatest expansion by LZW: bytes made of one; deflate and PackBits make fewer.
const MAX_EXPANSION: u64 = 4096;

const DESCRIPTION: u16 = 270;
const X_RESOLUTION: u16 = 282;
const Y_RESOLUTION: u16 = 283;
const SUBFILE_TYPE: u16 = 254;
const ORIENTATION: u16 = 274;

/// True for a TIFF picture.
pub(super) fn recognise(head: &[u8], _: &Path) -> bool {
    [b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"].iter().any(|magic| head.starts_with(*magic))
}

/// True if a file has several pages, as far as can be seen.
pub(super) fn is_whole(path: &Path) -> bool {
    let mut pages = Stack::default();
    match pages.add(path, 0) {
        Ok(()) => pages.pages.len() > 1,
        Err(_) => several_pages(path) == Some(true),
    }
}

/// Opens pictures: files with one page each make a volume together, and each with several pages is a volume
/// of its own, independent of the others.
pub(super) fn open(list: FileList, options: &OpenOptions) -> Vec<Slices> {
    let mut whole = Vec::new();
    let mut stack = Stack::default();
    let mut files = Vec::new();
    let mut refused: Option<SourceError> = None;
    // Files too damaged to count their pages.
    let mut unclear = Vec::new();
    for index in 0..list.len() {
        let path = list.path(index);
        let own = |volumes| Slices { files: vec![index], volumes };
        let mut pages = Stack::default();
        let added = pages.add(&path, 0);
        let several = if added.is_ok() { Some(pages.pages.len() > 1) } else { several_pages(&path) };
        match (added, several) {
            (Ok(()), Some(true)) => {
                let one = list.select(std::iter::once(index));
                whole.push(own(pages.volumes(one, base_name(&path))));
            }
            (Ok(()), _) => {
                files.push(index);
                if let Err(error) = stack.append(pages, files.len() - 1, &path) {
                    refused.get_or_insert(error);
                }
            }
            (Err(error), Some(true)) => whole.push(own(Err(error))),
            (Err(error), Some(false)) => {
                files.push(index);
                refused.get_or_insert(error);
            }
            (Err(error), None) => unclear.push((index, error)),
        }
    }
    // Files of unknown page count are taken for what most others are: a slice must not be missed, nor a volume take
    // others along.
    for (index, error) in unclear {
        if whole.len() > files.len() {
            whole.push(Slices { files: vec![index], volumes: Err(error) });
        } else {
            files.push(index);
            refused.get_or_insert(error);
        }
    }
    crate::order::by_key(&mut whole, |volume| volume.files.first().copied());
    files.sort_unstable();
    if files.is_empty() {
        return whole;
    }
    let judged = judge(list.select(files.iter().copied()), options.gaps);
    let volumes = judged.and_then(|(chosen, order)| {
        let path = chosen.path(0);
        let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let name = base_name(if chosen.len() == 1 { &path } else { folder });
        let stack = match refused {
            _ if chosen.len() < files.len() => Stack::of(&chosen)?,
            Some(error) => return Err(error),
            None => stack,
        };
        Ok(vec![order.apply(stack.volume(chosen, name)?)])
    });
    whole.insert(0, Slices { files, volumes });
    whole
}

/// True if an unusable file has several pages; `None` if that cannot be seen.
fn several_pages(path: &Path) -> Option<bool> {
    super::payload::regular(path).ok()?;
    let opened = PositionalFile::open(path).ok()?;
    let (tiff, mut offset) = Tiff::open(&opened).ok()?;
    let mut pages = 0;
    for _ in 0..MAX_PAGES {
        if offset == 0 {
            break;
        }
        let directory = match tiff.directory(offset) {
            Ok(directory) => directory,
            // There is one page, which points to another.
            Err(_) if pages > 0 => return Some(true),
            Err(_) => return None,
        };
        offset = directory.next;
        // A page with an unreadable type is not taken for a thumbnail.
        if tiff.value(&directory, SUBFILE_TYPE, 0).unwrap_or(0) & 1 == 1 {
            continue;
        }
        pages += 1;
        if pages > 1 || read_notes(&tiff, &directory).is_ok_and(|notes| notes.images > 1) {
            return Some(true);
        }
    }
    (pages == 1).then_some(false)
}

/// Properties that all slices of a volume share.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Shape {
    size: [u32; 2],
    samples: Samples,
}

/// One slice.
#[derive(Clone, Copy, Debug)]
struct Page {
    file: u32,
    /// Offset of its directory.
    offset: u64,
    /// Offset of its pixels, if stored plain.
    pixels: Option<u64>,
    endian: Endian,
}

/// Slices found so far.
#[derive(Clone, Debug, Default)]
struct Stack {
    pages: Vec<Page>,
    shape: Option<Shape>,
    spacing_mm: Option<[f64; 3]>,
    memory_bytes: u64,
    file_bytes: u64,
    inverted: bool,
    /// True if columns, and rows, are stored from the other end.
    backwards: Option<[bool; 2]>,
    thumbnails: usize,
    /// True if the pages of an ImageJ stack lay behind one directory.
    contiguous: bool,
    /// True if only the distance of slices is not stated.
    lacks_depth: bool,
    /// A unit of length that is stated and not known.
    unknown_unit: Option<String>,
    /// Slope and intercept of the values.
    calibration: Option<[f64; 2]>,
    /// The pages of each volume, where one file holds several.
    several: Option<Vec<Vec<usize>>>,
    /// Name of the first file that states the size of its voxels, and the number of files that do not.
    placed_by: Option<PathBuf>,
    unplaced: u32,
}

impl Stack {
    /// The pages of files that have one each.
    fn of(list: &FileList) -> Result<Self> {
        let mut stack = Self::default();
        for index in 0..list.len() {
            let path = list.path(index);
            let mut pages = Self::default();
            pages.add(&path, 0)?;
            stack.append(pages, index, &path)?;
        }
        Ok(stack)
    }

    /// Adds the pages of a file.
    fn add(&mut self, path: &Path, file: u32) -> Result {
        super::payload::regular(path)?;
        let added = PositionalFile::open(path).and_then(|opened| self.add_pages(&opened, file));
        added.map_err(|cause| unreadable(path, cause))
    }

    fn add_pages(&mut self, opened: &PositionalFile, file: u32) -> io::Result<()> {
        let (tiff, mut offset) = Tiff::open(opened)?;
        self.file_bytes = self.file_bytes.saturating_add(tiff.length);
        let mut seen = 0_usize;
        // Brent's way to notice a circle: the offset that all later ones are compared with moves on at
        // powers of two.
        let mut mark = (0, 1);
        let mut notes: Option<Notes> = None;
        while offset != 0 {
            if offset == mark.0 || seen >= MAX_PAGES {
                return Err(damaged(bad!("its pages follow each other in a circle")));
            }
            if seen == mark.1 {
                mark = (offset, seen * 2);
            }
            seen += 1;
            let directory = tiff.directory(offset)?;
            let here = offset;
            offset = directory.next;
            if tiff.value(&directory, SUBFILE_TYPE, 0)? & 1 == 1 {
                self.thumbnails += 1;
                continue;
            }
            self.page(&tiff, &directory, here, file)?;
            if notes.is_none() {
                notes = Some(read_notes(&tiff, &directory)?);
            }
        }
        let notes = notes.ok_or_else(|| damaged(bad!("it has no page")))?;
        self.spacing_mm = self.spacing_mm.or(notes.spacing_mm);
        self.lacks_depth |= notes.lacks_depth;
        self.unknown_unit = self.unknown_unit.take().or(notes.unknown_unit.clone());
        self.calibration = notes.calibration;
        self.contiguous(&tiff, notes.images)?;
        // One page of several files says nothing of the others.
        if self.pages.len() > 1 {
            self.several = notes.volumes(self.pages.len()).map_err(damaged)?;
        }
        Ok(())
    }

    fn page(&mut self, tiff: &Tiff<'_>, directory: &Directory, offset: u64, file: u32) -> io::Result<()> {
        let raster = Raster::read(tiff, directory)?;
        self.same(Shape { size: [raster.width, raster.height], samples: raster.samples }).map_err(damaged)?;
        let pixels = raster.placed(tiff)?;
        if let Some(at) = pixels
            && at.saturating_add(raster.bytes()) > tiff.length
        {
            return Err(damaged(bad!(
                "page {} needs {} bytes from byte {at} on, and the file has {}; copy it again",
                self.pages.len() + 1,
                raster.bytes(),
                tiff.length
            )));
        }
        self.memory_bytes = self.memory_bytes.max(raster.memory_bytes());
        self.inverted |= raster.inverted;
        self.turned(backwards(tiff.value(directory, ORIENTATION, 1)?).map_err(damaged)?).map_err(damaged)?;
        if self.pages.len() >= Dims::MAX_SIDE as usize {
            return Err(damaged(bad!("it has more than {} pages", Dims::MAX_SIDE)));
        }
        self.pages.push(Page { file, offset, pixels, endian: tiff.endian });
        Ok(())
    }

    /// Adds pictures of an ImageJ stack that have no directories of their own.
    fn contiguous(&mut self, tiff: &Tiff<'_>, images: u64) -> io::Result<()> {
        let [page] = self.pages.as_slice() else { return Ok(()) };
        let (first, Some(shape)) = (*page, self.shape) else { return Ok(()) };
        let Some(pixels) = first.pixels.filter(|_| images > 1) else { return Ok(()) };
        let bytes = u64::from(shape.size[0]) * u64::from(shape.size[1]) * shape.samples.bytes() as u64;
        if images > u64::from(Dims::MAX_SIDE) {
            return Err(damaged(bad!("its {images} images are out of range")));
        }
        let end = pixels.saturating_add(images.saturating_mul(bytes));
        if end > tiff.length {
            let length = tiff.length;
            return Err(damaged(bad!(
                "its description promises {images} images up to byte {end}, and the file has {length}; copy it again"
            )));
        }
        self.pages.extend((1..images).map(|i| Page { pixels: Some(pixels + i * bytes), ..first }));
        self.contiguous = true;
        Ok(())
    }

    /// Checks that a slice is of the same kind as those before.
    fn same(&mut self, shape: Shape) -> Result<(), Fault> {
        let first = *self.shape.get_or_insert(shape);
        if first == shape {
            return Ok(());
        }
        let told = |s: Shape| format!("{}x{} {}", s.size[0], s.size[1], s.samples.delivered().name());
        Err(bad!(
            "a page is {} where the first is {}; slices of a volume are alike in size and type, move the other away",
            told(shape),
            told(first)
        ))
    }

    /// Checks that a slice is stored from the same corner as those before.
    fn turned(&mut self, backwards: [bool; 2]) -> Result<(), Fault> {
        if *self.backwards.get_or_insert(backwards) == backwards {
            return Ok(());
        }
        Err(bad!("a page is stored from another corner than the first (Orientation); save all of them alike"))
    }

    /// Adds the slices of another file.
    fn append(&mut self, other: Self, number: usize, path: &Path) -> Result {
        let number = u32::try_from(number).unwrap_or(u32::MAX);
        self.check(&other).map_err(|fault| unusable(path, fault))?;
        self.calibration = other.calibration;
        self.pages.extend(other.pages.iter().map(|page| Page { file: number, ..*page }));
        self.unplaced += u32::from(other.place().is_none());
        if self.place().is_none() && other.place().is_some() {
            self.placed_by = path.file_name().map(PathBuf::from);
        }
        if self.spacing_mm.is_none() || self.lacks_depth {
            self.lacks_depth = other.lacks_depth;
            self.spacing_mm = other.spacing_mm.or(self.spacing_mm);
        }
        self.memory_bytes = self.memory_bytes.max(other.memory_bytes);
        self.file_bytes = self.file_bytes.saturating_add(other.file_bytes);
        self.inverted |= other.inverted;
        self.thumbnails += other.thumbnails;
        self.unknown_unit = self.unknown_unit.take().or(other.unknown_unit);
        Ok(())
    }

    /// Checks that the slices of another file belong to those before.
    fn check(&mut self, other: &Self) -> Result<(), Fault> {
        if let Some(shape) = other.shape {
            self.same(shape)?;
        }
        if let Some(backwards) = other.backwards {
            self.turned(backwards)?;
        }
        if !self.pages.is_empty() && self.calibration != other.calibration {
            return Err(bad!(
                "its values are calibrated otherwise than those before (c0, c1); save all of them alike"
            ));
        }
        let (Some(own), Some(theirs), Some(first)) = (self.place(), other.place(), &self.placed_by) else {
            return Ok(());
        };
        let (a, b) = (self.spacing_mm.unwrap_or_default(), other.spacing_mm.unwrap_or_default());
        let axes = if self.lacks_depth || other.lacks_depth { 2 } else { 3 };
        let is_same = a.iter().zip(b).take(axes).all(|(a, b)| (a - b).abs() <= SAME_SPACING * a.abs());
        if is_same && self.unknown_unit == other.unknown_unit {
            return Ok(());
        }
        Err(bad!(
            "states voxels of {theirs}, and {} states {own}; slices of a volume are alike in size, move the other away",
            shown(first)
        ))
    }

    /// The size of voxels or the unknown unit that the files state.
    fn place(&self) -> Option<String> {
        match (self.spacing_mm, &self.unknown_unit) {
            (Some([x, y, _]), _) if self.lacks_depth => Some(format!("{}x{} mm", Short(x), Short(y))),
            (Some([x, y, z]), _) => Some(format!("{}x{}x{} mm", Short(x), Short(y), Short(z))),
            (None, Some(unit)) => Some(format!("the unit `{}`", unit.escape_debug())),
            (None, None) => None,
        }
    }

    /// The volumes of one file.
    fn volumes(mut self, list: FileList, name: String) -> Result<Vec<Box<dyn VolumeSource>>> {
        let Some(several) = self.several.take() else { return Ok(vec![self.volume(list, name)?]) };
        let (of, all) = (several.len(), std::mem::take(&mut self.pages));
        let volume = |(at, pages): (usize, Vec<usize>)| {
            let pages = pages.iter().filter_map(|page| all.get(*page).copied()).collect();
            let own = Self { pages, ..self.clone() };
            let volume = own.volume(list.select(0..list.len()), name.clone())?;
            Ok(InfoOverride::with_note(
                volume,
                Note::new(format!("this is volume {} of {of} in the file", at + 1)),
            ))
        };
        several.into_iter().enumerate().map(volume).collect()
    }

    fn volume(self, list: FileList, name: String) -> Result<Box<dyn VolumeSource>> {
        let path = list.path(0);
        let refuse = |fault: Fault| unusable(&path, fault);
        let shape = self.shape.ok_or_else(|| refuse(bad!("has no page")))?;
        let nz = u32::try_from(self.pages.len()).unwrap_or(u32::MAX);
        let dims = Dims::new(shape.size[0], shape.size[1], nz)
            .ok_or_else(|| refuse(bad!("{nz} pages are out of range")))?;
        let bytes = dims.voxels() * shape.samples.bytes() as u64;
        if bytes > self.file_bytes.saturating_mul(MAX_EXPANSION) {
            return Err(refuse(bad!(
                "its pages promise {bytes} bytes, more than {} bytes of file can hold",
                self.file_bytes
            )));
        }
        let spacing_mm = self.spacing_mm.unwrap_or([1.0; 3]);
        let mut notes = Vec::new();
        if let Some(unit) = self.unknown_unit.as_ref().filter(|_| self.spacing_mm.is_none()) {
            let unit = unit.chars().take(40).collect::<String>();
            notes.push(Note::spacing(format!(
                "the description states distances in the unit `{}`, which is not known; 1 mm is assumed",
                unit.escape_debug()
            )));
        } else if self.spacing_mm.is_none() {
            notes.push(Note::no_spacing("this TIFF"));
        } else if self.lacks_depth {
            notes.push(Note::spacing(format!(
                "the description states no distance of slices; {} mm are assumed",
                Short(spacing_mm[2])
            )));
        }
        if let Some(first) = self.placed_by.as_ref().filter(|_| self.unplaced > 0) {
            notes.push(Note::new(format!(
                "{} of {} files state no size of voxels; it is taken from {}",
                self.unplaced,
                list.len(),
                shown(first)
            )));
        }
        notes.push(Note::no_directions("TIFF"));
        if self.inverted {
            notes.push(Note::new("0 is white in these pictures; the numbers are kept as they are"));
        }
        let mut affine = Affine::from_spacing(spacing_mm);
        for (axis, _) in self.backwards.unwrap_or_default().iter().enumerate().filter(|(_, back)| **back) {
            let row = &mut affine.rows[axis];
            row[3] = row[axis] * f64::from(shape.size[axis] - 1);
            row[axis] = -row[axis];
            notes.push(Note::backwards(axis));
        }
        if self.thumbnails > 0 {
            notes.push(Note::new(format!(
                "{} pages of reduced size (thumbnails) are left out",
                self.thumbnails
            )));
        }
        notes.extend(shape.samples.note());
        let line = self.calibration.filter(|_| shape.samples.bytes() <= 2);
        let info = VolumeInfo {
            dims,
            scalar: shape.samples.delivered(),
            rescale: line.map_or(Rescale::IDENTITY, |[slope, intercept]| Rescale { slope, intercept }),
            spacing_mm,
            affine,
            description: SourceDescription {
                format: "tiff".into(),
                name,
                files: list.len() as u64,
                bytes,
                ..SourceDescription::default()
            },
            notes,
        };
        let files = Arc::new(FileSet::new(list));
        let endian = self.pages.first().map_or(Endian::Little, |p| p.endian);
        let places: Option<Vec<(u32, u64)>> = self
            .pages
            .iter()
            .map(|p| p.pixels.filter(|_| p.endian == endian).map(|at| (p.file, at)))
            .collect();
        if let Some(places) = places {
            let placed =
                DirectSamples { files, offsets: SliceOffsets::Each(places), samples: shape.samples, endian };
            return Ok(Box::new(StoredVolume::direct(info, placed)));
        }
        let pages = self.pages.iter().map(|p| (p.file, p.offset)).collect();
        let recipe = Pages { files, pages, memory_bytes: self.memory_bytes };
        Ok(Box::new(StoredVolume::sequential(info, Box::new(recipe))))
    }
}

/// True for columns, and rows, that are stored from the other end, by the tag Orientation.
fn backwards(orientation: u64) -> Result<[bool; 2], Fault> {
    match orientation {
        2 => Ok([true, false]),
        3 => Ok([true, true]),
        4 => Ok([false, true]),
        5..=8 => Err(bad!(
            "its pictures are stored turned by 90 degrees (Orientation {orientation}); save them upright"
        )),
        // Other values mean nothing.
        _ => Ok([false, false]),
    }
}

/// Description and resolution of a file's first page.
fn read_notes(tiff: &Tiff<'_>, directory: &Directory) -> io::Result<Notes> {
    let text = tiff.text(directory, DESCRIPTION, MAX_DESCRIPTION)?;
    let resolution = [tiff.ratio(directory, X_RESOLUTION)?, tiff.ratio(directory, Y_RESOLUTION)?];
    let size =
        [tiff.value(directory, raster::tag::WIDTH, 0)?, tiff.value(directory, raster::tag::HEIGHT, 0)?];
    Notes::read(&text, resolution, size).map_err(damaged)
}

/// The recipe of pages that are packed, in tiles, or scattered: a few rows at a time.
struct Pages {
    files: Arc<FileSet>,
    /// File and directory of each.
    pages: Vec<(u32, u64)>,
    memory_bytes: u64,
}

impl Unroll for Pages {
    fn memory_bytes(&self) -> u64 {
        self.memory_bytes
    }

    fn files(&self) -> &FileList {
        self.files.list()
    }

    fn unroll(&self, info: &VolumeInfo, target: &Target<'_>) -> Result<Vec<Note>> {
        for (z, (file, offset)) in (0..).zip(&self.pages) {
            let index = *file as usize;
            let mut result = Ok(());
            let unroll = |opened: &PositionalFile| {
                let (tiff, _) = Tiff::open(opened)?;
                let raster = Raster::read(&tiff, &tiff.directory(*offset)?)?;
                // Compared with the survey: the file may have been changed since.
                let size = [info.dims.nx(), info.dims.ny()];
                if [raster.width, raster.height] != size || raster.samples.delivered() != info.scalar {
                    return Err(damaged(bad!("it is not the page that it was a moment ago")));
                }
                result = raster.unroll(&tiff, z, target)?;
                Ok(())
            };
            self.files.with(index, unroll).map_err(|cause| {
                let path = self.files.list().path(index);
                let page = z + 1;
                match cause.kind() {
                    io::ErrorKind::UnexpectedEof => {
                        unusable(&path, bad!("page {page} ends early; the file was cut short, copy it again"))
                    }
                    _ if cause.raw_os_error().is_some() => unreadable(&path, cause),
                    _ => unusable(&path, bad!("page {page} is damaged ({cause}); copy the file again")),
                }
            })?;
            result?;
        }
        Ok(Vec::new())
    }
}
