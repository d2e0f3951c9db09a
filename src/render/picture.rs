//! From a camera to pixels: rays in tiles over a private pool of threads.
//!
//! A pixel depends on its own ray only and is written to its own place, so a picture has the same bytes at
//! any number of threads.

use std::time::{Duration, Instant};

use rayon::prelude::*;

use crate::load::{ModelView, NodeView};
use crate::render::RenderFault;

use super::cells::Cells;
use super::discrete::DiscreteRays;
use super::form::Form;
use super::image::Image;
use super::normals::around::Surroundings;
use super::normals::shown::{Normals, PixelHit};
use super::shade::Shader;
use super::sight::Sight;
use super::single;
use super::space::GridSpace;
use super::surface::{Skin, Surface};
use super::tile::{RAYS as TILE_PIXELS, TILE, Tile, Tracer};
use super::traverse::Trace;
use super::{Camera, RenderError};

/// Pixels traced between two shading passes; bounds the memory for hits to 4 MiB, or a row of tiles.
const BAND_PIXELS: usize = 1 << 18;

/// Stack of a worker; nothing here recurses.
const WORKER_STACK_BYTES: usize = 4 << 20;

/// Longest side and most pixels of a picture.
const MAX_SIDE: u32 = 32_768;
const MAX_PIXELS: u64 = 1 << 28;

/// The settings of a picture besides the camera.
#[derive(Clone, Copy, Debug)]
pub struct Canvas {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Threads to use, at least 1.
    pub threads: usize,
    /// Nodes with an edge of 2^this or less count as surface; 0 for exact voxels.
    pub lod_edge_log2: u32,
    /// Trace four more rays where the silhouette passes through a pixel.
    pub smooth_edges: bool,
    /// Depth range in mm for a depth image, if one is wanted.
    pub depth_range_mm: Option<(f64, f64)>,
    /// Is a normal image wanted?
    pub normals: bool,
    /// Is an image of the numbers of boxes wanted?
    pub ids: bool,
    /// Are normals blended between the boxes around a hit?
    pub blended: bool,
    /// Rays of each pixel that measure how open its surroundings are; 0 for none.
    pub ambient_rays: u32,
    /// The rays' kind.
    pub traversal: Traversal,
    /// Pixels traced and coloured together, if fewer than usual; never fewer than 8 rows.
    pub most_band_pixels: Option<u32>,
}

/// The kind of a picture's rays.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Serialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub enum Traversal {
    /// The first box that the line intersects.
    #[default]
    Exact,
    /// The first voxel of a 6-connected discrete ray ([`super::discrete`]).
    Discrete,
}

impl Traversal {
    /// Every one.
    pub const ALL: [Self; 2] = [Self::Exact, Self::Discrete];

    /// Its name on the command line and in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Exact => "exact",
            Self::Discrete => "discrete",
        }
    }
}

/// Counts and times of a painted picture.
#[derive(Clone, Copy, Debug, Default)]
pub struct Counts {
    /// Rays traced.
    pub rays: u64,
    /// Rays that hit.
    pub hits: u64,
    /// Bricks of 4 x 4 x 4 boxes that rays were compared with.
    pub steps: u64,
    /// Most of one ray.
    pub max_steps: u32,
    /// Wall time of tracing.
    pub trace: Duration,
    /// Wall time of shading.
    pub shade: Duration,
    /// Wall time of ambient occlusion.
    pub ambient: Duration,
}

impl Canvas {
    /// Pixels that are traced and coloured together, unless 8 rows are more.
    fn band_pixels(&self) -> usize {
        self.most_band_pixels.map_or(BAND_PIXELS, |most| BAND_PIXELS.min(most as usize))
    }
}

impl Counts {
    fn add(mut self, trace: &Trace) -> Self {
        self.rays += 1;
        self.hits += u64::from(trace.hit.is_some());
        self.steps += u64::from(trace.steps);
        self.max_steps = self.max_steps.max(trace.steps);
        self
    }

    pub(super) fn plus(mut self, other: Self) -> Self {
        add_counts!(self, other: rays, hits, steps, trace, shade, ambient);
        self.max_steps = self.max_steps.max(other.max_steps);
        self
    }
}

