//! From what a band of a picture saw to its bytes: light, depth, normals and numbers of boxes.
//!
//! Hits are coloured tile by tile, their light by a kernel over all rays of a tile. Every pixel depends on its own hit
//! only; what a worker keeps from one to the next it forgets at each row of tiles.

use std::time::{Duration, Instant};

use rayon::prelude::*;

use super::colors::{color_of, has_colors};
use super::image::Image;
use super::normals::around::Surroundings;
use super::normals::repair::tile::{Doubts, Judge, Settle, Stored, Verdicts};
use super::normals::shown::{Line, PixelHit, towards_eye};
use super::picture::{Painter, depth_code, normal_code};
use super::shade::{Lit, Shader, TileLight};
use super::surface::Surface;
use super::tile::{RAYS as TILE_PIXELS, TILE};

/// The number of a box, counted from 1, in an image of them: the highest of 48 bits first.
#[expect(clippy::cast_possible_truncation, reason = "16 bits each")]
fn id_code(number: u64) -> [u16; 3] {
    let id = number.wrapping_add(1);
    [(id >> 32) as u16, (id >> 16) as u16, id as u16]
}

/// Row `y` of a band whose hits stand tile after tile.
fn row_of(seen: &[PixelHit], width: usize, y: usize) -> impl Iterator<Item = PixelHit> {
    let first = y / TILE * width.div_ceil(TILE) * TILE_PIXELS + y % TILE * TILE;
    (0..width).map(move |x| {
        seen.get(first + x / TILE * TILE_PIXELS + x % TILE).copied().unwrap_or(PixelHit::NOTHING)
    })
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
struct WorkerState {
    around: Surroundings,
    stored: Stored,
    doubts: Doubts,
    /// Round, box and face, and the normal that is shown there.
    normals: Vec<(u32, u64, Normal)>,
    round: u32,
}

impl WorkerState {
    fn new() -> Self {
        let nothing = (0, 0, Normal::Awaited(0));
        Self {
            around: Surroundings::new(),
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
    /// Linear RGB of a pixel that saw a surface with this normal.
    #[inline]
    pub(super) fn light(&self, seen: PixelHit, normal: [f64; 3], line: Line, [x, y]: [usize; 2]) -> [f64; 3] {
        let light = match color_of(self.view, &self.shader, seen) {
            Some(color) => Shader::lit(color, normal, line.1),
            None => self.shader.light(normal, line.1),
        };
        match self.open.at(self.canvas.width as usize, [x, y]) {
            Some(open) => light.map(|c| c * (f64::from(open) / 255.0)),
            None => light,
        }
    }

    /// Colours the rows of a traced band: `top` and those below it of an image that begins at the picture's row `from`.
    pub(super) fn shade_band(
        &self,
        seen: &[PixelHit],
        image: &mut Image,
        from: usize,
        top: usize,
        rows: usize,
    ) -> Duration {
        let start = Instant::now();
        let width = self.canvas.width as usize;
        self.color(seen, &mut image.rgba, [from, top, rows]);
        if let (Some(depth), Some(range)) = (&mut image.depth, self.canvas.depth_range_mm) {
            depth.par_chunks_mut(width).skip(top).take(rows).enumerate().for_each(|(y, row)| {
                for (pixel, out) in row_of(seen, width, y).zip(row) {
                    *out = if pixel.is_hit() { depth_code(range, pixel.depth()) } else { 0 };
                }
            });
        }
        if let Some(ids) = &mut image.ids {
            ids.par_chunks_mut(width * 3).skip(top).take(rows).enumerate().for_each(|(y, row)| {
                for (pixel, out) in row_of(seen, width, y).zip(row.as_chunks_mut::<3>().0) {
                    *out = if pixel.is_hit() { id_code(pixel.box_number()) } else { [0; 3] };
                }
            });
        }
        if let Some(normals) = &mut image.normals {
            self.fill_normals(seen, normals, [from, top, rows]);
        }
        start.elapsed()
    }

    /// The pixels of a traced band that hit something, tile after tile, with a worker's memory: column and row of the
    /// tile's corner, the tile's hits, and the bytes of its row of tiles, `N` a pixel.
    fn each_tile<const N: usize>(
        &self,
        seen: &[PixelHit],
        out: &mut [u8],
        [from, top, rows]: [usize; 3],
        paint: impl Fn(&mut WorkerState, [usize; 2], &[PixelHit], &mut [[u8; N]]) + Sync,
    ) {
        let width = self.canvas.width as usize;
        let tile_row = width.div_ceil(TILE) * TILE_PIXELS;
        let out = out.par_chunks_mut(width * N * TILE).skip(top / TILE).take(rows.div_ceil(TILE));
        let tiles = out.zip(seen.par_chunks(tile_row)).enumerate();
        tiles.for_each_init(WorkerState::new, |kept, (n, (out, seen))| {
            kept.forget();
            let (out, _) = out.as_chunks_mut::<N>();
            for (tile, seen) in seen.chunks(TILE_PIXELS).enumerate() {
                if seen.iter().any(|pixel| pixel.is_hit()) {
                    paint(kept, [tile * TILE, from + top + n * TILE], seen, out);
                    self.watch.step();
                }
            }
        });
    }

    /// Colours of the hits of a traced band.
    fn color(&self, seen: &[PixelHit], out: &mut [u8], place: [usize; 3]) {
        let width = self.canvas.width as usize;
        let has_colors = has_colors(self.view);
        self.each_tile::<4>(seen, out, place, |kept, corner, seen, out| {
            let (lit, to_eye) = self.lit(kept, corner, seen);
            let mut codes = [[0; TILE_PIXELS]; 3];
            self.form.run(TileLight { sight: &self.sight, corner, lit: &lit, out: &mut codes });
            for (at, pixel) in seen.iter().enumerate().filter(|(_, pixel)| pixel.is_hit()) {
                let (x, y) = (corner[0] + at % TILE, at / TILE);
                if let (true, Some(out)) = (x < width, out.get_mut(y * width + x)) {
                    let faces_eye = to_eye >> at & 1 == 1;
                    let [r, g, b] = if faces_eye || has_colors {
                        let line = self.sight.line(x as f64 + 0.5, (corner[1] + y) as f64 + 0.5);
                        let own = lit.normals.map(|parts| parts[at % TILE_PIXELS]);
                        let normal = if faces_eye {
                            towards_eye(line)
                        } else {
                            self.sight.space().normal_to_world(own)
                        };
                        let light = self.light(*pixel, normal, line, [x, corner[1] + y]);
                        light.map(|c| self.shader.encode(c))
                    } else {
                        [
                            self.shader.code(codes[0][at]),
                            self.shader.code(codes[1][at]),
                            self.shader.code(codes[2][at]),
                        ]
                    };
                    *out = [r, g, b, 255];
                }
            }
        });
    }

    /// The normals and openness of a tile's hits; and the pixels whose normals look towards the eye, since no normal in the
    /// frame of the boxes does that.
    fn lit(&self, kept: &mut WorkerState, corner: [usize; 2], seen: &[PixelHit]) -> (Lit, u64) {
        let width = self.canvas.width as usize;
        let mut lit = Lit::NOTHING;
        let (mut noted, mut alone, mut to_eye) = (0_u64, 0_u64, 0_u64);
        let edge_mm = self.normals.judged_together();
        // Tiles at the border reach over it; what is there may be of an earlier band.
        let is_seen = |at: usize, pixel: &PixelHit| pixel.is_hit() && corner[0] + at % TILE < width;
        for (at, pixel) in seen.iter().enumerate().filter(|(at, pixel)| is_seen(*at, pixel)) {
            if edge_mm.is_some() && self.normals.note(&mut kept.stored, at, *pixel) {
                noted |= 1 << (at % TILE_PIXELS);
            } else {
                alone |= 1 << (at % TILE_PIXELS);
            }
            if let Some(open) = self.open.at(width, [corner[0] + at % TILE, corner[1] + at / TILE]) {
                lit.open[at % TILE_PIXELS] = f64::from(open) / 255.0;
            }
        }
        let mut judged = Verdicts::NOTHING;
        if let (Some(edge_mm), 1..) = (edge_mm, noted) {
            self.form.run(Judge { stored: &kept.stored, edge_mm, out: &mut judged });
            lit.normals = judged.normals;
        }
        let sees = |at: usize| {
            self.sight.line((corner[0] + at % TILE) as f64 + 0.5, (corner[1] + at / TILE) as f64 + 0.5)
        };
        let mut put = |at: usize, normal: [f64; 3]| {
            for (out, part) in lit.normals.iter_mut().zip(normal) {
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
        (lit, to_eye)
    }

    /// Normals of the hits of a traced band.
    fn fill_normals(&self, seen: &[PixelHit], out: &mut [u8], place: [usize; 3]) {
        let width = self.canvas.width as usize;
        self.each_tile::<3>(seen, out, place, |kept, corner, seen, out| {
            for (at, pixel) in seen.iter().enumerate().filter(|(_, pixel)| pixel.is_hit()) {
                let (x, y) = (corner[0] + at % TILE, at / TILE);
                if let (true, Some(out)) = (x < width, out.get_mut(y * width + x)) {
                    let line = self.sight.line(x as f64 + 0.5, (corner[1] + y) as f64 + 0.5);
                    let normal = match self.normal_of(kept, *pixel, || line) {
                        Some(normal) => self.sight.space().normal_to_world(normal),
                        None => towards_eye(line),
                    };
                    *out = normal.map(normal_code);
                }
            }
        });
    }

    /// As `Normals::in_boxes`; pixels of one face have one normal, which is found once.
    #[inline]
    fn normal_of(&self, kept: &mut WorkerState, seen: PixelHit, line: impl Fn() -> Line) -> Option<[f64; 3]> {
        // Without a face it may depend on the line of sight.
        if !seen.is_of_face() || self.canvas.blended {
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
