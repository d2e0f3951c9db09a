//! NumPy arrays (`.npy`, versions 1 to 3).
//!
//! An array has shape (z, y, x), or (y, x), in either order in memory: an array saved in C and in Fortran
//! order gives the same volume. In C order x is the fastest axis, as everywhere; in Fortran order it is the
//! slowest, and the array is turned once. The header is a Python literal; it is parsed, never evaluated.

use std::path::Path;

use super::OpenOptions;
use super::axis_reversal::AxisReversal;
use super::files::FileList;
use super::header::{unreadable, unusable};
use super::payload::{Encoding, Samples, Skip, StoredLayout};
use crate::fault::{Fault, bad};
use crate::geom::Affine;
use crate::platform::PositionalFile;
use crate::volume::{Endian, Note, Rescale, Result, ScalarType, VolumeSource};

const MAGIC: &[u8] = b"\x93NUMPY";

/// Longest header: of an array of numbers it has some 100 bytes.
const MAX_HEADER: u64 = 64 << 10;

/// True for a NumPy array.
pub(super) fn recognise(head: &[u8], _: &Path) -> bool {
    head.starts_with(MAGIC)
}

/// Opens an array of two or three dimensions.
pub(super) fn open(path: &Path, _: &OpenOptions) -> Result<Vec<Box<dyn VolumeSource>>> {
    let file = PositionalFile::open(path).map_err(|cause| unreadable(path, cause))?;
    let length = file.metadata().map_err(|cause| unreadable(path, cause))?.len();
    let short = || unusable(path, bad!("ends within its header; copy the file again"));
    let mut start = [0; 12];
    let most = start.len().min(usize::try_from(length).unwrap_or(usize::MAX));
    let head = start.get_mut(..most).unwrap_or_default();
    file.read_exact_at(head, 0).map_err(|cause| unreadable(path, cause))?;
    if most < start.len() {
        return Err(short());
    }
    let (header_at, header_bytes) = match start[6] {
        1 => (10_u64, u64::from(u16::from_le_bytes([start[8], start[9]]))),
        2 | 3 => (12, u64::from(u32::from_le_bytes([start[8], start[9], start[10], start[11]]))),
        version => return Err(unusable(path, bad!("is .npy of version {version}; 1 to 3 are read"))),
    };
    if header_bytes > MAX_HEADER {
        return Err(unusable(path, bad!("its header of {header_bytes} bytes is not an array of numbers")));
    }
    if header_at + header_bytes > length {
        return Err(short());
    }
    let mut text = vec![0; usize::try_from(header_bytes).unwrap_or(0)];
    file.read_exact_at(&mut text, header_at).map_err(|cause| unreadable(path, cause))?;
    let array = Array::parse(&String::from_utf8_lossy(&text)).map_err(|fault| unusable(path, fault))?;
    let (samples, endian) = array.samples().map_err(|fault| unusable(path, fault))?;
    let mut size = match array.shape.as_slice() {
        [a, b] => [1, *a, *b],
        [a, b, c] => [*a, *b, *c],
        other => {
            return Err(unusable(
                path,
                bad!("has {} dimensions; arrays of 2 or 3 are read, save one volume", other.len()),
            ));
        }
    };
    // The fastest axis first.
    if !array.fortran {
        size.reverse();
    }
    let mut files = FileList::new(path.parent().unwrap_or(Path::new("")));
    files.push(Path::new(path.file_name().unwrap_or_default()));
    let volumes = StoredLayout {
        header: path.to_path_buf(),
        format: "npy",
        files,
        size,
        volumes: 1,
        samples,
        endian,
        encoding: Encoding::Raw,
        skip: Skip::Bytes(header_at + header_bytes),
        skip_unpacked: Skip::Bytes(0),
        rescale: Rescale::IDENTITY,
        affine: Affine::from_spacing([1.0; 3]),
        notes: vec![Note::no_spacing("an .npy file"), Note::no_directions("an .npy file")],
        labels: Vec::new(),
    }
    .open()?;
    if array.fortran {
        return Ok(volumes
            .into_iter()
            .map(|inner| -> Box<dyn VolumeSource> { Box::new(AxisReversal::new(inner)) })
            .collect());
    }
    Ok(volumes)
}

/// The fields of a header.
#[derive(Debug, Default, PartialEq)]
struct Array {
    descr: String,
    fortran: bool,
    shape: Vec<u64>,
}

