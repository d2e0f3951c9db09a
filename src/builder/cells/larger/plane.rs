//! The plane of a larger leaf: fitted to the crossings of the fine cells, then chosen in whole numbers.

use std::ops::Range;

use super::{Bound, FineBrick, PARTS, polygon};
use crate::builder::cells::corner::{EDGES, encode};
use crate::format::cell::{CORNERS, at_corner};
use crate::format::normal;
use crate::geom::{add_scaled, cross, dot};

/// Square of the least cosine between a fine normal and the mean: 60 degrees.
const NEAR: f64 = 0.25;
/// Pulls a fitted normal towards the mean of the fine ones, in square voxels of the finest spacing.
const PULL: f64 = 0.005;
/// A crossing's unit in cells: a power of two, so that products are exact.
const PART: f64 = 1.0 / PARTS as f64;
/// Cells of a box from which on a table of all 256 sides pays.
const MANY: usize = 48;
/// Half the range of the crossings along a fitted normal beyond which no code is tried, in bounds.
const HOPELESS: f64 = 3.0;

/// A larger leaf as it is stored, and how far its plane was found to be from the fine cells at the box's edges.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::builder) struct Leaf {
    pub(in crate::builder) code: u16,
    pub(in crate::builder) offset: i8,
    /// In parts of a voxel of the finest spacing.
    pub(super) between: u32,
}

impl Leaf {
    /// Calls `found` with the distance of every crossing from the plane.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "within the bound")]
    pub(super) fn measure(
        &self,
        bound: &Bound,
        low: [i32; 3],
        edge: i32,
        crossings: &[[i32; 3]],
        mut found: impl FnMut(u32),
    ) {
        let scale = Scale::new(self.code, bound, low, edge);
        let plane = i32::from(self.offset) * edge * PARTS;
        for p in crossings {
            let off = (scale.at(*p) - plane).abs();
            found((f64::from(off) / scale.length + 0.5).floor() as u32);
        }
    }
}

/// Values of a stored normal in a box: `N . (2 p - 2 low - edge)`, times [`PARTS`].
struct Scale {
    n: [i32; 3],
    /// Of the box's middle.
    middle: i32,
    /// Change along the normal over a voxel of the finest spacing in [`PARTS`].
    length: f64,
}

impl Scale {
    fn new(code: u16, bound: &Bound, low: [i32; 3], edge: i32) -> Self {
        let n = normal::decode_l1(code);
        let middle = (0..3).map(|a| n[a] * (2 * low[a] + edge)).sum::<i32>();
        let physical = bound.physical(n.map(f64::from));
        Self { n, middle, length: 2.0 * dot(physical, physical).sqrt() }
    }

    /// The value at a point in [`PARTS`]: below 2^30.
    #[inline(always)]
    fn at(&self, p: [i32; 3]) -> i32 {
        2 * (self.n[0] * p[0] + self.n[1] * p[1] + self.n[2] * p[2]) - self.middle * PARTS
    }
}

/// A box whose children are all leaves.
pub(super) struct Fit<'a> {
    pub(super) bound: &'a Bound,
    pub(super) brick: &'a FineBrick<'a>,
    pub(super) places: &'a [[u8; 3]],
    /// Cells before each word of the brick's.
    pub(super) before: &'a [usize],
    /// The fine cells in it.
    pub(super) cells: Range<usize>,
    /// Its lowest cell in the brick, and its edge.
    pub(super) low: [i32; 3],
    pub(super) edge: i32,
    /// Its corners inside, as bits.
    pub(super) sides: u8,
}

