//! Occupancy of the boxes around a box, looked up in cached bricks of 4 x 4 x 4 boxes.
//!
//! Adjacent pixels need the same few bricks again and again; so one walk down the octree serves some hundred of them.
//! Every window lies in eight bricks; those of the last windows are cached as blocks of 8 x 8 x 8 boxes. Memory: 26
//! KiB. Cost: some 10 ns where the block is cached, 40 where only its bricks are.

use super::{larger, smooth};
use crate::geom::{BoxIndex, NodeIndex, Octant};
use crate::load::{ModelView, NodeView};

use crate::cpu::Portable;
use crate::render::occupancy::{place, spread_children};

/// Reach of a window in boxes, and the boxes along its side.
pub(super) const REACH: i64 = 2;
pub(super) const SIDE: u32 = 5;

/// Cached bricks: the needs of a tile of pixels several times over.
const KEPT: usize = 256;

/// Deepest octree (SPEC 4.1).
const MAX_LEVELS: usize = 16;

/// A brick of 4 x 4 x 4 boxes.
#[derive(Clone, Copy)]
struct WindowBrick {
    /// Key of its position, or [`WindowBrick::NOWHERE`].
    key: u64,
    /// Its boxes in Morton order, and the number of the first.
    boxes: u64,
    first: u64,
    /// The same boxes, rows along x eight bits apart: bit `x + 8 y + 32 z`.
    rows: u128,
}

impl WindowBrick {
    const NOWHERE: u64 = u64::MAX;
    const NONE: Self = Self { key: Self::NOWHERE, boxes: 0, first: 0, rows: 0 };
}

/// The path down to the brick that was looked up last.
struct Descent {
    /// Coordinates of the brick, in bricks.
    to: [u32; 3],
    /// Nodes from the root on, and their number.
    nodes: [NodeIndex; MAX_LEVELS + 1],
    known: u32,
}

/// A block of 8 x 8 x 8 boxes: eight bricks.
#[derive(Clone, Copy)]
struct Block {
    /// Key of the lowest brick's position, or [`WindowBrick::NOWHERE`].
    key: u64,
    /// Layers along z, rows along x eight bits apart.
    layers: [u64; 8],
    /// The boxes of each brick in Morton order, and the number of its first box; bit 0 of the index for x.
    boxes: [(u64, u64); 8],
}

impl Block {
    const NONE: Self = Self { key: WindowBrick::NOWHERE, layers: [0; 8], boxes: [(0, 0); 8] };
}

const KEPT_BLOCKS: usize = 64;

/// Looks up windows of 5 x 5 x 5 boxes.
pub(crate) struct Neighborhood {
    bricks: Vec<WindowBrick>,
    blocks: [Block; KEPT_BLOCKS],
    way: Descent,
    /// Levels of the cached grid.
    levels: u32,
    /// Results found by windows.
    pub(super) smooth: smooth::Neighbourhoods,
    pub(super) larger: larger::BoxNormals,
}

impl Neighborhood {
    pub(crate) fn new() -> Self {
        let way = Descent { to: [0; 3], nodes: [NodeIndex::ROOT; MAX_LEVELS + 1], known: 1 };
        Self {
            bricks: vec![WindowBrick::NONE; KEPT],
            blocks: [Block::NONE; KEPT_BLOCKS],
            way,
            levels: u32::MAX,
            smooth: smooth::Neighbourhoods::default(),
            larger: larger::BoxNormals::default(),
        }
    }

