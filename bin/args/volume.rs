//! Options of the commands that read volumes: what is taken, what is inside, what is done to it.

use std::path::{Path, PathBuf};

use clap::Args;
use infobyte::budget::{MemoryCap, parse_size};
use infobyte::builder::{
    BuildOptions, Connectivity, Gradient, LabelChoice, Threshold, Tolerance, ViewedFrom,
};
use infobyte::clean::{CleanOptions, ComponentConnectivity, Preset, SizeLimit};
use infobyte::format::{Channels, LabelName, SurfaceKind};
use infobyte::geom::{Dims, Orientation};
use infobyte::jobs::build::{GridOptions, viewed_from};
use infobyte::jobs::export::MAX_SMOOTH;
use infobyte::mesh::{Fill, GridChoice, UpAxis, states_place};
use infobyte::source::{GapPolicy, SubjectKind};
use infobyte::volume::{Endian, Overlap, ScalarType};

use super::{RunArgs, Switch, ThreadArgs, parse};
use crate::failure::not_of;

/// `oct build`: what other commands build as well, and what only it can.
#[derive(Debug, Args)]
#[command(mut_arg("output", |arg| arg.required(false).required_unless_present("each")))]
pub(crate) struct BuildCommand {
    #[command(flatten)]
    pub(crate) build: BuildArgs,
    /// Build in parts of 128 slices, in a folder next to the output with .parts added to its name; an interrupted
    /// build continues from the parts that exist, and the report is that of merge
    #[arg(long, help_heading = None)]
    pub(crate) resume: bool,
    /// Also write one model per label into this folder, named after the label; without --output, only these. The
    /// volume is read once
    #[arg(long, value_name = "FOLDER", requires = "labels", conflicts_with = "resume", help_heading = None)]
    pub(crate) each: Option<PathBuf>,
}

#[derive(Debug, Args)]
#[command(mut_arg("quiet", |arg| arg.help("No progress, no warnings")))]
pub(crate) struct BuildArgs {
    /// A file, a folder, or several slice files; - for headerless voxels on standard input
    #[arg(required = true, value_name = "INPUT")]
    pub(crate) input: Vec<PathBuf>,
    /// The model to write
    #[arg(short, long, value_name = "MODEL.oct", required = true)]
    pub(crate) output: Option<PathBuf>,
    /// Write it even if its name says that it is another kind of file; with --each, replace models that are there
    #[arg(long)]
    pub(crate) force: bool,
    #[command(flatten)]
    pub(crate) selection: SelectionArgs,
    /// Build the cells between the labels of a label map (a segmentation), in one model: all labels, or numbers, ranges
    /// and names as 1,5,7..20,liver
    #[arg(long, value_name = "all|LIST", group = "selection")]
    pub(crate) labels: Option<LabelChoice>,
    /// Names and colours of labels: totalsegmentator (version 2), freesurfer, or a table: a TSV or CSV with a header,
    /// ITK-SNAP label descriptions, a .ctbl, or the JSON of DICOM SEG tools
    #[arg(long, value_name = "TABLE", requires = "labels")]
    pub(crate) names: Option<PathBuf>,
    /// Use free-text names of labels even where the input states the meaning of a code (DICOM SEG, .seg.nrrd, the
    /// JSON of DICOM SEG tools); free text may identify the patient, so by default the meanings of codes are used
    #[arg(long, requires = "labels")]
    pub(crate) keep_names: bool,
    /// How far walls of labels may move from the midpoint between samples, in voxels, 0 to 0.5 [default: 0.5]
    #[arg(long, value_name = "VOXELS", value_parser = parse::smooth, requires = "labels")]
    pub(crate) smooth: Option<f64>,
    /// Which mask or segment wins where several contain a voxel, when they are combined into one label map
    #[arg(long, value_parser = parse::choice::<Overlap, 3>(["first", "last", "refuse"]), default_value = "last", requires = "labels")]
    pub(crate) overlap: Overlap,
    /// Peak resident memory of the whole process
    #[arg(long, value_name = "SIZE", default_value = "64MiB", value_parser = parse_size)]
    pub(crate) memory: u64,
    #[command(flatten)]
    pub(crate) threads: ThreadArgs,
    #[command(flatten)]
    pub(crate) skin: SkinArgs,
    /// Leave out what cannot be seen from there: outside (anywhere beyond the volume's box), a view by its name
    /// (parallel), along:X,Y,Z (a parallel view in that direction), or the position X,Y,Z of an eye in mm; may be
    /// given several times
    #[arg(long, value_name = "WHERE", value_parser = viewed_from, allow_hyphen_values = true)]
    pub(crate) visible_from: Vec<ViewedFrom>,
    /// Store mean attributes of coarse nodes, for quick small pictures
    #[arg(long, value_enum, default_value_t = Switch::On)]
    pub(crate) lod: Switch,
    /// Folder for the scratch file; next to the output by default
    #[arg(long, value_name = "DIR")]
    pub(crate) scratch: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) run: RunArgs,
    #[command(flatten)]
    pub(crate) which: WhichArgs,
    #[command(flatten)]
    pub(crate) clean: CleanArgs,
    #[command(flatten)]
    pub(crate) raw: RawArgs,
    #[command(flatten)]
    pub(crate) mesh: MeshArgs,
}

