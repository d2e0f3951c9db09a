//! The node view: all that a traversal may know of an octree.

/// Read-only octree in breadth-first numbers (SPEC 2). Box `b < node_count()` is a node, any other
/// box is voxel `b - node_count()`; the root is box 0.
///
/// Implementations are safe on any bytes: for a number out of range an infobyte is 0.
pub trait NodeView: Sync {
    /// Depth L; the grid has 2^L cells a side.
    fn depth(&self) -> u32;

    /// Number of nodes N.
    fn node_count(&self) -> u64;

    /// Number of skin voxels V.
    fn voxel_count(&self) -> u64;

    /// Infobyte of a node.
    fn infobyte(&self, node: u64) -> u8;

    /// Infobytes of the eight nodes from `node` on, the first in the lowest byte.
    #[inline]
    fn infobytes(&self, node: u64) -> u64 {
        (0..8).fold(0, |word, i| word | u64::from(self.infobyte(node.wrapping_add(i))) << (8 * i))
    }

    /// Box number of the first child of a node.
    fn first_child(&self, node: u64) -> u64;

    /// Box number of the child in `octant` (0..8), or `None` if that octant is air.
    #[inline]
    fn child(&self, node: u64, octant: u32) -> Option<u64> {
        let mask = self.infobyte(node);
        (mask >> octant & 1 == 1)
            .then(|| self.first_child(node) + u64::from((u32::from(mask) & ((1 << octant) - 1)).count_ones()))
    }

    /// Normal code of a voxel (SPEC 4.6), if the model has normals.
    fn voxel_normal(&self, voxel: u64) -> Option<u16>;

    /// Mean normal code of a node with an edge of 4 cells or more, if the model has them.
    fn node_normal(&self, node: u64) -> Option<u16>;
}
