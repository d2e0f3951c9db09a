//! The `oct` command: arguments in, one call into the library, an exit code out.
// Failures end in a sentence.
#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

mod args;
mod bars;
mod cure;
mod failure;
mod help;
mod manual;
mod parts;
mod pictures;
mod platform;
mod streams;

use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{ArgMatches, CommandFactory, FromArgMatches};
use infobyte::budget::{Bytes, MemoryCap};
use infobyte::builder::{BuildOptions, Threshold};
use infobyte::cpu::Form;
use infobyte::export::ExportForm;
use infobyte::format::SurfaceKind;
use infobyte::geom::Orientation;
use infobyte::jobs::batch::{BatchRequest, LeftOutCount};
use infobyte::jobs::build::{BuildJob, EachLabel, GridOptions};
use infobyte::jobs::compare::{CompareOutputs, Verdict};
use infobyte::jobs::demo::DemoFiles;
use infobyte::jobs::export::ExportRequest;
use infobyte::jobs::names::read_label_names;
use infobyte::jobs::open_model::open_model;
use infobyte::jobs::pack::StripRequest;
use infobyte::jobs::picture::Outputs;
use infobyte::jobs::pores::PoresRequest;
use infobyte::jobs::report::ReportRequest;
use infobyte::jobs::scan::ScanReport;
use infobyte::jobs::scene::is_scene;
use infobyte::jobs::thickness::ThicknessOutputs;
use infobyte::jobs::view::ViewRequest;
use infobyte::jobs::{self, info, pack, picture, verify};
use infobyte::scene::LabelRule;
use infobyte::source::{OpenOptions, RawOptions, SubjectKind};
use infobyte::text::{self, Count, data, plain, shown};
use infobyte::volume::Placement;
use infobyte::{CleanOptions, Error, ErrorReport, ExitKind, Progress};
use serde::Serialize;

use args::{Cli, Command, RunArgs, Switch, cores, placed};
use bars::{Bars, BatchBars};
use failure::{Failure, dash, not_of, tell};
use pictures::print_picture;
use streams::{
    Input, Output, Written, check_suffixes, copy_to_stdout, is_dash, refuse_dash, write_to_stdout,
};

fn main() -> ExitCode {
    jobs::map_large_buffers();
    // Linking at start leaves code behind that is not needed any more, beyond the code that reads the arguments.
    jobs::give_back();
    platform::report_size_limits();
    text::spell(cure::spelled);
    let read = |given: ArgMatches| Ok((Cli::from_arg_matches(&given)?, is_json(&given)));
    let (cli, as_json) = match args::command().try_get_matches().and_then(read) {
        Ok(read) => read,
        Err(e) => return refuse(&e),
    };
    if let Err(sentence) = Form::chosen() {
        return tell(sentence, ExitKind::Usage, as_json);
    }
    match run(cli.command) {
        Ok(code) => code,
        Err(e) => tell(&e.to_string(), e.kind(), as_json),
    }
}

/// True if the report is asked for as JSON; some commands have none.
fn is_json(given: &ArgMatches) -> bool {
    let command = given.subcommand().map(|(_, command)| command);
    command.is_some_and(|command| matches!(command.try_get_one("json"), Ok(Some(true))))
}

