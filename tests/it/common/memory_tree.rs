//! An octree held in plain vectors: the slow, obvious oracle that faster views are tested against.

#![allow(dead_code, reason = "unit tests and tests of the whole use their own parts")]

use infobyte::format::rank;
use infobyte::geom::{BoxIndex, Dims, NodeIndex, VoxelIndex, morton};
use infobyte::load::{ModelView, NodeView};

/// Octree in memory, built level by level from its skin voxels.
///
/// Built by plain scans over sorted lists, so that it can be read and believed. The oracle walks it as it is;
/// [`MemoryTree::view`] shows it to the kernels.
#[derive(Clone, Debug)]
pub(crate) struct MemoryTree {
    dims: Dims,
    voxels: Vec<u64>,
    infobytes: Vec<u8>,
    first_children: Vec<u64>,
    directory: Vec<u8>,
    normals: Vec<[u8; 2]>,
    node_normals: Vec<[u8; 2]>,
}

impl MemoryTree {
    /// Builds the tree of these skin voxels: Morton codes in any order, repeats ignored.
    ///
    /// Returns `None` when a voxel lies outside the volume. No voxels at all give an empty tree.
    pub(crate) fn new(dims: Dims, voxels: &[u64]) -> Option<Self> {
        let mut voxels = voxels.to_vec();
        voxels.sort_unstable();
        voxels.dedup();
        let inside = |code: &u64| {
            let [x, y, z] = morton::decode(*code);
            *code < 1 << 48 && dims.contains(x, y, z)
        };
        if !voxels.iter().all(inside) {
            return None;
        }
        // levels[k]: Morton codes of the boxes with an edge of 2^k cells.
        let mut levels = vec![voxels.clone()];
        for k in 0..dims.depth() as usize {
            let mut parents: Vec<u64> = levels[k].iter().map(|code| code >> 3).collect();
            parents.dedup();
            levels.push(parents);
        }
        let mut infobytes = Vec::new();
        let mut first_children = Vec::new();
        let mut next_child = 1;
        for k in (1..levels.len()).rev() {
            for parent in &levels[k] {
                let is_child = |octant: &u64| levels[k - 1].binary_search(&(parent << 3 | octant)).is_ok();
                let mask = (0..8_u64).filter(is_child).fold(0, |mask, octant| mask | 1_u8 << octant);
                infobytes.push(mask);
                first_children.push(next_child);
                next_child += u64::from(mask.count_ones());
            }
        }
        let (normals, node_normals) = (Vec::new(), Vec::new());
        let directory = rank::directory(&infobytes);
        Some(Self { dims, voxels, infobytes, first_children, directory, normals, node_normals })
    }

    /// The tree of these cells.
    pub(crate) fn of_cells(dims: Dims, cells: impl IntoIterator<Item = [u32; 3]>) -> Self {
        let codes: Vec<u64> = cells.into_iter().map(|[x, y, z]| morton::encode(x, y, z)).collect();
        Self::new(dims, &codes).expect("cells of the volume")
    }

    /// This tree with one normal code (SPEC 4.6) per voxel in Morton order; `None` when the number of
    /// codes is not the number of voxels.
    pub(crate) fn with_normals(mut self, codes: Vec<u16>) -> Option<Self> {
        if codes.len() != self.voxels.len() {
            return None;
        }
        self.normals = codes.into_iter().map(u16::to_le_bytes).collect();
        Some(self)
    }

    /// This tree with one mean normal per node of depth 0 ..= L-2, in breadth-first order.
    pub(crate) fn with_node_normals(mut self, codes: Vec<u16>) -> Self {
        self.node_normals = codes.into_iter().map(u16::to_le_bytes).collect();
        self
    }

    /// This tree as the kernels see models.
    pub(crate) fn view(&self) -> ModelView<'_> {
        let normals = (!self.normals.is_empty()).then_some(&*self.normals);
        let node_normals = (!self.node_normals.is_empty()).then_some(&*self.node_normals);
        ModelView::over(self.dims.depth(), self.voxel_count(), &self.infobytes, &self.directory)
            .with_normals(normals, node_normals)
    }

    /// Size of the volume.
    pub(crate) fn dims(&self) -> Dims {
        self.dims
    }

    /// Morton codes of the voxels, in order.
    pub(crate) fn voxels(&self) -> &[u64] {
        &self.voxels
    }

    /// Infobytes of all nodes, in breadth-first order.
    pub(crate) fn infobytes(&self) -> &[u8] {
        &self.infobytes
    }
}

