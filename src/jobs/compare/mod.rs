//! `oct compare`: how far the surface of one model lies from that of another.

mod farthest;
mod report;
mod rule;
mod subject;

use std::path::{Path, PathBuf};
use std::time::Instant;

use super::export::{refuse_input, refuse_seen};
use super::info::has_values;
use super::open_model::refuse_larger_leaves;
use super::pass::{PageRelief, Pass, Records};
use crate::budget::{MemoryCap, peak_rss_bytes};
use crate::builder::{BuildOptions, Threshold};
use crate::error::Error;
use crate::fault::{Fault, usage};
use crate::format::{ColorMap, Quantity, SelectionKind};
use crate::geom::{Affine, dot};
use crate::interior::extent;
use crate::load::{Model, ModelView};
use crate::measure::fit::fit;
use crate::measure::nearest::{Sample, Surface};
use crate::measure::places::{PlaceOut, Places};
use crate::measure::statistics::Distribution;
use crate::platform;
use crate::progress::Progress;
use crate::text::names::{BOTH_WAYS, GRID, ISO, UNCERTAINTY};
use crate::text::{Count, Short, data};

use farthest::Farthest;
pub use report::{
    Area, Border, CompareReport, Deviation, Hausdorff, Placement, Tolerance, Uncertainty, Verdict, Worst,
};
use rule::{Apart, Doubt, Measured, Row, Rule};
use subject::{Input, refuse_unfit};

/// Part of the nominal's diagonal within which counterparts are looked for.
const RADIUS: f64 = 1.0 / 20.0;

/// Most cells that a fit goes by.
const SAMPLES: u64 = 20_000;

/// Greatest distance that a fit may leave (RMS), as a part of the radius.
const MAX_REST: f64 = 1.0 / 4.0;

/// How two models are compared.
#[derive(Clone, Debug)]
pub struct CompareRequest {
    /// Farthest counterpart, in mm; a twentieth of the nominal's diagonal, if not given.
    pub radius_mm: Option<f64>,
    /// Least and greatest deviation that conform, in mm.
    pub tolerance_mm: Option<[f64; 2]>,
    /// Greatest angle between the normals of a place and of its counterpart, in degrees.
    pub angle_deg: f64,
    /// From the millimetres of the actual model to those of the nominal one: at right angles, without scale.
    pub placement: Affine,
    /// True to align the actual model first.
    pub fit: bool,
    /// Standard deviation of the threshold of the actual model, in its values.
    pub threshold_sigma: Option<f64>,
    /// True to measure the nominal from the actual model, too, for the Hausdorff distance.
    pub both_ways: bool,
    /// Most places listed.
    pub worst: usize,
    /// Threshold of inputs that are volumes.
    pub threshold: Threshold,
    /// Memory of the process while inputs are built that are no models.
    pub memory: MemoryCap,
    /// Threads.
    pub threads: usize,
}

impl Default for CompareRequest {
    /// No tolerance, no placement, all cores.
    fn default() -> Self {
        let build = BuildOptions::default();
        Self {
            radius_mm: None,
            tolerance_mm: None,
            angle_deg: 90.0,
            placement: Affine::from_spacing([1.0; 3]),
            fit: false,
            threshold_sigma: None,
            both_ways: false,
            worst: 10,
            threshold: build.threshold,
            memory: build.memory,
            threads: build.threads,
        }
    }
}

/// Files that a comparison writes.
#[derive(Clone, Copy, Debug, Default)]
pub struct CompareOutputs<'a> {
    /// The actual model with its deviations as values.
    pub model: Option<&'a Path>,
    /// A table of all cells.
    pub csv: Option<&'a Path>,
}

