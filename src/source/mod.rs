//! Sources of voxels: one file or folder for each format.
//!
//! Every reader opens the files it recognises as volumes ([`crate::volume::VolumeSource`]); folders, and the choice of
//! files that belong together, are the part of [`crate::discovery`], which readers do not see.
//!
//! | part | what it holds |
//! |---|---|
//! | [`dicom`], `raw`, `nrrd`, `nifti`, `metaimage`, `npy`, `tiff`, `png_stack` | one kind of source each |
//! | `raw_with_header` | MRC, VGStudio, VTK, Amira: a header before raw samples |
//! | `zarr` | arrays in chunks |
//! | `formats`, `known` | lists of the formats that are read, and of those that are known but not read |
//! | `options`, `subject`, `finding` | choices of a caller, things to build, and results of a search |
//! | `payload`, `axis_reversal` | samples read where they lie, or unrolled first |
//! | `files`, `header`, `natural`, `numbered`, `stable_hash` | parts that several of them share |
#![doc = "\n"]
#![doc = include_str!("READING.md")]

mod axis_reversal;
#[doc(hidden)]
pub mod dicom;
mod files;
mod finding;
mod formats;
mod header;
mod known;
mod metaimage;
mod natural;
mod nifti;
mod npy;
mod nrrd;
mod numbered;
mod options;
mod payload;
mod png_stack;
mod raw;
mod raw_with_header;
mod stable_hash;
mod subject;
mod tiff;
mod zarr;

pub(crate) use files::{FileList, base_name};
pub use finding::{BurnedIn, Finding, InputFiles};
pub(crate) use formats::{FORMATS, STACKS, Slices, header_of_samples};
pub(crate) use header::stays;
pub(crate) use known::OCT;
pub(crate) use known::{HEAD_BYTES, known, known_folder};
pub(crate) use natural::natural_cmp;

pub use options::{GapPolicy, OpenOptions};
pub use raw::{RawOptions, RawVolume};
pub(crate) use stable_hash::StableHash;
pub use subject::{Subject, SubjectKind};
pub(crate) use zarr::{head_of as zarr_head, is_of_group as is_of_zarr_group, unchosen};
