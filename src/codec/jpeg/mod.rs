//! JPEG (ITU-T T.81): sequential and progressive DCT of 8 and 12 bits, and lossless of 2 to 16 bits, all
//! with Huffman codes.
//!
//! | process | what DICOM calls it | held at once |
//! |---|---|---|
//! | SOF0, SOF1 | baseline (.50), extended (.51) | one row of MCUs |
//! | SOF2 | spectral selection (.53), full progression (.55) | two bytes for each sample |
//! | SOF3 | lossless (.57, .70) | two lines |
//!
//! A sequential or lossless frame whose components come in scans of their own is held whole as well. To
//! that come about 30 KiB of tables and input. Samples come as they are coded: no colour conversion, and
//! subsampled components by repetition.
//!
//! Not decoded: arithmetic coding, hierarchical frames, a height that stands behind the pixels (DNL), and
//! lossless frames with subsampled components.
//!
//! A damaged image gives an error, never invented pixels: data that run out, or do not, at the last pixel;
//! codes that no table has; restart markers that do not come in turn; scans out of order. A missing end
//! marker is not damage once every sample is there, and what follows it is not read.

mod bits;
mod bytes;
mod dct;
#[cfg(test)]
#[path = "../../../tests/it/common/codec/jpeg.rs"]
mod encoder;
mod huffman;
mod lossless;
mod markers;
mod progressive;
mod sequential;
mod strip;
#[cfg(test)]
mod tests;

use std::io::Read;

use super::{CodecError, RowSink};
use crate::codec::damaged;
use bytes::{BUFFER_BYTES, Bytes};
use markers::{Event, Process, Tables};

/// Decodes one frame.
///
/// Time is bounded by the length of the input, and for a progressive frame by its number of samples.
///
/// # Errors
/// [`CodecError::Damaged`] and [`CodecError::Unsupported`] as above; [`CodecError::Memory`] if more than
/// `memory_bytes` would be held; what the input or the receiver reports.
pub(crate) fn decode(
    input: &mut dyn Read,
    memory_bytes: u64,
    sink: &mut dyn RowSink,
) -> Result<(), CodecError> {
    reserve(0, memory_bytes)?;
    let mut bytes = Bytes::new(input);
    let mut tables = Tables::default();
    markers::start(&mut bytes)?;
    let Event::Frame(frame) = tables.next(&mut bytes, None, None)? else {
        return Err(damaged("it ends before its image begins"));
    };
    sink.begin(&frame.format())?;
    let Event::Scan(scan) = tables.next(&mut bytes, None, Some(&frame))? else {
        return Err(damaged("it ends before its pixels begin"));
    };
    let in_one_scan = scan.components.len() == frame.components.len();
    match frame.process {
        Process::Lossless => lossless::decode(&mut bytes, &mut tables, &frame, &scan, memory_bytes, sink),
        Process::Sequential if in_one_scan => {
            sequential::decode(&mut bytes, &tables, &frame, &scan, memory_bytes, sink)
        }
        _ => progressive::decode(&mut bytes, &mut tables, &frame, scan, memory_bytes, sink),
    }
}

/// Checks an allocation of `bytes`, with tables and input buffer, against `allowed_bytes`.
fn reserve(bytes: u64, allowed_bytes: u64) -> Result<(), CodecError> {
    let needed_bytes = bytes + Tables::MAX_BYTES + BUFFER_BYTES as u64;
    if needed_bytes <= allowed_bytes {
        Ok(())
    } else {
        Err(CodecError::Memory { needed_bytes, allowed_bytes })
    }
}
