//! One column of voxels: a tile of 32 rows walked along z, from occupancy to swapped skin records.
//!
//! ```text
//!   slice z+2   --solid-->  ring of inside bits, where the cover of its slab is mixed
//!   slice z     skin = bit logic on z-1, z, z+1; the solid describes the skin voxels
//!               records of bricks of 32^3  --every 32 slices-->  scratch file
//! ```
//!
//! [`ColumnPlan::worker_bytes`] and the solid's worker state the memory, for any solid.
#![expect(
    clippy::cast_possible_truncation,
    reason = "coordinates are below 2^16, numbers of voxels within a brick below 2^15"
)]

use std::ops::Range;

use super::bits::BitVolume;
use super::boxes::{count_brick, count_slice};
use super::error::BuildError;
use super::item::ChannelForm;
use super::plan::ColumnPlan;
use super::pool::{CHUNK_BYTES, Chain, ChunkPool};
use super::skin::{BIT_RING, BIT_ROWS, BitRows, SkinRule, brick_rows, find_skin};
use super::solid::{
    BRICK, Cover, LOOKAHEAD, OccupancyRows, ScanSummary, SkinSlice, Solid, SolidWorker, VoxelBox,
};
use super::swap::{BrickEntry, FragmentWriter, Scratch};
use crate::format::Channel;
use crate::format::cell::HAS_CORNERS;
use crate::progress::Progress;

const BRICK_ROWS: usize = BRICK as usize;

/// State that all workers share.
pub(super) struct ScanContext<'a> {
    pub(super) solid: &'a dyn Solid,
    pub(super) channels: &'a [ChannelForm],
    pub(super) kept: SkinRule,
    pub(super) plan: &'a ColumnPlan,
    pub(super) scratch: &'a Scratch,
    /// Boxes that can be seen, if others are dropped.
    pub(super) seen: Option<&'a BitVolume>,
    pub(super) progress: &'a dyn Progress,
    /// Set to swap the masks of cells' inside corners as well.
    pub(super) with_sides: bool,
}

impl ScanContext<'_> {
    /// Chains of a brick: one per channel, and one of corner masks.
    fn chains(&self) -> usize {
        self.channels.len() + usize::from(self.with_sides)
    }
}

/// Totals of a worker.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ScanTotals {
    pub(super) skin: u64,
    /// Boxes of the surface dropped because they cannot be seen.
    pub(super) hidden: u64,
    /// True if a box of the surface is not at a side of the grid.
    pub(super) amid: bool,
    pub(super) found: ScanSummary,
}

impl ScanTotals {
    pub(super) fn join(self, other: Self) -> Self {
        Self {
            skin: self.skin + other.skin,
            hidden: self.hidden + other.hidden,
            amid: self.amid || other.amid,
            found: self.found.join(other.found),
        }
    }
}

/// True if a voxel of a slice of a brick is not at a side of the grid.
fn is_amid([nx, ny, nz]: [u32; 3], [x, y, z]: [u32; 3], rows: &[u32; BRICK_ROWS]) -> bool {
    let within = |at: u32, side: u32| at > 0 && at + 1 < side;
    let columns = (0..BRICK).filter(|i| within(x + i, nx)).fold(0_u32, |bits, i| bits | 1 << i);
    within(z, nz) && (y..).zip(rows).any(|(y, row)| within(y, ny) && row & columns != 0)
}

/// Skin bits of one brick that wait for the scratch file.
#[derive(Clone, Debug)]
struct WaitingBrick {
    /// Skin bits, `rows[32 z + y]`.
    rows: Box<[u32; BRICK_ROWS * BRICK_ROWS]>,
    /// Slices already swapped out, and slices done.
    swapped: u8,
    done: u8,
    last_fragment: u64,
    /// Cells with corners.
    corners: u16,
}

