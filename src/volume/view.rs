//! A volume of borrowed samples.

use std::cell::RefCell;
use std::ops::Range;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};

use super::{Rescale, Result, Scalar, ScalarType, SourceError, VolumeInfo, VolumeSource, check_request};
use crate::geom::{Affine, Dims};
use crate::volume::SourceFault;

/// Borrowed samples, read where they are: an array of any strides is a volume without a copy.
///
/// Strides may be negative, or 0 for an axis along which all samples are one. Memory: none beyond the samples, but
/// where they follow each other along z (Fortran order) up to 2 MiB for each thread, which reads some slices ahead.
/// Cost: rows along which samples follow each other are copied whole, any other row sample by sample.
///
/// ```
/// use infobyte::{Dims, VolumeSource, VolumeView};
///
/// // An array of 4 x 3 x 2 (z, y, x), and every other slice of it from the last one on.
/// let samples: Vec<i16> = (0..24).collect();
/// let dims = Dims::new(2, 3, 2).unwrap();
/// let view = VolumeView::strided(dims, &samples, 3 * 6, [1, 2, -12]).unwrap();
/// let mut row = [0_i16; 2];
/// view.read_rows(1, 2..3, 0..2, bytemuck::cast_slice_mut(&mut row)).unwrap();
/// assert_eq!(row, [10, 11]);
/// ```
#[derive(Clone, Debug)]
pub struct VolumeView<'a> {
    info: VolumeInfo,
    samples: Block<'a>,
}

/// Bytes, and the places of samples in them.
#[derive(Clone, Copy, Debug)]
pub(super) struct Block<'a> {
    bytes: &'a [u8],
    /// Byte of voxel (0, 0, 0).
    first: usize,
    /// Bytes from a voxel to the next one along x, y, z; negative ones wrap.
    strides: [usize; 3],
    /// Number that distinguishes views; 0 for one that is not read ahead.
    number: u64,
}

/// Bytes of slices that a thread reads ahead, where samples follow each other along z.
///
/// Enough for 32 slices of a build's row of bricks across 800 samples of two bytes: as many as share a line.
const AHEAD_BYTES: usize = 2 << 20;

/// Bytes that come from memory together.
const LINE: usize = 64;

/// Rows and columns of pencils of samples along z that are fetched before any of them is turned. As many lines of
/// memory are on their way together, and in a buffer of their own they do not compete for the cache.
const PENCILS: [usize; 2] = [4, 32];

/// Words that are turned side by side.
const LANES: usize = 4;

/// A part of some slices, which a thread has read together: the samples of one line of memory lie in them all, and one
/// slice after the other would fetch every line again for each.
#[derive(Default)]
struct Ahead {
    number: u64,
    rows: Range<u32>,
    cols: Range<u32>,
    z: Range<u32>,
    /// Bytes from a slice to the next; a line more than a slice, so that slices do not compete for the same places of
    /// the cache.
    pitch: usize,
    samples: Vec<u8>,
}

thread_local! {
    static AHEAD: RefCell<Ahead> = RefCell::default();
}

impl<'a> VolumeView<'a> {
    /// Samples one after the other: x fastest, then y, then z. Voxels are of 1 mm, and the middle of the first one is
    /// the origin; `None` unless there is one sample for each voxel.
    pub fn new<T: Scalar>(dims: Dims, samples: &'a [T]) -> Option<Self> {
        let info = VolumeInfo::in_memory(dims, T::TYPE);
        let samples = Block::dense(dims, samples)?;
        Some(Self { info, samples })
    }

    /// Samples with any strides, counted in samples. Voxel (x, y, z) is
    /// `samples[first + x * strides[0] + y * strides[1] + z * strides[2]]`; `None` if one of them is not in the slice.
    pub fn strided<T: Scalar>(
        dims: Dims,
        samples: &'a [T],
        first: usize,
        strides: [isize; 3],
    ) -> Option<Self> {
        let size = size_of::<T>();
        let [x, y, z] = strides.map(|stride| stride.checked_mul(size.cast_signed()));
        Self::from_bytes(dims, T::TYPE, bytemuck::cast_slice(samples), first.checked_mul(size)?, [x?, y?, z?])
    }

