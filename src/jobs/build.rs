//! `oct build`: a volume on disk into a model on disk, and the report of it.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::time::Instant;

use serde_json::{Value, json};

use super::info::{Info, read_info, static_facts};
use super::wording::foreign::{data, shown};
use super::wording::{Hint, Short, sentences};
use crate::budget::{Budget, Bytes, MemoryCap, costs, peak_rss_bytes};
use crate::builder::{self, BuildError, BuildOptions, BuildReport, Progress, Threshold};
use crate::catalogue;
use crate::clean::{CleanError, CleanOptions, CleanReport};
use crate::error::{Error, UsageError};
use crate::format::{MAGIC, SurfaceKind};
use crate::resident::give_back;
use crate::source::OpenOptions;
use crate::volume::{Preparation, SourceError, VolumeSource, Workspace};

/// What was built, from what, and what it took.
#[derive(Clone, Debug)]
pub struct BuildSummary {
    /// The inputs, as given.
    pub input: String,
    /// The model, as given.
    pub output: PathBuf,
    /// The cap.
    pub memory_bytes: u64,
    /// Figures of the build.
    pub report: BuildReport,
    /// Facts of the finished file.
    pub info: Info,
    /// What cleaning was asked for, and what it did to the occupancy if it touched that.
    pub cleaning: Option<(Vec<String>, Option<CleanReport>)>,
    /// Sentences about the input.
    pub warnings: Vec<String>,
    /// Sentences about what may be wanted besides, or instead.
    pub hints: Vec<String>,
    /// Seconds from opening the input to the model's name on disk.
    pub wall_s: f64,
}

/// Opens the inputs, cleans the volume, and builds the model.
///
/// # Errors
/// As [`catalogue::open_unprepared_in`], [`builder::build_volume`] and [`CleanOptions::clean`]; an old model is untouched then.
pub fn convert(
    inputs: &[PathBuf],
    how: &OpenOptions,
    cleaning: &CleanOptions,
    options: &BuildOptions,
    output: &Path,
    progress: &dyn Progress,
) -> Result<BuildSummary, Error> {
    let started = Instant::now();
    give_back();
    // Where not even a little is left, the builder says it better.
    let opening_bytes = Budget::of(options.memory).left_bytes().max(costs::LEAST_OPENING);
    let how = OpenOptions { opening_bytes: Some(opening_bytes), ..how.clone() };
    let source = catalogue::open_unprepared_in(inputs, &how, &options.scratch_folder(output))?;
    refuse_own_input(inputs, output)?;
    let input = inputs.iter().map(|p| data(p)).collect::<Vec<_>>().join(" ");
    convert_source(source, input, cleaning, options, output, progress, started)
        .map_err(|error| in_full(error, inputs))
}

/// An error with the whole path of the only input, where it names that by its last part.
fn in_full(mut error: Error, inputs: &[PathBuf]) -> Error {
    let [path] = inputs else { return error };
    let is_it = |name: &Path| name.file_name().is_some() && name.file_name() == path.file_name();
    let named = match &mut error {
        Error::Source(SourceError::Usage { path: own, .. }) => {
            if is_it(own) {
                own.clone_from(path);
            }
            return error;
        }
        Error::Clean(CleanError::NothingKept { name, .. }) => name,
        Error::Build(inner) | Error::Clean(CleanError::Build(inner)) => match inner.input_name() {
            Some(name) => name,
            None => return error,
        },
        _ => return error,
    };
    if is_it(Path::new(named.as_str())) {
        *named = data(path);
    }
    error
}

