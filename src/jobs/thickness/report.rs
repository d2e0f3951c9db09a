//! The report of a measurement of thickness.

use std::fmt::Write as _;

use serde::Serialize;

use super::Method;
use crate::jobs::compare::Area;
use crate::measure::places::PlaceOut;
use crate::measure::statistics::Distribution;
use crate::text::{Count, Rounded, Short, shown};

/// Thickness of the walls of a model. Lengths are in mm, areas in mm2, places in LPS mm.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct ThicknessReport {
    /// Input as named on the command line; several separated by blanks; `-` for standard input.
    pub input: String,
    /// Method of the measurement.
    pub by: Method,
    /// Greatest thickness that is measured.
    pub max_mm: f64,
    /// Cells of the model.
    pub cells: u64,
    /// Cells without a thickness: the ray meets no other side, or one at the border of the volume.
    pub none: Area,
    /// Cells whose thickness is more than `max_mm`.
    pub thicker: Area,
    /// Components, or cells, below the resolution.
    pub below_resolution: Area,
    /// Thickness of the cells where it is up to `max_mm`, weighted by area; null if there are none.
    pub thickness: Option<Spread>,
    /// Thin places, if a limit was given.
    pub thin: Option<Thin>,
    /// Peak resident memory of the process.
    pub peak_rss_bytes: u64,
    /// Seconds from start to end.
    pub wall_s: f64,
}

/// Statistics weighted by area.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Spread {
    /// Mean.
    pub mean: f64,
    /// 1 % of the area is no thicker.
    pub p1: f64,
    /// 5 % of the area are no thicker.
    pub p5: f64,
    /// Half of the area is no thicker.
    pub p50: f64,
    /// 95 % of the area are no thicker.
    pub p95: f64,
    /// 99 % of the area are no thicker.
    pub p99: f64,
    /// Least.
    pub min: f64,
    /// Greatest.
    pub max: f64,
}

impl Spread {
    pub(super) fn of(all: &Distribution) -> Option<Self> {
        let ([mean, _], [min, max]) = (all.mean_and_rms()?, all.range()?);
        let [p1, p5, p50, p95, p99] =
            [0.01, 0.05, 0.5, 0.95, 0.99].map(|part| all.percentile(part).unwrap_or(0.0));
        Some(Self { mean, p1, p5, p50, p95, p99, min, max })
    }
}

/// Thin places.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Thin {
    /// Thickness below which a wall is thin.
    pub limit_mm: f64,
    /// Area of the thin places.
    pub area_mm2: f64,
    /// Part of the measured area, 0 to 1.
    pub share: f64,
    /// Connected thin cells, the thinnest first, at most ten.
    pub places: Vec<ThinPlace>,
}

/// A thin place.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct ThinPlace {
    /// Place of its thinnest cell.
    pub at_mm: [f64; 3],
    /// Thickness of that cell.
    pub thickness_mm: f64,
    /// Area of the place.
    pub area_mm2: f64,
    /// Least and greatest coordinates of the place.
    pub box_mm: [[f64; 3]; 2],
}

impl ThinPlace {
    pub(super) fn of(place: &PlaceOut) -> Self {
        let PlaceOut { value, at, area, range, .. } = *place;
        Self { at_mm: at, thickness_mm: value, area_mm2: area, box_mm: range }
    }
}

impl ThicknessReport {
    /// Report for people.
    pub fn text(&self) -> String {
        let (by, most) = (self.by.name(), Rounded(self.max_mm));
        let mut text =
            format!("{}: {}, by {by}, up to {most} mm\n", shown(&self.input), Count(self.cells, "cell"));
        if let Some(t) = self.thickness {
            let [mean, p5, p50, p95, min, max] = [t.mean, t.p5, t.p50, t.p95, t.min, t.max].map(Rounded);
            let of = match 1.0 - self.thicker.share - self.none.share {
                _ if self.thicker.cells == 0 => String::new(),
                share => format!(" of the {} % of the area that is no thicker", Rounded(100.0 * share)),
            };
            let _ = writeln!(
                text,
                "  thickness{of}: mean {mean}, 5 % of the area up to {p5}, half up to {p50}, 95 % up to {p95}, from {min} to {max} mm"
            );
        }
        let parts = [
            ("thicker than that", self.thicker),
            ("without a thickness", self.none),
            ("below two voxels, too thin to be measured", self.below_resolution),
        ];
        for (what, area) in parts.into_iter().filter(|(_, area)| area.cells > 0) {
            let _ = writeln!(
                text,
                "  {what}: {}, {} % of the area",
                Count(area.cells, "cell"),
                Rounded(100.0 * area.share)
            );
        }
        if let Some(thin) = &self.thin {
            let [limit, area, share] = [thin.limit_mm, thin.area_mm2, 100.0 * thin.share].map(Rounded);
            let _ = writeln!(text, "  thinner than {limit} mm: {area} mm2, {share} % of the area");
            for place in &thin.places {
                let [x, y, z] = place.at_mm.map(Short);
                let [thickness, area] = [place.thickness_mm, place.area_mm2].map(Rounded);
                let _ = writeln!(text, "  {thickness} mm at {x}, {y}, {z} mm (LPS), {area} mm2");
            }
        }
        text
    }
}