    /// Like [`VolumeView::strided`], for samples in native byte order, which need not be aligned; `first` and `strides`
    /// count bytes.
    pub fn from_bytes(
        dims: Dims,
        scalar: ScalarType,
        bytes: &'a [u8],
        first: usize,
        strides: [isize; 3],
    ) -> Option<Self> {
        let reach = |stride: &isize, side: u32| i128::from(side - 1) * (*stride as i128);
        let reaches = strides.iter().zip(dims.to_array()).map(|(stride, side)| reach(stride, side));
        let (low, high) =
            reaches.fold((0, 0), |(low, high), reach| (low + reach.min(0), high + reach.max(0)));
        let is_within =
            first as i128 + low >= 0 && first as i128 + high + scalar.bytes() as i128 <= bytes.len() as i128;
        static VIEWS: AtomicU64 = AtomicU64::new(1);
        let number = VIEWS.fetch_add(1, Ordering::Relaxed);
        let samples = Block { bytes, first, strides: strides.map(isize::cast_unsigned), number };
        is_within.then(|| Self { info: VolumeInfo::in_memory(dims, scalar), samples })
    }

    /// Moves the voxels to another place: `affine` maps voxel indices to LPS mm. To change only the spacing:
    /// [`Affine::from_spacing`].
    #[must_use]
    pub fn placed(mut self, affine: Affine) -> Self {
        self.info.place(affine);
        self
    }

    /// Gives the samples other physical values, to which a threshold refers.
    #[must_use]
    pub fn rescaled(mut self, rescale: Rescale) -> Self {
        self.info.rescale = rescale;
        self
    }
}

impl<'a> Block<'a> {
    /// Samples one after the other; `None` unless there is one for each voxel.
    pub(super) fn dense<T: Scalar>(dims: Dims, samples: &'a [T]) -> Option<Self> {
        let [nx, ny, _] = dims.to_array().map(|side| side as usize);
        let size = size_of::<T>();
        let strides = [size, nx * size, nx * ny * size];
        let is_whole = samples.len() as u64 == dims.voxels();
        is_whole.then(|| Self { bytes: bytemuck::cast_slice(samples), first: 0, strides, number: 0 })
    }

    /// Implementation of [`VolumeSource::read_pitched`].
    pub(super) fn read(
        &self,
        info: &VolumeInfo,
        z: u32,
        (rows, cols): (Range<u32>, Range<u32>),
        pitch: usize,
        out: &mut [u8],
    ) -> Result {
        let size = info.scalar.bytes();
        let row_bytes = cols.len() * size;
        let wanted = match rows.len() {
            0 => 0,
            count => (count - 1) * pitch + row_bytes,
        };
        // Padding between rows is not part of the request.
        let is_as_long = row_bytes == 0 || out.len() == wanted;
        let asked = if is_as_long { rows.len() * row_bytes } else { usize::MAX };
        check_request(info, z, &rows, &cols, asked).map_err(|cause| {
            SourceError::from(SourceFault::ReadFailed {
                path: PathBuf::from(&info.description.name),
                slice: z,
                cause,
            })
        })?;
        if rows.is_empty() || row_bytes == 0 {
            return Ok(());
        }
        let [sx, sy, sz] = self.strides;
        let start = [(cols.start, sx), (rows.start, sy), (z, sz)]
            .into_iter()
            .fold(self.first, |at, (index, stride)| at.wrapping_add((index as usize).wrapping_mul(stride)));
        if sx == size {
            if sy == row_bytes && pitch == row_bytes {
                out.copy_from_slice(&self.bytes[start..][..out.len()]);
                return Ok(());
            }
            for (row, out) in out.chunks_mut(pitch).enumerate() {
                let at = start.wrapping_add(row.wrapping_mul(sy));
                out[..row_bytes].copy_from_slice(&self.bytes[at..][..row_bytes]);
            }
            return Ok(());
        }
        let count = self.slices_ahead(start, size, rows.len() * row_bytes).min((info.dims.nz() - z) as usize);
        if count > 0 {
            AHEAD.with_borrow_mut(|ahead| {
                let is_there = ahead.number == self.number && ahead.rows == rows && ahead.cols == cols;
                if !(is_there && ahead.z.contains(&z)) {
                    let end = z + u32::try_from(count).unwrap_or(1);
                    *ahead = Ahead { number: self.number, rows, cols, z: z..end, ..std::mem::take(ahead) };
                    match size {
                        1 => self.read_ahead::<1, 8>(start, ahead),
                        2 => self.read_ahead::<2, 4>(start, ahead),
                        4 => self.read_ahead::<4, 2>(start, ahead),
                        _ => self.read_ahead::<8, 1>(start, ahead),
                    }
                }
                let slice = &ahead.samples[(z - ahead.z.start) as usize * ahead.pitch..];
                for (row, out) in slice.chunks_exact(row_bytes).zip(out.chunks_mut(pitch)) {
                    out[..row_bytes].copy_from_slice(row);
                }
            });
            return Ok(());
        }
        let sides = [cols.len(), rows.len()];
        match size {
            1 => self.gather::<1>(start, sides, pitch, out),
            2 => self.gather::<2>(start, sides, pitch, out),
            4 => self.gather::<4>(start, sides, pitch, out),
            _ => self.gather::<8>(start, sides, pitch, out),
        }
        Ok(())
    }

