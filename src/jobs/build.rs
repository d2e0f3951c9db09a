//! `oct build`: inputs of any kind into a model on disk.
//!
//! ```text
//! paths --discovery--> Subject --+-- volume: reshape, prepare, clean --+
//!                                +-- mesh:   bounds, bins, caps -------+--> solid --builder--> .oct, BuildSummary
//!                                +-- tree:   parse, place, lay --------+
//! ```

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

mod each;
mod report;
mod summary;

#[cfg(feature = "python")]
pub(crate) use each::build_each;
pub use each::{EachLabel, LabelModel, convert_each};
pub use report::BuildFigures;
pub use summary::BuildSummary;
pub(super) use summary::above_cap;

use super::hint::Hint;
use super::info::read_info;
use crate::budget::{Budget, MemoryCap, costs};
use crate::builder::{
    self, BuildError, BuildFault, BuildOptions, BuildReport, FileSolid, Gradient, Progress, Threshold,
    ViewedFrom,
};
use crate::clean::{CleanOptions, CleanReport};
use crate::csg::{CsgInput, CsgOptions, Shape, Tree, check_links, memory_bound, read_tree, with_tree};
use crate::discovery;
use crate::error::Error;
use crate::fault::{FaultKind, usage};
use crate::format::{MAGIC, SurfaceKind};
use crate::load::Frame;
use crate::measure::nearest::Space;
use crate::mesh::{
    Fill, GridChoice, MeshOptions, UpAxis, least_share, sufficient_share, usual_channels, with_mesh,
};
use crate::platform::{PositionalFile, give_back};
use crate::render::NamedView;
use crate::source::{OpenOptions, Subject, SubjectKind};
use crate::text::data;
use crate::text::names::{COMPARE, GRADIENT, OUTPUT};
use crate::volume::{Preparation, SourceError, SourceFault, VolumeSource, Workspace, sentences};

/// Suffixes of files that are neither models nor PNG pictures.
const OTHER_KINDS: &[&str] = &[
    "3mf", "am", "avi", "bmp", "bz2", "csg", "csv", "dcm", "dicom", "gif", "glb", "gltf", "gz", "hdr",
    "heic", "htm", "html", "ima", "img", "jp2", "jpeg", "jpg", "json", "md", "mgh", "mgz", "mha", "mhd",
    "mp4", "mrc", "nhdr", "nii", "npy", "npz", "nrrd", "obj", "off", "pdf", "ply", "raw", "stl", "svg",
    "tar", "tif", "tiff", "toml", "txt", "vgi", "vol", "vtk", "webp", "xml", "zarr", "zip", "zst",
];

/// True for the suffix of a file that is neither a model nor a PNG picture, in lower case and without its dot.
#[must_use]
pub fn is_other_kind(suffix: &str) -> bool {
    OTHER_KINDS.contains(&suffix)
}

/// Bytes of mesh files beyond which a grid of 512 voxels would lose detail: some million triangles.
const LARGE_MESH: u64 = 64 << 20;

/// Grid of a mesh or a tree of solids, and units and axes of its files.
#[derive(Clone, Copy, Debug, PartialEq, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GridOptions {
    /// Fineness of the grid; a tree with a volume has the volume's grid. If it is not given, 512 voxels along the
    /// longest side; for meshes of more than 64 MiB 1024; fewer where the memory is too small.
    pub grid: Option<GridChoice>,
    /// Length of one unit of the files, in millimetres.
    pub unit_mm: f64,
    /// Up axis of meshes whose files do not state it.
    pub up: UpAxis,
    /// Meaning of a mesh's inside; if not given, by the mesh.
    pub fill: Option<Fill>,
    /// True to keep walls of meshes that are thinner than a voxel, see [`MeshOptions::keep_thin`].
    pub keep_thin: bool,
    /// True if links may lead out of the folder from files that a mesh or a tree names.
    pub follow_links: bool,
}

impl Default for GridOptions {
    /// No grid, units of a millimetre.
    fn default() -> Self {
        Self { grid: None, unit_mm: 1.0, up: UpAxis::Z, fill: None, keep_thin: false, follow_links: false }
    }
}

