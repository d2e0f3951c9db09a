//! Reasons for the command to end without success, and their report: one sentence on stderr, and under `--json` one
//! object on stdout as well.

use std::borrow::Cow;
use std::io::{self, Write};
use std::process::ExitCode;

use infobyte::text::{self, shown};
use infobyte::{Error, ErrorReport, ExitKind};

/// Reason for the command to end without success.
#[derive(Debug, thiserror::Error)]
pub(crate) enum Failure {
    /// Its arguments do not belong together, whatever the files contain: a sentence.
    #[error("{0}")]
    Arguments(Cow<'static, str>),
    /// The library's error.
    #[error(transparent)]
    Job(#[from] Error),
}

/// Sentences on `-` for standard input, or output, where it cannot be used.
pub(crate) mod dash {
    pub(crate) const VOLUME: &str =
        "standard input (-) is read as headerless voxels only; add --dims and --dtype, or name a file";
    pub(crate) const AMONG_FILES: &str = "standard input (-) cannot be one of several inputs; name files";
    pub(crate) const SEARCH: &str = "standard input (-) cannot be searched; name files and folders";
    pub(crate) const MODEL: &str =
        "a model is put in its place whole and cannot go to standard output (-); name a file";
    pub(crate) const FOLDER: &str = "standard output (-) cannot take several files; name a folder";
    pub(crate) const LAYER: &str =
        "only one picture can go to standard output (-), that of --output; name a file";
    pub(crate) const TABLE: &str = "a table cannot go to standard output (-); name a file";
    pub(crate) const WITH_JSON: &str =
        "standard output cannot take both the file (-o -) and the report (--json); name a file";
    pub(crate) const TERMINAL: &str =
        "the output is not for a terminal; send it into a file or another command";
}

/// The refusal of an option that the input or the output does not support.
pub(crate) fn not_of(flag: &str, of: &str) -> String {
    format!("{flag} is for {of}; leave it out")
}

impl From<&'static str> for Failure {
    fn from(sentence: &'static str) -> Self {
        Self::Arguments(sentence.into())
    }
}

impl From<String> for Failure {
    fn from(sentence: String) -> Self {
        Self::Arguments(sentence.into())
    }
}

impl Failure {
    /// Kind of the exit code.
    pub(crate) fn kind(&self) -> ExitKind {
        match self {
            Self::Arguments(_) => ExitKind::Usage,
            Self::Job(cause) => cause.kind(),
        }
    }
}

/// Reports a failure on stderr, and as an object on stdout if that was asked for. There may be no listener.
pub(crate) fn tell(sentence: &str, kind: ExitKind, as_json: bool) -> ExitCode {
    // One line, whatever a file's name contains.
    let sentence = shown(sentence).to_string();
    if as_json {
        let _ = writeln!(io::stdout(), "{}", text::json(&ErrorReport::new(&sentence, kind)));
    }
    let _ = writeln!(io::stderr(), "oct: {sentence}");
    ExitCode::from(kind.code())
}
