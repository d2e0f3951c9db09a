//! Bytes from a file never cause a panic, a hang or a large allocation, and `verify` notices every
//! damage. If this fails, a broken download can crash a file manager, or pass for a sound model.

#![expect(clippy::cast_possible_truncation, reason = "numbers here are small by construction")]

use crate::common as support;
use crate::prelude::*;

use support::{corner, shell};

/// Follows every child of every node to the model's depth, as a renderer would, at most `budget` boxes.
fn walk(model: &impl NodeView, budget: &mut u32) -> u64 {
    let mut stack = vec![(BoxIndex::ROOT, 0)];
    let mut sum = 0_u64;
    while let Some((number, depth)) = stack.pop() {
        if *budget == 0 {
            break;
        }
        *budget -= 1;
        if depth == model.depth() {
            let voxel = number.voxel(model.node_count());
            sum += u64::from(model.voxel_normal(voxel).unwrap_or(0));
            continue;
        }
        sum += u64::from(model.node_normal(number.node()).unwrap_or(0));
        stack.extend(
            Octant::ALL
                .into_iter()
                .filter_map(|o| model.child(number.node(), o))
                .map(|child| (child, depth + 1)),
        );
    }
    sum
}

/// Opens, walks and verifies bytes; says whether `verify` accepts them.
fn handle(bytes: &[u8]) -> Result<(), FormatError> {
    let model = Model::from_bytes(bytes)?;
    walk(&model, &mut 5000);
    for far in [0, 1, u64::MAX / 2, u64::MAX] {
        let (node, voxel) = (NodeIndex::new(far), VoxelIndex::new(far));
        model.infobyte(node);
        model.first_child(node);
        model.voxel_normal(voxel);
        model.node_normal(node);
        model.value(voxel);
        for octant in Octant::ALL {
            model.child(node, octant);
        }
    }
    match verify(bytes) {
        Ok(_) => Ok(()),
        Err(infobyte::load::Fault::Format(e)) => Err(e),
        Err(infobyte::load::Fault::Io(e)) => panic!("memory cannot fail to be read: {e}"),
    }
}

#[test]
fn a_file_cut_at_any_length_or_grown_is_refused() {
    let file = shell([12, 9, 10], FULL, 5);
    handle(&file).unwrap();
    for len in 0..file.len() {
        let error = handle(&file[..len]).unwrap_err();
        let due = match len {
            0 => matches!(error, FormatError::BadMagic),
            _ => matches!(error, FormatError::Truncated { .. }),
        };
        assert!(due, "cut to {len}: {error}");
    }
    let mut longer = file;
    longer.push(0);
    assert!(handle(&longer).unwrap_err().to_string().starts_with("has 1 bytes after its end"));
}

#[test]
fn every_flipped_byte_of_a_file_is_noticed() {
    for file in [shell([9, 12, 7], FULL, 6), corner([3, 2, 1], NORMALS), corner([1, 1, 1], FULL)] {
        for at in 0..file.len() {
            for flip in [0x01, 0x80, 0xff] {
                let mut bad = file.clone();
                bad[at] ^= flip;
                let error = handle(&bad).expect_err("damage must be noticed");
                let due = match at {
                    0..8 => error == FormatError::BadMagic,
                    8..HEADER_BYTES => matches!(error, FormatError::Checksum { of: "the header", .. }),
                    _ => match error {
                        FormatError::Checksum { of, .. } => of != "the header",
                        _ => matches!(error, FormatError::PaddingNotZero { .. }),
                    },
                };
                assert!(due, "byte {at} ^ {flip:02x}: {error}");
            }
        }
    }
}

#[test]
fn lies_in_header_and_table_with_right_checksums_are_refused() {
    let file = shell([12, 9, 10], FULL, 8);
    let refuse = |name: &str, change: fn(&mut Frame)| {
        handle(&forged(&file, |frame, _| change(frame))).expect_err(name)
    };
    let huge = 1 << 60;
    let says = |fault: FormatError, due| assert!(fault.to_string().contains(due), "{fault}");
    says(refuse("V 1", |f| f.header.voxels = 1), "number of nodes");
    says(refuse("V less", |f| f.header.voxels -= 1), "are due");
    says(refuse("N less", |f| f.header.nodes -= 1), "does not run from 0");
    refuse("V 0", |f| f.header.voxels = 0);
    refuse("V huge", |f| f.header.voxels = u64::MAX);
    refuse("N huge", |f| f.header.nodes = u64::MAX);
    refuse("N 0", |f| f.header.nodes = 0);
    refuse("sections", |f| f.header.sections = 65535);
    refuse("sections 0", |f| f.header.sections = 0);
    refuse("dims", |f| f.header.dims = infobyte::geom::Dims::new(12, 9, 11).unwrap());
    for section in 0..Frame::read(file.as_slice()).unwrap().sections.len() {
        for huge in [0, 1, huge, u64::MAX] {
            let with = |change: &dyn Fn(&mut infobyte::format::SectionEntry)| {
                let bad = forged(&file, |frame, _| change(&mut frame.sections[section]));
                if bad != file {
                    handle(&bad).expect_err("a lie in the table");
                }
            };
            with(&|e| e.offset = huge);
            with(&|e| e.stored_bytes = huge);
            with(&|e| e.content_bytes = huge);
            with(&|e| e.items = huge);
            with(&|e| (e.items, e.stored_bytes, e.content_bytes) = (huge, huge, huge));
            with(&|e| e.item_bytes = huge as u8);
            with(&|e| e.codec = 1 + huge as u8 % 4);
            with(&|e| e.tag = *b"NODE");
        }
    }
}

