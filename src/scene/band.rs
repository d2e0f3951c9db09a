//! From rays to the bytes of a band of a picture: hits, normals and openness tile by tile, then light.
//!
//! A pixel's hit, normal and own openness depend on its own ray alone; its colour also on the pixels around. So colours
//! lag behind by a row of tiles, and two rows of tiles are kept from one band to the next. A worker resets its state at
//! each row of tiles.

use std::collections::BTreeSet;
use std::time::Instant;

use rayon::prelude::*;

use crate::cpu::Form;
use crate::geom::{NodeIndex, add_scaled, dot};
use crate::render::Samples;
use crate::render::ambient::{RayBatch, ShadedPoint, Sky, tangents};
use crate::render::ambient_filter::{Patch, WIDE};
use crate::render::colors::label_of;
use crate::render::image::Image;
use crate::render::normals::many::TileNormals;
use crate::render::normals::shading_normal::PixelHit;
use crate::render::picture::{depth_code, normal_code};
use crate::render::shade::{Lit, TileLight};
use crate::render::tile::{RAYS as TILE_PIXELS, TILE, Tracer};

use super::body::SurfaceHit;
use super::paint::{Counts, FirstHits, Group, Painter, Seen, rays_of};
use super::shade::{BEYOND_RIM, Branch, WorkerMemory};

/// A pixel of a band: its hit, normal and openness, and the visible body and label.
pub(super) type BandPixel = (PixelHit, [f32; 3], u8, Item);

/// Number of the body, and of the visible label where the hit alone does not determine it.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Item {
    pub(super) body: u16,
    pub(super) label: u16,
}

/// Pixels with a hit, each with its position.
fn hits_of<T>(
    out: impl Iterator<Item = T>,
    row: impl Iterator<Item = Option<BandPixel>>,
) -> impl Iterator<Item = (T, BandPixel)> {
    out.zip(row).filter_map(|(out, seen)| Some((out, seen.filter(|(hit, ..)| hit.is_hit())?)))
}

/// A number in an image of numbers: the highest of 48 bits first.
#[expect(clippy::cast_possible_truncation, reason = "16 bits each")]
fn id_code(id: u64) -> [u16; 3] {
    [(id >> 32) as u16, (id >> 16) as u16, id as u16]
}

/// Hits of the rays through the middles of some rows' pixels, tile after tile. Memory: 29 bytes a pixel, 33 with
/// several bodies.
///
/// Rows are added below, and dropped above once no pixel needs them: a pixel's colour depends on the pixels around it,
/// up to four rows away.
pub(super) struct Band {
    width: usize,
    tiles_across: usize,
    /// First row of the band in the picture; a multiple of [`TILE`].
    first: usize,
    hits: Vec<PixelHit>,
    /// Displayed unit normals, in world space.
    normals: Vec<[f32; 3]>,
    /// Openness of the surroundings, by each pixel's own rays.
    open: Vec<u8>,
    /// Empty for one whole body.
    items: Vec<Item>,
    has_items: bool,
}

impl Band {
    pub(super) fn new(width: usize, has_items: bool) -> Self {
        let (tiles_across, first) = (width.div_ceil(TILE), 0);
        let (hits, normals, open, items) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        Self { width, tiles_across, first, hits, normals, open, items, has_items }
    }

    /// Bytes of a pixel, and further bytes with several bodies.
    pub(super) const PIXEL_BYTES: u64 = (size_of::<PixelHit>() + size_of::<[f32; 3]>() + 1) as u64;
    pub(super) const ITEM_BYTES: u64 = size_of::<Item>() as u64;

    fn row_pixels(&self) -> usize {
        self.tiles_across * TILE_PIXELS
    }

    /// Adds empty rows of tiles; returns the number of pixels before them.
    fn grow(&mut self, rows: usize) -> usize {
        let before = self.hits.len();
        let all = before + rows.div_ceil(TILE) * self.row_pixels();
        self.hits.resize(all, PixelHit::NOTHING);
        self.normals.resize(all, [0.0; 3]);
        self.open.resize(all, u8::MAX);
        if self.has_items {
            self.items.resize(all, Item::default());
        }
        before
    }

    #[inline]
    fn index(&self, x: usize, y: usize) -> Option<usize> {
        let row = y.checked_sub(self.first)?;
        let tile = row / TILE * self.tiles_across + x / TILE;
        (x < self.width).then_some(tile * TILE_PIXELS + row % TILE * TILE + x % TILE)
    }

