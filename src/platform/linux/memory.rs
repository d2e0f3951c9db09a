//! Memory that the operating system accounts to this process.

use std::fs::File;
use std::sync::OnceLock;

use super::FileExt;

/// Peak resident set of this process in bytes, as the kernel accounts it (`VmHWM`); 0 where the
/// system does not tell.
pub fn peak_rss_bytes() -> u64 {
    proc_status_bytes("VmHWM:")
}

/// Present resident set of this process in bytes (`VmRSS`); 0 where the system does not tell.
pub fn current_rss_bytes() -> u64 {
    proc_status_bytes("VmRSS:")
}

/// As [`current_rss_bytes`] at less cost, some 1 us: pages of `/proc/self/statm`, which stays open, taken as 4 KiB; 0
/// where the system does not tell. For larger pages it is too low, and a cap that is kept by it is exceeded.
pub(crate) fn resident_bytes() -> u64 {
    static STATM: OnceLock<Option<File>> = OnceLock::new();
    let statm = STATM.get_or_init(|| File::open("/proc/self/statm").ok());
    let mut text = [0; 64];
    let length = statm.as_ref().and_then(|statm| statm.read_at(&mut text, 0).ok()).unwrap_or(0);
    let text = std::str::from_utf8(text.get(..length).unwrap_or_default()).unwrap_or_default();
    let pages = text.split(' ').nth(1).and_then(|pages| pages.parse::<u64>().ok()).unwrap_or(0);
    pages.saturating_mul(4096)
}

/// Resident memory of this process without pages of files, in bytes; all of it where the system does not tell them
/// apart (old kernels, some sandboxes), and 0 where it tells neither.
pub(crate) fn own_rss_bytes() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    own_rss_of(&status)
}

fn own_rss_of(status: &str) -> u64 {
    let own = |key| status_bytes(status, key);
    own("RssAnon:")
        .map_or_else(|| own("VmRSS:"), |anon| Some(anon + own("RssShmem:").unwrap_or(0)))
        .unwrap_or(0)
}

/// Resident pages of files in this process (`RssFile`), its own code above all, in bytes; 0 where the system
/// does not tell.
pub(crate) fn file_rss_bytes() -> u64 {
    proc_status_bytes("RssFile:")
}

/// Resident bytes of the pages of a mapping; `None` where the system does not tell.
///
/// Cost: some 10 ns for a page of 4 KiB.
pub(crate) fn mapped_rss_bytes(mapped: &[u8]) -> Option<u64> {
    const PAGE: u64 = 4096;
    let pages = std::fs::File::open("/proc/self/pagemap").ok()?;
    let start = mapped.as_ptr().addr() as u64;
    let (mut at, end) = (start / PAGE, (start + mapped.len() as u64).div_ceil(PAGE));
    let (mut entries, mut resident) = ([0_u64; 512], 0);
    while at < end {
        let count = usize::try_from(end - at).map_or(entries.len(), |left| left.min(entries.len()));
        pages.read_exact_at(bytemuck::cast_slice_mut(&mut entries[..count]), at * 8).ok()?;
        // The highest bit is set for a resident page.
        resident += entries[..count].iter().map(|entry| entry >> 63).sum::<u64>();
        at += count as u64;
    }
    Some(resident * PAGE)
}

fn proc_status_bytes(key: &str) -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    status_bytes(&status, key).unwrap_or(0)
}

fn status_bytes(status: &str, key: &str) -> Option<u64> {
    let rest = status.lines().find_map(|line| line.strip_prefix(key))?;
    rest.trim().trim_end_matches("kB").trim().parse::<u64>().ok().map(|kib| kib * 1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn own_memory_is_counted_where_files_are_not_told_apart() {
        assert_eq!(
            own_rss_of("VmRSS:\t 9 kB\nRssAnon:\t 4 kB\nRssFile:\t 3 kB\nRssShmem:\t 2 kB\n"),
            6 << 10
        );
        assert_eq!(own_rss_of("VmRSS:\t 9 kB\n"), 9 << 10);
        assert_eq!(own_rss_of(""), 0);
    }
}
