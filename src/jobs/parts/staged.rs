//! The stages of a plan whose threshold has to be found first.

use std::path::Path;
use std::time::Instant;

use super::report::{PartReport, StageReport};
use super::{Opened, PartsInput, Plan, refused};
use crate::budget::peak_rss_bytes;
use crate::builder::parts::stage::{self, Finding, Stage};
use crate::builder::parts::{PartFault, PartId};
use crate::builder::{BuildError, BuildFault, Chooser, Threshold, choose_noted};
use crate::error::Error;
use crate::exit::ExitKind;
use crate::jobs::build::BuildJob;
use crate::text::data;
use crate::volume::VolumeSource;

impl PartsInput<'_> {
    fn chooser<'s>(&'s self, source: &'s dyn VolumeSource) -> Chooser<'s> {
        let BuildJob { options, progress, .. } = self.job;
        Chooser { source, memory: options.memory, threads: options.threads, progress }
    }

    /// The threshold of the parts.
    ///
    /// # Errors
    /// The stages that find it are not done.
    pub(super) fn threshold_of(
        &self,
        opened: &Opened,
        id: &PartId,
        folder: &Path,
    ) -> Result<Threshold, Error> {
        match opened.stages.last() {
            None => Ok(self.options().threshold),
            Some(&stage) => match stage::read(stage, id, folder, true)? {
                Some(Finding::Chosen(selection, _)) => Ok(Threshold::Chosen(selection)),
                _ => Err(refused(folder, PartFault::StageMissing { stage })),
            },
        }
    }

    /// The same on one machine, which looks at all values if they are not known.
    pub(super) fn own_threshold(
        &self,
        opened: &mut Opened,
        id: &PartId,
        folder: &Path,
    ) -> Result<Threshold, Error> {
        let Some(&stage) = opened.stages.last() else { return Ok(self.options().threshold) };
        if let Some(Finding::Chosen(selection, _)) = sound(stage::read(stage, id, folder, true))? {
            return Ok(Threshold::Chosen(selection));
        }
        self.prepare(opened, &stage.whole_path(id, folder))?;
        let Some(source) = opened.volume() else { return Ok(self.options().threshold) };
        let BuildJob { options, progress, .. } = self.job;
        let (selection, note) =
            choose_noted(source, Threshold::Otsu, options.memory, options.threads, progress)?;
        stage::write(&Finding::Chosen(selection, note), stage, id, folder, true)?;
        Ok(Threshold::Chosen(selection))
    }
}

/// A finding; one that is damaged counts as missing.
fn sound(found: Result<Option<Finding>, BuildError>) -> Result<Option<Finding>, Error> {
    match found {
        Err(error) if error.kind() == ExitKind::Input => Ok(None),
        found => Ok(found?),
    }
}

/// Opens the input of a plan for one of its stages; the extremes of all samples, if they come before it.
fn open(
    plan: &Plan,
    stage: Stage,
    id: &PartId,
    input: &PartsInput<'_>,
) -> Result<(Opened, Option<(f64, f64)>), Error> {
    let opened = plan.open(input)?;
    let of = opened.stages;
    let Some(at) = of.iter().position(|known| *known == stage) else {
        return Err(refused(&plan.path, PartFault::NoSuchStage { stage, of }));
    };
    let extremes = match of[..at].last() {
        None => None,
        Some(&before) => match stage::read(before, id, plan.folder(), true)? {
            Some(Finding::Extremes(extremes)) => extremes,
            _ => return Err(refused(plan.folder(), PartFault::StageMissing { stage: before })),
        },
    };
    Ok((opened, extremes))
}

/// Finds what a stage asks of a part's share of the volume, unless that is there and sound.
///
/// # Errors
/// The input is not what was planned for, the plan has no such stage, or an earlier one is not done.
pub fn part_stage(
    plan: &Plan,
    stage: Stage,
    number: u32,
    input: &PartsInput<'_>,
) -> Result<PartReport, Error> {
    let started = Instant::now();
    let (id, folder) = (plan.part(number)?, plan.folder());
    let (mut opened, extremes) = open(plan, stage, &id, input)?;
    let was_there = sound(stage::read(stage, &id, folder, false))?.is_some();
    let path = stage.path(&id, folder);
    if !was_there {
        input.prepare(&mut opened, &path)?;
        if let Some(source) = opened.volume() {
            let found = stage::find(&input.chooser(source), stage, &id, extremes)?;
            source.check_unchanged().map_err(|cause| BuildError::from(BuildFault::Source(cause)))?;
            stage::write(&found, stage, &id, folder, false)?;
        }
    }
    Ok(PartReport::new(plan, number, &path, started).with_stage(stage, was_there))
}

/// Adds up what a stage found in all parts.
///
/// # Errors
/// A part of the stage is missing, damaged or not of this plan; or all values are alike, so that there is no threshold.
pub fn merge_stage(plan: &Plan, stage: Stage, input: &PartsInput<'_>) -> Result<StageReport, Error> {
    let started = Instant::now();
    let (id, folder) = (plan.part(0)?, plan.folder());
    let (opened, extremes) = open(plan, stage, &id, input)?;
    let Some(source) = opened.volume() else { return Err(refused(&plan.path, PartFault::OtherPlan)) };
    let found = stage::join(&input.chooser(source), stage, &id, folder, extremes)?;
    stage::write(&found, stage, &id, folder, true)?;
    let (threshold, note) = match found {
        Finding::Chosen(selection, note) => (Some(selection.lo), note),
        _ => (None, None),
    };
    Ok(StageReport {
        plan: data(&plan.path),
        stage: stage.name(),
        output: data(&stage.whole_path(&id, folder)),
        parts: plan.file.parts,
        threshold,
        warnings: note.iter().map(ToString::to_string).collect(),
        peak_rss_bytes: peak_rss_bytes(),
        wall_s: started.elapsed().as_secs_f64(),
    })
}
