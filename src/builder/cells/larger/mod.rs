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
//!    codes around the fitted normal the first that does ([`plane`]);
//! 5. where the plane cuts the box's edges, and in the middle of these points, it is within one and a half bounds of
//!    a fine cell's polygon: planes do not jut out ([`polygon`]).
//!
//! By 3 every inside sample in the box lies behind the plane: step from it along edges so that the normal's component
//! rises; either all samples are inside as far as the box's corner, which is behind, or the last before one outside
//! is an inside corner of a fine cell, which is. So no ray from outside reaches an inside sample, or a box of them.
//!
//! Everything follows from one aligned brick. Decisions 3 and 4 are of whole numbers, the others of IEEE operations
//! in a fixed order.

mod plane;
mod polygon;
#[cfg(test)]
mod tests;

use std::ops::Range;

use super::corner::EDGES;
use crate::format::cell::{CORNERS, HAS_CORNERS, at_corner};
use crate::format::normal;
use crate::geom::morton;

pub(in crate::builder) use plane::Leaf;

/// Edge of a brick.
const BRICK: usize = 32;
/// Levels of boxes in a brick.
pub(in crate::builder) const LEVELS: usize = 5;
/// Cells of a brick.
const CELLS: usize = BRICK * BRICK * BRICK;
/// Words of 64 cells.
const WORDS: usize = CELLS / 64;
/// Parts of a cell's edge in which a crossing is counted, and distances in parts of a voxel of the finest spacing.
const PARTS: i32 = 1 << 16;
/// Most crossings of a box that may become a leaf: a plane through a whole brick has some 10,000.
const MAX_CROSSINGS: usize = 16 << 10;
/// How far a plane may be from the fine cells' polygons, in bounds.
const BETWEEN: f64 = 1.5;
/// Classes of distances, of which the 99th percentile is read.
const CLASSES: usize = 256;

/// How far leaves may be from the surface, and how long cells are.
#[derive(Clone, Copy, Debug)]
pub(in crate::builder) struct Bound {
    /// The bound, in voxels of the finest spacing.
    pub(in crate::builder) error: f64,
    /// Spacing along each axis, in finest ones.
    sides: [f64; 3],
    /// One by that.
    inverse: [f64; 3],
}

impl Bound {
    /// For spacings in mm.
    pub(in crate::builder) fn new(error: f64, spacing_mm: [f64; 3]) -> Self {
        let finest = spacing_mm[0].min(spacing_mm[1]).min(spacing_mm[2]);
        Self { error, sides: spacing_mm.map(|s| s / finest), inverse: spacing_mm.map(|s| finest / s) }
    }

    /// A normal of index space in the space of lengths.
    fn physical(&self, n: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|a| n[a] * self.inverse[a])
    }
}

/// The cells of a brick in Morton order.
#[derive(Clone, Copy)]
pub(in crate::builder) struct FineBrick<'a> {
    /// Which cells there are: a bit each.
    pub(in crate::builder) words: &'a [u64; WORDS],
    /// Normals and offsets, as they are stored.
    pub(in crate::builder) codes: &'a [[u8; 2]],
    pub(in crate::builder) offsets: &'a [u8],
    /// Corners of the cells that have them, with their numbers among the cells, which rise.
    pub(in crate::builder) corners: &'a [(u16, [i8; CORNERS])],
    /// Corners inside of every cell, as bits.
    pub(in crate::builder) sides: &'a [u8],
}

