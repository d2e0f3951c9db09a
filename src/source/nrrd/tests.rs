use std::fs;
use std::path::PathBuf;

use super::*;
use crate::volume::{Note, NoteKind, VolumeInfo};

/// Opens a header with `data` behind it.
fn opened(header: &str, data: &[u8]) -> Result<Vec<VolumeInfo>, String> {
    let folder = tempfile::tempdir().unwrap();
    let path: PathBuf = folder.path().join("v.nrrd");
    fs::write(&path, [header.as_bytes(), b"\n", data].concat()).unwrap();
    open(&path, &OpenOptions::default())
        .map(|volumes| volumes.iter().map(|v| v.info().clone()).collect())
        .map_err(|error| error.to_string())
}

fn one(header: &str, data: &[u8]) -> VolumeInfo {
    let mut all = opened(header, data).unwrap();
    assert_eq!(all.len(), 1);
    all.remove(0)
}

const BASE: &str = "NRRD0004\n# text\ntype: short\ndimension: 3\nsizes: 4 3 2\nendian: little\nencoding: raw\nkey:=value: x\n";

#[test]
fn directions_of_every_space_become_lps() {
    for (space, signs) in [
        ("left-posterior-superior", [1.0, 1.0, 1.0]),
        ("RAS", [-1.0, -1.0, 1.0]),
        ("left-anterior-superior", [1.0, -1.0, 1.0]),
        ("3D-right-handed", [1.0, 1.0, 1.0]),
    ] {
        let header = format!(
            "{BASE}space: {space}\nspace directions: (2,0,0.5) (0,-3,0) (0,0,1e1)\nspace origin: (7,-8,9)\n"
        );
        let info = one(&header, &[0; 48]);
        let expected: [[f64; 4]; 3] = [[2.0, 0.0, 0.0, 7.0], [0.0, -3.0, 0.0, -8.0], [0.5, 0.0, 10.0, 9.0]];
        for (row, sign) in [0, 1, 2].into_iter().zip(signs) {
            assert_eq!(info.affine.rows[row], expected[row].map(|v: f64| v * sign), "{space}");
        }
        assert_eq!(info.notes.is_empty(), space != "3D-right-handed", "{:?}", info.notes);
    }
    let microns = format!(
        "{BASE}space: LPS\nspace units: \"um\" \"um\" \"um\"\nspace directions: (500,0,0) (0,250,0) (0,0,2000)\nspace origin: (0,0,0)\n"
    );
    assert_eq!(one(&microns, &[0; 48]).spacing_mm, [0.5, 0.25, 2.0]);
}

#[test]
fn spacings_and_ends_of_axes_stand_in_for_directions() {
    let info =
        one(&format!("{BASE}spacings: 0.5 2 4\naxis mins: 10 nan 0\ncenters: cell cell node\n"), &[0; 48]);
    assert_eq!(info.spacing_mm, [0.5, 2.0, 4.0]);
    assert_eq!(info.affine.origin(), [10.25, 0.0, 0.0]);
    let info = one(&format!("{BASE}axis mins: 0 0 0\naxis maxs: 8 3 5\ncenters: cell cell node\n"), &[0; 48]);
    assert_eq!((info.spacing_mm, info.affine.origin()), ([2.0, 1.0, 5.0], [1.0, 0.5, 0.0]));
    let info = one(BASE, &[0; 48]);
    assert_eq!(info.spacing_mm, [1.0; 3]);
    assert!(info.notes.iter().any(|note| note.kind == NoteKind::AssumedSpacing), "{:?}", info.notes);
}

#[test]
fn axes_that_are_not_space_are_volumes_or_refused() {
    let header = |sizes: &str, kinds: &str| {
        let count = sizes.split(' ').count();
        format!(
            "NRRD0005\ntype: uint8\ndimension: {count}\nsizes: {sizes}\nkinds: {kinds}\nencoding: raw\nspacings:{}\n",
            " 1".repeat(count)
        )
    };
    let four = opened(&header("4 3 2 5", "domain domain domain list"), &[0; 120]).unwrap();
    assert_eq!(four.len(), 5);
    assert!(
        four[4].notes.contains(&Note::new(format!("this is volume {} of {} in the file", 5, 5))),
        "{:?}",
        four[4].notes
    );
    assert_eq!(opened(&header("4 3 2 5", "space space space space"), &[0; 120]).unwrap().len(), 5);
    assert_eq!(one(&header("1 4 3 2", "vector domain domain domain"), &[0; 24]).dims.to_array(), [4, 3, 2]);
    assert_eq!(one(&header("4 3", "domain domain"), &[0; 12]).dims.to_array(), [4, 3, 1]);
    for (sizes, kinds, words) in [
        ("3 4 3 2", "RGB-color domain domain domain", "`rgb-color`"),
        ("4 6 3 2", "domain vector domain domain", "runs faster than space"),
        ("24", "domain", "1 axes in space"),
        ("4 3 2", "domain domain", "2 kinds for 3 axes"),
        ("0 3 2", "domain domain domain", "out of range"),
        ("70000 3 2", "domain domain domain", "out of range"),
        ("99999999999999999999999 1 1", "domain domain domain", "for sizes, which is not a number"),
        ("4 3 2 999999", "domain domain domain time", "999999 volumes"),
    ] {
        let refused = opened(&header(sizes, kinds), &[0; 72]).unwrap_err();
        assert!(refused.contains(words), "{sizes} {kinds}: {refused}");
    }
}

#[test]
fn headers_that_say_too_little_or_nonsense_are_refused_by_name() {
    for (from, to, words) in [
        ("type: short\n", "", "no sample type"),
        ("type: short", "type: block", "`block` is not read"),
        ("encoding: raw\n", "", "no encoding"),
        ("encoding: raw", "encoding: zstd", "`zstd` is not read"),
        ("endian: little", "endian: middle", "byte order"),
        ("sizes: 4 3 2", "sizes: 4 3", "2 sizes for 3"),
        ("dimension: 3", "dimension: 99", "makes no sense"),
        ("NRRD0004", "NRRD0009", "not a version"),
        ("sizes: 4 3 2", "sizes: 4 3 3", "promises 72 bytes of samples, the file has 48"),
        ("encoding: raw", "encoding: gzip", "gzip"),
        ("key:=value: x", "nonsense", "is not a field"),
    ] {
        assert!(BASE.contains(from));
        let result = opened(&BASE.replace(from, to), &[0; 48]);
        if to == "encoding: gzip" {
            assert!(result.is_ok(), "a stream is judged when it is unrolled");
            continue;
        }
        let refused = result.unwrap_err();
        assert!(refused.contains(words) && refused.contains("v.nrrd"), "{to}: {refused}");
    }
    let flat =
        format!("{BASE}space: LPS\nspace directions: (1,0,0) (1,0,0) (0,0,1)\nspace origin: (0,0,0)\n");
    assert!(opened(&flat, &[0; 48]).unwrap_err().contains("flat"));
    let huge = BASE.replace("sizes: 4 3 2", "sizes: 60000 60000 60000").replace("raw", "gzip");
    assert!(opened(&huge, &[0; 48]).unwrap_err().contains("more than 48 bytes of gzip can hold"));
    assert!(opened(&format!("{BASE}byte skip: -1\n"), &[0; 60]).is_ok());
    assert!(
        opened(&format!("{BASE}line skip: 2\n"), b"a\nb").unwrap_err().contains("fewer than the 2 lines")
    );
}
