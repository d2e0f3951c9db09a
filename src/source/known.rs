//! File types that are recognised by their first bytes, but not read as volumes.

use std::path::Path;

/// Bytes at the head of a file by which it is recognised.
pub(crate) const HEAD_BYTES: usize = 1024;

/// First bytes of a model of this program.
pub(crate) const OCT: &[u8] = b"\x89OCT\r\n";

const NETCDF: &str = "a NetCDF file (MINC 1 is, too), whose array has to be written as .npy or NRRD first";
const VTK_XML: &str = "a VTK file in XML (.vti), which has to be written as MetaImage or NRRD first";

/// First bytes of formats that are not read, and the kind of the refused file.
const KNOWN: [(&[u8], &str); 9] = [
    (b"\x1f\x8b", "a gzip file, but of no volume that is read"),
    (b"\xff\xd8\xff", "a JPEG image"),
    (b"ply", "a PLY mesh"),
    (b"OFF", "an OFF mesh"),
    (OCT, "an .oct model, not a volume"),
    (
        b"\x89HDF\r\n\x1a\n",
        "an HDF5 file (MINC 2 and NetCDF-4 are, too), whose array has to be written as .npy or NRRD first",
    ),
    (b"CDF\x01", NETCDF),
    (b"CDF\x02", NETCDF),
    (b"<VTKFile", VTK_XML),
];

/// Files that a folder of an array in pieces holds.
const ZARR: [&str; 4] = [".zarray", ".zgroup", ".zattrs", "zarr.json"];

/// Type of a file by its first bytes, if it is known and not DICOM.
pub(crate) fn known(head: &[u8]) -> Option<&'static str> {
    let first = KNOWN.iter().find(|(magic, _)| head.starts_with(magic)).map(|(_, what)| *what);
    let is_xml = head.starts_with(b"<?xml") && head.windows(8).any(|part| part == b"<VTKFile");
    first.or(is_xml.then_some(VTK_XML))
}

/// Type of a folder that is one volume of a kind that is not read.
pub(crate) fn known_folder(path: &Path) -> Option<&'static str> {
    ZARR.iter().any(|name| path.join(name).is_file()).then_some("a Zarr group in which no array was found")
}