impl GridOptions {
    /// True if walls thinner than a voxel are kept, which only skin voxels can.
    pub(super) fn is_thin(&self) -> bool {
        self.keep_thin || self.fill == Some(Fill::Surface)
    }

    /// The options of a mesh, if the grid is given.
    pub fn mesh(&self) -> Option<MeshOptions> {
        self.grid.map(|grid| self.mesh_on(grid))
    }

    /// The options of meshes and trees, unless they are the default.
    pub(super) fn stated(&self) -> Option<MeshOptions> {
        let usual = Self { follow_links: self.follow_links, ..Self::default() };
        (*self != usual)
            .then(|| self.mesh_on(self.grid.unwrap_or(GridChoice::Side { voxels: 512, margin: 1 })))
    }

    fn mesh_on(&self, grid: GridChoice) -> MeshOptions {
        let Self { unit_mm, up, fill, keep_thin, follow_links, .. } = *self;
        MeshOptions { grid, unit_mm, up, fill, keep_thin, follow_links }
    }

    /// As [`GridOptions::mesh`]; without a grid, one by the size of the files, coarser where the memory needs it.
    fn mesh_or_usual(&self, files: &[PathBuf], options: &BuildOptions) -> MeshOptions {
        if let Some(mesh) = self.mesh() {
            return mesh;
        }
        let bytes: u64 = files.iter().filter_map(|path| fs::metadata(path).ok()).map(|file| file.len()).sum();
        let left = Budget::of(options.memory).left_bytes();
        let side = |voxels| self.mesh_on(GridChoice::Side { voxels, margin: 1 });
        let first = if bytes > LARGE_MESH { 1024 } else { 512 };
        let fits = |mesh: &MeshOptions| least_share(mesh, options) <= left;
        [first, 512, 256].map(side).into_iter().find(fits).unwrap_or_else(|| side(128))
    }

    /// The options of a tree.
    pub fn tree(&self) -> CsgOptions {
        CsgOptions { grid: self.grid, unit_mm: self.unit_mm }
    }
}

/// Viewpoint of a model, by name or as numbers: `outside`, `front`, `along:X,Y,Z`, `X,Y,Z` in mm.
///
/// # Errors
/// A sentence on the accepted forms.
pub fn viewed_from(text: &str) -> Result<ViewedFrom, String> {
    let triple = |text: &str| -> Option<[f64; 3]> {
        let numbers: Vec<f64> =
            text.split(',').map(|part| part.trim().parse().ok()).collect::<Option<_>>()?;
        numbers.try_into().ok().filter(|at: &[f64; 3]| at.iter().all(|c| c.is_finite()))
    };
    if text == "outside" {
        return Ok(ViewedFrom::Outside);
    }
    if let Ok(view) = text.parse::<NamedView>() {
        return Ok(ViewedFrom::Along(view.looks_along()));
    }
    let found = match text.strip_prefix("along:") {
        Some("0,0,0") => return Err("along:0,0,0 is not a direction".into()),
        Some(direction) => triple(direction).filter(|along| *along != [0.0; 3]).map(ViewedFrom::Along),
        None => triple(text).map(ViewedFrom::Point),
    };
    found.ok_or_else(|| {
        let views = NamedView::ALL.map(NamedView::name).join(", ");
        format!("'{text}' is not a place to look from; write outside, {views}, along:X,Y,Z, or X,Y,Z in mm")
    })
}

/// Options, output and watcher of builds.
#[derive(Clone, Copy)]
pub struct BuildJob<'a> {
    /// Reshaping and cleaning of a volume before its build.
    pub clean: &'a CleanOptions,
    /// Grid of meshes and trees.
    pub grid: &'a GridOptions,
    /// Options and resources of the build.
    pub options: &'a BuildOptions,
    /// Path of the model.
    pub output: &'a Path,
    /// Watcher of the build.
    pub progress: &'a dyn Progress,
}

/// Result of building a subject.
pub(crate) struct Built {
    pub(crate) report: BuildReport,
    pub(crate) cleaned: Option<CleanReport>,
    pub(crate) warnings: Vec<String>,
    pub(crate) hints: Vec<String>,
}

