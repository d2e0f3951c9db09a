//! Cells of one brick joined into larger leaves (SPEC 4.9): as many as the surface needs within a bound.
//!
//! ```text
//!   fine cells of 32^3 in Morton order --> boxes of 2 --> 4 --> 8 --> 16 --> 32 cells
//!      crossings of their edges --least squares--> plane --whole numbers--> normal of 16 bits, offset of 8
//! ```
//!
//! A box becomes a leaf if every child that is not empty is one, and
//!
//! 1. every fine normal is within 60 degrees of their mean;
//! 2. half the range of the crossings of *all fine cells* below, along the plane's normal, is at most three bounds
//!    (planes of smaller leaves do not count, so that errors do not add up);
//! 3. an offset within -127..=127 leaves every inside corner of every fine cell behind the plane;
//! 4. every crossing is within the bound of that plane, and no outside corner of the box deeper behind it; of nine
//!    codes around the fitted normal the first that satisfies this ([`plane`]);
//! 5. where the plane cuts the box's edges, and in the middle of these points, it is within one and a half bounds of
//!    a fine cell's polygon: planes do not jut out ([`polygon`]).
//!
//! By 3 every inside sample in the box lies behind the plane: step from it along edges so that the normal's component
//! rises; either all samples are inside as far as the box's corner, which is behind, or the last before one outside
//! is an inside corner of a fine cell, which is. So no ray from outside reaches an inside sample, or a box of them.
//!
//! Everything depends on one aligned brick only. Decisions 3 and 4 are in integers, the others are IEEE operations in a
//! fixed order.

mod crossings;
mod distances;
mod hide;
mod plane;
mod polygon;
#[cfg(test)]
mod tests;

use std::ops::Range;

use super::corner::EDGES;
use crate::format::cell::{CORNERS, HAS_CORNERS, at_corner};
use crate::format::normal;
use crate::geom::{add_scaled, dot, morton};

use crate::cpu::{Kernel, Lanes, dispatch};

use crossings::{Crossings, Moments};
pub(in crate::builder) use distances::Distances;
pub(in crate::builder) use plane::Leaf;

/// Edge of a brick.
const BRICK: usize = 32;
/// Levels of boxes in a brick.
pub(in crate::builder) const LEVELS: usize = 5;
/// Cells of a brick.
const CELLS: usize = BRICK * BRICK * BRICK;
/// Words of 64 cells.
const WORDS: usize = CELLS / 64;
/// Parts of a cell's edge that crossings are measured in; also parts of a voxel of the finest spacing for distances.
const PARTS: i32 = 1 << 16;
/// Largest distance of a plane from the fine cells' polygons, in bounds.
const BETWEEN: f64 = 1.5;

/// Bound on the distance of leaves from the surface, with the shape of cells.
#[derive(Clone, Copy, Debug)]
pub(in crate::builder) struct Bound {
    /// The bound, in voxels of the finest spacing.
    pub(in crate::builder) error: f64,
    /// Spacing along each axis, in units of the finest.
    sides: [f64; 3],
    /// Reciprocals of `sides`.
    inverse: [f64; 3],
    /// Diagonal of a voxel, in finest spacings, times the largest ratio by which physical space turns normals more than
    /// index space.
    diagonal: f64,
}

impl Bound {
    /// The bound for spacings in mm.
    pub(in crate::builder) fn new(error: f64, spacing_mm: [f64; 3]) -> Self {
        let finest = spacing_mm[0].min(spacing_mm[1]).min(spacing_mm[2]);
        let sides = spacing_mm.map(|s| s / finest);
        let diagonal = dot(sides, sides).sqrt() * sides[0].max(sides[1]).max(sides[2]);
        Self { error, sides, inverse: spacing_mm.map(|s| finest / s), diagonal }
    }
}

