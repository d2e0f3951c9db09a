//! Measurements as values: experiments of rows with costs and errors.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::time::Instant;

use serde::Serialize;

use super::plot::short;

/// A choice is tried in several ways, everything else left alike.
#[derive(Clone, Debug, Default, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Experiment {
    /// Short name, the same in every version.
    pub id: &'static str,
    /// Headline: the choices compared.
    pub title: &'static str,
    /// How it is measured, and against which reference.
    pub about: Cow<'static, str>,
    /// Verdict: the setting to choose and its cost, in one sentence.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub advice: Option<String>,
    /// The cost and the error that are drawn.
    pub drawn: Drawn,
    /// One for each choice measured.
    pub rows: Vec<Row>,
    /// Names and PNGs that stand beside the drawing.
    #[serde(skip)]
    pub pictures: Vec<(String, Vec<u8>)>,
}

/// The two axes of an experiment's drawing.
#[derive(Clone, Copy, Debug, Default, Serialize)]
#[serde(into = "[&'static str; 2]")]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Drawn {
    /// The cost on the horizontal axis, by its place in `Costs::NAMES`.
    pub cost: usize,
    /// The error that is drawn upwards.
    pub metric: Metric,
}

impl From<Drawn> for [&'static str; 2] {
    fn from(drawn: Drawn) -> Self {
        [Costs::NAMES[drawn.cost], drawn.metric.key()]
    }
}

/// One measurement.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Row {
    /// The volume or model.
    pub subject: String,
    /// The choice measured.
    pub choice: String,
    /// True for the default of the program.
    #[serde(rename = "default")]
    pub usual: bool,
    /// True if no other choice has both a lower cost and a lower error.
    pub on_front: bool,
    /// Times, sizes and counts, named as in report.csv.
    pub costs: Costs,
    /// Errors, named as in report.csv; report.html says what they are measured against.
    pub errors: Errors,
}

/// Costs of a choice; `None` where one was not measured.
#[derive(Clone, Copy, Debug, Default, Serialize)]
#[serde(into = "BTreeMap<&'static str, f64>")]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Costs {
    /// Seconds of the build, the median of five.
    pub build_s: Option<f64>,
    /// Nanoseconds for each ray on one thread, the median of five.
    pub ns_per_ray: Option<f64>,
    /// Bytes that the build reserved.
    pub memory_bytes: Option<u64>,
    /// Bytes of the model.
    pub file_bytes: Option<u64>,
    /// Boxes of the surface: voxels, or cells and larger leaves.
    pub boxes: Option<u64>,
    /// How much longer the slowest of the repeated timings took than the fastest, in percent of that.
    pub spread_percent: Option<f64>,
    /// Nanoseconds for each point, cell or voxel measured, on one thread, the median of five.
    pub ns_per_point: Option<f64>,
}

/// Place of the spread among costs.
const SPREAD: usize = 5;

