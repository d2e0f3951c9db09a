//! From bodies to pixels: rays in tiles fill a buffer band by band, shading reads it.
//!
//! ```text
//! parts + Look --> Painter --look--> Band: hit, normal, body, openness --shade--> Image, part after part
//!                     |                                                   |
//!                     '-- first: the nearest hits of a tile's rays -------'-- Stage: what mirrors and glass show
//! ```
//!
//! A model by itself is a scene with one body. A pixel's hit depends on its own ray only, and its colour on the hits of
//! the pixels around, in one order; so a picture has the same bytes at any number of threads, in bands of any height.

use std::collections::BTreeSet;
use std::time::Duration;

use crate::cpu::Form;
use crate::fault::usage;
use crate::geom::dot;
use crate::load::NodeView;
use crate::render::ambient::Sky;
use crate::render::ambient_filter::StepSize;
use crate::render::choices::PLACES;
use crate::render::discrete::DiscreteRays;
use crate::render::image::Image;
use crate::render::normals::shading_normal::Line;
use crate::render::picture::{Traversal, check_size, pool};
use crate::render::pixel_rays::PixelRays;
use crate::render::shade::{Rig, Shader};
use crate::render::surface::Skin;
use crate::render::tile::{RAYS, TILE, Tile, Tracer};
use crate::render::traverse::Trace;
use crate::render::{Camera, RenderError, RenderFault, Samples, Shading, Smoothing, add_counts};

use crate::text::names::{SURFACE, TRAVERSAL};

use super::band::Band;
use super::body::{Body, Instance, RayKind, SurfaceHit};
use super::light::{Ambient, Light};
use super::section::{self, Section};
use super::shade::LightingContext;
use super::world::World;

/// Pixels traced and coloured together: bounds the memory for their hits to 4 MiB, or three rows of tiles.
const BAND_PIXELS: usize = 1 << 17;

/// Rows of tiles that are kept from one band to the next.
const KEPT_ROWS: usize = 2;

/// Default rays of a pixel for soft light and for ambient occlusion; averaging over the pixels around multiplies them
/// by about sixteen.
const SOFT_RAYS: u32 = 1;
const AO_RAYS: u32 = 4;
/// Fewest ambient-occlusion rays of a point seen in a mirror or through glass, which is not averaged.
const MIN_FAR_RAYS: u32 = 8;

/// Memory of a worker, and of each further model file that it traces.
const WORKER_BYTES: u64 = 3 << 17;
const FILE_BYTES: u64 = 1 << 17;

/// Settings of a picture.
#[derive(Clone, Debug)]
pub struct PictureSettings {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// The eye.
    pub camera: Camera,
    /// Near distance in mm: points closer to the eye along a line of sight are not seen.
    pub near_mm: f64,
    /// The light; `None` for `lights` and the ambient colour.
    pub shading: Option<Shading>,
    /// The lights of a scene.
    pub lights: Vec<Light>,
    /// Ambient light; 0 rays means the shading's own number.
    pub ambient: Ambient,
    /// Linear RGB of mirrors and glass where they show no body; `None` for black. Behind bodies pictures are
    /// transparent.
    pub background: Option<[f64; 3]>,
    /// Most reflections and refractions of a line.
    pub bounces: u32,
    /// Rays of a pixel's colours.
    pub samples: Samples,
    /// True to trace more rays at creases as well where samples are `Auto`; silhouettes always have more.
    pub creases: bool,
    /// The displayed normals.
    pub smoothing: Smoothing,
    /// The traversal of the rays.
    pub traversal: Traversal,
    /// Base-2 logarithm, for each part, of the edge of nodes that count as surface; missing ones are 0, exact voxels.
    pub levels: Vec<u32>,
    /// A slice instead of a view; the camera is parallel and looks along its axis.
    pub section: Option<Section>,
    /// Threads to use, at least 1.
    pub threads: usize,
    /// Depth range in mm for a depth image, if one is wanted.
    pub depth_range_mm: Option<(f64, f64)>,
    /// True to add a normal image.
    pub normals: bool,
    /// True to add an image of the numbers of boxes or labels.
    pub ids: bool,
    /// True to list the visible models and labels.
    pub seen: bool,
    /// Pixels traced and coloured together, if fewer than usual; never fewer than 8 rows.
    pub max_band_pixels: Option<u32>,
}

