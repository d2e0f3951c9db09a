//! The report of a comparison.

use std::fmt::Write as _;

use serde::Serialize;

use super::{Distribution, PlaceOut};
use crate::geom::Affine;
use crate::text::{Count, Rounded, Short, shown};

/// Deviations of one model from another. Lengths are in mm, areas in mm2, places in the nominal's millimetres (LPS).
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct CompareReport {
    /// Both inputs, as named on the command line.
    pub inputs: [String; 2],
    /// Farthest counterpart.
    pub radius_mm: f64,
    /// Where the actual model lies.
    pub placement: Placement,
    /// Cells of the actual model.
    pub cells: u64,
    /// Cells without a counterpart within the radius and the angle, or whose counterpart is at the border of the nominal's
    /// volume; they are not among the deviations.
    pub without_counterpart: Area,
    /// Cells at the border of the actual model's volume, which are not compared.
    pub border: Border,
    /// Deviations, weighted by area; null if there are none.
    pub deviation: Option<Deviation>,
    /// Greatest distances of the surfaces from each other.
    pub hausdorff: Hausdorff,
    /// Verdict, if a tolerance was given.
    pub tolerance: Option<Tolerance>,
    /// Worst places: connected cells beyond the tolerance, or without one beyond the 95th percentile; of equal ones the
    /// largest first.
    pub worst: Vec<Worst>,
    /// Places of the nominal that the actual model lacks, as the worst ones: nothing of it is within the tolerance and a
    /// cell's diagonal, or the radius; empty unless measured both ways.
    pub lacking: Vec<Worst>,
    /// Cells of the nominal that lie beyond the actual model's volume, so that it is not known whether it lacks them;
    /// measured both ways.
    pub outside_volume: Area,
    /// Uncertainty of the deviations; null unless both models say how uncertain they are.
    pub uncertainty: Option<Uncertainty>,
    /// Spacing of the actual model, if it was built for the comparison.
    pub actual_grid_mm: Option<f64>,
    /// Spacing of the nominal model, if it was built for the comparison.
    pub nominal_grid_mm: Option<f64>,
    /// Sentences about the input: assumptions, parts left out, oddities.
    pub warnings: Vec<String>,
    /// Peak resident memory of the process.
    pub peak_rss_bytes: u64,
    /// Seconds from start to end.
    pub wall_s: f64,
}

/// Where the actual model lies.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Placement {
    /// Three rows of four numbers: from the actual model's millimetres to those of the nominal one.
    pub matrix: [[f64; 4]; 3],
    /// Rounds of the fit; 0 without one.
    pub rounds: u32,
    /// Root mean square distance of its cells before the fit.
    pub rms_before: Option<f64>,
    /// Root mean square distance after it, without the cells that it left out.
    pub rms_after: Option<f64>,
    /// Directions that the surfaces do not determine, and that the fit held.
    pub free: Vec<String>,
}

impl Placement {
    pub(super) fn given(affine: &Affine) -> Self {
        Self { matrix: affine.rows, rounds: 0, rms_before: None, rms_after: None, free: Vec::new() }
    }

    pub(super) fn affine(&self) -> Affine {
        Affine { rows: self.matrix }
    }
}

/// Cells with their area.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Area {
    /// Cells.
    pub cells: u64,
    /// Their area.
    pub area_mm2: f64,
    /// Part of the area that was asked for, 0 to 1.
    pub share: f64,
}

impl Area {
    /// Adds a cell.
    pub(in crate::jobs) fn add(&mut self, area_mm2: f64) {
        self.cells += 1;
        self.area_mm2 += area_mm2;
    }

    /// The cells with their share of an area; 0 of none.
    pub(in crate::jobs) fn of(self, all_mm2: f64) -> Self {
        Self { share: if all_mm2 > 0.0 { self.area_mm2 / all_mm2 } else { 0.0 }, ..self }
    }
}

/// Cells that are not compared.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Border {
    /// Cells.
    pub cells: u64,
}

/// Statistics weighted by area; percentiles are of the size, without its sign.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Deviation {
    /// Mean, with its sign.
    pub mean: f64,
    /// Root mean square.
    pub rms: f64,
    /// Half of the area deviates by no more.
    pub p50: f64,
    /// 95 % of the area deviate by no more.
    pub p95: f64,
    /// 99 % of the area deviate by no more.
    pub p99: f64,
    /// Least, with its sign: farthest inside.
    pub min: f64,
    /// Greatest, with its sign: farthest outside.
    pub max: f64,
}

impl Deviation {
    pub(super) fn of(all: &Distribution) -> Option<Self> {
        let ([mean, rms], [min, max]) = (all.mean_and_rms()?, all.range()?);
        let [p50, p95, p99] = [0.5, 0.95, 0.99].map(|part| all.percentile(part).unwrap_or(0.0));
        Some(Self { mean, rms, p50, p95, p99, min, max })
    }
}

