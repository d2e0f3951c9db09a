//! Stand-ins for files without a name and for reads into several buffers, on systems that have neither.

use std::fs::File;
use std::io::{self, IoSliceMut};
use std::path::Path;

use super::FileExt as _;

/// Always refuses: no file is without a name ([`io::ErrorKind::Unsupported`]).
///
/// # Errors
/// Always.
pub(crate) fn unnamed_file(_: &Path) -> io::Result<File> {
    Err(io::ErrorKind::Unsupported.into())
}

/// Always refuses: no file is without a name ([`io::ErrorKind::Unsupported`]).
///
/// # Errors
/// Always.
pub(crate) fn give_name(_: &File, _: &Path) -> io::Result<()> {
    Err(io::ErrorKind::Unsupported.into())
}

/// Reads into several buffers from one place on; returns how much was read.
///
/// # Errors
/// The system refused.
pub(crate) fn read_parts(file: &File, parts: &mut [IoSliceMut<'_>], offset: u64) -> io::Result<usize> {
    let mut all = 0;
    for part in parts {
        let read = file.read_at(part, offset + all as u64)?;
        all += read;
        if read < part.len() {
            break;
        }
    }
    Ok(all)
}

/// No-op: pages are mapped one by one.
pub(crate) fn part_mapping(_: &memmap2::Mmap) {}
