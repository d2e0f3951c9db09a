//! From rays to the bytes of a band of a picture: hits, normals and openness tile by tile, then light.
//!
//! A pixel's hit, normal and own openness depend on its own ray; its colour on those of the pixels around, too. So colours
//! lag behind by a row of tiles, and two rows of tiles are kept from one band to the next. What a worker keeps from one
//! pixel to the next it forgets at each row of tiles.

use std::time::Instant;

use rayon::prelude::*;

use super::ambient::Lot;
use super::colors::{has_colors, label_of};
use super::form::Form;
use super::image::Image;
use super::normals::around::Surroundings;
use super::normals::repair::tile::{Doubts, Judge, Settle, Stored, Verdicts};
use super::normals::shown::{Line, PixelHit, towards_eye};
use super::picture::{Counts, Painter, depth_code, normal_code};
use super::shade::{Lit, TileLight};
use super::soften::{Patch, WIDE};
use super::surface::Surface;
use super::tile::{RAYS as TILE_PIXELS, TILE, Tile, Tracer};
use super::{Samples, Smoothing};
use crate::load::NodeView;

/// Pixels that saw something, each with its place.
fn hits_of<T>(
    out: impl Iterator<Item = T>,
    row: impl Iterator<Item = Option<(PixelHit, [f32; 3], u8)>>,
) -> impl Iterator<Item = (T, (PixelHit, [f32; 3], u8))> {
    out.zip(row).filter_map(|(out, seen)| Some((out, seen.filter(|(hit, ..)| hit.is_hit())?)))
}

/// A number in an image of them: the highest of 48 bits first.
#[expect(clippy::cast_possible_truncation, reason = "16 bits each")]
fn id_code(id: u64) -> [u16; 3] {
    [(id >> 32) as u16, (id >> 16) as u16, id as u16]
}

/// What the rays through the middles of some rows' pixels saw, tile after tile. Memory: 29 bytes a pixel.
///
/// Rows are added below, and forgotten above when nothing looks at them any more: a pixel's colour depends on those around
/// it, up to four rows away.
pub(super) struct Band {
    width: usize,
    tiles_across: usize,
    /// First row of the picture; a multiple of [`TILE`].
    first: usize,
    hits: Vec<PixelHit>,
    /// Unit normals of the world that are shown.
    normals: Vec<[f32; 3]>,
    /// How open the surroundings are, by each pixel's own rays.
    open: Vec<u8>,
}

impl Band {
    pub(super) fn new(width: usize) -> Self {
        let tiles_across = width.div_ceil(TILE);
        Self { width, tiles_across, first: 0, hits: Vec::new(), normals: Vec::new(), open: Vec::new() }
    }

    /// Bytes of a pixel.
    pub(super) const PIXEL_BYTES: u64 = (size_of::<PixelHit>() + size_of::<[f32; 3]>() + 1) as u64;

    fn row_pixels(&self) -> usize {
        self.tiles_across * TILE_PIXELS
    }

    #[inline]
    fn index(&self, x: usize, y: usize) -> Option<usize> {
        let row = y.checked_sub(self.first)?;
        let tile = row / TILE * self.tiles_across + x / TILE;
        (x < self.width).then_some(tile * TILE_PIXELS + row % TILE * TILE + x % TILE)
    }

    /// Hit, normal and openness of a pixel of the picture, if it lies here.
    #[inline]
    pub(super) fn at(&self, x: usize, y: usize) -> Option<(PixelHit, [f32; 3], u8)> {
        let at = self.index(x, y)?;
        Some((*self.hits.get(at)?, *self.normals.get(at)?, *self.open.get(at)?))
    }

    /// Forgets the rows above one, a multiple of [`TILE`].
    pub(super) fn forget_above(&mut self, row: usize) {
        let past = ((row - self.first) / TILE * self.row_pixels()).min(self.hits.len());
        self.hits.drain(..past);
        self.normals.drain(..past);
        self.open.drain(..past);
        self.first = row;
    }
}