impl WaitingBrick {
    fn new() -> Self {
        Self {
            rows: Box::new([0; BRICK_ROWS * BRICK_ROWS]),
            swapped: 0,
            done: 0,
            last_fragment: 0,
            corners: 0,
        }
    }
}

/// Occupancy of a slab of 32 slices, 64 columns at a time.
#[derive(Clone, Debug)]
struct SlabCover {
    /// Number of the slab; beyond all slabs for none.
    slab: u32,
    /// Cover of each word of the tile, with all neighbours.
    words: Vec<Cover>,
    /// Runs of mixed words.
    mixed: Vec<Range<usize>>,
    /// Slices of the ring that still lack the bits of the other words, which stay the same.
    stale: usize,
}

impl SlabCover {
    const NONE: u32 = u32::MAX;

    fn new(words: usize) -> Self {
        Self {
            slab: Self::NONE,
            words: Vec::with_capacity(words),
            mixed: Vec::with_capacity(words.div_ceil(2)),
            stale: 0,
        }
    }

    /// Gathers the runs of mixed words once the cover of all words is known.
    fn finish(&mut self) {
        self.mixed.clear();
        for (word, cover) in self.words.iter().enumerate() {
            match self.mixed.last_mut() {
                _ if *cover != Cover::Mixed => {}
                Some(run) if run.end == word => run.end += 1,
                _ => self.mixed.push(word..word + 1),
            }
        }
        self.stale = BIT_RING;
    }

    /// Writes the bits of the words that are not mixed into every row of a slice.
    fn write_uniform(&mut self, slice: &mut [u64], row_words: usize) {
        if self.stale == 0 {
            return;
        }
        self.stale -= 1;
        for row in slice.chunks_exact_mut(row_words) {
            for (bits, cover) in row[1..].iter_mut().zip(&self.words) {
                match cover {
                    Cover::Outside => *bits = 0,
                    Cover::Inside => *bits = u64::MAX,
                    Cover::Mixed => {}
                }
            }
        }
    }
}

/// One worker: buffers for one column at a time, reused for the next.
pub(super) struct ColumnWorker<'a> {
    shared: &'a ScanContext<'a>,
    dims: [u32; 3],
    solid: Box<dyn SolidWorker + 'a>,
    /// Covers of the current slab and of the slab that is being read.
    covers: [SlabCover; 2],
    bits: Vec<u64>,
    no_bits: Vec<u64>,
    skin: Vec<u64>,
    bricks: Vec<WaitingBrick>,
    /// Items that wait for the scratch file: a chain for each channel of each brick.
    chains: Vec<Chain>,
    pool: ChunkPool,
    payload: Vec<u8>,
    entries: Vec<BrickEntry>,
    entry_bytes: Vec<u8>,
    writer: FragmentWriter<'a>,
    skin_voxels: u64,
    hidden: u64,
    amid: bool,
}

/// Words of skin bits across a column.
fn words_across(column: &VoxelBox) -> usize {
    column.x.len().div_ceil(64)
}

impl<'a> ColumnWorker<'a> {
    pub(super) fn new(shared: &'a ScanContext<'a>) -> Self {
        let plan = shared.plan;
        let words = plan.tile_words();
        Self {
            shared,
            dims: shared.solid.dims().to_array(),
            solid: shared.solid.worker(&plan.tile()),
            covers: [SlabCover::new(words), SlabCover::new(words)],
            bits: vec![0; BIT_RING * BIT_ROWS * (words + 2)],
            no_bits: vec![0; words + 2],
            skin: vec![0; BRICK_ROWS * words],
            bricks: vec![WaitingBrick::new(); plan.tile_bricks()],
            chains: vec![Chain::EMPTY; plan.tile_bricks() * shared.chains()],
            pool: ChunkPool::new(plan.pool_bytes),
            payload: Vec::with_capacity(plan.payload_bytes()),
            entries: Vec::with_capacity(plan.tile_bricks()),
            entry_bytes: Vec::with_capacity(plan.tile_bricks() * super::swap::ENTRY_BYTES),
            writer: FragmentWriter::new(shared.scratch),
            skin_voxels: 0,
            hidden: 0,
            amid: false,
        }
    }

