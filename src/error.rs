//! The errors of every boundary gathered once, and the exit code that each kind of failure has.
//!
//! An error has a kind, a path and one sentence with its remedy. The sentence is written at the place that finds the
//! fault; a fault is a variant of its own only where code branches on it. No code reads a sentence.

#![expect(missing_docs, reason = "the sentence of each variant says it")]

use std::io;
use std::path::PathBuf;

use thiserror::Error as Sentence;

use crate::budget::Bytes;
use crate::builder::BuildError;
use crate::clean::CleanError;
use crate::exit::ExitKind;
use crate::export::ExportFault;
use crate::fault::Fault;
use crate::format::{Channel, FormatError};
use crate::load::LoadError;
use crate::page;
use crate::progress::Stopped;
use crate::render::RenderError;
use crate::scene::SceneError;
use crate::text::names::{
    CHANNELS, EACH, ERROR, FORCE, FORM, GRADIENT, INFO, LABELS, LEGEND, LEVELS, LOD, OUT, OUTPUT, PORT,
    RANGE, SECTION, SKIN, SMOOTH, SURFACE, VIEW, VISIBLE_FROM,
};
use crate::text::{Short, shown, writing};
use crate::volume::SourceError;

/// Anything that can stop a job.
#[non_exhaustive]
#[derive(Debug, Sentence)]
pub enum Error {
    #[error(transparent)]
    Usage(#[from] UsageError),
    #[error(transparent)]
    Source(SourceError),
    #[error(transparent)]
    Build(BuildError),
    #[error(transparent)]
    Clean(CleanError),
    #[error(transparent)]
    Format(#[from] FormatError),
    #[error(transparent)]
    Load(LoadError),
    #[error(transparent)]
    Render(RenderError),
    #[error(transparent)]
    Scene(SceneError),
    #[error(transparent)]
    Measure(#[from] Fault),
    #[error("{Stopped}")]
    Stopped,
    #[error("{}: another batch is writing into this folder; wait until it has finished, or choose another folder with {OUT}", shown(.path))]
    Busy { path: PathBuf },
    #[error("{}: cannot be written ({cause}); {}", shown(.path), writing(.cause))]
    Output {
        path: PathBuf,
        #[source]
        cause: io::Error,
    },
    #[error("port {port} of 127.0.0.1 cannot be used ({cause}); choose another with {PORT}, or leave it out")]
    Port {
        port: u16,
        #[source]
        cause: io::Error,
    },
    #[error("an internal error stopped its conversion; please report it with the file")]
    Internal,
}

/// A request that cannot be met, whatever the input.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Sentence)]
pub enum UsageError {
    #[error("{}: keeps only what can be seen ({VISIBLE_FROM} {seen_from}), so that its inside is not known; build it without {VISIBLE_FROM}, or write its skin with {FORM} points, or a mask with {SKIN}", shown(.path))]
    KeepsPart { path: PathBuf, seen_from: String },
    #[error("{}: is a skin of voxels, which is too coarse to measure; build it with {SURFACE} cells", shown(.path))]
    TooCoarse { path: PathBuf },
    #[error("{}: has labels, and cannot be {doing} yet with them; build one of its labels by its range of values ({RANGE})", shown(.path))]
    Labels {
        path: PathBuf,
        /// What cannot be done to it.
        doing: &'static str,
    },
    #[error("{}: {}; give a TSV or CSV with a header, ITK-SNAP label descriptions, a .ctbl, or the JSON of DICOM SEG tools", shown(.path), unread(*.line))]
    LabelNames { path: PathBuf, line: usize },
    #[error("{}: names the label {number} twice; name it once", shown(.path))]
    LabelTwice { path: PathBuf, number: u16 },
    #[error("{}: already exists; {FORCE} replaces it, and the models of the other labels", shown(.path))]
    Exists { path: PathBuf },
    #[error("{}: has no labels that could be hidden; build a map of labels with {LABELS}", shown(.path))]
    Unlabelled { path: PathBuf },
    #[error("{}: has no labels to list; leave out {LEGEND}, or build a map of labels with {LABELS}", shown(.path))]
    NoLegend { path: PathBuf },
    #[error("{}: the plane does not intersect it; choose {SECTION} with {axis} from {} to {} mm", shown(.path), Short(*.from_mm), Short(*.to_mm))]
    Section { path: PathBuf, axis: char, from_mm: f64, to_mm: f64 },
    #[error("{}: has a single surface and no labels; leave out {EACH} and {SMOOTH}, or build a map of labels with {LABELS}", shown(.path))]
    OneSurface { path: PathBuf },
    #[error("{}: walls are moved by 0 to half a voxel; choose {SMOOTH} in between", shown(.path))]
    SmoothRange { path: PathBuf },
    #[error("{}: has no label {label}; {INFO} lists those of a model", shown(.path))]
    NoLabel {
        path: PathBuf,
        /// As it was asked for.
        label: String,
    },
    #[error("{}: labels are built without cleaning; leave out {asked}", shown(.path))]
    CleanLabels { path: PathBuf, asked: &'static str },
    #[error("{}: holds no volume, and normals are estimated for volumes only; leave out {GRADIENT}", shown(.path))]
    GradientOfTree { path: PathBuf },
    #[error("{}: is the input, {}; name another file with {OUTPUT}", shown(.path), if *.folder { "or part of it, and would be replaced by the model" } else { "and would be replaced" })]
    ReplacesInput { path: PathBuf, folder: bool },
    #[error("{}: has {}, more than a page in a browser holds ({}); build it on a coarser grid or within a bound ({ERROR}), or look at it with {VIEW}", shown(.path), Bytes(*.bytes), Bytes(page::MAX_BYTES))]
    PageTooLarge { path: PathBuf, bytes: u64 },
    #[error("{}: has {labels} labels, and a page holds {}; build it of fewer ({LABELS}), or look at it with {VIEW}", shown(.path), page::MAX_LABELS)]
    PageLabels { path: PathBuf, labels: usize },
    #[error("{}: has no models; give a folder that holds files named .oct", shown(.path))]
    NoModels { path: PathBuf },
    #[error("{}: is the model and would be replaced by a picture; name another file", shown(.path))]
    ReplacesModel { path: PathBuf },
    #[error("{}: two pictures would be written to it; name another file for one of them", shown(.path))]
    NamedTwice { path: PathBuf },
    #[error("{}: {fault}", shown(.path))]
    Strip { path: PathBuf, fault: StripFault },
    #[error("{}: {fault}", shown(.path))]
    Export { path: PathBuf, fault: ExportFault },
    #[error("{}: the placement makes it flat; give three rows that are not parallel, as in 1,0,0,0,0,1,0,0,0,0,1,0", shown(.path))]
    FlatPlacement { path: PathBuf },
    #[error("a head of {side} voxels a side cannot be made; choose 1 to 65536")]
    HeadSize { side: u32 },
}

/// Why a table of labels cannot be read; line 0 for the whole.
fn unread(line: usize) -> String {
    if line == 0 {
        "is not a table of labels".into()
    } else {
        format!("line {line} is not a row of a table of labels")
    }
}

/// Why something cannot be left out of a model.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Sentence)]
pub enum StripFault {
    #[error(
        "a model of cells stores its surface in its channels and finest boxes, so both must stay; only {LOD} off removes something"
    )]
    Cells,
    #[error("does not have {asked} levels to leave out; choose {LEVELS} 0 to {most}")]
    Levels { asked: u32, most: u32 },
    #[error("coarse boxes have no mean of the channel '{channel}'; leave it out with {CHANNELS}")]
    NoMeans { channel: Channel },
    #[error("does not have the channel '{channel}'; {INFO} names those that it has")]
    NoChannel { channel: Channel },
}

/// An error of one boundary becomes the variant of the same name, or [`Error::Stopped`].
macro_rules! gathers {
    ($($variant:ident($inner:ty)),*) => {$(
        impl From<$inner> for Error {
            fn from(cause: $inner) -> Self {
                match cause.kind() {
                    ExitKind::Stopped => Self::Stopped,
                    _ => Self::$variant(cause),
                }
            }
        }
    )*};
}

gathers!(
    Source(SourceError),
    Build(BuildError),
    Clean(CleanError),
    Load(LoadError),
    Render(RenderError),
    Scene(SceneError)
);

impl Error {
    /// The kind of failure, hence the exit code.
    pub fn kind(&self) -> ExitKind {
        match self {
            Self::Usage(_) => ExitKind::Usage,
            Self::Source(e) => e.kind(),
            Self::Build(e) => e.kind(),
            Self::Clean(e) => e.kind(),
            Self::Format(_) => ExitKind::Input,
            Self::Load(e) => e.kind(),
            Self::Render(e) => e.kind(),
            Self::Scene(e) => e.kind(),
            Self::Measure(fault) => fault.exit(),
            Self::Stopped => ExitKind::Stopped,
            Self::Busy { .. } | Self::Output { .. } | Self::Port { .. } | Self::Internal => ExitKind::Io,
        }
    }
}
