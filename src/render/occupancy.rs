//! Two levels of the octree at once: the 4 x 4 x 4 boxes within a node as 64 bits.
//!
//! The children of a node are consecutive, and so are all of their children. So one read at a node gives the infobytes
//! of its children as one 64-bit word; spread to the octants set in the node's own infobyte they are the occupancy of
//! its grandchildren in Morton order, and grandchild `v` has the number of the first plus the set bits below `v`.

use crate::geom::NodeIndex;
use crate::load::{ModelView, NodeView};

use crate::cpu::{Lanes, deposit, mirror_bits};

/// The pairs of axes (a, b), a < b, onto whose planes a box is projected.
pub(super) const PAIRS: [(usize, usize); 3] = [(0, 1), (0, 2), (1, 2)];

/// The 64 boxes two levels below a node, in the mirrored coordinates of a ray.
#[derive(Clone, Copy, Debug)]
pub(super) struct Brick {
    /// Bit v is set if box v, in mirrored Morton order, exists. Lowest first is front to back for the ray.
    pub(super) boxes: u64,
    /// The boxes in stored order.
    pub(super) stored: u64,
    /// Exclusive-or from the mirrored to the stored order.
    pub(super) flip: u32,
    /// Node whose first child is the first of the boxes.
    parent: NodeIndex,
    /// Boxes that are parts of larger leaves, eight each, in mirrored order; and the children of the node.
    pub(super) larger: u64,
    children: u8,
}

impl Brick {
    /// The grandchildren of `node`.
    #[inline(always)]
    pub(super) fn of<L: Lanes>(lanes: L, view: &ModelView<'_>, node: u64, mirror: u32) -> Self {
        let node = NodeIndex::new(node);
        let parent = view.first_child(node).node();
        let (children, infobytes) = (view.infobyte(node), view.infobytes(parent));
        let stored = spread_children(lanes, children, infobytes);
        let flip = mirror | mirror << 3;
        let mut larger = 0;
        if view.has_leaves() {
            larger = mirrored(spread_children(lanes, children, zero_bytes(infobytes)), flip);
        }
        Self { boxes: mirrored(stored, flip) | larger, stored, flip, parent, larger, children }
    }

    /// The children of the root as the lowest octant of a node above it, for grids of an odd depth.
    #[inline(always)]
    pub(super) fn above_root(view: &ModelView<'_>, mirror: u32) -> Self {
        let stored = u64::from(view.infobyte(NodeIndex::ROOT));
        let parent = NodeIndex::ROOT;
        Self { boxes: mirrored(stored, mirror), stored, flip: mirror, parent, larger: 0, children: 0 }
    }

    /// The top brick of a tree with this many levels, at least 1.
    #[inline(always)]
    pub(super) fn top<L: Lanes>(lanes: L, view: &ModelView<'_>, levels: u32, mirror: u32) -> Self {
        if levels.is_multiple_of(2) {
            Self::of(lanes, view, 0, mirror)
        } else {
            Self::above_root(view, mirror)
        }
    }

    /// Number of the first box.
    #[inline(always)]
    pub(super) fn first(&self, view: &ModelView<'_>) -> u64 {
        view.first_child(self.parent).get()
    }

    /// The larger leaf that box `v` is a part of, and the mask of all its boxes.
    #[inline]
    pub(super) fn leaf(&self, v: u32) -> (u64, u64) {
        let octant = (v ^ self.flip) >> 3 & 7;
        let before = self.children & 1_u8.wrapping_shl(octant).wrapping_sub(1);
        (self.parent.get().wrapping_add(u64::from(before.count_ones())), 0xff_u64.wrapping_shl(v & 56))
    }

    /// The first of the larger leaves in file order, their number, and in `places`, in that order, the lowest box of
    /// each in mirrored order.
    #[inline(always)]
    pub(super) fn leaves(&self, places: &mut [u8; 8]) -> (u64, usize) {
        let as_stored = mirrored(self.larger, self.flip);
        let (mut octants, mut count) = (as_stored & LOWEST, 0);
        let first = self.leaf(octants.trailing_zeros() & 63 ^ self.flip).0;
        while octants != 0 {
            let octant = octants.trailing_zeros();
            octants &= octants.wrapping_sub(1);
            places[count % 8] = ((octant ^ self.flip) & 56) as u8;
            count += 1;
        }
        (first, count)
    }

    /// `boxes` with the boxes of each larger leaf reduced to its lowest one.
    #[inline(always)]
    pub(super) fn leaf_by_leaf(&self, boxes: u64) -> u64 {
        let of_leaves = boxes & self.larger;
        boxes ^ of_leaves | (!zero_bytes(of_leaves) & LOWEST)
    }

    /// Mask, in stored order, of the boxes before box `v` of the mirrored order.
    #[inline(always)]
    pub(super) fn before(&self, v: u32) -> u64 {
        let below = 1_u64.wrapping_shl(v ^ self.flip).wrapping_sub(1);
        u64::from((self.stored & below).count_ones())
    }
}