    /// A pixel of the picture; `None` outside the band.
    #[inline]
    pub(super) fn at(&self, x: usize, y: usize) -> Option<BandPixel> {
        let at = self.index(x, y)?;
        let item = self.items.get(at).copied().unwrap_or_default();
        Some((*self.hits.get(at)?, *self.normals.get(at)?, *self.open.get(at)?, item))
    }

    /// Drops the rows above `row`, a multiple of [`TILE`].
    pub(super) fn forget_above(&mut self, row: usize) {
        let past = ((row - self.first) / TILE * self.row_pixels()).min(self.hits.len());
        self.hits.drain(..past);
        self.normals.drain(..past);
        self.open.drain(..past);
        self.items.drain(..past.min(self.items.len()));
        self.first = row;
    }
}

/// The pixels of some tiles in the band.
struct BandTile<'a> {
    hits: &'a mut [PixelHit],
    normals: &'a mut [[f32; 3]],
    open: &'a mut [u8],
    items: &'a mut [Item],
}

impl BandTile<'_> {
    /// The pixels in parts of so many each.
    fn parts(self, pixels: usize) -> impl Iterator<Item = Self> {
        let mut items = self.items.chunks_mut(pixels);
        let rest = self.normals.chunks_mut(pixels).zip(self.open.chunks_mut(pixels));
        self.hits.chunks_mut(pixels).zip(rest).map(move |(hits, (normals, open))| Self {
            hits,
            normals,
            open,
            items: items.next().unwrap_or_default(),
        })
    }
}

/// State of a worker, from one pixel to the next.
pub(super) struct WorkerState {
    pub(super) tracer: Tracer,
    pub(super) memory: WorkerMemory,
    normals: TileNormals,
    lot: RayBatch,
}

impl WorkerState {
    fn new(form: Form, files: usize) -> Self {
        let (tracer, memory) = (Tracer::new(form), WorkerMemory::new(files));
        Self { tracer, memory, normals: TileNormals::new(form), lot: RayBatch::new(form) }
    }
}

/// Stored form of an openness.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 255")]
fn open_code(open: f64) -> u8 {
    (open * 255.0 + 0.5) as u8
}

