//! Rays of an array that are neighbours: the fit of eight by eight of them to a tile.
//!
//! A tile's estimates need lines whose origins and directions are affine in the pixel. Directions of length 1 are not,
//! but lines are the same if directions are divided by their part along the tile's mean direction, and those of a
//! pinhole camera then are. So the best affine functions are fitted, and the largest distance of the 64 lines from them
//! within the grid is measured and added to the tile's slack; above [`MAX_OFF`] cells the rays go another way. These
//! are estimates only: hits are always decided by the exact rays.

use crate::cpu::{DOUBLES, Form, Kernel, Lanes, Truths};
use crate::geom::Affine;
use crate::render::pixel_rays::{MAX_CELLS, Pencil, PixelRays, Row, quantised};
use crate::render::ray::{BadRay, Ray};
use crate::render::space::GridSpace;

use super::beam::{RAYS, SURELY_MOVES, TILE};

/// Largest distance of a line from its estimate, in cells: a tile at this takes about 1.3 times as long as one at 0.
pub(super) const MAX_OFF: f64 = 0.02;

/// 64 rays in grid space, in rows of eight. Rays of a line, or of a column, are also affine in the row and the index in
/// it.
#[derive(Clone, Debug)]
pub(crate) struct Listed {
    depth: u32,
    origin: [[f64; RAYS]; 3],
    direction: [[f64; RAYS]; 3],
}

/// Source of a tile's rays. Tiles are compiled for each separately: with a choice at run time, skin took 8 % more.
pub(super) trait Source: Copy {
    /// True if rays that do not form a tile are left to the caller.
    const LEAVES: bool;

    /// Depth of the grid.
    fn depth(self) -> u32;

    /// The rays as affine functions of the pixel counted from the tile's corner, if they are close to it.
    fn pencil<L: Lanes>(self, l: L, corner: (usize, usize)) -> Option<Pencil>;

    /// A row of the tile's rays.
    fn row<L: Lanes>(self, l: L, corner: (usize, usize), row: usize) -> Row<L>;

    /// A ray of the tile by itself; `None` when it misses the grid.
    fn ray(self, corner: (usize, usize), ray: usize) -> Option<Ray>;
}

impl Source for &PixelRays<'_> {
    const LEAVES: bool = false;

    #[inline(always)]
    fn depth(self) -> u32 {
        self.space().dims().depth()
    }

    #[inline(always)]
    fn pencil<L: Lanes>(self, _: L, corner: (usize, usize)) -> Option<Pencil> {
        PixelRays::pencil(self, corner)
    }

    #[inline(always)]
    fn row<L: Lanes>(self, l: L, corner: (usize, usize), row: usize) -> Row<L> {
        PixelRays::row(self, l, (corner.0, corner.1 + row))
    }

    fn ray(self, corner: (usize, usize), ray: usize) -> Option<Ray> {
        let (x, y) = (corner.0 + ray % TILE, corner.1 + ray / TILE);
        PixelRays::ray(self, x as f64 + 0.5, y as f64 + 0.5)
    }
}

impl Source for &Listed {
    const LEAVES: bool = true;

    #[inline(always)]
    fn depth(self) -> u32 {
        self.depth
    }

    #[inline(always)]
    fn pencil<L: Lanes>(self, l: L, _: (usize, usize)) -> Option<Pencil> {
        self.fitted(l)
    }

    #[inline(always)]
    fn row<L: Lanes>(self, l: L, _: (usize, usize), row: usize) -> Row<L> {
        let origin = each3!(A => l.d_load(&self.origin[A].as_chunks().0[row % TILE]));
        let direction = each3!(A => l.d_load(&self.direction[A].as_chunks().0[row % TILE]));
        quantised(l, self.depth, origin, direction)
    }

    fn ray(self, _: (usize, usize), ray: usize) -> Option<Ray> {
        let of = |values: &[[f64; RAYS]; 3]| each3!(A => values[A][ray % RAYS]);
        // Invalid rays were refused before.
        Ray::new(self.depth, of(&self.origin), of(&self.direction), 0.0).ok().flatten()
    }
}

impl Listed {
    /// A group without rays.
    pub(crate) const fn new(depth: u32) -> Self {
        Self { depth, origin: [[0.0; RAYS]; 3], direction: [[0.0; RAYS]; 3] }
    }

    /// Sets the rays of a tile: `numbers` selects their lines in the world.
    ///
    /// # Errors
    /// A ray is invalid.
    pub(crate) fn fill(
        &mut self,
        form: Form,
        space: &GridSpace,
        lines: (&[[f64; 3]], &[[f64; 3]]),
        numbers: impl Fn(usize) -> usize,
    ) -> Result<(), BadRay> {
        form.run(Fill { listed: self, matrix: space.world_to_grid(), lines, numbers })
    }

