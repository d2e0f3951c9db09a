//! `oct thickness`: thickness of the walls of a model.

mod gauge;
mod report;
#[cfg(test)]
mod tests;

use std::path::Path;
use std::thread;
use std::time::Instant;

use serde::{Deserialize, Serialize};

use super::compare::Area;
use super::export::{refuse_input, refuse_seen};
use super::open_model::{open_model, refuse_larger_leaves};
use super::pass::{Pass, Records};
use super::verify::verify_unless_packed;
use crate::budget::peak_rss_bytes;
use crate::error::Error;
use crate::fault::usage;
use crate::format::{ColorMap, Quantity};
use crate::load::Model;
use crate::measure::nearest::{BLOCK, Sample, Search, Surface};
use crate::measure::places::{PlaceOut, Places};
use crate::measure::statistics::Distribution;
use crate::measure::uncertainty::Uncertainty;
use crate::platform;
use crate::progress::Progress;
use crate::text::data;

pub(super) use gauge::{Gauge, Thickness};
pub use report::{Spread, ThicknessReport, Thin, ThinPlace};

/// Default limit of a ball: this part of the volume's shortest side, and at most so many voxels. A ball's cost rises
/// with its size.
const BALL_PART: f64 = 1.0 / 8.0;
const BALL_VOXELS: f64 = 32.0;

/// Fewest voxels of a wall that is measured.
const MIN_VOXELS: f64 = 2.0;

/// Most thin places listed.
const MAX_PLACES: usize = 10;

/// Definition of thickness.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub enum Method {
    /// Distance to the other side, against the normal.
    #[default]
    Ray,
    /// The largest ball within that touches the place.
    Ball,
}

impl Method {
    /// Name on the command line and in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Ray => "ray",
            Self::Ball => "ball",
        }
    }
}

/// Method and limits of a measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ThicknessRequest {
    /// Definition of thickness.
    pub by: Method,
    /// Greatest thickness in mm; by default the volume's diagonal for rays, and for balls an eighth of its shortest side,
    /// at most 32 voxels, or `thin_mm` if that is more.
    pub max_mm: Option<f64>,
    /// Thickness in mm below which a wall is thin.
    pub thin_mm: Option<f64>,
    /// Threads; the result does not depend on them.
    pub threads: usize,
}

impl Default for ThicknessRequest {
    /// Rays, on all cores.
    fn default() -> Self {
        let threads = thread::available_parallelism().map_or(1, usize::from);
        Self { by: Method::Ray, max_mm: None, thin_mm: None, threads }
    }
}

/// Files that are written.
#[derive(Clone, Copy, Debug, Default)]
pub struct ThicknessOutputs<'a> {
    /// The model with its thickness as values.
    pub model: Option<&'a Path>,
    /// A table of all cells.
    pub csv: Option<&'a Path>,
}

/// Results for one cell.
#[derive(Clone, Copy, Default)]
struct Row {
    number: u64,
    cell: [u32; 3],
    at_mm: [f64; 3],
    area_mm2: f64,
    thickness: Thickness,
    u95_mm: Option<f64>,
}

/// Measures the thickness below each cell of a model.
///
/// Memory: 8 MiB, and 600 KiB a thread. Temporary disk: 8 bytes a cell, and a packed model unpacked. Cost: microseconds a
/// cell; by balls as many as their voxels are wide.
///
/// # Errors
/// The model is damaged, has a skin of voxels, several labels, larger leaves or axes that are not at right angles; an output
/// cannot be written, and is left as it was before.
pub fn thickness(
    path: &Path,
    request: &ThicknessRequest,
    outputs: ThicknessOutputs<'_>,
    progress: &dyn Progress,
) -> Result<ThicknessReport, Error> {
    let start = Instant::now();
    platform::give_back();
    for length in [request.max_mm, request.thin_mm].into_iter().flatten() {
        if !(length > 0.0 && length.is_finite()) {
            return Err(usage!("a thickness must be above 0 mm").into());
        }
    }
    if let (Some(max), Some(thin)) = (request.max_mm, request.thin_mm)
        && thin > max
    {
        return Err(usage!("walls are measured up to {max} mm, so that not all below {thin} mm are found; choose {thin} or more, or leave the greatest thickness out").into());
    }
    outputs.model.into_iter().chain(outputs.csv).try_for_each(|output| refuse_input(path, output))?;
    verify_unless_packed(path)?;
    let model = open_model(path)?;
    refuse_larger_leaves(&model, path, "thickness is")?;
    refuse_seen(&model, path)?;
    let view = model.solid_view();
    let models = [&model];
    let surface = Surface::open(&view, &model.affine(), model.dims()).map_err(|fault| fault.at(path))?;
    let surface = surface.relieved(&models);
    let spacing = surface.space.spacing;
    let sides: [f64; 3] = std::array::from_fn(|a| f64::from(surface.dims[a]) * spacing[a]);
    let shortest = sides.into_iter().fold(f64::INFINITY, f64::min);
    let usual = match request.by {
        Method::Ray => sides.iter().map(|side| side * side).sum::<f64>().sqrt(),
        Method::Ball => (BALL_PART * shortest).min(BALL_VOXELS * surface.space.finest),
    };
    let thin_mm = request.thin_mm.unwrap_or(0.0);
    let (max_mm, noise) = (request.max_mm.unwrap_or(usual.max(thin_mm)), Uncertainty::of(&model));
    let gauge = Gauge { surface, by: request.by, max_mm, noise };
    let job = Job { path, model: &model, gauge, request, progress };
    let mut report = job.run(outputs)?;
    report.peak_rss_bytes = peak_rss_bytes();
    report.wall_s = start.elapsed().as_secs_f64();
    Ok(report)
}