/// Help and version are printed as they are; wrong usage is one sentence like every other error.
fn refuse(e: &clap::Error) -> ExitCode {
    let is_missing = e.kind() == ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand;
    if is_missing || !e.use_stderr() {
        // Jobs read their arguments without the code for help.
        let is_short = std::env::args_os().any(|word| word == "-h");
        let shaped =
            help::command(is_short).try_get_matches().err().filter(|shaped| shaped.kind() == e.kind());
        let text = shaped.as_ref().unwrap_or(e).render().to_string();
        let text = text.replace(
            "this message or the help of the given subcommand(s)",
            "this, the help of a command, or a page",
        );
        if is_missing {
            let _ = write!(io::stderr(), "{text}");
            return ExitCode::from(ExitKind::Usage.code());
        }
        return put(&text).unwrap_or(ExitCode::FAILURE);
    }
    let given: Vec<_> = std::env::args_os().skip(1).collect();
    if let Some(page) = help::page(&given.iter().filter_map(|word| word.to_str()).collect::<Vec<_>>()) {
        return put(&page).unwrap_or(ExitCode::FAILURE);
    }
    let words = || std::env::args_os().skip(1).take_while(|word| word != "--");
    if let (Some(help), Some(first), Some(_)) = (words().next(), words().nth(1), words().nth(2))
        && let (Some("help"), Some(first)) = (help.to_str(), first.to_str())
    {
        let sentence = format!("help is for one command at a time; see `oct help {first}`");
        return tell(&sentence, ExitKind::Usage, false);
    }
    let known = args::Cli::command();
    let command = words().find_map(|word| word.to_str().and_then(|word| known.find_subcommand(word)));
    let help = command.map_or_else(|| "oct --help".to_owned(), |of| format!("oct {} --help", of.get_name()));
    let meant = meant(e, &known, command).unwrap_or_default();
    let sentence = format!("{}{meant}; see `{help}`", first_paragraph(&e.to_string()));
    // The command line could not be read, so its words are looked at.
    let as_json = words().any(|word| word == "--json");
    tell(&sentence, ExitKind::Usage, as_json)
}

/// The likely meaning of an unknown subcommand, or option of a command: one of its own, or else of other commands.
fn meant(e: &clap::Error, oct: &clap::Command, command: Option<&clap::Command>) -> Option<String> {
    let flags = |of: &clap::Command| -> Vec<String> {
        of.get_arguments().filter_map(|arg| Some(format!("--{}", arg.get_long()?))).collect()
    };
    let (word, known) = match e.kind() {
        ErrorKind::UnknownArgument => {
            if let Some(flag) = command.and_then(apart_from_value) {
                return Some(format!("; a text for --{flag} is written with =, as in --{flag}='My text'"));
            }
            let own = flags(command.unwrap_or(oct)).into_iter();
            (e.get(ContextKind::InvalidArg)?, own.chain(["--help".to_owned()]).collect())
        }
        ErrorKind::InvalidSubcommand => {
            let known = oct.get_subcommands().map(|command| command.get_name().to_owned());
            (e.get(ContextKind::InvalidSubcommand)?, known.collect::<Vec<_>>())
        }
        ErrorKind::ValueValidation => return without_unit(e),
        _ => return None,
    };
    let ContextValue::String(word) = word else { return None };
    if let Some(near) = help::meant(word, &known) {
        return Some(format!("; did you mean '{near}'?"));
    }
    if e.kind() == ErrorKind::InvalidSubcommand {
        return None;
    }
    let flag = help::meant(word, &oct.get_subcommands().flat_map(flags).collect::<Vec<_>>())?;
    let having = oct.get_subcommands().filter(|of| flags(of).contains(&flag));
    let having: Vec<String> = having.map(|of| format!("`oct {}`", of.get_name())).collect();
    let having = match &having[..] {
        [all @ .., last] if (1..3).contains(&all.len()) => format!("{} and {last}", all.join(", ")),
        [one, other, _, ..] => format!("{one}, {other} and others"),
        _ => having.concat(),
    };
    Some(format!("; {flag} is an option of {having}"))
}

/// A hint for a number with a unit, where the name of the value states the unit or that it is a number.
fn without_unit(e: &clap::Error) -> Option<String> {
    let [of, value] =
        [ContextKind::InvalidArg, ContextKind::InvalidValue].map(|kind| e.get(kind).map(ToString::to_string));
    let (of, value) = (of?, value?);
    let unit = [
        ("MM", ", in mm"),
        ("X", ", in mm"),
        ("BOUNDS", ", in mm"),
        ("DEG", ", in degrees"),
        ("<V", ""),
        ("LO..HI", ""),
    ];
    let (_, unit) = unit.into_iter().find(|(name, _)| of.contains(name) && !of.contains("NX"))?;
    let has_unit = |part: &str| {
        let number = part.trim_end_matches(|letter: char| letter.is_alphabetic() || letter == '°').trim_end();
        number.len() < part.len() && number.ends_with(|digit: char| digit.is_ascii_digit())
    };
    value.split([',', 'x', '=', '.']).any(has_unit).then(|| format!("; write the number alone{unit}"))
}

