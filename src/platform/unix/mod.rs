//! Items that Linux and macOS share.

mod files;
mod torn;

pub(crate) use files::*;
pub(crate) use torn::Watched;

/// Takes all pages of a mapping out of the process; pages that are read again come back from the system's cache. If the
/// system refuses, the pages stay.
#[expect(unsafe_code, reason = "advice on a mapping of a file")]
pub(crate) fn give_back_pages(map: &memmap2::Mmap) {
    // SAFETY: pages of a file that are mapped read-only come back with the file's bytes, so that no byte behind a
    // reference changes.
    let _ = unsafe { map.unchecked_advise(memmap2::UncheckedAdvice::DontNeed) };
}