#[derive(Debug, Args)]
#[command(
    mut_arg("otsu", |arg| arg.help("Choose the threshold of each volume by Otsu's method (the default)")),
    mut_arg("threads", |arg| arg.help("Worker threads in all; all cores by default")),
    mut_arg("quiet", |arg| arg.help("No progress, no lines for volumes"))
)]
pub(crate) struct BatchArgs {
    /// Folders (or files) to search
    #[arg(required = true, value_name = "DIR")]
    pub(crate) input: Vec<PathBuf>,
    /// Folder of the models, thumbnails and reports; made if it is not there
    #[arg(short, long, value_name = "DIR")]
    pub(crate) out: PathBuf,
    #[command(flatten)]
    pub(crate) selection: SelectionArgs,
    /// Peak resident memory of the whole process, shared by the jobs
    #[arg(long, value_name = "SIZE", default_value = "64MiB", value_parser = parse_size)]
    pub(crate) memory: u64,
    /// Volumes converted at a time; one per core by default
    #[arg(long, value_name = "N", value_parser = parse::jobs)]
    pub(crate) jobs: Option<usize>,
    #[command(flatten)]
    pub(crate) threads: ThreadArgs,
    /// Longest side of the thumbnails in pixels; 0 for none
    #[arg(long, value_name = "PIXELS", default_value = "256", value_parser = parse::side_or_none)]
    pub(crate) thumbnails: u32,
    /// Also make thumbnails of images whose pixels may show text, such as the patient's name: ultrasound,
    /// secondary captures, screenshots, and images whose Burned In Annotation is YES
    #[arg(long)]
    pub(crate) thumbnails_of_all: bool,
    #[command(flatten)]
    pub(crate) skin: SkinArgs,
    /// Folder for scratch files; the output folder by default
    #[arg(long, value_name = "DIR")]
    pub(crate) scratch: Option<PathBuf>,
    /// Show file and folder names in the contact sheet, as the reports do; by default it shows none
    #[arg(long)]
    pub(crate) keep_names: bool,
    #[command(flatten)]
    pub(crate) gaps: GapArgs,
    #[command(flatten)]
    pub(crate) search: SearchArgs,
    /// Skip volumes with fewer slices, such as scouts and scanned documents; they are listed as skipped
    #[arg(long, value_name = "N", default_value = "1", value_parser = clap::value_parser!(u32).range(1..=65536))]
    pub(crate) min_slices: u32,
    /// Take only DICOM series of these modalities, such as CT,MR; the others are listed as skipped
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    pub(crate) modality: Vec<String>,
    /// Take only these volumes, by their names in `oct scan` or the start of a name, such as mr-012; the others are
    /// listed as skipped
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    pub(crate) series: Vec<String>,
    /// Store mean attributes of coarse nodes, for quick small pictures
    #[arg(long, value_enum, default_value_t = Switch::On)]
    pub(crate) lod: Switch,
    /// Distance between neighbours in mm, for every volume; comes before what files state
    #[arg(long, value_name = "XxYxZ", value_parser = parse::spacing)]
    pub(crate) spacing: Option<[f64; 3]>,
    /// Patient directions that the axes run to, such as LPS or RAI, for every volume; comes before what files state
    #[arg(long, value_name = "LETTERS")]
    pub(crate) orientation: Option<Orientation>,
    #[command(flatten)]
    pub(crate) run: RunArgs,
    #[command(flatten)]
    pub(crate) clean: CleanArgs,
    #[command(flatten)]
    pub(crate) mesh: GridArgs,
}

