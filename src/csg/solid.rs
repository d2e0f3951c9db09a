//! A tree as a solid of the builder: programs for columns, slabs and boxes, bits row by row, normals at the skin.
//!
//! ```text
//!   tree --column--> program --slab--> program --64 columns--> program of a box, often one leaf long
//!                                                                └─ bits of 34 rows a slice, normals of skin voxels
//! ```
//!
//! The rest of a program in a box decides the cost of the box. Programs of boxes have a limited number of steps, and
//! wait in a store of fixed size; where that is full, the program of a larger box is used, with the same result.

use std::path::{Path, PathBuf};

use super::leaf::{Extent, Leaf, Nested, Rows};
use super::place::LatticeGrid;
use super::program::{self, Apart, Inverse, STACK, Step};
use super::sampled::{ROWS, SampledLeaf, Sampler};
use super::skin_normals::Description;
use crate::builder::{
    BuildError, BuildFault, Cover, ItemForm, OccupancyRows, ScanSummary, SkinSlice, Solid, SolidWorker, Tile,
    VoxelBox,
};
use crate::fault::Fault;
use crate::format::{Channel, Metadata, SourceMeta};
use crate::geom::Dims;
use crate::identity::file_identity;
use crate::mesh::Crossings;
use crate::volume::SourceError;

/// Slices of a slab, and columns of a box.
const SLAB: u32 = 32;
const BOX: u32 = 64;
/// Most steps of the programs of a slab's boxes that are kept, and of the program of one box.
const STORE: usize = 1 << 15;
const MAX_STEPS: usize = 1 << 13;
/// The source of its normals, for the model.
const ESTIMATOR: &str = "analytic";

/// A tree that has been placed on a grid.
pub(super) struct CsgSolid<'a> {
    pub(super) name: String,
    pub(super) place: LatticeGrid,
    pub(super) leaves: Vec<Leaf>,
    pub(super) extents: Vec<Extent>,
    pub(super) program: Vec<Step>,
    pub(super) sampled: Vec<SampledLeaf<'a>>,
    /// Leaves and steps of the program, which determine the memory of workers.
    pub(super) counts: [usize; 2],
    /// The text, and its identity before it was read.
    pub(super) text: Option<(PathBuf, u64)>,
}

/// Leaves to keep of those that lie within each other in a box.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Keep {
    /// All leaves: skin asks which of them makes it.
    All,
    /// Leaves that decide which voxels are inside, and where edges are crossed.
    Outermost,
    /// The leaves of a union that contain no other leaf.
    Innermost,
}

/// Number of levels of boxes within boxes: halves of a tile.
fn levels(tile: &Tile) -> usize {
    tile.columns.div_ceil(BOX).max(1).ilog2() as usize + 2
}

impl CsgSolid<'_> {
    fn store(&self, tile: &Tile) -> usize {
        (self.counts[1] * tile.columns.div_ceil(BOX) as usize).min(STORE)
    }

    /// Memory held beyond the workers'.
    pub(super) fn bytes(&self) -> u64 {
        let own: u64 = self.leaves.iter().map(Leaf::bytes).sum();
        let lists = self.leaves.capacity() * size_of::<Leaf>()
            + self.extents.capacity() * size_of::<Extent>()
            + self.program.capacity() * size_of::<Step>();
        own + lists as u64
    }

    /// Most steps of the program of a box.
    pub(super) fn most_steps(&self) -> usize {
        self.counts[1].min(MAX_STEPS)
    }

    /// Cover of a box by a leaf that is not sampled.
    #[inline]
    fn cover(&self, leaf: u32, region: &VoxelBox) -> Cover {
        if self.extents[leaf as usize].misses(region) {
            return Cover::Outside;
        }
        self.leaves[leaf as usize].cover(region)
    }

    /// The rest of a program in a box; `None` where it has no room.
    pub(super) fn prune(
        &self,
        steps: &[Step],
        region: &VoxelBox,
        keep: Keep,
        out: &mut Vec<Step>,
    ) -> Option<Cover> {
        self.prune_by(|leaf| self.cover(leaf, region), steps, region, keep, out)
    }

    /// The same, with covers of leaves that are known.
    pub(super) fn prune_by(
        &self,
        cover: impl FnMut(u32) -> Cover,
        steps: &[Step],
        region: &VoxelBox,
        keep: Keep,
        out: &mut Vec<Step>,
    ) -> Option<Cover> {
        match keep {
            Keep::All => program::prune(steps, cover, &Apart, out),
            Keep::Outermost => program::prune(steps, cover, &Nested::new(&self.leaves, region), out),
            Keep::Innermost => program::prune(steps, cover, &Inverse(Nested::new(&self.leaves, region)), out),
        }
    }

    /// True for a voxel inside a leaf that is not sampled.
    #[inline]
    pub(super) fn contains(&self, leaf: u32, voxel: [i32; 3]) -> bool {
        self.extents[leaf as usize].holds(voxel) && self.leaves[leaf as usize].contains(voxel)
    }

    /// Bits of a leaf that is not sampled, of 64 voxels of every row.
    fn fill(&self, leaf: u32, at: Rows, out: &mut [u64], crossings: &mut Crossings) {
        let rows = self.extents[leaf as usize].rows(at.y, out.len());
        out[..rows.start].fill(0);
        out[rows.end..].fill(0);
        let at = Rows { y: at.y + i32::try_from(rows.start).unwrap_or(0), ..at };
        self.leaves[leaf as usize].fill(at, &mut out[rows], crossings);
    }
}

