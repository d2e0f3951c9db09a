//! `oct intersect`: contact of two models and its place; their overlap or clearance.

use std::path::Path;
use std::time::Instant;

use serde::Serialize;

use super::open_model::open_model;
use super::verify::verify_file;
use crate::budget::peak_rss_bytes;
use crate::error::Error;
use crate::fault::usage;
use crate::geom::Affine;
use crate::intersect::{Placed, intersection};
use crate::measure::nearest::{Gap, Surface};
use crate::text::names::SURFACE;
use crate::text::{Short, data, shown};

/// Contact of two models.
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
    /// Volume that both bodies fill; null unless both are models of cells, of one label at most.
    pub overlap_mm3: Option<f64>,
    /// Greatest depth of either surface inside the other body: 0 where they do not overlap.
    pub depth_mm: Option<f64>,
    /// Least distance between the surfaces: 0 where bodies overlap.
    pub clearance_mm: Option<f64>,
    /// End points of the clearance, the first model's first, in mm (LPS).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub clearance_between_mm: Option<[[f64; 3]; 2]>,
    /// Peak resident memory of the process.
    pub peak_rss_bytes: u64,
    /// Seconds from start to end.
    pub wall_s: f64,
}

/// Checks two models, and finds the boxes of their finest levels that have a point in common: of larger leaves the
/// cells that their planes pass through. `placement` maps the second model's millimetres to the first's. Of models of
/// cells, of one label at most, it also measures the overlap, or the clearance; others are refused if `needs_gap` is set.
///
/// # Errors
/// A model is damaged or cannot be read; the placement has no volume.
pub fn intersect(inputs: [&Path; 2], placement: &Affine, needs_gap: bool) -> Result<IntersectReport, Error> {
    let start = Instant::now();
    if placement.inverse().is_none() {
        let fault = usage!(
            "the placement makes it flat; give three rows that are not parallel, as in 1,0,0,0,0,1,0,0,0,0,1,0"
        );
        return Err(fault.at(inputs[1]).into());
    }
    for input in inputs {
        verify_file(input)?;
    }
    let [one, other] = [open_model(inputs[0])?, open_model(inputs[1])?];
    let (one_view, other_view) = (one.solid_view(), other.solid_view());
    let one_placed = Placed { view: &one_view, affine: one.affine() };
    let other_placed = Placed { view: &other_view, affine: placement.after(&other.affine()) };
    let found = intersection(one_placed, other_placed);
    let both = found.and_then(|one| Some((one, intersection(other_placed, one_placed)?)));
    let models = [&one, &other];
    let surfaces = [
        Surface::open(&one_view, &one_placed.affine, one.dims()),
        Surface::open(&other_view, &other_placed.affine, other.dims()),
    ];
    let gap = match surfaces {
        [Ok(one), Ok(other)] => Gap::of(one.relieved(&models), other.relieved(&models)),
        [Err(fault), _] if needs_gap => return Err(fault.at(inputs[0]).into()),
        [_, Err(fault)] if needs_gap => return Err(fault.at(inputs[1]).into()),
        _ => None,
    };
    let (overlap_mm3, depth_mm, clearance_mm, clearance_between_mm) = match gap {
        Some(Gap::Overlap { volume_mm3, depth_mm }) => (Some(volume_mm3), Some(depth_mm), Some(0.0), None),
        Some(Gap::Apart { mm, between }) => (Some(0.0), Some(0.0), Some(mm), Some(between)),
        None => (None, None, None, None),
    };
    for (model, input) in [(&one, inputs[0]), (&other, inputs[1])] {
        model.check_unchanged(input)?;
    }
    Ok(IntersectReport {
        inputs: inputs.map(data),
        touch: both.is_some(),
        touching_voxels: both.map_or([0, 0], |(one, other)| [one.boxes, other.boxes]),
        first_mm: both.map(|(one, _)| one.first_mm),
        range_mm: both.map(|(one, _)| one.range_mm),
        overlap_mm3,
        depth_mm,
        clearance_mm,
        clearance_between_mm,
        peak_rss_bytes: peak_rss_bytes(),
        wall_s: start.elapsed().as_secs_f64(),
    })
}

impl IntersectReport {
    /// True if the bodies are known to be at least so many mm apart.
    pub fn is_clear_by(&self, mm: f64) -> bool {
        let shares_nothing = [self.overlap_mm3, self.depth_mm] == [Some(0.0); 2];
        shares_nothing && self.clearance_mm.is_some_and(|clearance| clearance >= mm)
    }

    /// Report for people.
    pub fn text(&self) -> String {
        let [one, other] = [0, 1].map(|i| shown(&self.inputs[i]).to_string());
        let point = |at: [f64; 3]| at.map(|c| Short(c).to_string()).join(", ");
        let gap = match (self.overlap_mm3, self.depth_mm, self.clearance_mm, self.clearance_between_mm) {
            (Some(volume), Some(depth), ..) if depth > 0.0 || volume > 0.0 => {
                format!("  they overlap by {} mm³, up to {} mm deep\n", Short(volume), Short(depth))
            }
            (.., Some(clearance), Some([from, to])) => {
                format!("  {} mm apart, from {} to {} mm (LPS)\n", Short(clearance), point(from), point(to))
            }
            _ => {
                format!(
                    "  overlap and clearance are not known: both need {SURFACE} cells, and one label at most\n"
                )
            }
        };
        let Some([low, high]) = self.range_mm else {
            return format!("{one} and {other} do not touch\n{gap}");
        };
        let [a, b] = self.touching_voxels;
        let [x, y, z] = [0, 1, 2].map(|i| format!("{} .. {}", Short(low[i]), Short(high[i])));
        format!(
            "{one} and {other} touch: {a} box(es) of the first, {b} of the second\n  at x {x}, y {y}, z {z} mm (LPS)\n{gap}"
        )
    }
}
