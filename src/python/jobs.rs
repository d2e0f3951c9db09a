//! Builds, packing, checking and exports.

use std::ffi::CString;
use std::path::{Path, PathBuf};
use std::time::Instant;

use numpy::PyReadonlyArray1;
use pyo3::exceptions::PyUserWarning;
use pyo3::prelude::*;
use serde::{Deserialize, Serialize};

use super::failure::{raised, usage};
use super::options::{BuildAsked, only_labels, read};
use super::samples::StoredSamples;
use super::watch::watched;
use crate::budget::MemoryCap;
use crate::builder::{BuildNote, Threshold};
use crate::error::Error;
use crate::export::ExportForm;
use crate::geom::{Affine, Dims};
use crate::jobs::build::{BuildJob, BuildSummary, Built, build_each, convert, convert_each, is_other_kind};
use crate::jobs::compare::{CompareOutputs, CompareRequest};
use crate::jobs::export::ExportRequest;
use crate::jobs::pack::{pack_with, unpack_with};
use crate::jobs::picture::{Outputs, render_file};
use crate::jobs::pores::PoresRequest;
use crate::jobs::render::RenderRequest;
use crate::jobs::thickness::{Method, ThicknessOutputs, ThicknessRequest};
use crate::progress::Progress;
use crate::source::SubjectKind;
use crate::text::shown;
use crate::volume::{ScalarType, SourceError, VolumeSource, VolumeView, sentences};

type Watcher<'a, 'py> = Option<&'a Bound<'py, PyAny>>;

fn json(py: Python<'_>, report: &impl Serialize) -> PyResult<String> {
    serde_json::to_string(report).map_err(|error| usage(py, &error.to_string()))
}

/// Refuses the name of another kind of file for a model.
#[pyfunction]
pub(super) fn check_name(py: Python<'_>, output: PathBuf) -> PyResult<()> {
    let suffix = output.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    if suffix != "png" && !is_other_kind(&suffix) {
        return Ok(());
    }
    let name = shown(&output);
    Err(usage(
        py,
        &format!("{name}: is named as another kind of file; name the model .oct, or add force=True"),
    ))
}

/// Builds the inputs at some paths.
#[pyfunction]
pub(super) fn build_files(
    py: Python<'_>,
    paths: Vec<PathBuf>,
    output: PathBuf,
    asked: &str,
    progress: Watcher<'_, '_>,
) -> PyResult<String> {
    let asked: BuildAsked = read(py, asked)?;
    let wrong = |sentence: String| usage(py, &sentence);
    let how = asked.opening().map_err(wrong)?;
    let kind = if how.raw.is_some() { SubjectKind::Volume } else { SubjectKind::of(&paths) };
    let (options, clean, grid) = asked.all().map_err(wrong)?;
    let summary = watched(py, progress, |progress| {
        let job = BuildJob { clean: &clean, grid: &grid, options: &options, output: &output, progress };
        match asked.each() {
            Some(each) => convert_each(kind, &paths, &how, &job, each),
            None => convert(kind, &paths, &how, &job),
        }
    })?;
    warn(py, &summary)?;
    json(py, &summary.json())
}

/// Warns of samples that are NaN or infinite.
fn warn(py: Python<'_>, summary: &BuildSummary) -> PyResult<()> {
    let is_of_samples = |note: &&BuildNote| matches!(note, BuildNote::NotNumbers | BuildNote::Infinite);
    for note in summary.report.notes.iter().filter(is_of_samples) {
        let text = CString::new(note.to_string())?;
        PyErr::warn(py, &py.get_type::<PyUserWarning>(), &text, 2)?;
    }
    Ok(())
}

/// Sides, and the type of the samples.
type Layout = ([u32; 3], String);

fn layout(py: Python<'_>, ([x, y, z], dtype): &Layout) -> PyResult<(Dims, ScalarType)> {
    let dims = Dims::new(*x, *y, *z).ok_or_else(|| {
        usage(py, &format!("an array of {z} x {y} x {x} cannot be built; each side is 1 to 65536"))
    })?;
    let scalar =
        ScalarType::parse(dtype).ok_or_else(|| usage(py, &format!("{dtype} is not a sample type")))?;
    Ok((dims, scalar.0))
}

