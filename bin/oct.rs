//! The `oct` command: arguments in, one call into the library, an exit code out.

mod args;
mod bars;

use std::fmt;
use std::io::{self, Write};
use std::path::Path;
use std::process::ExitCode;

use clap::Parser;
use infobyte::budget::{Bytes, MemoryCap};
use infobyte::builder::{BuildOptions, Threshold};
use infobyte::geom::Orientation;
use infobyte::jobs::batch::BatchRequest;
use infobyte::jobs::demo::DemoFiles;
use infobyte::jobs::render::{RenderReport, RenderRequest};
use infobyte::jobs::scan::ScanReport;
use infobyte::jobs::{self, info, pack, picture, verify};
use infobyte::load::Model;
use infobyte::render::ViewPoint;
use infobyte::source::{OpenOptions, RawOptions};
use infobyte::volume::Placement;
use infobyte::{Error, ExitKind};
use serde_json::{Value, json};

use args::{Cli, Command, Switch, cores};
use bars::{Bars, BatchBars};

fn main() -> ExitCode {
    jobs::map_large_buffers();
    // With a handler in place, writing past a file-size limit is an error that can be told, not the end of
    // the process. Without one (it cannot be set twice), the system's way stays.
    let _ = signal_hook::flag::register(
        signal_hook::consts::SIGXFSZ,
        std::sync::Arc::new(std::sync::atomic::AtomicBool::new(false)),
    );
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
    let sentence = first_paragraph(&e.to_string());
    let _ = writeln!(io::stderr(), "oct: {}; see `oct COMMAND --help`", one_line(&sentence));
    ExitCode::from(ExitKind::Usage.code())
}

/// Of what clap prints, that which says what is wrong; usage and hints follow after an empty line.
fn first_paragraph(printed: &str) -> String {
    let plain = printed.strip_prefix("error: ").unwrap_or(printed);
    let lines: Vec<&str> = plain.lines().map(str::trim).take_while(|line| !line.is_empty()).collect();
    lines.join(" ")
}

/// Errors are one sentence on one line, whatever a file's name contains.
fn one_line(text: &str) -> String {
    text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect()
}

fn run(command: Command) -> Result<ExitCode, Failure> {
    match command {
        Command::Build(args) => build(&args),
        Command::Batch(args) => Ok(batch(&args)?),
        Command::Scan(args) => Ok(scan(&args)?),
        Command::Info(args) => {
            let info = info::read_info(&args.model)?;
            Ok(print(args.json, || info.json(), || info.text())?)
        }
        Command::Verify(args) => {
            let report = verify::verify_file(&args.model)?;
            Ok(print(args.json, || report.json(), || report.text())?)
        }
        Command::Pack(args) => {
            let report = pack::pack(&args.input, &args.output)?;
            Ok(print_packed(&args, &report)?)
        }
        Command::Unpack(args) => {
            let report = pack::unpack(&args.input, &args.output)?;
            Ok(print_packed(&args, &report)?)
        }
        Command::Render(args) => Ok(render(&args)?),
        Command::Thumbnail(args) => Ok(thumbnail(&args)?),
        Command::Demo(args) => Ok(demo(&args)?),
        Command::Selfcheck(args) => Ok(selfcheck(&args)?),
    }
}

fn build(args: &args::BuildArgs) -> Result<ExitCode, Failure> {
    let options = BuildOptions {
        threshold: args.selection.threshold(),
        connectivity: args.skin.connectivity,
        channels: args.skin.channels,
        lod: args.lod == Switch::On,
        memory: MemoryCap::Process(args.memory),
        threads: args.threads.count(),
        scratch: args.scratch.clone(),
    };
    if jobs::mesh::are_meshes(&args.input) {
        if let Some(flag) = args.volume_flag() {
            return Err(Refusal::ForVolumes(flag).into());
        }
        let bars = Bars::new(args.quiet || args.json);
        let mesh = args.mesh.options(args.raw.dims);
        let summary = jobs::mesh::convert(&args.input, mesh.as_ref(), &options, &args.output, &bars);
        bars.finish();
        let summary = summary?;
        let text = || if args.quiet { String::new() } else { summary.text() };
        return Ok(print(args.json, || summary.json(), text)?);
    }
    if let Some(flag) = args.mesh.flag() {
        return Err(Refusal::ForMeshes(flag).into());
    }
    let how = OpenOptions {
        raw: raw_options(&args.raw)?,
        gaps: args.which.gaps.policy(),
        volume: args.which.volume,
        placement: Placement { spacing_mm: args.raw.spacing, orientation: args.raw.orientation },
        ..OpenOptions::default()
    };
    let bars = Bars::new(args.quiet || args.json);
    let cleaning = args.clean.options();
    let summary = jobs::build::convert(&args.input, &how, &cleaning, &options, &args.output, &bars);
    bars.finish();
    let summary = summary?;
    Ok(print(args.json, || summary.json(), || if args.quiet { String::new() } else { summary.text() })?)
}

