//! A mesh as a solid of the builder: bits from crossings, normals of the nearest triangle, bin by bin.
//!
//! ```text
//!   bin of 32 rows x 32 slices --blocks--> resident triangles, of as many slices as fit
//!   slice z+2   rows cross triangles, sums of crossings become bits
//!   slice z     skin voxels seek their nearest triangle within a voxel, then within two
//! ```
//!
//! As many slices are loaded as fit. Where the triangles of one slice alone do not fit, its rows cross blocks as they
//! are read, and its voxels are described by as many bricks at a time as fit; a brick that does not fit reads its
//! blocks, too. So two workers, each with room for some thousand triangles, read bins a few times instead of once for
//! every brick and slice.
#![expect(clippy::cast_possible_truncation, reason = "coordinates are below 2^16")]

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::bins::{BEYOND, BinTriangle, Bins, BlockBuffers, Record, held, numbered};
use super::cells::Cells;
use super::crossed::cross_edges;
use super::lattice::{Grid, HALF, STEPS, Triangle, first_centre, last_centre, span};
use super::nearest::{Facet, Nearest};
use super::paint::{Paint, PaintChannels, Painter};
use super::prism::Prism;
use super::raster::{Crossings, Rule, cross_slice};
use super::reach::Reach;
use super::resident::{Resident, bricks_of, slices};
use crate::builder::{
    BuildError, BuildFault, CellEdges, Cover, EdgeCrossing, Exposed, ItemForm, OccupancyRows, ScanSummary,
    SkinSlice, Solid, SolidWorker, Tile, VoxelBox,
};
use crate::cpu::{Kernel, Lanes, dispatch};
use crate::fault::{Fault, unfit};
use crate::format::{Channel, Metadata, SourceMeta, normal};
use crate::geom::Dims;
use crate::identity::file_identity;
use crate::text::names::FILL;
use crate::volume::SourceError;

/// Rows and columns of a brick.
const BRICK: usize = 32;
/// Rows of a column with one more on either side.
const ROWS: usize = BRICK + 2;
/// A voxel's edge, squared, in lattice steps, with room for the rounding of distances.
const VOXEL_SQUARED: f64 = 16_777_217.0;
/// Distance within which the nearest triangle is sought, and its square: one voxel, two where the thick skin has voxels
/// that touch the outside with a corner only.
const REACHES: [(i32, f64); 2] = [(STEPS, VOXEL_SQUARED), (2 * STEPS, 4.0 * VOXEL_SQUARED)];
/// The source of its normals, for the model.
const ESTIMATOR: &str = "nearest triangle";

/// The voxels inside a mesh whose triangles have been binned.
pub(crate) struct MeshSolid {
    pub(super) name: String,
    pub(super) grid: Grid,
    pub(super) bins: Bins,
    pub(super) rule: Rule,
    /// True if every row is outside again after its last crossing.
    pub(super) closed: bool,
    /// True if open edges were closed by caps.
    pub(super) open: bool,
    /// Triangles that a worker has room for.
    pub(super) resident: usize,
    /// Extent of the inside.
    pub(super) reach: Arc<Reach>,
    /// The files, and their identities before they were read.
    pub(super) inputs: Vec<(PathBuf, u64)>,
    /// Colours, parts and smooth normals, if there are any.
    pub(super) wanted: Option<PaintChannels>,
    pub(super) paint: Option<Paint>,
}

/// Words of a row of a tile, with one on either side.
pub(crate) fn row_words(tile: &Tile) -> usize {
    tile.columns.div_ceil(64) as usize + 2
}

/// Memory of a worker without its resident triangles.
pub(super) fn fixed_bytes(tile: &Tile) -> u64 {
    Crossings::bytes(row_words(tile), ROWS)
        + BlockBuffers::BYTES
        + Cells::BYTES
        + (SkinSlice::MAX_VOXELS * (size_of::<Nearest>() + 2)) as u64
}

impl Solid for MeshSolid {
    fn dims(&self) -> Dims {
        self.grid.dims
    }

