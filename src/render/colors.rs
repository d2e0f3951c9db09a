//! The colour at a hit: the colour of a voxel, or the mean of some voxels of a coarser box.

use super::normals::shading_normal::PixelHit;
use super::shade::Shader;
use crate::geom::{BoxIndex, VoxelIndex};
use crate::load::{ModelView, NodeView};

/// Most voxels whose colours are averaged.
const MAX: u64 = 64;

/// True if the voxels of a model have colours.
pub(crate) fn has_colors(view: &ModelView<'_>) -> bool {
    view.voxel_color(VoxelIndex::new(0)).is_some()
}

/// Linear RGB at a hit, if the model has colours.
pub(crate) fn color_of(view: &ModelView<'_>, shader: &Shader, seen: PixelHit) -> Option<[f64; 3]> {
    if !has_colors(view) {
        return None;
    }
    let at = BoxIndex::new(seen.box_number());
    if seen.is_finest() {
        return view.voxel_color(at.voxel(view.node_count())).map(|color| shader.decode(color));
    }
    // Voxels of a box have consecutive numbers.
    let (first, last) = (end(view, at, false)?, end(view, at, true)?);
    let step = last.saturating_sub(first) / MAX + 1;
    let (mut sum, mut count) = ([0.0; 3], 0.0);
    let mut voxel = first;
    while voxel <= last {
        let light = shader.decode(view.voxel_color(VoxelIndex::new(voxel))?);
        sum = std::array::from_fn(|k| sum[k] + light[k]);
        count += 1.0;
        voxel = voxel.saturating_add(step);
    }
    (count > 0.0).then(|| sum.map(|c| c / count))
}

/// The number of the label at a hit, if the model has labels: the label of a voxel, or of the first one of a coarser
/// box.
pub(crate) fn label_of(view: &ModelView<'_>, seen: PixelHit) -> Option<u16> {
    let labels = view.labels()?;
    Some(first_voxel(view, seen).and_then(|voxel| labels.get(voxel)).unwrap_or(0))
}

/// The voxel or cell that was hit, or the first of a coarser box.
pub(crate) fn first_voxel(view: &ModelView<'_>, seen: PixelHit) -> Option<u64> {
    end(view, BoxIndex::new(seen.box_number()), false)
}

/// The first or last voxel of a box.
fn end(view: &ModelView<'_>, mut at: BoxIndex, last: bool) -> Option<u64> {
    let nodes = view.node_count();
    for _ in 0..=view.depth() {
        if at.get() >= nodes {
            return Some(at.voxel(nodes).get());
        }
        let children = view.infobyte(at.node()).count_ones();
        at = view.first_child(at.node()).after(if last { children.checked_sub(1)? } else { 0 });
    }
    None
}
