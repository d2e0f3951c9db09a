//! Counts of a brick: its skin voxels, and its non-empty boxes of every edge.
#![expect(clippy::cast_possible_truncation, reason = "a brick has at most 4096 boxes of one edge")]

use super::solid::BRICK;
use crate::cpu::{Kernel, Lanes, dispatch};

const BRICK_ROWS: usize = BRICK as usize;

/// Skin voxels of one slice of a brick.
pub(super) fn count_slice(rows: &[u32; BRICK_ROWS]) -> usize {
    dispatch(CountKernel(rows))
}

/// Skin voxels of a brick (`rows[32 z + y]`), and its non-empty boxes with an edge of 2, 4, 8 and 16.
pub(super) fn count_brick(rows: &[u32; BRICK_ROWS * BRICK_ROWS]) -> (u32, [u16; 4]) {
    dispatch(BoxKernel(rows))
}

struct CountKernel<'a>(&'a [u32; BRICK_ROWS]);

impl Kernel for CountKernel<'_> {
    type Output = usize;

    #[inline(always)]
    fn run(self, _: impl Lanes) -> usize {
        self.0.iter().map(|row| row.count_ones() as usize).sum()
    }
}

struct BoxKernel<'a>(&'a [u32; BRICK_ROWS * BRICK_ROWS]);

impl Kernel for BoxKernel<'_> {
    type Output = (u32, [u16; 4]);

    #[inline(always)]
    fn run(self, _: impl Lanes) -> (u32, [u16; 4]) {
        count_boxes(self.0)
    }
}

#[inline(always)]
fn count_boxes(rows: &[u32; BRICK_ROWS * BRICK_ROWS]) -> (u32, [u16; 4]) {
    let skin = rows.iter().map(|r| r.count_ones()).sum();
    let mut level = *rows;
    let mut edge = BRICK_ROWS;
    let mut boxes = [0; 4];
    let keep = [0x5555_5555_u32, 0x1111_1111, 0x0101_0101, 0x0001_0001];
    for (step, count) in boxes.iter_mut().enumerate() {
        let half = edge / 2;
        let mut sum = 0;
        for z in 0..half {
            for y in 0..half {
                let at = |dz: usize, dy: usize| level[(2 * z + dz) * edge + 2 * y + dy];
                let row = at(0, 0) | at(0, 1) | at(1, 0) | at(1, 1);
                let folded = (row | row >> (1 << step)) & keep[step];
                sum += folded.count_ones();
                // Rows move to the front; the row written lies before every row still to be read.
                level[z * half + y] = folded;
            }
        }
        *count = sum as u16;
        edge = half;
    }
    (skin, boxes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_are_counted_as_by_brute_force() {
        for seed in 0..20_u32 {
            let mut rows = [0_u32; 1024];
            let mut state = seed.wrapping_mul(747_796_405) + 1;
            for (i, row) in rows.iter_mut().enumerate() {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                *row = if seed == 19 {
                    u32::MAX
                } else if (i as u32).is_multiple_of(seed + 1) {
                    state & (state >> 7)
                } else {
                    0
                };
            }
            let set = |x: usize, y: usize, z: usize| rows[32 * z + y] >> x & 1 == 1;
            let mut want = [0; 4];
            for (k, count) in want.iter_mut().enumerate() {
                let edge = 2 << k;
                let mut seen = std::collections::HashSet::new();
                for z in 0..32 {
                    for y in 0..32 {
                        for x in (0..32).filter(|x| set(*x, y, z)) {
                            seen.insert((x / edge, y / edge, z / edge));
                        }
                    }
                }
                *count = u16::try_from(seen.len()).unwrap();
            }
            assert_eq!(count_brick(&rows).1, want, "seed {seed}");
        }
    }
}