    /// Scans one column and swaps out its skin records.
    pub(super) fn scan(&mut self, column: &VoxelBox) -> Result<(), BuildError> {
        self.solid.start(column)?;
        for cover in &mut self.covers {
            cover.slab = SlabCover::NONE;
        }
        let (ahead_by, behind_by) = (i64::from(LOOKAHEAD), i64::from(self.shared.solid.lookbehind()));
        let (z0, z1) = (i64::from(column.z.start), i64::from(column.z.end));
        for ahead in z0 - behind_by..z1 + ahead_by {
            self.shared.progress.check()?;
            if let Some(slice) = u32::try_from(ahead).ok().filter(|z| *z < self.dims[2]) {
                self.load(column, slice)?;
            }
            let z = ahead - ahead_by;
            if z >= z0 {
                self.scan_slice(column, z as u32)?;
            }
        }
        Ok(())
    }

    pub(super) fn store_occupancy(&mut self, column: &VoxelBox, to: &BitVolume) -> Result<(), BuildError> {
        self.solid.start(column)?;
        for cover in &mut self.covers {
            cover.slab = SlabCover::NONE;
        }
        let (ahead_by, behind_by) = (LOOKAHEAD, self.shared.solid.lookbehind());
        let slices = column.z.start.saturating_sub(behind_by)..(column.z.end + ahead_by).min(self.dims[2]);
        let (words, row_words) = (words_across(column), self.no_bits.len());
        for z in slices {
            self.shared.progress.check()?;
            self.load(column, z)?;
            if !column.z.contains(&z) {
                continue;
            }
            // Without a skin from the solid, its buffer holds the rows, one after the other.
            let rows = &mut self.skin[..words * column.y.len()];
            let slice = &self.bits[z as usize % BIT_RING * BIT_ROWS * row_words..][row_words..];
            for (row, from) in rows.chunks_exact_mut(words).zip(slice.chunks_exact(row_words)) {
                row.copy_from_slice(&from[1..=words]);
            }
            let first = to.row(column.y.start, z);
            if words == to.row_words {
                to.write(first, 0, rows)?;
                continue;
            }
            for (row, number) in rows.chunks_exact(words).zip(first..) {
                to.write(number, column.x.start as usize / 64, row)?;
            }
        }
        Ok(())
    }

    /// Clears the bits of voxels that cannot be seen.
    fn hide(&mut self, column: &VoxelBox, z: u32, seen: &BitVolume) -> Result<(), BuildError> {
        let words = words_across(column);
        self.payload.clear();
        // As many rows as fit into the fragment buffer, which is not in use here.
        let at_once = (self.payload.capacity() / 8 / words).clamp(1, BRICK_ROWS);
        let at_once = if words == seen.row_words { at_once } else { 1 };
        self.payload.resize((at_once * words * 8).min(BRICK_ROWS * words * 8), 0);
        let rows = &mut self.skin[..words * column.y.len()];
        let first = seen.row(column.y.start, z);
        for (rows, at) in rows.chunks_mut(at_once * words).zip((first..).step_by(at_once)) {
            if rows.iter().all(|word| *word == 0) {
                continue;
            }
            let bytes = &mut self.payload[..rows.len() * 8];
            seen.read_bytes(at, column.x.start as usize / 64, bytes).map_err(|e| seen.failed(e))?;
            for (word, seen) in rows.iter_mut().zip(bytes.as_chunks::<8>().0) {
                let kept = *word & bytemuck::pod_read_unaligned::<u64>(seen);
                self.hidden += u64::from((*word ^ kept).count_ones());
                *word = kept;
            }
        }
        Ok(())
    }

