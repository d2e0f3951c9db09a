use std::fs;

use super::*;
use crate::volume::{Note, VolumeInfo};

/// A NIfTI-1 header of 4 x 3 x 2 i16 with spacing 2 x 3 x 4 mm and no orientation, and 48 bytes of samples.
fn plain() -> Vec<u8> {
    let mut bytes = vec![0; 352 + 48];
    bytes[..4].copy_from_slice(&348_u32.to_le_bytes());
    for (i, n) in [3_i16, 4, 3, 2, 1, 1, 1, 1].into_iter().enumerate() {
        bytes[40 + 2 * i..42 + 2 * i].copy_from_slice(&n.to_le_bytes());
    }
    bytes[70..72].copy_from_slice(&4_i16.to_le_bytes());
    for (i, v) in [1.0_f32, 2.0, 3.0, 4.0].into_iter().enumerate() {
        put(&mut bytes, 76 + 4 * i, v);
    }
    put(&mut bytes, 108, 352.0);
    bytes[123] = 2;
    bytes[344..348].copy_from_slice(b"n+1\0");
    bytes
}

fn put(bytes: &mut [u8], at: usize, v: f32) {
    bytes[at..at + 4].copy_from_slice(&v.to_le_bytes());
}

fn opened(bytes: &[u8]) -> Result<Vec<VolumeInfo>, String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("v.nii");
    fs::write(&path, bytes).unwrap();
    assert!(recognise(&bytes[..bytes.len().min(1024)], &path));
    open(&path, &OpenOptions::default())
        .map(|volumes| volumes.iter().map(|v| v.info().clone()).collect())
        .map_err(|error| error.to_string())
}

fn one(bytes: &[u8]) -> VolumeInfo {
    let mut all = opened(bytes).unwrap();
    assert_eq!(all.len(), 1);
    all.remove(0)
}

#[test]
fn the_sform_comes_before_the_qform_and_both_before_the_bare_spacing() {
    let mut bytes = plain();
    let info = one(&bytes);
    assert_eq!(info.affine.rows, [[-2.0, 0.0, 0.0, 0.0], [0.0, -3.0, 0.0, 0.0], [0.0, 0.0, 4.0, 0.0]]);
    assert!(info.notes.contains(&Note::directions(
"the header states no orientation; its axes are taken as right, anterior, superior, so left and right may be swapped")), "{:?}", info.notes);

    // A quarter turn about z, third axis reversed, at (10, 20, 30) RAS.
    bytes[252] = 1;
    put(&mut bytes, 76, -1.0);
    put(&mut bytes, 264, 0.5_f32.sqrt());
    for (i, v) in [10.0, 20.0, 30.0].into_iter().enumerate() {
        put(&mut bytes, 268 + 4 * i, v);
    }
    let info = one(&bytes);
    let expected = [[0.0, 3.0, 0.0, -10.0], [-2.0, 0.0, 0.0, -20.0], [0.0, 0.0, -4.0, 30.0]];
    for (row, want) in info.affine.rows.iter().flatten().zip(expected.as_flattened()) {
        assert!((row - want).abs() < 1e-6, "{:?}", info.affine);
    }
    assert!(info.notes.is_empty(), "{:?}", info.notes);

    // The sform in micrometres.
    bytes[254] = 1;
    bytes[123] = 3;
    for (i, v) in
        [500.0, 0.0, 0.0, 1000.0, 0.0, 250.0, 0.0, 0.0, 0.0, 100.0, 2000.0, -5000.0].into_iter().enumerate()
    {
        put(&mut bytes, 280 + 4 * i, v);
    }
    let info = one(&bytes);
    let expected = [[-0.5, 0.0, 0.0, -1.0], [0.0, -0.25, 0.0, 0.0], [0.0, 0.1, 2.0, -5.0]];
    for (row, want) in info.affine.rows.iter().flatten().zip(expected.as_flattened()) {
        assert!((row - want).abs() < 1e-12, "{:?}", info.affine);
    }
    // A singular affine is passed over.
    (280..328).for_each(|at| bytes[at] = 0);
    let info = one(&bytes);
    assert!(info.notes.contains(&Note::new("the sform of the header is singular and is not used")));
    assert!((info.affine.rows[2][2] + 0.004).abs() < 1e-9, "{:?}", info.affine);
}