/// Numbers of a visible model and of its label; 0 for a model without labels.
pub type Seen = (usize, u16);

/// A finished picture.
#[derive(Clone, Debug)]
pub struct Painted {
    /// The picture, transparent behind the bodies.
    pub image: Image,
    /// Rays and times.
    pub counts: Counts,
    /// Models and labels met first by rays through the pixels' middles, if requested.
    pub seen: BTreeSet<Seen>,
}

/// Counts and times of a painted picture.
#[derive(Clone, Copy, Debug, Default)]
pub struct Counts {
    /// Rays from the eye.
    pub rays: u64,
    /// Rays from the eye that hit.
    pub hits: u64,
    /// Bricks of 4 x 4 x 4 boxes tested against rays.
    pub steps: u64,
    /// Most steps of one ray.
    pub max_steps: u32,
    /// Wall time of tracing.
    pub trace: Duration,
    /// Wall time of shading.
    pub shade: Duration,
    /// Wall time of ambient occlusion.
    pub around: Duration,
    /// Rays of ambient occlusion.
    pub ambient: u64,
    /// Pixels with several rays.
    pub refined: u64,
    /// Rays towards lights.
    pub shadow: u64,
    /// Mirrored rays.
    pub mirrored: u64,
    /// Refracted rays.
    pub refracted: u64,
}

impl Counts {
    pub(super) fn plus(mut self, other: Self) -> Self {
        add_counts!(self, other: rays, hits, steps, trace, shade, around, ambient, refined, shadow, mirrored, refracted);
        self.max_steps = self.max_steps.max(other.max_steps);
        self
    }

    /// All rays that did not come from the eye.
    pub fn secondary(&self) -> u64 {
        self.shadow + self.mirrored + self.refracted + self.ambient
    }

    /// Scales the times of all threads to parts of the elapsed time.
    pub(super) fn within(mut self, wall: Duration) -> Self {
        let all = (self.trace + self.shade + self.around).as_secs_f64();
        if all > 0.0 {
            for part in [&mut self.trace, &mut self.shade, &mut self.around] {
                *part = wall.mul_f64(part.as_secs_f64() / all);
            }
        }
        self
    }
}

fn at_most(max_band_pixels: Option<u32>) -> usize {
    max_band_pixels.map_or(BAND_PIXELS, |most| BAND_PIXELS.min(most as usize))
}

impl PictureSettings {
    /// Pixels that are traced and coloured together; at least 8 rows.
    pub(super) fn band_pixels(&self) -> usize {
        at_most(self.max_band_pixels)
    }

    /// A blank image of this many rows.
    pub(super) fn blank(&self, rows: u32) -> Image {
        Image::blank([self.width, rows], [self.depth_range_mm.is_some(), self.normals, self.ids])
    }

    /// Ambient-occlusion rays of each pixel.
    fn sky_rays(&self) -> u32 {
        match (self.shading, self.ambient.rays) {
            (Some(Shading::Plain | Shading::Flat), _) | (None, 0) => 0,
            (Some(Shading::Soft), 0) => SOFT_RAYS,
            (Some(Shading::Ao), 0) => AO_RAYS,
            (_, rays) => rays,
        }
    }

