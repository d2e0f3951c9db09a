//! Headerless volumes: the bytes delivered are the bytes of the file, whichever way it is cut into
//! files, whichever part is asked for; and every disagreement of sizes is refused by name.

use crate::prelude::*;
use infobyte::discovery::open_unprepared as open;

fn options(dims: Dims, scalar: ScalarType, endian: Endian) -> RawOptions {
    RawOptions { dims, scalar, endian, spacing_mm: [0.5, 0.5, 2.0], skip: 0, orientation: Orientation::LPS }
}

fn read(source: &dyn VolumeSource, z: u32, rows: (u32, u32), cols: (u32, u32)) -> Vec<u8> {
    let samples = (rows.1 - rows.0) as usize * (cols.1 - cols.0) as usize;
    let mut out = vec![0xaa; samples * source.info().scalar.bytes()];
    source.read_rows(z, rows.0..rows.1, cols.0..cols.1, &mut out).unwrap();
    out
}

#[test]
fn any_block_is_the_same_from_one_file_and_from_slice_files_in_every_type_and_order() {
    let dims = Dims::new(7, 5, 12).unwrap();
    let mut random = Random(1);
    for scalar in ScalarType::ALL {
        for endian in [Endian::Little, Endian::Big] {
            for skip in [0_usize, 13] {
                let folder = tempfile::tempdir().unwrap();
                let slices = folder.path().join("slices");
                fs::create_dir(&slices).unwrap();
                let w = scalar.bytes();
                let slice_bytes = 7 * 5 * w;
                let voxels: Vec<u8> = (0..slice_bytes * 12).map(|_| random.byte()).collect();
                let head = vec![0xee; skip];
                let whole = folder.path().join("whole.raw");
                fs::write(&whole, [&head[..], &voxels].concat()).unwrap();
                let mut given = Vec::new();
                for (i, slice) in voxels.chunks(slice_bytes).enumerate() {
                    let path = slices.join(format!("s.{}", i + 1));
                    fs::write(&path, [&head[..], slice].concat()).unwrap();
                    given.push(path);
                }
                fs::write(slices.join(".hidden"), b"x").unwrap();
                fs::create_dir(slices.join("subfolder")).unwrap();
                let options = RawOptions { skip: skip as u64, ..options(dims, scalar, endian) };
                let sources = [
                    RawVolume::open(&[whole], &options).unwrap(),
                    RawVolume::open(&given, &options).unwrap(),
                    RawVolume::open(&[slices], &options).unwrap(),
                ];
                for round in 0..40 {
                    let z = random.below(12);
                    let y = random.below(5);
                    let rows = (y, y + 1 + random.below(5 - y));
                    let x = if round % 2 == 0 { 0 } else { random.below(7) };
                    let cols = if round % 2 == 0 { (0, 7) } else { (x, x + 1 + random.below(7 - x)) };
                    let mut expected = Vec::new();
                    for row in rows.0..rows.1 {
                        for col in cols.0..cols.1 {
                            let at = ((z * 5 + row) * 7 + col) as usize * w;
                            let mut sample = voxels[at..at + w].to_vec();
                            if (endian == Endian::Big) == cfg!(target_endian = "little") {
                                sample.reverse();
                            }
                            expected.extend(sample);
                        }
                    }
                    for source in &sources {
                        assert_eq!(
                            read(source, z, rows, cols),
                            expected,
                            "{scalar} {endian:?} z {z} {rows:?} {cols:?}"
                        );
                    }
                }
                let info = sources[2].info();
                assert_eq!((info.description.name.as_str(), info.description.files), ("slices", 12));
                assert_eq!(info.description.bytes, (slice_bytes * 12) as u64);
            }
        }
    }
}

