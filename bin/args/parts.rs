//! Options of the commands that build a model in parts.

use std::path::PathBuf;

use clap::Args;
use infobyte::budget::parse_size;
use infobyte::jobs::parts::{MAX_PARTS, Stage};

use super::{BuildArgs, RunArgs, ThreadArgs};

#[derive(Debug, Args)]
#[command(
    mut_arg("output", |arg| arg.long("out").value_name("JOB").help("Folder of the plan and its parts; made if it is not there")),
    mut_arg("force", |arg| arg.hide(true))
)]
pub(crate) struct PlanArgs {
    /// The build; its output is the folder of the job.
    #[command(flatten)]
    pub(crate) build: BuildArgs,
    /// Number of parts; cut at multiples of 128 voxels along z, then along y
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=i64::from(MAX_PARTS)), help_heading = None)]
    pub(crate) parts: u32,
}

#[derive(Debug, Args)]
#[command(mut_arg("quiet", |arg| arg.help("No progress, no line for the part")))]
pub(crate) struct PartArgs {
    /// The plan
    #[arg(value_name = "JOB/plan.json")]
    pub(crate) plan: PathBuf,
    /// Number of the part, from 0
    #[arg(value_name = "K")]
    pub(crate) number: u32,
    /// Run this stage on the part's share: extremes, histogram or occupancy, as the plan says
    #[arg(long, value_name = "STAGE")]
    pub(crate) stage: Option<Stage>,
    /// Peak resident memory of the whole process; that of the plan by default
    #[arg(long, value_name = "SIZE", value_parser = parse_size)]
    pub(crate) memory: Option<u64>,
    #[command(flatten)]
    pub(crate) threads: ThreadArgs,
    /// Folder for the scratch file; next to the part by default
    #[arg(long, value_name = "DIR")]
    pub(crate) scratch: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) run: RunArgs,
}

#[derive(Debug, Args)]
pub(crate) struct MergeArgs {
    /// The plan
    #[arg(value_name = "JOB/plan.json")]
    pub(crate) plan: PathBuf,
    /// Combine the results of this stage from all parts, instead of joining the parts
    #[arg(long, value_name = "STAGE", conflicts_with = "output")]
    pub(crate) stage: Option<Stage>,
    /// The model to write
    #[arg(short, long, value_name = "MODEL.oct", required_unless_present = "stage")]
    pub(crate) output: Option<PathBuf>,
    /// Write it even if its name says that it is another kind of file
    #[arg(long)]
    pub(crate) force: bool,
    #[command(flatten)]
    pub(crate) run: RunArgs,
}
