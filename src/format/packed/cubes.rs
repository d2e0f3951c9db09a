//! Infobytes of cubes bit by bit, each in the contexts of all known boxes around it (SPEC 5.6, 5.9).
#![expect(clippy::cast_possible_truncation, reason = "small fields of windows are wanted")]

use super::bits::{BitCoder, BitDecoder, BitEncoder};
use super::group::{Group, GroupCoder, Place, child_place, coordinates};
use super::mixer::{KEY_BITS, Mixer};
use super::prior::{Prior, Sums};
use super::{CUBE_DEPTH, CodingError};
use crate::cpu::Lanes;

/// Rows along a side of a grid: 128 cells and a border of two.
const SIDE: usize = (1 << CUBE_DEPTH) + 4;
/// Bytes of a row, with one to spare: bytes are read in pairs.
const ROW: usize = SIDE / 8 + 2;

/// Bytes that span a node's children, the boxes around it, and the nodes around it.
const CHILDREN: usize = (SIDE + 1) * ROW + 1;
const BOXES: usize = (4 * SIDE + 5) * ROW;
const NODES: usize = (3 * SIDE + 4) * ROW;

/// Boxes of one depth of a cube: bit x + 2 of the row at (z + 2) * SIDE + y + 2 is set where a box exists.
#[derive(Debug)]
struct Grid(Vec<u8>);

impl Grid {
    fn new() -> Self {
        Self(vec![0; SIDE * SIDE * ROW])
    }

    /// Bytes from the row two before the row of a box on, and in it from the byte of the box two before on.
    #[inline(always)]
    fn around<const BYTES: usize>(&self, first: usize, x: usize) -> Option<&[u8; BYTES]> {
        self.0.get(first * ROW + x / 8..)?.first_chunk()
    }

    /// The boxes of a node's children, from the four rows that hold them.
    #[inline(always)]
    fn children(&self, place: Place) -> u8 {
        let (first, at) = first_child(place);
        let Some(rows) = self.0.get(first..).and_then(|rows| rows.first_chunk::<CHILDREN>()) else {
            return 0;
        };
        let two = |row: usize| rows[row * ROW] >> at & 3;
        two(0) | two(1) << 2 | two(SIDE) << 4 | two(SIDE + 1) << 6
    }

    /// Replaces the boxes of a node's children.
    #[inline(always)]
    fn set_children(&mut self, place: Place, mask: u8) {
        let (first, at) = first_child(place);
        let Some(rows) = self.0.get_mut(first..).and_then(|rows| rows.first_chunk_mut::<CHILDREN>()) else {
            return;
        };
        for (row, two) in [(0, mask), (1, mask >> 2), (SIDE, mask >> 4), (SIDE + 1, mask >> 6)] {
            rows[row * ROW] = rows[row * ROW] & !(3 << at) | (two & 3) << at;
        }
    }

    /// Replaces the byte of a node.
    #[inline(always)]
    fn set(&mut self, [x, y, z]: [usize; 3], byte: u8) {
        if let Some(place) = self.0.get_mut(row_of(y, z) * ROW + (x + 2) / 8) {
            *place = byte;
        }
    }
}

#[inline(always)]
fn row_of(y: usize, z: usize) -> usize {
    (z + 2) * SIDE + y + 2
}

/// Index of the byte of a node's first child, and its bit in the byte.
#[inline(always)]
fn first_child(place: Place) -> (usize, usize) {
    let [x, y, z] = coordinates(place).map(|c| 2 * c);
    (row_of(y, z) * ROW + (x + 2) / 8, (x + 2) % 8)
}

/// Six boxes of a row, from bit `at` of its first byte on, in the lowest bits.
#[inline(always)]
fn six(rows: &[u8], row: usize, at: usize) -> u64 {
    u64::from(u16::from_le_bytes([rows[row * ROW], rows[row * ROW + 1]]) >> (at % 8) & 63)
}

