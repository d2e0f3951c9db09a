//! One row of boxes: those that a ray can be in, given the boxes that it can have come from.
//!
//! Rows are taken in the direction of the rays: bit 0 of word 0 is the box that they reach first. A ray that goes up
//! along all axes enters a box from one of the seven boxes around its lower corner. Where it enters through open
//! space, it can go on:
//!
//! ```text
//!   lit(x, y, z)  =  OR over steps s of  lit((x, y, z) - s)  AND  open(s)
//! ```
//!
//! A voxel outside is open from everywhere. For cells, a face, an edge or a corner is open if one of its samples is
//! outside: where all are inside, it lies in the solid, as every inside sample lies behind the plane of its cell.
//! Along x one carry of an addition goes through all open boxes of a word at once.

/// Outside samples in the four rows around a row of cells: *near* is the side that rays come from. Voxels only use
/// their own row, the last one.
#[derive(Clone, Copy)]
pub(super) struct Air<'a> {
    pub(super) near_both: &'a [u64],
    pub(super) near_y: &'a [u64],
    pub(super) near_z: &'a [u64],
    pub(super) far: &'a [u64],
}

/// A row that is lit, and whether the box before its first one is.
#[derive(Clone, Copy)]
pub(super) struct Lit<'a> {
    pub(super) row: &'a [u64],
    pub(super) before: bool,
}

/// The rows that rays come from.
#[derive(Clone, Copy)]
pub(super) struct Upstream<'a> {
    /// True if the box before the first of this row is lit.
    pub(super) before: bool,
    pub(super) y: Lit<'a>,
    pub(super) z: Lit<'a>,
    pub(super) yz: Lit<'a>,
}

/// A row that is also read shifted by one box.
struct Shifted<'a> {
    row: &'a [u64],
    carry: u64,
}

impl<'a> Shifted<'a> {
    fn new(row: &'a [u64], before: bool) -> Self {
        Self { row, carry: before.into() }
    }

    fn lit(lit: Lit<'a>) -> Self {
        Self::new(lit.row, lit.before)
    }

    /// Word `i` of the row, and of the row shifted by one box.
    #[inline(always)]
    fn next(&mut self, i: usize) -> (u64, u64) {
        let word = self.row[i];
        let before = word << 1 | self.carry;
        self.carry = word >> 63;
        (word, before)
    }
}

/// Writes the lit boxes of the row, and the boxes that a ray can enter at all, both within `region`. Rays begin in the
/// boxes of `start`. Without `along_x` rays stay in their column.
pub(super) fn sweep<const CELLS: bool>(
    along_x: bool,
    air: &Air<'_>,
    upstream: &Upstream<'_>,
    (region, start): (&[u64], &[u64]),
    lit: &mut [u64],
    entered: &mut [u64],
) {
    let steps = if along_x { u64::MAX } else { 0 };
    let (mut y, mut z, mut yz) =
        (Shifted::lit(upstream.y), Shifted::lit(upstream.z), Shifted::lit(upstream.yz));
    // The sample before the first is outside.
    let mut samples = [air.near_both, air.near_y, air.near_z, air.far].map(|row| Shifted::new(row, true));
    let mut own = u64::from(upstream.before);
    for (i, (lit, entered)) in lit.iter_mut().zip(entered.iter_mut()).enumerate() {
        let ((y, by_y), (z, by_z), (yz, by_yz)) = (y.next(i), z.next(i), yz.next(i));
        let [by_y, by_z, by_yz] = [by_y, by_z, by_yz].map(|word| word & steps);
        let direct = (y | by_y | z | by_z | yz | by_yz) & region[i];
        let reached = if CELLS {
            let [(nn, nn1), (nf, nf1), (fn_, fn1), (_, ff1)] = samples.each_mut().map(|s| s.next(i));
            let (face_y, face_z, edge) = (nn | nf | nn1 | nf1, nn | fn_ | nn1 | fn1, nn | nn1);
            let seeds =
                y & face_y | by_y & (nn1 | nf1) | z & face_z | by_z & (nn1 | fn1) | yz & edge | by_yz & nn1;
            carry(seeds & region[i] | start[i], (nn1 | nf1 | fn1 | ff1) & region[i] & steps, own)
        } else {
            let open = air.far[i] & region[i];
            carry(direct & open | start[i], open & steps, own)
        };
        *entered = (direct | (reached << 1 | own) & steps) & region[i] | reached;
        *lit = reached;
        own = reached >> 63;
    }
}

