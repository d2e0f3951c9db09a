//! `oct plan`, `oct part` and `oct merge`: a model in parts that any engine builds, joined into the bytes of one build.
//!
//! The plan is a file of JSON; each part is a file beside it whose name encodes its origin, so that an existing sound
//! part is not built again. No job is started on another machine.

mod input;
mod report;
mod staged;

pub use input::PartsInput;
pub use report::{MergeReport, PartReport, PlanReport, StageReport};
pub use staged::{merge_stage, part_stage};

use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::time::Instant;

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::build::BuildJob;
use crate::atomic::AtomicFile;
pub use crate::builder::parts::stage::Stage;
use crate::builder::parts::{Cuts, PartFault, PartFile, PartId, join};
use crate::builder::{BuildError, BuildFault, BuildOptions, Progress};
use crate::error::Error;
use crate::fault::{bad, usage};
use crate::geom::Dims;
use crate::platform::PositionalFile;
use crate::synthetic::is_synthetic;
use crate::text::data;
use crate::text::names::PLAN;
use crate::volume::Preparation;
use input::Opened;

/// Most parts of a plan.
pub const MAX_PARTS: u32 = 4096;
/// Longest plan in bytes.
const MAX_PLAN_BYTES: u64 = 1 << 20;

/// A plan as it stands in its file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct PlanFile {
    /// Program and version that made it.
    program: String,
    /// SHA-256, in hex digits, of everything that determines the bytes of the model.
    digest: String,
    /// Size of the model's grid.
    dims: [u32; 3],
    /// Parts, numbered from 0.
    parts: u32,
    /// Folder of the relative paths in `command`.
    folder: String,
    /// Files of a mesh or a tree of solids.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    files: Vec<String>,
    /// Inputs and options of the build, as words of a command line.
    command: Vec<String>,
    /// SHA-256, in hex digits, of the plan with an empty checksum.
    #[serde(default)]
    checksum: String,
}

impl PlanFile {
    /// The plan with its checksum.
    fn sealed(mut self) -> serde_json::Result<Self> {
        self.checksum.clear();
        self.checksum = hex(&Sha256::digest(serde_json::to_vec(&self)?));
        Ok(self)
    }
}

/// A plan that was read.
#[derive(Clone, Debug)]
pub struct Plan {
    path: PathBuf,
    file: PlanFile,
    digest: [u8; 32],
    dims: Dims,
}

impl Plan {
    /// Reads a plan.
    ///
    /// # Errors
    /// It cannot be read, or is not a plan.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let refuse = |fault| refused(path, fault);
        let not = |reason: &str| {
            refuse(bad!("is not a plan, or is damaged ({reason}); make it again with {PLAN}").into())
        };
        let unreadable = |cause| refuse(PartFault::Unreadable(cause));
        let mut bytes = Vec::new();
        let opened = PositionalFile::open(path)
            .and_then(|file| file.onwards(0).take(MAX_PLAN_BYTES + 1).read_to_end(&mut bytes));
        if opened.map_err(unreadable)? as u64 > MAX_PLAN_BYTES {
            return Err(not("it is too long"));
        }
        let file: PlanFile = serde_json::from_slice(&bytes).map_err(|e| not(&e.to_string()))?;
        if file.clone().sealed().ok().as_ref() != Some(&file) {
            return Err(not("it was edited"));
        }
        let digest = parse_hex(&file.digest).ok_or_else(|| not("its digest is not one"))?;
        let [x, y, z] = file.dims;
        let dims = Dims::new(x, y, z).ok_or_else(|| not("its size is not one"))?;
        if !(1..=MAX_PARTS).contains(&file.parts) {
            return Err(not("its number of parts is not one"));
        }
        Ok(Self { path: path.to_path_buf(), file, digest, dims })
    }

    /// Inputs and options of the build.
    pub fn command(&self) -> &[String] {
        &self.file.command
    }

    /// An input of the command, relative to the folder where the plan was made; a synthetic one has no folder.
    pub fn input(&self, path: &Path) -> PathBuf {
        if is_synthetic(path) { path.to_path_buf() } else { Path::new(&self.file.folder).join(path) }
    }

    /// The error of a command of another program.
    pub fn not_of_this_program(&self) -> Error {
        refused(&self.path, PartFault::OtherPlan)
    }

    /// The folder of the parts.
    pub fn folder(&self) -> &Path {
        match self.path.parent() {
            Some(parent) if !parent.as_os_str().is_empty() => parent,
            _ => Path::new("."),
        }
    }

    /// Opens the input, if it is the one that was planned for.
    fn open(&self, input: &PartsInput<'_>) -> Result<Opened, Error> {
        let opened = input.open(Some((self.dims, &self.file.files)))?;
        if opened.dims != self.dims || input.digest(&opened, self.file.parts) != self.digest {
            return Err(refused(&self.path, PartFault::OtherPlan));
        }
        Ok(opened)
    }

    fn cuts(&self) -> Cuts {
        Cuts { dims: self.dims, parts: self.file.parts }
    }

    /// Path of a part.
    ///
    /// # Errors
    /// The plan has no part of this number.
    pub fn part_path(&self, number: u32) -> Result<PathBuf, Error> {
        self.part(number).map(|part| part.path(self.folder()))
    }

    fn part(&self, number: u32) -> Result<PartId, Error> {
        let parts = self.file.parts;
        if number >= parts {
            let fault = usage!("has no part {number}; its {parts} parts are numbered from 0");
            return Err(refused(&self.path, fault.into()));
        }
        Ok(PartId { digest: self.digest, number, cuts: self.cuts() })
    }
}

