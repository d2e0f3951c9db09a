//! How far two bodies overlap, or how far apart they are: one octree is descended, the other asked for the nearest point.
//!
//! The surface of what two bodies share is that part of each that lies in the other. So its volume is the sum over these
//! facets of a third of area times height over a common origin (divergence theorem). A box of one tree that is farther
//! from the other surface than half its diagonal lies inside or outside as a whole, and is not looked into further where
//! it cannot change a figure.

use super::{Facet, ON, OctreeBox, Query, Search, Surface};
use crate::geom::{Octant, dot};
use crate::load::NodeView;

/// Rounds from surface to surface, each no longer than the one before, until the gap stays as it is.
const ROUNDS: usize = 64;

/// How two bodies lie to each other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Gap {
    /// They share a volume; `depth_mm` is how deep the deepest place of either surface lies inside the other body.
    Overlap { volume_mm3: f64, depth_mm: f64 },
    /// They are apart by this much, between these two places of the world.
    Apart { mm: f64, between: [[f64; 3]; 2] },
}

impl Gap {
    /// The gap between two surfaces of the same world; `None` where one is empty.
    ///
    /// Cost: follows the surfaces where they lie in each other, or are nearest to each other.
    pub(crate) fn of(one: Surface<'_>, other: Surface<'_>) -> Option<Self> {
        if one.view.is_empty() || other.view.is_empty() {
            return None;
        }
        let origin = one.space.to_world(one.middle([0; 3], one.view.depth()).0);
        let mut shared = Shared { origin, volume: 0.0, depth: 0.0 };
        for [own, of] in [[one, other], [other, one]] {
            Walk { own, search: of.search() }.shared(own.root(), None, &mut shared);
        }
        // Of a body and itself no place lies deeper than on the surface.
        if shared.depth > 0.0 || shared.volume > one.space.spacing.iter().product() {
            return Some(Self::Overlap { volume_mm3: shared.volume.max(0.0), depth_mm: shared.depth });
        }
        let mut walk = Walk { own: one, search: other.search() };
        let mut nearest: Option<(f64, [f64; 3])> = None;
        walk.nearest(one.root(), &mut nearest);
        let (mut mm, mut from) = nearest?;
        let mut back = one.search();
        let mut to = from;
        for _ in 0..ROUNDS {
            let found = walk.search.nearest(other.space.to_frame(from), &Query::ANY)?;
            to = other.space.to_world(found.point);
            let found = back.nearest(one.space.to_frame(to), &Query::ANY)?;
            from = one.space.to_world(found.point);
            let before = std::mem::replace(&mut mm, found.distance());
            if before - mm <= 1e-9 * before {
                break;
            }
        }
        let mm = if mm < ON * one.space.finest { 0.0 } else { mm };
        Some(Self::Apart { mm, between: [from, to] })
    }
}

impl Surface<'_> {
    fn root(&self) -> OctreeBox {
        OctreeBox { number: crate::geom::BoxIndex::ROOT, low: [0; 3], level: self.view.depth() }
    }
}

/// Sums over the surfaces of what two bodies share.
struct Shared {
    origin: [f64; 3],
    volume: f64,
    depth: f64,
}

/// A descent of one surface that asks the other.
struct Walk<'a> {
    own: Surface<'a>,
    search: Search<'a>,
}

impl Walk<'_> {
    fn children(&self, place: OctreeBox) -> Vec<OctreeBox> {
        let (node, level) = (place.number.node(), place.level - 1);
        let (infobyte, first) = (self.own.view.infobyte(node), self.own.view.first_child(node));
        let child = |octant: Octant| {
            let high = octant.high();
            let low = std::array::from_fn(|a| place.low[a] + (high[a] << level));
            OctreeBox { number: first.after(octant.rank_in(infobyte)), low, level }
        };
        Octant::ALL.into_iter().filter(|octant| octant.is_in(infobyte)).map(child).collect()
    }

    fn facets(&self, place: OctreeBox) -> Vec<Facet> {
        let mut facets = Vec::new();
        self.own.facets(place, |_, facet| facets.push(facet));
        facets
    }

    /// Signed distance of a place of the own frame from the other surface, positive outside it.
    fn signed(&mut self, at: [f64; 3]) -> f64 {
        let point = self.search.surface.space.to_frame(self.own.space.to_world(at));
        let found = self.search.nearest(point, &Query::ANY);
        found.map_or(f64::INFINITY, |found| self.search.signed(point, &found))
    }

    /// Adds what of the box's surface lies in the other body; `deepest` is the most that its places can be inside, if the
    /// whole box is.
    fn shared(&mut self, place: OctreeBox, deepest: Option<f64>, shared: &mut Shared) {
        let mut deepest = deepest;
        if deepest.is_none_or(|deepest| deepest > shared.depth) {
            let (middle, half) = self.own.middle(place.low, place.level);
            let (reach, signed) = (dot(half, half).sqrt(), self.signed(middle));
            if signed > reach {
                return;
            }
            if deepest.is_some() || signed < -reach {
                deepest = Some(reach - signed);
            }
        }
        if place.level > 0 && !self.own.is_leaf(place) {
            for child in self.children(place) {
                self.shared(child, deepest, shared);
            }
            return;
        }
        for facet in self.facets(place) {
            let (area, at) = facet.section();
            let inside = match deepest {
                Some(deepest) if deepest <= shared.depth => 1.0,
                _ => {
                    let signed = self.signed(at);
                    shared.depth = shared.depth.max(-signed);
                    // The part of a facet that is cut lies inside as far as its middle does, on the facet's scale.
                    if deepest.is_some() { 1.0 } else { (0.5 - signed / area.sqrt()).clamp(0.0, 1.0) }
                }
            };
            let (at, normal) = (self.own.space.to_world(at), self.own.space.direction_to_world(facet.normal));
            let from: [f64; 3] = std::array::from_fn(|a| at[a] - shared.origin[a]);
            shared.volume += inside * area * dot(from, normal) / 3.0;
        }
    }

    /// The least distance from the box's surface to the other one, and the place of the world where it is.
    fn nearest(&mut self, place: OctreeBox, best: &mut Option<(f64, [f64; 3])>) {
        if place.level == 0 || self.own.is_leaf(place) {
            for facet in self.facets(place) {
                let at = facet.section().1;
                let distance = self.signed(at).abs();
                if best.is_none_or(|(least, _)| distance < least) {
                    *best = Some((distance, self.own.space.to_world(at)));
                }
            }
            return;
        }
        let mut children: Vec<(f64, OctreeBox)> = Vec::new();
        for child in self.children(place) {
            let (middle, half) = self.own.middle(child.low, child.level);
            children.push((self.signed(middle).abs() - dot(half, half).sqrt(), child));
        }
        children.sort_by(|a, b| a.0.total_cmp(&b.0));
        for (bound, child) in children {
            if best.is_none_or(|(least, _)| bound < least) {
                self.nearest(child, best);
            }
        }
    }
}