struct Job<'a> {
    path: &'a Path,
    model: &'a Model,
    gauge: Gauge<'a>,
    request: &'a ThicknessRequest,
    progress: &'a dyn Progress,
}

impl<'a> Job<'a> {
    fn run(&self, outputs: ThicknessOutputs<'_>) -> Result<ThicknessReport, Error> {
        let folder = outputs.model.or(outputs.csv).unwrap_or(self.path);
        let mut records = Records::create(folder, outputs.csv, "thickness")?;
        let gauge = self.gauge;
        let mut found = Found::new(&gauge, self.request.thin_mm);
        self.progress.stage("measuring", self.model.header().voxels);
        let pass = Pass { models: &[self.model], progress: self.progress };
        let workers = (0..self.request.threads.max(1)).map(|_| gauge.surface.search());
        let row = |number, cell| Row { number, cell, ..Row::default() };
        let work = |search: &mut Search<'a>, rows: &mut [Row]| {
            let mut samples = [Sample::default(); BLOCK];
            gauge.surface.samples(rows.iter().map(|row| (row.number, row.cell)), &mut samples);
            rows.iter_mut().zip(&samples).for_each(|(row, sample)| row.fill(&gauge, search, sample));
        };
        pass.run(workers, row, work, |row| {
            found.add(row);
            let (kept, shown) = match row.thickness {
                Thickness::Of(value) => (value, value),
                Thickness::Thicker => (gauge.max_mm, f64::NAN),
                Thickness::None => (f64::NAN, f64::NAN),
            };
            let u95 = row.u95_mm.unwrap_or(f64::NAN);
            records.add((row.at_mm, row.area_mm2), &[kept], [shown, u95])
        })?;
        self.model.check_unchanged(self.path)?;
        let report = found.report(self);
        let quantity = self.quantity(&report);
        records.finish::<1>((self.model, outputs.model), &quantity, gauge.max_mm, self.progress)?;
        Ok(report)
    }

    /// The quantity that the written model carries.
    fn quantity(&self, report: &ThicknessReport) -> Quantity {
        let reach = report.thickness.map_or(self.gauge.max_mm, |spread| spread.p99);
        let reach = self.request.thin_mm.map_or(reach, |thin| reach.max(2.0 * thin));
        Quantity {
            name: "thickness".into(),
            unit: "mm".into(),
            sign: format!("by {}", self.request.by.name()),
            map: ColorMap::Sequential,
            range: [0.0, if reach > 0.0 { reach } else { self.gauge.max_mm }],
            tolerance: self.request.thin_mm.map(|thin| [thin, thin.max(self.gauge.max_mm)]),
        }
    }
}

impl Row {
    fn fill<'a>(&mut self, gauge: &Gauge<'a>, search: &mut Search<'a>, sample: &Sample) {
        let surface = &gauge.surface;
        self.at_mm = surface.space.to_world(sample.point);
        self.area_mm2 = sample.area;
        if !surface.touches_border(self.cell) && sample.area > 0.0 {
            (self.thickness, self.u95_mm) = gauge.measure(search, self.number, sample);
        }
    }
}

/// Sums of a pass.
#[derive(Default)]
struct Found {
    distribution: Distribution,
    all: Area,
    none: Area,
    thicker: Area,
    below: Area,
    /// Length of two voxels, the shortest that is measured.
    least_mm: f64,
    thin_mm: Option<f64>,
    thin: Area,
    places: Places,
}

impl Found {
    fn new(gauge: &Gauge<'_>, thin_mm: Option<f64>) -> Self {
        let finest = gauge.surface.space.finest;
        Self {
            distribution: Distribution::new(gauge.max_mm, finest),
            least_mm: MIN_VOXELS * finest,
            thin_mm,
            ..Self::default()
        }
    }

    fn add(&mut self, row: &Row) {
        self.all.add(row.area_mm2);
        let value = match row.thickness {
            Thickness::None => return self.none.add(row.area_mm2),
            Thickness::Thicker => return self.thicker.add(row.area_mm2),
            Thickness::Of(value) => value,
        };
        self.distribution.add(value, row.area_mm2);
        if value < self.least_mm {
            self.below.add(row.area_mm2);
        }
        if self.thin_mm.is_some_and(|thin| value < thin) {
            self.thin.add(row.area_mm2);
            let place = PlaceOut::of_cell(row.number, value, row.at_mm, row.area_mm2);
            self.places.add(row.cell, &PlaceOut { rank: -value, ..place });
        }
    }

    fn report(self, job: &Job<'_>) -> ThicknessReport {
        let [none, thicker, below_resolution, thin] =
            [self.none, self.thicker, self.below, self.thin].map(|area| area.of(self.all.area_mm2));
        let places = self.places.finish();
        ThicknessReport {
            input: data(job.path),
            by: job.request.by,
            max_mm: job.gauge.max_mm,
            cells: self.all.cells,
            none,
            thicker,
            below_resolution,
            thickness: Spread::of(&self.distribution),
            thin: self.thin_mm.map(|limit_mm| Thin {
                limit_mm,
                area_mm2: thin.area_mm2,
                share: thin.share,
                places: places.iter().take(MAX_PLACES).map(ThinPlace::of).collect(),
            }),
            peak_rss_bytes: 0,
            wall_s: 0.0,
        }
    }
}
