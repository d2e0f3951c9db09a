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

use std::fs::File;
use std::io;
use std::path::Path;
use std::sync::Arc;

use super::files::{FileList, FileSet};
use super::header::{unreadable, unusable};
use super::raw::base_name;
use super::stored::{Placed, Places, Samples, StoredVolume, Target, Unroll};
use super::{Endian, OpenOptions, Rescale, SourceDescription, SourceError, VolumeInfo, VolumeSource};
use crate::geom::{Affine, Dims};
use directory::{Directory, Tiff, damaged};
use notes::Notes;
use raster::Raster;

/// Most directories of a file, those of thumbnails included.
const MAX_PAGES: usize = 2 * Dims::MAX_SIDE as usize;

/// Longest part of a description that is read; spacing and counts are at its start.
const MAX_DESCRIPTION: u64 = 64 << 10;

/// The most bytes that LZW makes of one; deflate and PackBits make fewer.
const MOST_EXPANSION: u64 = 4096;

const DESCRIPTION: u16 = 270;
const X_RESOLUTION: u16 = 282;
const Y_RESOLUTION: u16 = 283;
const SUBFILE_TYPE: u16 = 254;

/// Is this a TIFF picture?
pub(super) fn recognise(head: &[u8], _: &Path) -> bool {
    [b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"].iter().any(|magic| head.starts_with(*magic))
}

/// Opens pictures: one file with pages is a volume, files with one page each make one together, and of
/// several files with pages each is a volume.
pub(super) fn open(list: FileList, _: &OpenOptions) -> Result<Vec<Box<dyn VolumeSource>>, SourceError> {
    let name = if list.len() == 1 {
        base_name(&list.path(0))
    } else {
        let folder = list.path(0).parent().map(Path::to_path_buf).unwrap_or_default();
        base_name(if folder.as_os_str().is_empty() { Path::new(".") } else { &folder })
    };
    let mut stack = Stack::default();
    let mut single = Vec::new();
    for index in 0..list.len() {
        let path = list.path(index);
        let mut pages = Stack::default();
        pages.add(&path, 0).map_err(|cause| unreadable(&path, cause))?;
        if list.len() > 1 && pages.pages.len() > 1 {
            let one = list.select(std::iter::once(index));
            single.push(pages.volume(one, base_name(&path))?);
        } else {
            let index = u32::try_from(index).unwrap_or(u32::MAX);
            pages.pages.iter_mut().for_each(|page| page.file = index);
            stack.append(pages).map_err(|reason| unusable(&path, reason))?;
        }
    }
    if !stack.pages.is_empty() {
        let used: Vec<usize> = stack.pages.iter().map(|p| p.file as usize).collect();
        // Files of several pages were taken out; what is left is counted anew.
        let chosen = if list.len() > 1 { list.select(used.into_iter()) } else { list };
        if chosen.len() > 1 {
            stack.pages.iter_mut().zip(0..).for_each(|(page, file)| page.file = file);
        }
        single.insert(0, stack.volume(chosen, name)?);
    }
    Ok(single)
}

/// What all slices of a volume share.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Shape {
    size: [u32; 2],
    samples: Samples,
}

/// One slice.
#[derive(Clone, Copy, Debug)]
struct Page {
    file: u32,
    /// Of its directory.
    offset: u64,
    /// Of its pixels, where they lie as they are.
    pixels: Option<u64>,
    endian: Endian,
}

/// Slices found so far.
#[derive(Debug, Default)]
struct Stack {
    pages: Vec<Page>,
    shape: Option<Shape>,
    spacing_mm: Option<[f64; 3]>,
    memory_bytes: u64,
    file_bytes: u64,
    inverted: bool,
    thumbnails: usize,
    /// Were the pages of an ImageJ stack behind one directory?
    contiguous: bool,
}

