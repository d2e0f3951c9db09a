//! The `oct` command: arguments in, one call into the library, an exit code out.

mod args;

use std::io::{self, Write};
use std::process::ExitCode;

use clap::Parser;
use infobyte::budget::Bytes;
use infobyte::jobs::{info, pack, verify};
use infobyte::{Error, ExitKind};
use serde_json::{Value, json};

use args::{Cli, Command};

fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(e) => return refuse(&e),
    };
    match run(cli.command) {
        Ok(code) => code,
        Err(e) => {
            // A closed stderr leaves nobody to tell.
            let _ = writeln!(io::stderr(), "oct: {}", one_line(&e.to_string()));
            ExitCode::from(e.kind().code())
        }
    }
}

/// Help and version are printed as they are; wrong usage is one sentence like every other error.
fn refuse(e: &clap::Error) -> ExitCode {
    if !e.use_stderr() {
        let _ = e.print();
        return ExitCode::SUCCESS;
    }
    if e.kind() == clap::error::ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand {
        let _ = e.print();
        return ExitCode::from(ExitKind::Usage.code());
    }
    let text = e.to_string();
    // The first paragraph says what is wrong; usage and hints follow after an empty line.
    let sentence: Vec<&str> = text.lines().map(str::trim).take_while(|line| !line.is_empty()).collect();
    let sentence = sentence.join(" ");
    let sentence = sentence.strip_prefix("error: ").unwrap_or(&sentence);
    let _ = writeln!(io::stderr(), "oct: {}; see `oct --help`", one_line(sentence));
    ExitCode::from(ExitKind::Usage.code())
}

/// Errors are one sentence on one line, whatever a file's name contains.
fn one_line(text: &str) -> String {
    text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect()
}

fn run(command: Command) -> Result<ExitCode, Error> {
    match command {
        Command::Build(args) => build(&args),
        Command::Info(args) => {
            let info = info::info(&args.model)?;
            print(args.json, || info.json(), || info.text())
        }
        Command::Verify(args) => {
            let report = verify::verify(&args.model)?;
            print(args.json, || report.json(), || report.text())
        }
        Command::Pack(args) => {
            let report = pack::pack(&args.input, &args.output)?;
            print_packed(&args, &report)
        }
        Command::Unpack(args) => {
            let report = pack::unpack(&args.input, &args.output)?;
            print_packed(&args, &report)
        }
        Command::Render(args) => render(&args),
        Command::Thumbnail(args) => thumbnail(&args),
        Command::Demo(args) => demo(&args),
        Command::Selfcheck(args) => selfcheck(&args),
    }
}

fn build(args: &args::BuildArgs) -> Result<ExitCode, Error> {
    Err(not_wired("build", &format!("{args:?}")))
}

fn render(args: &args::RenderArgs) -> Result<ExitCode, Error> {
    Err(not_wired("render", &format!("{args:?}")))
}

fn thumbnail(args: &args::ThumbnailArgs) -> Result<ExitCode, Error> {
    Err(not_wired("thumbnail", &format!("{args:?}")))
}

fn demo(args: &args::DemoArgs) -> Result<ExitCode, Error> {
    Err(not_wired("demo", &format!("{args:?}")))
}

fn selfcheck(args: &args::SelfcheckArgs) -> Result<ExitCode, Error> {
    Err(not_wired("selfcheck", &format!("{args:?}")))
}

fn not_wired(command: &str, understood: &str) -> Error {
    Error::Usage(format!("`oct {command}` is not wired yet in this version (understood: {understood})"))
}

fn print_packed(args: &args::PackArgs, report: &pack::PackReport) -> Result<ExitCode, Error> {
    let per_voxel = to_f64(report.bytes_out) / to_f64(report.skin_voxels);
    print(
        args.json,
        || {
            json!({
                "input": args.input.display().to_string(),
                "output": args.output.display().to_string(),
                "bytes_in": report.bytes_in,
                "bytes": report.bytes_out,
                "skin_voxels": report.skin_voxels,
                "bytes_per_skin_voxel": per_voxel,
                "peak_rss_bytes": infobyte::budget::peak_rss_bytes(),
                "wall_s": report.wall_s,
            })
        },
        || {
            format!(
                "{}: {} -> {} ({per_voxel:.4} bytes per skin voxel)\n",
                args.output.display(),
                Bytes(report.bytes_in),
                Bytes(report.bytes_out)
            )
        },
    )
}

#[expect(clippy::cast_precision_loss, reason = "ratios for people")]
fn to_f64(count: u64) -> f64 {
    count.max(1) as f64
}

/// Prints the report as JSON or as text. A reader that has gone away (`oct info x | head -1`) is no
/// error.
fn print(
    as_json: bool,
    json: impl FnOnce() -> Value,
    text: impl FnOnce() -> String,
) -> Result<ExitCode, Error> {
    let output = if as_json { format!("{}\n", json()) } else { text() };
    let mut stdout = io::stdout().lock();
    match stdout.write_all(output.as_bytes()).and_then(|()| stdout.flush()) {
        Err(cause) if cause.kind() != io::ErrorKind::BrokenPipe => {
            Err(Error::Output { path: "standard output".into(), cause })
        }
        _ => Ok(ExitCode::SUCCESS),
    }
}