/// Compares two models, or inputs that models can be built of: each cell of the actual model with the nearest point of
/// the nominal one. Deviations are in mm, positive outside the nominal; places are in its millimetres.
///
/// Memory: 8 MiB, and 600 KiB a thread; inputs that are built take `memory`. Temporary disk: 16 bytes a cell, and the
/// models that are built. Cost: a microsecond a cell where the surfaces are near.
///
/// # Errors
/// An input is damaged, has a skin of voxels, several labels, larger leaves (the actual one) or axes that are not at right angles;
/// the fit does not find together; an output cannot be written, and then is as it was before.
pub fn compare(
    [actual, nominal]: [&Path; 2],
    request: &CompareRequest,
    outputs: CompareOutputs<'_>,
    progress: &dyn Progress,
) -> Result<CompareReport, Error> {
    let start = Instant::now();
    platform::give_back();
    request.check()?;
    for output in outputs.model.into_iter().chain(outputs.csv) {
        [actual, nominal].iter().try_for_each(|input| refuse_input(input, output))?;
    }
    let folder = outputs.model.or(outputs.csv).unwrap_or(actual);
    [actual, nominal].into_iter().try_for_each(|input| refuse_unfit(input, request))?;
    let one = Input::open(actual, None, request, folder, progress)?;
    let finest = one.model.affine().spacing_mm().into_iter().fold(f64::INFINITY, f64::min);
    let other = Input::open(nominal, Some(finest / 2.0), request, folder, progress)?;
    refuse_larger_leaves(&one.model, actual, "deviations are")?;
    refuse_seen(&other.model, nominal)?;
    let (one_view, other_view) = (one.model.solid_view(), other.model.solid_view());
    let models = [&one.model, &other.model];
    let job = Job {
        request,
        one: measured(&one, &one_view, &models)?,
        other: measured(&other, &other_view, &models)?,
        progress,
        paths: [actual, nominal],
    };
    let mut report = job.run(outputs, folder)?;
    report.inputs = [actual, nominal].map(data);
    (report.actual_grid_mm, report.nominal_grid_mm) = (one.grid_mm, other.grid_mm);
    let thresholds = other_thresholds([&one, &other]);
    report.warnings.splice(0..0, one.warnings.into_iter().chain(other.warnings).chain(thresholds));
    report.peak_rss_bytes = peak_rss_bytes();
    report.wall_s = start.elapsed().as_secs_f64();
    Ok(report)
}

/// Note on a volume that was built at a threshold of its own, next to one with another.
fn other_thresholds(inputs: [&Input; 2]) -> Option<String> {
    let of = inputs.map(|input| input.model.metadata());
    let is_own = |i: usize| inputs[i].grid_mm.is_some() && of[i].selection.kind == SelectionKind::Otsu;
    let of_volumes = of.iter().all(|of| has_values(of));
    let [one, other] = of.map(|of| of.selection.lo);
    ((is_own(0) || is_own(1)) && of_volumes && one.to_bits() != other.to_bits()).then(|| {
        format!(
            "ACTUAL is the surface at {}, NOMINAL at {}, as each volume has a threshold of its own by default; {ISO} sets one \
             for both",
            Short(one),
            Short(other)
        )
    })
}

fn measured<'a>(
    input: &'a Input,
    view: &'a ModelView<'a>,
    models: &'a [&'a Model],
) -> Result<Measured<'a>, Error> {
    let surface = Surface::open(view, &input.model.affine(), input.model.dims())
        .map_err(|fault| fault.at(&input.path))?
        .relieved(models);
    Ok(Measured { model: &input.model, surface, doubt: Doubt::of(&input.model) })
}

impl CompareRequest {
    fn check(&self) -> Result<(), Fault> {
        if self.radius_mm.is_some_and(|radius| !(radius > 0.0 && radius.is_finite())) {
            return Err(usage!("the radius must be above 0 mm"));
        }
        if !(0.0..=180.0).contains(&self.angle_deg) {
            return Err(usage!("the angle between normals must be 0 to 180 degrees"));
        }
        if self.threshold_sigma.is_some_and(|sigma| !(sigma >= 0.0 && sigma.is_finite())) {
            return Err(usage!("the standard deviation of the threshold must be 0 or more"));
        }
        if self.tolerance_mm.is_some_and(|[lo, hi]| !(lo <= hi && lo.is_finite() && hi.is_finite())) {
            return Err(usage!(
                "the tolerance must rise from its lower to its upper limit; a single number must be 0 or more"
            ));
        }
        let columns = [0, 1, 2].map(|a| self.placement.column(a));
        let is_rigid = (0..3).all(|a| {
            (dot(columns[a], columns[a]) - 1.0).abs() < 1e-6
                && dot(columns[a], columns[(a + 1) % 3]).abs() < 1e-6
        });
        if !is_rigid {
            return Err(usage!(
                "the placement scales or shears, so that it would change what is measured; give one of lengths 1 and \
                 right angles"
            ));
        }
        Ok(())
    }
}