impl Array {
    /// Parses `{'descr': '<i2', 'fortran_order': False, 'shape': (3, 4), }`.
    fn parse(text: &str) -> Result<Self, Fault> {
        let wrong = || bad!("its header is not a description of an array");
        let mut rest = text.trim().strip_prefix('{').ok_or_else(wrong)?.trim_start();
        let (mut descr, mut fortran, mut shape) = (None, None, None);
        while !rest.starts_with('}') {
            let (key, after) = quoted(rest).ok_or_else(wrong)?;
            rest = after.trim_start().strip_prefix(':').ok_or_else(wrong)?.trim_start();
            match key {
                "descr" => {
                    if rest.starts_with('[') {
                        return Err(bad!("is a structured array, whose elements are not numbers"));
                    }
                    let (value, after) = quoted(rest).ok_or_else(wrong)?;
                    descr = Some(value.to_owned());
                    rest = after;
                }
                "fortran_order" => {
                    let (value, after) = if let Some(after) = rest.strip_prefix("True") {
                        (true, after)
                    } else {
                        (false, rest.strip_prefix("False").ok_or_else(wrong)?)
                    };
                    fortran = Some(value);
                    rest = after;
                }
                "shape" => {
                    let (inside, after) =
                        rest.strip_prefix('(').and_then(|r| r.split_once(')')).ok_or_else(wrong)?;
                    let parts = inside.split(',').map(str::trim).filter(|part| !part.is_empty());
                    // Python 2 wrote long integers with an L.
                    let sizes: Option<Vec<u64>> =
                        parts.map(|part| part.strip_suffix('L').unwrap_or(part).parse().ok()).collect();
                    shape = Some(sizes.ok_or_else(wrong)?);
                    rest = after;
                }
                _ => return Err(wrong()),
            }
            rest = rest.trim_start();
            match rest.strip_prefix(',') {
                Some(after) => rest = after.trim_start(),
                None if rest.starts_with('}') => {}
                None => return Err(wrong()),
            }
        }
        match (descr, fortran, shape) {
            (Some(descr), Some(fortran), Some(shape)) => Ok(Self { descr, fortran, shape }),
            _ => Err(wrong()),
        }
    }

    /// Type and byte order, by NumPy's names of them.
    fn samples(&self) -> Result<(Samples, Endian), Fault> {
        let order = self.descr.chars().next().filter(|c| "<>|=".contains(*c));
        let name = order.map_or(self.descr.as_str(), |_| self.descr.get(1..).unwrap_or(""));
        let endian = if order == Some('>') { Endian::Big } else { Endian::Little };
        let samples = match name {
            // Booleans are bytes of 0 and 1.
            "u1" | "b1" => Samples::Plain(ScalarType::U8),
            "i1" => Samples::Plain(ScalarType::I8),
            "u2" => Samples::Plain(ScalarType::U16),
            "i2" => Samples::Plain(ScalarType::I16),
            "u4" => Samples::Plain(ScalarType::U32),
            "i4" => Samples::Plain(ScalarType::I32),
            "f4" => Samples::Plain(ScalarType::F32),
            "f8" => Samples::Plain(ScalarType::F64),
            "i8" => Samples::I64,
            "u8" => Samples::U64,
            "f2" => Samples::F16,
            _ => {
                return Err(bad!(
                    "its elements are of the type `{}`, which is not read; save real numbers of up to 64 bits",
                    self.descr.escape_debug()
                ));
            }
        };
        Ok((samples, endian))
    }
}

/// A string in single or double quotation marks, and the text after it.
fn quoted(text: &str) -> Option<(&str, &str)> {
    let mark = text.chars().next().filter(|c| *c == '\'' || *c == '"')?;
    text.get(1..)?.split_once(mark)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headers_are_parsed_in_any_order_of_keys() {
        let expected = Array { descr: "<i2".into(), fortran: false, shape: vec![2, 3, 4] };
        for text in [
            "{'descr': '<i2', 'fortran_order': False, 'shape': (2, 3, 4), }   \n",
            "{\"shape\": (2L, 3L, 4L), 'fortran_order':False,'descr': '<i2'}",
        ] {
            assert_eq!(Array::parse(text).unwrap(), expected, "{text}");
        }
        for text in [
            "",
            "{",
            "{'descr'",
            "{'descr': '<i2', 'fortran_order': False}",
            "{'descr': '<i2', 'fortran_order': Maybe, 'shape': (2,)}",
            "{'descr': '<i2', 'fortran_order': False, 'shape': (-2,)}",
            "{'descr': '<i2', 'fortran_order': False, 'shape': (2,) 'x': 1}",
            "__import__('os')",
        ] {
            assert!(Array::parse(text).is_err(), "{text}");
        }
        let records = "{'descr': [('x', '<f4')], 'fortran_order': False, 'shape': (2,)}";
        assert_eq!(Array::parse(records), Err(bad!("is a structured array, whose elements are not numbers")));
    }

    #[test]
    fn element_types_have_their_order() {
        let of = |descr: &str| Array { descr: descr.into(), fortran: false, shape: vec![] }.samples();
        assert_eq!(of("<i2").unwrap(), (Samples::Plain(ScalarType::I16), Endian::Little));
        assert_eq!(of(">f8").unwrap(), (Samples::Plain(ScalarType::F64), Endian::Big));
        assert_eq!(of("|b1").unwrap(), (Samples::Plain(ScalarType::U8), Endian::Little));
        assert_eq!(of("=f2").unwrap().0, Samples::F16);
        for descr in ["<c8", "|O", "<U4", "", "<M8[ns]", "\u{e4}1"] {
            assert_eq!(
                of(descr),
                Err(bad!(
                    "its elements are of the type `{}`, which is not read; save real numbers of up to 64 bits",
                    descr.escape_debug()
                ))
            );
        }
    }
}
