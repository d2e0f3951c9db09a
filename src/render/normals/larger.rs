//! Normals blended between larger leaves (SPEC 4.9): as between cells, with boxes as wide as the leaf that was hit.
//!
//! Adjacent pixels need the same few boxes, so the last results are cached, and a walk down the octree starts where it
//! leaves the previous one. Memory: 10 KiB. Cost: some 5 ns a cached box, of eight for a hit.

use crate::geom::{NodeIndex, Octant, dot};
use crate::load::{ModelView, NodeView};

use crate::format::normal;

/// Least cosine between the hit's normal and another that counts.
const MIN_COSINE: f64 = 0.5;

/// Cached boxes.
const KEPT: usize = 256;
/// Levels of the deepest octree (SPEC 4.1); its nodes with the root.
const MAX_DEPTH: u32 = 16;
const NODES: usize = MAX_DEPTH as usize + 1;

/// The normal of a box, as a vector of length 1; `None` for an empty box.
type BoxNormal = Option<[f64; 3]>;

/// The normals of the boxes looked up last.
#[derive(Clone, Debug)]
pub(super) struct BoxNormals {
    /// Results by position and edge of the box.
    found: Vec<(u64, BoxNormal)>,
    /// The last walk: its target cell, and its nodes from the root on.
    to: [u32; 3],
    nodes: [NodeIndex; NODES],
    known: u32,
}

impl Default for BoxNormals {
    fn default() -> Self {
        Self { found: Vec::new(), to: [0; 3], nodes: [NodeIndex::ROOT; NODES], known: 1 }
    }
}

impl BoxNormals {
    /// The normal of the box of edge `2^edge_log2` at a position of the grid: the normal of the larger leaf that it is
    /// or lies in, or the mean over its content.
    fn normal(&mut self, view: &ModelView<'_>, place: [u32; 3], edge_log2: u32) -> BoxNormal {
        if self.found.is_empty() {
            self.found = vec![(u64::MAX, None); KEPT];
        }
        let [x, y, z] = place.map(|c| c >> edge_log2);
        let key = u64::from(x) | u64::from(y) << 16 | u64::from(z) << 32 | u64::from(edge_log2) << 48;
        let at = (x & 7 | (y & 7) << 3 | (z & 3) << 6) as usize % KEPT;
        if self.found[at].0 != key {
            self.found[at] = (key, self.walk(view, place, edge_log2).map(unit));
        }
        self.found[at].1
    }

    fn walk(&mut self, view: &ModelView<'_>, place: [u32; 3], edge_log2: u32) -> Option<[i32; 3]> {
        let depth = view.depth().min(MAX_DEPTH);
        let apart = (0..3).fold(0, |apart, a| apart | place[a] ^ self.to[a]);
        // The nodes of boxes that hold both positions, from the root on.
        let shared = depth.saturating_sub(u32::BITS - apart.leading_zeros());
        self.known = self.known.min(shared + 1).min(depth - edge_log2.min(depth) + 1);
        self.to = place;
        loop {
            let (node, level) = (self.nodes[self.known as usize - 1], depth + 1 - self.known);
            if level < depth && view.is_leaf(node) {
                return Some(normal::decode_l1(view.leaf_items(node).0));
            }
            if level <= edge_log2 {
                return Some(normal::decode_l1(view.node_normal(node)?));
            }
            let octant = (0..3).fold(0, |octant, a| octant | (place[a] >> (level - 1) & 1) << a);
            let child = view.child(node, Octant::low_bits(octant))?;
            self.nodes[self.known as usize] = child.node();
            self.known += 1;
        }
    }
}

fn unit(normal: [i32; 3]) -> [f64; 3] {
    let n = normal.map(f64::from);
    let length = dot(n, n).sqrt();
    n.map(|c| c / length)
}

/// The blended normal at a point of the grid within a larger leaf of edge `2^edge_log2`, in index space; `own` is the
/// leaf's normal.
pub(super) fn blended(
    view: &ModelView<'_>,
    kept: &mut BoxNormals,
    at: [f64; 3],
    edge_log2: u32,
    own: [f64; 3],
) -> [f64; 3] {
    let side = f64::from(1_u32 << view.depth().min(31));
    let length = dot(own, own).sqrt();
    let own = own.map(|c| c / length);
    let edge = f64::from(1_u32 << edge_log2);
    let from = at.map(|c| c / edge - 0.5);
    let low = from.map(f64::floor);
    let part = [from[0] - low[0], from[1] - low[1], from[2] - low[2]];
    let mut sum = [0.0; 3];
    for corner in 0..8 {
        let high = [corner & 1, corner >> 1 & 1, corner >> 2].map(|bit| bit == 1);
        let (mut weight, mut place, mut is_in) = (1.0, [0; 3], true);
        for a in 0..3 {
            let middle = (low[a] + if high[a] { 1.5 } else { 0.5 }) * edge;
            is_in &= (0.0..side).contains(&middle);
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "asked for within the grid only"
            )]
            let cell = middle as u32;
            place[a] = cell;
            weight *= if high[a] { part[a] } else { 1.0 - part[a] };
        }
        if weight <= 0.0 || !is_in {
            continue;
        }
        let Some(normal) = kept.normal(view, place, edge_log2) else { continue };
        if dot(normal, own) >= MIN_COSINE {
            sum = [sum[0] + weight * normal[0], sum[1] + weight * normal[1], sum[2] + weight * normal[2]];
        }
    }
    if dot(sum, sum) > 0.0 { sum } else { own }
}
