//! A brick of cells with planes: all pairs of its cells and the rays near it, compared at once by `pairs`.
//!
//! ```text
//! rays near the brick --list--> pairs (ray, cell), the cells of a ray front to back
//!   --compare, sixteen at a time--> past, within, or not sure
//!   --from the last pair to the first--> what each ray meets first: written last, so no pair is asked for its ray's others
//! ```
//!
//! A ray whose first pair other than past is unsure goes on alone from there, box by box. The times of hits within are
//! computed at the tile's end, a row at a time: by the same integers as box by box, so they have the same bits.

use crate::cpu::{Lanes, SINGLES};
use crate::geom::NodeIndex;
use crate::load::{BrickCodes, CellItems, NodeView};
use crate::render::occupancy::Brick;
use crate::render::pairs::{self, CELLS, LISTED, Planes};
use crate::render::surface::Surface;

use super::beam::{Beam, RAYS, TILE};
use super::listed::Source;
use super::walk::Walk;
use super::words::Words;

/// Most pairs of a tile and a brick.
const ROOM: usize = RAYS * LISTED;

/// The pairs of a brick, and the planes that the rays of the tile have met.
pub(super) struct Pairs {
    places: [u8; ROOM],
    rays: [u8; ROOM],
    /// Cells that a ray's line intersects, and the lowest one of each larger leaf.
    pub(super) boxes: [u64; RAYS],
    /// Buffer for cells at the end of the model, and for larger leaves behind a brick's cells.
    pub(super) room: BrickCodes,
    pub(super) leaf_places: [u8; 8],
    pub(super) words: Words,
    /// Mask of rays that meet a plane.
    pub(super) met: u64,
    /// The plane, as in [`crate::render::pairs::Compared`], and its box, 16 bits an axis and for its edge; 0 for other
    /// rays.
    pub(super) planes: [u64; RAYS],
    pub(super) lows: [u64; RAYS],
    /// Positions of the cells.
    pub(super) at: [u8; RAYS],
}

impl Pairs {
    pub(super) const fn new() -> Self {
        Self {
            places: [0; ROOM],
            rays: [0; ROOM],
            boxes: [0; RAYS],
            room: BrickCodes::NONE,
            leaf_places: [0; 8],
            words: Words::new(),
            met: 0,
            planes: [0; RAYS],
            lows: [0; RAYS],
            at: [0; RAYS],
        }
    }

    /// Forgets the previous tile.
    pub(super) fn clear(&mut self) {
        self.met = 0;
        self.planes = [0; RAYS];
    }
}

/// Coordinates of a cell in 16 bits each: coordinates of the grid are below 2^16.
#[inline(always)]
pub(super) fn packed(cell: [u32; 3]) -> u64 {
    u64::from(cell[0]) | u64::from(cell[1]) << 16 | u64::from(cell[2]) << 32
}

/// An edge in the bits above [`packed`] cells.
#[inline(always)]
pub(super) fn packed_edge(edge_log2: u32) -> u64 {
    1_u64.wrapping_shl(48 + edge_log2)
}

/// [`packed`] positions within a brick.
pub(super) static PLACES: [u64; 64] = {
    let mut packed = [0; 64];
    let mut v = 0;
    while v < 64 {
        let mut axis = 0;
        while axis < 3 {
            packed[v] |= ((v >> axis & 1) | (v >> (axis + 2) & 2)) as u64 * (1 << (16 * axis));
            axis += 1;
        }
        v += 1;
    }
    packed
};

