//! One column of the volume: a tile of 32 rows walked along z, from samples to swapped skin records.
//!
//! ```text
//!   slice z+2  --read-->  ring of 5 slices  --classify-->  ring of inside bits
//!   slice z               skin = bit logic on z-1, z, z+1; gradient on z-2 ..= z+2 at skin voxels
//!                         records of bricks of 32^3  --every 32 slices-->  scratch file
//! ```
//!
//! A column reads 2 rows and 2 columns beyond its tile on every side. Memory is that of
//! [`ColumnPlan::worker_bytes`], whatever the volume holds.
#![expect(
    clippy::cast_possible_truncation,
    reason = "coordinates are below 2^16, places within a brick below 2^15"
)]

use std::ops::Range;
use std::time::{Duration, Instant};

use super::boxes::{count_brick, count_slice};
use super::classify::classify;
use super::error::BuildError;
use super::flavour::{Flavour, border_unit, convert};
use super::gradient::{
    Gradients, NormalRule, OVERREAD, REACH, SLICE_VOXELS, SliceWindow, gradient_of_depths, gradients,
};
use super::plan::{BRICK, ColumnPlan};
use super::pool::{Chain, ChunkPool};
use super::range::{Ordered, SampleRange};
use super::skin::{BIT_RING, BIT_ROWS, BitRows, Connectivity, Exposed, brick_rows, exposed, find_skin};
use super::swap::{BrickEntry, FragmentWriter, Scratch};
use crate::volume::{SourceError, VolumeSource};

const BRICK_ROWS: usize = BRICK as usize;
const RING: usize = 2 * REACH as usize + 1;

/// Part of the volume that one worker takes at a time.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Column {
    pub(super) x: Range<u32>,
    pub(super) y: Range<u32>,
    pub(super) z: Range<u32>,
}

/// What all workers share.
pub(super) struct ScanContext<'a, F> {
    pub(super) source: &'a dyn VolumeSource,
    pub(super) flavour: F,
    pub(super) connectivity: Connectivity,
    pub(super) rule: &'a NormalRule,
    pub(super) plan: &'a ColumnPlan,
    pub(super) scratch: &'a Scratch,
}

/// Figures that a worker brings home.
#[derive(Clone, Copy, Debug)]
pub(super) struct ScanTotals {
    pub(super) skin: u64,
    /// Smallest and largest value of a skin voxel, for the scale of wide values.
    pub(super) values: (f32, f32),
    /// Time spent waiting for the source.
    pub(super) reading: Duration,
}

impl ScanTotals {
    pub(super) const NONE: Self =
        Self { skin: 0, values: (f32::INFINITY, f32::NEG_INFINITY), reading: Duration::ZERO };

    pub(super) fn join(self, other: Self) -> Self {
        Self {
            skin: self.skin + other.skin,
            values: (self.values.0.min(other.values.0), self.values.1.max(other.values.1)),
            reading: self.reading + other.reading,
        }
    }
}

/// Skin records of one brick that wait for the scratch file.
#[derive(Clone, Debug)]
struct Brick {
    /// Skin bits, `rows[32 z + y]`.
    rows: Box<[u32; BRICK_ROWS * BRICK_ROWS]>,
    normals: Chain,
    values: Chain,
    /// Slices swapped out already, and slices done.
    swapped: u8,
    done: u8,
    last_fragment: u64,
}

impl Brick {
    fn new() -> Self {
        Self {
            rows: Box::new([0; BRICK_ROWS * BRICK_ROWS]),
            normals: Chain::EMPTY,
            values: Chain::EMPTY,
            swapped: 0,
            done: 0,
            last_fragment: 0,
        }
    }
}

/// One worker: buffers for one column at a time, reused for the next.
pub(super) struct ColumnWorker<'a, F: Flavour> {
    shared: &'a ScanContext<'a, F>,
    dims: [u32; 3],
    ring: Vec<F::Ring>,
    plane_len: usize,
    staging: Vec<F::File>,
    bits: Vec<u64>,
    no_bits: Vec<u64>,
    skin: Vec<u64>,
    bricks: Vec<Brick>,
    pool: ChunkPool,
    gradients: Box<Gradients>,
    codes: Box<[u16; SLICE_VOXELS]>,
    values: Vec<u8>,
    payload: Vec<u8>,
    entries: Vec<BrickEntry>,
    entry_bytes: Vec<u8>,
    writer: FragmentWriter<'a>,
    totals: ScanTotals,
}

/// The column at hand: its place and the layout of its buffers.
#[derive(Clone, Debug)]
struct Frame {
    column: Column,
    /// Rows and columns read: the tile and its halo, within the volume.
    rows: Range<u32>,
    cols: Range<u32>,
    /// Samples of a row, from one row of the ring to the next, and of a slice in the ring.
    width: usize,
    stride: usize,
    samples: usize,
    /// Words per row of skin bits.
    words: usize,
}