fn refused(path: &Path, fault: PartFault) -> Error {
    Error::Build(BuildError::from(BuildFault::Part { path: path.to_path_buf(), fault }))
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

fn parse_hex(text: &str) -> Option<[u8; 32]> {
    let (pairs, []) = text.as_bytes().as_chunks::<2>() else { return None };
    let byte = |pair: &[u8; 2]| u8::from_str_radix(str::from_utf8(pair).ok()?, 16).ok();
    pairs.iter().map(byte).collect::<Option<Vec<_>>>()?.try_into().ok()
}

/// Plans a model in `parts` parts into the folder `out`, which is made if it is missing; `command` and `folder` are
/// kept for those who build the parts.
///
/// # Errors
/// The input cannot be opened, an operation of the build cannot be done in parts, or the plan cannot be written.
pub fn plan(
    input: &PartsInput<'_>,
    parts: u32,
    out: &Path,
    command: Vec<String>,
    folder: &str,
) -> Result<PlanReport, Error> {
    let opened = input.open(None)?;
    let (dims, digest) = (opened.dims, input.digest(&opened, parts));
    let not_text = || usage!("is not text, and cannot be written down in a plan; rename it").into();
    let text = |path: &PathBuf| path.to_str().map(str::to_owned).ok_or_else(|| refused(path, not_text()));
    let cuts = Cuts { dims, parts };
    let regions = (0..parts).map(|number| cuts.region(number));
    let (mut empty_parts, mut most) = (0, 0);
    for region in regions {
        let voxels = |beyond: usize| {
            let side = |side: &std::ops::Range<u32>| (side.len() + beyond) as u64;
            region.x.len() as u64 * side(&region.y) * side(&region.z)
        };
        if voxels(0) == 0 {
            empty_parts += 1;
        } else {
            most = voxels(5).max(most);
        }
    }
    let file = PlanFile {
        program: concat!("infobyte ", env!("CARGO_PKG_VERSION")).to_owned(),
        digest: hex(&digest),
        dims: dims.to_array(),
        parts,
        folder: folder.to_owned(),
        files: opened.files.iter().map(text).collect::<Result<_, _>>()?,
        command,
        checksum: String::new(),
    };
    let path = out.join("plan.json");
    write_plan(file.clone(), out, &path).map_err(|cause| Error::Output { path: path.clone(), cause })?;
    let mut warnings = opened.notes.clone();
    if let Some(volume) = opened.volume() {
        let needs = volume.preparation();
        if needs != Preparation::default() && !needs.on_demand {
            warnings.push(
                "the input can only be read from front to back: every part unrolls all of it first; store it uncompressed if there are many parts".into(),
            );
        }
    }
    Ok(PlanReport {
        plan: data(&path),
        parts,
        stages: opened.stages.iter().map(|stage| stage.name()).collect(),
        empty_parts,
        grid_dims: file.dims,
        digest: file.digest,
        part_bytes: opened.volume().map_or(0, |volume| most * volume.info().scalar.bytes() as u64),
        warnings,
    })
}

fn write_plan(file: PlanFile, out: &Path, path: &Path) -> std::io::Result<()> {
    std::fs::create_dir_all(out)?;
    let atomic = AtomicFile::create(path)?;
    let text = file.sealed().and_then(|file| serde_json::to_string_pretty(&file));
    let text = text.map_err(std::io::Error::other)?;
    atomic.file().write_all(format!("{text}\n").as_bytes())?;
    atomic.commit()
}

/// Builds a part of a plan, unless a sound one exists; a damaged one is replaced.
///
/// # Errors
/// The input is not what was planned for, it cannot be read, or the disk fails; a part appears whole or not at all.
pub fn part(plan: &Plan, number: u32, input: &PartsInput<'_>) -> Result<PartReport, Error> {
    let started = Instant::now();
    let (id, folder) = (plan.part(number)?, plan.folder());
    let mut opened = plan.open(input)?;
    let was_there = is_there(&id, folder, input.job.progress)?;
    let (mut part_voxels, mut warnings) = (None, Vec::new());
    if !was_there {
        let threshold = input.threshold_of(&opened, &id, folder)?;
        let options = BuildOptions { threshold, ..input.options() };
        let (voxels, notes) = input.build(&mut opened, &options, folder, &[id])?;
        (part_voxels, warnings) = (Some(voxels), notes);
    }
    let surface = input.job.options.volume_surface();
    let report = PartReport::new(plan, number, &id.path(folder), started);
    Ok(PartReport { was_there, part_voxels, surface, warnings, ..report })
}

/// True for an existing, whole and sound part. A damaged one is built again; one that cannot be read is not replaced.
fn is_there(id: &PartId, folder: &Path, progress: &dyn Progress) -> Result<bool, Error> {
    let is_sound = |found: Option<PartFile>| found.map(|part| part.check(progress)).transpose();
    match PartFile::open(id, folder).and_then(is_sound) {
        Ok(found) => Ok(found.is_some()),
        Err(error) => match error.fault() {
            BuildFault::Part { fault: PartFault::Unreadable(_), .. } => Err(error.into()),
            _ if matches!(error.kind(), crate::exit::ExitKind::Input) => Ok(false),
            _ => Err(error.into()),
        },
    }
}

/// Builds a model in parts of 128 slices, one after the other, in a folder beside [`BuildJob::output`]. Parts of an
/// interrupted build of the same input and options are used again. The folder is removed at the end.
///
/// # Errors
/// As [`part`] and [`merge`]; the parts that are done stay.
pub fn resume(input: &PartsInput<'_>) -> Result<MergeReport, Error> {
    let started = Instant::now();
    let BuildJob { progress, output, .. } = input.job;
    let mut opened = input.open(None)?;
    // Cells have one layer more than samples.
    let parts = (opened.dims.nz() + 1).div_ceil(128).min(MAX_PARTS);
    let digest = input.digest(&opened, parts);
    let cuts = Cuts { dims: opened.dims, parts };
    let mut folder = output.as_os_str().to_owned();
    folder.push(".parts");
    let folder = PathBuf::from(folder);
    let failed = |cause| Error::Output { path: folder.clone(), cause };
    std::fs::create_dir_all(&folder).map_err(failed)?;
    let mut missing = Vec::new();
    for number in 0..parts {
        let id = PartId { digest, number, cuts };
        if !is_there(&id, &folder, progress)? {
            missing.push(id);
        }
    }
    let mut warnings = opened.notes.clone();
    if let Some(first) = missing.first() {
        let (threshold, note) = input.own_threshold(&mut opened, first, &folder)?;
        let options = BuildOptions { threshold, ..input.options() };
        input.own_cleaning(&mut opened, first, &folder, &options)?;
        let (_, notes) = input.build(&mut opened, &options, &folder, &missing)?;
        warnings.extend(note.iter().map(ToString::to_string).chain(notes));
    }
    drop(opened);
    let joined = join(digest, cuts, &folder, output, progress)?;
    // Parts of builds with other options are removed, too; other files stay, and then so does the folder.
    for entry in std::fs::read_dir(&folder).map_err(failed)?.flatten() {
        if entry.path().extension().is_some_and(|extension| extension == "part") {
            std::fs::remove_file(entry.path()).map_err(failed)?;
        }
    }
    let _ = std::fs::remove_dir(&folder);
    Ok(MergeReport { warnings, ..MergeReport::of(&joined, (&folder, output), parts, started) })
}

/// Joins all parts of a plan into the model that one build makes.
///
/// Memory: about 2 MiB, and some 200 bytes a part, however large the parts are.
///
/// # Errors
/// A part is missing, damaged or not of this plan, or the disk fails; the old output is untouched then.
pub fn merge(plan: &Plan, output: &Path, progress: &dyn Progress) -> Result<MergeReport, Error> {
    let started = Instant::now();
    let joined = join(plan.digest, plan.cuts(), plan.folder(), output, progress)?;
    Ok(MergeReport::of(&joined, (&plan.path, output), plan.file.parts, started))
}
