//! Leaves that are sampled slice by slice: meshes and volumes, each a solid of its own.
//!
//! Four slices of bits are in memory: those around the described slice, and the next one.

use crate::builder::{OccupancyRows, Solid, SolidWorker, Tile, VoxelBox};
use crate::geom::Dims;
use crate::mesh::row_words;
use crate::volume::SourceError;

/// Slices in memory.
const SLICES: u32 = 4;
/// Rows of a tile with one more on either side.
pub(super) const ROWS: usize = 34;

pub(super) struct SampledLeaf<'a> {
    pub(super) solid: Box<dyn Solid + 'a>,
    /// True if its normals point out of it on either side of its surface. Normals of a mesh lead to it.
    pub(super) gives_outwards: bool,
}

pub(super) struct Sampler<'a> {
    pub(super) worker: Box<dyn SolidWorker + 'a>,
    dims: [u32; 3],
    column: VoxelBox,
    /// The slices that were asked for last, in one range.
    asked: std::ops::Range<u32>,
    /// Words of a row, one on either side included.
    width: usize,
    bits: Vec<u64>,
}

impl<'a> Sampler<'a> {
    /// Memory of a sampler, without its worker.
    pub(super) fn bytes(tile: &Tile) -> u64 {
        (SLICES as usize * ROWS * row_words(tile) * 8) as u64
    }

    pub(super) fn new(leaf: &'a SampledLeaf<'_>, dims: Dims, tile: &Tile) -> Self {
        Self {
            worker: leaf.solid.worker(tile),
            dims: dims.to_array(),
            column: VoxelBox { x: 0..0, y: 0..0, z: 0..0 },
            asked: 0..0,
            width: row_words(tile),
            bits: vec![0; SLICES as usize * ROWS * row_words(tile)],
        }
    }

    pub(super) fn start(&mut self, column: &VoxelBox) -> Result<(), SourceError> {
        self.column = column.clone();
        self.asked = 0..0;
        self.worker.start(column)
    }

    /// Rows in memory: the column's and one more on either side, as far as they exist.
    fn rows(&self) -> std::ops::Range<u32> {
        self.column.y.start.saturating_sub(1)..(self.column.y.end + 1).min(self.dims[1])
    }

    /// Finds the bits of slice `z` and of those before it, as far as they may be wanted.
    pub(super) fn reach(&mut self, z: u32) -> Result<(), SourceError> {
        let z = z.min(self.dims[2] - 1);
        if self.asked.contains(&z) && z + SLICES >= self.asked.end {
            return Ok(());
        }
        // A worker is asked for slices in rising order; it needs two on either side to describe one.
        let earliest = z.saturating_sub(SLICES);
        let first = if (earliest..=z).contains(&self.asked.end) { self.asked.end } else { earliest };
        if first != self.asked.end {
            self.asked = first..first;
        }
        let columns = self.column.x.start.saturating_sub(1)..(self.column.x.end + 1).min(self.dims[0]);
        let rows = self.rows();
        for slice in first..=z {
            let at = (slice % SLICES) as usize * ROWS * self.width;
            // The words before and after a tile count from its first column.
            let width = self.column.x.len().div_ceil(64) + 2;
            let origin = i64::from(self.column.x.start) - 64;
            let words = &mut self.bits[at..][..rows.len() * width];
            let asked = [columns.clone(), rows.clone()];
            self.worker.occupancy(&mut OccupancyRows::of_slice(asked, slice, origin, width, words))?;
            self.asked.end = slice + 1;
        }
        Ok(())
    }

    fn row(&self, y: u32, z: u32) -> &[u64] {
        let width = self.column.x.len().div_ceil(64) + 2;
        let row = (y - self.rows().start) as usize;
        &self.bits[(z % SLICES) as usize * ROWS * self.width + row * width..][..width]
    }

    /// The bits of 64 voxels of a row; 0 for rows that do not exist.
    pub(super) fn word(&self, x: i64, y: i64, z: u32) -> u64 {
        let at = (x - i64::from(self.column.x.start) + 64).div_euclid(64);
        match (u32::try_from(y), usize::try_from(at)) {
            (Ok(y), Ok(at)) if self.rows().contains(&y) => self.row(y, z).get(at).copied().unwrap_or(0),
            _ => 0,
        }
    }

    /// True for a voxel inside, in a slice in memory.
    pub(super) fn contains(&self, [x, y, z]: [i32; 3]) -> bool {
        let from = i64::from(self.column.x.start);
        let bit = (i64::from(x) - from).rem_euclid(64);
        let is_there = (0..3).all(|k| u32::try_from([x, y, z][k]).is_ok_and(|v| v < self.dims[k]));
        is_there && self.word(i64::from(x), y.into(), z.cast_unsigned()) >> bit & 1 == 1
    }
}
