//! The nearest of many triangles that are smaller than a voxel: by cells of a voxel, with balls around them as bounds.
//!
//! ```text
//!   triangles near to a slice of a brick --middle--> cells, row by row
//!   voxel --> 3 x 3 cells, eight balls at a time: the nearest middle is offered first, then all whose ball
//!             reaches nearer than the best so far
//! ```
//!
//! Bounds are in single precision with steps to spare; offered triangles are decided exactly, as all others.
//!
//! Searches that were tried on a torus of 1.84 M skin voxels, of 1 M triangles of two voxels and of 10 M of half
//! a voxel; in processor seconds, on a machine that differs by a fifth from run to run:
//!
//! | tried | 1 M | 10 M |
//! |---|---|---|
//! | lists by slice and brick, one triangle after the other (before) | 0.9 | 4.4 |
//! | disks as bounds by cells of one voxel; of two and four | 1.1; 3.5 | 6.2; 2.9 |
//! | the triangle made ready only once its box is near enough for a voxel | 0.8 | 4.1 |
//! | balls by cells of a voxel, all that reach near enough offered | 0.9 | 3.6 |
//! | the same, eight bounds of their distances at a time before ([`at_least`]); triangles moved to their bricks | 0.9 | 2.2 |
//! | that for triangles of up to three voxels, too | 1.1 | |
//! | what is done with each triangle near to a slice in one place, so that it is part of the loop; signs of differences instead of comparisons, choices by masks: all in lanes | | 1.8 (by a profile) |
//! | large triangles: eight voxels at a time against one triangle | 0.8, but a sixth more for those of many voxels | |
#![expect(clippy::cast_possible_truncation, reason = "cells and lanes are few, places are within a brick")]

use super::bins::{Record, unpacked, ways};
use super::bound::{LANES, at_least};
use super::lattice::{HALF, STEPS};
use super::nearest::{Facet, Nearest};
use crate::cpu::{Kernel, Lanes, dispatch};

/// Most triangles that are sorted at a time.
const MAX_BALLS: usize = 1024;
/// Cells beyond the brick, and along x and y.
const MARGIN: i32 = 4;
const SIDE: usize = 32 + 2 * MARGIN as usize;
/// Largest edge of the box of a triangle that is sorted, in lattice steps.
const LARGEST: i32 = STEPS + STEPS / 4;
const NONE: u32 = u32::MAX;
/// Larger than any squared distance in lattice steps of a brick.
const FAR: f32 = 1e12;

/// The ball around a triangle: its middle from the brick's corner and slice, and its radius, in lattice steps.
#[derive(Clone, Copy, Debug, Default)]
struct Ball {
    at: [f32; 3],
    radius: f32,
    record: u32,
    cell: u16,
}

#[derive(Clone, Copy, Debug)]
struct Balls {
    at: [[f32; LANES]; 3],
    radius: [f32; LANES],
    records: [u32; LANES],
}

/// Balls far from every voxel, in place of none.
const NOWHERE: Balls = Balls { at: [[1e9; LANES]; 3], radius: [0.0; LANES], records: [0; LANES] };

/// Small triangles near to one slice of a brick.
pub(super) struct Cells {
    balls: Vec<Ball>,
    /// Rows of cells that hold balls.
    rows: (usize, usize),
    largest: f32,
    /// First ball of every cell, once the balls are sorted.
    starts: Vec<u16>,
    sorted: Vec<Balls>,
}

impl Cells {
    pub(super) const BYTES: u64 = (MAX_BALLS * size_of::<Ball>()
        + (MAX_BALLS / LANES + 1) * size_of::<Balls>()
        + (SIDE * SIDE + 1) * size_of::<u16>()) as u64;

    pub(super) fn new() -> Self {
        Self {
            balls: Vec::with_capacity(MAX_BALLS),
            rows: (SIDE, 0),
            largest: 0.0,
            starts: vec![0; SIDE * SIDE + 1],
            sorted: vec![NOWHERE; MAX_BALLS / LANES + 1],
        }
    }

    /// True when [`Cells::seek`] is due.
    pub(super) fn is_full(&self) -> bool {
        self.balls.len() == MAX_BALLS
    }

