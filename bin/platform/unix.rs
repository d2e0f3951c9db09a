//! Linux and macOS.
//!
//! If a mapped file is truncated, the command ends with a sentence and the exit code of its kind. Reading a page of a
//! mapping beyond the end of the file raises SIGBUS. The traversal cannot be resumed from there, so the handler writes
//! a prepared sentence and ends the process. Nothing is left behind: pictures are written when they are finished, and
//! get their name only when they are whole.
#![allow(unsafe_code)]

use std::fs::File;
use std::io;
use std::os::fd::AsRawFd;
use std::path::Path;
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use infobyte::text::{self, shown};
use infobyte::{ErrorReport, ExitKind};
use signal_hook::consts::{SIGBUS, SIGXFSZ};
use signal_hook::{flag, low_level};

/// Makes writing past a file-size limit an error that can be reported, not the end of the process. If the handler
/// cannot be set, the system's default stays.
pub(crate) fn report_size_limits() {
    let _ = flag::register(SIGXFSZ, Arc::new(AtomicBool::new(false)));
}

/// Makes a file without a name on the file system of a folder, and a link at `path` by which this process opens it.
pub(crate) fn hidden_file(path: &Path, folder: &Path) -> io::Result<File> {
    let file = tempfile::tempfile_in(folder)?;
    std::os::unix::fs::symlink(format!("/dev/fd/{}", file.as_raw_fd()), path)?;
    Ok(file)
}

/// Makes a bus error end the process with a sentence about the file at `path`, which is about to be mapped.
///
/// Under `--json` it is an object on stdout as well, as every failure is. Costs nothing until then. If the handler
/// cannot be set, the system's default stays.
pub(crate) fn tell_of(path: &Path, as_json: bool) {
    let sentence = format!(
        "{}: was cut short while it was in use, or its disk failed, so that nothing was made of it; copy it again",
        shown(path)
    );
    let object = if as_json {
        text::json(&ErrorReport::new(&sentence, ExitKind::Input)) + "\n"
    } else {
        String::new()
    };
    let told: [(i32, Box<[u8]>); 2] = [
        (libc::STDOUT_FILENO, object.into_bytes().into()),
        (libc::STDERR_FILENO, format!("oct: {sentence}\n").into_bytes().into()),
    ];
    let begun = AtomicBool::new(false);
    let tell = move || {
        // Several threads read the file. One of them reports; the others fault again until the process ends.
        if !begun.swap(true, Ordering::Relaxed) {
            for (to, text) in &told {
                // SAFETY: `write` and `_exit` may be called in a signal handler; the bytes were written down before it
                // was set, live as long as it does, and have the length given. Nothing is allocated or locked.
                let _ = unsafe { libc::write(*to, text.as_ptr().cast(), text.len()) };
            }
            low_level::exit(ExitKind::Input.code().into());
        }
    };
    // The runtime has a handler for overflows of the stack, which raise another signal here. It would be called first,
    // and restore the default: the second thread would end the process before the first has reported.
    // SAFETY: the default is not a function, and the previous handler is not needed.
    let _ = unsafe { libc::signal(SIGBUS, libc::SIG_DFL) };
    // SAFETY: the action only makes calls that are allowed in a signal handler, see there.
    let _ = unsafe { low_level::register(SIGBUS, tell) };
}

/// True if the other end of the pipe was closed.
pub(crate) fn is_reader_gone(cause: &io::Error) -> bool {
    cause.kind() == io::ErrorKind::BrokenPipe
}

/// The program that opens an address, where there is a desktop.
pub(super) fn browser() -> Option<Command> {
    if cfg!(target_os = "macos") {
        return Some(Command::new("open"));
    }
    let has_desktop = ["DISPLAY", "WAYLAND_DISPLAY"].iter().any(|name| std::env::var_os(name).is_some());
    has_desktop.then(|| Command::new("xdg-open"))
}
