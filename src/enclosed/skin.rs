//! The skin of a model, slice by slice.

use crate::geom::{BoxIndex, Octant, VoxelIndex};
use crate::load::{ModelView, NodeView};

/// Slices that are taken from the octree at a time: a power of two.
const SLAB: u32 = 32;

/// A skin voxel of a slice; ordered by rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct SkinVoxel {
    pub(crate) y: u32,
    pub(crate) x: u32,
    pub(crate) voxel: VoxelIndex,
}

/// First voxel along each axis, and the one after the last. Cost: the nodes of six sides, about.
pub(crate) fn extent(view: &ModelView<'_>) -> Option<[[u32; 3]; 2]> {
    let (mut first, mut end) = ([0; 3], [0; 3]);
    for (axis, (first, end)) in first.iter_mut().zip(&mut end).enumerate() {
        *first = reach(view, axis, false)?;
        *end = reach(view, axis, true)? + 1;
    }
    Some([first, end])
}

/// The least or greatest coordinate of a voxel along an axis. Visits the nodes of the side that is looked for
/// first, and others only where these end before.
fn reach(view: &ModelView<'_>, axis: usize, high: bool) -> Option<u32> {
    let mut best: Option<u32> = None;
    let mut waiting = vec![(BoxIndex::ROOT, 0_u32, view.depth())];
    let mut visits = 0_u64;
    while let Some((number, low, level)) = waiting.pop() {
        let edge = 1_u32 << level;
        let most = if high { low + edge - 1 } else { low };
        if best.is_some_and(|best| if high { most <= best } else { most >= best }) {
            continue;
        }
        if level == 0 {
            best = Some(low);
            continue;
        }
        visits += 1;
        if visits > view.node_count() {
            return None;
        }
        for farther in [true, false] {
            // The side that is looked for is put last, and taken first.
            for octant in Octant::ALL {
                let upper = octant.high()[axis] == 1;
                if (upper == high) != farther
                    && let Some(child) = view.child(number.node(), octant)
                {
                    waiting.push((child, low + u32::from(upper) * edge / 2, level - 1));
                }
            }
        }
    }
    best
}

/// The skin of one slice after the other, each node visited about once. Memory: the skin of 32 slices, 16 bytes a
/// voxel.
pub(crate) struct SkinSlices<'a> {
    view: &'a ModelView<'a>,
    slices: [Vec<SkinVoxel>; SLAB as usize],
    slab: Option<u32>,
    seen: u64,
}

impl<'a> SkinSlices<'a> {
    pub(crate) fn new(view: &'a ModelView<'a>) -> Self {
        Self { view, slices: std::array::from_fn(|_| Vec::new()), slab: None, seen: 0 }
    }

    /// The skin of slice `z`, ordered by rows. Slices are asked for in order; `None` for a damaged model, which has
    /// more boxes than it says.
    pub(crate) fn slice(&mut self, z: u32) -> Option<&[SkinVoxel]> {
        let first = z / SLAB * SLAB;
        if self.slab != Some(first) {
            self.slices.iter_mut().for_each(Vec::clear);
            let mut left = self.view.node_count() + 1;
            self.descend(BoxIndex::ROOT, [0; 3], self.view.depth(), first, &mut left)?;
            self.slab = Some(first);
        }
        let skin = self.slices.get_mut((z - first) as usize)?;
        skin.sort_unstable();
        self.seen += skin.len() as u64;
        (self.seen <= self.view.voxel_count()).then_some(skin.as_slice())
    }

    fn descend(
        &mut self,
        number: BoxIndex,
        low: [u32; 3],
        level: u32,
        first: u32,
        left: &mut u64,
    ) -> Option<()> {
        if level == 0 {
            let voxel = number.voxel(self.view.node_count());
            let slice = self.slices.get_mut((low[2] - first) as usize)?;
            slice.push(SkinVoxel { y: low[1], x: low[0], voxel });
            return Some(());
        }
        *left = left.checked_sub(1)?;
        let infobyte = self.view.infobyte(number.node());
        let child = self.view.first_child(number.node());
        let half = 1_u32 << (level - 1);
        for octant in Octant::ALL.into_iter().filter(|octant| octant.is_in(infobyte)) {
            let high = octant.high();
            let at: [u32; 3] = std::array::from_fn(|a| low[a] + high[a] * half);
            if at[2] < first + SLAB && at[2] + half > first {
                self.descend(child.after(octant.rank_in(infobyte)), at, level - 1, first, left)?;
            }
        }
        Some(())
    }
}
