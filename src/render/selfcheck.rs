//! The traversal compared with the reference on many random rays, for tests and for users who want to see it.

use crate::geom::{Affine, BoxIndex, Dims, Octant};
use crate::load::{ModelView, NodeView};

use super::batch::Batch;
use super::cells::Cells;
use super::pixel_rays::PixelRays;
use super::ray::{MAX_DEPTH, Ray};
use super::reference::{self, BitVolume};
use super::surface::{Skin, Surface};
use super::tile::{RAYS, TILE, Tile, Tracer};
use super::traverse::{Hit, step_limit};
use super::{Camera, GridSpace, Projection, ViewPoint, single};
use crate::cpu::Form;

/// Rays of a batch.
const LOT: usize = 100;

/// Counts of a comparison; all mismatch counts are 0 for a sound build.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Mismatches {
    /// Rays traced, those for soft edges included.
    pub rays: u64,
    /// Rays that hit the model.
    pub hits: u64,
    /// Both hit, but different voxels.
    pub voxel: u64,
    /// Same voxel, different face.
    pub face: u64,
    /// Only the traversal hit.
    pub false_hits: u64,
    /// Only the reference hit.
    pub false_misses: u64,
    /// Hits with a number other than their voxel's, or with a depth off their face by over 2^-16 cell.
    pub inconsistent: u64,
    /// Rays that hit the inside of a cell or larger leaf, of a model that has them.
    pub cell_hits: u64,
    /// Rays that hit another cell or larger leaf than the reference, or rays that only one of them hits.
    pub cells: u64,
    /// Rays whose hit depends on the instruction set, or on being traced alone, in a batch or in a tile.
    pub forms: u64,
    /// Rays traced in tiles.
    pub tile_rays: u64,
    /// Rays that took more steps than allowed.
    pub over_limit: u64,
    /// Traversal steps of all rays.
    pub steps: u64,
    /// Steps of the longest ray.
    pub max_steps: u32,
}

impl Mismatches {
    /// All disagreements together.
    pub fn total(&self) -> u64 {
        let hits = self.voxel + self.face + self.false_hits + self.false_misses;
        hits + self.inconsistent + self.cells + self.forms + self.over_limit
    }

    /// Sum of two counts.
    #[must_use]
    pub fn plus(mut self, other: Self) -> Self {
        add_counts!(self, other: rays, hits, voxel, face, false_hits, false_misses, inconsistent);
        add_counts!(self, other: cell_hits, cells, forms, tile_rays, over_limit, steps);
        self.max_steps = self.max_steps.max(other.max_steps);
        self
    }

    /// Compares one ray and counts it: with the boxes of the model, unless it has larger leaves, and with its cells.
    pub fn compare(&mut self, view: &ModelView<'_>, volume: &BitVolume, ray: &Ray) {
        self.rays += 1;
        if let Some(cells) = view.cells().map(Cells::new) {
            self.compare_cells(view, &cells, ray);
        }
        if !view.has_leaves() {
            self.compare_boxes(view, volume, ray);
        }
    }

    fn compare_cells(&mut self, view: &ModelView<'_>, cells: &Cells<'_>, ray: &Ray) {
        let trace = single::trace(Form::Portable, view, cells, ray, 0);
        for form in Form::available() {
            self.forms += u64::from(single::trace(form, view, cells, ray, 0).hit != trace.hit);
        }
        let want = reference::planes::first_box(view, ray);
        self.cell_hits += u64::from(want.is_some());
        self.cells += u64::from(trace.hit.map(|hit| hit.box_number) != want);
    }

    fn compare_boxes(&mut self, view: &ModelView<'_>, volume: &BitVolume, ray: &Ray) {
        let trace = single::trace(Form::Portable, view, &Skin, ray, 0);
        let want = reference::walk(volume, ray, true, |_| {});
        self.hits += u64::from(want.is_some());
        self.steps += u64::from(trace.steps);
        self.max_steps = self.max_steps.max(trace.steps);
        for form in Form::available() {
            self.forms += u64::from(single::trace(form, view, &Skin, ray, 0).hit != trace.hit);
        }
        self.over_limit += u64::from(trace.steps > step_limit(ray.depth()));
        match (trace.hit, want) {
            (None, None) => {}
            (Some(_), None) => self.false_hits += 1,
            (None, Some(_)) => self.false_misses += 1,
            (Some(got), Some(want)) if got.cell != want.cell => self.voxel += 1,
            (Some(got), Some(want)) if got.face != want.face => self.face += 1,
            (Some(got), Some(_)) => {
                let found = number_of(view, got.cell).map(BoxIndex::get) == Some(got.box_number);
                self.inconsistent += u64::from(!found || !lies_on_face(ray, &got));
            }
        }
    }

    /// Compares a batch of rays, in every form, with the same rays alone.
    pub fn compare_batch(&mut self, view: &ModelView<'_>, rays: &[Ray], lod_edge_log2: u32) {
        if !view.has_leaves() {
            self.compare_batch_of(view, &Skin, rays, lod_edge_log2);
        }
        if let Some(cells) = view.cells().map(Cells::new) {
            self.compare_batch_of(view, &cells, rays, lod_edge_log2);
        }
    }

