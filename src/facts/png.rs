//! What can be wrong with PNG pictures.

/// Why PNG pictures are refused.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq)]
pub enum PngFault {
    /// A picture differs from the first in size or type.
    Unlike {
        /// The picture.
        picture: PngHead,
        /// The first one.
        first: PngHead,
    },
    /// There is no picture.
    NoPicture,
    /// Too many or too large pictures.
    OutOfRange {
        /// One of them.
        picture: PngHead,
        /// How many.
        slices: u32,
    },
    /// The headers promise more than the files can hold.
    Promise {
        /// Bytes of samples.
        bytes: u64,
        /// Bytes of files.
        file_bytes: u64,
    },
    /// The header is damaged.
    Header,
    /// Not grey values.
    Colour {
        /// Type of colour in the standard.
        code: u8,
    },
    /// A depth that the standard does not have.
    Depth {
        /// Bits of a sample.
        bits: u8,
    },
    /// Interlaced rows.
    Interlaced,
    /// The file ends early.
    Short,
    /// The pixels cannot be decoded.
    Damaged {
        /// In words of the decoder.
        decoder: String,
    },
    /// The picture was changed after it was found.
    Changed,
    /// Too few rows.
    FewRows,
}

/// Size and depth of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PngHead {
    /// Columns and rows.
    pub size: [u32; 2],
    /// Bits of a sample.
    pub bits: u8,
}