/// A model never takes the place of the volume it is made of, nor of a file in an input folder that is
/// not a model itself.
pub(super) fn refuse_own_input(inputs: &[PathBuf], output: &Path) -> Result<(), Error> {
    let Ok(real) = output.canonicalize() else { return Ok(()) };
    let is_model = || {
        let mut head = [0; MAGIC.len()];
        File::open(&real).and_then(|mut file| file.read_exact(&mut head)).is_ok() && head == MAGIC
    };
    let replaced = |input: &&PathBuf| {
        input.canonicalize().is_ok_and(|path| {
            if path.is_dir() { real.starts_with(&path) && !is_model() } else { path == real }
        })
    };
    match inputs.iter().find(replaced) {
        Some(_) => Err(UsageError::ReplacesInput { path: output.to_path_buf(), folder: true }.into()),
        None => Ok(()),
    }
}

/// Builds the model of an open source; `started` is when the job began.
///
/// # Errors
/// As [`builder::build_volume`].
pub fn build_source(
    source: &mut dyn VolumeSource,
    input: String,
    options: &BuildOptions,
    output: &Path,
    progress: &dyn Progress,
    started: Instant,
) -> Result<BuildSummary, Error> {
    prepare(source, &CleanOptions::default(), options, output, progress)?;
    give_back();
    let report = builder::build_volume(source, options, output, progress)?;
    let wall_s = started.elapsed().as_secs_f64();
    Ok(BuildSummary {
        input,
        output: output.to_path_buf(),
        memory_bytes: options.memory.bytes(),
        info: read_info(output)?,
        cleaning: None,
        warnings: told(source, &report),
        hints: Vec::new(),
        report,
        wall_s,
    })
}

/// Voxels this many times as long along one axis as along another make stairs of a surface.
const UNEVEN: f64 = 3.0;

/// What may be wanted besides: of a CT that nobody chose a threshold for, and of uneven spacing.
fn hints(
    source: &dyn VolumeSource,
    threshold: Threshold,
    surface: SurfaceKind,
    report: &BuildReport,
) -> Vec<String> {
    let bone = (threshold == Threshold::Otsu && source.modality() == Some("CT"))
        .then_some(Hint::Bone { chosen: report.selection.lo });
    let spacing_mm = source.info().spacing_mm;
    let axis = (0..3).fold(0, |longest, a| if spacing_mm[a] > spacing_mm[longest] { a } else { longest });
    // Along an axis of one voxel there are no stairs, nor are there where cells follow the samples.
    let sides = source.info().dims.to_array();
    let several = (0..3).filter(|a| sides[*a] > 1).map(|a| spacing_mm[a]);
    let times = spacing_mm[axis] / several.fold(f64::INFINITY, f64::min);
    let uneven = (surface == SurfaceKind::Skin && sides[axis] > 1 && times >= UNEVEN)
        .then_some(Hint::Uneven { spacing_mm, axis, times });
    bone.into_iter().chain(uneven).map(|hint| hint.to_string()).collect()
}

/// Cleans an open source and builds its model; `started` is when the job began.
///
/// # Errors
/// As [`builder::build_volume`] and [`CleanOptions::clean`].
pub fn convert_source(
    source: Box<dyn VolumeSource>,
    input: String,
    cleaning: &CleanOptions,
    options: &BuildOptions,
    output: &Path,
    progress: &dyn Progress,
    started: Instant,
) -> Result<BuildSummary, Error> {
    convert_reshaped(cleaning.reshape(source)?, input, cleaning, options, output, progress, started)
}

