//! Sentences about samples in files, with a header and without.

use std::fmt;
use std::io;

use crate::facts::samples::{Damage, RawFault, RawLayout, StoredFault};
use crate::geom::Dims;

impl fmt::Display for RawLayout {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { dims, dtype, slice, skip } = self;
        match slice {
            None => write!(f, "{dims} {dtype}")?,
            Some([index, files]) => {
                write!(f, "slice file {} of {files}, {}x{} {dtype}", index + 1, dims.nx(), dims.ny())?;
            }
        }
        if *skip > 0 { write!(f, " after {skip} skipped bytes") } else { Ok(()) }
    }
}

/// How whoever reads a sentence said what files without a header hold.
#[derive(Clone, Copy)]
pub(super) enum RawKeys {
    /// With flags of the command line.
    Flags,
    /// With keys of a side-car.
    SideCar,
}

/// A fault of files without a header, in terms of where it can be corrected.
pub(super) fn raw(fault: &RawFault, keys: RawKeys, f: &mut fmt::Formatter<'_>) -> fmt::Result {
    let before = match keys {
        RawKeys::Flags => "--",
        RawKeys::SideCar => "the key ",
    };
    match fault {
        RawFault::Files { files, dims } => write!(
            f,
            "{files} slice files are given, but {dims} needs {}; check {before}dims and which files are given",
            dims.nz()
        ),
        RawFault::Spacing => {
            write!(f, "spacing must be three positive numbers of mm; check {before}spacing")
        }
        RawFault::Length => write!(f, "no file can be that long; check {before}skip"),
    }
}

impl fmt::Display for StoredFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Size { size: [x, y, z] } => write!(
                f,
                "its size of {x}x{y}x{z} voxels is out of range; a side has 1 to {} of them",
                Dims::MAX_SIDE
            ),
            Self::Volumes { count, most } => {
                write!(f, "holds {count} volumes, and 1 to {most} are read; split the file")
            }
            Self::Axes => {
                f.write_str("its axes are flat, parallel or no numbers; correct spacing and directions")
            }
            Self::Rescale { slope, intercept } => {
                write!(f, "slope {slope} and intercept {intercept} give no values")
            }
            Self::Files { files, slices } => write!(
                f,
                "{files} data files are named for {slices} slices, which cannot be shared out evenly"
            ),
            Self::Begin => f.write_str("its samples begin elsewhere than those of the first file"),
            Self::Short { promised, there } => write!(
                f,
                "the header promises {promised} bytes of samples, the file has {there}; it was cut short or its header is wrong"
            ),
            Self::ShortStream { promised, there, packing } => write!(
                f,
                "the header promises {promised} bytes of samples, more than {there} bytes of {packing} can hold; it was cut short or its header is wrong"
            ),
            Self::StreamEnds { promised, got, packing } => write!(
                f,
                "the header promises {promised} bytes, the {packing} stream ends after {got}; the file was cut short, copy it again"
            ),
            Self::StreamUnreadable { code } => {
                write!(f, "cannot be read ({})", io::Error::from_raw_os_error(*code))
            }
            Self::StreamDamaged { packing, damage } => {
                write!(f, "the {packing} stream is damaged ({damage}); copy the file again")
            }
            Self::NotRegular => f.write_str("is no regular file, so it cannot hold samples"),
            Self::LongNumber => f.write_str("a number is too long"),
            Self::Number { text } => {
                write!(f, "`{}` is no number of its type", text.escape_default())
            }
            Self::HalfByte => f.write_str("half a byte at the end"),
            Self::Digit => f.write_str("a character is no hexadecimal digit"),
        }
    }
}

impl fmt::Display for Damage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Fault(fault) => fault.fmt(f),
            Self::Decoder(text) => f.write_str(text),
        }
    }
}