/// An option of a command whose value may be left out, and that was given with a word after it instead of `=`.
fn apart_from_value(command: &clap::Command) -> Option<&str> {
    let words: Vec<_> = std::env::args_os().skip(1).map(|word| word.to_string_lossy().into_owned()).collect();
    let is_apart = |flag: &&str| {
        let mut pairs = words.windows(2);
        pairs.any(|pair| pair[0].strip_prefix("--") == Some(*flag) && !pair[1].starts_with('-'))
    };
    let optional = command.get_arguments().filter(|arg| arg.is_require_equals_set());
    optional.filter_map(clap::Arg::get_long).find(is_apart)
}

/// The first paragraph of clap's output, which describes the error; usage and hints follow after an empty line.
fn first_paragraph(printed: &str) -> String {
    let plain = printed.strip_prefix("error: ").unwrap_or(printed);
    let lines: Vec<&str> = plain.lines().map(str::trim).take_while(|line| !line.is_empty()).collect();
    lines.join(" ")
}

fn run(command: Command) -> Result<ExitCode, Failure> {
    match command {
        Command::Build(args) if args.resume => parts::resume(&args.build),
        Command::Build(args) => build(&args.build, args.each.as_deref()),
        Command::Batch(args) => batch(&args),
        Command::Scan(args) => scan(&args),
        Command::Plan(args) => parts::plan(&args),
        Command::Part(args) => parts::part(&args),
        Command::Merge(args) => parts::merge(&args),
        Command::Info(args) => {
            let input = Input::of(&args.model)?;
            platform::tell_of(&args.model, args.json);
            let mut info = info::read_info_measured(input.path(), args.measure)?;
            info.input = data(&args.model);
            Ok(print(args.json, || info.json(), || info.text(args.all))?)
        }
        Command::Verify(args) => {
            let input = Input::of(&args.model)?;
            let mut report = verify::verify_file(input.path())?;
            report.input = data(&args.model);
            Ok(print(args.json, || &report, || report.text())?)
        }
        Command::Pack(args) => pack_with(&args, pack::pack),
        Command::Unpack(args) => pack_with(&args, pack::unpack),
        Command::Strip(args) => {
            let request =
                StripRequest { channels: args.channels, levels: args.levels, lod: args.lod == Switch::On };
            let is_whole = args.channels.is_none() && args.levels == 0 && request.lod;
            let code = pack_with(&args.files, |input, output| pack::strip(input, output, &request))?;
            if is_whole && !args.files.json {
                let _ = writeln!(
                    io::stderr(),
                    "oct: note: nothing was left out; choose what goes with --channels, --levels or --lod off"
                );
            }
            Ok(code)
        }
        Command::Export(args) => export(&args),
        Command::Intersect(args) => intersect(&args),
        Command::Compare(args) => compare(&args),
        Command::Thickness(args) => thickness(&args),
        Command::Pores(args) => pores(&args),
        Command::View(args) => view(&args),
        Command::Render(args) => render(&args),
        Command::Thumbnail(args) => thumbnail(&args),
        Command::Demo(args) => demo(&args),
        Command::Selfcheck(args) => selfcheck(&args),
        Command::Completions(args) => Ok(manual::completions(args.shell)?),
        Command::Man(args) => {
            refuse_dash([&args.folder], dash::FOLDER)?;
            Ok(manual::pages(&args.folder)?)
        }
        Command::Report(args) => report(&args),
    }
}

fn build(args: &args::BuildArgs, each: Option<&Path>) -> Result<ExitCode, Failure> {
    refuse_dash([args.output()], dash::MODEL)?;
    refuse_dash(each, dash::FOLDER)?;
    check_suffixes([args.output()], Written::Model, args.force)?;
    // Memory of reading the arguments is given back before the job.
    jobs::give_back();
    let build = Build::of(args)?;
    let mut summary = Bars::during(args.run.is_silent(), |bars| {
        let (kind, inputs, how, job) =
            (build.kind, &build.inputs, &build.how, build.job(args.output(), bars));
        match each {
            Some(folder) => {
                let each = EachLabel { folder, replace: args.force, keep_whole: args.output.is_some() };
                jobs::build::convert_each(kind, inputs, how, &job, each)
            }
            None => jobs::build::convert(kind, inputs, how, &job),
        }
    })?;
    summary.input = args.input.iter().map(|p| data(p)).collect::<Vec<_>>().join(" ");
    Ok(print_unless_quiet(&args.run, || summary.json(), || summary.text())?)
}

