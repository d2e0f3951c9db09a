//! `oct completions` and `oct man`: what shells and `man` want to know of the command line, made from its types.

use std::fs;
use std::io::{self, Write};
use std::path::Path;
use std::process::ExitCode;

use clap::CommandFactory;
use clap_complete::{Shell, generate};
use clap_mangen::Man;
use infobyte::Error;
use infobyte::text::shown;

use crate::args::Cli;

/// Prints the completions of a shell.
pub(crate) fn completions(shell: Shell) -> Result<ExitCode, Error> {
    // Written to memory first: the generator does not bear a reader that goes away.
    let mut script = Vec::new();
    generate(shell, &mut Cli::command(), "oct", &mut script);
    let mut stdout = io::stdout().lock();
    match stdout.write_all(&script).and_then(|()| stdout.flush()) {
        Err(cause) if cause.kind() != io::ErrorKind::BrokenPipe => {
            Err(Error::Output { path: "standard output".into(), cause })
        }
        _ => Ok(ExitCode::SUCCESS),
    }
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
        // A reader that has gone away misses a name.
        let _ = writeln!(stdout, "{}", shown(&path));
    }
    Ok(ExitCode::SUCCESS)
}
