//! Blocks of rows: checks of requests, and reading from a file of plain samples.

use std::io;
use std::ops::Range;

use super::VolumeInfo;
use crate::platform::PositionalFile;

/// Reads a block of a slice whose rows of `nx` samples start at byte `base`: full rows in one call, partial ones row by
/// row. `out` has the length of the block.
pub(crate) fn read_block(
    file: &PositionalFile,
    base: u64,
    nx: u32,
    sample_bytes: usize,
    rows: &Range<u32>,
    cols: &Range<u32>,
    out: &mut [u8],
) -> io::Result<()> {
    let sample = sample_bytes as u64;
    let row_bytes = u64::from(nx) * sample;
    let at = |row: u32| base + u64::from(row) * row_bytes + u64::from(cols.start) * sample;
    let piece = cols.len() * sample_bytes;
    if out.is_empty() {
        return Ok(());
    }
    if cols.len() as u64 == u64::from(nx) {
        return file.read_exact_at(out, at(rows.start));
    }
    out.chunks_exact_mut(piece)
        .zip(rows.clone())
        .try_for_each(|(part, row)| file.read_exact_at(part, at(row)))
}

/// Checks that the request lies inside the volume, and that `out` is as long as the trait promises.
pub(crate) fn check_request(
    info: &VolumeInfo,
    z: u32,
    rows: &Range<u32>,
    cols: &Range<u32>,
    out_len: usize,
) -> io::Result<()> {
    let dims = info.dims;
    let inside = z < dims.nz() && rows.end <= dims.ny() && cols.end <= dims.nx();
    let wanted = rows.len() as u64 * cols.len() as u64 * info.scalar.bytes() as u64;
    if inside && wanted == out_len as u64 {
        return Ok(());
    }
    let text = format!("rows {rows:?}, columns {cols:?} into {out_len} bytes");
    Err(io::Error::new(io::ErrorKind::InvalidInput, text))
}

/// The error of a read before the volume was prepared.
pub(crate) fn not_unrolled() -> io::Error {
    io::Error::new(io::ErrorKind::InvalidInput, "it has not been unrolled")
}
