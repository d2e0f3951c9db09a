//! Rays of an array that are neighbours: whether eight by eight of them make a tile, and the tile.
//!
//! A tile's estimates need lines whose origins and directions are affine in the pixel. Directions of length 1 are not,
//! but lines are the same if directions are divided by their part along the tile's mean direction, and those of a
//! pinhole camera then are. So the affine functions that fit best are taken, and how far any of the 64 lines is from
//! them within the grid is measured and added to the tile's slack; above [`MAX_OFF`] cells the rays go another way.
//! Estimates only: what is hit is decided by the exact rays, as always.

use crate::cpu::Lanes;
use crate::render::ray::{BadRay, Ray};
use crate::render::sight::{MAX_CELLS, Pencil, Row, Sight, quantised};
use crate::render::space::GridSpace;

use super::beam::{RAYS, SURELY_MOVES, TILE};

/// How far a line may be from its estimate, in cells: a tile at this takes about 1.3 times as long as one at 0.
pub(super) const MAX_OFF: f64 = 0.02;

/// How many times as far as from the first ray to the second is to the first ray of the next row, at least.
const JUMP: f64 = 4.0;

/// A step from a ray to the next may be this part of the numbers that it is between: their rounding.
const ROUNDING: f64 = 1e-9;

/// 64 rays in grid space, in rows of eight.
#[derive(Clone, Debug)]
pub(crate) struct Listed {
    depth: u32,
    origin: [[f64; RAYS]; 3],
    direction: [[f64; RAYS]; 3],
}

/// Where the rays of a tile come from. Tiles are compiled for each apart: chosen at run time, skin took 8 % more.
pub(super) trait Source: Copy {
    /// Are rays that make no tile left to the caller?
    const LEAVES: bool;

    /// Depth of the grid.
    fn depth(self) -> u32;

    /// The rays as affine functions of the pixel counted from the tile's corner, where they are that nearly.
    fn pencil(self, corner: (usize, usize)) -> Option<Pencil>;

    /// A row of the tile's rays.
    fn row<L: Lanes>(self, l: L, corner: (usize, usize), row: usize) -> Row<L>;

    /// A ray of the tile by itself; `None` when it misses the grid.
    fn ray(self, corner: (usize, usize), ray: usize) -> Option<Ray>;
}

impl Source for &Sight<'_> {
    const LEAVES: bool = false;

    #[inline(always)]
    fn depth(self) -> u32 {
        self.space().dims().depth()
    }

    #[inline(always)]
    fn pencil(self, corner: (usize, usize)) -> Option<Pencil> {
        Sight::pencil(self, corner)
    }

    #[inline(always)]
    fn row<L: Lanes>(self, l: L, corner: (usize, usize), row: usize) -> Row<L> {
        Sight::row(self, l, (corner.0, corner.1 + row))
    }

    fn ray(self, corner: (usize, usize), ray: usize) -> Option<Ray> {
        let (x, y) = (corner.0 + ray % TILE, corner.1 + ray / TILE);
        Sight::ray(self, x as f64 + 0.5, y as f64 + 0.5)
    }
}

impl Source for &Listed {
    const LEAVES: bool = true;

    #[inline(always)]
    fn depth(self) -> u32 {
        self.depth
    }

    fn pencil(self, _: (usize, usize)) -> Option<Pencil> {
        self.fitted()
    }

    #[inline(always)]
    fn row<L: Lanes>(self, l: L, _: (usize, usize), row: usize) -> Row<L> {
        let origin = each3!(A => l.d_load(&self.origin[A].as_chunks().0[row % TILE]));
        let direction = each3!(A => l.d_load(&self.direction[A].as_chunks().0[row % TILE]));
        quantised(l, self.depth, origin, direction)
    }

    fn ray(self, _: (usize, usize), ray: usize) -> Option<Ray> {
        let of = |values: &[[f64; RAYS]; 3]| each3!(A => values[A][ray % RAYS]);
        // Rays that are refused were seen to before.
        Ray::new(self.depth, of(&self.origin), of(&self.direction), 0.0).ok().flatten()
    }
}

impl Listed {
    /// No rays yet.
    pub(crate) const fn new(depth: u32) -> Self {
        Self { depth, origin: [[0.0; RAYS]; 3], direction: [[0.0; RAYS]; 3] }
    }

