//! Normals blended between larger leaves (SPEC 4.9): as between cells, with boxes as wide as the leaf that was hit.

use crate::geom::{NodeIndex, Octant, dot};
use crate::load::{ModelView, NodeView};

use crate::format::normal;

/// Least cosine between the hit's normal and another that counts.
const MIN_COSINE: f64 = 0.5;

/// The normal of the box of edge `2^edge_log2` at a place of the grid: of the larger leaf that it is or lies in, or the mean
/// of what is in it; and the edge of the leaf, or of the box.
fn normal_at(view: &ModelView<'_>, place: [u32; 3], edge_log2: u32) -> Option<([i32; 3], u32)> {
    let mut node = NodeIndex::ROOT;
    for level in (edge_log2..view.depth()).rev() {
        let [x, y, z] = place.map(|c| c >> level & 1);
        node = view.child(node, Octant::low_bits(x | y << 1 | z << 2))?.node();
        if level > 0 && view.is_leaf(node) {
            return Some((normal::decode_l1(view.leaf_items(node).0), level));
        }
    }
    Some((normal::decode_l1(view.node_normal(node)?), edge_log2))
}

/// The blended normal at a point of the grid within a larger leaf, in index space; `own` is the leaf's.
pub(super) fn blended(view: &ModelView<'_>, at: [f64; 3], own: [f64; 3]) -> [f64; 3] {
    let side = f64::from(1_u32 << view.depth().min(31));
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the grid")]
    let cell = |at: [f64; 3]| at.map(|c| c.clamp(0.0, side - 1.0) as u32);
    // Rounding may put the point beside the leaf, where smaller boxes or none are.
    let Some((_, edge_log2)) = normal_at(view, cell(at), 1).filter(|(_, edge_log2)| *edge_log2 > 0) else {
        return own;
    };
    let length = dot(own, own).sqrt();
    let own = own.map(|c| c / length);
    let edge = f64::from(1_u32 << edge_log2);
    let from = at.map(|c| c / edge - 0.5);
    let low = from.map(f64::floor);
    let mut sum = [0.0; 3];
    for corner in 0..8 {
        let high = |a: usize| corner >> a & 1 == 1;
        let place: [f64; 3] = std::array::from_fn(|a| (low[a] + if high(a) { 1.5 } else { 0.5 }) * edge);
        let weight = (0..3).fold(1.0, |weight, a| {
            let part = from[a] - low[a];
            weight * if high(a) { part } else { 1.0 - part }
        });
        if weight <= 0.0 || place.iter().any(|c| !(0.0..side).contains(c)) {
            continue;
        }
        let Some((stored, _)) = normal_at(view, cell(place), edge_log2) else { continue };
        let stored = stored.map(f64::from);
        let length = dot(stored, stored).sqrt();
        let normal = stored.map(|c| c / length);
        if dot(normal, own) >= MIN_COSINE {
            sum = std::array::from_fn(|a| sum[a] + weight * normal[a]);
        }
    }
    if dot(sum, sum) > 0.0 { sum } else { own }
}
