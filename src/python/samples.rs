//! Samples of an array that lie in a file.

use std::io;
use std::ops::Range;
use std::path::Path;

use crate::geom::{Affine, Dims};
use crate::platform::PositionalFile;
use crate::volume::{
    self, Rescale, ScalarType, SourceError, SourceFault, VolumeInfo, VolumeSource, check_request, read_block,
};

/// Contiguous samples in a file, x fastest, in the machine's byte order: read by position, as pages of a mapping would
/// count as memory of the process.
pub(super) struct StoredSamples {
    info: VolumeInfo,
    file: PositionalFile,
    offset: u64,
}

impl StoredSamples {
    pub(super) fn open(path: &Path, offset: u64, dims: Dims, scalar: ScalarType) -> io::Result<Self> {
        let file = PositionalFile::open(path)?;
        let info = VolumeInfo::in_memory(dims, scalar);
        let end = offset.checked_add(info.description.bytes);
        if end.is_none_or(|end| file.metadata().is_ok_and(|meta| meta.len() < end)) {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        Ok(Self { info, file, offset })
    }

    pub(super) fn placed(mut self, affine: Affine) -> Self {
        self.info.place(affine);
        self
    }

    pub(super) fn rescaled(mut self, rescale: Rescale) -> Self {
        self.info.rescale = rescale;
        self
    }
}

impl VolumeSource for StoredSamples {
    fn info(&self) -> &VolumeInfo {
        &self.info
    }

    fn read_rows(&self, z: u32, rows: Range<u32>, cols: Range<u32>, out: &mut [u8]) -> volume::Result {
        let [nx, ny, _] = self.info.dims.to_array();
        let size = self.info.scalar.bytes();
        let slice = u64::from(nx) * u64::from(ny) * size as u64;
        let base = self.offset + u64::from(z) * slice;
        check_request(&self.info, z, &rows, &cols, out.len())
            .and_then(|()| read_block(&self.file, base, nx, size, &rows, &cols, out))
            .map_err(|cause| {
                let path = (&self.info.description.name).into();
                SourceError::from(SourceFault::ReadFailed { path, slice: z, cause })
            })
    }
}
