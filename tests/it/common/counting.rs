//! What a piece of work takes from the allocator. Counted per thread, as tests run on threads of their own.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

/// Counts what the current thread allocates.
pub(crate) struct Counting;

thread_local! {
    /// Bytes ever allocated, bytes live now, and the most that were.
    static ALLOCATED: Cell<usize> = const { Cell::new(0) };
    static LIVE: Cell<isize> = const { Cell::new(0) };
    static PEAK: Cell<isize> = const { Cell::new(0) };
}

// SAFETY: every call is passed on to the system allocator unchanged; the counters are thread-local
// and need no allocation themselves.
#[expect(unsafe_code, reason = "a counting allocator cannot be written without; tests only")]
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let _ = ALLOCATED.try_with(|n| n.set(n.get() + layout.size()));
        let _ = LIVE.try_with(|n| {
            n.set(n.get() + layout.size().cast_signed());
            let _ = PEAK.try_with(|peak| peak.set(peak.get().max(n.get())));
        });
        // SAFETY: the caller's promise is passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, ptr: *mut u8, layout: Layout) {
        let _ = LIVE.try_with(|n| n.set(n.get() - layout.size().cast_signed()));
        // SAFETY: the caller's promise is passed on.
        unsafe { System.dealloc(ptr, layout) }
    }
}

/// Bytes that a piece of work took.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Taken {
    /// All that it ever allocated, given back or not.
    pub(crate) allocated: usize,
    /// What is live after it beyond what was before: what its result holds. Negative if it freed more.
    pub(crate) held: isize,
    /// The most that were live at a time beyond what was before.
    pub(crate) peak: usize,
}

/// Runs something and tells what it took; not to be nested.
pub(crate) fn measured<T>(run: impl FnOnce() -> T) -> (T, Taken) {
    let (allocated, live) = (ALLOCATED.get(), LIVE.get());
    PEAK.set(live);
    let result = run();
    let peak = usize::try_from(PEAK.get() - live).unwrap();
    (result, Taken { allocated: ALLOCATED.get() - allocated, held: LIVE.get() - live, peak })
}
