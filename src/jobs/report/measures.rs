//! How far deviations, thicknesses and pores are from the truth of a body, and what they cost.

use std::convert::Infallible;
use std::fs;
use std::path::Path;

use super::experiments::Bench;
use super::rows::{Costs, Drawn, Errors, Experiment, Metric, Row, Times};
use crate::builder::{BuildOptions, build_volume};
use crate::error::Error;
use crate::format::SurfaceKind;
use crate::geom::{add_scaled, dot};
use crate::jobs::nearest::nearest_points;
use crate::jobs::pores::{PoresReport, PoresRequest, pores};
use crate::jobs::thickness::{Gauge, Method, Thickness};
use crate::load::Model;
use crate::measure::nearest::{Sample, Surface};
use crate::progress::Silent;
use crate::synthetic::{AnalyticVolume, TrueSurface};
use crate::volume::VolumeSource;

/// Places of the volume, of which those that are no farther from the surface than so many voxels are asked for their
/// distance.
const PLACES: u32 = 1 << 16;
const REACH: f64 = 8.0;
/// Distance in voxels from which on a wrong side counts.
const SURE: f64 = 0.6;

/// About so many cells are measured by rays, and by balls, which meet all of the surface that is as far.
const CELLS: [(Method, u64); 2] = [(Method::Ray, 4096), (Method::Ball, 64)];

/// Most pores, as many as `oct pores` lists, and their radii in voxels.
const PORES: usize = 20;
const RADII: [f64; 4] = [6.0, 4.5, 3.0, 1.5];
/// Least solid around a pore, in voxels.
const SOLID: f64 = 3.0;
/// Least radius of a pore whose volume counts.
const MEASURED: f64 = 3.0;

/// Steps of a march, and of a ball that shrinks.
const MAX_STEPS: usize = 1000;
/// A march has arrived, and a ball touches, within so many voxels.
const ARRIVED: f64 = 1e-9;

impl Bench<'_> {
    /// The measurements on a closed body, each against the body itself.
    pub(super) fn measures(
        &self,
        subject: &str,
        options: &BuildOptions,
        body: &AnalyticVolume,
    ) -> Result<Experiment, Error> {
        let options = BuildOptions { surface: Some(SurfaceKind::Cells), ..options.clone() };
        let model = self.build(body, &options)?.model;
        let row = |choice: String, (times, per_run, errors): Measured| {
            let costs = Costs {
                ns_per_point: Some(1e9 * times.median() / per_run.max(1.0)),
                spread_percent: Some(times.spread_percent()),
                ..Costs::default()
            };
            Self::row(subject, choice, false, costs, errors)
        };
        let mut rows: Vec<Row> = vec![row("deviation".into(), deviation(&model, body)?)];
        for (by, cells) in CELLS {
            rows.push(row(format!("thickness by {}", by.name()), thickness(&model, body, by, cells)?));
        }
        let balls = balls(body);
        if !balls.is_empty() {
            let path = self.folder.join("pores.oct");
            let source = body.clone().with_pores(balls.clone());
            build_volume(&source, &options, &path, &Silent)?;
            rows.push(row(format!("pores ({})", balls.len()), porosity(&path, body, &balls)?));
            let _ = fs::remove_file(&path);
        }
        Ok(Experiment {
            id: "measures",
            title: "Deviation, thickness, pores: error against truth and time",
            about: format!(
                "Deviation: signed distances of places up to {REACH} voxels from the surface, against the body's own; wrong sides are counted from {SURE} voxel on. Thickness: of cells all over the surface, by a ray and by the largest ball, against the way through the body along its own normal, and the body's own largest ball. Pores: balls of air of {} to {} voxels' radius in the body; the volume is that of those from {MEASURED} voxels on. One thread; the time is that of a place, a cell or a voxel of the volume. A thickness errs by its normal, too: noise and thick slices turn it, and across a sharp edge it is between those of two faces, where the body has one of them. A tilted normal moves the middle of a ball by as much as the ball is large: where the body itself is nearly a ball, such as a sphere, the surface then reaches into it all around, and it comes out smaller by whole voxels. A mask and thick slices move the surface itself.",
                RADII[3], RADII[0]
            )
            .into(),
            drawn: Drawn { cost: 6, metric: Metric::DepthRms },
            rows,
            ..Experiment::default()
        })
    }
}

/// Seconds of a run, what it measured so many of, and the errors.
type Measured = (Times, f64, Errors);

/// A number of places that fill the volume evenly, in LPS mm: powers of the reciprocal of the root of x^4 = x + 1 as
/// steps (Roberts 2018, *The unreasonable effectiveness of quasirandom sequences*).
fn places(body: &AnalyticVolume, count: u32) -> impl Iterator<Item = [f64; 3]> {
    let (affine, dims) = (body.info().affine, body.dims().to_array());
    (0..count).map(move |i| {
        let steps = [0.819_172_513_396_164_4, 0.671_043_606_703_789_2, 0.549_700_477_901_97];
        let at = |a: usize| (0.5 + f64::from(i) * steps[a]).fract() * f64::from(dims[a]) - 0.5;
        affine.apply(std::array::from_fn(at))
    })
}

fn finest_mm(model: &Model) -> f64 {
    model.affine().spacing_mm().into_iter().fold(f64::INFINITY, f64::min)
}

fn percent(part: usize, all: usize) -> f64 {
    100.0 * part as f64 / all.max(1) as f64
}

