//! Ambient occlusion: how much of the sky above a surface the model leaves open.
//!
//! From each point that is seen, rays go out over the hemisphere above it, more of them upwards as a matt surface is lit
//! (by the cosine); the part of them that meets nothing is the point's openness. Hollows turn dark, ridges stay bright.
//!
//! A ray starts where it leaves the boxes around the one that was hit (`leave`).
//!
//! Directions are a spiral by the golden angle, turned in sixteen ways over four by four pixels: they depend on the pixel
//! alone. All of it is additions, products, quotients and roots in one order, the same on every machine. Cost: 0.3 microseconds
//! a ray, those of a pixel in one batch.

use std::time::{Duration, Instant};

use rayon::prelude::*;

use crate::geom::{add_scaled, cross, dot};
use crate::load::ModelView;

use super::batch::Batch;
use crate::geom::NodeIndex;

use super::form::Form;
use super::leave;
use super::normals::around::Surroundings;
use super::picture::{Openness, Painter};
use super::ray::Ray;
use super::space::GridSpace;
use super::surface::Surface;
use super::tile::{RAYS, TILE, Tile, Tracer};
use super::traverse::{Hit, Trace};

/// Most rays of a pixel.
pub(crate) const MAX_RAYS: u32 = 1024;

/// Rays between two looks at the process's memory.
const STEP_RAYS: usize = 16;

/// Cosine and sine of the golden angle.
const GOLDEN: [f64; 2] = [-0.737_368_878_078_319_7, 0.675_490_294_261_523_8];

/// Cosine and sine of a sixteenth of a turn.
const TURN: [f64; 2] = [0.923_879_532_511_286_7, 0.382_683_432_365_089_8];

/// Pixels that share no directions, and the order in which they are turned.
const PIXELS: [usize; 16] = [0, 8, 2, 10, 12, 4, 14, 6, 3, 11, 1, 9, 15, 7, 13, 5];

/// The directions that rays go out to; the axis upwards is the last.
#[derive(Clone, Debug)]
pub(crate) struct Sky {
    turned: Vec<Vec<[f64; 3]>>,
}

/// The memory of a worker, from pixel to pixel.
pub(super) struct Lot {
    batch: Batch,
    rays: Vec<Ray>,
    met: Vec<bool>,
}

impl Lot {
    fn new(form: Form) -> Self {
        Self { batch: Batch::new(form), rays: Vec::new(), met: Vec::new() }
    }
}

/// A point that is seen, where its light comes from.
#[derive(Clone, Copy, Debug)]
pub(super) struct ShadedPoint<'a> {
    pub(super) space: &'a GridSpace,
    pub(super) hit: &'a Hit,
    /// In the world.
    pub(super) point: [f64; 3],
    /// Unit vector of the world, on the side that is seen.
    pub(super) normal: [f64; 3],
}

fn turned([x, y]: [f64; 2], [cosine, sine]: [f64; 2]) -> [f64; 2] {
    [x * cosine - y * sine, x * sine + y * cosine]
}

impl Sky {
    /// So many directions, at least one and at most [`MAX_RAYS`].
    pub(crate) fn new(rays: u32) -> Self {
        let rays = rays.clamp(1, MAX_RAYS);
        let mut first = [1.0, 0.0];
        let mut all = Vec::with_capacity(PIXELS.len());
        for turn in 0..PIXELS.len() {
            let mut around = first;
            let directions = (0..rays).map(|i| {
                let square = (f64::from(i) + (turn as f64 + 0.5) / PIXELS.len() as f64) / f64::from(rays);
                let (across, up) = (square.sqrt(), (1.0 - square).sqrt());
                let direction = [around[0] * across, around[1] * across, up];
                around = turned(around, GOLDEN);
                direction
            });
            all.push(directions.collect());
            first = turned(first, TURN);
        }
        Self { turned: all }
    }

    /// The directions of a pixel.
    pub(crate) fn of(&self, [x, y]: [usize; 2]) -> &[[f64; 3]] {
        self.turned.get(PIXELS[x % 4 + y % 4 * 4]).map_or(&[], Vec::as_slice)
    }

    /// Part of a pixel's directions above a place that the model leaves open: 0 to 255.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 255")]
    pub(super) fn openness<S: Surface>(
        &self,
        lot: &mut Lot,
        (view, surface): (&ModelView<'_>, &S),
        place: &ShadedPoint<'_>,
        pixel: [usize; 2],
        between: &dyn Fn(),
    ) -> u8 {
        let directions = self.of(pixel);
        let [right, ahead] = tangents(place.normal);
        let mut closed = 0;
        for directions in directions.chunks(STEP_RAYS) {
            lot.rays.clear();
            lot.rays.extend(directions.iter().filter_map(|d| {
                let world =
                    std::array::from_fn(|a| right[a] * d[0] + ahead[a] * d[1] + place.normal[a] * d[2]);
                place.ray(world)
            }));
            // Larger leaves are not coarse boxes.
            let is_leaf = view.is_leaf(NodeIndex::new(place.hit.box_number));
            let lod_edge_log2 = if is_leaf { 0 } else { place.hit.edge_log2 };
            lot.batch.any(view, surface, &lot.rays, lod_edge_log2, &mut lot.met);
            closed += lot.met.iter().filter(|met| **met).count();
            between();
        }
        let closed = closed as f64 / directions.len().max(1) as f64;
        ((1.0 - closed) * 255.0 + 0.5) as u8
    }
}

impl ShadedPoint<'_> {
    /// The ray from here into a direction of the world, from where it leaves the boxes around; `None` where that is
    /// outside the grid.
    fn ray(&self, direction: [f64; 3]) -> Option<Ray> {
        leave::leaving(self.space, (self.hit, leave::REACH), self.point, direction, 0.0).map(|(ray, _)| ray)
    }
}

