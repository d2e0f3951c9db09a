//! Slices of a volume on their way through a column: read into a ring, and classified.
//!
//! A column reads some rows and columns beyond its tile on every side ([`Reach`]). [`RingShape::bytes`] states the
//! memory, for any volume.

use std::ops::Range;
use std::time::{Duration, Instant};

use super::gradient::{OVERREAD, SLICE_VOXELS};
use super::item::value_bytes;
use super::lanes::RingSample;
use super::range::{Ordered, SampleRange};
use super::ring::{FileRange, SampleForm};
use super::solid::{BRICK, OccupancyRows, Tile, VoxelBox};
use crate::format::Channel;
use crate::geom::Dims;
use crate::volume::{ScalarType, SourceError, VolumeInfo, VolumeSource};

/// Bytes of a cache line on current machines.
const CACHE_LINE: usize = 64;

/// Samples needed around a box of the model, along each axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Reach {
    /// Number before the sample with the box's number.
    pub(super) low: u32,
    /// Number after it.
    pub(super) high: u32,
}

impl Reach {
    pub(super) const fn ring(self) -> usize {
        (self.low + 1 + self.high) as usize
    }
}

/// Sizes of the buffers that a volume is read through.
#[derive(Clone, Copy, Debug)]
pub(super) struct RingShape {
    pub(super) dims: Dims,
    pub(super) reach: Reach,
    /// Bytes of a sample in the file and in the ring.
    pub(super) file_bytes: usize,
    pub(super) ring_bytes: usize,
    /// Set if slices are read straight into the ring.
    pub(super) in_place: bool,
    pub(super) value_bytes: usize,
}

impl RingShape {
    /// The shape for the most favourable range of a sample type.
    pub(super) fn kindest(dims: Dims, scalar: ScalarType, reach: Reach) -> Self {
        let in_place = scalar.bytes() <= 2 || scalar == ScalarType::F32;
        let ring_bytes = if in_place { scalar.bytes() } else { size_of::<f32>() };
        Self {
            dims,
            reach,
            file_bytes: scalar.bytes(),
            ring_bytes,
            in_place,
            value_bytes: value_bytes(scalar),
        }
    }

    pub(super) fn of(info: &VolumeInfo, form: &SampleForm, reach: Reach) -> Self {
        Self {
            dims: info.dims,
            reach,
            file_bytes: info.scalar.bytes(),
            ring_bytes: form.scalar.bytes(),
            in_place: form.in_place,
            value_bytes: value_bytes(info.scalar),
        }
    }

    pub(super) fn bytes(&self, tile: &Tile) -> u64 {
        let values = if tile.channels.contains(Channel::Value) { self.value_bytes } else { 0 };
        let bytes = (self.reach.ring() * self.plane_samples(tile) + OVERREAD) * self.ring_bytes
            + self.staging_words(tile) * size_of::<u64>()
            + SLICE_VOXELS * (15 + values);
        bytes as u64
    }

    /// Columns and rows of a tile with its halo.
    fn block(&self, tile: &Tile) -> (usize, usize) {
        let cols = (tile.columns + self.reach.low + self.reach.high).min(self.dims.nx());
        let rows = (BRICK + self.reach.low + self.reach.high).min(self.dims.ny());
        (cols as usize, rows as usize)
    }

    /// Samples of one slice of a tile with its halo.
    pub(super) fn block_samples(&self, tile: &Tile) -> usize {
        let (cols, rows) = self.block(tile);
        cols * rows
    }

    /// Samples from one row of the ring to the next: an odd number of cache lines, so that the 25 rows of a
    /// 5x5x5 window fall on different sets of the cache even when a row is 2^n bytes long.
    pub(super) fn stride(&self, tile: &Tile) -> usize {
        let line = CACHE_LINE / self.ring_bytes;
        let lines = self.block(tile).0.div_ceil(line);
        (lines | 1) * line
    }

    /// Samples of one slice in the ring.
    pub(super) fn plane_samples(&self, tile: &Tile) -> usize {
        self.stride(tile) * self.block(tile).1
    }

    /// Words of the staging slices: words align the samples for every type.
    fn staging_words(&self, tile: &Tile) -> usize {
        (self.staging_slices(tile) * self.block_samples(tile) * self.file_bytes).div_ceil(size_of::<u64>())
    }