/// Codes the infobytes of groups.
#[derive(Debug)]
pub(crate) struct NodeCoder {
    mixer: Mixer,
    prior: &'static Prior,
    nodes: Grid,
    /// Boxes below the nodes; all set below a node that is not coded yet.
    boxes: Grid,
    /// The boxes to code, for an encoder.
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
    const VOXELS: usize = 1 << 18;
    const DEPTH: u32 = CUBE_DEPTH;

    #[inline(always)]
    fn encode(&mut self, isa: impl Lanes, group: &mut Group) -> Result<Vec<u8>, CodingError> {
        self.given.get_or_insert_with(Grid::new);
        let mut encoder = BitEncoder::new();
        self.code(isa, &mut encoder, group, |_| Ok(()))?;
        Ok(encoder.finish())
    }

    /// Takes the number of cubes from the group and appends to its levels.
    #[inline(always)]
    fn decode(&mut self, isa: impl Lanes, payload: &[u8], group: &mut Group) -> Result<(), CodingError> {
        let mut decoder = BitDecoder::new(payload)?;
        let result = self.code(isa, &mut decoder, group, BitDecoder::check).and_then(|()| decoder.finish());
        if result.is_err() {
            // Boxes of the damaged cube remain in the grids.
            (self.nodes, self.boxes) = (Grid::new(), Grid::new());
        }
        result
    }
}

/// The nodes of one depth of a cube.
#[derive(Clone, Copy)]
struct Depth {
    /// 0 for nodes of voxels, 1 for nodes directly above, 2 for others.
    class: usize,
    /// True if a node may be a larger leaf.
    has_leaves: bool,
}

impl NodeCoder {
    #[inline(always)]
    fn code<C: BitCoder>(
        &mut self,
        isa: impl Lanes,
        coder: &mut C,
        group: &mut Group,
        check: impl Fn(&C) -> Result<(), CodingError>,
    ) -> Result<(), CodingError> {
        self.mixer.restart();
        let mut begins = [0; CUBE_DEPTH as usize];
        (group.voxels, group.leaves) = (0, 0);
        for _ in 0..group.subtrees {
            // A group that continues after it is full could exceed memory.
            if group.voxels + group.leaves >= Self::VOXELS {
                return Err(CodingError::GROUP_SUBTREES);
            }
            self.code_cube(isa, coder, group, &mut begins)?;
            check(coder)?;
        }
        Ok(())
    }

