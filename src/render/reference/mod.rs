//! The reference: first hits found slowly, in exact rationals, without an octree.
//!
//! Two independent answers to the same question. [`walk`] steps from voxel to voxel over a plain bit
//! volume; [`nearest_by_slabs`] intersects the ray with every skin voxel. They share nothing with the
//! traversal but the integers of the quantised ray. Comparisons multiply crosswise in i128: no division. Of models of cells
//! [`planes`] asks every cell and larger leaf that the first walk comes to.

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

    /// Decodes an octree, or `None` when it is too deep. Cost: one look at every node.
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

    /// Is the cell skin? Outside the grid nothing is.
    pub fn get(&self, cell: [u32; 3]) -> bool {
        self.index(cell).and_then(|at| self.words.get(at / 64).map(|w| w >> (at % 64) & 1)) == Some(1)
    }
}

/// First hit according to a reference.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReferenceHit {
    /// The skin voxel.
    pub cell: [u32; 3],
    /// Face of entry, of tied axes the first (with `sealed`, the one crossed last); `None` when the ray
    /// starts in the voxel.
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

/// [`walk`] through a grid of 2^depth cells a side, to the first one that `is_met`.
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
    let mut face = ray.entry();
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
        face = None;
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

/// First hit by intersecting the ray with each of `cells` and taking the earliest.
pub fn nearest_by_slabs(cells: impl Iterator<Item = [u32; 3]>, ray: &Ray) -> Option<ReferenceHit> {
    let (origin, direction) = (ray.origin().map(i128::from), ray.direction().map(i128::from));
    nearest_ideal(cells, origin, direction, CELL, ray.entry())
}

/// [`nearest_by_slabs`] for a ray of any integers: `cell_units` units of the origin make a cell, and the
/// origin may lie outside the grid; `entry` is what is reported when the ray starts in the hit.
///
/// Separates the error of quantising a ray from that of traversing it. The product of an
/// origin difference and a direction must fit an i128.
pub fn nearest_ideal(
    cells: impl Iterator<Item = [u32; 3]>,
    origin: [i128; 3],
    direction: [i128; 3],
    cell_units: i128,
    entry: Option<Face>,
) -> Option<ReferenceHit> {
    let mut best: Option<((i128, i128), ReferenceHit)> = None;
    'cells: for cell in cells {
        // The ray is in the cell for enter <= t < leave; times are fractions n / d with d > 0.
        let mut enter = (0, 1);
        let mut leave: Option<(i128, i128)> = None;
        let mut face = entry;
        for a in 0..3 {
            let (low, high) = (i128::from(cell[a]) * cell_units, (i128::from(cell[a]) + 1) * cell_units);
            let d = direction[a];
            if d == 0 {
                if origin[a] < low || origin[a] >= high {
                    continue 'cells;
                }
                continue;
            }
            let (near, far) = if d > 0 { (low, high) } else { (high, low) };
            let t_near = ((near - origin[a]) * d.signum(), d.abs());
            let t_far = ((far - origin[a]) * d.signum(), d.abs());
            if t_near.0 * enter.1 > enter.0 * t_near.1 {
                enter = t_near;
                face = Some(Face::new(a, d < 0));
            }
            if leave.is_none_or(|l| t_far.0 * l.1 < l.0 * t_far.1) {
                leave = Some(t_far);
            }
        }
        if leave.is_none_or(|l| enter.0 * l.1 >= l.0 * enter.1) {
            continue;
        }
        if best.is_none_or(|(b, _)| enter.0 * b.1 < b.0 * enter.1) {
            best = Some((enter, ReferenceHit { cell, face }));
        }
    }
    best.map(|(_, hit)| hit)
}
