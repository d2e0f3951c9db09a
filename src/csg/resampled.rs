//! A volume that a tree moves, turns or stretches: its values between samples, on the grid of the tree.
//!
//! ```text
//!   volume --once--> bricks of 9^3 samples (scratch file) --cache of a thread--> trilinear values of rows
//! ```
//!
//! A voxel's middle is brought to the volume's samples and rounded to 2^-12 of their distance; its value is the
//! trilinear interpolation there, rounded to a single. Beyond the outermost samples there is nothing, and voxels are
//! outside. A sample that is not a number is as far outside as the others around it are inside, so that the surface
//! lies midway; it does so between the two values of a mask, too, and around the labels of a map. So a volume that is moved by whole voxels, mirrored or turned by right angles has the voxels that it has
//! where it lies, and neither memory nor threads change a value. (Samples of more than 24 bits are rounded to singles
//! first.)
//!
//! Memory: [`CACHE_BYTES`] a thread, [`LAYING_BYTES`] while bricks are laid. Temporary disk: 5.7 bytes a sample.
#![expect(clippy::cast_possible_truncation, reason = "coordinates are below 2^17, weights below 2^37")]

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use super::place::LatticeGrid;
use crate::builder::Progress;
use crate::geom::Affine;
use crate::platform::PositionalFile;
use crate::scratch::{PageCache, unnamed};
use crate::volume::{Result, ScalarType, SourceError, SourceFault, VolumeInfo, VolumeSource};

/// Cells of a brick along each axis, and its samples: one more.
const CELLS: u32 = 8;
const SAMPLES: usize = CELLS as usize + 1;
const BRICK: usize = SAMPLES * SAMPLES * SAMPLES;
/// Bricks that a thread holds.
const SLOTS: usize = 512;
/// Bricks laid at a time.
const LAID: u32 = 32;
/// Units of the distance of two samples.
const PARTS: i64 = 4096;

const CACHE_BYTES: u64 = Cache::memory_bytes(SLOTS, BRICK);
pub(super) const LAYING_BYTES: u64 =
    (SAMPLES * SAMPLES * (CELLS * LAID + 1) as usize * 4 + LAID as usize * BRICK * 4 + (64 << 10)) as u64;

/// A volume on another grid.
pub(super) struct ResampledVolume<'a> {
    inner: &'a dyn VolumeSource,
    info: VolumeInfo,
    /// Voxels of the grid to samples of the volume.
    to_samples: Affine,
    sides: [u32; 3],
    bricks: [u32; 3],
    /// The value outside the volume.
    beyond: f32,
    /// Added to samples: it brings the middle between the values of a mask to the bound.
    shift: f64,
    /// The sample at the surface, and true if higher ones are inside.
    bound: f64,
    rises: bool,
    /// True if some samples are not numbers.
    pub(super) has_nan: bool,
    file: PositionalFile,
    folder: PathBuf,
    caches: Mutex<Vec<Cache>>,
}

/// Bricks in memory, by number.
type Cache = PageCache<u64, f32>;

/// The samples of a file, in native byte order, as singles.
fn singles(scalar: ScalarType, bytes: &[u8], out: &mut [f32]) {
    fn each<T: bytemuck::AnyBitPattern>(bytes: &[u8], out: &mut [f32], of: impl Fn(T) -> f32) {
        for (out, bytes) in out.iter_mut().zip(bytes.chunks_exact(size_of::<T>())) {
            *out = of(bytemuck::pod_read_unaligned(bytes));
        }
    }
    match scalar {
        ScalarType::U8 => each::<u8>(bytes, out, f32::from),
        ScalarType::I8 => each::<i8>(bytes, out, f32::from),
        ScalarType::U16 => each::<u16>(bytes, out, f32::from),
        ScalarType::I16 => each::<i16>(bytes, out, f32::from),
        ScalarType::U32 => each::<u32>(bytes, out, |v| v as f32),
        ScalarType::I32 => each::<i32>(bytes, out, |v| v as f32),
        ScalarType::F32 => each::<f32>(bytes, out, |v| v),
        ScalarType::F64 => each::<f64>(bytes, out, |v| v as f32),
    }
}