/// As [`convert_source`], of a source that [`CleanOptions::reshape`] has cut and shrunk already.
///
/// # Errors
/// As [`convert_source`].
pub fn convert_reshaped(
    mut source: Box<dyn VolumeSource>,
    input: String,
    cleaning: &CleanOptions,
    options: &BuildOptions,
    output: &Path,
    progress: &dyn Progress,
    started: Instant,
) -> Result<BuildSummary, Error> {
    let mut options = options.clone();
    let threshold = cleaning.preset.map_or(options.threshold, |preset| preset.threshold());
    let doubt = cleaning.preset.and_then(|preset| {
        options.threshold = preset.threshold();
        preset.doubt(source.modality())
    });
    prepare(&mut *source, cleaning, &options, output, progress)?;
    give_back();
    let cleaned = cleaning.clean(&*source, &options, output, progress)?;
    if cleaned.is_some() {
        give_back();
    }
    let report = match &cleaned {
        Some(cleaned) => {
            options.threshold = Threshold::Chosen(cleaned.selection);
            builder::build_volume(cleaned.source(), &options, output, progress)?
        }
        None => builder::build_volume(&*source, &options, output, progress)?,
    };
    // What is told of the model runs beside the last stage's code otherwise.
    give_back();
    let wall_s = started.elapsed().as_secs_f64();
    let mut warnings = told(&*source, &report);
    warnings.extend(doubt.map(|doubt| doubt.to_string()));
    warnings.extend(cleaned.as_ref().and_then(|cleaned| cleaned.report.note).map(|note| note.to_string()));
    let hints = hints(&*source, threshold, options.surface, &report);
    Ok(BuildSummary {
        input,
        output: output.to_path_buf(),
        memory_bytes: options.memory.bytes(),
        report,
        info: read_info(output)?,
        cleaning: (!cleaning.is_empty()).then(|| (cleaning.operations(), cleaned.map(|c| c.report))),
        warnings,
        hints,
        wall_s,
    })
}

/// Sentences about the input, and about what was found in it.
fn told(source: &dyn VolumeSource, report: &BuildReport) -> Vec<String> {
    let mut all = sentences(&source.info().notes);
    all.extend(report.notes.iter().map(|note| note.to_string()));
    all
}

/// Unrolls a source that has to be, unless the cap would be too small for that or for what follows.
pub(super) fn prepare(
    source: &mut dyn VolumeSource,
    cleaning: &CleanOptions,
    options: &BuildOptions,
    output: &Path,
    progress: &dyn Progress,
) -> Result<(), Error> {
    let needs = source.preparation();
    if needs == Preparation::default() {
        return Ok(());
    }
    give_back();
    let scratch = options.scratch_folder(output);
    let cap = options.memory;
    // What unrolling is said to need is the most it can be; it refuses for itself.
    if matches!(cap, MemoryCap::Process(_))
        && builder::reserve_least(source, options, &Budget::of_job(cap)).is_err()
    {
        let unrolling = Budget::dry(cap);
        drop(unrolling.reserve(needs.memory_bytes));
        let follows = cleaning.smallest_cap(source, options, cap);
        return Err(Error::Build(BuildError::BudgetTooSmall {
            name: source.info().description.name.clone(),
            limit_bytes: cap.bytes(),
            minimum_bytes: follows.max(unrolling.smallest_limit(1)),
        }));
    }
    Ok(source.prepare(&Workspace { scratch: &scratch, memory: Budget::of(cap), progress })?)
}

impl BuildSummary {
    /// One JSON object with the keys of the command contract.
    pub fn json(&self) -> Value {
        let r = &self.report;
        let mut facts = static_facts(&self.info.frame);
        let mut put = |key: &str, value: Value| facts.insert(key.to_owned(), value);
        put("input", json!(self.input));
        put("output", json!(data(&self.output)));
        put("memory_budget_bytes", json!(self.memory_bytes));
        put("memory_plan_bytes", json!(r.plan_bytes));
        put("peak_rss_bytes", json!(peak_rss_bytes()));
        put("scratch_bytes", json!(r.scratch_bytes));
        put("threads", json!(r.threads));
        put("tile_columns", json!(r.tile));
        let s = &r.seconds;
        put("read_s", json!(s.read));
        put("build_s", json!(s.histogram + s.sight + s.scan - s.read + s.merge));
        put("write_s", json!(s.seal + s.commit));
        put("wall_s", json!(self.wall_s));
        put(
            "stages_s",
            json!({
                "histogram": s.histogram, "scan": s.scan, "merge": s.merge, "seal": s.seal, "commit": s.commit
            }),
        );
        if let Some(hidden) = r.hidden {
            put(
                "sight",
                json!({ "hidden": hidden, "bytes_saved_about": r.bytes_saved_about(), "seconds": s.sight }),
            );
        }
        if let Some((operations, report)) = &self.cleaning {
            put("cleaning", cleaning_json(operations, report.as_ref()));
        }
        put("warnings", json!(self.warnings));
        put("hints", json!(self.hints));
        Value::Object(facts)
    }

