//! Volumes of other programs that are a header before raw samples.
//!
//! | file | format |
//! |---|---|
//! | `mrc` | MRC and CCP4 maps: 1024 bytes of numbers |
//! | `vgi` | VGStudio: sections of fields in `.vgi`, the samples in `.vol` |
//! | `vtk` | VTK's structured points: lines of text |
//! | `amira` | Amira and Avizo lattices: blocks of text |
//!
//! Axes stay as they are stored. None of them states directions in a patient, so theirs are taken as LPS.

pub(super) mod amira;
pub(super) mod mrc;
pub(super) mod vgi;
pub(super) mod vtk;

use std::path::Path;

use super::files::FileList;
use super::header::{files_beside, unit_mm};
use super::payload::{Encoding, Samples, Skip, StoredLayout};
use crate::fault::{Fault, bad};
use crate::geom::Affine;
use crate::volume::{Endian, Note, Rescale, Result, ScalarType, SourceError, VolumeSource};

/// Facts that all of these headers state.
struct Headed {
    format: &'static str,
    size: [u64; 3],
    volumes: u64,
    samples: Samples,
    endian: Endian,
    /// Byte of each file, or of its stream, at which samples begin.
    at: u64,
    encoding: Encoding,
    affine: Affine,
    notes: Vec<Note>,
}

impl Headed {
    /// The volumes of samples in files of their own, or behind the header.
    fn open(self, path: &Path, files: Option<FileList>) -> Result<Vec<Box<dyn VolumeSource>>> {
        let files = files.unwrap_or_else(|| {
            let mut own = files_beside(path);
            own.push(Path::new(path.file_name().unwrap_or_default()));
            own
        });
        let Self { format, size, volumes, samples, endian, at, encoding, affine, mut notes } = self;
        let (skip, skip_unpacked) = if encoding == Encoding::Raw { (at, 0) } else { (0, at) };
        notes.push(Note::no_directions("the header"));
        StoredLayout {
            header: path.to_path_buf(),
            format,
            files,
            size,
            volumes,
            samples,
            endian,
            encoding,
            skip: Skip::Bytes(skip),
            skip_unpacked: Skip::Bytes(skip_unpacked),
            rescale: Rescale::IDENTITY,
            affine,
            notes,
            labels: Vec::new(),
        }
        .open()
    }
}

/// Result whose error refuses a header, before the file is named.
type Read<T, E = Fault> = std::result::Result<T, E>;

fn missing(field: &'static str) -> Fault {
    bad!("its header does not state {field}, or not as it should; is it damaged?")
}

fn unread(what: impl AsRef<str>, cure: &'static str) -> Fault {
    bad!("holds {}, which is not read; {cure}", what.as_ref().escape_debug())
}

fn refused(path: &Path) -> impl Fn(Fault) -> SourceError + '_ {
    |fault| super::header::unusable(path, fault)
}

/// The type of whole numbers or floats of `bits` bits.
pub(super) fn sample_type(is_float: bool, signed: bool, bits: u64) -> Option<Samples> {
    Some(Samples::Plain(match (is_float, signed, bits) {
        (false, false, 8) => ScalarType::U8,
        (false, true, 8) => ScalarType::I8,
        (false, false, 16) => ScalarType::U16,
        (false, true, 16) => ScalarType::I16,
        (false, false, 32) => ScalarType::U32,
        (false, true, 32) => ScalarType::I32,
        (true, _, 32) => ScalarType::F32,
        (true, _, 64) => ScalarType::F64,
        (true, _, 16) => return Some(Samples::F16),
        (false, false, 64) => return Some(Samples::U64),
        (false, true, 64) => return Some(Samples::I64),
        _ => return None,
    }))
}

/// Millimetres in a unit, by its name; with a note where the name is missing or unknown.
fn scale(unit: Option<&str>, notes: &mut Vec<Note>) -> f64 {
    let unit = unit.map(|unit| unit.trim().trim_matches('"')).filter(|unit| !unit.is_empty());
    let Some(unit) = unit else {
        notes.push(Note::new("the header states no unit of length; mm is assumed"));
        return 1.0;
    };
    unit_mm(unit).unwrap_or_else(|| {
        notes.push(Note::new(format!("the unit `{}` is taken for mm", unit.escape_debug())));
        1.0
    })
}

/// Affine with axes along the axes of space, and the place of the first voxel.
fn upright(spacing: [f64; 3], origin: [f64; 3], scale: f64) -> Affine {
    let mut affine = Affine::from_spacing(spacing.map(|s| s * scale));
    (0..3).for_each(|axis| affine.rows[axis][3] = origin[axis] * scale);
    affine
}
