//! From a camera to pixels: rays in tiles over a private pool of threads.
//!
//! What a pixel sees depends on its own ray only, and its colour on what the pixels around see, in one order; so a picture
//! has the same bytes at any number of threads, in bands of any height.

use std::time::Duration;

use crate::load::{ModelView, NodeView};
use crate::render::RenderFault;

use super::ambient::Sky;
use super::band::Band;
use super::cells::Cells;
use super::choices::PLACES;
use super::discrete::DiscreteRays;
use super::form::Form;
use super::image::Image;
use super::normals::shown::{Normals, PixelHit};
use super::shade::{Light, Shader};
use super::sight::Sight;
use super::soften::StepSize;
use super::space::GridSpace;
use super::surface::{Skin, Surface};
use super::tile::{RAYS as TILE_PIXELS, TILE, Tile, Tracer};
use super::traverse::{Hit, Trace};
use super::{Camera, RenderError, Samples, Shading, Smoothing};

/// Pixels traced and coloured together: bounds the memory for what they see to 4 MiB, or three rows of tiles.
const BAND_PIXELS: usize = 1 << 17;

/// Rows of tiles that are kept from one band to the next.
const KEPT_ROWS: usize = 2;

/// Rays of a pixel for soft light and for ambient occlusion, where that is not said; a mean over the pixels around makes
/// them some sixteen times as many.
const SOFT_RAYS: u32 = 1;
const AO_RAYS: u32 = 4;

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
    /// Rays of a pixel's colours.
    pub samples: Samples,
    /// Have creases more rays, too, where samples are `Auto`? Silhouettes always have.
    pub creases: bool,
    /// The light.
    pub shading: Shading,
    /// Colour (sRGB) of a model without colours; `None` for that of bone.
    pub color: Option<[u8; 3]>,
    /// The normals that are shown.
    pub smoothing: Smoothing,
    /// Depth range in mm for a depth image, if one is wanted.
    pub depth_range_mm: Option<(f64, f64)>,
    /// Is a normal image wanted?
    pub normals: bool,
    /// Is an image of the numbers of boxes wanted?
    pub ids: bool,
    /// Rays of each pixel that measure how open its surroundings are; 0 for the shading's own number. Plain light has none.
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
    /// Wall time of looking around.
    pub ambient: Duration,
    /// Rays that looked around.
    pub ambient_rays: u64,
    /// Pixels of several rays.
    pub refined: u64,
}

impl Canvas {
    /// Pixels that are traced and coloured together, unless 8 rows are more.
    fn band_pixels(&self) -> usize {
        self.most_band_pixels.map_or(BAND_PIXELS, |most| BAND_PIXELS.min(most as usize))
    }
}

impl Counts {
    pub(super) fn add(mut self, trace: &Trace) -> Self {
        self.rays += 1;
        self.hits += u64::from(trace.hit.is_some());
        self.steps += u64::from(trace.steps);
        self.max_steps = self.max_steps.max(trace.steps);
        self
    }

    pub(super) fn plus(mut self, other: Self) -> Self {
        add_counts!(self, other: rays, hits, steps, trace, shade, ambient, ambient_rays, refined);
        self.max_steps = self.max_steps.max(other.max_steps);
        self
    }

