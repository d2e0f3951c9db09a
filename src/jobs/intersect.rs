//! `oct intersect`: do two models touch, and where.

use std::path::{Path, PathBuf};
use std::time::Instant;

use serde_json::{Value, json};

use super::opened::open_model;
use super::verify::verify_file;
use crate::budget::peak_rss_bytes;
use crate::contact::{Contact, Placed, contact};
use crate::error::{Error, UsageError};
use crate::geom::Affine;
use crate::text::Short;
use crate::text::{data, shown};

/// Whether two models touch.
#[derive(Clone, Debug, PartialEq)]
pub struct IntersectReport {
    /// Both, as named.
    pub inputs: [String; 2],
    /// What of each touches the other; `None` if they do not touch.
    pub contacts: Option<[Contact; 2]>,
    /// Seconds from start to end.
    pub wall_s: f64,
}

/// Checks two models, and tells which boxes of their finest levels have a point in common; `placement` leads from the
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
    let found = contact(one_placed, other_placed);
    let back = found.and_then(|_| contact(other_placed, one_placed));
    for (model, input) in [(&one, inputs[0]), (&other, inputs[1])] {
        model.check_unchanged(input)?;
    }
    Ok(IntersectReport {
        inputs: inputs.map(data),
        contacts: found.zip(back).map(|(a, b)| [a, b]),
        wall_s: start.elapsed().as_secs_f64(),
    })
}

impl IntersectReport {
    /// One JSON object.
    pub fn json(&self) -> Value {
        let mut object = json!({
            "inputs": self.inputs,
            "touch": self.contacts.is_some(),
            "touching_voxels": self.contacts.map_or([0, 0], |both| both.map(|c| c.boxes)),
            "peak_rss_bytes": peak_rss_bytes(),
            "wall_s": self.wall_s,
        });
        if let Some([one, _]) = self.contacts {
            object["first_mm"] = json!(one.first_mm);
            object["range_mm"] = json!(one.range_mm);
        }
        object
    }

    /// For people.
    pub fn text(&self) -> String {
        let [one, other] = [0, 1].map(|i| shown(&self.inputs[i]).to_string());
        let Some([a, b]) = self.contacts else { return format!("{one} and {other} do not touch\n") };
        let [low, high] = a.range_mm;
        let range = |i: usize| format!("{} .. {}", Short(low[i]), Short(high[i]));
        format!(
            "{one} and {other} touch: {} box(es) of the first, {} of the second\n  at x {}, y {}, z {} mm (LPS)\n",
            a.boxes,
            b.boxes,
            range(0),
            range(1),
            range(2)
        )
    }
}
