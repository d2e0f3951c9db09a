//! What is known by its first bytes, but not read as a volume.

use crate::facts::Known;

/// Bytes of a file that are looked at to tell what it is, or all of a shorter one.
pub(crate) const HEAD_BYTES: usize = 1024;

/// Formats by their first bytes that are not read, to say what a refused file is.
const KNOWN: [(&[u8], Known); 5] = [
    (b"\x1f\x8b", Known::Gzip),
    (b"\xff\xd8\xff", Known::Jpeg),
    (b"ply", Known::Ply),
    (b"OFF", Known::Off),
    (b"\x89OCT\r\n", Known::Oct),
];

/// What a file is by its first bytes, if that is known and it is not DICOM.
pub(crate) fn known(head: &[u8]) -> Option<Known> {
    KNOWN.iter().find(|(magic, _)| head.starts_with(magic)).map(|(_, what)| *what)
}