/// Inputs and options of a build, in the library's terms.
struct Build {
    kind: SubjectKind,
    inputs: Vec<PathBuf>,
    how: OpenOptions,
    clean: CleanOptions,
    grid: GridOptions,
    options: BuildOptions,
    /// Keeps the file of standard input.
    _held: Option<Input>,
}

impl Build {
    fn of(args: &args::BuildArgs) -> Result<Self, Failure> {
        // Standard input gives headerless voxels only.
        let is_piped = args.input.iter().any(|path| is_dash(path));
        let kind = if is_piped { SubjectKind::Volume } else { SubjectKind::of(&args.input) };
        args.refuse_foreign(kind)?;
        let label_names =
            args.names.as_deref().map_or(Ok(Vec::new()), |table| read_label_names(table, args.keep_names))?;
        let raw = if kind == SubjectKind::Volume { raw_options(&args.raw)? } else { None };
        let spool = args.scratch.clone().unwrap_or_else(std::env::temp_dir);
        let (inputs, held) = match args.input.as_slice() {
            [only] if is_dash(only) && raw.is_some() => {
                let input = Input::within(only, &spool)?;
                (vec![input.path().to_path_buf()], Some(input))
            }
            [only] if is_dash(only) => return Err(dash::VOLUME.into()),
            several => {
                refuse_dash(several, dash::AMONG_FILES)?;
                (several.to_vec(), None)
            }
        };
        let how = OpenOptions {
            raw,
            gaps: args.which.gaps.gaps,
            volume: args.which.volume,
            index: args.which.index.clone(),
            follow_links: args.which.links.follow_links,
            keep_names: args.keep_names,
            placement: Placement { spacing_mm: args.raw.spacing, orientation: args.raw.orientation },
            ..OpenOptions::default()
        };
        let grid = args.mesh.options(args.raw.dims, &args.which.links);
        let options = args.options(label_names);
        Ok(Self { kind, inputs, how, clean: args.clean.options(), grid, options, _held: held })
    }

    fn job<'a>(&'a self, output: &'a Path, progress: &'a dyn Progress) -> BuildJob<'a> {
        BuildJob { clean: &self.clean, grid: &self.grid, options: &self.options, output, progress }
    }
}

fn batch(args: &args::BatchArgs) -> Result<ExitCode, Failure> {
    refuse_dash(&args.input, dash::SEARCH)?;
    refuse_dash([&args.out], dash::FOLDER)?;
    args.skin.refuse_ignored(None)?;
    args.clean.refuse_ignored()?;
    let jobs = args.jobs.unwrap_or_else(cores);
    let request = BatchRequest {
        inputs: args.input.clone(),
        out: args.out.clone(),
        how: OpenOptions {
            gaps: args.gaps.gaps,
            placement: Placement { spacing_mm: args.spacing, orientation: args.orientation },
            follow_links: args.search.links.follow_links,
            all_volumes: args.search.all_volumes,
            ..OpenOptions::default()
        },
        clean: args.clean.options(),
        find_labels: !args.selection.is_given(),
        build: args.options(),
        jobs,
        thumbnails: args.thumbnails,
        keep_names: args.keep_names,
        thumbnails_of_all: args.thumbnails_of_all,
        min_slices: args.min_slices,
        grid: args.mesh.options(&args.search.links),
        modalities: args.modality.clone(),
        series: args.series.clone(),
    };
    // Thumbnails are made from models in that folder.
    platform::tell_of(&args.out, args.run.json);
    let is_cells = request.build.volume_surface() == SurfaceKind::Cells;
    let boxes = if is_cells { "cells" } else { "skin voxels" };
    let bars = BatchBars::new(jobs, args.run.is_silent(), boxes);
    let report = jobs::batch::batch(&request, &bars);
    bars.finish();
    let report = report?;
    let counts = report.counts;
    let code = if args.run.json {
        // The items come from the report just written: they are never all in memory.
        copy_to_stdout(&args.out.join("report.json"))?
    } else {
        let notes: String = report.warnings.iter().map(|note| format!("  note: {}\n", shown(note))).collect();
        put(&format!(
            "{}: {} converted, {} skipped, {} failed; {:.1} s, peak resident memory {} of {} allowed\n  the folder holds {}, {}\n{notes}",
            shown(&args.out),
            counts.converted,
            counts.skipped,
            counts.failed,
            report.wall_s,
            Bytes(report.peak_rss_bytes),
            Bytes(report.memory_budget_bytes),
            Count(report.holds.models, "model"),
            Bytes(report.holds.bytes)
        ))?
    };
    Ok(if counts.failed > 0 { ExitCode::from(ExitKind::Partial.code()) } else { code })
}

