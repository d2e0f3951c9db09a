//! Numbers of octants, levels, boxes, nodes and voxels: one type each, so that a wrong mix does not compile.
//!
//! ```text
//! breadth-first:   box   0 1 2 ... N-1   N N+1 ...
//!                  node  0 1 2 ... N-1
//!                  voxel                 0  1  ...
//! ```
//!
//! Each is one plain integer and costs nothing. A number may lie out of range, because files may state any number:
//! views answer for every number (SPEC 7).
//!
//! ```
//! use infobyte::geom::{BoxIndex, NodeIndex, VoxelIndex};
//!
//! let nodes = 3;
//! assert_eq!(BoxIndex::new(4).voxel(nodes), VoxelIndex::new(1));
//! assert_eq!(BoxIndex::ROOT.node(), NodeIndex::ROOT);
//! ```
//!
//! A voxel is not a node, and an octant is not a number of a box:
//!
//! ```compile_fail
//! use infobyte::geom::VoxelIndex;
//! use infobyte::load::NodeView;
//!
//! fn mask(view: &impl NodeView) -> u8 {
//!     view.infobyte(VoxelIndex::new(1))
//! }
//! ```
//!
//! ```compile_fail
//! use infobyte::geom::{BoxIndex, NodeIndex, Octant};
//! use infobyte::load::NodeView;
//!
//! fn child(view: &impl NodeView) -> Option<BoxIndex> {
//!     view.child(Octant::ALL[1], NodeIndex::ROOT)
//! }
//! ```

/// One eighth of a box: `i = x + 2 y + 4 z`, each 0 for the low half and 1 for the high half (SPEC 2).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(transparent)]
pub struct Octant(u8);

impl Octant {
    /// All eight, in the order of an infobyte's bits.
    pub const ALL: [Self; 8] = [Self(0), Self(1), Self(2), Self(3), Self(4), Self(5), Self(6), Self(7)];

    /// The octant of this number; `None` from 8 on.
    #[inline]
    pub const fn new(number: u32) -> Option<Self> {
        if number < 8 { Some(Self::low_bits(number)) } else { None }
    }

    /// The octant of the three lowest bits, for instance of a Morton code.
    #[inline]
    pub(crate) const fn low_bits(bits: u32) -> Self {
        Self((bits & 7) as u8)
    }

    /// Number of the octant, 0..8.
    #[inline]
    pub const fn get(self) -> u32 {
        self.0 as u32
    }

    /// 1 for the high half along x, y, z, else 0.
    #[inline]
    pub const fn high(self) -> [u32; 3] {
        let bits = self.get();
        [bits & 1, bits >> 1 & 1, bits >> 2]
    }

    /// True if a node with this infobyte has a child here.
    #[inline]
    pub(crate) const fn is_in(self, infobyte: u8) -> bool {
        infobyte.wrapping_shr(self.get()) & 1 == 1
    }

    /// Number of children before this octant in a node with this infobyte.
    #[inline]
    pub(crate) const fn rank_in(self, infobyte: u8) -> u32 {
        (infobyte as u32 & 1_u32.wrapping_shl(self.get()).wrapping_sub(1)).count_ones()
    }
}

/// Depth of a box below the root: 0 for the root, L for voxels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(transparent)]
pub struct Level(u32);

impl Level {
    /// Level of the root.
    pub const ROOT: Self = Self(0);

    /// The level this many steps below the root.
    #[inline]
    pub const fn new(depth: u32) -> Self {
        Self(depth)
    }

    /// Steps below the root.
    #[inline]
    pub const fn get(self) -> u32 {
        self.0
    }

    /// The depth as an index into arrays.
    #[inline]
    pub(crate) const fn index(self) -> usize {
        self.0 as usize
    }
}

/// A type with `new`, `get` and the number's type, common to all three breadth-first numbers.
macro_rules! index {
    ($name:ident) => {
        impl $name {
            /// The item of this number.
            #[inline]
            pub const fn new(number: u64) -> Self {
                Self(number)
            }

            /// The number.
            #[inline]
            pub const fn get(self) -> u64 {
                self.0
            }

            /// The number as an index into memory; `None` where the machine cannot address that much.
            #[inline]
            pub fn index(self) -> Option<usize> {
                usize::try_from(self.0).ok()
            }
        }
    };
}

/// Breadth-first number of a box (SPEC 2): below N a node, from N on voxel `number - N`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(transparent)]
pub struct BoxIndex(u64);

/// Number of a node: its infobyte's place.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(transparent)]
pub struct NodeIndex(u64);

/// Number of a skin voxel in Morton order: the place of its attributes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(transparent)]
pub struct VoxelIndex(u64);

index!(BoxIndex);
index!(NodeIndex);
index!(VoxelIndex);

impl BoxIndex {
    /// The root: a node, or with L = 0 the one voxel.
    pub const ROOT: Self = Self(0);

    /// The box as a node, of any level.
    #[inline]
    pub const fn node(self) -> NodeIndex {
        NodeIndex(self.0)
    }

    /// The box as a voxel of a model with this many nodes. For a box that is a node, the result is a number that no
    /// voxel has.
    #[inline]
    pub const fn voxel(self, nodes: u64) -> VoxelIndex {
        VoxelIndex(self.0.wrapping_sub(nodes))
    }

    /// The box that many places after it. Wraps around: a file may state any number.
    #[inline]
    pub const fn after(self, boxes: u32) -> Self {
        Self(self.0.wrapping_add(boxes as u64))
    }
}

impl NodeIndex {
    /// The root.
    pub const ROOT: Self = Self(0);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_octant_has_its_bit_its_halves_and_its_rank() {
        for (number, octant) in (0..8).zip(Octant::ALL) {
            assert_eq!((Octant::new(number), octant.get()), (Some(octant), number));
            let [x, y, z] = octant.high();
            assert_eq!(x + 2 * y + 4 * z, number);
            for mask in 0..=u8::MAX {
                assert_eq!(octant.is_in(mask), (0..8).any(|bit| bit == number && mask >> bit & 1 == 1));
                let before = (0..number).filter(|bit| mask >> bit & 1 == 1).count();
                assert_eq!(octant.rank_in(mask) as usize, before);
            }
        }
        assert_eq!((Octant::new(8), Octant::low_bits(9)), (None, Octant::ALL[1]));
    }

    #[test]
    fn numbers_cost_nothing_and_wrong_ones_are_safe() {
        assert_eq!(size_of::<(Octant, BoxIndex)>(), size_of::<(u8, u64)>());
        assert_eq!(BoxIndex::new(2).voxel(3).get(), u64::MAX);
        assert_eq!(BoxIndex::new(u64::MAX).after(1), BoxIndex::ROOT);
    }
}
