//! Cures for refusals of the operating system.

use std::fmt;
use std::io;

use crate::atomic::TargetFault;
use crate::platform::{is_not_regular, is_open_elsewhere, is_too_many_open};
use crate::text::names::BUILD_INPUT;

/// The cure for a file that cannot be read; `usual` if the reason suggests no other.
pub(crate) fn reading<T: fmt::Display>(cause: &io::Error, usual: T) -> Cure<T> {
    if is_too_many_open(cause) {
        Cure::RaiseLimit
    } else if is_open_elsewhere(cause) {
        Cure::CloseIt
    } else if is_not_regular(cause) {
        Cure::NameFile
    } else {
        Cure::Usual(usual)
    }
}

/// The end of a sentence about a file that cannot be read.
pub(crate) enum Cure<T> {
    RaiseLimit,
    CloseIt,
    NameFile,
    Usual(T),
}

impl<T: fmt::Display> fmt::Display for Cure<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::RaiseLimit => f.write_str(RAISE_LIMIT),
            Self::CloseIt => f.write_str(CLOSE_IT),
            Self::NameFile => {
                write!(f, "name a file; a folder of slices becomes a model with `{BUILD_INPUT}`")
            }
            Self::Usual(cure) => cure.fmt(f),
        }
    }
}

/// The cure for an output file that cannot be written.
pub(crate) fn writing(cause: &io::Error) -> &'static str {
    use io::ErrorKind as Kind;
    if is_too_many_open(cause) {
        return RAISE_LIMIT;
    }
    if is_open_elsewhere(cause) {
        return CLOSE_IT;
    }
    if let Some(fault) = cause.get_ref().and_then(|inner| inner.downcast_ref::<TargetFault>()) {
        return match fault {
            TargetFault::DanglingLink => "remove the link, or name another file",
            TargetFault::Device | TargetFault::NotRegular | TargetFault::NoFileName => {
                "name a file that is to be written"
            }
            TargetFault::NoFreeName => "clear the folder of old temporary files, or choose another one",
        };
    }
    match cause.kind() {
        Kind::AlreadyExists => "a file has that name; name a folder",
        Kind::NotFound => "its folder does not exist; make it first, or choose another one",
        Kind::NotADirectory => "a part of its path is a file; choose a folder",
        Kind::PermissionDenied => "you may not write there; choose another folder",
        Kind::ReadOnlyFilesystem => "nothing can be written there; choose another folder",
        Kind::InvalidFilename => "the system takes no such name, or none so long; choose another one",
        Kind::StorageFull | Kind::QuotaExceeded => "free some space, or choose another folder",
        _ => "check the folder and its free space",
    }
}

const CLOSE_IT: &str =
    "another program has it open, or it may only be read; close it there, or name another file";
const RAISE_LIMIT: &str = "too many files are open; raise the limit, for example with `ulimit -n 4096`";

#[cfg(test)]
mod tests {
    #[cfg(unix)]
    #[test]
    fn the_cure_fits_the_cause() {
        use super::*;
        use crate::platform::Errno;
        let of = |errno: Errno| io::Error::from_raw_os_error(errno.raw_os_error());
        assert!(reading(&of(Errno::MFILE), "as usual").to_string().contains("ulimit"));
        assert_eq!(reading(&of(Errno::NOENT), "as usual").to_string(), "as usual");
        for (errno, word) in [
            (Errno::NOENT, "does not exist"),
            (Errno::ACCESS, "may not write"),
            (Errno::NOSPC, "free some space"),
            (Errno::ROFS, "nothing can be written"),
            (Errno::NFILE, "ulimit"),
            (Errno::EXIST, "name a folder"),
            (Errno::IO, "check the folder"),
        ] {
            assert!(writing(&of(errno)).contains(word), "{errno:?}");
        }
        assert!(writing(&TargetFault::NotRegular.into()).contains("name a file"));
    }
}