impl Costs {
    /// Names of the costs, in the order of [`Costs::values`].
    pub(crate) const NAMES: [&'static str; 7] =
        ["build_s", "ns_per_ray", "memory_bytes", "file_bytes", "boxes", "spread_percent", "ns_per_point"];
    /// The same for people.
    pub(crate) const TITLES: [&'static str; 7] =
        ["build, s", "ray, ns", "memory, bytes", "file, bytes", "boxes", "spread of times, %", "point, ns"];

    /// All as numbers.
    pub(crate) fn values(&self) -> [Option<f64>; 7] {
        [
            self.build_s,
            self.ns_per_ray,
            self.memory_bytes.map(|b| b as f64),
            self.file_bytes.map(|b| b as f64),
            self.boxes.map(|b| b as f64),
            self.spread_percent,
            self.ns_per_point,
        ]
    }

    /// With the times of rays, and the greater of both spreads.
    pub(super) fn with_rays(self, times: &Times) -> Self {
        let spread = self.spread_percent.map_or(times.spread_percent(), |s| s.max(times.spread_percent()));
        Self { ns_per_ray: Some(times.median()), spread_percent: Some(spread), ..self }
    }
}

/// Runs of everything that is timed.
pub(super) const RUNS: usize = 5;
/// Spread of times, in percent, above which a row is marked.
pub(super) const UNEVEN_PERCENT: f64 = 20.0;

/// Repeated timings, in rising order.
#[derive(Clone, Debug)]
pub(super) struct Times(Vec<f64>);

impl Times {
    /// Times of [`RUNS`] runs, and the result of the last one.
    pub(super) fn of<T, E>(mut run: impl FnMut() -> Result<(f64, T), E>) -> Result<(Self, T), E> {
        let (first, mut result) = run()?;
        let mut all = vec![first];
        for _ in 1..RUNS {
            let (time, next) = run()?;
            all.push(time);
            result = next;
        }
        all.sort_by(f64::total_cmp);
        Ok((Self(all), result))
    }

    /// Seconds of [`RUNS`] runs, and the result of the last one.
    pub(super) fn measured<T, E>(mut run: impl FnMut() -> Result<T, E>) -> Result<(Self, T), E> {
        Self::of(|| {
            let started = Instant::now();
            let result = run()?;
            Ok((started.elapsed().as_secs_f64(), result))
        })
    }

    pub(super) fn median(&self) -> f64 {
        self.0[self.0.len() / 2]
    }

    pub(super) fn spread_percent(&self) -> f64 {
        100.0 * (self.0[self.0.len() - 1] / self.0[0] - 1.0)
    }

    pub(super) fn scaled(self, factor: f64) -> Self {
        Self(self.0.into_iter().map(|time| time * factor).collect())
    }
}

/// Kinds of errors.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub enum Metric {
    /// Root of the mean square of the distance to the reference, in voxels of the finest spacing.
    #[default]
    DepthRms,
    /// Its 99th percentile.
    DepthP99,
    /// Its greatest value.
    DepthMax,
    /// Pixels that meet another sheet than the reference, several boxes off, in percent of its pixels. Their distances
    /// are left out of the three above.
    OtherSheet,
    /// Pixels that hit where the reference does not or the other way round, in percent of its pixels.
    WrongPixels,
    /// Mean angle of the normal at the hit to the reference's, in degrees.
    NormalMean,
    /// Its 99th percentile.
    NormalP99,
    /// Root of the mean square difference of pictures, in grey levels of 0 to 255.
    Picture,
    /// Bytes of the model that differ from those of the usual choice.
    DifferentBytes,
    /// Points farther than 0.6 voxel from the true surface that are on the wrong side, in percent.
    WrongSides,
    /// Mean size of the error of a pore's volume, in percent of that.
    Volume,
    /// Cells without a thickness, and pores that were not found, in percent.
    Missed,
}

impl Metric {
    /// Every kind in the order of tables, with its name in files and its title for people.
    const TABLE: [(Self, &'static str, &'static str); 12] = [
        (Self::DepthRms, "depth_rms_voxels", "distance RMS, voxels"),
        (Self::DepthP99, "depth_p99_voxels", "distance p99, voxels"),
        (Self::DepthMax, "depth_max_voxels", "distance max, voxels"),
        (Self::OtherSheet, "other_sheet_percent", "another sheet, %"),
        (Self::WrongPixels, "wrong_pixels_percent", "wrong pixels, %"),
        (Self::NormalMean, "normal_mean_deg", "normal mean, deg"),
        (Self::NormalP99, "normal_p99_deg", "normal p99, deg"),
        (Self::Picture, "picture_rms_levels", "picture RMS, grey levels"),
        (Self::DifferentBytes, "different_bytes", "bytes that differ"),
        (Self::WrongSides, "wrong_sides_percent", "wrong sides, %"),
        (Self::Volume, "volume_error_percent", "pores' volume, %"),
        (Self::Missed, "missed_percent", "not found, %"),
    ];

    /// Every kind, in the order of tables.
    pub(crate) fn all() -> [Self; 12] {
        Self::TABLE.map(|(metric, ..)| metric)
    }

    /// Its name in files.
    pub(crate) fn key(self) -> &'static str {
        Self::TABLE[self as usize].1
    }

    /// Its title for people.
    pub(crate) fn title(self) -> &'static str {
        Self::TABLE[self as usize].2
    }
}

/// Errors by [`Metric`]; what does not apply is `None`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
#[serde(into = "BTreeMap<&'static str, f64>")]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Errors([Option<f64>; Metric::TABLE.len()]);

impl From<Costs> for BTreeMap<&'static str, f64> {
    fn from(costs: Costs) -> Self {
        Costs::NAMES.into_iter().zip(costs.values()).filter_map(|(name, v)| Some((name, v?))).collect()
    }
}

impl From<Errors> for BTreeMap<&'static str, f64> {
    fn from(errors: Errors) -> Self {
        Metric::all().into_iter().filter_map(|m| Some((m.key(), errors.get(m)?))).collect()
    }
}

impl Errors {
    /// Root of the mean square, 99th percentile and maximum of distances in voxels, which are sorted.
    pub(super) fn of_distances(distances: &mut [f64]) -> Self {
        let squares: f64 = distances.iter().map(|d| d * d).sum();
        distances.sort_by(f64::total_cmp);
        Self::default()
            .with(
                Metric::DepthRms,
                (!distances.is_empty()).then(|| (squares / distances.len() as f64).sqrt()),
            )
            .with(Metric::DepthP99, p99(distances))
            .with(Metric::DepthMax, distances.last().copied())
    }

    /// With one error more, if it is known.
    #[must_use]
    pub fn with(mut self, metric: Metric, value: impl Into<Option<f64>>) -> Self {
        self.0[metric as usize] = value.into();
        self
    }

    /// The errors of normals alone.
    pub(super) fn only_normals(&self) -> Self {
        let both = [Metric::NormalMean, Metric::NormalP99];
        both.into_iter().fold(Self::default(), |errors, metric| errors.with(metric, self.get(metric)))
    }