impl Fit<'_> {
    /// The leaf that the box becomes, if it does.
    pub(super) fn leaf(&self, crossings: &[[i32; 3]]) -> Option<Leaf> {
        let mean = self.mean_normal()?;
        let direction = self.direction(mean, crossings)?;
        let code = encode(std::array::from_fn(|a| direction[a] * self.bound.sides[a]))?;
        around(code).find_map(|code| {
            let offset = self.offset(code, crossings)?;
            let between = polygon::between(self, code, offset)?;
            Some(Leaf { code, offset, between })
        })
    }

    /// The mean of the fine normals, all within 60 degrees of it.
    fn mean_normal(&self) -> Option<[f64; 3]> {
        let normal = |cell: usize| self.bound.physical(self.brick.normal(cell).map(f64::from));
        let sum = self.cells.clone().fold([0.0; 3], |sum, cell| {
            let n = normal(cell);
            add_scaled(sum, 1.0 / dot(n, n).sqrt(), n)
        });
        let square = dot(sum, sum);
        let is_near = |cell: usize| {
            let n = normal(cell);
            let along = dot(n, sum);
            along > 0.0 && along * along >= NEAR * square * dot(n, n)
        };
        let length = square.sqrt();
        (length > 0.0 && self.cells.clone().all(is_near)).then(|| sum.map(|c| c / length))
    }

    /// The direction along which the crossings differ least: that of least squares near the mean normal, or this.
    fn direction(&self, mean: [f64; 3], crossings: &[[i32; 3]]) -> Option<[f64; 3]> {
        let half = f64::from(self.edge) * 0.5;
        let point = |p: [i32; 3]| -> [f64; 3] {
            std::array::from_fn(|a| {
                let from_middle = f64::from(p[a]) * PART - f64::from(self.low[a]) - half;
                from_middle * self.bound.sides[a]
            })
        };
        let (mut sum, mut products) = ([0.0; 3], [[0.0; 3]; 3]);
        for p in crossings {
            let p = point(*p);
            for a in 0..3 {
                sum[a] += p[a];
                products[a] = add_scaled(products[a], p[a], p);
            }
        }
        #[expect(clippy::cast_precision_loss, reason = "a small count")]
        let count = crossings.len() as f64;
        let spread: [[f64; 3]; 3] = std::array::from_fn(|a| add_scaled(products[a], -sum[a] / count, sum));
        let fitted = fitted_near(mean, &spread);
        let mut ranges = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
        for p in crossings {
            let p = point(*p);
            for (range, n) in ranges.iter_mut().zip([fitted, mean]) {
                let at = dot(n, p);
                *range = [range[0].min(at), range[1].max(at)];
            }
        }
        let [by_fit, by_mean] = ranges.map(|[low, high]| high - low);
        let (direction, range) = if by_mean < by_fit { (mean, by_mean) } else { (fitted, by_fit) };
        (0.5 * range <= HOPELESS * self.bound.error).then_some(direction)
    }

    /// The offset with which a normal's plane leaves every inside corner behind it and is within the bound.
    #[expect(clippy::cast_possible_truncation, reason = "below 2^25; an offset is -127..=127")]
    fn offset(&self, code: u16, crossings: &[[i32; 3]]) -> Option<i8> {
        let scale = Scale::new(code, self.bound, self.low, self.edge);
        let limit = (scale.length * self.bound.error * f64::from(PARTS)).floor() as i32;
        let (mut low, mut high) = (i32::MAX, i32::MIN);
        for p in crossings {
            let at = scale.at(*p);
            (low, high) = (low.min(at), high.max(at));
        }
        if i64::from(high) - i64::from(low) > 2 * i64::from(limit) {
            return None;
        }
        let step = i64::from(self.edge) * i64::from(PARTS);
        let middle = (i64::from(low) + i64::from(high) + step).div_euclid(2 * step) as i32;
        let is_inside = |c: usize| self.sides >> c & 1 == 1;
        let of_box = (0..CORNERS).filter(|c| is_inside(*c)).map(|c| at_corner(scale.n, c)).max();
        let highest = self.highest_inside(&scale);
        // Rounded up: behind is at most the offset.
        let least = -(-highest).div_euclid(self.edge);
        let offset = middle.max(least).max(of_box.unwrap_or(i32::MIN));
        if !(-normal::SCALE..=normal::SCALE).contains(&offset) {
            return None;
        }
        let plane = offset * self.edge * PARTS;
        let is_covered =
            |c: usize| !is_inside(c) && (offset - at_corner(scale.n, c)) * self.edge * PARTS > limit;
        let is_near = high - plane <= limit && plane - low <= limit && !(0..CORNERS).any(is_covered);
        is_near.then_some(offset as i8)
    }

    /// The greatest value at an inside corner of a fine cell, without [`PARTS`].
    fn highest_inside(&self, scale: &Scale) -> i32 {
        let n = scale.n;
        let along = |p: [i32; 3]| 2 * (n[0] * p[0] + n[1] * p[1] + n[2] * p[2]);
        let rise: [i32; CORNERS] =
            std::array::from_fn(|c| along([c & 1, c >> 1 & 1, c >> 2].map(|bit| i32::from(bit == 1))));
        let mut highest = i32::MIN;
        if self.cells.len() >= MANY {
            let mut highest_rise = [i32::MIN / 2; 256];
            for sides in 1..256_usize {
                let others = highest_rise[sides & (sides - 1)];
                highest_rise[sides] = others.max(rise[sides.trailing_zeros() as usize % CORNERS]);
            }
            for cell in self.cells.clone() {
                let at = along(self.places[cell].map(i32::from)) - scale.middle;
                highest = highest.max(at + highest_rise[usize::from(self.brick.sides[cell])]);
            }
            return highest;
        }
        for cell in self.cells.clone() {
            let at = along(self.places[cell].map(i32::from)) - scale.middle;
            let mut sides = self.brick.sides[cell];
            while sides != 0 {
                highest = highest.max(at + rise[sides.trailing_zeros() as usize % CORNERS]);
                sides &= sides - 1;
            }
        }
        highest
    }

    /// Where a plane cuts the box's edges, in cells of the brick.
    pub(super) fn cuts(&self, code: u16, offset: i8) -> impl Iterator<Item = [f64; 3]> + '_ {
        let n = normal::decode_l1(code);
        let ahead = move |c: usize| at_corner(n, c) - i32::from(offset);
        EDGES.into_iter().filter_map(move |(p, q)| {
            let (a, b) = (ahead(p), ahead(q));
            let axis = (p ^ q).trailing_zeros() as usize;
            ((a <= 0) != (b <= 0)).then(|| {
                let along = f64::from(a) / f64::from(a - b);
                std::array::from_fn(|i| {
                    let part = if i == axis { along } else { f64::from(u8::from(p >> i & 1 == 1)) };
                    f64::from(self.low[i]) + f64::from(self.edge) * part
                })
            })
        })
    }
}