impl Painter<'_> {
    /// Traces `rows` more rows of the picture, from `top` on: hits, normals and openness.
    pub(super) fn look(&self, band: &mut Band, top: usize, rows: usize) -> Counts {
        let start = Instant::now();
        let row_pixels = band.row_pixels();
        let before = band.grow(rows);
        let items_before = before.min(band.items.len());
        let added = BandTile {
            hits: &mut band.hits[before..],
            normals: &mut band.normals[before..],
            open: &mut band.open[before..],
            items: &mut band.items[items_before..],
        };
        let rows_of_tiles: Vec<_> = added.parts(row_pixels).collect();
        let counts = rows_of_tiles
            .into_par_iter()
            .enumerate()
            .map_init(
                || WorkerState::new(self.form, self.files),
                |kept, (row, pixels)| {
                    kept.normals.forget();
                    let limit = (rows - row * TILE).min(TILE);
                    let mut counts = Counts::default();
                    for (tile, pixels) in pixels.parts(TILE_PIXELS).enumerate() {
                        let corner = [tile * TILE, top + row * TILE];
                        counts = counts.plus(self.look_at(kept, corner, limit, pixels));
                        if self.watch.ends() {
                            break;
                        }
                    }
                    counts
                },
            )
            .reduce(Counts::default, Counts::plus);
        counts.within(start.elapsed())
    }

    /// Traces a tile with a limited number of rows.
    fn look_at(
        &self,
        kept: &mut WorkerState,
        corner: [usize; 2],
        rows: usize,
        mut out: BandTile<'_>,
    ) -> Counts {
        let start = Instant::now();
        let group = Group::Pixels(corner, (self.look.width as usize - corner[0], rows));
        let (met, mut counts) = self.first(&mut kept.tracer, group);
        for (ray, pixel) in out.hits.iter_mut().enumerate() {
            *pixel = match &met[ray % TILE_PIXELS] {
                None => PixelHit::NOTHING,
                Some((_, SurfaceHit::Cut { plane, t, label })) => {
                    PixelHit::cut(*plane, *t, label.unwrap_or(0))
                }
                Some((number, SurfaceHit::Surface(hit))) => {
                    self.stage.world.bodies[*number].normals.seen(hit, || self.line(group, ray))
                }
            };
        }
        counts.trace = start.elapsed();
        if counts.hits == 0 {
            return counts;
        }
        let start = Instant::now();
        if self.is_alone {
            if let ([body], Some(around)) = (&*self.stage.world.bodies, kept.memory.around.first_mut()) {
                let line = |ray| self.line(group, ray);
                kept.normals.fill(&body.normals, around, out.hits, line, out.normals);
            }
            counts.shade = start.elapsed();
            let start = Instant::now();
            counts.ambient = self.look_around(&mut kept.lot, group, &met, &mut out);
            counts.around = start.elapsed();
        } else {
            self.fill_spots(kept, group, &met, &mut out);
            counts = counts.plus(std::mem::take(&mut kept.memory.counts));
            counts.shade = start.elapsed();
        }
        counts
    }

    /// Fills in items, normals and openness of a tile's hits.
    fn fill_spots(&self, kept: &mut WorkerState, group: Group, met: &FirstHits, out: &mut BandTile<'_>) {
        let Group::Pixels(corner, _) = group else { return };
        for (ray, (number, met)) in met.iter().enumerate().filter_map(|(ray, met)| Some((ray, (*met)?))) {
            let line = self.line(group, ray);
            let spot = self.stage.spot(&mut kept.memory, &Branch::first(line), number, met);
            let pixel = [corner[0] + ray % TILE, corner[1] + ray / TILE];
            let openness = |sky: &Sky| self.stage.openness(&mut kept.memory, &spot, sky.of(pixel));
            let open = self.sky.as_ref().map_or(1.0, openness);
            #[expect(clippy::cast_possible_truncation, reason = "single precision will do")]
            let normal = spot.shown.map(|c| c as f32);
            let item = Item { body: u16::try_from(number).unwrap_or(u16::MAX), label: spot.label };
            if let (Some(out_normal), Some(out_open), Some(out_item)) =
                (out.normals.get_mut(ray), out.open.get_mut(ray), out.items.get_mut(ray))
            {
                (*out_normal, *out_open, *out_item) = (normal, open_code(open), item);
            }
        }
    }

    /// Measures the openness around the hits of a single body, by the world unit normals there. Returns the number of
    /// rays.
    fn look_around(&self, lot: &mut RayBatch, group: Group, met: &FirstHits, out: &mut BandTile<'_>) -> u64 {
        let (Some(sky), [body], Group::Pixels(corner, _)) = (&self.sky, &*self.stage.world.bodies, group)
        else {
            return 0;
        };
        let (view, cells) = (body.part.view, body.cells.as_ref());
        lot.begin();
        let (mut traced, mut level) = (0, body.level);
        let hits = met.iter().enumerate().filter_map(|(at, met)| match met {
            Some((_, SurfaceHit::Surface(hit))) => Some((at, hit)),
            _ => None,
        });
        for (at, hit) in hits.clone() {
            // Larger leaves are not coarse boxes.
            let is_leaf = view.is_leaf(NodeIndex::new(hit.box_number));
            let own = if is_leaf { 0 } else { hit.edge_log2 };
            if own != level {
                lot.flush(view, cells, level);
                level = own;
            }
            let (origin, sight) = self.line(group, at);
            let normal = out.normals.get(at).copied().unwrap_or_default().map(f64::from);
            let away = dot(normal, sight) > 0.0;
            let place = ShadedPoint {
                space: &body.part.space,
                hit,
                point: add_scaled(origin, hit.t, sight),
                normal: if away { normal.map(|c| -c) } else { normal },
            };
            let [right, ahead] = tangents(place.normal);
            for d in sky.of([corner[0] + at % TILE, corner[1] + at / TILE]) {
                let way = |a: usize| right[a] * d[0] + ahead[a] * d[1] + place.normal[a] * d[2];
                traced += 1;
                if let Some(ray) = place.ray([way(0), way(1), way(2)]) {
                    lot.add(at, ray);
                }
                if lot.is_full() {
                    lot.flush(view, cells, level);
                    self.watch.step();
                }
            }
        }
        lot.flush(view, cells, level);
        for (at, _) in hits {
            let all = sky.of([at % TILE, at / TILE]).len().max(1) as f64;
            if let Some(open) = out.open.get_mut(at) {
                *open = open_code(1.0 - f64::from(lot.closed(at)) / all);
            }
        }
        traced
    }

    /// Colours the rows of the picture from `top` on in the blank `image`, and adds the visible items to `seen`; `band`
    /// holds these rows and those around.
    pub(super) fn shade(
        &self,
        band: &Band,
        image: &mut Image,
        top: usize,
        seen: &mut BTreeSet<Seen>,
    ) -> Counts {
        let start = Instant::now();
        let width = self.look.width as usize;
        let row = move |y: usize| (0..width).map(move |x| band.at(x, top + y));
        if let (Some(depth), Some(range)) = (&mut image.depth, self.look.depth_range_mm) {
            depth.par_chunks_mut(width).enumerate().for_each(|(y, out)| {
                for (out, (hit, ..)) in hits_of(out.iter_mut(), row(y)) {
                    *out = depth_code(range, hit.depth());
                }
            });
        }
        if let Some(ids) = &mut image.ids {
            ids.par_chunks_mut(width * 3).enumerate().for_each(|(y, out)| {
                let pixels = out.as_chunks_mut::<3>().0.iter_mut().enumerate();
                for ((x, out), pixel) in hits_of(pixels, row(y)) {
                    *out = id_code(self.id(pixel, [x, top + y]));
                }
            });
        }
        if let Some(normals) = &mut image.normals {
            normals.par_chunks_mut(width * 3).enumerate().for_each(|(y, out)| {
                let pixels = out.as_chunks_mut::<3>().0.iter_mut().enumerate();
                for ((x, out), pixel) in hits_of(pixels, row(y)) {
                    *out = self.outside(pixel, [x, top + y]).map(normal_code);
                }
            });
        }
        if self.look.seen {
            let mut last = None;
            for y in 0..image.height as usize {
                for (x, pixel) in hits_of(0..width, row(y)) {
                    let shown = (pixel.3.body.into(), self.label(pixel, [x, top + y]).unwrap_or(0));
                    if last != Some(shown) {
                        last = Some(shown);
                        seen.insert(shown);
                    }
                }
            }
        }
        let counts = image
            .rgba
            .par_chunks_mut(width * 4 * TILE)
            .enumerate()
            .map_init(
                || (WorkerState::new(self.form, self.files), Patch::new()),
                |(kept, patch), (row, out)| {
                    let out = out.as_chunks_mut::<4>().0;
                    let counts = self.shade_row(kept, patch, band, top + row * TILE, out);
                    counts.plus(std::mem::take(&mut kept.memory.counts))
                },
            )
            .reduce(Counts::default, Counts::plus);
        let wall = start.elapsed();
        let mut counts = counts.within(wall);
        counts.shade = wall.saturating_sub(counts.trace + counts.around);
        counts
    }

    /// The normal of a pixel, turned to the side of the stored one where that shows the outside of the surface: at a
    /// rim a line may enter by a face that looks the other way.
    fn outside(&self, (hit, normal, _, item): BandPixel, [x, y]: [usize; 2]) -> [f64; 3] {
        let normal = normal.map(f64::from);
        let body = self.stage.world.bodies.get(usize::from(item.body));
        let Some(outward) = body.and_then(|body| body.normals.outward(hit)) else { return normal };
        let (_, sight) = self.line(Group::Pixels([x, y], (1, 1)), 0);
        let is_outside = dot(outward, sight) <= BEYOND_RIM * dot(sight, sight).sqrt();
        if is_outside && dot(outward, normal) < 0.0 { normal.map(|c| -c) } else { normal }
    }

    /// The number of a pixel's visible label; `None` for a model without labels.
    fn label(&self, (hit, _, _, item): BandPixel, [x, y]: [usize; 2]) -> Option<u16> {
        let body = self.stage.world.bodies.get(usize::from(item.body))?;
        body.part.view.labels()?;
        if let Some((_, label)) = hit.cut_of() {
            return Some(label);
        }
        if item.label > 0 {
            return Some(item.label);
        }
        let line = self.line(Group::Pixels([x, y], (1, 1)), 0);
        let met = body.normals.label(hit, line).map(|label| label.number);
        met.or_else(|| label_of(body.part.view, hit))
    }

    /// Number of a pixel's visible label, or of its box, from 1 on. Numbers of the second model start at 2^32, and so
    /// on.
    fn id(&self, pixel: BandPixel, at: [usize; 2]) -> u64 {
        let number = self.label(pixel, at).map_or(pixel.0.box_number().wrapping_add(1), u64::from);
        number + (u64::from(pixel.3.body) << 32)
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
        let width = self.look.width as usize;
        let rows = out.len() / width;
        let needs_patch = self.sky.is_some() || self.look.samples != Samples::One;
        let mut counts = Counts::default();
        for left in (0..width).step_by(WIDE) {
            if needs_patch {
                let pixel = |x, y| band.at(x, y).map(|(hit, normal, open, _)| (hit.depth(), normal, open));
                if !patch.fill(pixel, [left, top]) && self.look.samples == Samples::Auto {
                    continue;
                }
                if self.sky.is_some() {
                    patch.soften(self.form, &self.step);
                }
                if self.look.samples == Samples::Auto {
                    patch.compare(self.form, &self.step);
                }
            }
            let wide = WIDE.min(width - left);
            for tile in (0..wide).step_by(TILE) {
                if self.follows {
                    self.follow_tile(kept, patch, [left, tile], top, out);
                } else {
                    self.shade_tile(band, patch, [left, tile], top, out);
                }
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
            if self.watch.ends() {
                break;
            }
        }
        counts
    }

    /// Colours the hits of a tile from the band alone; `left` and `tile` are the columns of its patch, and its own
    /// columns there.
    fn shade_tile(
        &self,
        band: &Band,
        patch: &Patch,
        [left, tile]: [usize; 2],
        top: usize,
        out: &mut [[u8; 4]],
    ) {
        let width = self.look.width as usize;
        let (corner, Some(rig), Some(sight)) = ([left + tile, top], &self.stage.rig, self.sight()) else {
            return;
        };
        let group = Group::Pixels(corner, (TILE, TILE));
        let mut lit = Lit::NOTHING;
        let mut any = 0_u64;
        for at in 0..TILE_PIXELS {
            let (x, y) = (at % TILE, at / TILE);
            let Some((hit, normal, _, item)) =
                band.at(corner[0] + x, top + y).filter(|(hit, ..)| hit.is_hit())
            else {
                continue;
            };
            any |= 1 << at;
            let Some(body) = self.stage.world.bodies.get(usize::from(item.body)) else { continue };
            let color = body.color(&self.stage.shader, hit, item.label, || self.line(group, at));
            for a in 0..3 {
                lit.normals[a][at] = normal[a].into();
                lit.colors[a][at] = color[a];
            }
            if self.sky.is_some() {
                lit.open[at] = patch.open(tile + x, y);
            }
        }
        if any == 0 {
            return;
        }
        let mut codes = [[0; TILE_PIXELS]; 3];
        self.form.run(TileLight { sight, rig, corner, lit: &lit, out: &mut codes });
        for at in rays_of(any) {
            let Some(out) = out.get_mut(at / TILE * width + corner[0] + at % TILE) else { continue };
            let [r, g, b] = codes.map(|codes| self.stage.shader.code(codes[at]));
            *out = [r, g, b, 255];
        }
    }

    /// Colours the hits of a tile by tracing all the rays that their light needs.
    fn follow_tile(
        &self,
        kept: &mut WorkerState,
        patch: &Patch,
        [left, tile]: [usize; 2],
        top: usize,
        out: &mut [[u8; 4]],
    ) {
        let width = self.look.width as usize;
        let corner = [left + tile, top];
        let group = Group::Pixels(corner, (width - corner[0], out.len() / width));
        let (met, _) = self.first(&mut kept.tracer, group);
        for (at, met) in met.into_iter().enumerate().filter(|(_, met)| met.is_some()) {
            let pixel = [corner[0] + at % TILE, top + at / TILE];
            let open = self.sky.as_ref().map_or(1.0, |_| patch.open(tile + at % TILE, at / TILE));
            let branch = Branch::first(self.line(group, at));
            let (color, through) = self.stage.color(&mut kept.memory, branch, met, pixel, open);
            if let Some(out) = out.get_mut(at / TILE * width + pixel[0]) {
                *out = self.stage.shader.pixel(color, 1.0 - through, 1.0);
            }
        }
    }
}
