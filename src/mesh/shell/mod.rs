//! Solids of meshes that may hold no centre of a voxel: bare surfaces, and walls thinner than a voxel.
//!
//! ```text
//!   triangles --rows of centres along x, y, z--> halves of voxels that are crossed
//!        surface alone: voxels that are crossed
//!        walls kept:    the solid, and where a row crosses the surface between two centres that are both outside
//! ```
//!
//! Both hold a voxel of every two neighbours between whose centres the surface passes, unless the solid does: no path
//! from face to face leads through the surface (6-separating; Laine 2013, *A topological approach to voxelization*).
//! We take the rows along all three axes, not only along the one that a triangle faces most: triangles smaller than a
//! voxel that face different ways would leave holes between them. On a plane both give the same voxels.
//!
//! The voxels follow from the crossings of rows alone, so neither order nor memory nor threads change them.

mod half;
mod planes;

use super::bins::{BinTriangle, BlockBuffers, held};
use super::raster::{Crossings, cross_slice};
use super::resident::{Resident, slices as slices_of};
use super::solid::{MeshSolid, row_words};
use crate::builder::{
    Cover, ItemForm, OccupancyRows, ScanSummary, SkinSlice, Solid, SolidWorker, Tile, VoxelBox,
};
use crate::format::{Channel, Metadata, normal};
use crate::geom::Dims;
use crate::volume::SourceError;
use planes::{BEFORE, Mark, Planes, ROWS};

/// Slices in memory: the one that is described, those around it, and three ahead.
const SLICES: usize = 6;
/// Slices of a bin.
const BIN: i32 = 32;
/// Slices beyond a run whose triangles a bin holds.
const BEYOND: i32 = 2;

/// Treatment of voxels that a mesh crosses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Thin {
    /// Only crossed voxels are inside.
    Surface,
    /// Voxels of walls thinner than a voxel are inside, too.
    Walls,
}

/// A mesh with more voxels inside than those whose centres are.
pub(super) struct ThinSolid {
    pub(super) mesh: MeshSolid,
    pub(super) thin: Thin,
}

/// Memory of a worker without its mesh and its resident triangles.
pub(super) fn fixed_bytes(tile: &Tile) -> u64 {
    let words = row_words(tile);
    SLICES as u64 * Planes::bytes(words)
        + Crossings::bytes(words, ROWS)
        + BlockBuffers::BYTES
        + 2 * SkinSlice::MAX_VOXELS as u64
}

impl Solid for ThinSolid {
    fn dims(&self) -> Dims {
        self.mesh.dims()
    }

    fn inner(&self) -> Option<&dyn Solid> {
        Some(&self.mesh)
    }

    fn metadata(&self, found: &ScanSummary) -> Metadata {
        self.mesh.metadata(found)
    }

    fn form(&self, channel: Channel, found: &ScanSummary) -> Option<ItemForm> {
        self.mesh.form(channel, found)
    }

    fn worker_bytes(&self, tile: &Tile) -> u64 {
        self.mesh.worker_bytes(tile) + fixed_bytes(tile) + Resident::bytes(self.mesh.resident, 1)
    }

    fn worker(&self, tile: &Tile) -> Box<dyn SolidWorker + '_> {
        let words = row_words(tile);
        Box::new(ThinWorker {
            solid: self,
            mesh: self.mesh.worker(tile),
            column: VoxelBox { x: 0..0, y: 0..0, z: 0..0 },
            run: (0, 0),
            streamed: false,
            resident: Resident::new(self.mesh.resident, 1),
            buffers: BlockBuffers::new(),
            crossings: Crossings::new(words, ROWS),
            slices: std::array::from_fn(|_| Planes::new(words)),
            codes: Vec::with_capacity(2 * SkinSlice::MAX_VOXELS),
        })
    }
}