    /// Writes the gathered records and returns the worker's totals.
    pub(super) fn finish(mut self) -> Result<ScanTotals, BuildError> {
        self.writer.flush()?;
        Ok(ScanTotals {
            skin: self.skin_voxels,
            hidden: self.hidden,
            amid: self.amid,
            found: self.solid.found(),
        })
    }

    /// Determines the cover of a slab, box by box: the whole tile first, halves where it is mixed.
    fn cover_slab(&mut self, column: &VoxelBox, slab: u32) {
        let [nx, ny, nz] = self.dims;
        let grown = |from: u32, to: u32, n: u32| from.saturating_sub(1)..(to + 1).min(n);
        let (y, z) = (grown(column.y.start, column.y.end, ny), grown(slab * BRICK, (slab + 1) * BRICK, nz));
        // At the border a box that is all inside has skin.
        let inner = column.y.start > 0 && column.y.end < ny && slab > 0 && (slab + 1) * BRICK < nz;
        let cover = &mut self.covers[slab as usize % 2];
        cover.slab = slab;
        cover.words.clear();
        let words = words_across(column) as u32;
        let mut level = words.next_power_of_two();
        while cover.words.len() < words as usize {
            let first = cover.words.len() as u32;
            let end = (first + level).min(words);
            let (from, to) = (column.x.start + 64 * first, (column.x.start + 64 * end).min(column.x.end));
            let told = self.solid.cover(&VoxelBox { x: grown(from, to, nx), y: y.clone(), z: z.clone() });
            let told = match told {
                Cover::Inside if !inner || from == 0 || to == nx => Cover::Mixed,
                told => told,
            };
            if told == Cover::Mixed && level > 1 {
                level /= 2;
                continue;
            }
            cover.words.resize(end as usize, told);
            // The largest aligned box that begins here.
            level = 1 << end.trailing_zeros().min(words.next_power_of_two().trailing_zeros());
        }
        cover.finish();
    }

    /// Loads the occupancy of a slice of the column: its rows and one more on either side, each with the voxels at x0 -
    /// 1 and x1 in the words before and after. Rows outside the grid are cleared.
    fn load(&mut self, column: &VoxelBox, z: u32) -> Result<(), BuildError> {
        let slab = z / BRICK;
        if self.covers[slab as usize % 2].slab != slab {
            self.cover_slab(column, slab);
        }
        let cover = &mut self.covers[slab as usize % 2];
        let row_words = self.no_bits.len();
        let slice = &mut self.bits[z as usize % BIT_RING * BIT_ROWS * row_words..][..BIT_ROWS * row_words];
        cover.write_uniform(slice, row_words);
        if cover.mixed.is_empty() {
            return Ok(());
        }
        let [nx, ny, _] = self.dims;
        let y = column.y.start.saturating_sub(1)..(column.y.end + 1).min(ny);
        // Bits of row y are stored in row y + 1 - y0.
        let first_row = (y.start + 1 - column.y.start) as usize;
        let words = words_across(column);
        if column.y.start == 0 {
            slice[..row_words].fill(0);
        }
        if column.y.end == ny {
            slice[(column.y.len() + 1) * row_words..][..row_words].fill(0);
        }
        for run in &cover.mixed {
            // The words before and after the tile belong to its outermost words.
            let (first, end) = (run.start == 0, run.end == words);
            let from = if first { 0 } else { run.start + 1 };
            let to = if end { words + 2 } else { run.end + 1 };
            let x0 = column.x.start;
            let x_start = (x0 + 64 * run.start as u32).saturating_sub(first.into());
            let x_end = if end { (column.x.end + 1).min(nx) } else { x0 + 64 * run.end as u32 };
            let mut asked = OccupancyRows {
                x: x_start..x_end,
                y: y.clone(),
                z,
                origin: i64::from(x0) + 64 * (from as i64 - 1),
                width: to - from,
                pitch: row_words,
                words: &mut slice[first_row * row_words + from..],
            };
            self.solid.occupancy(&mut asked)?;
            // Beyond the grid everything is outside, even where the solid wrote there.
            if first && x0 == 0 || end && column.x.end == nx {
                let last = u64::MAX >> ((64 * words - column.x.len()) % 64);
                for row in slice.chunks_exact_mut(row_words) {
                    if first && x0 == 0 {
                        row[0] = 0;
                    }
                    if end && column.x.end == nx {
                        row[words] &= last;
                        row[words + 1] = 0;
                    }
                }
            }
        }
        Ok(())
    }

