//! Images of OME-Zarr: levels, axes, units and scales (OME-NGFF 0.4, section 3.4; 0.5, section 2.4).

use serde_json::Value;

use super::Read;
use super::array::missing;
use crate::fault::bad;
use crate::source::header::unit_mm;
use crate::volume::Note;

/// Statements of an image about one of its levels.
#[derive(Debug)]
pub(super) struct Image {
    /// Names and units of the axes, in the order of the array.
    axes: Vec<(String, Option<String>)>,
    /// Distance of samples along each axis, and the place of the first one.
    scale: Vec<f64>,
    shift: Vec<f64>,
}

/// The list of images in attributes of either version.
fn multiscales(what: &Value) -> Option<&Value> {
    let attributes = what.get("attributes");
    let new = attributes.and_then(|all| all.get("ome")).and_then(|ome| ome.get("multiscales"));
    let old = what.get("multiscales").or_else(|| attributes.and_then(|all| all.get("multiscales")));
    new.or(old).filter(|list| list.as_array().is_some_and(|list| !list.is_empty()))
}

impl Image {
    /// True if metadata describes an image.
    pub(super) fn is_there(what: &Value) -> bool {
        multiscales(what).is_some()
    }

    /// True if metadata describes an image with a level of this path.
    pub(super) fn has_level(what: &Value, level: &str) -> bool {
        let sets = multiscales(what).and_then(|list| list.get(0)?.get("datasets")?.as_array());
        sets.is_some_and(|sets| sets.iter().any(|set| set.get("path").and_then(Value::as_str) == Some(level)))
    }

    /// Reads the first image: its level of this path, or the finest one; with the path of the level.
    pub(super) fn read(what: &Value, level: Option<&str>) -> Read<(Self, String)> {
        let image = multiscales(what).and_then(|list| list.get(0)).ok_or_else(|| missing("multiscales"))?;
        let sets = image.get("datasets").and_then(Value::as_array).ok_or_else(|| missing("datasets"))?;
        let path = |set: &Value| set.get("path").and_then(Value::as_str).map(str::to_owned);
        let wanted = |set: &&Value| level.is_none_or(|level| path(set).as_deref() == Some(level));
        let set = sets.iter().find(wanted).ok_or_else(|| missing("datasets"))?;
        let name = path(set).ok_or_else(|| missing("path"))?;
        // A level lies in the folder of its image, or below.
        if name.split('/').any(|part| part.is_empty() || part == "." || part == "..") {
            return Err(missing("path"));
        }
        // Names alone in 0.3; names with types and units since.
        let axes: Vec<(String, Option<String>)> = match image.get("axes") {
            Some(axes) => {
                let axes = axes.as_array().and_then(|axes| axes.iter().map(axis).collect());
                axes.ok_or_else(|| missing("axes"))?
            }
            None => ["t", "c", "z", "y", "x"].map(|name| (name.to_owned(), None)).to_vec(),
        };
        let (mut scale, mut shift) = (vec![1.0; axes.len()], vec![0.0; axes.len()]);
        // Transformations of the level come first, then those of the whole image.
        for step in transformations(set)?.iter().chain(transformations(image)?) {
            let numbers = |key| numbers(step.get(key), axes.len());
            match step.get("type").and_then(Value::as_str) {
                Some("scale") => {
                    let by = numbers("scale")?;
                    scale.iter_mut().zip(&by).for_each(|(scale, by)| *scale *= by);
                    shift.iter_mut().zip(&by).for_each(|(shift, by)| *shift *= by);
                }
                Some("translation") => {
                    let by = numbers("translation")?;
                    shift.iter_mut().zip(&by).for_each(|(shift, by)| *shift += by);
                }
                Some("identity") => {}
                _ => return Err(missing("coordinateTransformations")),
            }
        }
        Ok((Self { axes, scale, shift }, name))
    }

    /// Name of an axis.
    pub(super) fn axis(&self, at: usize) -> Option<&str> {
        self.axes.get(at).map(|(name, _)| name.as_str())
    }

    /// Spacing and place of the first voxel along x, y and z, in mm, for an array of `axes` axes.
    pub(super) fn placed(&self, axes: usize, notes: &mut Vec<Note>) -> Read<([f64; 3], [f64; 3])> {
        let names: Vec<&str> = self.axes.iter().map(|(name, _)| name.as_str()).collect();
        let is_usual = names.ends_with(&["z", "y", "x"]) || (axes == 2 && names == ["y", "x"]);
        if names.len() != axes || !(is_usual || names.ends_with(&["y", "x"])) {
            let what = format!("axes in the order {}", names.join(", "));
            return Err(bad!(
                "holds {}, which is not read; pass the array to `infobyte.build` in Python, which reads any chunks",
                what.escape_debug()
            ));
        }
        if !is_usual {
            return Err(bad!(
                "holds {}, which is not read; pass the array to `infobyte.build` in Python, which reads any chunks",
                ("pictures of two dimensions").escape_debug()
            ));
        }
        let (mut spacing, mut origin) = ([1.0; 3], [0.0; 3]);
        for (axis, at) in (0..axes).rev().take(3).enumerate() {
            let mm = match self.axes[at].1.as_deref() {
                None => {
                    if !notes.contains(&Note::new("the header states no unit of length; mm is assumed")) {
                        notes.push(Note::new("the header states no unit of length; mm is assumed"));
                    }
                    1.0
                }
                Some(unit) => length_mm(unit).unwrap_or_else(|| {
                    let note = Note::new(format!("the unit `{}` is taken for mm", unit.escape_debug()));
                    if !notes.contains(&note) {
                        notes.push(note);
                    }
                    1.0
                }),
            };
            let step = self.scale[at] * mm;
            if !(step.is_finite() && step > 0.0 && self.shift[at].is_finite()) {
                return Err(missing("coordinateTransformations"));
            }
            spacing[axis] = step;
            origin[axis] = self.shift[at] * mm;
        }
        Ok((spacing, origin))
    }
}

/// Millimetres of a unit of UDUNITS-2, as OME-NGFF names them.
fn length_mm(unit: &str) -> Option<f64> {
    match unit {
        "picometer" => Some(1e-9),
        "kilometer" => Some(1e6),
        "foot" => Some(304.8),
        "yard" => Some(914.4),
        other => unit_mm(other),
    }
}

fn axis(axis: &Value) -> Option<(String, Option<String>)> {
    let name = axis.as_str().or_else(|| axis.get("name").and_then(Value::as_str))?;
    let unit = match axis.get("unit") {
        None | Some(Value::Null) => None,
        Some(unit) => Some(unit.as_str()?.to_owned()),
    };
    Some((name.to_owned(), unit))
}

fn transformations(of: &Value) -> Read<&[Value]> {
    match of.get("coordinateTransformations") {
        None => Ok(&[]),
        Some(list) => list.as_array().map(Vec::as_slice).ok_or_else(|| missing("coordinateTransformations")),
    }
}

fn numbers(list: Option<&Value>, count: usize) -> Read<Vec<f64>> {
    let list = list.and_then(Value::as_array).filter(|list| list.len() == count);
    let all = list.and_then(|list| list.iter().map(Value::as_f64).collect::<Option<Vec<f64>>>());
    all.ok_or_else(|| missing("coordinateTransformations"))
}
