//! `oct plan`, `oct part` and `oct merge`: a model in parts.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Parser;
use infobyte::Error;
use infobyte::jobs::parts::{self, PartsInput, Plan};

use crate::args::{BuildArgs, Cli, Command, MergeArgs, PartArgs, PlanArgs};
use crate::bars::Bars;
use crate::failure::{Dash, Failure, Refusal, Written};
use crate::streams::{check_suffixes, is_dash, refuse_dash};
use crate::{Build, print};

pub(crate) fn plan(args: &PlanArgs) -> Result<ExitCode, Failure> {
    let PlanArgs { build: args, parts } = args;
    refuse_dash([args.output()], Dash::Folder)?;
    refuse_dash(args.input.iter().map(PathBuf::as_path), Dash::Search)?;
    let build = Build::of(args)?;
    // This command line's own words, for the parts to repeat.
    let words = std::env::args_os().skip_while(|word| word != "plan").skip(1);
    let command =
        words.map(|word| word.into_string().map_err(|_| Refusal::NotText)).collect::<Result<_, _>>()?;
    let folder = std::env::current_dir().map_err(|cause| Error::Output { path: ".".into(), cause })?;
    let folder = folder.to_str().ok_or(Refusal::NotText)?;
    let bars = Bars::new(args.quiet || args.json);
    let input = input(&build, args.output(), &bars);
    let report = parts::plan(&input, *parts, args.output(), command, folder)?;
    Ok(print(args.json, || &report, || if args.quiet { String::new() } else { report.text() })?)
}

/// The build of a plan, as parsed from its command.
fn planned(plan: &Plan) -> Result<BuildArgs, Failure> {
    let line = ["oct", "plan"].into_iter().chain(plan.command().iter().map(String::as_str));
    let Ok(Cli { command: Command::Plan(PlanArgs { mut build, .. }) }) = Cli::try_parse_from(line) else {
        return Err(plan.not_of_this_program().into());
    };
    build.input = build.input.iter().map(|path| plan.input(path)).collect();
    build.scratch = None;
    if build.input.iter().any(|path| is_dash(path)) {
        return Err(Dash::Search.into());
    }
    Ok(build)
}

fn input<'a>(build: &'a Build, output: &'a Path, bars: &'a Bars) -> PartsInput<'a> {
    PartsInput { kind: build.kind, inputs: &build.inputs, how: &build.how, job: build.job(output, bars) }
}

pub(crate) fn part(args: &PartArgs) -> Result<ExitCode, Failure> {
    refuse_dash([args.plan.as_path()], Dash::AmongFiles)?;
    let plan = Plan::read(&args.plan)?;
    let output = plan.part_path(args.number)?;
    let mut planned = planned(&plan)?;
    planned.memory = args.memory.unwrap_or(planned.memory);
    planned.threads.threads = args.threads.threads.or(planned.threads.threads);
    planned.scratch.clone_from(&args.scratch);
    let build = Build::of(&planned)?;
    infobyte::jobs::give_back();
    let bars = Bars::new(args.quiet || args.json);
    let input = input(&build, &output, &bars);
    let report = match args.stage {
        None => parts::part(&plan, args.number, &input),
        Some(stage) => parts::part_stage(&plan, stage, args.number, &input),
    };
    bars.finish();
    let report = report?;
    Ok(print(args.json, || &report, || if args.quiet { String::new() } else { report.text() })?)
}

/// `oct build --resume`.
pub(crate) fn resume(args: &BuildArgs) -> Result<ExitCode, Failure> {
    refuse_dash([args.output()], Dash::Model)?;
    refuse_dash(args.input.iter().map(PathBuf::as_path), Dash::Search)?;
    check_suffixes([args.output()], Written::Model, args.force)?;
    infobyte::jobs::give_back();
    let build = Build::of(args)?;
    let bars = Bars::new(args.quiet || args.json);
    let report = parts::resume(&input(&build, args.output(), &bars));
    bars.finish();
    let report = report?;
    Ok(print(args.json, || &report, || if args.quiet { String::new() } else { report.text() })?)
}

pub(crate) fn merge(args: &MergeArgs) -> Result<ExitCode, Failure> {
    refuse_dash([args.plan.as_path()], Dash::AmongFiles)?;
    let bars = Bars::new(args.quiet || args.json);
    if let Some(stage) = args.stage {
        let plan = Plan::read(&args.plan)?;
        let build = Build::of(&planned(&plan)?)?;
        infobyte::jobs::give_back();
        let report = parts::merge_stage(&plan, stage, &input(&build, &args.plan, &bars))?;
        return Ok(print(args.json, || &report, || if args.quiet { String::new() } else { report.text() })?);
    }
    let output = args.output.as_deref().unwrap_or(Path::new(""));
    refuse_dash([output], Dash::Model)?;
    check_suffixes([output], Written::Model, args.force)?;
    let plan = Plan::read(&args.plan)?;
    infobyte::jobs::give_back();
    let report = parts::merge(&plan, output, &bars);
    bars.finish();
    let report = report?;
    Ok(print(args.json, || &report, || if args.quiet { String::new() } else { report.text() })?)
}