impl Solid for CsgSolid<'_> {
    fn dims(&self) -> Dims {
        self.place.dims
    }

    /// The metadata: the same for every text of the same tree.
    fn metadata(&self, _: &ScanSummary) -> Metadata {
        let LatticeGrid { dims, affine, spacing_mm, .. } = self.place;
        Metadata {
            source: SourceMeta { format: "csg".into(), kind: "tree of solids".into(), files: 0, bytes: 0 },
            spacing_mm,
            affine: affine.rows,
            gradient: ESTIMATOR.into(),
            ..Metadata::of_grid(dims, "tree of solids")
        }
    }

    fn name(&self) -> String {
        self.name.clone()
    }

    fn for_each_file(&self, each: &mut dyn FnMut(&Path)) {
        self.text.iter().for_each(|(path, _)| each(path));
        self.sampled.iter().for_each(|leaf| leaf.solid.for_each_file(each));
    }

    fn check_unchanged(&self) -> Result<(), SourceError> {
        if let Some((path, then)) = &self.text
            && file_identity(path) != *then
        {
            return Err(Fault::changed().at(path).into());
        }
        self.sampled.iter().try_for_each(|leaf| leaf.solid.check_unchanged())
    }

    fn form(&self, channel: Channel, _: &ScanSummary) -> Option<ItemForm> {
        (channel == Channel::Normal).then_some(ItemForm::AsIs { bytes: 2 })
    }

    fn worker_bytes(&self, tile: &Tile) -> u64 {
        let boxes = tile.columns.div_ceil(BOX) as usize;
        let programs = 2 * self.store(tile) + (levels(tile) + 3) * self.most_steps();
        let own = programs * size_of::<Step>() + 2 * boxes * size_of::<BoxProgram>() + STACK * ROWS * 8;
        let sampled: u64 =
            self.sampled.iter().map(|leaf| leaf.solid.worker_bytes(tile) + Sampler::bytes(tile)).sum();
        own as u64
            + Crossings::bytes(1, ROWS)
            + Description::bytes(self.counts[0], self.most_steps())
            + sampled
    }

    fn input_bytes(&self) -> u64 {
        self.sampled.iter().map(|leaf| leaf.solid.input_bytes()).sum()
    }

    fn worker(&self, tile: &Tile) -> Box<dyn SolidWorker + '_> {
        Box::new(CsgWorker::new(self, tile, Keep::All))
    }

    fn nothing_inside(&self) -> BuildError {
        BuildError::from(BuildFault::nothing_inside(self.name.clone()))
    }
}

/// The program of a box of 64 columns of a slab.
#[derive(Clone, Copy, Debug)]
enum BoxProgram {
    /// No program is known: the column's is used.
    Unknown,
    Uniform(bool),
    /// Its program: a part of the slab's steps.
    Steps {
        first: u32,
        count: u32,
    },
}

