//! Headerless volumes: one file with all slices, or one file per slice.

use std::fs;
use std::io::Read;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::files::{FileList, FileSet, base_name};
use super::known::HEAD_BYTES;
use super::payload::{DirectSamples, Samples, SliceOffsets};
use crate::fault::{Fault, bad, unfit, usage};
use crate::geom::{Dims, Orientation};
use crate::picture_mark::is_own_picture;
use crate::platform::PositionalFile;
use crate::source::OCT;
use crate::text::Name;
use crate::text::names::{DIMS, DTYPE, SKIP, SPACING};
use crate::volume::{
    Endian, Rescale, Result, ScalarType, SourceDescription, SourceError, SourceFault, VolumeInfo,
    VolumeSource,
};

/// Layout of a headerless volume, as the caller must state it.
#[derive(Clone, Debug, PartialEq)]
pub struct RawOptions {
    /// Size in voxels; x runs fastest in the file, then y, then z.
    pub dims: Dims,
    /// Type of the samples.
    pub scalar: ScalarType,
    /// Byte order of the samples.
    pub endian: Endian,
    /// Distance in mm between neighbours along x, y, z; finite and positive.
    pub spacing_mm: [f64; 3],
    /// Bytes to skip at the head of every file.
    pub skip: u64,
    /// Directions of the index axes in the patient.
    pub orientation: Orientation,
}

#[cfg(test)]
impl RawOptions {
    /// Two samples of 8 bits along each axis, 1 mm apart.
    pub(crate) fn small() -> Self {
        Self {
            dims: Dims::new(2, 2, 2).unwrap(),
            scalar: ScalarType::U8,
            endian: Endian::Little,
            spacing_mm: [1.0; 3],
            skip: 0,
            orientation: Orientation::LPS,
        }
    }
}

/// A headerless volume, read by position straight into the caller's buffer.
///
/// Holds the file names (some 30 bytes a slice) and open descriptors, no voxels.
#[derive(Debug)]
pub struct RawVolume {
    info: VolumeInfo,
    samples: DirectSamples,
}

impl RawVolume {
    /// Opens one file (all slices), several slice files in the order given, or a folder of slice
    /// files in natural order of their names (hidden files and subfolders are left out).
    ///
    /// # Errors
    /// [`SourceError`] when a file is not exactly `skip` plus its share of the dims, or the number of files is not the
    /// number of slices; for an empty folder, for impossible options, and when the system refuses.
    pub fn open(inputs: &[PathBuf], options: &RawOptions) -> Result<Self> {
        Self::described(inputs, options, None)
    }

    /// Like [`Self::open`]; faults of the description name the side-car, and its keys instead of options.
    pub(crate) fn described(
        inputs: &[PathBuf],
        options: &RawOptions,
        sidecar: Option<&Path>,
    ) -> Result<Self> {
        let (list, name) = list_files(inputs)?;
        let first = inputs.first().map_or(Path::new(""), PathBuf::as_path);
        let named = |option: Name, key: &str| match sidecar {
            None => option.to_string(),
            Some(_) => format!("the key {key}"),
        };
        let refused = |fault: Fault| {
            SourceError::from(match sidecar {
                None => fault.at(first),
                Some(path) => bad!("describes {}, but {fault}", base_name(first)).at(path),
            })
        };
        let affine = options.orientation.affine(options.spacing_mm);
        if !options.spacing_mm.iter().all(|s| s.is_finite() && *s > 0.0) || affine.inverse().is_none() {
            let spacing = named(SPACING, "spacing");
            return Err(refused(usage!("spacing must be three positive numbers of mm; check {spacing}")));
        }
        let dims = options.dims;
        let is_folder = list.len() != 1 || inputs.first().is_some_and(|p| p.is_dir());
        let slices_per_file = if is_folder { 1 } else { dims.nz() };
        if u64::from(dims.nz()) != list.len() as u64 * u64::from(slices_per_file) {
            return Err(refused(bad!(
                "{} slice files are given, but {dims} needs {}; check {} and which files are given",
                list.len(),
                dims.nz(),
                named(DIMS, "dims")
            )));
        }
        let voxel_bytes = options.scalar.bytes() as u64;
        let share = u64::from(dims.nx()) * u64::from(dims.ny()) * u64::from(slices_per_file) * voxel_bytes;
        let Some(expected) = share.checked_add(options.skip) else {
            return Err(refused(usage!("no file can be that long; check {}", named(SKIP, "skip"))));
        };
        for index in 0..list.len() {
            let path = list.path(index);
            let got = match fs::metadata(&path) {
                Ok(meta) => meta.len(),
                Err(cause) => return Err(SourceFault::Unreadable { path, cause }.into()),
            };
            if got != expected {
                let layout = layout_of(options, index, list.len());
                let Some(sidecar) = sidecar else {
                    return Err(bad!("has {got} bytes, but {expected} are needed for {layout}; check {DIMS}, {DTYPE} and {SKIP}").at(path).into());
                };
                let (data, key) = (base_name(&path), wrong_key(options, expected, got));
                return Err(bad!("describes {data} as {layout}, which takes {expected} bytes, but it has {got}; correct the key {key}, or copy {data} again").at(sidecar).into());
            }
        }
        // Opened now, so that a missing permission shows before a long build and not in it.
        let files = FileSet::new(list);
        files.with(0, |_| Ok(())).map_err(|cause| {
            SourceError::from(SourceFault::Unreadable { path: files.list().path(0), cause })
        })?;
        let info = VolumeInfo {
            dims,
            scalar: options.scalar,
            rescale: Rescale::IDENTITY,
            spacing_mm: options.spacing_mm,
            affine,
            description: SourceDescription {
                format: "raw".into(),
                name,
                files: files.list().len() as u64,
                bytes: dims.voxels() * voxel_bytes,
                ..SourceDescription::default()
            },
            notes: Vec::new(),
        };
        let samples = DirectSamples {
            files: Arc::new(files),
            offsets: SliceOffsets::Even {
                slices_per_file: u64::from(slices_per_file),
                skip: options.skip,
                first_slice: 0,
            },
            samples: Samples::Plain(options.scalar),
            endian: options.endian,
        };
        Ok(Self { info, samples })
    }
}

