//! The thickness at one place: by a ray along the normal, or by the largest ball that touches the surface there.
//!
//! The ray is exact to the cell ([`trace`]) and looks for where it *leaves* the solid. The ball shrinks from the ray's
//! length until no surface lies in it (Ma, Bae and Choi 2012, "3D medial axis point approximation using nearest
//! neighbors and the normal field"); at a surface point this is the local thickness of Hildebrand and Rüegsegger 1997.

use std::sync::{Mutex, PoisonError};

use crate::cpu::Form;
use crate::format::cell::CORNERS;
use crate::geom::{VoxelIndex, dot};
use crate::load::{CellItems, CellShape, ModelView, NodeView};
use crate::measure::nearest::{Query, Sample, Search, Surface};
use crate::measure::uncertainty::{SURE, Uncertainty};
use crate::render::ray::Ray;
use crate::render::single::trace;
use crate::render::surface::{Crossing, Passage, Surface as CellVolume};
use crate::render::traverse::Hit;

use super::Method;

/// Depth in voxels to which surface may reach into a ball: with .08 and noise of 2.5 % one cell in a thousand collapses
/// on its neighbours, with .25 wedges come out too thick.
const TOUCH: f64 = 0.15;

/// The same depth in standard deviations of the place by noise, where they are known and this is more.
const TOUCH_SIGMAS: f64 = 4.0;

/// Voxels within which, and least cosine of the normals with which, a place is a neighbour of the ball's own and does not
/// make it smaller: in noise neighbours reach into balls by more than the depth above.
const NEIGHBOUR: (f64, f64) = (1.5, 0.5);

/// Most steps of a ball; one to four are usual.
const MAX_STEPS: usize = 32;

/// Depth in voxels below a cell's plane from which a ray may leave the solid through a face behind which there is no cell:
/// planes of noisy cells do not meet at faces, and so far they are off.
const NEAR: f64 = 0.5;

/// Samples along a ray in a cell with corners, and halvings between two of them.
const SAMPLES: usize = 8;
const HALVINGS: usize = 40;

/// The thickness at a place.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(in crate::jobs) enum Thickness {
    /// None: the ray meets no other side.
    #[default]
    None,
    /// More than the requested maximum.
    Thicker,
    /// Thickness in mm.
    Of(f64),
}

/// Method, limit and surface of a measurement.
#[derive(Clone, Copy)]
pub(in crate::jobs) struct Gauge<'a> {
    pub(in crate::jobs) surface: Surface<'a>,
    pub(in crate::jobs) by: Method,
    pub(in crate::jobs) max_mm: f64,
    /// Noise of the model, if it was measured.
    pub(in crate::jobs) noise: Option<Uncertainty<'a>>,
}

impl<'a> Gauge<'a> {
    /// The thickness below the surface in a cell, at its place, and by rays half its 95 % interval in mm, where the model
    /// says how uncertain its places are.
    pub(in crate::jobs) fn measure(
        &self,
        search: &mut Search<'a>,
        cell: u64,
        place: &Sample,
    ) -> (Thickness, Option<f64>) {
        match (self.ray(place), self.by) {
            (None, _) => (Thickness::None, None),
            (Some(exit), Method::Ray) if exit.t > self.max_mm => (Thickness::Thicker, None),
            (Some(exit), Method::Ray) => (Thickness::Of(exit.t), self.u95_mm(cell, &exit)),
            (Some(exit), Method::Ball) => (self.ball(search, cell, place, exit.t), None),
        }
    }

    /// Half the 95 % interval of the distance from a cell to another one.
    fn u95_mm(&self, cell: u64, exit: &Hit) -> Option<f64> {
        let (noise, view) = (self.noise?, self.surface.view);
        let square = |cell| Some(noise.squares_mm2(view, VoxelIndex::new(cell))?.iter().sum::<f64>());
        Some(SURE * (square(cell)? + square(exit.voxel(view)?)?).sqrt())
    }

    /// Where the ray against the normal leaves the solid, at the time in mm; `None` if it has no exit, or leaves through a
    /// cap of the build at the border of the volume.
    fn ray(&self, place: &Sample) -> Option<Hit> {
        let (view, spacing) = (self.surface.view, self.surface.space.spacing);
        let origin = std::array::from_fn(|a| place.point[a] / spacing[a]);
        let direction = std::array::from_fn(|a| -place.normal[a] / spacing[a]);
        let ray = Ray::new(view.depth(), origin, direction, 0.0).ok().flatten()?;
        let leaving = Leaving { cells: view.cells()?, origin, direction, near: Mutex::new(None) };
        let hit = trace(Form::best(), view, &leaving, &ray, 0).hit.or_else(|| leaving.near(None))?;
        (!self.surface.touches_border(hit.cell)).then_some(hit)
    }

