//! A volume that is in memory already.

use std::ops::Range;

use super::view::Block;
use super::{Result, Scalar, VolumeInfo, VolumeSource};
use crate::geom::{Affine, Dims};

/// Samples in memory, x fastest, then y, then z.
///
/// For volumes that fit into memory. Borrowed samples are a [`VolumeView`](super::VolumeView), samples that come slice
/// by slice [`Slices`](super::Slices). For others implement [`VolumeSource`], and for shapes without samples
/// [`Solid`](crate::builder::Solid).
///
/// ```
/// use infobyte::{Dims, VolumeSource, Voxels};
///
/// let ramp = Voxels::from_fn(Dims::new(4, 3, 2).unwrap(), |[x, y, z]| (x + 10 * y + 100 * z) as u16);
/// assert_eq!(ramp.samples()[4 * 3 + 1], 101);
/// assert_eq!(ramp.info().spacing_mm, [1.0; 3]);
/// ```
#[derive(Clone, Debug)]
pub struct Voxels<T> {
    info: VolumeInfo,
    samples: Vec<T>,
}

impl<T: Scalar> Voxels<T> {
    /// A volume of these samples, with voxels of 1 mm and the middle of the first one at the origin; `None` unless
    /// there is one sample for each voxel.
    pub fn new(dims: Dims, samples: Vec<T>) -> Option<Self> {
        if samples.len() as u64 != dims.voxels() {
            return None;
        }
        Some(Self { info: VolumeInfo::in_memory(dims, T::TYPE), samples })
    }

    /// Computes every sample from its voxel index (x, y, z). Cost: one call a voxel.
    pub fn from_fn(dims: Dims, mut sample: impl FnMut([u32; 3]) -> T) -> Self {
        let mut samples = Vec::new();
        for z in 0..dims.nz() {
            for y in 0..dims.ny() {
                samples.extend((0..dims.nx()).map(|x| sample([x, y, z])));
            }
        }
        Self { info: VolumeInfo::in_memory(dims, T::TYPE), samples }
    }

    /// Moves the voxels to another place: `affine` maps voxel indices to LPS mm.
    #[must_use]
    pub fn placed(mut self, affine: Affine) -> Self {
        self.info.place(affine);
        self
    }

    /// All samples, x fastest, then y, then z.
    pub fn samples(&self) -> &[T] {
        &self.samples
    }
}

impl<T: Scalar> VolumeSource for Voxels<T> {
    fn info(&self) -> &VolumeInfo {
        &self.info
    }

    fn read_rows(&self, z: u32, rows: Range<u32>, cols: Range<u32>, out: &mut [u8]) -> Result {
        let pitch = cols.len() * size_of::<T>();
        self.read_pitched(z, rows, cols, pitch.max(1), out)
    }

    fn read_pitched(
        &self,
        z: u32,
        rows: Range<u32>,
        cols: Range<u32>,
        pitch: usize,
        out: &mut [u8],
    ) -> Result {
        match Block::dense(self.info.dims, &self.samples) {
            Some(samples) => samples.read(&self.info, z, (rows, cols), pitch, out),
            None => unreachable!("there is one sample for each voxel"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_come_back_as_they_were_given() {
        let dims = Dims::new(5, 4, 3).unwrap();
        let voxels = Voxels::from_fn(dims, |[x, y, z]| f32::from(u8::try_from(x + 5 * y + 20 * z).unwrap()));
        let mut out = vec![0_u8; 2 * 3 * 4];
        voxels.read_rows(2, 1..3, 1..4, &mut out).unwrap();
        let got: Vec<f32> = out.chunks_exact(4).map(bytemuck::pod_read_unaligned).collect();
        assert_eq!(got, [46.0, 47.0, 48.0, 51.0, 52.0, 53.0]);
        assert!(voxels.read_rows(3, 0..1, 0..5, &mut [0; 20]).is_err());
        assert!(Voxels::new(dims, vec![0_u8; 59]).is_none());
    }
}