impl<S: Surface, R: Source> Walk<'_, S, R> {
    /// [`Walk::rays_of_brick`] for a brick of the finest cells that is nowhere behind a ray.
    #[inline(always)]
    pub(super) fn planes_of_brick<L: Lanes>(
        &mut self,
        beam: &Beam<L>,
        items: &CellItems<'_>,
        brick: &Brick,
        low: [u32; 3],
        near: u64,
        live: &mut u64,
    ) {
        let (listed, crowded) = self.list(beam, brick, low, near);
        if listed == 0 && crowded == 0 {
            return;
        }
        let l = beam.lanes;
        let first = brick.first(self.view);
        let planes = self.planes_in(l, items, brick, first);
        let pairs = &mut *self.pairs;
        let lines = beam.lines(self.rays);
        let corner = packed(low);
        let (mut met, mut unsure) = (0_u64, 0_u64);
        for group in (0..listed.div_ceil(SINGLES)).rev() {
            let of_list = listed - group * SINGLES;
            let (Some(places), Some(rays)) = (
                pairs.places.as_chunks::<SINGLES>().0.get(group),
                pairs.rays.as_chunks::<SINGLES>().0.get(group),
            ) else {
                continue;
            };
            let compared = pairs::compare(l, &planes, &lines, places, rays);
            let pairs_here = if of_list < SINGLES { (1 << of_list) - 1 } else { 0xffff };
            let mut open = !compared.past & pairs_here;
            while open != 0 {
                let i = 31_u32.wrapping_sub(open.leading_zeros()) as usize % SINGLES;
                open ^= 1 << i;
                let (v, ray) = (places[i] % 64, usize::from(rays[i]) % RAYS);
                met |= 1 << ray;
                unsure = unsure & !(1 << ray) | u64::from(!compared.within >> i & 1) << ray;
                let number = planes.number[usize::from(v)];
                let is_larger = number >= planes.cells;
                let of_cell = first.wrapping_add(u64::from(number));
                self.hits.number[ray] = if is_larger { brick.leaf(v.into()).0 } else { of_cell };
                pairs.planes[ray] = u64::from(compared.planes[i]);
                pairs.lows[ray] =
                    corner.wrapping_add(PLACES[usize::from(v)]) | packed_edge(u32::from(is_larger));
                pairs.at[ray] = v;
            }
        }
        met &= !unsure;
        pairs.met |= met;
        let mut alone = unsure | crowded;
        while alone != 0 {
            let ray = alone.trailing_zeros() as usize % RAYS;
            alone &= alone.wrapping_sub(1);
            let from = if unsure >> ray & 1 == 1 { self.pairs.at[ray] } else { 0 };
            let boxes = self.pairs.boxes[ray] & u64::MAX.wrapping_shl(u32::from(from));
            self.pairs.planes[ray] = 0;
            met |= u64::from(self.box_by_box(beam, brick, (first, low), (ray, boxes), 0)) << ray;
        }
        *live &= !met;
    }

    /// The planes of a brick whose first cell is `first`: of its cells, then of its larger leaves.
    #[inline(always)]
    #[expect(clippy::cast_possible_truncation, reason = "at most 64 cells and leaves")]
    fn planes_in<L: Lanes>(&mut self, l: L, items: &CellItems<'_>, brick: &Brick, first: u64) -> Planes {
        let Pairs { room, leaf_places, .. } = &mut *self.pairs;
        let cell = first.wrapping_sub(self.view.node_count());
        if brick.larger == 0 {
            let (codes, offsets) = items.brick(cell, room);
            return pairs::planes(l, codes, offsets, brick.stored, brick.flip);
        }
        items.copy_brick(cell, room);
        let cells = brick.stored.count_ones();
        let (leaf, leaves) = brick.leaves(leaf_places);
        self.view.append_leaves(NodeIndex::new(leaf), (cells as usize, leaves), room);
        let mut planes = pairs::planes(l, &room.normals, &room.offsets, brick.stored, brick.flip);
        planes.cells = cells as u8;
        for (i, place) in leaf_places.iter().take(leaves).enumerate() {
            planes.number[usize::from(*place) % CELLS] = planes.cells.wrapping_add(i as u8);
        }
        planes
    }

    /// Lists the pairs of the rays `near` a brick: their number, and rays with too many boxes, which are left out.
    #[inline(always)]
    #[expect(clippy::cast_possible_truncation, reason = "rays are below 64")]
    fn list<L: Lanes>(&mut self, beam: &Beam<L>, brick: &Brick, low: [u32; 3], near: u64) -> (usize, u64) {
        let pairs = &mut *self.pairs;
        let (mut near, mut listed, mut crowded) = (near, 0, 0);
        while near != 0 {
            let ray = near.trailing_zeros() as usize % RAYS;
            near &= near.wrapping_sub(1);
            self.hits.steps[ray] = self.hits.steps[ray].wrapping_add(1);
            let mut boxes = brick.boxes & beam.intersected_by(self.rays, ray, low, false);
            if brick.larger != 0 {
                boxes = brick.leaf_by_leaf(boxes);
            }
            pairs.boxes[ray] = boxes;
            let count = boxes.count_ones() as usize;
            let places = pairs.places.get_mut(listed..).and_then(<[u8]>::first_chunk_mut);
            let rays = pairs.rays.get_mut(listed..).and_then(<[u8]>::first_chunk_mut);
            if let (true, Some(places), Some(rays)) = (count <= LISTED, places, rays) {
                pairs::list(beam.lanes, boxes, places);
                *rays = [ray as u8; LISTED];
                listed = listed.wrapping_add(count);
            } else {
                crowded |= 1 << ray;
            }
        }
        (listed, crowded)
    }

    /// Computes the hits of the rays with the listed planes; returns the rays whose exact ray is unknown.
    #[inline(always)]
    pub(super) fn planes_met<L: Lanes>(&mut self, l: L, mirror: u32, depth: u32) -> u64 {
        let met = self.pairs.met;
        for row in (0..TILE).filter(|row| met >> (TILE * row) & 0xff != 0) {
            self.exact.prepare(l, self.source, self.tile.corner, mirror, depth, row * TILE);
            let (planes, lows) = (&self.pairs.planes.as_chunks().0[row], &self.pairs.lows.as_chunks().0[row]);
            self.exact.meet_planes(l, row, (planes, lows), self.hits);
        }
        if self.view.has_leaves() {
            self.edges_of(met);
        }
        let valid = met & self.exact.valid();
        self.hits.hits |= valid;
        met & !valid
    }

    /// Sets the edges of the boxes in which these rays meet planes.
    fn edges_of(&mut self, met: u64) {
        let mut rays = met;
        while rays != 0 {
            let ray = rays.trailing_zeros() as usize % RAYS;
            rays &= rays.wrapping_sub(1);
            let edge = self.pairs.lows[ray] >> 48;
            self.hits.edge_log2[ray] = edge.trailing_zeros().to_le_bytes()[0];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::occupancy::place;

    #[test]
    fn packed_places_are_places() {
        for v in 0..64 {
            assert_eq!(PLACES[v as usize], packed(place(v)));
        }
    }
}
