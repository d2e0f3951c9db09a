//! From a camera to pixels: rays in tiles over a private pool of threads.
//!
//! A pixel depends on its own ray only and is written to its own place, so a picture has the same bytes at
//! any number of threads.

use std::time::{Duration, Instant};

use rayon::prelude::*;

use crate::format::normal;
use crate::geom::{BoxIndex, NodeIndex};
use crate::load::NodeView;

use super::blend;
use super::cells::Cells;
use super::facing;
use super::form::Form;
use super::image::Image;
use super::ray::Face;
use super::shade::Shader;
use super::sight::Sight;
use super::single;
use super::space::GridSpace;
use super::surface::{Skin, Surface};
use super::tile::{RAYS as TILE_PIXELS, TILE, Tile, Tracer};
use super::traverse::{Hit, Trace};
use super::{Camera, RenderError};

/// Pixels traced between two shading passes; bounds the memory for hits to 4 MiB, or a row of tiles.
const BAND_PIXELS: usize = 1 << 18;

/// Stack of a worker; nothing here recurses.
const WORKER_STACK_BYTES: usize = 4 << 20;

/// Longest side and most pixels of a picture.
const MAX_SIDE: u32 = 32_768;
const MAX_PIXELS: u64 = 1 << 28;

/// What to paint besides the camera.
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
    /// Are normals blended between the boxes around a hit?
    pub blended: bool,
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
}

impl Counts {
    fn add(mut self, trace: &Trace) -> Self {
        self.rays += 1;
        self.hits += u64::from(trace.hit.is_some());
        self.steps += u64::from(trace.steps);
        self.max_steps = self.max_steps.max(trace.steps);
        self
    }

    fn plus(mut self, other: Self) -> Self {
        self.rays += other.rays;
        self.hits += other.hits;
        self.steps += other.steps;
        self.max_steps = self.max_steps.max(other.max_steps);
        self.trace += other.trace;
        self.shade += other.shade;
        self
    }
}

/// A pixel's hit in 16 bytes.
#[derive(Clone, Copy)]
struct Seen {
    box_number: u64,
    /// Depth in mm; NaN for background.
    depth: f32,
    /// Axis and side of the face, or [`Seen::NO_FACE`].
    face: u8,
    kind: SeenKind,
    /// The normal's code, where it is not that of the box.
    code: u16,
}

/// Where the normal of a hit comes from.
#[derive(Clone, Copy, PartialEq, Eq)]
enum SeenKind {
    Voxel,
    Node,
    /// The hit itself: of a cell with corners, whose normal is not the same everywhere.
    Own,
}

impl Seen {
    const NO_FACE: u8 = u8::MAX;
    const NOTHING: Self =
        Self { box_number: 0, depth: f32::NAN, face: Self::NO_FACE, kind: SeenKind::Node, code: 0 };

    #[expect(clippy::cast_possible_truncation, reason = "a depth image has 16 bits")]
    fn new(trace: &Trace) -> Self {
        trace.hit.map_or(Self::NOTHING, |hit| Self {
            box_number: hit.box_number,
            depth: (hit.t as f32).min(f32::MAX),
            face: hit.face.map_or(Self::NO_FACE, |f| 2 * f.axis + u8::from(f.high)),
            kind: if hit.edge_log2 == 0 { SeenKind::Voxel } else { SeenKind::Node },
            code: 0,
        })
    }

    fn is_hit(self) -> bool {
        !self.depth.is_nan()
    }

    fn face(self) -> Option<Face> {
        (self.face != Self::NO_FACE).then(|| Face::new(usize::from(self.face / 2), self.face % 2 == 1))
    }
}

/// Checks a picture's size.
///
/// # Errors
/// [`RenderError::Size`] for no pixels or too many.
pub fn check_size(width: u32, height: u32) -> Result<(), RenderError> {
    let pixels = u64::from(width) * u64::from(height);
    if width == 0 || height == 0 || width > MAX_SIDE || height > MAX_SIDE || pixels > MAX_PIXELS {
        return Err(RenderError::Size { width, height, most_side: MAX_SIDE, most_pixels: MAX_PIXELS });
    }
    Ok(())
}