/// Checks a picture's size.
///
/// # Errors
/// [`RenderError`] for no pixels or too many.
pub(crate) fn check_size(width: u32, height: u32) -> Result<(), RenderError> {
    let pixels = u64::from(width) * u64::from(height);
    if width == 0 || height == 0 || width > MAX_SIDE || height > MAX_SIDE || pixels > MAX_PIXELS {
        return Err(RenderFault::Size { width, height, most_side: MAX_SIDE, most_pixels: MAX_PIXELS }.into());
    }
    Ok(())
}

/// A private pool of this many workers with small stacks; the process-wide pool is never used.
///
/// # Errors
/// [`RenderError`] when the system does not start that many.
pub fn pool(threads: usize) -> Result<rayon::ThreadPool, RenderError> {
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads.max(1))
        .stack_size(WORKER_STACK_BYTES)
        .build()
        .map_err(|cause| {
            RenderError::from(RenderFault::Threads { threads, cause: std::io::Error::other(cause) })
        })
}

/// Grey of a depth in a depth image of this range.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
pub(crate) fn depth_code((near, far): (f64, f64), depth: f32) -> u16 {
    let scale = if far > near { 65_534.0 / (far - near) } else { 0.0 };
    1 + ((f64::from(depth) - near) * scale + 0.5).clamp(0.0, 65_534.0) as u16
}

/// Colour of a component of a normal in a normal image.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
pub(crate) fn normal_code(component: f64) -> u8 {
    (128.5 + component * 127.0).clamp(1.0, 255.0) as u8
}

/// Everything that a pixel's worker reads.
pub(super) struct Painter<'a, S> {
    pub(super) view: &'a ModelView<'a>,
    pub(super) surface: S,
    pub(super) normals: Normals<'a>,
    pub(super) sight: Sight<'a>,
    /// The rays of the discrete mode, if that is asked for.
    pub(super) discrete: Option<DiscreteRays<'a>>,
    pub(super) form: Form,
    pub(super) canvas: Canvas,
    pub(super) shader: Shader,
    pub(super) open: Openness,
    pub(super) watch: Watch<'a>,
}

/// The receivers of a picture's progress.
#[derive(Clone, Copy)]
pub(crate) struct Watch<'a> {
    /// Each time how many more rows are painted.
    pub(crate) rows_done: &'a (dyn Fn(u32) + Sync),
    /// Called by any worker after each small step (a tile, some rays of ambient occlusion), to look after memory.
    pub(crate) between: &'a (dyn Fn() + Sync),
}

impl Watch<'_> {
    pub(super) fn step(&self) {
        (self.between)();
    }
}

/// How open the surroundings of some rows' pixels are, 0 to 255; empty where that does not matter.
#[derive(Default)]
pub(super) struct Openness {
    /// The first row.
    pub(super) top: usize,
    pub(super) pixels: Vec<u8>,
}

impl Openness {
    /// That of a pixel of a picture of this width.
    #[inline]
    pub(super) fn at(&self, width: usize, [x, y]: [usize; 2]) -> Option<u8> {
        self.pixels.get(y.wrapping_sub(self.top).wrapping_mul(width).wrapping_add(x)).copied()
    }
}

/// Takes a picture from the top, a part after the other.
pub(crate) type Taker<'a> = &'a mut (dyn FnMut(&mut Image) -> Result<(), RenderError> + Send);

/// Bytes that [`paint`] takes for a picture of this size with smooth edges, besides the model: the picture,
/// a band of hits, edges if a quarter of it is silhouette; and a stack for each thread.
pub(crate) fn paint_bytes(width: u32, height: u32, threads: usize) -> u64 {
    let pixels = u64::from(width) * u64::from(height);
    let band = pixels.next_multiple_of(TILE_PIXELS as u64).min(BAND_PIXELS as u64 + 4096 * u64::from(width));
    4 * pixels + band * size_of::<PixelHit>() as u64 + 2 * pixels + ((threads as u64) << 17)
}

/// Bytes that [`paint_parts`] takes for such a picture, besides the model and the program: the fewest, in bands of 8 rows.
pub(crate) fn parts_bytes(canvas: &Canvas) -> u64 {
    let row = u64::from(canvas.width).next_multiple_of(TILE as u64);
    let rows = (canvas.band_pixels() as u64 / (row * TILE as u64)).max(1) * TILE as u64;
    let rows = rows.min(u64::from(canvas.height).next_multiple_of(TILE as u64));
    let layers = 4
        + if canvas.depth_range_mm.is_some() { 2 } else { 0 }
        + if canvas.normals { 3 } else { 0 }
        + if canvas.ids { 6 } else { 0 }
        + if canvas.ambient_rays > 0 { 1 } else { 0 };
    rows * row * (2 * layers + size_of::<PixelHit>() as u64) + ((canvas.threads.max(1) as u64) << 18)
}

