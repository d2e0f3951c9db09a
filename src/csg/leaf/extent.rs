//! Boxes of voxels around leaves, outside of which a leaf need not be asked.

use super::Leaf;
use crate::builder::VoxelBox;
use crate::mesh::STEPS;

/// Voxels beyond which a leaf holds none; the last are within.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::csg) struct Extent {
    low: [i16; 3],
    high: [i16; 3],
}

impl Extent {
    const ALL: Self = Self { low: [i16::MIN; 3], high: [i16::MAX; 3] };
    const NONE: Self = Self { low: [i16::MAX; 3], high: [i16::MIN; 3] };

    /// The extent of a box of the lattice, with a voxel to spare.
    fn around(low: [i64; 3], high: [i64; 3]) -> Self {
        #[expect(clippy::cast_possible_truncation, reason = "clamped")]
        let voxel = |at: i64| at.clamp(i16::MIN.into(), i16::MAX.into()) as i16;
        let steps = i64::from(STEPS);
        Self {
            low: low.map(|c| voxel(c.div_euclid(steps) - 1)),
            high: high.map(|c| voxel(c.div_euclid(steps) + 1)),
        }
    }

    /// True if it has no voxel of a box.
    #[inline]
    pub(in crate::csg) fn misses(&self, region: &VoxelBox) -> bool {
        [&region.x, &region.y, &region.z].into_iter().zip(self.low).zip(self.high).any(
            |((range, low), high)| {
                i64::from(range.end) <= i64::from(low) || i64::from(range.start) > i64::from(high)
            },
        )
    }

    #[inline]
    pub(in crate::csg) fn holds(&self, voxel: [i32; 3]) -> bool {
        (0..3).all(|k| i32::from(self.low[k]) <= voxel[k] && voxel[k] <= i32::from(self.high[k]))
    }

    /// Rows that it has voxels in, of `count` rows from a first one.
    #[inline]
    pub(in crate::csg) fn rows(&self, first: i32, count: usize) -> std::ops::Range<usize> {
        let at = |row: i32| usize::try_from(row - first).unwrap_or(0).min(count);
        let from = at(i32::from(self.low[1]));
        from..at(i32::from(self.high[1]) + 1).max(from)
    }
}

impl Leaf {
    /// The box around its voxels.
    pub(in crate::csg) fn extent(&self) -> Extent {
        match self {
            Self::Nothing => Extent::NONE,
            Self::Half(_) | Self::Sampled(_) => Extent::ALL,
            Self::Ball(ball) => {
                let middle = ball.middle.map(i64::from);
                let radius = i64::from(ball.radius);
                Extent::around(middle.map(|c| c - radius), middle.map(|c| c + radius))
            }
            Self::Block(block) => Extent::around(block.low, block.high),
            Self::Curved(curved) => {
                let [low, high] = curved.bounds();
                Extent::around(low, high)
            }
            Self::Body(body) => {
                let [low, high] = body.bounds();
                Extent::around(low.map(i64::from), high.map(i64::from))
            }
        }
    }
}
