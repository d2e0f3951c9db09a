//! A volume at half or a quarter of its resolution: the mean of every block of voxels.

use std::ops::Range;
use std::path::PathBuf;

use super::wrapper::owns_source_and_info;
use super::{Note, Result, Scalar, ScalarType, Treatment, VolumeInfo, VolumeSource, Wrapper};
use crate::fault::usage;
use crate::geom::Dims;
use crate::text::Short;
use crate::text::names::DOWNSAMPLE;

/// Samples of the original that are read at a time; 32 KiB of doubles.
const PIECE: usize = 4096;

/// Ratio of the longest to the shortest spacing from which slices are thick.
const THICK: f64 = 2.0;

/// Means over blocks of 2^3 or 4^3 voxels.
///
/// **Accuracy.** Means are not rounded to the type of the samples: types of 8 and 16 bits and `f32` give `f32`,
/// wider ones `f64`. Sums are taken in `f64` in the order z, y, x, so the mean of whole blocks of integers is
/// exact, and any other rounded once. At the high border a block holds the voxels that there are. NaN is left
/// out; a block of more NaN than numbers is NaN.
///
/// **Geometry.** A voxel's centre is its whole block's, and the spacing grows by the factor: the box of the volume
/// stays in place (except for blocks that reach beyond it).
///
/// **Cost.** Computed whenever rows are read, so that no disk is needed: every pass over this volume reads all of
/// the original. Memory: 64 KiB a reading thread.
pub struct Downsample<'a> {
    source: Box<dyn VolumeSource + 'a>,
    info: VolumeInfo,
    factor: u32,
    /// True if samples above 0 count as 1: labels, whose numbers have no mean.
    is_mask: bool,
}

impl<'a> Downsample<'a> {
    /// Blocks of `factor`^3 voxels; `factor` is 2 or 4.
    ///
    /// # Errors
    /// [`SourceError`](super::SourceError) for other factors.
    pub fn new(source: Box<dyn VolumeSource + 'a>, factor: u32) -> Result<Self> {
        let mut info = source.info().clone();
        let sides = info.dims.to_array().map(|n| n.div_ceil(factor.max(1)));
        let dims = Dims::new(sides[0], sides[1], sides[2]);
        let (Some(dims), 2 | 4) = (dims, factor) else {
            let path = PathBuf::from(&info.description.name);
            return Err(usage!("a volume cannot be made {factor} times smaller; choose {DOWNSAMPLE} 2 or 4")
                .at(path)
                .into());
        };
        let wide = f64::from(factor);
        let origin = info.affine.apply([0.5 * (wide - 1.0); 3]);
        for (row, at) in info.affine.rows.iter_mut().zip(origin) {
            row.iter_mut().take(3).for_each(|step| *step *= wide);
            row[3] = at;
        }
        info.spacing_mm = info.spacing_mm.map(|mm| mm * wide);
        let [x, y, z] = info.spacing_mm;
        if x.max(y).max(z) >= THICK * x.min(y).min(z) {
            let [x, y, z] = info.spacing_mm.map(Short);
            info.notes.push(Note::new(format!(
                "{DOWNSAMPLE} {factor} averages along every axis, thick slices among them: voxels of {x} x {y} x {z} mm"
            )));
        }
        info.dims = dims;
        info.description.treatments.push(Treatment::Downsample(factor));
        info.scalar = match info.scalar {
            ScalarType::U32 | ScalarType::I32 | ScalarType::F64 => ScalarType::F64,
            _ => ScalarType::F32,
        };
        Ok(Self { source, info, factor, is_mask: false })
    }

    /// One row of means.
    fn row<T: Scalar>(&self, z: u32, y: u32, cols: &Range<u32>, out: &mut [u8]) -> Result {
        let [nx, ny, nz] = self.source.info().dims.to_array();
        let block = |i: u32, n: u32| (i * self.factor).min(n)..((i + 1) * self.factor).min(n);
        let (rows, slices) = (block(y, ny), block(z, nz));
        let factor = self.factor as usize;
        let mut samples = [T::zeroed(); PIECE];
        let mut sums = [(0.0, 0_u32); PIECE / 16];
        let out_bytes = self.info.scalar.bytes();
        // Blocks of 4 x 4 samples, as wide as they may be, fit a piece.
        let step = PIECE / 16;
        for (first, out) in cols.clone().step_by(step).zip(out.chunks_mut(step * out_bytes)) {
            let count = out.len() / out_bytes;
            let last = first + u32::try_from(count).unwrap_or(0) - 1;
            let columns = block(first, nx).start..block(last, nx).end;
            let width = columns.len();
            let sums = &mut sums[..count];
            sums.fill((0.0, 0));
            for slice in slices.clone() {
                let samples = &mut samples[..rows.len() * width];
                let bytes = bytemuck::cast_slice_mut(samples);
                self.source.read_rows(slice, rows.clone(), columns.clone(), bytes)?;
                for row in samples.chunks_exact(width) {
                    for (sum, block) in sums.iter_mut().zip(row.chunks(factor)) {
                        for v in block.iter().map(|v| v.to_f64()).filter(|v| !v.is_nan()) {
                            let v = if self.is_mask { f64::from(u8::from(v > 0.0)) } else { v };
                            *sum = (sum.0 + v, sum.1 + 1);
                        }
                    }
                }
            }
            for ((i, out), (sum, count)) in (first..).zip(out.chunks_exact_mut(out_bytes)).zip(sums) {
                let all = rows.len() * slices.len() * block(i, nx).len();
                let mean = if 2 * *count as usize >= all { *sum / f64::from(*count) } else { f64::NAN };
                if self.info.scalar == ScalarType::F64 {
                    out.copy_from_slice(bytemuck::bytes_of(&mean));
                } else {
                    #[expect(clippy::cast_possible_truncation, reason = "rounded once, to single")]
                    out.copy_from_slice(bytemuck::bytes_of(&(mean as f32)));
                }
            }
        }
        Ok(())
    }
}

impl Wrapper for Downsample<'_> {
    owns_source_and_info!();

    fn own_bytes(&self) -> u64 {
        64 << 10
    }

    fn own_average_mask(&mut self, labels: &dyn Fn(&dyn VolumeSource) -> Option<usize>) {
        if self.is_mask {
            return;
        }
        if let Some(count) = labels(&*self.source) {
            self.is_mask = true;
            let treatments = &mut self.info.description.treatments;
            treatments.insert(treatments.len().saturating_sub(1), Treatment::Mask(count));
        }
    }

    fn own_rows(&self, z: u32, rows: Range<u32>, cols: Range<u32>, out: &mut [u8]) -> Result {
        let row_bytes = cols.len() * self.info.scalar.bytes();
        if row_bytes == 0 {
            return Ok(());
        }
        for (y, out) in rows.zip(out.chunks_exact_mut(row_bytes)) {
            match self.source.info().scalar {
                ScalarType::U8 => self.row::<u8>(z, y, &cols, out),
                ScalarType::I8 => self.row::<i8>(z, y, &cols, out),
                ScalarType::U16 => self.row::<u16>(z, y, &cols, out),
                ScalarType::I16 => self.row::<i16>(z, y, &cols, out),
                ScalarType::U32 => self.row::<u32>(z, y, &cols, out),
                ScalarType::I32 => self.row::<i32>(z, y, &cols, out),
                ScalarType::F32 => self.row::<f32>(z, y, &cols, out),
                ScalarType::F64 => self.row::<f64>(z, y, &cols, out),
            }?;
        }
        Ok(())
    }
}
