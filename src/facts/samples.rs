//! What can be wrong with samples in files: their number, their place, their packing.

use std::io;
use std::ops::Range;

use thiserror::Error;

use super::error::Fault;
pub use super::raw::{RawFault, RawLayout};
use super::stated::Packing;

/// Why the samples that a header describes cannot be read.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq)]
pub enum StoredFault {
    /// A side is out of range.
    Size {
        /// Voxels along the axes.
        size: [u64; 3],
    },
    /// Too many volumes, or none.
    Volumes {
        /// How many.
        count: u64,
        /// The most that are read.
        most: u64,
    },
    /// The axes span no space.
    Axes,
    /// Slope and intercept give no values.
    Rescale {
        /// The slope.
        slope: f64,
        /// The intercept.
        intercept: f64,
    },
    /// Slices cannot be shared out evenly to the data files.
    Files {
        /// How many files.
        files: u64,
        /// How many slices.
        slices: u64,
    },
    /// Samples begin elsewhere than in the first file.
    Begin,
    /// The file is shorter than the header says.
    Short {
        /// Bytes that the header says.
        promised: u64,
        /// Bytes that are there.
        there: u64,
    },
    /// The stream is too short to hold what the header says.
    ShortStream {
        /// Unpacked bytes that the header says.
        promised: u64,
        /// Packed bytes that are there.
        there: u64,
        /// How they are packed.
        packing: Packing,
    },
    /// The stream ended early.
    StreamEnds {
        /// Unpacked bytes that the header says.
        promised: u64,
        /// Unpacked bytes that came.
        got: u64,
        /// How it is packed.
        packing: Packing,
    },
    /// The system failed while the stream was read.
    StreamUnreadable {
        /// The system's number of the failure.
        code: i32,
    },
    /// The stream cannot be unpacked.
    StreamDamaged {
        /// How it is packed.
        packing: Packing,
        /// What is wrong.
        damage: Damage,
    },
    /// A device, a pipe or a folder.
    NotRegular,
    /// A number of text is too long.
    LongNumber,
    /// A number of text does not fit its type.
    Number {
        /// The number.
        text: String,
    },
    /// Hexadecimal text ends within a byte.
    HalfByte,
    /// A character of hexadecimal text is no digit.
    Digit,
}

/// Why rows cannot be delivered, other than by the system: it stands as the cause in
/// [`SourceError::ReadFailed`](super::SourceError::ReadFailed).
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum ReadFault {
    /// The volume has to be unrolled first.
    NotUnrolled,
    /// The rows are not within the volume, or the buffer is not as long as they are.
    Outside {
        /// Rows that were asked for.
        rows: Range<u32>,
        /// Columns that were asked for.
        cols: Range<u32>,
        /// Bytes of the buffer.
        bytes: usize,
    },
}

impl From<ReadFault> for io::Error {
    fn from(fault: ReadFault) -> Self {
        Self::new(io::ErrorKind::InvalidInput, fault)
    }
}

/// What a decoder found wrong.
#[derive(Clone, Debug, PartialEq)]
pub enum Damage {
    /// One of our own.
    Fault(Box<Fault>),
    /// A library's, in its words.
    Decoder(String),
}

impl Damage {
    /// From what reading a stream ended with.
    pub(crate) fn of(cause: io::Error) -> Self {
        match cause.downcast::<Fault>() {
            Ok(fault) => Self::Fault(Box::new(fault)),
            Err(cause) => Self::Decoder(cause.to_string()),
        }
    }
}

impl Fault {
    /// As an error of a stream, from which [`Damage::of`] and `io::Error::downcast` take it out again.
    pub(crate) fn in_stream(self) -> io::Error {
        io::Error::new(io::ErrorKind::InvalidData, self)
    }
}
