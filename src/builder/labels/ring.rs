//! Slices of a label map on their way through a column, as label numbers: 0 for background, and beyond the volume.
//!
//! Columns and rows around the tile are read as well, so that borders need no special case.

use std::time::{Duration, Instant};

use super::cells::AROUND;
use super::wall::WINDOW;
use super::{Count, LabelChoice, LabelSolid};
use crate::builder::classify::classify;
use crate::builder::range::SampleRange;
use crate::builder::slices::Reach;
use crate::builder::solid::{BRICK, OccupancyRows, ScanSummary, Tile, VoxelBox};
use crate::cpu::{Lanes, movemask};
use crate::fault::bad;
use crate::format::MAX_LABELS;
use crate::volume::{Rescale, Scalar, ScalarType, SourceError, VolumeInfo};

/// Samples of a cache line: rows are an odd number of lines apart, and may be read beyond their end.
const LINE: usize = 32;
/// Samples of a row that are compared at once.
pub(super) const CHUNK: usize = 32;

/// The slices that one thread holds.
pub(super) struct Ring<'a> {
    pub(super) solid: &'a LabelSolid<'a>,
    pub(super) column: VoxelBox,
    /// Samples from one row to the next, and samples of a slice.
    pub(super) stride: usize,
    size: usize,
    samples: Vec<u16>,
    /// A slice beyond the volume.
    none: Vec<u16>,
    /// Samples of the file, in words so that they are aligned for every type.
    staged: Vec<u64>,
    counts: Vec<Count>,
    reading: Duration,
}

/// Samples from one row to the next.
fn stride(tile: &Tile) -> usize {
    (2 * tile.columns.div_ceil(64) as usize + 1) * LINE
}

/// Rows of a slice: the tile's and those around it.
fn rows() -> usize {
    (BRICK + AROUND.low + AROUND.high) as usize
}

/// Bytes of a ring.
pub(super) fn bytes(info: &VolumeInfo, tile: &Tile) -> u64 {
    // One more slice of zeros, for places beyond the volume.
    let ring = (AROUND.ring() + 1) * rows() * stride(tile) * size_of::<u16>();
    let columns = ((tile.columns + AROUND.low + AROUND.high) as usize).min(info.dims.nx() as usize);
    let staged = columns * rows().min(info.dims.ny() as usize) * info.scalar.bytes();
    (ring + staged.next_multiple_of(size_of::<u64>()) + MAX_LABELS * size_of::<Count>()) as u64
}

impl<'a> Ring<'a> {
    pub(super) fn new(solid: &'a LabelSolid<'a>, tile: &Tile) -> Self {
        const { assert!(WINDOW <= LINE / 2) };
        let (stride, size) = (stride(tile), rows() * stride(tile));
        Self {
            solid,
            column: VoxelBox { x: 0..0, y: 0..0, z: 0..0 },
            stride,
            size,
            samples: vec![0; AROUND.ring() * size],
            none: vec![0; size],
            staged: Vec::new(),
            counts: Vec::new(),
            reading: Duration::ZERO,
        }
    }

    /// Index in its slice of the sample at a row and a column.
    pub(super) fn at(&self, x: u32, y: u32) -> usize {
        let of = |at: u32, start: u32| (at + AROUND.low - start) as usize;
        of(y, self.column.y.start) * self.stride + of(x, self.column.x.start)
    }

    /// `N` slices from `first` on, which are held or lie beyond the volume.
    pub(super) fn slices<const N: usize>(&self, first: i64) -> [&[u16]; N] {
        let nz = self.solid.source.info().dims.nz();
        std::array::from_fn(|dz| match u32::try_from(first + dz as i64).ok().filter(|z| *z < nz) {
            Some(z) => &self.samples[z as usize % AROUND.ring() * self.size..][..self.size],
            None => &self.none,
        })
    }

    /// Reads a slice of the column, with the surroundings of its tile, into its place, and counts the labels of the
    /// tile's own voxels.
    pub(super) fn load(&mut self, z: u32) -> Result<(), SourceError> {
        let dims = self.solid.source.info().dims.to_array();
        let Reach { low, high } = AROUND;
        let around =
            |own: &std::ops::Range<u32>, n: u32| own.start.saturating_sub(low)..(own.end + high).min(n);
        let (cols, rows) = (around(&self.column.x, dims[0]), around(&self.column.y, dims[1]));
        let (first, width) = (self.at(cols.start, rows.start), cols.len());
        let row_bytes = width * self.solid.source.info().scalar.bytes();
        self.staged.resize((row_bytes * rows.len()).div_ceil(size_of::<u64>()), 0);
        let started = Instant::now();
        let staged = &mut bytemuck::cast_slice_mut(&mut self.staged)[..row_bytes * rows.len()];
        self.solid.source.read_rows(z, rows, cols, staged)?;
        self.reading += started.elapsed();
        let slice = &mut self.samples[z as usize % AROUND.ring() * self.size..][..self.size];
        slice.fill(0);
        for (from, to) in staged.chunks_exact(row_bytes).zip(slice[first..].chunks_mut(self.stride)) {
            (self.solid.convert)(self.solid, from, &mut to[..width])?;
        }
        if self.column.z.contains(&z) { self.count(z) } else { Ok(()) }
    }

