//! A volume that can be read: one trait, its facts, and volumes that wrap others.
//!
//! A source states its [`VolumeInfo`] and delivers any rows of any slice; the builder asks for what
//! its budget allows and never sees a path. Sources are shared by the builder's threads.
//!
//! | part | what it holds |
//! |---|---|
//! | `scalar` | types of samples and their byte order |
//! | `description` | origin of a volume, as a model records it |
//! | [`Voxels`], [`VolumeView`] | a volume that is in memory already: owned, borrowed |
//! | [`Slices`] | a volume whose slices come one after the other |
//! | `block`, `blend`, `spool` | rows read by position, mixed, and unrolled first |
//! | `wrapper`, `placement`, `crop`, `downsample`, `gap_fill`, `watch` | volumes that wrap another one, and change its
//! facts or samples |

mod blend;
mod block;
mod crop;
mod description;
mod downsample;
mod error;
mod gap_fill;
mod masks;
mod note;
mod placement;
mod scalar;
mod slices;
mod spool;
mod view;
mod voxels;
mod watch;
mod wrapper;

pub(crate) use blend::{blend_rows, neighbour_bytes};
pub(crate) use block::{check_request, not_unrolled, read_block};
pub use crop::Crop;
pub(crate) use description::FRACTIONAL;
pub use description::{ImageKind, SourceDescription, StatedLabel, Treatment};
pub use downsample::Downsample;
pub use error::SourceError;
pub(crate) use error::SourceFault;
pub(crate) use gap_fill::GapFill;
pub use masks::Overlap;
pub(crate) use masks::{MAX_MASKS, MaskPart, Masks, settle_overlaps};
pub(crate) use note::NoteKind;
pub use note::{Note, sentences};
pub use placement::Placement;
pub(crate) use placement::{StatedBy, place};
pub use scalar::{Endian, Scalar, ScalarType};
pub use slices::Slices;
pub(crate) use spool::Spool;
pub use view::VolumeView;
pub use voxels::Voxels;
pub(crate) use watch::FileWatch;
pub(crate) use wrapper::{InfoOverride, Wrapper};

use std::fmt;
use std::ops::Range;
use std::path::{Path, PathBuf};

use crate::budget::{Budget, Reservation};
use crate::geom::{Affine, Dims};
use crate::progress::{Progress, Stopped};

/// Result of opening or reading a volume.
pub type Result<T = (), E = SourceError> = std::result::Result<T, E>;

/// Facts of a volume that are known before its voxels are read.
#[derive(Clone, Debug)]
pub struct VolumeInfo {
    /// Size in voxels.
    pub dims: Dims,
    /// Type of the samples that [`VolumeSource::read_rows`] delivers (native byte order).
    pub scalar: ScalarType,
    /// `physical = slope * sample + intercept` for every sample (HU for CT). A source whose slices
    /// differ delivers `F32` samples that are physical already.
    pub rescale: Rescale,
    /// Distance in mm between neighbours along each index axis.
    pub spacing_mm: [f64; 3],
    /// Voxel index to LPS mm.
    pub affine: Affine,
    /// Origin of the volume, for the metadata and for messages.
    pub description: SourceDescription,
    /// Notes on guesses, omissions, replacements and oddities.
    pub notes: Vec<Note>,
}

impl VolumeInfo {
    /// Facts of samples in memory: voxels of 1 mm, the middle of the first one at the origin.
    pub(crate) fn in_memory(dims: Dims, scalar: ScalarType) -> Self {
        Self {
            dims,
            scalar,
            rescale: Rescale::IDENTITY,
            spacing_mm: [1.0; 3],
            affine: Affine::from_spacing([1.0; 3]),
            description: SourceDescription {
                format: "memory".into(),
                name: "voxels in memory".into(),
                bytes: dims.voxels() * scalar.bytes() as u64,
                ..SourceDescription::default()
            },
            notes: Vec::new(),
        }
    }