/// The pixels of a tile that `wanted` names.
fn each(wanted: u64, seen: &[PixelHit]) -> impl Iterator<Item = (usize, PixelHit)> {
    let mut left = wanted;
    std::iter::from_fn(move || {
        let at = left.trailing_zeros() as usize;
        let pixel = *seen.get(at)?;
        left &= left - 1;
        Some((at, pixel))
    })
}

/// Base-2 logarithm of the normals that a worker keeps, and an odd number that scatters their keys.
const KEPT_BITS: u32 = 9;
const MIXER: u64 = 0x9e37_79b9_7f4a_7c15;

/// A normal that is known, or will be once the doubts of the tile are settled.
#[derive(Clone, Copy)]
enum Normal {
    /// In the frame of the boxes.
    Known([f64; 3]),
    /// The number of the doubt.
    Awaited(u8),
}

/// The memory of a worker, from one pixel to the next.
pub(super) struct WorkerState {
    pub(super) tracer: Tracer,
    pub(super) around: Surroundings,
    lot: Lot,
    stored: Stored,
    doubts: Doubts,
    /// Round, box and face, and the normal that is shown there.
    normals: Vec<(u32, u64, Normal)>,
    round: u32,
}

impl WorkerState {
    fn new(form: Form) -> Self {
        let nothing = (0, 0, Normal::Awaited(0));
        Self {
            tracer: Tracer::new(form),
            around: Surroundings::new(),
            lot: Lot::new(form),
            stored: Stored::NOTHING,
            doubts: Doubts::NOTHING,
            normals: vec![nothing; 1 << KEPT_BITS],
            round: 0,
        }
    }

    fn slot(seen: PixelHit) -> usize {
        (seen.key().wrapping_mul(MIXER) >> (u64::BITS - KEPT_BITS)) as usize
    }

    /// The normal of the face of a box, if it was found.
    #[inline]
    fn recall(&self, seen: PixelHit) -> Option<Normal> {
        let (round, key, normal) = self.normals.get(Self::slot(seen))?;
        ((*round, *key) == (self.round, seen.key())).then_some(*normal)
    }

    #[inline]
    fn keep(&mut self, seen: PixelHit, normal: Normal) {
        if let Some(place) = self.normals.get_mut(Self::slot(seen)) {
            *place = (self.round, seen.key(), normal);
        }
    }

    /// Begins a row of tiles without normals, so that the picture does not depend on who paints which.
    fn forget(&mut self) {
        self.round += 1;
    }
}