impl Stack {
    /// Adds the pages of a file.
    fn add(&mut self, path: &Path, file: u32) -> io::Result<()> {
        super::stored::regular(path).map_err(|error| io::Error::other(error.to_string()))?;
        let opened = File::open(path)?;
        let (tiff, mut offset) = Tiff::open(&opened)?;
        self.file_bytes = self.file_bytes.saturating_add(tiff.length);
        let mut seen = 0_usize;
        // Brent's way to notice a circle: the offset that all later ones are compared with moves on at
        // powers of two.
        let mut mark = (0, 1);
        let mut notes: Option<Notes> = None;
        while offset != 0 {
            if offset == mark.0 || seen >= MAX_PAGES {
                return Err(damaged("its pages follow each other in a circle"));
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
            if notes.is_none() {
                notes = Some(read_notes(&tiff, &directory)?);
            }
            self.page(&tiff, &directory, here, file)?;
        }
        let notes = notes.ok_or_else(|| damaged("it has no page"))?;
        if let Some(reason) = notes.refused {
            return Err(damaged(reason));
        }
        self.spacing_mm = self.spacing_mm.or(notes.spacing_mm);
        self.contiguous(&tiff, notes.images)
    }

    fn page(&mut self, tiff: &Tiff<'_>, directory: &Directory, offset: u64, file: u32) -> io::Result<()> {
        let raster = Raster::read(tiff, directory)?;
        self.same(Shape { size: [raster.width, raster.height], samples: raster.samples }).map_err(damaged)?;
        let pixels = raster.placed(tiff)?;
        if let Some(at) = pixels
            && at.saturating_add(raster.bytes()) > tiff.length
        {
            return Err(damaged(format!(
                "page {} needs {} bytes from byte {at} on, and the file has {}; copy it again",
                self.pages.len() + 1,
                raster.bytes(),
                tiff.length
            )));
        }
        self.memory_bytes = self.memory_bytes.max(raster.memory_bytes());
        self.inverted |= raster.inverted;
        if self.pages.len() >= Dims::MAX_SIDE as usize {
            return Err(damaged(format!("it has more than {} pages", Dims::MAX_SIDE)));
        }
        self.pages.push(Page { file, offset, pixels, endian: tiff.endian });
        Ok(())
    }

    /// Pictures of an ImageJ stack that have no directories of their own.
    fn contiguous(&mut self, tiff: &Tiff<'_>, images: u64) -> io::Result<()> {
        let [page] = self.pages.as_slice() else { return Ok(()) };
        let (first, Some(shape)) = (*page, self.shape) else { return Ok(()) };
        let Some(pixels) = first.pixels.filter(|_| images > 1) else { return Ok(()) };
        let bytes = u64::from(shape.size[0]) * u64::from(shape.size[1]) * shape.samples.bytes() as u64;
        if images > u64::from(Dims::MAX_SIDE) {
            return Err(damaged(format!("its {images} images are out of range")));
        }
        let end = pixels.saturating_add(images.saturating_mul(bytes));
        if end > tiff.length {
            return Err(damaged(format!(
                "its description promises {images} images up to byte {end}, and the file has {}; copy it again",
                tiff.length
            )));
        }
        self.pages.extend((1..images).map(|i| Page { pixels: Some(pixels + i * bytes), ..first }));
        self.contiguous = true;
        Ok(())
    }

    /// Is a slice of the same kind as those before?
    fn same(&mut self, shape: Shape) -> Result<(), String> {
        let first = *self.shape.get_or_insert(shape);
        if first == shape {
            return Ok(());
        }
        let say = |s: Shape| format!("{}x{} {}", s.size[0], s.size[1], s.samples.delivered());
        Err(format!(
            "a page is {} where the first is {}; slices of a volume are alike in size and type, move the other away",
            say(shape),
            say(first)
        ))
    }

    /// Adds the slices of another file.
    fn append(&mut self, other: Self) -> Result<(), String> {
        if let Some(shape) = other.shape {
            self.same(shape)?;
        }
        self.pages.extend(other.pages);
        self.spacing_mm = self.spacing_mm.or(other.spacing_mm);
        self.memory_bytes = self.memory_bytes.max(other.memory_bytes);
        self.file_bytes = self.file_bytes.saturating_add(other.file_bytes);
        self.inverted |= other.inverted;
        self.thumbnails += other.thumbnails;
        Ok(())
    }

    fn volume(self, list: FileList, name: String) -> Result<Box<dyn VolumeSource>, SourceError> {
        let path = list.path(0);
        let refuse = |reason: String| unusable(&path, reason);
        let shape = self.shape.ok_or_else(|| refuse("has no page".into()))?;
        let nz = u32::try_from(self.pages.len()).unwrap_or(u32::MAX);
        let dims = Dims::new(shape.size[0], shape.size[1], nz)
            .ok_or_else(|| refuse(format!("{nz} pages are out of range")))?;
        let bytes = dims.voxels() * shape.samples.bytes() as u64;
        if bytes > self.file_bytes.saturating_mul(MOST_EXPANSION) {
            return Err(refuse(format!(
                "its pages promise {bytes} bytes, more than {} bytes of file can hold",
                self.file_bytes
            )));
        }
        let spacing_mm = self.spacing_mm.unwrap_or([1.0; 3]);
        let mut warnings = Vec::new();
        if self.spacing_mm.is_none() {
            warnings.push("the pictures state no voxel spacing; 1 mm is assumed".into());
        }
        warnings.push("TIFF states no directions; rows, columns and pages are taken as LPS".into());
        if self.inverted {
            warnings.push("0 is white in these pictures; the numbers are kept as they are".into());
        }
        if self.thumbnails > 0 {
            warnings.push(format!("{} pages of reduced size (thumbnails) are left out", self.thumbnails));
        }
        warnings.extend(shape.samples.warning());
        let info = VolumeInfo {
            dims,
            scalar: shape.samples.delivered(),
            rescale: Rescale::IDENTITY,
            spacing_mm,
            affine: Affine::from_spacing(spacing_mm),
            description: SourceDescription { format: "tiff".into(), name, files: list.len() as u64, bytes },
            warnings,
        };
        let files = Arc::new(FileSet::new(list));
        let endian = self.pages.first().map_or(Endian::Little, |p| p.endian);
        let places: Option<Vec<(u32, u64)>> = self
            .pages
            .iter()
            .map(|p| p.pixels.filter(|_| p.endian == endian).map(|at| (p.file, at)))
            .collect();
        if let Some(places) = places {
            let placed = Placed { files, places: Places::Each(places), samples: shape.samples, endian };
            return Ok(Box::new(StoredVolume::placed(info, placed)));
        }
        let pages = self.pages.iter().map(|p| (p.file, p.offset)).collect();
        let recipe = Pages { files, pages, memory_bytes: self.memory_bytes };
        Ok(Box::new(StoredVolume::sequential(info, Box::new(recipe))))
    }
}

/// Description and resolution of a file's first page.
fn read_notes(tiff: &Tiff<'_>, directory: &Directory) -> io::Result<Notes> {
    let text = tiff.text(directory, DESCRIPTION, MAX_DESCRIPTION)?;
    let resolution = [tiff.ratio(directory, X_RESOLUTION)?, tiff.ratio(directory, Y_RESOLUTION)?];
    Ok(Notes::read(&text, resolution))
}

/// The recipe of pages that are packed, in tiles, or scattered: a few rows at a time.
#[derive(Debug)]
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