fn batch(args: &args::BatchArgs) -> Result<ExitCode, Error> {
    let jobs = args.jobs.unwrap_or_else(cores);
    let request = BatchRequest {
        inputs: args.input.clone(),
        out: args.out.clone(),
        how: OpenOptions { gaps: args.gaps.policy(), ..OpenOptions::default() },
        clean: args.clean.options(),
        build: BuildOptions {
            threshold: args.selection.threshold(),
            connectivity: args.skin.connectivity,
            channels: args.skin.channels,
            lod: true,
            memory: MemoryCap::Process(args.memory),
            threads: args.threads.count(),
            scratch: args.scratch.clone(),
        },
        jobs,
        thumbnails: args.thumbnails,
        keep_names: args.keep_names,
        thumbnails_of_all: args.thumbnails_of_all,
        min_slices: args.min_slices,
    };
    let bars = BatchBars::new(jobs, args.quiet || args.json);
    let report = jobs::batch::batch(&request, &bars);
    bars.finish();
    let report = report?;
    let counts = report.counts;
    let code = if args.json {
        // The items come from the report just written: they are never all in memory.
        copy_to_stdout(&args.out.join("report.json"))?
    } else {
        print(
            false,
            || Value::Null,
            || {
                let notes: String =
                    report.warnings.iter().map(|warning| format!("  note: {warning}\n")).collect();
                format!(
                    "{}: {} converted, {} skipped, {} failed; {:.1} s, peak resident memory {} of {} allowed\n{notes}",
                    args.out.display(),
                    counts.converted,
                    counts.skipped,
                    counts.failed,
                    report.wall_s,
                    Bytes(report.peak_rss_bytes),
                    Bytes(report.memory_budget_bytes)
                )
            },
        )?
    };
    Ok(if counts.failed > 0 { ExitCode::from(ExitKind::Partial.code()) } else { code })
}

fn copy_to_stdout(path: &Path) -> Result<ExitCode, Error> {
    let copied = std::fs::File::open(path).and_then(|mut file| io::copy(&mut file, &mut io::stdout().lock()));
    match copied {
        Err(cause) if cause.kind() != io::ErrorKind::BrokenPipe => {
            Err(Error::Output { path: "standard output".into(), cause })
        }
        _ => Ok(ExitCode::SUCCESS),
    }
}

/// Memory that `oct scan`, which has no cap of its own, takes for the images of one series: some 600,000.
const SCAN_OPENING_BYTES: u64 = 256 << 20;

fn scan(args: &args::ScanArgs) -> Result<ExitCode, Error> {
    let mut first = true;
    // A list names files in any case.
    let _ = args.keep_names;
    let notice = ScanReport::notice();
    let begin = if args.json {
        format!("{{\"notice\":{},\"items\":[\n", json!(notice))
    } else {
        format!("{notice}\n")
    };
    let how = OpenOptions {
        gaps: args.gaps.policy(),
        opening_bytes: Some(SCAN_OPENING_BYTES),
        ..OpenOptions::default()
    };
    let report = jobs::scan::scan(&args.input, &how, &mut |listed| {
        let before = match (args.json, std::mem::take(&mut first)) {
            (_, true) => &begin,
            (true, false) => ",\n",
            (false, _) => "",
        };
        let text = if args.json { listed.json().to_string() } else { listed.text() };
        print(false, || Value::Null, || format!("{before}{text}")).map(|_| ())
    })?;
    let text = || {
        let mut text =
            format!("{} volume(s) would be converted, {} refused\n", report.usable, report.refused);
        for (reason, count, first) in &report.left_out {
            text += &format!("  {count} file(s) left out: {reason} (first: {first})\n");
        }
        text
    };
    let json = || {
        let head = if first { &begin } else { "" };
        let rest = report.json().to_string();
        format!("{head}\n],{}\n", rest.strip_prefix('{').unwrap_or(&rest))
    };
    print(false, || Value::Null, || if args.json { json() } else { text() })
}

/// Why the command ends without success.
enum Failure {
    /// Its arguments do not belong together.
    Arguments(Refusal),
    /// The library's error.
    Job(Error),
}

/// Arguments that do not belong together.
enum Refusal {
    SkipAlone,
    NoDims,
    NoType,
    /// This flag says something about a volume, and the input is a mesh.
    ForVolumes(&'static str),
    /// The other way round.
    ForMeshes(&'static str),
}

impl From<Refusal> for Failure {
    fn from(refusal: Refusal) -> Self {
        Self::Arguments(refusal)
    }
}

impl From<Error> for Failure {
    fn from(cause: Error) -> Self {
        Self::Job(cause)
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Job(cause) => return cause.fmt(f),
            Self::Arguments(Refusal::ForVolumes("--dims")) => {
                "--dims of a mesh needs --voxel and --origin as well; --grid N alone chooses all of them"
            }
            Self::Arguments(Refusal::ForVolumes(flag)) => {
                return write!(f, "{flag} is for volumes, and the input is a mesh; leave it out");
            }
            Self::Arguments(Refusal::ForMeshes(flag)) => {
                return write!(
                    f,
                    "{flag} is for meshes (STL, PLY, OBJ, OFF), and the input is a volume; leave it out"
                );
            }
            Self::Arguments(Refusal::SkipAlone) => {
                "--skip is for raw volumes, with --dims and --dtype; other files say where their voxels begin"
            }
            Self::Arguments(Refusal::NoDims) => "a raw volume needs --dims NXxNYxNZ as well",
            Self::Arguments(Refusal::NoType) => "a raw volume needs --dtype as well, for example --dtype u16",
        })
    }
}