/// Opens the inputs as the kind that [`SubjectKind::of`] tells, and builds their model.
///
/// # Errors
/// As [`Subject::open`], [`BuildJob::reshape`] and [`BuildJob::build`]; an old model is untouched then.
pub fn convert(
    kind: SubjectKind,
    inputs: &[PathBuf],
    how: &OpenOptions,
    job: &BuildJob<'_>,
) -> Result<BuildSummary, Error> {
    let started = Instant::now();
    job.give_back();
    let subject = job.open(kind, inputs, how)?;
    refuse_own_input(inputs, job.output)?;
    let input = inputs.iter().map(|p| data(p)).collect::<Vec<_>>().join(" ");
    let pseudonym = match &subject {
        Subject::Volume(volume) => volume.info().description.name.clone(),
        _ => String::new(),
    };
    let built = job.reshape(subject).and_then(|subject| job.build(subject, input, started));
    built.map_err(|error| in_full(error, inputs, &pseudonym))
}

/// An error with the whole path of the only input in place of its last part or its pseudonym.
fn in_full(mut error: Error, inputs: &[PathBuf], pseudonym: &str) -> Error {
    let [path] = inputs else { return error };
    let is_it = |name: &Path| {
        name == Path::new(pseudonym) || name.file_name().is_some() && name.file_name() == path.file_name()
    };
    let named = match &mut error {
        Error::Source(inner) => {
            if let SourceFault::Said(fault) = inner.fault_mut()
                && fault.kind == FaultKind::Usage
                && is_it(&fault.path)
            {
                fault.path.clone_from(path);
            }
            None
        }
        Error::Clean(inner) => inner.input_name(),
        Error::Build(inner) => inner.input_name(),
        _ => None,
    };
    if let Some(name) = named
        && is_it(Path::new(name.as_str()))
    {
        *name = data(path);
    }
    error
}

/// Refuses an output that is part of the input, or a file in an input folder other than a model.
fn refuse_own_input(inputs: &[PathBuf], output: &Path) -> Result<(), Error> {
    let Ok(real) = output.canonicalize() else { return Ok(()) };
    let is_model = || {
        let mut head = [0; MAGIC.len()];
        PositionalFile::open(&real).and_then(|file| file.read_exact_at(&mut head, 0)).is_ok() && head == MAGIC
    };
    let replaced = |input: &PathBuf| {
        input.canonicalize().is_ok_and(|path| {
            if path.is_dir() { real.starts_with(&path) && !is_model() } else { path == real }
        })
    };
    if inputs.iter().any(replaced) {
        let fault = usage!(
            "is the input, or part of it, and would be replaced by the model; name another file with {OUTPUT}"
        );
        return Err(fault.at(output).into());
    }
    Ok(())
}

/// Ratio of the longest to the shortest spacing from which a skin shows steps, and cells lose thin walls.
const UNEVEN: [f64; 2] = [3.0, 6.0];

/// Hints on other options: for a CT whose threshold was not chosen, for uneven spacing, and for axes in which nothing can
/// be measured.
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
    // An axis of one voxel shows no steps.
    let sides = source.info().dims.to_array();
    let several = (0..3).filter(|a| sides[*a] > 1).map(|a| spacing_mm[a]);
    let times = spacing_mm[axis] / several.fold(f64::INFINITY, f64::min);
    let is_skin = surface == SurfaceKind::Skin;
    let uneven = (sides[axis] > 1 && times >= UNEVEN[usize::from(!is_skin)]).then_some(Hint::Uneven {
        is_skin,
        spacing_mm,
        axis,
        times,
    });
    let hints = bone.into_iter().chain(uneven).map(|hint| hint.to_string());
    let unfit = if surface == SurfaceKind::Cells { Space::new(&source.info().affine).err() } else { None };
    hints.chain(unfit.map(|fault| format!("`{COMPARE}` refuses this model: it {}", fault.text))).collect()
}

/// Use of a finished solid.
type UseSolid<'a, T> = dyn FnMut(&FileSolid<'_>, &BuildOptions) -> Result<T, BuildError> + 'a;

