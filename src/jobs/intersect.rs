//! `oct intersect`: do two models touch, and where.

use std::path::{Path, PathBuf};
use std::time::Instant;

use serde::Serialize;

use super::opened::open_model;
use super::verify::verify_file;
use crate::budget::peak_rss_bytes;
use crate::error::{Error, UsageError};
use crate::geom::Affine;
use crate::intersect::{Placed, intersection};
use crate::text::{Short, data, shown};

/// Whether two models touch.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct IntersectReport {
    /// Both inputs, as named on the command line.
    pub inputs: [String; 2],
    /// True if a voxel of one model has a point in common with a voxel of the other.
    pub touch: bool,
    /// Skin voxels, or cells, of each model that touch the other.
    pub touching_voxels: [u64; 2],
    /// Centre of the first voxel of the first model that touches the other, in mm (LPS).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub first_mm: Option<[f64; 3]>,
    /// Lowest and highest coordinates of the centres of those voxels, in mm (LPS).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub range_mm: Option<[[f64; 3]; 2]>,
    /// Peak resident memory of the process.
    pub peak_rss_bytes: u64,
    /// Seconds from start to end.
    pub wall_s: f64,
}

/// Checks two models, and tells which boxes of their finest levels have a point in common: of larger leaves the cells that
/// their planes pass through; `placement` leads from the
/// second one's millimetres to those of the first.
///
/// # Errors
/// A model is damaged or cannot be read; the placement has no volume.
pub fn intersect(inputs: [&Path; 2], placement: &Affine) -> Result<IntersectReport, Error> {
    let start = Instant::now();
    if placement.inverse().is_none() {
        return Err(UsageError::FlatPlacement { path: PathBuf::from(inputs[1]) }.into());
    }
    for input in inputs {
        verify_file(input)?;
    }
    let [one, other] = [open_model(inputs[0])?, open_model(inputs[1])?];
    let (one_view, other_view) = (one.view(), other.view());
    let one_placed = Placed { view: &one_view, affine: one.affine() };
    let other_placed = Placed { view: &other_view, affine: placement.after(&other.affine()) };
    let found = intersection(one_placed, other_placed);
    let both = found.and_then(|one| Some((one, intersection(other_placed, one_placed)?)));
    for (model, input) in [(&one, inputs[0]), (&other, inputs[1])] {
        model.check_unchanged(input)?;
    }
    Ok(IntersectReport {
        inputs: inputs.map(data),
        touch: both.is_some(),
        touching_voxels: both.map_or([0, 0], |(one, other)| [one.boxes, other.boxes]),
        first_mm: both.map(|(one, _)| one.first_mm),
        range_mm: both.map(|(one, _)| one.range_mm),
        peak_rss_bytes: peak_rss_bytes(),
        wall_s: start.elapsed().as_secs_f64(),
    })
}

impl IntersectReport {
    /// For people.
    pub fn text(&self) -> String {
        let [one, other] = [0, 1].map(|i| shown(&self.inputs[i]).to_string());
        let Some([low, high]) = self.range_mm else { return format!("{one} and {other} do not touch\n") };
        let [a, b] = self.touching_voxels;
        let range = |i: usize| format!("{} .. {}", Short(low[i]), Short(high[i]));
        format!(
            "{one} and {other} touch: {} box(es) of the first, {} of the second\n  at x {}, y {}, z {} mm (LPS)\n",
            a,
            b,
            range(0),
            range(1),
            range(2)
        )
    }
}
