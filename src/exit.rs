//! Who has to act on a failure, hence the exit code of the command.

use serde::Serialize;

/// Who has to act on a failure; each kind is one exit code of the command.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub enum ExitKind {
    /// The caller is wrong: exit 2.
    Usage,
    /// The input is wrong: exit 3.
    Input,
    /// The memory budget is too small: exit 4.
    Budget,
    /// The disk or the operating system failed: exit 5.
    Io,
    /// A batch finished with some failures: exit 8.
    Partial,
}

impl ExitKind {
    /// The process exit code of this kind.
    pub fn code(self) -> u8 {
        match self {
            Self::Usage => 2,
            Self::Input => 3,
            Self::Budget => 4,
            Self::Io => 5,
            Self::Partial => 8,
        }
    }
}

/// The report of a command that fails, for `--json`.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct ErrorReport {
    /// Cause and remedy in one sentence; the same as on stderr.
    pub error: String,
    /// Kind of failure: wrong usage, unusable input, too little memory, or disk and system.
    pub kind: ExitKind,
    /// Exit code of the command: 2, 3, 4, 5 or 8.
    pub exit_code: u8,
}

impl ErrorReport {
    /// The report of a failure of some kind.
    pub fn new(sentence: &str, kind: ExitKind) -> Self {
        Self { error: sentence.to_owned(), kind, exit_code: kind.code() }
    }
}