struct Job<'a> {
    request: &'a CompareRequest,
    one: Measured<'a>,
    other: Measured<'a>,
    progress: &'a dyn Progress,
    paths: [&'a Path; 2],
}

impl Job<'_> {
    fn run(&self, outputs: CompareOutputs<'_>, folder: &Path) -> Result<CompareReport, Error> {
        let Self { request, one, other, .. } = *self;
        let radius_mm = request.radius_mm.unwrap_or_else(|| RADIUS * diagonal_mm(&other));
        let placement = self.place(radius_mm)?;
        let cosine = request.angle_deg.to_radians().cos();
        let diagonal = cell_diagonal_mm(&one);
        // Edges that cells cut off are included.
        let far_mm = request.tolerance_mm.map_or(radius_mm, |[lo, hi]| lo.abs().max(hi.abs()) + diagonal);
        let is_whole = other.is_whole();
        let rule = Rule { placement: placement.affine(), radius_mm, cosine, far_mm, is_whole };
        let mut records = Records::create(folder, outputs.csv, "deviation")?;
        let mut found = Found::new(radius_mm, one.surface.space.finest);
        found.has_intervals = one.doubt.is_known() && other.doubt.is_known();
        let mut farthest = Farthest::default();
        self.progress.stage("comparing", one.model.header().voxels);
        self.measure(&rule, [one, other], |row| {
            found.add(row, request.tolerance_mm, rule.is_far(row.distance));
            farthest.add(row);
            if let (Some(_), Some(shift)) = (row.value, one.doubt.shift_mm(row.number)) {
                found.shift = [found.shift[0] + shift * row.area_mm2, found.shift[1] + row.area_mm2];
            }
            let shown = [row.value, row.u95_mm()].map(|value| value.unwrap_or(f64::NAN));
            records.add((row.at_mm, row.area_mm2), &row.kept(), shown)
        })?;
        let back = self.way_back(&rule)?;
        let distances = [farthest.distance_mm(&rule, &one, &other), back.distance_mm];
        let worst = match found.distribution.count() {
            0 => Vec::new(),
            _ => self.worst(&mut records, &rule, found.distribution.percentile(0.95))?,
        };
        for (measured, path) in [one, other].iter().zip(self.paths) {
            measured.model.check_unchanged(path)?;
        }
        records.finish::<2>((one.model, outputs.model), &self.quantity(&found), radius_mm, self.progress)?;
        Ok(found.report(self, (placement, radius_mm), distances, worst, back))
    }

    /// Measures the cells of one model from the surface of the other.
    fn measure(
        &self,
        rule: &Rule,
        [one, other]: [Measured<'_>; 2],
        each: impl FnMut(&Row) -> Result<(), Error>,
    ) -> Result<(), Error> {
        let pass = Pass { models: &[one.model, other.model], progress: self.progress };
        let workers = (0..self.request.threads.max(1)).map(|_| other.surface.search());
        let row = |number, cell| Row { number, cell, ..Row::default() };
        pass.run(workers, row, |search, rows| rule.fill([&one, &other], search, rows), each)
    }

    /// Where the actual model lies.
    fn place(&self, radius_mm: f64) -> Result<Placement, Error> {
        let given = Placement::given(&self.request.placement);
        if !self.request.fit {
            return Ok(given);
        }
        let stride = self.one.model.header().voxels.div_ceil(SAMPLES).max(1);
        let chosen = self.one.model.voxels().places().filter(|(number, _)| number % stride == 0);
        let identity = Affine::from_spacing([1.0; 3]);
        let samples: Vec<Sample> = chosen
            .map(|(number, cell)| self.one.row(number, cell, &identity))
            .filter(|(row, _)| !row.is_border)
            .map(|(row, normal)| Sample { point: row.at_mm, normal, area: row.area_mm2 })
            .collect();
        let mut search = self.other.surface.search();
        let models = self.models();
        let mut relief = PageRelief::new(&models);
        let found = fit(&samples, given.affine(), &mut search, radius_mm * MAX_REST, &mut || {
            relief.step(1);
            self.progress.stopped()
        });
        let Some(found) = found.map_err(|fault| fault.at(self.paths[0]))? else {
            return Err(Error::Stopped);
        };
        Ok(Placement {
            matrix: found.placement.rows,
            rounds: found.rounds,
            rms_before: Some(found.rms[0]),
            rms_after: Some(found.rms[1]),
            free: found.free,
        })
    }

    fn models(&self) -> [&Model; 2] {
        [self.one.model, self.other.model]
    }

    /// The nominal measured from the actual model, if it is asked for.
    fn way_back(&self, rule: &Rule) -> Result<Back, Error> {
        let mut found = Back::default();
        let placement = rule.placement.inverse().filter(|_| self.request.both_ways);
        let Some(placement) = placement else { return Ok(found) };
        let back = Rule { placement, is_whole: self.one.is_whole(), ..*rule };
        let (mut farthest, mut places) = (Farthest::default(), Places::default());
        let mut apart = Apart::new(&self.one.surface, rule.radius_mm);
        let mut area_mm2 = 0.0;
        self.progress.stage("comparing back", self.other.model.header().voxels);
        self.measure(&back, [self.other, self.one], |row| {
            farthest.add(row);
            if row.is_border || row.area_mm2 <= 0.0 {
                return Ok(());
            }
            area_mm2 += row.area_mm2;
            if row.is_unknown {
                found.unknown.add(row.area_mm2);
            } else if back.is_far(row.distance) {
                let mm = row.value.unwrap_or_else(|| apart.signed_mm(row.at_mm));
                // Within the actual model the nominal's surface is covered.
                if mm > 0.0 {
                    found.lacks = true;
                    let there = Row { at_mm: rule.placement.apply(row.at_mm), ..*row };
                    places.add(row.cell, &PlaceOut { is_apart: true, ..there.place(mm) });
                }
            }
            Ok(())
        })?;
        found.unknown = found.unknown.of(area_mm2);
        found.distance_mm = farthest.distance_mm(&back, &self.other, &self.one);
        found.lacking = self.listed(places);
        Ok(found)
    }

    /// The places that are listed.
    fn listed(&self, places: Places) -> Vec<Worst> {
        places.finish().iter().take(self.request.worst).map(Worst::of).collect()
    }

    /// The worst places: beyond the tolerance, or without one beyond the 95th percentile.
    fn worst(&self, records: &mut Records<'_>, rule: &Rule, p95: Option<f64>) -> Result<Vec<Worst>, Error> {
        let mut places = Places::default();
        let mut apart = Apart::new(&self.other.surface, rule.radius_mm);
        let p95 = p95.unwrap_or(f64::INFINITY);
        let models = self.models();
        let mut relief = PageRelief::new(&models);
        for ((number, cell), value) in self.one.model.voxels().places().zip(records.values()?) {
            let [value, u95] = value.map_err(|cause| Error::Output { path: std::env::temp_dir(), cause })?;
            let known = Some(u95).filter(|u| !u.is_nan());
            let is_out = match self.request.tolerance_mm {
                _ if value.is_nan() => rule.is_far(known),
                Some([lo, hi]) => value < lo || value > hi,
                None => value.abs() > p95,
            };
            if is_out {
                let (row, _) = self.one.row(number, cell, &rule.placement);
                if row.area_mm2 > 0.0 {
                    let place = match value.is_nan() {
                        true => PlaceOut { is_apart: true, ..row.place(apart.signed_mm(row.at_mm)) },
                        false => PlaceOut { u95: known, ..row.place(value) },
                    };
                    places.add(cell, &place);
                }
            }
            relief.step(1);
        }
        Ok(self.listed(places))
    }

    /// Deviation, as a model carries it.
    fn quantity(&self, found: &Found) -> Quantity {
        let tolerance = self.request.tolerance_mm;
        let size = tolerance.map_or(0.0, |[lo, hi]| lo.abs().max(hi.abs()));
        let all = [size, found.distribution.percentile(0.99).unwrap_or(0.0), self.one.surface.space.finest];
        let reach = all.into_iter().find(|reach| *reach > 0.0).unwrap_or(1.0);
        Quantity {
            name: "deviation".into(),
            unit: "mm".into(),
            sign: "+ outside nominal".into(),
            map: ColorMap::Diverging,
            range: [-reach, reach],
            tolerance,
        }
    }
}

