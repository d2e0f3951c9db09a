//! What can be wrong with an input volume.

use std::io;
use std::ops::Range;
use std::path::{Path, PathBuf};

use thiserror::Error;

use super::csg::CsgFault;
use super::dicom::{DicomFault, SeriesFault};
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
use crate::exit::ExitKind;
use crate::geom::Dims;

/// A source that cannot be used: which file or folder, and why.
#[non_exhaustive]
#[derive(Debug, Error)]
pub enum SourceError {
    /// The operating system refused.
    Unreadable {
        /// File or folder.
        path: PathBuf,
        /// The system's reason.
        #[source]
        cause: io::Error,
    },
    /// File size and stated dims disagree.
    SizeMismatch {
        /// The file.
        path: PathBuf,
        /// Bytes that dims, type and skip require.
        expected: u64,
        /// Bytes that are there.
        got: u64,
        /// What the file was said to hold.
        layout: Box<RawLayout>,
    },
    /// The file shrank or failed while it was being read.
    ReadFailed {
        /// The file.
        path: PathBuf,
        /// Slice index.
        slice: u32,
        /// The system's reason.
        #[source]
        cause: io::Error,
    },
    /// A folder without a usable image.
    NoVolume {
        /// The folder or file.
        path: PathBuf,
        /// What was found instead.
        found: Instead,
    },
    /// The file is damaged, or of a kind that cannot be used.
    Unusable {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        fault: Fault,
    },
    /// A DICOM file or series that cannot be used.
    Dicom {
        /// The file, or the folder of the files.
        path: PathBuf,
        /// Why.
        fault: DicomFault,
    },
    /// The scratch file that a sequential input is unrolled into cannot be written.
    Scratch {
        /// The folder.
        path: PathBuf,
        /// The system's reason.
        #[source]
        cause: io::Error,
    },
    /// Unrolling the input needs more memory than allowed.
    Memory {
        /// The file.
        path: PathBuf,
        /// Bytes that decoding takes.
        needed_bytes: u64,
        /// Bytes that it may take.
        allowed_bytes: u64,
    },
    /// Putting the images of a series in order needs more memory than allowed.
    ManyImages {
        /// The series' first file.
        path: PathBuf,
        /// Files, or frames where files have several.
        images: u64,
        /// Bytes that ordering takes, about.
        needed_bytes: u64,
        /// Bytes that it may take.
        allowed_bytes: u64,
    },
    /// The largest of several volumes lacks slices, and another one would be taken for it.
    Gaps {
        /// Why it is refused.
        #[source]
        error: Box<SourceError>,
        /// Its number.
        number: usize,
        /// The largest of the others.
        other: Box<OtherVolume>,
    },
    /// The request does not fit the input (for example a headerless file of which nothing is said).
    Usage {
        /// The file or folder.
        path: PathBuf,
        /// What is wrong with the request.
        misuse: Misuse,
    },
}

impl SourceError {
    /// Exit kind: wrong options are usage (2), everything else makes the input unusable (3).
    pub fn kind(&self) -> ExitKind {
        match self {
            Self::Usage { .. } => ExitKind::Usage,
            Self::Scratch { .. } => ExitKind::Io,
            Self::Memory { .. } | Self::ManyImages { .. } => ExitKind::Budget,
            _ => ExitKind::Input,
        }
    }

    /// The file or folder at fault.
    pub fn path(&self) -> &Path {
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
            | Self::Usage { path, .. } => path,
            Self::Gaps { error, .. } => error.path(),
        }
    }

    /// Is nothing wrong but slices that are missing, or lie unevenly, so that whoever asks may choose?
    pub(crate) fn has_gaps(&self) -> bool {
        matches!(
            self,
            Self::Dicom { fault: DicomFault::Series(SeriesFault::Uneven(_)), .. }
                | Self::Unusable { fault: Fault::Numbers(NumberFault::Gaps(_)), .. }
        )
    }

    /// Is the input broken, rather than of a kind that is not used?
    pub(crate) fn is_damage(&self) -> bool {
        match self {
            Self::Unusable { .. } => true,
            Self::Dicom { fault, .. } => fault.is_damage(),
            _ => false,
        }
    }
}

