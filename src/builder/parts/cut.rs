//! The boxes of parts: whole slabs of groups along z; if there are more parts than groups along z, slabs are cut along
//! y.

use std::ops::Range;
use std::path::{Path, PathBuf};

use crate::builder::VoxelBox;
use crate::builder::walk::GROUP_VOXELS;
use crate::geom::Dims;

/// Cuts of a model's grid; they follow from its size and the number of parts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Cuts {
    pub(crate) dims: Dims,
    /// Number of parts, at least one; some are empty if there are more than boxes.
    pub(crate) parts: u32,
}

/// Share number `at` of `n` things in `parts` shares.
pub(super) fn share(at: u32, n: u32, parts: u32) -> Range<u32> {
    let bound = |at: u32| u64::from(at) * u64::from(n) / u64::from(parts);
    #[expect(clippy::cast_possible_truncation, reason = "at most n")]
    let range = bound(at) as u32..bound(at + 1) as u32;
    range
}

/// The share that holds thing `at`.
fn share_of(at: u32, n: u32, parts: u32) -> u32 {
    let above = (u64::from(at) + 1) * u64::from(parts);
    u32::try_from(above.div_ceil(u64::from(n)) - 1).unwrap_or(0)
}

impl Cuts {
    fn groups(self) -> [u32; 3] {
        self.dims.to_array().map(|n| n.div_ceil(GROUP_VOXELS))
    }

    /// Slabs along z.
    fn slabs(self) -> u32 {
        self.parts.min(self.groups()[2])
    }

    /// The box of a part, cut at multiples of a group's side; it may be empty.
    pub(crate) fn region(self, number: u32) -> VoxelBox {
        let [_, gy, gz] = self.groups();
        let slab = share_of(number, self.parts, self.slabs());
        let own = share(slab, self.parts, self.slabs());
        let side = |groups: Range<u32>, n: u32| {
            (groups.start * GROUP_VOXELS).min(n)..groups.end.saturating_mul(GROUP_VOXELS).min(n)
        };
        let count = own.end - own.start;
        VoxelBox {
            x: 0..self.dims.nx(),
            y: side(share(number - own.start, gy, count), self.dims.ny()),
            z: side(share(slab, gz, self.slabs()), self.dims.nz()),
        }
    }

    /// The part that holds a group.
    pub(crate) fn owner(self, [_, y, z]: [u32; 3]) -> u32 {
        let [_, gy, gz] = self.groups();
        let own = share(share_of(z, gz, self.slabs()), self.parts, self.slabs());
        own.start + share_of(y, gy, own.end - own.start)
    }
}

/// One part of a plan.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct PartId {
    /// SHA-256 of everything that decides the bytes.
    pub(crate) digest: [u8; 32],
    pub(crate) number: u32,
    pub(crate) cuts: Cuts,
}

impl PartId {
    pub(crate) fn region(&self) -> VoxelBox {
        self.cuts.region(self.number)
    }

    /// Path of the part in the folder of a job: the name identifies its content.
    pub(crate) fn path(&self, folder: &Path) -> PathBuf {
        self.named(folder, &format!("{:04}", self.number))
    }

    pub(super) fn named(&self, folder: &Path, what: &str) -> PathBuf {
        let digest: String = self.digest[..12].iter().map(|byte| format!("{byte:02x}")).collect();
        folder.join(format!("{digest}-{what}.part"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_group_lies_in_the_box_of_its_owner_and_in_no_other() {
        for dims in [[1, 1, 1], [300, 129, 1000], [64, 1000, 130], [5, 640, 640], [2000, 4000, 513]] {
            for parts in [1, 2, 3, 7, 8, 9, 64, 256] {
                let cuts = Cuts { dims: Dims::new(dims[0], dims[1], dims[2]).unwrap(), parts };
                let regions: Vec<_> = (0..parts).map(|number| cuts.region(number)).collect();
                let volume = |r: &VoxelBox| (r.x.len() * r.y.len() * r.z.len()) as u64;
                let all = dims.map(u64::from).iter().product::<u64>();
                assert_eq!(regions.iter().map(volume).sum::<u64>(), all, "{dims:?} in {parts}");
                let [_, gy, gz] = cuts.groups();
                for (y, z) in (0..gy).flat_map(|y| (0..gz).map(move |z| (y, z))) {
                    let owner = &regions[cuts.owner([0, y, z]) as usize];
                    let inside = owner.y.contains(&(y * 128)) && owner.z.contains(&(z * 128));
                    assert!(inside, "{dims:?} in {parts}: group {y}, {z} is not in {owner:?}");
                }
            }
        }
    }
}
