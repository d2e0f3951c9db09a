//! A volume whose samples agree with a given occupancy.

use std::ops::Range;

use super::bits::BitVolume;
use crate::builder::RangeTest;
use crate::volume::{Result, SourceError, SourceFault, VolumeInfo, VolumeSource, Wrapper};

/// Bytes of occupancy that are read at a time: at least one row.
const READ_BYTES: usize = 32 << 10;

/// The original volume, except for voxels that were removed or added: these have the nearest sample value on the other
/// side of the threshold.
///
/// The range test of the result is the occupancy, so the builder need not know about cleaning.
pub(super) struct Masked<'a> {
    source: &'a dyn VolumeSource,
    info: VolumeInfo,
    test: Box<dyn RangeTest>,
    bits: BitVolume,
}

impl<'a> Masked<'a> {
    pub(super) fn new(
        source: &'a dyn VolumeSource,
        info: VolumeInfo,
        test: Box<dyn RangeTest>,
        bits: BitVolume,
    ) -> Self {
        Self { source, info, test, bits }
    }

    /// Bytes that a reading thread holds beyond the source's own.
    pub(super) fn thread_bytes(row_words: usize) -> u64 {
        (READ_BYTES + row_words * 16) as u64
    }

    fn failed(&self, cause: std::io::Error) -> SourceError {
        SourceError::from(SourceFault::Scratch { path: self.bits.folder().to_path_buf(), cause })
    }

    /// Moves the samples of a block whose rows begin `pitch` bytes apart.
    fn enforce(&self, z: u32, rows: Range<u32>, cols: &Range<u32>, pitch: usize, out: &mut [u8]) -> Result {
        let row_bytes = cols.len() * self.info.scalar.bytes();
        if row_bytes == 0 || rows.is_empty() {
            return Ok(());
        }
        // Whole rows in one read, unless a narrow tile of a wide volume would waste most of it.
        let (first, end) = (cols.start as usize / 64, cols.end.div_ceil(64) as usize);
        let whole = (end - first) * 4 >= self.bits.row_words;
        let (first, width) = if whole { (0, self.bits.row_words) } else { (first, end - first) };
        let at_once = if whole { (READ_BYTES / 8 / width).clamp(1, rows.len()) } else { 1 };
        let mut words = vec![0; at_once * width];
        let mut wanted = vec![0; cols.len().div_ceil(64)];
        let shift = cols.start as usize - first * 64;
        let mut out = out.chunks_mut(pitch);
        let mut row = rows.start;
        while row < rows.end {
            let count = at_once.min((rows.end - row) as usize);
            let words = &mut words[..count * width];
            self.bits.read(self.bits.row(row, z), first, words).map_err(|cause| self.failed(cause))?;
            for (bits, out) in words.chunks_exact(width).zip(&mut out) {
                align(bits, shift, &mut wanted);
                self.test.enforce(&mut out[..row_bytes], &wanted);
            }
            row += u32::try_from(count).unwrap_or(u32::MAX);
        }
        Ok(())
    }
}

fn align(bits: &[u64], shift: usize, to: &mut [u64]) {
    let (skip, shift) = (shift / 64, shift % 64);
    for (i, to) in to.iter_mut().enumerate() {
        let low = bits.get(skip + i).copied().unwrap_or(0) >> shift;
        let high = if shift == 0 { 0 } else { bits.get(skip + i + 1).copied().unwrap_or(0) << (64 - shift) };
        *to = low | high;
    }
}

impl Wrapper for Masked<'_> {
    fn inner(&self) -> &dyn VolumeSource {
        self.source
    }

    fn inner_mut(&mut self) -> Option<&mut dyn VolumeSource> {
        None
    }

    fn own_info(&self) -> &VolumeInfo {
        &self.info
    }

    fn own_info_mut(&mut self) -> &mut VolumeInfo {
        &mut self.info
    }

    fn own_bytes(&self) -> u64 {
        Self::thread_bytes(self.bits.row_words)
    }

    fn own_rows(&self, z: u32, rows: Range<u32>, cols: Range<u32>, out: &mut [u8]) -> Result {
        self.source.read_rows(z, rows.clone(), cols.clone(), out)?;
        let pitch = (cols.len() * self.info.scalar.bytes()).max(1);
        self.enforce(z, rows, &cols, pitch, out)
    }

    fn own_pitched(
        &self,
        z: u32,
        rows: Range<u32>,
        cols: Range<u32>,
        pitch: usize,
        out: &mut [u8],
    ) -> Result {
        self.source.read_pitched(z, rows.clone(), cols.clone(), pitch, out)?;
        self.enforce(z, rows, &cols, pitch, out)
    }
}
