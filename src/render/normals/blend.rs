//! Normals blended between the boxes around a hit: no facets, no ribs at thick slices, no rings of quantisation.
//!
//! The eight boxes whose middles surround the hit point have trilinear weights by their distance along each axis. Only
//! boxes that exist and whose normals are within 60 degrees of the hit's own count: beyond an edge, or on the other
//! side of a thin wall, there is another surface. Cost: a walk from the root that splits where the eight do, some
//! microseconds a pixel, which is why blending is a choice.

use crate::geom::{BoxIndex, NodeIndex, Octant, VoxelIndex, dot};
use crate::load::{ModelView, NodeView};

/// Least cosine between the hit's normal and another that counts.
const MIN_COSINE: f64 = 0.5;

/// The voxel or cell at a position of the grid, if the model has it.
pub(crate) fn find(view: &ModelView<'_>, at: [u32; 3]) -> Option<VoxelIndex> {
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

/// The voxels or cells at the eight corners of a box of positions: bit `a` of a corner's number selects `high` along
/// axis `a`. Corners in one node descend together. `low` and `high` are equal or adjacent.
fn find_corners(view: &ModelView<'_>, [low, high]: [[u32; 3]; 2]) -> [Option<VoxelIndex>; 8] {
    let mut boxes = [Some(BoxIndex::ROOT); 8];
    // Axes along which corners lie in different boxes.
    let mut apart = 0;
    for level in (0..view.depth()).rev() {
        let (parents, above) = (boxes, apart);
        apart = 0;
        for a in 0..3 {
            apart |= usize::from(low[a] >> level != high[a] >> level) << a;
        }
        for (corner, child) in boxes.iter_mut().enumerate() {
            if corner & !apart != 0 {
                continue;
            }
            let mut octant = 0;
            for a in 0..3 {
                let at = if corner >> a & 1 == 1 { high[a] } else { low[a] };
                octant |= (at >> level & 1) << a;
            }
            let parent = parents[corner & above];
            *child = parent.and_then(|parent| view.child(parent.node(), Octant::low_bits(octant)));
        }
    }
    if view.depth() == 0 {
        return [None; 8];
    }
    std::array::from_fn(|corner| boxes[corner & apart].map(|voxel| voxel.voxel(view.node_count())))
}

/// Unit normal of a decoded code.
fn unit(stored: [i32; 3]) -> [f64; 3] {
    let n = stored.map(f64::from);
    let length = dot(n, n).sqrt();
    n.map(|c| c / length)
}

/// The blended normal at a point of the grid, in the frame of stored normals; `own` is the hit's, of any length.
pub(crate) fn blended(view: &ModelView<'_>, at: [f64; 3], own: [f64; 3]) -> [f64; 3] {
    let length = dot(own, own).sqrt();
    let own = own.map(|c| c / length);
    let side = f64::from(1_u32 << view.depth().min(31));
    let mut sum = [0.0; 3];
    let low = [at[0] - 0.5, at[1] - 0.5, at[2] - 0.5].map(f64::floor);
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the grid")]
    let places = [0.0, 1.0].map(|step| low.map(|low| (low + step).clamp(0.0, side - 1.0) as u32));
    for (corner, voxel) in find_corners(view, places).into_iter().enumerate() {
        let mut weight = 1.0;
        for a in 0..3 {
            let from = at[a] - 0.5;
            let high = corner >> a & 1 == 1;
            weight *= if high { from - low[a] } else { 1.0 - (from - low[a]) };
            let c = if high { low[a] + 1.0 } else { low[a] };
            if !(0.0..side).contains(&c) {
                weight = 0.0;
            }
        }
        if weight <= 0.0 {
            continue;
        }
        let Some(stored) = voxel.and_then(|voxel| view.voxel_direction(voxel)) else { continue };
        let normal = unit(stored);
        if dot(normal, own) >= MIN_COSINE {
            sum = std::array::from_fn(|a| sum[a] + weight * normal[a]);
        }
    }
    if dot(sum, sum) > 0.0 { sum } else { own }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::Dims;
    use crate::memory_tree::MemoryTree;
    use crate::random::Random;

    /// Corners that descend together match separate walks.
    #[test]
    fn corners_are_found_as_each_alone() {
        let mut random = Random(5);
        for side in [1_u32, 2, 5, 16, 33] {
            let dims = Dims::new(side, side, side).unwrap();
            let cell = |i: u32| [i % side, i / side % side, i / side / side];
            let tree =
                MemoryTree::of_cells(dims, (0..side.pow(3)).filter(|_| random.below(3_u32) > 0).map(cell));
            let last = (1_u32 << tree.depth()) - 1;
            for _ in 0..500 {
                let low = [0; 3].map(|_: u32| random.below(last + 1));
                let high = low.map(|c| (c + random.below(2_u32)).min(last));
                for (corner, found) in find_corners(&tree.view(), [low, high]).into_iter().enumerate() {
                    let at = std::array::from_fn(|a| if corner >> a & 1 == 1 { high[a] } else { low[a] });
                    assert_eq!(found, find(&tree.view(), at), "{side}: {at:?}");
                }
            }
        }
    }
}
