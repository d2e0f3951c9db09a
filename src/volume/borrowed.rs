//! A borrowed volume is a volume.

use std::ops::Range;
use std::path::Path;

use super::{Preparation, Result, VolumeInfo, VolumeSource, Workspace};

/// So that what wraps a volume, such as [`Crop`](super::Crop), need not own it.
#[deny(clippy::missing_trait_methods)]
impl VolumeSource for &mut (dyn VolumeSource + '_) {
    fn info(&self) -> &VolumeInfo {
        (**self).info()
    }

    fn modality(&self) -> Option<&str> {
        (**self).modality()
    }

    fn for_each_file(&self, each: &mut dyn FnMut(&Path)) {
        (**self).for_each_file(each);
    }

    fn check_unchanged(&self) -> Result {
        (**self).check_unchanged()
    }

    fn preparation(&self) -> Preparation {
        (**self).preparation()
    }

    fn prepare(&mut self, workspace: &Workspace<'_>) -> Result {
        (**self).prepare(workspace)
    }

    fn read_rows(&self, z: u32, rows: Range<u32>, cols: Range<u32>, out: &mut [u8]) -> Result {
        (**self).read_rows(z, rows, cols, out)
    }

    fn read_pitched(
        &self,
        z: u32,
        rows: Range<u32>,
        cols: Range<u32>,
        pitch: usize,
        out: &mut [u8],
    ) -> Result {
        (**self).read_pitched(z, rows, cols, pitch, out)
    }

    fn resident_bytes(&self) -> u64 {
        (**self).resident_bytes()
    }
}
