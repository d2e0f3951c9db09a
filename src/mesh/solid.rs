//! A mesh as a solid of the builder: bits from crossings, normals of the nearest triangle, bin by bin.
//!
//! ```text
//!   bin of 32 rows x 32 slices --blocks--> resident triangles, of as many slices as fit
//!   slice z+2   rows cross triangles, sums of crossings become bits
//!   slice z     skin voxels seek their nearest triangle within a voxel, then within two
//! ```
//!
//! Where the triangles of one slice alone do not fit, they are read block by block whenever they are needed.
#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    reason = "coordinates are below 2^16"
)]

use std::path::PathBuf;

use super::bins::{BEYOND, Bins, BlockBuffers, held};
use super::lattice::{Grid, HALF, STEPS, Triangle, centres, first_centre, last_centre, span};
use super::nearest::{Facet, Nearest};
use super::paint::{Paint, Painter};
use super::raster::{Crossings, Rule, cross_slice};
use super::resident::Resident;
use crate::builder::{
    Cover, Exposed, Found, ItemForm, OccupancyRows, SkinSlice, Solid, SolidWorker, Tile, VoxelBox,
};
use crate::facts::{Fault, SourceError};
use crate::format::{Channel, Metadata, SourceMeta, normal};
use crate::geom::Dims;
use crate::stamp::stamp;

/// Rows and columns of a brick.
const BRICK: usize = 32;
/// Rows of a column with one more on either side.
const ROWS: usize = BRICK + 2;
/// A voxel's edge, squared, in lattice steps, with room for the rounding of distances.
const VOXEL_SQUARED: f64 = 16_777_217.0;
/// How far the nearest triangle is sought, and that squared: one voxel, two where the thick skin has voxels that
/// touch the outside with a corner only.
const REACHES: [(i32, f64); 2] = [(STEPS, VOXEL_SQUARED), (2 * STEPS, 4.0 * VOXEL_SQUARED)];
/// What the model says of its normals.
const ESTIMATOR: &str = "nearest triangle";

/// The voxels inside a mesh whose triangles have been binned.
pub(crate) struct MeshSolid {
    pub(super) name: String,
    pub(super) grid: Grid,
    pub(super) bins: Bins,
    pub(super) rule: Rule,
    /// Is every row outside again after its last crossing?
    pub(super) closed: bool,
    /// Triangles that a worker has room for.
    pub(super) resident: usize,
    /// The files, and what they were before they were read.
    pub(super) inputs: Vec<(PathBuf, u64)>,
    /// Colours, parts and smooth normals, if there are any.
    pub(super) paint: Option<Paint>,
}

/// Words of a row of a tile, with one on either side.
fn row_words(tile: &Tile) -> usize {
    tile.columns.div_ceil(64) as usize + 2
}

/// Memory of a worker beside its resident triangles.
pub(super) fn fixed_bytes(tile: &Tile) -> u64 {
    Crossings::bytes(row_words(tile), ROWS)
        + BlockBuffers::BYTES
        + (SkinSlice::MOST * (size_of::<Nearest>() + 2)) as u64
}

impl Solid for MeshSolid {
    fn dims(&self) -> Dims {
        self.grid.dims
    }

