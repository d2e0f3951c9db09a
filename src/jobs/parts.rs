//! `oct plan`, `oct part` and `oct merge`: a model in parts that any engine builds, joined into the bytes of one build.
//!
//! The plan is a file of JSON; every part is a file beside it whose name says what it is made of, so that a part that is
//! there and sound is not built again. Nothing here runs anything on another machine.

use std::fmt::Write;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::time::{Instant, UNIX_EPOCH};

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::build::{BuildJob, prepare};
use crate::atomic::AtomicFile;
use crate::budget::{Bytes, MemoryCap, peak_rss_bytes};
use crate::builder::parts::{Cuts, Joined, NotInParts, PartFault, PartFile, PartId, join};
use crate::builder::{self, BuildError, BuildFault, BuildOptions, Progress, Threshold, cell_dims};
use crate::clean::CleanOptions;
use crate::error::Error;
use crate::format::{Channel, SurfaceKind};
use crate::geom::Dims;
use crate::source::{OpenOptions, SubjectKind};
use crate::text::{data, shown};
use crate::volume::{Preparation, VolumeSource};

/// Most parts of a plan.
pub const MAX_PARTS: u32 = 4096;
/// Version of the layout of parts and of what their digest is made of.
const VERSION: &str = "infobyte parts 1";
/// No plan is longer.
const MAX_PLAN_BYTES: u64 = 1 << 20;

/// A plan as it stands in its file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct PlanFile {
    /// Program and version that made it.
    program: String,
    /// SHA-256, in hex digits, of everything that decides the bytes of the model.
    digest: String,
    /// Size of the model's grid.
    dims: [u32; 3],
    /// Parts, numbered from 0.
    parts: u32,
    /// Folder that the paths in `command` start from.
    folder: String,
    /// Inputs and options of the build, as words of a command line.
    command: Vec<String>,
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
        let not = |reason: &str| refuse(PartFault::NotPlan { reason: reason.to_owned() });
        let unreadable = |cause| refuse(PartFault::Unreadable(cause));
        if std::fs::metadata(path).map_err(unreadable)?.len() > MAX_PLAN_BYTES {
            return Err(not("it is too long"));
        }
        let bytes = std::fs::read(path).map_err(unreadable)?;
        let file: PlanFile = serde_json::from_slice(&bytes).map_err(|e| not(&e.to_string()))?;
        let digest = parse_hex(&file.digest).ok_or_else(|| not("its digest is not one"))?;
        let [x, y, z] = file.dims;
        let dims = Dims::new(x, y, z).ok_or_else(|| not("its size is not one"))?;
        if !(1..=MAX_PARTS).contains(&file.parts) {
            return Err(not("its number of parts is not one"));
        }
        Ok(Self { path: path.to_path_buf(), file, digest, dims })
    }

    /// Inputs and options of the build, and the folder that their paths start from.
    pub fn command(&self) -> (&[String], &Path) {
        (&self.file.command, Path::new(&self.file.folder))
    }

    /// Its command is not one of this program.
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

    fn cuts(&self) -> Cuts {
        Cuts { dims: self.dims, parts: self.file.parts }
    }

    /// The file of a part.
    ///
    /// # Errors
    /// The plan has no part of this number.
    pub fn part_path(&self, number: u32) -> Result<PathBuf, Error> {
        self.part(number).map(|part| part.path(self.folder()))
    }

    fn part(&self, number: u32) -> Result<PartId, Error> {
        let parts = self.file.parts;
        if number >= parts {
            return Err(refused(&self.path, PartFault::NoSuchPart { number, parts }));
        }
        Ok(PartId { digest: self.digest, number, cuts: self.cuts() })
    }
}

fn refused(path: &Path, fault: PartFault) -> Error {
    Error::Build(BuildError::from(BuildFault::Part { path: path.to_path_buf(), fault }))
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().fold(String::new(), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    })
}

fn parse_hex(text: &str) -> Option<[u8; 32]> {
    let mut bytes = [0; 32];
    if text.len() != 64 || !text.is_ascii() {
        return None;
    }
    for (at, byte) in bytes.iter_mut().enumerate() {
        *byte = u8::from_str_radix(text.get(2 * at..2 * at + 2)?, 16).ok()?;
    }
    Some(bytes)
}

/// What is built, as one build is asked for.
#[derive(Clone, Copy)]
pub struct PartsInput<'a> {
    /// What lies at the inputs.
    pub kind: SubjectKind,
    /// The files and folders.
    pub inputs: &'a [PathBuf],
    /// How they are opened.
    pub how: &'a OpenOptions,
    /// How they are built. [`BuildJob::output`] is not used.
    pub job: BuildJob<'a>,
}

