//! Memory that the operating system accounts to this process.

/// Peak resident set of this process in bytes, as the kernel accounts it (`VmHWM`); 0 where the
/// system does not tell.
pub fn peak_rss_bytes() -> u64 {
    proc_status_bytes("VmHWM:")
}

/// Present resident set of this process in bytes (`VmRSS`); 0 where the system does not tell.
pub fn current_rss_bytes() -> u64 {
    proc_status_bytes("VmRSS:")
}

/// The same at less cost, some 2 us: pages of `/proc/self/statm`, of 4 KiB; 0 where the system does not tell. Of other
/// pages this is too little, and a cap that is kept by it too large.
pub(crate) fn resident_bytes() -> u64 {
    let statm = std::fs::read_to_string("/proc/self/statm").unwrap_or_default();
    let pages = statm.split(' ').nth(1).and_then(|pages| pages.parse::<u64>().ok()).unwrap_or(0);
    pages.saturating_mul(4096)
}

/// Resident memory of this process that is no file's, in bytes; all of it where the system does not tell them
/// apart (old kernels, some sandboxes), and 0 where it does not tell that either.
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

/// Resident part of the mapping that starts where `mapped` does, in bytes; `None` where none does, or
/// where the system does not tell.
///
/// Cost: the kernel walks the pages of all mappings once.
pub(crate) fn mapped_rss_bytes(mapped: &[u8]) -> Option<u64> {
    let smaps = std::fs::read_to_string("/proc/self/smaps").ok()?;
    resident_of(&smaps, mapped.as_ptr().addr())
}

/// The `Rss` of the mapping that starts at `address`.
fn resident_of(smaps: &str, address: usize) -> Option<u64> {
    let start = format!("{address:08x}-");
    let mut lines = smaps.lines().skip_while(|line| !line.starts_with(&start));
    let rss = lines.find_map(|line| line.strip_prefix("Rss:"))?;
    rss.trim().strip_suffix("kB")?.trim().parse::<u64>().ok().map(|kib| kib * 1024)
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

    #[test]
    fn the_resident_part_of_one_mapping_is_found() {
        let smaps = "7f00aa000-7f00bb000 r--p 00000000 08:01 12 /a\nSize: 68 kB\nRss:          12 kB\n\
                     7f00bb000-7f00cc000 r--p 00000000 08:01 13 /b\nSize: 68 kB\nRss:          64 kB\n";
        assert_eq!(resident_of(smaps, 0x7_f00b_b000), Some(64 << 10));
        assert_eq!(resident_of(smaps, 0x7_f00a_a000), Some(12 << 10));
        assert_eq!(resident_of(smaps, 0x7_f00c_c000), None);
    }
}
