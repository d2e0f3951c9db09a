//! Memory that the operating system accounts to this process.
#![expect(unsafe_code, reason = "calls of the system")]

/// Buffers from this size on are taken to be the allocator's own mappings, which are returned at once.
pub(crate) const MAPPED_FROM: usize = 128 << 10;

/// Difference of [`own_rss_bytes`] between two runs of the same job: not measured; the largest of other systems.
pub(crate) const HELD_SPREAD: u64 = 768 << 10;

/// Bytes of a thread that the budget's own figures do not count: not measured; the largest of other systems.
pub(crate) const THREAD_BYTES: u64 = 1344 << 10;

fn usage() -> Option<libc::rusage_info_v4> {
    // SAFETY: a structure of integers may be zeros; it is the one that the flavour names, and lives through the call.
    unsafe {
        let mut usage: libc::rusage_info_v4 = std::mem::zeroed();
        let failed = libc::proc_pid_rusage(libc::getpid(), libc::RUSAGE_INFO_V4, (&raw mut usage).cast());
        (failed == 0).then_some(usage)
    }
}

/// Peak resident set of this process in bytes; 0 where the system does not tell.
pub fn peak_rss_bytes() -> u64 {
    // SAFETY: a structure of integers may be zeros; it lives through the call.
    let (failed, usage) = unsafe {
        let mut usage: libc::rusage = std::mem::zeroed();
        (libc::getrusage(libc::RUSAGE_SELF, &raw mut usage), usage)
    };
    // In bytes, where other systems count KiB.
    if failed == 0 { u64::try_from(usage.ru_maxrss).unwrap_or(0) } else { 0 }
}

/// Present resident set of this process in bytes; 0 where the system does not tell.
pub fn current_rss_bytes() -> u64 {
    usage().map_or(0, |usage| usage.ri_resident_size)
}

/// Present resident set of this process in bytes; 0 where the system does not tell.
pub(crate) fn resident_bytes() -> u64 {
    current_rss_bytes()
}

/// Resident memory of this process without pages of files, in bytes, as far as the system tells them apart.
pub(crate) fn own_rss_bytes() -> u64 {
    usage().map_or(0, |usage| usage.ri_phys_footprint.min(usage.ri_resident_size))
}

/// Resident pages of files in this process, its own code above all, in bytes.
pub(crate) fn file_rss_bytes() -> u64 {
    usage().map_or(0, |usage| usage.ri_resident_size.saturating_sub(usage.ri_phys_footprint))
}

/// `None`: not implemented on this system.
pub(crate) fn mapped_rss_bytes(_: &[u8]) -> Option<u64> {
    None
}

/// No-op.
pub fn map_large_buffers() {}

/// No-op: the system takes pages back by itself.
pub fn give_back() {}
