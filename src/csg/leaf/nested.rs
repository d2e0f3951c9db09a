//! Leaves that lie within others in a box: of ten thousand balls in nearly one place few matter anywhere.

use super::{Ball, Block, Leaf, middles};
use crate::builder::VoxelBox;
use crate::csg::program::Nesting;

/// Leaves in a box of voxel middles. Balls are compared with balls, and boxes with boxes.
pub(in crate::csg) struct Nested<'a> {
    leaves: &'a [Leaf],
    region: [(i64, i64); 3],
}

impl<'a> Nested<'a> {
    pub(in crate::csg) fn new(leaves: &'a [Leaf], region: &VoxelBox) -> Self {
        Self { leaves, region: middles(region) }
    }
}

impl Nesting for Nested<'_> {
    #[inline]
    fn reach(&self, leaf: u32) -> Option<i64> {
        let middle = self.region.map(|(low, high)| (low + high) / 2);
        match &self.leaves[leaf as usize] {
            Leaf::Ball(ball) => Some(ball.beyond(middle)),
            Leaf::Block(block) => {
                (0..3).map(|k| (block.low[k] - middle[k]).max(middle[k] - block.high[k])).max()
            }
            _ => None,
        }
    }

    #[inline]
    fn holds(&self, outer: u32, inner: u32) -> bool {
        match (&self.leaves[outer as usize], &self.leaves[inner as usize]) {
            (Leaf::Ball(outer), Leaf::Ball(inner)) => ball_holds(outer, inner, &self.region),
            (Leaf::Block(outer), Leaf::Block(inner)) => block_holds(outer, inner, &self.region),
            _ => false,
        }
    }
}

/// The difference of the squares by which points are beyond both balls is linear, so that corners decide. A lattice
/// step changes the square by twice the distance and one at most.
fn ball_holds(outer: &Ball, inner: &Ball, region: &[(i64, i64); 3]) -> bool {
    let low = region.map(|(low, _)| low);
    let mut most = i128::from(outer.beyond(low)) - i128::from(inner.beyond(low));
    let mut step = 1;
    for (k, (low, high)) in region.iter().enumerate() {
        let (own, other) = (i64::from(outer.middle[k]), i64::from(inner.middle[k]));
        most += i128::from((2 * (other - own) * (high - low)).max(0));
        step += 2 * (low - own).abs().max((high - own).abs());
    }
    most + i128::from(step) < 0
}

fn block_holds(outer: &Block, inner: &Block, region: &[(i64, i64); 3]) -> bool {
    region.iter().enumerate().all(|(k, (low, high))| {
        outer.low[k] + 2 <= inner.low[k].max(*low) && outer.high[k] >= inner.high[k].min(*high) + 2
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::csg::place::centre;

    /// If one leaf is said to hold another, every lattice point of the box that is in the inner one is in the outer one
    /// with all its neighbours.
    #[test]
    fn what_is_held_is_within_by_a_step() {
        let mut state = 11_u32;
        let mut next = |n: i32| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            i32::try_from(state >> 8).unwrap() % n
        };
        let (mut held, mut tried) = ([0, 0], 0);
        while held[0] < 300 || held[1] < 300 {
            tried += 1;
            assert!(tried < 1_000_000, "{held:?}");
            let start: [u32; 3] = std::array::from_fn(|_| u32::try_from(next(9)).unwrap());
            let side = |k: usize| start[k]..start[k] + 3;
            let region = VoxelBox { x: side(0), y: side(1), z: side(2) };
            let middle: [i32; 3] = std::array::from_fn(|_| next(40_000));
            let radius = 5000 + next(30_000);
            let mut ball = || Ball { middle: middle.map(|c| c + next(90)), radius: radius + next(90) };
            let balls = [ball(), ball()];
            let mut block = || {
                let mut ends = || middle.map(|c| i64::from(c + next(90)));
                let (low, high) = (ends(), ends());
                Box::new(Block { low, high: high.map(|c| c + i64::from(radius)) })
            };
            let blocks = [block(), block()];
            let pairs = [balls.map(Leaf::Ball), blocks.map(Leaf::Block)];
            for (kind, pair) in pairs.iter().enumerate() {
                if !Nested::new(pair, &region).holds(0, 1) {
                    continue;
                }
                held[kind] += 1;
                let contains = |leaf: &Leaf, p: [i64; 3]| match leaf {
                    Leaf::Ball(ball) => ball.contains(p),
                    Leaf::Block(block) => block.contains(p),
                    _ => unreachable!("none is made"),
                };
                for _ in 0..100 {
                    let p: [i64; 3] = std::array::from_fn(|k| {
                        let first = centre(i32::try_from(start[k]).unwrap());
                        first + i64::from(next(2 * 4096 + 1))
                    });
                    if !contains(&pair[1], p) {
                        continue;
                    }
                    for (axis, by) in [(0, -1), (0, 1), (1, -1), (1, 1), (2, -1), (2, 1)] {
                        let mut beside = p;
                        beside[axis] += by;
                        assert!(contains(&pair[0], beside), "{pair:?} {p:?}");
                    }
                }
            }
        }
    }
}
