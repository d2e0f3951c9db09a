//! The skin of a model, slice by slice.
//!
//! A larger leaf (SPEC 4.9) is given as all cells of its box, each with the part of the leaf's plane in it
//! ([`PlanePart`]).

use std::ops::Range;

use crate::format::cell::{Plane, PlanePart};
use crate::geom::{BoxIndex, NodeIndex, Octant, VoxelIndex};
use crate::load::{CellItems, CellShape, ModelView, NodeView};

/// Slices read from the octree at a time: a power of two, from 2 on.
const SLAB: u32 = 4;

/// A skin voxel of a slice; ordered by rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct SkinVoxel {
    pub(crate) y: u32,
    pub(crate) x: u32,
    /// Number of the voxel; of a cell of a larger leaf, a number that no voxel has.
    pub(crate) voxel: VoxelIndex,
    pub(crate) leaf: Option<LeafCell>,
}

/// The plane of a larger leaf in one of its cells.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct LeafCell {
    pub(crate) code: u16,
    /// Offset in the cell's coordinates: -127..127 where the plane passes through the cell, more where the cell lies
    /// behind the plane.
    pub(crate) offset: i16,
}

impl LeafCell {
    /// True if the plane passes through the cell.
    pub(crate) fn is_crossed(self) -> bool {
        (-127..127).contains(&self.offset)
    }

    /// The offset as a cell stores it: 127 for a cell that is all inside.
    pub(crate) fn clamped(self) -> i8 {
        i8::try_from(self.offset.clamp(-127, 127)).unwrap_or(i8::MAX)
    }
}

impl SkinVoxel {
    /// The code of the voxel's normal, if the model has normals.
    pub(crate) fn code(&self, view: &ModelView<'_>) -> Option<u16> {
        match self.leaf {
            Some(leaf) => Some(leaf.code),
            None => view.voxel_normal(self.voxel),
        }
    }

    /// True for a part of the surface: not a cell of a larger leaf that the plane misses.
    pub(crate) fn is_surface(&self) -> bool {
        self.leaf.is_none_or(LeafCell::is_crossed)
    }

    /// The surface within a cell.
    pub(crate) fn shape(&self, cells: &CellItems<'_>) -> CellShape {
        match self.leaf {
            Some(leaf) => CellShape::Plane(Plane::new(leaf.code, leaf.clamped())),
            None => cells.shape(self.voxel.get()),
        }
    }

    /// The offset of a cell's plane, or `HAS_CORNERS`.
    pub(crate) fn offset(&self, cells: &CellItems<'_>) -> i16 {
        self.leaf.map_or_else(|| cells.offset(self.voxel.get()).into(), |leaf| leaf.offset)
    }
}

/// A larger leaf and its position.
struct Leaf {
    code: u16,
    plane: PlanePart,
    low: [u32; 3],
    edge: u32,
}

impl Leaf {
    fn of(view: &ModelView<'_>, node: NodeIndex, low: [u32; 3], level: u32) -> Self {
        let (code, offset) = view.leaf_items(node);
        // A damaged model may have leaves at any level.
        let edge = 1 << level.min(MAX_LEAF_LEVEL);
        Self { code, plane: PlanePart::of(Plane::new(code, offset)), low, edge }
    }

    /// The plane in a cell, by the cell's position in the box.
    #[expect(clippy::cast_possible_truncation, reason = "at most 127 (2 x 32 - 1)")]
    fn cell(&self, at: [u32; 3]) -> LeafCell {
        LeafCell { code: self.code, offset: self.plane.cell(self.edge, at).offset() as i16 }
    }

    /// The least or greatest coordinate along an axis of a cell that the plane passes through.
    fn reach(&self, axis: usize, high: bool) -> Option<u32> {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let crossed = |along: u32| {
            (0..self.edge * self.edge).any(|place| {
                let mut at = [along; 3];
                (at[u], at[v]) = (place % self.edge, place / self.edge);
                self.cell(at).is_crossed()
            })
        };
        let mut from_side = (0..self.edge).map(|c| if high { self.edge - 1 - c } else { c });
        from_side.find(|c| crossed(*c)).map(|c| self.low[axis] + c)
    }
}

/// Base-2 logarithm of the largest edge of a leaf.
const MAX_LEAF_LEVEL: u32 = 5;

/// First voxel along each axis, and the one after the last. Cost: about the nodes of six sides.
pub(crate) fn extent(view: &ModelView<'_>) -> Option<[[u32; 3]; 2]> {
    let (mut first, mut end) = ([0; 3], [0; 3]);
    for (axis, (first, end)) in first.iter_mut().zip(&mut end).enumerate() {
        *first = reach(view, axis, false)?;
        *end = reach(view, axis, true)? + 1;
    }
    Some([first, end])
}

