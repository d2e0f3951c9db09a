//! What can be wrong with an input volume.

use std::fmt;
use std::io;
use std::ops::Range;
use std::path::{Path, PathBuf};

use thiserror::Error;

use super::csg::CsgFault;
use super::dicom::{DicomFault, SeriesFault};
use super::headed::HeadedFault;
use super::header::HeaderFault;
use super::left_out::{Known, NotVolume};
use super::mesh::MeshFault;
use super::metaimage::MetaImageFault;
use super::nifti::NiftiFault;
use super::npy::NpyFault;
use super::nrrd::NrrdFault;
use super::numbered::NumberFault;
use super::png::PngFault;
use super::raw::{RawFault, RawLayout};
use super::samples::StoredFault;
use super::sidecar::SideCarFault;
use super::stated::StatedBy;
use super::synthetic::SyntheticFault;
use super::tiff::TiffFault;
use super::zarr::{IndexFault, ZarrFault};
use crate::budget::Bytes;
use crate::exit::{ExitKind, opaque_error};
use crate::geom::Dims;
use crate::progress::Stopped;
use crate::text::names::{
    DIMS, DOWNSAMPLE, DTYPE, GRID, ISO, MEMORY, OVERLAP, RANGE, ROI, SCAN, SCRATCH, SKIP, SPACING, VOLUME,
    VOXEL,
};
use crate::text::{reading, shown};

opaque_error! {
    /// A source that cannot be used: which file or folder, and why.
    SourceError(SourceFault)
}

/// Why, with its sentence.
#[derive(Debug, Error)]
pub(crate) enum SourceFault {
    #[error("{}: cannot be read ({cause}); {}", shown(.path), reading(.cause, "check that it exists and that you may read it"))]
    Unreadable {
        path: PathBuf,
        #[source]
        cause: io::Error,
    },
    #[error("{}: has {got} bytes, but {expected} are needed for {layout}; check {DIMS}, {DTYPE} and {SKIP}", shown(.path))]
    SizeMismatch { path: PathBuf, expected: u64, got: u64, layout: Box<RawLayout> },
    #[error("{}: ended or failed while slice {slice} was read ({cause}); {}", shown(.path), reading(.cause, "was it changed during the build?"))]
    ReadFailed {
        path: PathBuf,
        slice: u32,
        #[source]
        cause: io::Error,
    },
    #[error("{}: {found}", shown(.path))]
    NoVolume { path: PathBuf, found: Instead },
    #[error("{}: {fault}", shown(.path))]
    Unusable { path: PathBuf, fault: Fault },
    #[error("{}: {fault}", shown(.path))]
    Dicom { path: PathBuf, fault: DicomFault },
    #[error("scratch file in {}: {cause}; {}", shown(.path), reading(.cause, format_args!("free some space or choose another folder with {SCRATCH}")))]
    Scratch {
        path: PathBuf,
        #[source]
        cause: io::Error,
    },
    #[error("{}: needs {} to be decoded, and {MEMORY} leaves only {}; allow at least {} more", shown(.path), Bytes(*.needed_bytes), Bytes(*.allowed_bytes), Bytes(.needed_bytes.saturating_sub(*.allowed_bytes)))]
    Memory { path: PathBuf, needed_bytes: u64, allowed_bytes: u64 },
    #[error("{}: has {images} images; sorting them takes {} of memory, and {} is left; allow at least {} more with {MEMORY}", shown(.path), Bytes(*.needed_bytes), Bytes(*.allowed_bytes), Bytes(.needed_bytes.saturating_sub(*.allowed_bytes)))]
    ManyImages { path: PathBuf, images: u64, needed_bytes: u64, allowed_bytes: u64 },
    #[error("{error}; or choose a volume: {VOLUME} {number} is this one, {VOLUME} {} the largest of the others ({other})", .other.number)]
    Gaps {
        #[source]
        error: Box<SourceError>,
        number: usize,
        other: Box<OtherVolume>,
    },
    #[error("{}: {misuse}", shown(.path))]
    Usage { path: PathBuf, misuse: Misuse },
    #[error("{Stopped}")]
    Stopped,
}

/// An error without its path, where that stands for itself before the reason.
pub(super) struct Reason<'a>(pub(super) &'a SourceError);

impl fmt::Display for Reason<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0.fault() {
            SourceFault::NoVolume { found, .. } => found.fmt(f),
            SourceFault::Unusable { fault, .. } => fault.fmt(f),
            SourceFault::Dicom { fault, .. } => fault.fmt(f),
            SourceFault::Usage { misuse, .. } => misuse.fmt(f),
            other => other.fmt(f),
        }
    }
}