    /// Adds the triangle of record `number` if it is small and may be within `reach` of a voxel of the slice;
    /// `false` if it is large. Coordinates are from the corner of the brick, whose slice's centres are at z 0.
    #[inline(always)]
    pub(super) fn add(&mut self, record: &Record, number: u32, [x, y, z]: [i32; 3], reach: i32) -> bool {
        let (mut doubled, mut edges) = ([0; 3], [0; 3]);
        for (axis, corner) in [x, y, z].into_iter().enumerate() {
            let [a, b] = ways(record, axis);
            let (low, high) = (a.min(b).min(0), a.max(b).max(0));
            // No overflow: coordinates are below 2^29.
            doubled[axis] = (2 * record[axis].wrapping_sub(corner)).wrapping_add(low).wrapping_add(high);
            edges[axis] = high.wrapping_sub(low);
        }
        if edges.iter().any(|edge| *edge > LARGEST) {
            return false;
        }
        let cell = |doubled: i32| (doubled >> 13) + MARGIN;
        let (column, row) = (cell(doubled[0]), cell(doubled[1]));
        let side = 0..SIDE as i32;
        // A quick test by the triangle's box.
        let far = doubled[2].abs() - edges[2] > 2 * reach + 2;
        if far || !side.contains(&column) || !side.contains(&row) {
            return true;
        }
        let edge = edges.map(|edge| edge as f32);
        let radius = 0.5 * (edge[0] * edge[0] + edge[1] * edge[1] + edge[2] * edge[2]).sqrt() + 0.5;
        let row = row as usize;
        self.rows = (self.rows.0.min(row), self.rows.1.max(row + 1));
        self.largest = if radius > self.largest { radius } else { self.largest };
        let cell = (row * SIDE + column as usize) as u16;
        let at = doubled.map(|d| d as f32 * 0.5);
        self.balls.push(Ball { at, radius, record: number, cell });
        true
    }

    /// Offers the added triangles, whose records are found by number, to the wanted voxels of a brick's slice, and
    /// begins anew.
    #[inline(never)]
    pub(super) fn seek<'r>(
        &mut self,
        record: impl Fn(u32) -> &'r Record,
        corner: [i32; 3],
        wanted: &[u32; 32],
        nearest: &mut [Nearest],
    ) {
        if self.balls.is_empty() {
            return;
        }
        self.sort();
        dispatch(Seek { cells: self, record, corner, wanted, nearest });
        self.balls.clear();
        self.rows = (SIDE, 0);
        self.largest = 0.0;
    }

    fn sort(&mut self) {
        let (first, end) = (self.rows.0 * SIDE, self.rows.1 * SIDE);
        let starts = &mut self.starts[first..=end];
        starts.fill(0);
        for ball in &self.balls {
            starts[usize::from(ball.cell) - first] += 1;
        }
        let mut sum = 0;
        for start in starts.iter_mut() {
            sum += *start;
            *start = sum;
        }
        // Every cell's end moves down to its start.
        for ball in &self.balls {
            let place = &mut starts[usize::from(ball.cell) - first];
            *place -= 1;
            let to = usize::from(*place);
            let balls = &mut self.sorted[to / LANES];
            for axis in 0..3 {
                balls.at[axis][to % LANES] = ball.at[axis];
            }
            balls.radius[to % LANES] = ball.radius;
            balls.records[to % LANES] = ball.record;
        }
        let count = self.balls.len();
        let last = &mut self.sorted[count / LANES];
        for lane in count % LANES..LANES {
            last.at[0][lane] = 1e9;
        }
    }
}

/// Seeks the nearest triangles of voxels.
struct Seek<'a, F> {
    cells: &'a Cells,
    record: F,
    corner: [i32; 3],
    wanted: &'a [u32; 32],
    nearest: &'a mut [Nearest],
}

