//! Ambient occlusion: the part of the sky above a surface that the model leaves open.
//!
//! From each visible point, rays go out over the hemisphere above it, more of them upwards as a matte surface is lit
//! (by the cosine); the share of them without a hit is the point's openness. Hollows turn dark, ridges stay bright.
//!
//! A ray starts where it leaves the boxes around the one that was hit (`leave`).
//!
//! Directions are a spiral by the golden angle. Points in mirrors have it turned in sixteen ways over four by four
//! pixels. Directly visible points share one spiral out over eight by eight pixels, so that few rays a pixel do, one or
//! four: `soften` takes the mean over the pixels around. Shared out over four by four, each direction's shadow would
//! have a visible edge. Directions depend on the pixel alone. All arithmetic is sums, products, quotients and roots in
//! one order, the same on every machine. Cost: 0.3 microseconds a ray, with the rays of a pixel in one batch.

use super::batch::Batch;
use super::cells::Cells;
use super::ray::Ray;
use super::ray_offset;
use super::space::GridSpace;
use super::surface::Skin;
use super::tile::RAYS;
use super::traverse::Hit;
use crate::cpu::Form;
use crate::geom::{cross, dot};
use crate::load::ModelView;

/// Most rays of a pixel.
pub(crate) const MAX_RAYS: u32 = 1024;

/// Rays between two checks of the process's memory.
const STEP_RAYS: usize = 64;

/// Cosine and sine of the golden angle.
const GOLDEN: [f64; 2] = [-0.737_368_878_078_319_7, 0.675_490_294_261_523_8];

/// Cosine and sine of a sixteenth of a turn.
const TURN: [f64; 2] = [0.923_879_532_511_286_7, 0.382_683_432_365_089_8];

/// Turns of the spiral in four by four pixels, all different, in this order.
const PIXELS: [usize; 16] = [0, 8, 2, 10, 12, 4, 14, 6, 3, 11, 1, 9, 15, 7, 13, 5];

/// Offsets for two by two blocks of four by four pixels, all different, in this order.
const BLOCKS: [usize; 4] = [0, 2, 3, 1];
/// Position of a block's directions between the directions of the spiral.
const BETWEEN: [usize; 4] = [2, 0, 3, 1];

/// Directions of rays; the axis upwards is the last.
#[derive(Clone, Debug)]
pub(crate) struct Sky {
    turned: Vec<Vec<[f64; 3]>>,
}

/// Buffers of a worker, from tile to tile of one model's picture: bricks seen by rays are remembered.
pub(crate) struct RayBatch {
    batch: Batch,
    rays: Vec<Ray>,
    /// The pixel of each ray.
    of: Vec<u8>,
    met: Vec<bool>,
    /// Number of rays with a hit, by pixel.
    closed: [u16; RAYS],
}

impl RayBatch {
    pub(crate) fn new(form: Form) -> Self {
        let (rays, of, met) = (Vec::new(), Vec::new(), Vec::new());
        Self { batch: Batch::new(form), rays, of, met, closed: [0; RAYS] }
    }

    /// Begins a tile.
    pub(crate) fn begin(&mut self) {
        self.closed = [0; RAYS];
    }

    /// Adds a ray of a pixel.
    pub(crate) fn add(&mut self, pixel: usize, ray: Ray) {
        self.rays.push(ray);
        self.of.push(pixel.to_le_bytes()[0]);
    }

    /// True if enough rays wait to be traced.
    pub(crate) fn is_full(&self) -> bool {
        self.rays.len() >= STEP_RAYS
    }

    /// Number of a pixel's rays with a hit.
    pub(crate) fn closed(&self, pixel: usize) -> u16 {
        self.closed[pixel % RAYS]
    }

    /// Traces the waiting rays.
    pub(crate) fn flush(&mut self, view: &ModelView<'_>, cells: Option<&Cells<'_>>, lod_edge_log2: u32) {
        if self.rays.is_empty() {
            return;
        }
        match cells {
            Some(cells) => self.batch.any_more(view, cells, &self.rays, lod_edge_log2, &mut self.met),
            None => self.batch.any_more(view, &Skin, &self.rays, lod_edge_log2, &mut self.met),
        }
        for (pixel, met) in self.of.iter().zip(&self.met) {
            self.closed[usize::from(*pixel) % RAYS] += u16::from(*met);
        }
        self.rays.clear();
        self.of.clear();
    }
}

/// A visible point with the position that its rays start from.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ShadedPoint<'a> {
    pub(crate) space: &'a GridSpace,
    pub(crate) hit: &'a Hit,
    /// Position in the world.
    pub(crate) point: [f64; 3],
    /// Unit normal in the world, on the visible side.
    pub(crate) normal: [f64; 3],
}

