//! A model of labels as triangles, a part for each label, in one file or a file for each; or as the map of its labels.

use std::collections::HashSet;
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::time::Instant;

use serde::Serialize;

use super::{
    ExportReport, ExportRequest, MAX_SMOOTH, exporter_of, failed, folder_of, is_far, refuse_input,
    refuse_part, warnings,
};
use crate::atomic::AtomicFile;
use crate::budget::peak_rss_bytes;
use crate::error::{Error, UsageError};
use crate::export::{Exported, LabelMesh, part_name};
use crate::format::Label;
use crate::jobs::opened::open_model;
use crate::jobs::verify::verify_unless_packed;
use crate::load::Model;
use crate::progress::Progress;
use crate::render::GridSpace;
use crate::text::data;

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
/// The surfaces are those of [`export`](super::export) to one file: closed, and where two labels touch both have the
/// same triangles. Memory, disk and cost are those of one file.
///
/// # Errors
/// As [`export`](super::export); the model has no labels. Files of labels before the one that failed stay.
pub fn export_each(
    input: &Path,
    folder: &Path,
    request: ExportRequest,
    progress: &dyn Progress,
) -> Result<ExportReport, Error> {
    let start = Instant::now();
    refuse_input(input, folder)?;
    verify_unless_packed(input)?;
    let model = open_model(input)?;
    if model.frame().labels.is_empty() {
        return Err(UsageError::OneSurface { path: input.to_path_buf() }.into());
    }
    refuse_part(&model, input, request)?;
    let unwritable = |path: &Path, cause| Error::Output { path: path.to_path_buf(), cause };
    fs::create_dir_all(folder).map_err(|cause| unwritable(folder, cause))?;
    let mesh = mesh(input, folder, folder, &model, request, progress)?;
    let (mut made, mut bytes, mut outputs) = (Exported::default(), 0, Vec::new());
    for (part, name) in names(mesh.labels()).into_iter().enumerate() {
        let path = folder.join(format!("{name}.{}", request.form.suffix()));
        let out = AtomicFile::create(&path).map_err(|cause| unwritable(&path, cause))?;
        let copy = out.file().try_clone().map_err(|cause| unwritable(&path, cause))?;
        let of_part = mesh
            .write(request.form, copy, folder, part..part + 1)
            .map_err(|stop| failed(stop, &model, input, &path))?;
        bytes += out.file().metadata().map_err(|cause| unwritable(&path, cause))?.len();
        if progress.stopped() {
            return Err(Error::Stopped);
        }
        out.commit().map_err(|cause| unwritable(&path, cause))?;
        made.vertices += of_part.vertices;
        made.triangles += of_part.triangles;
        made.unknown = of_part.unknown;
        outputs.push(path);
    }
    Ok(report([input, folder], request, &model, Some(&mesh), (made, bytes, start, outputs)))
}

/// Writes all labels of a model into one file: their surfaces, or their map.
pub(super) fn export_labels(
    input: &Path,
    output: &Path,
    model: &Model,
    request: ExportRequest,
    progress: &dyn Progress,
) -> Result<ExportReport, Error> {
    let start = Instant::now();
    let unwritable = |cause: io::Error| Error::Output { path: output.to_path_buf(), cause };
    let out = AtomicFile::create(output).map_err(unwritable)?;
    let copy = out.file().try_clone().map_err(unwritable)?;
    let folder = folder_of(output);
    let (made, surfaces) = if request.form.is_mask() {
        (map(input, output, model, request, copy, progress)?, None)
    } else {
        let mesh = mesh(input, output, folder, model, request, progress)?;
        let made = mesh.write(request.form, copy, folder, 0..mesh.labels().len());
        (made.map_err(|stop| failed(stop, model, input, output))?, Some(mesh))
    };
    let bytes = out.file().metadata().map_err(unwritable)?.len();
    if progress.stopped() {
        return Err(Error::Stopped);
    }
    out.commit().map_err(unwritable)?;
    Ok(report([input, output], request, model, surfaces.as_ref(), (made, bytes, start, Vec::new())))
}