impl<'r, F: Fn(u32) -> &'r Record> Kernel for Seek<'_, F> {
    type Output = ();

    #[inline(always)]
    fn run(self, _: impl Lanes) {
        let Self { cells, record, corner, wanted, nearest } = self;
        for (y, row) in wanted.iter().enumerate() {
            let mut left = *row;
            while left != 0 {
                let x = left.trailing_zeros() as usize;
                left &= left - 1;
                let within = [x as i32 * STEPS + HALF, y as i32 * STEPS + HALF];
                let voxel = [corner[0] + within[0], corner[1] + within[1], corner[2]];
                let middle = within.map(|c| c as f32);
                let mut sought =
                    VoxelSearch { voxel, best: &mut nearest[32 * y + x], waiting: [0; LANES], count: 0 };
                let mut first = cells.nearest_middle([x, y], middle, 0);
                if first == NONE {
                    first = cells.nearest_middle([x, y], middle, 1);
                }
                if first != NONE {
                    sought.offer(record(first));
                }
                let bound = sought.bound();
                // Cells on either side of the voxel's own in which a ball may be as near.
                let beyond =
                    ((bound + cells.largest - HALF as f32) * (1.0 / STEPS as f32)).max(0.0) as usize + 1;
                let (from, to) = cells.rows_around(y, beyond);
                for row in from..to {
                    for balls in cells.around(x, row, beyond) {
                        let mut reached = reached(balls, middle, bound);
                        while reached != 0 {
                            let lane = reached.trailing_zeros() as usize % LANES;
                            reached &= reached - 1;
                            if balls.records[lane] != first {
                                sought.add(balls.records[lane], &record);
                            }
                        }
                    }
                }
                sought.settle(&record);
            }
        }
    }
}

/// A voxel, and triangles that wait to be offered to it.
struct VoxelSearch<'a> {
    voxel: [i32; 3],
    best: &'a mut Nearest,
    waiting: [u32; LANES],
    count: usize,
}

impl VoxelSearch<'_> {
    /// Greatest distance of a triangle that may count, with steps to spare.
    #[inline(always)]
    fn bound(&self) -> f32 {
        self.best.bound() + 2.0
    }

    #[inline(always)]
    fn add<'r>(&mut self, number: u32, record: &impl Fn(u32) -> &'r Record) {
        self.waiting[self.count % LANES] = number;
        self.count += 1;
        if self.count == LANES {
            self.settle(record);
        }
    }

    /// Offers the waiting triangles that are near enough.
    #[inline(always)]
    fn settle<'r>(&mut self, record: &impl Fn(u32) -> &'r Record) {
        if self.count == 0 {
            return;
        }
        let first = self.waiting[0];
        self.waiting[self.count..].fill(first);
        let mut corners = [[0.0_f32; LANES]; 9];
        for (lane, number) in self.waiting.iter().enumerate() {
            let t = record(*number);
            for axis in 0..3 {
                let [b, c] = ways(t, axis);
                corners[axis][lane] = (t[axis] - self.voxel[axis]) as f32;
                corners[3 + axis][lane] = b as f32;
                corners[6 + axis][lane] = c as f32;
            }
        }
        let squared = at_least(&corners);
        for (number, squared) in self.waiting.into_iter().zip(squared).take(self.count) {
            let bound = self.bound();
            if squared <= bound * bound {
                self.offer(record(number));
            }
        }
        self.count = 0;
    }

    #[inline(never)]
    fn offer(&mut self, record: &Record) {
        if let Some(facet) = Facet::new(&unpacked(record)) {
            self.best.offer(&facet, self.voxel.map(f64::from));
        }
    }
}

impl Cells {
    /// Rows of cells around a voxel's that hold balls.
    #[inline(always)]
    fn rows_around(&self, y: usize, beyond: usize) -> (usize, usize) {
        let own = y + MARGIN as usize;
        (own.saturating_sub(beyond).max(self.rows.0), (own + beyond + 1).min(self.rows.1))
    }

    /// Balls of the cells of a row around a voxel's, and some more.
    #[inline(always)]
    fn around(&self, x: usize, row: usize, beyond: usize) -> &[Balls] {
        let own = x + MARGIN as usize;
        let starts = &self.starts[row * SIDE..][..=SIDE];
        let start = usize::from(starts[own.saturating_sub(beyond)]);
        let end = usize::from(starts[(own + beyond + 1).min(SIDE)]);
        if start < end { &self.sorted[start / LANES..end.div_ceil(LANES)] } else { &[] }
    }

