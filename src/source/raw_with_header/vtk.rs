//! VTK's structured points in legacy files (`.vtk`), binary, which are always big-endian: the first scalars at points.

use std::path::Path;

use super::{Headed, Read, missing, refused, sample_type, scale, unread, upright};

use crate::fault::{Fault, bad};
use crate::platform::PositionalFile;
use crate::source::OpenOptions;
use crate::source::header::{Lines, Once, exactly, number, text, unreadable};
use crate::source::payload::{Encoding, Samples};
use crate::volume::{Endian, Result, VolumeSource};

const ELSE: &str = "write it as structured points, MetaImage or NRRD";

pub(in crate::source) fn recognise(head: &[u8], _: &Path) -> bool {
    head.starts_with(b"# vtk DataFile")
}

pub(in crate::source) fn open(path: &Path, _: &OpenOptions) -> Result<Vec<Box<dyn VolumeSource>>> {
    let file = PositionalFile::open(path).map_err(|cause| unreadable(path, cause))?;
    let mut lines = Lines::new(&file);
    let mut fields = Fields::default();
    let mut once = Once::new(&["DIMENSIONS", "ORIGIN", "SPACING", "POINT_DATA"]);
    let mut number = 0;
    while let Some(line) = lines.next().map_err(|cause| unreadable(path, cause))? {
        number += 1;
        // The second line is a title.
        if number == 2 {
            continue;
        }
        let line = text(&line);
        if line.split_whitespace().next().is_some_and(|word| word.eq_ignore_ascii_case("FIELD")) {
            skip_field(&line, &mut lines, path)?;
        } else if fields.line(&line, &mut once).map_err(refused(path))? {
            return fields.headed(lines.offset).map_err(refused(path))?.open(path, None);
        }
    }
    Err(refused(path)(missing("SCALARS and LOOKUP_TABLE")))
}

/// Leaves out the arrays of `FIELD name count`, such as the time of ParaView: each is a line `name components tuples
/// type`, and binary values.
fn skip_field(field: &str, lines: &mut Lines<'_>, path: &Path) -> Result<()> {
    let words: Vec<&str> = field.split_whitespace().collect();
    let &[_, _, count] = words.as_slice() else { return Err(refused(path)(missing("FIELD"))) };
    let mut left: u64 = number("FIELD", count).map_err(refused(path))?;
    let mut in_metadata = false;
    while left > 0 {
        let line = lines.next().map_err(|cause| unreadable(path, cause))?;
        let Some(line) = line.map(|line| text(&line)) else { return Err(refused(path)(missing("FIELD"))) };
        // Metadata may stand between arrays; an empty line ends it.
        in_metadata = (in_metadata || line == "METADATA") && !line.is_empty();
        if in_metadata || line.is_empty() {
            continue;
        }
        let bytes = array_bytes(&line).map_err(refused(path))?;
        lines.skip(bytes);
        left -= 1;
    }
    Ok(())
}

/// Bytes of an array of a `FIELD`, by its line.
fn array_bytes(line: &str) -> Read<u64> {
    let words: Vec<&str> = line.split_whitespace().collect();
    let &[_, components, tuples, kind] = words.as_slice() else { return Err(missing("FIELD")) };
    let each = sample_of(kind)
        .ok_or_else(|| unread(format!("a FIELD of {kind} first"), "write its scalars alone"))?;
    let [components, tuples] = [number::<u64>("FIELD", components)?, number("FIELD", tuples)?];
    Ok(components.saturating_mul(tuples).saturating_mul(each.bytes() as u64))
}

#[derive(Default)]
struct Fields {
    binary: bool,
    points: Option<u64>,
    size: Option<[u64; 3]>,
    origin: Option<[f64; 3]>,
    spacing: Option<[f64; 3]>,
    samples: Option<Samples>,
}

