//! [`super::planes`] without gathers, for machines that gather slowly: a word for each plane, a word for each pair.
//!
//! ```text
//! rays near the brick --boxes of each--> decode the brick once: a word a cell, at its place
//!   --list: plane and pair, two words--> batches of 64 pairs, no ray in two
//!   --compare, sixteen at a time--> 64 bits each of what is open and what is within
//!   --a bit scan a ray--> its first open pair
//! ```
//!
//! # Slack
//!
//! The comparison is that of `pairs`; but a ray's direction and its e at the brick's middle are computed from its
//! column x and row y, both below 8, as `v = c + x p + y q`, with c, p and q rounded to singles and four operations.
//! With u = 2^-24 and m = |c| + 7 |p| + 7 |q|, the rounded numbers and the products move v by 2 u m at most, the two
//! sums by 2 u m more. For directions m is below 3 times the longest component, so that is below 2^-20. For e, |v| is
//! at most 5 near the brick, so m is below 5 + 14 (|p| + |q|), and 4 u m below `(8 + 14 change) 2^-21`, which the slack
//! S of a beam holds for that rounding, `change` being the greatest |p| + |q|. So at a cell near the brick e is off by
//! at most S, and so is each component of d, which is all that the proof in `pairs` requires.

use crate::cpu::{Lanes, SINGLES, Truths};
use crate::geom::NodeIndex;
use crate::load::{CellItems, NodeView};
use crate::render::occupancy::Brick;
use crate::render::pairs::{LISTED, SLACKS};
use crate::render::surface::Surface;

use super::beam::{Beam, RAYS};
use super::listed::Source;
use super::planes::{PLACES as PACKED, Pairs, packed, packed_edge};
use super::walk::Walk;

/// Pairs that are compared together: results are the bits of two integers.
const BATCH: usize = 64;

/// Pairs that are listed together, without a branch.
const STEP: usize = 4;

/// Bits of a pair's word: the ray, then the position of the cell, two bits an axis, the mark of a larger leaf, and the
/// number of the position.
const PLACE: u32 = 8;
const LARGER: u32 = 1 << 14;
const NUMBER: u32 = 16;

/// Words of positions within a brick.
static PLACES: [u32; 64] = {
    let mut words = [0; 64];
    let mut v = 0_u32;
    while v < 64 {
        words[v as usize] = v << NUMBER;
        let mut axis = 0;
        while axis < 3 {
            words[v as usize] |= ((v >> axis & 1) | (v >> (axis + 2) & 2)) << (PLACE + 2 * axis);
            axis += 1;
        }
        v += 1;
    }
    words
};

/// Pairs of a brick, a batch at a time, one ray's after another's. Memory: 1.2 KiB.
#[repr(align(64))]
pub(super) struct Words {
    /// Planes at the positions of their cells, as in `Compared`, and words of the positions.
    at: [[u32; 2]; 64],
    planes: [u32; BATCH + SINGLES],
    pairs: [u32; BATCH + SINGLES],
    count: usize,
    /// Masks of each ray's first pair, and of its last one.
    first: u64,
    last: u64,
}

/// Affine functions of the pixel, by axis or by pair: at (0, 0), and their changes with x and y.
pub(super) struct Affines {
    direction: [[f32; 3]; 3],
    beside: [[f32; 3]; 3],
    slack: f32,
}

impl Affines {
    #[expect(clippy::cast_possible_truncation, reason = "estimates within SLACK")]
    pub(super) fn new(direction: &[[f64; 3]; 3], beside: &[[f64; 3]; 3], slack: f32) -> Self {
        Self {
            direction: each3!(A => [direction[0][A] as f32, direction[1][A] as f32, direction[2][A] as f32]),
            beside: each3!(PAIR => [beside[PAIR][0] as f32, beside[PAIR][1] as f32, beside[PAIR][2] as f32]),
            slack: SLACKS * slack,
        }
    }
}