/// Item `at` of a slice, or nothing.
fn item<T: Copy>(items: &[T], at: Option<usize>) -> Option<T> {
    items.get(at?).copied()
}

impl NodeView for MemoryTree {
    fn depth(&self) -> u32 {
        self.dims.depth()
    }

    fn node_count(&self) -> u64 {
        self.infobytes.len() as u64
    }

    fn voxel_count(&self) -> u64 {
        self.voxels.len() as u64
    }

    fn infobyte(&self, node: NodeIndex) -> u8 {
        item(&self.infobytes, node.index()).unwrap_or(0)
    }

    fn first_child(&self, node: NodeIndex) -> BoxIndex {
        BoxIndex::new(item(&self.first_children, node.index()).unwrap_or(0))
    }

    fn voxel_normal(&self, voxel: VoxelIndex) -> Option<u16> {
        item(&self.normals, voxel.index()).map(u16::from_le_bytes)
    }

    fn node_normal(&self, node: NodeIndex) -> Option<u16> {
        item(&self.node_normals, node.index()).map(u16::from_le_bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use infobyte::geom::Octant;

    /// Voxels found by walking the tree from its root.
    fn walk(tree: &MemoryTree) -> Vec<u64> {
        let mut found = Vec::new();
        let mut boxes = if tree.voxel_count() > 0 { vec![(BoxIndex::ROOT, 0_u64)] } else { Vec::new() };
        for _ in 0..tree.depth() {
            let mut next = Vec::new();
            for (number, code) in boxes {
                for octant in Octant::ALL {
                    let code = code << 3 | u64::from(octant.get());
                    next.extend(tree.child(number.node(), octant).map(|child| (child, code)));
                }
            }
            boxes = next;
        }
        for (number, code) in boxes {
            assert_eq!(item(tree.voxels(), number.voxel(tree.node_count()).index()), Some(code));
            found.push(code);
        }
        found
    }

    #[test]
    fn walking_the_tree_gives_back_its_voxels_in_order() {
        let dims = Dims::new(37, 5, 64).unwrap();
        let codes: Vec<u64> = (0..500_u32)
            .map(|i| morton::encode(i * 7 % 37, i * 3 % 5, i.wrapping_mul(2_654_435_761) >> 26))
            .collect();
        let tree = MemoryTree::new(dims, &codes).unwrap();
        let mut want = codes;
        want.sort_unstable();
        want.dedup();
        assert_eq!(walk(&tree), want);
        // The kernels' view finds the same children by the directory.
        for node in (0..tree.node_count() + 40).map(NodeIndex::new) {
            assert_eq!(tree.view().infobyte(node), tree.infobyte(node));
            if node.get() < tree.node_count() {
                assert_eq!(tree.view().first_child(node), tree.first_child(node));
            }
        }
        assert!(tree.infobytes().iter().all(|mask| *mask != 0));
    }

    #[test]
    fn the_smallest_grids_work() {
        let one = Dims::new(1, 1, 1).unwrap();
        let tree = MemoryTree::new(one, &[0]).unwrap();
        assert_eq!((tree.depth(), tree.node_count(), tree.voxel_count()), (0, 0, 1));
        assert_eq!(walk(&tree), [0]);
        assert!(MemoryTree::new(one, &[1]).is_none());
        let empty = MemoryTree::new(Dims::new(4, 4, 4).unwrap(), &[]).unwrap();
        assert_eq!((empty.node_count(), empty.voxel_count(), empty.infobyte(NodeIndex::ROOT)), (0, 0, 0));
        let corner = MemoryTree::new(Dims::new(4, 3, 2).unwrap(), &[morton::encode(3, 2, 1)]).unwrap();
        assert_eq!(corner.infobytes(), [1 << 3, 1 << 5]);
    }
}
