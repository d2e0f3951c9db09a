//! A model of labels as triangles, a part for each label, in one file or a file for each; or as the map of its labels.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use serde::Serialize;

use super::{
    ExportReport, ExportRequest, MAX_SMOOTH, commit, exported, failed, folder_of, one_surface, refuse_input,
    refuse_part, report,
};
use crate::atomic::AtomicFile;
use crate::error::Error;
use crate::export::{Exported, LabelMesh};
use crate::fault::{Fault, usage};
use crate::format::Label;
use crate::jobs::names::file_names;
use crate::jobs::open_model::open_model;
use crate::jobs::scene::{no_label, unlabelled};
use crate::jobs::verify::verify_unless_packed;
use crate::load::Model;
use crate::progress::Progress;
use crate::scene::label_parts;
use crate::text::data;
use crate::text::names::{RANGE, SMOOTH};

/// The surface of one label, as it was written.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct LabelSurface {
    /// Number of the label in the volume.
    pub number: u16,
    /// Name of the label; empty if it has none.
    pub name: String,
    /// Corners of its triangles.
    pub vertices: u64,
    /// Triangles of the label.
    pub triangles: u64,
    /// The label's own file, if each has one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub output: Option<String>,
}

/// Writes the surface of each label of the model at `input` into a file of its own in `folder`, which is made if it is
/// missing. Files are named by the labels' names, with their numbers where names are missing or the same.
///
/// The surfaces are the same as [`export`](super::export) writes to one file: closed, and with common triangles where
/// two labels touch. Memory, disk and cost are the same as for one file.
///
/// # Errors
/// As [`export`](super::export); the model has no labels. Files of labels before the one that failed stay.
pub fn export_each(
    input: &Path,
    folder: &Path,
    request: ExportRequest<'_>,
    progress: &dyn Progress,
) -> Result<ExportReport, Error> {
    let start = Instant::now();
    refuse_input(input, folder)?;
    verify_unless_packed(input)?;
    let model = open_model(input)?;
    if model.frame().labels.is_empty() {
        return Err(one_surface(input).into());
    }
    refuse_part(&model, input, request)?;
    let unwritable = |path: &Path, cause| Error::Output { path: path.to_path_buf(), cause };
    fs::create_dir_all(folder).map_err(|cause| unwritable(folder, cause))?;
    let mesh = mesh([input, folder], folder, &model, request, progress)?;
    let (mut made, mut bytes, mut outputs) = (Exported::default(), 0, Vec::new());
    for (part, name) in file_names(mesh.labels()).into_iter().enumerate() {
        let path = folder.join(format!("{name}.{}", request.form.suffix()));
        let out = AtomicFile::create(&path).map_err(|cause| unwritable(&path, cause))?;
        let of_part = mesh
            .write(request.form, out.file(), folder, part..part + 1)
            .map_err(|stop| failed(stop, &model, input, &path))?;
        bytes += commit(out, &path, progress)?;
        made = Exported {
            vertices: made.vertices + of_part.vertices,
            triangles: made.triangles + of_part.triangles,
            is_closed: Some(made.is_closed != Some(false) && of_part.is_closed == Some(true)),
            ..of_part
        };
        outputs.push(path);
    }
    let surfaces = surfaces(&mesh, &outputs);
    Ok(report([input, folder], request, &model, (made, bytes, surfaces), start))
}

/// Writes all labels of a model into one file: their surfaces, or their map.
pub(super) fn export_labels(
    input: &Path,
    output: &Path,
    model: &Model,
    request: ExportRequest<'_>,
    progress: &dyn Progress,
) -> Result<ExportReport, Error> {
    let start = Instant::now();
    let out =
        AtomicFile::create(output).map_err(|cause| Error::Output { path: output.to_path_buf(), cause })?;
    let folder = folder_of(output);
    let (made, surfaces) = if request.form.is_mask() {
        let is_wanted = wanted(model, input, request)?;
        let labels = model.frame().labels.iter().zip(is_wanted).filter(|(_, is_wanted)| *is_wanted);
        let numbers: Vec<u16> = labels.map(|(label, _)| label.number).collect();
        let made = exported(model, [input, output], request, |exporter| {
            exporter.label_map(&numbers, request.form, out.file(), progress)
        })?;
        (made, Vec::new())
    } else {
        let mesh = mesh([input, output], folder, model, request, progress)?;
        let made = mesh.write(request.form, out.file(), folder, 0..mesh.labels().len());
        (made.map_err(|stop| failed(stop, model, input, output))?, surfaces(&mesh, &[]))
    };
    let bytes = commit(out, output, progress)?;
    Ok(report([input, output], request, model, (made, bytes, surfaces), start))
}

/// A model of labels, which something cannot be done to.
pub(in crate::jobs) fn with_labels(doing: &str, input: &Path) -> Fault {
    usage!("has labels, and cannot be {doing} yet with them; build one of its labels by its range of values ({RANGE})")
        .at(input)
}

/// The surfaces of all labels, made and checked.
fn mesh(
    paths: [&Path; 2],
    scratch: &Path,
    model: &Model,
    request: ExportRequest<'_>,
    progress: &dyn Progress,
) -> Result<LabelMesh, Error> {
    let smooth = request.smooth.unwrap_or(MAX_SMOOTH);
    if !(0.0..=MAX_SMOOTH).contains(&smooth) {
        let fault = usage!("walls are moved by 0 to half a voxel; choose {SMOOTH} in between");
        return Err(fault.at(paths[0]).into());
    }
    let wanted = wanted(model, paths[0], request)?;
    exported(model, paths, request, |exporter| {
        exporter.label_mesh(&model.frame().labels, &wanted, smooth, scratch, progress)
    })
}

/// For each label of a model, true if it is written.
pub(super) fn wanted<D: AsRef<[u8]>>(
    model: &Model<D>,
    path: &Path,
    request: ExportRequest<'_>,
) -> Result<Vec<bool>, Fault> {
    let (table, rules) = (&model.frame().labels, request.labels);
    if table.is_empty() && !rules.is_empty() {
        return Err(unlabelled(path));
    }
    let parts = label_parts(rules, table).map_err(|pick| no_label(pick, table, path))?;
    let wanted: Vec<bool> = parts.into_iter().map(|part| part > 0.0).collect();
    if !rules.is_empty() && !wanted.contains(&true) {
        return Err(usage!("no label is left to write; name one that is not left out").at(path));
    }
    Ok(wanted)
}

/// The surface of each label, with its file, if each has one.
fn surfaces(mesh: &LabelMesh, outputs: &[PathBuf]) -> Vec<LabelSurface> {
    let figures = |(part, (label, [vertices, triangles])): (usize, (&Label, [u64; 2]))| {
        let output = outputs.get(part).map(|path| data(path));
        LabelSurface { number: label.number, name: label.name.clone(), vertices, triangles, output }
    };
    mesh.labels().iter().zip(mesh.counts()).enumerate().map(figures).collect()
}
