//! The plane of a larger leaf: fitted to the crossings of the fine cells, then rounded and checked in integers.

use std::ops::Range;

use super::crossings::{Moments, Points};
use super::{Bound, CROSSED, FineBrick, PARTS, Sums, polygon};
use crate::builder::cells::corner::EDGES;
use crate::format::cell::{CORNERS, at_corner};
use crate::format::normal;
use crate::geom::{add_scaled, cross, dot, morton};

/// Square of the least cosine between a fine normal and the mean: 60 degrees.
const NEAR: f64 = 0.25;
/// Weight of the mean fine normal in the fit, in square voxels of the finest spacing.
const PULL: f64 = 0.005;
/// Largest angle between a code and one of the eight around it: a step of (1, 1, 2) of a vector of length 127 / sqrt 3.
const STEP: f64 = 0.0335;

/// A larger leaf as stored, and the measured distance of its plane from the fine cells at the box's edges.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::builder) struct Leaf {
    pub(in crate::builder) code: u16,
    pub(in crate::builder) offset: i8,
    /// Distance from the fine cells at the box's edges, in parts of a voxel of the finest spacing.
    pub(super) between: u32,
}

impl Leaf {
    /// Distance of every crossing from the plane, in [`PARTS`].
    #[inline(always)]
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "within the bound")]
    pub(super) fn distances<'a>(
        &self,
        bound: &Bound,
        low: [i32; 3],
        edge: i32,
        crossings: &Points<'a>,
    ) -> impl Iterator<Item = u32> + 'a {
        let scale = Scale::new(self.code, bound, low, edge);
        let plane = i32::from(self.offset) * edge * PARTS;
        let per_voxel = 1.0 / scale.length;
        let [x, y, z] = crossings.at;
        x.iter().zip(y).zip(z).map(move |((x, y), z)| {
            let off = (scale.at([*x, *y, *z]) - plane).abs();
            (f64::from(off) * per_voxel + 0.5) as u32
        })
    }
}

/// Values of a stored normal in a box: `N . (2 p - 2 low - edge)`, times [`PARTS`].
struct Scale {
    n: [i32; 3],
    /// `N . (2 low + edge)`, from the box's middle.
    middle: i32,
    /// Change along the normal over a voxel of the finest spacing in [`PARTS`].
    length: f64,
}

impl Scale {
    #[inline(always)]
    fn new(code: u16, bound: &Bound, low: [i32; 3], edge: i32) -> Self {
        let n = normal::decode_l1(code);
        let along = |a: usize| n[a] * (2 * low[a] + edge);
        let middle = along(0) + along(1) + along(2);
        let part = |a: usize| f64::from(n[a]) * bound.inverse[a];
        let physical = [part(0), part(1), part(2)];
        Self { n, middle, length: 2.0 * dot(physical, physical).sqrt() }
    }

    /// The value at a point in [`PARTS`]: below 2^30.
    #[inline(always)]
    fn at(&self, p: [i32; 3]) -> i32 {
        2 * (self.n[0] * p[0] + self.n[1] * p[1] + self.n[2] * p[2]) - self.middle * PARTS
    }

    /// Least and greatest value at crossings, and the greatest at the inside ends of their edges, without [`PARTS`].
    #[inline(always)]
    fn extremes(&self, crossings: &Points<'_>) -> [i32; 3] {
        let n = self.n;
        let (mut low, mut high, mut highest) = (i32::MAX, i32::MIN, i32::MIN);
        let ([x, y, z], [u, v, w]) = (crossings.at, crossings.ends);
        for ((((x, y), z), u), (v, w)) in x.iter().zip(y).zip(z).zip(u).zip(v.iter().zip(w)) {
            let at = n[0] * x + n[1] * y + n[2] * z;
            (low, high) = (low.min(at), high.max(at));
            highest = highest.max(n[0] * i32::from(*u) + n[1] * i32::from(*v) + n[2] * i32::from(*w));
        }
        let middle = self.middle * PARTS;
        [2 * low - middle, 2 * high - middle, 2 * highest - self.middle]
    }
}

