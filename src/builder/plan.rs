//! The plan: how a volume is cut into columns so that a build fits its budget.
//!
//! The plan changes speed and memory only; the bytes of the result do not depend on it.

use std::ops::Range;

use super::item::ChannelForm;
use super::solid::{BRICK, Tile, VoxelBox};
use super::swap::{ENTRY_BYTES, EXTENT_BYTES};
use crate::budget::{HELD_SPREAD, MemoryCap};
use crate::format::Channels;
use crate::geom::Dims;

/// Slices of one column, so that a few columns of a flat volume still occupy every thread.
const SEGMENT: u32 = 256;
/// Tiles are narrowed down to this before threads are given up: narrower ones read short rows.
const COMFORTABLE_TILE: u32 = 1024;
/// Narrowest tile.
const NARROWEST_TILE: u32 = 64;
/// Chunks for the records of one row of bricks; at least what one brick slice can need.
const POOL_BYTES: usize = 128 << 10;
/// A worker's stack as far as it is touched, its allocator arena and small change.
pub(super) const WORKER_OVERHEAD: u64 = 192 << 10;
/// What a build holds beside its workers, and what the allocator wastes, in a process of its host.
const SHARE_OVERHEAD: u64 = 256 << 10;

/// What counts against a cap before any buffer of weight.
pub(crate) fn fixed_bytes(memory: MemoryCap) -> u64 {
    match memory {
        MemoryCap::Process(_) => memory.held(),
        MemoryCap::Share(_) => SHARE_OVERHEAD,
    }
}

/// Sizes of one worker's buffers.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct ColumnPlan {
    dims: Dims,
    /// Columns (x) of a tile: the whole width, or a multiple of 64.
    pub(super) tile: u32,
    /// Worker threads.
    pub(super) threads: usize,
    /// The channels that are scanned, and the bytes of all their items of one voxel.
    channels: Channels,
    pub(super) swapped_bytes: usize,
    /// Size of the chunk pool.
    pub(super) pool_bytes: usize,
    /// What the plan promises to stay within, everything included.
    pub(super) total_bytes: u64,
}

/// What a plan is made for.
#[derive(Clone, Copy)]
pub(super) struct PlanRequest<'a> {
    pub(super) dims: Dims,
    pub(super) channels: &'a [ChannelForm],
    pub(super) threads: usize,
    pub(super) memory: MemoryCap,
    /// What counts against it before any buffer of the build.
    pub(super) fixed_bytes: u64,
    /// What a worker of the solid holds for a tile.
    pub(super) solid_bytes: &'a dyn Fn(&Tile) -> u64,
    /// What a thread may hold for the inputs of the solid.
    pub(super) input_bytes: u64,
}

impl ColumnPlan {
    /// The widest tiles and most threads that fit the limit.
    ///
    /// # Errors
    /// The smallest limit that would do.
    pub(super) fn new(request: &PlanRequest<'_>) -> Result<Self, u64> {
        let nx = request.dims.nx();
        let narrower = |tile: u32| (tile / 2).next_multiple_of(64).max(NARROWEST_TILE);
        // Workers without a column of their own would only take memory.
        let columns = Self::sized(request, nx, 1).column_count();
        let most = usize::try_from(columns).unwrap_or(usize::MAX);
        let (mut tile, mut threads) = (nx, request.threads.clamp(1, most));
        loop {
            let plan = Self::sized(request, tile, threads);
            if plan.total_bytes <= request.memory.bytes() {
                return Ok(plan);
            }
            if tile > COMFORTABLE_TILE {
                tile = narrower(tile);
            } else if threads > 1 {
                threads -= 1;
            } else if tile > NARROWEST_TILE {
                tile = narrower(tile);
            } else {
                let spread = match request.memory {
                    MemoryCap::Process(_) => HELD_SPREAD,
                    MemoryCap::Share(_) => 0,
                };
                return Err((plan.total_bytes + spread).next_multiple_of(1 << 16));
            }
        }
    }

    fn sized(request: &PlanRequest<'_>, tile: u32, threads: usize) -> Self {
        let mut plan = Self {
            dims: request.dims,
            tile,
            threads,
            channels: request.channels.iter().map(|c| c.channel).collect(),
            swapped_bytes: request.channels.iter().map(|c| c.form.swapped_bytes()).sum(),
            pool_bytes: POOL_BYTES,
            total_bytes: 0,
        };
        let scan = plan.worker_bytes() + (request.solid_bytes)(&plan.tile());
        let worker =
            scan.max(super::merge::worker_bytes(request.channels)) + WORKER_OVERHEAD + request.input_bytes;
        plan.total_bytes = request.fixed_bytes + worker * threads as u64;
        plan
    }

    /// Bytes of one [`super::column::ColumnWorker`], beside what the solid holds.
    pub(super) fn worker_bytes(&self) -> u64 {
        let words = self.tile_words();
        let bytes = (4 * 34 + 1) * (words + 2) * 8
            + 32 * words * 8
            + self.tile_bricks() * (4096 + 64 + ENTRY_BYTES * 2)
            + self.pool_bytes
            + self.payload_bytes()
            + EXTENT_BYTES;
        bytes as u64
    }

    /// What a worker of the solid is made for.
    pub(super) fn tile(&self) -> Tile {
        Tile { columns: self.tile, channels: self.channels }
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
    pub(super) fn column(&self, at: u64) -> VoxelBox {
        let [tiles, _, segments] = self.column_grid();
        let span = |index: u64, step: u32, n: u32| -> Range<u32> {
            #[expect(clippy::cast_possible_truncation, reason = "below the side of the volume")]
            let start = (index * u64::from(step)) as u32;
            start..(start + step).min(n)
        };
        VoxelBox {
            x: span(at % tiles, self.tile, self.dims.nx()),
            z: span(at / tiles % segments, SEGMENT, self.dims.nz()),
            y: span(at / tiles / segments, BRICK, self.dims.ny()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::builder::item::ItemForm;
    use crate::format::Channel;

    const NORMAL: &[ChannelForm] =
        &[ChannelForm { channel: Channel::Normal, form: ItemForm::AsIs { bytes: 2 } }];

    fn request(nx: u32, limit_mib: u64, threads: usize) -> PlanRequest<'static> {
        PlanRequest {
            dims: Dims::new(nx, 100, 600).unwrap(),
            channels: NORMAL,
            threads,
            memory: MemoryCap::Process(limit_mib << 20),
            fixed_bytes: 4 << 20,
            // Five slices of singles.
            solid_bytes: &|tile| u64::from(tile.columns) * 36 * 20,
            input_bytes: 0,
        }
    }

    #[test]
    fn columns_tile_the_volume_once() {
        for nx in [1, 64, 100, 5000] {
            let plan = ColumnPlan::new(&request(nx, 8, 2)).unwrap();
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
        let wide = ColumnPlan::new(&request(65_536, 1024, 4)).unwrap();
        assert_eq!((wide.tile, wide.threads), (65_536, 4));
        let tight = ColumnPlan::new(&request(65_536, 8, 4)).unwrap();
        assert!(tight.tile < 65_536 && tight.total_bytes <= 8 << 20);
        let Err(minimum_bytes) = ColumnPlan::new(&request(65_536, 2, 4)) else {
            panic!("2 MiB cannot be enough");
        };
        let mut again = request(65_536, 0, 4);
        again.memory = MemoryCap::Process(minimum_bytes);
        assert!(ColumnPlan::new(&again).is_ok());
        again.memory = MemoryCap::Process(minimum_bytes - (1 << 19));
        assert!(ColumnPlan::new(&again).is_err());
    }
}
