//! Infobytes of a subtree as two nibbles, each in the contexts of the boxes around that are known (SPEC 5.9).
#![expect(clippy::cast_possible_truncation, reason = "two boxes and nibbles are wanted")]

use super::group::{Group, GroupCoder, Place, child_place, coordinates, wrong_count};
use super::tables::{SymbolCoder, Tables};
use super::{CodingError, SUBTREE_DEPTH};

/// Rows along a side of the grid: 64 cells and a border.
const SIDE: usize = 66;
/// Rows that a node looks at: its own four, and those at y - 1 and z - 1.
const WINDOW: usize = 2 * SIDE + 3;

/// One depth of a subtree: bit x of the row at (z + 1) * SIDE + y + 1 says whether there is a box.
type Rows = Vec<u64>;

/// Codes the infobytes of groups.
#[derive(Debug)]
pub(crate) struct NodeCoder {
    low: Tables<4096, 3, 6>,
    low_of_cells: Tables<512, 3, 6>,
    high: Tables<4096, 3, 6>,
    high_of_cells: Tables<512, 3, 6>,
    nodes: Rows,
    boxes: Rows,
    places: Vec<Place>,
    next: Vec<Place>,
}

impl Default for NodeCoder {
    fn default() -> Self {
        Self {
            low: Tables::new(),
            low_of_cells: Tables::new(),
            high: Tables::new(),
            high_of_cells: Tables::new(),
            nodes: vec![0; SIDE * SIDE],
            boxes: vec![0; SIDE * SIDE],
            places: Vec::new(),
            next: Vec::new(),
        }
    }
}

impl GroupCoder for NodeCoder {
    const VOXELS: usize = 1 << 18;

    /// A decoder takes the number of subtrees from the group and appends to its levels; either counts the voxels.
    #[inline(always)]
    fn code<C: SymbolCoder>(&mut self, coder: &mut C, group: &mut Group) -> Result<(), CodingError> {
        self.low.restart();
        self.low_of_cells.restart();
        self.high.restart();
        self.high_of_cells.restart();
        let mut begins = [0; SUBTREE_DEPTH as usize];
        group.voxels = 0;
        for _ in 0..group.subtrees {
            // A group that goes on after it is full could be longer than memory.
            if group.voxels >= Self::VOXELS {
                return Err(CodingError::GroupSubtrees { subtrees: group.subtrees });
            }
            group.voxels += self.code_subtree(coder, &mut group.levels, &mut begins)?;
        }
        Ok(())
    }
}

impl NodeCoder {
    /// Codes one subtree, whose infobytes begin at `begins` in the levels and, for a decoder, end with them. Returns its
    /// voxels.
    #[inline(always)]
    fn code_subtree<C: SymbolCoder>(
        &mut self,
        coder: &mut C,
        levels: &mut [Vec<u8>],
        begins: &mut [usize; SUBTREE_DEPTH as usize],
    ) -> Result<usize, CodingError> {
        self.places.clear();
        self.places.push(0);
        let depths = levels.len();
        let mut voxels = 1;
        self.boxes.iter_mut().take(3 * SIDE).for_each(|row| *row = 0);
        if let Some(row) = self.boxes.get_mut(SIDE + 1) {
            *row = 1;
        }
        for (depth, (level, begin)) in levels.iter_mut().zip(begins).enumerate() {
            std::mem::swap(&mut self.nodes, &mut self.boxes);
            let side = (2 << depth) + 2;
            self.boxes.iter_mut().take(side * SIDE).for_each(|row| *row = 0);
            let count = self.places.len();
            if C::READS {
                level.resize(*begin + count, 0);
            }
            let have = level.len().saturating_sub(*begin);
            let masks = level.get_mut(*begin..).and_then(|left| left.get_mut(..count));
            let masks = masks.ok_or_else(|| wrong_count(have, count))?;
            *begin += count;
            let is_last = depth + 1 == depths;
            self.next.clear();
            voxels = 0;
            for (place, mask) in self.places.iter().zip(masks) {
                let [x, y, z] = coordinates(*place);
                let node = (z + 1) * SIDE + y + 1;
                let at = |step: usize| self.nodes.get(node + step).copied().unwrap_or(0);
                let beside = (at(0) >> (x + 1) & 1) | (at(1) >> x & 1) << 1 | (at(SIDE) >> x & 1) << 2;
                let first = 2 * z * SIDE + 2 * y;
                let Some(rows) = self.boxes.get_mut(first..).and_then(|r| r.first_chunk_mut::<WINDOW>())
                else {
                    return Err(CodingError::SubtreeTooDeep);
                };
                let rest = (beside as usize) << 8 | usize::from(is_last) << 11;
                let around = pair(rows, 1, x)
                    | pair(rows, 2, x) << 2
                    | pair(rows, SIDE, x) << 4
                    | left(rows, SIDE + 1, x) << 6
                    | left(rows, SIDE + 2, x) << 7;
                let low = coder.code(
                    (&mut self.low, around | rest),
                    (&mut self.low_of_cells, around | usize::from(is_last) << 8),
                    usize::from(*mask & 15),
                );
                let around = low
                    | pair(rows, 2 * SIDE, x) << 4
                    | left(rows, 2 * SIDE + 1, x) << 6
                    | left(rows, 2 * SIDE + 2, x) << 7;
                let high = coder.code(
                    (&mut self.high, around | rest),
                    (&mut self.high_of_cells, around | usize::from(is_last) << 8),
                    usize::from(*mask >> 4),
                );
                let all = (low | high << 4) as u8;
                if all == 0 {
                    return Err(CodingError::EmptyNode);
                }
                *mask = all;
                coder.end_item();
                coder.check()?;
                for (row, cells) in [SIDE + 1, SIDE + 2, 2 * SIDE + 1, 2 * SIDE + 2].into_iter().zip([
                    low & 3,
                    low >> 2,
                    high & 3,
                    high >> 2,
                ]) {
                    rows[row] |= (cells as u64) << (2 * x);
                }
                if is_last {
                    voxels += all.count_ones() as usize;
                } else {
                    let mut left = all;
                    while left != 0 {
                        self.next.push(child_place(*place, left.trailing_zeros()));
                        left &= left - 1;
                    }
                }
            }
            std::mem::swap(&mut self.places, &mut self.next);
        }
        Ok(voxels)
    }
}

/// The two boxes of a row next to the node at x.
#[inline(always)]
fn pair(rows: &[u64; WINDOW], row: usize, x: usize) -> usize {
    (rows[row] >> (2 * x) & 3) as usize
}

/// The box of a row before the node at x.
#[inline(always)]
fn left(rows: &[u64; WINDOW], row: usize, x: usize) -> usize {
    (rows[row] << 1 >> (2 * x) & 1) as usize
}