impl FineBrick<'_> {
    fn normal(&self, cell: usize) -> [i32; 3] {
        normal::decode_l1(u16::from_le_bytes(self.codes[cell]))
    }

    /// How far each corner lies in front of the surface, up to a factor.
    fn ahead(&self, cell: usize) -> [i32; CORNERS] {
        let offset = self.offsets[cell].cast_signed();
        if offset != HAS_CORNERS {
            let n = self.normal(cell);
            return std::array::from_fn(|c| at_corner(n, c) - i32::from(offset));
        }
        let found = self.corners.binary_search_by_key(&cell, |(cell, _)| usize::from(*cell));
        found.map_or([0; CORNERS], |at| self.corners[at].1.map(|c| -i32::from(c)))
    }

    /// Calls `found` with the edges of a cell that are crossed, and where, from their first corner in [`PARTS`].
    #[expect(clippy::cast_possible_truncation, reason = "0..=PARTS")]
    fn for_each_crossing(&self, cell: usize, mut found: impl FnMut((usize, usize), i32)) {
        let (sides, ahead) = (self.sides[cell], self.ahead(cell));
        let mut left = CROSSED[usize::from(sides)];
        while left != 0 {
            let (p, q) = EDGES[left.trailing_zeros() as usize % EDGES.len()];
            left &= left - 1;
            let (a, b) = (ahead[p], ahead[q]);
            let along = if (a <= 0) != (b <= 0) {
                (f64::from(a) / f64::from(a - b) * f64::from(PARTS) + 0.5).floor() as i32
            } else if sides >> p & 1 == 1 {
                // The plane covers the outside corner, too.
                PARTS
            } else {
                0
            };
            found((p, q), along);
        }
    }
}

/// Edges whose ends are on different sides, as bits, by the corners inside.
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

/// Number of such edges.
fn crossed_edges(sides: u8) -> u64 {
    CROSSED[usize::from(sides)].count_ones().into()
}

/// A box of the brick.
#[derive(Clone, Copy, Debug, PartialEq)]
enum State {
    Empty,
    /// Some of what is below does not belong to a leaf as large as this.
    Inner,
    /// With the corners inside, as bits.
    Leaf(Leaf, u8),
}

/// A node of the model within a brick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::builder) enum Kept {
    /// With children as in this infobyte.
    Inner(u8),
    Leaf(Leaf),
}

/// Distances between the fine cells and the leaves in their place, in [`PARTS`].
#[derive(Clone, Debug, PartialEq)]
pub(in crate::builder) struct Distances {
    crossings: u64,
    squares: u128,
    most: u32,
    classes: Vec<u64>,
    /// Where the last class ends.
    limit: u64,
}

impl Distances {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most two voxels")]
    pub(in crate::builder) fn new(error: f64) -> Self {
        let limit = (error * BETWEEN * f64::from(PARTS)).ceil().clamp(1.0, 1e6) as u64;
        Self { crossings: 0, squares: 0, most: 0, classes: vec![0; CLASSES], limit }
    }

    fn add(&mut self, distance: u32) {
        let class = u64::from(distance) * CLASSES as u64 / self.limit;
        self.classes[usize::try_from(class).unwrap_or(CLASSES).min(CLASSES - 1)] += 1;
        self.crossings += 1;
        self.squares += u128::from(distance) * u128::from(distance);
        self.most = self.most.max(distance);
    }

    /// Crossings of cells that stay.
    fn add_none(&mut self, crossings: u64) {
        self.classes[0] += crossings;
        self.crossings += crossings;
    }

    pub(in crate::builder) fn join(&mut self, other: &Self) {
        self.crossings += other.crossings;
        self.squares += other.squares;
        self.most = self.most.max(other.most);
        self.classes.iter_mut().zip(&other.classes).for_each(|(own, more)| *own += more);
    }

    /// Root of the mean square, 99th percentile (the end of its class) and greatest, in voxels of the finest spacing.
    #[expect(clippy::cast_precision_loss, reason = "sums of small whole numbers")]
    pub(in crate::builder) fn rms_p99_most(&self) -> [f64; 3] {
        let (crossings, parts) = (self.crossings.max(1), f64::from(PARTS));
        let rms = (self.squares as f64 / crossings as f64).sqrt() / parts;
        let (mut below, mut p99) = (0, 0.0);
        for (end, count) in (1_u32..).zip(&self.classes) {
            below += count;
            if below * 100 >= crossings * 99 {
                p99 = if end == 1 && self.most == 0 { 0.0 } else { f64::from(end) / CLASSES as f64 };
                break;
            }
        }
        let most = f64::from(self.most) / parts;
        [rms, (p99 * self.limit as f64 / parts).min(most), most]
    }
}