    /// A few lines for people.
    pub fn text(&self) -> String {
        let r = &self.report;
        let metadata = &self.info.frame.metadata;
        let range = if !super::info::has_values(metadata) {
            metadata.source.kind.clone()
        } else if r.selection.hi.is_finite() {
            format!("values {}..{}", Short(r.selection.lo), Short(r.selection.hi))
        } else {
            format!(
                "values {} and more ({})",
                Short(r.selection.lo),
                super::info::kind_name(r.selection.kind)
            )
        };
        #[expect(clippy::cast_precision_loss, reason = "a ratio for people")]
        let per_voxel = r.file_bytes as f64 / r.skin_voxels.max(1) as f64;
        let (kept, one) = match self.info.frame.surface() {
            SurfaceKind::Skin if r.skin_voxels == 1 => ("skin voxel", "skin voxel"),
            SurfaceKind::Skin => ("skin voxels", "skin voxel"),
            SurfaceKind::Cells if r.skin_voxels == 1 => ("cell", "cell"),
            SurfaceKind::Cells => ("cells", "cell"),
        };
        let [x, y, z] = self.info.frame.metadata.dims;
        let mut text = format!(
            "{}: {} {kept} of {x}x{y}x{z}, {range}\n  {} ({per_voxel:.3} bytes per {one}), {} nodes\n  {:.2} s with {}, peak resident memory {} of {} allowed\n",
            shown(&self.output),
            r.skin_voxels,
            Bytes(r.file_bytes),
            r.nodes,
            self.wall_s,
            if r.threads == 1 { "1 thread".to_owned() } else { format!("{} threads", r.threads) },
            Bytes(peak_rss_bytes()),
            Bytes(self.memory_bytes),
        );
        if let Some(hidden) = r.hidden {
            text.push_str(&format!(
                "  left out: {hidden} {kept} that cannot be seen from there, about {}\n",
                Bytes(r.bytes_saved_about())
            ));
        }
        if let Some((operations, report)) = &self.cleaning {
            text.push_str(&format!("  cleaned: {}", operations.join(", ")));
            if let Some(r) = report {
                text.push_str(&format!("; {} voxels added, {} removed", r.voxels_added, r.voxels_removed));
                if r.components > 0 {
                    text.push_str(&format!(", {} of {} components kept", r.kept, r.components));
                }
            }
            text.push('\n');
        }
        for warning in &self.warnings {
            text.push_str(&format!("  note: {warning}\n"));
        }
        for hint in &self.hints {
            text.push_str(&format!("  hint: {hint}\n"));
        }
        text
    }
}

/// The `cleaning` object: all its keys are always there; the figures are 0 where the occupancy was not touched.
fn cleaning_json(operations: &[String], report: Option<&CleanReport>) -> Value {
    json!({
        "operations": operations,
        "passes": {
            "volume": report.map_or(0, |r| r.passes.volume),
            "occupancy": report.map_or(0, |r| r.passes.occupancy),
        },
        "voxels": report.map(|r| r.voxels),
        "voxels_added": report.map_or(0, |r| r.voxels_added),
        "voxels_removed": report.map_or(0, |r| r.voxels_removed),
        "components": report.map_or(0, |r| r.components),
        "kept": report.map_or(0, |r| r.kept),
        "scratch_bytes": report.map_or(0, |r| r.scratch_bytes),
        "seconds": report.map_or(0.0, |r| r.seconds),
    })
}