    /// The same for every file of the same solid: neither format, size nor number of triangles.
    fn metadata(&self, _: &ScanSummary) -> Metadata {
        let Grid { dims, voxel_mm, origin_mm, .. } = self.grid;
        let mut affine = [[0.0; 4]; 3];
        for (axis, row) in affine.iter_mut().enumerate() {
            row[axis] = voxel_mm;
            row[3] = origin_mm[axis] + voxel_mm / 2.0;
        }
        Metadata {
            source: SourceMeta { format: "mesh".into(), kind: "triangle mesh".into(), files: 0, bytes: 0 },
            spacing_mm: [voxel_mm; 3],
            affine,
            gradient: ESTIMATOR.into(),
            ..Metadata::of_grid(dims, "triangle mesh")
        }
    }

    fn name(&self) -> String {
        self.name.clone()
    }

    fn nothing_inside(&self) -> BuildError {
        let name = self.name.clone();
        if self.open {
            return BuildFault::Said { name, fault: unfit!("no voxel is inside, as the mesh is open and its caps enclose too little; {FILL} surface builds skin of the voxels that it passes through, and a finer grid may help") }.into();
        }
        BuildFault::nothing_inside(name).into()
    }

    fn for_each_file(&self, each: &mut dyn FnMut(&Path)) {
        self.inputs.iter().for_each(|(path, _)| each(path));
    }

    /// Fails if a file has changed: each pass relies on the findings of the one before.
    fn check_unchanged(&self) -> Result<(), SourceError> {
        match self.inputs.iter().find(|(path, then)| file_identity(path) != *then) {
            Some((path, _)) => Err(Fault::changed().at(path).into()),
            None => Ok(()),
        }
    }

    fn form(&self, channel: Channel, _: &ScanSummary) -> Option<ItemForm> {
        match channel {
            Channel::Normal => Some(ItemForm::AsIs { bytes: 2 }),
            _ => self.wanted?.form(channel),
        }
    }

    fn worker_bytes(&self, tile: &Tile) -> u64 {
        let paint = if self.wanted.is_some() { Painter::BYTES } else { 0 };
        paint + fixed_bytes(tile) + Resident::bytes(self.resident, tile.columns.div_ceil(32) as usize)
    }

    fn worker(&self, tile: &Tile) -> Box<dyn SolidWorker + '_> {
        Box::new(MeshWorker::new(self, tile))
    }
}

/// One thread's view of the bins.
pub(crate) struct MeshWorker<'a> {
    solid: &'a MeshSolid,
    column: VoxelBox,
    /// Slices and bricks whose skin the loaded triangles describe; fewer bricks than the tile has belong to a single
    /// slice, and none are described where not even a brick's triangles fit.
    run: (i32, i32),
    bricks: Range<usize>,
    /// Counts of the current bin, if not all of it has room.
    needs: Needs,
    resident: Resident,
    buffers: BlockBuffers,
    crossings: Crossings,
    /// Slices whose rows were crossed and whose triangles were gathered last.
    crossed: Option<u32>,
    gathered: Option<(i32, i32)>,
    nearest: Vec<Nearest>,
    cells: Cells,
    codes: Vec<u8>,
    pub(super) painter: Option<Painter<'a>>,
}

impl<'a> MeshWorker<'a> {
    pub(super) fn new(solid: &'a MeshSolid, tile: &Tile) -> Self {
        let words = row_words(tile);
        Self {
            solid,
            column: VoxelBox { x: 0..0, y: 0..0, z: 0..0 },
            run: (0, 0),
            bricks: 0..0,
            needs: Needs::NONE,
            resident: Resident::new(solid.resident, tile.columns.div_ceil(32) as usize),
            buffers: BlockBuffers::new(),
            crossings: Crossings::new(words, ROWS),
            crossed: None,
            gathered: None,
            nearest: vec![Nearest::within(0.0); SkinSlice::MAX_VOXELS],
            cells: Cells::new(),
            codes: Vec::with_capacity(2 * SkinSlice::MAX_VOXELS),
            painter: solid.paint.as_ref().map(Painter::new),
        }
    }
}

