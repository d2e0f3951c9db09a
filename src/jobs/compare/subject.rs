//! An input of a comparison: a model, or what a model can be built of.

use std::fs::File;
use std::io::Read;

use super::super::build::{BuildJob, GridOptions, convert};
use super::super::open_model::open_model;
use super::super::verify::verify_unless_packed;
use super::*;
use crate::budget::Budget;
use crate::builder::BuildFault;
use crate::clean::CleanOptions;
use crate::csg::unmoved_volumes;
use crate::fault::{FaultKind, bad};
use crate::format::MAGIC;
use crate::measure::nearest::Space;
use crate::mesh::GridChoice;
use crate::source::{OpenOptions, Subject, SubjectKind};
use crate::volume::SourceError;

/// Voxels left free around a mesh, so that its surface keeps off the border.
const MARGIN: u32 = 2;

/// A model, opened or built.
pub(super) struct Input {
    pub(super) path: PathBuf,
    pub(super) model: Model,
    /// Spacing of the grid that was built.
    pub(super) grid_mm: Option<f64>,
    pub(super) warnings: Vec<String>,
    /// Folder of the model that was built.
    _folder: Option<tempfile::TempDir>,
}

/// Refuses a model, a volume or the volumes of a tree whose axes are unfit, before anything is built. Faults in opening
/// one are left to [`Input::open`].
pub(super) fn refuse_unfit(path: &Path, request: &CompareRequest) -> Result<(), Error> {
    let refuse = |path: &Path, affine: &Affine| -> Result<(), Error> {
        Space::new(affine).map(drop).map_err(|fault| fault.at(path).into())
    };
    if is_model(path) {
        return Model::map(path).map_or(Ok(()), |model| refuse(path, &model.affine()));
    }
    let inputs = [path.to_path_buf()];
    let volumes = match SubjectKind::of(&inputs) {
        SubjectKind::Volume => inputs.to_vec(),
        SubjectKind::Tree => unmoved_volumes(path, request.memory),
        SubjectKind::Mesh => Vec::new(),
    };
    volumes.iter().try_for_each(|volume| {
        let opening_bytes = Some(Budget::of(request.memory).left_bytes());
        let how = OpenOptions { opening_bytes, ..OpenOptions::default() };
        let one = std::slice::from_ref(volume);
        match Subject::open_as(SubjectKind::Volume, one, &how, &std::env::temp_dir()) {
            Ok(Subject::Volume(source)) => refuse(volume, &source.info().affine),
            _ => Ok(()),
        }
    })
}

impl Input {
    /// Opens a model, or builds one in a folder next to `beside`; meshes and trees on voxels of `edge_mm`, if it is given.
    pub(super) fn open(
        path: &Path,
        edge_mm: Option<f64>,
        request: &CompareRequest,
        beside: &Path,
        progress: &dyn Progress,
    ) -> Result<Self, Error> {
        if is_model(path) {
            verify_unless_packed(path)?;
            let model = open_model(path)?;
            let (path, warnings) = (path.to_path_buf(), Vec::new());
            return Ok(Self { path, model, grid_mm: None, warnings, _folder: None });
        }
        let unwritable = |cause| Error::Output { path: std::env::temp_dir(), cause };
        let near = beside.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let folder = tempfile::tempdir_in(near).or_else(|_| tempfile::tempdir()).map_err(unwritable)?;
        let built = folder.path().join("built.oct");
        let inputs = [path.to_path_buf()];
        let kind = SubjectKind::of(&inputs);
        let grid = edge_mm.map(|edge_mm| GridChoice::Voxel { edge_mm, margin: MARGIN });
        let options = BuildOptions {
            uncertainty: kind == SubjectKind::Volume,
            threshold: request.threshold,
            memory: request.memory,
            threads: request.threads,
            ..BuildOptions::default()
        };
        let job = BuildJob {
            clean: &CleanOptions::default(),
            grid: &GridOptions { grid, ..GridOptions::default() },
            options: &options,
            output: &built,
            progress,
        };
        let summary = convert(kind, &inputs, &OpenOptions::default(), &job).map_err(|error| {
            match edge_mm {
                // The grid is ACTUAL's, not one of the caller's choice.
                Some(edge) if is_too_long(&error) => SourceError::from(bad!(
                    "needs too large a grid on voxels of {} mm, half as long as those of ACTUAL; scale one of them to the other's unit, or make a model of it with `oct build`, and compare that",
                    crate::text::Short(edge)
                )
                .at(path))
                .into(),
                _ => error,
            }
        })?;
        let model = Model::map(&built)?;
        let edge = model.affine().spacing_mm().into_iter().fold(f64::INFINITY, f64::min);
        let mut warnings = summary.warnings;
        if kind == SubjectKind::Mesh {
            warnings.push(format!(
                "{} was made into cells of {} mm, in which thinner walls may be lost: the largest distances may be theirs",
                crate::text::shown(path),
                crate::text::Short(edge)
            ));
        }
        Ok(Self { path: path.to_path_buf(), grid_mm: Some(edge), model, warnings, _folder: Some(folder) })
    }
}

/// True if the grid of a mesh or a tree would be too large.
fn is_too_long(error: &Error) -> bool {
    match error {
        Error::Source(error) => error.has_kind(FaultKind::LongGrid),
        Error::Build(error) => {
            matches!(error.fault(), BuildFault::Source(error) if error.has_kind(FaultKind::LongGrid))
        }
        _ => false,
    }
}

fn is_model(path: &Path) -> bool {
    let mut head = [0; MAGIC.len()];
    let is_file = std::fs::metadata(path).is_ok_and(|meta| meta.is_file());
    let suffix = path.extension().is_some_and(|suffix| suffix == "oct");
    suffix
        || is_file
            && File::open(path).is_ok_and(|mut file| file.read_exact(&mut head).is_ok() && head == MAGIC)
}