/// Paints a model as a camera sees it.
///
/// Memory: the image, 4 MiB for hits, with smooth edges 8 bytes a pixel of the silhouette, and with ambient occlusion a
/// byte a pixel.
///
/// # Errors
/// [`RenderError`] when the size is not possible or the threads do not start, and for discrete rays in a model of cells.
pub fn paint(
    view: &ModelView<'_>,
    space: &GridSpace,
    camera: &Camera,
    canvas: Canvas,
) -> Result<(Image, Counts), RenderError> {
    paint_watched(view, space, camera, canvas, Watch { rows_done: &|_| {}, between: &|| {} })
}

/// [`paint`] with progress. With ambient occlusion all rows are done twice.
pub(crate) fn paint_watched(
    view: &ModelView<'_>,
    space: &GridSpace,
    camera: &Camera,
    canvas: Canvas,
    watch: Watch<'_>,
) -> Result<(Image, Counts), RenderError> {
    check_size(canvas.width, canvas.height)?;
    let mut whole = blank(&canvas, canvas.height);
    let counts = with_painter(view, space, camera, canvas, watch, Whole { image: &mut whole })?;
    Ok((whole, counts))
}

/// [`paint_watched`] in parts, some rows after the other: the picture is never held as a whole, unless its edges are
/// smooth. While `take` has one part the next is painted, where there are threads enough.
///
/// Memory: 4 MiB for hits or 8 rows of them, whichever is more, and two parts of 2^18 pixels or 8 rows, of all layers.
pub(crate) fn paint_parts(
    view: &ModelView<'_>,
    space: &GridSpace,
    camera: &Camera,
    canvas: Canvas,
    watch: Watch<'_>,
    take: Taker<'_>,
) -> Result<Counts, RenderError> {
    check_size(canvas.width, canvas.height)?;
    with_painter(view, space, camera, canvas, watch, Parts { take })?
}

/// Rows of a picture without anything in them.
fn blank(canvas: &Canvas, rows: u32) -> Image {
    let mut image = Image {
        width: canvas.width,
        height: 0,
        rgba: Vec::new(),
        depth: canvas.depth_range_mm.map(|_| Vec::new()),
        normals: canvas.normals.then(Vec::new),
        ids: canvas.ids.then(Vec::new),
    };
    image.clear(rows);
    image
}

/// The work of a painter.
trait Job {
    type Output: Send;

    fn run<S: Surface>(self, painter: Painter<'_, S>) -> Self::Output;
}

/// Paints the whole picture.
struct Whole<'a> {
    image: &'a mut Image,
}

impl Job for Whole<'_> {
    type Output = Counts;

    fn run<S: Surface>(self, mut painter: Painter<'_, S>) -> Counts {
        painter.paint(self.image, 0)
    }
}

/// Paints part after part, and hands each on while the next is painted.
struct Parts<'a> {
    take: Taker<'a>,
}

impl Job for Parts<'_> {
    type Output = Result<Counts, RenderError>;

    fn run<S: Surface>(self, mut painter: Painter<'_, S>) -> Self::Output {
        let Self { take } = self;
        let canvas = painter.canvas;
        let rows = if canvas.smooth_edges { canvas.height } else { painter.band_rows() };
        let mut counts = Counts::default();
        let [mut done, mut next] = [0, 1].map(|_| blank(&canvas, 0));
        for top in (0..canvas.height).step_by(rows as usize) {
            next.clear(rows.min(canvas.height - top));
            let (taken, own) = rayon::join(
                || if done.height > 0 { take(&mut done) } else { Ok(()) },
                || painter.paint(&mut next, top as usize),
            );
            taken?;
            counts = counts.plus(own);
            std::mem::swap(&mut done, &mut next);
        }
        take(&mut done)?;
        Ok(counts)
    }
}

