//! Crossings of rows of voxel centres with triangles, in integers, and the bits that follow.
//!
//! A row runs along x through the centres of its voxels. Centres are moved by (-e, e^2, e^3), e infinitely small, so
//! that a centre never lies on a triangle nor a row on an edge: of the triangles around an edge exactly those are
//! crossed that a row next to it would cross.

use super::lattice::{HALF, STEPS, Triangle, first_centre, last_centre, span};

/// Least distance of a crossing in f64 from a whole number at which its neighbour is certain: errors are below 2^-33.
const SURE: f64 = 1e-6;

/// Calls `cross(row, column, sign)` for every row of slice `z`, of rows `from..to`, that crosses a triangle:
/// `column` is the first whose centre lies beyond, `sign` the direction of the triangle.
#[inline]
pub(crate) fn cross_slice(t: &Triangle, z: i32, from: i32, to: i32, cross: &mut impl FnMut(i32, i64, i32)) {
    let (low, high) = span(t, 1);
    let (first, last) = (first_centre(low).max(from), last_centre(high).min(to - 1));
    if first > last {
        return;
    }
    let corner = |k: usize| [i64::from(t[k]), i64::from(t[k + 1]), i64::from(t[k + 2])];
    let ([x0, y0, z0], [x1, y1, z1], [x2, y2, z2]) = (corner(0), corner(3), corner(6));
    let area = (y1 - y0) * (z2 - z0) - (z1 - z0) * (y2 - y0);
    if area == 0 {
        return;
    }
    let sign = area.signum();
    let area = area.abs();
    let (py, pz) = (
        i64::from(first) * i64::from(STEPS) + i64::from(HALF),
        i64::from(z) * i64::from(STEPS) + i64::from(HALF),
    );
    // Twice the area left of an edge, positive inside; the amount added where zero counts as outside; and the step from
    // row to row.
    let edge = |ay: i64, az: i64, by: i64, bz: i64| {
        let (dy, dz) = (sign * (by - ay), sign * (bz - az));
        let at = dy * (pz - az) - dz * (py - ay);
        let inside = if dz == 0 { dy > 0 } else { dz < 0 };
        (at, if inside { 0 } else { -1 }, -dz * i64::from(STEPS))
    };
    let (mut e0, t0, s0) = edge(y1, z1, y2, z2);
    let (mut e1, t1, s1) = edge(y2, z2, y0, z0);
    let (mut e2, t2, s2) = edge(y0, z0, y1, z1);
    let (fx0, fx1, fx2, scale) = (x0 as f64, x1 as f64, x2 as f64, 1.0 / (area as f64 * f64::from(STEPS)));
    for row in first..=last {
        if ((e0 + t0) | (e1 + t1) | (e2 + t2)) >= 0 {
            let at = (e0 as f64 * fx0 + e1 as f64 * fx1 + e2 as f64 * fx2) * scale - 0.5;
            #[expect(clippy::cast_possible_truncation, reason = "coordinates are below 2^17 voxels")]
            let cut = at as i64;
            let rest = at - cut as f64;
            let column = if rest.abs() > SURE && rest.abs() < 1.0 - SURE {
                cut + i64::from(rest > 0.0)
            } else {
                exact_column([e0, e1, e2], [x0, x1, x2], area)
            };
            cross(row, column, sign as i32);
        }
        e0 += s0;
        e1 += s1;
        e2 += s2;
    }
}

/// The first column whose centre, moved by -e, lies beyond a crossing.
fn exact_column(weights: [i64; 3], x: [i64; 3], area: i64) -> i64 {
    let sum: i128 = weights.iter().zip(x).map(|(w, x)| i128::from(*w) * i128::from(x)).sum();
    let beyond = sum - i128::from(area) * i128::from(HALF);
    let column = beyond.div_euclid(i128::from(area) * i128::from(STEPS)) + 1;
    i64::try_from(column).unwrap_or(i64::MAX)
}

/// Signed crossings of the rows of one slice, and the bits that follow from them.
pub(crate) struct Crossings {
    /// Words of a row, and rows.
    words: usize,
    rows: usize,
    counts: Vec<i32>,
    /// Columns with a count.
    touched: Vec<u64>,
    bits: Vec<u64>,
    /// True for rows that have counts, and for rows that had some before.
    used: Vec<(bool, bool)>,
}

/// Rule for sums of crossings that are inside.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Rule {
    NonZero,
    Odd,
}

impl Crossings {
    /// Memory for `rows` rows of `words` words.
    pub(crate) fn bytes(words: usize, rows: usize) -> u64 {
        (words * rows * (64 * size_of::<i32>() + 16) + 2 * rows) as u64
    }

    pub(crate) fn new(words: usize, rows: usize) -> Self {
        Self {
            words,
            rows,
            counts: vec![0; 64 * words * rows],
            touched: vec![0; words * rows],
            bits: vec![0; words * rows],
            used: vec![(false, false); rows],
        }
    }

    /// Counts a crossing before a column; those before the first count there, those beyond the last nowhere.
    #[inline]
    pub(crate) fn add(&mut self, row: usize, column: i64, sign: i32) {
        let column = usize::try_from(column.max(0)).unwrap_or(usize::MAX);
        if column >= 64 * self.words || row >= self.rows {
            return;
        }
        let at = row * 64 * self.words + column;
        // A sum beyond 2^31 would take as many triangles in one place.
        self.counts[at] = self.counts[at].wrapping_add(sign);
        self.touched[at / 64] |= 1 << (at % 64);
        self.used[row].0 = true;
    }

