//! Pairs of a ray and a cell with a plane, compared many at a time: only certain results are taken.
//!
//! # The comparison
//!
//! Coordinates are mirrored and in cells, with components of a direction d of at most 1. For a cell with its middle at
//! c and the plane `n . (p - c) = k / 2`, and a line from o along d, let `w = o - c`, `s = n . d`, and e be the e of
//! `tile`'s beam at c. The line crosses the plane at `c + at / -s` with `at = d (n . w - k / 2) - w s`, which is
//!
//! ```text
//! at_x =  n_y e_xy + n_z e_xz - d_x k / 2
//! at_y = -n_x e_xy + n_z e_yz - d_y k / 2
//! at_z = -n_x e_xz - n_y e_yz - d_z k / 2
//! ```
//!
//! * *Past* if some `at > |s| / 2`. With s < 0 the ray leaves by that face before the crossing; with s > 0 it enters by
//!   the opposite one after it; with s = 0 it is in front of the plane all along; where it does not move along the axis
//!   it runs beside the cell. Wherever it starts, it does not meet the space behind the plane in this cell.
//! * *Within* if s < 0 and all `|at| < |s| / 2`: the line crosses the plane strictly inside the cell, from the front to
//!   the back. That is the hit if the crossing lies ahead of the origin. It does for bricks that are not behind
//!   ([`super::tile`]): either the brick lies beyond all origins along an axis that the ray moves along, or the ray
//!   came in by a face of the grid, which no inner point of a cell lies behind.
//!
//! # Slack
//!
//! All that is in singles, by the tile's estimates of its rays. Let S be the slack of the beam, at least 2^-12: at a
//! cell near the brick e is off by at most S, and so is each component of d. Then, with sizes of n that sum up to 127,
//! the terms of e are off by 127 S, the term of d by 63.5 S, and half of s by 63.5 S; a line near the cell has
//! |e| <= 1 + S, so that sums are at most 256, and their eight roundings make 2^-13 < S at most. Together that is below
//! 256 S. Comparisons leave a margin of [`SLACKS`] times S: twice as much. Results within the margin, and cells with
//! corners, are uncertain and go on to integers.
//!
//! # Larger leaves
//!
//! For a leaf with an edge of 2 cells, c is the middle of its box and the plane `n . (p - c) = k`; the faces are at
//! `|s|`. All terms are at most twice as large, and so is the margin.

use crate::format::cell::HAS_CORNERS;
use crate::format::normal;

#[cfg(target_arch = "x86_64")]
use super::pairs_vbmi2;
use crate::cpu::{Lanes, SINGLES};

/// Cells of a brick, and rays of a tile.
pub(crate) const CELLS: usize = 64;
/// A brick without larger leaves.
pub(crate) const ALL_CELLS: u8 = 64;

/// Most listed cells of a brick for a ray; more are intersected along edges of cells only.
pub(crate) const LISTED: usize = 16;

/// Margin of a comparison, in slacks of the beam.
pub(crate) const SLACKS: f32 = 512.0;

/// The planes of a brick's cells, in mirrored coordinates of the rays.
#[derive(Clone, Debug, PartialEq, Eq)]
#[repr(align(64))]
pub(crate) struct Planes {
    /// Normals by axis, of the cells in stored order.
    pub(crate) normal: [[i8; CELLS]; 3],
    /// Offsets, or the mark of a cell with corners.
    pub(crate) offset: [i8; CELLS],
    /// Stored index of the cell at each mirrored position; 0 for an empty one.
    pub(crate) number: [u8; CELLS],
    /// Number of cells, at most [`CELLS`]; then follow larger leaves of 2 x 2 x 2 cells, at the position of their
    /// lowest one.
    pub(crate) cells: u8,
}

/// The lines of a tile's rays, about a brick.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Lines<'a> {
    /// Directions by axis.
    pub(crate) direction: &'a [[f32; CELLS]; 3],
    /// e of the brick's middle, by pair of axes.
    pub(crate) beside: &'a [[f32; CELLS]; 3],
    /// Margin of a comparison.
    pub(crate) slack: f32,
}

