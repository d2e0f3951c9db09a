//! Infobytes of cubes bit by bit, each in the contexts of all boxes around it that are known (SPEC 5.9, 5.12).
#![expect(clippy::cast_possible_truncation, reason = "small fields of windows are wanted")]

use super::bits::{BitCoder, BitDecoder, BitEncoder};
use super::group::{Group, GroupCoder, Place, child_place, coordinates, wrong_count};
use super::mixer::{KEY_BITS, Mixer};
use super::prior::Prior;
use super::{CUBE_DEPTH, CodingError};
use crate::cpu::Isa;

/// Rows along a side of a grid: 128 cells and a border of two.
const SIDE: usize = (1 << CUBE_DEPTH) + 4;
/// Bytes of a row; of its last bits two are read together.
const ROW: usize = SIDE / 8 + 2;

/// Boxes of one depth of a cube: bit x + 2 of the row at (z + 2) * SIDE + y + 2 says whether there is one.
#[derive(Debug)]
struct Grid(Vec<u8>);

impl Grid {
    fn new() -> Self {
        Self(vec![0; SIDE * SIDE * ROW])
    }

    /// The boxes of a row at x - 2 to x + 3, in the lowest bits.
    #[inline(always)]
    fn six(&self, row: usize, x: usize) -> u64 {
        let at = row * ROW + x / 8;
        let pair = self.0.get(at..).and_then(|bytes| bytes.first_chunk()).copied().unwrap_or_default();
        u64::from(u16::from_le_bytes(pair) >> (x % 8) & 63)
    }

    /// The byte with box x of a row, and its place there.
    #[inline(always)]
    fn bit(&mut self, row: usize, x: usize) -> (&mut u8, usize) {
        let len = self.0.len();
        (&mut self.0[(row * ROW + (x + 2) / 8) % len], (x + 2) % 8)
    }

    /// Takes the boxes of a node's children from the four rows that they are in.
    #[inline(always)]
    fn children(&mut self, place: Place) -> u8 {
        let (rows, x) = rows_of_children(place);
        rows.into_iter().rev().fold(0, |mask, row| {
            let (byte, at) = self.bit(row, x);
            mask << 2 | *byte >> at & 3
        })
    }

    /// Puts others in the place of the boxes of a node's children.
    #[inline(always)]
    fn set_children(&mut self, place: Place, mask: u8) {
        let (rows, x) = rows_of_children(place);
        for (i, row) in rows.into_iter().enumerate() {
            let (byte, at) = self.bit(row, x);
            *byte = *byte & !(3 << at) | (mask >> (2 * i) & 3) << at;
        }
    }
}

#[inline(always)]
fn row_of([_, y, z]: [usize; 3]) -> usize {
    (z + 2) * SIDE + y + 2
}

#[inline(always)]
fn rows_of_children(place: Place) -> ([usize; 4], usize) {
    let [x, y, z] = coordinates(place).map(|c| 2 * c);
    let row = row_of([x, y, z]);
    ([row, row + 1, row + SIDE, row + SIDE + 1], x)
}

/// Codes the infobytes of groups.
#[derive(Debug)]
pub(crate) struct NodeCoder {
    mixer: Mixer,
    prior: &'static Prior,
    nodes: Grid,
    /// Boxes below the nodes: of one that is not coded yet, all.
    boxes: Grid,
    /// What an encoder has to code.
    given: Option<Grid>,
    places: Vec<Place>,
    next: Vec<Place>,
}

impl Default for NodeCoder {
    fn default() -> Self {
        Self {
            mixer: Mixer::default(),
            prior: Prior::get(),
            nodes: Grid::new(),
            boxes: Grid::new(),
            given: None,
            places: Vec::new(),
            next: Vec::new(),
        }
    }
}

impl GroupCoder for NodeCoder {
    const VOXELS: usize = 1 << 19;
    const DEPTH: u32 = CUBE_DEPTH;

    #[inline(always)]
    fn encode(&mut self, group: &mut Group) -> Result<Vec<u8>, CodingError> {
        self.given.get_or_insert_with(Grid::new);
        let mut encoder = BitEncoder::new();
        self.code(&mut encoder, group, |_| Ok(()))?;
        Ok(encoder.finish())
    }

    /// Takes the number of cubes from the group and appends to its levels.
    #[inline(always)]
    fn decode(&mut self, _: impl Isa, payload: &[u8], group: &mut Group) -> Result<(), CodingError> {
        let mut decoder = BitDecoder::new(payload)?;
        let result = self.code(&mut decoder, group, BitDecoder::check).and_then(|()| decoder.finish());
        if result.is_err() {
            // Boxes of the cube that went wrong are left.
            (self.nodes, self.boxes) = (Grid::new(), Grid::new());
        }
        result
    }
}