pub(super) struct ThinWorker<'a> {
    solid: &'a ThinSolid,
    /// Describes the skin.
    mesh: Box<dyn SolidWorker + 'a>,
    column: VoxelBox,
    /// Slices whose triangles are loaded, or are read again for every slice.
    run: (i32, i32),
    streamed: bool,
    resident: Resident,
    buffers: BlockBuffers,
    crossings: Crossings,
    slices: [Planes; SLICES],
    codes: Vec<u8>,
}

/// Index of a slice; -1 is the first.
fn slot(slice: i32) -> usize {
    usize::try_from(slice + 1).unwrap_or(0) % SLICES
}

impl ThinWorker<'_> {
    /// The voxel of the first bit.
    fn corner(&self) -> [i32; 2] {
        let at = |c: u32| i32::try_from(c).unwrap_or(i32::MAX / 2);
        [at(self.column.x.start) - 64, at(self.column.y.start) - BEFORE]
    }

    /// The bin that holds a slice, within the grid.
    fn bin_of(&self, slice: i32) -> u32 {
        let last = self.solid.mesh.dims().nz() - 1;
        u32::try_from(slice).unwrap_or(0).min(last)
    }

    /// Loads the triangles of a slice.
    fn seek(&mut self, slice: i32) -> Result<(), SourceError> {
        if (self.run.0..self.run.1).contains(&slice) {
            return Ok(());
        }
        let bin = self.bin_of(slice);
        let bin_end = ((bin | 31) + 1).cast_signed().min(self.bin_of(i32::MAX).cast_signed() + 1);
        let share = self.solid.mesh.resident as u64 * (BIN + 2 * BEYOND) as u64
            / u64::from(self.solid.mesh.bins.triangles(self.column.y.start, bin)).max(1);
        let run = i32::try_from(share).unwrap_or(BIN).saturating_sub(2 * BEYOND).clamp(1, BIN);
        let mut end = bin_end.min(slice + run).max(slice + 1);
        let [left, _] = self.corner();
        loop {
            // All bricks are loaded as one.
            let Self { resident, buffers, solid, column, .. } = self;
            let (bins, at) = (&solid.mesh.bins, (column.y.start, bin));
            let fits = resident.load(bins, at, slice..end, left + 64, 0..1, buffers)?;
            self.streamed = !fits && end == slice + 1;
            if fits || self.streamed {
                break;
            }
            end = slice + (end - slice) / 2;
        }
        self.run = (slice, end);
        if !self.streamed {
            self.resident.settle();
        }
        Ok(())
    }

    /// Finds the bits of a slice.
    fn reach(&mut self, slice: i32) -> Result<(), SourceError> {
        if self.slices[slot(slice)].slice == slice {
            return Ok(());
        }
        self.seek(slice)?;
        let [left, top] = self.corner();
        let bin = self.bin_of(slice);
        let Self { solid, column, resident, buffers, crossings, slices, .. } = self;
        let planes = &mut slices[slot(slice)];
        planes.clear(slice);
        let (walls, what) = match solid.thin {
            Thin::Walls => (true, Mark::Halves),
            Thin::Surface => (false, Mark::Directions),
        };
        let bottom = top + i32::try_from(ROWS).unwrap_or(0);
        let mut cross = |t: &BinTriangle<'_>| {
            cross_slice(&t.triangle(), slice, top, bottom, &mut |row, column, sign| {
                let row = usize::try_from(row - top).unwrap_or(usize::MAX);
                crossings.add(row, column - i64::from(left), sign);
            });
        };
        if self.streamed {
            solid.mesh.bins.for_each_block(column.y.start, bin, buffers, &mut |block| {
                for t in held(block) {
                    let (low, high) = slices_of(&t);
                    if walls && low <= slice && slice <= high {
                        cross(&t);
                    }
                    if low - 1 <= slice && slice <= high + 1 {
                        planes.note(&t.triangle(), [left, top], what);
                    }
                }
                true
            })?;
        } else {
            if walls {
                resident.crossed(slice, &mut cross);
            }
            resident.around(slice, 1, &mut |t| planes.note(&t.triangle(), [left, top], what));
        }
        if walls {
            crossings.settle(solid.mesh.rule);
            for (row, out) in planes.solid.chunks_exact_mut(crossings.row(0).len()).enumerate() {
                out.copy_from_slice(crossings.row(row));
            }
        }
        Ok(())
    }

    /// Turns the normals of the slice that was described last to the right side.
    ///
    /// Normals of the mesh lead from a voxel's centre through the nearest triangle, which is inwards for a wall whose
    /// centre is outside. Normals of surfaces follow their triangles; where two in a voxel look different ways, the
    /// normal stays.
    fn turn(&mut self, skin: &SkinSlice<'_>) {
        let [left, top] = self.corner();
        let [_, _, z] = skin.corner().map(u32::cast_signed);
        let planes = &self.slices[slot(z)];
        let codes = self.codes.as_chunks_mut::<2>().0;
        for (code, [x, y, _]) in codes.iter_mut().zip(skin.voxels()) {
            let at = |c: u32, from: i32| usize::try_from(c.cast_signed() - from).unwrap_or(0);
            let (bit, row) = (at(x, left), at(y, top));
            let own = normal::decode_l1(u16::from_le_bytes(*code));
            let turned = match self.solid.thin {
                Thin::Walls => planes.inside(row, bit / 64) >> (bit % 64) & 1 == 0,
                Thin::Surface => {
                    let along: i32 = own
                        .iter()
                        .enumerate()
                        .map(|(axis, c)| match planes.directions(axis, row, bit) {
                            (true, false) => *c,
                            (false, true) => -*c,
                            _ => 0,
                        })
                        .sum();
                    along < 0
                }
            };
            if turned {
                let back = own.map(|c| -c as f32);
                *code = normal::encode(back).to_le_bytes();
            }
        }
    }
}

