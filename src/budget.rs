//! Sizes in bytes as people write them, and what the operating system accounts to this process.

use std::fmt;

/// Parses `8MiB`, `64M`, `1GiB`, `4096`; K, M and G are binary with or without `iB`/`B`.
///
/// # Errors
/// A sentence that says what is accepted.
pub fn parse_size(text: &str) -> Result<u64, String> {
    let trimmed = text.trim();
    let split = trimmed.find(|c: char| !c.is_ascii_digit() && c != '.').unwrap_or(trimmed.len());
    let (number, unit) = trimmed.split_at(split);
    let shift = match unit.trim().to_ascii_lowercase().as_str() {
        "" | "b" => 0,
        "k" | "kb" | "kib" => 10,
        "m" | "mb" | "mib" => 20,
        "g" | "gb" | "gib" => 30,
        "t" | "tb" | "tib" => 40,
        _ => return Err(format!("'{text}' is not a size; write for example 8MiB, 64M or 1GiB")),
    };
    let value: f64 =
        number.parse().map_err(|_| format!("'{text}' is not a size; write for example 8MiB, 64M or 1GiB"))?;
    let bytes = value * f64::from(1_u32 << 10).powi(shift / 10);
    if !(1.0..1e18).contains(&bytes) {
        return Err(format!("'{text}' is out of range for a size"));
    }
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked to lie in 1..1e18")]
    Ok(bytes as u64)
}

/// A byte count for people: `8.0 MiB`.
#[derive(Clone, Copy, Debug)]
pub struct Bytes(
    /// The count.
    pub u64,
);

impl fmt::Display for Bytes {
    #[expect(clippy::cast_precision_loss, reason = "two digits are shown")]
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut value = self.0 as f64;
        let mut unit = "B";
        for next in ["KiB", "MiB", "GiB", "TiB"] {
            if value < 1024.0 {
                break;
            }
            value /= 1024.0;
            unit = next;
        }
        if unit == "B" { write!(f, "{} B", self.0) } else { write!(f, "{value:.2} {unit}") }
    }
}

/// A byte count as [`parse_size`] reads it back, never less: `6784KiB`, `8MiB`.
#[derive(Clone, Copy, Debug)]
pub struct SizeArgument(
    /// The count.
    pub u64,
);

impl fmt::Display for SizeArgument {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0.div_ceil(1 << 10) {
            kib if kib.is_multiple_of(1 << 20) => write!(f, "{}GiB", kib >> 20),
            kib if kib.is_multiple_of(1 << 10) => write!(f, "{}MiB", kib >> 10),
            kib => write!(f, "{kib}KiB"),
        }
    }
}

/// Code and constants of the program, and of the libraries it uses, that one stage of a job has resident at
/// most, if the stages before it gave theirs back; larger where they are not optimised. Measured over every
/// reader, cleaning and range, with room for where the system happens to place them.
pub const CODE_BYTES: u64 = if cfg!(debug_assertions) { 6 << 20 } else { 4 << 20 };
/// By how much [`MemoryCap::held`] may differ between two runs of the same job; added where the smallest cap
/// is stated, so that it does work.
pub const HELD_SPREAD: u64 = 192 << 10;

/// What bounds the memory of a job.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MemoryCap {
    /// The resident memory of the whole process; the job is all that it does.
    Process(u64),
    /// What the job may add to a process that does other things too.
    Share(u64),
}

impl MemoryCap {
    /// The bound itself.
    pub fn bytes(self) -> u64 {
        match self {
            Self::Process(bytes) | Self::Share(bytes) => bytes,
        }
    }

    /// Bytes that count against the bound beside what the job allocates from now on: in a process, all that
    /// is allocated now, and code. What code is resident at the moment says little, as more is mapped while a
    /// job runs, and differs with every start; so the most that it comes to is counted.
    pub fn held(self) -> u64 {
        match self {
            Self::Process(_) => own_rss_bytes() + file_rss_bytes().max(CODE_BYTES),
            Self::Share(_) => 0,
        }
    }

    /// Bytes that the job may still allocate.
    pub fn left(self) -> u64 {
        self.bytes().saturating_sub(self.held())
    }
}

/// Peak resident set of this process in bytes, as the kernel accounts it (`VmHWM`); 0 where the
/// system does not tell.
pub fn peak_rss_bytes() -> u64 {
    proc_status_bytes("VmHWM:")
}

/// Present resident set of this process in bytes (`VmRSS`); 0 where the system does not tell.
pub fn current_rss_bytes() -> u64 {
    proc_status_bytes("VmRSS:")
}

/// Resident memory of this process that is no file's, in bytes; all of it where the system does not tell them
/// apart (old kernels, some sandboxes), and 0 where it does not tell that either.
pub fn own_rss_bytes() -> u64 {
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
pub fn file_rss_bytes() -> u64 {
    proc_status_bytes("RssFile:")
}

/// Resident part of the mapping that starts where `mapped` does, in bytes; `None` where none does, or
/// where the system does not tell.
///
/// Cost: the kernel walks the pages of all mappings once.
pub fn mapped_rss_bytes(mapped: &[u8]) -> Option<u64> {
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
    fn sizes_parse_in_binary_units() {
        assert_eq!(parse_size("8MiB"), Ok(8 << 20));
        assert_eq!(parse_size("64M"), Ok(64 << 20));
        assert_eq!(parse_size("1GiB"), Ok(1 << 30));
        assert_eq!(parse_size("1.5k"), Ok(1536));
        assert_eq!(parse_size("4096"), Ok(4096));
        for bad in ["", "MiB", "8 parsecs", "-1", "0", "1e400", "nan"] {
            assert!(parse_size(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn sizes_for_the_command_line_are_read_back_and_never_less() {
        for (bytes, text) in [(8 << 20, "8MiB"), (1 << 30, "1GiB"), (6_946_817, "6785KiB"), (1, "1KiB")] {
            assert_eq!(SizeArgument(bytes).to_string(), text);
            assert!(parse_size(text).unwrap() >= bytes);
        }
    }

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