    /// Diameter of the largest ball that touches the place from within, at most `length`; none if a cap of the build at
    /// the border of the volume stops it.
    fn ball(&self, search: &mut Search<'a>, cell: u64, place: &Sample, length: f64) -> Thickness {
        let squares = |noise: Uncertainty<'_>| noise.squares_mm2(self.surface.view, VoxelIndex::new(cell));
        let sigma = self.noise.and_then(squares).map_or(0.0, |[noise, _]| noise.sqrt());
        let touch = (TOUCH * self.surface.space.finest).max(TOUCH_SIGMAS * sigma);
        let near = NEIGHBOUR.0 * self.surface.space.spacing.into_iter().fold(0.0, f64::max);
        let mut radius = length.min(self.max_mm) / 2.0;
        let (mut is_smaller, mut is_capped) = (length <= self.max_mm, false);
        for _ in 0..MAX_STEPS {
            let middle = std::array::from_fn(|a| place.point[a] - radius * place.normal[a]);
            if radius <= touch {
                break;
            }
            let within = Query::within(radius - touch);
            let way_from = |point: [f64; 3]| std::array::from_fn(|a| place.point[a] - point[a]);
            let Some(mut found) = search.nearest(middle, &within) else { break };
            let mut way: [f64; 3] = way_from(found.point);
            if dot(way, way) < near * near && dot(found.normal, place.normal) > NEIGHBOUR.1 {
                let facing = Some((place.normal.map(|c| -c), -NEIGHBOUR.1));
                let Some(other) = search.nearest(middle, &Query { facing, ..within }) else { break };
                (found, way) = (other, way_from(other.point));
            }
            let next = dot(way, way) / (2.0 * dot(way, place.normal));
            // A point of the place's own facet is ignored.
            if !(next > 0.0 && next < radius) {
                break;
            }
            (radius, is_smaller, is_capped) = (next, true, self.surface.is_border(found.point));
        }
        match is_smaller {
            _ if is_capped => Thickness::None,
            true => Thickness::Of(2.0 * radius),
            false => Thickness::Thicker,
        }
    }
}

/// The surface of cells for a ray that starts inside: the hit is where the ray leaves the solid.
///
/// A ray may leave a cell just below its plane through a face behind which all is outside, without a cell. That counts
/// as an exit if the ray ends there, or next enters the solid again.
struct Leaving<'a> {
    cells: CellItems<'a>,
    /// The ray in cells; its parameter is mm.
    origin: [f64; 3],
    direction: [f64; 3],
    /// Such an exit, of the last cell on the way.
    near: Mutex<Option<Hit>>,
}

impl Leaving<'_> {
    /// Replaces the exit just below a plane; returns the one before.
    fn near(&self, next: Option<Hit>) -> Option<Hit> {
        std::mem::replace(&mut *self.near.lock().unwrap_or_else(PoisonError::into_inner), next)
    }

    /// Place in a cell's own coordinates, -1 to 1.
    fn within(&self, cell: [u32; 3], t: f64) -> [f64; 3] {
        std::array::from_fn(|a| 2.0 * (self.origin[a] + t * self.direction[a] - f64::from(cell[a])) - 1.0)
    }
}

impl CellVolume for Leaving<'_> {
    const SOLID: bool = false;

    fn meet(&self, view: &ModelView<'_>, ray: &Ray, passage: &Passage) -> Option<Hit> {
        let time = |crossing: Crossing| ray.t_after(crossing.distance, crossing.component);
        let (enter, leave) = (passage.enter.map_or(0.0, time), time(passage.leave));
        let t = match self.cells.shape(passage.box_number.checked_sub(view.node_count())?) {
            CellShape::Plane(plane) => {
                let normal = plane.normal.map(f64::from);
                let slope = 2.0 * dot(normal, self.direction);
                let front = |t| dot(normal, self.within(passage.cell, t)) - f64::from(plane.offset);
                let before = front(enter);
                if slope <= 0.0 {
                    let left = self.near(None);
                    return left.filter(|_| before > 0.0 && passage.enter.is_some());
                }
                let t = enter + (-before).max(0.0) / slope;
                if t > leave {
                    let is_near = -front(leave) <= NEAR * 2.0 * dot(normal, normal).sqrt();
                    self.near(is_near.then(|| Hit { t: leave, ..passage.entry_hit(ray) }));
                    return None;
                }
                t
            }
            CellShape::Corners(corners) => {
                let value = |t: f64| interpolated(&corners, self.within(passage.cell, t));
                let at = |sample: usize| enter + (leave - enter) * sample as f64 / SAMPLES as f64;
                let inside = |sample: &usize| value(at(*sample)) >= 0.0;
                match (0..SAMPLES).find(|sample| inside(sample) && !inside(&(sample + 1))) {
                    Some(sample) => last_inside(value, at(sample), at(sample + 1)),
                    // All in front, and increasing: the surface was in an earlier cell.
                    None if passage.enter.is_some() && !inside(&0) && !inside(&SAMPLES) => {
                        (value(leave) < value(enter) && !(1..SAMPLES).any(|s| inside(&s))).then_some(enter)?
                    }
                    None if inside(&SAMPLES) => return self.near(None).filter(|_| !inside(&0)),
                    None => return None,
                }
            }
        };
        Some(Hit { t, ..passage.entry_hit(ray) })
    }
}

/// The place between an inner and an outer one where the sign changes.
fn last_inside(value: impl Fn(f64) -> f64, mut inner: f64, mut outer: f64) -> f64 {
    for _ in 0..HALVINGS {
        let middle = 0.5 * (inner + outer);
        if value(middle) >= 0.0 { inner = middle } else { outer = middle }
    }
    inner
}

/// The trilinear interpolation of corners, at a place in the cell's own coordinates.
#[inline]
fn interpolated(corners: &[i8; CORNERS], u: [f64; 3]) -> f64 {
    (0..CORNERS).zip(corners).fold(0.0, |sum, (corner, value)| {
        let weight = |a: usize| if corner >> a & 1 == 1 { 1.0 + u[a] } else { 1.0 - u[a] };
        sum + weight(0) * weight(1) * weight(2) * f64::from(*value)
    })
}