    /// Slices of file samples held besides the ring: enough that slice z is still there when its values are gathered.
    pub(super) fn staging_slices(&self, tile: &Tile) -> usize {
        match (self.in_place, tile.channels.contains(Channel::Value)) {
            (true, _) => 0,
            (false, false) => 1,
            (false, true) => self.reach.high as usize + 1,
        }
    }
}

/// The current column: its position in the volume and the layout of its buffers.
#[derive(Clone, Debug)]
pub(super) struct Frame {
    pub(super) column: VoxelBox,
    /// Rows and columns read: the tile and its halo, within the volume.
    pub(super) rows: Range<u32>,
    pub(super) cols: Range<u32>,
    /// Samples of a row, samples from one row of the ring to the next, and samples of a slice in the ring.
    pub(super) width: usize,
    pub(super) stride: usize,
    pub(super) samples: usize,
}

/// One thread's ring of slices.
pub(super) struct Slices<'a, R> {
    source: &'a dyn VolumeSource,
    range: &'a dyn FileRange,
    pub(super) form: SampleForm,
    pub(super) dims: [u32; 3],
    reach: Reach,
    stride: usize,
    pub(super) frame: Frame,
    ring: Vec<R>,
    plane_len: usize,
    /// Bytes of a sample in the file.
    file_bytes: usize,
    staging: Vec<u64>,
    /// Slices of the staging, and bytes of each.
    staging_slices: usize,
    staging_len: usize,
    /// Time spent waiting for input.
    pub(super) reading: Duration,
    /// Presence of NaN samples, and of infinite ones inside.
    pub(super) odd: OddSamples,
}

impl<'a, R: RingSample> Slices<'a, R> {
    /// `R` must be the type that the range's form states.
    pub(super) fn new(
        source: &'a dyn VolumeSource,
        range: &'a dyn FileRange,
        reach: Reach,
        tile: &Tile,
    ) -> Self {
        let (info, form) = (source.info(), range.form());
        let shape = RingShape::of(info, &form, reach);
        let plane_len = shape.plane_samples(tile);
        let nothing = VoxelBox { x: 0..0, y: 0..0, z: 0..0 };
        Self {
            source,
            range,
            form,
            dims: info.dims.to_array(),
            reach,
            stride: shape.stride(tile),
            frame: Frame { column: nothing, rows: 0..0, cols: 0..0, width: 0, stride: 0, samples: 0 },
            ring: vec![bytemuck::Zeroable::zeroed(); reach.ring() * plane_len + OVERREAD],
            plane_len,
            file_bytes: shape.file_bytes,
            staging: vec![0; shape.staging_words(tile)],
            staging_slices: shape.staging_slices(tile),
            staging_len: shape.block_samples(tile) * shape.file_bytes,
            reading: Duration::ZERO,
            odd: OddSamples::default(),
        }
    }

    /// Begins a column; a grid of cells has one more box than the volume has voxels, and the last boxes have no
    /// samples.
    pub(super) fn start(&mut self, column: &VoxelBox) {
        let widen =
            |r: &Range<u32>, n: u32| r.start.saturating_sub(self.reach.low)..(r.end + self.reach.high).min(n);
        let (rows, cols) = (widen(&column.y, self.dims[1]), widen(&column.x, self.dims[0]));
        self.frame = Frame {
            column: column.clone(),
            samples: self.stride * (rows.len() - 1) + cols.len(),
            width: cols.len(),
            stride: self.stride,
            rows,
            cols,
        };
    }

