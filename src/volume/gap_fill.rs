//! A volume whose missing slices are made between their neighbours.

use std::ops::Range;

use super::blend::{blend_rows, neighbour_bytes};
use super::wrapper::owns_source_and_info;
use super::{InfoOverride, Result, VolumeInfo, VolumeSource, Wrapper};
use crate::geom::Dims;
use crate::volume::Note;

/// Slices of another volume and, between them, slices made of their two neighbours: delivered samples are interpolated
/// linearly, integers rounded half away from zero.
///
/// Holds 16 bytes a slice; while it is read, 64 KiB (or one row) for each thread.
pub(crate) struct GapFill {
    source: Box<dyn VolumeSource>,
    info: VolumeInfo,
    /// For each slice a slice of `source`, and the part of the way to the next one.
    slices: Vec<(u32, f64)>,
}

impl GapFill {
    /// The slices that `slices` names; all of them where those are too many or none.
    pub(crate) fn between(
        source: Box<dyn VolumeSource>,
        slices: Vec<(u32, f64)>,
        note: Note,
    ) -> Box<dyn VolumeSource> {
        let mut info = source.info().clone();
        let [nx, ny, _] = info.dims.to_array();
        let Some(dims) = u32::try_from(slices.len()).ok().and_then(|nz| Dims::new(nx, ny, nz)) else {
            return InfoOverride::with_note(source, note);
        };
        info.dims = dims;
        info.description.bytes = dims.voxels() * info.scalar.bytes() as u64;
        info.notes.push(note);
        Box::new(Self { source, info, slices })
    }
}

impl Wrapper for GapFill {
    owns_source_and_info!();

    fn own_bytes(&self) -> u64 {
        neighbour_bytes(&self.info)
    }

    fn own_rows(&self, z: u32, rows: Range<u32>, cols: Range<u32>, out: &mut [u8]) -> Result {
        // The inner volume refuses a slice out of range.
        let (at, part) = self.slices.get(z as usize).copied().unwrap_or((u32::MAX, 0.0));
        self.source.read_rows(at, rows.clone(), cols.clone(), out)?;
        if part == 0.0 {
            return Ok(());
        }
        blend_rows(self.info.scalar, part, rows, cols.len(), out, |rows, other| {
            self.source.read_rows(at + 1, rows, cols.clone(), other)
        })
    }
}