/// Joins the cells of one brick after the other.
pub(in crate::builder) struct Joiner {
    bound: Bound,
    /// Boxes with an edge of 2 to 2^this may become leaves.
    levels: usize,
    /// Coordinates of every cell.
    places: Vec<[u8; 3]>,
    /// Cells before each word.
    before: Vec<usize>,
    /// Crossings of the brick, or of a box where those are too many; in [`PARTS`] from the corner of the brick.
    crossings: Vec<[i32; 3]>,
    /// Crossings of the brick before each box of 2^3, and all of them; empty where they are too many.
    starts: Vec<u16>,
    /// Boxes with an edge of 2^(i + 1), in Morton order.
    states: [Vec<State>; LEVELS],
}

impl Joiner {
    /// Memory of one.
    pub(in crate::builder) const BYTES: u64 = (CELLS * 3
        + MAX_CROSSINGS * size_of::<[i32; 3]>()
        + (CELLS / 7 + LEVELS) * size_of::<State>()
        + (CELLS / 8 + 1) * size_of::<u16>()
        + WORDS * size_of::<usize>()) as u64;

    /// For a grid of this depth, whose root never becomes a leaf.
    pub(in crate::builder) fn new(bound: Bound, depth: u32) -> Self {
        Self {
            bound,
            levels: (depth.max(1) as usize - 1).min(LEVELS),
            places: Vec::with_capacity(CELLS),
            before: Vec::with_capacity(WORDS),
            crossings: Vec::with_capacity(MAX_CROSSINGS),
            starts: Vec::with_capacity(CELLS / 8 + 1),
            states: std::array::from_fn(|i| Vec::with_capacity(CELLS >> (3 * (i + 1)))),
        }
    }

    /// Finds the leaves of a brick.
    pub(in crate::builder) fn join(&mut self, brick: &FineBrick<'_>) {
        self.places.clear();
        self.before.clear();
        for (word, bits) in brick.words.iter().enumerate() {
            self.before.push(self.places.len());
            let mut left = *bits;
            while left != 0 {
                let code = 64 * word as u64 + u64::from(left.trailing_zeros());
                left &= left - 1;
                self.places.push(morton::decode(code).map(|c| c.to_le_bytes()[0]));
            }
        }
        self.gather_all(brick);
        for e in 1..=LEVELS {
            for at in 0..CELLS >> (3 * e) {
                let state = self.state(brick, at, e);
                self.states[e - 1].push(state);
            }
        }
    }

    /// Makes all crossings at once, for every level, unless they are too many.
    #[expect(clippy::cast_possible_truncation, reason = "at most MAX_CROSSINGS")]
    fn gather_all(&mut self, brick: &FineBrick<'_>) {
        const { assert!(MAX_CROSSINGS <= u16::MAX as usize) };
        let mut crossings = std::mem::take(&mut self.crossings);
        crossings.clear();
        self.starts.clear();
        for at in 0..CELLS / 8 {
            self.starts.push(crossings.len() as u16);
            if gather(brick, &self.places, self.cells(brick, at, 1), &mut crossings).is_none() {
                self.starts.clear();
                break;
            }
        }
        if !self.starts.is_empty() {
            self.starts.push(crossings.len() as u16);
        }
        self.crossings = crossings;
    }

    /// The crossings of box `at` with an edge of 2^e, unless they are too many.
    fn crossings(&mut self, brick: &FineBrick<'_>, at: usize, e: usize) -> Option<Range<usize>> {
        let boxes = 1 << (3 * e - 3);
        if let (Some(start), Some(end)) = (self.starts.get(at * boxes), self.starts.get((at + 1) * boxes)) {
            return Some(usize::from(*start)..usize::from(*end));
        }
        let cells = self.cells(brick, at, e);
        self.crossings.clear();
        gather(brick, &self.places, cells, &mut self.crossings)?;
        Some(0..self.crossings.len())
    }

    /// The cells of box `at` with an edge of 2^e.
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