    /// The times of all threads as parts of the time that passed.
    pub(super) fn within(mut self, wall: Duration) -> Self {
        let all = (self.trace + self.shade + self.ambient).as_secs_f64();
        if all > 0.0 {
            for part in [&mut self.trace, &mut self.shade, &mut self.ambient] {
                *part = wall.mul_f64(part.as_secs_f64() / all);
            }
        }
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
pub(crate) fn pool(threads: usize) -> Result<rayon::ThreadPool, RenderError> {
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
    pub(super) light: Light,
    /// Where rays that look around go, if there are such.
    pub(super) sky: Option<Sky>,
    /// The lines through [`PLACES`] times [`PLACES`] places of each pixel.
    pub(super) places: Sight<'a>,
    pub(super) step: StepSize,
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

/// Takes a picture from the top, a part after the other.
pub(crate) type Taker<'a> = &'a mut (dyn FnMut(&mut Image) -> Result<(), RenderError> + Send);

/// Memory of a worker.
const WORKER_BYTES: u64 = 3 << 17;

/// Bytes that [`paint`] takes for a picture of this size, besides the model: the picture, a band, two parts of its rows, and
/// the threads.
pub(crate) fn paint_bytes(width: u32, height: u32, threads: usize) -> u64 {
    let (width, height) = (u64::from(width).next_multiple_of(TILE as u64), u64::from(height));
    let rows = (BAND_PIXELS as u64 / width).max(TILE as u64).min(height.next_multiple_of(TILE as u64));
    let kept = (KEPT_ROWS * TILE) as u64;
    4 * width * height
        + width * ((rows + kept) * Band::PIXEL_BYTES + 8 * rows)
        + threads as u64 * WORKER_BYTES
}

/// Bytes that [`paint_parts`] takes for such a picture, besides the model and the program: the fewest, in bands of 8 rows.
pub(crate) fn parts_bytes(canvas: &Canvas) -> u64 {
    let row = u64::from(canvas.width).next_multiple_of(TILE as u64);
    let rows = (canvas.band_pixels() as u64 / (row * TILE as u64)).max(1) * TILE as u64;
    let all = u64::from(canvas.height).next_multiple_of(TILE as u64);
    let layers = 4
        + if canvas.depth_range_mm.is_some() { 2 } else { 0 }
        + if canvas.normals { 3 } else { 0 }
        + if canvas.ids { 6 } else { 0 };
    let kept = (rows + (KEPT_ROWS * TILE) as u64).min(all);
    row * (rows.min(all) * 2 * layers + kept * Band::PIXEL_BYTES)
        + canvas.threads.max(1) as u64 * WORKER_BYTES
}

/// Paints a model as a camera sees it.
///
/// Memory: the image, 4 MiB for what rays see, and two parts of 2^17 pixels.
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

/// [`paint`] with progress.
pub(crate) fn paint_watched(
    view: &ModelView<'_>,
    space: &GridSpace,
    camera: &Camera,
    canvas: Canvas,
    watch: Watch<'_>,
) -> Result<(Image, Counts), RenderError> {
    check_size(canvas.width, canvas.height)?;
    let mut whole = blank(&canvas, 0);
    whole.reserve(canvas.height);
    let counts = paint_parts(view, space, camera, canvas, watch, &mut |part| {
        whole.append(part);
        Ok(())
    })?;
    Ok((whole, counts))
}

/// [`paint_watched`] in parts, some rows after the other: the picture is never held as a whole. While `take` has one part
/// the next is painted, where there are threads enough.
///
/// Memory: 4 MiB for what rays see or three rows of tiles, whichever is more, and two parts of 2^17 pixels or 8 rows, of
/// all layers.
pub(crate) fn paint_parts(
    view: &ModelView<'_>,
    space: &GridSpace,
    camera: &Camera,
    canvas: Canvas,
    watch: Watch<'_>,
    take: Taker<'_>,
) -> Result<Counts, RenderError> {
    check_size(canvas.width, canvas.height)?;
    let sight = Sight::new(space, camera, canvas.width, canvas.height);
    let places = u32::from(PLACES.to_le_bytes()[0]);
    let places = Sight::new(space, camera, canvas.width * places, canvas.height * places);
    let cells = view.cells().map(Cells::new);
    let discrete = (canvas.traversal == Traversal::Discrete)
        .then(|| DiscreteRays::new(sight, canvas.width, canvas.height));
    if discrete.is_some() && cells.is_some() {
        return Err(RenderFault::DiscreteCells.into());
    }
    let sky = match (canvas.shading, canvas.ambient_rays) {
        (Shading::Plain, _) => None,
        (Shading::Soft, 0) => Some(Sky::shared(SOFT_RAYS)),
        (Shading::Ao, 0) => Some(Sky::shared(AO_RAYS)),
        (_, rays) => Some(Sky::shared(rays)),
    };
    let pool = pool(canvas.threads)?;
    let painter = Painter {
        view,
        surface: Skin,
        normals: Normals::new(view, space, canvas.smoothing, canvas.lod_edge_log2),
        sight,
        discrete,
        form: Form::best(),
        canvas,
        shader: Shader::new(),
        light: Light::new(canvas.shading, camera.axes(), canvas.color),
        sky,
        places,
        step: step_size(space, camera, &canvas),
        watch,
    };
    match cells.filter(|_| canvas.lod_edge_log2 == 0 || view.has_leaves()) {
        Some(cells) => pool.install(|| painter.on(cells).paint(take)),
        // Coarse boxes are solid, also those of cells, but for larger leaves among them.
        None => pool.install(|| painter.paint(take)),
    }
}

/// What steps in depth are compared with.
#[expect(clippy::cast_possible_truncation, reason = "single precision will do")]
fn step_size(space: &GridSpace, camera: &Camera, canvas: &Canvas) -> StepSize {
    let [x, y, z] = space.spacing_mm();
    let voxel_mm = (x + y + z) / 3.0 * f64::from(1_u32 << canvas.lod_edge_log2.min(31));
    let [at_eye, at_one] = [0.0, 1.0].map(|depth| camera.pixel_mm(canvas.height, depth));
    let crease = if canvas.creases { StepSize::CREASE } else { StepSize::NO_CREASE };
    StepSize { voxel_mm: voxel_mm as f32, pixel_mm: [at_eye as f32, (at_one - at_eye) as f32], crease }
}

/// Rows of a picture without anything in them.
fn blank(canvas: &Canvas, rows: u32) -> Image {
    let layers = [canvas.depth_range_mm.is_some(), canvas.normals, canvas.ids];
    Image::blank([canvas.width, rows], layers)
}

impl<'a> Painter<'a, Skin> {
    /// The same for another surface within the boxes.
    fn on<S>(self, surface: S) -> Painter<'a, S> {
        let Self { view, surface: Skin, normals, sight, discrete, form, canvas, .. } = self;
        let Self { shader, light, sky, places, step, watch, .. } = self;
        Painter {
            view,
            surface,
            normals,
            sight,
            discrete,
            form,
            canvas,
            shader,
            light,
            sky,
            places,
            step,
            watch,
        }
    }
}

impl<S: Surface> Painter<'_, S> {
    /// Rows that are traced and coloured together.
    fn band_rows(&self) -> usize {
        let row = (self.canvas.width as usize).div_ceil(TILE) * TILE_PIXELS;
        (self.canvas.band_pixels() / row).max(1) * TILE
    }

    /// Paints the picture part after part, and hands each on while the next is painted.
    fn paint(&self, take: Taker<'_>) -> Result<Counts, RenderError> {
        let (width, height) = (self.canvas.width as usize, self.canvas.height as usize);
        let mut band = Band::new(width);
        let mut counts = Counts::default();
        let [mut done, mut next] = [0, 1].map(|_| blank(&self.canvas, 0));
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
                    counts.plus(self.shade(&band, &mut next, painted))
                },
            );
            taken?;
            counts = counts.plus(own);
            (traced, painted) = (traced + rows, end);
            band.forget_above(painted.saturating_sub(TILE) / TILE * TILE);
            (self.watch.rows_done)(parts);
            std::mem::swap(&mut done, &mut next);
        }
        take(&mut done)?;
        Ok(counts)
    }

    /// Traces the rays of a tile that lie in the picture: here a tile's pixels are decided.
    pub(super) fn trace_tile(
        &self,
        tracer: &mut Tracer,
        seen: &mut [PixelHit],
        struck: &mut [Option<Hit>; TILE_PIXELS],
        tile: Tile,
    ) -> Counts {
        let rays = tile.live();
        let mut counts = Counts::default();
        seen.fill(PixelHit::NOTHING);
        if let Some(discrete) = &self.discrete {
            discrete.trace_tile(self.view, tile, rays, |ray, trace| {
                counts = counts.add(&trace);
                struck[ray % TILE_PIXELS] = trace.hit;
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
                struck[ray % TILE_PIXELS] = trace.hit;
                let (x, y) = ((corner.0 + ray % TILE) as f64 + 0.5, (corner.1 + ray / TILE) as f64 + 0.5);
                *pixel = self.normals.seen(&trace, || self.sight.line(x, y));
            }
        }
        counts
    }
}