/// Memory that `oct scan`, which has no cap of its own, takes for the images of one series: some 600,000.
const SCAN_OPENING_BYTES: u64 = 256 << 20;

fn scan(args: &args::ScanArgs) -> Result<ExitCode, Failure> {
    refuse_dash(&args.input, dash::SEARCH)?;
    let mut first = true;
    let notice = ScanReport::notice();
    let begin = if args.json {
        format!("{{\"notice\":{},\"items\":[\n", text::json(&notice))
    } else {
        format!("{notice}\n")
    };
    let how = OpenOptions {
        gaps: args.gaps.gaps,
        opening_bytes: Some(SCAN_OPENING_BYTES),
        follow_links: args.search.links.follow_links,
        all_volumes: args.search.all_volumes,
        meshes: true,
        ..OpenOptions::default()
    };
    let report = jobs::scan::scan(&args.input, &how, args.values, &mut |listed| {
        let before = match (args.json, std::mem::take(&mut first)) {
            (_, true) => &begin,
            (true, false) => ",\n",
            (false, _) => "",
        };
        let text = if args.json { text::json(listed) } else { listed.text() };
        put(&format!("{before}{text}")).map(|_| ())
    });
    let report = match report {
        Err(e) if args.json && !first => {
            // The object on stdout is closed with the error.
            let sentence = shown(&e.to_string()).to_string();
            let rest = text::json(&ErrorReport::new(&sentence, e.kind()));
            let _ = writeln!(io::stdout(), "\n],{}", rest.strip_prefix('{').unwrap_or(&rest));
            return Ok(tell(&sentence, e.kind(), false));
        }
        report => report?,
    };
    let text = || {
        let mut text =
            format!("{} would be converted, {} refused", Count(report.usable, "volume"), report.refused);
        if report.copies > 0 {
            text += &format!(", {} skipped as copies", report.copies);
        }
        if report.passed_over > 0 {
            text += &format!(", {} joined or passed over as similar", report.passed_over);
        }
        text += if report.usable + report.refused == 0 {
            NOTHING_FOUND
        } else if args.values {
            "; values were read, too\n"
        } else {
            "; only headers were read: --values also finds damaged pixels, and label maps that no header states\n"
        };
        for LeftOutCount { reason, count, first } in &report.left_out {
            text += &format!(
                "  {} left out: {} (first: {})\n",
                Count(*count, "file"),
                shown(reason),
                shown(first)
            );
            if *count > 1 && reason == NOT_VOLUME {
                text += "    headerless slices are taken with a side-car: NAME.json beside the folder NAME, with {\"dims\": [512, 512, 300], \"dtype\": \"u16\", \"spacing\": [0.5, 0.5, 1.0]}\n";
            }
        }
        text
    };
    let json = || {
        let head = if first { &begin } else { "" };
        let rest = text::json(&report);
        format!("{head}\n],{}\n", rest.strip_prefix('{').unwrap_or(&rest))
    };
    Ok(put(&if args.json { json() } else { text() })?)
}

/// End of the sentence on folders without a volume.
const NOTHING_FOUND: &str = ": no DICOM, NRRD, NIfTI, MetaImage, MRC, VTK, VGStudio, Amira, NumPy, Zarr, TIFF, PNG or mesh (STL, PLY, OBJ, OFF, glTF, 3MF), no tree of solids (.csg), and no headerless voxels with a side-car were found (`oct help formats`)\n";

/// Reason for files that are left out without a known one.
const NOT_VOLUME: &str = "not a volume";

