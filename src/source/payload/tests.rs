use std::fs;
use std::path::Path;

use super::*;
use crate::budget::Budget;
use crate::compress::gzip;
use crate::progress::Silent;
use crate::source::{OpenOptions, nrrd};
use crate::volume::{Note, SourceFault};

/// A header of three volumes of 4 x 3 x 2 bytes, `volume * 24 + voxel` each.
fn header(encoding: &str, data: &str) -> String {
    format!(
        "NRRD0005\ntype: uchar\ndimension: 4\nsizes: 4 3 2 3\nkinds: domain domain domain list\n\
         spacings: 1 1 1 nan\nencoding: {encoding}\n{data}"
    )
}

fn workspace(scratch: &Path) -> Workspace<'_> {
    Workspace { scratch, memory: Budget::new(3 << 20), progress: &Silent }
}

#[test]
fn each_volume_of_a_file_is_its_own_part_of_the_stream() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let bytes: Vec<u8> = (0..72).collect();
    fs::write(at("raw.nrrd"), [header("raw", "\n").as_bytes(), &bytes].concat()).unwrap();
    fs::write(at("gz.nrrd"), [header("gz", "\n").as_bytes(), &gzip(&bytes)].concat()).unwrap();
    // One slice, one volume and a volume and a half in each file.
    for (per_file, name) in [(12, "a"), (24, "b"), (36, "c")] {
        for (i, part) in bytes.chunks(per_file).enumerate() {
            fs::write(at(&format!("{name}{i}")), gzip(part)).unwrap();
        }
        let data = format!("data file: {name}%d 0 {} 1\n", 72 / per_file - 1);
        fs::write(at(&format!("{name}.nhdr")), header("gz", &data)).unwrap();
    }
    for name in ["raw.nrrd", "gz.nrrd", "a.nhdr", "b.nhdr", "c.nhdr"] {
        let mut volumes = nrrd::open(&at(name), &OpenOptions::default()).unwrap();
        assert_eq!(volumes.len(), 3, "{name}");
        for (index, volume) in volumes.iter_mut().enumerate().rev() {
            volume.prepare(&workspace(folder.path())).unwrap();
            let mut out = [0; 12];
            for z in 0..2 {
                volume.read_rows(z, 0..3, 0..4, &mut out).unwrap();
                let first = index * 24 + z as usize * 12;
                assert_eq!(out[..], bytes[first..first + 12], "{name}, volume {index}, slice {z}");
            }
        }
    }
}

#[test]
fn too_little_memory_no_scratch_and_reading_too_early_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("v.nrrd");
    fs::write(&path, [header("gz", "\n").as_bytes(), &gzip(&[1; 72])].concat()).unwrap();
    let mut volume = nrrd::open(&path, &OpenOptions::default()).unwrap().remove(0);
    let needs = volume.preparation();
    assert_eq!(needs.scratch_bytes, 24);
    assert!(needs.memory_bytes <= 160 << 10, "{needs:?}");
    let little = Workspace { memory: Budget::new(needs.memory_bytes - 1), ..workspace(folder.path()) };
    assert!(matches!(volume.prepare(&little).unwrap_err().fault(), SourceFault::Memory { .. }));
    let nowhere = Workspace { scratch: Path::new("missing/folder"), ..workspace(folder.path()) };
    assert!(matches!(volume.prepare(&nowhere).unwrap_err().fault(), SourceFault::Scratch { .. }));
    let early = volume.read_rows(0, 0..1, 0..4, &mut [0; 4]).unwrap_err();
    assert!(early.to_string().contains("not been unrolled"), "{early}");
    let enough = Workspace { memory: Budget::new(needs.memory_bytes), ..workspace(folder.path()) };
    volume.prepare(&enough).unwrap();
    assert_eq!(volume.preparation(), Preparation::default());
    assert!(volume.read_rows(0, 0..1, 0..5, &mut [0; 5]).is_err());
}

#[test]
fn a_wrong_checksum_is_damage_and_more_than_promised_a_warning() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("v.nrrd");
    let prepared = |stream: &[u8]| {
        fs::write(&path, [header("gz", "\n").as_bytes(), stream].concat()).unwrap();
        let mut volume = nrrd::open(&path, &OpenOptions::default()).unwrap().remove(2);
        volume.prepare(&workspace(folder.path())).map(|()| volume.info().notes.clone())
    };
    let whole = gzip(&[1; 72]);
    let mut wrong = whole.clone();
    wrong[whole.len() - 6] ^= 1;
    let refused = prepared(&wrong).unwrap_err().to_string();
    assert!(refused.contains("gzip stream is damaged") && refused.contains("v.nrrd"), "{refused}");
    let cut = prepared(&whole[..whole.len() - 3]).unwrap_err().to_string();
    assert!(cut.contains("was cut short"), "{cut}");
    let longer = Note::new(format!(
        "the gzip stream holds more than the {} bytes that the header promises; the rest is ignored",
        72
    ));
    assert!(prepared(&gzip(&[1; 73])).unwrap().contains(&longer));
    assert!(!prepared(&[&whole[..], b"\0\0\0"].concat()).unwrap().contains(&longer));
}
