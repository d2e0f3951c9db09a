//! All that depends on the operating system: files read at places, files without a name, what a file is besides
//! its name, the memory of the process and of the machine.
//!
//! The rest of the library takes it from here, and a test holds that. So another system is one folder next to
//! `linux` with the same items.
//!
//! | file | what it holds |
//! |---|---|
//! | `files` | reading and writing at places, names as bytes, unnamed files, links, limits |
//! | `machine` | processor, memory, other processes |
//! | `memory` | the memory of this process, as the system accounts it |
//! | `resident` | resident memory given back |
//! | `torn` | mappings whose file is cut short while they are read, in Python |

#[cfg(not(any(target_os = "linux", windows)))]
compile_error!(
    "infobyte supports Linux and Windows: another system needs a folder in src/platform with the items of `linux`"
);

#[cfg(target_os = "linux")]
mod linux;
#[cfg(windows)]
mod windows;

#[cfg(target_os = "linux")]
pub use linux::*;
#[cfg(windows)]
pub use windows::*;
