//! A scene as pixels: tiles of 8 x 8 points over a private pool of threads.
//!
//! A point depends on its own line only and is written to its own place, so a picture has the same bytes at any number
//! of threads. Lines from the eye walk each body's octree together, as in pictures of one model; those of bodies that
//! are cut, and all others, go alone.

use std::collections::BTreeSet;
use std::time::{Duration, Instant};

use rayon::prelude::*;

use crate::geom::{add_scaled, dot};
use crate::render::ambient::Sky;
use crate::render::form::Form;
use crate::render::image::Image;
use crate::render::normals::shown::Line;
use crate::render::picture::{check_size, depth_code, normal_code, pool};
use crate::render::shade::Shader;
use crate::render::sight::Sight;
use crate::render::surface::Skin;
use crate::render::tile::{RAYS, TILE, Tile, Tracer};
use crate::render::{Camera, RenderError};

use super::body::{Met, Part, Purpose};
use super::light::{Ambient, Light};
use super::rays::Rays;
use super::shade::{Branch, Stage, WorkerMemory};
use super::world::World;

/// How a scene is shown.
#[derive(Clone, Debug, PartialEq)]
pub struct Look {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// The eye.
    pub camera: Camera,
    /// Nearer points along a line of sight, in mm, are not seen.
    pub near_mm: f64,
    /// The lights.
    pub lights: Vec<Light>,
    /// Light from everywhere.
    pub ambient: Ambient,
    /// Linear RGB of what meets nothing; `None` is transparent, and black in mirrors.
    pub background: Option<[f64; 3]>,
    /// How often a line is thrown back or bent.
    pub bounces: u32,
    /// Lines of a pixel along each of its sides: 1 to 8.
    pub samples: u32,
    /// Threads to use, at least 1.
    pub threads: usize,
    /// Depth range in mm for a depth image, if one is wanted.
    pub depth_range_mm: Option<(f64, f64)>,
    /// Is a normal image wanted?
    pub normals: bool,
}

/// The number of a model that is seen, and of its label; 0 of one without labels.
pub type Seen = (usize, u16);

/// A picture that is finished.
#[derive(Clone, Debug)]
pub struct Painted {
    /// The picture.
    pub image: Image,
    /// Lines that it took.
    pub rays: Rays,
    /// What it shows first along any line.
    pub seen: BTreeSet<Seen>,
    /// Wall time.
    pub traced: Duration,
}

impl Look {
    /// An empty picture.
    pub(super) fn blank(&self) -> Image {
        let layers = [self.depth_range_mm.is_some(), self.normals, false];
        Image::blank([self.width, self.height], layers)
    }

    /// The pixel of some lines, of which so many meet something and have this sum of colours.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
    pub(super) fn pixel(&self, shader: &Shader, sum: [f64; 3], hits: f64, lines: f64) -> [u8; 4] {
        let (color, alpha) = match self.background {
            Some(background) => (add_scaled(sum, lines - hits, background).map(|c| c / lines), 255.0),
            None if hits > 0.0 => (sum.map(|c| c / hits), 255.0 * hits / lines),
            None => ([0.0; 3], 0.0),
        };
        let [r, g, b] = color.map(|c| shader.encode(c));
        if alpha > 0.0 { [r, g, b, (alpha + 0.5) as u8] } else { [0; 4] }
    }
}

