//! The reference: first hits found slowly, in exact rationals, without an octree.
//!
//! [`walk`] steps from voxel to voxel over a plain bit volume. It shares nothing with the traversal but the integers of
//! the quantised ray. Comparisons multiply crosswise in i128: no division. Of models of cells [`planes`] asks every cell
//! and larger leaf that the walk comes to.

pub mod planes;

use crate::geom::{BoxIndex, Octant};
use crate::load::NodeView;

use super::ray::{FRACTION_BITS, Face, Ray};

/// Skin voxels as one bit per cell of the grid, x fastest: the decoded form of an octree.
#[derive(Clone, Debug)]
pub struct BitVolume {
    depth: u32,
    words: Vec<u64>,
}

impl BitVolume {
    /// Deepest grid that may be decoded: 2^30 cells in 128 MiB.
    pub(crate) const MAX_DEPTH: u32 = 10;

    /// An empty volume of 2^depth cells a side, or `None` over [`BitVolume::MAX_DEPTH`].
    pub fn new(depth: u32) -> Option<Self> {
        let words = (1_usize << (3 * depth.min(Self::MAX_DEPTH))).div_ceil(64);
        (depth <= Self::MAX_DEPTH).then(|| Self { depth, words: vec![0; words] })
    }

    /// Decodes an octree; `None` when it is too deep. Cost: one read of every node.
    pub fn decode<V: NodeView>(view: &V) -> Option<Self> {
        let mut volume = Self::new(view.depth())?;
        if view.voxel_count() == 0 {
            return Some(volume);
        }
        // (box number, lowest cell, level); at most 7 entries wait per level.
        let mut waiting = vec![(BoxIndex::ROOT, [0_u32; 3], volume.depth)];
        while let Some((number, low, level)) = waiting.pop() {
            if level == 0 {
                volume.set(low);
                continue;
            }
            for octant in Octant::ALL {
                if let Some(child) = view.child(number.node(), octant) {
                    let half = 1 << (level - 1);
                    let at = std::array::from_fn(|a| low[a] + octant.high()[a] * half);
                    waiting.push((child, at, level - 1));
                }
            }
        }
        Some(volume)
    }

    fn index(&self, cell: [u32; 3]) -> Option<usize> {
        let side = 1_usize << self.depth;
        let [x, y, z] = cell.map(|c| c as usize);
        (x < side && y < side && z < side).then(|| (z * side + y) * side + x)
    }

    /// Marks a cell as skin; cells outside the grid are ignored.
    pub fn set(&mut self, cell: [u32; 3]) {
        if let Some(at) = self.index(cell)
            && let Some(word) = self.words.get_mut(at / 64)
        {
            *word |= 1 << (at % 64);
        }
    }

    /// True if the cell is skin; false outside the grid.
    pub fn get(&self, cell: [u32; 3]) -> bool {
        self.index(cell).and_then(|at| self.words.get(at / 64).map(|w| w >> (at % 64) & 1)) == Some(1)
    }
}

/// First hit according to a reference.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReferenceHit {
    /// The skin voxel.
    pub cell: [u32; 3],
    /// Face of entry, of tied axes the first; `None` when the ray starts in the voxel.
    pub face: Option<Face>,
}

/// Units of an origin coordinate per cell.
const CELL: i128 = 1 << FRACTION_BITS;

/// First hit by walking from voxel to voxel; `visit` sees every voxel on the way, the hit included.
///
/// Simultaneous crossings are taken at once, or, when `sealed`, one by one in the order x, y, z.
pub fn walk(
    volume: &BitVolume,
    ray: &Ray,
    sealed: bool,
    mut visit: impl FnMut([u32; 3]),
) -> Option<ReferenceHit> {
    walk_until(volume.depth, ray, sealed, |cell| {
        visit(cell);
        volume.get(cell)
    })
}

/// [`walk`] through a grid of 2^depth cells a side, to the first cell that `is_met`.
fn walk_until(
    depth: u32,
    ray: &Ray,
    sealed: bool,
    mut is_met: impl FnMut([u32; 3]) -> bool,
) -> Option<ReferenceHit> {
    let origin = ray.origin().map(i128::from);
    let direction = ray.direction().map(i128::from);
    let side = 1_i128 << depth;
    let mut cell = [0_i128; 3];
    for a in 0..3 {
        // Half-open in the direction of travel: floor, or ceil - 1 for a ray that runs backwards.
        let backwards = i128::from(direction[a] < 0);
        cell[a] = (origin[a] - backwards).div_euclid(CELL);
    }
    let (mut face, mut last) = (ray.entry(), None);
    loop {
        let mut at = [0_u32; 3];
        for a in 0..3 {
            if cell[a] < 0 || cell[a] >= side {
                return None;
            }
            at[a] = u32::try_from(cell[a]).ok()?;
        }
        if is_met(at) {
            return Some(ReferenceHit { cell: at, face });
        }
        // Time to the next plane of each axis as a fraction of two positive numbers.
        let mut first: Option<(i128, i128)> = None;
        let mut times = [None; 3];
        for a in 0..3 {
            if direction[a] != 0 {
                let plane = (cell[a] + i128::from(direction[a] > 0)) * CELL;
                let time = ((plane - origin[a]) * direction[a].signum(), direction[a].abs());
                times[a] = Some(time);
                if first.is_none_or(|f| time.0 * f.1 < f.0 * time.1) {
                    first = Some(time);
                }
            }
        }
        let first = first?;
        // A crossing at the time of the one before is tied with it.
        if last.is_none_or(|last: (i128, i128)| last.0 * first.1 < first.0 * last.1) {
            face = None;
        }
        last = Some(first);
        for a in 0..3 {
            if times[a].is_some_and(|t| t.0 * first.1 == first.0 * t.1) {
                cell[a] += direction[a].signum();
                face = face.or(Some(Face::new(a, direction[a] < 0)));
                if sealed {
                    break;
                }
            }
        }
    }
}
