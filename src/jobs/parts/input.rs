//! The input of parts: opened, and hashed with everything else that determines the bytes of the model.

use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;

use sha2::{Digest, Sha256};

use super::refused;
use crate::budget::MemoryCap;
use crate::builder::parts::PartId;
use crate::builder::parts::stage::Stage;
use crate::builder::{self, BuildError, BuildFault, BuildOptions, Threshold, cell_dims};
use crate::clean::Cleaned;
use crate::error::Error;
use crate::fault::{Fault, usage};
use crate::format::{Channel, SurfaceKind};
use crate::geom::Dims;
use crate::jobs::build::{BuildJob, prepare};
use crate::source::{OpenOptions, Subject, SubjectKind};
use crate::text::names::{ERROR, LABELS, UNCERTAINTY, VISIBLE_FROM};
use crate::volume::{VolumeSource, sentences};

/// Version of the layout of parts and of the contents of their digest.
const VERSION: &str = "infobyte parts 2";

/// Inputs, options and output, as for one build.
#[derive(Clone, Copy)]
pub struct PartsInput<'a> {
    /// Kind of the inputs.
    pub kind: SubjectKind,
    /// The files and folders.
    pub inputs: &'a [PathBuf],
    /// Options for opening them.
    pub how: &'a OpenOptions,
    /// Options of the build. [`BuildJob::output`] is the place of scratch files for parts of solids.
    pub job: BuildJob<'a>,
}

/// An input that is open.
pub(super) struct Opened {
    pub(super) subject: Subject,
    /// Size of the model's grid.
    pub(super) dims: Dims,
    /// The files of a solid.
    pub(super) files: Vec<PathBuf>,
    /// The stages before the parts.
    pub(super) stages: Vec<Stage>,
    /// Notes on it.
    pub(super) notes: Vec<String>,
}

impl Opened {
    pub(super) fn volume(&self) -> Option<&dyn VolumeSource> {
        match &self.subject {
            Subject::Volume(volume) => Some(&**volume),
            Subject::Mesh(_) | Subject::Tree(_) => None,
        }
    }
}