/// A code and the eight around it.
fn around(code: u16) -> impl Iterator<Item = u16> {
    let [u, v] = code.to_le_bytes().map(|c| i32::from(c.cast_signed()));
    let steps = [[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1], [1, 1], [1, -1], [-1, 1], [-1, -1]];
    steps.into_iter().filter_map(move |[du, dv]| {
        let component = |c: i32| i8::try_from(c).ok().filter(|c| *c != i8::MIN).map(i8::cast_unsigned);
        Some(u16::from_le_bytes([component(u + du)?, component(v + dv)?]))
    })
}

/// Unit normal of the plane through points of this spread that fits them best: that of least squares among the guess, a
/// unit vector, plus something at right angles to it, which is held small.
fn fitted_near(guess: [f64; 3], spread: &[[f64; 3]; 3]) -> [f64; 3] {
    let least = (0..3).fold(0, |best, a| if guess[a].abs() < guess[best].abs() { a } else { best });
    let mut axis = [0.0; 3];
    axis[least] = 1.0;
    let e1 = cross(guess, axis);
    let length = dot(e1, e1).sqrt();
    let e1 = e1.map(|c| c / length);
    let e2 = cross(guess, e1);
    let by = |a: [f64; 3], b: [f64; 3]| dot(a, spread.map(|row| dot(row, b)));
    let (s11, s12, s22) = (by(e1, e1) + PULL, by(e1, e2), by(e2, e2) + PULL);
    let (r1, r2) = (-by(e1, guess), -by(e2, guess));
    let determinant = s11 * s22 - s12 * s12;
    let (a, b) = ((r1 * s22 - r2 * s12) / determinant, (r2 * s11 - r1 * s12) / determinant);
    let fitted = add_scaled(add_scaled(guess, a, e1), b, e2);
    let length = dot(fitted, fitted).sqrt();
    fitted.map(|c| c / length)
}
