//! The plan: the columns into which a volume is cut so that a build fits its budget.
//!
//! The plan changes speed and memory only; the bytes of the result do not depend on it.

use std::ops::Range;

use super::item::ChannelForm;
use super::merge;
use super::reduce;
use super::solid::{BRICK, Tile, VoxelBox};
use super::swap::{ENTRY_BYTES, EXTENT_BYTES};
use crate::budget::costs::WORKER_OVERHEAD;
use crate::budget::{Budget, Reservation, TooSmall};
use crate::format::Channels;
use crate::geom::Dims;

/// Most slices of one column, so that a few columns of a flat volume still occupy every thread.
const SEGMENT: u32 = 256;
/// Width down to which tiles are narrowed before threads are given up: narrower ones read short rows.
const COMFORTABLE_TILE: u32 = 1024;
const NARROWEST_TILE: u32 = 64;
/// Chunks for the records of one row of bricks; at least the need of one brick slice.
const POOL_BYTES: usize = 128 << 10;

/// Sizes of one worker's buffers, and the memory of all workers.
pub(super) struct ColumnPlan {
    /// The scanned region: the whole grid, or a part of its bricks.
    region: VoxelBox,
    /// Columns (x) of a tile: the whole width, or a multiple of 64.
    pub(super) tile: u32,
    pub(super) threads: usize,
    /// The scanned channels, and the bytes of all their items of one voxel.
    channels: Channels,
    pub(super) swapped_bytes: usize,
    pub(super) pool_bytes: usize,
    /// The bound that the plan keeps, everything included.
    pub(super) total_bytes: u64,
    /// Memory of one worker while it scans, its part of the solid included.
    pub(super) scan_bytes: u64,
    /// The reservation for the workers; each takes its part from it.
    pub(super) memory: Budget,
}

/// The request for a plan.
pub(super) struct PlanRequest<'a> {
    pub(super) dims: Dims,
    pub(super) channels: Vec<ChannelForm>,
    pub(super) threads: usize,
    /// Memory of a solid's worker for a tile.
    pub(super) solid_bytes: Box<dyn Fn(&Tile) -> u64 + 'a>,
    /// Memory that a thread may hold for the inputs of the solid.
    pub(super) input_bytes: u64,
    /// Set if cells are joined into larger leaves, which needs their corner masks swapped as well.
    pub(super) with_sides: bool,
}