/// Certain results of sixteen pairs, as bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Compared {
    /// The ray does not meet the cell's surface.
    pub(crate) past: u32,
    /// The ray meets the plane within the cell, if that is ahead of it.
    pub(crate) within: u32,
    /// The planes: normal by axis and offset in a byte each, plus 128.
    pub(crate) planes: [u32; SINGLES],
}

/// Returns the result of VBMI2 where the lanes have it.
macro_rules! with_vbmi2 {
    ($lanes:ident, $function:ident($($argument:expr),*)) => {
        #[cfg(target_arch = "x86_64")]
        if let Some(vbmi2) = $lanes.vbmi2() {
            return pairs_vbmi2::$function(vbmi2, $($argument),*);
        }
        #[cfg(not(target_arch = "x86_64"))]
        let _ = $lanes;
    };
}

/// Positions of the first boxes, lowest first; the entries after them are undefined.
#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "below 64")]
pub(crate) fn list(lanes: impl Lanes, boxes: u64, places: &mut [u8; LISTED]) {
    with_vbmi2!(lanes, list(boxes, places));
    let mut rest = boxes;
    for place in places {
        *place = rest.trailing_zeros() as u8 % 64;
        rest &= rest.wrapping_sub(1);
    }
}

/// The planes of a brick by the codes of its cells; its boxes in stored order, and the exclusive-or from a stored
/// position to a mirrored one.
#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "components of L1-127 vectors; below 64")]
pub(crate) fn planes(
    lanes: impl Lanes,
    codes: &[[u8; 2]; CELLS],
    offsets: &[u8; CELLS],
    stored: u64,
    flip: u32,
) -> Planes {
    with_vbmi2!(lanes, planes(codes, offsets, stored, flip));
    let offset = offsets.map(u8::cast_signed);
    let mut planes = Planes { normal: [[0; CELLS]; 3], offset, number: [0; CELLS], cells: ALL_CELLS };
    for (i, code) in codes.iter().enumerate() {
        let normal = normal::decode_l1(u16::from_le_bytes(*code));
        for (a, of_axis) in planes.normal.iter_mut().enumerate() {
            of_axis[i] = (if flip >> a & 1 == 1 { -normal[a] } else { normal[a] }) as i8;
        }
    }
    let mut number = 0;
    for place in 0..CELLS as u32 {
        if stored >> place & 1 == 1 {
            planes.number[(place ^ flip) as usize % CELLS] = number;
            number += 1;
        }
    }
    planes
}

/// Distance of a position's middle from the brick's, along an axis.
#[inline(always)]
fn from_middle(place: u8, axis: usize) -> f32 {
    f32::from((place >> axis & 1) | (place >> (axis + 2) & 2)) - 1.5
}

