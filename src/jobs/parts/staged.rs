//! The stages of a plan whose threshold has to be found first.

use std::ops::Range;
use std::path::Path;
use std::time::Instant;

use super::report::{PartReport, StageReport};
use super::{Opened, PartsInput, Plan, refused};
use crate::budget::peak_rss_bytes;
use crate::builder::parts::occupancy::{Occupancy, OccupancyId};
use crate::builder::parts::stage::{self, Finding, Stage};
use crate::builder::parts::{PartFault, PartId};
use crate::builder::{
    BitVolume, BuildError, BuildFault, BuildNote, BuildOptions, Chooser, Extremes, Progress, Threshold,
    choose_noted,
};
use crate::clean::{CleanError, CleanReport};
use crate::error::Error;
use crate::exit::ExitKind;
use crate::fault::usage;
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
    /// The stages that find it are not finished.
    pub(super) fn threshold_of(
        &self,
        opened: &Opened,
        id: &PartId,
        folder: &Path,
    ) -> Result<Threshold, Error> {
        let stage = Stage::Histogram;
        if !opened.stages.contains(&stage) {
            return Ok(self.options().threshold);
        }
        match stage::read(stage, id, folder, true)? {
            Some(Finding::Chosen(selection, _)) => Ok(Threshold::Chosen(selection)),
            _ => Err(refused(folder, PartFault::StageMissing { stage })),
        }
    }

    /// The threshold on one machine, which reads all values if it is not known yet; also returns the note on it.
    pub(super) fn own_threshold(
        &self,
        opened: &mut Opened,
        id: &PartId,
        folder: &Path,
    ) -> Result<(Threshold, Option<BuildNote>), Error> {
        let stage = Stage::Histogram;
        if !opened.stages.contains(&stage) {
            return Ok((self.options().threshold, None));
        }
        if let Some(Finding::Chosen(selection, note)) = sound(stage::read(stage, id, folder, true))? {
            return Ok((Threshold::Chosen(selection), note));
        }
        self.prepare(opened, &stage.whole_path(id, folder))?;
        let Some(source) = opened.volume() else { return Ok((self.options().threshold, None)) };
        let BuildJob { options, progress, .. } = self.job;
        let (selection, note) =
            choose_noted(source, Threshold::Otsu, options.memory, options.threads, progress)?;
        stage::write(&Finding::Chosen(selection, note), stage, id, folder, true)?;
        Ok((Threshold::Chosen(selection), note))
    }

    /// The cleaned occupancy, with the slices checked that `parts` read; `None` without cleaning.
    pub(super) fn cleaned_bits(
        &self,
        opened: &Opened,
        ids: &[PartId],
        folder: &Path,
    ) -> Result<Option<BitVolume>, Error> {
        let stage = Stage::Occupancy;
        let (Some(source), Some(part)) = (opened.volume(), ids.first()) else { return Ok(None) };
        if !opened.stages.contains(&stage) {
            return Ok(None);
        }
        let whole = OccupancyId { part, folder, is_whole: true, dims: source.info().dims };
        let missing = || refused(folder, PartFault::StageMissing { stage });
        let occupancy = whole.open()?.ok_or_else(missing)?;
        for id in ids {
            let Range { start, end } = id.region().z;
            occupancy.check(start.saturating_sub(BEYOND)..end.saturating_add(BEYOND), self.job.progress)?;
        }
        Ok(occupancy.into_bits())
    }

    /// Cleans on one machine, unless that is done already.
    pub(super) fn own_cleaning(
        &self,
        opened: &mut Opened,
        part: &PartId,
        folder: &Path,
        options: &BuildOptions,
    ) -> Result<(), Error> {
        let BuildJob { clean, progress, .. } = self.job;
        if !opened.stages.contains(&Stage::Occupancy) {
            return Ok(());
        }
        let Some(dims) = opened.volume().map(|source| source.info().dims) else { return Ok(()) };
        let whole = OccupancyId { part, folder, is_whole: true, dims };
        if is_sound(&whole, progress)? {
            return Ok(());
        }
        self.prepare(opened, &whole.path())?;
        let Some(source) = opened.volume() else { return Ok(()) };
        whole.write::<Error>(progress, |bits| {
            let all = 0..dims.nz();
            let fill = |own: &BitVolume| clean.occupancy_of(source, options, all.clone(), own, progress);
            let (cleaned, _) = clean.clean_bits(source, options, &fill, &whole.path(), progress)?;
            Ok(bits.take(&cleaned, 0)?)
        })
    }

    /// Writes the occupancy of a part's share of the slices to its file.
    fn write_occupancy(
        &self,
        opened: &Opened,
        id: &OccupancyId<'_>,
        options: &BuildOptions,
    ) -> Result<(), Error> {
        let BuildJob { clean, progress, .. } = self.job;
        let Some(source) = opened.volume() else { return Ok(()) };
        id.write::<Error>(progress, |bits| {
            clean.occupancy_of(source, options, id.slices(), bits, progress)?;
            source.check_unchanged().map_err(|cause| BuildError::from(BuildFault::Source(cause)))?;
            Ok(())
        })
    }

    /// Cleans the occupancies that the parts have found, and writes the result for the parts to read.
    fn join_occupancy(
        &self,
        opened: &Opened,
        whole: &OccupancyId<'_>,
        options: &BuildOptions,
    ) -> Result<CleanReport, Error> {
        let BuildJob { clean, progress, .. } = self.job;
        let Some(source) = opened.volume() else { return Ok(CleanReport::default()) };
        let parts = whole.part.cuts.parts;
        let each = |number: u32, then: &mut dyn FnMut(Occupancy<'_>, u32) -> Result<(), BuildError>| {
            let part = PartId { number, ..*whole.part };
            let own = OccupancyId { part: &part, is_whole: false, ..*whole };
            let first = own.slices().start;
            match own.open()? {
                None => Ok::<bool, BuildError>(false),
                Some(found) => then(found, first).map(|()| true),
            }
        };
        let mut missing = Vec::new();
        for number in 0..parts {
            if !each(number, &mut |_, _| Ok(()))? {
                missing.push(number);
            }
        }
        if !missing.is_empty() {
            let count = u32::try_from(missing.len()).unwrap_or(parts);
            missing.truncate(8);
            return Err(refused(whole.folder, PartFault::Missing { parts, missing: count, first: missing }));
        }
        let mut report = CleanReport::default();
        whole.write::<Error>(progress, |bits| {
            let fill = |all: &BitVolume| -> Result<(), CleanError> {
                for number in 0..parts {
                    each(number, &mut |found, first| {
                        found.check(0..u32::MAX, progress)?;
                        found.into_bits().map_or(Ok(()), |own| all.take(&own, first))
                    })?;
                }
                Ok(())
            };
            let (cleaned, done) = clean.clean_bits(source, options, &fill, &whole.path(), progress)?;
            report = done;
            Ok(bits.take(&cleaned, 0)?)
        })?;
        Ok(report)
    }
}

