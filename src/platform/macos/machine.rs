//! The machine, and its other processes.
#![expect(unsafe_code, reason = "calls of the system")]

use std::ffi::CStr;

use rustix::process::{Pid, test_kill_process};

pub(crate) fn processor() -> Option<String> {
    text(c"machdep.cpu.brand_string")
}

/// Memory of the machine in MiB.
pub(crate) fn memory_mib() -> Option<u64> {
    let mut bytes = [0; 8];
    (read(c"hw.memsize", &mut bytes)? == bytes.len()).then(|| u64::from_ne_bytes(bytes) >> 20)
}

pub(crate) fn system_release() -> String {
    text(c"kern.osrelease").unwrap_or_default()
}

/// True if no process has this number.
pub(crate) fn has_ended(process: &str) -> bool {
    let number = process.parse().ok().and_then(Pid::from_raw);
    number.is_some_and(|number| test_kill_process(number) == Err(rustix::io::Errno::SRCH))
}

fn text(key: &CStr) -> Option<String> {
    let mut bytes = [0; 256];
    let length = read(key, &mut bytes)?;
    CStr::from_bytes_until_nul(bytes.get(..length)?).ok()?.to_str().ok().map(str::to_owned)
}

/// Reads a value of the system; returns its length in bytes.
fn read(key: &CStr, bytes: &mut [u8]) -> Option<usize> {
    let mut length = bytes.len();
    // SAFETY: the name ends with a zero, the buffer has the length given, and nothing is set.
    let failed = unsafe {
        libc::sysctlbyname(key.as_ptr(), bytes.as_mut_ptr().cast(), &raw mut length, std::ptr::null_mut(), 0)
    };
    (failed == 0).then_some(length)
}
