//! Everything that depends on the operating system: positional reads of files, files without a name, a file's identity,
//! the memory of the process and of the machine.
//!
//! The rest of the library takes it from here, which a test checks. So another system is one folder next to `linux`
//! with the same items. `unix` holds items of Linux and macOS, `portable` items of Windows and macOS.
//!
//! A file that is read or written by position is not used by its cursor as well: on Windows the system moves that, too.
//! All readers take a [`PositionalFile`], which has no cursor; sequential reads and writes take a [`Placed`] file,
//! which has a position of its own. (A file that was only written sequentially may be read by position afterwards.)
//!
//! | file | content |
//! |---|---|
//! | `files` | reading and writing at places, names as bytes, unnamed files, links, limits |
//! | `machine` | processor, memory, other processes |
//! | `memory` | the memory of this process, as the system accounts it |
//! | `resident` | resident memory given back |
//! | `torn` | mappings whose file is cut short while they are read, in Python |

#[cfg(not(any(target_os = "linux", target_os = "macos", windows)))]
compile_error!(
    "infobyte supports Linux, Windows and macOS: another system needs a folder in src/platform with the items of `linux`"
);

#[cfg(target_os = "linux")]
mod linux;
#[cfg(target_os = "macos")]
mod macos;
#[cfg(not(target_os = "linux"))]
mod portable;
#[cfg(unix)]
mod unix;
#[cfg(windows)]
mod windows;

#[cfg(target_os = "linux")]
pub use linux::*;
#[cfg(target_os = "macos")]
pub use macos::*;
#[cfg(windows)]
pub use windows::*;

use std::fs::{File, Metadata};
use std::io::{self, IoSliceMut};
use std::path::Path;

/// True for a name that stands for a device on Windows, in every folder and with every suffix: no file gets such a name
/// on any system.
pub(crate) fn is_device_name(name: &str) -> bool {
    let stem = name.split('.').next().unwrap_or_default().trim_end().to_ascii_uppercase();
    let port = ["COM", "LPT"].iter().find_map(|kind| stem.strip_prefix(kind));
    matches!(&*stem, "CON" | "PRN" | "AUX" | "NUL" | "CONIN$" | "CONOUT$")
        || port.is_some_and(|number| {
            matches!(number, "¹" | "²" | "³") || matches!(number.as_bytes(), [b'0'..=b'9'])
        })
}

/// A file that is read and written by position only, without a cursor.
#[derive(Debug)]
pub(crate) struct PositionalFile(File);

impl From<File> for PositionalFile {
    fn from(file: File) -> Self {
        Self(file)
    }
}

impl PositionalFile {
    /// Opens a regular file; a folder, a pipe and a device are refused.
    ///
    /// # Errors
    /// The file is not regular ([`is_not_regular`]), or the system refused.
    pub(crate) fn open(path: &Path) -> io::Result<Self> {
        open_file(path).map(Self)
    }

    /// Its length, times and kind.
    pub(crate) fn metadata(&self) -> io::Result<Metadata> {
        self.0.metadata()
    }

    /// Its bytes from a position on, for sequential reads.
    pub(crate) fn onwards(&self, at: u64) -> Placed<'_> {
        Placed::new(&self.0, at)
    }

    /// The system's file, to be mapped.
    pub(crate) fn whole(&self) -> &File {
        &self.0
    }

    pub(crate) fn read_at(&self, bytes: &mut [u8], offset: u64) -> io::Result<usize> {
        self.0.read_at(bytes, offset)
    }

    pub(crate) fn read_exact_at(&self, bytes: &mut [u8], offset: u64) -> io::Result<()> {
        self.0.read_exact_at(bytes, offset)
    }

    pub(crate) fn write_all_at(&self, bytes: &[u8], offset: u64) -> io::Result<()> {
        self.0.write_all_at(bytes, offset)
    }

    /// A second handle of the file.
    pub(crate) fn try_clone(&self) -> io::Result<Self> {
        self.0.try_clone().map(Self)
    }

    /// Reads into several buffers from one place on; returns how much was read.
    pub(crate) fn read_parts(&self, parts: &mut [IoSliceMut<'_>], offset: u64) -> io::Result<usize> {
        read_parts(&self.0, parts, offset)
    }
}

/// A file that is read or written sequentially from a position on, whatever its cursor is.
#[derive(Debug)]
pub(crate) struct Placed<'a> {
    file: &'a File,
    at: u64,
}

impl<'a> Placed<'a> {
    /// A file whose next byte is at `at`.
    pub(crate) fn new(file: &'a File, at: u64) -> Self {
        Self { file, at }
    }
}

impl io::Read for Placed<'_> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let read = self.file.read_at(bytes, self.at)?;
        self.at += read as u64;
        Ok(read)
    }
}

impl io::Write for Placed<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write_all_at(bytes, self.at)?;
        self.at += bytes.len() as u64;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::io::{Read as _, Write as _};

    use super::*;

    #[test]
    fn a_placed_file_goes_on_where_it_was_whatever_is_read_between() {
        let file = tempfile::tempfile().unwrap();
        let mut out = Placed::new(&file, 3);
        for part in [b"ab", b"cd"] {
            out.write_all(part).unwrap();
            file.read_exact_at(&mut [0; 2], 0).unwrap();
        }
        let mut read = Placed::new(&file, 3);
        let mut got = [0; 2];
        read.read_exact(&mut got).unwrap();
        file.read_exact_at(&mut [0; 1], 0).unwrap();
        let mut rest = Vec::new();
        read.read_to_end(&mut rest).unwrap();
        assert_eq!((&got, &*rest), (b"ab", &b"cd"[..]));
    }

    #[test]
    fn names_of_devices_are_known_in_every_spelling() {
        for name in ["con", "NUL.oct", "Com1", "lpt9.a.b", "aux .txt", "COM\u{b9}"] {
            assert!(is_device_name(name), "{name}");
        }
        for name in ["", "console", "com", "com10", "a.con", "_nul", "lptx"] {
            assert!(!is_device_name(name), "{name}");
        }
    }
}