/// Paints a scene; `rows_done` gets the number of rows each time that more are painted.
///
/// Memory: the image, and for every thread 20 KiB for each file, 1.5 KiB a tile.
///
/// # Errors
/// [`RenderError`] when the size is not possible, or the threads do not start.
pub fn paint(
    parts: &[Part<'_>],
    look: &Look,
    rows_done: &(dyn Fn(u32) + Sync),
) -> Result<Painted, RenderError> {
    check_size(look.width, look.height)?;
    let samples = look.samples.clamp(1, 8);
    let (wide, high) = (look.width * samples, look.height * samples);
    let painter = Painter {
        stage: Stage {
            world: World::of(parts),
            lights: &look.lights,
            ambient: look.ambient,
            camera: &look.camera,
            background: look.background.unwrap_or([0.0; 3]),
            most_bounces: look.bounces,
            sky: Sky::new(look.ambient.rays.div_ceil(samples * samples)),
        },
        sights: parts.iter().map(|part| Sight::new(part.space(), &look.camera, wide, high)).collect(),
        files: parts.iter().map(|part| part.file() + 1).max().unwrap_or(0),
        look,
        samples: samples as usize,
        form: Form::best(),
        shader: Shader::new(),
    };
    let pool = pool(look.threads)?;
    let start = Instant::now();
    let (image, (rays, seen)) = pool.install(|| painter.paint(rows_done));
    Ok(Painted { image, rays, seen, traced: start.elapsed() })
}

struct Painter<'a> {
    stage: Stage<'a>,
    /// The lines of sight in each body's grid.
    sights: Vec<Sight<'a>>,
    files: usize,
    look: &'a Look,
    samples: usize,
    form: Form,
    shader: Shader,
}

