//! Extent of the inside, compared with the mesh's: parts thinner than a voxel may vanish.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicI32, Ordering};

use crate::builder::VoxelBox;

/// First and last column, row and slice.
pub(super) type Ranges = [[i32; 2]; 3];

const NONE: Ranges = [[i32::MAX, i32::MIN]; 3];

/// Least shortfall of a model from its mesh, in voxels, that is reported: tips of cones lose as much.
const FEWEST: u32 = 3;

/// Common findings of workers.
pub(super) struct Reach {
    /// Centres of voxels within the bounds of the mesh, if these are known.
    wanted: OnceLock<Ranges>,
    found: [[AtomicI32; 2]; 3],
}

impl Default for Reach {
    fn default() -> Self {
        let found = NONE.map(|range| range.map(AtomicI32::new));
        Self { wanted: OnceLock::new(), found }
    }
}

impl Reach {
    /// Counts from now on.
    pub(super) fn expect(&self, wanted: Ranges) {
        // A second reading finds the same bounds.
        let _ = self.wanted.set(wanted);
    }

    /// Takes the inside of a slice of a column: the bits of its rows, whose first word begins at column `left`.
    pub(super) fn add<'a>(
        &self,
        z: i32,
        column: &VoxelBox,
        left: i64,
        rows: impl Iterator<Item = (i32, &'a [u64])>,
    ) {
        if self.wanted.get().is_none() {
            return;
        }
        let mut own = NONE;
        for (y, words) in rows {
            let set = |(_, word): &(usize, &u64)| **word != 0;
            let mut some = words.iter().enumerate().filter(set);
            let Some(first) = some.next() else { continue };
            let last = some.next_back().unwrap_or(first);
            let place = |(at, bit): (usize, u32)| left + 64 * at as i64 + i64::from(bit);
            let low = place((first.0, first.1.trailing_zeros())).max(i64::from(column.x.start));
            let high = place((last.0, 63 - last.1.leading_zeros())).min(i64::from(column.x.end) - 1);
            if low <= high {
                #[expect(clippy::cast_possible_truncation, reason = "within the column")]
                let x = [low as i32, high as i32];
                for (range, [low, high]) in own.iter_mut().zip([x, [y; 2], [z; 2]]) {
                    *range = [range[0].min(low), range[1].max(high)];
                }
            }
        }
        for (all, [low, high]) in self.found.iter().zip(own) {
            all[0].fetch_min(low, Ordering::Relaxed);
            all[1].fetch_max(high, Ordering::Relaxed);
        }
    }

    /// Voxels by which the model is short of the mesh on some side, if enough for a note.
    pub(super) fn short(&self) -> Option<u64> {
        let wanted = self.wanted.get()?;
        let found =
            self.found.each_ref().map(|range| range.each_ref().map(|end| end.load(Ordering::Relaxed)));
        let by = |[low, high]: [i32; 2], [first, last]: [i32; 2]| {
            let high = high.max(low.saturating_sub(1));
            (first.saturating_sub(low)).max(high.saturating_sub(last))
        };
        let most =
            wanted.iter().zip(found).filter(|(_, of)| of[0] <= of[1]).map(|(w, of)| by(*w, of)).max()?;
        u32::try_from(most).ok().filter(|most| *most >= FEWEST).map(u64::from)
    }
}