/// The description of a headerless volume, if a part of it was given.
fn raw_options(raw: &args::RawArgs) -> Result<Option<RawOptions>, &'static str> {
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
        (None, None) => Err(
            "--skip is for raw volumes, with --dims and --dtype; other files say where their voxels begin",
        ),
        (None, Some(_)) => Err("a raw volume needs --dims NXxNYxNZ as well"),
        (Some(_), None) => Err("a raw volume needs --dtype as well, for example --dtype u16"),
    }
}

fn export(args: &args::ExportArgs) -> Result<ExitCode, Failure> {
    let Some(named) = &args.output else { return export_each(args) };
    let Some(form) = args.form.or_else(|| ExportForm::of(named)) else {
        return Err(format!(
            "{}: does not say what to write; name it .stl, .ply, .obj, .glb, .3mf, .nrrd, .nii, .nii.gz or .html, or choose with --as",
            shown(named)
        )
        .into());
    };
    let suffix = ExportForm::of(named).map_or("", ExportForm::suffix);
    if !args.force && !suffix.is_empty() && suffix != form.suffix() {
        return Err(format!(
            "{}: is named as another kind of file, and {} would be written; name it .{}, or add --force",
            shown(named),
            form.name(),
            form.suffix()
        )
        .into());
    }
    let rules = args.labels.rules(&[]);
    let request = export_request(args, form, &rules)?;
    if form == ExportForm::Linked {
        // The page fetches the model by its name.
        refuse_dash([&args.model], dash::AMONG_FILES)?;
    }
    let output = Output::of(named, Written::Export, args.force, args.run.json)?;
    let model = Input::of(&args.model)?;
    platform::tell_of(&args.model, args.run.json);
    let mut report = Bars::during(args.run.is_silent(), |bars| {
        jobs::export::export(model.path(), output.path(), request, bars)
    })?;
    (report.input, report.output) = (data(&args.model), data(named));
    output.finish(|| print_unless_quiet(&args.run, || &report, || report.text()))
}

/// Writes a file for each label.
fn export_each(args: &args::ExportArgs) -> Result<ExitCode, Failure> {
    let folder = args.each.clone().unwrap_or_default();
    let rules = args.labels.rules(&[]);
    let request = export_request(args, args.form.unwrap_or(ExportForm::Stl), &rules)?;
    if !request.form.has_triangles() {
        return Err(not_of("--each", TRIANGLES).into());
    }
    refuse_dash([&folder], dash::FOLDER)?;
    let model = Input::of(&args.model)?;
    platform::tell_of(&args.model, args.run.json);
    let mut report = Bars::during(args.run.is_silent(), |bars| {
        jobs::export::export_each(model.path(), &folder, request, bars)
    })?;
    report.input = data(&args.model);
    Ok(print_unless_quiet(&args.run, || &report, || report.text())?)
}

/// Forms that have surfaces.
const TRIANGLES: &str = "triangles (stl, ply, obj, glb, 3mf)";

fn export_request<'a>(
    args: &args::ExportArgs,
    form: ExportForm,
    labels: &'a [LabelRule],
) -> Result<ExportRequest<'a>, String> {
    if args.skin && !form.is_mask() {
        return Err(not_of("--skin", "masks (nrrd, nii, nii.gz)"));
    }
    let of_triangles = [
        ("--error", args.error.is_some()),
        ("--triangles", args.triangles.is_some()),
        ("--smooth", args.smooth.is_some()),
    ];
    if let Some((flag, _)) = of_triangles.iter().find(|(_, given)| *given && !form.has_triangles()) {
        return Err(not_of(flag, TRIANGLES));
    }
    Ok(ExportRequest {
        form,
        skin_only: args.skin,
        error: args.error,
        triangles: args.triangles,
        smooth: args.smooth,
        labels,
    })
}

fn view(args: &args::ViewArgs) -> Result<ExitCode, Failure> {
    refuse_dash([&args.model], dash::AMONG_FILES)?;
    platform::tell_of(&args.model, false);
    let request = ViewRequest { port: args.port, idle: args.idle.map(Duration::from_secs) };
    let ready = |address: &str| {
        let _ = writeln!(io::stdout(), "{address}\n  Ctrl-C ends it");
        let _ = io::stdout().flush();
        if !args.no_open {
            platform::open_browser(address);
        }
    };
    jobs::view::view(&args.model, request, &std::env::temp_dir(), &ready, &|| false)?;
    Ok(ExitCode::SUCCESS)
}

