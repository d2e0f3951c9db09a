//! Decoders of compressed images, one frame at a time, row by row.
//!
//! A decoder reads a [`std::io::Read`] and hands rows to a [`RowSink`]; it never sees a file, a volume or a DICOM
//! element. Its memory is bounded by the limit it is given, and its time by the size that the receiver accepted: a
//! number in a codestream alone causes neither allocations nor loops.

mod bytes;
mod error;
mod frame;
pub(crate) mod jpeg;
pub(crate) mod jpeg2000;
pub(crate) mod jpegls;
#[cfg(test)]
#[path = "../../tests/it/common/codec/kept.rs"]
mod kept;
pub(crate) mod rle;

pub(crate) use error::{CodecError, damaged, unsupported};
pub(crate) use frame::{FrameBytes, FrameFormat, RowSink};
