//! The kept files of `fixtures/` can be made again. If this fails, a kept file was changed by hand, or
//! the writer's bytes changed without a new format version.
//!
//! `INFOBYTE_ADD_FIXTURES=1` (set by `scripts/make_fixtures.sh`) writes the files that are missing
//! first; a file that is there is never rewritten.

use crate::common as support;
use crate::prelude::*;

use support::shell_of;

/// Another program's file with our suffix.
const FOREIGN: &[u8] = b"%Scene 1.0\nanother program's file with the same suffix\n";

/// CRC-32C bit by bit, so that the damaged header does not depend on the code under test.
fn crc32c(bytes: &[u8]) -> u32 {
    let step = |crc: u32, byte: &u8| {
        (0..8).fold(crc ^ u32::from(*byte), |c, _| if c & 1 == 1 { c >> 1 ^ 0x82F6_3B78 } else { c >> 1 })
    };
    !bytes.iter().fold(u32::MAX, step)
}

/// Every fixture by name, made afresh.
fn make() -> Vec<(&'static str, Vec<u8>)> {
    // The numbers that the kept files were made with (Marsaglia's xorshift). They stay here, whatever the
    // generator of the other tests is, for a kept file is never rewritten.
    let mut state = 2027_u64;
    let mapped = shell_of([36, 20, 18], FULL, |n| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) % n
    });
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    fs::write(at("mapped.oct"), &mapped).unwrap();
    pack::pack(&at("mapped.oct"), &at("packed.oct")).unwrap();
    let packed = fs::read(at("packed.oct")).unwrap();

    let cut = mapped[..1000].to_vec();
    // SPEC 4.1: the major version is at 8, the header's CRC over its first 60 bytes at 60.
    let mut newer = cut.clone();
    newer[8] = 2;
    let crc = crc32c(&newer[..60]).to_le_bytes();
    newer[60..64].copy_from_slice(&crc);
    vec![
        ("v1.0-mapped.oct", mapped),
        ("v1.0-packed.oct", packed),
        ("x_cut.oct", cut),
        ("x_newer.oct", newer),
        ("x_foreign.oct", FOREIGN.to_vec()),
    ]
}

#[test]
fn the_kept_files_are_what_their_description_makes() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures");
    let made = make();
    if std::env::var_os("INFOBYTE_ADD_FIXTURES").is_some() {
        for (name, bytes) in made.iter().filter(|(name, _)| !folder.join(name).exists()) {
            fs::write(folder.join(name), bytes).unwrap();
            println!("wrote {name}");
        }
    }
    for (name, bytes) in &made {
        let kept = fs::read(folder.join(name)).unwrap_or_else(|e| panic!("fixtures/{name}: {e}"));
        assert!(kept == *bytes, "fixtures/{name} is not what this program makes of it");
    }
    let mut there: Vec<String> = fs::read_dir(&folder)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
        // What the fuzzer keeps changes with every campaign, tests/corpus.rs reads it; a tree of solids is text.
        .filter(|name| !["README.md", "fuzz", "csg"].contains(&name.as_str()))
        .collect();
    there.sort();
    let mut known: Vec<&str> = made.iter().map(|(name, _)| *name).collect();
    known.sort_unstable();
    assert_eq!(there, known, "every file in fixtures/ has to be described here and in its README");
}