/// Bits that are set, or that are open and have a lower neighbour (of bit 0: `before`) that becomes set.
#[inline(always)]
fn carry(set: u64, open: u64, before: u64) -> u64 {
    // An addition carries out of a place where both bits are 1, or where one is and a carry comes in.
    let either = set | open;
    let sum = either.wrapping_add(set).wrapping_add(before);
    set | either & !sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    fn bit(row: &[u64], i: usize) -> bool {
        row[i / 64] >> (i % 64) & 1 == 1
    }

    #[test]
    fn rows_are_those_of_the_rule_bit_by_bit() {
        let mut random = Random(11);
        const WORDS: usize = 3;
        for round in 0..400 {
            let mut row = |thin: u32| -> Vec<u64> {
                (0..WORDS).map(|_| (0..thin).fold(u64::MAX, |m, _| m & random.bits())).collect()
            };
            let (mostly, air) = (round % 3, [row(round % 2), row(1), row(2), row(round % 3)]);
            let rows = [row(mostly + 1), row(3), row(4)];
            let region = if round % 5 == 0 { row(1) } else { vec![u64::MAX; WORDS] };
            let start = if round % 4 == 0 { row(6) } else { vec![0; WORDS] };
            let before: [bool; 4] = std::array::from_fn(|i| round >> i & 1 == 1);
            for (cells, along_x) in [(false, true), (true, true), (false, false), (true, false)] {
                let lit = |i: usize| Lit { row: &rows[i], before: before[i] };
                let upstream = Upstream { before: before[3], y: lit(0), z: lit(1), yz: lit(2) };
                let around = Air { near_both: &air[0], near_y: &air[1], near_z: &air[2], far: &air[3] };
                let (mut got, mut entered) = ([0; WORDS], [0; WORDS]);
                if cells {
                    sweep::<true>(along_x, &around, &upstream, (&region, &start), &mut got, &mut entered);
                } else {
                    sweep::<false>(along_x, &around, &upstream, (&region, &start), &mut got, &mut entered);
                }
                let mut own = before[3];
                for i in 0..64 * WORDS {
                    let at = |row: &[u64], first: bool, dx: usize| {
                        i.checked_sub(dx).map_or(first, |i| bit(row, i))
                    };
                    // Sample of row y, z (1: the near one), `dx` before.
                    let sample = |y: usize, z: usize, dx: usize| at(&air[3 - 2 * y - z], true, dx);
                    let (mut is_lit, mut is_entered) = (false, false);
                    for (dx, dy, dz) in (1..8).map(|s| (s & 1, s >> 1 & 1, s >> 2)) {
                        if dx == 1 && !along_x {
                            continue;
                        }
                        let from = match (dy, dz) {
                            (0, 0) => own,
                            (1, 0) => at(&rows[0], before[0], dx),
                            (0, 1) => at(&rows[1], before[1], dx),
                            _ => at(&rows[2], before[2], dx),
                        };
                        // Samples common to both boxes: along a step its near side, else both.
                        let sides = |step: usize| if step == 1 { 1..2 } else { 0..2 };
                        let open = if cells {
                            sides(dy).any(|y| sides(dz).any(|z| sides(dx).any(|x| sample(y, z, x))))
                        } else {
                            bit(&air[3], i)
                        };
                        is_entered |= from;
                        is_lit |= from && open;
                    }
                    is_lit = is_lit && bit(&region, i) || bit(&start, i);
                    is_entered = is_entered && bit(&region, i) || is_lit;
                    assert_eq!((bit(&got, i), bit(&entered, i)), (is_lit, is_entered), "{round} {cells} {i}");
                    own = is_lit;
                }
            }
        }
    }
}
