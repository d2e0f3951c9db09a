//! The command line as types: the commands, and the options of those that only read models.
//!
//! | part | what it holds |
//! |---|---|
//! | [`volume`] | options of the commands that read volumes |
//! | [`picture`] | options of the commands that make pictures |
//! | [`parts`] | options of the commands that build a model in parts |
//! | [`parse`] | values of options, and the sentences for wrong ones |
//! | [`examples`] | what stands below the help of each command |

mod compare;
mod examples;
mod parse;
mod parts;
mod picture;
mod volume;

use std::path::PathBuf;

use clap::{Args, CommandFactory, Parser, Subcommand, ValueEnum};
use infobyte::builder::Tolerance;
use infobyte::export::ExportForm;
use infobyte::format::Channels;
use infobyte::geom::Affine;

pub(crate) use compare::{CompareArgs, MeasureArgs, ThicknessArgs};
pub(crate) use parts::{MergeArgs, PartArgs, PlanArgs};
pub(crate) use picture::{RenderArgs, ThumbnailArgs};
pub(crate) use volume::{BatchArgs, BuildArgs, BuildCommand, DemoArgs, RawArgs, ScanArgs};

/// Build compact surface octrees from volumes in a fixed amount of memory, and render them by exact ray traversal.
#[derive(Debug, Parser)]
#[command(name = "oct", version, arg_required_else_help = true)]
pub(crate) struct Cli {
    #[command(subcommand)]
    pub(crate) command: Command,
}

/// Names of values that are numbers and sizes.
const NUMBERS: &str = "N V R SIZE MM DEG WxH PIXELS XxYxZ NXxNYxNZ X0..X1,Y0..Y1,Z0..Z1 SECONDS VOXELS VOXELS|PERCENT% FACTOR \
    1..1024 2|4 26|6 BYTES CONNECTIVITY LOD SAMPLES";

/// The command line as it is read. A word such as `-4MiB` is the value of an option before it, whose sentence fits
/// better than one on an unknown option.
pub(crate) fn command() -> clap::Command {
    let is_negative =
        |word: std::ffi::OsString| matches!(word.as_encoded_bytes(), [b'-', b'0'..=b'9' | b'.', ..]);
    let negative = std::env::args_os().any(is_negative);
    let is_number = |arg: &clap::Arg| {
        let is_known = |name: &str| NUMBERS.split_whitespace().any(|known| known == name);
        arg.get_long().is_some()
            && arg.get_value_names().is_some_and(|names| names.iter().any(|name| is_known(name)))
    };
    let taking =
        move |arg: clap::Arg| if negative && is_number(&arg) { arg.allow_hyphen_values(true) } else { arg };
    Cli::command().mut_subcommands(move |command| command.mut_args(taking))
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Build a model from a volume (a file, a DICOM folder, or slice files), from meshes or from a tree of solids
    #[command(after_help = examples::BUILD)]
    Build(BuildCommand),
    /// Convert every volume below some folders, with thumbnails and a report
    #[command(after_help = examples::BATCH)]
    Batch(BatchArgs),
    /// List what would be converted, and why the rest would be refused
    #[command(after_help = examples::SCAN)]
    Scan(ScanArgs),
    /// Plan a model in parts, to be built on many machines
    #[command(after_help = examples::PLAN)]
    Plan(PlanArgs),
    /// Build one part of a plan, unless it already exists
    #[command(after_help = examples::PART)]
    Part(PartArgs),
    /// Join the parts of a plan into the same model as a single build, byte for byte
    #[command(after_help = examples::MERGE)]
    Merge(MergeArgs),
    /// Show the metadata and measurements of a model (mapped or packed)
    #[command(after_help = examples::INFO)]
    Info(InfoArgs),
    /// Check that a model file is undamaged (mapped or packed)
    #[command(after_help = examples::VERIFY)]
    Verify(ModelArgs),
    /// Pack a model for archive and transport; lossless
    #[command(after_help = examples::PACK)]
    Pack(PackArgs),
    /// Unpack a packed model; gives the original byte for byte
    #[command(after_help = examples::UNPACK)]
    Unpack(PackArgs),
    /// Write a smaller model, without some channels or its finest levels
    #[command(after_help = examples::STRIP)]
    Strip(StripArgs),
    /// Write a model as triangles, points or a mask, for other programs, or as a page for a browser
    #[command(after_help = examples::EXPORT)]
    Export(ExportArgs),
    /// Report whether two models touch, and where
    #[command(after_help = examples::INTERSECT)]
    Intersect(IntersectArgs),
    /// Measure how far one surface lies from another: a part from its drawing
    #[command(after_help = examples::COMPARE)]
    Compare(CompareArgs),
    /// Measure how thick the walls of a model are
    #[command(after_help = examples::THICKNESS)]
    Thickness(ThicknessArgs),
    /// List the pores that a model encloses, or its separate bodies
    #[command(after_help = examples::PORES)]
    Pores(PoresArgs),
    /// Render a picture of a model
    #[command(after_help = examples::RENDER)]
    Render(RenderArgs),
    /// Render a small square picture with a transparent background
    #[command(after_help = examples::THUMBNAIL)]
    Thumbnail(ThumbnailArgs),
    /// Build and draw a synthetic head, to try the program without any data
    #[command(after_help = examples::DEMO)]
    Demo(DemoArgs),
    /// Show a model in a browser on this machine, until Ctrl-C
    #[command(after_help = examples::VIEW)]
    View(ViewArgs),
    /// Check the rays of this machine: random ones through a model, against a slow exact reference
    #[command(after_help = examples::SELFCHECK)]
    Selfcheck(SelfcheckArgs),
    /// Measure speed and error of all settings on known bodies, or a model's levels of detail
    #[command(after_help = examples::REPORT)]
    Report(ReportArgs),
    /// Print a script that completes commands, options and files in a shell
    #[command(after_help = examples::COMPLETIONS)]
    Completions(CompletionsArgs),
    /// Write the manual: a page for each command
    #[command(after_help = examples::MAN)]
    Man(ManArgs),
}