/// Diagonal of a cell.
fn cell_diagonal_mm(of: &Measured<'_>) -> f64 {
    let spacing = of.surface.space.spacing;
    dot(spacing, spacing).sqrt()
}

/// Diagonal of the box around a model's surface.
fn diagonal_mm(of: &Measured<'_>) -> f64 {
    let [low, end] = extent(of.surface.view).unwrap_or([[0; 3], of.surface.dims]);
    let edges: [f64; 3] =
        std::array::from_fn(|a| f64::from(end[a].saturating_sub(low[a])) * of.surface.space.spacing[a]);
    dot(edges, edges).sqrt()
}

/// What the way back finds.
#[derive(Default)]
struct Back {
    /// The greatest distance from the actual model.
    distance_mm: Option<f64>,
    /// True if the actual model lacks a place, listed or not.
    lacks: bool,
    /// The worst of these places.
    lacking: Vec<Worst>,
    /// Surface beyond its volume.
    unknown: Area,
}

/// Sums of a pass.
#[derive(Default)]
struct Found {
    distribution: Distribution,
    cells: u64,
    border: u64,
    without: Area,
    area_mm2: f64,
    /// Cells within the tolerance, beyond it, and so near its limits that the uncertainty does not decide, or without a
    /// counterpart although some surface is near.
    within: Area,
    beyond: Area,
    doubtful: Area,
    /// Doubtful cells at sharp edges.
    edges: u64,
    /// Half the 95 % intervals, and sums by area of the squares that they are made of.
    intervals: Distribution,
    squares: [f64; 2],
    known: Area,
    /// True if most cells have an interval, so that one without it is not beyond the tolerance for certain.
    has_intervals: bool,
    /// Sum by area of how far cells move where the threshold rises by one unit, and the area.
    shift: [f64; 2],
}

