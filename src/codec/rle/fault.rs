//! What can be wrong with an RLE frame.

/// What is damaged in an RLE frame.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Damage {
    /// `bytes` bytes are too few for an RLE header.
    ShortHeader {
        /// Bytes of the frame.
        bytes: u64,
    },
    /// Its RLE header has `count` segments, where the pixels need `wanted`.
    Segments {
        /// Segments that the header states.
        count: u64,
        /// Segments that the pixels need.
        wanted: usize,
    },
    /// Its RLE segment `segment` lies at `start` to `end` in a frame of `bytes` bytes.
    SegmentPlace {
        /// Number of the segment, from 1.
        segment: usize,
        /// Where it begins.
        start: u64,
        /// Where it ends.
        end: u64,
        /// Bytes of the frame.
        bytes: u64,
    },
    /// Its RLE segment `segment` ends early.
    ShortSegment {
        /// Number of the segment, from 1.
        segment: usize,
    },
}

/// What an RLE frame may use that is not decoded.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Feature {
    /// RLE samples of `bytes` bytes.
    SampleBytes {
        /// Bytes of a sample.
        bytes: u8,
    },
    /// RLE pixels of `bytes` bytes.
    PixelBytes {
        /// Bytes of a pixel.
        bytes: usize,
    },
    /// Lines of `columns` samples.
    LineSamples {
        /// Samples of a line.
        columns: u32,
    },
}