    /// Codes one cube, whose infobytes begin at `begins` in the levels and, for a decoder, end with them.
    #[inline(always)]
    fn code_cube<C: BitCoder>(
        &mut self,
        isa: impl Lanes,
        coder: &mut C,
        group: &mut Group,
        begins: &mut [usize; CUBE_DEPTH as usize],
    ) -> Result<(), CodingError> {
        self.places.clear();
        self.places.push(0);
        self.nodes.set([0; 3], 1 << 2);
        let depths = group.levels.len();
        for (depth, (level, begin)) in group.levels.iter_mut().zip(begins).enumerate() {
            let count = self.places.len();
            if C::READS {
                level.resize(*begin + count, 0);
            }
            let masks = level.get_mut(*begin..).and_then(|left| left.get_mut(..count));
            let masks = masks.ok_or(CodingError::SUBTREE_NODES)?;
            *begin += count;
            let is_last = depth + 1 == depths;
            let at = Depth { class: (depths - 1 - depth).min(2), has_leaves: depth >= group.first_leaves };
            self.code_depth(isa, coder, masks, at);
            self.next.clear();
            for (place, mask) in self.places.iter().zip(masks) {
                if C::READS {
                    *mask = self.boxes.children(*place);
                }
                if *mask == 0 {
                    group.leaves += 1;
                }
                self.nodes.set(coordinates(*place), 0);
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
    fn code_depth<C: BitCoder>(&mut self, isa: impl Lanes, coder: &mut C, masks: &[u8], depth: Depth) {
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
                let row = row_of(y, z) * ROW;
                for byte in (low[0] + 2) / 8..=(high[0] + 2) / 8 {
                    let mut nodes = self.nodes.0.get(row + byte).copied().unwrap_or(0);
                    while nodes != 0 {
                        let x = 8 * byte + nodes.trailing_zeros() as usize - 2;
                        nodes &= nodes - 1;
                        self.code_node(isa, coder, [x, y, z], depth);
                    }
                }
            }
        }
    }

    #[inline(always)]
    fn code_node<C: BitCoder>(&mut self, isa: impl Lanes, coder: &mut C, at: [usize; 3], depth: Depth) {
        let place = at[0] as Place | (at[1] as Place) << 10 | (at[2] as Place) << 20;
        let given = match &mut self.given {
            Some(given) if !C::READS => given.children(place),
            _ => 0,
        };
        self.boxes.set_children(place, 0);
        let Some(around) = Around::new(&self.nodes, &self.boxes, at) else { return };
        let class = depth.class;
        let keys = around.keys(class);
        for (octant, keys) in keys.iter().enumerate().take(4) {
            self.mixer.fetch(with_own(keys, octant, 0));
        }
        let mut node = Node { keys, sums: self.prior.sums(around.inputs(class)), class, given, mask: 0 };
        // Octants as constants, so that shifts and table indices are known at compile time.
        self.code_octant(isa, coder, &mut node, 0);
        self.code_octant(isa, coder, &mut node, 1);
        self.code_octant(isa, coder, &mut node, 2);
        self.code_octant(isa, coder, &mut node, 3);
        self.code_octant(isa, coder, &mut node, 4);
        self.code_octant(isa, coder, &mut node, 5);
        self.code_octant(isa, coder, &mut node, 6);
        if node.mask == 0 && !depth.has_leaves {
            node.mask = 1 << 7;
        } else {
            self.code_octant(isa, coder, &mut node, 7);
        }
        self.boxes.set_children(place, node.mask);
    }

    #[inline(always)]
    fn code_octant<C: BitCoder>(&mut self, isa: impl Lanes, coder: &mut C, node: &mut Node, octant: usize) {
        let mask = usize::from(node.mask);
        if (1..5).contains(&octant) {
            // The next bits stay within a cache line.
            self.mixer.fetch(with_own(&node.keys[octant + 3], octant + 3, mask));
        }
        let keys = with_own(&node.keys[octant], octant, mask);
        let logit = self.prior.logit(isa, &node.sums, octant);
        let place = 3 * octant + node.class;
        let is_one = self.mixer.code(isa, coder, keys, place, logit, node.given >> octant & 1 == 1);
        node.mask |= u8::from(is_one) << octant;
        self.prior.note(&mut node.sums, octant, is_one);
    }
}

/// A node whose boxes are being coded.
struct Node {
    keys: [[usize; 3]; 8],
    sums: Sums,
    class: usize,
    /// The boxes to code, for an encoder.
    given: u8,
    /// Boxes that are coded.
    mask: u8,
}

/// Odd numbers whose products have well mixed high bits.
const FACTORS: [u64; 2] = [0x9e37_79b9_7f4a_7c15, 0xd6e8_feb8_6659_fd93];

/// Keys of an octant with the node's bits so far: the last three are lowest, so that the rest is known early.
#[inline(always)]
fn with_own(keys: &[usize; 3], octant: usize, own: usize) -> [usize; 3] {
    let early = octant.saturating_sub(3);
    let turned = |own: usize| own >> early | (own & ((1 << early) - 1)) << 3;
    // The box across a corner is not a near one.
    [
        keys[0] ^ turned(own & !(1 << (7 - octant))) << 8,
        keys[1] ^ turned(own) << 8,
        keys[2] ^ turned(own) << 8,
    ]
}

#[inline(always)]
fn hash(fields: u64, factor: u64) -> usize {
    (fields.wrapping_mul(factor) >> (64 - KEY_BITS)) as usize
}

/// The 26 boxes around the first of a window's 3 x 3 x 3, and the boxes among them across faces and edges.
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

/// Known boxes around a node, with its own boxes 0. Rows of boxes have six bits, from two before the node's first; rows
/// of nodes as well.
struct Around {
    /// Rows at z - 1, y - 2 to y + 3 (in boxes).
    below: [u64; 6],
    /// Rows at z - 2, y - 1 to y + 2.
    deep: [u64; 4],
    /// Rows at z and z + 1, y - 2 to y + 2.
    beside: [[u64; 5]; 2],
    /// Rows at z + 2, y - 1 to y + 2.
    above: [u64; 4],
    /// The node's row, rows at y + 1 and y + 2; at z + 1 and z + 2, rows y - 1 to y + 1.
    later: [u64; 9],
    /// The 27 nodes around and the node itself.
    nodes: u64,
}

impl Around {
    #[inline(always)]
    fn new(nodes: &Grid, boxes: &Grid, [x, y, z]: [usize; 3]) -> Option<Self> {
        // Rows are counted from z - 2 and y - 2.
        let boxes: &[u8; BOXES] = boxes.around(2 * z * SIDE + 2 * y, 2 * x)?;
        let row = |y: usize, z: usize| six(boxes, y + z * SIDE, 2 * x);
        let below = [row(0, 1), row(1, 1), row(2, 1), row(3, 1), row(4, 1), row(5, 1)];
        let deep = [row(1, 0), row(2, 0), row(3, 0), row(4, 0)];
        let beside = [2, 3].map(|z| [row(0, z), row(1, z), row(2, z), row(3, z), row(4, z)]);
        let above = [row(1, 4), row(2, 4), row(3, 4), row(4, 4)];
        // Rows are counted from z - 1 and y - 1.
        let nodes: &[u8; NODES] = nodes.around((z + 1) * SIDE + y + 1, x)?;
        let row = |y: usize, z: usize| six(nodes, y + z * SIDE, x);
        let later = [
            row(1, 1),
            row(2, 1),
            row(3, 1),
            row(0, 2),
            row(1, 2),
            row(2, 2),
            row(0, 3),
            row(1, 3),
            row(2, 3),
        ];
        let earlier = [row(0, 0), row(1, 0), row(2, 0), row(0, 1)];
        let rows = earlier.iter().chain(&later[..2]).chain(&later[3..6]);
        let nodes = rows.rev().fold(0, |all, row| all << 3 | row >> 1 & 7);
        Some(Self { below, deep, beside, above, later, nodes })
    }