impl SourceFault {
    /// Exit kind: wrong options are usage (2), everything else makes the input unusable (3).
    pub(crate) fn kind(&self) -> ExitKind {
        match self {
            Self::Usage { .. } => ExitKind::Usage,
            Self::Scratch { .. } => ExitKind::Io,
            Self::Memory { .. } | Self::ManyImages { .. } => ExitKind::Budget,
            Self::Stopped => ExitKind::Stopped,
            _ => ExitKind::Input,
        }
    }

    pub(crate) fn path(&self) -> Option<&Path> {
        match self {
            Self::Unreadable { path, .. }
            | Self::SizeMismatch { path, .. }
            | Self::ReadFailed { path, .. }
            | Self::NoVolume { path, .. }
            | Self::Unusable { path, .. }
            | Self::Dicom { path, .. }
            | Self::Scratch { path, .. }
            | Self::Memory { path, .. }
            | Self::ManyImages { path, .. }
            | Self::Usage { path, .. } => {
                Some(path).filter(|path| !path.as_os_str().is_empty()).map(PathBuf::as_path)
            }
            Self::Gaps { error, .. } => error.path(),
            Self::Stopped => None,
        }
    }
}

impl SourceError {
    /// The file or folder `path` cannot be read: for a [`VolumeSource`](crate::VolumeSource) or a
    /// [`Solid`](crate::builder::Solid) of your own.
    pub fn unreadable(path: impl Into<PathBuf>, cause: io::Error) -> Self {
        SourceFault::Unreadable { path: path.into(), cause }.into()
    }

    /// A slice, from 0, cannot be read: for a [`VolumeSource`](crate::VolumeSource) of your own.
    pub fn read_failed(path: impl Into<PathBuf>, slice: u32, cause: io::Error) -> Self {
        SourceFault::ReadFailed { path: path.into(), slice, cause }.into()
    }

    /// The memory in bytes that reading needs, if there was too little of it.
    pub fn minimum_bytes(&self) -> Option<u64> {
        match self.fault() {
            SourceFault::Memory { needed_bytes, .. } | SourceFault::ManyImages { needed_bytes, .. } => {
                Some(*needed_bytes)
            }
            _ => None,
        }
    }

    /// Are missing or uneven slices all that is wrong? The caller may then choose what to do about them.
    pub(crate) fn has_gaps(&self) -> bool {
        matches!(
            self.fault(),
            SourceFault::Dicom { fault: DicomFault::Series(SeriesFault::Uneven(_)), .. }
                | SourceFault::Unusable { fault: Fault::Numbers(NumberFault::Gaps(_)), .. }
        )
    }

    /// Is the input broken, rather than of a kind that is not used?
    pub(crate) fn is_damage(&self) -> bool {
        match self.fault() {
            SourceFault::Unusable { .. } => true,
            SourceFault::Dicom { fault, .. } => fault.is_damage(),
            _ => false,
        }
    }
}

/// A volume that could be taken instead.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct OtherVolume {
    /// Its number.
    pub number: usize,
    /// What it is.
    pub kind: String,
    /// Which part of its input it is, where that holds several volumes.
    pub part: Option<String>,
    /// Size in voxels, as far as it is known.
    pub size: Option<[u32; 3]>,
}

impl fmt::Display for OtherVolume {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { kind, part, size, .. } = self;
        describe(f, kind, part.as_deref(), *size)
    }
}

/// Kind, part and size of a volume.
pub(super) fn describe(
    f: &mut fmt::Formatter<'_>,
    kind: &str,
    part: Option<&str>,
    size: Option<[u32; 3]>,
) -> fmt::Result {
    f.write_str(kind)?;
    if let Some(part) = part {
        write!(f, " {part}")?;
    }
    size.map_or(Ok(()), |[x, y, z]| write!(f, " {x}x{y}x{z}"))
}

/// What was found where a volume was looked for.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Instead {
    EmptyFolder,
    NoSlices,
    Only { files: u64, kind: NotVolume },
    Unknown { files: u64 },
    File(NotVolume),
    Nothing,
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
                "no volume is among the {files} file(s); for headerless voxels add {DIMS} NXxNYxNZ and {DTYPE}"
            ),
            Self::File(kind) => kind.fmt(f),
            Self::Nothing => write!(f, "no volume was found below it; `{SCAN}` says what is there"),
        }
    }
}

