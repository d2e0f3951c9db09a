//! Crossings of leaves between two neighbouring middles, and the normals there.

use super::{Body, Leaf};
use crate::builder::{CellEdges, EdgeCrossing};
use crate::csg::place::centre;
use crate::mesh::{STEPS, cross_edges};

impl Leaf {
    /// The crossing of the edge from a voxel's middle to the next one's along an axis, for a leaf that holds one of
    /// them, the first one if `holds_low`; `None` where it is not found, and for sampled leaves.
    ///
    /// Exact to half a lattice step, by the same whole numbers that decide about middles.
    pub(in crate::csg) fn crossing(
        &self,
        low: [i32; 3],
        axis: usize,
        holds_low: bool,
    ) -> Option<EdgeCrossing> {
        let from = low.map(centre);
        let at = |steps: i64| {
            let mut p = from;
            p[axis] += steps;
            p
        };
        let contains = |p: [i64; 3]| match self {
            Self::Ball(ball) => ball.contains(p),
            Self::Block(block) => block.contains(p),
            Self::Half(half) => half.contains(p),
            Self::Curved(curved) => curved.contains(p),
            Self::Nothing | Self::Body(_) | Self::Sampled(_) => false,
        };
        match self {
            Self::Nothing | Self::Sampled(_) => return None,
            Self::Body(body) => return of_body(body, low, axis, holds_low),
            _ => {}
        }
        let (mut first, mut last) = (0, i64::from(STEPS));
        while last - first > 1 {
            let middle = (first + last) / 2;
            *if contains(at(middle)) == holds_low { &mut first } else { &mut last } = middle;
        }
        let (inner, outer) = if holds_low { (at(first), at(last)) } else { (at(last), at(first)) };
        let normal = match self {
            Self::Ball(ball) => ball.outwards(inner),
            Self::Half(half) => half.outwards(),
            Self::Curved(curved) => curved.face(inner, outer, true).outwards,
            _ => {
                let mut across = [0.0; 3];
                across[axis] = if holds_low { 1.0 } else { -1.0 };
                across
            }
        };
        #[expect(clippy::cast_precision_loss, reason = "at most 4096")]
        let along = (first as f64 + 0.5) / f64::from(STEPS);
        Some(EdgeCrossing { low, axis, along, normal })
    }
}

/// The crossing of a body that is next to its outside end; for a large body the one that cells keep, which may come
/// from bins.
pub(super) fn of_body(body: &Body, low: [i32; 3], axis: usize, low_inside: bool) -> Option<EdgeCrossing> {
    let mut high = low;
    high[axis] += 1;
    let mut best: Option<EdgeCrossing> = None;
    body.each_near([low, high], STEPS.into(), |t| {
        cross_edges(t, [low, high], &mut |crossing| {
            if crossing.low != low || crossing.axis != axis {
                return;
            }
            let crossing = if body.is_large() { CellEdges::kept(crossing, low_inside) } else { *crossing };
            let is_better = |known: EdgeCrossing| {
                let farther =
                    if low_inside { crossing.along - known.along } else { known.along - crossing.along };
                farther > 0.0 || (farther == 0.0 && crossing.normal < known.normal)
            };
            if best.is_none_or(is_better) {
                best = Some(crossing);
            }
        });
    });
    best.map(|found| {
        let turned = (found.normal[axis] >= 0.0) != low_inside;
        EdgeCrossing { normal: found.normal.map(|c| if turned { -c } else { c }), ..found }
    })
}