/// A volume that could be taken instead.
#[derive(Clone, Debug, PartialEq)]
pub struct OtherVolume {
    /// Its number.
    pub number: usize,
    /// What it is.
    pub kind: String,
    /// Which part of its input it is, where that holds several volumes.
    pub part: Option<String>,
    /// Size in voxels, as far as it is known.
    pub size: Option<[u32; 3]>,
}

/// What was found where a volume was looked for.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq)]
pub enum Instead {
    /// No file at all.
    EmptyFolder,
    /// No file that could be a slice without a header.
    NoSlices,
    /// Files of one kind only.
    Only {
        /// How many.
        files: u64,
        /// Their kind.
        kind: NotVolume,
    },
    /// Files of which none is known.
    Unknown {
        /// How many.
        files: u64,
    },
    /// A single file that is something else.
    File(NotVolume),
    /// Nothing below several inputs.
    Nothing,
}

/// What is wrong with a file.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Error)]
pub enum Fault {
    /// It ends within its header.
    EndsEarly,
    /// It has no bytes.
    Empty,
    /// It is neither a file nor a folder.
    NotAFile,
    /// It was changed after it was found.
    Changed,
    /// It was changed, cut, grown or replaced while samples were read.
    ChangedInUse,
    /// It is of a kind that is known, but not read.
    Known(Known),
    /// It is named like DICOM only.
    NotDicom,
    /// It is named like a mesh.
    Mesh,
    /// A mesh that cannot be used.
    MeshFile(MeshFault),
    /// A tree of solids that cannot be used.
    Csg(CsgFault),
    /// Files without a header do not fit what is said of them.
    Raw(RawFault),
    /// What formats with headers of text share.
    Header(HeaderFault),
    /// Samples that do not fit their header.
    Stored(StoredFault),
    /// NRRD.
    Nrrd(NrrdFault),
    /// NIfTI.
    Nifti(NiftiFault),
    /// MetaImage.
    MetaImage(MetaImageFault),
    /// NumPy arrays.
    Npy(NpyFault),
    /// TIFF.
    Tiff(TiffFault),
    /// PNG.
    Png(PngFault),
    /// Side-cars.
    SideCar(SideCarFault),
    /// Slices numbered by their names.
    Numbers(NumberFault),
}

/// What is wrong with a request.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq)]
pub enum Misuse {
    /// Nothing is given.
    NoInput,
    /// A folder is given beside other inputs.
    FolderAmongFiles,
    /// Nothing is said of a file without a header.
    Undescribed,
    /// What is said of a file without a header is impossible.
    Raw(RawFault),
    /// The box of a crop is empty, or not within the volume.
    Roi {
        /// The box, along x, y, z.
        roi: [Range<u32>; 3],
        /// Size of the volume.
        dims: Dims,
    },
    /// A volume cannot be made that many times smaller.
    Downsample {
        /// How many times.
        factor: u32,
    },
    /// A spacing gives no sound affine.
    Spacing {
        /// Who stated it.
        by: StatedBy,
    },
    /// Another volume than the only one is asked for.
    SingleVolume {
        /// Its number.
        wanted: usize,
    },
    /// A volume is asked for that is not there.
    NoSuchVolume {
        /// Its number.
        wanted: usize,
        /// How many there are.
        found: usize,
    },
    /// Nothing says how fine the grid of a mesh is to be.
    NoGrid,
    /// A tree of solids among other inputs.
    SeveralTrees,
    /// There is no volume at all.
    NoneFound,
    /// The description of a synthetic volume is wrong.
    Synthetic(SyntheticFault),
}

macro_rules! of_family {
    ($($family:ident($fault:ty)),* $(,)?) => {$(
        impl From<$fault> for Fault {
            fn from(fault: $fault) -> Self {
                Self::$family(fault)
            }
        }
    )*};
}
of_family!(
    Csg(CsgFault),
    Raw(RawFault),
    Header(HeaderFault),
    Stored(StoredFault),
    Nrrd(NrrdFault),
    Nifti(NiftiFault),
    MetaImage(MetaImageFault),
    Npy(NpyFault),
    Tiff(TiffFault),
    Png(PngFault),
    SideCar(SideCarFault),
    Numbers(NumberFault),
);