    /// True if samples follow each other along z, nearer than along the other axes.
    fn is_along_z(&self) -> bool {
        let [x, y, z] = self.strides.map(|stride| stride.cast_signed().unsigned_abs());
        self.number > 0 && (1..x.min(y)).contains(&z)
    }

    /// Number of slices to be read together, whose parts are `part_bytes` long each: up to the end of the first
    /// sample's cache line.
    fn slices_ahead(&self, start: usize, size: usize, part_bytes: usize) -> usize {
        if !self.is_along_z() {
            return 0;
        }
        let stride = self.strides[2].cast_signed();
        let within = self.bytes.as_ptr().addr().wrapping_add(start) % LINE;
        let left = if stride > 0 { LINE - within } else { within + 1 };
        left.div_ceil(stride.unsigned_abs().max(size)).min(AHEAD_BYTES / (part_bytes + 2 * LINE))
    }

    /// Fills `ahead`; `start` is the offset of its first sample. `N` samples are a word.
    fn read_ahead<const SIZE: usize, const N: usize>(&self, start: usize, ahead: &mut Ahead) {
        let [sx, sy, sz] = self.strides;
        let row_bytes = ahead.cols.len() * SIZE;
        let slice_bytes = ahead.rows.len() * row_bytes;
        ahead.pitch = slice_bytes.next_multiple_of(LINE) + LINE;
        ahead.samples.resize(ahead.z.len() * ahead.pitch, 0);
        let (columns, rows, slices) = (ahead.cols.len(), ahead.rows.len(), ahead.z.len());
        let along = |index: usize, stride: usize| index.wrapping_mul(stride);
        let run = slices * SIZE;
        let mut pencils = [[[0_u8; LINE]; PENCILS[1]]; PENCILS[0]];
        // Rows that lie in one page of memory come before the next columns.
        for y0 in (0..rows).step_by(PENCILS[0]) {
            for x0 in (0..columns).step_by(PENCILS[1]) {
                let there = [PENCILS[0].min(rows - y0), PENCILS[1].min(columns - x0)];
                for x in 0..there[1] {
                    for (y, pencils) in pencils[..there[0]].iter_mut().enumerate() {
                        let at = start.wrapping_add(along(x0 + x, sx)).wrapping_add(along(y0 + y, sy));
                        let pencil = &mut pencils[x];
                        if sz == SIZE && run == LINE {
                            // A copy of fixed length: many are in flight at a time.
                            pencil.copy_from_slice(&self.bytes[at..][..LINE]);
                            continue;
                        }
                        for (z, to) in pencil[..run].chunks_exact_mut(SIZE).enumerate() {
                            to.copy_from_slice(&self.bytes[at.wrapping_add(along(z, sz))..][..SIZE]);
                        }
                    }
                }
                for (y, pencils) in pencils[..there[0]].iter().enumerate() {
                    let row = &mut ahead.samples[(y0 + y) * row_bytes + x0 * SIZE..];
                    turn::<SIZE, N>(pencils, [there[1], slices], row, ahead.pitch);
                }
            }
        }
    }

    /// Reads a part of a slice sample by sample, along the axis whose samples are nearer to each other.
    fn gather<const SIZE: usize>(&self, start: usize, sides: [usize; 2], pitch: usize, out: &mut [u8]) {
        let [sx, sy, _] = self.strides;
        let mut axes = [(sides[0], sx, SIZE), (sides[1], sy, pitch)];
        if sy.cast_signed().unsigned_abs() < sx.cast_signed().unsigned_abs() {
            axes.reverse();
        }
        let [(inner, from_step, to_step), (outer, from_pitch, to_pitch)] = axes;
        for line in 0..outer {
            let (mut from, mut to) = (start.wrapping_add(line.wrapping_mul(from_pitch)), line * to_pitch);
            for _ in 0..inner {
                out[to..to + SIZE].copy_from_slice(&self.bytes[from..from + SIZE]);
                (from, to) = (from.wrapping_add(from_step), to + to_step);
            }
        }
    }
}

