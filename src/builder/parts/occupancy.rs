//! The occupancy of a volume in files that parts share: the slices of one part before cleaning, and all slices after
//! it.
//!
//! A file, little-endian: the rows of bits as in [`BitVolume`], slice after slice; the CRC of each slice; the head of a
//! stage; the CRC of these two. Readers check the slices that they need.

use std::ops::Range;
use std::path::{Path, PathBuf};

use super::cut::{PartId, share};
use super::fault::PartFault;
use super::read::at;
use super::stage::{HEAD_BYTES, Stage, head};
use crate::atomic::AtomicFile;
use crate::builder::bits::BitVolume;
use crate::builder::error::{BuildError, BuildFault};
use crate::geom::Dims;
use crate::platform::{FileExt, PositionalFile};
use crate::progress::Progress;

/// Bytes read at a time.
const STEP: usize = 64 << 10;

/// Identity of an occupancy: a part's share of the slices, or all of them.
#[derive(Clone, Copy)]
pub(crate) struct OccupancyId<'a> {
    pub(crate) part: &'a PartId,
    pub(crate) folder: &'a Path,
    pub(crate) is_whole: bool,
    /// Size of the volume.
    pub(crate) dims: Dims,
}

impl OccupancyId<'_> {
    /// The slices in the file.
    pub(crate) fn slices(&self) -> Range<u32> {
        let nz = self.dims.nz();
        if self.is_whole { 0..nz } else { share(self.part.number, nz, self.part.cuts.parts) }
    }

    /// Size of the stored slices; `None` without stored slices.
    pub(crate) fn own_dims(&self) -> Option<Dims> {
        let slices = self.slices();
        Dims::new(self.dims.nx(), self.dims.ny(), slices.end - slices.start)
    }

    pub(crate) fn path(&self) -> PathBuf {
        let stage = Stage::Occupancy;
        if self.is_whole {
            stage.whole_path(self.part, self.folder)
        } else {
            stage.path(self.part, self.folder)
        }
    }

    fn slice_bytes(&self) -> u64 {
        u64::from(self.dims.nx().div_ceil(64)) * 8 * u64::from(self.dims.ny())
    }

    fn head(&self) -> [u8; HEAD_BYTES] {
        head(Stage::Occupancy, self.part, self.is_whole)
    }

    /// Writes the file; `fill` supplies the bits, which must not be empty.
    ///
    /// # Errors
    /// The disk fails, or `fill` does.
    pub(crate) fn write<E: From<BuildError>>(
        &self,
        progress: &dyn Progress,
        fill: impl FnOnce(&BitVolume) -> Result<(), E>,
    ) -> Result<(), E> {
        let path = self.path();
        let failed = |cause| BuildError::from(BuildFault::Output { path: path.clone(), cause });
        let atomic = AtomicFile::create(&path).map_err(failed)?;
        if let Some(dims) = self.own_dims() {
            let file = atomic.file().try_clone().map_err(failed)?;
            let bits = BitVolume::over(file.into(), self.folder, dims);
            atomic.file().set_len(bits.bytes()).map_err(failed)?;
            fill(&bits)?;
        }
        let (bytes, slices) = (self.slice_bytes(), self.slices());
        let mut tail = Vec::new();
        let mut buffer = vec![0; STEP];
        for slice in 0..u64::from(slices.end - slices.start) {
            progress.check().map_err(BuildError::from)?;
            let crc = crc_of(|to, at| atomic.file().read_exact_at(to, at), slice * bytes, bytes, &mut buffer)
                .map_err(failed)?;
            tail.extend(crc.to_le_bytes());
        }
        tail.extend(self.head());
        let crc = crc32c::crc32c(&tail);
        tail.extend(crc.to_le_bytes());
        let end = bytes * u64::from(slices.end - slices.start);
        let finish = || {
            atomic.file().write_all_at(&tail, end)?;
            atomic.file().sync_all()
        };
        finish().map_err(failed)?;
        Ok(atomic.commit().map_err(failed)?)
    }

    /// Opens the file without checking its bits; `None` if it does not exist.
    ///
    /// # Errors
    /// It is damaged, or cannot be read.
    pub(crate) fn open(&self) -> Result<Option<Occupancy<'_>>, BuildError> {
        let path = self.path();
        let file = match PositionalFile::open(&path) {
            Err(cause) if cause.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            file => file.map_err(|cause| at(&path, PartFault::Unreadable(cause)))?,
        };
        let slices = self.slices();
        let count = (slices.end - slices.start) as usize;
        let mut tail = vec![0; 4 * count + HEAD_BYTES + 4];
        let end = self.slice_bytes() * count as u64;
        let length = file.metadata().map_err(|cause| at(&path, PartFault::Unreadable(cause)))?.len();
        let is_there = length == end + tail.len() as u64 && file.read_exact_at(&mut tail, end).is_ok();
        let crcs = tail.split_last_chunk::<4>().filter(|(content, crc)| {
            let is_sound = crc32c::crc32c(content) == u32::from_le_bytes(**crc);
            is_there && is_sound && content.ends_with(&self.head())
        });
        let Some((content, _)) = crcs else { return Err(self.damaged()) };
        let crcs = content.as_chunks().0.iter().take(count).map(|crc| u32::from_le_bytes(*crc)).collect();
        Ok(Some(Occupancy { id: *self, file, crcs }))
    }

    fn damaged(&self) -> BuildError {
        at(&self.path(), PartFault::DamagedStage { stage: Stage::Occupancy })
    }
}

/// CRC of a stretch of a file.
fn crc_of(
    read: impl Fn(&mut [u8], u64) -> std::io::Result<()>,
    at: u64,
    bytes: u64,
    buffer: &mut [u8],
) -> std::io::Result<u32> {
    let (mut done, mut crc) = (0, 0);
    while done < bytes {
        let now = usize::try_from(bytes - done).unwrap_or(usize::MAX).min(buffer.len());
        read(&mut buffer[..now], at + done)?;
        crc = crc32c::crc32c_append(crc, &buffer[..now]);
        done += now as u64;
    }
    Ok(crc)
}

/// An occupancy that is open.
pub(crate) struct Occupancy<'a> {
    id: OccupancyId<'a>,
    file: PositionalFile,
    crcs: Vec<u32>,
}

impl Occupancy<'_> {
    /// Checks the given slices, as far as the file holds them.
    ///
    /// # Errors
    /// One is damaged, or cannot be read.
    pub(crate) fn check(&self, slices: Range<u32>, progress: &dyn Progress) -> Result<(), BuildError> {
        let (own, bytes) = (self.id.slices(), self.id.slice_bytes());
        let mut buffer = vec![0; STEP];
        for z in slices.start.max(own.start)..slices.end.min(own.end) {
            progress.check()?;
            let slice = z - own.start;
            let crc = crc_of(
                |to, at| self.file.read_exact_at(to, at),
                u64::from(slice) * bytes,
                bytes,
                &mut buffer,
            )
            .map_err(|cause| at(&self.id.path(), PartFault::Unreadable(cause)))?;
            if self.crcs.get(slice as usize) != Some(&crc) {
                return Err(self.id.damaged());
            }
        }
        Ok(())
    }

    /// The bits; `None` without stored bits.
    pub(crate) fn into_bits(self) -> Option<BitVolume> {
        let dims = self.id.own_dims()?;
        Some(BitVolume::over(self.file, self.id.folder, dims))
    }
}