/// Certain results of sixteen pairs: bits of the pairs past, and of the pairs within.
#[inline(always)]
fn compare<L: Lanes>(
    l: L,
    lines: &Affines,
    planes: &[u32; SINGLES],
    pairs: &[u32; SINGLES],
    any_larger: bool,
) -> [u32; 2] {
    let (x, y) = (l.f_field(pairs, 0, 7), l.f_field(pairs, 3, 7));
    let d = each3!(A => {
        let [at, by_x, by_y] = lines.direction[A];
        l.f(at) + x * l.f(by_x) + y * l.f(by_y)
    });
    let e = each3!(PAIR => {
        let [at, by_x, by_y] = lines.beside[PAIR];
        l.f(at) + x * l.f(by_x) + y * l.f(by_y)
    });
    let n = each3!(A => l.f_field(planes, [0, 8, 16][A], 0xff) - l.f(128.0));
    let offset = l.f_field(planes, 24, 0xff);
    let has_plane = l.f_le(l.f(1.0), offset);
    let mut o = each3!(A => l.f_field(pairs, PLACE + [0, 2, 4][A], 3) - l.f(1.5));
    let (mut half_edge, mut slack) = (l.f(0.5), l.f(lines.slack));
    if any_larger {
        let more = l.f_field(pairs, LARGER.trailing_zeros(), 1) * l.f(0.5);
        o = each3!(A => o[A] + more);
        half_edge = half_edge + more;
        slack = slack * (half_edge + half_edge);
    }
    let e_xy = e[0] + o[0] * d[1] - o[1] * d[0];
    let e_xz = e[1] + o[0] * d[2] - o[2] * d[0];
    let e_yz = e[2] + o[1] * d[2] - o[2] * d[1];
    let (zero, k) = (l.f(0.0), (offset - l.f(128.0)) * half_edge);
    let at_x = n[1] * e_xy + n[2] * e_xz - d[0] * k;
    let at_y = n[2] * e_yz - n[0] * e_xy - d[1] * k;
    let at_z = zero - n[0] * e_xz - n[1] * e_yz - d[2] * k;
    let s = n[0] * d[0] + n[1] * d[1] + n[2] * d[2];
    let half = l.f_abs(s) * half_edge;
    let (beyond, inner) = (half + slack, half - slack);
    let past = l.f_le(beyond, at_x) | l.f_le(beyond, at_y) | l.f_le(beyond, at_z);
    let within = l.f_le(l.f_abs(at_x), inner)
        & l.f_le(l.f_abs(at_y), inner)
        & l.f_le(l.f_abs(at_z), inner)
        & l.f_le(s, zero);
    [(past & has_plane).bits(), (within & has_plane).bits()]
}

impl Words {
    pub(super) const fn new() -> Self {
        Self {
            at: [[0; 2]; 64],
            planes: [0; BATCH + SINGLES],
            pairs: [0; BATCH + SINGLES],
            count: 0,
            first: 0,
            last: 0,
        }
    }

    fn clear(&mut self) {
        (self.count, self.first, self.last) = (0, 0, 0);
    }

    /// Puts the planes of a brick at their positions, mirrored, from codes and offsets in stored order.
    #[inline(always)]
    fn decode(&mut self, codes: &[[u8; 2]; 64], offsets: &[u8; 64], (stored, flip): (u64, u32)) {
        let mut words = [0; 64];
        // A plain loop over groups of eight cells, which is vectorised.
        let cells = (stored.count_ones() as usize).next_multiple_of(8);
        for ((word, code), offset) in words.iter_mut().zip(codes).zip(offsets).take(cells) {
            *word = plane_word(*code, *offset, flip);
        }
        let (mut rest, mut number) = (stored, 0);
        while rest != 0 {
            let v = (rest.trailing_zeros() ^ flip) as usize % 64;
            rest &= rest.wrapping_sub(1);
            self.at[v] = [words[number % 64], PLACES[v]];
            number += 1;
        }
    }

    /// Adds the pairs of a ray and its boxes, from one to [`LISTED`] of them.
    #[inline(always)]
    #[expect(clippy::cast_possible_truncation, reason = "below 64")]
    fn list(&mut self, ray: usize, boxes: u64) {
        let (mut at, mut rest) = (self.count % BATCH, boxes);
        self.first |= 1 << at;
        self.count = at + boxes.count_ones() as usize;
        self.last |= 1 << (self.count.wrapping_sub(1) % BATCH);
        loop {
            let planes = self.planes.get_mut(at..).and_then(<[u32]>::first_chunk_mut::<STEP>);
            let pairs = self.pairs.get_mut(at..).and_then(<[u32]>::first_chunk_mut::<STEP>);
            let (Some(planes), Some(pairs)) = (planes, pairs) else { return };
            for i in 0..STEP {
                let [plane, word] = self.at[rest.trailing_zeros() as usize % 64];
                rest &= rest.wrapping_sub(1);
                (planes[i], pairs[i]) = (plane, word | ray as u32);
            }
            if rest == 0 {
                return;
            }
            at += STEP;
        }
    }