/// Builds samples in memory: bytes, the byte of voxel (0, 0, 0), bytes from a voxel to the next along x, y, z.
#[pyfunction]
pub(super) fn build_array(
    py: Python<'_>,
    bytes: PyReadonlyArray1<'_, u8>,
    strides: (usize, [isize; 3]),
    of: Layout,
    output: PathBuf,
    asked: &str,
    progress: Watcher<'_, '_>,
) -> PyResult<String> {
    let asked: BuildAsked = read(py, asked)?;
    let (dims, scalar) = layout(py, &of)?;
    let (affine, rescale) = asked.place();
    let view = VolumeView::from_bytes(dims, scalar, bytes.as_slice()?, strides.0, strides.1)
        .ok_or_else(|| usage(py, "the strides lead out of the array"))?;
    build_volume(py, &mut view.placed(affine).rescaled(rescale), &output, &asked, progress)
}

/// Builds samples in a file, contiguous from a byte on.
#[pyfunction]
pub(super) fn build_stored(
    py: Python<'_>,
    stored: (PathBuf, u64),
    of: Layout,
    output: PathBuf,
    asked: &str,
    progress: Watcher<'_, '_>,
) -> PyResult<String> {
    let asked: BuildAsked = read(py, asked)?;
    let (dims, scalar) = layout(py, &of)?;
    let (affine, rescale) = asked.place();
    let samples = StoredSamples::open(&stored.0, stored.1, dims, scalar)
        .map_err(|cause| raised(py, &Error::from(SourceError::unreadable(&stored.0, cause))))?;
    build_volume(py, &mut samples.placed(affine).rescaled(rescale), &output, &asked, progress)
}

fn build_volume(
    py: Python<'_>,
    volume: &mut dyn VolumeSource,
    output: &Path,
    asked: &BuildAsked,
    progress: Watcher<'_, '_>,
) -> PyResult<String> {
    let started = Instant::now();
    let (options, clean, grid) = asked.all().map_err(|sentence| usage(py, &sentence))?;
    let mut warnings = sentences(&volume.info().notes);
    let input = volume.info().description.name.clone();
    let build = |job: &BuildJob<'_>| {
        let BuildJob { clean, options, output, progress, .. } = *job;
        let (report, cleaned) = crate::clean_and_build(volume, clean, options, output, progress)?;
        warnings.extend(report.notes.iter().map(ToString::to_string));
        let note = cleaned.as_ref().and_then(|cleaned| cleaned.note);
        warnings.extend(note.map(|note| note.to_string()));
        job.summary(input, Built { report, cleaned, warnings, hints: Vec::new() }, started)
    };
    let summary = watched(py, progress, move |progress: &dyn Progress| {
        let job = BuildJob { clean: &clean, grid: &grid, options: &options, output, progress };
        match asked.each() {
            Some(each) => build_each(&job, each, build),
            None => build(&job),
        }
    })?;
    warn(py, &summary)?;
    json(py, &summary.json())
}

/// Packs a model, or unpacks it.
#[pyfunction]
pub(super) fn repack(
    py: Python<'_>,
    input: PathBuf,
    output: PathBuf,
    packs: bool,
    progress: Watcher<'_, '_>,
) -> PyResult<String> {
    let convert = if packs { pack_with } else { unpack_with };
    let report = watched(py, progress, |progress| convert(&input, &output, progress))?;
    json(py, &report)
}

/// Lists pores, or bodies; the report as JSON.
#[pyfunction]
pub(super) fn pores(
    py: Python<'_>,
    model: PathBuf,
    csv: Option<PathBuf>,
    asked: (bool, u64, bool),
    progress: Watcher<'_, '_>,
) -> PyResult<String> {
    let (bodies, least, gap) = asked;
    let request = PoresRequest { bodies, least, gap };
    let report = watched(py, progress, |progress| {
        crate::jobs::pores::pores(&model, request, csv.as_deref(), progress)
    })?;
    json(py, &report)
}

/// Options of a comparison.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CompareAsked {
    radius_mm: Option<f64>,
    tolerance_mm: Option<[f64; 2]>,
    angle_deg: f64,
    placement: [[f64; 4]; 3],
    fit: bool,
    threshold_sigma: Option<f64>,
    both_ways: bool,
    worst: usize,
    iso: Option<f64>,
    memory_bytes: u64,
    threads: usize,
}

/// Options of a measurement of thickness.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ThicknessAsked {
    by: Method,
    max_mm: Option<f64>,
    thin_mm: Option<f64>,
    threads: usize,
}

