//! Bricks in Morton order, skipping those outside the volume.

use super::error::BuildError;
use super::solid::{BRICK, VoxelBox};
use super::swap::{BrickEntry, Scratch};
use crate::geom::{Dims, morton};

/// Bricks of a group along each axis; a group is a box of 4^3 bricks.
const GROUP: u32 = 4;
pub(super) const GROUP_BRICKS: usize = (GROUP * GROUP * GROUP) as usize;
/// Side of a group in voxels.
pub(super) const GROUP_VOXELS: u32 = GROUP * BRICK;

/// A brick with skin, and its Morton code in the grid of bricks.
pub(super) type WalkedBrick = (u64, BrickEntry);

/// Visits groups of bricks in Morton order; as an iterator it gives their codes and positions.
pub(super) struct BrickWalk {
    /// Groups along x, y, z: the first visited one, and one past the last.
    first: [u32; 3],
    groups: [u32; 3],
    /// Morton codes of groups: the next one, and one past the last.
    next: u64,
    end: u64,
}

impl BrickWalk {
    /// The groups of a volume.
    pub(super) fn new(dims: Dims) -> Self {
        Self::of(&VoxelBox::whole(dims))
    }

    /// The groups that a box touches.
    pub(super) fn of(region: &VoxelBox) -> Self {
        let sides = [&region.x, &region.y, &region.z];
        let groups = sides.map(|side| if side.is_empty() { 0 } else { side.end.div_ceil(GROUP_VOXELS) });
        let first = sides.map(|side| side.start / GROUP_VOXELS);
        let last = groups.map(|n| n.saturating_sub(1));
        let end = if groups.contains(&0) { 0 } else { morton::encode(last[0], last[1], last[2]) + 1 };
        Self { first, groups, next: 0, end }
    }

    /// Fills `found` with the bricks of the next group that have skin, in Morton order; `false` at the end. A group
    /// without skin gives an empty list.
    pub(super) fn next_group(
        &mut self,
        scratch: &Scratch,
        found: &mut Vec<WalkedBrick>,
    ) -> Result<bool, BuildError> {
        found.clear();
        let Some((code, at)) = self.next() else { return Ok(false) };
        Self::read_group(scratch, code, at, found)?;
        Ok(true)
    }

    fn read_group(
        scratch: &Scratch,
        code: u64,
        at: [u32; 3],
        found: &mut Vec<WalkedBrick>,
    ) -> Result<(), BuildError> {
        let mut entries = [BrickEntry::default(); GROUP_BRICKS];
        let first = at.map(|g| u64::from(g * GROUP));
        for z in 0..GROUP {
            for y in 0..GROUP {
                let row = scratch.entries([first[0], first[1] + u64::from(y), first[2] + u64::from(z)])?;
                for (x, entry) in (0..GROUP).zip(row) {
                    #[expect(clippy::cast_possible_truncation, reason = "below 64")]
                    let within = morton::encode(x, y, z) as usize;
                    entries[within] = entry;
                }
            }
        }
        let base = code * GROUP_BRICKS as u64;
        found.extend((base..).zip(entries).filter(|(_, e)| !e.is_empty()));
        Ok(())
    }
}

impl Iterator for BrickWalk {
    type Item = (u64, [u32; 3]);

    fn next(&mut self) -> Option<Self::Item> {
        while self.next < self.end {
            let code = self.next;
            let at = morton::decode(code);
            if let Some(axis) = (0..3).find(|a| at[*a] >= self.groups[*a]) {
                self.next = skip_outside(code, at, axis, self.groups[axis]);
                continue;
            }
            self.next += 1;
            if (0..3).all(|a| at[a] >= self.first[a]) {
                return Some((code, at));
            }
        }
        None
    }
}

/// The next Morton code after `code` that can be inside along `axis`, where `at[axis] >= limit`: skips the largest
/// aligned box that lies wholly beyond the limit.
fn skip_outside(code: u64, at: [u32; 3], axis: usize, limit: u32) -> u64 {
    let mut step = 1_u64;
    let mut edge = 1_u32;
    while code.is_multiple_of(step * 8) && at[axis] / (edge * 2) * (edge * 2) >= limit && edge < 1 << 15 {
        step *= 8;
        edge *= 2;
    }
    code + step
}

#[cfg(test)]
#[expect(clippy::cast_possible_truncation, reason = "small numbers of the test")]
mod tests {
    use super::*;

    #[test]
    fn every_brick_of_any_dims_is_met_once_and_in_order() {
        for dims in [(1, 1, 1), (33, 1, 1), (100, 700, 64), (1, 1, 2000), (257, 129, 300)] {
            let dims = Dims::new(dims.0, dims.1, dims.2).unwrap();
            let bricks = dims.to_array().map(|n| u64::from(n.div_ceil(BRICK)));
            let folder = tempfile::tempdir().unwrap();
            let scratch = Scratch::create(folder.path(), bricks).unwrap();
            let mut want = Vec::new();
            for z in 0..bricks[2] {
                for y in 0..bricks[1] {
                    for x in 0..bricks[0] {
                        let code = morton::encode(x as u32, y as u32, z as u32);
                        let entry = BrickEntry {
                            last_fragment: code + 1,
                            skin: 1,
                            boxes: [1; 4],
                            ..BrickEntry::default()
                        };
                        scratch.put_entries([x, y, z], &[entry], &mut Vec::new()).unwrap();
                        want.push(code);
                    }
                }
            }
            want.sort_unstable();
            let (mut walk, mut found, mut got) = (BrickWalk::new(dims), Vec::new(), Vec::new());
            while walk.next_group(&scratch, &mut found).unwrap() {
                for (code, entry) in &found {
                    assert_eq!(entry.last_fragment, code + 1);
                    got.push(*code);
                }
            }
            assert_eq!(got, want, "{dims}");
        }
    }
}