/// Turns some pencils, of which each holds a sample of every slice, into a row of each slice; slices lie `pitch` bytes
/// apart.
#[inline(always)]
fn turn<const SIZE: usize, const N: usize>(
    pencils: &[[u8; LINE]; PENCILS[1]],
    [columns, slices]: [usize; 2],
    out: &mut [u8],
    pitch: usize,
) {
    for x in (0..columns).step_by(LANES * N) {
        let width = (LANES * N).min(columns - x) * SIZE;
        for z in (0..slices).step_by(N) {
            let word = |k: usize, lane: usize| {
                let bytes = pencils[x + lane * N + k][z * SIZE..].first_chunk();
                u64::from_le_bytes(*bytes.unwrap_or(&[0; 8]))
            };
            let mut words: [[u64; LANES]; N] =
                std::array::from_fn(|k| std::array::from_fn(|lane| word(k, lane)));
            // A square of samples is turned by halves: samples off its diagonal change places.
            let mut half = N / 2;
            while half > 0 {
                let shift = half * SIZE * 8;
                let mask = u64::MAX / ((1 << shift) + 1);
                for k in (0..N).filter(|k| k & half == 0) {
                    let (low, high) = words.split_at_mut(k + half);
                    for (one, other) in low[k].iter_mut().zip(&mut high[0]) {
                        let changed = (*one >> shift ^ *other) & mask;
                        *one ^= changed << shift;
                        *other ^= changed;
                    }
                }
                half /= 2;
            }
            for (k, words) in words.iter().enumerate().take(slices - z) {
                let row: [[u8; 8]; LANES] = words.map(u64::to_le_bytes);
                let to = &mut out[(z + k) * pitch + x * SIZE..][..width];
                match to.first_chunk_mut::<{ 8 * LANES }>() {
                    Some(to) => to.copy_from_slice(row.as_flattened()),
                    None => to.copy_from_slice(&row.as_flattened()[..width]),
                }
            }
        }
    }
}

