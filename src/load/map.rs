//! Read-only mapping of a finished file: the only `unsafe` of the loader.
#![allow(unsafe_code)]

use std::fs::File;
use std::io;

/// A whole file mapped read-only; dereferences to its bytes through `AsRef`.
#[derive(Debug)]
pub struct Mapping(memmap2::Mmap);

impl Mapping {
    /// Maps `file`, which must not be empty.
    ///
    /// # Errors
    /// The operating system refused.
    pub fn of(file: &File) -> io::Result<Self> {
        // SAFETY: the bytes must not change while they are mapped. This program keeps that promise by
        // never writing to a finished `.oct`: every output is a new file that replaces the old name by
        // rename, so a mapped file keeps its own unchanged bytes. Other programs are asked by the
        // specification (SPEC 7) to do the same; if one does not, no reference with an invariant
        // beyond "any byte" is ever made from the mapping, and a file cut short ends the process with
        // a bus error, as every mapping of a file does.
        let map = unsafe { memmap2::Mmap::map(file)? };
        Ok(Self(map))
    }
}

impl AsRef<[u8]> for Mapping {
    #[inline]
    fn as_ref(&self) -> &[u8] {
        &self.0
    }
}