#[test]
fn sizes_that_disagree_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("v.raw");
    let dims = Dims::new(4, 3, 2).unwrap();
    let options = options(dims, ScalarType::U16, Endian::Little);
    for got in [0_u64, 47, 49] {
        fs::write(&path, vec![0; usize::try_from(got).unwrap()]).unwrap();
        let error = RawVolume::open(std::slice::from_ref(&path), &options).unwrap_err();
        assert!(
            matches!(error, SourceError::SizeMismatch { expected: 48, got: g, .. } if g == got),
            "{error}"
        );
        assert!(error.to_string().contains("4x3x2 u16"), "{error}");
        assert_eq!(error.kind(), ExitKind::Input);
    }
    let huge = RawOptions { skip: u64::MAX, ..options.clone() };
    let error = RawVolume::open(std::slice::from_ref(&path), &huge).unwrap_err();
    assert_eq!(error.kind(), ExitKind::Usage, "{error}");
    let flat = RawOptions { spacing_mm: [1.0, 0.0, 1.0], ..options.clone() };
    assert_eq!(RawVolume::open(std::slice::from_ref(&path), &flat).unwrap_err().kind(), ExitKind::Usage);

    let (a, b) = (folder.path().join("a"), folder.path().join("b"));
    fs::write(&a, [0; 24]).unwrap();
    fs::write(&b, [0; 23]).unwrap();
    let error = RawVolume::open(&[a.clone(), b.clone()], &options).unwrap_err();
    assert!(
        matches!(&error, SourceError::SizeMismatch { path, expected: 24, got: 23, .. } if *path == b),
        "{error}"
    );
    let error = RawVolume::open(&[a.clone(), a.clone(), a.clone()], &options).unwrap_err();
    assert!(error.to_string().contains("3 slice files"), "{error}");
}

#[test]
fn missing_files_empty_folders_and_mixtures_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let options = options(Dims::new(2, 2, 2).unwrap(), ScalarType::U8, Endian::Little);
    let error = RawVolume::open(&[folder.path().join("nothing")], &options).unwrap_err();
    assert!(matches!(error, SourceError::Unreadable { .. }), "{error}");
    let error = RawVolume::open(&[folder.path().to_path_buf()], &options).unwrap_err();
    assert!(matches!(error, SourceError::NoVolume { .. }), "{error}");
    let error = RawVolume::open(&[], &options).unwrap_err();
    assert_eq!(error.kind(), ExitKind::Usage);
    let file = folder.path().join("f");
    fs::write(&file, [0; 4]).unwrap();
    let error = RawVolume::open(&[file, folder.path().to_path_buf()], &options).unwrap_err();
    assert!(error.to_string().contains("among several inputs"), "{error}");
}

#[test]
fn a_file_that_shrinks_and_a_request_outside_fail_without_a_panic() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("v.raw");
    fs::write(&path, [7; 8]).unwrap();
    let options = options(Dims::new(2, 2, 2).unwrap(), ScalarType::U8, Endian::Little);
    let source = RawVolume::open(std::slice::from_ref(&path), &options).unwrap();
    for (z, rows, cols, len) in
        [(2, 0..2, 0..2, 4), (0, 1..3, 0..2, 4), (0, 0..2, 0..3, 6), (0, 0..2, 0..2, 3)]
    {
        assert!(source.read_rows(z, rows, cols, &mut vec![0; len]).is_err());
    }
    source.read_rows(0, 1..1, 0..2, &mut []).unwrap();
    source.read_rows(0, 0..2, 1..1, &mut []).unwrap();
    fs::File::options().write(true).open(&path).unwrap().set_len(7).unwrap();
    let error = source.read_rows(1, 0..2, 0..2, &mut [0; 4]).unwrap_err();
    assert!(matches!(error, SourceError::ReadFailed { slice: 1, .. }), "{error}");
}

#[test]
fn the_cadaver_head_is_read_in_natural_order_and_big_endian() {
    let Some(folder) = real_data("raw-cthead") else { return };
    let dims = Dims::new(256, 256, 113).unwrap();
    let source = open(
        std::slice::from_ref(&folder),
        &OpenOptions { raw: Some(options(dims, ScalarType::I16, Endian::Big)), ..OpenOptions::default() },
    )
    .unwrap();
    let (mut low, mut high) = (i16::MAX, i16::MIN);
    for z in 0..113 {
        let out = read(source.as_ref(), z, (0, 256), (0, 256));
        let file = fs::read(folder.join(format!("CThead.{}", z + 1))).unwrap();
        for (mine, theirs) in out.as_chunks::<2>().0.iter().zip(file.as_chunks::<2>().0) {
            let value = bytemuck::cast::<[u8; 2], i16>(*mine);
            assert_eq!(value, i16::from_be_bytes(*theirs));
            (low, high) = (low.min(value), high.max(value));
        }
    }
    assert_eq!((low, high), (0, 3272));
}
