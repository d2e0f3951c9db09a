//! Who has to act on a failure, hence the exit code of the command.

/// Who has to act on a failure; each kind is one exit code of the command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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

    /// Its name, as reports in JSON have it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Usage => "usage",
            Self::Input => "input",
            Self::Budget => "budget",
            Self::Io => "io",
            Self::Partial => "partial",
            Self::Stopped => "stopped",
        }
    }
}
