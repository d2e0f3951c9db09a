//! Mappings whose file is truncated while they are read: pages of zeros in place of a bus error, which would end a
//! process of the caller's.
//!
//! A reader that checks afterwards whether the file has changed finds the truncation.
#![allow(unsafe_code)]

use std::ffi::c_void;
use std::sync::atomic::{AtomicPtr, AtomicUsize, Ordering};
use std::{mem, ptr};

use rustix::param::page_size;

/// Mappings that are watched at a time; others raise bus errors as before.
const MAX_WATCHED: usize = 4096;

/// First byte and end of each; 0 for an unused entry, a first byte of 1 for one that is being changed.
static RANGES: [[AtomicUsize; 2]; MAX_WATCHED] =
    [const { [AtomicUsize::new(0), AtomicUsize::new(0)] }; MAX_WATCHED];

/// Previous handler of bus errors.
static BEFORE: AtomicPtr<libc::sigaction> = AtomicPtr::new(ptr::null_mut());

/// A watched mapping; to be dropped before the mapping itself.
#[derive(Debug)]
pub(crate) struct Watched(usize);

impl Watched {
    /// Watches a mapping of a file; `None` if there are too many, or the system refuses.
    pub(crate) fn new(mapping: &[u8]) -> Option<Self> {
        install()?;
        let range = mapping.as_ptr_range();
        let free = |[first, _]: &[AtomicUsize; 2]| {
            first.compare_exchange(0, 1, Ordering::AcqRel, Ordering::Relaxed).is_ok()
        };
        let at = RANGES.iter().position(free)?;
        RANGES[at][1].store(range.end.addr(), Ordering::Release);
        RANGES[at][0].store(range.start.addr(), Ordering::Release);
        Some(Self(at))
    }
}

impl Drop for Watched {
    fn drop(&mut self) {
        RANGES[self.0][0].store(0, Ordering::Release);
    }
}

fn is_watched(address: usize) -> bool {
    RANGES.iter().any(|[first, end]| {
        let first = first.load(Ordering::Acquire);
        first > 1 && (first..end.load(Ordering::Acquire)).contains(&address)
    })
}

/// Installs [`on_bus_error`] as the first handler, as another one may have replaced it.
fn install() -> Option<()> {
    // SAFETY: an action of zeros is a valid value of that type in C; both pointers are to values that live through the
    // calls. The handler only makes calls that are allowed in one.
    unsafe {
        let mut now: libc::sigaction = mem::zeroed();
        if libc::sigaction(libc::SIGBUS, ptr::null(), &mut now) != 0 {
            return None;
        }
        let ours = on_bus_error as extern "C" fn(i32, *mut libc::siginfo_t, *mut c_void);
        if now.sa_sigaction == ours as libc::sighandler_t {
            return Some(());
        }
        // Never freed: a handler may be about to read it.
        BEFORE.store(Box::leak(Box::new(now)), Ordering::Release);
        let mut action: libc::sigaction = mem::zeroed();
        action.sa_sigaction = ours as libc::sighandler_t;
        action.sa_flags = libc::SA_SIGINFO | libc::SA_ONSTACK | libc::SA_NODEFER;
        (libc::sigaction(libc::SIGBUS, &action, ptr::null_mut()) == 0).then_some(())
    }
}

/// Maps a page of zeros where a watched mapping has lost its file; else calls the previous handler.
extern "C" fn on_bus_error(signal: i32, info: *mut libc::siginfo_t, _: *mut c_void) {
    // SAFETY: the system calls this with a valid `info`. `mmap`, `sigaction`, `raise` and `errno` may be used in a handler.
    // The page that is replaced belongs to a watched mapping, which is read-only and never taken for more than bytes of
    // any value; it is unmapped with it.
    unsafe {
        #[cfg(target_os = "linux")]
        let errno = libc::__errno_location();
        #[cfg(target_os = "macos")]
        let errno = libc::__error();
        let saved = *errno;
        let (address, is_fault) = ((*info).si_addr().addr(), (*info).si_code > 0);
        if is_fault && is_watched(address) {
            let page = ptr::without_provenance_mut(address & !(page_size() - 1));
            let how = libc::MAP_PRIVATE | libc::MAP_ANON | libc::MAP_FIXED;
            let mapped = libc::mmap(page, page_size(), libc::PROT_READ, how, -1, 0);
            if mapped != libc::MAP_FAILED {
                *errno = saved;
                return;
            }
        }
        let before = BEFORE.load(Ordering::Acquire);
        libc::sigaction(signal, before, ptr::null_mut());
        // A fault is raised again by itself when this returns.
        if !is_fault {
            libc::raise(signal);
        }
        *errno = saved;
    }
}
