//! A volume whose slices come one after the other.

use std::io;
use std::ops::Range;
use std::sync::{Mutex, PoisonError};

use super::{
    Preparation, Rescale, Result, Scalar, SourceError, Spool, VolumeInfo, VolumeSource, Workspace,
    check_request,
};
use crate::geom::{Affine, Dims};
use crate::volume::{SourceFault, not_unrolled};

/// Function that makes the samples of slice z.
type Fill<'a, T> = dyn FnMut(u32, &mut [T]) -> io::Result<()> + Send + 'a;

/// Slices that a function makes in order, from front to back: a decoder, an instrument, a simulation, an iterator.
///
/// The builder reads columns of a volume, so that the slices are first written to an anonymous scratch file, as long as
/// the volume; [`clean_and_build`](crate::clean_and_build) does so. Memory: one slice. Cost: reading a volume back
/// took a build 4 times as long as a file of samples that was read in place.
///
/// ```
/// use infobyte::{BuildOptions, CleanOptions, Dims, Slices, Threshold, progress::Silent};
///
/// # fn main() -> Result<(), infobyte::Error> {
/// # let folder = tempfile::tempdir().expect("a temporary folder");
/// # let path = folder.path().join("wave.oct");
/// let mut frames = (0..16_u16).map(|z| vec![z * z; 20 * 20]);
/// let mut volume = Slices::new(Dims::new(20, 20, 16).unwrap(), move |_, slice| {
///     let frame = frames.next().ok_or(std::io::ErrorKind::UnexpectedEof)?;
///     slice.copy_from_slice(&frame);
///     Ok(())
/// });
/// let options = BuildOptions { threshold: Threshold::Iso(100.0), ..Default::default() };
/// infobyte::clean_and_build(&mut volume, &CleanOptions::default(), &options, &path, &Silent)?;
/// # Ok(())
/// # }
/// ```
pub struct Slices<'a, T> {
    info: VolumeInfo,
    /// Source of the slices, until it has been asked.
    fill: Option<Mutex<Box<Fill<'a, T>>>>,
    spool: Option<Spool>,
}

impl<'a, T: Scalar> Slices<'a, T> {
    /// Voxels of 1 mm, with the middle of the first one at the origin. `fill` is called once for each z, from 0 on, and
    /// writes every sample of the slice, x fastest, then y; its error ends the build.
    pub fn new(dims: Dims, fill: impl FnMut(u32, &mut [T]) -> io::Result<()> + Send + 'a) -> Self {
        let info = VolumeInfo::in_memory(dims, T::TYPE);
        Self { info, fill: Some(Mutex::new(Box::new(fill))), spool: None }
    }

    /// Moves the voxels to another place: `affine` maps voxel indices to LPS mm.
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

    fn slice_samples(&self) -> usize {
        let [nx, ny, _] = self.info.dims.to_array();
        nx as usize * ny as usize
    }

    fn failed(&self, z: u32, cause: io::Error) -> SourceError {
        SourceError::from(SourceFault::ReadFailed {
            path: (&self.info.description.name).into(),
            slice: z,
            cause,
        })
    }
}

impl<T: Scalar> VolumeSource for Slices<'_, T> {
    fn info(&self) -> &VolumeInfo {
        &self.info
    }

    fn preparation(&self) -> Preparation {
        if self.fill.is_none() {
            return Preparation::default();
        }
        Preparation {
            scratch_bytes: self.info.dims.voxels() * size_of::<T>() as u64,
            memory_bytes: (self.slice_samples() * size_of::<T>()) as u64,
            on_demand: false,
        }
    }

    fn prepare(&mut self, workspace: &Workspace<'_>) -> Result {
        let name = || (&self.info.description.name).into();
        let _memory = workspace.reserve(self.preparation().memory_bytes, name)?;
        let Some(fill) = self.fill.take() else { return Ok(()) };
        let mut fill = fill.into_inner().unwrap_or_else(PoisonError::into_inner);
        let spool = Spool::create(workspace.scratch, self.info.dims, self.info.scalar)?;
        workspace.progress.stage("unroll", spool.bytes());
        let mut slice = vec![T::zeroed(); self.slice_samples()];
        for z in 0..self.info.dims.nz() {
            fill(z, &mut slice).map_err(|cause| self.failed(z, cause))?;
            spool.write(bytemuck::cast_slice(&slice), spool.offset(0, z))?;
            workspace.progress.step(size_of_val(slice.as_slice()) as u64)?;
        }
        self.spool = Some(spool);
        Ok(())
    }

    fn read_rows(&self, z: u32, rows: Range<u32>, cols: Range<u32>, out: &mut [u8]) -> Result {
        check_request(&self.info, z, &rows, &cols, out.len())
            .and_then(|()| match &self.spool {
                Some(spool) => spool.read_rows(z, &rows, &cols, out),
                None => Err(not_unrolled()),
            })
            .map_err(|cause| self.failed(z, cause))
    }
}