#[derive(Debug, Args)]
pub(crate) struct StripArgs {
    #[command(flatten)]
    pub(crate) files: PackArgs,
    /// Channels that stay, separated by commas, or none; all by default
    #[arg(long, value_name = "LIST", value_parser = parse::kept_channels)]
    pub(crate) channels: Option<Channels>,
    /// Number of finest levels to remove; each makes boxes twice as long
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value_t = 0)]
    pub(crate) levels: u32,
    /// Keep the means of coarse nodes, where they are
    #[arg(long, value_enum, default_value_t = Switch::On)]
    pub(crate) lod: Switch,
}

#[derive(Debug, Args)]
pub(crate) struct ExportArgs {
    /// The model (mapped or packed); - for standard input
    #[arg(value_name = "MODEL.oct")]
    pub(crate) model: PathBuf,
    /// The file to write; - for standard output
    #[arg(short, long, value_name = "FILE", required_unless_present = "each", conflicts_with = "each")]
    pub(crate) output: Option<PathBuf>,
    /// Write the surface of each label into a file of its own in this folder, named by the label
    #[arg(long, value_name = "FOLDER")]
    pub(crate) each: Option<PathBuf>,
    /// What to write: triangles (stl, ply, obj, glb, 3mf; one part per label), points (a PLY of the skin), a mask
    /// (nrrd, nii, nii.gz), a page that shows the model in a browser (html), or one that fetches it from its web server
    /// (linked); by default what the file name implies
    #[arg(long = "as", value_name = "FORM", value_parser = parse::one_of(&ExportForm::ALL, ExportForm::name))]
    pub(crate) form: Option<ExportForm>,
    /// Leave out corners of triangles while the surface stays this close to the full one: in voxels of the finest
    /// spacing (0.1), or in mm (0.05mm)
    #[arg(long, value_name = "BOUND", allow_hyphen_values = true)]
    pub(crate) error: Option<Tolerance>,
    /// Make at most so many triangles; how far they are from the full surface is measured. With --error whichever comes first
    #[arg(long, value_name = "N", allow_hyphen_values = true, value_parser = parse::triangles)]
    pub(crate) triangles: Option<u64>,
    /// How far walls of labels may move along each axis to be smooth, in voxels, 0 to 0.5; at 0, and where labels are
    /// thin, they follow the faces of voxels [default: 0.5]
    #[arg(long, value_name = "VOXELS", value_parser = parse::smooth)]
    pub(crate) smooth: Option<f64>,
    #[command(flatten)]
    pub(crate) labels: picture::LabelArgs,
    /// In a mask set only the skin, not what it encloses
    #[arg(long)]
    pub(crate) skin: bool,
    /// Write even if the name says that the file is of another kind
    #[arg(long)]
    pub(crate) force: bool,
    #[command(flatten)]
    pub(crate) run: RunArgs,
}