struct Slab {
    number: u32,
    kept: Vec<BoxProgram>,
    steps: Vec<Step>,
}

/// A box, and the rest of the program in it.
struct Level {
    region: VoxelBox,
    steps: Vec<Step>,
}

/// One thread's view of the tree.
pub(super) struct CsgWorker<'a> {
    solid: &'a CsgSolid<'a>,
    column: VoxelBox,
    keep: Keep,
    /// The program of the column, unless it is the whole tree's.
    whole: Vec<Step>,
    is_whole: bool,
    /// Boxes within each other, the smallest last, and lists that are not in use.
    levels: Vec<Level>,
    most_levels: usize,
    unused: Vec<Vec<Step>>,
    slabs: [Slab; 2],
    stack: Vec<u64>,
    slice: Vec<Step>,
    crossings: Crossings,
    samplers: Vec<Sampler<'a>>,
    description: Description,
}

/// A pruned program, or its uniform value.
#[derive(Clone, Copy, Debug)]
pub(super) enum Remainder<'p> {
    Uniform(bool),
    Steps(&'p [Step]),
}

fn grown(range: &std::ops::Range<u32>, by: u32, n: u32) -> std::ops::Range<u32> {
    range.start.saturating_sub(by)..(range.end + by).min(n)
}

fn holds(outer: &VoxelBox, inner: &VoxelBox) -> bool {
    let within = |a: &std::ops::Range<u32>, b: &std::ops::Range<u32>| a.start <= b.start && b.end <= a.end;
    within(&outer.x, &inner.x) && within(&outer.y, &inner.y) && within(&outer.z, &inner.z)
}

fn as_i32(of: u32) -> i32 {
    i32::try_from(of).unwrap_or(i32::MAX)
}

fn box_of(column: &VoxelBox, x: i64) -> usize {
    let last = column.x.len().div_ceil(BOX as usize).max(1) - 1;
    let at = (x - i64::from(column.x.start)).div_euclid(i64::from(BOX));
    usize::try_from(at.max(0)).unwrap_or(0).min(last)
}

/// The rest of the program in a box of a slab.
fn left<'p>(slabs: &'p [Slab; 2], whole: &'p [Step], z: u32, at: usize) -> Remainder<'p> {
    let slab = &slabs[(z / SLAB) as usize % 2];
    let kept = slab.kept.get(at).filter(|_| slab.number == z / SLAB).copied();
    match kept {
        Some(BoxProgram::Uniform(inside)) => Remainder::Uniform(inside),
        Some(BoxProgram::Steps { first, count }) => {
            Remainder::Steps(&slab.steps[first as usize..][..count as usize])
        }
        Some(BoxProgram::Unknown) | None => Remainder::Steps(whole),
    }
}

impl<'a> CsgWorker<'a> {
    pub(super) fn new(solid: &'a CsgSolid<'_>, tile: &Tile, keep: Keep) -> Self {
        let boxes = tile.columns.div_ceil(BOX) as usize;
        let slab = || Slab {
            number: u32::MAX,
            kept: Vec::with_capacity(boxes),
            steps: Vec::with_capacity(solid.store(tile)),
        };
        Self {
            column: VoxelBox { x: 0..0, y: 0..0, z: 0..0 },
            keep,
            whole: Vec::with_capacity(solid.most_steps()),
            is_whole: false,
            most_levels: levels(tile),
            levels: Vec::with_capacity(levels(tile)),
            unused: (0..=levels(tile)).map(|_| Vec::with_capacity(solid.most_steps())).collect(),
            slabs: [slab(), slab()],
            stack: vec![0; STACK * ROWS],
            slice: Vec::with_capacity(solid.most_steps()),
            crossings: Crossings::new(1, ROWS),
            samplers: solid.sampled.iter().map(|leaf| Sampler::new(leaf, solid.place.dims, tile)).collect(),
            description: Description::new(solid.leaves.len(), solid.most_steps()),
            solid,
        }
    }

    /// Prepares the sampled leaves, if there are any, for a slice.
    pub(super) fn ready(&mut self, z: u32) -> Result<(), SourceError> {
        if self.samplers.is_empty() { Ok(()) } else { self.reach(z) }
    }

