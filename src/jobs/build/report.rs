//! The report of `oct build`.

use serde::Serialize;

use super::{BuildSummary, LabelModel};
use crate::budget::peak_rss_bytes;
use crate::clean::{CleanReport, ExtraPasses};
use crate::jobs::info::ModelFigures;
use crate::text::data;

/// Figures of a build and of its model.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct BuildFigures {
    /// Input as named on the command line; several separated by blanks; `-` for standard input.
    pub input: String,
    /// Output as named on the command line.
    pub output: String,
    /// The model.
    #[serde(flatten)]
    pub model: ModelFigures,
    /// Limit of the resident memory of the process.
    pub memory_budget_bytes: u64,
    /// Most memory in use at a time by the plan of the build.
    pub memory_plan_bytes: u64,
    /// Peak resident memory of the process.
    pub peak_rss_bytes: u64,
    /// Size of the scratch files.
    pub scratch_bytes: u64,
    /// Worker threads.
    pub threads: usize,
    /// Columns of voxels along a side of the tile that a worker takes.
    pub tile_columns: u32,
    /// Seconds of reading, as a mean over the threads.
    pub read_s: f64,
    /// Seconds of building, without reading and writing.
    pub build_s: f64,
    /// Seconds of writing the model.
    pub write_s: f64,
    /// Seconds from start to end.
    pub wall_s: f64,
    /// Seconds of each stage.
    pub stages_s: Stages,
    /// Boxes left out because they cannot be seen; only with `--visible-from`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sight: Option<Sight>,
    /// The model of each label; only with `--each`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub each: Vec<LabelModel>,
    /// Cleaning of the volume before the build; only if asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cleaning: Option<Cleaning>,
    /// Sentences about the input: assumptions, parts left out, oddities.
    pub warnings: Vec<String>,
    /// Sentences that suggest other options.
    pub hints: Vec<String>,
}

/// Seconds of the stages of a build.
#[derive(Clone, Copy, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Stages {
    /// Histogram for the threshold.
    pub histogram: f64,
    /// Reading, classifying and describing the skin.
    pub scan: f64,
    /// Merging bricks into the octree.
    pub merge: f64,
    /// Rank directory and checksums.
    pub seal: f64,
    /// Syncing and renaming.
    pub commit: f64,
}

/// Boxes that cannot be seen.
#[derive(Clone, Copy, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Sight {
    /// Boxes of the surface that were left out.
    pub hidden: u64,
    /// Bytes that they would have taken, at the mean size of those kept.
    pub bytes_saved_about: u64,
    /// Seconds of finding them; part of `build_s`.
    pub seconds: f64,
}

/// Cleaning of a volume; figures are 0 where the inside was not touched.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Cleaning {
    /// The operations, as options of the command line.
    pub operations: Vec<String>,
    /// Passes in addition to those of the build.
    pub passes: ExtraPasses,
    /// Inside voxels before cleaning; null where the inside was not touched.
    pub voxels: Option<u64>,
    /// Voxels that became inside.
    pub voxels_added: u64,
    /// Voxels that became outside.
    pub voxels_removed: u64,
    /// Connected components found.
    pub components: u64,
    /// Components kept.
    pub kept: u64,
    /// Voxels of the largest component that was dropped; 0 if none was.
    pub largest_dropped: u64,
    /// Size of the scratch files of cleaning.
    pub scratch_bytes: u64,
    /// Seconds of cleaning.
    pub seconds: f64,
}

impl Cleaning {
    fn new(operations: &[String], report: Option<&CleanReport>) -> Self {
        let r = report.cloned().unwrap_or_default();
        Self {
            operations: operations.to_vec(),
            passes: r.passes,
            voxels: report.map(|r| r.voxels),
            voxels_added: r.voxels_added,
            voxels_removed: r.voxels_removed,
            components: r.components,
            kept: r.kept,
            largest_dropped: r.largest_dropped,
            scratch_bytes: r.scratch_bytes,
            seconds: r.seconds,
        }
    }
}

impl BuildSummary {
    /// The report for `--json`.
    pub fn json(&self) -> BuildFigures {
        let (r, s) = (&self.report, &self.report.seconds);
        let cleaning = |(operations, report): &(Vec<String>, Option<CleanReport>)| {
            Cleaning::new(operations, report.as_ref())
        };
        BuildFigures {
            input: self.input.clone(),
            output: data(&self.output),
            model: (&self.info.frame).into(),
            memory_budget_bytes: self.memory_bytes,
            memory_plan_bytes: r.plan_bytes,
            peak_rss_bytes: peak_rss_bytes(),
            scratch_bytes: r.scratch_bytes,
            threads: r.threads,
            tile_columns: r.tile,
            read_s: s.read,
            build_s: s.histogram + s.sight + s.scan - s.read + s.merge,
            write_s: s.seal + s.commit,
            wall_s: self.wall_s,
            stages_s: Stages {
                histogram: s.histogram,
                scan: s.scan,
                merge: s.merge,
                seal: s.seal,
                commit: s.commit,
            },
            sight: r.hidden.map(|hidden| Sight {
                hidden,
                bytes_saved_about: r.bytes_saved_about(),
                seconds: s.sight,
            }),
            each: self.each.clone(),
            cleaning: self.cleaning.as_ref().map(cleaning),
            warnings: self.warnings.clone(),
            hints: self.hints.clone(),
        }
    }
}