#[inline(always)]
fn scaled(n: &[i8; 3], by: [f64; 3]) -> [f64; 3] {
    [f64::from(n[0]) * by[0], f64::from(n[1]) * by[1], f64::from(n[2]) * by[2]]
}

/// The sum of the unit normals of cells.
#[inline(always)]
pub(super) fn sum(bound: &Bound, normals: &[[i8; 3]]) -> [f64; 3] {
    normals.iter().fold([0.0; 3], |sum, normal| {
        let n = scaled(normal, bound.inverse);
        add_scaled(sum, 1.0 / dot(n, n).sqrt(), n)
    })
}

/// The crossings' values along a stored normal.
struct Along {
    code: u16,
    scale: Scale,
    /// Least and greatest value of the crossings by [`Scale::at`], and the greatest of their edges' inside ends.
    low: i32,
    high: i32,
    highest: i32,
    /// Difference of the least and the greatest value, in voxels of the finest spacing.
    range: f64,
}

/// A box whose children are all leaves.
pub(super) struct Fit<'a> {
    pub(super) bound: &'a Bound,
    pub(super) brick: &'a FineBrick<'a>,
    pub(super) places: &'a [[u8; 3]],
    pub(super) normals: &'a [[i8; 3]],
    /// Number of cells before each word of the brick.
    pub(super) before: &'a [usize],
    /// The fine cells in the box.
    pub(super) cells: Range<usize>,
    /// Lowest cell of the box in the brick, and edge of the box.
    pub(super) low: [i32; 3],
    pub(super) edge: i32,
    /// Mask of the box's inside corners.
    pub(super) sides: u8,
}

