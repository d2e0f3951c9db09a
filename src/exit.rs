//! Responsibility for a failure, hence the exit code of the command.

use serde::Serialize;

/// Responsibility for a failure; each kind is one exit code of the command.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub enum ExitKind {
    /// The caller's request is wrong: exit 2.
    Usage,
    /// The input is wrong: exit 3.
    Input,
    /// The memory budget is too small: exit 4.
    Budget,
    /// The disk, the operating system or this program failed: exit 5.
    Io,
    /// A batch finished with some failures: exit 8.
    Partial,
    /// The caller stopped the job, as [`Progress`](crate::progress::Progress) can: exit 130, as shells have it.
    Stopped,
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
            Self::Stopped => 130,
        }
    }
}

/// An error of one boundary: opaque, with its kind, its path and its sentence. What it holds is private to the crate.
macro_rules! opaque_error {
    ($(#[$doc:meta])* $name:ident($fault:ident)) => {
        $(#[$doc])*
        pub struct $name(Box<$fault>);

        impl $name {
            /// Responsibility for it, hence the exit code.
            pub fn kind(&self) -> $crate::ExitKind {
                self.0.kind()
            }

            /// The file or folder at fault, if there is one.
            pub fn path(&self) -> Option<&std::path::Path> {
                self.0.path()
            }

            #[allow(dead_code, reason = "not every boundary is asked by the crate")]
            pub(crate) fn fault(&self) -> &$fault {
                &self.0
            }

            #[allow(dead_code, reason = "not every boundary is asked by the crate")]
            pub(crate) fn fault_mut(&mut self) -> &mut $fault {
                &mut self.0
            }
        }

        impl From<$fault> for $name {
            fn from(fault: $fault) -> Self {
                Self(Box::new(fault))
            }
        }

        impl std::fmt::Debug for $name {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                std::fmt::Debug::fmt(&self.0, f)
            }
        }

        impl std::fmt::Display for $name {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                std::fmt::Display::fmt(&self.0, f)
            }
        }

        impl std::error::Error for $name {
            fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
                self.0.source()
            }
        }
    };
}
pub(crate) use opaque_error;

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
