//! A tile's rays and the larger leaves on their way (SPEC 4.9).

use crate::render::lanes::Lanes;
use crate::render::leaves;
use crate::render::mirrored_ray::MirroredRay;
use crate::render::single::LargerLeaf;
use crate::render::surface::{Estimate, Surface};

use super::beam::{Beam, RAYS};
use super::walk::Walk;

impl<S: Surface> Walk<'_, '_, S> {
    /// Asks a leaf about all rays of `live`; gives those that meet it.
    #[inline(never)]
    pub(super) fn rays_of_leaf<L: Lanes>(
        &mut self,
        beam: &Beam<L>,
        leaf: &LargerLeaf,
        live: u64,
        depth: u32,
        unit: u32,
    ) -> u64 {
        let (mut left, mut met) = (live, 0);
        while left != 0 {
            let ray = left.trailing_zeros() as usize % RAYS;
            left &= left.wrapping_sub(1);
            self.exact.prepare(beam.lanes, &self.source, self.tile.corner, beam.mirror, depth, ray);
            self.hits.steps[ray] = self.hits.steps[ray].wrapping_add(1);
            met |= u64::from(self.look_at_leaf(ray, leaf, unit, beam.mirror)) << ray;
        }
        met
    }

    /// Does a ray meet a leaf? At a glance, and exactly where that does not do.
    #[inline]
    pub(super) fn look_at_leaf(&mut self, ray: usize, leaf: &LargerLeaf, unit: u32, mirror: u32) -> bool {
        let low = leaf.low.map(|c| c.wrapping_shl(unit));
        let edge_log2 = leaf.edge.wrapping_add(unit);
        if let Some(approach) = self.exact.approach(ray, leaf.node, low, mirror) {
            match leaves::predict(self.view, &approach, edge_log2) {
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
        let Some(exact) = self.exact(ray) else { return false };
        let mirrored = MirroredRay::new(&exact);
        let hit = leaves::meet(self.view, &exact, &mirrored, leaf.node, low, edge_log2);
        if let Some(hit) = hit {
            self.hits.set(ray, &hit);
        }
        hit.is_some()
    }
}