    /// The 4 x 4 x 4 boxes around the node's own.
    #[inline(always)]
    fn window(&self) -> u64 {
        let [low, high] = &self.beside;
        let rows = self.below[1..5].iter().chain(&low[1..5]).chain(&high[1..5]).chain(&self.above);
        rows.rev().fold(0, |all, row| all << 4 | row >> 1 & 15)
    }

    /// Keys for the tables for each octant, with all of the node's own boxes clear.
    #[inline(always)]
    fn keys(&self, class: usize) -> [[usize; 3]; 8] {
        let window = self.window();
        let existing = hash(self.nodes | (class as u64) << 48, FACTORS[0]);
        std::array::from_fn(|octant| {
            let cells = window >> (octant % 2 + 4 * (octant / 2 % 2) + 16 * (octant / 4));
            let place = ((octant | class << 3) as u64) << 48;
            [
                hash(cells & NEAR | place, FACTORS[0]),
                hash(cells & ALL | place, FACTORS[1]),
                existing ^ octant << 15,
            ]
        })
    }

    /// The inputs of the prior (SPEC 5.9).
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

    /// Two cubes: a slab through the whole first one; in the second one voxel, or larger leaves beside it.
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
            let payload = coder.encode(Portable, &mut group).unwrap();
            assert_eq!((group.voxels, group.leaves), (16_385, usize::from(leaves)));
            for _ in 0..2 {
                let got = decode(&mut coder, &payload, &group).unwrap();
                assert_eq!(got.levels, group.levels);
                assert_eq!((got.voxels, got.leaves), (group.voxels, group.leaves));
                let cut = decode(&mut coder, &payload[..payload.len() - 4], &group);
                assert!(cut.is_err() || cut.is_ok_and(|cut| cut.levels != group.levels));
                assert!(decode(&mut coder, &[&payload[..], &[0; 4]].concat(), &group).is_err());
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
            let around = Around::new(&nodes, &boxes, at).unwrap();
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