/// The nodes of one depth of a cube.
#[derive(Clone, Copy)]
struct Depth {
    /// 0 for nodes of voxels, 1 for those above, 2 for others.
    class: usize,
    /// May a node be a larger leaf?
    has_leaves: bool,
}

impl NodeCoder {
    #[inline(always)]
    fn code<C: BitCoder>(
        &mut self,
        coder: &mut C,
        group: &mut Group,
        check: impl Fn(&C) -> Result<(), CodingError>,
    ) -> Result<(), CodingError> {
        self.mixer.restart();
        let mut begins = [0; CUBE_DEPTH as usize];
        (group.voxels, group.leaves) = (0, 0);
        for _ in 0..group.subtrees {
            // A group that goes on after it is full could be longer than memory.
            if group.voxels + group.leaves >= Self::VOXELS {
                return Err(CodingError::GroupSubtrees { subtrees: group.subtrees });
            }
            self.code_cube(coder, group, &mut begins)?;
            check(coder)?;
        }
        Ok(())
    }

    /// Codes one cube, whose infobytes begin at `begins` in the levels and, for a decoder, end with them.
    #[inline(always)]
    fn code_cube<C: BitCoder>(
        &mut self,
        coder: &mut C,
        group: &mut Group,
        begins: &mut [usize; CUBE_DEPTH as usize],
    ) -> Result<(), CodingError> {
        self.places.clear();
        self.places.push(0);
        let (byte, at) = self.nodes.bit(row_of([0; 3]), 0);
        *byte |= 1 << at;
        let depths = group.levels.len();
        for (depth, (level, begin)) in group.levels.iter_mut().zip(begins).enumerate() {
            let count = self.places.len();
            if C::READS {
                level.resize(*begin + count, 0);
            }
            let have = level.len().saturating_sub(*begin);
            let masks = level.get_mut(*begin..).and_then(|left| left.get_mut(..count));
            let masks = masks.ok_or_else(|| wrong_count(have, count))?;
            *begin += count;
            let is_last = depth + 1 == depths;
            let at = Depth { class: (depths - 1 - depth).min(2), has_leaves: depth >= group.first_leaves };
            self.code_depth(coder, masks, at);
            self.next.clear();
            for (place, mask) in self.places.iter().zip(masks) {
                if C::READS {
                    *mask = self.boxes.children(*place);
                }
                if *mask == 0 {
                    group.leaves += 1;
                }
                let at = coordinates(*place);
                *self.nodes.bit(row_of(at), at[0]).0 = 0;
                if is_last {
                    group.voxels += mask.count_ones() as usize;
                    self.boxes.set_children(*place, 0);
                } else {
                    let mut left = *mask;
                    while left != 0 {
                        self.next.push(child_place(*place, left.trailing_zeros()));
                        left &= left - 1;
                    }
                }
            }
            if !is_last {
                std::mem::swap(&mut self.nodes, &mut self.boxes);
                std::mem::swap(&mut self.places, &mut self.next);
            }
        }
        Ok(())
    }

    /// Codes the nodes at `places`, by z, y, x, into the grid of boxes.
    #[inline(always)]
    fn code_depth<C: BitCoder>(&mut self, coder: &mut C, masks: &[u8], depth: Depth) {
        let (mut low, mut high) = ([usize::MAX; 3], [0; 3]);
        for (place, mask) in self.places.iter().zip(masks) {
            self.boxes.set_children(*place, u8::MAX);
            if let (false, Some(given)) = (C::READS, &mut self.given) {
                given.set_children(*place, *mask);
            }
            let at = coordinates(*place);
            (low, high) = ([0, 1, 2].map(|i| at[i].min(low[i])), [0, 1, 2].map(|i| at[i].max(high[i])));
        }
        for z in low[2]..=high[2] {
            for y in low[1]..=high[1] {
                let row = row_of([0, y, z]) * ROW;
                for byte in (low[0] + 2) / 8..=(high[0] + 2) / 8 {
                    let mut nodes = self.nodes.0.get(row + byte).copied().unwrap_or(0);
                    while nodes != 0 {
                        let x = 8 * byte + nodes.trailing_zeros() as usize - 2;
                        nodes &= nodes - 1;
                        self.code_node(coder, [x, y, z], depth);
                    }
                }
            }
        }
    }

