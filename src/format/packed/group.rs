//! The subtrees of a group, one after the other (SPEC 5.2).
use super::tables::{Decoder, Encoder, SymbolCoder};
use super::{CodingError, SUBTREE_DEPTH};
use crate::cpu::Lanes;

/// Position of a node in its subtree: ten bits for each of x, y, z.
pub(super) type Place = u32;

/// The position of the child in an octant of the node at `place`.
#[inline(always)]
pub(super) fn child_place(place: Place, octant: u32) -> Place {
    place << 1 | (octant & 1) | (octant & 2) << 9 | (octant & 4) << 18
}

#[inline(always)]
pub(super) fn coordinates(place: Place) -> [usize; 3] {
    [0, 10, 20].map(|bits| (place >> bits & 1023) as usize)
}

/// A group: its subtrees one after the other, and the voxel data of its codec.
#[derive(Debug, Default)]
pub(crate) struct Group {
    /// Infobytes by depth, each subtree's in Morton order. Without any depth, each subtree is one voxel.
    pub levels: Vec<Vec<u8>>,
    /// Number of subtrees.
    pub subtrees: u32,
    /// Voxels of all subtrees.
    pub voxels: usize,
    /// Larger leaves of all subtrees.
    pub leaves: usize,
    /// The first of the levels that may have larger leaves.
    pub first_leaves: usize,
    /// Normals of the voxels.
    pub normals: Vec<u16>,
    /// Offsets of the voxels.
    pub offsets: Vec<u8>,
}

impl Group {
    /// Empties the group, for subtrees of `depth` levels of nodes, with larger leaves from level `first_leaves` on.
    pub(crate) fn clear(&mut self, depth: usize, first_leaves: usize) {
        self.levels.resize(depth, Vec::new());
        self.levels.iter_mut().for_each(Vec::clear);
        (self.subtrees, self.voxels, self.leaves) = (0, 0, 0);
        self.first_leaves = first_leaves;
        self.normals.clear();
        self.offsets.clear();
    }
}

/// A codec of groups. Its adaptive state is reset at each group.
pub(crate) trait GroupCoder: Default + Send {
    /// A group is full once it holds this many voxels and larger leaves: enough for the tables to learn.
    const VOXELS: usize;
    /// Most levels of nodes of a subtree.
    const DEPTH: u32;

    /// Encodes the payload of a group.
    ///
    /// # Errors
    /// The parts of the group do not belong together.
    fn encode(&mut self, isa: impl Lanes, group: &mut Group) -> Result<Vec<u8>, CodingError>;

    /// Decodes the codec's part of a group.
    ///
    /// # Errors
    /// The payload holds impossible values, or does not end with the group.
    fn decode(&mut self, isa: impl Lanes, payload: &[u8], group: &mut Group) -> Result<(), CodingError>;
}

/// A codec of groups by symbols.
pub(super) trait SymbolGroups: Default + Send {
    /// See [`GroupCoder::VOXELS`].
    const VOXELS: usize;

    /// Codes a group: an encoder reads all of it, a decoder fills in the codec's part.
    ///
    /// # Errors
    /// The decoder reads impossible values; the parts of the group do not belong together.
    fn code<C: SymbolCoder>(&mut self, coder: &mut C, group: &mut Group) -> Result<(), CodingError>;
}

impl<G: SymbolGroups> GroupCoder for G {
    const VOXELS: usize = G::VOXELS;
    const DEPTH: u32 = SUBTREE_DEPTH;

    #[inline(always)]
    fn encode(&mut self, isa: impl Lanes, group: &mut Group) -> Result<Vec<u8>, CodingError> {
        let mut encoder = Encoder::new(isa);
        self.code(&mut encoder, group)?;
        Ok(encoder.finish())
    }

    #[inline(always)]
    fn decode(&mut self, isa: impl Lanes, payload: &[u8], group: &mut Group) -> Result<(), CodingError> {
        let mut decoder = Decoder::new(isa, payload)?;
        self.code(&mut decoder, group)?;
        decoder.finish()
    }
}

/// Walks through a group's subtrees.
#[derive(Debug, Default)]
pub(super) struct Walk {
    passed: [usize; SUBTREE_DEPTH as usize],
    places: Vec<Place>,
    next: Vec<Place>,
}

impl Walk {
    /// Goes back to the first subtree.
    pub(super) fn restart(&mut self) {
        self.passed = Default::default();
    }

    /// The nodes of the next subtree whose children are voxels: positions and infobytes. For a subtree that is one
    /// voxel, a node with the voxel as its first child.
    pub(super) fn next_subtree<'a>(
        &'a mut self,
        levels: &'a [Vec<u8>],
    ) -> Result<(&'a [Place], &'a [u8]), CodingError> {
        self.places.clear();
        self.places.push(0);
        for (depth, (level, passed)) in levels.iter().zip(&mut self.passed).enumerate() {
            let masks = part(level, *passed, self.places.len())?;
            *passed += masks.len();
            if depth + 1 == levels.len() {
                return Ok((&self.places, masks));
            }
            self.next.clear();
            for (place, mask) in self.places.iter().zip(masks) {
                let mut left = *mask;
                while left != 0 {
                    self.next.push(child_place(*place, left.trailing_zeros()));
                    left &= left - 1;
                }
            }
            std::mem::swap(&mut self.places, &mut self.next);
        }
        Ok((&self.places, &[1]))
    }
}

fn part(level: &[u8], from: usize, count: usize) -> Result<&[u8], CodingError> {
    let left = level.get(from..).unwrap_or_default();
    left.get(..count).ok_or(CodingError::SUBTREE_NODES)
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// Subtrees of a slab each: all cells at the bottom.
    pub(in super::super) fn slab(subtrees: usize, depths: u32) -> Group {
        let levels = (0..depths).map(|depth| vec![0b1111; subtrees << (2 * depth)]).collect();
        let count = u32::try_from(subtrees).unwrap();
        Group { levels, subtrees: count, voxels: subtrees << (2 * depths), ..Group::default() }
    }

    #[test]
    fn a_walk_visits_the_nodes_above_the_voxels_and_refuses_levels_that_end_early() {
        let group = slab(2, 6);
        let mut walk = Walk::default();
        for _ in 0..2 {
            let (places, masks) = walk.next_subtree(&group.levels).unwrap();
            assert_eq!((places.len(), masks), (1024, &[15; 1024][..]));
            assert_eq!(coordinates(places[1023]), [31, 31, 0]);
            assert_eq!(coordinates(places[5]), [3, 0, 0]);
        }
        assert_eq!(walk.next_subtree(&group.levels).unwrap_err(), CodingError::SUBTREE_NODES);
    }
}