#[derive(Debug, Args)]
pub(crate) struct IntersectArgs {
    /// One model (mapped or packed)
    #[arg(value_name = "A.oct")]
    pub(crate) one: PathBuf,
    /// The other
    #[arg(value_name = "B.oct")]
    pub(crate) other: PathBuf,
    /// Translation of the other model, in mm (LPS)
    #[arg(long = "move", value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = parse::triple, conflicts_with = "place")]
    pub(crate) moved: Option<[f64; 3]>,
    /// Transform of the other model: three rows of four numbers, from its mm to those of the first
    #[arg(long, value_name = "M", allow_hyphen_values = true, value_parser = parse::placement)]
    pub(crate) place: Option<Affine>,
    /// Exit with 6 unless the bodies are at least this far apart, in mm; 0: unless they do not overlap
    #[arg(long, value_name = "MM", allow_hyphen_values = true, value_parser = parse::clearance)]
    pub(crate) clearance: Option<f64>,
    /// Print one JSON object
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, Args)]
pub(crate) struct PoresArgs {
    /// The model of cells (mapped or packed)
    #[arg(value_name = "MODEL.oct")]
    pub(crate) model: PathBuf,
    /// List separate bodies of the solid, not pores
    #[arg(long)]
    pub(crate) bodies: bool,
    /// Write a table of all of them
    #[arg(long, value_name = "FILE.csv")]
    pub(crate) csv: Option<PathBuf>,
    /// Leave out pores or bodies of fewer voxels
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub(crate) least: u64,
    /// Measure how far each pore is from the outer surface
    #[arg(long, conflicts_with = "bodies")]
    pub(crate) gap: bool,
    #[command(flatten)]
    pub(crate) run: RunArgs,
}

#[derive(Debug, Args)]
pub(crate) struct ViewArgs {
    /// The model (mapped or packed), a scene, or a folder of models
    #[arg(value_name = "MODEL.oct|SCENE.toml|FOLDER")]
    pub(crate) model: PathBuf,
    /// Port on this machine; a free one by default
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub(crate) port: u16,
    /// Stop after this many seconds without a request
    #[arg(long, value_name = "SECONDS")]
    pub(crate) idle: Option<u64>,
    /// Print the address, and open no browser
    #[arg(long)]
    pub(crate) no_open: bool,
}

#[derive(Debug, Args)]
pub(crate) struct InfoArgs {
    /// The model; - for standard input
    #[arg(value_name = "MODEL.oct")]
    pub(crate) model: PathBuf,
    /// Measure surface and volume however long it takes; by default only unpacked models of up to 16 million skin
    /// voxels are measured
    #[arg(long)]
    pub(crate) measure: bool,
    /// Also list the make-up of the file: tree, sections, ratios, checksum
    #[arg(long)]
    pub(crate) all: bool,
    /// Print one JSON object
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, Args)]
pub(crate) struct CompletionsArgs {
    /// The shell
    #[arg(value_enum, value_name = "SHELL")]
    pub(crate) shell: clap_complete::Shell,
}

#[derive(Debug, Args)]
pub(crate) struct ManArgs {
    /// Folder of the pages; made if it is not there
    #[arg(value_name = "DIR")]
    pub(crate) folder: PathBuf,
}

/// A model that is only read.
#[derive(Debug, Args)]
pub(crate) struct ModelArgs {
    /// The model; - for standard input
    #[arg(value_name = "MODEL.oct")]
    pub(crate) model: PathBuf,
    /// Print one JSON object
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, Args)]
pub(crate) struct PackArgs {
    /// The file to read; - for standard input
    #[arg(value_name = "IN.oct")]
    pub(crate) input: PathBuf,
    /// The file to write; - for standard output
    #[arg(short, long, value_name = "OUT.oct")]
    pub(crate) output: PathBuf,
    /// Write it even if its name says that it is another kind of file
    #[arg(long)]
    pub(crate) force: bool,
    /// Print one JSON object
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, Args)]
pub(crate) struct SelfcheckArgs {
    /// The model; - for standard input
    #[arg(value_name = "MODEL.oct")]
    pub(crate) model: PathBuf,
    /// Random rays to compare with the exact reference
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value = "1000000", value_parser = clap::value_parser!(u64).range(1..))]
    pub(crate) rays: u64,
    /// Seed of the random sequence
    #[arg(long, value_name = "N", default_value = "1")]
    pub(crate) seed: u64,
    #[command(flatten)]
    pub(crate) threads: ThreadArgs,
    /// Print one JSON object
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, Args)]
#[command(group = clap::ArgGroup::new("subject").required(true).multiple(true))]
pub(crate) struct ReportArgs {
    /// A model: measured against its own full-quality picture, as its true surface is not known
    #[arg(value_name = "MODEL.oct", group = "subject")]
    pub(crate) model: Option<PathBuf>,
    /// A synthetic volume whose surface is known, as NAME, NAME@N or NAME@N?key=value; suite for several bodies, head
    /// for the head; may be given several times
    #[arg(long, value_name = "NAME", group = "subject")]
    pub(crate) synthetic: Vec<String>,
    /// Folder of the page, its tables and drawings; made if it is not there
    #[arg(short, long, value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// Side in pixels of the pictures used to measure errors
    #[arg(long, value_name = "PIXELS", default_value = "256", value_parser = clap::value_parser!(u32).range(16..=4096))]
    pub(crate) pixels: u32,
    #[command(flatten)]
    pub(crate) threads: ThreadArgs,
    #[command(flatten)]
    pub(crate) run: RunArgs,
}