impl PartsInput<'_> {
    /// What a part of a model cannot know.
    fn unsupported(&self, source: Option<&dyn VolumeSource>) -> Option<NotInParts> {
        let BuildJob { clean, options, .. } = self.job;
        let threshold = clean.preset.map_or(options.threshold, |preset| preset.threshold());
        let cleaning = CleanOptions { roi: None, downsample: None, preset: None, ..clean.clone() };
        let wide = source.is_some_and(|source| source.info().scalar.bytes() > 2);
        let found = [
            (options.labels.is_some(), NotInParts::Labels),
            (self.kind != SubjectKind::Volume, NotInParts::Solid),
            (matches!(threshold, Threshold::Otsu | Threshold::Chosen(_)), NotInParts::Otsu),
            (!options.visible_from.is_empty(), NotInParts::Sight),
            (options.joins(), NotInParts::Leaves),
            (wide && options.channels.contains(Channel::Value), NotInParts::WideValues),
            (!cleaning.is_empty(), NotInParts::Cleaning { operations: cleaning.operations().join(", ") }),
        ];
        found.into_iter().find(|(is_so, _)| *is_so).map(|(_, what)| what)
    }

    /// The options of a part, with the threshold of its preset.
    fn options(&self) -> BuildOptions {
        let BuildJob { clean, options, .. } = self.job;
        let threshold = clean.preset.map_or(options.threshold, |preset| preset.threshold());
        BuildOptions { threshold, ..options.clone() }
    }

    /// Opens and reshapes the volume.
    fn open(&self) -> Result<Box<dyn VolumeSource>, Error> {
        let refuse = |what| {
            let path = self.inputs.first().cloned().unwrap_or_default();
            refused(&path, PartFault::Unsupported(what))
        };
        if let Some(what) = self.unsupported(None) {
            return Err(refuse(what));
        }
        let subject = self.job.reshape(self.job.open(self.kind, self.inputs, self.how)?)?;
        let volume = subject.into_volume().ok_or_else(|| refuse(NotInParts::Solid))?;
        self.unsupported(Some(&*volume)).map_or(Ok(volume), |what| Err(refuse(what)))
    }

    /// Size of the model's grid, and the digest of everything that decides its bytes: program, options, and of every file
    /// of the input its name, length and time of change.
    fn digest(&self, source: &dyn VolumeSource, parts: u32) -> Result<(Dims, [u8; 32]), Error> {
        let BuildJob { clean, options, .. } = self.job;
        let surface = options.volume_surface();
        let info = source.info();
        let dims = match surface {
            SurfaceKind::Skin => info.dims,
            SurfaceKind::Cells => cell_dims(info.dims).ok_or_else(|| {
                let name = info.description.name.clone();
                Error::Build(BuildError::from(BuildFault::NoRoomForCells { name }))
            })?,
        };
        // What changes time and memory only is the same for all.
        let what = BuildOptions {
            memory: MemoryCap::Share(0),
            threads: 0,
            scratch: None,
            surface,
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
        take(&format!("{what:?} {clean:?} {how:?} {:?} {dims:?} {parts}", self.kind));
        take(&format!("{:?} {:?} {:?}", info.scalar, info.affine, info.rescale));
        let mut file = |path: &Path| {
            let state = std::fs::metadata(path).ok().filter(|meta| meta.is_file()).map(|meta| {
                let changed = meta.modified().ok().and_then(|time| time.duration_since(UNIX_EPOCH).ok());
                (meta.len(), changed)
            });
            take(&format!("{:?} {state:?}", path.file_name()));
        };
        self.inputs.iter().for_each(|path| file(path));
        source.for_each_file(&mut file);
        Ok((dims, hash.finalize().into()))
    }
}

/// A plan that was written.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct PlanReport {
    /// File of the plan.
    pub plan: String,
    /// Parts of the plan, numbered from 0.
    pub parts: u32,
    /// Parts that hold no voxel, because there are more parts than boxes of 128 voxels along z and y.
    pub empty_parts: u32,
    /// Size of the model's grid along x, y, z.
    pub grid_dims: [u32; 3],
    /// SHA-256, in hex digits, of everything that decides the bytes of the model.
    pub digest: String,
    /// Bytes of samples that one part reads at most, those beyond its box included.
    pub part_bytes: u64,
    /// Sentences about the input: assumptions, parts left out, oddities.
    pub warnings: Vec<String>,
}