fn intersect(args: &args::IntersectArgs) -> Result<ExitCode, Failure> {
    refuse_dash([&args.one, &args.other], dash::AMONG_FILES)?;
    platform::tell_of(&args.one, args.json);
    let placement = placed(args.place, args.moved);
    let report = jobs::intersect::intersect([&args.one, &args.other], &placement, args.clearance.is_some())?;
    let shown = print(args.json, || &report, || report.text())?;
    let is_too_near = args.clearance.is_some_and(|mm| !report.is_clear_by(mm));
    Ok(if is_too_near { ExitCode::from(Verdict::DoesNotConform.code()) } else { shown })
}

/// Checks the arguments of a measurement.
fn begin_measuring(inputs: &[&Path], run: &args::MeasureArgs) -> Result<(), Failure> {
    refuse_dash(inputs, dash::AMONG_FILES)?;
    refuse_dash(&run.output, dash::MODEL)?;
    refuse_dash(&run.csv, dash::TABLE)?;
    check_suffixes(&run.output, Written::Model, run.force)?;
    inputs.iter().take(1).for_each(|input| platform::tell_of(input, run.run.json));
    Ok(())
}

fn compare(args: &args::CompareArgs) -> Result<ExitCode, Failure> {
    let (inputs, run) = ([args.actual.as_path(), &args.nominal], &args.run);
    begin_measuring(&inputs, run)?;
    let outputs = CompareOutputs { model: run.output.as_deref(), csv: run.csv.as_deref() };
    let report = Bars::during(run.run.is_silent(), |bars| {
        jobs::compare::compare(inputs, &args.request(), outputs, bars)
    })?;
    let code = print(run.run.json, || &report, || report.text())?;
    Ok(report.verdict().map_or(code, |verdict| ExitCode::from(verdict.code())))
}

fn thickness(args: &args::ThicknessArgs) -> Result<ExitCode, Failure> {
    let (model, run) = (args.model.as_path(), &args.run);
    begin_measuring(&[model], run)?;
    let outputs = ThicknessOutputs { model: run.output.as_deref(), csv: run.csv.as_deref() };
    let report = Bars::during(run.run.is_silent(), |bars| {
        jobs::thickness::thickness(model, &args.request(), outputs, bars)
    })?;
    Ok(print(run.run.json, || &report, || report.text())?)
}

fn pores(args: &args::PoresArgs) -> Result<ExitCode, Failure> {
    refuse_dash([&args.model], dash::AMONG_FILES)?;
    refuse_dash(&args.csv, dash::TABLE)?;
    platform::tell_of(&args.model, args.run.json);
    let request = PoresRequest { bodies: args.bodies, least: args.least, gap: args.gap };
    let report = Bars::during(args.run.is_silent(), |bars| {
        jobs::pores::pores(&args.model, request, args.csv.as_deref(), bars)
    })?;
    Ok(print(args.run.json, || &report, || report.text())?)
}

fn render(args: &args::RenderArgs) -> Result<ExitCode, Failure> {
    let (depth, normals, ids) = (args.depth.as_deref(), args.normals.as_deref(), args.ids.as_deref());
    let layers = || depth.into_iter().chain(normals).chain(ids);
    refuse_dash(layers(), dash::LAYER)?;
    check_suffixes(layers(), Written::Picture, args.force)?;
    args.refuse_ignored(is_scene(&args.model))?;
    let written = if args.turntable.is_some() { Written::Turntable } else { Written::Picture };
    let output = Output::of(&args.output, written, args.force, args.json)?;
    let (title, legend) = (args.title.as_deref(), args.legend);
    let outputs = Outputs { image: output.path(), depth, normals, ids, shots: args.shots(), title, legend };
    platform::tell_of(&args.model, args.json);
    let model = Input::of(&args.model)?;
    let report =
        Bars::during(args.json, |bars| picture::render_file(model.path(), &outputs, &args.request(), bars))?;
    let has = [depth.is_some(), args.section.is_some()];
    output.finish(|| print_picture(args.json, (&args.model, &args.output), has, report))
}