    /// The boxes within [`REACH`] of `cell`, in a grid of 2^levels boxes a side, as bits `x + 5 y + 25 z`; and the
    /// number of the middle box, if it exists.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few bits")]
    pub(super) fn window(
        &mut self,
        view: &ModelView<'_>,
        levels: u32,
        cell: [i64; 3],
    ) -> (u128, Option<u64>) {
        if self.levels != levels {
            *self = Self { levels, ..Self::new() };
        }
        let low = [cell[0] - REACH, cell[1] - REACH, cell[2] - REACH];
        let block = self.block(view, [low[0] >> 2, low[1] >> 2, low[2] >> 2]);
        let [shift, from_y, from_z] = [low[0] & 3, low[1] & 3, low[2] & 3];
        let mut found = 0_u128;
        for z in 0..SIDE as usize {
            // Five rows of five, each at the low end of its byte; then side by side.
            let rows = block.layers[(from_z as usize + z) & 7] >> (8 * from_y + shift) & WINDOW_ROWS;
            let pairs = rows & 0x1f | rows >> 3 & 0x3e0;
            let next = rows >> 6 & 0x7c00 | rows >> 9 & 0xf_8000 | rows >> 12 & 0x1f0_0000;
            found |= u128::from(pairs | next) << (25 * z);
        }
        // The middle is in one of the eight bricks.
        let brick = (0..3).fold(0, |brick, a| brick | (((cell[a] >> 2) - (low[a] >> 2)) & 1) << a) as usize;
        let (boxes, first) = block.boxes[brick & 7];
        let at = (0..3).fold(0, |at, a| at | (cell[a] & 1) << a | (cell[a] & 2) << (a + 2));
        let there = boxes >> at & 1 == 1;
        let before = boxes & (1_u64 << at).wrapping_sub(1);
        (found, there.then(|| first.wrapping_add(u64::from(before.count_ones()))))
    }

    /// The box at `cell` and its neighbours, in a grid of 2^levels boxes a side: `x + 3 y + 9 z` and the number of each
    /// box that exists.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few bits")]
    pub(super) fn neighbours(
        &mut self,
        view: &ModelView<'_>,
        levels: u32,
        cell: [i64; 3],
        mut each: impl FnMut(usize, u64),
    ) {
        if self.levels != levels {
            *self = Self { levels, ..Self::new() };
        }
        let low = cell.map(|c| c - 1);
        let block = self.block(view, low.map(|c| c >> 2));
        for (slot, offset) in (0..27_i64).enumerate() {
            let at = [low[0] + offset % 3, low[1] + offset / 3 % 3, low[2] + offset / 9];
            let brick = (0..3).fold(0, |brick, a| brick | (((at[a] >> 2) - (low[a] >> 2)) & 1) << a) as usize;
            let (boxes, first) = block.boxes[brick & 7];
            let place = (0..3).fold(0, |place, a| place | (at[a] & 1) << a | (at[a] & 2) << (a + 2));
            if boxes >> place & 1 == 1 {
                let before = boxes & (1_u64 << place).wrapping_sub(1);
                each(slot, first.wrapping_add(u64::from(before.count_ones())));
            }
        }
    }

    /// The eight bricks from these coordinates on.
    #[inline]
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few bits")]
    fn block(&mut self, view: &ModelView<'_>, at: [i64; 3]) -> &Block {
        // Coordinates start at -1, one below the grid.
        let [x, y, z] =
            [(at[0] + 1) as u64 & 0xffff, (at[1] + 1) as u64 & 0xffff, (at[2] + 1) as u64 & 0xffff];
        let key = x | y << 16 | z << 32;
        let slot = (x & 3 | (y & 3) << 2 | (z & 3) << 4) as usize % KEPT_BLOCKS;
        if self.blocks[slot].key != key {
            self.blocks[slot] = self.gather(view, key, at);
        }
        &self.blocks[slot]
    }

    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "bits of a layer")]
    fn gather(&mut self, view: &ModelView<'_>, key: u64, [x, y, z]: [i64; 3]) -> Block {
        let mut block = Block { key, ..Block::NONE };
        for (number, boxes) in (0_i64..).zip(&mut block.boxes) {
            let [i, j, k] = [number & 1, number >> 1 & 1, number >> 2];
            let brick = self.brick(view, [x + i, y + j, z + k]);
            *boxes = (brick.boxes, brick.first);
            for z in 0..4 {
                let layer = (brick.rows >> (32 * z)) as u64 & 0x0f0f_0f0f;
                block.layers[(z + 4 * k) as usize & 7] |= layer << (4 * i + 32 * j);
            }
        }
        block
    }

    /// The brick at these coordinates; empty outside the grid.
    #[inline]
    fn brick(&mut self, view: &ModelView<'_>, at: [i64; 3]) -> WindowBrick {
        let side = 1_i64 << self.levels.saturating_sub(2);
        if at.iter().any(|c| !(0..side).contains(c)) {
            return WindowBrick::NONE;
        }
        #[expect(clippy::cast_sign_loss, clippy::cast_possible_truncation, reason = "within the grid")]
        let at = [at[0] as u32, at[1] as u32, at[2] as u32];
        let key = u64::from(at[0]) | u64::from(at[1]) << 16 | u64::from(at[2]) << 32;
        // Neighbours along every axis have different slots.
        let slot = (at[0] & 7 | (at[1] & 7) << 3 | (at[2] & 3) << 6) as usize % KEPT;
        match self.bricks.get(slot) {
            Some(brick) if brick.key == key => *brick,
            _ => {
                let brick = WindowBrick { key, ..self.fetch(view, at) };
                if let Some(kept) = self.bricks.get_mut(slot) {
                    *kept = brick;
                }
                brick
            }
        }
    }

    /// Walks down to a brick.
    fn fetch(&mut self, view: &ModelView<'_>, at: [u32; 3]) -> WindowBrick {
        let Some(steps) = self.levels.checked_sub(2) else {
            // The children of the root, as the lowest octant of a brick.
            let infobyte = view.infobyte(NodeIndex::ROOT);
            return WindowBrick::of(u64::from(infobyte), view.first_child(NodeIndex::ROOT));
        };
        let way = &mut self.way;
        let apart = (0..3).fold(0, |apart, a| apart | at[a] ^ way.to[a]);
        let shared = steps.saturating_sub(u32::BITS - apart.leading_zeros());
        way.known = way.known.min(shared + 1).max(1);
        way.to = at;
        while way.known <= steps {
            let down = steps - way.known;
            let octant = (0..3).fold(0, |octant, a| octant | (at[a] >> down & 1) << a);
            let node = way.nodes[way.known as usize - 1];
            let Some(child) = view.child(node, Octant::low_bits(octant)) else { return WindowBrick::NONE };
            way.nodes[way.known as usize] = child.node();
            way.known += 1;
        }
        let node = way.nodes[steps as usize];
        let parent = view.first_child(node).node();
        let boxes = spread_children(Portable, view.infobyte(node), view.infobytes(parent));
        WindowBrick::of(boxes, view.first_child(parent))
    }
}

