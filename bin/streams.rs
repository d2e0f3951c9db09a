//! `-` for standard input and output, and suffixes that tell the kind of a file.

use std::fs::File;
use std::io::{self, IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use infobyte::Error;
use infobyte::jobs::build::is_other_kind;
use infobyte::text::{call, shown};
use tempfile::TempDir;

use crate::failure::{Failure, dash};
use crate::platform::{hidden_file, is_reader_gone};

/// True for `-`, which stands for standard input or output.
pub(crate) fn is_dash(path: &Path) -> bool {
    path == Path::new("-")
}

/// A file to be read: the one that was named, or all of standard input.
pub(crate) struct Input {
    path: PathBuf,
    /// Standard input cannot seek, so it is spooled into a file without a name, which is gone when the process ends,
    /// however that happens. A link by which it is opened stands in a folder of its own.
    _spooled: Option<(File, TempDir)>,
}

impl Input {
    /// The file named, or standard input spooled into the system's folder for temporary files.
    pub(crate) fn of(named: &Path) -> Result<Self, Error> {
        Self::within(named, &std::env::temp_dir())
    }

    /// The file named, or standard input spooled into a file in `folder`.
    pub(crate) fn within(named: &Path, folder: &Path) -> Result<Self, Error> {
        if !is_dash(named) {
            return Ok(Self { path: named.to_path_buf(), _spooled: None });
        }
        let failed = |cause| Error::Output { path: folder.to_path_buf(), cause };
        let link = tempfile::tempdir_in(folder).map_err(failed)?;
        let path = link.path().join("standard input");
        let mut file = hidden_file(&path, folder).map_err(failed)?;
        io::copy(&mut io::stdin().lock(), &mut file).map_err(failed)?;
        call(path.clone(), "standard input");
        Ok(Self { path, _spooled: Some((file, link)) })
    }

    /// Path by which it can be opened.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }
}

/// Kind of an output.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Written {
    Model,
    Picture,
    Turntable,
    Export,
}

/// A file to be written: the one that was named, or one that is sent to standard output when it is whole.
pub(crate) struct Output {
    path: PathBuf,
    held: Option<TempDir>,
}

impl Output {
    /// Checks the named output before any work is done.
    pub(crate) fn of(named: &Path, written: Written, force: bool, as_json: bool) -> Result<Self, Failure> {
        if !is_dash(named) {
            check_suffix(named, written, force)?;
            return Ok(Self { path: named.to_path_buf(), held: None });
        }
        if as_json {
            return Err(dash::WITH_JSON.into());
        }
        if io::stdout().is_terminal() {
            return Err(dash::TERMINAL.into());
        }
        let failed = |cause| Error::Output { path: std::env::temp_dir(), cause };
        let folder = tempfile::tempdir().map_err(failed)?;
        Ok(Self { path: folder.path().join("standard output"), held: Some(folder) })
    }

    /// Path of the file to be written.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Sends the file on to standard output, or lets the report be printed.
    pub(crate) fn finish(
        self,
        report: impl FnOnce() -> Result<ExitCode, Error>,
    ) -> Result<ExitCode, Failure> {
        match &self.held {
            None => Ok(report()?),
            Some(_) => Ok(copy_to_stdout(&self.path)?),
        }
    }
}

/// Copies a file to standard output. A reader that has gone away is not an error.
pub(crate) fn copy_to_stdout(path: &Path) -> Result<ExitCode, Error> {
    let copied = File::open(path).and_then(|mut file| io::copy(&mut file, &mut io::stdout().lock()));
    put(copied.map(drop))
}

/// Writes all to standard output, as [`copy_to_stdout`] does.
pub(crate) fn write_to_stdout(bytes: &[u8]) -> Result<ExitCode, Error> {
    let mut stdout = io::stdout().lock();
    put(stdout.write_all(bytes).and_then(|()| stdout.flush()))
}

fn put(written: io::Result<()>) -> Result<ExitCode, Error> {
    match written {
        Err(cause) if !is_reader_gone(&cause) => Err(Error::Output { path: "standard output".into(), cause }),
        _ => Ok(ExitCode::SUCCESS),
    }
}

/// Refuses a suffix that belongs to another kind of file.
fn check_suffix(path: &Path, written: Written, force: bool) -> Result<(), Failure> {
    let suffix = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    let (foreign, this, other) = match written {
        Written::Model => ("png", "a model", "MODEL.oct"),
        Written::Turntable if suffix == "gif" => return Ok(()),
        Written::Picture => ("oct", "a PNG picture", "IMAGE.png"),
        Written::Turntable => ("oct", "an animation", "TURN.png or TURN.gif"),
        // The suffix selects the form.
        Written::Export => return Ok(()),
    };
    if !force && (suffix == foreign || is_other_kind(&suffix)) {
        return Err(format!(
            "{}: is named as another kind of file, and {this} would be written; name it {other}, or add --force",
            shown(path)
        )
        .into());
    }
    Ok(())
}

/// Refuses `-` among names where it would be the name of a file.
pub(crate) fn refuse_dash<P: AsRef<Path>>(
    paths: impl IntoIterator<Item = P>,
    sentence: &'static str,
) -> Result<(), Failure> {
    if paths.into_iter().any(|path| is_dash(path.as_ref())) { Err(sentence.into()) } else { Ok(()) }
}

/// Refuses names of models or pictures with the suffix of another kind.
pub(crate) fn check_suffixes<P: AsRef<Path>>(
    paths: impl IntoIterator<Item = P>,
    written: Written,
    force: bool,
) -> Result<(), Failure> {
    paths.into_iter().try_for_each(|path| check_suffix(path.as_ref(), written, force))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_other_kinds_are_refused_unless_insisted_on() {
        let refused = |name: &str, written, force| check_suffix(Path::new(name), written, force).is_err();
        for name in ["a.png", "a.PNG", "b/c.nii.gz", "x.jpg"] {
            assert!(refused(name, Written::Model, false) && !refused(name, Written::Model, true), "{name}");
        }
        for name in ["a.jpg", "a.TIFF", "m.oct"] {
            assert!(
                refused(name, Written::Picture, false) && !refused(name, Written::Picture, true),
                "{name}"
            );
        }
        for name in ["a.oct", "noname", "a.packed", ".hidden", "v1.2"] {
            assert!(!refused(name, Written::Model, false), "{name}");
        }
        assert!(!refused("a.gif", Written::Turntable, false) && refused("a.mp4", Written::Turntable, false));
        assert!(!refused("a.png", Written::Picture, false) && !refused("tmp.XyZ", Written::Picture, false));
    }
}