/// Writes the labels of all voxels.
fn map(
    input: &Path,
    output: &Path,
    model: &Model,
    request: ExportRequest,
    out: File,
    progress: &dyn Progress,
) -> Result<Exported, Error> {
    let space = GridSpace::new(model.dims(), &model.affine())?;
    let (view, give_back) = (model.view(), || model.give_back());
    let exporter = exporter_of(model, &view, &space, request, &give_back);
    let made = exporter
        .label_map(&model.frame().labels, request.form, out, progress)
        .map_err(|stop| failed(stop, model, input, output))?;
    model.check_unchanged(input)?;
    Ok(made)
}

/// The surfaces of all labels, made and checked.
fn mesh(
    input: &Path,
    output: &Path,
    scratch: &Path,
    model: &Model,
    request: ExportRequest,
    progress: &dyn Progress,
) -> Result<LabelMesh, Error> {
    if request.simplify > 0 {
        let (path, doing) = (input.to_path_buf(), "simplified");
        return Err(UsageError::Labels { path, doing }.into());
    }
    let space = GridSpace::new(model.dims(), &model.affine())?;
    let view = model.view();
    let give_back = || model.give_back();
    let exporter = exporter_of(model, &view, &space, request, &give_back);
    let smooth = request.smooth.unwrap_or(MAX_SMOOTH);
    if !(0.0..=MAX_SMOOTH).contains(&smooth) {
        return Err(UsageError::SmoothRange { path: input.to_path_buf() }.into());
    }
    let mesh = exporter
        .label_mesh(&model.frame().labels, smooth, scratch, progress)
        .map_err(|stop| failed(stop, model, input, output))?;
    model.check_unchanged(input)?;
    Ok(mesh)
}

/// Bytes of a label's name in that of its file: file systems hold 255.
const MAX_NAME: usize = 200;

/// Names of files: those of labels, with the number where there is none or where a label before has the same.
fn names(labels: &[Label]) -> Vec<String> {
    let mut taken = HashSet::new();
    let plain = |c: char| if c.is_alphanumeric() || matches!(c, '-' | '_' | '.') { c } else { '_' };
    labels
        .iter()
        .map(|label| {
            let name: String = part_name(label).chars().map(plain).collect();
            // Not hidden, and no option.
            let mut name = name.trim_start_matches(['.', '-']).to_owned();
            while name.len() > MAX_NAME {
                name.pop();
            }
            while name.is_empty() || !taken.insert(name.to_lowercase()) {
                name.push_str(&format!("_{}", label.number));
            }
            name
        })
        .collect()
}

/// What was written: counts, bytes, when it began, and the files of labels, if each has one.
type Written = (Exported, u64, Instant, Vec<PathBuf>);

fn report(
    [input, output]: [&Path; 2],
    request: ExportRequest,
    model: &Model,
    mesh: Option<&LabelMesh>,
    (made, bytes, start, outputs): Written,
) -> ExportReport {
    let is_far = request.form.has_coordinates() && is_far(&model.affine(), model.dims());
    let surfaces = mesh.map_or_else(Vec::new, |mesh| {
        let figures = |(part, label): (usize, &Label)| {
            let [vertices, triangles] = mesh.counts(part);
            let output = outputs.get(part).map(|path| data(path));
            LabelSurface { number: label.number, name: label.name.clone(), vertices, triangles, output }
        };
        mesh.labels().iter().enumerate().map(figures).collect()
    });
    ExportReport {
        input: data(input),
        output: data(output),
        form: request.form,
        vertices: made.vertices,
        triangles: made.triangles,
        inside_voxels: made.inside,
        unknown_voxels: made.unknown,
        surfaces,
        is_far,
        warnings: warnings(made.unknown, is_far),
        apart_voxels: None,
        bytes,
        peak_rss_bytes: peak_rss_bytes(),
        wall_s: start.elapsed().as_secs_f64(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_of_labels_are_named_once_and_stay_in_their_folder() {
        let label = |number, name: &str| Label { number, name: name.into(), color: [0; 3], voxels: 1 };
        let labels = [label(1, "liver"), label(2, ""), label(3, "Liver"), label(7, "../a b"), label(9, "..")];
        assert_eq!(names(&labels), ["liver", "label_2", "Liver_3", "_a_b", "_9"]);
        let labels = [label(1, "x"), label(2, "x_3"), label(3, "x"), label(4, &"肝".repeat(100))];
        let names = names(&labels);
        assert_eq!(names[..3], ["x", "x_3", "x_3_3"]);
        assert_eq!(names[3], "肝".repeat(66));
    }
}
