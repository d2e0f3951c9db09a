//! `oct completions` and `oct man`: completions and manual pages, made from the types of the command line.

use std::fs;
use std::io::{self, Write};
use std::path::Path;
use std::process::ExitCode;

use clap::builder::PossibleValuesParser;
use clap::{Arg, Command, CommandFactory, ValueHint};
use clap_complete::{Shell, generate};
use clap_mangen::Man;
use infobyte::Error;
use infobyte::builder::Gradient;
use infobyte::clean::Preset;
use infobyte::text::shown;

use crate::args::Cli;
use crate::streams::write_to_stdout;

/// The values of an option with few of them, where the command line parses it by a rule of its own.
fn values(option: &str) -> Option<Vec<&'static str>> {
    Some(match option {
        "surface" => vec!["skin", "cells"],
        "channels" => vec!["normal", "value", "offset", "color", "material", "none"],
        "gradient" => Gradient::ALL.map(Gradient::name).to_vec(),
        "connectivity" | "component-connectivity" => vec!["26", "6"],
        "downsample" => vec!["2", "4"],
        "preset" => Preset::ALL.map(Preset::name).to_vec(),
        "dtype" => vec![
            "u8", "i8", "u16", "i16", "u32", "i32", "f32", "f64", "u16be", "i16be", "u32be", "i32be",
            "f32be", "f64be",
        ],
        "orientation" => vec!["LPS", "LPI", "RAS", "RAI"],
        "unit" => vec!["um", "mm", "cm", "m", "in"],
        "up" => vec!["x", "y", "z"],
        _ => return None,
    })
}

/// A command with additional completions: words of few, and folders where one is meant.
fn completed(command: Command) -> Command {
    let offered = |arg: Arg| {
        let is_folder = arg.get_value_names().is_some_and(|names| names.iter().any(|name| name == "DIR"));
        match arg.get_long().and_then(values) {
            Some(words) if arg.get_action().takes_values() => {
                arg.value_parser(PossibleValuesParser::new(words))
            }
            _ if is_folder => arg.value_hint(ValueHint::DirPath),
            _ => arg,
        }
    };
    command.mut_args(offered).mut_subcommands(completed)
}

/// Prints the completions of a shell.
pub(crate) fn completions(shell: Shell) -> Result<ExitCode, Error> {
    // Written to memory first: the generator panics if the reader has gone away.
    let mut script = Vec::new();
    generate(shell, &mut completed(Cli::command()), "oct", &mut script);
    write_to_stdout(&script)
}

/// Writes `oct.1` and a page for each command, such as `oct-build.1`, and prints their names.
pub(crate) fn pages(folder: &Path) -> Result<ExitCode, Error> {
    let failed = |path: &Path| {
        let path = path.to_path_buf();
        move |cause| Error::Output { path, cause }
    };
    fs::create_dir_all(folder).map_err(failed(folder))?;
    let mut whole = Cli::command().disable_help_subcommand(true);
    whole.build();
    let mut stdout = io::stdout().lock();
    let commands: Vec<_> = whole.get_subcommands().cloned().collect();
    for command in std::iter::once(whole.clone()).chain(commands) {
        let name = command.get_display_name().unwrap_or_else(|| command.get_name()).to_owned();
        let path = folder.join(format!("{name}.1"));
        let mut page = Vec::new();
        Man::new(command).render(&mut page).map_err(failed(&path))?;
        fs::write(&path, page).map_err(failed(&path))?;
        // If the reader has gone away, the name is lost.
        let _ = writeln!(stdout, "{}", shown(&path));
    }
    Ok(ExitCode::SUCCESS)
}
