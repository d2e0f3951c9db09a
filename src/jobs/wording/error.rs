//! Sentences about why a volume cannot be used, and what to do.

use std::fmt;

use super::foreign::shown;
use super::samples::{RawKeys, raw};
use super::system::reading;
use crate::budget::Bytes;
use crate::facts::{Candidate, Fault, Instead, Misuse, OtherVolume, SourceError, StatedBy};

impl fmt::Display for SourceError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoVolume { path, .. }
            | Self::Unusable { path, .. }
            | Self::Dicom { path, .. }
            | Self::Usage { path, .. } => write!(f, "{}: {}", shown(path), Reason(self)),
            _ => Reason(self).fmt(f),
        }
    }
}

/// An error without its path, where that stands for itself before the reason.
pub(super) struct Reason<'a>(pub(super) &'a SourceError);

impl fmt::Display for Reason<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            SourceError::NoVolume { found, .. } => found.fmt(f),
            SourceError::Unusable { fault, .. } => fault.fmt(f),
            SourceError::Dicom { fault, .. } => fault.fmt(f),
            SourceError::Usage { misuse, .. } => misuse.fmt(f),
            SourceError::Gaps { error, number, other } => {
                let OtherVolume { number: instead, kind, part, size } = &**other;
                let other = Candidate { kind: kind.clone(), part: part.clone(), size: *size, refused: None };
                write!(
                    f,
                    "{error}; or choose a volume: --volume {number} is this one, --volume {instead} the largest of the others ({other})"
                )
            }
            SourceError::Unreadable { path, cause } => write!(
                f,
                "{}: cannot be read ({cause}); {}",
                shown(path),
                reading(cause, "check that it exists and that you may read it")
            ),
            SourceError::SizeMismatch { path, expected, got, layout } => write!(
                f,
                "{}: has {got} bytes, but {expected} are needed for {layout}; check --dims, --dtype and --skip",
                shown(path)
            ),
            SourceError::ReadFailed { path, slice, cause } => write!(
                f,
                "{}: ended or failed while slice {slice} was read ({cause}); {}",
                shown(path),
                reading(cause, "was it changed during the build?")
            ),
            SourceError::Scratch { path, cause } => write!(
                f,
                "scratch file in {}: {cause}; {}",
                shown(path),
                reading(cause, "free some space or choose another folder with --scratch")
            ),
            SourceError::Memory { path, needed_bytes, allowed_bytes } => write!(
                f,
                "{}: needs {} to be decoded, and --memory leaves {} for that; allow at least {} more",
                shown(path),
                Bytes(*needed_bytes),
                Bytes(*allowed_bytes),
                Bytes(needed_bytes.saturating_sub(*allowed_bytes))
            ),
            SourceError::ManyImages { path, images, needed_bytes, allowed_bytes } => write!(
                f,
                "{}: has {images} images, which take {} to be put in order, where {} is left for that; allow at least {} more with --memory",
                shown(path),
                Bytes(*needed_bytes),
                Bytes(*allowed_bytes),
                Bytes(needed_bytes.saturating_sub(*allowed_bytes))
            ),
        }
    }
}

impl fmt::Display for Instead {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::EmptyFolder => f.write_str("the folder holds no file"),
            Self::NoSlices => f.write_str("the folder holds no file; give the folder of the slice files"),
            Self::Only { files, kind } => {
                write!(f, "none of the {files} file(s) is a volume: {kind}")
            }
            Self::Unknown { files } => write!(
                f,
                "no volume is among the {files} file(s); for headerless voxels add --dims NXxNYxNZ and --dtype"
            ),
            Self::File(kind) => kind.fmt(f),
            Self::Nothing => f.write_str("no volume was found below it; `oct scan` says what is there"),
        }
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::EndsEarly => f.write_str("ends early; it was cut short, copy it again"),
            Self::Empty => f.write_str("is empty; give a DICOM series or headerless voxels"),
            Self::NotAFile => f.write_str("is neither a file nor a folder; name one of these"),
            Self::Changed => f.write_str("was changed while the folders were searched; start again"),
            Self::ChangedInUse => f.write_str(
                "was changed or replaced while it was read, so that nothing was made of it; start again once it is complete",
            ),
            Self::Known(known) => write!(
                f,
                "is {known}; DICOM, NRRD, NIfTI, MetaImage, .npy, TIFF and PNG are read, and headerless voxels with --dims NXxNYxNZ and --dtype"
            ),
            Self::NotDicom => f.write_str(
                "is not DICOM, in spite of its name; for headerless voxels add --dims and --dtype",
            ),
            Self::Mesh => f.write_str(
                "is a mesh by its name, and is not read as a volume; meshes (STL, PLY, OBJ, OFF, glTF, 3MF) are built by themselves, with --grid N or --voxel MM",
            ),
            Self::MeshFile(fault) => fault.fmt(f),
            Self::Csg(fault) => fault.fmt(f),
            Self::Raw(fault) => raw(fault, RawKeys::Flags, f),
            Self::Header(fault) => fault.fmt(f),
            Self::Stored(fault) => fault.fmt(f),
            Self::Nrrd(fault) => fault.fmt(f),
            Self::Nifti(fault) => fault.fmt(f),
            Self::MetaImage(fault) => fault.fmt(f),
            Self::Npy(fault) => fault.fmt(f),
            Self::Tiff(fault) => fault.fmt(f),
            Self::Png(fault) => fault.fmt(f),
            Self::SideCar(fault) => fault.fmt(f),
            Self::Numbers(fault) => fault.fmt(f),
        }
    }
}

impl fmt::Display for Misuse {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoInput => f.write_str("no input file is given"),
            Self::FolderAmongFiles => {
                f.write_str("is a folder among several inputs; give one folder, or files only")
            }
            Self::Undescribed => f.write_str(
                "is not a file of a known kind; for headerless voxels add --dims NXxNYxNZ and --dtype, or put a side-car with dims and dtype beside it, as NAME.json",
            ),
            Self::Raw(fault) => raw(fault, RawKeys::Flags, f),
            Self::Roi { roi: [x, y, z], dims } => write!(
                f,
                "--roi {x:?},{y:?},{z:?} is empty or not within the volume of {dims} voxels; write X0..X1,Y0..Y1,Z0..Z1 with each end at most the side"
            ),
            Self::Downsample { factor } => write!(
                f,
                "a volume cannot be made {factor} times smaller; choose --downsample 2 or 4"
            ),
            Self::Spacing { by } => {
                let who = match by {
                    StatedBy::Caller => "--spacing",
                    StatedBy::SideCar => "spacing of the side-car",
                };
                write!(f, "{who} is out of range; give the distance of voxels in mm")
            }
            Self::SingleVolume { wanted } => {
                write!(f, "there is no volume {wanted}: it is a single one")
            }
            Self::NoSuchVolume { wanted, found } => write!(
                f,
                "there is no volume {wanted} among the {found} that were found; oct scan lists them"
            ),
            Self::NoGrid => f.write_str(
                "is a mesh or a tree of solids; say how fine its grid is with --grid N (voxels along its longest side) or --voxel MM",
            ),
            Self::SeveralTrees => f.write_str(
                "a tree of solids (.csg) is built by itself; join several by union() { ... } in one file, and meshes by import()",
            ),
            Self::NoneFound => f.write_str("no volume was found"),
            Self::Synthetic(fault) => fault.fmt(f),
        }
    }
}