    /// One of them.
    pub fn get(&self, metric: Metric) -> Option<f64> {
        self.0[metric as usize]
    }
}

/// The 99th percentile of numbers in rising order.
pub(super) fn p99(sorted: &[f64]) -> Option<f64> {
    sorted.get(sorted.len() * 99 / 100).copied()
}

/// Adds rows to the experiment of the same name, or the whole experiment behind the others.
pub(super) fn join(all: &mut Vec<Experiment>, found: Experiment) {
    match all.iter_mut().find(|e| e.id == found.id) {
        Some(known) => {
            known.rows.extend(found.rows);
            known.pictures.extend(found.pictures);
        }
        None => all.push(found),
    }
}

/// Marks the rows that no other of the same subject beats in both cost and error.
pub(super) fn mark_fronts(all: &mut [Experiment]) {
    for experiment in all {
        let at = |row: &Row| {
            Some((row.costs.values()[experiment.drawn.cost]?, row.errors.get(experiment.drawn.metric)?))
        };
        let places: Vec<_> = experiment.rows.iter().map(|row| (row.subject.clone(), at(row))).collect();
        for (row, (subject, place)) in experiment.rows.iter_mut().zip(&places) {
            let Some((cost, error)) = *place else { continue };
            let beaten = places
                .iter()
                .filter(|(other, _)| other == subject)
                .filter_map(|(_, p)| *p)
                .any(|(c, e)| c <= cost && e <= error && (c < cost || e < error));
            row.on_front = !beaten;
        }
    }
}

/// A column of a table of numbers.
#[derive(Clone, Copy)]
pub(super) enum Column {
    /// One of [`Costs::NAMES`].
    Cost(usize),
    Error(Metric),
}

impl Column {
    pub(super) fn title(self) -> &'static str {
        match self {
            Self::Cost(cost) => Costs::TITLES[cost],
            Self::Error(metric) => metric.title(),
        }
    }

    pub(super) fn of(self, row: &Row) -> Option<f64> {
        match self {
            Self::Cost(cost) => row.costs.values()[cost],
            Self::Error(metric) => row.errors.get(metric),
        }
    }
}

impl Experiment {
    /// True if no choice has an error: a line of zeros shows less than the table.
    pub(super) fn is_exact(&self) -> bool {
        self.rows.iter().filter_map(|row| row.errors.get(self.drawn.metric)).all(|error| error == 0.0)
    }

    /// The columns of what at least one row has.
    pub(super) fn columns(&self) -> Vec<Column> {
        let costs = (0..Costs::NAMES.len()).map(Column::Cost);
        let all = costs.chain(Metric::all().map(Column::Error));
        all.filter(|column| self.rows.iter().any(|row| column.of(row).is_some())).collect()
    }
}

impl Row {
    /// The value of a column as it is shown; a spread that is too wide for its times is marked.
    pub(super) fn shown(&self, column: Column) -> String {
        let Some(value) = column.of(self) else { return String::new() };
        let uneven = matches!(column, Column::Cost(SPREAD)) && value > UNEVEN_PERCENT;
        format!("{}{}", short(value), if uneven { " (!)" } else { "" })
    }

    pub(super) fn csv(&self, experiment: &str) -> String {
        let quoted = |text: &str| format!("\"{}\"", text.replace('"', "\"\""));
        let number = |v: Option<f64>| v.map(|v| v.to_string()).unwrap_or_default();
        let mut fields = vec![
            experiment.to_owned(),
            quoted(&self.subject),
            quoted(&self.choice),
            self.usual.to_string(),
            self.on_front.to_string(),
        ];
        fields.extend(self.costs.values().map(number));
        fields.extend(self.errors.0.map(number));
        format!("{}\n", fields.join(","))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_front_holds_what_nothing_beats() {
        let row = |subject: &str, cost: f64, error: f64| Row {
            subject: subject.into(),
            choice: String::new(),
            usual: false,
            on_front: false,
            costs: Costs { build_s: Some(cost), ..Costs::default() },
            errors: Errors::default().with(Metric::DepthRms, error),
        };
        let rows = vec![row("a", 1.0, 3.0), row("a", 2.0, 3.0), row("a", 3.0, 1.0), row("b", 9.0, 9.0)];
        let drawn = Drawn { cost: 0, metric: Metric::DepthRms };
        let mut all = vec![Experiment { id: "x", drawn, rows, ..Experiment::default() }];
        mark_fronts(&mut all);
        let front: Vec<bool> = all[0].rows.iter().map(|r| r.on_front).collect();
        assert_eq!(front, [true, false, true, true]);
        let more = all[0].clone();
        join(&mut all, more);
        assert_eq!((all.len(), all[0].rows.len()), (1, 8));
        assert!(all[0].rows[0].csv("x").starts_with("x,\"a\",\"\",false,true,1,,,,,,,3,"));
    }
}