impl Fields {
    /// Reads a line; returns true if samples follow it.
    fn line(&mut self, line: &str, once: &mut Once) -> Read<bool> {
        let mut words = line.split_whitespace();
        let keyword = words.next().unwrap_or_default().to_uppercase();
        let rest = line.get(keyword.len()..).unwrap_or_default();
        once.check(if keyword == "ASPECT_RATIO" { "SPACING" } else { &keyword })?;
        match keyword.as_str() {
            "ASCII" => return Err(unread("text (ASCII)", "write it as BINARY, or as MetaImage or NRRD")),
            "BINARY" => self.binary = true,
            "DATASET" => {
                let kind = words.next().unwrap_or_default();
                if !kind.eq_ignore_ascii_case("STRUCTURED_POINTS") {
                    return Err(unread(format!("a DATASET {kind}"), ELSE));
                }
            }
            "DIMENSIONS" => self.size = Some(exactly("DIMENSIONS", rest)?),
            "ORIGIN" => self.origin = Some(exactly("ORIGIN", rest)?),
            "SPACING" | "ASPECT_RATIO" => {
                let spacing: [f64; 3] = exactly("SPACING", rest)?;
                if let Some(step) = spacing.iter().find(|step| **step <= 0.0) {
                    return Err(bad!(
                        "its field SPACING has {step}, which is not above 0; write the samples in rising order"
                    ));
                }
                self.spacing = Some(spacing);
            }
            "POINT_DATA" => self.points = Some(number("POINT_DATA", rest)?),
            "CELL_DATA" if self.points.is_none() => return Err(unread("values of cells (CELL_DATA)", ELSE)),
            "SCALARS" if self.points.is_some() => self.samples = Some(scalars(words)?),
            "LOOKUP_TABLE" if self.samples.is_some() => return Ok(true),
            "VECTORS" | "NORMALS" | "TENSORS" | "COLOR_SCALARS" | "TEXTURE_COORDINATES" => {
                return Err(unread(format!("{keyword} first"), "write its scalars alone"));
            }
            _ => {}
        }
        Ok(false)
    }

    fn headed(self, at: u64) -> Read<Headed> {
        if !self.binary {
            return Err(missing("BINARY"));
        }
        let size = self.size.ok_or_else(|| missing("DIMENSIONS"))?;
        if self.points != size.iter().try_fold(1_u64, |all, side| all.checked_mul(*side)) {
            return Err(bad!(
                "its header states another number of points (POINT_DATA) than its DIMENSIONS make"
            ));
        }
        let spacing = self.spacing.ok_or_else(|| missing("SPACING"))?;
        let origin = self.origin.ok_or_else(|| missing("ORIGIN"))?;
        let samples = self.samples.ok_or_else(|| missing("SCALARS"))?;
        let mut notes = Vec::new();
        let affine = upright(spacing, origin, scale(None, &mut notes));
        Ok(Headed {
            format: "vtk",
            size,
            volumes: 1,
            samples,
            endian: Endian::Big,
            at,
            encoding: Encoding::Raw,
            affine,
            notes,
        })
    }
}

/// The type of `SCALARS name type components`.
fn scalars<'a>(mut words: impl Iterator<Item = &'a str>) -> Read<Samples, Fault> {
    let kind = words.nth(1).unwrap_or_default();
    if words.next().is_some_and(|components| components != "1") || words.next().is_some() {
        return Err(unread("several values a voxel", "write one of them alone"));
    }
    sample_of(kind)
        .ok_or_else(|| unread(format!("samples of the type `{kind}`"), "write whole numbers or floats"))
}

/// A type by its name.
fn sample_of(kind: &str) -> Option<Samples> {
    let signed = !kind.starts_with("unsigned_") && !kind.starts_with("vtktypeuint");
    match kind.strip_prefix("unsigned_").unwrap_or(kind) {
        "char" | "signed_char" => sample_type(false, signed, 8),
        "short" => sample_type(false, signed, 16),
        "int" => sample_type(false, signed, 32),
        "long" | "vtktypeint64" | "vtktypeuint64" => sample_type(false, signed, 64),
        "float" => sample_type(true, true, 32),
        "double" => sample_type(true, true, 64),
        _ => None,
    }
}
