//! Why a file or folder below those that were searched is left out.

use std::fmt;
use std::io;

use super::dicom::Obstacle;
use super::sidecar::Unparsed;
use crate::text::names::{FOLLOW_LINKS, GRID, VOXEL};

/// Why a file or folder is left out.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq)]
pub enum NotVolume {
    Empty,
    Unreadable(io::ErrorKind),
    Dicom(Obstacle),
    ModelPicture,
    SinglePicture,
    Mesh,
    Tree,
    Known(Known),
    OtherSideCar,
    SideCar(Unparsed),
    Headerless,
    Unknown,
    FolderUnreadable,
    LinkedFolder,
    FolderTooDeep,
    Other,
}

impl fmt::Display for NotVolume {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Empty => f.write_str("empty file"),
            Self::Unreadable(kind) => write!(f, "cannot be read ({kind})"),
            Self::Dicom(kind) => kind.fmt(f),
            Self::ModelPicture => f.write_str("picture of a model"),
            Self::SinglePicture => f.write_str("single picture, no stack"),
            Self::Mesh => write!(f, "a triangle mesh, which is taken with {GRID} N or {VOXEL} MM only"),
            Self::Tree => write!(f, "a tree of solids, which is taken with {GRID} N or {VOXEL} MM only"),
            Self::Known(known) => known.fmt(f),
            Self::OtherSideCar => f.write_str("another side-car describes the same data"),
            Self::SideCar(unparsed) => unparsed.fmt(f),
            Self::Headerless => f.write_str(
                "headerless voxels by its name, which lack a side-car: write NAME.json beside NAME.raw, or beside the folder NAME of slices, with {\"dims\": [512, 512, 300], \"dtype\": \"u16\", \"spacing\": [0.5, 0.5, 1.0]}",
            ),
            Self::Unknown => f.write_str("not a volume"),
            Self::FolderUnreadable => f.write_str("folder that cannot be read"),
            Self::LinkedFolder => {
                write!(f, "folder that a link leads to, which is searched with {FOLLOW_LINKS} only")
            }
            Self::FolderTooDeep => f.write_str("folder that lies too deep to be searched"),
            Self::Other => f.write_str("left out for other reasons"),
        }
    }
}

/// Formats that are known by their first bytes, but not read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Known {
    Gzip,
    Jpeg,
    Ply,
    Off,
    Oct,
    Hdf5,
    NetCdf,
    VtkXml,
    Zarr,
}

impl fmt::Display for Known {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Gzip => "a gzip file, but of no volume that is read",
            Self::Jpeg => "a JPEG image",
            Self::Ply => "a PLY mesh",
            Self::Off => "an OFF mesh",
            Self::Oct => "an .oct model, not a volume",
            Self::Hdf5 => {
                "an HDF5 file (MINC 2 and NetCDF-4 are, too), whose array has to be written as .npy or NRRD first"
            }
            Self::NetCdf => {
                "a NetCDF file (MINC 1 is, too), whose array has to be written as .npy or NRRD first"
            }
            Self::VtkXml => "a VTK file in XML (.vti), which has to be written as MetaImage or NRRD first",
            Self::Zarr => "a Zarr group in which no array was found",
        })
    }
}