    /// Finds the skin of slice `z`, gathers its records, and swaps a full slab out.
    fn scan_slice(&mut self, column: &VoxelBox, z: u32) -> Result<(), BuildError> {
        let slab = z / BRICK;
        let words = words_across(column);
        let bricks = column.x.len().div_ceil(BRICK_ROWS);
        let (kept, nz) = (self.shared.kept, self.dims[2]);
        // Skin of a run of words: given by the solid, or derived from the bits.
        let find =
            |solid: &mut dyn SolidWorker, bits: &[u64], none: &[u64], skin: &mut [u64], run: Range<usize>| {
                let (origin, width) = (i64::from(column.x.start) + 64 * run.start as i64, run.len());
                let mut own = OccupancyRows {
                    x: column.x.clone(),
                    y: column.y.clone(),
                    z,
                    origin,
                    width,
                    pitch: words,
                    words: &mut skin[run.start..],
                };
                if solid.skin(&mut own) {
                    skin[words * column.y.len()..].fill(0);
                } else {
                    let bits = BitRows { bits, none, words, z, nz };
                    find_skin(&bits, run, column.y.len(), kept, &mut skin[..words * BRICK_ROWS]);
                }
            };
        if let Some(seen) = self.shared.seen {
            // Only words of mixed runs are computed below; the others are left from before.
            self.skin[..words * BRICK_ROWS].fill(0);
            for run in &self.covers[slab as usize % 2].mixed {
                let run = run.clone();
                find(&mut *self.solid, &self.bits, &self.no_bits, &mut self.skin, run);
            }
            self.hide(column, z, seen)?;
        }
        for at in 0..self.covers[slab as usize % 2].mixed.len() {
            let run = self.covers[slab as usize % 2].mixed[at].clone();
            if self.shared.seen.is_none() {
                find(&mut *self.solid, &self.bits, &self.no_bits, &mut self.skin, run.clone());
            }
            for brick in 2 * run.start..(2 * run.end).min(bricks) {
                self.scan_brick_slice(column, z, brick)?;
            }
        }
        if (z + 1).is_multiple_of(BRICK) || z + 1 == column.z.end {
            self.end_slab(column, slab)?;
        }
        Ok(())
    }

    fn scan_brick_slice(&mut self, column: &VoxelBox, z: u32, brick: usize) -> Result<(), BuildError> {
        let words = words_across(column);
        let skin = brick_rows(&self.skin, words, brick);
        if skin.iter().fold(0, |any, row| any | row) == 0 {
            return Ok(());
        }
        let corner = [column.x.start + brick as u32 * BRICK, column.y.start, z];
        self.amid = self.amid || is_amid(self.dims, corner, &skin);
        let count = count_slice(&skin);
        let slice = (z % BRICK) as usize;
        let channels = self.shared.channels;
        // One more chunk each: the last chunk of a chain may be full.
        let (chains, with_sides) = (self.shared.chains(), self.shared.with_sides);
        let most = count * self.shared.plan.swapped_bytes + chains * CHUNK_BYTES;
        if !self.pool.has_room(most) {
            self.swap_out()?;
        }
        if !channels.is_empty() {
            let slice = SkinSlice {
                corner,
                rows: &skin,
                count,
                bits: BitRows { bits: &self.bits, none: &self.no_bits, words, z, nz: self.dims[2] },
                brick,
            };
            self.solid.describe(&slice)?;
            let chains = &mut self.chains[brick * chains..][..chains];
            if let (true, Some(sides)) = (with_sides, chains.last_mut()) {
                self.payload.clear();
                self.payload.extend(slice.sides());
                self.pool.append(sides, &self.payload);
            }
            let mut corners = 0;
            for (chain, ChannelForm { channel, form }) in chains.iter_mut().zip(channels) {
                let items = self.solid.items(*channel);
                // Offsets come before the corners that they announce.
                if *channel == Channel::Offset && self.shared.kept == SkinRule::Cells {
                    corners = items.iter().filter(|o| **o == HAS_CORNERS.cast_unsigned()).count();
                }
                let due = if channel.row().is_sparse { corners } else { count };
                assert_eq!(items.len(), due * form.swapped_bytes(), "one {channel} for every skin voxel");
                self.pool.append(chain, items);
            }
            self.bricks[brick].corners += corners as u16;
        }
        let b = &mut self.bricks[brick];
        b.rows[slice * BRICK_ROWS..][..BRICK_ROWS].copy_from_slice(&skin);
        b.done = slice as u8 + 1;
        self.skin_voxels += count as u64;
        Ok(())
    }