impl<'a, F: Flavour> ColumnWorker<'a, F> {
    pub(super) fn new(shared: &'a ScanContext<'a, F>) -> Self {
        let plan = shared.plan;
        let plane_len = plan.plane_samples();
        let words = plan.tile_words();
        let staging = plan.staging_slices(F::DIRECT) * plan.block_samples();
        Self {
            shared,
            dims: shared.source.info().dims.to_array(),
            ring: vec![bytemuck::Zeroable::zeroed(); RING * plane_len + OVERREAD],
            plane_len,
            staging: vec![bytemuck::Zeroable::zeroed(); staging],
            bits: vec![0; BIT_RING * BIT_ROWS * (words + 2)],
            no_bits: vec![0; words + 2],
            skin: vec![0; BRICK_ROWS * words],
            bricks: vec![Brick::new(); plan.tile_bricks()],
            pool: ChunkPool::new(plan.pool_bytes),
            gradients: Gradients::new(),
            codes: Box::new([0; SLICE_VOXELS]),
            values: Vec::with_capacity(SLICE_VOXELS * plan.swapped_value_bytes),
            payload: Vec::with_capacity(plan.payload_bytes()),
            entries: Vec::with_capacity(plan.tile_bricks()),
            entry_bytes: Vec::with_capacity(plan.tile_bricks() * super::swap::ENTRY_BYTES),
            writer: FragmentWriter::new(shared.scratch),
            totals: ScanTotals::NONE,
        }
    }

    /// Scans one column and swaps its skin records out.
    pub(super) fn scan(&mut self, column: &Column) -> Result<(), BuildError> {
        let frame = self.frame(column);
        let reach = i64::from(REACH);
        let (z0, z1) = (i64::from(column.z.start), i64::from(column.z.end));
        for ahead in z0 - reach..z1 + reach {
            if let Some(slice) = self.slice_in_volume(ahead) {
                self.load(&frame, slice)?;
            }
            let z = ahead - reach;
            if z >= z0 {
                self.scan_slice(&frame, z as u32)?;
            }
        }
        Ok(())
    }

    /// Writes what is still gathered and returns the worker's figures.
    pub(super) fn finish(mut self) -> Result<ScanTotals, BuildError> {
        self.writer.flush()?;
        Ok(self.totals)
    }

    fn slice_in_volume(&self, z: i64) -> Option<u32> {
        u32::try_from(z).ok().filter(|z| *z < self.dims[2])
    }

    fn frame(&self, column: &Column) -> Frame {
        let widen = |r: &Range<u32>, n: u32| r.start.saturating_sub(REACH)..(r.end + REACH).min(n);
        let (rows, cols) = (widen(&column.y, self.dims[1]), widen(&column.x, self.dims[0]));
        let stride = self.shared.plan.ring_stride();
        Frame {
            column: column.clone(),
            samples: stride * (rows.len() - 1) + cols.len(),
            width: cols.len(),
            stride,
            words: column.x.len().div_ceil(64),
            rows,
            cols,
        }
    }

    /// Reads a slice of the column into its place in the ring and classifies it.
    fn load(&mut self, f: &Frame, z: u32) -> Result<(), SourceError> {
        let shared = self.shared;
        let plane = &mut self.ring[z as usize % RING * self.plane_len..][..f.samples];
        let words = self.no_bits.len();
        let bits = &mut self.bits[z as usize % BIT_RING * BIT_ROWS * words..][..BIT_ROWS * words];
        let (rows, cols) = (f.rows.clone(), f.cols.clone());
        let started = Instant::now();
        if F::DIRECT {
            let pitch = f.stride * size_of::<F::Ring>();
            shared.source.read_pitched(z, rows, cols, pitch, bytemuck::cast_slice_mut(plane))?;
            self.totals.reading += started.elapsed();
            classify_rows(
                f,
                self.dims,
                bytemuck::cast_slice(plane),
                f.stride,
                shared.flavour.range(),
                bits,
                words,
            );
        } else {
            let slots = shared.plan.staging_slices(false);
            let len = self.staging.len() / slots;
            let staged = &mut self.staging[z as usize % slots * len..][..f.width * f.rows.len()];
            shared.source.read_rows(z, rows, cols, bytemuck::cast_slice_mut(staged))?;
            self.totals.reading += started.elapsed();
            classify_rows(f, self.dims, staged, f.width, shared.flavour.range(), bits, words);
            for (from, to) in staged.chunks_exact(f.width).zip(plane.chunks_mut(f.stride)) {
                convert(&shared.flavour, from, &mut to[..f.width]);
            }
        }
        Ok(())
    }

