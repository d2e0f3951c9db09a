//! Triangles of a body by where they lie: a grid of boxes over the body, each with the triangles that reach into it.
//!
//! The boxes are as many along each axis as make looking up cheapest: long walls of a prism are not cut along their
//! length. Memory: at most [`ENTRIES`] + [`BOXES`] numbers of 32 bits a triangle.

use crate::mesh::{Triangle, span};

/// Most entries and boxes, as multiples of the number of triangles.
const ENTRIES: usize = 4;
const BOXES: usize = 2;
/// Number of triangles below which they are not divided.
const FEW: usize = 16;

#[derive(Debug)]
pub(super) struct Near {
    low: [i32; 3],
    /// Lattice steps of a box along each axis, as a power of two.
    shifts: [u32; 3],
    /// Boxes along each axis.
    sides: [usize; 3],
    /// Index of the first triangle of each box.
    starts: Vec<u32>,
    numbers: Vec<u32>,
}

/// Bits that hold a distance.
fn bits(distance: i32) -> u32 {
    u32::BITS - distance.cast_unsigned().leading_zeros()
}

impl Near {
    pub(super) fn new(triangles: &[Triangle], low: [i32; 3], high: [i32; 3]) -> Self {
        let whole = std::array::from_fn(|k| bits(high[k].saturating_sub(low[k])));
        let mut near = Self { low, shifts: whole, sides: [1; 3], starts: Vec::new(), numbers: Vec::new() };
        let count = triangles.len();
        let mut entries = count;
        if count < FEW {
            near.fill(triangles, entries);
            return near;
        }
        loop {
            // The grid is halved along the axis that leaves fewest triangles in a box.
            let halved = (0..3).filter(|k| near.shifts[*k] > 0).map(|k| {
                let (mut shifts, mut sides) = (near.shifts, near.sides);
                (shifts[k], sides[k]) = (shifts[k] - 1, 2 * sides[k]);
                let tried = Self { low, shifts, sides, starts: Vec::new(), numbers: Vec::new() };
                let of = |t| tried.boxes(t).map(|range| range.len()).iter().product::<usize>();
                (triangles.iter().map(of).sum::<usize>(), shifts, sides)
            });
            let Some((more, shifts, sides)) = halved.min() else { break };
            // Each halving has to halve the boxes' content, nearly, or it is not worth its memory.
            if more > ENTRIES * count
                || sides.iter().product::<usize>() > BOXES * count
                || 8 * more > 15 * entries
            {
                break;
            }
            (entries, near.shifts, near.sides) = (more, shifts, sides);
        }
        near.fill(triangles, entries);
        near
    }

    fn fill(&mut self, triangles: &[Triangle], entries: usize) {
        let mut starts = vec![0_u32; self.sides.iter().product::<usize>() + 1];
        for t in triangles {
            self.each_box(self.boxes(t), |at, _| starts[at + 1] += 1);
        }
        for at in 1..starts.len() {
            starts[at] += starts[at - 1];
        }
        let mut numbers = vec![0_u32; entries];
        for (number, t) in (0_u32..).zip(triangles) {
            self.each_box(self.boxes(t), |at, _| {
                numbers[starts[at] as usize] = number;
                starts[at] += 1;
            });
        }
        // Each has come to the next one's beginning.
        starts.rotate_right(1);
        starts[0] = 0;
        (self.starts, self.numbers) = (starts, numbers);
    }

    /// The boxes between two places along an axis, as far as there are any.
    #[inline]
    fn along(&self, k: usize, (low, high): (i64, i64)) -> std::ops::Range<usize> {
        let last = self.sides[k] - 1;
        let at =
            |c: i64| usize::try_from((c - i64::from(self.low[k])).max(0) >> self.shifts[k]).unwrap_or(last);
        at(low).min(last)..at(high).min(last) + 1
    }

    #[inline]
    fn boxes(&self, t: &Triangle) -> [std::ops::Range<usize>; 3] {
        std::array::from_fn(|k| {
            let (low, high) = span(t, k);
            self.along(k, (low.into(), high.into()))
        })
    }

    #[inline]
    fn each_box(&self, [x, y, z]: [std::ops::Range<usize>; 3], mut each: impl FnMut(usize, [usize; 3])) {
        for cz in z {
            for cy in y.clone() {
                for cx in x.clone() {
                    each((cz * self.sides[1] + cy) * self.sides[0] + cx, [cx, cy, cz]);
                }
            }
        }
    }

    /// Calls `each` once with every triangle that may reach between these places along the axes, and possibly with
    /// others.
    #[inline]
    pub(super) fn each<'t>(
        &self,
        triangles: &'t [Triangle],
        region: [(i64, i64); 3],
        mut each: impl FnMut(&'t Triangle),
    ) {
        let asked: [_; 3] = std::array::from_fn(|k| self.along(k, region[k]));
        let first = asked.clone().map(|range| range.start);
        self.each_box(asked, |at, here| {
            for number in &self.numbers[self.starts[at] as usize..self.starts[at + 1] as usize] {
                let t = &triangles[*number as usize];
                // A triangle counts in the first of its boxes that are asked.
                let is_first = (0..3).all(|k| {
                    here[k] == first[k]
                        || self.along(k, [span(t, k).0; 2].map(i64::from).into()).start == here[k]
                });
                if is_first {
                    each(t);
                }
            }
        });
    }

    pub(super) fn held_bytes(&self) -> usize {
        (self.starts.capacity() + self.numbers.capacity()) * size_of::<u32>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_triangle_of_a_region_is_met_once() {
        let mut state = 3_u32;
        let mut next = |n: i32| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            i32::try_from(state >> 8).unwrap() % n
        };
        for count in [1, 40, 3000] {
            let triangles: Vec<Triangle> = (0..count)
                .map(|at| {
                    let (corner, size) =
                        ([next(90_000), next(40_000), next(9_000)], if at % 50 == 0 { 60_000 } else { 900 });
                    std::array::from_fn(|k| corner[k % 3] - 30_000 + next(size))
                })
                .collect();
            let side = |k: usize, most: bool| {
                let all = triangles.iter().map(|t| if most { span(t, k).1 } else { span(t, k).0 });
                if most { all.max().unwrap() } else { all.min().unwrap() }
            };
            let near =
                Near::new(&triangles, [0, 1, 2].map(|k| side(k, false)), [0, 1, 2].map(|k| side(k, true)));
            assert!(near.held_bytes() <= 4 * (ENTRIES + BOXES) * triangles.len() + 8);
            for _ in 0..200 {
                let region: [(i64, i64); 3] = std::array::from_fn(|_| {
                    let low = i64::from(next(130_000)) - 40_000;
                    (low, low + i64::from(next(9_000)))
                });
                let mut met: Vec<&Triangle> = Vec::new();
                near.each(&triangles, region, |t| met.push(t));
                let apart = |t: &Triangle| {
                    (0..3).any(|k| {
                        i64::from(span(t, k).0) > region[k].1 || i64::from(span(t, k).1) < region[k].0
                    })
                };
                let number = |t: &&Triangle| std::ptr::from_ref::<Triangle>(t) as usize;
                let mut numbers: Vec<usize> = met.iter().map(number).collect();
                numbers.sort_unstable();
                numbers.dedup();
                assert_eq!(numbers.len(), met.len());
                assert!(
                    triangles
                        .iter()
                        .filter(|t| !apart(t))
                        .all(|t| numbers.binary_search(&number(&t)).is_ok())
                );
            }
        }
    }
}