impl Found {
    fn new(radius_mm: f64, finest: f64) -> Self {
        Self {
            distribution: Distribution::new(radius_mm, finest),
            intervals: Distribution::new(radius_mm, finest),
            ..Self::default()
        }
    }

    /// Adds a cell; `is_far` is true if it deviates for certain, counterpart or not.
    fn add(&mut self, row: &Row, tolerance_mm: Option<[f64; 2]>, is_far: bool) {
        self.cells += 1;
        if row.is_border {
            self.border += 1;
            return;
        }
        // A plane that meets its cell in a corner or an edge only: its neighbours have the surface there.
        if row.area_mm2 <= 0.0 {
            return;
        }
        self.area_mm2 += row.area_mm2;
        let Some(value) = row.value else {
            self.without.add(row.area_mm2);
            let verdict = if is_far { &mut self.beyond } else { &mut self.doubtful };
            return verdict.add(row.area_mm2);
        };
        self.distribution.add(value, row.area_mm2);
        if let (Some(squares), Some(u95)) = (row.squares, row.u95_mm()) {
            self.intervals.add(u95, row.area_mm2);
            self.squares = std::array::from_fn(|i| self.squares[i] + squares[i] * row.area_mm2);
            self.known.add(row.area_mm2);
        }
        let Some([lo, hi]) = tolerance_mm else { return };
        let u = row.u95_mm().unwrap_or(0.0);
        if lo + u <= value && value <= hi - u {
            self.within.add(row.area_mm2);
        } else if (value < lo - u || value > hi + u) && (row.squares.is_some() || !self.has_intervals) {
            self.beyond.add(row.area_mm2);
        } else {
            self.doubtful.add(row.area_mm2);
            self.edges += u64::from(row.is_edge);
        }
    }

