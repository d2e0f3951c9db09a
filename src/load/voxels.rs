//! The voxels or cells of a model, one after the other.

use crate::format::number;
use crate::geom::{Affine, NodeIndex, Octant, VoxelIndex};

use super::{Items, ModelView, NodeView};

/// Most levels of nodes.
const MAX_LEVELS: usize = 16;

/// A stored skin voxel or cell of a model.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StoredVoxel {
    /// Number in the order of the file: index of its items in every channel.
    pub number: u64,
    /// Index (x, y, z) of the voxel, or of the cell: cell i lies between samples i - 1 and i.
    pub voxel: [u32; 3],
    /// Unit vector out of the surface, in LPS, where the model has normals.
    pub normal: Option<[f64; 3]>,
    /// Physical value, such as HU, where the model has values.
    pub value: Option<f64>,
    /// Colour (sRGB), where the model has colours.
    pub color: Option<[u8; 3]>,
    /// Number of its greatest label, where the model has labels.
    pub label: Option<u16>,
}

/// The voxels or cells of a model in the order of the file, which is Morton order; see
/// [`Model::voxels`](super::Model::voxels).
///
/// A depth-first walk visits the nodes of every depth in the order of the file, so a counter for each depth replaces
/// ranks.
#[derive(Clone, Debug)]
pub struct StoredVoxels<'a> {
    view: ModelView<'a>,
    values: Option<Items<'a>>,
    value_scale: [f64; 2],
    /// Map from stored normals to world normals, and the sides of a box where normals are of index space.
    normals: Option<([[f64; 3]; 3], [f64; 3])>,
    /// Next node of every depth.
    next_node: [u64; MAX_LEVELS],
    /// Octants still to visit, from the root down, and the lowest corner of each node in boxes of its children.
    open: [(u8, [u32; 3]); MAX_LEVELS],
    /// Depth of the current node, from 1 on; 0 at the end.
    at: usize,
    number: u64,
}

impl<'a> StoredVoxels<'a> {
    pub(super) fn new(
        view: ModelView<'a>,
        levels: &[u64],
        affine: &Affine,
        values: Option<Items<'a>>,
        value_scale: [f64; 2],
    ) -> Self {
        let frame_mm = affine.spacing_mm();
        let stored_in = if view.cells().is_some() { frame_mm } else { [1.0; 3] };
        let mut next_node = [u64::MAX; MAX_LEVELS];
        next_node.iter_mut().zip(levels).for_each(|(next, first)| *next = *first);
        let mut found = Self {
            view,
            values,
            value_scale,
            normals: affine.normal_rows(frame_mm).map(|rows| (rows, stored_in)),
            next_node,
            open: [(0, [0; 3]); MAX_LEVELS],
            at: 0,
            number: 0,
        };
        if view.depth() > 0 {
            found.enter([0; 3]);
        }
        found
    }

    /// Descends into the next node of the next depth.
    fn enter(&mut self, corner: [u32; 3]) {
        let Some(next) = self.next_node.get_mut(self.at) else { return };
        let infobyte = self.view.infobyte(NodeIndex::new(*next));
        *next = next.saturating_add(1);
        self.open[self.at] = (infobyte, corner.map(|c| 2 * c));
        self.at += 1;
    }

    /// The next voxel's index.
    fn next_cell(&mut self) -> Option<[u32; 3]> {
        let depth = self.view.depth() as usize;
        if depth == 0 {
            return Some([0; 3]);
        }
        while let Some((octants, corner)) = self.at.checked_sub(1).and_then(|at| self.open.get_mut(at)) {
            if *octants == 0 {
                self.at -= 1;
                continue;
            }
            let high = Octant::low_bits(octants.trailing_zeros()).high();
            *octants &= octants.wrapping_sub(1);
            // Corners are even.
            let child = [corner[0] | high[0], corner[1] | high[1], corner[2] | high[2]];
            if self.at >= depth.min(MAX_LEVELS) {
                return Some(child);
            }
            self.enter(child);
        }
        None
    }

    /// Number and index of the next voxel.
    fn next_place(&mut self) -> Option<(u64, [u32; 3])> {
        if self.number >= self.view.voxel_count() {
            return None;
        }
        let voxel = self.next_cell()?;
        self.number += 1;
        Some((self.number - 1, voxel))
    }

    /// Numbers and indices alone.
    pub(crate) fn places(mut self) -> impl Iterator<Item = (u64, [u32; 3])> {
        std::iter::from_fn(move || self.next_place())
    }

    fn normal(&self, voxel: VoxelIndex) -> Option<[f64; 3]> {
        let stored = match self.view.cells() {
            Some(cells) => cells.normal(voxel.get()),
            None => self.view.voxel_direction(voxel)?,
        };
        let (rows, stored_in) = self.normals?;
        let n: [f64; 3] = std::array::from_fn(|a| f64::from(stored[a]) / stored_in[a]);
        let world = rows.map(|r| r[0] * n[0] + r[1] * n[1] + r[2] * n[2]);
        let length = world.iter().map(|c| c * c).sum::<f64>().sqrt();
        Some(if length > 0.0 { world.map(|c| c / length) } else { world })
    }
}

impl Iterator for StoredVoxels<'_> {
    type Item = StoredVoxel;

    fn next(&mut self) -> Option<StoredVoxel> {
        let (number, voxel) = self.next_place()?;
        let [slope, intercept] = self.value_scale;
        let index = VoxelIndex::new(number);
        Some(StoredVoxel {
            number,
            voxel,
            normal: self.normal(index),
            value: self
                .values
                .and_then(|v| v.get(number))
                .map(to_f64)
                .filter(|stored| *stored > 0.0 || !self.view.has_quantity())
                .map(|stored| slope * stored + intercept),
            color: self.view.voxel_color(index),
            label: self.view.labels().and_then(|labels| labels.get(number)),
        })
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        (0, usize::try_from(self.view.voxel_count() - self.number).ok())
    }
}

fn to_f64(item: &[u8]) -> f64 {
    f64::from(u16::try_from(number(item)).unwrap_or(u16::MAX))
}