/// Plans a model in `parts` parts into the folder `out`, which is made if it is not there; `command` and `folder` are kept
/// for those who build them.
///
/// # Errors
/// The input cannot be opened, something of the build cannot be done in parts, or the plan cannot be written.
pub fn plan(
    input: &PartsInput<'_>,
    parts: u32,
    out: &Path,
    command: Vec<String>,
    folder: &str,
) -> Result<PlanReport, Error> {
    let source = input.open()?;
    let (dims, digest) = input.digest(&*source, parts)?;
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
        command,
    };
    let path = out.join("plan.json");
    write_plan(&file, out, &path).map_err(|cause| Error::Output { path: path.clone(), cause })?;
    let mut warnings = crate::facts::sentences(&source.info().notes);
    let needs = source.preparation();
    if needs != Preparation::default() && !needs.on_demand {
        warnings.push(
            "the input can only be read from front to back: every part unrolls all of it first; store it uncompressed if there are many parts".into(),
        );
    }
    Ok(PlanReport {
        plan: data(&path),
        parts,
        empty_parts,
        grid_dims: file.dims,
        digest: file.digest,
        part_bytes: most * source.info().scalar.bytes() as u64,
        warnings,
    })
}

fn write_plan(file: &PlanFile, out: &Path, path: &Path) -> std::io::Result<()> {
    std::fs::create_dir_all(out)?;
    let atomic = AtomicFile::create(path)?;
    let text = serde_json::to_string_pretty(file).map_err(std::io::Error::other)?;
    atomic.file().write_all(format!("{text}\n").as_bytes())?;
    atomic.commit()
}

impl PlanReport {
    /// For people.
    pub fn text(&self) -> String {
        let [x, y, z] = self.grid_dims;
        let empty = if self.empty_parts > 0 {
            format!(" ({} of them empty: fewer would do)", self.empty_parts)
        } else {
            String::new()
        };
        let mut text = format!(
            "{}: {} parts, numbered from 0{empty}, of a grid of {x}x{y}x{z}; a part reads up to {}\n",
            shown(&self.plan),
            self.parts,
            Bytes(self.part_bytes)
        );
        for warning in &self.warnings {
            let _ = writeln!(text, "  note: {}", shown(warning));
        }
        text
    }
}

/// A part that is there.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct PartReport {
    /// File of the plan.
    pub plan: String,
    /// Number of the part, from 0.
    pub part: u32,
    /// Output as named on the command line.
    pub output: String,
    /// True if the part was there before and is sound, so that nothing was built.
    pub was_there: bool,
    /// Skin voxels of the part; null if it was there before.
    pub part_voxels: Option<u64>,
    /// Size of the file that was written or read.
    pub bytes: u64,
    /// Peak resident memory of the process.
    pub peak_rss_bytes: u64,
    /// Seconds from start to end.
    pub wall_s: f64,
}

/// Builds a part of a plan, unless it is there and sound; a damaged one is replaced.
///
/// # Errors
/// The input is not what was planned for, it cannot be read, or the disk fails; a part appears whole or not at all.
pub fn part(plan: &Plan, number: u32, input: &PartsInput<'_>) -> Result<PartReport, Error> {
    let started = Instant::now();
    let id = plan.part(number)?;
    let BuildJob { clean, progress, .. } = input.job;
    let mut source = input.open()?;
    if input.digest(&*source, plan.file.parts)? != (plan.dims, plan.digest) {
        return Err(refused(&plan.path, PartFault::OtherPlan));
    }
    let path = id.path(plan.folder());
    let was_there = is_there(&id, plan.folder(), progress)?;
    let mut part_voxels = None;
    if !was_there {
        let options = input.options();
        prepare(&mut *source, clean, &options, &path, progress)?;
        input.job.give_back();
        let built = builder::build_volume_part(&*source, &options, &path, &id, progress)?;
        part_voxels = Some(built.skin_voxels);
    }
    let bytes = std::fs::metadata(&path).map_or(0, |meta| meta.len());
    Ok(PartReport {
        plan: data(&plan.path),
        part: number,
        output: data(&path),
        was_there,
        part_voxels,
        bytes,
        peak_rss_bytes: peak_rss_bytes(),
        wall_s: started.elapsed().as_secs_f64(),
    })
}

