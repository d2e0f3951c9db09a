//! Normals blended between the boxes around a hit: no facets, no ribs at thick slices, no rings of quantisation.
//!
//! The eight boxes whose middles surround the point of the hit count by how near they are along each axis, as in
//! trilinear interpolation, those that exist and whose normals are within 60 degrees of the hit's own: beyond an edge,
//! or on the other side of a thin wall, there is another surface. Cost: eight walks from the root, some microseconds a
//! pixel; that is why it is a choice.

use crate::geom::{NodeIndex, Octant, VoxelIndex};
use crate::load::NodeView;

use super::space::dot;

/// Least cosine between the hit's normal and another that counts.
const LEAST_COSINE: f64 = 0.5;

/// The voxel or cell at a place of the grid, if the model has it.
pub(crate) fn find<V: NodeView>(view: &V, at: [u32; 3]) -> Option<VoxelIndex> {
    let mut node = NodeIndex::ROOT;
    for level in (0..view.depth()).rev() {
        let [x, y, z] = at.map(|c| c >> level & 1);
        let octant = Octant::low_bits(x | y << 1 | z << 2);
        let child = view.child(node, octant)?;
        if level == 0 {
            return Some(child.voxel(view.node_count()));
        }
        node = child.node();
    }
    None
}

/// A normal of length 1 of what a code says.
fn unit(stored: [i32; 3]) -> [f64; 3] {
    let n = stored.map(f64::from);
    let length = dot(n, n).sqrt();
    n.map(|c| c / length)
}

/// The blended normal at a point of the grid, in the frame of stored normals; `own` is the hit's, of any length.
pub(crate) fn blended<V: NodeView>(view: &V, at: [f64; 3], own: [f64; 3]) -> [f64; 3] {
    let length = dot(own, own).sqrt();
    let own = own.map(|c| c / length);
    let side = f64::from(1_u32 << view.depth().min(31));
    let mut sum = [0.0; 3];
    for corner in 0..8_u32 {
        let mut weight = 1.0;
        let mut place = [0; 3];
        for a in 0..3 {
            let from = at[a] - 0.5;
            let low = from.floor();
            let high = corner >> a & 1 == 1;
            weight *= if high { from - low } else { 1.0 - (from - low) };
            let c = if high { low + 1.0 } else { low };
            if !(0.0..side).contains(&c) {
                weight = 0.0;
            }
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "clamped to the grid"
            )]
            let c = c.clamp(0.0, side - 1.0) as u32;
            place[a] = c;
        }
        if weight <= 0.0 {
            continue;
        }
        let Some(stored) = find(view, place).and_then(|voxel| view.voxel_direction(voxel)) else { continue };
        let normal = unit(stored);
        if dot(normal, own) >= LEAST_COSINE {
            sum = std::array::from_fn(|a| sum[a] + weight * normal[a]);
        }
    }
    if dot(sum, sum) > 0.0 { sum } else { own }
}