    fn compare_batch_of<S: Surface>(
        &mut self,
        view: &ModelView<'_>,
        surface: &S,
        rays: &[Ray],
        lod_edge_log2: u32,
    ) {
        let alone = |ray| single::trace(Form::Portable, view, surface, ray, lod_edge_log2).hit;
        let want: Vec<_> = rays.iter().map(alone).collect();
        let (mut hits, mut met) = (Vec::new(), Vec::new());
        for form in Form::available() {
            let mut batch = Batch::new(form);
            batch.nearest(view, surface, rays, lod_edge_log2, &mut hits);
            batch.any(view, surface, rays, lod_edge_log2, &mut met);
            for (want, (hit, met)) in want.iter().zip(hits.iter().zip(&met)) {
                self.forms += u64::from(hit != want || *met != want.is_some());
            }
        }
    }

    /// Compares a tile of a picture, in every form, with its rays alone.
    pub fn compare_tile(&mut self, view: &ModelView<'_>, sight: &PixelRays<'_>, tile: Tile) {
        if !view.has_leaves() {
            self.compare_tile_of(view, &Skin, sight, tile);
        }
        if let Some(cells) = view.cells().map(Cells::new) {
            self.compare_tile_of(view, &cells, sight, tile);
        }
        let rays: Vec<Ray> = (0..RAYS).filter_map(|number| ray_of(sight, tile, number)).collect();
        self.compare_batch(view, &rays, tile.lod_edge_log2);
        self.tile_rays += RAYS as u64;
    }

    fn compare_tile_of<S: Surface>(
        &mut self,
        view: &ModelView<'_>,
        surface: &S,
        sight: &PixelRays<'_>,
        tile: Tile,
    ) {
        let alone = |ray: &Ray| single::trace(Form::Portable, view, surface, ray, tile.lod_edge_log2).hit;
        let want: [Option<_>; RAYS] = std::array::from_fn(|number| {
            let is_live = tile.live() >> number & 1 == 1;
            ray_of(sight, tile, number).filter(|_| is_live).and_then(|ray| alone(&ray))
        });
        for form in Form::available() {
            let mut tracer = Tracer::new(form);
            let hits = tracer.trace(view, surface, sight, tile);
            for (ray, want) in want.iter().enumerate() {
                self.forms += u64::from(hits.hit(ray) != *want);
            }
        }
    }
}

/// The ray of a tile with this number.
fn ray_of(sight: &PixelRays<'_>, tile: Tile, number: usize) -> Option<Ray> {
    let [x, y] = [tile.corner.0 + number % TILE, tile.corner.1 + number / TILE];
    sight.ray(x as f64 + 0.5, y as f64 + 0.5)
}

/// A random picture of a grid of 2^depth cells, from outside or inside; one in four has its eye or its
/// direction on a lattice, where ties happen. `None` for an impossible camera.
fn random_picture(random: &mut Random, depth: u32) -> Option<(GridSpace, Camera, u32)> {
    let side = 1_u32 << depth.min(MAX_DEPTH);
    let spacing = if random.bits() & 3 == 0 { [1.0, 0.5, 3.0] } else { [1.0; 3] };
    let space = GridSpace::new(Dims::new(side, side, side)?, &Affine::from_spacing(spacing)).ok()?;
    let length = f64::from(side);
    let kind = random.bits();
    let (low, high) = if kind & 1 == 0 { (0.0, length) } else { (-1.5 * length, 2.5 * length) };
    // A voxel's centre is an integer in the world, so a grid plane is half a spacing off.
    let in_world = |p: [f64; 3]| std::array::from_fn(|a| (p[a] - 0.5) * spacing[a]);
    let mut eye = [0.0; 3].map(|_: f64| random.range(low, high));
    let goal = [0.0; 3].map(|_: f64| random.range(0.0, length));
    let mut along: [f64; 3] = std::array::from_fn(|a| goal[a] - eye[a]);
    match kind >> 1 & 15 {
        0 => eye = eye.map(f64::round),
        1 => along = along.map(|v| (v * 3.0 / length).round()),
        2 => {
            eye = eye.map(|v| (v * 2.0).round() / 2.0);
            along = along.map(|v| (v * 2.0 / length).round());
        }
        3 => along[usize::from(kind & 32 > 0)] = 0.0,
        _ => {}
    }
    let eye_world = in_world(eye);
    let look_at = std::array::from_fn(|a| eye_world[a] + along[a] * spacing[a]);
    let projection = if kind & 64 == 0 { Projection::Parallel } else { Projection::Perspective };
    let point = ViewPoint::Free { eye: eye_world, look_at, up: None };
    let camera = Camera::new(point, projection, random.range(0.5, 120.0), 1.0, |_| 0.0).ok()?;
    let size = 8 + u32::try_from(kind >> 8 & 1023).unwrap_or(0);
    Some((space, camera, size))
}