#[test]
fn content_damage_behind_right_checksums_never_harms_a_walk() {
    let file = shell([12, 9, 10], FULL, 9);
    for seed in 1..=400 {
        let mut random = Random(seed * 0x9E37_79B9);
        let mut bad = file.clone();
        let table_end = HEADER_BYTES + Frame::read(file.as_slice()).unwrap().sections.len() * ENTRY_BYTES;
        for _ in 0..1 + random.below(20) {
            let at = table_end + random.below(file.len() - table_end);
            bad[at] = random.byte();
        }
        let repaired = forge_crcs(&bad, &file);
        // Whatever comes of it: no panic, and if it is accepted it must be walkable in full.
        if handle(&repaired).is_ok() {
            let model = Model::from_bytes(repaired).unwrap();
            let mut budget = 1_000_000;
            walk(&model, &mut budget);
            assert!(budget > 0, "seed {seed}");
        }
    }
}

/// Makes all checksums right again, with the table of `sound`.
pub(crate) fn forge_crcs(bad: &[u8], sound: &[u8]) -> Vec<u8> {
    forged(sound, |frame, file| {
        file.copy_from_slice(bad);
        for e in &mut frame.sections {
            e.stored_crc = crc32c::crc32c(&file[e.offset as usize..e.end() as usize]);
            e.content_crc = e.stored_crc;
        }
    })
}

#[test]
fn a_newer_major_version_is_named_and_a_newer_minor_is_read() {
    let mut file = corner([3, 2, 1], NORMALS);
    let newer = forged(&file, |frame, _| frame.header.minor = 9);
    handle(&newer).unwrap();
    file[8] = 2;
    let crc = crc32c::crc32c(&file[..60]).to_le_bytes();
    file[60..64].copy_from_slice(&crc);
    assert!(handle(&file).unwrap_err().to_string().starts_with("has format version 2;"));
}

/// A packed shell large enough for two cubes in a group, and its bytes.
fn packed(folder: &Path) -> Vec<u8> {
    let (a, p) = (folder.join("whole.oct"), folder.join("packed.oct"));
    fs::write(&a, shell([140, 20, 18], FULL, 11)).unwrap();
    pack::pack(&a, &p).unwrap();
    fs::read(p).unwrap()
}

#[test]
fn packed_files_cut_or_flipped_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (path, out) = (folder.path().join("a.oct"), folder.path().join("out.oct"));
    let file = packed(folder.path());
    assert_eq!(Model::from_bytes(file.as_slice()).err(), Some(FormatError::Packed));
    for at in (0..file.len()).step_by(7) {
        fs::write(&path, &file[..at]).unwrap();
        assert_eq!(pack::unpack(&path, &out).unwrap_err().kind(), ExitKind::Input, "cut to {at}");
        let mut bad = file.clone();
        bad[at] ^= 0x10;
        fs::write(&path, &bad).unwrap();
        assert_eq!(pack::unpack(&path, &out).unwrap_err().kind(), ExitKind::Input, "flipped at {at}");
        assert!(info::read_info(&path).is_ok() || at < 1024);
        assert!(!out.exists());
    }
}

/// Hostile payloads: damage behind right stored checksums reaches every decoder.
#[test]
fn packed_content_damage_behind_right_checksums_is_an_error_or_the_same_content() {
    let folder = tempfile::tempdir().unwrap();
    let (path, out) = (folder.path().join("a.oct"), folder.path().join("out.oct"));
    let file = packed(folder.path());
    let whole = fs::read(folder.path().join("whole.oct")).unwrap();
    let frame = Frame::read(file.as_slice()).unwrap();
    for seed in 1..=200 * u64::from(long()) {
        let mut random = Random(seed * 0x85EB_CA6B);
        let mut bad = file.clone();
        let coded: Vec<_> = frame.sections.iter().filter(|e| e.codec != 0 && e.stored_bytes > 0).collect();
        let section = coded[random.below(coded.len())];
        for _ in 0..1 + random.below(3) {
            // Half of the damage goes to the lengths in front.
            let span = if random.below(2) == 0 { section.stored_bytes.min(12) } else { section.stored_bytes };
            bad[(section.offset + random.below(span)) as usize] = random.byte();
        }
        let bad = forged(&file, |frame, file| {
            file.copy_from_slice(&bad);
            for e in &mut frame.sections {
                e.stored_crc = crc32c::crc32c(&bad[e.offset as usize..e.end() as usize]);
            }
        });
        fs::write(&path, &bad).unwrap();
        match pack::unpack(&path, &out) {
            Ok(_) => {
                assert!(fs::read(&out).unwrap() == whole, "seed {seed}: other content was accepted");
                fs::remove_file(&out).unwrap();
            }
            Err(e) => assert_eq!(e.kind(), ExitKind::Input, "seed {seed}: {e}"),
        }
    }
}

/// A packed header may promise any size; nothing of it is believed before the bytes are there.
#[test]
fn a_packed_file_that_promises_too_much_is_refused_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let (path, out) = (folder.path().join("a.oct"), folder.path().join("out.oct"));
    let file = packed(folder.path());
    let bad = forged(&file, |frame, _| {
        for e in frame.sections.iter_mut().filter(|e| e.kind == Some(SectionKind::Voxels(Channel::Value))) {
            (e.items, e.content_bytes) = (1 << 40, 1 << 41);
        }
    });
    fs::write(&path, &bad).unwrap();
    let error = pack::unpack(&path, &out).unwrap_err();
    assert!(error.to_string().contains("I4"), "{error}");
}
