//! `oct plan`, `oct part` and `oct merge`: a model in parts.

use std::path::Path;
use std::process::ExitCode;

use clap::Parser;
use infobyte::Error;
use infobyte::jobs::parts::{self, PartsInput, Plan};

use crate::args::{BuildArgs, Cli, Command, MergeArgs, PartArgs, PlanArgs};
use crate::bars::Bars;
use crate::failure::{Failure, dash};
use crate::streams::{Written, check_suffixes, is_dash, refuse_dash};
use crate::{Build, print_unless_quiet};

const NOT_TEXT: &str =
    "a plan holds paths and options as Unicode text, and one of them is not; rename the file or folder";

pub(crate) fn plan(args: &PlanArgs) -> Result<ExitCode, Failure> {
    let PlanArgs { build: args, parts } = args;
    refuse_dash([args.output()], dash::FOLDER)?;
    refuse_dash(&args.input, dash::SEARCH)?;
    let build = Build::of(args)?;
    // This command line's own words, for the parts to repeat.
    let words = std::env::args_os().skip_while(|word| word != "plan").skip(1);
    let command = words.map(|word| word.into_string().map_err(|_| NOT_TEXT)).collect::<Result<_, _>>()?;
    let folder = std::env::current_dir().map_err(|cause| Error::Output { path: ".".into(), cause })?;
    let folder = folder.to_str().ok_or(NOT_TEXT)?;
    let bars = Bars::new(args.run.is_silent());
    let input = input(&build, args.output(), &bars);
    let report = parts::plan(&input, *parts, args.output(), command, folder)?;
    Ok(print_unless_quiet(&args.run, || &report, || report.text())?)
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
        return Err(dash::SEARCH.into());
    }
    Ok(build)
}

fn input<'a>(build: &'a Build, output: &'a Path, bars: &'a Bars) -> PartsInput<'a> {
    PartsInput { kind: build.kind, inputs: &build.inputs, how: &build.how, job: build.job(output, bars) }
}

pub(crate) fn part(args: &PartArgs) -> Result<ExitCode, Failure> {
    refuse_dash([&args.plan], dash::AMONG_FILES)?;
    let plan = Plan::read(&args.plan)?;
    let output = plan.part_path(args.number)?;
    let mut planned = planned(&plan)?;
    planned.memory = args.memory.unwrap_or(planned.memory);
    planned.threads.threads = args.threads.threads.or(planned.threads.threads);
    planned.scratch.clone_from(&args.scratch);
    let build = Build::of(&planned)?;
    infobyte::jobs::give_back();
    let report = Bars::during(args.run.is_silent(), |bars| {
        let input = input(&build, &output, bars);
        match args.stage {
            None => parts::part(&plan, args.number, &input),
            Some(stage) => parts::part_stage(&plan, stage, args.number, &input),
        }
    })?;
    Ok(print_unless_quiet(&args.run, || &report, || report.text())?)
}

/// `oct build --resume`.
pub(crate) fn resume(args: &BuildArgs) -> Result<ExitCode, Failure> {
    refuse_dash([args.output()], dash::MODEL)?;
    refuse_dash(&args.input, dash::SEARCH)?;
    check_suffixes([args.output()], Written::Model, args.force)?;
    infobyte::jobs::give_back();
    let build = Build::of(args)?;
    let report =
        Bars::during(args.run.is_silent(), |bars| parts::resume(&input(&build, args.output(), bars)))?;
    Ok(print_unless_quiet(&args.run, || &report, || report.text())?)
}

pub(crate) fn merge(args: &MergeArgs) -> Result<ExitCode, Failure> {
    refuse_dash([&args.plan], dash::AMONG_FILES)?;
    if let Some(stage) = args.stage {
        let plan = Plan::read(&args.plan)?;
        let build = Build::of(&planned(&plan)?)?;
        infobyte::jobs::give_back();
        let bars = Bars::new(args.run.is_silent());
        let report = parts::merge_stage(&plan, stage, &input(&build, &args.plan, &bars))?;
        return Ok(print_unless_quiet(&args.run, || &report, || report.text())?);
    }
    let output = args.output.as_deref().unwrap_or(Path::new(""));
    refuse_dash([output], dash::MODEL)?;
    check_suffixes([output], Written::Model, args.force)?;
    let plan = Plan::read(&args.plan)?;
    infobyte::jobs::give_back();
    let report = Bars::during(args.run.is_silent(), |bars| parts::merge(&plan, output, bars))?;
    Ok(print_unless_quiet(&args.run, || &report, || report.text())?)
}
