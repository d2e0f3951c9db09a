//! Samples that lie linearly in one or several files: read where they lie, or unrolled first.
//!
//! | part | content |
//! |---|---|
//! | [`Samples`] | types of samples, as stored and as delivered |
//! | [`DirectSamples`] | slices at known offsets of files, read by position straight into the caller's buffer |
//! | [`Unroll`] | a recipe that writes a volume once from front to back into a [`Spool`] |
//! | [`Linear`] | the recipe of gzip, zlib, bzip2 and text: a stream with one slice after another |
//! | [`StoredVolume`] | a volume of either kind |

mod direct;
mod inflate;
mod linear;
mod open;
mod samples;
mod text;

use std::ops::Range;
use std::path::{Path, PathBuf};

pub(super) use direct::{DirectSamples, SliceOffsets};
use inflate::INPUT_BYTES;
pub(super) use inflate::{Section, section};
pub(super) use linear::{Encoding, Linear};
pub(super) use open::{Skip, StoredLayout, regular};
pub(super) use samples::Samples;

use super::files::FileList;
use crate::progress::Progress;
use crate::volume::{
    Note, Preparation, Result, SourceError, SourceFault, Spool, VolumeInfo, VolumeSource, Workspace,
    check_request, not_unrolled, row_by_row,
};

/// Writes a volume that can only be read from front to back.
pub(super) trait Unroll: Send + Sync {
    /// Bytes of memory that it holds while it works, at least.
    fn memory_bytes(&self) -> u64;

    /// The files that are read.
    fn files(&self) -> &FileList;

    /// The file to name where no single one is at fault.
    fn path(&self) -> PathBuf {
        self.files().path(0)
    }

    /// Writes every sample of the volume into `target`; returns notes on its findings.
    fn unroll(&self, info: &VolumeInfo, target: &Target<'_>) -> Result<Vec<Note>>;
}

/// Target of a recipe.
pub(super) struct Target<'a> {
    spool: &'a Spool,
    progress: &'a dyn Progress,
}

impl Target<'_> {
    /// Writes samples (native order, as delivered) at a byte offset of the volume.
    pub(super) fn write(&self, samples: &[u8], offset: u64) -> Result {
        self.spool.write(samples, offset)?;
        Ok(self.progress.step(samples.len() as u64)?)
    }

    /// Offset of row `y` of slice `z`.
    pub(super) fn offset(&self, y: u32, z: u32) -> u64 {
        self.spool.offset(y, z)
    }
}

/// A volume whose samples lie linearly in files.
///
/// Holds the names of its files, 16 bytes a slice where offsets are uneven, and no voxels.
pub(super) struct StoredVolume {
    info: VolumeInfo,
    data: Data,
}

/// The two ways to the samples.
enum Data {
    Direct(DirectSamples),
    Sequential { recipe: Box<dyn Unroll>, spool: Option<Spool> },
}

impl StoredVolume {
    /// A volume that is read by position.
    pub(super) fn direct(info: VolumeInfo, samples: DirectSamples) -> Self {
        Self { info, data: Data::Direct(samples) }
    }

    /// A volume that is unrolled first.
    pub(super) fn sequential(info: VolumeInfo, recipe: Box<dyn Unroll>) -> Self {
        Self { info, data: Data::Sequential { recipe, spool: None } }
    }
}

impl VolumeSource for StoredVolume {
    fn info(&self) -> &VolumeInfo {
        &self.info
    }

    fn for_each_file(&self, each: &mut dyn FnMut(&Path)) {
        match &self.data {
            Data::Direct(samples) => samples.files.list().for_each(each),
            Data::Sequential { recipe, .. } => recipe.files().for_each(each),
        }
    }

    fn preparation(&self) -> Preparation {
        match &self.data {
            Data::Sequential { recipe, spool: None } => Preparation {
                scratch_bytes: self.info.dims.voxels() * self.info.scalar.bytes() as u64,
                memory_bytes: recipe.memory_bytes(),
                on_demand: false,
            },
            _ => Preparation::default(),
        }
    }

    fn prepare(&mut self, workspace: &Workspace<'_>) -> Result {
        let needed_bytes = self.preparation().memory_bytes;
        let Data::Sequential { recipe, spool } = &mut self.data else { return Ok(()) };
        if spool.is_some() {
            return Ok(());
        }
        let _memory = workspace.reserve(needed_bytes, || recipe.path())?;
        let made = Spool::create(workspace.scratch, self.info.dims, self.info.scalar)?;
        workspace.progress.stage("unroll", made.bytes());
        let target = Target { spool: &made, progress: workspace.progress };
        let notes = recipe.unroll(&self.info, &target)?;
        self.info.notes.extend(notes);
        *spool = Some(made);
        Ok(())
    }

    fn read_rows(&self, z: u32, rows: Range<u32>, cols: Range<u32>, out: &mut [u8]) -> Result {
        match &self.data {
            Data::Direct(samples) => samples.read_rows(&self.info, z, rows, cols, out),
            Data::Sequential { recipe, spool } => check_request(&self.info, z, &rows, &cols, out.len())
                .and_then(|()| match spool {
                    Some(spool) => spool.read_rows(z, &rows, &cols, out),
                    None => Err(not_unrolled()),
                })
                .map_err(|cause| {
                    SourceError::from(SourceFault::ReadFailed { path: recipe.path(), slice: z, cause })
                }),
        }
    }

    fn read_pitched(
        &self,
        z: u32,
        rows: Range<u32>,
        cols: Range<u32>,
        pitch: usize,
        out: &mut [u8],
    ) -> Result {
        match &self.data {
            Data::Direct(samples) => samples.read_pitched(&self.info, z, rows, cols, pitch, out),
            Data::Sequential { .. } => row_by_row(self, z, rows, cols, pitch, out),
        }
    }
}

#[cfg(test)]
mod tests;