#[test]
fn slopes_keep_the_integers() {
    let mut bytes = plain();
    assert_eq!(one(&bytes).rescale, Rescale::IDENTITY);
    put(&mut bytes, 112, 2.0);
    put(&mut bytes, 116, -1024.0);
    let info = one(&bytes);
    assert_eq!((info.scalar, info.rescale), (ScalarType::I16, Rescale { slope: 2.0, intercept: -1024.0 }));
    put(&mut bytes, 112, f32::NAN);
    assert_eq!(one(&bytes).rescale, Rescale::IDENTITY);
}

#[test]
fn more_dimensions_are_volumes_or_refused() {
    let mut bytes = plain();
    bytes[40] = 4;
    bytes[48] = 3;
    bytes.resize(352 + 3 * 48, 0);
    assert_eq!(opened(&bytes).unwrap().len(), 3);
    bytes[40] = 5;
    bytes[50] = 3;
    assert!(opened(&bytes).unwrap_err().contains("5 dimensions"));
    let mut flat = plain();
    flat[40] = 2;
    assert_eq!(one(&flat).dims.to_array(), [4, 3, 1]);
}

#[test]
fn what_is_not_read_is_named() {
    for (datatype, words) in [(32, "complex"), (128, "RGB"), (1, "single bits"), (99, "unknown type 99")] {
        let mut bytes = plain();
        bytes[70..72].copy_from_slice(&i16::to_le_bytes(datatype));
        let refused = opened(&bytes).unwrap_err();
        assert!(refused.contains(words) && refused.contains("v.nii"), "{refused}");
    }
    let mut analyze = plain();
    analyze[344..348].fill(0);
    assert!(opened(&analyze).unwrap_err().contains("ANALYZE 7.5"));
    assert!(opened(&plain()[..399]).unwrap_err().contains("promises 48 bytes of samples, the file has 47"));
    assert!(opened(&plain()[..100]).unwrap_err().contains("within its NIfTI header"));
    let mut early = plain();
    put(&mut early, 108, 100.0);
    assert!(opened(&early).unwrap_err().contains("within its header"));
    let mut nowhere = plain();
    put(&mut nowhere, 108, f32::NAN);
    assert!(opened(&nowhere).unwrap_err().contains("begin nowhere"));
    let mut pair = plain();
    pair[344..348].copy_from_slice(b"ni1\0");
    assert!(opened(&pair).unwrap_err().contains("no .img file"));
}

#[test]
fn other_gzip_files_are_left_alone() {
    use crate::compress::gzip;
    assert!(recognise(&gzip(&plain()), Path::new("anything.gz")));
    assert!(!recognise(&gzip(&[7; 5000]), Path::new("a.nii.gz")));
    assert!(!recognise(&plain()[..300], Path::new("a.dat")));
}

#[test]
fn forms_that_disagree_and_steps_that_are_missing_are_reported() {
    let noted = |bytes: &[u8], note: &Note| one(bytes).notes.contains(note);
    let mut bytes = plain();
    (bytes[252], bytes[254]) = (1, 2);
    for (row, at) in [(0, 280), (1, 296), (2, 312)] {
        put(&mut bytes, at + 4 * row, [2.0, 3.0, 4.0][row]);
    }
    // The qform is not a rotation, at the origin: the same.
    assert!(!noted(
        &bytes,
        &Note::new(
            "sform and qform of the header place the volume differently; the sform is used, and other programs may use the qform"
        )
    ));
    put(&mut bytes, 268, 0.9);
    assert!(
        !noted(
            &bytes,
            &Note::new(
                "sform and qform of the header place the volume differently; the sform is used, and other programs may use the qform"
            )
        ),
        "less than half a step"
    );
    put(&mut bytes, 268, 1.1);
    assert!(noted(
        &bytes,
        &Note::new(
            "sform and qform of the header place the volume differently; the sform is used, and other programs may use the qform"
        )
    ));
    put(&mut bytes, 268, 0.0);
    put(&mut bytes, 264, 0.02);
    assert!(noted(
        &bytes,
        &Note::new(
            "sform and qform of the header place the volume differently; the sform is used, and other programs may use the qform"
        )
    ));
    assert!(!noted(
        &plain(),
        &Note::spacing("the header states no spacing along some axis; 1 mm is assumed")
    ));
    let mut bytes = plain();
    put(&mut bytes, 84, 0.0);
    assert!(noted(&bytes, &Note::spacing("the header states no spacing along some axis; 1 mm is assumed")));
    assert_eq!(one(&bytes).spacing_mm, [2.0, 1.0, 4.0]);
}
