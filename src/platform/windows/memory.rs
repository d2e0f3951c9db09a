//! Memory that the operating system accounts to this process: its working set.
#![expect(unsafe_code, reason = "calls of the system")]

use std::sync::OnceLock;

use windows_sys::Win32::System::Memory::VirtualUnlock;
use windows_sys::Win32::System::ProcessStatus::{K32GetProcessMemoryInfo, PROCESS_MEMORY_COUNTERS};
use windows_sys::Win32::System::Threading::{GetCurrentProcess, SetProcessWorkingSetSize};

/// Buffers from this size on are the system's own allocations, which are returned at once.
pub(crate) const MAPPED_FROM: usize = 128 << 10;

/// Difference of [`own_rss_bytes`] between two runs of the same job: largest less smallest at the same place, under
/// Wine 8. Added to the stated smallest cap, so that it suffices.
pub(crate) const HELD_SPREAD: u64 = 768 << 10;

/// Bytes of a thread that the budget's own figures do not count: the system's share, and freed buffers that the heap
/// keeps. Without them 9 of 20 builds with two threads at their smallest cap exceeded it under Wine 8, by up to 0.7
/// MiB.
pub(crate) const THREAD_BYTES: u64 = 1344 << 10;

fn counters() -> Option<PROCESS_MEMORY_COUNTERS> {
    let bytes = u32::try_from(size_of::<PROCESS_MEMORY_COUNTERS>()).ok()?;
    // SAFETY: a structure of integers may be zeros; its length is given, and it lives through the call.
    let (done, counters) = unsafe {
        let mut counters: PROCESS_MEMORY_COUNTERS = std::mem::zeroed();
        (K32GetProcessMemoryInfo(GetCurrentProcess(), &raw mut counters, bytes), counters)
    };
    (done != 0).then_some(counters)
}

/// Peak working set of this process in bytes; 0 where the system does not tell.
pub fn peak_rss_bytes() -> u64 {
    counters().map_or(0, |counters| counters.PeakWorkingSetSize as u64)
}

/// Present working set of this process in bytes; 0 where the system does not tell.
pub fn current_rss_bytes() -> u64 {
    counters().map_or(0, |counters| counters.WorkingSetSize as u64)
}

/// Present working set of this process in bytes; 0 where the system does not tell.
pub(crate) fn resident_bytes() -> u64 {
    current_rss_bytes()
}

/// Bytes of the process at its start: its own, and pages of files (the system's libraries, and the code that starts
/// it).
static BASE: OnceLock<(u64, u64)> = OnceLock::new();

/// Growth of a process that runs a job, before the job holds anything: its own bytes (threads, and the heap's
/// reserves), and pages of files (more of the libraries). Counted from the start, so that a stated cap suffices: chosen
/// from eight commands under Wine 8, for all of which it does.
const GROWTH: (u64, u64) = (7 << 18, 10 << 18);

/// Present resident bytes: the process's own, and pages of files.
fn own_and_file() -> (u64, u64) {
    let (own, all) = counters().map_or((0, 0), |now| (now.PagefileUsage as u64, now.WorkingSetSize as u64));
    (own.min(all), all.saturating_sub(own))
}

/// Bytes that the process has allocated, and its [`BASE`] with the [`GROWTH`].
pub(crate) fn own_rss_bytes() -> u64 {
    let (own, _) = own_and_file();
    let (first, file) = *BASE.get_or_init(own_and_file);
    own.max(first + GROWTH.0) + file + GROWTH.1
}

/// Pages of files beyond the [`BASE`] and the [`GROWTH`].
pub(crate) fn file_rss_bytes() -> u64 {
    own_and_file().1.saturating_sub(BASE.get_or_init(own_and_file).1 + GROWTH.1)
}

/// `None`: the system does not tell.
pub(crate) fn mapped_rss_bytes(_: &[u8]) -> Option<u64> {
    None
}

/// Sets nothing: the system's heap returns large buffers by itself. Called first of all, it measures the base.
pub fn map_large_buffers() {
    let _ = own_rss_bytes();
}

/// Empties the working set; pages that are touched again come back from the system's cache.
///
/// Cost: some hundred page faults later.
pub fn give_back() {
    // SAFETY: the handle is the process's own pseudo handle; both sizes at their maximum ask for this.
    let _ = unsafe { SetProcessWorkingSetSize(GetCurrentProcess(), usize::MAX, usize::MAX) };
}

/// Takes all pages of a mapping out of the working set. If the system refuses, the pages stay.
pub(crate) fn give_back_pages(map: &memmap2::Mmap) {
    // SAFETY: the range is mapped. Unlocking pages that are not locked takes them out of the working set, and fails.
    let _ = unsafe { VirtualUnlock(map.as_ptr().cast(), map.len()) };
}

/// A mapping whose file cannot be truncated: the system refuses that while it is mapped.
#[derive(Debug)]
pub(crate) struct Watched;

impl Watched {
    /// No-op.
    #[allow(clippy::unnecessary_wraps, reason = "the same face on every system")]
    pub(crate) fn new(_: &[u8]) -> Option<Self> {
        Some(Self)
    }
}
