//! One pass over the occupancy along one of the eight ways of rays: up or down each axis.
#![expect(clippy::cast_possible_truncation, reason = "places are within the grid, below 2^17")]

use std::io;

use super::row::{Air, Lit, Upstream, sweep};
use crate::builder::bits::BitVolume;
use crate::builder::error::BuildError;

/// Bytes of rows processed at a time, of each kind.
const BLOCK_BYTES: usize = 16 << 10;

/// Rays of one direction along each axis, and their possible positions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct SweepDirection {
    /// True for the axes along which the rays move.
    pub(super) moves: [bool; 3],
    /// True for the axes along which the rays go down.
    pub(super) back: [bool; 3],
    /// The box of the eye, where the rays begin: they stay on its far side.
    pub(super) eye: Option<[i64; 3]>,
    /// True if the eye lies in the grid. Otherwise everything beyond the grid is lit.
    pub(super) within: bool,
}

impl SweepDirection {
    /// True if the rays can be at this position of an axis. Positions are rounded; one more counts as on the far side.
    pub(super) fn reaches(&self, axis: usize, at: i64) -> bool {
        self.eye.is_none_or(|eye| if self.back[axis] { at <= eye[axis] + 1 } else { at >= eye[axis] - 1 })
    }

    /// True if the rays can be anywhere in a grid of this size.
    pub(super) fn meets(&self, dims: [u32; 3]) -> bool {
        (0..3).all(|a| {
            let (first, last) = (0, i64::from(dims[a]) - 1);
            self.reaches(a, if self.back[a] { first } else { last })
        })
    }

    /// True if boxes of this row beyond the grid are lit.
    fn is_lit_beyond(&self, y: i64, z: i64) -> bool {
        !self.within && self.reaches(1, y) && self.reaches(2, z)
    }

    /// The row at (y, z) if rays come from there: as stored, or beyond the grid uniformly lit or dark.
    fn lit<'a>(
        &self,
        moves: bool,
        (is_held, held): (bool, &'a [u64]),
        (region, zeros): (&'a [u64], &'a [u64]),
        column_lit: bool,
        y: i64,
        z: i64,
    ) -> Lit<'a> {
        let beyond = moves && self.is_lit_beyond(y, z);
        let row = match (moves && is_held, beyond) {
            (true, _) => held,
            (false, true) => region,
            (false, false) => zeros,
        };
        Lit { row, before: beyond && column_lit }
    }
}

/// State of one pass. Memory: [`Pass::bytes`].
pub(super) struct Pass<'a> {
    way: SweepDirection,
    occupancy: &'a BitVolume,
    is_cells: bool,
    /// Lit boxes of the previous slice, in the direction of the rays, stored as slice `slot`.
    slices: &'a BitVolume,
    slot: u32,
    seen: &'a BitVolume,
    /// Possible positions of rays along x.
    region: Vec<u64>,
    zeros: Vec<u64>,
    rows: usize,
    block: Block,
}

/// Rows of one block, and the rows before them.
struct Block {
    /// Rows of slices z - 1 and z, with one more before.
    air: [Vec<u64>; 2],
    old: Vec<u64>,
    new: Vec<u64>,
    seen: Vec<u64>,
    old_before: Vec<u64>,
    new_before: Vec<u64>,
    entered: Vec<u64>,
    /// Boxes of a row where rays begin.
    start: Vec<u64>,
}

fn block_rows(row_words: usize, ny: u32) -> usize {
    (BLOCK_BYTES / 8 / row_words).clamp(1, ny as usize)
}

impl<'a> Pass<'a> {
    pub(super) fn bytes(row_words: usize, ny: u32) -> u64 {
        (row_words * 8 * (5 * block_rows(row_words, ny) + 8)) as u64
    }

