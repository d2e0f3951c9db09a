//! A tile's rays and the larger leaves on their way (SPEC 4.9).

use crate::cpu::Lanes;
use crate::format::cell::Plane;
use crate::geom::NodeIndex;
use crate::load::ModelView;
use crate::render::leaves;
use crate::render::mirrored_ray::MirroredRay;
use crate::render::single::LargerLeaf;
use crate::render::surface::{Estimate, Surface};

use super::beam::{Beam, RAYS};
use super::listed::Source;
use super::planes::{packed, packed_edge};
use super::walk::Walk;

/// Planes of the leaves used last: finding one counts up to 512 infobytes.
pub(super) struct Planes([(u64, Plane); Self::KEPT]);

impl Planes {
    const KEPT: usize = 16;
    const NONE: (u64, Plane) = (u64::MAX, Plane { normal: [0; 3], offset: 0 });

    pub(super) const fn new() -> Self {
        Self([Self::NONE; Self::KEPT])
    }

    #[inline(always)]
    #[expect(clippy::cast_possible_truncation, reason = "a place among the planes that are kept")]
    fn get(&mut self, view: &ModelView<'_>, node: u64) -> Plane {
        let kept = &mut self.0[node as usize % Self::KEPT];
        if kept.0 != node {
            *kept = (node, view.leaf_plane(NodeIndex::new(node)));
        }
        kept.1
    }
}

impl<S: Surface, R: Source> Walk<'_, S, R> {
    /// Tests all rays of `live` against a leaf; returns those that hit it.
    #[inline(always)]
    pub(super) fn rays_of_leaf<L: Lanes>(
        &mut self,
        beam: &Beam<L>,
        leaf: &LargerLeaf,
        live: u64,
        depth: u32,
        unit: u32,
    ) -> u64 {
        let (mut met, mut left) = (0, live);
        if !S::SOLID && !beam.may_be_behind(leaf.low) {
            let plane = self.exact.planes.get(self.view, leaf.node);
            let sides = beam.sides(self.rays, leaf, &plane, live);
            met = sides.within;
            left = sides.unsure;
            self.take(leaf, &plane, met, beam.mirror, unit);
        }
        while left != 0 {
            let ray = left.trailing_zeros() as usize % RAYS;
            left &= left.wrapping_sub(1);
            self.exact.prepare(beam.lanes, self.source, self.tile.corner, beam.mirror, depth, ray);
            self.hits.steps[ray] = self.hits.steps[ray].wrapping_add(1);
            met |= u64::from(self.look_at_leaf(ray, leaf, unit, beam.mirror)) << ray;
        }
        met
    }

    /// Records rays that meet a leaf's plane within its box.
    #[inline(always)]
    fn take(&mut self, leaf: &LargerLeaf, plane: &Plane, met: u64, mirror: u32, unit: u32) {
        let bytes = each3!(A => if mirror >> A & 1 == 1 { -plane.normal[A] } else { plane.normal[A] });
        let bytes = [bytes[0], bytes[1], bytes[2], plane.offset].map(|n| n.to_le_bytes()[0]);
        let plane = u64::from(u32::from_le_bytes(bytes) ^ 0x8080_8080);
        let low = packed(leaf.low.map(|c| c.wrapping_shl(unit))) | packed_edge(leaf.edge.wrapping_add(unit));
        self.pairs.met |= met;
        let mut rays = met;
        while rays != 0 {
            let ray = rays.trailing_zeros() as usize % RAYS;
            rays &= rays.wrapping_sub(1);
            self.hits.number[ray] = leaf.node;
            self.pairs.planes[ray] = plane;
            self.pairs.lows[ray] = low;
        }
    }

    /// True if a ray hits a leaf: by an estimate, and exactly where that does not suffice.
    #[inline(always)]
    pub(super) fn look_at_leaf(&mut self, ray: usize, leaf: &LargerLeaf, unit: u32, mirror: u32) -> bool {
        let low = leaf.low.map(|c| c.wrapping_shl(unit));
        let edge_log2 = leaf.edge.wrapping_add(unit);
        if let Some(approach) = self.exact.approach(ray, leaf.node, low, mirror) {
            let plane = self.exact.planes.get(self.view, leaf.node);
            match leaves::predict(&plane, &approach, edge_log2) {
                Estimate::Past => return false,
                Estimate::Within { distance, component } => {
                    let t = self.exact.t_after(ray, distance, component);
                    self.hits.set_mirrored(ray, leaf.node, low, None, t);
                    self.hits.edge_log2[ray % RAYS] = edge_log2.to_le_bytes()[0];
                    return true;
                }
                Estimate::Entry | Estimate::Unsure => {}
            }
        }
        self.meet_leaf(ray, leaf.node, low, edge_log2)
    }

    /// Tests a ray against a leaf in integers.
    #[cold]
    fn meet_leaf(&mut self, ray: usize, node: u64, low: [u32; 3], edge_log2: u32) -> bool {
        let Some(exact) = self.exact(ray) else { return false };
        let mirrored = MirroredRay::new(&exact);
        let hit = leaves::meet(self.view, &exact, &mirrored, node, low, edge_log2);
        if let Some(hit) = hit {
            self.hits.set(ray, &hit);
        }
        hit.is_some()
    }
}