/// Greatest distances of the surfaces from each other, whichever way they face: from each place to the nearest one, borders
/// of volumes left out.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Hausdorff {
    /// Distance of the actual model's surface from the nominal one: at the middles of cells, and at all corners of the
    /// 1,024 farthest; null where one of them has nothing within the radius.
    pub to_nominal: Option<f64>,
    /// Distance of the nominal surface from the actual one; null unless it is asked for, too.
    pub to_actual: Option<f64>,
    /// Bound on how much farther other places of the surfaces are: half a diagonal of a cell.
    pub within_mm: f64,
    /// True where a place has nothing within the radius, to the nominal and to the actual model.
    #[serde(skip)]
    pub is_beyond: [bool; 2],
}

/// Verdict on a tolerance. Shares are of the area that was asked for, 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Tolerance {
    /// Least deviation that conforms.
    pub lo: f64,
    /// Greatest deviation that conforms.
    pub hi: f64,
    /// Share within the tolerance.
    pub inside: f64,
    /// Share beyond it, and farther from all of the nominal than its limits and a cell's diagonal.
    pub outside: f64,
    /// Share whose uncertainty reaches over a limit, or that has no counterpart and is not far from all of the nominal.
    pub undecided: f64,
    /// All of it.
    pub verdict: Verdict,
}

/// Verdict on a tolerance.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub enum Verdict {
    /// All cells lie within the tolerance.
    Conforms,
    /// A cell lies beyond it, or, measured both ways, a part of the nominal is lacking.
    DoesNotConform,
    /// No cell lies beyond it for certain, but some may; or none has a counterpart.
    Undecided,
}

/// A place that stands out.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Worst {
    /// Its worst cell.
    pub at_mm: [f64; 3],
    /// Deviation there; without a counterpart the distance of the nearest surface with the side as its sign, or the radius.
    pub d_mm: f64,
    /// True if the cell has a counterpart.
    pub has_counterpart: bool,
    /// Uncertainty there (95 %); null if it is not known.
    pub u_mm: Option<f64>,
    /// Area of its cells.
    pub area_mm2: f64,
    /// Cells.
    pub cells: u64,
    /// Least and greatest coordinates.
    pub box_mm: [[f64; 3]; 2],
}

impl Worst {
    pub(super) fn of(place: &PlaceOut) -> Self {
        let PlaceOut { value, at, is_apart, u95, cells, area, range, .. } = *place;
        Self {
            at_mm: at,
            d_mm: value,
            has_counterpart: !is_apart,
            u_mm: u95,
            area_mm2: area,
            cells,
            box_mm: range,
        }
    }

    /// A line for people, with the deviation in words.
    fn line(&self, d: String) -> String {
        let [x, y, z] = self.at_mm.map(Short);
        let d = self.u_mm.map_or_else(|| d.clone(), |u| format!("{d} +- {}", Rounded(u)));
        let rest = match (self.has_counterpart, self.d_mm > 0.0) {
            (true, _) => "",
            (false, true) => ", outside without counterpart",
            (false, false) => ", inside without counterpart",
        };
        format!("    {d} mm at {x}, {y}, {z} mm, {} mm2{rest}\n", Rounded(self.area_mm2))
    }
}

/// Uncertainty of deviations: means by area (RMS) over the cells where it is known.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Uncertainty {
    /// Standard deviation by the noise of the volumes.
    pub sigma_noise_mm: f64,
    /// Standard deviation by the interpolation between samples, and by the grid of meshes.
    pub model_mm: f64,
    /// Median of half the 95 % intervals.
    pub median_u95_mm: f64,
    /// Share of the area where it is known: not at edges.
    pub share: f64,
    /// Standard deviation of the mean place of all cells by the stated one of the threshold; in no interval.
    pub common_mm: Option<f64>,
}

impl Verdict {
    /// Exit code of the command.
    pub fn code(self) -> u8 {
        match self {
            Self::Conforms => 0,
            Self::DoesNotConform => 6,
            Self::Undecided => 7,
        }
    }
}

impl CompareReport {
    /// Adds what has to be said about the figures.
    pub(super) fn warn(&mut self) {
        let percent = Rounded(100.0 * self.without_counterpart.share);
        if self.without_counterpart.cells > 0 && self.deviation.is_some() {
            self.warnings.push(format!(
                "{percent} % of the surface has no counterpart: nothing that faces the same way lies within {} mm; it is in \
                 no figure of deviation",
                Rounded(self.radius_mm)
            ));
        }
        if self.deviation.is_none() {
            let within = Rounded(self.radius_mm);
            self.warnings.push(format!(
                "no part of the surface has a counterpart within {within} mm: are the models in the same place and unit?"
            ));
        }
        if self.outside_volume.cells > 0 {
            self.warnings.push(format!(
                "{} % of NOMINAL lies beyond ACTUAL's volume: whether ACTUAL lacks it is not known",
                Rounded(100.0 * self.outside_volume.share)
            ));
        }
        if self.border.cells > 0 {
            self.warnings.push(format!(
                "{} at the border of the volume were not compared: the surface there may be where the volume ends",
                Count(self.border.cells, "cell")
            ));
        }
    }