#[derive(Debug, Args)]
pub(crate) struct ScanArgs {
    /// Folders (or files) to search
    #[arg(required = true, value_name = "DIR")]
    pub(crate) input: Vec<PathBuf>,
    #[command(flatten)]
    pub(crate) gaps: GapArgs,
    #[command(flatten)]
    pub(crate) search: SearchArgs,
    /// Also read the values, which takes as long as a batch: finds damaged pixels, and label maps that no header
    /// states
    #[arg(long)]
    pub(crate) values: bool,
    /// Print one JSON object
    #[arg(long)]
    pub(crate) json: bool,
    #[command(flatten)]
    pub(crate) mesh: GridArgs,
}

#[derive(Debug, Args)]
#[command(mut_arg("quiet", |arg| arg.help("No progress, no warnings")))]
pub(crate) struct DemoArgs {
    /// The model to write
    #[arg(short, long, value_name = "MODEL.oct", default_value = "head.oct")]
    pub(crate) output: PathBuf,
    /// Write model and picture even if their names say that they are other kinds of files
    #[arg(long)]
    pub(crate) force: bool,
    /// Voxels along a side of the synthetic volume
    #[arg(long, value_name = "N", default_value = "512", value_parser = parse::side)]
    pub(crate) size: u32,
    /// Write the volume itself (16-bit signed, little-endian) to a file, and do nothing else
    #[arg(long, value_name = "FILE")]
    pub(crate) write_raw: Option<PathBuf>,
    /// Inside are values of V and more; 400 (the skull) by default, -400 shows the skin
    #[arg(long, value_name = "V", allow_hyphen_values = true, value_parser = parse::number, default_value = "400")]
    pub(crate) iso: f64,
    /// Picture to write
    #[arg(long, value_name = "IMAGE.png")]
    pub(crate) picture: Option<PathBuf>,
    /// Peak resident memory of the whole process until the model is built; the pictures come after
    #[arg(long, value_name = "SIZE", default_value = "8MiB", value_parser = parse_size)]
    pub(crate) memory: u64,
    #[command(flatten)]
    pub(crate) threads: ThreadArgs,
    #[command(flatten)]
    pub(crate) run: RunArgs,
}

/// Selection of the inside.
#[derive(Debug, Args)]
pub(crate) struct SelectionArgs {
    /// Inside are values of V and more, in physical units (HU for CT)
    #[arg(long, value_name = "V", group = "selection", allow_hyphen_values = true, value_parser = parse::number)]
    pub(crate) iso: Option<f64>,
    /// Inside are values from LO to HI, both included
    #[arg(long, value_name = "LO..HI", group = "selection", allow_hyphen_values = true, value_parser = parse::range)]
    pub(crate) range: Option<[f64; 2]>,
    /// Choose the threshold by Otsu's method (the default); it may move the surface by a tenth of a voxel: `oct help formats`
    #[arg(long, group = "selection")]
    pub(crate) otsu: bool,
}