impl VolumeSource for RawVolume {
    fn info(&self) -> &VolumeInfo {
        &self.info
    }

    fn for_each_file(&self, each: &mut dyn FnMut(&Path)) {
        self.samples.files.list().for_each(each);
    }

    fn read_rows(&self, z: u32, rows: Range<u32>, cols: Range<u32>, out: &mut [u8]) -> Result {
        self.samples.read_rows(&self.info, z, rows, cols, out)
    }

    fn read_pitched(
        &self,
        z: u32,
        rows: Range<u32>,
        cols: Range<u32>,
        pitch: usize,
        out: &mut [u8],
    ) -> Result {
        self.samples.read_pitched(&self.info, z, rows, cols, pitch, out)
    }
}

/// The described content of one of the files.
fn layout_of(options: &RawOptions, index: usize, files: usize) -> String {
    let RawOptions { dims, scalar, skip, .. } = *options;
    let dtype = scalar.name();
    let layout = match files {
        1 => format!("{dims} {dtype}"),
        _ => format!("slice file {} of {files}, {}x{} {dtype}", index + 1, dims.nx(), dims.ny()),
    };
    if skip > 0 { format!("{layout} after {skip} skipped bytes") } else { layout }
}

/// The key of a side-car that is probably wrong where a file has `got` bytes instead of `expected`.
fn wrong_key(options: &RawOptions, expected: u64, got: u64) -> &'static str {
    let voxels = expected.saturating_sub(options.skip) / (options.scalar.bytes() as u64).max(1);
    let sizes = |size: u64| voxels.checked_mul(size).and_then(|n| n.checked_add(options.skip));
    let slice = u64::from(options.dims.nx()) * u64::from(options.dims.ny());
    if [1, 2, 4, 8].into_iter().any(|size| sizes(size) == Some(got)) {
        "dtype"
    } else if got.checked_sub(expected).is_some_and(|more| more < slice) {
        "skip"
    } else {
        "dims"
    }
}

/// The files to read, in slice order, and the base name to remember.
fn list_files(inputs: &[PathBuf]) -> Result<(FileList, String)> {
    let Some(first) = inputs.first() else {
        return Err(usage!("no input file is given").into());
    };
    let is_dir = |path: &Path| match fs::metadata(path) {
        Ok(meta) => Ok(meta.is_dir()),
        Err(cause) => Err(SourceError::unreadable(path, cause)),
    };
    if inputs.len() == 1 && is_dir(first)? {
        return Ok((list_folder(first)?, base_name(first)));
    }
    let mut list = FileList::new(Path::new(""));
    for path in inputs {
        if is_dir(path)? {
            return Err(usage!("is a folder among several inputs; give one folder, or files only")
                .at(path)
                .into());
        }
        list.push(path);
    }
    Ok((list, base_name(first)))
}

/// True if a file in a folder of slices was made of them: a model, or a picture of one. Recognised by content, not by
/// its name; a file that cannot be read says so when it is opened as a slice.
fn is_made_of_slices(path: &Path) -> bool {
    let mut head = Vec::with_capacity(HEAD_BYTES);
    let read = PositionalFile::open(path)
        .and_then(|file| file.onwards(0).take(HEAD_BYTES as u64).read_to_end(&mut head));
    read.is_ok() && (head.starts_with(OCT) || is_own_picture(&head))
}

/// Regular files of a folder in natural order; hidden ones, models, their pictures and subfolders are left out.
fn list_folder(folder: &Path) -> Result<FileList> {
    let unreadable = |cause| SourceError::from(SourceFault::Unreadable { path: folder.to_path_buf(), cause });
    let mut list = FileList::new(folder);
    for entry in fs::read_dir(folder).map_err(unreadable)? {
        let name = entry.map_err(unreadable)?.file_name();
        let path = folder.join(&name);
        let hidden = name.as_encoded_bytes().starts_with(b".");
        // Follows links: a folder of links to slices is common.
        let is_file = !hidden && fs::metadata(&path).is_ok_and(|meta| meta.is_file());
        if is_file && !is_made_of_slices(&path) {
            list.push(Path::new(&name));
        }
    }
    if list.len() == 0 {
        return Err(unfit!("the folder holds no file; give the folder of the slice files").at(folder).into());
    }
    let order = list.natural_order();
    Ok(list.select(order.into_iter()))
}