/// True for an existing, whole and sound occupancy.
fn is_sound(id: &OccupancyId<'_>, progress: &dyn Progress) -> Result<bool, Error> {
    let check =
        |found: Option<Occupancy<'_>>| found.map(|found| found.check(0..u32::MAX, progress)).transpose();
    match id.open().and_then(check) {
        Err(error) if error.kind() == ExitKind::Input => Ok(false),
        found => Ok(found?.is_some()),
    }
}

/// Most slices beyond its box that a part reads.
const BEYOND: u32 = 8;

/// A finding; one that is damaged counts as missing.
fn sound(found: Result<Option<Finding>, BuildError>) -> Result<Option<Finding>, Error> {
    match found {
        Err(error) if error.kind() == ExitKind::Input => Ok(None),
        found => Ok(found?),
    }
}

/// Opens the input of a plan for one of its stages; also returns the extremes of all samples, if an earlier stage finds
/// them.
fn open(plan: &Plan, stage: Stage, id: &PartId, input: &PartsInput<'_>) -> Result<(Opened, Extremes), Error> {
    let opened = plan.open(input)?;
    let of = &opened.stages;
    if !of.contains(&stage) {
        let names: Vec<_> = of.iter().map(|stage| stage.name()).collect();
        let known = match &names[..] {
            [] => "its threshold is given, and its parts can be built at once".to_owned(),
            names => format!("its stages are {}", names.join(" and ")),
        };
        return Err(refused(&plan.path, usage!("has no stage '{stage}': {known}").into()));
    }
    let before = Stage::Extremes;
    let extremes = match stage == Stage::Histogram && of.contains(&before) {
        false => Extremes::default(),
        true => match stage::read(before, id, plan.folder(), true)? {
            Some(Finding::Extremes(extremes)) => extremes,
            _ => return Err(refused(plan.folder(), PartFault::StageMissing { stage: before })),
        },
    };
    Ok((opened, extremes))
}