    /// Bytes that [`paint_parts`] needs besides the models and the program, in bands of at most this many pixels.
    pub(crate) fn parts_bytes(&self, files: usize, max_band_pixels: Option<u32>) -> u64 {
        let row = u64::from(self.width).next_multiple_of(TILE as u64);
        let rows = (at_most(max_band_pixels) as u64 / (row * TILE as u64)).max(1) * TILE as u64;
        let all = u64::from(self.height).next_multiple_of(TILE as u64);
        let layers = 4
            + if self.depth_range_mm.is_some() { 2 } else { 0 }
            + if self.normals { 3 } else { 0 }
            + if self.ids { 6 } else { 0 };
        let kept = (rows + (KEPT_ROWS * TILE) as u64).min(all);
        let pixel = Band::PIXEL_BYTES + if files > 1 { Band::ITEM_BYTES } else { 0 };
        row * (rows.min(all) * 2 * layers + kept * pixel)
            + self.threads.max(1) as u64 * (WORKER_BYTES + FILE_BYTES * (files.max(1) as u64 - 1))
    }
}

/// The receivers of a picture's progress.
#[derive(Clone, Copy)]
pub(crate) struct Watch<'a> {
    /// Receives the number of further rows painted, each time.
    pub(crate) rows_done: &'a (dyn Fn(u32) + Sync),
    /// Called by any worker after each small step (a tile, some rays of ambient occlusion), to check memory.
    pub(crate) between: &'a (dyn Fn() + Sync),
    /// True as soon as the picture is no longer wanted.
    pub(crate) is_stopped: &'a (dyn Fn() -> bool + Sync),
}

impl Watch<'_> {
    pub(super) fn step(&self) {
        (self.between)();
    }

    /// Reports a step; true if the worker shall leave the rest of its rows.
    pub(super) fn ends(&self) -> bool {
        self.step();
        (self.is_stopped)()
    }

    /// Reports a finished part; an error if the picture is stopped.
    pub(super) fn part(&self, rows: u32) -> Result<(), RenderError> {
        (self.rows_done)(rows);
        if (self.is_stopped)() { Err(RenderFault::Stopped.into()) } else { Ok(()) }
    }
}

/// Receives a picture from the top, part by part.
pub(crate) type Taker<'a> = &'a mut (dyn FnMut(&mut Image) -> Result<(), RenderError> + Send);

/// Bytes that [`paint`] needs for a picture of one model of this size, besides the model: the picture, a band, two
/// parts of its rows, and the threads.
pub(crate) fn paint_bytes(width: u32, height: u32, threads: usize) -> u64 {
    let (width, height) = (u64::from(width).next_multiple_of(TILE as u64), u64::from(height));
    let rows = (BAND_PIXELS as u64 / width).max(TILE as u64).min(height.next_multiple_of(TILE as u64));
    let kept = (KEPT_ROWS * TILE) as u64;
    4 * width * height
        + width * ((rows + kept) * Band::PIXEL_BYTES + 8 * rows)
        + threads as u64 * WORKER_BYTES
}