impl VolumeSource for VolumeView<'_> {
    fn info(&self) -> &VolumeInfo {
        &self.info
    }

    fn read_rows(&self, z: u32, rows: Range<u32>, cols: Range<u32>, out: &mut [u8]) -> Result {
        let pitch = cols.len() * self.info.scalar.bytes();
        self.samples.read(&self.info, z, (rows, cols), pitch.max(1), out)
    }

    fn read_pitched(
        &self,
        z: u32,
        rows: Range<u32>,
        cols: Range<u32>,
        pitch: usize,
        out: &mut [u8],
    ) -> Result {
        self.samples.read(&self.info, z, (rows, cols), pitch, out)
    }

    fn resident_bytes(&self) -> u64 {
        let most = self.info.description.bytes.saturating_mul(2).min(AHEAD_BYTES as u64);
        if self.samples.is_along_z() { most } else { 0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Checks that every part of every slice matches the strides, dense and with a pitch.
    fn check(view: &VolumeView<'_>, sample: impl Fn([u32; 3]) -> u16) {
        let [nx, ny, nz] = view.info().dims.to_array();
        for (z, y0, y1, x0, x1) in (0..nz).flat_map(|z| {
            let pairs = |n: u32| (0..=n).flat_map(move |a| (a..=n).map(move |b| (a, b)));
            pairs(ny).flat_map(move |(y0, y1)| pairs(nx).map(move |(x0, x1)| (z, y0, y1, x0, x1)))
        }) {
            let (rows, cols) = ((y1 - y0) as usize, (x1 - x0) as usize);
            let want: Vec<u16> =
                (y0..y1).flat_map(|y| (x0..x1).map(move |x| [x, y, z])).map(&sample).collect();
            let mut got = vec![0_u16; rows * cols];
            view.read_rows(z, y0..y1, x0..x1, bytemuck::cast_slice_mut(&mut got)).unwrap();
            assert_eq!(got, want, "{z} {y0}..{y1} {x0}..{x1}");
            if rows > 0 {
                let mut apart = vec![9_u16; (rows - 1) * (cols + 3) + cols];
                let pitch = 2 * (cols + 3);
                view.read_pitched(z, y0..y1, x0..x1, pitch, bytemuck::cast_slice_mut(&mut apart)).unwrap();
                for (row, want) in apart.chunks(cols + 3).zip(want.chunks(cols.max(1))) {
                    assert!(row[..cols] == *want && row[cols..].iter().all(|v| *v == 9));
                }
            }
        }
    }

    #[test]
    fn samples_are_found_by_any_strides() {
        let samples: Vec<u16> = (0..210).collect();
        let dims = Dims::new(5, 3, 4).unwrap();
        for (first, strides) in [
            (0, [1, 5, 15]),
            (0, [12, 4, 1]),
            (0, [3, 1, 15]),
            (7, [1, 10, 40]),
            (7, [2, 11, 40]),
            (209, [-1, -5, -15]),
            (60, [-12, 4, 30]),
            (3, [0, 0, 1]),
            (3, [1, 0, 0]),
        ] {
            let view = VolumeView::strided(dims, &samples, first, strides).unwrap();
            check(&view, |p| {
                let at = (0..3).fold(first.cast_signed(), |at, a| at + p[a] as isize * strides[a]);
                samples[at.cast_unsigned()]
            });
        }
        let bytes: Vec<u8> = bytemuck::cast_slice(&samples).to_vec();
        let view = VolumeView::from_bytes(dims, ScalarType::U16, &bytes[1..], 1, [2, 10, 30]).unwrap();
        check(&view, |[x, y, z]| samples[(1 + x + 5 * y + 15 * z) as usize]);
        check(&VolumeView::new(dims, &samples[..60]).unwrap(), |[x, y, z]| {
            samples[(x + 5 * y + 15 * z) as usize]
        });
    }

    /// Samples that follow each other along z are turned word by word: of every size, from any byte on, in both
    /// directions, with remainders at the sides.
    #[test]
    fn samples_along_z_are_turned() {
        let dims = Dims::new(37, 6, 45).unwrap();
        let [nx, ny, nz] = dims.to_array().map(|side| side as isize);
        for scalar in [ScalarType::U8, ScalarType::I16, ScalarType::F32, ScalarType::F64] {
            let size = scalar.bytes();
            let step = size.cast_signed();
            let count = 2 * (nx * ny * nz).unsigned_abs() * size + 70;
            let bytes: Vec<u8> =
                (0..count).map(|i| (i.wrapping_mul(0x9e37_79b1) >> 11).to_le_bytes()[0]).collect();
            let last = (nx * ny * nz - 1) * step;
            for (first, strides) in [
                (0, [ny * nz * step, nz * step, step]),
                (0, [nz * step, nx * nz * step, step]),
                (last, [-ny * nz * step, -nz * step, -step]),
                (0, [2 * ny * nz * step, 2 * nz * step, 2 * step]),
            ] {
                for (before, [y0, y1, x0, x1]) in
                    [(0, [0, 6, 0, 37]), (1, [1, 6, 3, 36]), (62, [5, 6, 0, 32]), (63, [0, 5, 30, 37])]
                {
                    let bytes = &bytes[before..];
                    let at = first.cast_unsigned();
                    let view = VolumeView::from_bytes(dims, scalar, bytes, at, strides).unwrap();
                    for z in [0, 1, 30, 31, 44, 7, 8] {
                        let mut got = vec![0; ((y1 - y0) * (x1 - x0)) as usize * size];
                        view.read_rows(z, y0..y1, x0..x1, &mut got).unwrap();
                        let places = (y0..y1).flat_map(|y| (x0..x1).map(move |x| [x, y, z]));
                        for (p, got) in places.zip(got.chunks(size)) {
                            let at =
                                (0..3).fold(first, |at, a| at + p[a] as isize * strides[a]).cast_unsigned();
                            assert_eq!(got, &bytes[at..at + size], "{scalar:?} {strides:?} {before} {p:?}");
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn samples_beyond_the_slice_are_refused() {
        let dims = Dims::new(5, 3, 4).unwrap();
        let samples = [0_u8; 60];
        assert!(VolumeView::new(dims, &samples[..59]).is_none());
        assert!(VolumeView::strided(dims, &samples, 0, [1, 5, 15]).is_some());
        for (first, strides) in [
            (1, [1, 5, 15]),
            (0, [-1, 5, 15]),
            (0, [1, 5, 16]),
            (usize::MAX, [1, 5, 15]),
            (0, [isize::MAX, isize::MAX, isize::MAX]),
            (59, [isize::MIN, 0, 0]),
        ] {
            assert!(VolumeView::strided(dims, &samples, first, strides).is_none(), "{first} {strides:?}");
        }
        assert!(VolumeView::strided(dims, &[0_u64 as f64; 60], 0, [isize::MAX, 0, 0]).is_none());
        let view = VolumeView::new(dims, &samples).unwrap();
        assert!(view.read_rows(4, 0..1, 0..5, &mut [0; 5]).is_err());
        assert!(view.read_rows(0, 0..1, 0..6, &mut [0; 6]).is_err());
        assert!(view.read_rows(0, 0..1, 0..5, &mut [0; 6]).is_err());
    }
}