/// Runs a stage on a part's share of the volume, unless its result exists and is sound.
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
    let path = stage.path(&id, folder);
    let progress = input.job.progress;
    let Some(dims) = opened.volume().map(|source| source.info().dims) else {
        return Err(refused(&plan.path, PartFault::OtherPlan));
    };
    let occupancy = OccupancyId { part: &id, folder, is_whole: false, dims };
    let was_there = match stage {
        Stage::Occupancy => is_sound(&occupancy, progress)?,
        _ => sound(stage::read(stage, &id, folder, false))?.is_some(),
    };
    if !was_there && stage == Stage::Occupancy {
        let threshold = input.threshold_of(&opened, &id, folder)?;
        input.prepare(&mut opened, &path)?;
        input.write_occupancy(&opened, &occupancy, &BuildOptions { threshold, ..input.options() })?;
    } else if !was_there {
        input.prepare(&mut opened, &path)?;
        if let Some(source) = opened.volume() {
            let found = stage::find(&input.chooser(source), stage, &id, &extremes)?;
            source.check_unchanged().map_err(|cause| BuildError::from(BuildFault::Source(cause)))?;
            stage::write(&found, stage, &id, folder, false)?;
        }
    }
    let report = PartReport::new(plan, number, &path, started);
    Ok(PartReport { stage: Some(stage.name()), was_there, ..report })
}

/// Merges the results of a stage in all parts.
///
/// # Errors
/// A part of the stage is missing, damaged or not of this plan; or all values are alike, so that there is no threshold.
pub fn merge_stage(plan: &Plan, stage: Stage, input: &PartsInput<'_>) -> Result<StageReport, Error> {
    let started = Instant::now();
    let (id, folder) = (plan.part(0)?, plan.folder());
    let (mut opened, extremes) = open(plan, stage, &id, input)?;
    let is_one_number = extremes.whole().is_some_and(|(least, most)| least == most);
    if stage == Stage::Histogram && (is_one_number || input.job.clean.downsample.is_some()) {
        // A number in NaN is a mask, and averages of labels have a threshold of their own: the values tell.
        input.prepare(&mut opened, &stage.whole_path(&id, folder))?;
    }
    let Some(source) = opened.volume() else { return Err(refused(&plan.path, PartFault::OtherPlan)) };
    input.job.give_back();
    let (mut threshold, mut note, mut cleaning) = (None, None, None);
    if stage == Stage::Occupancy {
        let threshold = input.threshold_of(&opened, &id, folder)?;
        let whole = OccupancyId { part: &id, folder, is_whole: true, dims: source.info().dims };
        let options = BuildOptions { threshold, ..input.options() };
        cleaning = Some(input.join_occupancy(&opened, &whole, &options)?);
    } else {
        let found = stage::join(&input.chooser(source), stage, &id, folder, &extremes)?;
        stage::write(&found, stage, &id, folder, true)?;
        if let Finding::Chosen(selection, of) = found {
            (threshold, note) = (Some(selection.lo), of);
        }
    }
    Ok(StageReport {
        plan: data(&plan.path),
        stage: stage.name(),
        output: data(&stage.whole_path(&id, folder)),
        parts: plan.file.parts,
        threshold,
        voxels_added: cleaning.as_ref().map(|done| done.voxels_added),
        voxels_removed: cleaning.as_ref().map(|done| done.voxels_removed),
        components: cleaning.as_ref().map(|done| done.components),
        warnings: note.iter().map(ToString::to_string).collect(),
        peak_rss_bytes: peak_rss_bytes(),
        wall_s: started.elapsed().as_secs_f64(),
    })
}