    /// Takes the rays of a tile, origin and direction in the world.
    ///
    /// # Errors
    /// Some ray is refused.
    #[inline]
    pub(crate) fn fill(
        &mut self,
        space: &GridSpace,
        lines: impl Fn(usize) -> ([f64; 3], [f64; 3]),
    ) -> Result<(), BadRay> {
        let matrix = space.world_to_grid();
        let (mut sum, mut null) = (0.0, false);
        for ray in 0..RAYS {
            let (origin, direction) = lines(ray);
            let (origin, direction) = (matrix.apply(origin), matrix.apply_vector(direction));
            let mut size = 0.0;
            for a in 0..3 {
                (self.origin[a][ray], self.direction[a][ray]) = (origin[a], direction[a]);
                sum += (origin[a] + direction[a]) * 0.0;
                size += direction[a].abs();
            }
            null |= size == 0.0;
        }
        // 0 times NaN or infinity is NaN.
        if sum != 0.0 {
            return Err(BadRay::NotFinite);
        }
        if null { Err(BadRay::NoDirection) } else { Ok(()) }
    }

    /// The affine functions that fit best, if they fit.
    fn fitted(&self) -> Option<Pencil> {
        let mean = each3!(A => self.direction[A].iter().sum::<f64>());
        let mut part = [0.0; RAYS];
        let mut least = f64::MAX;
        for (ray, part) in part.iter_mut().enumerate() {
            let along = (0..3).fold(0.0, |sum, a| sum + self.direction[a][ray] * mean[a]);
            *part = 1.0 / along;
            least = if along < least { along } else { least };
        }
        let is_far = self.origin.iter().flatten().any(|o| o.abs() > MAX_CELLS);
        let all_ahead = least > 0.0;
        if is_far || !all_ahead {
            return None;
        }
        let (mut origin, mut direction, mut off) = ([[0.0; 3]; 3], [[0.0; 3]; 3], [[0.0; 3]; 2]);
        let mut scaled = [0.0; RAYS];
        for a in 0..3 {
            for (scaled, (direction, part)) in scaled.iter_mut().zip(self.direction[a].iter().zip(&part)) {
                *scaled = direction * part;
            }
            (direction[0][a], direction[1][a], direction[2][a], off[1][a]) = fitted(&scaled);
            (origin[0][a], origin[1][a], origin[2][a], off[0][a]) = fitted(&self.origin[a]);
        }
        let pencil = Pencil { origin, direction, off: Some(off) };
        self.moves_alike(&part).then_some(pencil)
    }

    /// Does every axis have all rays run along it one way, or none at all? Beams rest on that.
    fn moves_alike(&self, part: &[f64; RAYS]) -> bool {
        let size =
            |ray: usize| (0..3).fold(0.0_f64, |m, a| m.max((self.direction[a][ray] * part[ray]).abs()));
        let longest = (0..RAYS).fold(0.0_f64, |m, ray| m.max(size(ray)));
        self.direction.iter().all(|direction| {
            let (mut low, mut high, mut nearest) = (f64::MAX, f64::MIN, f64::MAX);
            for (direction, part) in direction.iter().zip(part) {
                let d = direction * part;
                (low, high, nearest) = (low.min(d), high.max(d), nearest.min(d.abs()));
            }
            let is_still = low == 0.0 && high == 0.0;
            is_still || (low * high > 0.0 && nearest > 2.0 * SURELY_MOVES * longest)
        })
    }
}

/// The affine function of the pixel that fits best by least squares, as its value at pixel (0, 0) and its changes with x
/// and y; and how far it is off at most.
fn fitted(values: &[f64; RAYS]) -> (f64, f64, f64, f64) {
    /// Sum of squares of a pixel's distance from the tile's middle along an axis, over the tile.
    const SQUARES: f64 = 336.0;
    let middle = (TILE - 1) as f64 / 2.0;
    let (mut sum, mut x_sum, mut y_sum) = (0.0, 0.0, 0.0);
    for (row, values) in values.as_chunks::<TILE>().0.iter().enumerate() {
        for (column, value) in values.iter().enumerate() {
            sum += value;
            x_sum += (column as f64 - middle) * value;
            y_sum += (row as f64 - middle) * value;
        }
    }
    let (x, y) = (x_sum / SQUARES, y_sum / SQUARES);
    let first = sum / RAYS as f64 - middle * (x + y);
    let mut off = 0.0_f64;
    for (row, values) in values.as_chunks::<TILE>().0.iter().enumerate() {
        for (column, value) in values.iter().enumerate() {
            off = off.max((first + column as f64 * x + row as f64 * y - value).abs());
        }
    }
    (first, x, y, off)
}