    /// Finds the skin of slice `z`, computes its records, and swaps a full slab out.
    fn scan_slice(&mut self, f: &Frame, z: u32) -> Result<(), BuildError> {
        self.find_skin(f, z);
        for brick in 0..f.column.x.len().div_ceil(BRICK_ROWS) {
            self.scan_brick_slice(f, z, brick)?;
        }
        if (z + 1).is_multiple_of(BRICK) || z + 1 == f.column.z.end {
            self.end_slab(f, z / BRICK)?;
        }
        Ok(())
    }

    fn find_skin(&mut self, f: &Frame, z: u32) {
        let bits = BitRows { bits: &self.bits, none: &self.no_bits, words: f.words, z, nz: self.dims[2] };
        let skin = &mut self.skin[..f.words * BRICK_ROWS];
        find_skin(&bits, f.column.y.len(), self.shared.connectivity, skin);
    }

    fn scan_brick_slice(&mut self, f: &Frame, z: u32, brick: usize) -> Result<(), BuildError> {
        let skin = brick_rows(&self.skin, f.words, brick);
        if skin.iter().fold(0, |any, row| any | row) == 0 {
            return Ok(());
        }
        let count = count_slice(&skin);
        let slice = (z % BRICK) as usize;
        let value_bytes = self.shared.plan.swapped_value_bytes;
        let normal_bytes = if self.shared.plan.normals { 2 } else { 0 };
        // One more chunk each: the last chunk of a chain may be full or shared with none.
        if !self.pool.has_room(count * (value_bytes + normal_bytes) + 2 * super::pool::CHUNK_BYTES) {
            self.swap_out()?;
        }
        if normal_bytes > 0 {
            self.normals(f, z, brick, &skin);
            let codes = bytemuck::cast_slice(&self.codes[..count]);
            self.pool.append(&mut self.bricks[brick].normals, codes);
        }
        if value_bytes > 0 {
            self.gather_values(f, z, brick, &skin);
            self.pool.append(&mut self.bricks[brick].values, &self.values);
        }
        let b = &mut self.bricks[brick];
        b.rows[slice * BRICK_ROWS..][..BRICK_ROWS].copy_from_slice(&skin);
        b.done = slice as u8 + 1;
        self.totals.skin += count as u64;
        Ok(())
    }

    /// Fills `codes` with the normals of a brick's skin voxels in slice `z`.
    fn normals(&mut self, f: &Frame, z: u32, brick: usize, skin: &[u32; BRICK_ROWS]) {
        let x0 = f.column.x.start + brick as u32 * BRICK;
        let interior = self.interior(f, z, x0, skin);
        let row0 = (f.column.y.start - f.rows.start) as usize;
        let planes: [&[F::Ring]; RING] = std::array::from_fn(|k| {
            let slice = (z as usize + k + RING - REACH as usize) % RING;
            &self.ring[slice * self.plane_len..][..self.plane_len + OVERREAD]
        });
        let origin = row0 * f.stride + (x0 - f.cols.start) as usize;
        let window = SliceWindow { planes, stride: f.stride, origin, skin, interior: &interior };
        gradients(&window, self.shared.rule.taps, &mut self.gradients);
        let bits = BitRows { bits: &self.bits, none: &self.no_bits, words: f.words, z, nz: self.dims[2] };
        let faces: [Exposed; BRICK_ROWS] = std::array::from_fn(|y| {
            if skin[y] == 0 { Exposed::default() } else { exposed(&bits.around(y), brick) }
        });
        let (dims, flavour) = (self.dims, self.shared.flavour);
        let (unit, taps) = (border_unit::<F>(), self.shared.rule.taps);
        self.shared.rule.codes(&window, &faces, &mut self.gradients, &mut self.codes, |y, x| {
            let (cx, cy) = (i64::from(x0 + x), i64::from(f.column.y.start) + y as i64);
            let depths = std::array::from_fn(|k| {
                std::array::from_fn(|j| {
                    std::array::from_fn(|i| {
                        let (px, py) = (cx + i as i64 - 2, cy + j as i64 - 2);
                        let pz = i64::from(z) + k as i64 - 2;
                        let (qx, qy) =
                            (px.clamp(0, i64::from(dims[0]) - 1), py.clamp(0, i64::from(dims[1]) - 1));
                        let qz = pz.clamp(0, i64::from(dims[2]) - 1);
                        let at = (qy as usize - f.rows.start as usize) * f.stride
                            + (qx as usize - f.cols.start as usize);
                        let depth = flavour.depth(window.planes[(qz - i64::from(z) + 2) as usize][at]);
                        // Beyond the border the volume is as far outside as it is inside before it.
                        if (px, py, pz) == (qx, qy, qz) { depth } else { -depth.abs() - unit }
                    })
                })
            });
            gradient_of_depths(taps, &depths)
        });
    }