    fn state(&mut self, brick: &FineBrick<'_>, at: usize, e: usize) -> State {
        if at == 0 {
            self.states[e - 1].clear();
        }
        let cells = self.cells(brick, at, e);
        if cells.is_empty() {
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
        let Some(crossings) = self.crossings(brick, at, e) else { return State::Inner };
        let Self { bound, places, before, crossings: all, .. } = self;
        let fit = plane::Fit { bound, brick, places, before, cells, low, edge: 1 << e, sides };
        fit.leaf(&all[crossings]).map_or(State::Inner, |leaf| State::Leaf(leaf, sides))
    }

    /// Calls `found` with the nodes of the model that have an edge of 2^e, in Morton order, and their places in it.
    pub(in crate::builder) fn for_each_kept(
        &self,
        brick: &FineBrick<'_>,
        e: usize,
        mut found: impl FnMut(usize, Kept),
    ) {
        for (at, state) in self.states[e - 1].iter().enumerate() {
            if e < LEVELS && self.states[e][at / 8] != State::Inner {
                continue;
            }
            match state {
                State::Empty => {}
                State::Leaf(leaf, _) => found(at, Kept::Leaf(*leaf)),
                State::Inner => found(at, Kept::Inner(self.infobyte(brick, at, e))),
            }
        }
    }

    fn infobyte(&self, brick: &FineBrick<'_>, at: usize, e: usize) -> u8 {
        if e == 1 {
            return brick.words[at / 8].to_le_bytes()[at % 8];
        }
        let below = &self.states[e - 2][8 * at..8 * at + 8];
        below.iter().enumerate().fold(0, |mask, (i, s)| mask | u8::from(*s != State::Empty) << i)
    }

    /// Calls `found` with the numbers of the cells that stay, in order, a run for each box of 2^3.
    pub(in crate::builder) fn for_each_run(
        &self,
        brick: &FineBrick<'_>,
        mut found: impl FnMut(usize, Range<usize>),
    ) {
        for (at, state) in self.states[0].iter().enumerate() {
            if *state == State::Inner {
                found(at, self.cells(brick, at, 1));
            }
        }
    }

    /// Measures how far the leaves of a brick are from its cells.
    pub(in crate::builder) fn measure(&mut self, brick: &FineBrick<'_>, distances: &mut Distances) {
        self.for_each_run(brick, |_, cells| {
            distances.add_none(brick.sides[cells].iter().map(|sides| crossed_edges(*sides)).sum());
        });
        for e in 1..=self.levels {
            let mut kept = Vec::new();
            self.for_each_kept(brick, e, |at, found| {
                if let Kept::Leaf(leaf) = found {
                    kept.push((at, leaf));
                }
            });
            for (at, leaf) in kept {
                let Some(crossings) = self.crossings(brick, at, e) else { continue };
                let low = morton::decode((at as u64) << (3 * e)).map(u32::cast_signed);
                let crossings = &self.crossings[crossings];
                leaf.measure(&self.bound, low, 1 << e, crossings, |distance| distances.add(distance));
                distances.most = distances.most.max(leaf.between);
            }
        }
    }
}

/// Appends the crossings of cells, unless they are too many.
fn gather(
    brick: &FineBrick<'_>,
    places: &[[u8; 3]],
    cells: Range<usize>,
    crossings: &mut Vec<[i32; 3]>,
) -> Option<()> {
    for cell in cells {
        let place = places[cell].map(|c| i32::from(c) * PARTS);
        brick.for_each_crossing(cell, |(p, q), along| {
            let axis = (p ^ q).trailing_zeros() as usize;
            let corner = |a: usize| i32::from(p >> a & 1 == 1) * PARTS;
            crossings.push(std::array::from_fn(|a| place[a] + if a == axis { along } else { corner(a) }));
        });
        if crossings.len() + EDGES.len() > MAX_CROSSINGS {
            return None;
        }
    }
    Some(())
}

/// Corners of a box that are inside, from those of its children: corner i is child i's, and a child that is empty lies
/// on one side, that of the box's middle, which is a corner of every other child.
fn sides_of(children: &[Option<u8>; 8]) -> u8 {
    let middle = (0..8).find_map(|j| children[j].map(|sides| sides >> (7 - j) & 1)).unwrap_or(0);
    (0..8).fold(0, |bits, i| bits | children[i].map_or(middle, |sides| sides >> i & 1) << i)
}