impl SelectionArgs {
    /// Was anything of it asked for?
    pub(crate) fn is_given(&self) -> bool {
        self.iso.is_some() || self.range.is_some() || self.otsu
    }

    /// The threshold of the library.
    pub(crate) fn threshold(&self) -> Threshold {
        match (self.iso, self.range) {
            (Some(iso), _) => Threshold::Iso(iso),
            (None, Some([lo, hi])) => Threshold::Range(lo, hi),
            (None, None) => Threshold::Otsu,
        }
    }
}

/// Surface of the model, and channels of its voxels.
#[derive(Debug, Args)]
pub(crate) struct SkinArgs {
    /// Surface of the model: cells between samples (for meshes and trees: voxel centres) with a plane in each, true
    /// to a few hundredths of a voxel; or skin voxels. By default cells, but skin for what only skin has: channels
    /// other than normals, sheets and thin walls, --gradient, --connectivity 6
    #[arg(long, value_name = "skin|cells", value_parser = parse::surface)]
    pub(crate) surface: Option<SurfaceKind>,
    /// Join cells into larger leaves that stay this close to the surface: in voxels of the finest spacing (0.1), or
    /// in mm (0.05mm); at most one voxel. It holds where the surface crosses the edges of cells; between these half as
    /// much again is allowed, and `oct info` shows what was measured
    #[arg(long, value_name = "BOUND", allow_hyphen_values = true)]
    pub(crate) error: Option<Tolerance>,
    /// Attributes per skin voxel: normal (the default), value, or none; offset implies --surface cells; for the
    /// skin of meshes normal, color (stored by default if they have colours), and material, the number of
    /// the part from 0 (file, object or group of OBJ, node of glTF, mesh of 3MF)
    #[arg(long, value_name = "LIST", value_parser = parse::channels)]
    pub(crate) channels: Option<Channels>,
    /// Measure the noise of the volume, and keep how steep each cell is, so that `oct compare` states how sure each
    /// distance is; of the cells of a volume, one byte each
    #[arg(long)]
    pub(crate) uncertainty: bool,
    /// How normals are estimated: central, sobel, isotropic5 (the default), modified (the paper's), label5 (for two values), or auto, which chooses the best of them for every 32 x 32 voxels and takes three times as long
    #[arg(long, value_name = "NAME", value_parser = parse::gradient)]
    pub(crate) gradient: Option<Gradient>,
    /// Connectivity of the skin: 26 (thin) or 6 (thick)
    #[arg(long, default_value = "26", value_parser = parse::connectivity)]
    pub(crate) connectivity: Connectivity,
}

impl SkinArgs {
    fn options(&self) -> BuildOptions {
        let Self { surface, error, channels, uncertainty, gradient, connectivity } = *self;
        BuildOptions {
            surface,
            error,
            channels,
            uncertainty,
            gradient,
            connectivity,
            ..BuildOptions::default()
        }
    }

    /// Refuses a flag that says nothing about cells, where these are built: they are asked for, or there are labels.
    pub(crate) fn refuse_ignored(&self, labels: Option<&LabelChoice>) -> Result<(), String> {
        let options = BuildOptions { labels: labels.cloned(), ..self.options() };
        let Some((name, of)) = options.ignored() else { return Ok(()) };
        let flag = match name {
            "surface" => "--surface skin",
            "gradient" => "--gradient",
            "uncertainty" => "--uncertainty",
            _ => "--connectivity",
        };
        Err(not_of(flag, of))
    }
}

