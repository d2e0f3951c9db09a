//! The colour at the end of a line: light, shadow, mirrors, glass.
//!
//! At a clear body a line splits in two; so lines wait in a list, each with its share of the point's light, and are
//! dropped once that share is too small to be seen, or after too many reflections and refractions.

use crate::geom::{add_scaled, dot};
use crate::render::ambient::{Sky, tangents};
use crate::render::normals::neighborhood::Neighborhood;
use crate::render::normals::shading_normal::Line;
use crate::render::shade::{Rig, Shader};
use crate::render::traverse::Hit;

use super::body::{Side, Start, SurfaceHit};
use super::light::{Light, LightSample};
use super::material::{Material, fresnel, power};
use super::media::Media;
use super::paint::{Counts, PictureSettings};
use super::world::{From, RayBatch, World};

/// Least share of a point's light for which a line is followed.
const MIN_SHARE: f64 = 1.0 / 1024.0;

/// Cosine between a normal and the line of sight up to which the surface counts as seen from its outside, near its rim:
/// there normals point away from the eye through their own errors, and through the curvature within a voxel. Beyond it
/// the surface is seen from within.
pub(super) const BEYOND_RIM: f64 = 0.35;

/// A line to be followed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Branch {
    pub(super) line: Line,
    pub(super) from: From,
    media: Media,
    /// Its share of the point's light.
    share: [f64; 3],
    bounces: u32,
    /// True if it has come straight from the eye.
    straight: bool,
}

impl Branch {
    /// A line from the eye.
    pub(super) fn first(line: Line) -> Self {
        Self { line, from: None, media: Media::default(), share: [1.0; 3], bounces: 0, straight: true }
    }
}

/// State of a worker, from one point to the next.
pub(super) struct WorkerMemory {
    /// Surroundings by file.
    pub(super) around: Vec<Neighborhood>,
    waiting: Vec<Branch>,
    lot: RayBatch,
    /// Counts of rays that did not come from the eye.
    pub(super) counts: Counts,
}

impl WorkerMemory {
    pub(super) fn new(files: usize) -> Self {
        let around = (0..files).map(|_| Neighborhood::new()).collect();
        Self { around, waiting: Vec::new(), lot: RayBatch::default(), counts: Counts::default() }
    }
}

/// Bodies with their light.
pub(super) struct LightingContext<'a> {
    pub(super) world: World<'a>,
    pub(super) look: &'a PictureSettings,
    /// The rig of lamps and sky; `None` for a scene's own lights.
    pub(super) rig: Option<Rig>,
    /// The lamps that shine on surfaces: the scene's, or the rig's for its highlights.
    pub(super) lamps: Vec<Light>,
    pub(super) shader: Shader,
    /// Directions of ambient-occlusion rays of a point seen in a mirror or through glass, if there are any.
    pub(super) sky: Option<Sky>,
}

/// A point of a surface.
pub(super) struct ShadingPoint<'a> {
    number: usize,
    material: &'a Material,
    pub(super) color: [f64; 3],
    /// The visible label, for a model with labels that are not solid; else 0.
    pub(super) label: u16,
    point: [f64; 3],
    /// Unit vector along the incoming line.
    sight: [f64; 3],
    /// Unit normal as displayed, on either side.
    pub(super) shown: [f64; 3],
    /// Unit vector out of the surface on the visible side.
    normal: [f64; 3],
    /// True if the line came from outside the body.
    enters: bool,
    /// Part of the light that stops here.
    opacity: f64,
    met: SurfaceHit,
}

impl ShadingPoint<'_> {
    /// A start of lines on the visible side, or on the other one.
    fn start(&self, beyond: bool) -> From {
        let start = match self.met {
            SurfaceHit::Surface(hit) => {
                let side = if self.enters == beyond { Side::Inside } else { Side::Outside };
                Start::Surface { hit, side }
            }
            SurfaceHit::Cut { plane, .. } => Start::Cut { plane },
        };
        Some((self.number, start))
    }
}