impl MeshWorker<'_> {
    /// Calls `act` with every triangle that may be within a voxel of a brick's slice, some of them more than once.
    pub(super) fn each_near(
        &mut self,
        skin: &SkinSlice<'_>,
        act: &mut impl FnMut(&Triangle),
    ) -> Result<(), SourceError> {
        let [x0, _, z] = skin.corner().map(|c| c as i32);
        let brick = (x0 - self.column.x.start as i32) as usize / BRICK;
        let fits = self.seek_brick(z, brick)?;
        let Self { resident, solid, buffers, column, gathered, .. } = self;
        if fits {
            if *gathered != Some((z, 1)) {
                resident.gather(z, 1);
                *gathered = Some((z, 1));
            }
            resident.near(z, brick, 1, &mut |_, t| act(&t.triangle()));
            return Ok(());
        }
        solid.bins.for_each_block(column.y.start, z as u32, buffers, &mut |block| {
            held(block).for_each(|t| act(&t.triangle()));
            true
        })
    }

    /// Loads the triangles for describing slice `z` and for the bits two slices ahead, if they have room.
    fn seek(&mut self, z: i32) -> Result<(), SourceError> {
        if (self.run.0..self.run.1).contains(&z) {
            return Ok(());
        }
        let Self { resident, buffers, solid, column, .. } = self;
        let (row, x0) = (column.y.start, column.x.start as i32);
        let all = 0..resident.bricks();
        let mut end = (z | 31) + 1;
        if 4 * solid.bins.triangles(row, z as u32) as usize > resident.room() {
            if self.needs.bin != (row, z >> 5) {
                self.needs = Needs::count(solid, buffers, column, z)?;
            }
            while end > z && self.needs.places(z, end) > resident.room() {
                end -= 1;
            }
        }
        self.gathered = None;
        loop {
            resident.clear(z, x0, all.clone());
            let bin = (row, z as u32);
            let fits = end > z && resident.load(&solid.bins, bin, z..end, x0, all.clone(), buffers)?;
            if fits || end <= z + 1 {
                self.bricks = if fits { all } else { 0..0 };
                break;
            }
            end = z + (end - z) / 2;
        }
        self.run = (z, end.max(z + 1));
        resident.settle();
        Ok(())
    }

    /// Finds the bits of slice `z`, of all rows and columns of the tile and one more on every side.
    fn cross(&mut self, z: u32) -> Result<(), SourceError> {
        let slice = z as i32;
        let described = slice - BEYOND;
        let (first, last) = (self.column.z.start as i32, self.column.z.end as i32 - 1);
        self.seek(described.clamp(first, last))?;
        let top = self.column.y.start as i32 - 1;
        let bottom = self.column.y.end as i32 + 1;
        let left = i64::from(self.column.x.start) - 64;
        let Self { resident, crossings, solid, buffers, column, bricks, .. } = self;
        let mut each = |t: &BinTriangle<'_>| {
            cross_slice(&t.triangle(), slice, top, bottom, &mut |row, column, sign| {
                crossings.add((row - top) as usize, column - left, sign);
            });
        };
        if bricks.len() == resident.bricks() {
            resident.crossed(slice, &mut each);
        } else {
            solid.bins.for_each_block(column.y.start, self.run.0 as u32, buffers, &mut |block| {
                for t in held(block) {
                    let (low, high) = slices(&t);
                    if low <= slice && slice <= high {
                        each(&t);
                    }
                }
                true
            })?;
        }
        crossings.settle(solid.rule);
        let rows = column.y.clone().map(|y| (y as i32, crossings.row((y as i32 - top) as usize)));
        solid.reach.add(slice, column, left, rows);
        self.crossed = Some(z);
        Ok(())
    }

    /// Loads the triangles of a brick's slice, and of as many bricks behind it as fit; `false` if its own do not.
    fn seek_brick(&mut self, z: i32, brick: usize) -> Result<bool, SourceError> {
        self.seek(z)?;
        if self.bricks.contains(&brick) {
            return Ok(true);
        }
        let Self { resident, buffers, solid, column, .. } = self;
        let (row, x0) = (column.y.start, column.x.start as i32);
        // Places that are first wanted for each brick.
        let mut counts = [0_u32; BRICK];
        solid.bins.for_each_block(row, z as u32, buffers, &mut |block| {
            for t in held(block) {
                let (low, high) = slices(&t);
                let (from, to) = bricks_of(&t, x0);
                let from = from - brick as i32;
                if low < z + 1 + BEYOND && high >= z - BEYOND && to >= brick as i32 && from < BRICK as i32 {
                    counts[from.max(0) as usize] += Resident::places(&t, from + brick as i32, to);
                }
            }
            true
        })?;
        let mut sum = 0;
        let fits = counts.iter().take_while(|count| {
            sum += **count as usize;
            sum <= resident.room()
        });
        let mut end = resident.bricks().min(brick + fits.count());
        self.gathered = None;
        self.bricks = 0..0;
        while end > brick {
            if resident.load(&solid.bins, (row, z as u32), z..z + 1, x0, brick..end, buffers)? {
                resident.settle();
                self.bricks = brick..end;
                break;
            }
            end = brick + (end - brick) / 2;
        }
        Ok(!self.bricks.is_empty())
    }

    /// Offers every triangle that may be within `reach` lattice steps to the skin voxels of a brick's slice.
    fn offer(&mut self, skin: &SkinSlice<'_>, wanted: &[u32; BRICK], reach: i32) -> Result<(), SourceError> {
        let [x0, y0, z] = skin.corner().map(|c| c as i32);
        let brick = (x0 - self.column.x.start as i32) as usize / BRICK;
        let fits = self.seek_brick(z, brick)?;
        let Self { resident, nearest, solid, buffers, column, gathered, cells, .. } = self;
        let mut offered = SliceSearch { corner: [x0, y0, z], wanted, reach, cells, nearest };
        if fits {
            let voxels = reach / STEPS;
            if *gathered != Some((z, voxels)) {
                resident.gather(z, voxels);
                *gathered = Some((z, voxels));
            }
            dispatch(OfferNear { resident, offered: &mut offered, brick });
            return Ok(());
        }
        solid.bins.for_each_block(column.y.start, z as u32, buffers, &mut |block| {
            let record = |number: u32| &block[number as usize];
            numbered(block).for_each(|(number, t)| offered.add(number, &t, record));
            offered.finish(record);
            true
        })
    }
}