impl Fit<'_> {
    /// The leaf that the box becomes; `None` if it stays.
    #[inline(always)]
    pub(super) fn leaf(&self, sums: &Sums, crossings: &Points<'_>) -> Option<Leaf> {
        let mean = self.mean_normal(sums.normals)?;
        let fitted = self.direction(mean, &sums.moments, crossings);
        // Turning a normal by a step reduces the range by this at most.
        let turn = STEP * f64::from(self.edge) * self.bound.diagonal;
        if fitted.range > 2.0 * self.bound.error + turn {
            return None;
        }
        let mut leaf = self.with(&fitted);
        // A loop: closures are not compiled for the caller's instruction set.
        for step in AROUND {
            if leaf.is_some() {
                break;
            }
            if let Some(code) = stepped(fitted.code, step) {
                leaf = self.with(&self.along(code, crossings));
            }
        }
        leaf
    }

    /// The leaf with a normal; `None` if it breaks a rule.
    #[inline(always)]
    fn with(&self, along: &Along) -> Option<Leaf> {
        let offset = self.offset(along)?;
        let between = polygon::between(self, along.code, offset)?;
        Some(Leaf { code: along.code, offset, between })
    }

    /// The mean of the fine normals, from their sum; `None` unless all are within 60 degrees of it.
    #[inline(always)]
    fn mean_normal(&self, sum: [f64; 3]) -> Option<[f64; 3]> {
        let square = dot(sum, sum);
        let inverse = self.bound.inverse;
        let is_near = |normal: &[i8; 3]| {
            let n = scaled(normal, inverse);
            let along = dot(n, sum);
            (along > 0.0) & (along * along >= NEAR * square * dot(n, n))
        };
        let are_near = self.normals[self.cells.clone()].iter().fold(true, |all, n| all & is_near(n));
        let length = square.sqrt();
        (length > 0.0 && are_near).then(|| sum.map(|c| c / length))
    }

    /// The direction along which the crossings vary least: least squares near the mean normal, or the mean normal
    /// itself.
    #[inline(always)]
    fn direction(&self, mean: [f64; 3], moments: &Moments, crossings: &Points<'_>) -> Along {
        let sides = self.bound.sides;
        let mut spread = moments.spread();
        for a in 0..3 {
            for b in 0..3 {
                spread[a][b] *= sides[a] * sides[b];
            }
        }
        let fitted = self.along(self.code(fitted_near(mean, &spread)), crossings);
        if fitted.range <= 2.0 * self.bound.error {
            return fitted;
        }
        let by_mean = self.along(self.code(mean), crossings);
        if by_mean.range < fitted.range { by_mean } else { fitted }
    }

    /// The code of a unit vector of physical space.
    #[inline(always)]
    #[expect(clippy::cast_possible_truncation, reason = "a direction in single precision")]
    fn code(&self, direction: [f64; 3]) -> u16 {
        let part = |a: usize| (direction[a] * self.bound.sides[a]) as f32;
        normal::encode([part(0), part(1), part(2)])
    }

    /// Extent of the crossings along a stored normal.
    #[inline(always)]
    fn along(&self, code: u16, crossings: &Points<'_>) -> Along {
        let scale = Scale::new(code, self.bound, self.low, self.edge);
        let [low, high, highest] = scale.extremes(crossings);
        let range = f64::from(high - low) / (scale.length * f64::from(PARTS));
        Along { code, scale, low, high, highest, range }
    }

    /// The offset at which a normal's plane has every inside corner behind it and keeps the bound.
    ///
    /// Only inside corners that are ends of a crossed edge are checked: from any other a step along an edge leads
    /// higher, and finally to such an end or to a corner of the box.
    #[inline(always)]
    #[expect(clippy::cast_possible_truncation, reason = "below 2^25; an offset is -127..=127")]
    fn offset(&self, along: &Along) -> Option<i8> {
        let Along { scale, low, high, highest, .. } = along;
        let (low, high, highest) = (*low, *high, *highest);
        let limit = (scale.length * self.bound.error * f64::from(PARTS)).floor() as i32;
        if i64::from(high) - i64::from(low) > 2 * i64::from(limit) {
            return None;
        }
        let step = i64::from(self.edge) * i64::from(PARTS);
        let middle = (i64::from(low) + i64::from(high) + step).div_euclid(2 * step) as i32;
        // The inside corner of the box farthest ahead, and the outside one farthest behind.
        let (mut of_box, mut outside) = (i32::MIN, i32::MAX);
        for c in 0..CORNERS {
            let (at, is_inside) = (at_corner(scale.n, c), self.sides >> c & 1 == 1);
            of_box = if is_inside { of_box.max(at) } else { of_box };
            outside = if is_inside { outside } else { outside.min(at) };
        }
        // Rounded up: points behind are at most the offset.
        let least = -(-highest).div_euclid(self.edge);
        let offset = middle.max(least).max(of_box);
        if !(-normal::SCALE..=normal::SCALE).contains(&offset) {
            return None;
        }
        let plane = offset * self.edge * PARTS;
        let covered = outside < offset && (offset - outside) * self.edge * PARTS > limit;
        (high - plane <= limit && plane - low <= limit && !covered).then_some(offset as i8)
    }

    /// Mask of the box's edges that a plane cuts, and the value of each corner in front of it.
    #[inline(always)]
    pub(super) fn cut_edges(&self, code: u16, offset: i8) -> (u16, [i32; CORNERS]) {
        let n = normal::decode_l1(code);
        let mut ahead = [0; CORNERS];
        let mut behind = 0_usize;
        for (c, ahead) in ahead.iter_mut().enumerate() {
            *ahead = at_corner(n, c) - i32::from(offset);
            behind |= usize::from(*ahead <= 0) << c;
        }
        (CROSSED[behind % 256], ahead)
    }

    /// The cut of a plane with an edge.
    #[inline(always)]
    pub(super) fn cut(&self, edge: usize, ahead: &[i32; CORNERS]) -> Cut {
        let (p, q) = EDGES[edge % EDGES.len()];
        let (a, b) = (ahead[p], ahead[q]);
        let axis = (p ^ q).trailing_zeros() as usize % 3;
        let edge = f64::from(self.edge);
        let high = |a: usize| f64::from(self.low[a]) + if p >> a & 1 == 1 { edge } else { 0.0 };
        let mut point = [high(0), high(1), high(2)];
        point[axis] += edge * (f64::from(a) / f64::from(a - b));
        Cut { ends: (p, q), axis, point }
    }

    /// Distance between a cut and the fine cell's crossing of the same edge, in voxels of the finest spacing; infinity
    /// if the fine cell does not cross it.
    #[inline(always)]
    pub(super) fn along_edge(&self, cut: &Cut) -> f64 {
        let (p, q) = cut.ends;
        let Some(cell) = self.cell_at(cut.point) else { return f64::INFINITY };
        let sides = self.brick.sides[cell];
        if (sides >> p ^ sides >> q) & 1 == 0 {
            return f64::INFINITY;
        }
        let along = f64::from(self.brick.crossing(cell, (p, q))) / f64::from(PARTS);
        let place = f64::from(self.places[cell][cut.axis]);
        (cut.point[cut.axis] - place - along).abs() * self.bound.sides[cut.axis]
    }

    /// The fine cell of the box at a point of it, in cells of the brick.
    #[inline(always)]
    #[expect(clippy::cast_possible_truncation, reason = "a place within the brick")]
    pub(super) fn cell_at(&self, point: [f64; 3]) -> Option<usize> {
        let at = |a: usize| (point[a] as i32).clamp(self.low[a], self.low[a] + self.edge - 1).cast_unsigned();
        self.cell_of([at(0), at(1), at(2)])
    }

    /// The fine cell at a position in the brick, if it exists.
    #[inline(always)]
    pub(super) fn cell_of(&self, [x, y, z]: [u32; 3]) -> Option<usize> {
        let code = morton::encode(x, y, z) as usize;
        let (word, bit) = (code / 64, code % 64);
        let bits = self.brick.words[word];
        let below = bits & ((1 << bit) - 1);
        (bits >> bit & 1 == 1).then(|| self.before[word] + below.count_ones() as usize)
    }
}

