//! The machine, and its other processes.

use std::fs;
use std::path::Path;

pub(crate) fn processor() -> Option<String> {
    value("/proc/cpuinfo", "model name")
}

/// Memory of the machine in MiB.
pub(crate) fn memory_mib() -> Option<u64> {
    let memory = value("/proc/meminfo", "MemTotal:")?;
    memory.split(' ').next()?.parse::<u64>().ok().map(|kib| kib / 1024)
}

pub(crate) fn system_release() -> String {
    read("/proc/sys/kernel/osrelease")
}

/// True if the process with this number has ended; false where the system does not tell.
pub(crate) fn has_ended(process: &str) -> bool {
    Path::new("/proc/self").exists() && !Path::new("/proc").join(process).exists()
}

fn value(path: &str, key: &str) -> Option<String> {
    let text = read(path);
    let line = text.lines().find_map(|line| line.strip_prefix(key))?;
    Some(line.trim_start_matches([' ', '\t', ':']).trim().to_owned())
}

fn read(path: &str) -> String {
    fs::read_to_string(path).unwrap_or_default()
}