impl WindowBrick {
    fn of(boxes: u64, first: BoxIndex) -> Self {
        let (mut rows, mut rest) = (0, boxes);
        while rest != 0 {
            let [x, y, z] = place(rest.trailing_zeros());
            rows |= 1 << (x + 8 * y + 32 * z);
            rest &= rest - 1;
        }
        Self { key: Self::NOWHERE, boxes, first: first.get(), rows }
    }
}

/// Five bits of each of five rows.
const WINDOW_ROWS: u64 = 0x1f_1f1f_1f1f;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::{Dims, morton};
    use crate::memory_tree::MemoryTree;
    use crate::random::Random;

    /// Every window of small grids of every depth, in an order that goes back and forth.
    #[test]
    fn windows_are_what_the_boxes_are() {
        let mut random = Random(77);
        for side in [1_u32, 2, 3, 4, 7, 8, 16, 33] {
            let dims = Dims::new(side, side, side).unwrap();
            let count = (side * side * side).div_ceil(3);
            let cells: std::collections::BTreeSet<[u32; 3]> =
                (0..count).map(|_| [0; 3].map(|_: u32| random.below(side))).collect();
            let tree = MemoryTree::of_cells(dims, cells.iter().copied());
            let levels = dims.depth();
            if levels == 0 {
                continue;
            }
            let mut around = Neighborhood::new();
            for _ in 0..600 {
                let cell = [0; 3].map(|_: u32| i64::from(random.below(1_u32 << levels)));
                let (found, number) = around.window(&tree.view(), levels, cell);
                for bit in 0..125_u32 {
                    let offset = [bit % 5, bit / 5 % 5, bit / 25];
                    let at: [i64; 3] = std::array::from_fn(|a| cell[a] - REACH + i64::from(offset[a]));
                    let there = u32::try_from(at[0]).is_ok_and(|x| {
                        let rest = [at[1], at[2]].map(|c| u32::try_from(c).unwrap_or(u32::MAX));
                        cells.contains(&[x, rest[0], rest[1]])
                    });
                    assert_eq!(found >> bit & 1 == 1, there, "{side}: {cell:?} bit {bit}");
                }
                let [x, y, z] = cell.map(|c| u32::try_from(c).unwrap());
                let code = morton::encode(x, y, z);
                let at = tree.voxels().binary_search(&code).ok().map(|at| tree.node_count() + at as u64);
                assert_eq!(number, at, "{side}: {cell:?}");
            }
        }
    }
}