    /// The triangle whose middle is nearest to a voxel, among those in its cell and `beyond` cells around it.
    #[inline(always)]
    fn nearest_middle(&self, [x, y]: [usize; 2], p: [f32; 2], beyond: usize) -> u32 {
        let (mut least, mut records) = ([FAR; LANES], [NONE; LANES]);
        let (from, to) = self.rows_around(y, beyond);
        for row in from..to {
            for balls in self.around(x, row, beyond) {
                let squared = squared(balls, p);
                for lane in 0..LANES {
                    // All ones where the difference is below zero: chosen by masks the numbers stay in lanes, too.
                    let nearer = (squared[lane] - least[lane]).to_bits().cast_signed() >> 31;
                    let nearer = nearer.cast_unsigned();
                    records[lane] = balls.records[lane] & nearer | records[lane] & !nearer;
                    least[lane] = if squared[lane] < least[lane] { squared[lane] } else { least[lane] };
                }
            }
        }
        let mut first = (FAR, NONE);
        for lane in 0..LANES {
            if least[lane] < first.0 {
                first = (least[lane], records[lane]);
            }
        }
        first.1
    }
}

/// Balls within a bound, a bit each.
#[inline(always)]
fn reached(balls: &Balls, p: [f32; 2], bound: f32) -> u32 {
    let squared = squared(balls, p);
    let mut beyond = 0;
    for (lane, (squared, radius)) in squared.iter().zip(&balls.radius).enumerate() {
        let most = radius + bound;
        // The sign of the difference: compilers know how to gather signs, but not how to gather comparisons.
        beyond |= ((most * most - squared).to_bits() >> 31) << lane;
    }
    !beyond & 0xff
}

/// Squared distances of the middles of balls.
#[inline(always)]
fn squared(balls: &Balls, p: [f32; 2]) -> [f32; LANES] {
    let mut out = [0.0; LANES];
    for (lane, out) in out.iter_mut().enumerate() {
        let (x, y, z) = (balls.at[0][lane] - p[0], balls.at[1][lane] - p[1], balls.at[2][lane]);
        *out = x * x + y * y + z * z;
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_is_that_of_a_search_among_all() {
        let mut state = 9_u32;
        let mut next = |n: u32| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            i32::try_from((state >> 9) % n).unwrap()
        };
        let corner = [64 * STEPS, 96 * STEPS, 7 * STEPS + HALF];
        for (count, size) in [(3, 5000), (400, 5000), (3000, 900), (3000, 60), (50, 9000)] {
            let records: Vec<Record> = (0..count)
                .map(|_| {
                    let at: [i32; 3] = std::array::from_fn(|axis| match axis {
                        2 => corner[2] + next(5 * 4096) - 5 * 2048,
                        _ => corner[axis] + next(36 * 4096) - 2 * 4096,
                    });
                    let ways: [i32; 6] = std::array::from_fn(|_| next(size) - next(size) / 2);
                    let both = |k: usize| ways[k] & 0xffff | ways[k + 3] << 16;
                    [at[0], at[1], at[2], both(0), both(1), both(2)]
                })
                .collect();
            for (reach, squared) in [(STEPS, 16_777_217.0), (2 * STEPS, 4.0 * 16_777_217.0)] {
                let wanted: [u32; 32] = std::array::from_fn(|y| 0x1001_8421_u32.rotate_left(y as u32));
                let mut cells = Cells::new();
                let mut got = vec![Nearest::within(squared); 1024];
                let mut want = got.clone();
                for (number, record) in (0..).zip(&records) {
                    let facet = Facet::new(&unpacked(record));
                    let sorted = cells.add(record, number, corner, reach);
                    for (y, row) in wanted.iter().enumerate() {
                        for x in (0..32).filter(|x| row >> x & 1 != 0) {
                            let voxel = [x as i32, y as i32].map(|c| c * STEPS + HALF);
                            let p = [corner[0] + voxel[0], corner[1] + voxel[1], corner[2]].map(f64::from);
                            if let Some(facet) = &facet {
                                want[32 * y + x].offer(facet, p);
                                if !sorted {
                                    got[32 * y + x].offer(facet, p);
                                }
                            }
                        }
                    }
                    if cells.is_full() {
                        cells.seek(|number| &records[number as usize], corner, &wanted, &mut got);
                    }
                }
                cells.seek(|number| &records[number as usize], corner, &wanted, &mut got);
                for (got, want) in got.iter().zip(&want) {
                    assert_eq!(
                        (got.found(), got.distance(), got.normal),
                        (want.found(), want.distance(), want.normal)
                    );
                }
                assert!(count < 50 || want.iter().filter(|best| best.found()).count() > 3);
            }
        }
    }
}