/// A private pool of this many workers with small stacks; the process-wide pool is never used.
///
/// # Errors
/// [`RenderError::Threads`] when the system does not start that many.
pub fn pool(threads: usize) -> Result<rayon::ThreadPool, RenderError> {
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads.max(1))
        .stack_size(WORKER_STACK_BYTES)
        .build()
        .map_err(|cause| RenderError::Threads { threads, cause: std::io::Error::other(cause) })
}

/// A world point in the coordinates of a cell, -1..=1.
pub(super) fn cell_coordinates(space: &GridSpace, cell: [u32; 3], world: [f64; 3]) -> [f64; 3] {
    let at = space.to_grid(world);
    std::array::from_fn(|a| (2.0 * (at[a] - f64::from(cell[a])) - 1.0).clamp(-1.0, 1.0))
}

/// Row `y` of a band whose hits stand tile after tile.
fn row_of(seen: &[Seen], width: usize, y: usize) -> impl Iterator<Item = Seen> {
    let first = y / TILE * width.div_ceil(TILE) * TILE_PIXELS + y % TILE * TILE;
    (0..width)
        .map(move |x| seen.get(first + x / TILE * TILE_PIXELS + x % TILE).copied().unwrap_or(Seen::NOTHING))
}

/// Everything that a pixel's worker reads.
struct Painter<'a, V, S> {
    view: &'a V,
    surface: S,
    /// The cells, if the model has them: normals are of index space then.
    cells: Option<Cells<'a>>,
    sight: Sight<'a>,
    form: Form,
    canvas: Canvas,
    shader: Shader,
}

/// Bytes that [`paint`] takes for a picture of this size with smooth edges, beside the model: the picture,
/// a band of hits, edges if a quarter of it is silhouette; and a stack for each thread.
pub fn paint_bytes(width: u32, height: u32, threads: usize) -> u64 {
    let pixels = u64::from(width) * u64::from(height);
    let band = pixels.next_multiple_of(TILE_PIXELS as u64).min(BAND_PIXELS as u64 + 4096 * u64::from(width));
    4 * pixels + band * size_of::<Seen>() as u64 + 2 * pixels + ((threads as u64) << 17)
}

/// Paints a model as a camera sees it.
///
/// Memory: the image, 4 MiB for hits, and with smooth edges 8 bytes a pixel of the silhouette.
///
/// # Errors
/// [`RenderError::Size`] when the size is not possible, [`RenderError::Threads`] when the threads do not start.
pub fn paint<V: NodeView>(
    view: &V,
    space: &GridSpace,
    camera: &Camera,
    canvas: Canvas,
) -> Result<(Image, Counts), RenderError> {
    paint_watched(view, space, camera, canvas, &|_| {})
}

/// As [`paint`]; `rows_done` is told each time how many more rows are painted.
///
/// # Errors
/// As [`paint`].
pub fn paint_watched<V: NodeView>(
    view: &V,
    space: &GridSpace,
    camera: &Camera,
    canvas: Canvas,
    rows_done: &(dyn Fn(u32) + Sync),
) -> Result<(Image, Counts), RenderError> {
    check_size(canvas.width, canvas.height)?;
    let sight = Sight::new(space, camera, canvas.width, canvas.height);
    let cells = view.cells().map(Cells::new);
    let (form, shader) = (Form::best(), Shader::new());
    let pool = pool(canvas.threads)?;
    Ok(match cells.filter(|_| canvas.lod_edge_log2 == 0) {
        Some(surface) => {
            let painter = Painter { view, surface, cells, sight, form, canvas, shader };
            pool.install(|| painter.paint(rows_done))
        }
        // Coarse boxes are solid, whatever the finest are.
        None => {
            let painter = Painter { view, surface: Skin, cells, sight, form, canvas, shader };
            pool.install(|| painter.paint(rows_done))
        }
    })
}