fn deviation(model: &Model, body: &AnalyticVolume) -> Result<Measured, Error> {
    let near = |at: &[f64; 3]| body.surface_at(*at).distance.abs() <= REACH;
    let points: Vec<[f64; 3]> = places(body, PLACES).filter(near).collect();
    let (times, found) = Times::measured(|| nearest_points(model, &points, 1, &Silent))?;
    let (mut off, mut sure, mut wrong) = (Vec::new(), 0, 0);
    for (at, mm) in points.iter().zip(found.distance_mm) {
        let (truth, distance) = (body.surface_at(*at).distance, mm / finest_mm(model));
        off.push((distance - truth).abs());
        if truth.abs() > SURE {
            sure += 1;
            wrong += usize::from(distance * truth <= 0.0);
        }
    }
    let errors = Errors::of_distances(&mut off).with(Metric::WrongSides, percent(wrong, sure));
    Ok((times, points.len() as f64, errors))
}

fn thickness(model: &Model, body: &AnalyticVolume, by: Method, cells: u64) -> Result<Measured, Error> {
    let view = model.view();
    let surface = Surface::open(&view, &model.affine(), model.dims())?;
    let gauge = Gauge { surface, by, max_mm: f64::INFINITY, noise: None };
    let stride = model.header().voxels.div_ceil(cells).max(1);
    let chosen: Vec<(u64, Sample)> = model
        .voxels()
        .places()
        .filter(|(number, _)| number % stride == 0)
        .map(|(number, cell)| (number, surface.sample(surface.cell_place(number, cell))))
        .filter(|(_, sample)| sample.area > 0.0)
        .collect();
    let Ok((times, found)) = Times::measured(|| {
        let mut search = surface.search();
        let measured = chosen.iter().map(|(number, sample)| gauge.measure(&mut search, *number, sample).0);
        Ok::<_, Infallible>(measured.collect::<Vec<_>>())
    });
    let mut off = Vec::new();
    for (found, (_, sample)) in found.into_iter().zip(&chosen) {
        if let Thickness::Of(mm) = found {
            let truth = true_thickness(body, surface.space.to_world(sample.point), by);
            off.push((mm / surface.space.finest - truth).abs());
        }
    }
    let missed = percent(chosen.len() - off.len(), chosen.len());
    let errors = Errors::of_distances(&mut off).with(Metric::Missed, missed);
    Ok((times, chosen.len() as f64, errors))
}

/// The thickness of a body, in voxels, below the place of its surface that is nearest to one of the world.
fn true_thickness(volume: &AnalyticVolume, at_mm: [f64; 3], by: Method) -> f64 {
    let (body, place) = (volume.body(), volume.place_of(at_mm));
    let TrueSurface { distance, normal } = body.surface(place);
    let foot = add_scaled(place, -distance, normal);
    let mut length = 1e-3;
    for _ in 0..MAX_STEPS {
        let depth = -body.surface(add_scaled(foot, -length, normal)).distance;
        length += depth;
        if depth < ARRIVED {
            break;
        }
    }
    if by == Method::Ray {
        return length;
    }
    let mut radius = length / 2.0;
    for _ in 0..MAX_STEPS {
        let middle = add_scaled(foot, -radius, normal);
        let near = body.surface(middle);
        if near.distance.abs() >= radius - ARRIVED {
            break;
        }
        let way = add_scaled(foot, -1.0, add_scaled(middle, -near.distance, near.normal));
        radius = dot(way, way) / (2.0 * dot(way, normal));
    }
    2.0 * radius
}

/// Balls deep enough in a body and far enough from each other: middles in its own units, and radii.
fn balls(body: &AnalyticVolume) -> Vec<([f64; 3], f64)> {
    let mut balls: Vec<([f64; 3], f64)> = Vec::new();
    for at in places(body, PLACES / 16) {
        let (place, radius) = (body.place_of(at), RADII[balls.len() % RADII.len()]);
        let apart = |(other, r): &([f64; 3], f64)| length_between(place, *other) >= r + radius + SOLID;
        if balls.len() < PORES
            && body.body().surface(place).distance <= -radius - SOLID
            && balls.iter().all(apart)
        {
            balls.push((place, radius));
        }
    }
    balls
}

fn length_between(one: [f64; 3], other: [f64; 3]) -> f64 {
    let way = add_scaled(one, -1.0, other);
    dot(way, way).sqrt()
}

fn porosity(path: &Path, body: &AnalyticVolume, balls: &[([f64; 3], f64)]) -> Result<Measured, Error> {
    let request = PoresRequest { bodies: false, least: 1, gap: false };
    let (times, found): (Times, PoresReport) = Times::measured(|| pores(path, request, None, &Silent))?;
    let unit_mm = body.info().spacing_mm.into_iter().fold(f64::INFINITY, f64::min);
    let (mut off, mut missed) = (Vec::new(), 0);
    for (middle, radius) in balls {
        let own = |at_mm: [f64; 3]| length_between(body.place_of(at_mm), *middle) < *radius;
        let Some(pore) = found.largest.iter().find(|pore| own(pore.at_mm)) else {
            missed += 1;
            continue;
        };
        if *radius >= MEASURED {
            let truth = 4.0 / 3.0 * std::f64::consts::PI * radius.powi(3);
            off.push(100.0 * (pore.volume_mm3 / unit_mm.powi(3) / truth - 1.0).abs());
        }
    }
    let mean = (!off.is_empty()).then(|| off.iter().sum::<f64>() / off.len() as f64);
    let errors =
        Errors::default().with(Metric::Missed, percent(missed, balls.len())).with(Metric::Volume, mean);
    Ok((times, body.dims().voxels() as f64, errors))
}