/// Is a part there, whole and sound? What is damaged is built again; what cannot be read is not replaced.
fn is_there(id: &PartId, folder: &Path, progress: &dyn Progress) -> Result<bool, Error> {
    let is_sound = |found: Option<PartFile>| found.map(|part| part.check(progress)).transpose();
    match PartFile::open(id, folder).and_then(is_sound) {
        Ok(found) => Ok(found.is_some()),
        Err(error) if matches!(error.kind(), crate::exit::ExitKind::Input) => Ok(false),
        Err(error) => Err(error.into()),
    }
}

/// Builds a model in parts of 128 slices, one after the other, in a folder beside [`BuildJob::output`]; those that are
/// there from a build of the same input and options that was stopped are not built again. The folder is removed at the end.
///
/// # Errors
/// As [`part`] and [`merge`]; the parts that are done stay.
pub fn resume(input: &PartsInput<'_>) -> Result<MergeReport, Error> {
    let started = Instant::now();
    let BuildJob { clean, progress, output, .. } = input.job;
    let mut source = input.open()?;
    // Cells have one layer more than samples.
    let parts = (source.info().dims.nz() + 1).div_ceil(128).min(MAX_PARTS);
    let (dims, digest) = input.digest(&*source, parts)?;
    let cuts = Cuts { dims, parts };
    let mut folder = output.as_os_str().to_owned();
    folder.push(".parts");
    let folder = PathBuf::from(folder);
    let failed = |cause| Error::Output { path: folder.clone(), cause };
    std::fs::create_dir_all(&folder).map_err(failed)?;
    let options = input.options();
    let mut is_ready = false;
    for number in 0..parts {
        let id = PartId { digest, number, cuts };
        if is_there(&id, &folder, progress)? {
            continue;
        }
        let path = id.path(&folder);
        if !is_ready {
            prepare(&mut *source, clean, &options, &path, progress)?;
            input.job.give_back();
            is_ready = true;
        }
        builder::build_volume_part(&*source, &options, &path, &id, progress)?;
    }
    let joined = join(digest, cuts, &folder, output, progress)?;
    // Parts of builds with other options, too; what else lies there stays, and so does the folder then.
    for entry in std::fs::read_dir(&folder).map_err(failed)?.flatten() {
        if entry.path().extension().is_some_and(|extension| extension == "part") {
            std::fs::remove_file(entry.path()).map_err(failed)?;
        }
    }
    let _ = std::fs::remove_dir(&folder);
    Ok(MergeReport::of(&joined, (&folder, output), parts, started))
}

impl PartReport {
    /// For people.
    pub fn text(&self) -> String {
        let done = match self.part_voxels {
            Some(voxels) => format!("{voxels} skin voxels or cells in {:.2} s", self.wall_s),
            None => "was there, and is sound".into(),
        };
        format!("{}: part {}, {}, {done}\n", shown(&self.output), self.part, Bytes(self.bytes))
    }
}

/// A model that was joined.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct MergeReport {
    /// File of the plan.
    pub plan: String,
    /// Output as named on the command line.
    pub output: String,
    /// Parts of the plan, numbered from 0.
    pub parts: u32,
    /// Skin voxels of the model.
    pub skin_voxels: u64,
    /// Nodes of the octree, one infobyte each.
    pub nodes: u64,
    /// Size of the file that was written or read.
    pub bytes: u64,
    /// Seconds of census and joining.
    pub join_s: f64,
    /// Seconds of rank directory and checksums.
    pub seal_s: f64,
    /// Seconds of syncing and renaming.
    pub commit_s: f64,
    /// Peak resident memory of the process.
    pub peak_rss_bytes: u64,
    /// Seconds from start to end.
    pub wall_s: f64,
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

impl MergeReport {
    fn of(joined: &Joined, (plan, output): (&Path, &Path), parts: u32, started: Instant) -> Self {
        Self {
            plan: data(plan),
            output: data(output),
            parts,
            skin_voxels: joined.voxels,
            nodes: joined.nodes,
            bytes: joined.file_bytes,
            join_s: joined.seconds.merge,
            seal_s: joined.seconds.seal,
            commit_s: joined.seconds.commit,
            peak_rss_bytes: peak_rss_bytes(),
            wall_s: started.elapsed().as_secs_f64(),
        }
    }

    /// For people.
    pub fn text(&self) -> String {
        format!(
            "{}: {} parts joined, {} skin voxels or cells, {} nodes, {} in {:.2} s; peak resident memory {}\n",
            shown(&self.output),
            self.parts,
            self.skin_voxels,
            self.nodes,
            Bytes(self.bytes),
            self.wall_s,
            Bytes(self.peak_rss_bytes)
        )
    }
}
