//! Sequential inputs unrolled: samples in the machine's order in an anonymous scratch file, read by position.
//!
//! The scratch file is as long as the volume is in memory; it is not compressed, because the builder reads
//! it in tiles, at the speed of the page cache, which does not count as the process's memory.

use std::io;
use std::ops::Range;
use std::path::{Path, PathBuf};

use super::{Result, ScalarType, SourceError};
use crate::geom::Dims;
use crate::platform::PositionalFile;
use crate::scratch::unnamed_for;
use crate::volume::{SourceFault, read_block};

/// Samples of a volume in a scratch file: x fastest, then y, then z, native byte order.
pub(crate) struct Spool {
    file: PositionalFile,
    folder: PathBuf,
    dims: Dims,
    scalar: ScalarType,
}

impl Spool {
    /// An empty spool (all zero) for a volume of `dims`, in `folder`.
    ///
    /// # Errors
    /// [`SourceError`] where the folder has no room for it.
    pub(crate) fn create(folder: &Path, dims: Dims, scalar: ScalarType) -> Result<Self> {
        let bytes = dims.voxels() * scalar.bytes() as u64;
        let failed = |cause| SourceError::from(SourceFault::Scratch { path: folder.to_path_buf(), cause });
        let file = unnamed_for(folder, bytes).map_err(failed)?;
        file.set_len(bytes).map_err(failed)?;
        Ok(Self { file: file.into(), folder: folder.to_path_buf(), dims, scalar })
    }

    /// Bytes of the whole volume.
    pub(crate) fn bytes(&self) -> u64 {
        self.dims.voxels() * self.scalar.bytes() as u64
    }

    /// Offset of row `y` of slice `z`.
    pub(crate) fn offset(&self, y: u32, z: u32) -> u64 {
        let row = u64::from(self.dims.nx()) * self.scalar.bytes() as u64;
        (u64::from(z) * u64::from(self.dims.ny()) + u64::from(y)) * row
    }

    /// Writes samples (native order) at a byte offset.
    ///
    /// # Errors
    /// [`SourceError`].
    pub(crate) fn write(&self, samples: &[u8], offset: u64) -> Result {
        self.file
            .write_all_at(samples, offset)
            .map_err(|cause| SourceError::from(SourceFault::Scratch { path: self.folder.clone(), cause }))
    }

    /// Like [`super::VolumeSource::read_rows`], for the stored samples; the request has been checked.
    pub(crate) fn read_rows(
        &self,
        z: u32,
        rows: &Range<u32>,
        cols: &Range<u32>,
        out: &mut [u8],
    ) -> io::Result<()> {
        read_block(&self.file, self.offset(0, z), self.dims.nx(), self.scalar.bytes(), rows, cols, out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_come_back_from_where_they_were_written() {
        let folder = tempfile::tempdir().unwrap();
        let dims = Dims::new(3, 2, 2).unwrap();
        let spool = Spool::create(folder.path(), dims, ScalarType::U16).unwrap();
        assert_eq!(spool.bytes(), 24);
        let row: Vec<u8> = (1..=6).collect();
        spool.write(&row, spool.offset(1, 1)).unwrap();
        let mut out = [0; 8];
        spool.read_rows(1, &(0..2), &(1..3), &mut out).unwrap();
        assert_eq!(out, [0, 0, 0, 0, 3, 4, 5, 6]);
        let refused = Spool::create(Path::new("missing/folder"), dims, ScalarType::U8).err().unwrap();
        assert!(matches!(refused.fault(), SourceFault::Scratch { .. }), "{refused}");
    }
}