    fn unroll(&self, info: &VolumeInfo, target: &Target<'_>) -> Result<Vec<String>, SourceError> {
        for (z, (file, offset)) in (0..).zip(&self.pages) {
            let index = *file as usize;
            let mut result = Ok(());
            let unroll = |opened: &File| {
                let (tiff, _) = Tiff::open(opened)?;
                let raster = Raster::read(&tiff, &tiff.directory(*offset)?)?;
                // Held against the survey: the file may have been changed since.
                let size = [info.dims.nx(), info.dims.ny()];
                if [raster.width, raster.height] != size || raster.samples.delivered() != info.scalar {
                    return Err(damaged("it is not the page that it was a moment ago"));
                }
                result = raster.unroll(&tiff, z, target)?;
                Ok(())
            };
            self.files.with(index, unroll).map_err(|cause| {
                let path = self.files.list().path(index);
                let page = format!("page {}", z + 1);
                match cause.kind() {
                    io::ErrorKind::UnexpectedEof => {
                        unusable(&path, format!("{page} ends early; the file was cut short, copy it again"))
                    }
                    _ if cause.raw_os_error().is_some() => unreadable(&path, cause),
                    _ => unusable(&path, format!("{page} is damaged ({cause}); copy the file again")),
                }
            })?;
            result?;
        }
        Ok(Vec::new())
    }
}