/// The cells of a brick in Morton order.
#[derive(Clone, Copy)]
pub(in crate::builder) struct FineBrick<'a> {
    /// Occupancy of the cells, a bit each.
    pub(in crate::builder) words: &'a [u64; WORDS],
    /// Normals and offsets, as stored.
    pub(in crate::builder) codes: &'a [[u8; 2]],
    pub(in crate::builder) offsets: &'a [u8],
    /// Corners of the cells that have them, by ascending cell number.
    pub(in crate::builder) corners: &'a [(u16, [i8; CORNERS])],
    /// Masks of each cell's inside corners.
    pub(in crate::builder) sides: &'a [u8],
}

impl FineBrick<'_> {
    #[inline(always)]
    fn normal(&self, cell: usize) -> [i32; 3] {
        normal::decode_l1(u16::from_le_bytes(self.codes[cell]))
    }

    /// Signed distance of each corner in front of the surface, up to a factor.
    #[inline(always)]
    fn ahead(&self, cell: usize) -> [i32; CORNERS] {
        let offset = self.offsets[cell].cast_signed();
        if offset == HAS_CORNERS {
            return self.corners_ahead(cell);
        }
        let (n, mut ahead) = (self.normal(cell), [0; CORNERS]);
        for (c, ahead) in ahead.iter_mut().enumerate() {
            *ahead = at_corner(n, c) - i32::from(offset);
        }
        ahead
    }

    #[inline(never)]
    fn corners_ahead(&self, cell: usize) -> [i32; CORNERS] {
        let found = self.corners.binary_search_by_key(&cell, |(cell, _)| usize::from(*cell));
        found.map_or([0; CORNERS], |at| self.corners[at].1.map(|c| -i32::from(c)))
    }

    /// Calls `found` with each crossed edge of a cell and its crossing, from its first corner in [`PARTS`].
    #[inline(always)]
    fn for_each_crossing(&self, cell: usize, mut found: impl FnMut((usize, usize), i32)) {
        let (sides, ahead) = (self.sides[cell], self.ahead(cell));
        let mut left = CROSSED[usize::from(sides)];
        while left != 0 {
            let (p, q) = EDGES[left.trailing_zeros() as usize % EDGES.len()];
            left &= left - 1;
            found((p, q), crossed_at([ahead[p], ahead[q]], sides >> p & 1 == 1));
        }
    }

    /// Crossing of a crossed edge of a cell, as in [`FineBrick::for_each_crossing`].
    #[inline(always)]
    fn crossing(&self, cell: usize, (p, q): (usize, usize)) -> i32 {
        let ahead = self.ahead(cell);
        crossed_at([ahead[p], ahead[q]], self.sides[cell] >> p & 1 == 1)
    }
}

/// 1.5 * 2^52: adding it to a number leaves the nearest integer in the low bits.
const WHOLE: f64 = 6_755_399_441_055_744.0;

/// Reciprocals of integers, in [`PARTS`]: corners of a cell's edge differ by twice a part of its normal, or of 127.
const PARTS_BY: [f64; 256] = {
    let mut parts = [0.0; 256];
    let mut n = 1;
    while n < 256 {
        parts[n] = PARTS as f64 / n as f64;
        n += 1;
    }
    parts
};

/// Crossing of an edge whose ends lie at these distances in front of the surface, from the first end in [`PARTS`].
#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "the low bits")]
fn crossed_at([a, b]: [i32; 2], first_is_inside: bool) -> i32 {
    if (a <= 0) != (b <= 0) {
        let along = f64::from(a.abs()) * PARTS_BY[(a - b).unsigned_abs() as usize % 256];
        return (along + WHOLE).to_bits() as i32;
    }
    // The plane covers the outside corner as well.
    if first_is_inside { PARTS } else { 0 }
}

/// Masks of the edges whose ends are on different sides, by the mask of inside corners.
const CROSSED: [u16; 256] = {
    let mut table = [0; 256];
    let mut at = 0;
    while at < 256 * EDGES.len() {
        let (sides, edge) = (at / EDGES.len(), at % EDGES.len());
        let (p, q) = EDGES[edge];
        if (sides >> p ^ sides >> q) & 1 == 1 {
            table[sides] |= 1 << edge;
        }
        at += 1;
    }
    table
};