    /// The rest of the program around a brick's slice, the samplers, and a buffer for crossings of rows.
    pub(super) fn near(
        &mut self,
        skin: &SkinSlice<'_>,
    ) -> (&CsgSolid<'a>, &[Step], &mut [Sampler<'a>], &mut Crossings) {
        let [x, _, z] = skin.corner();
        let at = self.box_of(x.into());
        let Self { solid, slabs, whole, is_whole, samplers, description, crossings, .. } = self;
        let whole = if *is_whole { &solid.program } else { whole };
        (solid, description.look(skin, solid, left(slabs, whole, z, at)), samplers, crossings)
    }
}

impl CsgWorker<'_> {
    /// The number of the box of 64 columns that a column of voxels lies in; the outermost for those outside the tile.
    fn box_of(&self, x: i64) -> usize {
        box_of(&self.column, x)
    }

    /// Prepares all sampled leaves that the column meets for a slice.
    fn reach(&mut self, z: u32) -> Result<(), SourceError> {
        let whole = if self.is_whole { &self.solid.program } else { &self.whole };
        for step in whole {
            if let Some((leaf, _)) = program::leaf_of(*step)
                && let Leaf::Sampled(at) = self.solid.leaves[leaf as usize]
            {
                self.samplers[at as usize].reach(z)?;
            }
        }
        Ok(())
    }

    /// Stores the cover of the boxes of a region.
    fn keep(&mut self, region: &VoxelBox, slab: u32, cover: Cover, steps: &[Step]) {
        let first = self.box_of(i64::from(region.x.start) + i64::from(region.x.start > self.column.x.start));
        let first = if region.x.start < self.column.x.start { 0 } else { first };
        let last = self.box_of(i64::from(region.x.end) - 1 - i64::from(region.x.end < self.column.x.end));
        let slab = &mut self.slabs[slab as usize % 2];
        match cover {
            Cover::Mixed if first == last => {
                if slab.steps.len() + steps.len() <= slab.steps.capacity() {
                    let at = slab.steps.len();
                    slab.steps.extend_from_slice(steps);
                    let number = |n: usize| u32::try_from(n).unwrap_or(0);
                    slab.kept[first] = BoxProgram::Steps { first: number(at), count: number(steps.len()) };
                }
            }
            Cover::Mixed => {}
            cover => slab.kept[first..=last].fill(BoxProgram::Uniform(cover == Cover::Inside)),
        }
    }
}