fn thumbnail(args: &args::ThumbnailArgs) -> Result<ExitCode, Failure> {
    let threads = args.threads.count();
    let output = Output::of(&args.output, Written::Picture, args.force, args.json)?;
    let model = Input::of(&args.model)?;
    platform::tell_of(&args.model, args.json);
    let report = picture::thumbnail_file(model.path(), output.path(), args.size, threads)?;
    output.finish(|| print_picture(args.json, (&args.model, &args.output), [false; 2], report))
}

fn demo(args: &args::DemoArgs) -> Result<ExitCode, Failure> {
    refuse_dash([&args.output].into_iter().chain(&args.write_raw), dash::MODEL)?;
    refuse_dash(&args.picture, dash::LAYER)?;
    check_suffixes([&args.output], Written::Model, args.force)?;
    check_suffixes(&args.picture, Written::Picture, args.force)?;
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
    platform::tell_of(&args.output, args.run.json);
    let summary = Bars::during(args.run.is_silent(), |bars| {
        jobs::demo::demo(args.size, &options, &files, threads, bars)
    })?;
    Ok(print_unless_quiet(&args.run, || summary.json(), || summary.text())?)
}

fn selfcheck(args: &args::SelfcheckArgs) -> Result<ExitCode, Failure> {
    let input = Input::of(&args.model)?;
    platform::tell_of(&args.model, args.json);
    let model = open_model(input.path())?;
    let threads = args.threads.count();
    let found = jobs::render::selfcheck(&model.view(), args.rays, args.seed, threads).map_err(Error::from)?;
    model.check_unchanged(input.path()).map_err(Error::from)?;
    let total = found.total();
    let code = print(
        args.json,
        || &found,
        || format!("{} rays, {total} mismatches against the exact reference\n", args.rays),
    )?;
    Ok(if total == 0 { code } else { ExitCode::FAILURE })
}

fn report(args: &args::ReportArgs) -> Result<ExitCode, Failure> {
    refuse_dash(&args.model, dash::SEARCH)?;
    refuse_dash([&args.out], dash::FOLDER)?;
    // Quoted for a shell.
    let quoted = |word: String| {
        let plain = |c: char| c.is_ascii_alphanumeric() || "-_./@=:,".contains(c);
        if word.chars().all(plain) { word } else { format!("'{}'", word.replace('\'', "'\\''")) }
    };
    let words = std::env::args_os().skip(1).map(|word| quoted(word.to_string_lossy().into_owned()));
    let request = ReportRequest {
        model: args.model.clone(),
        synthetic: args.synthetic.clone(),
        out: args.out.clone(),
        threads: args.threads.count(),
        pixels: args.pixels,
        command: std::iter::once("oct".to_owned()).chain(words).collect::<Vec<_>>().join(" "),
    };
    let report = Bars::or_lines(args.run.is_silent(), |bars| jobs::report::report(&request, bars))?;
    Ok(print(args.run.json, || &report, || report.text())?)
}

fn pack_with(
    args: &args::PackArgs,
    work: impl FnOnce(&Path, &Path) -> Result<pack::PackReport, Error>,
) -> Result<ExitCode, Failure> {
    let output = Output::of(&args.output, Written::Model, args.force, args.json)?;
    let input = Input::of(&args.input)?;
    let mut report = work(input.path(), output.path())?;
    (report.input, report.output) = (data(&args.input), data(&args.output));
    output.finish(|| print(args.json, || &report, || report.text()))
}

/// Prints the report as JSON or as text.
pub(crate) fn print<T: Serialize>(
    as_json: bool,
    json: impl FnOnce() -> T,
    text: impl FnOnce() -> String,
) -> Result<ExitCode, Error> {
    put(&if as_json { text::json(&json()) + "\n" } else { text() })
}

/// Like [`print()`], without the text under `--quiet`.
pub(crate) fn print_unless_quiet<T: Serialize>(
    run: &RunArgs,
    json: impl FnOnce() -> T,
    text: impl FnOnce() -> String,
) -> Result<ExitCode, Error> {
    print(run.json, json, || if run.quiet { String::new() } else { text() })
}

/// Prints a text. A reader that has gone away (`oct info x | head -1`) is not an error.
fn put(text: &str) -> Result<ExitCode, Error> {
    write_to_stdout(plain(text, true).as_bytes())
}