impl<'a> ResampledVolume<'a> {
    /// A volume that `placed` brings from its millimetres to the grid's, of which values from `iso` on are inside; of a
    /// map of labels, only their mask is kept. `None` if the affine has no inverse.
    ///
    /// # Errors
    /// The volume cannot be read, or the scratch file not be written.
    pub(super) fn new(
        inner: &'a dyn VolumeSource,
        placed: &Affine,
        place: &LatticeGrid,
        (iso, is_map): (f64, bool),
        folder: &Path,
        progress: &dyn Progress,
    ) -> Result<Option<Self>> {
        let own = inner.info();
        let bound = (iso - own.rescale.intercept) / own.rescale.slope;
        let Some(back) = placed.after(&own.affine).inverse() else { return Ok(None) };
        let sides = own.dims.to_array();
        let bricks = sides.map(|n| n.div_ceil(CELLS));
        let scratch = |cause| SourceError::from(SourceFault::Scratch { path: folder.to_path_buf(), cause });
        let mut resampled = Self {
            inner,
            info: VolumeInfo {
                dims: place.dims,
                scalar: ScalarType::F32,
                affine: place.affine,
                spacing_mm: place.spacing_mm,
                ..own.clone()
            },
            to_samples: back.after(&place.affine),
            sides,
            bricks,
            rises: own.rescale.slope > 0.0,
            bound,
            beyond: 0.0,
            shift: 0.0,
            has_nan: false,
            file: unnamed(folder).map_err(scratch)?.into(),
            folder: folder.to_path_buf(),
            caches: Mutex::new(Vec::new()),
        };
        let found = resampled.lay(is_map, progress)?;
        let [low, high] = found.ends.map(f64::from);
        let (outermost, outwards) = if resampled.rises { (low, -1.0) } else { (high, 1.0) };
        let is_outside = resampled.depth(outermost) < 0.0;
        if found.is_two_valued && bound.is_finite() && low <= high {
            let surface = if is_outside { f64::midpoint(low, high) } else { outermost + outwards };
            resampled.shift = bound - surface;
        }
        // A value outside, no steeper than at an edge where the volume was cut.
        let edge = bound + outwards * (1.0 + bound.abs() * 1e-6);
        let outermost = outermost + resampled.shift;
        resampled.beyond = (if resampled.rises { outermost.min(edge) } else { outermost.max(edge) }) as f32;
        resampled.has_nan = found.has_nan;
        Ok(Some(resampled))
    }

    /// Depth of a sample inside.
    fn depth(&self, sample: f64) -> f64 {
        if self.rises { sample - self.bound } else { self.bound - sample }
    }

    /// Lays the bricks; of a map of labels 1 for those inside, and 0.
    fn lay(&self, is_map: bool, progress: &dyn Progress) -> Result<Found> {
        let mut found = Found::new();
        let scalar = self.inner.info().scalar;
        let [nx, ny, nz] = self.sides;
        let [bx, by, bz] = self.bricks;
        let width = (CELLS * LAID + 1) as usize;
        let mut slab = vec![0.0_f32; SAMPLES * SAMPLES * width];
        let mut bytes = vec![0_u8; SAMPLES * width * scalar.bytes()];
        let mut laid = vec![0.0_f32; LAID as usize * BRICK];
        progress.stage("bricks", bz.into());
        for k in 0..bz {
            for j in 0..by {
                for first in (0..bx).step_by(LAID as usize) {
                    let count = LAID.min(bx - first);
                    let cols = first * CELLS..((first + count) * CELLS + 1).min(nx);
                    let rows = j * CELLS..((j + 1) * CELLS + 1).min(ny);
                    for (z, plane) in (k * CELLS..).zip(slab.chunks_exact_mut(SAMPLES * width)) {
                        // Beyond the last sample weights are 0.
                        if z >= nz {
                            break;
                        }
                        let bytes = &mut bytes[..rows.len() * cols.len() * scalar.bytes()];
                        self.inner.read_rows(z, rows.clone(), cols.clone(), bytes)?;
                        let row_bytes = cols.len() * scalar.bytes();
                        for (row, out) in bytes.chunks_exact(row_bytes).zip(plane.chunks_exact_mut(width)) {
                            let out = &mut out[..cols.len()];
                            singles(scalar, row, out);
                            if is_map {
                                let is_inside = |v: f32| self.depth(f64::from(v)) >= 0.0;
                                out.iter_mut().for_each(|v| *v = f32::from(u8::from(is_inside(*v))));
                            }
                            found.add(out);
                        }
                    }
                    for (at, brick) in laid.chunks_exact_mut(BRICK).take(count as usize).enumerate() {
                        for (row, out) in brick.chunks_exact_mut(SAMPLES).enumerate() {
                            let from = row * width + at * CELLS as usize;
                            out.copy_from_slice(&slab[from..from + SAMPLES]);
                        }
                    }
                    let at = self.number([first, j, k]) * (BRICK * size_of::<f32>()) as u64;
                    let laid = bytemuck::cast_slice(&laid[..count as usize * BRICK]);
                    let scratch =
                        |cause| SourceError::from(SourceFault::Scratch { path: self.folder.clone(), cause });
                    self.file.write_all_at(laid, at).map_err(scratch)?;
                }
            }
            progress.step(1)?;
        }
        Ok(found)
    }

    fn number(&self, [i, j, k]: [u32; 3]) -> u64 {
        let [bx, by, _] = self.bricks.map(u64::from);
        (u64::from(k) * by + u64::from(j)) * bx + u64::from(i)
    }