/// Choice among the volumes of folders, and gaps of series.
#[derive(Debug, Args)]
#[command(next_help_heading = "Folders and series")]
pub(crate) struct WhichArgs {
    /// Take the volume of this number in the list of `oct scan`; the largest by default
    #[arg(long, value_name = "N", value_parser = parse::volume_number)]
    pub(crate) volume: Option<usize>,
    /// For OME-Zarr and Zarr, indices on the axes before z, by axis name and counted from 0, such as t=12,c=0
    #[arg(long, value_name = "AXIS=N,...", value_delimiter = ',', value_parser = parse::place_on_axis, conflicts_with = "volume")]
    pub(crate) index: Vec<(String, u64)>,
    #[command(flatten)]
    pub(crate) gaps: GapArgs,
    #[command(flatten)]
    pub(crate) links: LinkArgs,
}

/// Treatment of symbolic links.
#[derive(Debug, Args)]
pub(crate) struct LinkArgs {
    /// Search linked folders; also follow links out of a folder to data that a header or a side-car names
    #[arg(long)]
    pub(crate) follow_links: bool,
}

/// Folders to search, and the choice of their volumes.
#[derive(Debug, Args)]
pub(crate) struct SearchArgs {
    #[command(flatten)]
    pub(crate) links: LinkArgs,
    /// Take all volumes of a series that has more than 16 similar ones; by default the first (phases of a film,
    /// functional MR)
    #[arg(long)]
    pub(crate) all_volumes: bool,
}

/// Treatment of series with gaps.
#[derive(Debug, Args)]
pub(crate) struct GapArgs {
    /// If slices are missing or uneven: refuse, interpolate from their neighbours, or treat them as evenly spaced
    #[arg(long, value_parser = parse::choice::<GapPolicy, 3>(["error", "fill", "keep"]), default_value = "error")]
    pub(crate) gaps: GapPolicy,
}

/// Cleaning of the volume before it is built, in the order of these options.
#[derive(Debug, Args)]
#[command(next_help_heading = "Cleaning (in this order, whatever the order given)")]
pub(crate) struct CleanArgs {
    /// Use a part of the volume: voxel indices from X0 to X1 - 1, and so on
    #[arg(long, value_name = "X0..X1,Y0..Y1,Z0..Z1", value_parser = parse::roi)]
    pub(crate) roi: Option<parse::Roi>,
    /// Make the volume 2 or 4 times smaller along each axis, by averaging blocks; thick slices are averaged, too. Each pass
    /// still reads all of it
    #[arg(long, value_name = "2|4", value_parser = parse::downsample)]
    pub(crate) downsample: Option<u32>,
    /// Inside is a tissue by its range in HU (CT only): bone 226 and more, compact-bone 662 and more, teeth 1550
    /// and more, metal 2500 and more, skin -300 and more, muscle -5..135, fat -205..-51, lung -950..-500
    #[arg(long, value_name = "NAME", group = "selection", value_parser = parse::preset)]
    pub(crate) preset: Option<Preset>,
    /// Close gaps: dilation, then erosion, by a ball of R + 1/2 voxels, R = 1 or 2, whatever the spacing. Extra
    /// passes: the volume once (for this and all below together), the bits once
    #[arg(long, value_name = "R", value_parser = parse::closing)]
    pub(crate) close: Option<u32>,
    /// Fill what is enclosed: parts of the outside, connected through faces, that do not reach the border of the volume.
    /// Extra passes: the bits twice
    #[arg(long)]
    pub(crate) fill_cavities: bool,
    /// Keep the N largest components, of equal ones the first in z, y, x; each becomes one body of triangles. Extra passes:
    /// the bits twice
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = parse::keep_largest)]
    pub(crate) keep_largest: Option<u32>,
    /// Drop components of fewer voxels, or of less than a part of the largest one. Extra passes: the bits twice,
    /// together with --keep-largest
    #[arg(long, value_name = "VOXELS|PERCENT%", allow_negative_numbers = true)]
    pub(crate) drop_below: Option<SizeLimit>,
    /// Voxels of one component share a face (6), or a face, an edge or a corner (26), at which triangles come apart
    #[arg(long, value_name = "26|6", default_value = "6", value_parser = parse::component_connectivity)]
    pub(crate) component_connectivity: ComponentConnectivity,
}