    #[inline(always)]
    fn code_node<C: BitCoder>(&mut self, coder: &mut C, at: [usize; 3], depth: Depth) {
        let place = at[0] as Place | (at[1] as Place) << 10 | (at[2] as Place) << 20;
        let given = match &mut self.given {
            Some(given) if !C::READS => given.children(place),
            _ => 0,
        };
        self.boxes.set_children(place, 0);
        let around = Around::new(&self.nodes, &self.boxes, at);
        let class = depth.class;
        let mut sums = self.prior.sums(around.inputs(class));
        let keys = around.keys(class);
        let existing = hash(around.nodes | (class as u64) << 48, FACTORS[0]);
        let mut mask = 0_u8;
        for (octant, [near, all]) in keys.into_iter().enumerate() {
            if octant == 7 && mask == 0 && !depth.has_leaves {
                mask = 1 << 7;
                break;
            }
            let own = usize::from(mask);
            // Across a corner is not near.
            let own = [own & !(1 << (7 - octant)), own, own | 1 << octant];
            let keys = [near ^ own[0] << 8, all ^ own[1] << 8, existing ^ own[2] << 8];
            let logit = self.prior.logit(&sums, octant);
            let place = 3 * octant + class;
            if self.mixer.code(coder, keys, place, logit, given >> octant & 1 == 1) {
                mask |= 1 << octant;
                self.prior.note(&mut sums, octant);
            }
        }
        self.boxes.set_children(place, mask);
    }
}

/// Odd numbers whose products have well mixed high bits.
const FACTORS: [u64; 2] = [0x9e37_79b9_7f4a_7c15, 0xd6e8_feb8_6659_fd93];

#[inline(always)]
fn hash(fields: u64, factor: u64) -> usize {
    (fields.wrapping_mul(factor) >> (64 - KEY_BITS)) as usize
}

/// The 26 boxes around the first of a window's 3 x 3 x 3, and those of them across faces and edges.
const ALL: u64 = {
    let (mut all, mut i) = (0, 0);
    while i < 27 {
        all |= 1 << (i % 3 + 4 * (i / 3 % 3) + 16 * (i / 9));
        i += 1;
    }
    all & !(1 << 21)
};
const NEAR: u64 = {
    let (mut near, mut i) = (ALL, 0);
    while i < 8 {
        near &= !(1 << (2 * (i % 2) + 8 * (i / 2 % 2) + 32 * (i / 4)));
        i += 1;
    }
    near
};

/// What is known around a node, its own boxes 0. Rows of boxes are six, from two before its first; rows of nodes, too.
struct Around {
    /// At z - 1, y - 2 to y + 3 (in boxes).
    below: [u64; 6],
    /// At z - 2, y - 1 to y + 2.
    deep: [u64; 4],
    /// At z and z + 1, y - 2 to y + 2.
    beside: [[u64; 5]; 2],
    /// At z + 2, y - 1 to y + 2.
    above: [u64; 4],
    /// The node's row, those at y + 1 and y + 2; at z + 1 and z + 2, y - 1 to y + 1.
    later: [u64; 9],
    /// The 27 nodes around and the node itself.
    nodes: u64,
}

impl Around {
    #[inline(always)]
    fn new(nodes: &Grid, boxes: &Grid, [x, y, z]: [usize; 3]) -> Self {
        let first = row_of([0, 2 * y, 2 * z]);
        // The rows before the first are in the border.
        let row = |dy: usize, dz: usize| boxes.six(first + dy + dz * SIDE - 2 * SIDE - 2, 2 * x);
        let below = std::array::from_fn(|i| row(i, 1));
        let deep = std::array::from_fn(|i| row(i + 1, 0));
        let beside = [2, 3].map(|z| std::array::from_fn(|i| row(i, z)));
        let above = std::array::from_fn(|i| row(i + 1, 4));
        let first = row_of([0, y, z]);
        let row = |dy: usize, dz: usize| nodes.six(first + dy + dz * SIDE - SIDE - 1, x);
        let later =
            [[1, 1], [2, 1], [3, 1], [0, 2], [1, 2], [2, 2], [0, 3], [1, 3], [2, 3]].map(|[y, z]| row(y, z));
        let earlier = [[0, 0], [1, 0], [2, 0], [0, 1]].map(|[y, z]| row(y, z));
        let rows = earlier.iter().chain(&later[..2]).chain(&later[3..6]);
        let nodes = rows.rev().fold(0, |all, row| all << 3 | row >> 1 & 7);
        Self { below, deep, beside, above, later, nodes }
    }

    /// The 4 x 4 x 4 boxes around the node's own.
    #[inline(always)]
    fn window(&self) -> u64 {
        let [low, high] = &self.beside;
        let rows = self.below[1..5].iter().chain(&low[1..5]).chain(&high[1..5]).chain(&self.above);
        rows.rev().fold(0, |all, row| all << 4 | row >> 1 & 15)
    }

    /// Keys for the first and the second table for each octant, none of the node's own boxes being there.
    #[inline(always)]
    fn keys(&self, class: usize) -> [[usize; 2]; 8] {
        let window = self.window();
        std::array::from_fn(|octant| {
            let cells = window >> (octant % 2 + 4 * (octant / 2 % 2) + 16 * (octant / 4));
            let place = ((octant | class << 3) as u64) << 48;
            [hash(cells & NEAR | place, FACTORS[0]), hash(cells & ALL | place, FACTORS[1])]
        })
    }