    pub(super) fn new(
        way: SweepDirection,
        occupancy: &'a BitVolume,
        is_cells: bool,
        (slices, slot): (&'a BitVolume, u32),
        seen: &'a BitVolume,
    ) -> Self {
        let words = occupancy.row_words;
        let rows = block_rows(words, occupancy.dims().ny());
        let region = (0..words).map(|i| {
            (0..64).fold(0, |word, b| {
                let at = 64 * i + b;
                let x = if way.back[0] { 64 * words - 1 - at } else { at };
                word | u64::from(way.reaches(0, x as i64)) << b
            })
        });
        let row = || vec![0; words];
        Self {
            way,
            occupancy,
            is_cells,
            slices,
            slot,
            seen,
            region: region.collect(),
            zeros: row(),
            rows,
            block: Block {
                air: [vec![0; (rows + 1) * words], vec![0; (rows + 1) * words]],
                old: vec![0; rows * words],
                new: vec![0; rows * words],
                seen: vec![0; rows * words],
                old_before: row(),
                new_before: row(),
                entered: row(),
                start: row(),
            },
        }
    }

    /// Processes slice `z`; slices come in the direction of the rays.
    pub(super) fn slice(&mut self, z: u32) -> Result<(), BuildError> {
        if !self.way.reaches(2, z.into()) {
            return Ok(());
        }
        let (ny, rows) = (self.occupancy.dims().ny(), self.rows as u32);
        let blocks = ny.div_ceil(rows);
        self.block.new_before.fill(0);
        self.block.old_before.fill(0);
        for at in 0..blocks {
            let at = if self.way.back[1] { blocks - 1 - at } else { at };
            let first = at * rows;
            self.rows_of_slice(z, first, rows.min(ny - first))?;
        }
        Ok(())
    }

    fn rows_of_slice(&mut self, z: u32, first: u32, count: u32) -> Result<(), BuildError> {
        let words = self.occupancy.row_words;
        let seen_bits = self.seen;
        let failed = |cause| seen_bits.failed(cause);
        let len = count as usize * words;
        self.read_air(z, first, count).map_err(failed)?;
        let slot = self.slices.row(first, self.slot);
        self.slices.read(slot, 0, &mut self.block.old[..len]).map_err(failed)?;
        let seen = self.seen.row(first, z);
        self.seen.read(seen, 0, &mut self.block.seen[..len]).map_err(failed)?;
        for j in 0..count {
            let j = if self.way.back[1] { count - 1 - j } else { j };
            self.row(z, first + j, j as usize);
            let row = j as usize * words..(j as usize + 1) * words;
            let block = &mut self.block;
            block.old_before.copy_from_slice(&block.old[row.clone()]);
            block.new_before.copy_from_slice(&block.new[row.clone()]);
            for (i, seen) in block.seen[row].iter_mut().enumerate() {
                let entered = &block.entered;
                *seen |= if self.way.back[0] { entered[words - 1 - i].reverse_bits() } else { entered[i] };
            }
        }
        self.slices.write(slot, 0, &self.block.new[..len])?;
        self.seen.write(seen, 0, &self.block.seen[..len])
    }

    /// Air of slices z - 1 and z, rows `first - 1 ..`, in the direction of the rays.
    fn read_air(&mut self, z: u32, first: u32, count: u32) -> io::Result<()> {
        let words = self.occupancy.row_words;
        let back = self.way.back[0];
        for (slice, air) in self.block.air.iter_mut().enumerate() {
            let Some(z) = (z + slice as u32).checked_sub(1) else {
                air.fill(u64::MAX);
                continue;
            };
            if slice == 0 && !self.is_cells {
                continue;
            }
            // The row before the first.
            let skip = usize::from(first == 0);
            air[..skip * words].fill(0);
            let rows = count as usize + 1;
            let from = self.occupancy.row(first.saturating_sub(1), z);
            self.occupancy.read(from, 0, &mut air[skip * words..rows * words])?;
            for row in air[..rows * words].chunks_exact_mut(words) {
                if back {
                    row.reverse();
                    row.iter_mut().for_each(|word| *word = word.reverse_bits());
                }
                row.iter_mut().for_each(|word| *word = !*word);
                if back && self.is_cells {
                    // The sample before a cell in the direction of the rays is the one after it in the file.
                    for i in 0..words {
                        let next = row.get(i + 1).copied().unwrap_or(1);
                        row[i] = row[i] >> 1 | next << 63;
                    }
                }
            }
        }
        Ok(())
    }

    /// Processes row `y`, number `j` of the block.
    fn row(&mut self, z: u32, y: u32, j: usize) {
        let (way, dims) = (self.way, self.occupancy.dims());
        let words = self.occupancy.row_words;
        let row = |number: usize| number * words..(number + 1) * words;
        let (y, z) = (i64::from(y), i64::from(z));
        let block = &mut self.block;
        let (new, entered) = (&mut block.new[row(j)], &mut block.entered[..]);
        if !way.reaches(1, y) {
            new.fill(0);
            entered.fill(0);
            return;
        }
        let before = |axis: usize, at: i64| if way.back[axis] { at + 1 } else { at - 1 };
        let (from_y, from_z) = (before(1, y), before(2, z));
        let in_y = (0..i64::from(dims.ny())).contains(&from_y);
        let in_z = (0..i64::from(dims.nz())).contains(&from_z);
        let column = if way.back[0] { dims.nx().into() } else { -1 };
        let column_lit = way.moves[0] && way.reaches(0, column);
        let (region, zeros) = (&self.region, &self.zeros);
        let upstream = Upstream {
            before: column_lit && way.is_lit_beyond(y, z),
            y: way.lit(way.moves[1], (in_y, &block.new_before), (region, zeros), column_lit, from_y, z),
            z: way.lit(way.moves[2], (in_z, &block.old[row(j)]), (region, zeros), column_lit, y, from_z),
            yz: way.lit(
                way.moves[1] && way.moves[2],
                (in_y && in_z, &block.old_before),
                (region, zeros),
                column_lit,
                from_y,
                from_z,
            ),
        };
        let (near, far) = if way.back[1] { (j + 1, j) } else { (j, j + 1) };
        let [below, here] = &block.air;
        let (near_z, far_z) = if way.back[2] { (here, below) } else { (below, here) };
        let own = if self.is_cells { &far_z[row(far)] } else { &here[row(j + 1)] };
        let air = Air {
            near_both: &near_z[row(near)],
            near_y: &far_z[row(near)],
            near_z: &near_z[row(far)],
            far: own,
        };
        let sweep = if self.is_cells { sweep::<true> } else { sweep::<false> };
        let starts = way.eye.filter(|eye| way.within && (y - eye[1]).abs() <= 1 && (z - eye[2]).abs() <= 1);
        let Some(eye) = starts else {
            return sweep(way.moves[0], &air, &upstream, (region, zeros), new, entered);
        };
        block.start.fill(0);
        for x in (eye[0] - 1).max(0)..=(eye[0] + 1).min(i64::from(dims.nx()) - 1) {
            let x = x as usize;
            let at = if way.back[0] { 64 * words - 1 - x } else { x };
            block.start[at / 64] |= 1 << (at % 64);
        }
        sweep(way.moves[0], &air, &upstream, (region, &block.start), new, entered);
    }
}
