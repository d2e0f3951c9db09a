//! Why an image cannot be a slice of a volume.

use std::fmt::{self, Display, Formatter};

use thiserror::Error;

use super::attribute::Attribute;
use super::scan::{ReadFault, ScanError};
use super::syntax::TransferSyntax;

/// Why an image cannot be a slice of a volume.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub(crate) enum ImageFault {
    #[error("{0}")]
    Pixels(Obstacle),
    #[error("{0}")]
    Mosaic(MosaicFault),
    #[error(
        "its frames are views, detectors, energy windows or points in time, not slices (there is no Slice Vector (0054,0080)), so they form no volume"
    )]
    FramesWithoutSlices,
    #[error("its frames cannot be distinguished: {0}")]
    Frames(ScanError),
    #[error(
        "its {0} is infinite or not a number, so that neither place nor values are known; correct the header"
    )]
    NotFinite(Attribute),
    #[error(
        "its frames are tiles of a larger picture (a whole slide, or what was found on one), not slices, so they form no volume"
    )]
    Tiles,
}

impl ImageFault {
    /// Does a part of the pixels lack? Such a file was whole once.
    pub(crate) fn is_cut_short(&self) -> bool {
        matches!(self, Self::Pixels(Obstacle::Truncated { .. }))
    }
}

/// Why the pixels of an object cannot be used.
#[expect(missing_docs, reason = "the sentence of each variant says it")]
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum Obstacle {
    #[error("{object} without pixels")]
    NoPixels { object: String },
    #[error("compressed pixels ({}) cannot be read{}", .0, .0.remedy())]
    Codec(TransferSyntax),
    #[error("pixels in an {0} cannot be read")]
    UnknownSyntax(TransferSyntax),
    #[error(
        "there are {bytes} bytes of pixel data, but no image description: rows, columns and bits allocated are missing"
    )]
    NoDescription { bytes: u64 },
    #[error("the pixels have no length, though {0} pixels must have one")]
    NoLength(TransferSyntax),
    /// Number of Frames is illegible or 0. It is not guessed from the length of the pixels: what else the
    /// header says may be as wrong.
    #[error("the number of frames is not a positive number")]
    BadFrames,
    #[error("{stated} frames are stated, and the file is too short for more than {room}")]
    TooManyFrames { stated: u32, room: u64 },
    #[error("colour images ({photometric}, {samples} samples a pixel) of this kind cannot be read")]
    Colour { photometric: String, samples: u16 },
    #[error("the palette is missing, or of a kind that cannot be read")]
    Palette,
    #[error("pixels of {0} bits allocated cannot be read")]
    BitsAllocated(u16),
    #[error("{stored} bits stored with high bit {high} do not fit {allocated} bits allocated")]
    BadBits { allocated: u16, stored: u16, high: u16 },
    #[error("{0} cannot be read")]
    Combination(Combination),
    #[error("the image does not state its {0}")]
    Missing(Required),
    #[error("the pixels are cut short: {got} bytes of {needed}")]
    Truncated { needed: u64, got: u64 },
}

/// Pixels as the standard does not have them.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Combination {
    CompressedFloats,
    CompressedBits,
    SignedColour,
    SubsampledComponents,
}

impl Display for Combination {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::CompressedFloats => "compressed floating-point pixels",
            Self::CompressedBits => "compressed pixels of one bit",
            Self::SignedColour => "colour with signed samples",
            Self::SubsampledComponents => "subsampled colour as components",
        })
    }
}

/// An attribute that every image must state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Required {
    Rows,
    Columns,
    BitsAllocated,
}

impl Display for Required {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Rows => "rows",
            Self::Columns => "columns",
            Self::BitsAllocated => "bits allocated",
        })
    }
}

/// Why the slices in a Siemens mosaic cannot be found.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub(crate) enum MosaicFault {
    /// It has several frames.
    SeveralFrames,
    /// Two private elements state different numbers of slices.
    SlicesDisagree {
        /// That of the private header, and that of the other.
        stated: [u32; 2],
    },
    /// Nothing states the number of slices.
    NoSliceNumber {
        /// Why the private header, which has it, cannot be read.
        header: Option<CsaFault>,
    },
    /// The picture cannot be divided into as many tiles.
    Tiles {
        /// Slices that are stated.
        slices: u32,
        /// Tiles in a row, and in a column.
        across: u32,
        /// Size of the picture.
        columns: u32,
        /// Size of the picture.
        rows: u32,
    },
    /// The stated normal of the slices is not that of the picture.
    OtherNormal,
    /// Tiles are laid out as another vendor does, in a way that is not read.
    OtherVendor,
}

impl Display for MosaicFault {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        if *self != Self::OtherVendor {
            f.write_str("a Siemens mosaic ")?;
        }
        match self {
            Self::OtherVendor => f.write_str(
                "a frame set of United Imaging (VFRAME) holds its slices as tiles of one picture, which is not read; \
                 export it with one file for each slice",
            ),
            Self::SeveralFrames => f.write_str("of several frames cannot be read"),
            Self::SlicesDisagree { stated: [a, b] } => {
                write!(f, "whose private elements state {a} slices, and {b} in another place")
            }
            Self::NoSliceNumber { header } => {
                f.write_str(
                    "does not state the number of its slices, which only the private header (0029,1010) has",
                )?;
                if let Some(fault) = header {
                    write!(f, " (it cannot be read: {fault})")?;
                }
                f.write_str("; give the original files, or convert them on the scanner")
            }
            Self::Tiles { slices, across, columns, rows } => write!(
                f,
                "of {slices} slices has {across} x {across} tiles, and its {columns} x {rows} pixels cannot be \
                 divided so"
            ),
            Self::OtherNormal => f.write_str(
                "states a slice normal in its private header that is not perpendicular to its rows and columns",
            ),
        }
    }
}

/// Why the private header of a Siemens image cannot be read.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum CsaFault {
    #[error("{0}")]
    Read(ReadFault),
    #[error("{0}")]
    Element(ScanError),
    #[error("it ends {}too early", .lacking.map_or_else(String::new, |bytes| format!("{bytes} bytes ")))]
    EndsEarly {
        /// Bytes that it lacks; nothing where the file ends.
        lacking: Option<u64>,
    },
    #[error("it states {stated} {of}")]
    Count { of: CsaCount, stated: u32 },
    #[error("an item is longer than the rest of it")]
    LongItem,
}

impl From<std::io::Error> for CsaFault {
    fn from(error: std::io::Error) -> Self {
        Self::Read(error.into())
    }
}

impl From<ScanError> for CsaFault {
    fn from(error: ScanError) -> Self {
        Self::Element(error)
    }
}

/// What the private header of a Siemens image counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CsaCount {
    /// Its tags.
    Tags,
    /// The items of a tag.
    Items,
}

impl Display for CsaCount {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Tags => "tags",
            Self::Items => "items",
        })
    }
}