/// Places that the slices of a bin need, from which the number of slices that fit follows.
struct Needs {
    /// Row and slab of the bin.
    bin: (u32, i32),
    /// Places of triangles that are needed from a slice on, and those that no slice from it on needs.
    begin: [u32; BRICK],
    ended: [u32; BRICK],
}

impl Needs {
    const NONE: Self = Self { bin: (u32::MAX, -1), begin: [0; BRICK], ended: [0; BRICK] };

    fn count(
        solid: &MeshSolid,
        buffers: &mut BlockBuffers,
        column: &VoxelBox,
        z: i32,
    ) -> Result<Self, SourceError> {
        let (row, slab, x0) = (column.y.start, z >> 5, column.x.start as i32);
        let mut needs = Self { bin: (row, slab), ..Self::NONE };
        solid.bins.for_each_block(row, z as u32, buffers, &mut |block| {
            for t in held(block) {
                let (low, high) = slices(&t);
                let (from, to) = bricks_of(&t, x0);
                let places = Resident::places(&t, from, to);
                let (first, end) = (low - BEYOND - (slab << 5), high + BEYOND + 1 - (slab << 5));
                if let Some(begin) = needs.begin.get_mut(first.max(0) as usize) {
                    *begin += places;
                    if let Some(ended) = needs.ended.get_mut(end.max(0) as usize) {
                        *ended += places;
                    }
                }
            }
            true
        })?;
        Ok(needs)
    }

    /// Places that slices `first..end` need.
    fn places(&self, first: i32, end: i32) -> usize {
        let sum = |counts: &[u32]| counts.iter().map(|count| *count as usize).sum::<usize>();
        let at = |slice: i32| (slice - (self.bin.1 << 5)).clamp(0, BRICK as i32) as usize;
        // Triangles that begin within a slice may end before it.
        let ended = at(first + 1).min(BRICK);
        sum(&self.begin[..at(end)]).saturating_sub(sum(&self.ended[..ended]))
    }
}