impl Failure {
    fn kind(&self) -> ExitKind {
        match self {
            Self::Arguments(_) => ExitKind::Usage,
            Self::Job(cause) => cause.kind(),
        }
    }
}

/// The description of a headerless volume, if any of it was given.
fn raw_options(raw: &args::RawArgs) -> Result<Option<RawOptions>, Refusal> {
    match (raw.dims, raw.dtype) {
        (Some(dims), Some((scalar, endian))) => Ok(Some(RawOptions {
            dims,
            scalar,
            endian,
            spacing_mm: raw.spacing.unwrap_or([1.0; 3]),
            skip: raw.skip.unwrap_or(0),
            orientation: raw.orientation.unwrap_or(Orientation::LPS),
        })),
        (None, None) if raw.skip.is_none() => Ok(None),
        (None, None) => Err(Refusal::SkipAlone),
        (None, Some(_)) => Err(Refusal::NoDims),
        (Some(_), None) => Err(Refusal::NoType),
    }
}

fn render(args: &args::RenderArgs) -> Result<ExitCode, Error> {
    let request = RenderRequest {
        width: args.size[0],
        height: args.size[1],
        point: match (args.eye, args.look_at) {
            (Some(eye), Some(look_at)) => ViewPoint::Free { eye, look_at, up: args.up },
            _ => ViewPoint::Named(args.view),
        },
        projection: args.projection,
        fov_deg: args.fov,
        threads: args.threads.count(),
        lod: args.lod == Switch::On,
        ..RenderRequest::default()
    };
    let (depth, normals) = (args.depth.as_deref(), args.normals.as_deref());
    let report = picture::render_file(&args.model, &args.output, depth, normals, &request)?;
    print_picture(args.json, &args.model, &args.output, &report)
}

fn thumbnail(args: &args::ThumbnailArgs) -> Result<ExitCode, Error> {
    let threads = args.threads.count();
    let report = picture::thumbnail_file(&args.model, &args.output, args.size, threads)?;
    print_picture(args.json, &args.model, &args.output, &report)
}

fn print_picture(
    as_json: bool,
    model: &Path,
    output: &Path,
    report: &RenderReport,
) -> Result<ExitCode, Error> {
    let json = || {
        let mut value = serde_json::to_value(report).unwrap_or_default();
        if let Value::Object(map) = &mut value {
            map.insert("input".into(), json!(model.display().to_string()));
            map.insert("output".into(), json!(output.display().to_string()));
            map.insert("peak_rss_bytes".into(), json!(infobyte::budget::peak_rss_bytes()));
        }
        value
    };
    let text = || {
        format!(
            "{}: {}x{}, {} rays, {} hits, {:.3} s\n",
            output.display(),
            report.width,
            report.height,
            report.rays,
            report.hits,
            report.wall_s
        )
    };
    print(as_json, json, text)
}

fn demo(args: &args::DemoArgs) -> Result<ExitCode, Error> {
    if let Some(path) = &args.write_raw {
        jobs::demo::write_raw(args.size, path)?;
        return Ok(ExitCode::SUCCESS);
    }
    let threads = args.threads.count();
    let options = BuildOptions {
        threshold: Threshold::Iso(args.iso),
        memory: MemoryCap::Process(args.memory),
        threads,
        ..BuildOptions::default()
    };
    let files = DemoFiles::beside(&args.output, args.picture.as_deref());
    let bars = Bars::new(args.quiet || args.json);
    let summary = jobs::demo::demo(args.size, &options, &files, threads, &bars);
    bars.finish();
    let summary = summary?;
    print(args.json, || summary.json(), || if args.quiet { String::new() } else { summary.text() })
}

fn selfcheck(args: &args::SelfcheckArgs) -> Result<ExitCode, Error> {
    let model = Model::open(&args.model)?;
    let threads = args.threads.count();
    let found = jobs::render::selfcheck(&model.view(), args.rays, args.seed, threads)?;
    let total = found.total();
    let code = print(
        args.json,
        || serde_json::to_value(found).unwrap_or_default(),
        || format!("{} rays, {total} mismatches against the exact reference\n", args.rays),
    )?;
    Ok(if total == 0 { code } else { ExitCode::FAILURE })
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