impl<S: Surface> Painter<'_, S> {
    /// Finds how open the surroundings of every pixel of some rows are, if that is asked for; the time it took.
    pub(super) fn look_around(&mut self, from: usize, rows: usize) -> Duration {
        let start = Instant::now();
        let rows_done = self.watch.rows_done;
        if self.canvas.ambient_rays == 0 {
            return Duration::ZERO;
        }
        let sky = Sky::new(self.canvas.ambient_rays);
        let width = self.canvas.width as usize;
        let mut open = vec![u8::MAX; width * rows];
        open.par_chunks_mut(width * TILE).enumerate().for_each_init(
            || (Tracer::new(self.form), Surroundings::new(), Lot::new(self.form)),
            |(tracer, around, lot), (tile_row, rows)| {
                let (top, height) = (from + tile_row * TILE, rows.len() / width);
                for left in (0..width).step_by(TILE) {
                    let limits = (TILE.min(width - left), height);
                    let tile = Tile { corner: (left, top), limits, lod_edge_log2: self.canvas.lod_edge_log2 };
                    let hits = tracer.trace(self.view, &self.surface, &self.sight, tile);
                    self.watch.step();
                    for ray in 0..RAYS {
                        let (Some(hit), (x, y)) = (hits.hit(ray), (left + ray % TILE, ray / TILE)) else {
                            continue;
                        };
                        if let Some(open) = rows.get_mut(y * width + x) {
                            *open = self.openness(&sky, (around, lot), hit, [x, top + y]);
                        }
                    }
                }
                #[expect(clippy::cast_possible_truncation, reason = "rows of a tile")]
                rows_done(height as u32);
            },
        );
        self.open = Openness { top: from, pixels: open };
        start.elapsed()
    }

    /// How open the surroundings of a pixel's hit are.
    fn openness(
        &self,
        sky: &Sky,
        (around, lot): (&mut Surroundings, &mut Lot),
        hit: Hit,
        pixel: [usize; 2],
    ) -> u8 {
        let [x, y] = pixel.map(|c| c as f64 + 0.5);
        let line @ (origin, sight) = self.sight.line(x, y);
        let seen = self.seen(&Trace { hit: Some(hit), steps: 0 }, x, y);
        let normal = self.normals.normal(around, seen, line);
        let away = dot(normal, sight) > 0.0;
        let place = ShadedPoint {
            space: self.sight.space(),
            hit: &hit,
            point: add_scaled(origin, hit.t, sight),
            normal: if away { normal.map(|c| -c) } else { normal },
        };
        sky.openness(lot, (self.view, &self.surface), &place, pixel, self.watch.between)
    }
}

