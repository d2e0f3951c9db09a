//! The description of a cell (SPEC 4.8): a plane, or eight corners found by rank.
//!
//! A cell's own coordinates `u` run from -1 to 1 along each axis, 0 in its middle.

use super::normal;
use crate::geom::Octant;

/// Samples at the corners of a cell; corner i is the high one along x, y, z by the bits of i.
pub const CORNERS: usize = 8;

/// The offset of a cell that has corners instead of a plane.
pub(crate) const HAS_CORNERS: i8 = i8::MIN;

/// Cells per block of the directory of corners.
pub(crate) const CORNER_BLOCK: u64 = 512;

/// The least depth of larger leaves in a grid of this depth: an edge of 32 cells, but not the root.
pub(crate) const fn first_leaf_depth(depth: u32) -> u32 {
    if depth > 6 { depth - 5 } else { 1 }
}

/// Blocks of the directory of larger leaves for this many nodes.
pub(crate) const fn leaf_blocks(nodes: u64) -> u64 {
    corner_blocks(nodes)
}

/// [`CORNER_BLOCK`] as an index into memory.
const BLOCK: usize = 512;
const _: () = assert!(BLOCK as u64 == CORNER_BLOCK);

/// Blocks of the directory of corners for this many cells.
pub(crate) const fn corner_blocks(cells: u64) -> u64 {
    cells.div_ceil(CORNER_BLOCK)
}

/// Value of `normal . u` at a corner, for an L1-127 vector: -127..=127.
#[inline(always)]
pub fn at_corner(normal: [i32; 3], corner: usize) -> i32 {
    let signed = |a: usize| if corner >> a & 1 == 1 { normal[a] } else { -normal[a] };
    signed(0) + signed(1) + signed(2)
}

/// Patterns of corners that some plane separates: 104 of 256, the empty and the full one included.
pub(crate) const SEPARABLE: [bool; 256] = {
    // Integer weights of -2 to 2 suffice for every such pattern of three variables.
    let mut table = [false; 256];
    let mut weights = 0;
    while weights < 125 {
        let w = [weights % 5 - 2, weights / 5 % 5 - 2, weights / 25 - 2];
        // Odd limits, beyond twice the greatest value: doubled values are even, so no corner lies on a limit.
        let mut limit = -13;
        while limit <= 13 {
            let (mut mask, mut c) = (0, 0);
            while c < 8 {
                let value =
                    w[0] * (2 * (c & 1) - 1) + w[1] * (2 * (c >> 1 & 1) - 1) + w[2] * (2 * (c >> 2) - 1);
                if 2 * value < limit {
                    mask |= 1_usize << c;
                }
                c += 1;
            }
            table[mask] = true;
            limit += 2;
        }
        weights += 1;
    }
    table
};

/// The plane of a cell: points with `normal . u <= offset` are inside. The normal is of index space.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Plane {
    /// Outward normal, of L1 length 127.
    pub normal: [i32; 3],
    /// Offset, -127..=127; at 127 the whole cell is inside.
    pub offset: i32,
}

impl Plane {
    /// The plane of a normal code and an offset, which must not be `HAS_CORNERS`.
    #[inline(always)]
    pub fn new(code: u16, offset: i8) -> Self {
        Self { normal: normal::decode_l1(code), offset: i32::from(offset) }
    }

    /// The point of the plane nearest to the middle of the cell, clamped to the cell: from the middle, in edges.
    pub(crate) fn nearest_to_middle(self) -> [f64; 3] {
        let n = self.normal.map(f64::from);
        let square = n.iter().map(|c| c * c).sum::<f64>().max(1.0);
        n.map(|c| (c * f64::from(self.offset) / 2.0 / square).clamp(-0.5, 0.5))
    }

    /// Mask of the corners behind the plane.
    pub fn inside(&self) -> u8 {
        (0..CORNERS).filter(|c| at_corner(self.normal, *c) <= self.offset).fold(0, |bits, c| bits | 1 << c)
    }
}

/// The plane of a larger leaf (SPEC 4.9) in a part of its box: points with `normal . u <= offset` in the part's own
/// coordinates are inside. In integers: the middle of a part of a box E times as long lies at c / E, with integer c,
/// and the plane `N . u <= k` of the box is `N . u <= E k - N . c` there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct PlanePart {
    normal: [i32; 3],
    offset: i32,
}

impl PlanePart {
    /// The plane in the whole box.
    pub(crate) fn of(plane: Plane) -> Self {
        Self { normal: plane.normal, offset: plane.offset }
    }

    /// The plane in a cell of a box of `edge` cells, by the cell's position.
    pub(crate) fn cell(self, edge: u32, at: [u32; 3]) -> Self {
        let edge = edge.cast_signed();
        let [x, y, z] = at.map(|c| 2 * c.cast_signed() + 1 - edge);
        let along = self.normal[0] * x + self.normal[1] * y + self.normal[2] * z;
        Self { offset: edge * self.offset - along, ..self }
    }

    /// The plane in an octant.
    pub(crate) fn octant(self, octant: Octant) -> Self {
        self.cell(2, octant.high())
    }