    /// Reads a slice of the column into its slot of the ring and classifies it.
    pub(super) fn load(&mut self, wanted: &mut OccupancyRows<'_>) -> Result<(), SourceError> {
        let (f, z) = (&self.frame, wanted.z());
        if z >= self.dims[2] {
            wanted.y().for_each(|y| wanted.row_mut(y).fill(0));
            return Ok(());
        }
        let ring = self.reach.ring();
        let plane = &mut self.ring[z as usize % ring * self.plane_len..][..f.samples];
        let (rows, cols) = (f.rows.clone(), f.cols.clone());
        let started = Instant::now();
        if self.form.in_place {
            let pitch = f.stride * size_of::<R>();
            let bytes: &mut [u8] = bytemuck::cast_slice_mut(plane);
            self.source.read_pitched(z, rows, cols, pitch, bytes)?;
            self.reading += started.elapsed();
            self.range.look(bytes, &mut self.odd);
            classify_rows(f, self.dims, bytes, (f.stride, size_of::<R>()), self.range, wanted);
        } else {
            let width = f.width * self.file_bytes;
            let staged = &mut bytemuck::cast_slice_mut(&mut self.staging)
                [z as usize % self.staging_slices * self.staging_len..][..width * f.rows.len()];
            self.source.read_rows(z, rows, cols, staged)?;
            self.reading += started.elapsed();
            self.range.look(staged, &mut self.odd);
            classify_rows(f, self.dims, staged, (f.width, self.file_bytes), self.range, wanted);
            let plane: &mut [f32] = bytemuck::cast_slice_mut(plane);
            for (from, to) in staged.chunks_exact(width).zip(plane.chunks_mut(f.stride)) {
                self.range.depths(from, &mut to[..f.width]);
            }
        }
        Ok(())
    }

    /// The samples of slice `z` in the ring, with [`OVERREAD`] more behind them. Any `z` is safe; for one outside the
    /// ring the samples belong to another slice.
    #[inline(always)]
    pub(super) fn plane(&self, z: u32) -> &[R] {
        &self.ring[z as usize % self.reach.ring() * self.plane_len..][..self.plane_len + OVERREAD]
    }

    /// Appends values of a slice, as in [`FileRange::push_values`]: by rows, from column and row `first` of the read
    /// block on, those with `chosen` bits.
    pub(super) fn push_values(
        &self,
        z: u32,
        first: [usize; 2],
        chosen: &[u32],
        values: &mut Vec<u8>,
        extent: &mut (f32, f32),
    ) {
        let z = z as usize;
        let (samples, stride): (&[u8], usize) = if self.form.in_place {
            let plane = &self.ring[z % self.reach.ring() * self.plane_len..][..self.plane_len];
            (bytemuck::cast_slice(plane), self.frame.stride)
        } else {
            let staging = bytemuck::cast_slice(&self.staging);
            (&staging[z % self.staging_slices * self.staging_len..][..self.staging_len], self.frame.width)
        };
        for (row, chosen) in (first[1]..).zip(chosen) {
            self.range.push_values(samples, row * stride + first[0], *chosen, values, extent);
        }
    }
}

/// Samples to report to the user.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct OddSamples {
    pub(super) not_numbers: bool,
    /// Set for infinite samples that are inside.
    pub(super) infinite: bool,
}

impl OddSamples {
    /// Searches in branch-free parts, at the speed of memory.
    pub(super) fn look<T: Ordered>(&mut self, samples: &[T], range: SampleRange<T>) {
        const PART: usize = 256;
        if T::NO_NUMBER.is_none() {
            return;
        }
        let any = |is_so: &dyn Fn(&[T]) -> bool| samples.chunks(PART).any(is_so);
        self.not_numbers = self.not_numbers
            || any(&|part| part.iter().fold(false, |found, v| found | v.partial_cmp(v).is_none()));
        for end in [T::at(T::ENDS.0), T::at(T::ENDS.1)].into_iter().filter(|end| range.contains(*end)) {
            self.infinite =
                self.infinite || any(&|part| part.iter().fold(false, |found, v| found | (*v == end)));
        }
    }
}

/// Inside bits of the wanted rows, from samples of `bytes` bytes with rows `stride` apart; each row has a word before
/// the column and one after it.
fn classify_rows(
    f: &Frame,
    dims: [u32; 3],
    plane: &[u8],
    (stride, sample_bytes): (usize, usize),
    range: &dyn FileRange,
    wanted: &mut OccupancyRows<'_>,
) {
    let x0 = (f.column.x.start - f.cols.start) as usize;
    // Columns that exist in the volume.
    let within = f.column.x.len().min((dims[0] - f.column.x.start.min(dims[0])) as usize);
    for y in wanted.y() {
        if y >= dims[1] {
            wanted.row_mut(y).fill(0);
            continue;
        }
        let first = (y - f.rows.start) as usize * stride * sample_bytes;
        let row = &plane[first..][..f.width * sample_bytes];
        range.classify(row, x0..x0 + within, wanted.row_mut(y));
    }
}