impl SolidWorker for CsgWorker<'_> {
    fn start(&mut self, column: &VoxelBox) -> Result<(), SourceError> {
        self.column = column.clone();
        for slab in &mut self.slabs {
            slab.number = u32::MAX;
        }
        self.levels.drain(..).for_each(|level| self.unused.push(level.steps));
        let [nx, ny, nz] = self.solid.place.dims.to_array();
        let around =
            VoxelBox { x: grown(&column.x, 1, nx), y: grown(&column.y, 1, ny), z: grown(&column.z, 2, nz) };
        let cover = self.solid.prune(&self.solid.program, &around, self.keep, &mut self.whole);
        // Where all is in or out no program is left: boxes know it, and it is seldom needed.
        self.is_whole = cover != Some(Cover::Mixed);
        self.samplers.iter_mut().try_for_each(|sampler| sampler.start(column))
    }

    fn cover(&mut self, region: &VoxelBox) -> Cover {
        let number = region.z.start.div_ceil(SLAB);
        let slab = &mut self.slabs[number as usize % 2];
        if slab.number != number {
            slab.number = number;
            slab.kept.clear();
            slab.kept.resize(self.column.x.len().div_ceil(BOX as usize), BoxProgram::Unknown);
            slab.steps.clear();
        }
        // `number` names only boxes within the slab.
        let is_slab = region.z.end <= (number + 1) * SLAB + 1;
        while let Some(level) = self.levels.pop_if(|level| !holds(&level.region, region)) {
            self.unused.push(level.steps);
        }
        let Some(mut steps) = self.unused.pop() else { return Cover::Mixed };
        let whole = if self.is_whole { &self.solid.program } else { &self.whole };
        let above = self.levels.last().map_or(whole, |level| &level.steps);
        let Self { solid, samplers, keep, .. } = self;
        let of_leaf = |leaf| match &solid.leaves[leaf as usize] {
            Leaf::Sampled(at) if is_slab => samplers[*at as usize].worker.cover(region),
            _ => solid.cover(leaf, region),
        };
        let cover = solid.prune_by(of_leaf, above, region, *keep, &mut steps);
        if let (true, Some(cover)) = (is_slab, cover) {
            self.keep(region, number, cover, &steps);
        }
        let is_narrow = region.x.len() <= BOX as usize + 2;
        if cover == Some(Cover::Mixed) && !is_narrow && self.levels.len() < self.most_levels {
            self.levels.push(Level { region: region.clone(), steps });
        } else {
            self.unused.push(steps);
        }
        cover.unwrap_or(Cover::Mixed)
    }

    fn occupancy(&mut self, rows: &mut OccupancyRows<'_>) -> Result<(), SourceError> {
        let (x, y, z) = (rows.x(), rows.y(), rows.z());
        self.ready(z)?;
        let Self { solid, column, slabs, whole, is_whole, stack, slice, crossings, samplers, .. } = self;
        let whole = if *is_whole { &solid.program } else { whole };
        let count = y.len();
        let width = rows.row_mut(y.start).len();
        let from = rows.origin();
        for word in 0..width {
            let first = from + 64 * i64::try_from(word).unwrap_or(0);
            if first >= i64::from(x.end) || first + 64 <= i64::from(x.start) {
                continue;
            }
            let near = match left(slabs, whole, z, box_of(column, first)) {
                Remainder::Uniform(inside) => Remainder::Uniform(inside),
                Remainder::Steps(steps) => {
                    // Less matters in a slice of the box than in all of it.
                    let columns = i64::from(x.start).max(first)..i64::from(x.end).min(first + 64);
                    let at = |column: i64| u32::try_from(column).unwrap_or(0);
                    let x = at(columns.start)..at(columns.end);
                    let region = VoxelBox { x, y: y.clone(), z: z..z + 1 };
                    match solid.prune(steps, &region, Keep::Outermost, slice) {
                        Some(Cover::Mixed) => Remainder::Steps(slice),
                        None => Remainder::Steps(steps),
                        Some(cover) => Remainder::Uniform(cover == Cover::Inside),
                    }
                }
            };
            match near {
                Remainder::Uniform(inside) => {
                    let bits = if inside { u64::MAX } else { 0 };
                    y.clone().for_each(|y| rows.row_mut(y)[word] = bits);
                }
                Remainder::Steps(near) => {
                    let place =
                        Rows { x: i32::try_from(first).unwrap_or(0), y: as_i32(y.start), z: as_i32(z) };
                    program::rows_of(near, stack, count, |leaf, out| match &solid.leaves[leaf as usize] {
                        Leaf::Sampled(at) => {
                            let sampler = &samplers[*at as usize];
                            for (word, y) in out.iter_mut().zip(i64::from(y.start)..) {
                                *word = sampler.word(first, y, z);
                            }
                        }
                        _ => solid.fill(leaf, place, out, crossings),
                    });
                    for (y, bits) in y.clone().zip(stack.iter()) {
                        rows.row_mut(y)[word] = *bits;
                    }
                }
            }
        }
        Ok(())
    }

    fn describe(&mut self, skin: &SkinSlice<'_>) -> Result<(), SourceError> {
        let [x, _, z] = skin.corner();
        self.ready(z + 2)?;
        let at = self.box_of(x.into());
        let Self { solid, slabs, whole, is_whole, samplers, description, .. } = self;
        let whole = if *is_whole { &solid.program } else { whole };
        description.describe(skin, solid, left(slabs, whole, z, at), samplers)
    }

    fn items(&self, _: Channel) -> &[u8] {
        self.description.codes()
    }

    fn found(&self) -> ScanSummary {
        let samplers = self.samplers.iter().map(|sampler| sampler.worker.found());
        ScanSummary {
            extent: ScanSummary::default().extent,
            ..samplers.fold(ScanSummary::default(), ScanSummary::join)
        }
    }
}
