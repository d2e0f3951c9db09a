//! The rays of pictures from three sides, and how far their hits are from a reference.

use std::convert::Infallible;

use rayon::prelude::*;

use super::rows::{Errors, Metric, Times, p99};
use crate::cpu::Form;
use crate::error::Error;
use crate::format::normal;
use crate::geom::{BoxIndex, Dims, VoxelIndex, cross, dot};
use crate::load::{Model, NodeView};
use crate::render::cells::Cells;
use crate::render::picture::pool;
use crate::render::surface::Skin;
use crate::render::{Camera, GridSpace, Projection, RayCaster, ViewPoint, single};
use crate::synthetic::AnalyticVolume;

/// Directions from which a subject is looked at: none along an axis or a diagonal.
const SIDES: [[f64; 3]; 3] = [[0.31, -1.0, 0.22], [1.0, 0.37, -0.29], [-0.41, 0.33, 1.0]];
/// Angle of the pictures, in degrees.
pub(super) const FOV_DEG: f64 = 40.0;
/// A hit that is farther off than so many boxes lies on another sheet of the surface.
const SHEET: f64 = 4.0;
/// Distance of the eye in half extents: a cube's corners are just within the picture then.
const AWAY: f64 = 4.8;

/// A line of sight in the world: where it begins, and its direction.
pub(super) type Line = ([f64; 3], [f64; 3]);

/// A hit of a ray.
#[derive(Clone, Copy, Debug)]
pub(super) struct Met {
    /// Distance along the line, in lengths of its direction.
    pub(super) t: f64,
    pub(super) point: [f64; 3],
    pub(super) normal: Option<[f64; 3]>,
    /// The voxel or cell, or the first of a box of several.
    pub(super) voxel: [u32; 3],
    /// True in the outermost voxels, where the volume ends and the body may not.
    pub(super) at_border: bool,
}

/// True if a box of cells touches a face of the volume.
fn at_border(cell: [u32; 3], edge: u32, dims: Dims) -> bool {
    cell.iter().zip(dims.to_array()).any(|(c, n)| *c == 0 || c + edge >= n)
}

/// Where the three pictures are taken from.
pub(super) fn points(space: &GridSpace, model: &Model<impl AsRef<[u8]>>) -> [ViewPoint; 3] {
    let view = model.view();
    let (affine, dims) = (model.affine(), model.dims());
    let middle = affine.apply(dims.to_array().map(|n| 0.5 * f64::from(n - 1)));
    SIDES.map(|side| {
        let length = dot(side, side).sqrt();
        // As far away as the model's extent across the sight asks for.
        let reach = (0..3)
            .flat_map(|a| [(a, 1.0), (a, -1.0)])
            .map(|(a, sign)| {
                let mut direction = [0.0; 3];
                direction[a] = sign;
                space.support(&view, direction) - sign * middle[a]
            })
            .fold(0.0, f64::max);
        let away = AWAY * reach / length;
        let eye = std::array::from_fn(|a| middle[a] + away * side[a]);
        ViewPoint::Free { eye, look_at: middle, up: None }
    })
}

/// Lines of sight through every pixel of the three pictures.
pub(super) fn lines(
    space: &GridSpace,
    model: &Model<impl AsRef<[u8]>>,
    pixels: u32,
) -> Result<Vec<Line>, Error> {
    let at = |i: u32| (f64::from(i) + 0.5) / f64::from(pixels) * 2.0 - 1.0;
    let mut all = Vec::new();
    for point in points(space, model) {
        let camera = Camera::new(point, Projection::Perspective, FOV_DEG, 1.0, |_| 0.0)?;
        let places = (0..pixels).flat_map(|y| (0..pixels).map(move |x| (x, y)));
        all.extend(places.map(|(x, y)| camera.ray(at(x), -at(y))));
    }
    Ok(all)
}

/// The first surface on every line, as single rays see it.
pub(super) fn cast(
    model: &Model<impl AsRef<[u8]> + Sync>,
    lines: &[Line],
    threads: usize,
) -> Result<Vec<Option<Met>>, Error> {
    let (caster, dims) = (RayCaster::new(model)?, model.dims());
    let one = |(origin, direction): &Line| {
        let hit = caster.first_hit(*origin, *direction).ok().flatten()?;
        let at_border = at_border(hit.voxel, 1, dims);
        Some(Met { t: hit.t, point: hit.position_mm, normal: hit.normal, voxel: hit.voxel, at_border })
    };
    Ok(pool(threads)?.install(|| lines.par_iter().map(one).collect()))
}

/// The first box of an edge of 2^k voxels or less on every line, and the nanoseconds of a ray on one thread.
pub(super) fn cast_boxes(
    space: &GridSpace,
    model: &Model<impl AsRef<[u8]>>,
    lines: &[Line],
    k: u32,
) -> (Vec<Option<Met>>, Times) {
    let view = model.view();
    let cells = view.cells().map(Cells::new);
    let rays: Vec<_> = lines.iter().map(|(o, d)| space.ray(*o, *d).ok().flatten()).collect();
    let Ok((seconds, hits)) = Times::measured(|| {
        let hit = |ray: &Option<_>| {
            let ray = ray.as_ref()?;
            match &cells {
                Some(cells) => single::trace(Form::best(), &view, cells, ray, k).hit,
                None => single::trace(Form::best(), &view, &Skin, ray, k).hit,
            }
        };
        Ok::<_, Infallible>(rays.iter().map(hit).collect::<Vec<_>>())
    });
    let met = lines.iter().zip(hits).map(|((o, d), hit)| {
        let hit = hit?;
        let number = BoxIndex::new(hit.box_number);
        let code = match hit.voxel(&view) {
            Some(voxel) => view.voxel_normal(VoxelIndex::new(voxel)),
            None => view.node_normal(number.node()),
        };
        let point = std::array::from_fn(|a| o[a] + hit.t * d[a]);
        let normal = code.map(|code| space.normal_to_world(normal::decode(code).map(f64::from)));
        let at_border = at_border(hit.cell, 1 << hit.edge_log2, model.dims());
        Some(Met { t: hit.t, point, normal, voxel: hit.cell, at_border })
    });
    let per_ray = 1e9 / lines.len().max(1) as f64;
    (met.collect(), seconds.scaled(per_ray))
}

