//! Cures for refusals of the operating system.

use std::borrow::Cow;
use std::io;

use crate::atomic::TargetFault;
use crate::platform::{is_not_regular, is_open_elsewhere, is_too_many_open};
use crate::text::names::BUILD_INPUT;

/// The cure for a file that cannot be read; `usual` if the reason suggests no other.
pub(crate) fn reading(cause: &io::Error, usual: &'static str) -> Cow<'static, str> {
    if is_too_many_open(cause) {
        RAISE_LIMIT.into()
    } else if is_open_elsewhere(cause) {
        CLOSE_IT.into()
    } else if is_not_regular(cause) {
        format!("name a file; a folder of slices becomes a model with `{BUILD_INPUT}`").into()
    } else {
        usual.into()
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
        assert!(reading(&of(Errno::MFILE), "as usual").contains("ulimit"));
        assert_eq!(reading(&of(Errno::NOENT), "as usual"), "as usual");
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
