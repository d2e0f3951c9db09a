//! The fuzzer's program: libFuzzer changes inputs, keeps those that reach new code, and runs one target on each.
//!
//! `INFOBYTE_FUZZ_TARGET` names the target. `scripts/fuzz.py` builds this with the compiler's counters of coverage,
//! runs it, and looks after what it finds.
#![no_main]

// Not all of it: the fuzzer is built without the command.
#[allow(dead_code, reason = "each program uses its own part")]
#[path = "../it/common"]
mod common {
    pub(crate) mod dicom;
    pub(crate) mod frames;
    pub(crate) mod models;
}
mod live;
mod second;
mod targets;

use std::sync::LazyLock;

static CHOSEN: LazyLock<targets::Target> = LazyLock::new(|| {
    let name = std::env::var("INFOBYTE_FUZZ_TARGET").unwrap_or_default();
    targets::TARGETS.into_iter().find(|target| target.name == name).unwrap_or_else(|| {
        let known = targets::TARGETS.map(|target| target.name).join(", ");
        panic!("INFOBYTE_FUZZ_TARGET is '{name}'; one of {known} is wanted")
    })
});

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let (_, bytes) = live::peak(|| CHOSEN.run(bytes));
    assert!(bytes <= targets::MAX_BYTES, "{bytes} bytes of memory");
});