impl<V: NodeView, S: Surface<V>> Painter<'_, V, S> {
    fn paint(&self, rows_done: &(dyn Fn(u32) + Sync)) -> (Image, Counts) {
        let (width, height) = (self.canvas.width as usize, self.canvas.height as usize);
        let mut image = Image {
            width: self.canvas.width,
            height: self.canvas.height,
            rgba: vec![0; width * height * 4],
            depth: self.canvas.depth_range_mm.map(|_| vec![0; width * height]),
            normals: self.canvas.normals.then(|| vec![0; width * height * 3]),
        };
        let tiles_across = width.div_ceil(TILE);
        let tile_rows = (BAND_PIXELS / (tiles_across * TILE_PIXELS)).clamp(1, height.div_ceil(TILE));
        let mut seen = vec![Seen::NOTHING; tile_rows * tiles_across * TILE_PIXELS];
        let mut counts = Counts::default();
        let mut top = 0;
        while top < height {
            let rows = (tile_rows * TILE).min(height - top);
            let used = rows.div_ceil(TILE) * tiles_across * TILE_PIXELS;
            let band = seen.get_mut(..used).unwrap_or_default();
            counts = counts.plus(self.trace_band(band, top, rows));
            counts.shade += self.shade_band(band, &mut image, top, rows);
            top += rows;
            #[expect(clippy::cast_possible_truncation, reason = "at most the picture's rows")]
            rows_done(rows as u32);
        }
        if self.canvas.smooth_edges {
            counts = counts.plus(self.smooth_edges(&mut image));
        }
        (image, counts)
    }

    /// Traces the rays of `rows` rows from `top` on; `seen` is filled tile after tile.
    fn trace_band(&self, seen: &mut [Seen], top: usize, rows: usize) -> Counts {
        let start = Instant::now();
        let width = self.canvas.width as usize;
        let tiles_across = width.div_ceil(TILE);
        let mut counts = seen
            .par_chunks_mut(TILE_PIXELS)
            .enumerate()
            .map_init(
                || Tracer::new(self.form),
                |tracer, (tile, seen)| {
                    let (left, above) = (tile % tiles_across * TILE, tile / tiles_across * TILE);
                    let limits = (width.saturating_sub(left), rows.saturating_sub(above));
                    self.trace_tile(tracer, seen, (left, top + above), limits)
                },
            )
            .reduce(Counts::default, Counts::plus);
        counts.trace = start.elapsed();
        counts
    }

    /// Traces one tile; `limits` are its columns and rows that lie in the picture.
    fn trace_tile(
        &self,
        tracer: &mut Tracer,
        seen: &mut [Seen],
        corner: (usize, usize),
        limits: (usize, usize),
    ) -> Counts {
        let tile = Tile { corner, limits, lod_edge_log2: self.canvas.lod_edge_log2 };
        let hits = tracer.trace(self.view, &self.surface, &self.sight, tile);
        let mut counts = Counts::default();
        for (ray, pixel) in seen.iter_mut().enumerate() {
            if ray % TILE < limits.0 && ray / TILE < limits.1 {
                let trace = Trace { hit: hits.hit(ray), steps: hits.steps(ray) };
                counts = counts.add(&trace);
                let (x, y) = ((corner.0 + ray % TILE) as f64 + 0.5, (corner.1 + ray / TILE) as f64 + 0.5);
                *pixel = self.seen(&trace, x, y);
            }
        }
        counts
    }

    /// Colours the rows of a traced band.
    fn shade_band(&self, seen: &[Seen], image: &mut Image, top: usize, rows: usize) -> Duration {
        let start = Instant::now();
        let width = self.canvas.width as usize;
        image.rgba.par_chunks_mut(width * 4).skip(top).take(rows).enumerate().for_each(|(y, row)| {
            let (out, _) = row.as_chunks_mut::<4>();
            let mut last = None;
            for (x, (pixel, out)) in row_of(seen, width, y).zip(out).enumerate() {
                if pixel.is_hit() {
                    let line = self.sight.line(x as f64 + 0.5, (top + y) as f64 + 0.5);
                    let light = self.shader.light(self.normal_after(&mut last, pixel, line), line.1);
                    let [r, g, b] = light.map(|c| self.shader.encode(c));
                    *out = [r, g, b, 255];
                }
            }
        });
        if let (Some(depth), Some((near, far))) = (&mut image.depth, self.canvas.depth_range_mm) {
            let scale = if far > near { 65_534.0 / (far - near) } else { 0.0 };
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
            let code = |d: f32| 1 + ((f64::from(d) - near) * scale + 0.5).clamp(0.0, 65_534.0) as u16;
            depth.par_chunks_mut(width).skip(top).take(rows).enumerate().for_each(|(y, row)| {
                for (pixel, out) in row_of(seen, width, y).zip(row) {
                    *out = if pixel.is_hit() { code(pixel.depth) } else { 0 };
                }
            });
        }
        if let Some(normals) = &mut image.normals {
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
            let code = |c: f64| (128.5 + c * 127.0).clamp(1.0, 255.0) as u8;
            normals.par_chunks_mut(width * 3).skip(top).take(rows).enumerate().for_each(|(y, row)| {
                let (out, _) = row.as_chunks_mut::<3>();
                let mut last = None;
                for (x, (pixel, out)) in row_of(seen, width, y).zip(out).enumerate() {
                    if pixel.is_hit() {
                        let line = self.sight.line(x as f64 + 0.5, (top + y) as f64 + 0.5);
                        *out = self.normal_after(&mut last, pixel, line).map(code);
                    }
                }
            });
        }
        start.elapsed()
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
            .map(|(i, pixel)| {
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
                        let light = self.light(seen, self.sight.line(x + dx, y + dy));
                        sum = std::array::from_fn(|c| sum[c] + light[c]);
                    }
                }
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
        let ray = self.sight.ray(x, y);
        let alone = |ray| single::trace(self.form, self.view, &self.surface, &ray, self.canvas.lod_edge_log2);
        ray.map_or(Trace { hit: None, steps: 0 }, alone)
    }

    /// What was seen through a point of the picture.
    #[inline]
    fn seen(&self, trace: &Trace, x: f64, y: f64) -> Seen {
        let mut seen = Seen::new(trace);
        if let (Some(cells), Some(hit)) = (&self.cells, &trace.hit)
            && seen.kind == SeenKind::Voxel
            && cells.has_corners(hit.box_number.wrapping_sub(self.view.node_count()))
        {
            (seen.kind, seen.code) = (SeenKind::Own, self.corner_normal(cells, hit, x, y));
        }
        seen
    }

    /// Code of the normal where a cell with corners was hit.
    #[cold]
    #[expect(clippy::cast_possible_truncation, reason = "a direction in single precision")]
    fn corner_normal(&self, cells: &Cells<'_>, hit: &Hit, x: f64, y: f64) -> u16 {
        let (origin, direction) = self.sight.line(x, y);
        let at = std::array::from_fn(|i| origin[i] + hit.t * direction[i]);
        let number = hit.box_number.wrapping_sub(self.view.node_count());
        let u = cell_coordinates(self.sight.space(), hit.cell, at);
        normal::encode(cells.normal(number, u).map(|c| c as f32))
    }

    fn light(&self, seen: Seen, line: Line) -> [f64; 3] {
        self.shader.light(self.normal(seen, line), line.1)
    }

    /// A normal of the hit's box, blended with those of the boxes around where that is wanted.
    #[inline]
    fn blended(&self, seen: Seen, (origin, sight): Line, own: [f64; 3]) -> [f64; 3] {
        if !self.canvas.blended || seen.kind == SeenKind::Node {
            return own;
        }
        let world = super::space::add_scaled(origin, f64::from(seen.depth), sight);
        blend::blended(self.view, self.sight.space().to_grid(world), own)
    }

    /// As [`Painter::normal`], for pixels of one row from left to right: those of one face have one normal.
    #[inline]
    fn normal_after(&self, last: &mut Option<(u64, u8, [f64; 3])>, seen: Seen, line: Line) -> [f64; 3] {
        match last {
            Some((number, face, normal))
                if (*number, *face) == (seen.box_number, seen.face) && !self.canvas.blended =>
            {
                *normal
            }
            _ => {
                let normal = self.normal(seen, line);
                // Without a face it may depend on the line of sight.
                *last = (seen.face != Seen::NO_FACE).then_some((seen.box_number, seen.face, normal));
                normal
            }
        }
    }

    /// World normal: the stored one unless the skin around contradicts it, else that of the face, else towards
    /// the eye. The plane of a cell is the surface itself; nothing contradicts it.
    fn normal(&self, seen: Seen, line: Line) -> [f64; 3] {
        let box_frame = match (self.stored(seen, 0), seen.face()) {
            (Some(stored), _) if self.cells.is_some() => {
                let own = self.blended(seen, line, stored.map(f64::from));
                return self.sight.space().index_normal_to_world(own);
            }
            (Some(stored), Some(face)) => {
                let own = self.facing(seen, face, line, stored).unwrap_or(stored.map(f64::from));
                self.blended(seen, line, own)
            }
            (Some(stored), None) => self.blended(seen, line, stored.map(f64::from)),
            (None, Some(face)) => {
                let mut n = [0.0; 3];
                n[usize::from(face.axis % 3)] = if face.high { 1.0 } else { -1.0 };
                n
            }
            (None, None) => {
                let sight = line.1;
                let length = super::space::dot(sight, sight).sqrt();
                return sight.map(|c| -c / length);
            }
        };
        self.sight.space().normal_to_world(box_frame)
    }

    /// The normal stored for the box so far behind the one that was hit in the order of the file, in the frame of
    /// the box, its parts' sizes adding up to 127.
    #[inline]
    fn stored(&self, seen: Seen, distance: i64) -> Option<[i32; 3]> {
        let number = seen.box_number.wrapping_add_signed(distance);
        let code = match seen.kind {
            SeenKind::Voxel => self.view.voxel_normal(BoxIndex::new(number).voxel(self.view.node_count())),
            SeenKind::Node => self.view.node_normal(NodeIndex::new(number)),
            SeenKind::Own => Some(seen.code),
        };
        code.map(normal::decode_l1)
    }

    /// A stored normal in the frame of the box, turned to the side that is seen; `None` where it stays.
    #[inline]
    fn facing(&self, seen: Seen, face: Face, (origin, sight): Line, stored: [i32; 3]) -> Option<[f64; 3]> {
        let space = self.sight.space();
        // In voxels instead of millimetres: a normal's components grow with the spacing.
        let spacing = space.spacing_mm();
        let scale = |n: [i32; 3]| -> [f64; 3] { std::array::from_fn(|a| f64::from(n[a]) * spacing[a]) };
        let in_voxels = scale(stored);
        let edge_log2 = if seen.kind == SeenKind::Voxel { 0 } else { self.canvas.lod_edge_log2 };
        let struck = || {
            let world = super::space::add_scaled(origin, f64::from(seen.depth), sight);
            let edge = f64::from(1_u32 << edge_log2.min(31));
            let at = space.world_to_grid().apply(world).map(|c| c / edge);
            facing::Struck { number: seen.box_number, at, edge_log2, face }
        };
        let company = facing::company(in_voxels, |distance| self.stored(seen, distance).map(scale));
        let shown = facing::shown(self.view, face, struck, in_voxels, company)?;
        Some(std::array::from_fn(|a| shown[a] / spacing[a]))
    }
}

/// Line of sight in the world: origin and direction.
type Line = ([f64; 3], [f64; 3]);