/// Two unit vectors perpendicular to a unit vector and to each other.
pub(crate) fn tangents(normal: [f64; 3]) -> [[f64; 3]; 2] {
    let size = normal.map(f64::abs);
    let least = (1..3).fold(0, |least, a| if size[a] < size[least] { a } else { least });
    let mut axis = [0.0; 3];
    axis[least] = 1.0;
    let across = cross(normal, axis);
    let length = dot(across, across).sqrt();
    let right = across.map(|c| c / length);
    [right, cross(normal, right)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::{Affine, Dims};
    use crate::load::MemoryTree;
    use crate::render::leave::REACH;
    use crate::render::picture::{Canvas, Traversal, paint};
    use crate::render::single;
    use crate::render::surface::Skin;
    use crate::render::{Camera, NamedView, Projection, ViewPoint};

    fn space(side: u32) -> GridSpace {
        GridSpace::new(Dims::new(side, side, side).unwrap(), &Affine::from_spacing([1.0; 3])).unwrap()
    }

    #[test]
    fn directions_are_of_unit_length_and_lit_by_the_cosine() {
        for rays in [1, 7, 64, 5000] {
            let sky = Sky::new(rays);
            for pixel in 0..16 {
                let directions = sky.of([pixel % 4, pixel / 4]);
                assert_eq!(directions.len(), rays.clamp(1, MAX_RAYS) as usize);
                assert!(directions.iter().all(|d| (dot(*d, *d) - 1.0).abs() < 1e-12 && d[2] > 0.0));
            }
        }
        // The mean height of directions by the cosine is 2/3, and they have no side that they favour.
        let sky = Sky::new(256);
        let mean = |a: usize| sky.of([0, 0]).iter().map(|d| d[a]).sum::<f64>() / 256.0;
        assert!((mean(2) - 2.0 / 3.0).abs() < 0.01 && mean(0).abs() < 0.01 && mean(1).abs() < 0.01);
    }

    /// A plate as it is seen from above, with a wall around the middle of it.
    #[test]
    fn walls_darken_what_they_surround_and_a_plate_alone_stays() {
        let dims = Dims::new(32, 32, 32).unwrap();
        let picture = |wall: u32, ambient_rays, threads| {
            let around = |c: u32| (10..22).contains(&c);
            let edge = |x: u32, y: u32| around(x) && around(y) && [x, y].iter().any(|c| *c == 10 || *c == 21);
            let all = (0..32_u32 * 32 * 32).map(|i| [i % 32, i / 32 % 32, i / 1024]);
            let is_skin = |[x, y, z]: &[u32; 3]| *z == 4 || (edge(*x, *y) && (5..5 + wall).contains(z));
            let tree = MemoryTree::of_cells(dims, all.filter(is_skin));
            let space = space(32);
            let support = |direction| space.support(&tree.view(), direction);
            let top = ViewPoint::Named(NamedView::Top);
            let camera = Camera::new(top, Projection::Parallel, 35.0, 1.0, support).unwrap();
            let canvas = Canvas {
                width: 48,
                height: 48,
                threads,
                lod_edge_log2: 0,
                smooth_edges: true,
                depth_range_mm: None,
                normals: false,
                ids: false,
                blended: false,
                ambient_rays,
                traversal: Traversal::Exact,
                most_band_pixels: None,
            };
            let (image, _) = paint(&tree.view(), &space, &camera, canvas).unwrap();
            image.rgba
        };
        assert_eq!(picture(0, 16, 1), picture(0, 0, 2));
        let (plain, dark) = (picture(8, 0, 1), picture(8, 16, 1));
        assert_eq!(dark, picture(8, 16, 3));
        let middle = 4 * (24 * 48 + 24);
        assert!(dark[middle] < plain[middle] - 30, "{} {}", dark[middle], plain[middle]);
        assert!(plain.iter().zip(&dark).all(|(plain, dark)| dark <= plain));
    }

    /// A million rays out of a ball: none meets the box that it comes from, nor those next to it, nor any that it rises
    /// from steeply.
    #[test]
    fn no_ray_of_a_ball_meets_where_it_comes_from() {
        let side = 64_u32;
        let middle = 32.0;
        let inside = |c: [u32; 3]| {
            let d = c.map(|c| f64::from(c) + 0.5 - middle);
            dot(d, d) <= 24.0 * 24.0
        };
        let all = (0..side * side * side).map(|i| [i % side, i / side % side, i / side / side]);
        let is_skin = |c: &[u32; 3]| {
            let next = |n: u32| [c[0] + n % 3, c[1] + n / 3 % 3, c[2] + n / 9].map(|c| c.wrapping_sub(1));
            inside(*c) && (0..27).any(|n| !inside(next(n)))
        };
        let tree = MemoryTree::of_cells(Dims::new(side, side, side).unwrap(), all.filter(is_skin));
        let (space, sky) = (space(side), Sky::new(256));
        let (mut rays, mut met) = (0_u32, 0_u32);
        for at in 0..4096_usize {
            // From a sphere around it, by the golden spiral, to the middle.
            let z = 1.0 - (2.0 * at as f64 + 1.0) / 4096.0;
            let [x, y] = (0..at % 977).fold([1.0, 0.0], |v, _| turned(v, GOLDEN));
            let outward = [x * (1.0 - z * z).sqrt(), y * (1.0 - z * z).sqrt(), z];
            let from = outward.map(|c| middle - 0.5 + 40.0 * c);
            let ray = space.ray(from, outward.map(|c| -c)).unwrap().unwrap();
            let hit = single::trace(Form::best(), &tree.view(), &Skin, &ray, 0).hit.unwrap();
            let point = std::array::from_fn(|a| from[a] - hit.t * outward[a]);
            let place = ShadedPoint { space: &space, hit: &hit, point, normal: outward };
            let [right, ahead] = tangents(outward);
            for d in sky.of([at % 4, at / 4]) {
                let world = std::array::from_fn(|a| right[a] * d[0] + ahead[a] * d[1] + outward[a] * d[2]);
                let Some(ray) = place.ray(world) else { continue };
                rays += 1;
                if let Some(other) = single::trace(Form::best(), &tree.view(), &Skin, &ray, 0).hit {
                    met += 1;
                    let apart = (0..3).map(|a| other.cell[a].abs_diff(hit.cell[a])).max().unwrap();
                    assert!(apart > REACH, "{hit:?} {other:?}");
                    // What is met is the stair, by rays that rise little.
                    assert!(d[2] < 0.45, "{d:?} {hit:?} {other:?}");
                }
            }
        }
        assert!(rays >= 1_000_000 && met < rays / 50, "{met} of {rays}");
    }
}
