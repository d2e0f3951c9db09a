//! Occupancy of the boxes around a box, looked up in cached bricks of 4 x 4 x 4 boxes.
//!
//! Adjacent pixels need the same few bricks again and again; so one walk down the octree serves some hundred of them.
//! A box and its neighbours lie in eight bricks; the last eights are cached as blocks of 8 x 8 x 8 boxes. Memory: 20 KiB.

use super::{larger, smooth};
use crate::geom::{BoxIndex, NodeIndex, Octant};
use crate::load::{ModelView, NodeView};

use crate::cpu::Portable;
use crate::render::occupancy::spread_children;

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
}

impl WindowBrick {
    const NOWHERE: u64 = u64::MAX;
    const NONE: Self = Self { key: Self::NOWHERE, boxes: 0, first: 0 };

    fn of(boxes: u64, first: BoxIndex) -> Self {
        Self { key: Self::NOWHERE, boxes, first: first.get() }
    }
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
    /// The boxes of each brick in Morton order, and the number of its first box; bit 0 of the index for x.
    boxes: [(u64, u64); 8],
}

impl Block {
    const NONE: Self = Self { key: WindowBrick::NOWHERE, boxes: [(0, 0); 8] };
}

const KEPT_BLOCKS: usize = 64;

/// Looks up the boxes around a box.
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

    fn gather(&mut self, view: &ModelView<'_>, key: u64, [x, y, z]: [i64; 3]) -> Block {
        let mut block = Block { key, ..Block::NONE };
        for (number, boxes) in (0_i64..).zip(&mut block.boxes) {
            let brick = self.brick(view, [x + (number & 1), y + (number >> 1 & 1), z + (number >> 2)]);
            *boxes = (brick.boxes, brick.first);
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::{Dims, morton};
    use crate::memory_tree::MemoryTree;
    use crate::random::Random;

    /// The neighbours in small grids of every depth, in an order that goes back and forth.
    #[test]
    fn neighbours_are_what_the_boxes_are() {
        let mut random = Random(77);
        for side in [2_u32, 3, 4, 7, 8, 16, 33] {
            let dims = Dims::new(side, side, side).unwrap();
            let count = (side * side * side).div_ceil(3);
            let cells: std::collections::BTreeSet<[u32; 3]> =
                (0..count).map(|_| [0; 3].map(|_: u32| random.below(side))).collect();
            let tree = MemoryTree::of_cells(dims, cells.iter().copied());
            let levels = dims.depth();
            let mut around = Neighborhood::new();
            for _ in 0..600 {
                let cell = [0; 3].map(|_: u32| i64::from(random.below(1_u32 << levels)));
                let mut found = [None; 27];
                around.neighbours(&tree.view(), levels, cell, |slot, number| found[slot] = Some(number));
                for (slot, found) in (0_i64..).zip(found) {
                    let at = [cell[0] + slot % 3 - 1, cell[1] + slot / 3 % 3 - 1, cell[2] + slot / 9 - 1];
                    let number =
                        at.map(u32::try_from).into_iter().collect::<Result<Vec<_>, _>>().ok().and_then(
                            |at| {
                                let code = cells
                                    .contains(&[at[0], at[1], at[2]])
                                    .then(|| morton::encode(at[0], at[1], at[2]))?;
                                let place = tree.voxels().binary_search(&code).unwrap();
                                Some(tree.node_count() + place as u64)
                            },
                        );
                    assert_eq!(found, number, "{side}: {cell:?} slot {slot}");
                }
            }
        }
    }
}
