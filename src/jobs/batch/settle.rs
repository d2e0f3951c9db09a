//! Choice between labels and a threshold for volumes of a batch where the request leaves it open.

use super::Run;
use crate::budget::MemoryCap;
use crate::builder::{BuildNote, BuildOptions, Threshold};
use crate::clean::CleanOptions;
use crate::error::Error;
use crate::jobs::build::BuildJob;
use crate::jobs::labels::{Values, all_labels, look, stated};
use crate::source::Subject;

impl Run<'_> {
    /// The options of a job for a reshaped subject, with remarks on its values: for all labels, if its header or its
    /// values show labels and the request leaves the choice of the inside open.
    pub(super) fn settle(
        &self,
        job: &BuildJob<'_>,
        subject: &mut Subject,
        name: &str,
        least: u64,
    ) -> Result<(BuildOptions, Option<BuildNote>), Error> {
        let asked = job.options;
        // Cleaning needs a single inside.
        let CleanOptions { roi, .. } = job.clean;
        let is_cleaned = *job.clean != CleanOptions { roi: roi.clone(), ..CleanOptions::default() };
        let (true, false, Subject::Volume(source)) = (self.request.find_labels, is_cleaned, subject) else {
            return Ok((asked.clone(), None));
        };
        if stated(&**source) > 0 {
            return Ok((all_labels(asked), None));
        }
        let grant = self.grant(name, least)?;
        let options = BuildOptions { memory: MemoryCap::Share(grant.bytes()), ..asked.clone() };
        let values = look(&mut **source, job.clean, &options, job.output, job.progress)?;
        Ok(match values {
            Values::Labels(_) => (all_labels(asked), None),
            Values::Mixed(selection, note) => {
                (BuildOptions { threshold: Threshold::Chosen(selection), ..asked.clone() }, note)
            }
        })
    }
}