/// Number of edges whose ends are on different sides.
fn crossed_edges(sides: u8) -> u64 {
    CROSSED[usize::from(sides)].count_ones().into()
}

/// State of a box of the brick.
#[derive(Clone, Copy, Debug, PartialEq)]
enum State {
    Empty,
    /// Some cells below do not belong to a leaf of this size.
    Inner,
    /// A leaf, with the mask of the box's inside corners.
    Leaf(Leaf, u8),
}

/// A node of the model within a brick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::builder) enum ModelNode {
    /// A node with children as in this infobyte.
    Inner(u8),
    Leaf(Leaf),
}

/// Sums over a box whose cells all belong to one leaf, for the box above.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    /// Sum of the fine cells' unit normals.
    normals: [f64; 3],
    moments: Moments,
}

/// Joins the cells of one brick after the other.
pub(in crate::builder) struct Joiner {
    bound: Bound,
    /// Boxes with an edge of 2 to 2^this may become leaves.
    levels: usize,
    /// Coordinates and normal of every cell.
    places: Vec<[u8; 3]>,
    normals: Vec<[i8; 3]>,
    /// Number of cells before each word.
    before: Vec<usize>,
    /// Visibility of the cells, a bit each.
    shown: [u64; WORDS],
    /// Crossings of the brick, or of a single box if the brick has too many.
    crossings: Crossings,
    /// Number of the brick's crossings before each box of 2^3, then their total; empty if there are too many.
    starts: Vec<u16>,
    /// Boxes with an edge of 2^(i + 1), in Morton order.
    states: [Vec<State>; LEVELS],
    /// Sums of the last eight boxes with an edge of 2^(i + 1).
    sums: [[Sums; 8]; LEVELS],
}

/// [`Joiner::join`] for an instruction set.
struct Join<'a, 'b>(&'a mut Joiner, &'a FineBrick<'b>);

impl Kernel for Join<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run(self, _: impl Lanes) {
        let Self(joiner, brick) = self;
        joiner.list(brick);
        joiner.gather_all(brick);
        joiner.states.iter_mut().for_each(Vec::clear);
        for at in 0..CELLS / 8 {
            let (mut at, mut e) = (at, 1);
            loop {
                let state = joiner.state(brick, at, e);
                joiner.states[e - 1].push(state);
                if at % 8 != 7 || e == LEVELS {
                    break;
                }
                (at, e) = (at / 8, e + 1);
            }
        }
    }
}

/// [`Joiner::measure`] for an instruction set.
struct Measure<'a, 'b>(&'a mut Joiner, &'a FineBrick<'b>, &'a mut Distances);

impl Kernel for Measure<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run(self, _: impl Lanes) {
        let Self(joiner, brick, distances) = self;
        joiner.for_each_run(brick, |cells| {
            distances.add_none(brick.sides[cells].iter().map(|sides| crossed_edges(*sides)).sum());
        });
        let mut kept = Vec::new();
        for e in 1..=joiner.levels {
            joiner.for_each_kept(e, |at, found| {
                if let ModelNode::Leaf(leaf) = found {
                    kept.push((at, e, leaf));
                }
            });
        }
        for (at, e, leaf) in kept {
            let Some(crossings) = joiner.crossings(brick, at, e) else { continue };
            let low = morton::decode((at as u64) << (3 * e)).map(u32::cast_signed);
            let crossings = joiner.crossings.points(crossings);
            distances.add_all(leaf.distances(&joiner.bound, low, 1 << e, &crossings));
            distances.add_between(leaf.between);
        }
    }
}

impl Joiner {
    /// Memory of one joiner.
    pub(in crate::builder) const BYTES: u64 = (CELLS * (3 + 3)
        + Crossings::BYTES
        + (CELLS / 7 + LEVELS) * size_of::<State>()
        + (CELLS / 8 + 1) * size_of::<u16>()
        + WORDS * (size_of::<usize>() + size_of::<u64>())
        + 8 * LEVELS * size_of::<Sums>()) as u64;

