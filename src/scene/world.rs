//! All bodies together: the nearest that a line meets, and how much light comes through.

use crate::cpu::Form;
use crate::geom::dot;
use crate::render::Smoothing;
use crate::render::batch::Batch;
use crate::render::normals::shown::Line;
use crate::render::ray::Ray;
use crate::render::traverse::Hit;

use super::body::{Body, Met, Part, Purpose, Side, Start, Way};

/// Surfaces of clear bodies that a line to a light passes at most.
const MAX_SURFACES: u32 = 64;

/// Where a line starts: the number of a body, and where on it.
pub(super) type From = Option<(usize, Start)>;

/// Where on this body a line starts, if it does.
fn start_on(from: &From, body: usize) -> Option<&Start> {
    from.as_ref().filter(|(start, _)| *start == body).map(|(_, start)| start)
}

/// Lines from one place, and what a worker keeps to trace them together.
#[derive(Default)]
pub(super) struct Lot {
    pub(super) lines: Vec<Line>,
    /// For each line its way, and t where its ray begins; nothing for a line that passes the body by.
    ways: Vec<Option<(Way, f64)>>,
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
    /// With the normals and the level of each part that are shown; levels that are missing are 0.
    pub(super) fn of(parts: &'a [Part<'a>], smoothing: Smoothing, levels: &[u32]) -> Self {
        let levels = levels.iter().copied().chain(std::iter::repeat(0));
        let body = |(part, level)| Body::of(part, Form::best(), smoothing, level);
        Self { bodies: parts.iter().zip(levels).map(body).collect() }
    }

    /// The first place where a line meets a body between two values of t, and the body's number: the first of those
    /// that are met at the same t.
    pub(super) fn nearest(&self, line: Line, limits: [f64; 2], from: &From) -> Option<(usize, Met)> {
        let mut nearest: Option<(usize, Met)> = None;
        for (number, body) in self.bodies.iter().enumerate() {
            let most = nearest.as_ref().map_or(limits[1], |(_, met)| met.t());
            if let Some(met) = body.meet(Purpose::Sight, line, [limits[0], most], start_on(from, number))
                && nearest.as_ref().is_none_or(|(_, other)| met.t() < other.t())
            {
                nearest = Some((number, met));
            }
        }
        nearest
    }

    /// True if a line is stopped by a body that is not clear.
    pub(super) fn is_stopped(&self, line: Line, limits: [f64; 2], from: &From) -> bool {
        let mut solids = self.bodies.iter().enumerate().filter(|(_, body)| !body.part.material().is_clear());
        solids.any(|(number, body)| body.meet(Purpose::Light, line, limits, start_on(from, number)).is_some())
    }

    /// How many of `lot.lines` are stopped, as [`World::is_stopped`] says of each.
    pub(super) fn count_stopped(&self, lot: &mut Lot, limits: [f64; 2], from: &From) -> usize {
        let all = lot.lines.len();
        for (number, body) in self.bodies.iter().enumerate() {
            if body.part.material().is_clear() {
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

    /// Part of the light that comes along a line, by colour: none past a body that is not clear, and of what is clear as
    /// much as it lets through. It is not bent.
    pub(super) fn light_through(&self, line: Line, limits: [f64; 2], from: &From) -> Option<[f64; 3]> {
        if self.is_stopped(line, limits, from) {
            return None;
        }
        let mut light = [1.0; 3];
        for (number, body) in self.bodies.iter().enumerate() {
            let material = body.part.material();
            if !material.is_clear() {
                continue;
            }
            let mut start = start_on(from, number).copied();
            let mut least = limits[0];
            for _ in 0..MAX_SURFACES {
                let Some(met) = body.meet(Purpose::Light, line, [least, limits[1]], start.as_ref()) else {
                    break;
                };
                least = met.t();
                let enters = match met {
                    Met::Surface(hit) => {
                        body.outward(line, hit).is_none_or(|outward| dot(outward, line.1) < 0.0)
                    }
                    Met::Cut { .. } => true,
                };
                if enters {
                    let part = (1.0 - material.mirror) * material.clear;
                    light = std::array::from_fn(|c| light[c] * part * material.color[c]);
                }
                let side = if enters { Side::Inside } else { Side::Outside };
                start = Some(match met {
                    Met::Surface(hit) => Start::Surface { hit, side },
                    Met::Cut { plane, .. } => Start::Cut { plane },
                });
            }
        }
        Some(light)
    }
}
