//! `oct build --each`: a model of all labels, split into one for each label.

use std::fs;
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::{BuildJob, BuildSummary, convert};
use crate::atomic::{sweep, temporary_name};
use crate::error::Error;
use crate::fault::usage;
use crate::jobs::batch::NewFolders;
use crate::jobs::names::file_names;
use crate::jobs::pack::split;
use crate::source::{OpenOptions, SubjectKind};
use crate::text::data;
use crate::text::names::FORCE;

/// Outputs of the models of labels.
#[derive(Clone, Copy, Debug)]
pub struct EachLabel<'a> {
    /// Their folder; made if it is not there.
    pub folder: &'a Path,
    /// True if existing files are replaced.
    pub replace: bool,
    /// True if the model of all labels, [`BuildJob::output`], stays.
    pub keep_whole: bool,
}

/// The model of one label, as it was written.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct LabelModel {
    /// Number of the label in the volume.
    pub number: u16,
    /// Name of the label; empty if it has none.
    pub name: String,
    /// The label's own file.
    pub output: String,
    /// Voxels of the volume with this label.
    pub voxels: u64,
    /// Cells of the model.
    pub skin_voxels: u64,
    /// Size of the file that was written or read.
    pub bytes: u64,
}

/// As [`convert`] for a build of labels, and a model of each label in a file of its own, named by the label. The volume
/// is read once: each model is taken from the model of all labels, and neighbours share their walls exactly.
///
/// Memory as for the build, within its cap. Temporary disk: 12 bytes more for each label of a cell.
/// Cost: about as much as the build again, and a sync of each file.
///
/// # Errors
/// As [`convert`]; a file of that name exists and is not to be replaced: then no model of a label is written. Models of
/// labels before one that failed stay, each whole.
pub fn convert_each(
    kind: SubjectKind,
    inputs: &[PathBuf],
    how: &OpenOptions,
    job: &BuildJob<'_>,
    each: EachLabel<'_>,
) -> Result<BuildSummary, Error> {
    build_each(job, each, |job| convert(kind, inputs, how, job))
}

/// As [`convert_each`], for any `build`.
pub(crate) fn build_each(
    job: &BuildJob<'_>,
    each: EachLabel<'_>,
    build: impl FnOnce(&BuildJob<'_>) -> Result<BuildSummary, Error>,
) -> Result<BuildSummary, Error> {
    let EachLabel { folder, .. } = each;
    let _new =
        NewFolders::create(folder).map_err(|cause| Error::Output { path: folder.to_path_buf(), cause })?;
    sweep(folder);
    if each.keep_whole {
        let built = build(job)?;
        return write(built, job.output, job, each);
    }
    let whole = folder.join(temporary_name());
    let built = build(&BuildJob { output: &whole, ..*job });
    let made = built.and_then(|built| write(built, &whole, job, each));
    let _ = fs::remove_file(&whole);
    made.map(|made| BuildSummary { output: folder.to_path_buf(), ..made })
}

fn write(
    built: BuildSummary,
    whole: &Path,
    job: &BuildJob<'_>,
    each: EachLabel<'_>,
) -> Result<BuildSummary, Error> {
    let labels = &built.info.frame.labels;
    let path_of = |name: String| each.folder.join(format!("{name}.oct"));
    let outputs: Vec<PathBuf> = file_names(labels).into_iter().map(path_of).collect();
    if let Some(there) = outputs.iter().find(|path| !each.replace && path.exists()) {
        let fault = usage!("already exists; {FORCE} replaces it, and the models of the other labels");
        return Err(fault.at(there).into());
    }
    job.give_back();
    let scratch = job.options.scratch_folder(&each.folder.join("x"));
    let made = split((whole, &built.input), &outputs, &scratch, job.options.memory, job.progress)?;
    let mut each = Vec::with_capacity(labels.len());
    for ((label, output), [skin_voxels, bytes]) in labels.iter().zip(&outputs).zip(made) {
        if skin_voxels > 0 {
            let (number, name, voxels) = (label.number, label.name.clone(), label.voxels);
            each.push(LabelModel { number, name, output: data(output), voxels, skin_voxels, bytes });
        }
    }
    Ok(BuildSummary { each, ..built })
}