/// The lowest box of each octant.
const LOWEST: u64 = 0x0101_0101_0101_0101;

/// 0xff for each byte that is 0, else 0.
#[inline(always)]
fn zero_bytes(word: u64) -> u64 {
    const LOW: u64 = 0x7f7f_7f7f_7f7f_7f7f;
    let not_zero = (((word & LOW) + LOW) | word) & !LOW;
    ((not_zero ^ !LOW) >> 7) * 0xff
}

/// Positions of four cells of a pair's plane in Morton order of space: `LOW` for the cells (a, b) in 0..2 squared,
/// `HIGH` for the quarters of the plane.
const LOW: [[u64; 4]; 3] = [[0, 1, 2, 3], [0, 1, 4, 5], [0, 2, 4, 6]];
const HIGH: [[u32; 4]; 3] = [[0, 8, 16, 24], [0, 8, 32, 40], [0, 16, 32, 48]];

/// Factor that repeats a plane's bits along the axis outside the pair.
const REPEAT: [u64; 3] =
    [(1 + (1 << 4)) * (1 + (1 << 32)), (1 + (1 << 2)) * (1 + (1 << 16)), (1 + (1 << 1)) * (1 + (1 << 8))];

/// The bits of 64 that a plane's sixteen come from: those at 0 along the other axis.
const PLANE: [u64; 3] = [plane_bits(0), plane_bits(1), plane_bits(2)];

const fn plane_bits(pair: usize) -> u64 {
    let (mut bits, mut cell) = (0, 0);
    while cell < 16 {
        bits |= 1 << (LOW[pair][cell % 4] + HIGH[pair][cell / 4] as u64);
        cell += 1;
    }
    bits
}

/// All sixteen values of four cells, spread.
const LOW_SPREAD: [[u64; 16]; 3] = {
    let mut spread = [[0; 16]; 3];
    let mut at = 0;
    while at < 3 * 16 * 4 {
        let (pair, value, cell) = (at / 64, at / 4 % 16, at % 4);
        spread[pair][value] |= (value as u64 >> cell & 1) << LOW[pair][cell];
        at += 1;
    }
    spread
};

/// Sixteen flags of a plane's cells, in Morton order over the pair's two axes, repeated along the third axis: 64 flags
/// in Morton order.
#[inline(always)]
pub(super) fn extrude(lanes: impl Lanes, pair: usize, plane: u32) -> u64 {
    let once = if let Some(avx2) = lanes.avx2() {
        deposit(avx2, plane.into(), PLANE[pair])
    } else {
        let spread = &LOW_SPREAD[pair];
        (0..4).fold(0, |all, q| all | spread[(plane >> (4 * q) & 15) as usize] << HIGH[pair][q])
    };
    once.wrapping_mul(REPEAT[pair])
}

/// Infobytes of a node's children, lowest byte first, spread to the octants set in `infobyte`.
#[inline(always)]
pub(super) fn spread_children(lanes: impl Lanes, infobyte: u8, children: u64) -> u64 {
    if let Some(avx2) = lanes.avx2() {
        return deposit(avx2, children, deposit(avx2, infobyte.into(), LOWEST).wrapping_mul(0xff));
    }
    let (mut spread, mut rest) = (0, children);
    for octant in 0..8 {
        if infobyte >> octant & 1 == 1 {
            spread |= (rest & 0xff) << (8 * octant);
            rest >>= 8;
        }
    }
    spread
}

/// Bits moved from position i to position `i ^ flip`.
#[inline(always)]
pub(super) fn mirrored(bits: u64, flip: u32) -> u64 {
    const KEEP: [u64; 6] = [
        0x5555_5555_5555_5555,
        0x3333_3333_3333_3333,
        0x0f0f_0f0f_0f0f_0f0f,
        0x00ff_00ff_00ff_00ff,
        0x0000_ffff_0000_ffff,
        0x0000_0000_ffff_ffff,
    ];
    let mut bits = bits;
    // A tile's rays all have the same mirror, so these branches are predictable.
    for (i, keep) in KEEP.into_iter().enumerate() {
        if flip >> i & 1 == 1 {
            bits = (bits & keep) << (1 << i) | (bits >> (1 << i)) & keep;
        }
    }
    bits
}

/// [`mirrored`] without branches, where the lanes support it: for rays with different mirrors.
#[inline(always)]
pub(super) fn mirrored_any(lanes: impl Lanes, bits: u64, flip: u32) -> u64 {
    lanes.avx2().map_or_else(|| mirrored(bits, flip), |avx2| mirror_bits(avx2, bits, flip))
}

/// Coordinates within a brick of box `v`.
#[inline(always)]
pub(super) fn place(v: u32) -> [u32; 3] {
    each3!(A => (v >> A & 1) | (v >> (A + 2) & 2))
}