/// Errors of hits against the true surface of a body.
pub(super) fn against_body(
    met: &[Option<Met>],
    lines: &[Line],
    body: &AnalyticVolume,
    threads: usize,
) -> Result<Errors, Error> {
    let closed = body.body().is_closed();
    let one = |(met, (origin, direction)): (&Option<Met>, &Line)| {
        let seen = closed.then(|| {
            let (from, length) = (body.place_of(*origin), dot(*direction, *direction).sqrt());
            let farthest = 10.0 * dot(from, from).sqrt() + 1e4;
            body.body().cast(from, direction.map(|d| d / length), farthest).is_some()
        });
        // Where a body goes on beyond the volume, the volume's faces are not its surface.
        let off = met.filter(|met| closed || !met.at_border).map(|met| {
            let truth = body.surface_at(met.point);
            (truth.distance.abs(), met.normal.map(|n| angle_deg(n, truth.normal)))
        });
        (off, seen)
    };
    let all: Vec<_> = pool(threads)?.install(|| met.par_iter().zip(lines).map(one).collect());
    let mut found = Found::default();
    for (off, seen) in all {
        if let Some((distance, angle)) = off {
            found.distances.push(distance);
            found.angles.extend(angle);
        }
        if let Some(seen) = seen {
            found.reference += u64::from(seen);
            found.wrong += u64::from(seen != off.is_some());
        }
    }
    Ok(found.errors())
}

/// Errors of hits against those of the full-quality frame; `voxel_mm` is the finest spacing, `edge` that of the boxes
/// hit in voxels.
pub(super) fn against_frame(
    met: &[Option<Met>],
    frame: &[Option<Met>],
    lines: &[Line],
    (voxel_mm, edge): (f64, u32),
) -> Errors {
    let mut found = Found::default();
    for ((met, frame), (_, direction)) in met.iter().zip(frame).zip(lines) {
        found.reference += u64::from(frame.is_some());
        found.wrong += u64::from(met.is_some() != frame.is_some());
        if let (Some(met), Some(frame)) = (met, frame) {
            let off = (met.t - frame.t).abs() * dot(*direction, *direction).sqrt() / voxel_mm;
            if off > SHEET * f64::from(edge) {
                found.other_sheet += 1;
                continue;
            }
            found.distances.push(off);
            found.angles.extend(met.normal.zip(frame.normal).map(|(a, b)| angle_deg(a, b)));
        }
    }
    found.errors()
}

/// Errors collected over rays, in their order.
#[derive(Default)]
struct Found {
    distances: Vec<f64>,
    angles: Vec<f64>,
    /// Pixels of the reference, and pixels that differ from it.
    reference: u64,
    wrong: u64,
    /// Pixels whose distances are left out.
    other_sheet: u64,
}

impl Found {
    fn errors(mut self) -> Errors {
        let percent = |pixels: u64| 100.0 * pixels as f64 / self.reference as f64;
        let mean = self.angles.iter().sum::<f64>() / self.angles.len() as f64;
        self.angles.sort_by(f64::total_cmp);
        Errors::of_distances(&mut self.distances)
            .with(Metric::WrongPixels, (self.reference > 0).then(|| percent(self.wrong)))
            .with(Metric::OtherSheet, (self.other_sheet > 0).then(|| percent(self.other_sheet)))
            .with(Metric::NormalMean, (!self.angles.is_empty()).then_some(mean))
            .with(Metric::NormalP99, p99(&self.angles))
    }
}

/// Angle between two vectors in degrees, by the polynomial of the arc tangent that rounds alike everywhere: errors are
/// compared between machines. Error below 1e-6 degree.
fn angle_deg(a: [f64; 3], b: [f64; 3]) -> f64 {
    let across = cross(a, b);
    let (sine, cosine) = (dot(across, across).sqrt(), dot(a, b));
    let (small, large) = if sine < cosine.abs() { (sine, cosine.abs()) } else { (cosine.abs(), sine) };
    if large == 0.0 {
        return 0.0;
    }
    // Halved twice by tan(x/2) = tan x / (1 + sqrt(1 + tan^2 x)); then the series.
    let half = |t: f64| t / (1.0 + (1.0 + t * t).sqrt());
    let t = half(half(small / large));
    let square = t * t;
    let series = (0..10_u32).rev().fold(0.0, |sum, k| {
        let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
        sign / f64::from(2 * k + 1) + square * sum
    });
    let eighth = 4.0 * t * series;
    let quarter = std::f64::consts::FRAC_PI_2;
    let first = if sine < cosine.abs() { eighth } else { quarter - eighth };
    (if cosine < 0.0 { 2.0 * quarter - first } else { first }) * (180.0 / std::f64::consts::PI)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_are_those_of_the_platform() {
        for i in 0..=3600 {
            let x = f64::from(i) * std::f64::consts::PI / 3600.0;
            let got = angle_deg([2.0, 0.0, 0.0], [3.0 * x.cos(), 0.0, 3.0 * x.sin()]);
            assert!((got - x.to_degrees()).abs() < 1e-6, "{i}: {got}");
        }
        assert_eq!(angle_deg([0.0; 3], [1.0, 0.0, 0.0]), 0.0);
    }
}
