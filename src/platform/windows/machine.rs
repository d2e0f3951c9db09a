//! The machine, and its other processes.
#![expect(unsafe_code, reason = "calls of the system")]

use windows_sys::Win32::Foundation::{CloseHandle, ERROR_INVALID_PARAMETER, GetLastError, WAIT_OBJECT_0};
use windows_sys::Win32::System::SystemInformation::{GlobalMemoryStatusEx, MEMORYSTATUSEX};
use windows_sys::Win32::System::Threading::{OpenProcess, PROCESS_SYNCHRONIZE, WaitForSingleObject};

pub(crate) fn processor() -> Option<String> {
    std::env::var("PROCESSOR_IDENTIFIER").ok()
}

/// Memory of the machine in MiB.
pub(crate) fn memory_mib() -> Option<u64> {
    // SAFETY: a structure of integers may be zeros; it holds its own length, and lives through the call.
    let (done, status) = unsafe {
        let mut status: MEMORYSTATUSEX = std::mem::zeroed();
        status.dwLength = u32::try_from(size_of::<MEMORYSTATUSEX>()).unwrap_or(0);
        (GlobalMemoryStatusEx(&raw mut status), status)
    };
    (done != 0).then_some(status.ullTotalPhys >> 20)
}

pub(crate) fn system_release() -> String {
    "Windows".into()
}

/// True if the process with this number has ended; false where the system does not tell.
pub(crate) fn has_ended(process: &str) -> bool {
    let Ok(number) = process.parse() else { return false };
    // SAFETY: the handle is closed once, and not used afterwards.
    unsafe {
        let process = OpenProcess(PROCESS_SYNCHRONIZE, 0, number);
        if process.is_null() {
            // There is no process of this number.
            return GetLastError() == ERROR_INVALID_PARAMETER;
        }
        let ended = WaitForSingleObject(process, 0) == WAIT_OBJECT_0;
        CloseHandle(process);
        ended
    }
}