impl Painter<'_> {
    fn paint(&self, rows_done: &(dyn Fn(u32) + Sync)) -> (Image, (Rays, BTreeSet<Seen>)) {
        let width = self.look.width as usize;
        let mut image = self.look.blank();
        let mut strips: Vec<Strip<'_>> =
            image.rgba.chunks_mut(width * TILE * 4).map(|rgba| Strip { rgba, ..Strip::default() }).collect();
        let depth = image.depth.as_mut().map(|all| all.chunks_mut(width * TILE));
        for (strip, depth) in strips.iter_mut().zip(depth.into_iter().flatten()) {
            strip.depth = depth;
        }
        let normals = image.normals.as_mut().map(|all| all.chunks_mut(width * TILE * 3));
        for (strip, normals) in strips.iter_mut().zip(normals.into_iter().flatten()) {
            strip.normals = normals;
        }
        let begin = || (Tracer::new(self.form), WorkerMemory::new(self.files));
        let rays = strips.into_par_iter().enumerate().map_init(begin, |(tracer, kept), (number, strip)| {
            kept.rays = Rays::default();
            let rows = self.strip(tracer, kept, number * TILE, strip);
            #[expect(clippy::cast_possible_truncation, reason = "rows of a strip")]
            rows_done(rows as u32);
            (kept.rays, std::mem::take(&mut kept.seen))
        });
        let traced = rays.reduce(Default::default, joined);
        (image, traced)
    }

    /// Paints a strip of pixels from row `top` on; how many rows it has.
    fn strip(&self, tracer: &mut Tracer, kept: &mut WorkerMemory, top: usize, strip: Strip<'_>) -> usize {
        let (width, samples) = (self.look.width as usize, self.samples);
        let rows = strip.rgba.len() / 4 / width.max(1);
        let mut sums = vec![Sum::default(); width * rows];
        for down in (0..rows * samples).step_by(TILE) {
            for left in (0..width * samples).step_by(TILE) {
                let corner = (left, top * samples + down);
                let limits = (TILE.min(width * samples - left), TILE.min(rows * samples - down));
                let met = self.first(tracer, Tile { corner, limits, lod_edge_log2: 0 });
                for (ray, met) in met.into_iter().enumerate() {
                    let at = [corner.0 + ray % TILE, corner.1 + ray / TILE];
                    if ray % TILE >= limits.0 || ray / TILE >= limits.1 {
                        continue;
                    }
                    let pixel = (at[1] / samples - top) * width + at[0] / samples;
                    if let Some(sum) = sums.get_mut(pixel) {
                        self.add(kept, met, at, sum);
                    }
                }
            }
        }
        self.write(&sums, strip);
        rows
    }

    /// The line of sight through a point of the picture.
    fn line(&self, at: [usize; 2]) -> Line {
        let (wide, high) = (
            f64::from(self.look.width) * self.samples as f64,
            f64::from(self.look.height) * self.samples as f64,
        );
        let [x, y] = at.map(|c| c as f64 + 0.5);
        self.look.camera.ray((2.0 * x - wide) / wide, (high - 2.0 * y) / high)
    }

    /// The first hits of a tile's lines.
    fn first(&self, tracer: &mut Tracer, tile: Tile) -> Vec<Option<(usize, Met)>> {
        let mut nearest: Vec<Option<(usize, Met)>> = vec![None; RAYS];
        for (number, (body, sight)) in self.stage.world.bodies.iter().zip(&self.sights).enumerate() {
            let mut take = |ray: usize, met: Met| {
                if let Some(nearest) = nearest.get_mut(ray)
                    && nearest.as_ref().is_none_or(|(_, other)| met.t() < other.t())
                {
                    *nearest = Some((number, met));
                }
            };
            if self.look.near_mm > 0.0 || !body.part.clip().is_empty() {
                for ray in 0..RAYS {
                    let line = self.line([tile.corner.0 + ray % TILE, tile.corner.1 + ray / TILE]);
                    let near = self.look.near_mm / dot(line.1, line.1).sqrt();
                    if let Some(met) = body.meet(Purpose::Sight, line, [near, f64::INFINITY], None) {
                        take(ray, met);
                    }
                }
                continue;
            }
            let hits = match &body.cells {
                Some(cells) => tracer.trace(body.part.view(), cells, sight, tile),
                None => tracer.trace(body.part.view(), &Skin, sight, tile),
            };
            for ray in 0..RAYS {
                let Some(hit) = hits.hit(ray) else { continue };
                take(ray, Met::Surface(hit));
            }
        }
        nearest
    }

    /// Adds what a line sees to a pixel.
    fn add(&self, kept: &mut WorkerMemory, met: Option<(usize, Met)>, at: [usize; 2], sum: &mut Sum) {
        kept.rays.primary += 1;
        sum.lines += 1;
        let Some((number, first)) = met else { return };
        kept.rays.hits += 1;
        let line = self.line(at);
        let label = match &first {
            Met::Surface(hit) => self.stage.world.bodies[number].part.label_number(line, hit),
            Met::Cut { label, .. } => label.unwrap_or(0),
        };
        kept.seen.insert((number, label));
        let (color, open) = self.stage.color(kept, Branch::first(line), met, at);
        sum.color = add_scaled(sum.color, 1.0, color);
        sum.open += open;
        if sum.hits == 0 && self.look.depth_range_mm.is_some() {
            sum.depth = first.t();
        }
        if sum.hits == 0 && self.look.normals {
            sum.normal = self.stage.normal(kept, line, (number, first));
        }
        sum.hits += 1;
    }

    /// Writes the pixels of a strip.
    #[expect(clippy::cast_possible_truncation, reason = "clamped")]
    fn write(&self, sums: &[Sum], strip: Strip<'_>) {
        let (rgba, _) = strip.rgba.as_chunks_mut::<4>();
        for (sum, out) in sums.iter().zip(rgba) {
            let (hits, lines) = (f64::from(sum.hits) - sum.open, f64::from(sum.lines.max(1)));
            *out = self.look.pixel(&self.shader, sum.color, hits, lines);
        }
        if let Some(range) = self.look.depth_range_mm {
            for (sum, out) in sums.iter().zip(strip.depth) {
                *out = if sum.hits > 0 { depth_code(range, sum.depth as f32) } else { 0 };
            }
        }
        for (sum, out) in sums.iter().zip(strip.normals.as_chunks_mut::<3>().0) {
            *out = if sum.hits > 0 { sum.normal.map(normal_code) } else { [0; 3] };
        }
    }
}

/// What two strips took and show.
pub(super) fn joined(one: (Rays, BTreeSet<Seen>), other: (Rays, BTreeSet<Seen>)) -> (Rays, BTreeSet<Seen>) {
    let mut seen = one.1;
    seen.extend(other.1);
    (one.0.plus(other.0), seen)
}

/// The pixels of some rows.
#[derive(Default)]
struct Strip<'a> {
    rgba: &'a mut [u8],
    depth: &'a mut [u16],
    normals: &'a mut [u8],
}

/// The sum over a pixel's lines.
#[derive(Clone, Copy, Default)]
struct Sum {
    color: [f64; 3],
    lines: u32,
    hits: u32,
    /// The part of the hits' lines that goes on into the background.
    open: f64,
    /// Those of the first line that met something.
    depth: f64,
    normal: [f64; 3],
}