    /// A joiner for a grid of this depth, whose root never becomes a leaf.
    pub(in crate::builder) fn new(bound: Bound, depth: u32) -> Self {
        Self {
            bound,
            levels: (depth.max(1) as usize - 1).min(LEVELS),
            places: Vec::with_capacity(CELLS),
            normals: Vec::with_capacity(CELLS),
            before: Vec::with_capacity(WORDS),
            shown: [0; WORDS],
            crossings: Crossings::new(),
            starts: Vec::with_capacity(CELLS / 8 + 1),
            states: std::array::from_fn(|i| Vec::with_capacity(CELLS >> (3 * (i + 1)))),
            sums: [[Sums::default(); 8]; LEVELS],
        }
    }

    /// Finds the leaves of a brick.
    pub(in crate::builder) fn join(&mut self, brick: &FineBrick<'_>) {
        dispatch(Join(self, brick));
    }

    /// Measures the distances of a brick's leaves from its cells.
    pub(in crate::builder) fn measure(&mut self, brick: &FineBrick<'_>, distances: &mut Distances) {
        dispatch(Measure(self, brick, distances));
    }

    /// Lists the cells of a brick.
    #[inline(always)]
    fn list(&mut self, brick: &FineBrick<'_>) {
        self.places.clear();
        self.before.clear();
        self.shown = *brick.words;
        for (word, bits) in brick.words.iter().enumerate() {
            self.before.push(self.places.len());
            let mut left = *bits;
            let low = morton::decode(64 * word as u64).map(|c| c.to_le_bytes()[0]);
            while left != 0 {
                let code = left.trailing_zeros();
                left &= left - 1;
                let within = |a: usize| (code >> a & 1 | (code >> (a + 2) & 2)).to_le_bytes()[0];
                self.places.push(std::array::from_fn(|a| low[a] + within(a)));
            }
        }
        self.normals.clear();
        self.normals.extend(brick.codes.iter().map(|code| {
            normal::decode_l1(u16::from_le_bytes(*code)).map(|n| n.to_le_bytes()[0].cast_signed())
        }));
    }

    /// Gathers the crossings of the whole brick for all levels at once, unless they are too many.
    #[inline(always)]
    fn gather_all(&mut self, brick: &FineBrick<'_>) {
        self.crossings.clear();
        self.starts.clear();
        for at in 0..CELLS / 8 {
            let so_far = u16::try_from(self.crossings.len()).ok();
            let cells = self.cells(brick, at, 1);
            if so_far.is_none() || self.crossings.gather(brick, &self.places, cells).is_none() {
                self.starts.clear();
                return;
            }
            self.starts.extend(so_far);
        }
        self.starts.extend(u16::try_from(self.crossings.len()));
    }

    /// The crossings of box `at` with an edge of 2^e; `None` if they are too many.
    #[inline(always)]
    fn crossings(&mut self, brick: &FineBrick<'_>, at: usize, e: usize) -> Option<Range<usize>> {
        let boxes = 1 << (3 * e - 3);
        if let (Some(start), Some(end)) = (self.starts.get(at * boxes), self.starts.get((at + 1) * boxes)) {
            return Some(usize::from(*start)..usize::from(*end));
        }
        let cells = self.cells(brick, at, e);
        self.crossings.clear();
        self.crossings.gather(brick, &self.places, cells)?;
        Some(0..self.crossings.len())
    }

    /// The cells of box `at` with an edge of 2^e.
    #[inline(always)]
    fn cells(&self, brick: &FineBrick<'_>, at: usize, e: usize) -> Range<usize> {
        let count = |bits: u64| bits.count_ones() as usize;
        if e == 1 {
            let (word, shift) = (at / 8, 8 * (at % 8));
            let bits = brick.words[word];
            let first = self.before[word] + count(bits & ((1 << shift) - 1));
            return first..first + count(bits >> shift & 0xff);
        }
        let words = 1 << (3 * e - 6);
        let last = (at + 1) * words - 1;
        self.before[at * words]..self.before[last] + count(brick.words[last])
    }