/// The report of a command that shows its progress.
#[derive(Debug, Args)]
pub(crate) struct RunArgs {
    /// Print one JSON object
    #[arg(long)]
    pub(crate) json: bool,
    /// No progress
    #[arg(long)]
    pub(crate) quiet: bool,
}

impl RunArgs {
    /// True if no progress is shown.
    pub(crate) fn is_silent(&self) -> bool {
        self.quiet || self.json
    }
}

/// A placement that was given in full, or as a translation.
pub(crate) fn placed(place: Option<Affine>, moved: Option<[f64; 3]>) -> Affine {
    let mut placement = place.unwrap_or(Affine::from_spacing([1.0; 3]));
    for (row, by) in placement.rows.iter_mut().zip(moved.unwrap_or_default()) {
        row[3] += by;
    }
    placement
}

/// How many threads work.
#[derive(Debug, Args)]
pub(crate) struct ThreadArgs {
    /// Worker threads; all cores by default
    #[arg(long, value_name = "N", value_parser = parse::threads)]
    pub(crate) threads: Option<usize>,
}

impl ThreadArgs {
    /// The number given, or that of the cores.
    pub(crate) fn count(&self) -> usize {
        self.threads.unwrap_or_else(cores)
    }
}

/// Cores that the system lets the process use.
pub(crate) fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// `on` or `off`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Switch {
    On,
    Off,
}

#[cfg(test)]
mod tests {
    use infobyte::volume::{Endian, ScalarType};

    use super::*;

    fn build(extra: &str) -> Result<BuildArgs, clap::Error> {
        let line = ["oct", "build", "in.raw", "-o", "out.oct"].into_iter().chain(extra.split_whitespace());
        match Cli::try_parse_from(line)?.command {
            Command::Build(args) => Ok(args.build),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn negative_values_and_ranges_are_understood_and_exclude_each_other() {
        assert_eq!(build("--iso -300").unwrap().selection.iso, Some(-300.0));
        assert_eq!(build("--iso=-300").unwrap().selection.iso, Some(-300.0));
        assert_eq!(build("--range -300..500").unwrap().selection.range, Some([-300.0, 500.0]));
        assert_eq!(build("--range -3.5..-1").unwrap().selection.range, Some([-3.5, -1.0]));
        assert_eq!(build("").unwrap().memory, 64 << 20);
        for bad in [
            "--iso 1 --otsu",
            "--iso 1 --range 1..2",
            "--iso nan",
            "--range 5..1",
            "--range 5",
            "--threads 0",
            "--channels smell",
            "--connectivity 18",
            "--dims 4x4",
            "--dims 0x4x4",
            "--spacing 1x1x0",
            "--orientation LRS",
            "--dtype u12",
            "--memory lots",
        ] {
            assert_eq!(build(bad).unwrap_err().exit_code(), 2, "{bad}");
        }
    }

    #[test]
    fn raw_options_parse() {
        let line = "--dims 3x4x5 --dtype i16be --spacing 0.5x0.5x1.25 --orientation rai";
        let raw = build(line).unwrap().raw;
        assert_eq!(raw.dims.unwrap().to_array(), [3, 4, 5]);
        assert_eq!(raw.dtype, Some((ScalarType::I16, Endian::Big)));
        assert_eq!(raw.spacing, Some([0.5, 0.5, 1.25]));
        assert_eq!(raw.orientation.unwrap().to_string(), "RAI");
        assert_eq!(build("--spacing 0.5,0.5,1.25").unwrap().raw.spacing, raw.spacing);
    }

    #[test]
    fn an_eye_needs_something_to_look_at() {
        let render = |extra: &[&str]| {
            Cli::try_parse_from(["oct", "render", "a.oct", "-o", "a.png"].iter().chain(extra))
        };
        assert!(render(&["--eye", "-1,-2,3.5", "--look-at", "0,0,0", "--up", "0,0,1"]).is_ok());
        assert!(render(&["--eye", "1,2,3"]).is_err());
        assert!(render(&["--look-at", "1,2,3"]).is_err());
        assert!(render(&["--view", "front", "--eye", "1,2,3", "--look-at", "0,0,0"]).is_err());
    }
}
