//! Why a frame cannot be decoded.

use std::io;

use thiserror::Error;

use super::jpeg::fault as jpeg;
use super::jpeg2000::fault as jpeg2000;
use super::jpegls::fault as jpegls;
use super::rle::fault as rle;

/// Why a frame cannot be decoded.
#[non_exhaustive]
#[derive(Debug, Error)]
pub enum CodecError {
    #[error("the compressed image is damaged: {0}")]
    Damaged(Damage),
    #[error("the compressed image uses {0}, which is not supported")]
    Unsupported(Feature),
    #[error("decoding the image needs {needed_bytes} bytes of memory, and {allowed_bytes} are allowed")]
    Memory { needed_bytes: u64, allowed_bytes: u64 },
    #[error("{0}")]
    Io(#[from] io::Error),
}

/// Damage in a frame.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum Damage {
    #[error("{0}")]
    Frame(Mismatch),
    #[error("{0}")]
    Jpeg(jpeg::Damage),
    #[error("{0}")]
    JpegLs(jpegls::Damage),
    #[error("{0}")]
    Jpeg2000(jpeg2000::Damage),
    #[error("{0}")]
    Rle(rle::Damage),
}

/// A feature of a frame that is not decoded.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum Feature {
    #[error("{0}")]
    Jpeg(jpeg::Feature),
    #[error("{0}")]
    JpegLs(jpegls::Feature),
    #[error("{0}")]
    Jpeg2000(jpeg2000::Feature),
    #[error("{0}")]
    Rle(rle::Feature),
}

/// How a frame differs from what surrounds it.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum Mismatch {
    #[error("it is {columns}x{rows}, and the header says {x}x{y}", columns = .size[0], rows = .size[1], x = .stated[0], y = .stated[1])]
    Size { size: [u32; 2], stated: [u32; 2] },
    #[error("it has {samples} samples a pixel, and the header says {stated}")]
    Samples { samples: u8, stated: u8 },
    #[error("it has {bits} bits a sample, and the header allocates {allocated}")]
    Bits { bits: u32, allocated: u32 },
    #[error("it has more rows than it says")]
    ManyRows,
    #[error("it has {rows} rows of {stated}")]
    FewRows { rows: u32, stated: u32 },
}

impl From<Mismatch> for CodecError {
    fn from(mismatch: Mismatch) -> Self {
        Self::Damaged(Damage::Frame(mismatch))
    }
}

macro_rules! of_codecs {
    ($($family:ident($codec:ident)),*) => {$(
        impl From<$codec::Damage> for CodecError {
            fn from(damage: $codec::Damage) -> Self {
                Self::Damaged(Damage::$family(damage))
            }
        }

        impl From<$codec::Feature> for CodecError {
            fn from(feature: $codec::Feature) -> Self {
                Self::Unsupported(Feature::$family(feature))
            }
        }
    )*};
}
of_codecs!(Jpeg(jpeg), JpegLs(jpegls), Jpeg2000(jpeg2000), Rle(rle));