impl PartsInput<'_> {
    fn threshold(&self) -> Threshold {
        let BuildJob { clean, options, .. } = self.job;
        clean.preset.map_or(options.threshold, |preset| preset.threshold())
    }

    /// An option of the build that a part of a model cannot support.
    fn unsupported(&self, source: Option<&dyn VolumeSource>) -> Option<Fault> {
        let BuildJob { options, .. } = self.job;
        if options.labels.is_some() {
            return Some(usage!(
                "{LABELS} cannot be used in parts yet, as the table of labels covers all parts; build the model in one piece"
            ));
        }
        let found = [
            (!options.visible_from.is_empty(), VISIBLE_FROM, ", as rays cross all of them"),
            (options.joins(), ERROR, " yet, as the distances stated by the model cover all parts"),
            (options.uncertainty, UNCERTAINTY, " yet, as noise is measured over all parts"),
        ];
        if let Some((_, option, why)) = found.into_iter().find(|(is_used, ..)| *is_used) {
            return Some(usage!("{option} cannot be used in parts{why}; leave it out"));
        }
        let wide = source.is_some_and(|source| source.info().scalar.bytes() > 2);
        (wide && options.channels().contains(Channel::Value)).then(|| {
            usage!("the channel 'value' of samples of 32 or 64 bits cannot be built in parts, as it is scaled by the extent of all values of the skin; leave it out")
        })
    }

    /// The options of a part, with the threshold of its preset.
    pub(super) fn options(&self) -> BuildOptions {
        BuildOptions { threshold: self.threshold(), ..self.job.options.clone() }
    }

    /// Opens the input, and reshapes a volume. The grid and the files of a solid are found by making it, unless they
    /// are `known`.
    pub(super) fn open(&self, known: Option<(Dims, &[String])>) -> Result<Opened, Error> {
        let refuse = |fault: Fault| {
            let path = self.inputs.first().cloned().unwrap_or_default();
            Err(refused(&path, fault.into()))
        };
        if let Some(what) = self.unsupported(None) {
            return refuse(what);
        }
        let subject = self.job.reshape(self.job.open(self.kind, self.inputs, self.how)?)?;
        let Subject::Volume(volume) = &subject else {
            let (dims, files, notes) = match known {
                Some((dims, files)) => (dims, files.iter().map(PathBuf::from).collect(), Vec::new()),
                None => self.outline(&subject)?,
            };
            return Ok(Opened { subject, dims, files, stages: Vec::new(), notes });
        };
        if let Some(what) = self.unsupported(Some(&**volume)) {
            return refuse(what);
        }
        let info = volume.info();
        let dims = match self.job.options.volume_surface() {
            SurfaceKind::Skin => info.dims,
            SurfaceKind::Cells => cell_dims(info.dims).ok_or_else(|| {
                let name = info.description.name.clone();
                Error::Build(BuildError::from(BuildFault::no_room_for_cells(name)))
            })?,
        };
        let by_otsu = self.threshold() == Threshold::Otsu;
        let mut stages = if by_otsu { Stage::of_otsu(info.scalar).to_vec() } else { Vec::new() };
        stages.extend(self.job.clean.works_on_bits().then_some(Stage::Occupancy));
        let doubt = self.job.clean.preset.and_then(|preset| preset.doubt(volume.modality()));
        let notes = sentences(&info.notes).into_iter().chain(doubt.map(|doubt| doubt.to_string())).collect();
        Ok(Opened { dims, files: Vec::new(), stages, notes, subject })
    }

    /// Grid and files of a mesh or a tree, and the notes on it.
    fn outline(&self, subject: &Subject) -> Result<(Dims, Vec<PathBuf>, Vec<String>), Error> {
        let ((dims, files), notes) = self.job.with_solid(subject, &mut |made, _| {
            let mut files = Vec::new();
            made.solid.for_each_file(&mut |path| files.push(path.to_path_buf()));
            Ok((made.solid.dims(), files))
        })?;
        Ok((dims, files, notes))
    }

    /// The digest of everything that determines the bytes of the model: program, options, and name, length and time of
    /// change of every file of the input.
    pub(super) fn digest(&self, opened: &Opened, parts: u32) -> [u8; 32] {
        let BuildJob { clean, options, grid, .. } = self.job;
        // Options that only change time and memory are set to the same values.
        let what = BuildOptions {
            memory: MemoryCap::Share(0),
            threads: 0,
            scratch: None,
            surface: Some(options.volume_surface()),
            ..options.clone()
        };
        let how = OpenOptions { opening_bytes: None, skip: None, ..self.how.clone() };
        let mut hash = Sha256::new();
        let mut take = |text: &str| {
            hash.update((text.len() as u64).to_le_bytes());
            hash.update(text);
        };
        take(VERSION);
        take(env!("CARGO_PKG_VERSION"));
        take(&format!("{what:?} {clean:?} {grid:?} {how:?} {:?} {:?} {parts}", self.kind, opened.dims));
        if let Some(info) = opened.volume().map(VolumeSource::info) {
            take(&format!("{:?} {:?} {:?}", info.scalar, info.affine, info.rescale));
        }
        let mut file = |path: &Path| {
            let state = std::fs::metadata(path).ok().filter(|meta| meta.is_file()).map(|meta| {
                let changed = meta.modified().ok().and_then(|time| time.duration_since(UNIX_EPOCH).ok());
                (meta.len(), changed)
            });
            take(&format!("{:?} {state:?}", path.file_name()));
        };
        self.inputs.iter().for_each(|path| file(path));
        opened.files.iter().for_each(|path| file(path));
        if let Some(volume) = opened.volume() {
            volume.for_each_file(&mut file);
        }
        hash.finalize().into()
    }

    /// Unrolls a volume that needs it.
    pub(super) fn prepare(&self, opened: &mut Opened, scratch_beside: &Path) -> Result<(), Error> {
        let BuildJob { clean, options, progress, .. } = self.job;
        if let Subject::Volume(volume) = &mut opened.subject {
            prepare(&mut **volume, clean, options, scratch_beside, progress)?;
            clean.mask_labels(&mut **volume, options, progress);
            self.job.give_back();
        }
        Ok(())
    }

    /// Builds some parts, one after the other; returns the number of voxels in all of them, and the notes on them.
    pub(super) fn build(
        &self,
        opened: &mut Opened,
        options: &BuildOptions,
        folder: &Path,
        ids: &[PartId],
    ) -> Result<(u64, Vec<String>), Error> {
        let Some(first) = ids.first() else { return Ok((0, Vec::new())) };
        self.prepare(opened, &first.path(folder))?;
        let bits = self.cleaned_bits(opened, ids, folder)?;
        let progress = self.job.progress;
        let mut notes = Vec::new();
        let mut each = |build: &mut dyn FnMut(&PartId, &Path) -> Result<builder::BuildReport, BuildError>| {
            ids.iter().try_fold(0, |voxels, id| {
                let report = build(id, &id.path(folder))?;
                for note in report.notes.iter().map(ToString::to_string) {
                    if !notes.contains(&note) {
                        notes.push(note);
                    }
                }
                Ok(voxels + report.skin_voxels)
            })
        };
        let voxels = match &opened.subject {
            Subject::Volume(volume) => {
                let clean = self.job.clean;
                let cleaned =
                    bits.map(|bits| clean.cleaned(&**volume, options, bits, progress)).transpose()?;
                let source = cleaned.as_ref().map_or(&**volume, Cleaned::source);
                each(&mut |id, path| builder::build_volume_part(source, options, path, id, progress))?
            }
            solid => {
                self.job
                    .with_solid(solid, &mut |made, options| {
                        each(&mut |id, path| made.build_part(options, path, Some(id), progress))
                    })?
                    .0
            }
        };
        Ok((voxels, notes))
    }
}