/// Paints bodies; `rows_done` receives the number of further rows each time.
///
/// Memory: the image, 4 MiB for hits, two parts of 2^17 pixels, and for every thread 128 KiB for each file.
///
/// # Errors
/// [`RenderError`] when the size is not possible or the threads do not start, and for discrete rays in a model of cells
/// or one that is cut.
pub fn paint(
    parts: &[Instance<'_>],
    look: &PictureSettings,
    rows_done: &(dyn Fn(u32) + Sync),
) -> Result<Painted, RenderError> {
    check_size(look.width, look.height)?;
    let mut image = look.blank(0);
    image.reserve(look.height);
    let (counts, seen) =
        paint_parts(parts, look, Watch { rows_done, between: &|| {}, is_stopped: &|| false }, &mut |part| {
            image.append(part);
            Ok(())
        })?;
    Ok(Painted { image, counts, seen })
}

/// Like [`paint`], part by part: the picture is never held as a whole. While `take` handles one part the next is
/// painted, if there are enough threads.
///
/// Memory: 4 MiB for hits or three rows of tiles, whichever is more, and two parts of 2^17 pixels or 8 rows, of all
/// layers.
///
/// # Errors
/// Errors of [`paint`] and of `take`.
pub(crate) fn paint_parts(
    parts: &[Instance<'_>],
    look: &PictureSettings,
    watch: Watch<'_>,
    take: Taker<'_>,
) -> Result<(Counts, BTreeSet<Seen>), RenderError> {
    check_size(look.width, look.height)?;
    Form::chosen().map_err(|sentence| usage!("{sentence}"))?;
    let pool = pool(look.threads)?;
    if let Some(section) = look.section {
        return pool.install(|| section::slice(parts, look, section, watch, take));
    }
    let painter = Painter::new(parts, look, watch)?;
    pool.install(|| painter.paint(take))
}

/// The lines of sight in the grid of a body.
struct Eye<'a> {
    sight: PixelRays<'a>,
    /// The lines through the [`PLACES`] times [`PLACES`] subpixels of each pixel.
    places: PixelRays<'a>,
    /// The rays of the discrete mode, if requested.
    discrete: Option<DiscreteRays<'a>>,
}

/// The first hits of a tile's rays: the number of the body, and the intersection.
pub(super) type FirstHits = [Option<(usize, SurfaceHit)>; RAYS];

/// A group of rays from the eye.
#[derive(Clone, Copy)]
pub(super) enum Group {
    /// Rays through the middles of the pixels of the tile at this corner, with this many columns and rows in the
    /// picture.
    Pixels([usize; 2], (usize, usize)),
    /// Rays through these subpixels of one pixel.
    Places([usize; 2], u64),
}

impl Group {
    /// The tile of its picture, and the rays to trace.
    pub(super) fn tile(self, lod_edge_log2: u32) -> (Tile, u64) {
        match self {
            Self::Pixels([x, y], limits) => {
                let tile = Tile { corner: (x, y), limits, lod_edge_log2 };
                (tile, tile.live())
            }
            Self::Places([x, y], places) => {
                const { assert!(PLACES == TILE) };
                let corner = (x * PLACES, y * PLACES);
                (Tile { corner, limits: (PLACES, PLACES), lod_edge_log2 }, places)
            }
        }
    }
}

/// The rays of a tile whose bits in `asked` are set.
pub(super) fn rays_of(mut asked: u64) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let ray = (asked != 0).then(|| asked.trailing_zeros() as usize)?;
        asked &= asked - 1;
        Some(ray)
    })
}

/// Read-only data of a picture's workers.
pub(super) struct Painter<'a> {
    pub(super) look: &'a PictureSettings,
    pub(super) stage: LightingContext<'a>,
    eyes: Vec<Eye<'a>>,
    /// Number of model files.
    pub(super) files: usize,
    pub(super) form: Form,
    /// Directions of ambient-occlusion rays, if there are any.
    pub(super) sky: Option<Sky>,
    pub(super) step: StepSize,
    /// True for one whole body, whose rays are all traced by tiles.
    pub(super) is_alone: bool,
    /// True if a pixel's colour needs more rays than the band's: towards lights, in mirrors and through bodies.
    pub(super) follows: bool,
    pub(super) watch: Watch<'a>,
}