/// Cut of a plane with an edge of a box.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cut {
    /// The corners at the ends of the edge, and its axis.
    ends: (usize, usize),
    axis: usize,
    /// Position, in cells of the brick.
    pub(super) point: [f64; 3],
}

/// Steps from a code to the eight around it.
const AROUND: [[i32; 2]; 8] = [[1, 0], [-1, 0], [0, 1], [0, -1], [1, 1], [1, -1], [-1, 1], [-1, -1]];

#[inline(always)]
fn stepped(code: u16, step: [i32; 2]) -> Option<u16> {
    let [u, v] = code.to_le_bytes().map(|c| i32::from(c.cast_signed()));
    let component = |c: i32| i8::try_from(c).ok().filter(|c| *c != i8::MIN).map(i8::cast_unsigned);
    Some(u16::from_le_bytes([component(u + step[0])?, component(v + step[1])?]))
}

/// Unit normal of the plane that fits points of this spread best: least squares over the guess, a unit vector, plus an
/// orthogonal term that is held small.
#[inline(always)]
fn fitted_near(guess: [f64; 3], spread: &[[f64; 3]; 3]) -> [f64; 3] {
    let least = (0..3).fold(0, |best, a| if guess[a].abs() < guess[best].abs() { a } else { best });
    let mut axis = [0.0; 3];
    axis[least] = 1.0;
    let e1 = cross(guess, axis);
    let length = dot(e1, e1).sqrt();
    let e1 = e1.map(|c| c / length);
    let e2 = cross(guess, e1);
    let by = |a: [f64; 3], b: [f64; 3]| dot(a, [dot(spread[0], b), dot(spread[1], b), dot(spread[2], b)]);
    let (s11, s12, s22) = (by(e1, e1) + PULL, by(e1, e2), by(e2, e2) + PULL);
    let (r1, r2) = (-by(e1, guess), -by(e2, guess));
    let determinant = s11 * s22 - s12 * s12;
    let (a, b) = ((r1 * s22 - r2 * s12) / determinant, (r2 * s11 - r1 * s12) / determinant);
    let fitted = add_scaled(add_scaled(guess, a, e1), b, e2);
    let length = dot(fitted, fitted).sqrt();
    fitted.map(|c| c / length)
}
