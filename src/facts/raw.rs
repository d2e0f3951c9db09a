//! What is said of a file without a header, and what is impossible in it.

use std::fmt::{self, Display, Formatter};

use crate::geom::Dims;
use crate::text::names::{DIMS, SKIP, SPACING};

/// What is wrong with what is said of files without a header.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum RawFault {
    /// Not one file for each slice.
    Files {
        /// How many files.
        files: usize,
        /// Size of the volume.
        dims: Dims,
    },
    /// The spacing is not three positive numbers.
    Spacing,
    /// No file can be as long as dims and skip require.
    Length,
}

impl RawFault {
    /// The sentence; `dims`, `spacing` and `skip` say where each can be corrected.
    fn write(&self, [dims, spacing, skip]: [&dyn Display; 3], f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Files { files, dims: size } => write!(
                f,
                "{files} slice files are given, but {size} needs {}; check {dims} and which files are given",
                size.nz()
            ),
            Self::Spacing => write!(f, "spacing must be three positive numbers of mm; check {spacing}"),
            Self::Length => write!(f, "no file can be that long; check {skip}"),
        }
    }
}

impl Display for RawFault {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        self.write([&DIMS, &SPACING, &SKIP], f)
    }
}

impl std::error::Error for RawFault {}

/// The same of files that a side-car describes.
pub(super) struct BySideCar<'a>(pub(super) &'a RawFault);

impl Display for BySideCar<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        self.0.write([&"the key dims", &"the key spacing", &"the key skip"], f)
    }
}

/// What a file without a header was said to hold.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct RawLayout {
    /// Size of the whole volume.
    pub dims: Dims,
    /// Name of the samples' type.
    pub dtype: &'static str,
    /// Which slice file it is, from 0, and of how many, where there are several.
    pub slice: Option<[usize; 2]>,
    /// Bytes before the samples.
    pub skip: u64,
}

impl Display for RawLayout {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let Self { dims, dtype, slice, skip } = self;
        match slice {
            None => write!(f, "{dims} {dtype}")?,
            Some([index, files]) => {
                write!(f, "slice file {} of {files}, {}x{} {dtype}", index + 1, dims.nx(), dims.ny())?;
            }
        }
        if *skip > 0 { write!(f, " after {skip} skipped bytes") } else { Ok(()) }
    }
}