    /// The same for every file of the same solid: neither format, size nor number of triangles.
    fn metadata(&self, _: &Found) -> Metadata {
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

    /// Files are gone through several times, and what one pass found is taken for true in the next.
    fn check_unchanged(&self) -> Result<(), SourceError> {
        match self.inputs.iter().find(|(path, then)| stamp(path) != *then) {
            Some((path, _)) => Err(SourceError::Unusable { path: path.clone(), fault: Fault::ChangedInUse }),
            None => Ok(()),
        }
    }

    fn form(&self, channel: Channel, _: &Found) -> Option<ItemForm> {
        let wanted = self.paint.as_ref().map(|paint| paint.wanted);
        let bytes = match channel {
            Channel::Normal => Some(2),
            Channel::Color => wanted.filter(|wanted| wanted.colors).map(|_| 3),
            Channel::Material => wanted.filter(|wanted| wanted.parts).map(|_| 1),
            _ => None,
        };
        bytes.map(|bytes| ItemForm::AsIs { bytes })
    }

    fn worker_bytes(&self, tile: &Tile) -> u64 {
        let paint = if self.paint.is_some() { Painter::BYTES } else { 0 };
        paint + fixed_bytes(tile) + Resident::bytes(self.resident, tile.columns.div_ceil(32) as usize)
    }

    fn worker(&self, tile: &Tile) -> Box<dyn SolidWorker + '_> {
        let words = row_words(tile);
        Box::new(MeshWorker {
            solid: self,
            column: VoxelBox { x: 0..0, y: 0..0, z: 0..0 },
            run: (0, 0),
            streamed: false,
            resident: Resident::new(self.resident, tile.columns.div_ceil(32) as usize),
            buffers: BlockBuffers::new(),
            crossings: Crossings::new(words, ROWS),
            crossed: None,
            gathered: None,
            nearest: vec![Nearest::within(0.0); SkinSlice::MOST],
            codes: Vec::with_capacity(2 * SkinSlice::MOST),
            painter: self.paint.as_ref().map(Painter::new),
        })
    }
}

/// One thread's view of the bins.
pub(crate) struct MeshWorker<'a> {
    solid: &'a MeshSolid,
    column: VoxelBox,
    /// Slices whose skin can be described with the triangles at hand.
    run: (i32, i32),
    /// Are they too many to be held?
    streamed: bool,
    resident: Resident,
    buffers: BlockBuffers,
    crossings: Crossings,
    /// Slices whose rows were crossed and whose triangles were gathered last.
    crossed: Option<u32>,
    gathered: Option<u32>,
    nearest: Vec<Nearest>,
    codes: Vec<u8>,
    painter: Option<Painter<'a>>,
}

impl MeshWorker<'_> {
    /// Has the triangles for describing slice `z`, and for the bits two slices ahead, at hand.
    fn seek(&mut self, z: i32) -> Result<(), SourceError> {
        if (self.run.0..self.run.1).contains(&z) {
            return Ok(());
        }
        // As many slices as have room if the bin's triangles are spread evenly, at first.
        let bin_end = (z | 31) + 1;
        let share = self.solid.resident as u64 * (BRICK as u64 + 2 * BEYOND as u64)
            / u64::from(self.solid.bins.triangles(self.column.y.start, z as u32)).max(1);
        let run = share.saturating_sub(2 * BEYOND as u64).clamp(1, BRICK as u64) as i32;
        let mut end = bin_end.min(z + run);
        self.gathered = None;
        loop {
            self.resident.clear(z, self.column.x.start as i32);
            let mut fits = true;
            let Self { resident, buffers, solid, column, .. } = self;
            solid.bins.for_each_block(column.y.start, z as u32, buffers, &mut |block| {
                fits = resident.take(block, z, end);
                fits
            })?;
            self.streamed = !fits && end == z + 1;
            if fits || self.streamed {
                break;
            }
            end = z + (end - z) / 2;
        }
        self.run = (z, end);
        if !self.streamed {
            self.resident.settle();
        }
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
        let Self { resident, crossings, solid, buffers, column, .. } = self;
        let mut each = |t: &Triangle| {
            cross_slice(t, slice, top, bottom, &mut |row, column, sign| {
                crossings.add((row - top) as usize, column - left, sign);
            });
        };
        if self.streamed {
            solid.bins.for_each_block(column.y.start, self.run.0 as u32, buffers, &mut |block| {
                for t in held(block).map(|t| t.triangle()) {
                    let (low, high) = centres(&t, 2);
                    if low <= slice && slice <= high {
                        each(&t);
                    }
                }
                true
            })?;
        } else {
            resident.crossed(slice, &mut each);
        }
        crossings.settle(solid.rule);
        self.crossed = Some(z);
        Ok(())
    }

    /// Offers every triangle that may be within `reach` lattice steps to the skin voxels of a brick's slice.
    fn offer(&mut self, skin: &SkinSlice<'_>, wanted: &[u32; BRICK], reach: i32) -> Result<(), SourceError> {
        let [x0, y0, z] = skin.corner().map(|c| c as i32);
        let Self { resident, nearest, solid, buffers, column, gathered, .. } = self;
        let mut each = |t: &Triangle| offer_triangle(t, [x0, y0, z], wanted, reach, nearest);
        if self.streamed {
            return solid.bins.for_each_block(column.y.start, self.run.0 as u32, buffers, &mut |block| {
                held(block).for_each(|t| each(&t.triangle()));
                true
            });
        }
        if reach > STEPS {
            resident.all(&mut each);
        } else {
            if *gathered != Some(z as u32) {
                resident.gather(z);
                *gathered = Some(z as u32);
            }
            resident.near((x0 - column.x.start as i32) as usize / BRICK, &mut each);
        }
        Ok(())
    }
}

