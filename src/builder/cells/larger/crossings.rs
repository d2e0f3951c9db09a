//! Crossings of the edges of a brick's fine cells, axis by axis, and the moments of these points.

use std::ops::Range;

use super::{CROSSED, FineBrick, PARTS, crossed_at};
use crate::builder::cells::corner::EDGES;
use crate::format::cell::CORNERS;

/// Most crossings that are held: a plane through a whole brick has some 10,000.
const ROOM: usize = 16 << 10;

/// Crossings in [`PARTS`] from the corner of the brick, and the inside ends of their edges in voxels.
#[derive(Debug)]
pub(super) struct Crossings {
    at: [Vec<i32>; 3],
    ends: [Vec<u8>; 3],
}

/// A range of the crossings, all arrays of one length.
#[derive(Clone, Copy, Debug)]
pub(super) struct Points<'a> {
    pub(super) at: [&'a [i32]; 3],
    pub(super) ends: [&'a [u8]; 3],
}

impl Crossings {
    /// Memory of one [`Crossings`].
    pub(super) const BYTES: usize = 3 * ROOM * (size_of::<i32>() + 1);

    pub(super) fn new() -> Self {
        let at = std::array::from_fn(|_| Vec::with_capacity(ROOM));
        Self { at, ends: std::array::from_fn(|_| Vec::with_capacity(ROOM)) }
    }

    pub(super) fn clear(&mut self) {
        self.at.iter_mut().for_each(Vec::clear);
        self.ends.iter_mut().for_each(Vec::clear);
    }

    pub(super) fn len(&self) -> usize {
        self.at[0].len()
    }

    #[inline(always)]
    pub(super) fn points(&self, range: Range<usize>) -> Points<'_> {
        Points {
            at: std::array::from_fn(|a| &self.at[a][range.clone()]),
            ends: std::array::from_fn(|a| &self.ends[a][range.clone()]),
        }
    }

    /// Appends the crossings of cells; `None` if they are too many.
    #[inline(always)]
    pub(super) fn gather(
        &mut self,
        brick: &FineBrick<'_>,
        places: &[[u8; 3]],
        cells: Range<usize>,
    ) -> Option<()> {
        let Self { at, ends } = self;
        for cell in cells {
            if at[0].len() + EDGES.len() > ROOM {
                return None;
            }
            let place = places[cell];
            let (sides, ahead) = (brick.sides[cell], brick.ahead(cell));
            // Where the cell's plane covers an outside corner, the corners of its polygon are added.
            let behind = (0..CORNERS).fold(0_usize, |bits, c| bits | usize::from(ahead[c] <= 0) << c);
            let mut left = CROSSED[usize::from(sides)] | CROSSED[behind % 256];
            while left != 0 {
                let (p, q) = EDGES[left.trailing_zeros() as usize % EDGES.len()];
                left &= left - 1;
                let along = crossed_at([ahead[p], ahead[q]], sides >> p & 1 == 1);
                let inside = match [p, q].map(|corner| sides >> corner & 1 == 1) {
                    [true, _] => p,
                    [_, true] => q,
                    // Another inside corner of the cell.
                    _ => sides.trailing_zeros() as usize % CORNERS,
                };
                for a in 0..3 {
                    let low = i32::from(place[a]) * PARTS;
                    // The ends of an edge differ along its axis.
                    let within =
                        if (p ^ q) >> a & 1 == 1 { along } else { i32::from(p >> a & 1 == 1) * PARTS };
                    at[a].push(low + within);
                    ends[a].push(place[a] + u8::from(inside >> a & 1 == 1));
                }
            }
        }
        Some(())
    }
}

/// Count, sums and sums of products of points, as integers: below 2^15, 2^36 and 2^57.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Moments {
    count: i64,
    sums: [i64; 3],
    /// Sums of products, in the order xx, yy, zz, xy, xz, yz.
    products: [i64; 6],
}

/// The axes of each product.
const PRODUCTS: [(usize, usize); 6] = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)];

impl Moments {
    #[inline(always)]
    pub(super) fn of(points: &Points<'_>) -> Self {
        let (mut s, mut p) = ([0; 3], [0; 6]);
        for ((x, y), z) in points.at[0].iter().zip(points.at[1]).zip(points.at[2]) {
            let (x, y, z) = (i64::from(*x), i64::from(*y), i64::from(*z));
            s = [s[0] + x, s[1] + y, s[2] + z];
            p = [p[0] + x * x, p[1] + y * y, p[2] + z * z, p[3] + x * y, p[4] + x * z, p[5] + y * z];
        }
        Self { count: points.at[0].len() as i64, sums: s, products: p }
    }

    #[inline(always)]
    pub(super) fn add(&mut self, other: &Self) {
        self.count += other.count;
        self.sums.iter_mut().zip(other.sums).for_each(|(own, more)| *own += more);
        self.products.iter_mut().zip(other.products).for_each(|(own, more)| *own += more);
    }

    /// Sums of products about the mean, in square voxels.
    #[expect(clippy::cast_precision_loss, reason = "of a difference that is exact, below 2^73")]
    pub(super) fn spread(&self) -> [[f64; 3]; 3] {
        let count = i128::from(self.count.max(1));
        let mut spread = [[0.0; 3]; 3];
        for (product, (a, b)) in self.products.iter().zip(PRODUCTS) {
            let about_mean =
                count * i128::from(*product) - i128::from(self.sums[a]) * i128::from(self.sums[b]);
            let unit = f64::from(PARTS) * f64::from(PARTS);
            let value = about_mean as f64 / (count as f64 * unit);
            (spread[a][b], spread[b][a]) = (value, value);
        }
        spread
    }
}
