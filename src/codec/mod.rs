//! Decoders of compressed images, one frame at a time, row by row.
//!
//! A decoder reads a [`std::io::Read`] and hands rows to a [`RowSink`]; it never sees a file, a volume or a
//! DICOM element. What it holds is bounded by the memory it is given, and its time by the size that the
//! receiver accepted: nothing is allocated, and nothing looped over, because a codestream says so.

mod error;
mod frame;
pub mod jpeg;
pub mod jpeg2000;
pub mod jpegls;
pub mod rle;

pub use error::{CodecError, Damage, Feature, Mismatch};
pub use frame::{FrameBytes, FrameFormat, FrameReader, RowSink};