impl<S: Surface> Painter<'_, S> {
    /// Traces `rows` more rows of the picture, from `top` on: hits, normals and openness.
    pub(super) fn look(&self, band: &mut Band, top: usize, rows: usize) -> Counts {
        let start = Instant::now();
        let row_pixels = band.row_pixels();
        let before = band.hits.len();
        let all = before + rows.div_ceil(TILE) * row_pixels;
        band.hits.resize(all, PixelHit::NOTHING);
        band.normals.resize(all, [0.0; 3]);
        band.open.resize(all, u8::MAX);
        let (_, hits) = band.hits.split_at_mut(before);
        let (_, normals) = band.normals.split_at_mut(before);
        let (_, open) = band.open.split_at_mut(before);
        let counts = hits
            .par_chunks_mut(row_pixels)
            .zip(normals.par_chunks_mut(row_pixels))
            .zip(open.par_chunks_mut(row_pixels))
            .enumerate()
            .map_init(
                || WorkerState::new(self.form),
                |kept, (row, ((hits, normals), open))| {
                    kept.forget();
                    let limit = (rows - row * TILE).min(TILE);
                    let mut counts = Counts::default();
                    let tiles = hits.chunks_mut(TILE_PIXELS).zip(normals.chunks_mut(TILE_PIXELS));
                    for (tile, ((hits, normals), open)) in tiles.zip(open.chunks_mut(TILE_PIXELS)).enumerate()
                    {
                        let corner = [tile * TILE, top + row * TILE];
                        counts = counts.plus(self.look_at(kept, corner, limit, (hits, normals, open)));
                        self.watch.step();
                    }
                    counts
                },
            )
            .reduce(Counts::default, Counts::plus);
        counts.within(start.elapsed())
    }

    /// The same for a tile of at most so many rows.
    fn look_at(
        &self,
        kept: &mut WorkerState,
        corner: [usize; 2],
        rows: usize,
        (hits, normals, open): (&mut [PixelHit], &mut [[f32; 3]], &mut [u8]),
    ) -> Counts {
        let start = Instant::now();
        let limits = (self.canvas.width as usize - corner[0], rows);
        let lod_edge_log2 = self.canvas.lod_edge_log2;
        let tile = Tile { corner: (corner[0], corner[1]), limits, lod_edge_log2 };
        let mut struck = [None; TILE_PIXELS];
        let mut counts = self.trace_tile(&mut kept.tracer, hits, &mut struck, tile);
        counts.trace = start.elapsed();
        if counts.hits > 0 {
            let start = Instant::now();
            self.fill_normals(kept, corner, hits, normals);
            counts.shade = start.elapsed();
        }
        if let (Some(sky), 1..) = (&self.sky, counts.hits) {
            let start = Instant::now();
            counts.ambient_rays = self.look_around(sky, &mut kept.lot, corner, &struck, (normals, open));
            counts.ambient = start.elapsed();
        }
        counts
    }

    /// Colours the rows of the picture from `top` on that `image` holds, which is blank; `band` knows them and those
    /// around.
    pub(super) fn shade(&self, band: &Band, image: &mut Image, top: usize) -> Counts {
        let start = Instant::now();
        let width = self.canvas.width as usize;
        let row = move |y: usize| (0..width).map(move |x| band.at(x, top + y));
        if let (Some(depth), Some(range)) = (&mut image.depth, self.canvas.depth_range_mm) {
            depth.par_chunks_mut(width).enumerate().for_each(|(y, out)| {
                for (out, (hit, ..)) in hits_of(out.iter_mut(), row(y)) {
                    *out = depth_code(range, hit.depth());
                }
            });
        }
        if let Some(ids) = &mut image.ids {
            ids.par_chunks_mut(width * 3).enumerate().for_each(|(y, out)| {
                let pixels = out.as_chunks_mut::<3>().0.iter_mut().enumerate();
                for ((x, out), (hit, ..)) in hits_of(pixels, row(y)) {
                    *out = id_code(self.id(hit, [x, top + y]));
                }
            });
        }
        if let Some(normals) = &mut image.normals {
            normals.par_chunks_mut(width * 3).enumerate().for_each(|(y, out)| {
                for (out, (_, normal, _)) in hits_of(out.as_chunks_mut::<3>().0.iter_mut(), row(y)) {
                    *out = normal.map(|part| normal_code(part.into()));
                }
            });
        }
        let counts = image
            .rgba
            .par_chunks_mut(width * 4 * TILE)
            .enumerate()
            .map_init(
                || (WorkerState::new(self.form), Patch::new()),
                |(kept, patch), (row, out)| {
                    self.shade_row(kept, patch, band, top + row * TILE, out.as_chunks_mut::<4>().0)
                },
            )
            .reduce(Counts::default, Counts::plus);
        let wall = start.elapsed();
        let mut counts = counts.within(wall);
        counts.shade = wall.saturating_sub(counts.trace + counts.ambient);
        counts
    }

    /// The number of what a pixel shows, from 1 on: of its label, or of its box.
    fn id(&self, hit: PixelHit, pixel: [usize; 2]) -> u64 {
        let [x, y] = pixel.map(|at| at as f64 + 0.5);
        let met = self.view.labels().and_then(|_| self.normals.label(hit, self.sight.line(x, y)));
        let label = met.map(|label| label.number).or_else(|| label_of(self.view, hit));
        label.map_or(hit.box_number().wrapping_add(1), u64::from)
    }

    /// Colours a row of tiles.
    fn shade_row(
        &self,
        kept: &mut WorkerState,
        patch: &mut Patch,
        band: &Band,
        top: usize,
        out: &mut [[u8; 4]],
    ) -> Counts {
        let width = self.canvas.width as usize;
        let rows = out.len() / width;
        let needs_patch = self.sky.is_some() || self.canvas.samples != Samples::One;
        let mut counts = Counts::default();
        for left in (0..width).step_by(WIDE) {
            if needs_patch {
                if !patch.fill(band, [left, top]) && self.canvas.samples == Samples::Auto {
                    continue;
                }
                if self.sky.is_some() {
                    patch.soften(self.form, &self.step);
                }
                if self.canvas.samples == Samples::Auto {
                    patch.compare(self.form, &self.step);
                }
            }
            let wide = WIDE.min(width - left);
            for tile in (0..wide).step_by(TILE) {
                self.shade_tile(band, patch, [left, tile], top, out);
            }
            for (x, y) in (0..rows).flat_map(|y| (0..wide).map(move |x| (x, y))) {
                if self.is_refined(patch, x, y)
                    && let Some(out) = out.get_mut(y * width + left + x)
                {
                    let start = Instant::now();
                    counts.refined += 1;
                    *out = self.refined(kept, patch, [x, y], [left + x, top + y], &mut counts);
                    counts.trace += start.elapsed();
                }
            }
            self.watch.step();
        }
        counts
    }

    /// Colours the hits of a tile; `left` and `tile` are the columns of its patch, and its own there.
    fn shade_tile(
        &self,
        band: &Band,
        patch: &Patch,
        [left, tile]: [usize; 2],
        top: usize,
        out: &mut [[u8; 4]],
    ) {
        let width = self.canvas.width as usize;
        let corner = [left + tile, top];
        let mut lit = Lit::NOTHING;
        let mut hits = [PixelHit::NOTHING; TILE_PIXELS];
        let mut any = false;
        for (at, hit) in hits.iter_mut().enumerate() {
            let (x, y) = (at % TILE, at / TILE);
            let Some((seen, normal, _)) = band.at(corner[0] + x, top + y).filter(|(seen, ..)| seen.is_hit())
            else {
                continue;
            };
            (*hit, any) = (seen, true);
            for (out, part) in lit.normals.iter_mut().zip(normal) {
                out[at] = part.into();
            }
            if self.sky.is_some() {
                lit.open[at] = patch.open(tile + x, y);
            }
        }
        if !any {
            return;
        }
        let has_colors = has_colors(self.view);
        let mut codes = [[0; TILE_PIXELS]; 3];
        if !has_colors {
            let (sight, light) = (&self.sight, &self.light);
            self.form.run(TileLight { sight, light, corner, lit: &lit, out: &mut codes });
        }
        for (at, hit) in hits.iter().enumerate().filter(|(_, hit)| hit.is_hit()) {
            let (x, y) = (corner[0] + at % TILE, at / TILE);
            let Some(out) = out.get_mut(y * width + x) else { continue };
            let [r, g, b] = if has_colors {
                let line = self.sight.line(x as f64 + 0.5, (top + y) as f64 + 0.5);
                let normal = lit.normals.map(|parts| parts[at]);
                let light = self.light.of(self.color(*hit, line), normal, line.1, lit.open[at]);
                light.map(|c| self.shader.encode(c))
            } else {
                codes.map(|codes| self.shader.code(codes[at]))
            };
            *out = [r, g, b, 255];
        }
    }

    /// The unit normals of the world that are shown at a tile's hits.
    fn fill_normals(
        &self,
        kept: &mut WorkerState,
        corner: [usize; 2],
        hits: &[PixelHit],
        normals: &mut [[f32; 3]],
    ) {
        let (in_boxes, to_eye) = self.normals_of(kept, corner, hits);
        for ((at, _), out) in hits.iter().enumerate().zip(normals).filter(|((_, hit), _)| hit.is_hit()) {
            let normal = if to_eye >> at & 1 == 1 {
                towards_eye(self.sees(corner, at))
            } else {
                self.sight.space().normal_to_world(in_boxes.map(|parts| parts[at % TILE_PIXELS]))
            };
            #[expect(clippy::cast_possible_truncation, reason = "single precision will do")]
            let single = normal.map(|c| c as f32);
            *out = single;
        }
    }

    /// The line of sight through a pixel of the tile at `corner`.
    #[inline]
    fn sees(&self, corner: [usize; 2], at: usize) -> Line {
        self.sight.line((corner[0] + at % TILE) as f64 + 0.5, (corner[1] + at / TILE) as f64 + 0.5)
    }

    /// The normals of a tile's hits in the frame of the boxes, of any length; and the pixels whose normals look towards the
    /// eye, since no normal in that frame does.
    fn normals_of(
        &self,
        kept: &mut WorkerState,
        corner: [usize; 2],
        seen: &[PixelHit],
    ) -> ([[f64; TILE_PIXELS]; 3], u64) {
        let mut normals = [[1.0; TILE_PIXELS]; 3];
        let (mut noted, mut alone, mut to_eye) = (0_u64, 0_u64, 0_u64);
        let edge_mm = self.normals.judged_together();
        for (at, pixel) in seen.iter().enumerate().filter(|(_, pixel)| pixel.is_hit()) {
            if edge_mm.is_some() && self.normals.note(&mut kept.stored, at, *pixel) {
                noted |= 1 << (at % TILE_PIXELS);
            } else {
                alone |= 1 << (at % TILE_PIXELS);
            }
        }
        let mut judged = Verdicts::NOTHING;
        if let (Some(edge_mm), 1..) = (edge_mm, noted) {
            self.form.run(Judge { stored: &kept.stored, edge_mm, out: &mut judged });
            normals = judged.normals;
        }
        let sees = |at: usize| self.sees(corner, at);
        let mut put = |at: usize, normal: [f64; 3]| {
            for (out, part) in normals.iter_mut().zip(normal) {
                out[at % TILE_PIXELS] = part;
            }
        };
        for (at, pixel) in each(alone, seen) {
            match self.normal_of(kept, pixel, || sees(at)) {
                Some(normal) => put(at, normal),
                None => to_eye |= 1 << at,
            }
        }
        kept.doubts.clear();
        let mut awaited = [0_u8; TILE_PIXELS];
        let mut unsettled = 0_u64;
        for (at, pixel) in each(noted & judged.doubts, seen) {
            let normal = kept.recall(pixel).or_else(|| {
                let scatter = self.normals.scatter(&mut kept.around, pixel, || sees(at))?;
                let awaited = Normal::Awaited(kept.doubts.add(&judged, &kept.stored, at, scatter));
                kept.keep(pixel, awaited);
                Some(awaited)
            });
            match normal {
                Some(Normal::Known(normal)) => put(at, normal),
                Some(Normal::Awaited(number)) => {
                    awaited[at % TILE_PIXELS] = number;
                    unsettled |= 1 << at;
                }
                None => {}
            }
        }
        if let (Some(edge_mm), 1..) = (edge_mm, unsettled) {
            self.form.run(Settle { doubts: &mut kept.doubts, edge_mm });
            for (at, pixel) in each(unsettled, seen) {
                let normal = kept.doubts.normal(awaited[at % TILE_PIXELS]);
                put(at, normal);
                kept.keep(pixel, Normal::Known(normal));
            }
        }
        (normals, to_eye)
    }

    /// As `Normals::in_boxes`; pixels of one face have one normal, which is found once.
    #[inline]
    fn normal_of(&self, kept: &mut WorkerState, seen: PixelHit, line: impl Fn() -> Line) -> Option<[f64; 3]> {
        // Without a face it may depend on the line of sight.
        let by_place = match self.canvas.smoothing {
            Smoothing::Stored => false,
            Smoothing::Smooth => self.view.cells().is_some(),
            Smoothing::Blended => true,
        };
        if !seen.is_of_face() || by_place {
            return self.normals.in_boxes(&mut kept.around, seen, line);
        }
        match kept.recall(seen) {
            Some(Normal::Known(normal)) => Some(normal),
            _ => {
                let normal = self.normals.in_boxes(&mut kept.around, seen, line)?;
                kept.keep(seen, Normal::Known(normal));
                Some(normal)
            }
        }
    }
}