    #[inline(always)]
    fn state(&mut self, brick: &FineBrick<'_>, at: usize, e: usize) -> State {
        let cells = self.cells(brick, at, e);
        if cells.is_empty() {
            self.sums[e - 1][at % 8] = Sums::default();
            return State::Empty;
        }
        let mut children = [None; 8];
        if e == 1 {
            let mut sides = brick.sides[cells.clone()].iter();
            let there = brick.words[at / 8] >> (8 * (at % 8));
            for (octant, child) in children.iter_mut().enumerate() {
                *child = (there >> octant & 1 == 1).then(|| sides.next().copied()).flatten();
            }
        } else {
            for (child, state) in children.iter_mut().zip(&self.states[e - 2][8 * at..8 * at + 8]) {
                match state {
                    State::Empty => {}
                    State::Inner => return State::Inner,
                    State::Leaf(_, sides) => *child = Some(*sides),
                }
            }
        }
        if e > self.levels {
            return State::Inner;
        }
        let sides = sides_of(&children);
        let low = morton::decode((at as u64) << (3 * e)).map(u32::cast_signed);
        let Some(range) = self.crossings(brick, at, e) else { return State::Inner };
        let Self { bound, places, normals, before, crossings, .. } = self;
        let crossings = crossings.points(range);
        let sums = if e == 1 {
            Sums { normals: plane::sum(bound, &normals[cells.clone()]), moments: Moments::of(&crossings) }
        } else {
            self.sums[e - 2].iter().fold(Sums::default(), |mut sum, child| {
                sum.normals = add_scaled(sum.normals, 1.0, child.normals);
                sum.moments.add(&child.moments);
                sum
            })
        };
        self.sums[e - 1][at % 8] = sums;
        let fit = plane::Fit { bound, brick, places, normals, before, cells, low, edge: 1 << e, sides };
        fit.leaf(&sums, &crossings).map_or(State::Inner, |leaf| State::Leaf(leaf, sides))
    }

    /// Calls `found` with the position and the node of each box with an edge of 2^e in the model, in Morton order.
    pub(in crate::builder) fn for_each_kept(&self, e: usize, mut found: impl FnMut(usize, ModelNode)) {
        for (at, state) in self.states[e - 1].iter().enumerate() {
            if e < LEVELS && self.states[e][at / 8] != State::Inner {
                continue;
            }
            match state {
                State::Empty => {}
                State::Leaf(leaf, _) => found(at, ModelNode::Leaf(*leaf)),
                State::Inner => found(at, ModelNode::Inner(self.infobyte(at, e))),
            }
        }
    }

    fn infobyte(&self, at: usize, e: usize) -> u8 {
        if e == 1 {
            return self.shown[at / 8].to_le_bytes()[at % 8];
        }
        let below = &self.states[e - 2][8 * at..8 * at + 8];
        below.iter().enumerate().fold(0, |mask, (i, s)| mask | u8::from(*s != State::Empty) << i)
    }

    /// Calls `found` with runs of the cells that stay, in order.
    pub(in crate::builder) fn for_each_run(
        &self,
        brick: &FineBrick<'_>,
        mut found: impl FnMut(Range<usize>),
    ) {
        for (at, state) in self.states[0].iter().enumerate() {
            if *state == State::Inner {
                self.for_each_run_of(brick, at, &mut found);
            }
        }
    }
}

/// Mask of a box's inside corners, from its children: corner i comes from child i. An empty child lies on one side, the
/// side of the box's middle, which is a corner of every other child.
fn sides_of(children: &[Option<u8>; 8]) -> u8 {
    let middle = (0..8).find_map(|j| children[j].map(|sides| sides >> (7 - j) & 1)).unwrap_or(0);
    (0..8).fold(0, |bits, i| bits | children[i].map_or(middle, |sides| sides >> i & 1) << i)
}
