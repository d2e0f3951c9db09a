//! VTK's structured points in legacy files (`.vtk`), binary, which are always big-endian: the first scalars at points.

use std::path::Path;

use super::{Headed, Read, missing, refused, sample_type, scale, unread, upright};

use crate::fault::Fault;
use crate::platform::open_file;
use crate::source::OpenOptions;
use crate::source::header::{Lines, counts, numbers, text, unreadable};
use crate::source::stored::Samples;
use crate::volume::{Endian, Result, VolumeSource};

const ELSE: &str = "write it as structured points, MetaImage or NRRD";

pub(in crate::source) fn recognise(head: &[u8], _: &Path) -> bool {
    head.starts_with(b"# vtk DataFile")
}

pub(in crate::source) fn open(path: &Path, _: &OpenOptions) -> Result<Vec<Box<dyn VolumeSource>>> {
    let file = open_file(path).map_err(|cause| unreadable(path, cause))?;
    let mut lines = Lines::new(&file);
    let mut fields = Fields::default();
    let mut number = 0;
    while let Some(line) = lines.next().map_err(|cause| unreadable(path, cause))? {
        number += 1;
        // The second line is a title.
        if number != 2 && fields.line(&text(&line)).map_err(refused(path))? {
            return fields.headed(lines.offset).map_err(refused(path))?.open(path, None);
        }
    }
    Err(refused(path)(missing("SCALARS and LOOKUP_TABLE")))
}

#[derive(Default)]
struct Fields {
    binary: bool,
    points: bool,
    size: Vec<u64>,
    origin: Vec<f64>,
    spacing: Vec<f64>,
    samples: Option<Samples>,
}

impl Fields {
    /// Takes a line; do samples follow?
    fn line(&mut self, line: &str) -> Read<bool> {
        let mut words = line.split_whitespace();
        let keyword = words.next().unwrap_or_default().to_uppercase();
        let rest = line.get(keyword.len()..).unwrap_or_default();
        match keyword.as_str() {
            "ASCII" => return Err(unread("text (ASCII)", "write it as BINARY, or as MetaImage or NRRD")),
            "BINARY" => self.binary = true,
            "DATASET" => {
                let kind = words.next().unwrap_or_default();
                if !kind.eq_ignore_ascii_case("STRUCTURED_POINTS") {
                    return Err(unread(format!("a DATASET {kind}"), ELSE));
                }
            }
            "DIMENSIONS" => self.size = counts(rest).ok_or_else(|| missing("DIMENSIONS"))?,
            "ORIGIN" => self.origin = numbers(rest).ok_or_else(|| missing("ORIGIN"))?,
            "SPACING" | "ASPECT_RATIO" => self.spacing = numbers(rest).ok_or_else(|| missing("SPACING"))?,
            "POINT_DATA" => self.points = true,
            "CELL_DATA" if !self.points => return Err(unread("values of cells (CELL_DATA)", ELSE)),
            "SCALARS" if self.points => self.samples = Some(scalars(words)?),
            "LOOKUP_TABLE" if self.samples.is_some() => return Ok(true),
            "VECTORS" | "NORMALS" | "TENSORS" | "COLOR_SCALARS" | "TEXTURE_COORDINATES" | "FIELD" => {
                return Err(unread(format!("{keyword} first"), "write its scalars alone"));
            }
            _ => {}
        }
        Ok(false)
    }

    fn headed(self, at: u64) -> Read<Headed> {
        let three = |list: &[f64]| <[f64; 3]>::try_from(list).ok();
        if !self.binary {
            return Err(missing("BINARY"));
        }
        let size = self.size.try_into().map_err(|_| missing("DIMENSIONS"))?;
        let spacing = three(&self.spacing).ok_or_else(|| missing("SPACING"))?;
        let origin = three(&self.origin).ok_or_else(|| missing("ORIGIN"))?;
        let samples = self.samples.ok_or_else(|| missing("SCALARS"))?;
        let mut notes = Vec::new();
        let affine = upright(spacing, origin, scale(None, &mut notes));
        Ok(Headed { format: "vtk", size, volumes: 1, samples, endian: Endian::Big, at, affine, notes })
    }
}

/// The type of `SCALARS name type components`.
fn scalars<'a>(mut words: impl Iterator<Item = &'a str>) -> Read<Samples, Fault> {
    let kind = words.nth(1).unwrap_or_default();
    if words.next().is_some_and(|components| components != "1") {
        return Err(unread("several values a voxel", "write one of them alone"));
    }
    let signed = !kind.starts_with("unsigned_") && !kind.starts_with("vtktypeuint");
    let found = match kind.strip_prefix("unsigned_").unwrap_or(kind) {
        "char" | "signed_char" => sample_type(false, signed, 8),
        "short" => sample_type(false, signed, 16),
        "int" => sample_type(false, signed, 32),
        "long" | "vtktypeint64" | "vtktypeuint64" => sample_type(false, signed, 64),
        "float" => sample_type(true, true, 32),
        "double" => sample_type(true, true, 64),
        _ => None,
    };
    found.ok_or_else(|| unread(format!("samples of the type `{kind}`"), "write whole numbers or floats"))
}