    /// Of a mask of pairs, the first one of each ray.
    ///
    /// Where a pair is neither in the mask nor its ray's last, the complement has a 1: adding 1 at a ray's first pair
    /// carries to the first one that is, and never on to the next ray.
    #[inline(always)]
    fn first_of_rays(&self, mask: u64) -> u64 {
        let stops = mask | self.last;
        (!stops).wrapping_add(self.first) & mask
    }

    /// Masks of the pairs that are not past, and of those within.
    #[inline(always)]
    #[expect(clippy::cast_possible_truncation, reason = "below 64")]
    fn compared<L: Lanes>(&self, l: L, lines: &Affines, any_larger: bool) -> [u64; 2] {
        let (mut past, mut within) = (0, 0);
        let groups = self.planes.as_chunks().0.iter().zip(self.pairs.as_chunks().0);
        for (group, (planes, pairs)) in groups.enumerate().take(self.count.div_ceil(SINGLES)) {
            let bits = compare(l, lines, planes, pairs, any_larger);
            let shift = (SINGLES * group) as u32;
            past |= u64::from(bits[0]).wrapping_shl(shift);
            within |= u64::from(bits[1]).wrapping_shl(shift);
        }
        [!past, within]
    }
}

/// A plane in a word: normal by axis, mirrored, and offset in a byte each, plus 128.
#[inline(always)]
fn plane_word(code: [u8; 2], offset: u8, flip: u32) -> u32 {
    let least = |byte: u8| i32::from(byte.cast_signed()).max(-127);
    let (u, v) = (least(code[0]), least(code[1]));
    // Same as `normal::decode_l1`.
    let (beside_u, beside_v) = (127 - u.abs(), 127 - v.abs());
    let z = beside_u - v.abs();
    let x = if z < 0 { if u < 0 { -beside_v } else { beside_v } } else { u };
    let y = if z < 0 { if v < 0 { -beside_u } else { beside_u } } else { v };
    let turned = |c: i32, axis: u32| {
        let sign = -((flip >> axis & 1).cast_signed());
        ((c ^ sign) - sign + 128).cast_unsigned()
    };
    turned(x, 0) | turned(y, 1) << 8 | turned(z, 2) << 16 | u32::from(offset ^ 0x80) << 24
}

impl Pairs {
    /// Notes where the rays of pairs that are not sure go on by themselves; returns the rays.
    #[inline(always)]
    fn left_alone(&mut self, of_batch: u64) -> u64 {
        let (mut rest, mut unsure) = (of_batch, 0_u64);
        while rest != 0 {
            let word = self.words.pairs[rest.trailing_zeros() as usize % BATCH];
            rest &= rest.wrapping_sub(1);
            let ray = word as usize % RAYS;
            self.at[ray] = (word >> NUMBER & 63) as u8;
            unsure |= 1 << ray;
        }
        unsure
    }
}

