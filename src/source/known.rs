//! File types that are recognised by their first bytes, but not read as volumes.

use crate::facts::Known;

/// Bytes at the head of a file by which it is recognised.
pub(crate) const HEAD_BYTES: usize = 1024;

/// Formats by their first bytes that are not read, to say what a refused file is.
const KNOWN: [(&[u8], Known); 5] = [
    (b"\x1f\x8b", Known::Gzip),
    (b"\xff\xd8\xff", Known::Jpeg),
    (b"ply", Known::Ply),
    (b"OFF", Known::Off),
    (b"\x89OCT\r\n", Known::Oct),
];

/// Type of a file by its first bytes, if it is known and not DICOM.
pub(crate) fn known(head: &[u8]) -> Option<Known> {
    KNOWN.iter().find(|(magic, _)| head.starts_with(magic)).map(|(_, what)| *what)
}