impl CleanArgs {
    /// Refuses a rule for components where none are looked for.
    pub(crate) fn refuse_ignored(&self) -> Result<(), String> {
        let looked_for = self.keep_largest.is_some() || self.drop_below.is_some();
        if self.component_connectivity != ComponentConnectivity::default() && !looked_for {
            return Err(not_of("--component-connectivity", "--keep-largest and --drop-below"));
        }
        Ok(())
    }

    /// The options of the library.
    pub(crate) fn options(&self) -> CleanOptions {
        CleanOptions {
            roi: self.roi.as_ref().map(|roi| roi.0.clone()),
            downsample: self.downsample,
            preset: self.preset,
            close: self.close.unwrap_or(0),
            fill_cavities: self.fill_cavities,
            keep_largest: self.keep_largest,
            drop_below: self.drop_below,
            connectivity: self.component_connectivity,
        }
    }
}

impl BatchArgs {
    /// The options of the library.
    pub(crate) fn options(&self) -> BuildOptions {
        BuildOptions {
            threshold: self.selection.threshold(),
            lod: self.lod == Switch::On,
            memory: MemoryCap::Process(self.memory),
            threads: self.threads.count(),
            scratch: self.scratch.clone(),
            ..self.skin.options()
        }
    }
}

impl BuildArgs {
    /// The options of the library, with the names of the labels.
    pub(crate) fn options(&self, label_names: Vec<LabelName>) -> BuildOptions {
        BuildOptions {
            threshold: self.selection.threshold(),
            labels: self.labels.clone(),
            label_names,
            smooth: self.smooth.unwrap_or(MAX_SMOOTH),
            overlap: self.overlap,
            visible_from: self.visible_from.clone(),
            lod: self.lod == Switch::On,
            memory: MemoryCap::Process(self.memory),
            threads: self.threads.count(),
            scratch: self.scratch.clone(),
            ..self.skin.options()
        }
    }

    /// The model to write; empty where none is asked for.
    pub(crate) fn output(&self) -> &Path {
        self.output.as_deref().unwrap_or(Path::new(""))
    }

    /// Refuses a flag that says nothing about what is built.
    pub(crate) fn refuse_foreign(&self, kind: SubjectKind) -> Result<(), String> {
        self.skin.refuse_ignored(self.labels.as_ref())?;
        self.clean.refuse_ignored()?;
        let grid = &self.mesh.grid;
        let stated = [
            ("--unit", grid.unit.is_some(), "files without a unit, and glTF and 3MF state theirs"),
            ("--up", grid.up.is_some(), "files that do not say what is up, as glTF and 3MF do"),
        ];
        if let Some((flag, _, of)) = stated.into_iter().find(|(_, given, _)| *given)
            && self.input.iter().all(|path| states_place(path))
        {
            return Err(not_of(flag, of));
        }
        let of_meshes = || {
            first_given(&[
                ("--fill", grid.fill.is_some()),
                ("--keep-thin", grid.keep_thin),
                ("--up", grid.up.is_some()),
            ])
        };
        let gradient = || self.skin.gradient.map(|_| "--gradient");
        let (flag, of, is) = match kind {
            SubjectKind::Volume => {
                (grid.flag(), "meshes (STL, PLY, OBJ, OFF, glTF, 3MF) and trees (.csg)", "volume or of no known kind")
            }
            SubjectKind::Mesh => (self.volume_flag().or_else(gradient), "volumes", "mesh"),
            SubjectKind::Tree if self.input.len() > 1 => return Err("a tree of solids (.csg) is built by itself; join several by union() { ... } in one file, and meshes by import()".into()),
            SubjectKind::Tree => (self.volume_flag().or_else(of_meshes), "volumes", "tree of solids"),
        };
        match flag {
            None => Ok(()),
            Some("--dims") => Err(format!(
                "--dims of a {} needs --voxel and --origin as well; --grid N alone chooses all of them",
                if kind == SubjectKind::Tree { "tree" } else { is }
            )),
            Some(flag) => {
                let of = if matches!(flag, "--fill" | "--keep-thin") && kind == SubjectKind::Tree {
                    "meshes"
                } else {
                    of
                };
                Err(format!("{flag} is for {of}, and the input is a {is}; leave it out"))
            }
        }
    }

