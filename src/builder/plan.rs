//! The plan: how a volume is cut into columns so that a build fits its budget.
//!
//! The plan changes speed and memory only; the bytes of the result do not depend on it.

use std::ops::Range;

use super::column::Column;
use super::gradient::{OVERREAD, REACH, SLICE_VOXELS};
use super::swap::{ENTRY_BYTES, EXTENT_BYTES};
use crate::budget::costs::WORKER_OVERHEAD;
use crate::budget::{Budget, Reservation, TooSmall};
use crate::geom::Dims;

/// Edge of a brick, the unit of swapping: a column is one brick high.
pub(super) const BRICK: u32 = 32;
/// Slices of one column, so that a few columns of a flat volume still occupy every thread.
const SEGMENT: u32 = 256;
/// Tiles are narrowed down to this before threads are given up: narrower ones read short rows.
const COMFORTABLE_TILE: u32 = 1024;
/// Narrowest tile.
const NARROWEST_TILE: u32 = 64;
/// Bytes of a cache line, on every machine of interest.
const CACHE_LINE: usize = 64;
/// Chunks for the records of one row of bricks; at least what one brick slice can need.
const POOL_BYTES: usize = 128 << 10;

/// Sizes of one worker's buffers, and the memory of all workers.
#[derive(Debug)]
pub(super) struct ColumnPlan {
    dims: Dims,
    /// Columns (x) of a tile: the whole width, or a multiple of 64.
    pub(super) tile: u32,
    /// Worker threads.
    pub(super) threads: usize,
    /// Are normals computed?
    pub(super) normals: bool,
    /// Bytes of a swapped value; 0 without the channel.
    pub(super) swapped_value_bytes: usize,
    /// Size of the chunk pool.
    pub(super) pool_bytes: usize,
    /// Bytes of a sample in the file, and in the ring.
    sample_bytes: (usize, usize),
    /// What the plan promises to stay within, everything included.
    pub(super) total_bytes: u64,
    /// What is reserved for the workers; each takes its part from it.
    pub(super) memory: Budget,
}

/// What a plan is made for.
#[derive(Clone, Copy, Debug)]
pub(super) struct PlanRequest {
    pub(super) dims: Dims,
    /// Bytes of a sample in the file and in the ring; equal means that slices are read in place.
    pub(super) file_sample_bytes: usize,
    pub(super) ring_sample_bytes: usize,
    pub(super) direct: bool,
    pub(super) normals: bool,
    pub(super) swapped_value_bytes: usize,
    pub(super) threads: usize,
    /// What the source may hold per reading thread.
    pub(super) source_bytes: u64,
}

impl ColumnPlan {
    /// The widest tiles and most threads whose memory the budget grants; it is reserved from then on.
    ///
    /// # Errors
    /// The narrowest tile of one thread, [`ColumnPlan::smallest`], does not fit.
    pub(super) fn new(request: &PlanRequest, budget: &Budget) -> Result<Self, TooSmall> {
        let nx = request.dims.nx();
        let narrower = |tile: u32| (tile / 2).next_multiple_of(64).max(NARROWEST_TILE);
        // Workers without a column of their own would only take memory.
        let columns = Self::sized(request, nx, 1).column_count();
        let most = usize::try_from(columns).unwrap_or(usize::MAX);
        let (mut tile, mut threads) = (nx, request.threads.clamp(1, most));
        loop {
            let plan = Self::sized(request, tile, threads);
            match plan.reserve(request, budget) {
                Ok(workers) => {
                    let total_bytes = budget.reserved_bytes();
                    return Ok(Self { total_bytes, memory: workers.into_budget(), ..plan });
                }
                Err(_) if tile > COMFORTABLE_TILE => tile = narrower(tile),
                Err(_) if threads > 1 => threads -= 1,
                Err(_) if tile > NARROWEST_TILE => tile = narrower(tile),
                Err(refused) => return Err(refused),
            }
        }
    }

    /// The memory of the smallest plan.
    ///
    /// # Errors
    /// Not even that is left.
    pub(super) fn smallest(request: &PlanRequest, budget: &Budget) -> Result<Reservation, TooSmall> {
        Self::sized(request, request.dims.nx().min(NARROWEST_TILE), 1).reserve(request, budget)
    }

    /// Reserves what the workers hold in all stages.
    fn reserve(&self, request: &PlanRequest, budget: &Budget) -> Result<Reservation, TooSmall> {
        let buffers = self.worker_bytes(request.direct).max(super::merge::WORKER_BYTES);
        let worker = buffers + WORKER_OVERHEAD + request.source_bytes;
        budget.reserve(worker * self.threads as u64)
    }

    fn sized(request: &PlanRequest, tile: u32, threads: usize) -> Self {
        Self {
            dims: request.dims,
            tile,
            threads,
            normals: request.normals,
            swapped_value_bytes: request.swapped_value_bytes,
            pool_bytes: POOL_BYTES,
            sample_bytes: (request.file_sample_bytes, request.ring_sample_bytes),
            total_bytes: 0,
            memory: Budget::new(0),
        }
    }

    /// Bytes of one [`super::column::ColumnWorker`].
    pub(super) fn worker_bytes(&self, direct: bool) -> u64 {
        let (file, ring) = self.sample_bytes;
        let plane = self.plane_samples();
        let words = self.tile_words();
        let bytes = (5 * plane + OVERREAD) * ring
            + self.staging_slices(direct) * self.block_samples() * file
            + (4 * 34 + 1) * (words + 2) * 8
            + 32 * words * 8
            + self.tile_bricks() * (4096 + 64 + ENTRY_BYTES * 2)
            + self.pool_bytes
            + self.payload_bytes()
            + EXTENT_BYTES
            + SLICE_VOXELS * (14 + self.swapped_value_bytes);
        bytes as u64
    }