    /// Turns the counts into bits, and clears them for the next slice.
    pub(crate) fn settle(&mut self, rule: Rule) {
        let inside = |sum: i32| match rule {
            Rule::NonZero => sum != 0,
            Rule::Odd => sum & 1 != 0,
        };
        let rows = self.touched.chunks_exact_mut(self.words).zip(self.bits.chunks_exact_mut(self.words));
        let rows = rows.zip(self.counts.chunks_exact_mut(64 * self.words)).zip(&mut self.used);
        for (((touched, bits), counts), used) in rows {
            // Rows that are crossed neither now nor before stay unchanged.
            let (now, before) = (used.0, used.1);
            *used = (false, now);
            if !now {
                if before {
                    bits.fill(0);
                }
                continue;
            }
            let mut sum = 0_i32;
            for (at, (touched, bits)) in touched.iter_mut().zip(bits).enumerate() {
                let mut word = if inside(sum) { u64::MAX } else { 0 };
                let mut left = std::mem::take(touched);
                while left != 0 {
                    let bit = left.trailing_zeros();
                    left &= left - 1;
                    let count = &mut counts[64 * at + bit as usize];
                    sum = sum.wrapping_add(std::mem::take(count));
                    let from = u64::MAX << bit;
                    word = if inside(sum) { word | from } else { word & !from };
                }
                *bits = word;
            }
        }
    }

    pub(crate) fn row(&self, row: usize) -> &[u64] {
        &self.bits[row * self.words..][..self.words]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The definition, with wide integers and a real, if small, shift: coordinates times 2^40.
    fn by_definition(t: &Triangle, row: i32, z: i32) -> Option<(i64, i32)> {
        let scale = 1_i128 << 40;
        let at = |c: i32| i128::from(c) * scale;
        let centre = |c: i32| (i128::from(c) * 4096 + 2048) * scale;
        // Stand-ins for e^2 and e^3, far below any difference of lattice distances.
        let (py, pz) = (centre(row) + (1 << 20), centre(z) + 1);
        let p = |k: usize| (at(t[3 * k + 1]), at(t[3 * k + 2]));
        let side = |a: (i128, i128), b: (i128, i128)| (b.0 - a.0) * (pz - a.1) - (b.1 - a.1) * (py - a.0);
        let w = [side(p(1), p(2)), side(p(2), p(0)), side(p(0), p(1))];
        let sign = match w {
            w if w.iter().all(|w| *w > 0) => 1,
            w if w.iter().all(|w| *w < 0) => -1,
            _ => return None,
        };
        // x of the crossing of the row that was not moved, against centres moved by -e.
        let q = |k: usize| (i128::from(t[3 * k + 1]), i128::from(t[3 * k + 2]));
        let (cy, cz) = (i128::from(row) * 4096 + 2048, i128::from(z) * 4096 + 2048);
        let area_of = |a: (i128, i128), b: (i128, i128)| (b.0 - a.0) * (cz - a.1) - (b.1 - a.1) * (cy - a.0);
        let v = [area_of(q(1), q(2)), area_of(q(2), q(0)), area_of(q(0), q(1))];
        let area: i128 = v.iter().sum();
        let num: i128 = (0..3).map(|k| v[k] * i128::from(t[3 * k])).sum();
        let column = (-50..60).find(|i: &i64| {
            let centre = (i128::from(*i) * 4096 + 2048) * area;
            if area > 0 { centre > num } else { centre < num }
        });
        column.map(|c| (c, sign))
    }

    #[test]
    fn crossings_are_those_of_the_definition_also_through_edges_and_corners() {
        let mut state = 7_u32;
        let mut next = |n: u32| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 10) % n
        };
        let mut met = 0;
        for round in 0..4000 {
            // Every other triangle has its vertices on centres and corners, where ties are.
            let t: Triangle = std::array::from_fn(|_| {
                let c = if round % 2 == 0 { next(11) * 2048 } else { next(5 * 4096) };
                i32::try_from(c).unwrap()
            });
            for z in -1..7 {
                let mut got = Vec::new();
                cross_slice(&t, z, -1, 7, &mut |row, column, sign| got.push((row, column, sign)));
                let want: Vec<(i32, i64, i32)> =
                    (-1..7).filter_map(|row| by_definition(&t, row, z).map(|(c, s)| (row, c, s))).collect();
                assert_eq!(got, want, "{t:?} slice {z}");
                met += want.len();
            }
        }
        assert!(met > 5000, "{met}");
    }

    #[test]
    fn sums_of_crossings_become_bits_and_are_cleared() {
        let mut crossings = Crossings::new(2, 2);
        for (column, sign) in [(3, 1), (70, 1), (75, -1), (-5, 0), (80, -1), (500, 1)] {
            crossings.add(1, column, sign);
        }
        crossings.settle(Rule::NonZero);
        assert_eq!(crossings.row(1), [u64::MAX << 3, (1 << 16) - 1]);
        assert_eq!(crossings.row(0), [0, 0]);
        for column in [3, 70, 70, 70] {
            crossings.add(0, column, 1);
        }
        crossings.settle(Rule::Odd);
        assert_eq!(crossings.row(0), [u64::MAX << 3, (1 << 6) - 1]);
        assert_eq!(crossings.row(1), [0, 0]);
    }
}