impl<'a> Painter<'a> {
    fn new(
        parts: &'a [Instance<'a>],
        look: &'a PictureSettings,
        watch: Watch<'a>,
    ) -> Result<Self, RenderError> {
        let world = World::of(parts, look.smoothing, &look.levels);
        let is_whole = |body: &Body<'_>| body.part.clip.is_empty() && !body.part.is_dimmed();
        let is_discrete = look.traversal == Traversal::Discrete;
        if is_discrete && world.bodies.iter().any(|body| body.part.view.cells().is_some()) {
            return Err(usage!("discrete rays meet voxels, and this model has cells with a surface within; leave {TRAVERSAL} exact, or build it with {SURFACE} skin").into());
        }
        if is_discrete && !(look.near_mm == 0.0 && world.bodies.iter().all(is_whole)) {
            return Err(usage!("discrete rays meet the voxels of whole models, and this one is cut or lacks some labels; leave {TRAVERSAL} exact").into());
        }
        let (width, height) = (look.width, look.height);
        let places = u32::from(PLACES.to_le_bytes()[0]);
        let eyes = parts.iter().map(|part| {
            let sight = PixelRays::new(&part.space, &look.camera, width, height);
            let places = PixelRays::new(&part.space, &look.camera, width * places, height * places);
            let discrete = is_discrete.then(|| DiscreteRays::new(sight, width, height));
            Eye { sight, places, discrete }
        });
        let rays = look.sky_rays();
        let step = step_size(&world, look);
        let is_lit = |body: &Body<'_>| !body.part.material.is_plain() || body.part.is_translucent();
        Ok(Self {
            look,
            eyes: eyes.collect(),
            files: parts.iter().map(|part| part.file + 1).max().unwrap_or(0),
            form: Form::best(),
            sky: (rays > 0).then(|| Sky::shared(rays)),
            step,
            is_alone: look.near_mm == 0.0 && matches!(&*world.bodies, [body] if is_whole(body)),
            follows: look.shading.is_none() || world.bodies.iter().any(is_lit),
            watch,
            stage: LightingContext {
                world,
                look,
                rig: look.shading.map(|shading| Rig::new(shading, look.camera.axes())),
                lamps: if look.shading.is_some() { Light::usual() } else { look.lights.clone() },
                shader: Shader::new(),
                sky: (rays > 0).then(|| Sky::new(rays.max(MIN_FAR_RAYS))),
            },
        })
    }

    /// The line of sight of a ray of a group.
    #[inline]
    pub(super) fn line(&self, group: Group, ray: usize) -> Line {
        let (tile, _) = group.tile(0);
        let places = if matches!(group, Group::Places(..)) { PLACES as f64 } else { 1.0 };
        let (width, height) = (f64::from(self.look.width) * places, f64::from(self.look.height) * places);
        let (x, y) = ((tile.corner.0 + ray % TILE) as f64 + 0.5, (tile.corner.1 + ray / TILE) as f64 + 0.5);
        self.look.camera.ray((2.0 * x - width) / width, (height - 2.0 * y) / height)
    }

    /// Any of the bodies' sights, for directions.
    pub(super) fn sight(&self) -> Option<&PixelRays<'a>> {
        self.eyes.first().map(|eye| &eye.sight)
    }

    /// The first hits of a group of rays, which decide the content of a pixel.
    pub(super) fn first(&self, tracer: &mut Tracer, group: Group) -> (FirstHits, Counts) {
        let mut nearest: FirstHits = [None; RAYS];
        let mut steps = [0_u32; RAYS];
        for (number, (body, eye)) in self.stage.world.bodies.iter().zip(&self.eyes).enumerate() {
            let (tile, asked) = group.tile(body.level);
            let sight = if matches!(group, Group::Places(..)) { &eye.places } else { &eye.sight };
            let mut take = |ray: usize, met: SurfaceHit| {
                if let Some(nearest) = nearest.get_mut(ray)
                    && nearest.as_ref().is_none_or(|(_, other)| met.t() < other.t())
                {
                    *nearest = Some((number, met));
                }
            };
            if let Some(discrete) = &eye.discrete {
                let mut each = |ray: usize, trace: Trace| {
                    steps[ray % RAYS] += trace.steps;
                    trace.hit.into_iter().for_each(|hit| take(ray, SurfaceHit::Surface(hit)));
                };
                match group {
                    Group::Pixels(..) => discrete.trace_tile(body.part.view, tile, asked, each),
                    Group::Places(..) => rays_of(asked).for_each(|ray| {
                        let [x, y] = [tile.corner.0 + ray % TILE, tile.corner.1 + ray / TILE]
                            .map(|c| (c as f64 + 0.5) / PLACES as f64);
                        each(ray, discrete.trace(body.part.view, x, y, body.level));
                    }),
                }
                continue;
            }
            if self.look.near_mm > 0.0 || !body.part.clip.is_empty() {
                for ray in rays_of(asked) {
                    let line = self.line(group, ray);
                    let near = self.look.near_mm / dot(line.1, line.1).sqrt();
                    if let Some(met) = body.meet(RayKind::PixelRays, line, [near, f64::INFINITY], None) {
                        take(ray, met);
                    }
                }
                continue;
            }
            let view = body.part.view;
            let hits = match &body.cells {
                Some(cells) => tracer.trace_some(view, cells, sight, tile, asked),
                None => tracer.trace_some(view, &Skin, sight, tile, asked),
            };
            for ray in rays_of(asked) {
                steps[ray] += hits.steps(ray);
                let Some(hit) = hits.hit(ray) else { continue };
                take(ray, SurfaceHit::Surface(hit));
            }
        }
        let (_, asked) = group.tile(0);
        let counts = Counts {
            rays: asked.count_ones().into(),
            hits: nearest.iter().map(|met| u64::from(met.is_some())).sum(),
            steps: steps.iter().map(|steps| u64::from(*steps)).sum(),
            max_steps: steps.iter().fold(0, |most, steps| most.max(*steps)),
            ..Counts::default()
        };
        (nearest, counts)
    }

    /// Number of rows traced and coloured together.
    fn band_rows(&self) -> usize {
        let row = (self.look.width as usize).div_ceil(TILE) * RAYS;
        (self.look.band_pixels() / row).max(1) * TILE
    }

    /// Paints the picture part by part, and passes each on while the next is painted.
    fn paint(&self, take: Taker<'_>) -> Result<(Counts, BTreeSet<Seen>), RenderError> {
        let (width, height) = (self.look.width as usize, self.look.height as usize);
        let mut band = Band::new(width, !self.is_alone);
        let mut counts = Counts::default();
        let mut seen = BTreeSet::new();
        let [mut done, mut next] = [0, 1].map(|_| self.look.blank(0));
        let (mut traced, mut painted) = (0, 0);
        while painted < height {
            let rows = self.band_rows().min(height - traced);
            // Colours depend on the tiles around.
            let end = if traced + rows < height { traced + rows - TILE } else { height };
            #[expect(clippy::cast_possible_truncation, reason = "at most the picture's rows")]
            let parts = (end - painted) as u32;
            next.clear(parts);
            let (taken, own) = rayon::join(
                || if done.height > 0 { take(&mut done) } else { Ok(()) },
                || {
                    let counts = self.look(&mut band, traced, rows);
                    counts.plus(self.shade(&band, &mut next, painted, &mut seen))
                },
            );
            taken?;
            counts = counts.plus(own);
            (traced, painted) = (traced + rows, end);
            band.forget_above(painted.saturating_sub(TILE) / TILE * TILE);
            self.watch.part(parts)?;
            std::mem::swap(&mut done, &mut next);
        }
        take(&mut done)?;
        Ok((counts, seen))
    }
}

/// The sizes that depth steps are compared with.
#[expect(clippy::cast_possible_truncation, reason = "single precision will do")]
fn step_size(world: &World<'_>, look: &PictureSettings) -> StepSize {
    let voxel_mm = world.bodies.iter().fold(0.0_f64, |most, body| {
        let [x, y, z] = body.part.space.spacing_mm();
        most.max((x + y + z) / 3.0 * f64::from(1_u32 << body.level.min(31)))
    });
    let [at_eye, at_one] = [0.0, 1.0].map(|depth| look.camera.pixel_mm(look.height, depth));
    let crease = if look.creases { StepSize::CREASE } else { StepSize::NO_CREASE };
    StepSize { voxel_mm: voxel_mm as f32, pixel_mm: [at_eye as f32, (at_one - at_eye) as f32], crease }
}
