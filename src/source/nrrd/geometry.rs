//! Axes of an NRRD header, and their directions in space.

use crate::fault::{Fault, bad};
use crate::geom::Affine;
use crate::source::header::{normal_of, number, numbers, unit_mm, wrong_count};
use crate::volume::Note;

/// Axis kinds that are directions in space; an unknown one is taken for one.
const SPATIAL_KINDS: [&str; 4] = ["domain", "space", "???", "none"];

/// The format's other kinds, and endings of those with a number in front.
const OTHER_KINDS: [&str; 9] =
    ["time", "list", "point", "vector", "covariant-vector", "normal", "stub", "scalar", "complex"];
const ENDINGS: [&str; 7] = ["-vector", "-color", "-gradient", "-normal", "quaternion", "-matrix", "-tensor"];

fn is_kind(kind: &str) -> bool {
    [&SPATIAL_KINDS[..], &OTHER_KINDS].concat().contains(&kind)
        || ENDINGS.iter().any(|end| kind.ends_with(end))
}

/// Places of samples in the cells of an axis; the last two leave it open.
const CENTERS: [&str; 4] = ["cell", "node", "???", "none"];

/// Greatest difference of a spacing from the length of a direction, as a part of it: the rounding of text.
const ROUNDED: f64 = 1e-3;

/// One axis.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Axis {
    pub(super) size: u64,
    pub(super) kind: String,
    /// True if it runs in space.
    pub(super) spatial: bool,
}

/// The fields that place voxels.
#[derive(Debug, Default)]
pub(super) struct Geometry {
    space: String,
    dimension: Option<usize>,
    directions: Vec<Option<Vec<f64>>>,
    origin: Vec<f64>,
    space_units: Vec<String>,
    units: Vec<String>,
    spacings: Vec<f64>,
    mins: Vec<f64>,
    maxs: Vec<f64>,
    centers: Vec<String>,
    kinds: Vec<String>,
}

impl Geometry {
    /// Takes a field if it is one of these.
    pub(super) fn field(&mut self, field: &str, value: &str) -> Result<(), Fault> {
        let words = || value.split_whitespace().map(str::to_lowercase).collect();
        match field {
            "space" => self.space = value.to_lowercase(),
            "space dimension" | "spacedimension" => self.dimension = Some(number(field, value)?),
            "space directions" => self.directions = vectors(field, value)?,
            "space origin" => {
                let mut all = vectors(field, value)?;
                let origin = all.pop().filter(|_| all.is_empty());
                let text = value.escape_debug();
                self.origin = origin
                    .ok_or_else(|| bad!("its field `{field}: {text}` is not one vector"))?
                    .unwrap_or_default();
            }
            "space units" => self.space_units = quoted(value),
            "units" => self.units = quoted(value),
            "spacings" => self.spacings = numbers(field, value)?,
            "axis mins" | "axismins" => self.mins = numbers(field, value)?,
            "axis maxs" | "axismaxs" => self.maxs = numbers(field, value)?,
            "centers" | "centerings" => {
                self.centers = words();
                if self.centers.iter().any(|word| !CENTERS.contains(&word.as_str())) {
                    return Err(bad!("its field `{field}: {}` makes no sense", value.escape_debug()));
                }
            }
            "kinds" => {
                self.kinds = words();
                if !self.kinds.iter().all(|kind| is_kind(kind)) {
                    return Err(bad!("its field `{field}: {}` makes no sense", value.escape_debug()));
                }
            }
            _ => {}
        }
        Ok(())
    }

    /// The axes with their sizes. Where some axes have a direction, those without one are not in space.
    pub(super) fn axes(&self, sizes: &[u64]) -> Result<Vec<Axis>, Fault> {
        for (field, entries) in [
            ("space directions", self.directions.len()),
            ("kinds", self.kinds.len()),
            ("spacings", self.spacings.len()),
            ("axis mins", self.mins.len()),
            ("axis maxs", self.maxs.len()),
        ] {
            if entries != 0 && entries != sizes.len() {
                return Err(bad!("its header has {entries} {field} for {} axes", sizes.len()));
            }
        }
        let vectors = self.directions.iter().flatten().chain(Some(&self.origin).filter(|o| !o.is_empty()));
        for vector in vectors {
            let due = self.dimensions().unwrap_or(vector.len());
            if vector.len() != due {
                let text: Vec<String> = vector.iter().map(f64::to_string).collect();
                return Err(wrong_count("a vector in space", &text.join(","), vector.len(), due));
            }
        }
        self.check_lengths()?;
        let axis = |(index, size): (usize, &u64)| {
            let kind = self.kinds.get(index).cloned().unwrap_or_default();
            let named = kind.is_empty() || SPATIAL_KINDS.contains(&kind.as_str());
            let directed = self.directions.get(index).is_none_or(Option::is_some);
            Axis { size: *size, spatial: named && directed, kind }
        };
        Ok(sizes.iter().enumerate().map(axis).collect())
    }