/// Offers the triangles near to a brick's slice.
struct OfferNear<'a, 'b> {
    resident: &'a Resident,
    offered: &'a mut SliceSearch<'b>,
    brick: usize,
}

impl Kernel for OfferNear<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run(self, _: impl Lanes) {
        let Self { resident, offered, brick } = self;
        let record = |number| resident.record(number);
        let (z, reach) = (offered.corner[2], offered.reach / STEPS);
        resident.near(z, brick, reach, &mut |number, t| offered.add(number, t, record));
        offered.finish(record);
    }
}

/// The skin voxels of a brick's slice, to which triangles are offered.
struct SliceSearch<'a> {
    corner: [i32; 3],
    wanted: &'a [u32; BRICK],
    reach: i32,
    cells: &'a mut Cells,
    nearest: &'a mut [Nearest],
}

impl SliceSearch<'_> {
    /// Offers a triangle: at once, or together with others that are as small, whose records are found by number.
    #[inline(always)]
    fn add<'r>(&mut self, number: u32, t: &BinTriangle<'_>, record: impl Fn(u32) -> &'r Record) {
        if let BinTriangle::Short(own) = t {
            let [x, y, z] = self.corner;
            if self.cells.add(own, number, [x * STEPS, y * STEPS, z * STEPS + HALF], self.reach) {
                if self.cells.is_full() {
                    self.finish(record);
                }
                return;
            }
        }
        offer_triangle(&t.triangle(), self.corner, self.wanted, self.reach, self.nearest);
    }

    /// Offers the triangles that still wait.
    #[inline(never)]
    fn finish<'r>(&mut self, record: impl Fn(u32) -> &'r Record) {
        let [x, y, z] = self.corner;
        let corner = [x * STEPS, y * STEPS, z * STEPS + HALF];
        self.cells.seek(record, corner, self.wanted, self.nearest);
    }
}

/// Offers a triangle to the wanted voxels of a brick's slice that it may be near to.
#[inline(always)]
fn offer_triangle(
    t: &Triangle,
    [x0, y0, z]: [i32; 3],
    wanted: &[u32; BRICK],
    reach: i32,
    nearest: &mut [Nearest],
) {
    // Columns, rows and the slice whose centres are within reach of the triangle's box.
    let within = |axis: usize, from: i32| {
        let (low, high) = span(t, axis);
        (first_centre(low - reach) - from, last_centre(high + reach) - from)
    };
    let (first, last) = within(2, z);
    if first > 0 || last < 0 {
        return;
    }
    let ((from, to), (top, bottom)) = (within(0, x0), within(1, y0));
    let (from, to, top, bottom) = (from.max(0), to.min(31), top.max(0), bottom.min(31));
    if from > to || top > bottom {
        return;
    }
    let columns = u32::MAX << from & u32::MAX >> (31 - to);
    let rows = top as usize..bottom as usize + 1;
    if wanted[rows.clone()].iter().all(|row| row & columns == 0) {
        return;
    }
    let Some(facet) = Facet::new(t) else { return };
    let centre = |c: i32| f64::from(c * STEPS + HALF);
    let (px, pz) = (centre(x0), centre(z));
    let prism = Prism::around(&facet);
    for y in rows {
        let found = wanted[y] & columns;
        if found == 0 {
            continue;
        }
        let py = centre(y0 + y as i32);
        let row = prism.row([px, py, pz]);
        each_bit(found, |x| {
            let best = &mut nearest[BRICK * y + x];
            if row.at_least(x as f64) <= best.reach() {
                best.offer(&facet, [px + f64::from(STEPS) * x as f64, py, pz]);
            }
        });
    }
}