impl SolidWorker for ThinWorker<'_> {
    fn start(&mut self, column: &VoxelBox) -> Result<(), SourceError> {
        self.column = column.clone();
        self.run = (0, 0);
        self.slices.iter_mut().for_each(|planes| planes.slice = Planes::NO_SLICE);
        self.mesh.start(column)
    }

    /// The bounds of a bin's triangles also bound the crossed voxels.
    fn cover(&mut self, region: &VoxelBox) -> Cover {
        self.mesh.cover(region)
    }

    fn occupancy(&mut self, rows: &mut OccupancyRows<'_>) -> Result<(), SourceError> {
        let z = rows.z().cast_signed();
        let walls = self.solid.thin == Thin::Walls;
        let around = if walls { z - 1..=z + 1 } else { z..=z };
        around.into_iter().try_for_each(|slice| self.reach(slice))?;
        let [left, top] = self.corner();
        let first = usize::try_from((rows.origin() - i64::from(left)) / 64).unwrap_or(0);
        let [below, own, above] = [z - 1, z, z + 1].map(|slice| &self.slices[slot(slice)]);
        for y in rows.y() {
            let row = usize::try_from(y.cast_signed() - top).unwrap_or(0);
            for (at, word) in (first..).zip(rows.row_mut(y)) {
                *word = if walls { own.united(below, above, row, at) } else { own.crossed(row, at) };
            }
        }
        Ok(())
    }

    fn describe(&mut self, skin: &SkinSlice<'_>) -> Result<(), SourceError> {
        self.mesh.describe(skin)?;
        self.reach(skin.corner()[2].cast_signed())?;
        self.codes.clear();
        self.codes.extend_from_slice(self.mesh.items(Channel::Normal));
        self.turn(skin);
        Ok(())
    }

    fn items(&self, channel: Channel) -> &[u8] {
        match channel {
            Channel::Normal => &self.codes,
            other => self.mesh.items(other),
        }
    }
}