/// Measures the thickness of a model; the report as JSON.
#[pyfunction]
pub(super) fn thickness(
    py: Python<'_>,
    path: PathBuf,
    output: Option<PathBuf>,
    csv: Option<PathBuf>,
    asked: &str,
    progress: Watcher<'_, '_>,
) -> PyResult<String> {
    let ThicknessAsked { by, max_mm, thin_mm, threads } = read(py, asked)?;
    let request = ThicknessRequest { by, max_mm, thin_mm, threads };
    let outputs = ThicknessOutputs { model: output.as_deref(), csv: csv.as_deref() };
    let report = watched(py, progress, |progress| {
        crate::jobs::thickness::thickness(&path, &request, outputs, progress)
    })?;
    json(py, &report)
}

/// Compares two inputs; the report as JSON.
#[pyfunction]
pub(super) fn compare(
    py: Python<'_>,
    files: (PathBuf, PathBuf),
    output: Option<PathBuf>,
    csv: Option<PathBuf>,
    asked: &str,
    progress: Watcher<'_, '_>,
) -> PyResult<String> {
    let asked: CompareAsked = read(py, asked)?;
    let request = CompareRequest {
        radius_mm: asked.radius_mm,
        tolerance_mm: asked.tolerance_mm,
        angle_deg: asked.angle_deg,
        placement: Affine { rows: asked.placement },
        fit: asked.fit,
        threshold_sigma: asked.threshold_sigma,
        both_ways: asked.both_ways,
        worst: asked.worst,
        threshold: asked.iso.map_or(Threshold::Otsu, Threshold::Iso),
        memory: MemoryCap::Share(asked.memory_bytes),
        threads: asked.threads,
    };
    let outputs = CompareOutputs { model: output.as_deref(), csv: csv.as_deref() };
    let inputs = [files.0.as_path(), files.1.as_path()];
    let report =
        watched(py, progress, |progress| crate::jobs::compare::compare(inputs, &request, outputs, progress))?;
    json(py, &report)
}

#[pyfunction]
pub(super) fn verify(py: Python<'_>, path: PathBuf) -> PyResult<String> {
    let report = py.detach(|| crate::jobs::verify::verify_file(&path)).map_err(|error| raised(py, &error))?;
    json(py, &report)
}

#[pyfunction]
pub(super) fn export(
    py: Python<'_>,
    files: (PathBuf, PathBuf),
    form: Option<&str>,
    fewer: (Option<&str>, Option<u64>),
    labels: (Option<Vec<String>>, Option<f64>),
    progress: Watcher<'_, '_>,
) -> PyResult<String> {
    let ((input, output), (error, most), (only, smooth)) = (files, fewer, labels);
    let form = match form {
        Some(name) => ExportForm::ALL.into_iter().find(|form| form.name() == name),
        None => ExportForm::of(&output),
    };
    let form = form.ok_or_else(|| {
        let names = ExportForm::ALL.map(ExportForm::name).join(", ");
        usage(py, &format!("the name of the output does not say what it is; choose a form of {names}"))
    })?;
    let named = ExportForm::of(&output).map_or(form.suffix(), ExportForm::suffix);
    if named != form.suffix() {
        let (name, form, suffix) = (shown(&output), form.name(), form.suffix());
        let wrong = format!(
            "{name}: is named as another kind of file, and {form} would be written; name it .{suffix}"
        );
        return Err(usage(py, &wrong));
    }
    let of_triangles =
        [("error", error.is_some()), ("triangles", most.is_some()), ("smooth", smooth.is_some())];
    if let Some((option, _)) = of_triangles.iter().find(|(_, given)| *given && !form.has_triangles()) {
        return Err(usage(py, &format!("{option} is for triangles (stl, ply, obj, glb, 3mf); leave it out")));
    }
    let error = error.map(str::parse).transpose().map_err(|sentence: String| usage(py, &sentence))?;
    let labels = &only_labels(only.as_deref()).map_err(|sentence| usage(py, &sentence))?[..];
    let request = ExportRequest { error, triangles: most, smooth, labels, ..ExportRequest::of(form) };
    let report =
        watched(py, progress, |progress| crate::jobs::export::export(&input, &output, request, progress))?;
    json(py, &report)
}

/// Renders a scene to a PNG.
#[pyfunction]
pub(super) fn render_scene(
    py: Python<'_>,
    path: PathBuf,
    output: PathBuf,
    size: Option<[u32; 2]>,
    threads: usize,
    progress: Watcher<'_, '_>,
) -> PyResult<String> {
    let outputs = Outputs::of(&output);
    let request = RenderRequest { size, threads, ..RenderRequest::default() };
    let report = watched(py, progress, |progress| render_file(&path, &outputs, &request, progress))?;
    json(py, &report)
}