    /// A deviation for people, with more digits where it would read like a limit of the tolerance.
    fn length(&self, mm: f64) -> String {
        let text = Rounded(mm).to_string();
        let limits = self.tolerance.map_or([f64::NAN; 2], |tolerance| [tolerance.lo, tolerance.hi]);
        let reads_like = limits.iter().any(|limit| Rounded(*limit).to_string() == text);
        if reads_like { Short(mm).to_string() } else { text }
    }

    /// Greatest distances for people; empty without any.
    fn hausdorff_line(&self) -> String {
        let Hausdorff { to_nominal, to_actual, within_mm, is_beyond } = self.hausdorff;
        let way = |mm: Option<f64>, is_beyond: bool| {
            let beyond = is_beyond.then(|| format!("more than {} mm", Rounded(self.radius_mm)));
            beyond.or_else(|| mm.map(|mm| format!("{} mm", Rounded(mm))))
        };
        let (to, back) = (way(to_nominal, is_beyond[0]), way(to_actual, is_beyond[1]));
        let ways = match (to, back) {
            (None, None) => return String::new(),
            (Some(to), None) => format!("one way, from ACTUAL to NOMINAL: {to}"),
            (None, Some(back)) => format!("one way, from NOMINAL to ACTUAL: {back}"),
            (Some(to), Some(back)) => format!("both ways: {to} and {back} back"),
        };
        let larger = if is_beyond.contains(&true) { "; a larger radius finds it" } else { "" };
        format!(
            "  Hausdorff distance, {ways}, at corners of cells, too; at most {} more between the places measured{larger}\n",
            Rounded(within_mm)
        )
    }

    /// The verdict, if a tolerance was given.
    pub fn verdict(&self) -> Option<Verdict> {
        self.tolerance.map(|tolerance| tolerance.verdict)
    }

    /// For people.
    pub fn text(&self) -> String {
        let [actual, nominal] = &self.inputs;
        let mut text = format!(
            "{} against {}: {}, counterparts within {} mm\n",
            shown(actual),
            shown(nominal),
            Count(self.cells, "cell"),
            Rounded(self.radius_mm)
        );
        if let Some(rms) = self.placement.rms_after {
            let (before, after) = (Rounded(self.placement.rms_before.unwrap_or(0.0)), Rounded(rms));
            let _ = writeln!(
                text,
                "  fit: {}, {before} mm before, {after} mm after (RMS)",
                Count(self.placement.rounds, "round")
            );
        }
        for free in &self.placement.free {
            let _ = writeln!(text, "  fit: {free} is free, and was held");
        }
        if let Some(d) = self.deviation {
            let [mean, rms, p95, p99, min, max] =
                [d.mean, d.rms, d.p95, d.p99, d.min, d.max].map(|mm| self.length(mm));
            let _ = writeln!(
                text,
                "  deviation (+ outside nominal): mean {mean}, RMS {rms}, 95 % within {p95}, 99 % within {p99}, from {min} to {max} mm"
            );
        }
        text += &self.hausdorff_line();
        if let Some(t) = self.tolerance {
            let verdict = match t.verdict {
                Verdict::Conforms => "conforms",
                Verdict::DoesNotConform => "does not conform",
                Verdict::Undecided => "undecided",
            };
            let [inside, outside, none] =
                [t.inside, t.outside, t.undecided].map(|part| Rounded(100.0 * part));
            let _ = writeln!(
                text,
                "  tolerance {}..{} mm: {verdict}; {inside} % inside, {outside} % outside, {none} % undecided",
                t.lo, t.hi
            );
        }
        if let Some(u) = self.uncertainty {
            let [noise, model, median, percent] =
                [u.sigma_noise_mm, u.model_mm, u.median_u95_mm, 100.0 * u.share].map(Rounded);
            let _ = writeln!(
                text,
                "  uncertainty: {median} mm in the median (95 %), by noise {noise} and by the models {model} (sigma); known on {percent} % of the area"
            );
            if let Some(common) = u.common_mm {
                let _ = writeln!(
                    text,
                    "  threshold: {} mm more (sigma), the same way for all cells",
                    Rounded(common)
                );
            }
        }
        if !self.worst.is_empty() {
            text += "  worst places: deviation, place (LPS), area of their cells\n";
        }
        text.extend(self.worst.iter().map(|place| place.line(self.length(place.d_mm))));
        if !self.lacking.is_empty() {
            text += "  places of NOMINAL that ACTUAL lacks: distance, place (LPS), area of their cells\n";
        }
        text.extend(self.lacking.iter().map(|place| place.line(self.length(place.d_mm))));
        for warning in &self.warnings {
            let _ = writeln!(text, "  note: {warning}");
        }
        text
    }
}