    fn report(
        mut self,
        job: &Job<'_>,
        (placement, radius_mm): (Placement, f64),
        distances: [Option<f64>; 2],
        worst: Vec<Worst>,
        Back { lacks, lacking, unknown, .. }: Back,
    ) -> CompareReport {
        let lacks = lacks && job.request.tolerance_mm.is_some();
        if self.distribution.count() == 0 {
            // The models may be in different places.
            (self.doubtful, self.beyond) = (self.without, Area::default());
        }
        let [without, within, beyond, doubtful, known] =
            [self.without, self.within, self.beyond, self.doubtful, self.known]
                .map(|area| area.of(self.area_mm2));
        let tolerance = job.request.tolerance_mm.map(|[lo, hi]| Tolerance {
            lo,
            hi,
            inside: within.share,
            outside: beyond.share,
            undecided: doubtful.share,
            verdict: match (beyond.cells, doubtful.cells + unknown.cells, self.distribution.count()) {
                (.., 0) => Verdict::Undecided,
                _ if lacks => Verdict::DoesNotConform,
                (0, 0, _) => Verdict::Conforms,
                (0, ..) => Verdict::Undecided,
                _ => Verdict::DoesNotConform,
            },
        });
        let mean = |square: f64| (square / known.area_mm2).sqrt();
        let uncertainty = (known.area_mm2 > 0.0).then(|| Uncertainty {
            sigma_noise_mm: mean(self.squares[0]),
            model_mm: mean(self.squares[1]),
            median_u95_mm: self.intervals.percentile(0.5).unwrap_or(0.0),
            share: known.share,
            common_mm: job.request.threshold_sigma.map(|sigma| sigma * self.shift[0] / self.shift[1]),
        });
        let deviation = Deviation::of(&self.distribution);
        let [to_nominal, to_actual] = distances.map(|distance| distance.filter(|mm| mm.is_finite()));
        let is_beyond = distances.map(|distance| distance == Some(f64::INFINITY));
        let mut report = CompareReport {
            inputs: job.paths.map(data),
            radius_mm,
            placement,
            cells: self.cells,
            without_counterpart: without,
            border: Border { cells: self.border },
            deviation,
            hausdorff: Hausdorff {
                to_nominal,
                to_actual,
                within_mm: cell_diagonal_mm(&job.one) / 2.0,
                is_beyond,
            },
            tolerance,
            worst,
            lacking,
            outside_volume: unknown,
            uncertainty,
            actual_grid_mm: None,
            nominal_grid_mm: None,
            warnings: Vec::new(),
            peak_rss_bytes: 0,
            wall_s: 0.0,
        };
        if let [Doubt::Volume(_), Doubt::Unknown] | [Doubt::Unknown, Doubt::Volume(_)] =
            [job.one.doubt, job.other.doubt]
        {
            report.warnings.push(format!(
                "one of the models does not state how uncertain it is, so no interval is given; build both with {UNCERTAINTY}"
            ));
        }
        if lacks && deviation.is_some() {
            report.warnings.push("a part of NOMINAL has nothing of ACTUAL within the tolerance".into());
        } else if report.verdict() == Some(Verdict::Conforms) && distances[1].is_none() {
            report
                .warnings
                .push(format!("what ACTUAL lacks of NOMINAL is not looked for without {BOTH_WAYS}"));
        }
        if report.verdict() == Some(Verdict::Undecided) && self.edges > 0 {
            report.warnings.push(format!(
                "{} of the undecided ones {} at sharp edges, which cells cut off by up to half a voxel: build the mesh or tree on \
                 a finer grid ({GRID}) to decide more of them",
                Count(self.edges, "cell"),
                if self.edges == 1 { "lies" } else { "lie" }
            ));
        }
        report.warn();
        report
    }
}