    /// Refuses spacings that are not the lengths of the directions; the format allows either field.
    fn check_lengths(&self) -> Result<(), Fault> {
        for (axis, (spacing, direction)) in (1..).zip(self.spacings.iter().zip(&self.directions)) {
            let Some(direction) = direction.as_ref().filter(|_| !spacing.is_nan()) else { continue };
            let length = direction.iter().map(|c| c * c).sum::<f64>().sqrt();
            if (length - spacing.abs()).abs() > ROUNDED * length {
                return Err(bad!(
                    "its header states a spacing of {spacing} along axis {axis} (spacings), and one of {length} (space directions); remove the wrong field"
                ));
            }
        }
        Ok(())
    }

    /// Dimensions of the space, by its name, by their number, or by the first direction.
    fn dimensions(&self) -> Option<usize> {
        let named = (signs(&self.space).1)
            .then(|| if self.space.ends_with('t') || self.space.ends_with("-time") { 4 } else { 3 });
        named.or(self.dimension).or_else(|| self.directions.iter().flatten().next().map(Vec::len))
    }

    /// Voxel index to LPS mm, for the axes that became x, y and z.
    pub(super) fn affine(
        &self,
        axes: &[Axis],
        space: &[usize],
        notes: &mut Vec<Note>,
    ) -> Result<Affine, Fault> {
        let mut affine = Affine::from_spacing([1.0; 3]);
        let directed = !self.directions.is_empty();
        if directed {
            self.directed(space, &mut affine, notes)?;
        } else {
            self.measured(axes, space, &mut affine, notes)?;
        }
        if space.len() == 2 {
            // A picture has no thickness; its third axis is taken at right angles.
            let [a, b] = [affine.column(0), affine.column(1)];
            let third = normal_of(a, b, 1.0);
            affine.rows.iter_mut().zip(third).for_each(|(row, c)| row[2] = c);
        }
        Ok(affine)
    }

    /// Fills the affine from `space directions` and `space origin`.
    fn directed(&self, space: &[usize], affine: &mut Affine, notes: &mut Vec<Note>) -> Result<(), Fault> {
        let (signs, known) = signs(&self.space);
        if !known {
            let space = match self.space.as_str() {
                "" => "the header states no space".to_owned(),
                space => format!("the space `{}` is not a patient's", space.escape_debug()),
            };
            notes.push(Note::directions(format!("{space}; its directions are taken as LPS")));
        }
        let mut scales = [1.0; 3];
        for (scale, name) in scales.iter_mut().zip(&self.space_units) {
            match unit_mm(name) {
                Some(mm) => *scale = mm,
                None => notes.push(Note::new(format!("the unit `{}` is taken for mm", name.escape_debug()))),
            }
        }
        let place = |vector: &[f64]| {
            let at = |i: usize| vector.get(i).copied().unwrap_or(0.0);
            [0, 1, 2].map(|i| at(i) * signs[i] * scales[i])
        };
        for (column, index) in space.iter().enumerate() {
            let vector = self.directions.get(*index).cloned().flatten();
            let vector = vector.ok_or_else(|| bad!("an axis has no direction"))?;
            affine.rows.iter_mut().zip(place(&vector)).for_each(|(row, c)| row[column] = c);
        }
        if self.origin.is_empty() {
            notes.push(Note::new("the header states no origin; the first voxel is used as the origin"));
        }
        affine.rows.iter_mut().zip(place(&self.origin)).for_each(|(row, c)| row[3] = c);
        Ok(())
    }