/// Compares tiles of random pictures in every form with the same rays alone: about `rays` rays, each 1 to
/// 64 tiles of a picture; the same seed gives the same tiles. Levels of detail are among them.
pub fn tile_mismatches(view: &ModelView<'_>, rays: u64, seed: u64) -> Mismatches {
    let mut random = Random::new(seed ^ 0x7469_6c65);
    let mut counts = Mismatches::default();
    for _ in 0..rays.div_ceil(4 * RAYS as u64) {
        let Some((space, camera, size)) = random_picture(&mut random, view.depth()) else { continue };
        let sight = PixelRays::new(&space, &camera, size, size);
        for _ in 0..4 {
            let bits = random.bits();
            let at = |bits: u64| usize::try_from(bits % u64::from(size)).unwrap_or(0) / TILE * TILE;
            let corner = (at(bits & 0xffff), at(bits >> 16 & 0xffff));
            let limits = (size as usize - corner.0, size as usize - corner.1);
            let lod_edge_log2 =
                if bits >> 32 & 7 == 0 { u32::try_from(bits >> 40 & 15).unwrap_or(0) } else { 0 };
            let tile = Tile { corner, limits, lod_edge_log2: lod_edge_log2.min(view.depth()) };
            counts.compare_tile(view, &sight, tile);
        }
    }
    counts
}

/// Number of the voxel box at a cell, by descending from the root.
fn number_of(view: &ModelView<'_>, cell: [u32; 3]) -> Option<BoxIndex> {
    (0..view.depth()).rev().try_fold(BoxIndex::ROOT, |number, level| {
        let bit = |a: usize| cell[a] >> level & 1;
        view.child(number.node(), Octant::low_bits(bit(0) | bit(1) << 1 | bit(2) << 2))
    })
}

/// True if the hit's t is the time at which the quantised ray is at the entered face, to 2^-16 cell.
fn lies_on_face(ray: &Ray, hit: &Hit) -> bool {
    let per_t = ray.t_after(1, 1) - ray.t_start();
    let units = (hit.t - ray.t_start()) / per_t;
    if units == 0.0 {
        return true; // starts in the voxel, or enters it with the grid
    }
    let Some(face) = hit.face else { return false };
    let a = usize::from(face.axis);
    #[expect(clippy::cast_precision_loss, reason = "below 2^53")]
    let at = ray.origin()[a] as f64 + units * ray.direction()[a] as f64;
    let plane = f64::from(hit.cell[a] + u32::from(face.high)) * 65536.0;
    (at - plane).abs() <= 1.0
}

/// A small generator of uniform 64-bit numbers (Weyl sequence, Stafford's mixer 13): the same everywhere.
#[derive(Clone, Debug)]
pub struct Random(u64);

impl Random {
    /// Starts from a seed.
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// Next 64 bits.
    #[inline]
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ self.0 >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ z >> 31
    }

    /// Next number in 0..1, a multiple of 2^-53.
    #[inline]
    #[expect(clippy::cast_precision_loss, reason = "53 bits")]
    pub fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / 9_007_199_254_740_992.0
    }

    /// Next number in low..high.
    #[inline]
    pub fn range(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }
}

/// A random ray at a grid of 2^depth cells: from outside or inside, towards a point in the grid; one in
/// four has its origin or direction on a lattice, where ties happen.
pub fn random_ray(random: &mut Random, depth: u32) -> Option<Ray> {
    let side = f64::from(1_u32 << depth);
    let kind = random.bits();
    let (low, high) = if kind & 1 == 0 { (0.0, side) } else { (-1.5 * side, 2.5 * side) };
    let mut origin = [0.0; 3].map(|_: f64| random.range(low, high));
    let target = [0.0; 3].map(|_: f64| random.range(0.0, side));
    let mut direction: [f64; 3] = std::array::from_fn(|a| target[a] - origin[a]);
    match kind >> 1 & 15 {
        0 => origin = origin.map(f64::round),
        1 => origin = origin.map(|v| (v * 2.0).round() / 2.0),
        2 => {
            origin = origin.map(f64::round);
            direction = direction.map(f64::round);
        }
        3 => {
            let steps = side / 4.0;
            direction = direction.map(|v| (v / steps).round());
            origin = origin.map(|v| (v * 4.0).round() / 4.0);
        }
        _ => {}
    }
    Ray::new(depth, origin, direction, 0.0).ok().flatten()
}

/// Compares traversal and reference on `rays` random rays, alone and in batches, and a quarter as many in tiles; the same seed
/// gives the same rays.
///
/// Cost: about a microsecond per ray and 100 cells of side.
pub fn mismatches(view: &ModelView<'_>, volume: &BitVolume, rays: u64, seed: u64) -> Mismatches {
    let mut random = Random::new(seed);
    let mut counts = Mismatches::default();
    let mut lot = Vec::new();
    for _ in 0..rays {
        match random_ray(&mut random, view.depth()) {
            Some(ray) => {
                counts.compare(view, volume, &ray);
                lot.push(ray);
            }
            None => counts.rays += 1,
        }
        if lot.len() == LOT {
            counts.compare_batch(view, &lot, 0);
            lot.clear();
        }
    }
    counts.compare_batch(view, &lot, 0);
    counts.plus(tile_mismatches(view, rays / 4, seed))
}