/// Rays of a row, if an array looks as if it were an image's: there directions or origins jump first.
pub(crate) fn row_of(origins: &[[f64; 3]], directions: &[[f64; 3]]) -> Option<usize> {
    let step = |lines: &[[f64; 3]], at: usize| -> Option<(f64, f64)> {
        let (before, here) = (lines.get(at - 1)?, lines.get(at)?);
        let far = (0..3).fold(0.0_f64, |m, a| m.max((here[a] - before[a]).abs()));
        let size = (0..3).fold(0.0_f64, |m, a| m.max(here[a].abs()));
        Some((far, size * ROUNDING))
    };
    let (origin, direction) = (step(origins, 1)?, step(directions, 1)?);
    let jumps = |(far, rounding): (f64, f64), first: (f64, f64)| far > JUMP * first.0 + rounding;
    let mut at = 2;
    loop {
        if jumps(step(origins, at)?, origin) || jumps(step(directions, at)?, direction) {
            return Some(at);
        }
        at += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cpu::Form;
    use crate::geom::{Affine, Dims};
    use crate::memory_tree::MemoryTree;
    use crate::render::surface::Skin;
    use crate::render::tile::Tracer;

    #[test]
    fn an_affine_function_is_fitted_and_what_is_left_is_measured() {
        let mut values: [f64; RAYS] =
            std::array::from_fn(|i| 3.0 + (i % 8) as f64 * 0.5 - (i / 8) as f64 * 2.0);
        let (first, x, y, off) = fitted(&values);
        assert!((first - 3.0).abs() < 1e-12 && (x - 0.5).abs() < 1e-12 && (y + 2.0).abs() < 1e-12);
        assert!(off < 1e-12);
        values[20] += 1.0;
        assert!(fitted(&values).3 > 0.9);
    }

    #[test]
    fn a_pinholes_rays_go_together_and_scattered_ones_do_not() {
        let dims = Dims::new(64, 64, 64).unwrap();
        let tree = MemoryTree::new(dims, &(0..64_u64.pow(3)).collect::<Vec<_>>()).unwrap();
        let space = GridSpace::new(dims, &Affine::from_spacing([1.0; 3])).unwrap();
        let mut listed = Listed::new(space.dims().depth());
        for (moved, asked, left) in [(0.0, u64::MAX, 0), (0.1, u64::MAX, u64::MAX), (0.1, 7, 7)] {
            let line = |ray: usize| {
                let d = [(ray % 8) as f64 * 0.001 + 0.1, (ray / 8) as f64 * 0.001 + 0.2, 1.0];
                let length = d.iter().map(|c| c * c).sum::<f64>().sqrt();
                ([20.0 + if ray == 9 { moved } else { 0.0 }, 15.0, -50.0], d.map(|c| c / length))
            };
            listed.fill(&space, line).unwrap();
            for form in Form::available() {
                let mut tracer = Tracer::new(form);
                let (hits, rest) = tracer.trace_listed(&tree.view(), &Skin, &listed, asked);
                assert_eq!((rest, hits.bits() == 0), (left, left != 0), "{form:?}");
            }
        }
    }

    #[test]
    fn rows_end_where_lines_jump() {
        let pinhole = |i: usize| {
            let d = [(i % 20) as f64 - 9.5, (i / 20) as f64 - 5.0, 30.0];
            let length = d.iter().map(|c| c * c).sum::<f64>().sqrt();
            d.map(|c| c / length)
        };
        let directions: Vec<_> = (0..200).map(pinhole).collect();
        let (here, ahead) = (vec![[1.0, 2.0, 3.0]; 200], vec![[0.0, 0.0, 1.0]; 200]);
        assert_eq!(row_of(&here, &directions), Some(20));
        let origins: Vec<_> = (0..200).map(|i| [f64::from(i % 25), f64::from(i / 25), 0.0]).collect();
        assert_eq!(row_of(&origins, &ahead), Some(25));
        assert_eq!(row_of(&here, &ahead), None);
        assert_eq!(row_of(&[], &[]), None);
    }
}
