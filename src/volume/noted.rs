//! A volume of which more is said than it says itself.

use std::ops::Range;

use super::{Result, VolumeInfo, VolumeSource, Wrapper};

/// A volume with more to be said of it.
pub(crate) struct Noted {
    pub(crate) source: Box<dyn VolumeSource>,
    /// What is said of it.
    pub(crate) info: VolumeInfo,
}

impl Wrapper for Noted {
    fn inner(&self) -> &dyn VolumeSource {
        &*self.source
    }

    fn inner_mut(&mut self) -> Option<&mut dyn VolumeSource> {
        Some(&mut *self.source)
    }

    fn own_info(&self) -> &VolumeInfo {
        &self.info
    }

    fn own_info_mut(&mut self) -> &mut VolumeInfo {
        &mut self.info
    }

    fn own_bytes(&self) -> u64 {
        0
    }

    fn own_rows(&self, z: u32, rows: Range<u32>, cols: Range<u32>, out: &mut [u8]) -> Result {
        self.source.read_rows(z, rows, cols, out)
    }

    fn own_pitched(
        &self,
        z: u32,
        rows: Range<u32>,
        cols: Range<u32>,
        pitch: usize,
        out: &mut [u8],
    ) -> Result {
        self.source.read_pitched(z, rows, cols, pitch, out)
    }
}