impl LightingContext<'_> {
    /// Linear RGB of a line from the eye that has met `first`, without the background straight ahead; and the opacity
    /// of that. `open` is the openness at the first point.
    pub(super) fn color(
        &self,
        kept: &mut WorkerMemory,
        first: Branch,
        met: Option<(usize, SurfaceHit)>,
        pixel: [usize; 2],
        open: f64,
    ) -> ([f64; 3], f64) {
        let (mut sum, mut through) = ([0.0; 3], 0.0);
        let mut waiting = std::mem::take(&mut kept.waiting);
        waiting.clear();
        let mut next = Some((first, met));
        let mut known = Some(open);
        while let Some((branch, met)) = next {
            let light = match met {
                None if branch.straight => {
                    through += branch.share[0];
                    [0.0; 3]
                }
                None => self.look.background.unwrap_or([0.0; 3]),
                Some((number, met)) => {
                    let spot = self.spot(kept, &branch, number, met);
                    self.follow(kept, &mut waiting, &branch, &spot);
                    self.local(kept, &spot, pixel, known).map(|c| c * spot.opacity)
                }
            };
            known = None;
            sum = std::array::from_fn(|c| sum[c] + branch.share[c] * light[c]);
            next = waiting.pop().map(|branch| {
                let met = self.world.nearest(branch.line, [0.0, f64::INFINITY], &branch.from);
                (branch, met)
            });
        }
        kept.waiting = waiting;
        (sum, through)
    }

    /// The point where a line meets a body.
    pub(super) fn spot(
        &self,
        kept: &mut WorkerMemory,
        branch: &Branch,
        number: usize,
        met: SurfaceHit,
    ) -> ShadingPoint<'_> {
        let body = &self.world.bodies[number];
        let (line, material) = (branch.line, &body.part.material);
        let length = dot(line.1, line.1).sqrt();
        let sight = line.1.map(|c| c / length);
        let (seen, label) = body.pixel(line, &met);
        let color = body.color(&self.shader, seen, label, || line);
        let (shown, mut normal, enters) = match met {
            SurfaceHit::Cut { plane, .. } => {
                let normal = body.part.clip.planes()[plane].normal;
                (normal, normal, true)
            }
            SurfaceHit::Surface(hit) => self.surface_normal(kept, branch, number, hit),
        };
        let away = dot(normal, sight);
        if away > BEYOND_RIM {
            normal = normal.map(|c| -c);
        } else if away > 0.0 {
            let rim = add_scaled(normal, -away, sight);
            let length = dot(rim, rim).sqrt();
            normal = rim.map(|c| c / length);
        }
        let point = add_scaled(line.0, met.t(), line.1);
        let opacity = match met {
            SurfaceHit::Surface(hit) => body.part.opacity(line, &hit),
            SurfaceHit::Cut { .. } => 1.0,
        };
        ShadingPoint { number, material, color, label, point, sight, shown, normal, enters, opacity, met }
    }

    /// The displayed normal, the same turned to the incoming side at a rim, and true if the line comes from outside.
    fn surface_normal(
        &self,
        kept: &mut WorkerMemory,
        branch: &Branch,
        number: usize,
        hit: Hit,
    ) -> ([f64; 3], [f64; 3], bool) {
        let (body, line) = (&self.world.bodies[number], branch.line);
        let outward = body.outward(line, hit);
        let length = dot(line.1, line.1).sqrt();
        let from_outside = |outward| dot(outward, line.1) <= BEYOND_RIM * length;
        let enters = !branch.media.has(number) && outward.is_none_or(from_outside);
        let smooth = body.part.material.mirror > 0.0 || body.part.material.is_clear();
        let shown = kept.around.get_mut(body.part.file).map_or(outward.unwrap_or(line.1), |around| {
            // Mirrors and clear bodies are as smooth as their normals; the skin around adds nothing.
            let smooth = if smooth { body.smooth_outward(around, line, hit) } else { None };
            smooth.unwrap_or_else(|| {
                let seen = body.normals.seen(&hit, || line);
                body.normals.normal(around, seen, || line)
            })
        });
        // At a rim a line may enter by a face that looks the other way.
        let is_turned = enters && outward.is_some_and(|outward| dot(shown, outward) < 0.0);
        (shown, if is_turned { shown.map(|c| -c) } else { shown }, enters)
    }

    /// Adds mirrored and refracted lines.
    fn follow(
        &self,
        kept: &mut WorkerMemory,
        waiting: &mut Vec<Branch>,
        branch: &Branch,
        spot: &ShadingPoint<'_>,
    ) {
        let (material, cosine) = (spot.material, (-dot(spot.normal, spot.sight)).max(0.0));
        if let (true, SurfaceHit::Surface(hit)) = (spot.opacity < 1.0, spot.met) {
            // Light that a label lets through goes straight on.
            let share = branch.share.map(|part| part * (1.0 - spot.opacity));
            if share[0] >= MIN_SHARE {
                let from = Some((spot.number, Start::Through { hit }));
                waiting.push(Branch { line: (spot.point, spot.sight), from, share, ..*branch });
            }
        }
        if branch.bounces >= self.look.bounces {
            return;
        }
        let mut mirror = material.mirror;
        let mut bent = None;
        if material.is_clear() {
            let through = (1.0 - material.mirror) * material.clear;
            let ratio = self.index_ratio(branch.media, spot);
            match fresnel(cosine.min(1.0), ratio) {
                Some((part, behind)) => {
                    mirror += through * part;
                    let way = spot.sight.map(|c| c * ratio);
                    let bend = add_scaled(way, ratio * cosine - behind, spot.normal);
                    bent = Some((bend, through * (1.0 - part)));
                }
                None => mirror += through,
            }
        }
        let mut add = |direction: [f64; 3], part: f64, color: [f64; 3], beyond: bool, rays: &mut u64| {
            let share: [f64; 3] = std::array::from_fn(|c| branch.share[c] * part * color[c]);
            if share.iter().any(|c| *c >= MIN_SHARE) {
                *rays += 1;
                let within = spot.enters == beyond && material.is_clear();
                let media =
                    if within { branch.media.entered(spot.number) } else { branch.media.left(spot.number) };
                let length = dot(direction, direction).sqrt();
                let line = (spot.point, direction.map(|c| c / length));
                let from = spot.start(beyond);
                waiting.push(Branch {
                    line,
                    from,
                    media,
                    share,
                    bounces: branch.bounces + 1,
                    straight: false,
                });
            }
        };
        if mirror > 0.0 {
            let back = add_scaled(spot.sight, 2.0 * cosine, spot.normal);
            let color = if material.is_clear() { [1.0; 3] } else { material.color };
            add(back, mirror, color, false, &mut kept.counts.mirrored);
        }
        if let Some((bend, part)) = bent {
            let color = if spot.enters { material.color } else { [1.0; 3] };
            add(bend, part, color, true, &mut kept.counts.refracted);
        }
    }

    /// Ratio of the refractive index in front of a clear surface to the index behind it. A body within another borders
    /// on that body's index; a line that leaves the inner body stays in the outer one.
    fn index_ratio(&self, media: Media, spot: &ShadingPoint<'_>) -> f64 {
        let index = |body: Option<usize>| {
            body.and_then(|body| self.world.bodies.get(body)).map_or(1.0, |body| body.part.material.index)
        };
        let (before, behind) = if spot.enters {
            (media.innermost(), media.entered(spot.number).innermost())
        } else {
            (media.innermost().or(Some(spot.number)), media.left(spot.number).innermost())
        };
        index(before) / index(behind)
    }

    /// Light reflected by a surface itself, with its openness where `known`.
    fn local(
        &self,
        kept: &mut WorkerMemory,
        spot: &ShadingPoint<'_>,
        pixel: [usize; 2],
        known: Option<f64>,
    ) -> [f64; 3] {
        let material = spot.material;
        let mut matte = material.solid() * material.diffuse;
        // Highlights only appear outside clear bodies.
        let shiny = if spot.enters || !material.is_clear() { material.specular } else { 0.0 };
        let mut light = [0.0; 3];
        if matte > 0.0 {
            let open = known.unwrap_or_else(|| {
                self.sky.as_ref().map_or(1.0, |sky| self.openness(kept, spot, sky.of(pixel)))
            });
            let color = spot.color.map(|c| matte * c);
            light = match &self.rig {
                Some(rig) => {
                    matte = 0.0;
                    rig.of(color, spot.normal, spot.sight, open)
                }
                None => std::array::from_fn(|c| color[c] * self.look.ambient.color[c] * open),
            };
        }
        if matte <= 0.0 && shiny <= 0.0 {
            return light;
        }
        for lamp in &self.lamps {
            let Some(way) = lamp.way(spot.point, &self.look.camera) else { continue };
            let cosine = dot(way.towards, spot.normal);
            if cosine <= 0.0 {
                continue;
            }
            let half = add_scaled(way.towards, -1.0, spot.sight);
            let shine =
                shiny * power((dot(half, spot.normal) / dot(half, half).sqrt()).max(0.0), material.exponent);
            let Some(through) = self.through(kept, lamp, way, spot) else { continue };
            light = std::array::from_fn(|c| {
                let back = matte * cosine * spot.color[c] + shine;
                light[c] + back * lamp.color[c] * through[c]
            });
        }
        light
    }

    /// Part of a lamp's light that arrives.
    fn through(
        &self,
        kept: &mut WorkerMemory,
        lamp: &Light,
        way: LightSample,
        spot: &ShadingPoint<'_>,
    ) -> Option<[f64; 3]> {
        if !lamp.shadows {
            return Some([1.0; 3]);
        }
        kept.counts.shadow += 1;
        self.world.light_through((spot.point, way.towards), [0.0, way.distance], &spot.start(false))
    }

    /// Openness of the surroundings, by rays into these directions of the sky above.
    pub(super) fn openness(
        &self,
        kept: &mut WorkerMemory,
        spot: &ShadingPoint<'_>,
        directions: &[[f64; 3]],
    ) -> f64 {
        // Surfaces that let light through are not darkened.
        if spot.opacity < 1.0 {
            return 1.0;
        }
        let [right, ahead] = tangents(spot.normal);
        let from = spot.start(false);
        let way =
            |d: &[f64; 3]| std::array::from_fn(|a| right[a] * d[0] + ahead[a] * d[1] + spot.normal[a] * d[2]);
        kept.lot.lines.clear();
        kept.lot.lines.extend(directions.iter().map(|d| (spot.point, way(d))));
        let closed = self.world.count_stopped(&mut kept.lot, [0.0, self.look.ambient.reach_mm], &from) as f64;
        kept.counts.ambient += directions.len() as u64;
        1.0 - closed / directions.len().max(1) as f64
    }
}