/// Makes a painter, and has it work in a pool of its own.
fn with_painter<J: Job + Send>(
    view: &ModelView<'_>,
    space: &GridSpace,
    camera: &Camera,
    canvas: Canvas,
    watch: Watch<'_>,
    job: J,
) -> Result<J::Output, RenderError> {
    let sight = Sight::new(space, camera, canvas.width, canvas.height);
    let cells = view.cells().map(Cells::new);
    let discrete = (canvas.traversal == Traversal::Discrete)
        .then(|| DiscreteRays::new(sight, canvas.width, canvas.height));
    if discrete.is_some() && cells.is_some() {
        return Err(RenderFault::DiscreteCells.into());
    }
    let pool = pool(canvas.threads)?;
    let painter = Painter {
        view,
        surface: Skin,
        normals: Normals::new(view, space, canvas.blended, canvas.lod_edge_log2),
        sight,
        discrete,
        form: Form::best(),
        canvas,
        shader: Shader::new(),
        open: Openness::default(),
        watch,
    };
    Ok(match cells.filter(|_| canvas.lod_edge_log2 == 0 || view.has_leaves()) {
        Some(cells) => pool.install(|| job.run(painter.on(cells))),
        // Coarse boxes are solid, also those of cells, but for larger leaves among them.
        None => pool.install(|| job.run(painter)),
    })
}

impl<'a> Painter<'a, Skin> {
    /// The same for another surface within the boxes.
    fn on<S>(self, surface: S) -> Painter<'a, S> {
        let Self { view, surface: Skin, normals, sight, discrete, form, canvas, shader, open, watch } = self;
        Painter { view, surface, normals, sight, discrete, form, canvas, shader, open, watch }
    }
}

