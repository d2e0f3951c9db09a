//! The worked example of SPEC 8. If this fails, the specification and the program disagree about
//! bytes, and files of one of them cannot be read by the other.

use crate::invariants::with_metadata;
use crate::prelude::*;

/// The bytes of a hex block under "Worked examples", counted from 0: offset, bytes, and `;` before a remark.
fn bytes_of_the_text(number: usize) -> Vec<u8> {
    let text = include_str!("../../src/format/SPEC.md");
    let section = text.split("## 8. Worked examples").nth(1).unwrap().split("\n## ").next().unwrap();
    let block = section.split("```").nth(2 * number + 1).unwrap();
    let mut bytes = Vec::new();
    for line in block.lines().skip(1).filter(|l| !l.trim().is_empty()) {
        let mut words = line.split(';').next().unwrap().split_whitespace();
        let offset = usize::from_str_radix(words.next().unwrap(), 16).unwrap();
        assert_eq!(offset, bytes.len(), "{line}");
        bytes.extend(words.map(|w| u8::from_str_radix(w, 16).unwrap()));
    }
    bytes
}

/// Rows of 16 bytes, as the text has them.
fn dump(bytes: &[u8]) -> String {
    let row = |(i, c): (usize, &[u8])| {
        format!("{:04x}  {}\n", 16 * i, c.iter().map(|b| format!("{b:02x}")).collect::<Vec<_>>().join(" "))
    };
    bytes.chunks(16).enumerate().map(row).collect()
}

#[test]
fn the_text_the_assembler_and_the_loader_agree_byte_for_byte() {
    let voxel = |cell, direction| AssembledVoxel { cell, normal: normal::encode(direction), value: 0 };
    let voxels = [
        voxel([0, 0, 0], [-1.0, 0.0, 0.0]),
        voxel([2, 0, 0], [1.0, 0.0, 0.0]),
        voxel([2, 1, 0], [0.0, 1.0, 0.0]),
    ];
    let file = assemble(&metadata([3, 2, 1], NORMALS), &voxels, NORMALS);
    let text = bytes_of_the_text(0);
    assert!(file == text, "the bytes are\n{}", dump(&file));

    verify(text.as_slice()).unwrap();
    let model = Model::from_bytes(text).unwrap();
    assert_eq!((model.node_count(), model.voxel_count(), model.depth()), (3, 3, 2));
    assert_eq!([0, 1, 2].map(|n| model.infobyte(NodeIndex::new(n))), [0x03, 0x01, 0x05]);
    assert_eq!([0, 1, 2].map(|n| model.first_child(NodeIndex::new(n)).get()), [1, 3, 4]);
    assert_eq!(model.child(NodeIndex::new(2), Octant::ALL[2]), Some(BoxIndex::new(5)));
    assert_eq!(model.child(NodeIndex::new(2), Octant::ALL[1]), None);
    // (-1, 0, 0), (1, 0, 0), (0, 1, 0); the sum of all is along y.
    assert_eq!(
        [0, 1, 2].map(|v| model.voxel_normal(VoxelIndex::new(v))),
        [Some(0x0081), Some(0x007f), Some(0x7f00)]
    );
    assert_eq!(model.node_normal(NodeIndex::ROOT), Some(0x7f00));
}

/// The header of the example, field by field from SPEC 4.1, without the program's own reader.
#[test]
fn the_header_of_the_example_reads_as_the_table_says() {
    let b = bytes_of_the_text(0);
    let u32_at = |at: usize| u32::from_le_bytes(b[at..at + 4].try_into().unwrap());
    let u64_at = |at: usize| u64::from_le_bytes(b[at..at + 8].try_into().unwrap());
    assert_eq!(b[..8], [0x89, 0x4f, 0x43, 0x54, 0x0d, 0x0a, 0x1a, 0x0a]);
    assert_eq!((b[8], b[10], b[12], b[13], b[14]), (1, 0, 0, 2, 6));
    assert_eq!((u64_at(16), u64_at(24), u64_at(32)), (b.len() as u64, 3, 3));
    assert_eq!([u32_at(40), u32_at(44), u32_at(48), u32_at(52)], [3, 2, 1, 0]);
    // CRC-32C bit by bit.
    let crc = |bytes: &[u8]| {
        let step = |crc: u32, byte: &u8| {
            (0..8).fold(crc ^ u32::from(*byte), |c, _| if c & 1 == 1 { c >> 1 ^ 0x82F6_3B78 } else { c >> 1 })
        };
        !bytes.iter().fold(u32::MAX, step)
    };
    assert_eq!(u32_at(56), crc(&b[64..64 + 6 * 48]));
    assert_eq!(u32_at(60), crc(&b[..60]));
}

/// The smallest solid with larger leaves, as the builder makes it.
#[test]
fn the_builder_makes_the_second_example() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.oct");
    let volume = Voxels::from_fn(Dims::new(2, 2, 2).unwrap(), |_| 255_u8);
    let options = BuildOptions {
        threshold: Threshold::Iso(128.0),
        surface: Some(SurfaceKind::Cells),
        error: Some(infobyte::builder::Tolerance::Voxels(0.3)),
        lod: false,
        ..BuildOptions::default()
    };
    infobyte::build(&volume, &options, &path).unwrap();
    let mut file = with_metadata(&std::fs::read(&path).unwrap(), |m| m.program = "example".into());
    // The helper makes files of skin voxels.
    file[12] = 6;
    let crc = crc32c::crc32c(&file[..60]);
    file[60..64].copy_from_slice(&crc.to_le_bytes());
    let text = bytes_of_the_text(1);
    assert!(file == text, "the bytes are\n{}", dump(&file));

    verify(text.as_slice()).unwrap();
    let model = Model::from_bytes(text).unwrap();
    assert_eq!((model.node_count(), model.voxel_count(), model.depth()), (9, 19, 2));
    let leaves: Vec<u64> = (1..9).filter(|n| model.infobyte(NodeIndex::new(*n)) == 0).collect();
    assert_eq!(leaves.len(), 4);
    assert_eq!(model.metadata().error.map(|found| found.bound), Some(0.3));
}

/// The independent reader in `scripts/` and the program say the same of a file.
#[test]
fn the_script_reads_what_the_program_reads() {
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
    for name in ["v1.0-mapped.oct", "v1.0-packed.oct"] {
        let file = root.join("fixtures").join(name);
        let script =
            std::process::Command::new("python3").arg(root.join("scripts/read_oct.py")).arg(&file).output();
        let output = match script {
            Ok(output) => output,
            Err(e) => return println!("skipped: python3 cannot be run ({e})"),
        };
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let script: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        let program = serde_json::to_value(infobyte::jobs::info::read_info(&file).unwrap().json()).unwrap();
        let keys = script.as_object().unwrap();
        assert!(keys.len() >= 20);
        for (key, value) in keys {
            assert_eq!(&program[key], value, "{name}: {key}");
        }
    }
}
