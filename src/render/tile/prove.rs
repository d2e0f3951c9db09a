//! A row of candidates decided exactly: rays as integers, eight at a time.
//!
//! The conditions are the same as in `mirrored_ray`, the results equal [`Passage::entry_hit`].
//!
//! [`Passage::entry_hit`]: crate::render::surface::Passage::entry_hit

use crate::cpu::{DOUBLES, Lanes, Truths};
use crate::render::occupancy::PAIRS;
use crate::render::pixel_rays::Row;
use crate::render::ray::FRACTION_BITS;

/// Entries of eight rays into their boxes.
pub(super) struct Entries {
    /// Mask of rays that enter their boxes.
    pub(super) proved: u32,
    /// Masks of rays that enter by a face of axis x, y, z; in none when a ray starts within its box.
    pub(super) by_axis: [u32; 3],
    /// Parameter of the entry.
    pub(super) t: [f64; DOUBLES],
}

/// 1.5 * 2^52: adding it to an integer leaves that integer in the low bits.
const WHOLE: f64 = 6_755_399_441_055_744.0;

/// Decides whether each ray enters the box with the lowest cell `low` (mirrored, as doubles) and an edge of
/// `2^unit` cells, in a grid of 2^depth.
#[inline(always)]
pub(super) fn entries<L: Lanes>(
    l: L,
    row: &Row<L>,
    mirror: u32,
    depth: u32,
    unit: u32,
    low: [&[f64; DOUBLES]; 3],
) -> Entries {
    let zero = l.d(0.0);
    let one_cell = f64::from(1_u32 << FRACTION_BITS);
    let far = l.d(f64::from(1_u32.wrapping_shl(depth)) * one_cell);
    let (mut origin, mut direction) = (row.origin, row.direction);
    for a in 0..3 {
        if mirror >> a & 1 == 1 {
            origin[a] = far - origin[a];
            direction[a] = zero - direction[a];
        }
    }
    let distance = each3!(A => l.d_load(low[A]) * l.d(one_cell) - origin[A]);
    let (offset, zeros) = (l.d(WHOLE), l.d_bits(l.d(WHOLE)));
    let n = each3!(A => l.d_bits(distance[A] + offset) - zeros);
    let d = each3!(A => l.d_bits(direction[A] + offset) - zeros);
    let moves = each3!(A => l.d_lt(zero, direction[A]));
    let positive = each3!(A => l.d_lt(zero, distance[A]));

    let edge = f64::from(1_u32.wrapping_shl(unit)) * one_cell;
    let mut proved = row.valid;
    for a in 0..3 {
        let ahead = l.d_lt(l.d(-edge), distance[a]);
        // Directions against the mirror were not estimated.
        let along = l.d_le(zero, direction[a]) & (moves[a] | !positive[a]);
        proved = proved & ahead & along;
    }
    // For a < b, e = n_a d_b - n_b d_a > 0 when a is crossed later than b.
    let mut e = [l.i(0); 3];
    let edge = l.i(1_i64.wrapping_shl(FRACTION_BITS + unit));
    for (pair, (a, b)) in PAIRS.into_iter().enumerate() {
        e[pair] = n[a] * d[b] - n[b] * d[a];
        let (most, least) = (d[a] * edge, d[b] * edge);
        let within = !l.i_gt(e[pair], most) & l.i_gt(e[pair] + least, l.i(0));
        proved = proved & (within | !(moves[a] & moves[b]));
    }
    // The first axis of the latest crossing.
    let counts = each3!(A => positive[A] & moves[A]);
    let y_later = counts[1] & (!counts[0] | l.i_gt(l.i(0), e[0]));
    let after_x = !counts[0] | l.i_gt(l.i(0), e[1]);
    let after_y = l.i_gt(l.i(0), e[2]);
    let z_later = counts[2] & ((y_later & after_y) | (!y_later & after_x));
    let by_z = z_later;
    let by_y = y_later & !z_later;
    let by_x = counts[0] & !y_later & !z_later;
    let crossed = by_x | by_y | by_z;
    let last_n = l.d_choose(by_z, distance[2], l.d_choose(by_y, distance[1], distance[0]));
    let last_d = l.d_choose(by_z, direction[2], l.d_choose(by_y, direction[1], direction[0]));
    let t = row.t_start + last_n / last_d * row.t_scale;
    let mut entries = Entries { proved: proved.bits() & 0xff, by_axis: [0; 3], t: [0.0; DOUBLES] };
    l.d_store(l.d_choose(crossed, t, row.t_start), &mut entries.t);
    let starts = !crossed;
    let axes = [by_x, by_y, by_z];
    entries.by_axis = each3!(A => (axes[A] | (starts & row.entry[A])).bits() & 0xff);
    entries
}