impl<S: Surface, R: Source> Walk<'_, S, R> {
    /// [`Walk::rays_of_brick`] for a brick of the finest cells that is nowhere behind a ray.
    #[inline(always)]
    pub(super) fn words_of_brick<L: Lanes>(
        &mut self,
        beam: &Beam<L>,
        items: &CellItems<'_>,
        brick: &Brick,
        low: [u32; 3],
        near: u64,
        live: &mut u64,
    ) {
        let (mut left, mut meeting) = (near, 0_u64);
        while left != 0 {
            let ray = left.trailing_zeros() as usize % RAYS;
            left &= left.wrapping_sub(1);
            self.hits.steps[ray] = self.hits.steps[ray].wrapping_add(1);
            let mut boxes = brick.boxes & beam.intersected_by(self.rays, ray, low, false);
            if brick.larger != 0 {
                boxes = brick.leaf_by_leaf(boxes);
            }
            self.pairs.boxes[ray] = boxes;
            meeting |= u64::from(boxes != 0) << ray;
        }
        if meeting == 0 {
            return;
        }
        let first = brick.first(self.view);
        self.decode(items, brick, first);
        let lines = beam.affines(low);
        let (mut met, mut alone) = (0_u64, 0_u64);
        while meeting != 0 {
            self.pairs.words.clear();
            while meeting != 0 && self.pairs.words.count <= BATCH - LISTED {
                let ray = meeting.trailing_zeros() as usize % RAYS;
                meeting &= meeting.wrapping_sub(1);
                let boxes = self.pairs.boxes[ray];
                if boxes.count_ones() as usize <= LISTED {
                    self.pairs.words.list(ray, boxes);
                } else {
                    self.pairs.at[ray] = 0;
                    alone |= 1 << ray;
                }
            }
            let [open, within] = self.pairs.words.compared(beam.lanes, &lines, brick.larger != 0);
            let met_first = self.pairs.words.first_of_rays(open);
            let sure = self.meet_planes_of(brick, (first, low), met_first & within);
            let unsure = self.pairs.left_alone(met_first & !within);
            met |= sure;
            alone |= unsure;
        }
        self.pairs.met |= met;
        while alone != 0 {
            let ray = alone.trailing_zeros() as usize % RAYS;
            alone &= alone.wrapping_sub(1);
            let boxes = self.pairs.boxes[ray] & u64::MAX.wrapping_shl(u32::from(self.pairs.at[ray]));
            self.pairs.planes[ray] = 0;
            met |= u64::from(self.box_by_box(beam, brick, (first, low), (ray, boxes), 0)) << ray;
        }
        *live &= !met;
    }

    /// Notes the planes of pairs that rays certainly meet first; returns the rays.
    #[inline(always)]
    fn meet_planes_of(&mut self, brick: &Brick, (first, low): (u64, [u32; 3]), of_batch: u64) -> u64 {
        let pairs = &mut *self.pairs;
        let corner = packed(low);
        let (mut rest, mut sure) = (of_batch, 0_u64);
        while rest != 0 {
            let at = rest.trailing_zeros() as usize % BATCH;
            rest &= rest.wrapping_sub(1);
            let word = pairs.words.pairs[at];
            let (ray, v) = (word as usize % RAYS, word >> NUMBER & 63);
            sure |= 1 << ray;
            let is_larger = word & LARGER != 0;
            self.hits.number[ray] =
                if is_larger { brick.leaf(v).0 } else { first.wrapping_add(brick.before(v)) };
            pairs.planes[ray] = u64::from(pairs.words.planes[at]);
            pairs.lows[ray] = corner.wrapping_add(PACKED[v as usize]) | packed_edge(u32::from(is_larger));
        }
        sure
    }

    /// Puts the planes of a brick and of its larger leaves at their positions; the brick's first cell is `first`.
    #[inline(always)]
    fn decode(&mut self, items: &CellItems<'_>, brick: &Brick, first: u64) {
        let pairs = &mut *self.pairs;
        let cell = first.wrapping_sub(self.view.node_count());
        let (codes, offsets) = items.brick(cell, &mut pairs.room);
        pairs.words.decode(codes, offsets, (brick.stored, brick.flip));
        if brick.larger == 0 {
            return;
        }
        let (leaf, leaves) = brick.leaves(&mut pairs.leaf_places);
        self.view.append_leaves(NodeIndex::new(leaf), (0, leaves), &mut pairs.room);
        for (i, place) in pairs.leaf_places.iter().take(leaves).enumerate() {
            let (v, room) = (usize::from(*place) % 64, &pairs.room);
            let plane = plane_word(room.normals[i % 64], room.offsets[i % 64], brick.flip);
            pairs.words.at[v] = [plane, PLACES[v] | LARGER];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::normal;
    use crate::render::occupancy::place;

    #[test]
    fn words_hold_planes_and_places() {
        for v in 0..64_u32 {
            let at = place(v);
            assert_eq!(PLACES[v as usize], at[0] << 8 | at[1] << 10 | at[2] << 12 | v << 16);
        }
        for code in 0..=u16::MAX {
            let n = normal::decode_l1(code);
            for flip in [0, 63, 9, 36] {
                let byte = |a: usize| if flip >> a & 1 == 1 { -n[a] } else { n[a] } + 128;
                let word = byte(0) | byte(1) << 8 | byte(2) << 16 | 1 << 24;
                assert_eq!(plane_word(code.to_le_bytes(), 0x81, flip), word.cast_unsigned());
            }
        }
    }
}