fn turned([x, y]: [f64; 2], [cosine, sine]: [f64; 2]) -> [f64; 2] {
    [x * cosine - y * sine, x * sine + y * cosine]
}

impl Sky {
    /// A sky of `rays` directions, at least one and at most [`MAX_RAYS`].
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
        let block = BLOCKS[x / 4 % 2 + y / 4 % 2 * 2];
        let at = PIXELS[x % 4 + y % 4 * 4] + block * PIXELS.len();
        self.turned.get(at % self.turned.len().max(1)).map_or(&[], Vec::as_slice)
    }

    /// A sky of `rays` directions for each of eight by eight pixels. The directions of four by four pixels make a
    /// spiral; the spiral of the next four by four is turned a little and lies between.
    pub(crate) fn shared(rays: u32) -> Self {
        let rays = rays.clamp(1, MAX_RAYS) as usize;
        let all = rays * PIXELS.len();
        let mut shared = vec![Vec::with_capacity(rays); BLOCKS.len() * PIXELS.len()];
        let mut first = [1.0, 0.0];
        for block in 0..BLOCKS.len() {
            let between = (BETWEEN[block] as f64 + 0.5) / BLOCKS.len() as f64;
            let mut around = first;
            for i in 0..all {
                let square = (i as f64 + between) / all as f64;
                let (across, up) = (square.sqrt(), (1.0 - square).sqrt());
                let directions = &mut shared[i % PIXELS.len() + block * PIXELS.len()];
                directions.push([around[0] * across, around[1] * across, up]);
                around = turned(around, GOLDEN);
            }
            first = turned(first, TURN);
        }
        Self { turned: shared }
    }
}

impl ShadedPoint<'_> {
    /// The ray from here into a direction of the world, from its exit from the boxes around; `None` if that is outside
    /// the grid.
    pub(crate) fn ray(&self, direction: [f64; 3]) -> Option<Ray> {
        ray_offset::leaving(self.space, (self.hit, ray_offset::REACH), self.point, direction, 0.0)
            .map(|(ray, _)| ray)
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
    use crate::memory_tree::MemoryTree;
    use crate::render::ray_offset::REACH;
    use crate::render::single;

    fn space(side: u32) -> GridSpace {
        GridSpace::new(Dims::new(side, side, side).unwrap(), &Affine::from_spacing([1.0; 3])).unwrap()
    }

    #[test]
    fn directions_are_of_unit_length_and_lit_by_the_cosine() {
        for rays in [1, 7, 64, 5000] {
            let sky = Sky::new(rays);
            for pixel in 0..16 {
                for sky in [&sky, &Sky::shared(rays)] {
                    let directions = sky.of([pixel % 4, pixel / 4]);
                    assert_eq!(directions.len(), rays.clamp(1, MAX_RAYS) as usize);
                    assert!(directions.iter().all(|d| (dot(*d, *d) - 1.0).abs() < 1e-12 && d[2] > 0.0));
                }
            }
        }
        // One ray of each of four by four pixels: also evenly spread.
        let shared = Sky::shared(1);
        let mean = |a: usize| (0..16).map(|at| shared.of([at % 4, at / 4])[0][a]).sum::<f64>() / 16.0;
        assert!((mean(2) - 2.0 / 3.0).abs() < 0.01 && mean(0).abs() < 0.06 && mean(1).abs() < 0.06);
        // The same over eight by eight pixels, with a smaller error.
        let mean = |a: usize| (0..64).map(|at| shared.of([at % 8, at / 8])[0][a]).sum::<f64>() / 64.0;
        assert!((mean(2) - 2.0 / 3.0).abs() < 0.001 && mean(0).abs() < 0.03 && mean(1).abs() < 0.03);
        // The mean height of cosine-weighted directions is 2/3, and all sides are equal.
        let sky = Sky::new(256);
        let mean = |a: usize| sky.of([0, 0]).iter().map(|d| d[a]).sum::<f64>() / 256.0;
        assert!((mean(2) - 2.0 / 3.0).abs() < 0.01 && mean(0).abs() < 0.01 && mean(1).abs() < 0.01);
    }

    /// A million rays out of a ball: they never hit the starting box or its neighbours, and, if they rise steeply,
    /// nothing.
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
            // From a point on a sphere around it, by the golden spiral, to the middle.
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
                    // Hits are steps of the staircase, by rays that rise little.
                    assert!(d[2] < 0.45, "{d:?} {hit:?} {other:?}");
                }
            }
        }
        assert!(rays >= 1_000_000 && met < rays / 50, "{met} of {rays}");
    }
}
