//! All of the command that depends on the operating system: signals, files without a name, the browser.

#[cfg(unix)]
mod unix;
#[cfg(windows)]
mod windows;

#[cfg(unix)]
pub(crate) use unix::*;
#[cfg(windows)]
pub(crate) use windows::*;

/// Shows an address in the user's browser, where there is a desktop; whether that works is not waited for.
pub(crate) fn open_browser(address: &str) {
    let quiet = std::process::Stdio::null;
    if let Some(mut browser) = browser() {
        let _ = browser.arg(address).stdin(quiet()).stdout(quiet()).stderr(quiet()).spawn();
    }
}