/// Offers a triangle to those of the wanted voxels of a brick's slice that it may be near to.
#[inline]
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
    let pz = centre(z);
    for y in rows {
        let mut left = wanted[y] & columns;
        let py = centre(y0 + y as i32);
        while left != 0 {
            let x = left.trailing_zeros();
            left &= left - 1;
            let p = [centre(x0 + x as i32), py, pz];
            let best = &mut nearest[BRICK * y + x as usize];
            best.offer(&facet, p);
        }
    }
}

impl SolidWorker for MeshWorker<'_> {
    fn start(&mut self, column: &VoxelBox) -> Result<(), SourceError> {
        self.column = column.clone();
        self.run = (0, 0);
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
            for (word, own) in rows.row_mut(y).iter_mut().zip(&own[first..]) {
                *word = *own;
            }
        }
        Ok(())
    }

    fn describe(&mut self, skin: &SkinSlice<'_>) -> Result<(), SourceError> {
        self.seek(skin.corner()[2] as i32)?;
        let each_bit = |row: u32, act: &mut dyn FnMut(usize)| {
            let mut left = row;
            while left != 0 {
                act(left.trailing_zeros() as usize);
                left &= left - 1;
            }
        };
        let mut wanted = *skin.rows();
        for (reach, squared) in &REACHES {
            for (y, row) in wanted.iter().enumerate() {
                each_bit(*row, &mut |x| self.nearest[BRICK * y + x] = Nearest::within(*squared));
            }
            self.offer(skin, &wanted, *reach)?;
            let mut lost = 0;
            for (y, row) in wanted.iter_mut().enumerate() {
                let mut left = 0;
                each_bit(*row, &mut |x| left |= u32::from(!self.nearest[BRICK * y + x].found()) << x);
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
            each_bit(*row, &mut |x| {
                let best = &self.nearest[BRICK * y + x];
                let direction = if best.found() { best.normal } else { from_faces(&skin.exposed(y), x) };
                if direction != last.0 {
                    last = (direction, normal::encode(direction).to_le_bytes());
                }
                self.codes.extend(last.1);
            });
        }
        match &mut self.painter {
            Some(painter) => painter.describe(skin, &mut self.codes),
            None => Ok(()),
        }
    }

    fn items(&self, channel: Channel) -> &[u8] {
        match (channel, &self.painter) {
            (Channel::Color, Some(painter)) => painter.colors(),
            (Channel::Material, Some(painter)) => painter.parts(),
            _ => &self.codes,
        }
    }
}

/// The mean direction of the faces of a voxel that look outside, where no triangle is near.
fn from_faces(exposed: &Exposed, x: usize) -> [f32; 3] {
    let at = |face: usize| (exposed.faces[face] >> x & 1) as f32;
    let sum = [at(1) - at(0), at(3) - at(2), at(5) - at(4)];
    if sum == [0.0; 3] { [0.0, 0.0, 1.0] } else { sum }
}
