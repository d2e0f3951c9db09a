//! What can be wrong with samples in files: their number, their place, their packing.

use std::io;
use std::ops::Range;

use thiserror::Error;

use super::error::Fault;
pub(crate) use super::raw::{RawFault, RawLayout};
use super::stated::Packing;
use crate::geom::Dims;

/// Why the samples that a header describes cannot be read.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Error)]
pub(crate) enum StoredFault {
    #[error("its size of {x}x{y}x{z} voxels is out of range; a side has 1 to {} of them", Dims::MAX_SIDE, x = .size[0], y = .size[1], z = .size[2])]
    Size { size: [u64; 3] },
    #[error("holds {count} volumes, and 1 to {most} are read; split the file")]
    Volumes { count: u64, most: u64 },
    #[error("its axes are flat, parallel or no numbers; correct spacing and directions")]
    Axes,
    #[error("slope {slope} and intercept {intercept} give no values")]
    Rescale { slope: f64, intercept: f64 },
    #[error("{files} data files are named for {slices} slices, which cannot be shared out evenly")]
    Files { files: u64, slices: u64 },
    #[error("its samples begin elsewhere than those of the first file")]
    Begin,
    #[error(
        "the header promises {promised} bytes of samples, the file has {there}; it was cut short or its header is wrong"
    )]
    Short { promised: u64, there: u64 },
    #[error(
        "the header promises {promised} bytes of samples, more than {there} bytes of {packing} can hold; it was cut short or its header is wrong"
    )]
    ShortStream { promised: u64, there: u64, packing: Packing },
    #[error(
        "the header promises {promised} bytes, the {packing} stream ends after {got}; the file was cut short, copy it again"
    )]
    StreamEnds { promised: u64, got: u64, packing: Packing },
    #[error("cannot be read ({})", io::Error::from_raw_os_error(*.code))]
    StreamUnreadable { code: i32 },
    #[error("the {packing} stream is damaged ({damage}); copy the file again")]
    StreamDamaged { packing: Packing, damage: Damage },
    #[error("is not a regular file, so it cannot hold samples")]
    NotRegular,
    #[error("a number is too long")]
    LongNumber,
    #[error("`{}` is not a number of its type", .text.escape_default())]
    Number { text: String },
    #[error("half a byte at the end")]
    HalfByte,
    #[error("a character is not a hexadecimal digit")]
    Digit,
}

/// Why rows cannot be delivered, other than by the system: it stands as the cause in
/// [`SourceFault::ReadFailed`](super::SourceFault::ReadFailed).
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum ReadFault {
    #[error("it has not been unrolled")]
    NotUnrolled,
    #[error("rows {rows:?}, columns {cols:?} into {bytes} bytes")]
    Outside { rows: Range<u32>, cols: Range<u32>, bytes: usize },
}

impl From<ReadFault> for io::Error {
    fn from(fault: ReadFault) -> Self {
        Self::new(io::ErrorKind::InvalidInput, fault)
    }
}

/// What a decoder found wrong.
#[derive(Clone, Debug, PartialEq, Error)]
pub(crate) enum Damage {
    #[error("{0}")]
    Fault(Box<Fault>),
    #[error("{0}")]
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
