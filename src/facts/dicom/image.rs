//! Why an image cannot be a slice of a volume.

use thiserror::Error;

use super::attribute::Attribute;
use super::scan::{ReadFault, ScanError};
use super::syntax::TransferSyntax;

/// Why an image cannot be a slice of a volume.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum ImageFault {
    /// Its pixels cannot be used.
    Pixels(Obstacle),
    /// It is a mosaic that cannot be taken apart.
    Mosaic(MosaicFault),
    /// Frames of nuclear medicine are views, detectors, energy windows or points in time.
    FramesWithoutSlices,
    /// Its frames cannot be told apart.
    Frames(ScanError),
    /// An attribute that places it, or scales its values, is infinite or not a number.
    NotFinite(Attribute),
    /// Its frames are tiles of a larger picture, as those of whole slides are.
    Tiles,
}

impl ImageFault {
    /// Does a part of the pixels lack? Such a file was whole once.
    pub fn is_cut_short(&self) -> bool {
        matches!(self, Self::Pixels(Obstacle::Truncated { .. }))
    }
}

/// Why the pixels of an object cannot be used.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum Obstacle {
    /// A report, a plan, a directory, ...
    NoPixels {
        /// What the object is.
        object: String,
    },
    /// Compressed in a way that is not decoded here.
    Codec(TransferSyntax),
    /// A transfer syntax that is not known here.
    UnknownSyntax(TransferSyntax),
    /// Pixels, but no word on what they are.
    NoDescription {
        /// Bytes of pixel data.
        bytes: u64,
    },
    /// Native syntax, but no length.
    NoLength(TransferSyntax),
    /// Number of Frames is illegible or 0. It is not guessed from the length of the pixels: what else the
    /// header says may be as wrong.
    BadFrames,
    /// More frames than could lie in the file.
    TooManyFrames {
        /// Number of Frames.
        stated: u32,
        /// Frames that the file could hold at most.
        room: u64,
    },
    /// A photometric interpretation that cannot be reduced to one number a pixel.
    Colour {
        /// Photometric Interpretation.
        photometric: String,
        /// Samples per Pixel.
        samples: u16,
    },
    /// A palette image without a palette that can be used.
    Palette,
    /// A width other than 1, 8, 16 or 32.
    BitsAllocated(u16),
    /// Bits stored and high bit do not fit the bits allocated.
    BadBits {
        /// Bits Allocated.
        allocated: u16,
        /// Bits Stored.
        stored: u16,
        /// High Bit.
        high: u16,
    },
    /// A combination that the standard does not have.
    Combination(Combination),
    /// An attribute that every image must have.
    Missing(Required),
    /// The file ends, or its pixel element ends, before the last row.
    Truncated {
        /// Bytes that the size of the image needs.
        needed: u64,
        /// Bytes that are there.
        got: u64,
    },
}

/// Pixels as the standard does not have them.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Combination {
    /// Floating point, compressed.
    CompressedFloats,
    /// One bit a pixel, compressed.
    CompressedBits,
    /// Colour with signed samples.
    SignedColour,
    /// Subsampled colour that is asked for component by component.
    SubsampledComponents,
}

/// An attribute that every image must state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Required {
    /// Rows.
    Rows,
    /// Columns.
    Columns,
    /// Bits Allocated.
    BitsAllocated,
}

/// Why the slices in a Siemens mosaic cannot be found.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum MosaicFault {
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

/// Why the private header of a Siemens image cannot be read.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum CsaFault {
    /// Its bytes cannot be had.
    Read(ReadFault),
    /// The element that holds it is damaged.
    Element(ScanError),
    /// It ends before what it announces.
    EndsEarly {
        /// Bytes that it lacks; nothing where the file ends.
        lacking: Option<u64>,
    },
    /// It states more of something than any header has.
    Count {
        /// Of what.
        of: CsaCount,
        /// How many.
        stated: u32,
    },
    /// An item is longer than the rest of it.
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