/// Boxes of a brick whose coordinate along `axis` is not below `from` (0..=4).
#[inline(always)]
pub(super) fn at_least(axis: usize, from: u32) -> u64 {
    const FROM: [[u64; 5]; 3] = {
        let mut masks = [[0; 5]; 3];
        let mut at = 0;
        while at < 3 * 5 * 64 {
            let (axis, from, v) = (at / 320, at / 64 % 5, at % 64);
            if (v >> axis & 1) | (v >> (axis + 2) & 2) >= from {
                masks[axis][from] |= 1 << v;
            }
            at += 1;
        }
        masks
    };
    FROM[axis % 3][(from as usize).min(4)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cpu::{Form, Kernel, Portable};
    use crate::geom::Dims;
    use crate::geom::Octant;
    use crate::geom::morton;
    use crate::memory_tree::MemoryTree;

    #[test]
    fn mirroring_moves_every_bit() {
        for flip in 0..64 {
            for bit in 0..64_u32 {
                assert_eq!(mirrored(1 << bit, flip), 1 << (bit ^ flip));
            }
        }
    }

    #[test]
    fn a_brick_has_the_grandchildren_and_their_numbers() {
        let dims = Dims::new(8, 8, 8).unwrap();
        let codes: Vec<u64> = (0..90_u64).map(|i| i * i * 7 % 512).collect();
        let tree = MemoryTree::new(dims, &codes).unwrap();
        for mirror in 0..8 {
            let top = Brick::above_root(&tree.view(), mirror);
            for octant in 0..8_u32 {
                let node = tree.child(NodeIndex::ROOT, Octant::low_bits(octant));
                assert_eq!(top.boxes >> (octant ^ mirror) & 1 == 1, node.is_some());
                let Some(node) = node else { continue };
                assert_eq!(top.first(&tree.view()) + top.before(octant ^ mirror), node.get());
                let brick = Brick::of(Portable, &tree.view(), node.get(), mirror);
                for v in 0..64_u32 {
                    let number = tree
                        .child(node.node(), Octant::low_bits(v >> 3))
                        .and_then(|child| tree.child(child.node(), Octant::low_bits(v & 7)));
                    let seen = v ^ (mirror | mirror << 3);
                    assert_eq!(brick.boxes >> seen & 1 == 1, number.is_some());
                    if let Some(number) = number {
                        assert_eq!(brick.first(&tree.view()) + brick.before(seen), number.get());
                    }
                }
            }
        }
    }

    #[test]
    fn places_are_morton_codes() {
        for v in 0..64 {
            assert_eq!(place(v), morton::decode(u64::from(v)));
            for axis in 0..3 {
                for from in 0..5 {
                    assert_eq!(at_least(axis, from) >> v & 1 == 1, place(v)[axis] >= from);
                }
            }
        }
    }

    /// A plane of cells, children of a node, and a mirror.
    #[derive(Clone, Copy)]
    struct Moved(usize, u32, u64, u32);

    impl Kernel for Moved {
        type Output = [u64; 3];

        #[inline(always)]
        fn run(self, lanes: impl Lanes) -> [u64; 3] {
            let Self(pair, plane, bits, flip) = self;
            let spread = spread_children(lanes, plane.to_le_bytes()[0], bits);
            [extrude(lanes, pair, plane), spread, mirrored_any(lanes, bits, flip)]
        }
    }

    #[test]
    fn every_form_moves_bits_alike() {
        for i in 0..20_000_u32 {
            let (bits, flip) = (u64::from(i).wrapping_mul(0x9e37_79b9_7f4a_7c15), i / 64 % 64);
            let moved = Moved(i as usize % 3, i.wrapping_mul(0x9e37_79b9) >> 16, bits, flip);
            let portable = moved.run(Portable);
            Form::available().for_each(|form| assert_eq!(form.run(moved), portable, "{form:?} {i}"));
        }
    }

    #[test]
    fn a_plane_of_cells_is_repeated_along_the_third_axis() {
        for (pair, (a, b)) in PAIRS.into_iter().enumerate() {
            for bit in 0..16 {
                let plane = 1_u32 << bit;
                let of = |i: u32| (bit >> i & 1) | (bit >> (2 + i) & 1) << 1;
                let mut want = 0;
                for v in 0..64_u32 {
                    let at = |axis: usize| (v >> axis & 1) | (v >> (3 + axis) & 1) << 1;
                    if at(a) == of(0) && at(b) == of(1) {
                        want |= 1_u64 << v;
                    }
                }
                assert_eq!(extrude(Portable, pair, plane), want, "{pair} {bit}");
            }
            assert_eq!(extrude(Portable, pair, 0xffff), u64::MAX);
            assert_eq!(PLANE[pair].wrapping_mul(REPEAT[pair]), u64::MAX);
        }
    }
}
