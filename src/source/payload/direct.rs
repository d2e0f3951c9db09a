//! Slices at known offsets of files.

use std::io::{self, IoSliceMut};
use std::ops::Range;
use std::path::PathBuf;
use std::sync::Arc;

use super::Samples;
use crate::source::files::FileSet;
use crate::volume::{Endian, Result, SourceError, SourceFault, VolumeInfo, check_request, read_block};

/// Offsets of the slices of a volume.
#[derive(Clone, Debug)]
pub(in crate::source) enum SliceOffsets {
    /// Every file holds the same number of slices side by side.
    Even {
        /// Slices in one file; at least 1.
        slices_per_file: u64,
        /// Bytes before the first slice of each file.
        skip: u64,
        /// Slice of the first file that is slice 0 of the volume: volumes may follow each other.
        first_slice: u64,
    },
    /// File and offset of every slice.
    Each(Vec<(u32, u64)>),
}

/// A volume that is read by position, straight into the caller's buffer.
#[derive(Debug)]
pub(in crate::source) struct DirectSamples {
    pub(in crate::source) files: Arc<FileSet>,
    pub(in crate::source) offsets: SliceOffsets,
    pub(in crate::source) samples: Samples,
    pub(in crate::source) endian: Endian,
}

impl DirectSamples {
    /// File and offset of slice `z`; `None` where no file could have it.
    fn offset_of(&self, info: &VolumeInfo, z: u32) -> Option<(usize, u64)> {
        match &self.offsets {
            SliceOffsets::Even { slices_per_file, skip, first_slice } => {
                let slice = first_slice.checked_add(z.into())?;
                let area = u64::from(info.dims.nx()) * u64::from(info.dims.ny());
                let bytes = area * self.samples.bytes() as u64;
                let within = slice.checked_rem(*slices_per_file)?.checked_mul(bytes)?.checked_add(*skip)?;
                Some((usize::try_from(slice.checked_div(*slices_per_file)?).ok()?, within))
            }
            SliceOffsets::Each(offsets) => {
                let (file, offset) = offsets.get(usize::try_from(z).ok()?)?;
                Some((usize::try_from(*file).ok()?, *offset))
            }
        }
    }

    fn path(&self, info: &VolumeInfo, z: u32) -> PathBuf {
        self.files.list().path(self.offset_of(info, z).map_or(0, |(file, _)| file))
    }

    /// Like [`crate::volume::VolumeSource::read_rows`].
    pub(in crate::source) fn read_rows(
        &self,
        info: &VolumeInfo,
        z: u32,
        rows: Range<u32>,
        cols: Range<u32>,
        out: &mut [u8],
    ) -> Result {
        let width = self.samples.bytes();
        check_request(info, z, &rows, &cols, out.len())
            .and_then(|()| {
                let (file, base) =
                    self.offset_of(info, z).ok_or_else(|| io::Error::from(io::ErrorKind::InvalidInput))?;
                // Samples that have to grow wait in the tail of `out`.
                let tail = out.len() - out.len() / self.samples.delivered().bytes() * width;
                let stored = out.get_mut(tail..).unwrap_or_default();
                self.files.with(file, |f| read_block(f, base, info.dims.nx(), width, &rows, &cols, stored))
            })
            .map_err(|cause| {
                SourceError::from(SourceFault::ReadFailed { path: self.path(info, z), slice: z, cause })
            })?;
        self.samples.deliver(self.endian, out);
        Ok(())
    }

    /// Like [`crate::volume::VolumeSource::read_pitched`]: whole rows in one call where samples are delivered as
    /// stored.
    pub(in crate::source) fn read_pitched(
        &self,
        info: &VolumeInfo,
        z: u32,
        rows: Range<u32>,
        cols: Range<u32>,
        pitch: usize,
        out: &mut [u8],
    ) -> Result {
        let dims = info.dims;
        let row_bytes = cols.len() * info.scalar.bytes();
        let expected = rows.len() * row_bytes;
        let whole_rows = cols == (0..dims.nx()) && z < dims.nz() && rows.end <= dims.ny();
        let as_it_is = self.endian.is_native() && matches!(self.samples, Samples::Plain(_));
        if whole_rows
            && as_it_is
            && row_bytes <= pitch
            && let Some((file, base)) = self.offset_of(info, z)
        {
            let offset = base + u64::from(rows.start) * row_bytes as u64;
            let mut parts: Vec<IoSliceMut<'_>> = out
                .chunks_mut(pitch)
                .take(rows.len())
                .map(|part| IoSliceMut::new(&mut part[..row_bytes]))
                .collect();
            let got = self.files.with(file, |f| f.read_parts(&mut parts, offset));
            // Anything but a full block (a short read, a limit on the number of parts, an error) is done
            // again row by row, which also finds the words for it.
            if got.is_ok_and(|n| n == expected) {
                return Ok(());
            }
        }
        for (row, part) in rows.zip(out.chunks_mut(pitch)) {
            self.read_rows(info, z, row..row + 1, cols.clone(), &mut part[..row_bytes])?;
        }
        Ok(())
    }
}