impl SolidWorker for MeshWorker<'_> {
    fn start(&mut self, column: &VoxelBox) -> Result<(), SourceError> {
        self.column = column.clone();
        self.run = (0, 0);
        self.bricks = 0..0;
        self.needs = Needs::NONE;
        self.crossed = None;
        self.gathered = None;
        Ok(())
    }

    /// Rows are outside before the first triangle of their bin and after the last.
    fn cover(&mut self, region: &VoxelBox) -> Cover {
        // The region is a slab with one more slice on either side, where there is one.
        let slab = region.z.start.div_ceil(BRICK as u32) * BRICK as u32;
        let (low, high) = self.solid.bins.columns(self.column.y.start, slab.min(region.z.end - 1));
        let beyond = self.solid.closed && region.x.start as i32 > high;
        if region.x.end as i32 <= low || beyond { Cover::Outside } else { Cover::Mixed }
    }

    fn occupancy(&mut self, rows: &mut OccupancyRows<'_>) -> Result<(), SourceError> {
        if self.crossed != Some(rows.z()) {
            self.cross(rows.z())?;
        }
        // Words begin at multiples of 64 from the column's first.
        let left = i64::from(self.column.x.start) - 64;
        let first = ((rows.origin() - left) / 64) as usize;
        for y in rows.y() {
            let own = self.crossings.row((y + 1 - self.column.y.start) as usize);
            let words = rows.row_mut(y);
            let most = words.len().min(own.len().saturating_sub(first));
            words[..most].copy_from_slice(&own[first..first + most]);
        }
        Ok(())
    }

    fn describe(&mut self, skin: &SkinSlice<'_>) -> Result<(), SourceError> {
        let mut wanted = *skin.rows();
        for (reach, squared) in &REACHES {
            for (y, row) in wanted.iter().enumerate() {
                each_bit(*row, |x| self.nearest[BRICK * y + x] = Nearest::within(*squared));
            }
            self.offer(skin, &wanted, *reach)?;
            let mut lost = 0;
            for (y, row) in wanted.iter_mut().enumerate() {
                let mut left = 0;
                each_bit(*row, |x| left |= u32::from(!self.nearest[BRICK * y + x].found()) << x);
                *row = left;
                lost |= left;
            }
            if lost == 0 {
                break;
            }
        }
        self.codes.clear();
        // Neighbours often share their nearest triangle.
        let mut last = ([0.0_f32; 3], [0; 2]);
        for (y, row) in skin.rows().iter().enumerate() {
            each_bit(*row, |x| {
                let best = &self.nearest[BRICK * y + x];
                let direction = if best.found() { best.normal } else { from_faces(&skin.exposed(y), x) };
                if direction != last.0 {
                    last = (direction, normal::encode(direction).to_le_bytes());
                }
                self.codes.extend(last.1);
            });
        }
        match &mut self.painter {
            Some(painter) => painter.voxels(skin, &mut self.codes),
            None => Ok(()),
        }
    }

    fn crossings(
        &mut self,
        skin: &SkinSlice<'_>,
        found: &mut dyn FnMut(&EdgeCrossing),
    ) -> Result<(), SourceError> {
        let samples = CellEdges::samples_of(skin);
        self.each_near(skin, &mut |t| cross_edges(t, samples, &mut |crossing| found(crossing)))
    }

    fn items(&self, channel: Channel) -> &[u8] {
        match (channel, &self.painter) {
            (Channel::Color | Channel::Material, Some(painter)) => painter.items(channel),
            _ => &self.codes,
        }
    }
}

/// Calls `act` with every bit that is set.
#[inline(always)]
fn each_bit(row: u32, mut act: impl FnMut(usize)) {
    let mut left = row;
    while left != 0 {
        act(left.trailing_zeros() as usize);
        left &= left - 1;
    }
}

/// The mean direction of the faces of a voxel that look outside, for voxels without a near triangle.
pub(crate) fn from_faces(exposed: &Exposed, x: usize) -> [f32; 3] {
    let at = |face: usize| (exposed.faces[face] >> x & 1) as f32;
    let sum = [at(1) - at(0), at(3) - at(2), at(5) - at(4)];
    if sum == [0.0; 3] { [0.0, 0.0, 1.0] } else { sum }
}
