//! File types that are recognised by their first bytes, but not read as volumes.

use std::path::Path;

use crate::facts::Known;

/// Bytes at the head of a file by which it is recognised.
pub(crate) const HEAD_BYTES: usize = 1024;

/// Formats by their first bytes that are not read, to say what a refused file is.
const KNOWN: [(&[u8], Known); 9] = [
    (b"\x1f\x8b", Known::Gzip),
    (b"\xff\xd8\xff", Known::Jpeg),
    (b"ply", Known::Ply),
    (b"OFF", Known::Off),
    (b"\x89OCT\r\n", Known::Oct),
    (b"\x89HDF\r\n\x1a\n", Known::Hdf5),
    (b"CDF\x01", Known::NetCdf),
    (b"CDF\x02", Known::NetCdf),
    (b"<VTKFile", Known::VtkXml),
];

/// Files that a folder of an array in pieces holds.
const ZARR: [&str; 4] = [".zarray", ".zgroup", ".zattrs", "zarr.json"];

/// Type of a file by its first bytes, if it is known and not DICOM.
pub(crate) fn known(head: &[u8]) -> Option<Known> {
    let first = KNOWN.iter().find(|(magic, _)| head.starts_with(magic)).map(|(_, what)| *what);
    let is_xml = head.starts_with(b"<?xml") && head.windows(8).any(|part| part == b"<VTKFile");
    first.or(is_xml.then_some(Known::VtkXml))
}

/// Type of a folder that is one volume of a kind that is not read.
pub(crate) fn known_folder(path: &Path) -> Option<Known> {
    ZARR.iter().any(|name| path.join(name).is_file()).then_some(Known::Zarr)
}
