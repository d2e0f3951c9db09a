//! Why a file or folder below those that were searched is left out.

use std::io;

use super::dicom::Obstacle;
use super::sidecar::Unparsed;

/// Why a file or folder is left out.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq)]
pub enum NotVolume {
    /// It has no bytes.
    Empty,
    /// The system refused.
    Unreadable(io::ErrorKind),
    /// DICOM, but not an image.
    Dicom(Obstacle),
    /// The picture of a model.
    ModelPicture,
    /// One picture alone.
    SinglePicture,
    /// A triangle mesh, where only volumes are taken.
    Mesh,
    /// A tree of solids, where only volumes are taken.
    Tree,
    /// Of a kind that is known, but not read.
    Known(Known),
    /// A side-car of data that another one describes.
    OtherSideCar,
    /// A side-car that cannot be parsed.
    SideCar(Unparsed),
    /// By its name headerless voxels, which lack a description.
    Headerless,
    /// Of no kind that is known.
    Unknown,
    /// A folder that may not be read.
    FolderUnreadable,
    /// A folder that a symbolic link leads to.
    LinkedFolder,
    /// A folder below the deepest that is searched.
    FolderTooDeep,
    /// One of more reasons than are kept apart.
    Other,
}

/// Formats that are known by their first bytes, but not read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Known {
    /// Gzip of something that is not read.
    Gzip,
    /// JPEG.
    Jpeg,
    /// A PLY mesh.
    Ply,
    /// An OFF mesh.
    Off,
    /// A model.
    Oct,
}