/// Gives memory back, except within an interpreter, which keeps the pages of its libraries.
fn give_back_within(cap: MemoryCap) {
    if cfg!(not(feature = "python")) || matches!(cap, MemoryCap::Process(_)) {
        give_back();
    }
}

impl BuildJob<'_> {
    pub(super) fn give_back(&self) {
        give_back_within(self.options.memory);
    }

    /// Opens the inputs within the memory that the cap leaves.
    pub(super) fn open(
        &self,
        kind: SubjectKind,
        inputs: &[PathBuf],
        how: &OpenOptions,
    ) -> Result<Subject, Error> {
        // If less than this is left, the builder refuses, with the smallest cap that works.
        let opening_bytes = Budget::of(self.options.memory).left_bytes().max(costs::MIN_OPENING);
        let masks = self.options.labels.as_ref().map(|_| self.options.overlap);
        let how = OpenOptions { opening_bytes: Some(opening_bytes), masks, ..how.clone() };
        Ok(Subject::open_as(kind, inputs, &how, &self.options.scratch_folder(self.output))?)
    }

    /// Cuts and shrinks a volume, as [`CleanOptions::reshape`] does.
    ///
    /// # Errors
    /// As [`CleanOptions::reshape`].
    pub fn reshape(&self, subject: Subject) -> Result<Subject, Error> {
        Ok(subject.map_volume(|volume| self.clean.reshape(volume))?)
    }

    /// The least memory of a share in which a reshaped subject can be built; approximate for meshes and trees.
    pub(crate) fn least_share(&self, subject: &Subject) -> u64 {
        match subject {
            Subject::Volume(volume) => {
                let unrolling = volume.preparation().memory_bytes;
                self.clean.smallest_share(&**volume, self.options).max(unrolling)
            }
            Subject::Mesh(files) => {
                let options = self.mesh_options();
                least_share(&self.grid.mesh_or_usual(files, &options), &options)
            }
            Subject::Tree(_) => least_share(&self.grid.mesh_or_usual(&[], self.options), self.options),
        }
    }

    /// Builds the model of a reshaped subject; `started` is when the work on it began.
    ///
    /// # Errors
    /// As [`builder::build_volume`], [`CleanOptions::clean`], [`with_mesh`] and [`with_tree`].
    pub fn build(&self, subject: Subject, input: String, started: Instant) -> Result<BuildSummary, Error> {
        let is_solid = !matches!(subject, Subject::Volume(_));
        let built = match subject {
            Subject::Volume(volume) => self.volume(volume)?,
            solid => self.solid(&solid)?,
        };
        // Else the report of the model runs with the last stage's code still resident.
        self.give_back();
        let mut summary = self.summary(input, built, started)?;
        if is_solid {
            let Frame { header, metadata, .. } = &summary.info.frame;
            let hints = Hint::of_size(header.dims.to_array(), metadata.spacing_mm);
            summary.hints.extend(hints.map(|hint| hint.to_string()));
        }
        summary.warnings.extend(above_cap(self.options.memory));
        Ok(summary)
    }

    /// The summary of a finished build; `started` is when the work on it began.
    ///
    /// # Errors
    /// The model cannot be read.
    pub(crate) fn summary(
        &self,
        input: String,
        built: Built,
        started: Instant,
    ) -> Result<BuildSummary, Error> {
        let Built { report, cleaned, warnings, hints } = built;
        Ok(BuildSummary {
            input,
            output: self.output.to_path_buf(),
            memory_bytes: self.options.memory.bytes(),
            wall_s: started.elapsed().as_secs_f64(),
            report,
            info: read_info(self.output)?,
            each: Vec::new(),
            cleaning: (!self.clean.is_empty()).then(|| (self.clean.operations(), cleaned)),
            warnings,
            hints,
        })
    }

    fn volume(&self, mut source: Box<dyn VolumeSource>) -> Result<Built, Error> {
        let Self { clean, output, progress, .. } = *self;
        self.refuse_cleaned_labels(&*source)?;
        let threshold = clean.preset.map_or(self.options.threshold, |preset| preset.threshold());
        let mut options = BuildOptions { threshold, ..self.options.clone() };
        prepare(&mut *source, clean, &options, output, progress)?;
        clean.mask_labels(&mut *source, &options, progress);
        self.give_back();
        let cleaned = clean.clean(&*source, &options, output, progress)?;
        let report = match &cleaned {
            Some(cleaned) => {
                self.give_back();
                options.threshold = Threshold::Chosen(cleaned.selection);
                builder::build_volume(cleaned.source(), &options, output, progress)?
            }
            None => builder::build_volume(&*source, &options, output, progress)?,
        };
        let doubt = clean.preset.and_then(|preset| preset.doubt(source.modality()));
        let mut warnings = sentences(&source.info().notes);
        warnings.extend(report.notes.iter().map(|note| note.to_string()));
        warnings.extend(doubt.map(|doubt| doubt.to_string()));
        let cleaned = cleaned.map(|cleaned| cleaned.report);
        warnings.extend(cleaned.as_ref().and_then(|cleaned| cleaned.note).map(|note| note.to_string()));
        // Notes on thresholds do not apply to labels.
        let threshold =
            if options.labels.is_some() { Threshold::Chosen(report.selection) } else { threshold };
        let hints = hints(&*source, threshold, options.volume_surface(), &report);
        Ok(Built { report, cleaned, warnings, hints })
    }

    /// Refuses labels to be cleaned: cleaning needs a single inside, and would mix them.
    fn refuse_cleaned_labels(&self, source: &dyn VolumeSource) -> Result<(), Error> {
        let CleanOptions { downsample, preset, close, fill_cavities, keep_largest, drop_below, .. } =
            self.clean;
        let asked = [
            ("a preset", preset.is_some()),
            ("the downsampling", downsample.is_some()),
            ("the closing", *close > 0),
            ("the filling of cavities", *fill_cavities),
            ("the choice of components", keep_largest.is_some() || drop_below.is_some()),
        ];
        if let Some((asked, _)) = asked.into_iter().find(|(_, given)| *given && self.options.labels.is_some())
        {
            let fault = usage!("labels are built without cleaning; leave out {asked}");
            return Err(fault.at(&source.info().description.name).into());
        }
        Ok(())
    }

    fn solid(&self, subject: &Subject) -> Result<Built, Error> {
        let (report, mut warnings) =
            self.with_solid(subject, &mut |made, options| made.build(options, self.output, self.progress))?;
        warnings.extend(report.notes.iter().map(|note| note.to_string()));
        Ok(Built { report, cleaned: None, warnings, hints: Vec::new() })
    }

    /// Makes the solid of a mesh or a tree, and hands it on with its notes.
    ///
    /// # Errors
    /// As [`with_mesh`] and [`with_tree`].
    pub(super) fn with_solid<T>(
        &self,
        subject: &Subject,
        then: &mut UseSolid<'_, T>,
    ) -> Result<(T, Vec<String>), Error> {
        match subject {
            Subject::Mesh(paths) => self.mesh(paths, then),
            Subject::Tree(path) => self.tree(path, then),
            Subject::Volume(volume) => {
                let path = PathBuf::from(&volume.info().description.name);
                Err(SourceError::from(usage!("is a volume, which has a grid of its own").at(path)).into())
            }
        }
    }

    /// The options of a mesh, its surface and channels chosen.
    fn mesh_options(&self) -> BuildOptions {
        let options = self.options;
        let thin = options.surface.is_none() && self.grid.is_thin();
        let surface = if thin { SurfaceKind::Skin } else { options.volume_surface() };
        let channels = options.channels.or(Some(usual_channels(options)));
        BuildOptions { surface: Some(surface), channels, ..options.clone() }
    }

    fn mesh<T>(&self, inputs: &[PathBuf], then: &mut UseSolid<'_, T>) -> Result<(T, Vec<String>), Error> {
        let options = self.mesh_options();
        let mesh = self.grid.mesh_or_usual(inputs, &options);
        let scratch = options.scratch_folder(self.output);
        let (done, facts, notes) = with_mesh(inputs, &mesh, &options, scratch, self.progress, then)?;
        let notes = notes.iter().map(ToString::to_string);
        Ok((done, std::iter::once(facts.to_string()).chain(notes).collect()))
    }

    fn tree<T>(&self, path: &Path, then: &mut UseSolid<'_, T>) -> Result<(T, Vec<String>), Error> {
        let dry = Budget::dry(self.options.memory);
        self.tree_within(path, then).map_err(|error| match error {
            Error::Build(error) if error.minimum_bytes().is_some() => {
                let share = sufficient_share(&self.grid.mesh_or_usual(&[], self.options), self.options);
                // Any file may be a mesh.
                let sum = memory_bound(path).map_or(0, |(bytes, files)| bytes + (1 + files) * share);
                Error::Build(error.with_minimum(dry.smallest_limit_with(sum)))
            }
            other => other,
        })
    }

    fn tree_within<T>(&self, path: &Path, then: &mut UseSolid<'_, T>) -> Result<(T, Vec<String>), Error> {
        let (tree, root) = read_tree(path, self.options.memory)?;
        if !self.grid.follow_links {
            check_links(&tree, path)?;
        }
        let volumes = self.open_volumes(&tree)?;
        if volumes.is_empty() && self.options.gradient() != Gradient::default() {
            let fault =
                usage!("holds no volume, and normals are estimated for volumes only; leave out {GRADIENT}");
            return Err(fault.at(path).into());
        }
        self.give_back();
        let volumes = volumes.iter().map(|(path, source)| (path.clone(), &**source)).collect();
        let note = tree.note_on_text();
        let input = CsgInput { tree, root, name: path.to_path_buf(), volumes };
        let (options, scratch) = (self.options, self.options.scratch_folder(self.output));
        let then = |made: &FileSolid<'_>| then(made, options);
        let (done, facts, notes) =
            with_tree(input, &self.grid.tree(), options, scratch, self.progress, then)?;
        Ok((done, std::iter::once(facts.to_string()).chain(note).chain(notes).collect()))
    }

    /// Opens the volumes that leaves of a tree name, each once, and prepares them.
    fn open_volumes(&self, tree: &Tree) -> Result<Vec<Named>, Error> {
        let mut open: Vec<Named> = Vec::new();
        for shape in tree.files() {
            let Shape::Volume { path, .. } = shape else { continue };
            if open.iter().any(|(known, _)| known == path) {
                continue;
            }
            let opening_bytes = Budget::of(self.options.memory).left_bytes().max(costs::MIN_OPENING);
            let follow_links = self.grid.follow_links;
            let how =
                OpenOptions { opening_bytes: Some(opening_bytes), follow_links, ..OpenOptions::default() };
            let scratch = self.options.scratch_folder(self.output);
            let mut source = discovery::open_unprepared_in(std::slice::from_ref(path), &how, &scratch)?;
            prepare(&mut *source, &CleanOptions::default(), self.options, self.output, self.progress)?;
            open.push((path.clone(), source));
        }
        Ok(open)
    }
}

/// A volume, and the name by which leaves know it.
type Named = (PathBuf, Box<dyn VolumeSource>);

/// Unrolls a source that needs it, unless the cap would be too small for that or for the build.
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
    give_back_within(options.memory);
    let scratch = options.scratch_folder(output);
    let cap = options.memory;
    // The stated need of unrolling is its maximum; unrolling itself refuses if it needs more.
    if matches!(cap, MemoryCap::Process(_))
        && builder::reserve_least(source, options, &Budget::of_job(cap)).is_err()
    {
        let unrolling = Budget::dry(cap);
        drop(unrolling.reserve(needs.memory_bytes));
        let follows = cleaning.smallest_cap(source, options, cap);
        return Err(Error::Build(BuildError::from(BuildFault::BudgetTooSmall {
            name: source.info().description.name.clone(),
            limit_bytes: cap.bytes(),
            minimum_bytes: follows.max(unrolling.smallest_limit(1)),
        })));
    }
    Ok(source.prepare(&Workspace { scratch: &scratch, memory: Budget::of(cap), progress })?)
}