/// What is wrong with a file.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Error)]
pub(crate) enum Fault {
    #[error("ends early; it was cut short, copy it again")]
    EndsEarly,
    #[error("is empty; give a DICOM series or headerless voxels")]
    Empty,
    #[error("is neither a file nor a folder; name one of these")]
    NotAFile,
    #[error("was changed while the folders were searched; start again")]
    Changed,
    #[error(
        "was changed or replaced while it was read, so no output was written; start again once it is complete"
    )]
    ChangedInUse,
    #[error(
        "is {0}; DICOM, NRRD, NIfTI, MetaImage, .npy, MRC, VTK, VGStudio, Amira, Zarr, TIFF and PNG are read, and headerless voxels with {DIMS} NXxNYxNZ and {DTYPE}"
    )]
    Known(Known),
    #[error("is not DICOM, in spite of its name; for headerless voxels add {DIMS} and {DTYPE}")]
    NotDicom,
    #[error(
        "is a mesh by its name, and is not read as a volume; meshes (STL, PLY, OBJ, OFF, glTF, 3MF) are built by themselves, with {GRID} N or {VOXEL} MM"
    )]
    Mesh,
    #[error("{0}")]
    MeshFile(MeshFault),
    #[error("holds the value {value}, and labels are whole numbers")]
    NotALabel { value: f64 },
    #[error("holds the value {value}, and labels are numbers from 1 to 65535, 0 for none")]
    LabelRange { value: f64 },
    #[error("holds more than {most} labels; choose some of them")]
    ManyLabels { most: usize },
    #[error(transparent)]
    Csg(#[from] CsgFault),
    #[error(transparent)]
    Raw(#[from] RawFault),
    #[error(transparent)]
    Header(#[from] HeaderFault),
    #[error(transparent)]
    Stored(#[from] StoredFault),
    #[error(transparent)]
    Nrrd(#[from] NrrdFault),
    #[error(transparent)]
    Nifti(#[from] NiftiFault),
    #[error(transparent)]
    MetaImage(#[from] MetaImageFault),
    #[error(transparent)]
    Headed(#[from] HeadedFault),
    #[error(transparent)]
    Npy(#[from] NpyFault),
    #[error(transparent)]
    Zarr(#[from] ZarrFault),
    #[error(transparent)]
    Tiff(#[from] TiffFault),
    #[error(transparent)]
    Png(#[from] PngFault),
    #[error(transparent)]
    SideCar(#[from] SideCarFault),
    #[error(transparent)]
    Numbers(#[from] NumberFault),
    #[error(
        "holds the values {one} and {other}, where a mask has one; build it alone, or choose it with {VOLUME} N"
    )]
    NotMask { one: f64, other: f64 },
}

/// What is wrong with a request.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Error)]
pub(crate) enum Misuse {
    #[error("no input file is given")]
    NoInput,
    #[error("is a folder among several inputs; give one folder, or files only")]
    FolderAmongFiles,
    #[error(
        "is not a file of a known kind; for headerless voxels add {DIMS} NXxNYxNZ and {DTYPE}, or put a side-car with dims and dtype beside it, as NAME.json"
    )]
    Undescribed,
    #[error(
        "contains headerless voxels, judging by its name (.vol); put the .vgi that describes it into its folder, or add {DIMS} NXxNYxNZ and {DTYPE}"
    )]
    SamplesOnly,
    #[error("{0}")]
    Raw(RawFault),
    #[error("{ROI} {x:?},{y:?},{z:?} is empty or not within the volume of {dims} voxels; write X0..X1,Y0..Y1,Z0..Z1 with each end at most the side", x = .roi[0], y = .roi[1], z = .roi[2])]
    Roi { roi: [Range<u32>; 3], dims: Dims },
    #[error("a volume cannot be made {factor} times smaller; choose {DOWNSAMPLE} 2 or 4")]
    Downsample { factor: u32 },
    #[error("{} is out of range; give the distance of voxels in mm", .by.named(SPACING, "spacing"))]
    Spacing { by: StatedBy },
    #[error("there is no volume {wanted}: the input has only one")]
    SingleVolume { wanted: usize },
    #[error("there is no volume {wanted} among the {found} that were found; {SCAN} lists them")]
    NoSuchVolume { wanted: usize, found: usize },
    #[error("is a volume, which has a grid of its own")]
    OwnGrid,
    #[error(
        "a tree of solids (.csg) is built by itself; join several by union() {{ ... }} in one file, and meshes by import()"
    )]
    SeveralTrees,
    #[error("no volume was found")]
    NoneFound,
    #[error("{0}")]
    Index(IndexFault),
    #[error(
        "lies on another grid than {first}; masks of one grid become one map of labels: give those, or choose a volume with {VOLUME} N"
    )]
    OtherGrid { first: String },
    #[error("{voxels} voxel(s) are in several masks; choose which mask wins with {OVERLAP} first or last")]
    Overlaps { voxels: u64 },
    #[error(
        "is a FRACTIONAL segmentation: its values are parts of voxels, not labels; choose a part with {ISO} V or {RANGE} LO..HI"
    )]
    Fractional,
    #[error("{found} masks are more than the {most} that one map can be made of")]
    ManyMasks { found: usize, most: usize },
    #[error("{0}")]
    Synthetic(SyntheticFault),
}