    /// Fills the affine from `spacings`, or `axis mins` and `axis maxs`: axes along the patient's.
    fn measured(
        &self,
        axes: &[Axis],
        space: &[usize],
        affine: &mut Affine,
        notes: &mut Vec<Note>,
    ) -> Result<(), Fault> {
        let finite = |list: &[f64], at: usize| list.get(at).copied().filter(|v| v.is_finite());
        let wrong = |list: &[f64], at: usize| list.get(at).copied().filter(|v| !v.is_finite());
        let mut missing = false;
        for (column, index) in space.iter().enumerate() {
            if self.spacings.get(*index) == Some(&0.0) {
                return Err(bad!(
                    "its header states a spacing of 0 along axis {} (spacings); correct it, or write nan if it is unknown",
                    *index + 1
                ));
            }
            let cells = self.centers.get(*index).is_none_or(|c| c != "node");
            let count = axes.get(*index).map_or(1, |a| a.size) as f64;
            let (min, max) = (finite(&self.mins, *index), finite(&self.maxs, *index));
            let steps = if cells { count } else { (count - 1.0).max(1.0) };
            let ends = min.zip(max).map(|(min, max)| (max - min) / steps);
            let spacing = finite(&self.spacings, *index).or(ends).filter(|s| *s != 0.0);
            match [&self.spacings, &self.mins, &self.maxs].into_iter().find_map(|list| wrong(list, *index)) {
                Some(stated) if spacing.is_none() => {
                    notes.push(Note::spacing(format!(
                        "the header states a spacing of {} along axis {}; 1 mm is assumed there",
                        stated,
                        *index + 1
                    )));
                }
                _ => missing |= spacing.is_none(),
            }
            let spacing = spacing.unwrap_or(1.0);
            let unit = self.units.get(*index).filter(|unit| !unit.is_empty());
            let scale = unit.map_or(Some(1.0), |unit| unit_mm(unit)).unwrap_or_else(|| {
                let unit = unit.map_or("", String::as_str).escape_debug();
                notes.push(Note::new(format!("the unit `{unit}` is taken for mm")));
                1.0
            });
            let start = min.map_or(0.0, |min| if cells { min + spacing / 2.0 } else { min });
            if let Some(row) = affine.rows.get_mut(column) {
                row[column] = spacing * scale;
                row[3] = start * scale;
            }
        }
        if missing {
            notes.push(Note::no_spacing("the header"));
        }
        let unused =
            [("space origin", !self.origin.is_empty()), ("space units", !self.space_units.is_empty())];
        for (field, _) in unused.into_iter().filter(|(_, is_stated)| *is_stated) {
            let note = format!("the {field} of the header is not used, as it states no space directions");
            notes.push(Note::new(note));
        }
        notes.push(Note::no_directions("the header"));
        Ok(())
    }
}

/// Signs that turn a space's coordinates into LPS, and true for a patient's space.
fn signs(space: &str) -> ([f64; 3], bool) {
    let name = space.strip_suffix("-time").unwrap_or(space);
    match name {
        "left-posterior-superior" | "lps" | "lpst" => ([1.0, 1.0, 1.0], true),
        "right-anterior-superior" | "ras" | "rast" => ([-1.0, -1.0, 1.0], true),
        "left-anterior-superior" | "las" | "last" => ([1.0, -1.0, 1.0], true),
        _ => ([1.0; 3], false),
    }
}

/// `(1,0,0) none (0,1,0)`: one vector for each axis; a word in place of numbers means no vector.
fn vectors(field: &str, text: &str) -> Result<Vec<Option<Vec<f64>>>, Fault> {
    let wrong = || bad!("its field `{field}: {}` is not a list of vectors", text.escape_debug());
    let mut found = Vec::new();
    let mut rest = text.trim();
    while !rest.is_empty() {
        if let Some(after) = rest.strip_prefix("none") {
            found.push(None);
            rest = after.trim_start();
            continue;
        }
        let (inside, after) = rest.strip_prefix('(').and_then(|r| r.split_once(')')).ok_or_else(wrong)?;
        let vector: Vec<f64> = inside.split(',').map(|part| number(field, part)).collect::<Result<_, _>>()?;
        found.push((!vector.iter().all(|v| v.is_nan())).then_some(vector));
        rest = after.trim_start();
    }
    Ok(found)
}

/// Words in quotation marks; without any, words between spaces.
fn quoted(text: &str) -> Vec<String> {
    if text.contains('"') {
        return text.split('"').skip(1).step_by(2).map(str::to_owned).collect();
    }
    text.split_whitespace().map(str::to_owned).collect()
}
