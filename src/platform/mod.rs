//! All that depends on the operating system: files read at places, files without a name, what a file is besides
//! its name, the memory of the process and of the machine.
//!
//! The rest of the library takes it from here, and a test holds that. So another system is one folder next to
//! `linux` with the same items.
//!
//! A file that is read or written at places has no other use meanwhile: on Windows the system moves its cursor, too. Its
//! head may be read by the cursor before, and a file that was written onwards may be read at places afterwards; who writes
//! onwards between such reads takes a [`PlacedWriter`].
//!
//! | file | what it holds |
//! |---|---|
//! | `files` | reading and writing at places, names as bytes, unnamed files, links, limits |
//! | `machine` | processor, memory, other processes |
//! | `memory` | the memory of this process, as the system accounts it |
//! | `resident` | resident memory given back |
//! | `torn` | mappings whose file is cut short while they are read, in Python |

#[cfg(not(any(target_os = "linux", windows)))]
compile_error!(
    "infobyte supports Linux and Windows: another system needs a folder in src/platform with the items of `linux`"
);

#[cfg(target_os = "linux")]
mod linux;
#[cfg(windows)]
mod windows;

#[cfg(target_os = "linux")]
pub use linux::*;
#[cfg(windows)]
pub use windows::*;

use std::fs::File;
use std::io;

/// True for a name that stands for a device on Windows, in every folder and with every suffix: no file is given it on any
/// system.
pub(crate) fn is_device_name(name: &str) -> bool {
    let stem = name.split('.').next().unwrap_or_default().trim_end().to_ascii_uppercase();
    let port = ["COM", "LPT"].iter().find_map(|kind| stem.strip_prefix(kind));
    matches!(&*stem, "CON" | "PRN" | "AUX" | "NUL" | "CONIN$" | "CONOUT$")
        || port.is_some_and(|number| {
            matches!(number, "¹" | "²" | "³") || matches!(number.as_bytes(), [b'0'..=b'9'])
        })
}

/// A writer from one place of a file on, whatever its cursor is.
#[derive(Debug)]
pub(crate) struct PlacedWriter<'a> {
    file: &'a File,
    at: u64,
}

impl<'a> PlacedWriter<'a> {
    /// A writer whose first byte goes to `at`.
    pub(crate) fn new(file: &'a File, at: u64) -> Self {
        Self { file, at }
    }
}

impl io::Write for PlacedWriter<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write_all_at(bytes, self.at)?;
        self.at += bytes.len() as u64;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