    /// -127..127 where the plane passes through the part, more where the part lies behind it.
    pub(crate) fn offset(self) -> i32 {
        self.offset
    }

    /// True if the plane passes through the part.
    pub(crate) fn is_crossed(self) -> bool {
        (-127..127).contains(&self.offset)
    }
}

/// Builds a directory from bytes fed in order: of corners from offsets, or of larger leaves from infobytes.
pub(crate) struct CornerRankBuilder {
    /// The counted byte value.
    value: u8,
    cells: u64,
    with_corners: u64,
}

impl Default for CornerRankBuilder {
    fn default() -> Self {
        Self::of(HAS_CORNERS.cast_unsigned())
    }
}

impl CornerRankBuilder {
    /// A builder that counts bytes of this value.
    pub(crate) fn of(value: u8) -> Self {
        Self { value, cells: 0, with_corners: 0 }
    }

    /// Feeds the next offsets, and calls `on_block` with the number of cells with corners before every block.
    pub(crate) fn feed(&mut self, offsets: &[u8], mut on_block: impl FnMut(u64)) {
        let mut rest = offsets;
        while !rest.is_empty() {
            if self.cells.is_multiple_of(CORNER_BLOCK) {
                on_block(self.with_corners);
            }
            let room = BLOCK - usize::try_from(self.cells % CORNER_BLOCK).unwrap_or(0);
            let (now, later) = rest.split_at(room.min(rest.len()));
            self.with_corners += count(now, self.value);
            self.cells += now.len() as u64;
            rest = later;
        }
    }

    /// Number of cells with corners so far.
    pub(crate) fn with_corners(&self) -> u64 {
        self.with_corners
    }
}

/// Most cells that a byte counts, a multiple of the vector length.
const PART: usize = 128;

/// Number of bytes equal to `value`.
#[inline(always)]
fn count(offsets: &[u8], value: u8) -> u64 {
    // Counts in bytes as long as they do not overflow: one vector then counts many bytes at once.
    let of = |part: &[u8]| part.iter().fold(0_u8, |n, o| n.wrapping_add(u8::from(*o == value)));
    offsets.chunks(PART).map(|part| u64::from(of(part))).sum()
}

/// Number of a cell's corners, by the directory. Any bytes are safe: missing ones count 0.
#[inline]
pub(crate) fn corner_number(offsets: &[u8], directory: &[[u8; 8]], cell: usize) -> u64 {
    number_of(offsets, directory, cell, HAS_CORNERS.cast_unsigned())
}

/// Number of the larger leaf at a node, by the directory. Any bytes are safe.
#[inline(always)]
pub(crate) fn leaf_number(infobytes: &[u8], directory: &[[u8; 8]], node: usize) -> u64 {
    number_of(infobytes, directory, node, 0)
}

#[inline(always)]
fn number_of(bytes: &[u8], directory: &[[u8; 8]], at: usize, value: u8) -> u64 {
    let block = at / BLOCK;
    let base = directory.get(block).map_or(0, |b| u64::from_le_bytes(*b));
    base.wrapping_add(bytes.get(block * BLOCK..at).map_or(0, |part| count(part, value)))
}

#[cfg(test)]
#[expect(clippy::cast_possible_truncation, reason = "numbers made up for the test")]
mod tests {
    use super::*;

    #[test]
    fn patterns_that_a_plane_separates_are_counted_as_in_the_literature() {
        assert_eq!(SEPARABLE.iter().filter(|s| **s).count(), 104);
        assert!(SEPARABLE[0b1111_0000] && !SEPARABLE[0b1000_0001] && !SEPARABLE[0b0110_1001]);
    }

    #[test]
    fn corners_are_found_by_rank_whatever_the_feed_sizes() {
        let offsets: Vec<u8> =
            (0..3000_u32).map(|i| if i % 7 < 2 || i > 2600 { 0x80 } else { i as u8 & 0x7f }).collect();
        for feed in [1, 100, 512, 3000] {
            let (mut directory, mut builder) = (Vec::new(), CornerRankBuilder::default());
            for part in offsets.chunks(feed) {
                builder.feed(part, |b| directory.push(b.to_le_bytes()));
            }
            assert_eq!(directory.len() as u64, corner_blocks(3000));
            let mut before = 0;
            for (cell, offset) in offsets.iter().enumerate() {
                assert_eq!(corner_number(&offsets, &directory, cell), before);
                before += u64::from(*offset == 0x80);
            }
            assert_eq!(builder.with_corners(), before);
        }
        assert_eq!(corner_number(&offsets, &[], usize::MAX), 0);
    }

    #[test]
    fn a_plane_at_its_limits_holds_one_corner_or_all() {
        for code in [0x0000_u16, 0x007f, 0x7f00, 0x2a2a, 0x81d5] {
            let normal = normal::decode_l1(code);
            let values: Vec<i32> = (0..CORNERS).map(|c| at_corner(normal, c)).collect();
            assert_eq!((values.iter().min(), values.iter().max()), (Some(&-127), Some(&127)));
            assert_eq!(Plane { normal, offset: 127 }.inside(), 0xff);
            assert_ne!(Plane { normal, offset: -127 }.inside(), 0);
        }
    }
}
