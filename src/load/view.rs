//! The node view: the interface of an octree for the plain walk, which is the oracle of every traversal.

use super::CellItems;
use crate::format::normal;
use crate::geom::{BoxIndex, NodeIndex, Octant, VoxelIndex};

/// Read-only octree in breadth-first numbers (SPEC 2). A [`BoxIndex`] below `node_count()` is a node, any other a
/// voxel; [`BoxIndex::node`] and [`BoxIndex::voxel`] convert the number.
///
/// Implementations are safe on any bytes: the infobyte of a number out of range is 0.
pub trait NodeView: Sync {
    /// Depth L; the grid has 2^L cells a side.
    fn depth(&self) -> u32;

    /// Number of nodes N.
    fn node_count(&self) -> u64;

    /// Number of skin voxels V.
    fn voxel_count(&self) -> u64;

    /// Infobyte of a node.
    fn infobyte(&self, node: NodeIndex) -> u8;

    /// The first child of a node.
    fn first_child(&self, node: NodeIndex) -> BoxIndex;

    /// The child in `octant`, or `None` if that octant is air.
    #[inline]
    fn child(&self, node: NodeIndex, octant: Octant) -> Option<BoxIndex> {
        let infobyte = self.infobyte(node);
        octant.is_in(infobyte).then(|| self.first_child(node).after(octant.rank_in(infobyte)))
    }

    /// Normal code of a voxel (SPEC 4.6), if the model has normals.
    fn voxel_normal(&self, voxel: VoxelIndex) -> Option<u16>;

    /// The L1-127 vector of a voxel's normal (SPEC 4.6), if the model has normals.
    #[inline]
    fn voxel_direction(&self, voxel: VoxelIndex) -> Option<[i32; 3]> {
        self.voxel_normal(voxel).map(normal::decode_l1)
    }

    /// Mean normal code of a node with an edge of 4 cells or more, if the model has them.
    fn node_normal(&self, node: NodeIndex) -> Option<u16>;

    /// Colour of a voxel (sRGB), if the model has colours, or labels with colours.
    #[inline]
    fn voxel_color(&self, voxel: VoxelIndex) -> Option<[u8; 3]> {
        let _ = voxel;
        None
    }

    /// The surface within the boxes of the finest level, if they are cells; normals are then of index space.
    #[inline]
    fn cells(&self) -> Option<CellItems<'_>> {
        None
    }
}
