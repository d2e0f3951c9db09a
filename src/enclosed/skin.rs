//! The skin of a model, slice by slice.

use crate::geom::{BoxIndex, Octant, VoxelIndex};
use crate::load::{ModelView, NodeView};

/// Slices that are taken from the octree at a time: a power of two, from 2 on.
const SLAB: u32 = 4;

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

/// The skin of one slice after the other, each node visited about twice. Memory: the skin of four slices, 16 bytes a
/// voxel, and of one of them in rows.
pub(crate) struct SkinSlices<'a> {
    view: &'a ModelView<'a>,
    /// Each in the order of the file: in a row x rises.
    slices: [Vec<SkinVoxel>; SLAB as usize],
    /// The slice that was asked for, ordered by rows.
    sorted: Vec<SkinVoxel>,
    /// Where the next voxel of each row goes.
    rows: Vec<usize>,
    slab: Option<u32>,
    seen: u64,
}

impl<'a> SkinSlices<'a> {
    pub(crate) fn new(view: &'a ModelView<'a>) -> Self {
        let slices = std::array::from_fn(|_| Vec::new());
        Self { view, slices, sorted: Vec::new(), rows: Vec::new(), slab: None, seen: 0 }
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
        let skin = self.slices.get((z - first) as usize)?;
        self.seen += skin.len() as u64;
        if self.seen > self.view.voxel_count() {
            return None;
        }
        in_rows(skin, &mut self.rows, &mut self.sorted);
        Some(&self.sorted)
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
        if level == 1 {
            return self.voxels(infobyte, child.voxel(self.view.node_count()), low, first);
        }
        let half = 1_u32 << (level - 1);
        if level == 2 {
            // The voxels of a node follow those of the node before it.
            let mut voxel = self.view.first_child(child.node());
            for octant in Octant::ALL.into_iter().filter(|octant| octant.is_in(infobyte)) {
                let high = octant.high();
                let within = self.view.infobyte(child.after(octant.rank_in(infobyte)).node());
                let at = std::array::from_fn(|a| low[a] + high[a] * half);
                self.voxels(within, voxel.voxel(self.view.node_count()), at, first)?;
                voxel = voxel.after(within.count_ones());
            }
            *left = left.checked_sub(u64::from(infobyte.count_ones()))?;
            return Some(());
        }
        for octant in Octant::ALL.into_iter().filter(|octant| octant.is_in(infobyte)) {
            let high = octant.high();
            let at: [u32; 3] = std::array::from_fn(|a| low[a] + high[a] * half);
            if at[2] < first + SLAB && at[2] + half > first {
                self.descend(child.after(octant.rank_in(infobyte)), at, level - 1, first, left)?;
            }
        }
        Some(())
    }

    /// The voxels of a node whose children they are; all of them lie in the slab.
    #[inline]
    fn voxels(&mut self, infobyte: u8, voxel: VoxelIndex, low: [u32; 3], first: u32) -> Option<()> {
        let [below, above] =
            self.slices.get_disjoint_mut([low[2] - first, low[2] - first + 1].map(|z| z as usize)).ok()?;
        let mut number = voxel.get();
        for (slice, octants) in [(below, infobyte & 15), (above, infobyte >> 4)] {
            let mut octants = u32::from(octants);
            while octants != 0 {
                let octant = octants.trailing_zeros();
                octants &= octants - 1;
                slice.push(SkinVoxel {
                    y: low[1] + (octant >> 1),
                    x: low[0] + (octant & 1),
                    voxel: VoxelIndex::new(number),
                });
                number = number.wrapping_add(1);
            }
        }
        Some(())
    }
}

/// Orders a slice by rows; within a row the order stays.
fn in_rows(skin: &[SkinVoxel], rows: &mut Vec<usize>, sorted: &mut Vec<SkinVoxel>) {
    sorted.clear();
    let Some(first) = skin.iter().map(|found| found.y).min() else { return };
    rows.clear();
    for found in skin {
        let row = (found.y - first) as usize + 1;
        if row >= rows.len() {
            rows.resize(row + 1, 0);
        }
        rows[row] += 1;
    }
    let mut before = 0;
    for start in rows.iter_mut() {
        before += *start;
        *start = before;
    }
    sorted.resize(skin.len(), skin[0]);
    for found in skin {
        let at = &mut rows[(found.y - first) as usize];
        sorted[*at] = *found;
        *at += 1;
    }
}