    /// Moves the voxels to where `affine` maps them.
    pub(crate) fn place(&mut self, affine: Affine) {
        self.affine = affine;
        self.spacing_mm = affine.spacing_mm();
    }
}

/// Linear map from stored samples to physical values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rescale {
    /// Factor; never 0, finite.
    pub slope: f64,
    /// Offset; finite.
    pub intercept: f64,
}

impl Rescale {
    /// Samples are physical values.
    pub const IDENTITY: Self = Self { slope: 1.0, intercept: 0.0 };

    /// Physical value of a sample.
    pub fn apply(self, sample: f64) -> f64 {
        self.slope * sample + self.intercept
    }
}

/// Resources that a source needs before any of its rows can be read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Preparation {
    /// Bytes to be written to an anonymous scratch file; 0 if nothing has to be unrolled.
    pub scratch_bytes: u64,
    /// Memory in bytes that is held meanwhile, beyond the opened source's.
    pub memory_bytes: u64,
    /// True if parts are unrolled on demand, when they are read.
    pub on_demand: bool,
}

/// Scratch space, memory and progress for a source that unrolls itself.
#[derive(Clone)]
pub struct Workspace<'a> {
    /// Folder for an anonymous scratch file.
    pub scratch: &'a Path,
    /// Memory that may be held meanwhile.
    pub memory: Budget,
    /// Receives the progress.
    pub progress: &'a dyn Progress,
}

impl Workspace<'_> {
    /// Takes the memory for unrolling the file that `path` names.
    ///
    /// # Errors
    /// [`SourceError`].
    pub(crate) fn reserve(&self, bytes: u64, path: impl FnOnce() -> PathBuf) -> Result<Reservation> {
        self.memory.reserve(bytes).map_err(|refused| {
            SourceError::from(SourceFault::Memory {
                path: path(),
                needed_bytes: refused.needed_bytes,
                allowed_bytes: refused.left_bytes,
            })
        })
    }
}

impl From<Stopped> for SourceError {
    fn from(_: Stopped) -> Self {
        SourceFault::Stopped.into()
    }
}

/// A volume that can deliver any rows of any slice.
///
/// Implementations keep little memory of their own (it is stated by [`VolumeSource::resident_bytes`])
/// and read by position, so that threads do not disturb each other. Two methods are enough:
///
/// ```
/// use infobyte::volume::{SourceDescription, SourceError};
/// use infobyte::{Affine, BuildOptions, Dims, Rescale, ScalarType, Threshold, VolumeInfo, VolumeSource};
/// use std::ops::Range;
///
/// /// A bowl: samples are computed where they are asked for.
/// struct Bowl(VolumeInfo);
///
/// impl VolumeSource for Bowl {
///     fn info(&self) -> &VolumeInfo {
///         &self.0
///     }
///
///     fn read_rows(
///         &self,
///         z: u32,
///         rows: Range<u32>,
///         cols: Range<u32>,
///         out: &mut [u8],
///     ) -> Result<(), SourceError> {
///         let places = rows.flat_map(|y| cols.clone().map(move |x| (x, y)));
///         for ((x, y), sample) in places.zip(out) {
///             let height = (f64::from(x) - 15.5).hypot(f64::from(y) - 15.5) / 2.0;
///             *sample = u8::from((height - f64::from(z)).abs() < 1.0);
///         }
///         Ok(())
///     }
/// }
///
/// # fn main() -> Result<(), infobyte::Error> {
/// # let folder = tempfile::tempdir().expect("a temporary folder");
/// # let path = folder.path().join("bowl.oct");
/// let bowl = Bowl(VolumeInfo {
///     dims: Dims::new(32, 32, 16).unwrap(),
///     scalar: ScalarType::U8,
///     rescale: Rescale::IDENTITY,
///     spacing_mm: [0.5; 3],
///     affine: Affine::from_spacing([0.5; 3]),
///     description: SourceDescription::default(),
///     notes: Vec::new(),
/// });
/// let options = BuildOptions { threshold: Threshold::Iso(1.0), ..Default::default() };
/// assert!(infobyte::build(&bowl, &options, &path)?.skin_voxels > 500);
/// # Ok(())
/// # }
/// ```
pub trait VolumeSource: Send + Sync {
    /// Static facts; known before [`VolumeSource::prepare`].
    fn info(&self) -> &VolumeInfo;