    /// The best affine functions, if they fit.
    #[inline(always)]
    fn fitted<L: Lanes>(&self, l: L) -> Option<Pencil> {
        let mut totals = [l.d(0.0); 3];
        for (total, direction) in totals.iter_mut().zip(&self.direction) {
            for row in direction.as_chunks::<DOUBLES>().0 {
                *total = *total + l.d_load(row);
            }
        }
        let mean = each3!(A => l.d(sum(l, totals[A])));
        let mut part = [0.0; RAYS];
        let (mut least, mut farthest) = (l.d(f64::MAX), l.d(0.0));
        for row in 0..TILE {
            let d = each3!(A => l.d_load(&self.direction[A].as_chunks().0[row]));
            let along = d[0] * mean[0] + d[1] * mean[1] + d[2] * mean[2];
            least = l.d_choose(l.d_lt(along, least), along, least);
            l.d_store(l.d(1.0) / along, &mut part.as_chunks_mut().0[row]);
            for origin in &self.origin {
                farthest = larger(l, farthest, l.d_abs(l.d_load(&origin.as_chunks().0[row])));
            }
        }
        let is_far = (l.d_lt(l.d(MAX_CELLS), farthest)).bits() & 0xff != 0;
        let all_ahead = l.d_lt(l.d(0.0), least).bits() & 0xff == 0xff;
        if is_far || !all_ahead {
            return None;
        }
        let (mut origin, mut direction, mut off) = ([[0.0; 3]; 3], [[0.0; 3]; 3], [[0.0; 3]; 2]);
        let mut scaled = [[0.0; RAYS]; 3];
        for a in 0..3 {
            for row in 0..TILE {
                let at = l.d_load(&self.direction[a].as_chunks().0[row]) * l.d_load(&part.as_chunks().0[row]);
                l.d_store(at, &mut scaled[a].as_chunks_mut().0[row]);
            }
            (direction[0][a], direction[1][a], direction[2][a], off[1][a]) = fitted(l, &scaled[a]);
            (origin[0][a], origin[1][a], origin[2][a], off[0][a]) = fitted(l, &self.origin[a]);
        }
        let pencil = Pencil { origin, direction, off: Some(off) };
        move_alike(l, &scaled).then_some(pencil)
    }
}

/// [`Listed::fill`] for any lanes.
struct Fill<'a, F> {
    listed: &'a mut Listed,
    matrix: &'a Affine,
    lines: (&'a [[f64; 3]], &'a [[f64; 3]]),
    numbers: F,
}

impl<F: Fn(usize) -> usize> Kernel for Fill<'_, F> {
    type Output = Result<(), BadRay>;

    #[inline(always)]
    fn run(self, l: impl Lanes) -> Result<(), BadRay> {
        let Self { listed, matrix, lines, numbers } = self;
        let (mut sum, zero) = (l.d(0.0), l.d(0.0));
        let mut null = l.d_lt(zero, zero);
        for row in 0..TILE {
            let (mut from, mut along) = ([[0.0; DOUBLES]; 3], [[0.0; DOUBLES]; 3]);
            for i in 0..TILE {
                let number = numbers(row * TILE + i);
                let (origin, direction) = (&lines.0[number], &lines.1[number]);
                for a in 0..3 {
                    (from[a][i], along[a][i]) = (origin[a], direction[a]);
                }
            }
            let (from, along) = (each3!(A => l.d_load(&from[A])), each3!(A => l.d_load(&along[A])));
            let mut size = zero;
            for a in 0..3 {
                // The operations of `Affine::apply`, in its order; no closures, in which instructions would be calls.
                let r = matrix.rows[a];
                let (x, y, z) = (l.d(r[0]), l.d(r[1]), l.d(r[2]));
                let origin = x * from[0] + y * from[1] + z * from[2] + l.d(r[3]);
                let direction = x * along[0] + y * along[1] + z * along[2];
                l.d_store(origin, &mut listed.origin[a].as_chunks_mut().0[row]);
                l.d_store(direction, &mut listed.direction[a].as_chunks_mut().0[row]);
                sum = sum + (origin + direction) * zero;
                size = size + l.d_abs(direction);
            }
            null = null | l.d_eq(size, zero);
        }
        // 0 times NaN or infinity is NaN.
        if l.d_eq(sum, zero).bits() & 0xff != 0xff {
            return Err(BadRay::NotFinite);
        }
        if null.bits() & 0xff != 0 { Err(BadRay::NoDirection) } else { Ok(()) }
    }
}

