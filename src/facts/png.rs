//! What can be wrong with PNG pictures.

use std::fmt;

use thiserror::Error;

/// Why PNG pictures are refused.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Error)]
pub(crate) enum PngFault {
    #[error(
        "is {picture} where the first slice is {first}; slices of a volume are alike in size and type, move the other away"
    )]
    Unlike { picture: PngHead, first: PngHead },
    #[error("holds no picture")]
    NoPicture,
    #[error("{picture} in {slices} slices are out of range")]
    OutOfRange { picture: PngHead, slices: u32 },
    #[error("its header promises {bytes} bytes, more than {file_bytes} bytes of PNG can hold")]
    Promise { bytes: u64, file_bytes: u64 },
    #[error("its PNG header is damaged")]
    Header,
    #[error("has {}, and grey values are needed; convert it to grey", colour(*.code))]
    Colour { code: u8 },
    #[error("its PNG header is damaged: samples of {bits} bits")]
    Depth { bits: u8 },
    #[error("is interlaced, which is not read; save it without")]
    Interlaced,
    #[error("the PNG picture ends early; the file was cut short, copy it again")]
    Short,
    #[error("the PNG picture is damaged ({decoder}); copy the file again")]
    Damaged { decoder: String },
    #[error("is not the picture that it was a moment ago")]
    Changed,
    #[error("the PNG picture has too few rows")]
    FewRows,
}

fn colour(code: u8) -> &'static str {
    match code {
        2 => "RGB colours",
        3 => "colours of a palette",
        4 => "grey values with transparency",
        6 => "RGB colours with transparency",
        _ => "an unknown kind of colour",
    }
}

/// Size and depth of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct PngHead {
    /// Columns and rows.
    pub size: [u32; 2],
    /// Bits of a sample.
    pub bits: u8,
}

impl fmt::Display for PngHead {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { size: [x, y], bits } = self;
        write!(f, "{x}x{y} of {bits} bits")
    }
}