    /// Makes a volume of averages average the mask of a label map instead of its numbers, if `labels` counts labels in
    /// the volume behind it.
    #[doc(hidden)]
    fn average_mask(&mut self, labels: &dyn Fn(&dyn VolumeSource) -> Option<usize>) {
        let _ = labels;
    }

    /// The kind of image, such as `CT` or `MR`, where the input states it.
    fn modality(&self) -> Option<&str> {
        None
    }

    /// Calls `each` for every file that samples are read from, as far as the source knows them; the catalogue asks the
    /// volumes that a format has opened, so that a change of samples outside the header is noticed.
    fn for_each_file(&self, _each: &mut dyn FnMut(&Path)) {}

    /// Checks that the files have not changed since the volume was opened. Called after the last read, before the
    /// output gets its name: samples from two states of a file form a volume that never existed.
    ///
    /// # Errors
    /// [`SourceError`] with the first file that has changed. Only volumes from
    /// [`discovery::open`](fn@crate::discovery::open) notice it.
    fn check_unchanged(&self) -> Result {
        Ok(())
    }

    /// Resources that [`VolumeSource::prepare`] will take.
    fn preparation(&self) -> Preparation {
        Preparation::default()
    }

    /// Unrolls a source that can only be read from front to back (compressed frames, gzip) into an anonymous
    /// scratch file. Called once, before any row is read; nothing to do where rows lie in the file.
    ///
    /// # Errors
    /// The input is damaged, the scratch folder is full, or the memory allowed is too little.
    fn prepare(&mut self, workspace: &Workspace<'_>) -> Result {
        let _ = workspace;
        Ok(())
    }

    /// Fills `out` with columns `cols` of rows `rows` of slice `z`: x fastest, no padding, samples of
    /// [`VolumeInfo::scalar`] in native byte order; `out` is exactly that long.
    ///
    /// # Errors
    /// The file became unreadable or ended early.
    fn read_rows(&self, z: u32, rows: Range<u32>, cols: Range<u32>, out: &mut [u8]) -> Result;

    /// Like [`VolumeSource::read_rows`], but row r of the block begins at byte `r * pitch` of `out`, and bytes between
    /// rows stay unchanged. `out` ends with the last row.
    ///
    /// Rows a little apart do not compete for the same cache lines, as rows of 2^n bytes do.
    ///
    /// # Errors
    /// The errors of [`VolumeSource::read_rows`].
    fn read_pitched(
        &self,
        z: u32,
        rows: Range<u32>,
        cols: Range<u32>,
        pitch: usize,
        out: &mut [u8],
    ) -> Result {
        row_by_row(self, z, rows, cols, pitch, out)
    }

    /// Memory in bytes per reading thread, beyond the opened source's.
    fn resident_bytes(&self) -> u64 {
        0
    }
}

/// [`VolumeSource::read_pitched`] in terms of [`VolumeSource::read_rows`].
pub(crate) fn row_by_row(
    source: &(impl VolumeSource + ?Sized),
    z: u32,
    rows: Range<u32>,
    cols: Range<u32>,
    pitch: usize,
    out: &mut [u8],
) -> Result {
    let row_bytes = cols.len() * source.info().scalar.bytes();
    for (row, part) in rows.zip(out.chunks_mut(pitch)) {
        source.read_rows(z, row..row + 1, cols.clone(), part.get_mut(..row_bytes).unwrap_or_default())?;
    }
    Ok(())
}

impl fmt::Debug for dyn VolumeSource + '_ {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.info().fmt(f)
    }
}
