//! What files below a folder are, where they are not the volume that was looked for.

use std::io;
use std::sync::Arc;

use super::dicom::Obstacle;
use super::error::SourceError;
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
    /// Of a kind that is known, but not read.
    Known(Known),
    /// A side-car of data that another one describes.
    OtherSideCar,
    /// A side-car that cannot be parsed.
    SideCar(Unparsed),
    /// Of no kind that is known.
    Unknown,
    /// A folder that may not be read.
    FolderUnreadable,
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

/// Which of several volumes was taken.
#[derive(Clone, Debug, PartialEq)]
pub struct Choice {
    /// How many there were.
    pub found: usize,
    /// Was it asked for, rather than the largest?
    pub asked_for: bool,
    /// The one that is used.
    pub used: Candidate,
    /// Some of the others.
    pub others: Vec<Candidate>,
    /// How many more there are.
    pub more: usize,
}

/// A volume among several.
#[derive(Clone, Debug, PartialEq)]
pub struct Candidate {
    /// What it is.
    pub kind: String,
    /// Which part of its input it is, where that holds several volumes.
    pub part: Option<String>,
    /// Size in voxels, as far as it is known.
    pub size: Option<[u32; 3]>,
    /// Why it cannot be used.
    pub refused: Option<Refusal>,
}

/// Why a volume beside the one that is used cannot be used.
#[derive(Clone, Debug)]
pub struct Refusal(
    /// The error, which several notes may share.
    pub Arc<SourceError>,
);

impl PartialEq for Refusal {
    /// Equal if they are one and the same.
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}