    /// Counts the labels of the tile's own rows of a slice.
    fn count(&mut self, z: u32) -> Result<(), SourceError> {
        let start = self.at(self.column.x.start, self.column.y.start);
        let slice = &self.samples[z as usize % AROUND.ring() * self.size..][start..self.size];
        let width = self.column.x.len();
        for row in slice.chunks(self.stride).take(self.column.y.len()) {
            let mut rest = &row[..width];
            while let [first, ..] = rest {
                let differs = |part: &[u16]| part.iter().fold(0, |any, label| any | (label ^ first)) != 0;
                let alike = rest.chunks_exact(64).take_while(|part| !differs(part)).count() * 64;
                let run = alike + rest[alike..].iter().take_while(|label| *label == first).count();
                let (number, voxels) = (*first, run as u64);
                rest = &rest[run..];
                if number > 0 {
                    match self.counts.binary_search_by_key(&number, |count| count.0) {
                        Ok(at) => self.counts[at].1 += voxels,
                        Err(_) if self.counts.len() == MAX_LABELS => {
                            return Err(self
                                .solid
                                .wrong(bad!("holds more than {MAX_LABELS} labels; choose some of them")));
                        }
                        Err(at) => self.counts.insert(at, (number, voxels)),
                    }
                }
            }
        }
        Ok(())
    }

    /// Marks the samples of a slice that have a label, in the wanted rows.
    pub(super) fn occupancy(&self, wanted: &mut OccupancyRows<'_>) {
        let [slice] = self.slices(wanted.z().into());
        let width = self.column.x.len();
        for y in wanted.y() {
            let row = &slice[self.at(self.column.x.start, y) - 1..];
            let [before, words @ .., after] = wanted.row_mut(y) else { continue };
            classify(&row[1..=width], SampleRange { lo: 1, hi: u16::MAX }, words);
            *before = u64::from(row[0] > 0) << 63;
            *after = u64::from(row[width + 1] > 0);
        }
    }

    /// Passes the counts on to the solid.
    pub(super) fn found(&self) -> ScanSummary {
        let mut all = self.solid.counted();
        for (number, voxels) in &self.counts {
            match all.binary_search_by_key(number, |count| count.0) {
                Ok(at) => all[at].1 += voxels,
                Err(at) => all.insert(at, (*number, *voxels)),
            }
        }
        ScanSummary { reading: self.reading, ..ScanSummary::default() }
    }
}

/// Mask with bit k set where sample k differs.
#[inline(always)]
pub(super) fn bits_of(isa: impl Lanes, differ: &[u16; CHUNK]) -> u32 {
    let mut mask = [0_u8; CHUNK];
    for (mask, differ) in mask.iter_mut().zip(differ) {
        *mask = if *differ != 0 { 0xff } else { 0 };
    }
    match isa.avx2() {
        Some(avx2) => movemask(avx2, mask),
        None => mask.iter().enumerate().fold(0, |m, (k, b)| m | u32::from(b >> 7) << k),
    }
}

/// Converts a row of the file's samples, as aligned bytes, to label numbers.
pub(super) type ConvertRow = fn(&LabelSolid<'_>, &[u8], &mut [u16]) -> Result<(), SourceError>;

/// [`ConvertRow`] of a type; a sample equal to the previous one costs one comparison.
pub(super) fn convert<T: Scalar>(
    solid: &LabelSolid<'_>,
    from: &[u8],
    to: &mut [u16],
) -> Result<(), SourceError> {
    let as_it_is = *solid.choice == LabelChoice::All && solid.source.info().rescale == Rescale::IDENTITY;
    match T::TYPE {
        ScalarType::U8 if as_it_is => {
            to.iter_mut().zip(from).for_each(|(to, from)| *to = u16::from(*from));
            return Ok(());
        }
        ScalarType::U16 if as_it_is => {
            to.copy_from_slice(bytemuck::cast_slice(from));
            return Ok(());
        }
        _ => {}
    }
    let mut known: Option<(T, u16)> = None;
    for (to, sample) in to.iter_mut().zip(bytemuck::cast_slice::<u8, T>(from)) {
        *to = match known {
            Some((before, label)) if before == *sample => label,
            _ => {
                let label = solid.label_of(sample.to_f64())?;
                known = Some((*sample, label));
                label
            }
        };
    }
    Ok(())
}