impl ColumnPlan {
    /// Finds the widest tiles and most threads whose memory the budget grants, and reserves it.
    ///
    /// # Errors
    /// The narrowest tile of one thread, [`ColumnPlan::smallest`], does not fit.
    pub(super) fn new(request: &PlanRequest<'_>, budget: &Budget) -> Result<Self, TooSmall> {
        let nx = request.dims.nx();
        let narrower = |tile: u32| (tile / 2).next_multiple_of(64).max(NARROWEST_TILE);
        // Workers without a column of their own would only use memory.
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
    /// The budget is smaller, or the process exceeded the limit earlier: a cap is on the peak.
    pub(super) fn smallest(request: &PlanRequest<'_>, budget: &Budget) -> Result<Reservation, TooSmall> {
        Self::sized(request, request.dims.nx().min(NARROWEST_TILE), 1).reserve(request, budget)
    }

    /// Reserves the workers' memory in all stages; later single-threaded stages fit into the part of one worker.
    fn reserve(&self, request: &PlanRequest<'_>, budget: &Budget) -> Result<Reservation, TooSmall> {
        let channels = &request.channels;
        let joining = if request.with_sides { reduce::worker_bytes(channels) } else { 0 };
        let merging = merge::worker_bytes(channels).max(merge::upper_bytes(channels)).max(joining);
        let worker = self.scan_bytes.max(merging) + WORKER_OVERHEAD + request.input_bytes;
        let needed_bytes = worker * self.threads as u64;
        if budget.is_passed() {
            return Err(TooSmall { needed_bytes, left_bytes: 0 });
        }
        budget.reserve(needed_bytes)
    }

    fn sized(request: &PlanRequest<'_>, tile: u32, threads: usize) -> Self {
        let mut plan = Self {
            region: VoxelBox::whole(request.dims),
            tile,
            threads,
            channels: request.channels.iter().map(|c| c.channel).collect(),
            swapped_bytes: request.channels.iter().map(|c| c.form.swapped_bytes()).sum::<usize>()
                + usize::from(request.with_sides),
            pool_bytes: POOL_BYTES,
            total_bytes: 0,
            scan_bytes: 0,
            memory: Budget::new(0),
        };
        plan.scan_bytes = plan.worker_bytes() + (request.solid_bytes)(&plan.tile());
        plan
    }

    /// Bytes of one [`super::column::ColumnWorker`], without the solid's own memory.
    fn worker_bytes(&self) -> u64 {
        let words = self.tile_words();
        let bytes = (4 * 34 + 1) * (words + 2) * 8
            + 32 * words * 8
            + self.tile_bricks() * (4096 + 64 + ENTRY_BYTES * 2)
            + self.pool_bytes
            + self.payload_bytes()
            + EXTENT_BYTES;
        bytes as u64
    }

    /// The tile that a solid's worker is made for.
    pub(super) fn tile(&self) -> Tile {
        Tile { columns: self.tile, channels: self.channels }
    }

    /// Words of bits across a tile.
    pub(super) fn tile_words(&self) -> usize {
        self.tile.div_ceil(64) as usize
    }

    pub(super) fn tile_bricks(&self) -> usize {
        self.tile.div_ceil(BRICK) as usize
    }

    /// Largest payload of a fragment: bits of a brick, and the whole content of the pool.
    pub(super) fn payload_bytes(&self) -> usize {
        2 + 32 * 4 + 4096 + self.pool_bytes
    }

    pub(super) fn column_count(&self) -> u64 {
        let [a, b, c] = self.column_grid();
        a * b * c
    }

    /// Restricts the scan to a part of the grid, which begins at a brick's corner.
    pub(super) fn limit(&mut self, region: &VoxelBox) {
        self.region.clone_from(region);
    }

    fn column_grid(&self) -> [u64; 3] {
        let parts = |side: &Range<u32>, step: u32| side.len().div_ceil(step as usize) as u64;
        let VoxelBox { x, y, z } = &self.region;
        [parts(x, self.tile), parts(y, BRICK), parts(z, SEGMENT)]
    }

    /// Column number `at`: tiles along x first, then rows of bricks, then segments along z, so that reads from files in
    /// slices or chunks lie together.
    pub(super) fn column(&self, at: u64) -> VoxelBox {
        let [tiles, rows, _] = self.column_grid();
        let span = |index: u64, step: u32, side: &Range<u32>| -> Range<u32> {
            #[expect(clippy::cast_possible_truncation, reason = "below the side of the volume")]
            let start = side.start + (index * u64::from(step)) as u32;
            start..(start + step).min(side.end)
        };
        VoxelBox {
            x: span(at % tiles, self.tile, &self.region.x),
            y: span(at / tiles % rows, BRICK, &self.region.y),
            z: span(at / tiles / rows, SEGMENT, &self.region.z),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::builder::item::ItemForm;
    use crate::format::Channel;

    /// A plan with 4 MiB of the budget already taken.
    fn plan(nx: u32, limit_bytes: u64, threads: usize) -> Result<ColumnPlan, TooSmall> {
        let budget = Budget::new(limit_bytes);
        let _taken = budget.reserve(limit_bytes.min(4 << 20))?;
        ColumnPlan::new(&request(nx, threads), &budget)
    }

    fn request(nx: u32, threads: usize) -> PlanRequest<'static> {
        PlanRequest {
            dims: Dims::new(nx, 100, 600).unwrap(),
            channels: vec![ChannelForm { channel: Channel::Normal, form: ItemForm::AsIs { bytes: 2 } }],
            threads,
            // Five slices of singles.
            solid_bytes: Box::new(|tile| u64::from(tile.columns) * 36 * 20),
            input_bytes: 0,
            with_sides: false,
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
