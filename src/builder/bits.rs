//! One bit per voxel in an unnamed scratch file, rows padded to whole words.

use std::io;
use std::path::{Path, PathBuf};

use super::error::BuildError;
use crate::builder::BuildFault;
use crate::geom::Dims;
use crate::platform::PositionalFile;
use crate::scratch::unnamed_for;

/// Occupancy of a volume: bit x of a row is word x / 64, bit x % 64; bits beyond the row are 0.
pub(crate) struct BitVolume {
    file: PositionalFile,
    folder: PathBuf,
    dims: Dims,
    pub(crate) row_words: usize,
}

impl BitVolume {
    pub(crate) fn create(folder: &Path, dims: Dims) -> Result<Self, BuildError> {
        let row_words = dims.nx().div_ceil(64) as usize;
        let bytes = row_words as u64 * 8 * u64::from(dims.ny()) * u64::from(dims.nz());
        let failed = |cause| scratch_error(folder, cause);
        let file = unnamed_for(folder, bytes).map_err(failed)?;
        file.set_len(bytes).map_err(failed)?;
        Ok(Self { file: file.into(), folder: folder.to_path_buf(), dims, row_words })
    }

    /// Opens the bits stored from the start of a file on.
    pub(crate) fn over(file: PositionalFile, folder: &Path, dims: Dims) -> Self {
        Self { file, folder: folder.to_path_buf(), dims, row_words: dims.nx().div_ceil(64) as usize }
    }

    /// Copies all bits of `other` to the slices from `first` on; slices of both must have the same size.
    ///
    /// # Errors
    /// A file fails.
    pub(crate) fn take(&self, other: &Self, first: u32) -> Result<(), BuildError> {
        const STEP: usize = 8 << 10;
        let mut words = vec![0; STEP.max(self.row_words) / self.row_words * self.row_words];
        let at_once = (words.len() / self.row_words) as u64;
        let mut row = 0;
        while row < other.rows() {
            let rows = at_once.min(other.rows() - row);
            let words = &mut words[..usize::try_from(rows).unwrap_or(0) * self.row_words];
            other.read(row, 0, words).map_err(|cause| other.failed(cause))?;
            self.write(self.row(0, first) + row, 0, words)?;
            row += rows;
        }
        Ok(())
    }

    pub(crate) fn dims(&self) -> Dims {
        self.dims
    }

    /// Folder of the unnamed file.
    pub(crate) fn folder(&self) -> &Path {
        &self.folder
    }

    /// Length of the file.
    pub(crate) fn bytes(&self) -> u64 {
        self.row_words as u64 * 8 * self.rows()
    }

    pub(crate) fn rows(&self) -> u64 {
        u64::from(self.dims.ny()) * u64::from(self.dims.nz())
    }

    /// Index of a row in the file.
    pub(crate) fn row(&self, y: u32, z: u32) -> u64 {
        u64::from(z) * u64::from(self.dims.ny()) + u64::from(y)
    }

    /// Reads `words` from word `first` of row `row` on; whole rows follow each other.
    pub(crate) fn read(&self, row: u64, first: usize, words: &mut [u64]) -> io::Result<()> {
        self.file.read_exact_at(bytemuck::cast_slice_mut(words), self.offset(row, first))
    }

    /// Like [`BitVolume::read`], into the bytes of the words.
    pub(crate) fn read_bytes(&self, row: u64, first: usize, bytes: &mut [u8]) -> io::Result<()> {
        self.file.read_exact_at(bytes, self.offset(row, first))
    }

    pub(crate) fn write(&self, row: u64, first: usize, words: &[u64]) -> Result<(), BuildError> {
        self.file
            .write_all_at(bytemuck::cast_slice(words), self.offset(row, first))
            .map_err(|cause| self.failed(cause))
    }

    fn offset(&self, row: u64, first: usize) -> u64 {
        (row * self.row_words as u64 + first as u64) * 8
    }

    /// The error for a failure of the file.
    pub(crate) fn failed(&self, cause: io::Error) -> BuildError {
        scratch_error(&self.folder, cause)
    }
}

pub(crate) fn scratch_error(folder: &Path, cause: io::Error) -> BuildError {
    BuildError::from(BuildFault::Scratch { path: folder.to_path_buf(), cause })
}