    fn brick<'c>(&self, number: u64, cache: &'c mut Cache) -> Result<&'c [f32]> {
        // Neighbours along any axis fall into different slots, nearly always.
        let slot = (number.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40) as usize % SLOTS;
        cache.get(slot, number, |samples| {
            let at = number * (BRICK * size_of::<f32>()) as u64;
            self.file
                .read_exact_at(bytemuck::cast_slice_mut(samples), at)
                .map_err(|cause| SourceError::from(SourceFault::Scratch { path: self.folder.clone(), cause }))
        })
    }

    /// The value at a voxel's middle.
    fn value(&self, voxel: [u32; 3], cache: &mut Cache) -> Result<f32> {
        let place = self.to_samples.apply(voxel.map(f64::from));
        let (mut brick, mut first, mut parts) = ([0; 3], [0; 3], [0; 3]);
        for axis in 0..3 {
            let at = (place[axis] * PARTS as f64 + 0.5).floor();
            if !(at >= 0.0 && at <= (i64::from(self.sides[axis] - 1) * PARTS) as f64) {
                return Ok(self.beyond);
            }
            let at = at as i64;
            let sample = (at / PARTS) as u32;
            (brick[axis], first[axis], parts[axis]) = (sample / CELLS, (sample % CELLS) as usize, at % PARTS);
        }
        let samples = self.brick(self.number(brick), cache)?;
        let (mut sum, mut known) = (0.0, 0);
        for corner in 0..8_usize {
            let (mut weight, mut at) = (1_i64, 0);
            for axis in (0..3).rev() {
                let far = corner >> axis & 1;
                weight *= if far == 1 { parts[axis] } else { PARTS - parts[axis] };
                at = at * SAMPLES + first[axis] + far;
            }
            // A sample without weight need not be a number, nor exist.
            if weight != 0 && !samples[at].is_nan() {
                sum += weight as f64 * f64::from(samples[at]);
                known += weight;
            }
        }
        let all = PARTS * PARTS * PARTS;
        match known {
            0 => Ok(self.beyond),
            _ if known == all => Ok((sum / all as f64 + self.shift) as f32),
            _ => Ok(self.among_unknown(sum / known as f64 + self.shift, known as f64 / all as f64)),
        }
    }

    /// The value among samples that are not numbers, by the mean of the others and their part of the weight.
    fn among_unknown(&self, mean: f64, known: f64) -> f32 {
        let depth = self.depth(mean);
        if depth < 0.0 {
            return mean as f32;
        }
        let depth = depth.max(self.bound.abs() * 1e-6) * (2.0 * known - 1.0);
        (if self.rises { self.bound + depth } else { self.bound - depth }) as f32
    }
}

/// Facts about samples.
struct Found {
    /// The lowest and the highest finite one.
    ends: [f32; 2],
    /// True if there are no more than two finite ones.
    is_two_valued: bool,
    has_nan: bool,
    /// The first two of different value.
    values: [Option<f32>; 2],
}

impl Found {
    fn new() -> Self {
        Self {
            ends: [f32::INFINITY, f32::NEG_INFINITY],
            is_two_valued: true,
            has_nan: false,
            values: [None; 2],
        }
    }

    fn add(&mut self, samples: &[f32]) {
        let [low, high] = &mut self.ends;
        for v in samples.iter().filter(|v| v.is_finite()) {
            (*low, *high) = (low.min(*v), high.max(*v));
        }
        self.has_nan |= samples.iter().any(|v| v.is_nan());
        if !self.is_two_valued {
            return;
        }
        for v in samples.iter().filter(|v| v.is_finite()) {
            let known = self.values.iter_mut().find(|known| known.is_none_or(|known| known == *v));
            match known {
                Some(known) => *known = Some(*v),
                None => self.is_two_valued = false,
            }
        }
    }
}

impl VolumeSource for ResampledVolume<'_> {
    fn info(&self) -> &VolumeInfo {
        &self.info
    }

    fn modality(&self) -> Option<&str> {
        self.inner.modality()
    }

    fn for_each_file(&self, each: &mut dyn FnMut(&Path)) {
        self.inner.for_each_file(each);
    }

    fn check_unchanged(&self) -> Result {
        self.inner.check_unchanged()
    }

    fn read_rows(&self, z: u32, rows: Range<u32>, cols: Range<u32>, out: &mut [u8]) -> Result {
        let free = self.caches.lock().unwrap_or_else(PoisonError::into_inner).pop();
        let mut cache = free.unwrap_or_else(|| Cache::new(SLOTS, BRICK, 0.0));
        let width = cols.len();
        for (y, row) in rows.zip(out.chunks_exact_mut(width * size_of::<f32>())) {
            for (x, out) in cols.clone().zip(row.chunks_exact_mut(size_of::<f32>())) {
                out.copy_from_slice(bytemuck::bytes_of(&self.value([x, y, z], &mut cache)?));
            }
        }
        self.caches.lock().unwrap_or_else(PoisonError::into_inner).push(cache);
        Ok(())
    }

    fn resident_bytes(&self) -> u64 {
        CACHE_BYTES
    }
}
