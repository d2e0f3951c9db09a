//! The reports of plans, parts and merges.

use std::fmt::Write;
use std::path::Path;
use std::time::Instant;

use serde::Serialize;

use super::Plan;
use crate::budget::{Bytes, peak_rss_bytes};
use crate::builder::parts::Joined;
use crate::format::SurfaceKind;
use crate::jobs::info::noun;
use crate::text::{Count, Short, data, shown};

/// The lines of notes.
fn notes(warnings: &[String]) -> String {
    warnings.iter().map(|warning| format!("  note: {}\n", shown(warning))).collect()
}

/// A plan that was written.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct PlanReport {
    /// File of the plan.
    pub plan: String,
    /// Parts of the plan, numbered from 0.
    pub parts: u32,
    /// Stages that come before the parts, in their order.
    pub stages: Vec<&'static str>,
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

impl PlanReport {
    /// Report for people.
    pub fn text(&self) -> String {
        let [x, y, z] = self.grid_dims;
        let empty = if self.empty_parts > 0 {
            format!(" ({} of them empty: fewer would do)", self.empty_parts)
        } else {
            String::new()
        };
        let mut text = format!(
            "{}: {}, numbered from 0{empty}, of a grid of {x}x{y}x{z}",
            shown(&self.plan),
            Count(self.parts, "part"),
        );
        if self.part_bytes > 0 {
            let _ = write!(text, "; a part reads up to {}", Bytes(self.part_bytes));
        }
        if !self.stages.is_empty() {
            let _ = write!(text, "; stages before the parts: {}", self.stages.join(", "));
        }
        text.push('\n');
        text + &notes(&self.warnings)
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
    /// The stage; null for the part itself.
    pub stage: Option<&'static str>,
    /// Output as named on the command line.
    pub output: String,
    /// True if the part was there before and is sound, so that nothing was built.
    pub was_there: bool,
    /// Skin voxels or cells of the part; null if it was there before, and for a stage.
    pub part_voxels: Option<u64>,
    #[serde(skip)]
    pub(super) surface: SurfaceKind,
    /// Size of the file that was written or read.
    pub bytes: u64,
    /// Sentences about the input: assumptions, parts left out, oddities.
    pub warnings: Vec<String>,
    /// Peak resident memory of the process.
    pub peak_rss_bytes: u64,
    /// Seconds from start to end.
    pub wall_s: f64,
}

impl PartReport {
    pub(super) fn new(plan: &Plan, part: u32, path: &Path, started: Instant) -> Self {
        Self {
            plan: data(&plan.path),
            part,
            stage: None,
            output: data(path),
            was_there: false,
            part_voxels: None,
            surface: SurfaceKind::Skin,
            bytes: std::fs::metadata(path).map_or(0, |meta| meta.len()),
            warnings: Vec::new(),
            peak_rss_bytes: peak_rss_bytes(),
            wall_s: started.elapsed().as_secs_f64(),
        }
    }

    /// Report for people.
    pub fn text(&self) -> String {
        let done = match self.part_voxels {
            _ if self.was_there => "was there, and is sound".into(),
            Some(voxels) => format!("{} in {:.2} s", Count(voxels, noun(self.surface)), self.wall_s),
            None => format!("{} in {:.2} s", self.stage.unwrap_or_default(), self.wall_s),
        };
        let size = Bytes(self.bytes);
        format!("{}: part {}, {size}, {done}\n", shown(&self.output), self.part) + &notes(&self.warnings)
    }
}

/// A stage that was added up.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct StageReport {
    /// File of the plan.
    pub plan: String,
    /// The stage; null for the part itself.
    pub stage: &'static str,
    /// Output as named on the command line.
    pub output: String,
    /// Parts of the plan, numbered from 0.
    pub parts: u32,
    /// The least value that is inside, if this stage decides that.
    pub threshold: Option<f64>,
    /// Voxels that closing and filling added, if this stage cleans.
    pub voxels_added: Option<u64>,
    /// Voxels of dropped components.
    pub voxels_removed: Option<u64>,
    /// Components found; 0 when they were not asked for.
    pub components: Option<u64>,
    /// Sentences about the input: assumptions, parts left out, oddities.
    pub warnings: Vec<String>,
    /// Peak resident memory of the process.
    pub peak_rss_bytes: u64,
    /// Seconds from start to end.
    pub wall_s: f64,
}

impl StageReport {
    /// Report for people.
    pub fn text(&self) -> String {
        let mut text = format!("{}: {} of {}", shown(&self.output), self.stage, Count(self.parts, "part"));
        if let Some(threshold) = self.threshold {
            let _ = write!(text, "; inside are values from {} up", Short(threshold));
        }
        if let (Some(added), Some(removed)) = (self.voxels_added, self.voxels_removed) {
            let _ = write!(text, "; cleaned: {} added, {removed} removed", Count(added, "voxel"));
        }
        text.push('\n');
        text + &notes(&self.warnings)
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
    #[serde(skip)]
    pub(super) surface: SurfaceKind,
    /// Nodes of the octree, one infobyte each.
    pub nodes: u64,
    /// Size of the file that was written or read.
    pub bytes: u64,
    /// Sentences about the input: assumptions, parts left out, oddities.
    pub warnings: Vec<String>,
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

impl MergeReport {
    pub(super) fn of(joined: &Joined, (plan, output): (&Path, &Path), parts: u32, started: Instant) -> Self {
        Self {
            plan: data(plan),
            output: data(output),
            parts,
            skin_voxels: joined.voxels,
            surface: joined.surface,
            nodes: joined.nodes,
            bytes: joined.file_bytes,
            join_s: joined.seconds.merge,
            seal_s: joined.seconds.seal,
            commit_s: joined.seconds.commit,
            warnings: Vec::new(),
            peak_rss_bytes: peak_rss_bytes(),
            wall_s: started.elapsed().as_secs_f64(),
        }
    }

    /// Report for people.
    pub fn text(&self) -> String {
        format!(
            "{}: {} joined, {}, {}, {} in {:.2} s; peak resident memory {}\n",
            shown(&self.output),
            Count(self.parts, "part"),
            Count(self.skin_voxels, noun(self.surface)),
            Count(self.nodes, "node"),
            Bytes(self.bytes),
            self.wall_s,
            Bytes(self.peak_rss_bytes)
        ) + &notes(&self.warnings)
    }
}