impl<S: Surface> Painter<'_, S> {
    /// Rows that are traced between two passes of shading.
    fn band_rows(&self) -> u32 {
        let row = (self.canvas.width as usize).div_ceil(TILE) * TILE_PIXELS;
        #[expect(clippy::cast_possible_truncation, reason = "at most the picture's rows")]
        let rows = ((self.canvas.band_pixels() / row).max(1) * TILE) as u32;
        rows.min(self.canvas.height)
    }

    /// Paints the rows of the picture from `from` on that `image` holds, which is blank.
    fn paint(&mut self, image: &mut Image, from: usize) -> Counts {
        let rows_done = self.watch.rows_done;
        let rows = image.height as usize;
        let ambient = self.look_around(from, rows);
        let width = self.canvas.width as usize;
        let band_rows = self.band_rows() as usize;
        let mut counts = Counts::default();
        let tiles_across = width.div_ceil(TILE);
        let mut seen = vec![PixelHit::NOTHING; band_rows.div_ceil(TILE) * tiles_across * TILE_PIXELS];
        for top in (0..rows).step_by(band_rows) {
            let rows = band_rows.min(rows - top);
            let used = rows.div_ceil(TILE) * tiles_across * TILE_PIXELS;
            let band = seen.get_mut(..used).unwrap_or_default();
            counts = counts.plus(self.trace_band(band, from + top, rows));
            counts.shade += self.shade_band(band, image, from, top, rows);
            #[expect(clippy::cast_possible_truncation, reason = "at most the picture's rows")]
            rows_done(rows as u32);
        }
        if self.canvas.smooth_edges {
            counts = counts.plus(self.smooth_edges(image));
        }
        Counts { ambient, ..counts }
    }

    /// Traces the rays of `rows` rows from `top` on; `seen` is filled tile after tile.
    fn trace_band(&self, seen: &mut [PixelHit], top: usize, rows: usize) -> Counts {
        let start = Instant::now();
        let width = self.canvas.width as usize;
        let tiles_across = width.div_ceil(TILE);
        let begin = || Tracer::new(self.form);
        let mut counts = seen
            .par_chunks_mut(TILE_PIXELS)
            .enumerate()
            .map_init(begin, |tracer, (tile, seen)| {
                let (left, above) = (tile % tiles_across * TILE, tile / tiles_across * TILE);
                let limits = (width.saturating_sub(left), rows.saturating_sub(above));
                let lod_edge_log2 = self.canvas.lod_edge_log2;
                let tile = Tile { corner: (left, top + above), limits, lod_edge_log2 };
                let counts = self.trace_tile(tracer, seen, tile);
                self.watch.step();
                counts
            })
            .reduce(Counts::default, Counts::plus);
        counts.trace = start.elapsed();
        counts
    }

    /// Traces the rays of a tile that lie in the picture: here a tile's pixels are decided.
    fn trace_tile(&self, tracer: &mut Tracer, seen: &mut [PixelHit], tile: Tile) -> Counts {
        let rays = tile.live();
        let mut counts = Counts::default();
        if let Some(discrete) = &self.discrete {
            discrete.trace_tile(self.view, tile, rays, |ray, trace| {
                counts = counts.add(&trace);
                if let Some(pixel) = seen.get_mut(ray) {
                    *pixel = PixelHit::new(&trace);
                }
            });
            return counts;
        }
        let hits = tracer.trace_some(self.view, &self.surface, &self.sight, tile, rays);
        let corner = tile.corner;
        for (ray, pixel) in seen.iter_mut().enumerate() {
            if rays >> (ray % TILE_PIXELS) & 1 == 1 {
                let trace = Trace { hit: hits.hit(ray), steps: hits.steps(ray) };
                counts = counts.add(&trace);
                let (x, y) = ((corner.0 + ray % TILE) as f64 + 0.5, (corner.1 + ray / TILE) as f64 + 0.5);
                *pixel = self.seen(&trace, x, y);
            }
        }
        counts
    }

    /// Pixels whose neighbour is on the other side of the silhouette get the mean of four more rays.
    fn smooth_edges(&self, image: &mut Image) -> Counts {
        let start = Instant::now();
        let (width, height) = (self.canvas.width as usize, self.canvas.height as usize);
        let rgba = &image.rgba;
        let solid = |x: usize, y: usize| rgba.get((y * width + x) * 4 + 3).is_some_and(|a| *a > 0);
        // Both lists are 4 bytes a pixel of the silhouette; a picture has fewer than 2^32 pixels.
        let edges: Vec<u32> = (0..u32::try_from(width * height).unwrap_or(u32::MAX))
            .into_par_iter()
            .filter(|i| {
                let i = *i as usize;
                let (x, y) = (i % width, i / width);
                let here = solid(x, y);
                (x > 0 && solid(x - 1, y) != here)
                    || (x + 1 < width && solid(x + 1, y) != here)
                    || (y > 0 && solid(x, y - 1) != here)
                    || (y + 1 < height && solid(x, y + 1) != here)
            })
            .collect();
        let mut pixels = vec![[0_u8; 4]; edges.len()];
        let mut counts = edges
            .par_iter()
            .zip(&mut pixels)
            .map_init(Surroundings::new, |around, (i, pixel)| {
                let i = *i as usize;
                let (x, y) = ((i % width) as f64, (i / width) as f64);
                let mut counts = Counts::default();
                let mut sum = [0.0; 3];
                let mut hits = 0_u16;
                for (dx, dy) in [(0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75)] {
                    let trace = self.trace(x + dx, y + dy);
                    counts = counts.add(&trace);
                    let seen = self.seen(&trace, x + dx, y + dy);
                    if seen.is_hit() {
                        hits += 1;
                        let line = self.sight.line(x + dx, y + dy);
                        let normal = self.normals.normal(around, seen, line);
                        let light = self.light(seen, normal, line, [i % width, i / width]);
                        sum = std::array::from_fn(|c| sum[c] + light[c]);
                    }
                }
                self.watch.step();
                // Straight alpha: colour is the mean of what was hit, alpha its share.
                let [r, g, b] = sum.map(|c| self.shader.encode(c / f64::from(hits.max(1))));
                let alpha = [0, 64, 128, 191, 255][usize::from(hits)];
                *pixel = if hits == 0 { [0; 4] } else { [r, g, b, alpha] };
                counts
            })
            .reduce(Counts::default, Counts::plus);
        for (i, pixel) in edges.into_iter().zip(pixels) {
            let at = i as usize * 4;
            if let Some(out) = image.rgba.get_mut(at..at + 4) {
                out.copy_from_slice(&pixel);
            }
        }
        counts.trace = start.elapsed();
        counts
    }

    /// Traces the ray through a point of the picture alone.
    fn trace(&self, x: f64, y: f64) -> Trace {
        if let Some(discrete) = &self.discrete {
            return discrete.trace(self.view, x, y, self.canvas.lod_edge_log2);
        }
        let ray = self.sight.ray(x, y);
        let alone = |ray| single::trace(self.form, self.view, &self.surface, &ray, self.canvas.lod_edge_log2);
        ray.map_or(Trace { hit: None, steps: 0 }, alone)
    }

    /// The hit at a point of the picture.
    #[inline]
    pub(super) fn seen(&self, trace: &Trace, x: f64, y: f64) -> PixelHit {
        self.normals.seen(trace, || self.sight.line(x, y))
    }
}
