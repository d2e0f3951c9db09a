//! All bodies together: the nearest one on a line, and the light that passes along it.

use crate::cpu::Form;
use crate::geom::dot;
use crate::render::Smoothing;
use crate::render::batch::Batch;
use crate::render::normals::shading_normal::Line;
use crate::render::ray::Ray;
use crate::render::traverse::Hit;

use super::body::{Body, BodyRay, Instance, RayKind, Side, Start, SurfaceHit};

/// Most surfaces of clear bodies that a line to a light passes.
const MAX_SURFACES: u32 = 64;

/// Start of a line: the number of a body, and the position on it.
pub(super) type From = Option<(usize, Start)>;

/// The start of a line on this body, if it starts there.
fn start_on(from: &From, body: usize) -> Option<&Start> {
    from.as_ref().filter(|(start, _)| *start == body).map(|(_, start)| start)
}

/// Lines from one point, and the buffers of a worker to trace them together.
#[derive(Default)]
pub(super) struct RayBatch {
    pub(super) lines: Vec<Line>,
    /// The way of each line, and t at the start of its ray; `None` for a line that misses the body.
    ways: Vec<Option<(BodyRay, f64)>>,
    rays: Vec<Ray>,
    hits: Vec<Option<Hit>>,
    batch: Batch,
}

/// The bodies of a scene.
#[derive(Debug)]
pub(super) struct World<'a> {
    pub(super) bodies: Vec<Body<'a>>,
}

impl<'a> World<'a> {
    /// A world with the displayed normals and the level of each part; missing levels are 0.
    pub(super) fn of(parts: &'a [Instance<'a>], smoothing: Smoothing, levels: &[u32]) -> Self {
        let levels = levels.iter().copied().chain(std::iter::repeat(0));
        let body = |(part, level)| Body::of(part, Form::best(), smoothing, level);
        Self { bodies: parts.iter().zip(levels).map(body).collect() }
    }

    /// The first intersection of a line with a body between two values of t, and the body's number: the lowest number
    /// at equal t.
    pub(super) fn nearest(&self, line: Line, limits: [f64; 2], from: &From) -> Option<(usize, SurfaceHit)> {
        let mut nearest: Option<(usize, SurfaceHit)> = None;
        for (number, body) in self.bodies.iter().enumerate() {
            let most = nearest.as_ref().map_or(limits[1], |(_, met)| met.t());
            if let Some(met) = body.meet(RayKind::PixelRays, line, [limits[0], most], start_on(from, number))
                && nearest.as_ref().is_none_or(|(_, other)| met.t() < other.t())
            {
                nearest = Some((number, met));
            }
        }
        nearest
    }

    /// True if a line is stopped by a body that is not clear.
    pub(super) fn is_stopped(&self, line: Line, limits: [f64; 2], from: &From) -> bool {
        let mut solids = self.bodies.iter().enumerate().filter(|(_, body)| !body.part.material.is_clear());
        solids.any(|(number, body)| body.meet(RayKind::Light, line, limits, start_on(from, number)).is_some())
    }

    /// Number of `lot.lines` that are stopped, by [`World::is_stopped`].
    pub(super) fn count_stopped(&self, lot: &mut RayBatch, limits: [f64; 2], from: &From) -> usize {
        let all = lot.lines.len();
        for (number, body) in self.bodies.iter().enumerate() {
            if body.part.material.is_clear() {
                continue;
            }
            let start = start_on(from, number);
            lot.ways.clear();
            lot.rays.clear();
            lot.lines.retain(|line| match body.set_out(*line, limits, start) {
                Ok((way, ray, before)) => {
                    lot.ways.push(Some((way, before)));
                    lot.rays.push(ray);
                    true
                }
                Err(Some(_)) => false,
                Err(None) => {
                    lot.ways.push(None);
                    true
                }
            });
            body.nearest(&mut lot.batch, &lot.rays, &mut lot.hits);
            let (mut ways, mut hits) = (lot.ways.iter(), lot.hits.iter());
            lot.lines.retain(|_| {
                let Some(Some((way, before))) = ways.next() else { return true };
                let hit = hits.next().copied().flatten();
                body.follow(*way, hit.map(|hit| Hit { t: before + hit.t, ..hit })).is_none()
            });
        }
        all - lot.lines.len()
    }

    /// Part of the light that passes along a line, by colour: zero behind a body that is not clear, and reduced by
    /// clear ones. Refraction is ignored.
    pub(super) fn light_through(&self, line: Line, limits: [f64; 2], from: &From) -> Option<[f64; 3]> {
        if self.is_stopped(line, limits, from) {
            return None;
        }
        let mut light = [1.0; 3];
        for (number, body) in self.bodies.iter().enumerate() {
            let material = &body.part.material;
            if !material.is_clear() {
                continue;
            }
            let mut start = start_on(from, number).copied();
            let mut least = limits[0];
            for _ in 0..MAX_SURFACES {
                let Some(met) = body.meet(RayKind::Light, line, [least, limits[1]], start.as_ref()) else {
                    break;
                };
                least = met.t();
                let enters = match met {
                    SurfaceHit::Surface(hit) => {
                        body.outward(line, hit).is_none_or(|outward| dot(outward, line.1) < 0.0)
                    }
                    SurfaceHit::Cut { .. } => true,
                };
                if enters {
                    let part = (1.0 - material.mirror) * material.clear;
                    light = std::array::from_fn(|c| light[c] * part * material.color[c]);
                }
                let side = if enters { Side::Inside } else { Side::Outside };
                start = Some(match met {
                    SurfaceHit::Surface(hit) => Start::Surface { hit, side },
                    SurfaceHit::Cut { plane, .. } => Start::Cut { plane },
                });
            }
        }
        Some(light)
    }
}