    /// The inputs of the prior (SPEC 5.12).
    #[inline(always)]
    fn inputs(&self, class: usize) -> [u64; 2] {
        let (middle, pair) = (|row: u64| row >> 1 & 15, |row: u64| row & 3);
        let (five, three) = (|row: u64| row & 31, |row: u64| row >> 1 & 7);
        let ([low, high], later) = (&self.beside, &self.later);
        let rows = |rows: &[u64], bits: u32| rows.iter().rev().fold(0, |all, row| all << bits | row);
        let first =
            rows(&self.below, 6) | rows(&self.deep.map(middle), 4) << 36 | low[1] << 52 | high[1] << 58;
        let second = rows(&[low[0], high[0]].map(middle), 4)
            | rows(&[low[2], low[3], high[2], high[3]].map(pair), 2) << 8
            | (later[0] >> 3 & 3) << 16
            | five(later[1]) << 18
            | three(later[2]) << 23
            | rows(&[later[3], later[4], later[5]].map(five), 5) << 26
            | (later[6] >> 2 & 1) << 41
            | three(later[7]) << 42
            | (later[8] >> 2 & 1) << 45
            | u64::from(class == 0) << 46
            | u64::from(class == 1) << 47;
        [first, second]
    }
}

#[cfg(test)]
mod tests {
    use super::super::group::tests::slab;
    use super::*;
    use crate::cpu::Portable;

    fn decode(coder: &mut NodeCoder, payload: &[u8], like: &Group) -> Result<Group, CodingError> {
        let mut got = Group { subtrees: like.subtrees, first_leaves: like.first_leaves, ..Group::default() };
        got.levels.resize(like.levels.len(), Vec::new());
        coder.decode(Portable, payload, &mut got).map(|()| got)
    }

    /// Two cubes: a slab through all of the first; of the second one voxel, or larger leaves beside it.
    fn cubes(leaves: bool) -> Group {
        let mut group = slab(1, 7);
        for (depth, level) in group.levels.iter_mut().enumerate() {
            level.push(if leaves && depth == 3 { 0b1000_0001 } else { 0b1000_0000 });
            if leaves && depth == 4 {
                level.push(0);
            }
        }
        (group.subtrees, group.voxels) = (2, group.voxels + 1);
        (group.first_leaves, group.leaves) = if leaves { (4, 1) } else { (usize::MAX, 0) };
        if leaves {
            // The leaf comes first in Morton order.
            let len = group.levels[4].len();
            group.levels[4].swap(len - 1, len - 2);
        }
        group
    }

    #[test]
    fn infobytes_come_back_with_and_without_larger_leaves_also_after_an_error() {
        let mut coder = NodeCoder::default();
        for leaves in [false, true, false] {
            let mut group = cubes(leaves);
            let payload = coder.encode(&mut group).unwrap();
            assert_eq!((group.voxels, group.leaves), (16_385, usize::from(leaves)));
            for _ in 0..2 {
                let got = decode(&mut coder, &payload, &group).unwrap();
                assert_eq!(got.levels, group.levels);
                assert_eq!((got.voxels, got.leaves), (group.voxels, group.leaves));
                assert!(decode(&mut coder, &payload[..payload.len() - 4], &group).is_err());
            }
        }
    }

    #[test]
    fn windows_are_the_boxes_around() {
        let (mut nodes, mut boxes) = (Grid::new(), Grid::new());
        let mut state = 1_u64;
        for byte in nodes.0.iter_mut().chain(&mut boxes.0) {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            *byte = (state >> 56) as u8;
        }
        let has = |grid: &Grid, [x, y, z]: [i32; 3]| {
            let row = ((z + 2) as usize * SIDE + (y + 2) as usize) * ROW;
            u64::from(grid.0[row + (x + 2) as usize / 8] >> ((x + 2) % 8) & 1)
        };
        for at in [[0, 0, 0], [63, 63, 63], [1, 5, 62], [30, 0, 7]] {
            let around = Around::new(&nodes, &boxes, at);
            let [x, y, z] = at.map(|c| c as i32);
            let window = (0..64).fold(0, |all, i| {
                all | has(&boxes, [2 * x + i % 4 - 1, 2 * y + i / 4 % 4 - 1, 2 * z + i / 16 - 1]) << i
            });
            assert_eq!(around.window(), window);
            let near = (0..27)
                .fold(0, |all, i| all | has(&nodes, [x + i % 3 - 1, y + i / 3 % 3 - 1, z + i / 9 - 1]) << i);
            assert_eq!(around.nodes, near);
        }
    }
}
