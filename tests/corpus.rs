//! What the fuzzer found worth keeping is taken again by every test run: each case of `fixtures/fuzz` is opened or
//! refused, without a panic, in time and within its memory. If this fails, a mistake that was mended is back, or a
//! reader has a new one.
//!
//! `scripts/fuzz.py` makes those files; `INFOBYTE_FUZZ_SEEDS` names a folder to write the first inputs of every
//! target to.

#[allow(dead_code, reason = "each program uses its own part")]
#[path = "it/common/mod.rs"]
mod common;
#[path = "fuzz/live.rs"]
mod live;
#[path = "fuzz/second.rs"]
mod second;
#[path = "fuzz/seeds.rs"]
mod seeds;
#[path = "fuzz/targets.rs"]
mod targets;

use std::fs;
use std::path::Path;
use std::time::{Duration, Instant};

use targets::{MAX_BYTES, TARGETS, Target};

const SLOWEST: Duration = Duration::from_secs(5);

/// The cases of a target: each has its length as four bytes, the lowest first, before it.
fn cases(bytes: &[u8]) -> Vec<&[u8]> {
    let (mut found, mut rest) = (Vec::new(), bytes);
    while let Some((length, behind)) = rest.split_first_chunk::<4>() {
        let (case, behind) = behind.split_at(u32::from_le_bytes(*length) as usize);
        found.push(case);
        rest = behind;
    }
    assert!(rest.is_empty(), "a length is cut");
    found
}

/// Runs a case, holds it to time and memory, and tells whether it was accepted.
fn taken(target: &Target, number: usize, case: &[u8]) -> bool {
    let started = Instant::now();
    let (accepted, bytes) = live::peak(|| target.run(case));
    let name = target.name;
    assert!(started.elapsed() < SLOWEST, "{name}, case {number}: {:?}", started.elapsed());
    assert!(bytes <= MAX_BYTES, "{name}, case {number}: {bytes} bytes of memory");
    accepted
}

// One test: what is live is counted for the whole process.
#[test]
fn what_the_fuzzer_kept_and_what_it_began_with_is_taken_or_refused() {
    let first = seeds::seeds();
    if let Some(folder) = std::env::var_os("INFOBYTE_FUZZ_SEEDS") {
        for (number, (target, bytes)) in first.iter().enumerate() {
            let folder = Path::new(&folder).join(target);
            fs::create_dir_all(&folder).unwrap();
            fs::write(folder.join(format!("seed-{number}")), bytes).unwrap();
        }
    }
    let read = |name: &str, second: fn(&[u8]) -> Option<second::Second>| {
        first.iter().any(|seed| seed.0 == name && second(&seed.1).is_some())
    };
    assert!(read("stl", second::stl) && read("ply", second::ply), "no seed is read a second time");
    assert!(read("obj", second::obj) && read("off", second::off), "no seed is read a second time");
    for target in TARGETS {
        let begun: Vec<&[u8]> =
            first.iter().filter(|seed| seed.0 == target.name).map(|seed| &seed.1[..]).collect();
        let sound = begun.iter().enumerate().filter(|(number, case)| taken(&target, *number, case)).count();
        // Frames of other codecs than runs have no seeds; what is kept of them is mostly damaged.
        println!("{}: {sound} of {} seeds are accepted", target.name, begun.len());
        assert!(sound > 0 || begun.is_empty(), "{}: no seed is accepted", target.name);
        let kept = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("fixtures/fuzz/{}.cases", target.name));
        let kept = fs::read(&kept).unwrap_or_else(|e| panic!("{}: {e}", kept.display()));
        let kept = cases(&kept);
        let accepted = kept.iter().enumerate().filter(|(number, case)| taken(&target, *number, case)).count();
        println!("{}: {accepted} of {} kept cases are accepted", target.name, kept.len());
        assert!(!kept.is_empty(), "{}: nothing is kept", target.name);
    }
    fs::remove_dir_all(targets::folder()).unwrap();
}