/// Compares sixteen rays with a cell each.
#[inline(always)]
pub(crate) fn compare(
    lanes: impl Lanes,
    planes: &Planes,
    lines: &Lines<'_>,
    places: &[u8; SINGLES],
    rays: &[u8; SINGLES],
) -> Compared {
    with_vbmi2!(lanes, compare(planes, lines, places, rays));
    let mut compared = Compared { past: 0, within: 0, planes: [0; SINGLES] };
    for i in 0..SINGLES {
        let (place, ray) = (places[i] % 64, usize::from(rays[i]) % CELLS);
        let cell = usize::from(planes.number[usize::from(place)]) % CELLS;
        let (normal, offset) = (each3!(A => planes.normal[A][cell]), planes.offset[cell]);
        let bytes = [normal[0], normal[1], normal[2], offset].map(i8::cast_unsigned);
        compared.planes[i] = u32::from_le_bytes(bytes) ^ 0x8080_8080;

        let n = normal.map(f32::from);
        let d = each3!(A => lines.direction[A][ray]);
        let is_larger = planes.number[usize::from(place)] >= planes.cells;
        let (to_middle, edge) = if is_larger { (0.5, 2.0) } else { (0.0, 1.0) };
        let o = each3!(A => from_middle(place, A) + to_middle);
        let e = each3!(PAIR => lines.beside[PAIR][ray]);
        let e_xy = e[0] + o[0] * d[1] - o[1] * d[0];
        let e_xz = e[1] + o[0] * d[2] - o[2] * d[0];
        let e_yz = e[2] + o[1] * d[2] - o[2] * d[1];
        let k = f32::from(offset) * (0.5 * edge);
        let at_x = n[1] * e_xy + n[2] * e_xz - d[0] * k;
        let at_y = n[2] * e_yz - n[0] * e_xy - d[1] * k;
        let at_z = 0.0 - n[0] * e_xz - n[1] * e_yz - d[2] * k;
        let s = n[0] * d[0] + n[1] * d[1] + n[2] * d[2];
        let (half, slack) = (s.abs() * (0.5 * edge), lines.slack * edge);
        let (most, least) = (at_x.max(at_y).max(at_z), at_x.min(at_y).min(at_z));
        let has_plane = offset != HAS_CORNERS;
        let (beyond, inner) = (half + slack, half - slack);
        compared.past |= u32::from(has_plane && most > beyond) << i;
        compared.within |= u32::from(has_plane && s < 0.0 && most < inner && least > -inner) << i;
    }
    compared
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cpu::Portable;
    use crate::render::selfcheck::Random;

    #[test]
    #[expect(clippy::cast_possible_truncation, reason = "numbers made up")]
    fn what_is_sure_is_what_doubles_say_even_at_the_slack() {
        let mut random = Random::new(4);
        let (mut past, mut within) = (0, 0);
        for _ in 0..20_000 {
            let code = random.bits() as u16;
            let offset = random.bits() as i8;
            // A cell, or a larger leaf at the position of its lowest cell.
            let (edge, places) = if random.bits().is_multiple_of(3) { (2.0, 56) } else { (1.0, 63) };
            let place = random.bits() as u8 & places;
            let (o, d): ([f64; 3], [f64; 3]) = (
                [0.0; 3].map(|_: f64| edge * random.range(-0.5, 0.5)),
                [0.0; 3].map(|_: f64| random.range(0.0, 1.0)),
            );
            // The line passes at `o` from the box's middle; the brick's middle is offset from the box's.
            let slack = 1.0 / 4096.0;
            let middle: [f64; 3] =
                std::array::from_fn(|a| -f64::from(from_middle(place, a)) - 0.5 * (edge - 1.0));
            let mut beside = [[0.0; CELLS]; 3];
            for ((a, b), beside) in crate::render::occupancy::PAIRS.into_iter().zip(&mut beside) {
                let e = (middle[a] - o[a]) * d[b] - (middle[b] - o[b]) * d[a];
                beside[0] = (e + random.range(-slack, slack)) as f32;
            }
            let mut direction = [[0.0; CELLS]; 3];
            (0..3).for_each(|a| direction[a][0] = (d[a] + random.range(-slack, slack)) as f32);
            let lines = Lines { direction: &direction, beside: &beside, slack: SLACKS * slack as f32 };
            let mut planes =
                planes(Portable, &[code.to_le_bytes(); CELLS], &[offset.cast_unsigned(); CELLS], u64::MAX, 0);
            planes.cells = if edge > 1.0 { 0 } else { ALL_CELLS };
            let compared = compare(Portable, &planes, &lines, &[place; SINGLES], &[0; SINGLES]);
            let n = normal::decode_l1(code).map(f64::from);
            let dot = |v: [f64; 3]| n[0] * v[0] + n[1] * v[1] + n[2] * v[2];
            let (start, s) = (dot(o) - f64::from(offset) * edge / 2.0, dot(d));
            let at: [f64; 3] = std::array::from_fn(|a| d[a] * start - o[a] * s);
            let most = at.iter().fold(f64::MIN, |m, v| m.max(*v));
            let size = at.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
            if compared.past & 1 == 1 {
                assert!(most > s.abs() * edge / 2.0);
                past += 1;
            }
            if compared.within & 1 == 1 {
                assert!(s < 0.0 && size < -s * edge / 2.0);
                within += 1;
            }
        }
        assert!(past > 3000 && within > 500, "{past} {within}");
    }
}
