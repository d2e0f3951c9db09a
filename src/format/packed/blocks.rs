//! The voxels of a group's subtrees in Morton order, each with a window on the coded voxels around it (SPEC 5.7).
#![expect(clippy::cast_possible_truncation, reason = "places of the grid fit 16 bits, steps 32")]

use super::CodingError;
use super::group::{Group, Place, Walk, coordinates};
pub(super) use super::lanes::Octet;
use super::tables::SymbolCoder;

/// Voxels along a side of a block, as a power of two: half a subtree's, so that the grid stays in a cache.
const BLOCK_BITS: u32 = 5;
/// The bits of a node's place above voxels that select the block.
const BLOCK: Place = 1 << 4 | 1 << 14 | 1 << 24;
/// Places along a side of the grid: a block and a border of two.
const ROW: usize = (1 << BLOCK_BITS) + 4;
const SLICE: usize = ROW * ROW;
const PLACES: usize = ROW * SLICE;
/// Place of a block's first voxel.
const FIRST: usize = 2 * (SLICE + ROW + 1);
/// Index of the voxel itself in its window, which extends two slices back and one slice and row forward.
pub(super) const SELF: usize = 2 * SLICE;
const WINDOW: usize = SELF + 1 + SLICE + ROW;

/// The surroundings of a voxel, which is at [`SELF`].
pub(super) type Window = [Octet; WINDOW];

/// A neighbour that can precede a voxel in Morton order: its index in the window and the step to it. (Three faces,
/// three edges and a corner always follow it.)
#[derive(Clone, Copy, Debug)]
pub(super) struct Neighbour {
    pub(super) at: usize,
    pub(super) away: [i32; 3],
}

const fn neighbours<const N: usize>(axes: i32) -> [Neighbour; N] {
    let mut all = [Neighbour { at: SELF, away: [0; 3] }; N];
    let (mut found, mut i) = (0, 0);
    while i < 27 {
        let [x, y, z]: [i32; 3] = [i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1];
        if x.abs() + y.abs() + z.abs() == axes && (x < 0 || y < 0 || z < 0) {
            let step = x + y * ROW as i32 + z * SLICE as i32;
            all[found] = Neighbour { at: SELF.wrapping_add_signed(step as isize), away: [x, y, z] };
            found += 1;
        }
        i += 1;
    }
    assert!(found == N);
    all
}

/// Neighbours across a face, an edge, a corner; each by z, y, x.
pub(super) const FACES: [Neighbour; 3] = neighbours(1);
/// See [`FACES`].
pub(super) const EDGES: [Neighbour; 9] = neighbours(2);
/// See [`FACES`].
pub(super) const CORNERS: [Neighbour; 7] = neighbours(3);

pub(super) trait VoxelCoder {
    /// Called before the first voxel of a subtree.
    fn begin_subtree(&mut self);

    /// Codes the voxel of this number in the group, and stores in the window the data that its neighbours will need.
    fn code_voxel<C: SymbolCoder>(
        &mut self,
        coder: &mut C,
        window: &mut Window,
        number: usize,
    ) -> Result<(), CodingError>;
}

/// A grid for one block after the other.
#[derive(Debug)]
pub(super) struct Blocks {
    grid: Vec<Octet>,
    /// The first places of nodes that have voxels in the grid.
    written: Vec<u16>,
    walk: Walk,
}

impl Default for Blocks {
    fn default() -> Self {
        const { assert!(PLACES <= 1 << 16) };
        Self { grid: vec![Octet::default(); PLACES], written: Vec::new(), walk: Walk::default() }
    }
}

impl Blocks {
    /// Codes all voxels of a group.
    ///
    /// # Errors
    /// The errors of the coder, or levels of the group that do not belong together.
    #[inline(always)]
    pub(super) fn code<C: SymbolCoder, V: VoxelCoder>(
        &mut self,
        coder: &mut C,
        group: &Group,
        voxels: &mut V,
    ) -> Result<(), CodingError> {
        self.walk.restart();
        let mut number = 0;
        for _ in 0..group.subtrees {
            let (places, masks) = self.walk.next_subtree(&group.levels)?;
            voxels.begin_subtree();
            let mut block = 0;
            for (place, mask) in places.iter().zip(masks) {
                let [x, y, z] = coordinates(*place);
                if place & BLOCK != block {
                    block = place & BLOCK;
                    clear(&mut self.grid, &mut self.written);
                }
                let within = |c: usize| 2 * c % (1 << BLOCK_BITS);
                let first = FIRST + within(z) * SLICE + within(y) * ROW + within(x);
                self.written.push(first as u16);
                let mut octants = *mask;
                while octants != 0 {
                    let octant = octants.trailing_zeros() as usize;
                    octants &= octants - 1;
                    let at = first + octant % 2 + octant / 2 % 2 * ROW + octant / 4 * SLICE;
                    let Some(window) = self.grid.get_mut(at - SELF..).and_then(|g| g.first_chunk_mut())
                    else {
                        return Err(CodingError::SUBTREE_TOO_DEEP);
                    };
                    let result = voxels.code_voxel(coder, window, number);
                    if result.is_err() {
                        clear(&mut self.grid, &mut self.written);
                        return result;
                    }
                    number += 1;
                    coder.end_item();
                }
                coder.check()?;
            }
            clear(&mut self.grid, &mut self.written);
        }
        Ok(())
    }
}

fn clear(grid: &mut [Octet], written: &mut Vec<u16>) {
    for first in written.drain(..) {
        for row in [0, ROW, SLICE, SLICE + ROW] {
            let at = usize::from(first) + row;
            if let Some(pair) = grid.get_mut(at..at + 2) {
                pair.fill(Octet::default());
            }
        }
    }
}