    /// Swaps out the gathered records of every brick of the tile.
    fn swap_out(&mut self) -> Result<(), BuildError> {
        let channels = self.shared.chains();
        for (at, brick) in self.bricks.iter_mut().enumerate() {
            let chains = &mut self.chains[at * channels..][..channels];
            if brick.swapped < brick.done {
                self.payload.clear();
                let slices = usize::from(brick.swapped)..usize::from(brick.done);
                self.payload.extend([brick.swapped, brick.done]);
                for rows in brick.rows.as_chunks::<BRICK_ROWS>().0[slices].iter() {
                    let filled = rows.iter().enumerate().fold(0_u32, |m, (y, r)| m | u32::from(*r != 0) << y);
                    self.payload.extend(filled.to_le_bytes());
                    for row in rows.iter().filter(|r| **r != 0) {
                        self.payload.extend(row.to_le_bytes());
                    }
                }
                let is_split = |at: usize| {
                    self.shared.channels.get(at).is_some_and(|channel| channel.form.tail_bytes() > 0)
                };
                for (at, chain) in chains.iter().enumerate() {
                    let bytes = if is_split(at) { [1, 2] } else { [0, 1] };
                    self.pool.copy_to(chain, bytes, &mut self.payload);
                }
                let packed = self.payload.len();
                for (_, chain) in chains.iter().enumerate().filter(|(at, _)| is_split(*at)) {
                    self.pool.copy_to(chain, [0, 2], &mut self.payload);
                }
                let tail = self.payload.len() - packed;
                brick.last_fragment = self.writer.append(brick.last_fragment, &self.payload, tail)?;
                brick.swapped = brick.done;
            }
            chains.fill(Chain::EMPTY);
        }
        self.pool.clear();
        Ok(())
    }

    /// Swaps out a finished row of bricks and writes its index entries.
    fn end_slab(&mut self, column: &VoxelBox, slab: u32) -> Result<(), BuildError> {
        self.swap_out()?;
        self.entries.clear();
        for brick in &mut self.bricks[..column.x.len().div_ceil(BRICK_ROWS)] {
            let mut entry = BrickEntry::default();
            if brick.last_fragment != 0 {
                (entry.skin, entry.boxes) = count_brick(&brick.rows);
                entry.last_fragment = brick.last_fragment;
                entry.corners = brick.corners;
                brick.rows.fill(0);
                (brick.last_fragment, brick.corners) = (0, 0);
            }
            (brick.swapped, brick.done) = (0, 0);
            self.entries.push(entry);
        }
        let first = [column.x.start / BRICK, column.y.start / BRICK, slab].map(u64::from);
        self.shared.scratch.put_entries(first, &self.entries, &mut self.entry_bytes)
    }
}