    /// A flag that was given and says something about volumes only.
    fn volume_flag(&self) -> Option<&'static str> {
        let Self { selection, clean, raw, which, mesh, .. } = self;
        first_given(&[
            ("--labels", self.labels.is_some()),
            ("--iso", selection.iso.is_some()),
            ("--range", selection.range.is_some()),
            ("--otsu", selection.otsu),
            ("--preset", clean.preset.is_some()),
            ("--roi", clean.roi.is_some()),
            ("--downsample", clean.downsample.is_some()),
            ("--close", clean.close.is_some()),
            ("--fill-cavities", clean.fill_cavities),
            ("--keep-largest", clean.keep_largest.is_some()),
            ("--drop-below", clean.drop_below.is_some()),
            ("--dtype", raw.dtype.is_some()),
            ("--spacing", raw.spacing.is_some()),
            ("--skip", raw.skip.is_some()),
            ("--orientation", raw.orientation.is_some()),
            ("--volume", which.volume.is_some()),
            ("--index", !which.index.is_empty()),
            // With both it is the size of the grid.
            ("--dims", raw.dims.is_some() && (mesh.grid.voxel.is_none() || mesh.origin.is_none())),
        ])
    }
}

/// The first flag that was given.
fn first_given(flags: &[(&'static str, bool)]) -> Option<&'static str> {
    flags.iter().find(|(_, given)| *given).map(|(flag, _)| *flag)
}

/// How a mesh becomes a solid.
#[derive(Debug, Args)]
pub(crate) struct MeshArgs {
    #[command(flatten)]
    pub(crate) grid: GridArgs,
    /// Low corner of the grid in mm; with --voxel and --dims nothing is moved or scaled
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = parse::triple, requires = "voxel", requires = "dims", help_heading = MESHES)]
    pub(crate) origin: Option<[f64; 3]>,
}

/// Heading of the options of meshes.
const MESHES: &str = "Meshes (STL, PLY, OBJ, OFF, glTF, 3MF) and trees of solids (.csg) only";

/// The grid of a mesh, and what is inside of it.
#[derive(Debug, Args)]
#[command(next_help_heading = MESHES)]
pub(crate) struct GridArgs {
    /// Voxels along the longest side of the grid, margins included; by default 512, 1024 for meshes of more than 64 MiB, or
    /// fewer as the memory needs. At least one voxel lies between the margins
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = parse::grid_side, conflicts_with = "voxel")]
    pub(crate) grid: Option<u32>,
    /// Edge of a voxel in mm
    #[arg(long, value_name = "MM", allow_hyphen_values = true, value_parser = parse::positive)]
    pub(crate) voxel: Option<f64>,
    /// Voxels left free at every side of the mesh; 1 by default
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = parse::margin)]
    pub(crate) margin: Option<u16>,
    /// Unit of the file's coordinates: um, mm (the default), cm, m or in; glTF and 3MF state theirs
    #[arg(long, value_name = "UNIT", value_parser = parse::unit_mm)]
    pub(crate) unit: Option<f64>,
    /// Axis of the file's coordinates that is up: z (the default) or y; glTF and 3MF state theirs
    #[arg(long, value_parser = parse::choice::<UpAxis, 2>(["z", "y"]), value_name = "z|y")]
    pub(crate) up: Option<UpAxis>,
    /// Inside is what the mesh winds around, or where a ray meets it an odd number of times; by default what suits
    /// the mesh. surface: only the voxels that the mesh itself crosses, for open sheets and thin shells
    #[arg(long, value_parser = parse::choice::<Fill, 3>(["winding", "parity", "surface"]), value_name = "winding|parity|surface")]
    pub(crate) fill: Option<Fill>,
    /// Keep walls thinner than a voxel: where a mesh passes between two neighbouring centres that are both outside,
    /// one of their voxels is inside, so that walls have no holes. Without effect on --fill surface
    #[arg(long)]
    pub(crate) keep_thin: bool,
}

