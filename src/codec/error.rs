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
    /// The codestream is damaged, ends early, or is not what its receiver expects.
    Damaged(Damage),
    /// The codestream is sound, but of a kind that is not decoded here.
    Unsupported(Feature),
    /// Decoding needs more memory than allowed.
    Memory {
        /// Bytes that decoding would take.
        needed_bytes: u64,
        /// Bytes that it may take.
        allowed_bytes: u64,
    },
    /// The input failed, or the receiver did.
    Io(#[from] io::Error),
}

/// What is damaged in a frame.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Damage {
    /// It is not the frame that its receiver expects.
    Frame(Mismatch),
    /// In a JPEG image.
    Jpeg(jpeg::Damage),
    /// In a JPEG-LS image.
    JpegLs(jpegls::Damage),
    /// In a JPEG 2000 image.
    Jpeg2000(jpeg2000::Damage),
    /// In an RLE frame.
    Rle(rle::Damage),
}

/// What a frame uses that is not decoded.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Feature {
    /// Of JPEG.
    Jpeg(jpeg::Feature),
    /// Of JPEG-LS.
    JpegLs(jpegls::Feature),
    /// Of JPEG 2000.
    Jpeg2000(jpeg2000::Feature),
    /// Of RLE.
    Rle(rle::Feature),
}

/// How a frame differs from what surrounds it.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mismatch {
    /// Columns and rows.
    Size {
        /// Of the frame.
        size: [u32; 2],
        /// Of the header around it.
        stated: [u32; 2],
    },
    /// Samples per pixel.
    Samples {
        /// Of the frame.
        samples: u8,
        /// Of the header around it.
        stated: u8,
    },
    /// More bits a sample than there is room for.
    Bits {
        /// Of the frame.
        bits: u32,
        /// Of the header around it.
        allocated: u32,
    },
    /// More rows than the frame itself states.
    ManyRows,
    /// Fewer rows than the frame itself states.
    FewRows {
        /// Rows that came.
        rows: u32,
        /// Rows that are stated.
        stated: u32,
    },
}

impl From<Mismatch> for CodecError {
    fn from(mismatch: Mismatch) -> Self {
        Self::Damaged(Damage::Frame(mismatch))
    }
}

impl From<jpeg::Damage> for CodecError {
    fn from(damage: jpeg::Damage) -> Self {
        Self::Damaged(Damage::Jpeg(damage))
    }
}

impl From<jpeg::Feature> for CodecError {
    fn from(feature: jpeg::Feature) -> Self {
        Self::Unsupported(Feature::Jpeg(feature))
    }
}

impl From<jpegls::Damage> for CodecError {
    fn from(damage: jpegls::Damage) -> Self {
        Self::Damaged(Damage::JpegLs(damage))
    }
}

impl From<jpegls::Feature> for CodecError {
    fn from(feature: jpegls::Feature) -> Self {
        Self::Unsupported(Feature::JpegLs(feature))
    }
}

impl From<jpeg2000::Damage> for CodecError {
    fn from(damage: jpeg2000::Damage) -> Self {
        Self::Damaged(Damage::Jpeg2000(damage))
    }
}

impl From<jpeg2000::Feature> for CodecError {
    fn from(feature: jpeg2000::Feature) -> Self {
        Self::Unsupported(Feature::Jpeg2000(feature))
    }
}

impl From<rle::Damage> for CodecError {
    fn from(damage: rle::Damage) -> Self {
        Self::Damaged(Damage::Rle(damage))
    }
}

impl From<rle::Feature> for CodecError {
    fn from(feature: rle::Feature) -> Self {
        Self::Unsupported(Feature::Rle(feature))
    }
}
