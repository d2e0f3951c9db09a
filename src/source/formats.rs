//! The volume formats that are read besides DICOM and headerless files: two short lists.
//!
//! A new format is a file in this folder, with the sentences of its faults, and a row here. Its name goes into the
//! sentence about files of unknown kind (`discovery::open`); a format that states no placement says so in its row, and
//! its suffix stands in `discovery::placing`; one whose axes are a patient's is named in `page`.
//!
//! A file belongs to the first format of [`FORMATS`] that recognises it, else, if [`STACKS`] does, to the
//! stack of all such files of its folder. DICOM is asked before both. Formats are recognised by content; a
//! name may only decide between things that look alike (a gzip file called `.nii.gz`).

use std::path::{Path, PathBuf};

use super::files::FileList;
use super::raw_with_header::{amira, mrc, vgi, vtk};
use super::{OpenOptions, metaimage, nifti, npy, nrrd, png_stack, tiff, zarr};
use crate::volume::{Result, VolumeSource};

/// Volumes that a file of some kind holds.
type Volumes = Result<Vec<Box<dyn VolumeSource>>>;

/// A kind of file that holds one or several volumes.
pub(crate) struct Format {
    /// Name as shown to users and in [`crate::volume::SourceDescription::format`]: `nrrd`, `nifti`, ...
    pub(crate) name: &'static str,
    /// Returns true for a file of this kind, which begins with these [`HEAD_BYTES`](super::HEAD_BYTES). A damaged one
    /// counts, too, so that it is refused by name. Called for every file other than DICOM: quick, and without opening
    /// the file unless `head` already speaks for the format.
    pub(crate) recognise: fn(head: &[u8], path: &Path) -> bool,
    /// True if the format knows neither spacing nor directions: a side-car may then state them.
    pub(crate) states_no_place: bool,
    /// Opens a file that was recognised: its volumes, in the order of the file.
    pub(crate) open: fn(path: &Path, options: &OpenOptions) -> Volumes,
}

/// A kind of picture; the files of a folder, in natural order of their names, make a volume.
pub(crate) struct StackFormat {
    /// Name as shown to users.
    pub(crate) name: &'static str,
    /// Returns true for a slice of this kind, which begins with these bytes.
    pub(crate) recognise: fn(head: &[u8], path: &Path) -> bool,
    /// Returns true for a file of several slices, which is a volume on its own.
    pub(crate) is_whole: fn(path: &Path) -> bool,
    /// Opens all such files of one folder; at least one, in natural order.
    pub(crate) open: fn(slices: FileList, options: &OpenOptions) -> Vec<Slices>,
}

/// The volumes of some of the files of a folder, or the reason why these make none.
pub(crate) struct Slices {
    /// Indices of these files.
    pub(crate) files: Vec<usize>,
    /// The volume of these files, or the volumes of one file.
    pub(crate) volumes: Volumes,
}

/// Formats of whole volumes.
pub(crate) const FORMATS: &[Format] = &[
    Format { name: "nrrd", recognise: nrrd::recognise, states_no_place: false, open: nrrd::open },
    Format { name: "nifti", recognise: nifti::recognise, states_no_place: false, open: nifti::open },
    Format { name: "npy", recognise: npy::recognise, states_no_place: true, open: npy::open },
    Format {
        name: "metaimage",
        recognise: metaimage::recognise,
        states_no_place: false,
        open: metaimage::open,
    },
    Format { name: "mrc", recognise: mrc::recognise, states_no_place: false, open: mrc::open },
    Format { name: "vgi", recognise: vgi::recognise, states_no_place: false, open: vgi::open },
    Format { name: "vtk", recognise: vtk::recognise, states_no_place: false, open: vtk::open },
    Format { name: "amira", recognise: amira::recognise, states_no_place: false, open: amira::open },
    Format { name: "zarr", recognise: zarr::recognise, states_no_place: false, open: zarr::open },
];

/// The header of samples that were given: `brain.hdr` for `brain.img`, `part.vgi` for `part.vol`.
pub(crate) fn header_of_samples(path: &Path) -> Option<PathBuf> {
    nifti::header_of_samples(path).or_else(|| vgi::header_of(path))
}

/// Formats of single slices.
pub(crate) const STACKS: &[StackFormat] = &[
    StackFormat { name: "tiff", recognise: tiff::recognise, is_whole: tiff::is_whole, open: tiff::open },
    StackFormat { name: "png", recognise: png_stack::recognise, is_whole: |_| false, open: png_stack::open },
];