    /// Columns and rows of a tile with its halo.
    fn block(&self) -> (usize, usize) {
        let cols = (self.tile + 2 * REACH).min(self.dims.nx());
        let rows = (BRICK + 2 * REACH).min(self.dims.ny());
        (cols as usize, rows as usize)
    }

    /// Samples of one slice of a tile with its halo.
    pub(super) fn block_samples(&self) -> usize {
        let (cols, rows) = self.block();
        cols * rows
    }

    /// Samples from one row of the ring to the next: an odd number of cache lines, so that the 25 rows of a
    /// 5x5x5 window fall on different sets of the cache even when a row is 2^n bytes long.
    pub(super) fn ring_stride(&self) -> usize {
        let line = CACHE_LINE / self.sample_bytes.1;
        let lines = self.block().0.div_ceil(line);
        (lines | 1) * line
    }

    /// Samples of one slice in the ring.
    pub(super) fn plane_samples(&self) -> usize {
        self.ring_stride() * self.block().1
    }

    /// Slices of file samples held beside the ring: enough that slice z is still there when its values
    /// are gathered.
    pub(super) fn staging_slices(&self, direct: bool) -> usize {
        match (direct, self.swapped_value_bytes) {
            (true, _) => 0,
            (false, 0) => 1,
            (false, _) => REACH as usize + 1,
        }
    }

    /// Words of bits across a tile.
    pub(super) fn tile_words(&self) -> usize {
        self.tile.div_ceil(64) as usize
    }

    /// Bricks across a tile.
    pub(super) fn tile_bricks(&self) -> usize {
        self.tile.div_ceil(BRICK) as usize
    }

    /// Largest payload of a fragment: bits of a brick, and all that the pool holds.
    pub(super) fn payload_bytes(&self) -> usize {
        2 + 32 * 4 + 4096 + self.pool_bytes
    }

    /// Number of columns.
    pub(super) fn column_count(&self) -> u64 {
        let [a, b, c] = self.column_grid();
        a * b * c
    }

    fn column_grid(&self) -> [u64; 3] {
        [self.dims.nx().div_ceil(self.tile), self.dims.ny().div_ceil(BRICK), self.dims.nz().div_ceil(SEGMENT)]
            .map(u64::from)
    }

    /// Column number `at`: tiles along x first, then segments along z, then rows of bricks.
    pub(super) fn column(&self, at: u64) -> Column {
        let [tiles, _, segments] = self.column_grid();
        let span = |index: u64, step: u32, n: u32| -> Range<u32> {
            #[expect(clippy::cast_possible_truncation, reason = "below the side of the volume")]
            let start = (index * u64::from(step)) as u32;
            start..(start + step).min(n)
        };
        Column {
            x: span(at % tiles, self.tile, self.dims.nx()),
            z: span(at / tiles % segments, SEGMENT, self.dims.nz()),
            y: span(at / tiles / segments, BRICK, self.dims.ny()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A plan of which 4 MiB are taken before.
    fn plan(nx: u32, limit_bytes: u64, threads: usize) -> Result<ColumnPlan, TooSmall> {
        let budget = Budget::new(limit_bytes);
        let _taken = budget.reserve(limit_bytes.min(4 << 20))?;
        ColumnPlan::new(&request(nx, threads), &budget)
    }

    fn request(nx: u32, threads: usize) -> PlanRequest {
        PlanRequest {
            dims: Dims::new(nx, 100, 600).unwrap(),
            file_sample_bytes: 4,
            ring_sample_bytes: 4,
            direct: true,
            normals: true,
            swapped_value_bytes: 0,
            threads,
            source_bytes: 0,
        }
    }

    #[test]
    fn columns_tile_the_volume_once() {
        for nx in [1, 64, 100, 5000] {
            let plan = plan(nx, 8 << 20, 2).unwrap();
            let voxels: u64 = (0..plan.column_count())
                .map(|i| plan.column(i))
                .map(|c| (c.x.len() * c.y.len() * c.z.len()) as u64)
                .sum();
            assert_eq!(voxels, u64::from(nx) * 100 * 600, "{nx}");
            assert!(plan.tile == nx || plan.tile.is_multiple_of(64));
        }
    }

    #[test]
    fn a_small_budget_narrows_tiles_and_drops_threads_and_the_smallest_is_stated() {
        let wide = plan(65_536, 1 << 30, 4).unwrap();
        assert_eq!((wide.tile, wide.threads), (65_536, 4));
        let tight = plan(65_536, 8 << 20, 4).unwrap();
        assert!(tight.tile < 65_536 && tight.total_bytes <= 8 << 20);
        assert_eq!(tight.total_bytes, (4 << 20) + tight.memory.limit_bytes());
        assert!(plan(65_536, 2 << 20, 4).is_err());
        let dry = Budget::new(u64::MAX);
        drop(ColumnPlan::smallest(&request(65_536, 4), &dry).unwrap());
        let minimum_bytes = (4 << 20) + dry.smallest_limit(1);
        assert!(plan(65_536, minimum_bytes, 4).is_ok());
        assert!(plan(65_536, minimum_bytes - (1 << 16), 4).is_err());
    }
}
