//! Errors in an RLE frame.

use thiserror::Error;

/// Damage in an RLE frame.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum Damage {
    #[error("{bytes} bytes are too few for an RLE header")]
    ShortHeader { bytes: u64 },
    #[error("its RLE header has {count} segments, where the pixels need {wanted}")]
    Segments { count: u64, wanted: usize },
    #[error("its RLE segment {segment} lies at {start} to {end} in a frame of {bytes} bytes")]
    SegmentPlace { segment: usize, start: u64, end: u64, bytes: u64 },
    #[error("its RLE segment {segment} ends early")]
    ShortSegment { segment: usize },
}

/// Features of RLE frames that are not decoded.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum Feature {
    #[error("RLE samples of {bytes} bytes")]
    SampleBytes { bytes: u8 },
    #[error("RLE pixels of {bytes} bytes")]
    PixelBytes { bytes: usize },
    #[error("lines of {columns} samples")]
    LineSamples { columns: u32 },
}