/// The least or greatest coordinate of a voxel along an axis. Visits the nodes of the wanted side first, and others
/// only where these end before.
fn reach(view: &ModelView<'_>, axis: usize, high: bool) -> Option<u32> {
    let mut best: Option<u32> = None;
    let mut waiting = vec![(BoxIndex::ROOT, [0_u32; 3], view.depth())];
    let mut visits = 0_u64;
    while let Some((number, corner, level)) = waiting.pop() {
        let (low, edge) = (corner[axis], 1_u32 << level);
        let most = if high { low + edge - 1 } else { low };
        if best.is_some_and(|best| if high { most <= best } else { most >= best }) {
            continue;
        }
        if level == 0 {
            best = Some(low);
            continue;
        }
        if view.is_leaf(number.node()) {
            let leaf = Leaf::of(view, number.node(), corner, level);
            let farther = if high { u32::max } else { u32::min };
            best = best.into_iter().chain(leaf.reach(axis, high)).reduce(farther);
            continue;
        }
        visits += 1;
        if visits > view.node_count() {
            return None;
        }
        for farther in [true, false] {
            // The wanted side is pushed last, to be popped first.
            for octant in Octant::ALL {
                let halves = octant.high();
                if ((halves[axis] == 1) == high) != farther
                    && let Some(child) = view.child(number.node(), octant)
                {
                    let at = std::array::from_fn(|a| corner[a] + halves[a] * edge / 2);
                    waiting.push((child, at, level - 1));
                }
            }
        }
    }
    best
}

/// The skin of one slice after the other, each node visited about twice. Memory: the skin of four slices, 24 bytes a
/// voxel, and of one of them in rows.
pub(crate) struct SkinSlices<'a> {
    view: &'a ModelView<'a>,
    /// Skin of each slice in the order of the file: x increases within a row.
    slices: [Vec<SkinVoxel>; SLAB as usize],
    /// The requested slice, ordered by rows.
    sorted: Vec<SkinVoxel>,
    /// Position of the next voxel of each row.
    rows: Vec<usize>,
    slab: Option<u32>,
    seen: u64,
    /// Columns and rows to which cells of larger leaves are limited.
    bounds: [Range<u32>; 2],
}

impl<'a> SkinSlices<'a> {
    /// Slices of the box from `low` to `end`, in the form of [`extent`].
    pub(crate) fn new(view: &'a ModelView<'a>, [low, end]: [[u32; 3]; 2]) -> Self {
        let slices = std::array::from_fn(|_| Vec::new());
        let bounds = [low[0]..end[0], low[1]..end[1]];
        Self { view, slices, sorted: Vec::new(), rows: Vec::new(), slab: None, seen: 0, bounds }
    }

    /// The skin of slice `z`, ordered by rows. Slices must be requested in order; `None` for a damaged model, which has
    /// more boxes than it states.
    pub(crate) fn slice(&mut self, z: u32) -> Option<&[SkinVoxel]> {
        let first = z / SLAB * SLAB;
        if self.slab != Some(first) {
            self.slices.iter_mut().for_each(Vec::clear);
            let mut left = self.view.node_count() + 1;
            self.descend(BoxIndex::ROOT, [0; 3], self.view.depth(), first, &mut left)?;
            self.slab = Some(first);
        }
        let skin = self.slices.get((z - first) as usize)?;
        self.seen += skin.iter().filter(|found| found.leaf.is_none()).count() as u64;
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
            slice.push(SkinVoxel { y: low[1], x: low[0], voxel, leaf: None });
            return Some(());
        }
        *left = left.checked_sub(1)?;
        let infobyte = self.view.infobyte(number.node());
        if self.view.is_leaf(number.node()) {
            return self.leaf(&Leaf::of(self.view, number.node(), low, level), first..first + SLAB);
        }
        let child = self.view.first_child(number.node());
        if level == 1 {
            return self.voxels(infobyte, child.voxel(self.view.node_count()), low, first);
        }
        let half = 1_u32 << (level - 1);
        if level == 2 && !self.view.has_leaves() {
            // The voxels of a node follow the voxels of the node before it.
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

    /// Adds the cells of a larger leaf in these slices.
    fn leaf(&mut self, leaf: &Leaf, slab: Range<u32>) -> Option<()> {
        let [left, front, low] = leaf.low;
        let [x, y] = [(left, &self.bounds[0]), (front, &self.bounds[1])]
            .map(|(low, within)| low.max(within.start)..(low + leaf.edge).min(within.end));
        for z in slab.start.max(low)..slab.end.min(low + leaf.edge) {
            let slice = self.slices.get_mut((z - slab.start) as usize)?;
            for y in y.clone() {
                slice.extend(x.clone().map(|x| SkinVoxel {
                    y,
                    x,
                    voxel: VoxelIndex::new(u64::MAX),
                    leaf: Some(leaf.cell([x - left, y - front, z - low])),
                }));
            }
        }
        Some(())
    }

    /// Adds the voxels of a node at the lowest level of nodes; all of them lie in the slab.
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
                    leaf: None,
                });
                number = number.wrapping_add(1);
            }
        }
        Some(())
    }
}

/// Orders a slice by rows; the order within a row is kept.
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