    /// Skin voxels whose 5x5x5 neighbourhood lies in the volume.
    fn interior(&self, f: &Frame, z: u32, x0: u32, skin: &[u32; BRICK_ROWS]) -> [u32; BRICK_ROWS] {
        let inside = |p: u32, n: u32| p >= REACH && p + REACH < n;
        if !inside(z, self.dims[2]) {
            return [0; BRICK_ROWS];
        }
        let mut columns = u32::MAX;
        if x0 < REACH || x0 + BRICK + REACH > self.dims[0] {
            columns = (0..BRICK).filter(|x| inside(x0 + x, self.dims[0])).fold(0, |m, x| m | 1 << x);
        }
        std::array::from_fn(|y| {
            let here = f.column.y.start + y as u32;
            if inside(here, self.dims[1]) { skin[y] & columns } else { 0 }
        })
    }

    /// Fills `values` with the swapped values of a brick's skin voxels in slice `z`.
    fn gather_values(&mut self, f: &Frame, z: u32, brick: usize, skin: &[u32; BRICK_ROWS]) {
        let (plane, stride): (&[F::File], usize) = if F::DIRECT {
            let plane = &self.ring[z as usize % RING * self.plane_len..][..self.plane_len];
            (bytemuck::cast_slice(plane), f.stride)
        } else {
            let slots = self.shared.plan.staging_slices(false);
            let len = self.staging.len() / slots;
            (&self.staging[z as usize % slots * len..][..len], f.width)
        };
        let x0 = (f.column.x.start - f.cols.start) as usize + brick * BRICK_ROWS;
        let y0 = (f.column.y.start - f.rows.start) as usize;
        self.values.clear();
        for (y, row) in skin.iter().enumerate() {
            let mut bits = *row;
            while bits != 0 {
                let x = bits.trailing_zeros() as usize;
                bits &= bits - 1;
                let value = plane[(y0 + y) * stride + x0 + x];
                super::value::push_swapped(value, &mut self.values, &mut self.totals.values);
            }
        }
    }

    /// Swaps out what every brick of the tile has gathered.
    fn swap_out(&mut self) -> Result<(), BuildError> {
        for brick in &mut self.bricks {
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
                self.pool.copy_to(&brick.normals, &mut self.payload);
                self.pool.copy_to(&brick.values, &mut self.payload);
                brick.last_fragment = self.writer.append(brick.last_fragment, &self.payload)?;
                brick.swapped = brick.done;
            }
            (brick.normals, brick.values) = (Chain::EMPTY, Chain::EMPTY);
        }
        self.pool.clear();
        Ok(())
    }

    /// Swaps out a finished row of bricks and writes its index entries.
    fn end_slab(&mut self, f: &Frame, slab: u32) -> Result<(), BuildError> {
        self.swap_out()?;
        self.entries.clear();
        for brick in &mut self.bricks[..f.column.x.len().div_ceil(BRICK_ROWS)] {
            let mut entry = BrickEntry::default();
            if brick.last_fragment != 0 {
                (entry.skin, entry.boxes) = count_brick(&brick.rows);
                entry.last_fragment = brick.last_fragment;
                brick.rows.fill(0);
                brick.last_fragment = 0;
            }
            (brick.swapped, brick.done) = (0, 0);
            self.entries.push(entry);
        }
        let first = [f.column.x.start / BRICK, f.column.y.start / BRICK, slab].map(u64::from);
        self.shared.scratch.put_entries(first, &self.entries, &mut self.entry_bytes)
    }
}

/// Inside bits of one slice of the column: the tile's rows and one more on either side, each with the
/// neighbours at x0 - 1 and x1 in the words before and after. Rows outside the volume are cleared.
fn classify_rows<T: Ordered>(
    f: &Frame,
    dims: [u32; 3],
    plane: &[T],
    stride: usize,
    range: SampleRange<T>,
    bits: &mut [u64],
    row_words: usize,
) {
    let x0 = (f.column.x.start - f.cols.start) as usize;
    let width = f.column.x.len();
    for (at, row) in bits.chunks_exact_mut(row_words).enumerate() {
        let y = f.column.y.start.wrapping_add(at as u32).wrapping_sub(1);
        if y >= dims[1] || !f.rows.contains(&y) {
            row.fill(0);
            continue;
        }
        let samples = &plane[(y - f.rows.start) as usize * stride..][..f.width];
        classify(&samples[x0..x0 + width], range, &mut row[1..=f.words]);
        row[0] = if x0 > 0 { u64::from(range.contains(samples[x0 - 1])) << 63 } else { 0 };
        row[f.words + 1] = samples.get(x0 + width).map_or(0, |v| u64::from(range.contains(*v)));
    }
}
