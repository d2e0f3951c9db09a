//! Solids made of files, built in the memory that is left.

use std::path::Path;

use super::job::build_part;
use super::parts::PartId;
use super::{BuildError, BuildOptions, BuildReport, Progress, Solid};
use crate::budget::MemoryCap;

/// A solid made of files, with the time and memory that this took.
pub struct FileSolid<'a> {
    pub(crate) solid: Box<dyn Solid + 'a>,
    pub(crate) held_bytes: u64,
    pub(crate) scratch_bytes: u64,
    /// Seconds of reading files, and seconds of all work before the build, reading included.
    pub(crate) reading_s: f64,
    pub(crate) making_s: f64,
}

impl FileSolid<'_> {
    /// Builds its model.
    ///
    /// # Errors
    /// The errors of [`super::build_solid`].
    pub fn build(
        &self,
        options: &BuildOptions,
        output: &Path,
        progress: &dyn Progress,
    ) -> Result<BuildReport, BuildError> {
        self.build_part(options, output, None, progress)
    }

    /// Builds its model, or a part of it.
    ///
    /// # Errors
    /// The errors of [`super::build_solid`].
    pub(crate) fn build_part(
        &self,
        options: &BuildOptions,
        output: &Path,
        part: Option<&PartId>,
        progress: &dyn Progress,
    ) -> Result<BuildReport, BuildError> {
        // With a share, only this part of the cap counts the memory of the solid.
        let (memory, held) = match options.memory {
            MemoryCap::Share(bytes) => {
                (MemoryCap::Share(bytes.saturating_sub(self.held_bytes)), self.held_bytes)
            }
            whole @ MemoryCap::Process(_) => (whole, 0),
        };
        let options = BuildOptions { memory, ..options.clone() };
        let mut report =
            build_part(&*self.solid, &options, output, part, progress).map_err(|e| e.beside(held))?;
        report.scratch_bytes += self.scratch_bytes;
        report.seconds.scan += self.making_s;
        report.seconds.read += self.reading_s;
        Ok(report)
    }
}
