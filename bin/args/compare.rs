//! Arguments of `oct compare` and `oct thickness`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use infobyte::budget::{MemoryCap, parse_size};
use infobyte::builder::Threshold;
use infobyte::geom::Affine;
use infobyte::jobs::compare::CompareRequest;
use infobyte::jobs::thickness::{Method, ThicknessRequest};

use super::{RunArgs, ThreadArgs, parse, placed};

/// Options of both.
#[derive(Debug, Args)]
pub(crate) struct MeasureArgs {
    /// Write the measured model with its values, to be shown in colours
    #[arg(short, long, value_name = "OUT.oct")]
    pub(crate) output: Option<PathBuf>,
    /// Write a table of all cells
    #[arg(long, value_name = "FILE.csv")]
    pub(crate) csv: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) threads: ThreadArgs,
    /// Write OUT.oct even if its name says that it is another kind of file
    #[arg(long)]
    pub(crate) force: bool,
    #[command(flatten)]
    pub(crate) run: RunArgs,
}

#[derive(Debug, Args)]
pub(crate) struct CompareArgs {
    /// The part as made: a model, or anything that `build` reads
    #[arg(value_name = "ACTUAL")]
    pub(crate) actual: PathBuf,
    /// The part as it should be; a mesh is built on a grid twice as fine as that of ACTUAL
    #[arg(value_name = "NOMINAL")]
    pub(crate) nominal: PathBuf,
    /// Greatest deviation that conforms, in mm, or the least and the greatest
    #[arg(long, value_name = "MM|LO..HI", allow_hyphen_values = true, value_parser = parse::tolerance)]
    pub(crate) tolerance: Option<[f64; 2]>,
    /// Farthest distance at which a counterpart is looked for, in mm; a twentieth of NOMINAL's diagonal by default
    #[arg(long, value_name = "MM", value_parser = parse::positive)]
    pub(crate) radius: Option<f64>,
    /// Greatest angle between the normals of a place and its counterpart, in degrees
    #[arg(long, value_name = "DEG", default_value_t = 90.0, value_parser = parse::number)]
    pub(crate) angle: f64,
    /// Align ACTUAL with NOMINAL first
    #[arg(long)]
    pub(crate) fit: bool,
    /// Translation of ACTUAL, in mm (LPS)
    #[arg(long = "move", value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = parse::triple, conflicts_with = "place")]
    pub(crate) moved: Option<[f64; 3]>,
    /// Transform of ACTUAL: three rows of four numbers, from its mm to those of NOMINAL
    #[arg(long, value_name = "M", allow_hyphen_values = true, value_parser = parse::placement)]
    pub(crate) place: Option<Affine>,
    /// Standard deviation of the threshold of ACTUAL, in its values: says how far it moves all cells together
    #[arg(long, value_name = "V")]
    pub(crate) threshold_sigma: Option<f64>,
    /// Measure NOMINAL from ACTUAL, too: what ACTUAL lacks does not conform
    #[arg(long)]
    pub(crate) both_ways: bool,
    /// Worst places to list
    #[arg(long, value_name = "N", default_value_t = 10)]
    pub(crate) worst: usize,
    /// Inside of inputs that are volumes are values of V and more; by Otsu's method by default
    #[arg(long, value_name = "V", allow_hyphen_values = true, value_parser = parse::number)]
    pub(crate) iso: Option<f64>,
    /// Peak resident memory while a volume or mesh given as input is built
    #[arg(long, value_name = "SIZE", default_value = "64MiB", value_parser = parse_size)]
    pub(crate) memory: u64,
    #[command(flatten)]
    pub(crate) run: MeasureArgs,
}

impl CompareArgs {
    /// The request of the library.
    pub(crate) fn request(&self) -> CompareRequest {
        CompareRequest {
            radius_mm: self.radius,
            tolerance_mm: self.tolerance,
            angle_deg: self.angle,
            placement: placed(self.place, self.moved),
            fit: self.fit,
            threshold_sigma: self.threshold_sigma,
            both_ways: self.both_ways,
            worst: self.worst,
            threshold: self.iso.map_or(Threshold::Otsu, Threshold::Iso),
            memory: MemoryCap::Process(self.memory),
            threads: self.run.threads.count(),
        }
    }
}

/// How thickness is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum By {
    /// The way to the other side along the normal: for parallel walls
    Ray,
    /// The largest ball within that touches the place: for free forms
    Ball,
}

#[derive(Debug, Args)]
pub(crate) struct ThicknessArgs {
    /// The model of cells (mapped or packed)
    #[arg(value_name = "MODEL.oct")]
    pub(crate) model: PathBuf,
    /// How it is measured
    #[arg(long, value_enum, default_value = "ray")]
    by: By,
    /// Greatest thickness to look for, in mm; by default without limit for rays, and for balls an eighth of the shortest
    /// side, at most 32 voxels, or --thin if that is more
    #[arg(long, value_name = "MM", value_parser = parse::positive)]
    max: Option<f64>,
    /// List places that are thinner, in mm
    #[arg(long, value_name = "MM", value_parser = parse::positive)]
    thin: Option<f64>,
    #[command(flatten)]
    pub(crate) run: MeasureArgs,
}

impl ThicknessArgs {
    /// The request of the library.
    pub(crate) fn request(&self) -> ThicknessRequest {
        ThicknessRequest {
            by: if self.by == By::Ball { Method::Ball } else { Method::Ray },
            max_mm: self.max,
            thin_mm: self.thin,
            threads: self.run.threads.count(),
        }
    }
}
