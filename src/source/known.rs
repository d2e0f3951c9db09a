//! File types that are recognised by their first bytes, but not read as volumes.

use std::fmt;
use std::path::Path;

/// Bytes at the head of a file by which it is recognised.
pub(crate) const HEAD_BYTES: usize = 1024;

/// Formats that are known by their first bytes, but not read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Known {
    Gzip,
    Jpeg,
    Ply,
    Off,
    Oct,
    Hdf5,
    NetCdf,
    VtkXml,
    Zarr,
}

impl fmt::Display for Known {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Gzip => "a gzip file, but of no volume that is read",
            Self::Jpeg => "a JPEG image",
            Self::Ply => "a PLY mesh",
            Self::Off => "an OFF mesh",
            Self::Oct => "an .oct model, not a volume",
            Self::Hdf5 => {
                "an HDF5 file (MINC 2 and NetCDF-4 are, too), whose array has to be written as .npy or NRRD first"
            }
            Self::NetCdf => {
                "a NetCDF file (MINC 1 is, too), whose array has to be written as .npy or NRRD first"
            }
            Self::VtkXml => "a VTK file in XML (.vti), which has to be written as MetaImage or NRRD first",
            Self::Zarr => "a Zarr group in which no array was found",
        })
    }
}

/// First bytes of formats that are not read, to name the kind of a refused file.
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