#[inline(always)]
fn larger<L: Lanes>(l: L, one: L::D, other: L::D) -> L::D {
    l.d_choose(l.d_lt(one, other), other, one)
}

/// Sum of all lanes.
#[inline(always)]
fn sum<L: Lanes>(l: L, values: L::D) -> f64 {
    let mut lanes = [0.0; DOUBLES];
    l.d_store(values, &mut lanes);
    lanes.iter().sum()
}

/// Greatest of all lanes.
#[inline(always)]
fn greatest<L: Lanes>(l: L, values: L::D) -> f64 {
    let mut lanes = [0.0; DOUBLES];
    l.d_store(values, &mut lanes);
    lanes.into_iter().fold(f64::MIN, f64::max)
}

/// True if along every axis all rays move one way, or none moves. Beams rely on that.
#[inline(always)]
fn move_alike<L: Lanes>(l: L, directions: &[[f64; RAYS]; 3]) -> bool {
    let (mut longest, mut ranges) = (0.0_f64, [[0.0; 3]; 3]);
    for (direction, range) in directions.iter().zip(&mut ranges) {
        let lowest = l.d(f64::MIN);
        let (mut low, mut high, mut near) = (lowest, lowest, lowest);
        for row in direction.as_chunks().0 {
            let d = l.d_load(row);
            (low, high) = (larger(l, low, l.d(0.0) - d), larger(l, high, d));
            near = larger(l, near, l.d(0.0) - l.d_abs(d));
        }
        *range = [-greatest(l, low), greatest(l, high), -greatest(l, near)];
        longest = longest.max(range[0].abs()).max(range[1].abs());
    }
    ranges.iter().all(|[low, high, nearest]| {
        let is_still = *low == 0.0 && *high == 0.0;
        is_still || (low * high > 0.0 && *nearest > 2.0 * SURELY_MOVES * longest)
    })
}

/// The affine function of the pixel that fits best by least squares, as its value at pixel (0, 0) and its changes with
/// x and y; and its largest error.
#[inline(always)]
fn fitted<L: Lanes>(l: L, values: &[f64; RAYS]) -> (f64, f64, f64, f64) {
    /// Sum of squares of a pixel's distance from the tile's middle along an axis, over the tile.
    const SQUARES: f64 = 336.0;
    const MIDDLE: f64 = (TILE - 1) as f64 / 2.0;
    const COLUMN: [f64; DOUBLES] = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0];
    let rows = values.as_chunks::<DOUBLES>().0;
    let column = l.d_load(&COLUMN);
    let (mut columns, mut y_sum) = (l.d(0.0), l.d(0.0));
    for (row, values) in rows.iter().enumerate() {
        let values = l.d_load(values);
        columns = columns + values;
        y_sum = y_sum + l.d(row as f64 - MIDDLE) * values;
    }
    let x = sum(l, (column - l.d(MIDDLE)) * columns) / SQUARES;
    let y = sum(l, y_sum) / SQUARES;
    let first = sum(l, columns) / RAYS as f64 - MIDDLE * (x + y);
    let (mut off, along) = (l.d(0.0), l.d(first) + column * l.d(x));
    for (row, values) in rows.iter().enumerate() {
        off = larger(l, off, l.d_abs(along + l.d(row as f64 * y) - l.d_load(values)));
    }
    (first, x, y, greatest(l, off))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cpu::Portable;
    use crate::geom::Dims;
    use crate::memory_tree::MemoryTree;
    use crate::render::surface::Skin;
    use crate::render::tile::Tracer;

    #[test]
    fn an_affine_function_is_fitted_and_what_is_left_is_measured() {
        let mut values: [f64; RAYS] =
            std::array::from_fn(|i| 3.0 + (i % 8) as f64 * 0.5 - (i / 8) as f64 * 2.0);
        let (first, x, y, off) = fitted(Portable, &values);
        assert!((first - 3.0).abs() < 1e-12 && (x - 0.5).abs() < 1e-12 && (y + 2.0).abs() < 1e-12);
        assert!(off < 1e-12);
        values[20] += 1.0;
        assert!(fitted(Portable, &values).3 > 0.9);
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
            let (origins, directions): (Vec<_>, Vec<_>) = (0..RAYS).map(line).unzip();
            for form in Form::available() {
                listed.fill(form, &space, (&origins, &directions), |ray| ray).unwrap();
                let mut tracer = Tracer::new(form);
                let (hits, rest) = tracer.trace_listed(&tree.view(), &Skin, &listed, asked);
                assert_eq!((rest, hits.bits() == 0), (left, left != 0), "{form:?}");
            }
        }
    }
}