impl GridArgs {
    /// A flag that was given.
    fn flag(&self) -> Option<&'static str> {
        first_given(&[
            ("--grid", self.grid.is_some()),
            ("--voxel", self.voxel.is_some()),
            ("--fill", self.fill.is_some()),
            ("--keep-thin", self.keep_thin),
            ("--margin", self.margin.is_some()),
            ("--unit", self.unit.is_some()),
            ("--up", self.up.is_some()),
        ])
    }

    /// How fine the grid is, if anything says it.
    fn choice(&self, whole: Option<([f64; 3], Dims)>) -> Option<GridChoice> {
        let margin = self.margin.unwrap_or(1).into();
        match (self.grid, self.voxel, whole) {
            (_, Some(edge_mm), Some((origin_mm, dims))) => {
                Some(GridChoice::Exact { edge_mm, origin_mm, dims })
            }
            (_, Some(edge_mm), None) => Some(GridChoice::Voxel { edge_mm, margin }),
            (Some(voxels), ..) => Some(GridChoice::Side { voxels, margin }),
            // The margin is of the usual grid.
            _ => self.margin.map(|_| GridChoice::Side { voxels: 512, margin }),
        }
    }

    fn within(&self, whole: Option<([f64; 3], Dims)>, links: &LinkArgs) -> GridOptions {
        GridOptions {
            grid: self.choice(whole),
            unit_mm: self.unit.unwrap_or(1.0),
            up: self.up.unwrap_or_default(),
            fill: self.fill,
            keep_thin: self.keep_thin,
            follow_links: links.follow_links,
        }
    }

    /// The options of the library, each mesh and tree on a grid of its own.
    pub(crate) fn options(&self, links: &LinkArgs) -> GridOptions {
        self.within(None, links)
    }
}

impl MeshArgs {
    /// The options of the library.
    pub(crate) fn options(&self, dims: Option<Dims>, links: &LinkArgs) -> GridOptions {
        self.grid.within(self.origin.zip(dims), links)
    }
}

/// Heading of the options that serve raw volumes and others alike.
const PLACE: &str = "Spacing and directions";

/// Geometry and samples of a headerless volume.
#[derive(Debug, Args)]
#[command(next_help_heading = "Raw volumes only")]
pub(crate) struct RawArgs {
    /// Size in voxels, x fastest
    #[arg(long, value_name = "NXxNYxNZ", value_parser = parse::dims)]
    pub(crate) dims: Option<Dims>,
    /// Sample type: u8, i8, u16, i16, u32, i32, f32 or f64, with le (default) or be
    #[arg(long, value_name = "TYPE", value_parser = parse::dtype)]
    pub(crate) dtype: Option<(ScalarType, Endian)>,
    /// Distance between neighbours in mm, of volumes; comes before what files state. Where nothing states it, 1x1x1
    #[arg(long, value_name = "XxYxZ", value_parser = parse::spacing, help_heading = PLACE)]
    pub(crate) spacing: Option<[f64; 3]>,
    /// Bytes to skip at the start of every file
    #[arg(long, value_name = "BYTES", allow_negative_numbers = true, value_parser = parse::skip)]
    pub(crate) skip: Option<u64>,
    /// Patient directions that the axes run to, such as LPS or RAI, of volumes; comes before what files state
    #[arg(long, value_name = "LETTERS", help_heading = PLACE)]
    pub(crate) orientation: Option<Orientation>,
}
