//! Real series and odd files: each is opened or refused for the right reason, and the stored values of
//! every uncompressed file are those that another reader decoded (EXPECTED.tsv beside the data).

use std::fmt::Write as _;
use std::fs::{self, File};
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

use infobyte::catalogue::open;
use infobyte::source::dicom::{Access, Image, PixelLayout, ScanError, scan};
use infobyte::volume::{ScalarType, VolumeSource};

#[path = "support/data.rs"]
mod data;
use data::real_data;

fn open_error(path: PathBuf) -> String {
    match open(&[path], &infobyte::source::OpenOptions::default()) {
        Ok(source) => panic!("opened as {:?}", source.info()),
        Err(error) => error.to_string(),
    }
}

fn close(got: f64, expected: f64, tolerance: f64) {
    assert!((got - expected).abs() <= tolerance, "{got} is not {expected}");
}

/// Smallest and largest sample of a 16-bit volume.
fn range_of(source: &dyn VolumeSource) -> (i64, i64) {
    let info = source.info();
    let [nx, ny, nz] = info.dims.to_array();
    let mut out = vec![0; nx as usize * ny as usize * 2];
    let (mut low, mut high) = (i64::MAX, i64::MIN);
    for z in 0..nz {
        source.read_rows(z, 0..ny, 0..nx, &mut out).unwrap();
        for sample in out.chunks_exact(2) {
            let bits: u16 = bytemuck::pod_read_unaligned(sample);
            let value =
                if info.scalar == ScalarType::I16 { i64::from(bits.cast_signed()) } else { i64::from(bits) };
            (low, high) = (low.min(value), high.max(value));
        }
    }
    (low, high)
}

#[test]
fn a_head_ct_is_ordered_by_position_with_its_spacing_and_rescale() {
    let Some(folder) = real_data("ct-philips-28") else { return };
    let source = open(std::slice::from_ref(&folder), &infobyte::source::OpenOptions::default()).unwrap();
    let info = source.info();
    println!("{info:#?}");
    assert_eq!(info.dims.to_array(), [512, 512, 28]);
    assert_eq!(info.scalar, ScalarType::U16);
    assert_eq!((info.rescale.slope, info.rescale.intercept), (1.0, -1024.0));
    close(info.spacing_mm[0], 0.451, 5e-4);
    close(info.spacing_mm[1], 0.451, 5e-4);
    close(info.spacing_mm[2], 5.0, 1e-3);
    assert!(info.affine.determinant() > 0.0);
    // Each slice must lie where its own header says, and hold its own pixels.
    let mut out = vec![0; 512 * 512 * 2];
    for entry in fs::read_dir(&folder).unwrap() {
        let file = File::open(entry.unwrap().path()).unwrap();
        let header = scan(&file).unwrap();
        let position = header.position.unwrap();
        let z = info.affine.inverse().unwrap().apply(position);
        close(z[0], 0.0, 1e-3);
        close(z[1], 0.0, 1e-3);
        close(z[2], z[2].round(), 1e-3);
        let slice = (0..28_u32).find(|i| (f64::from(*i) - z[2]).abs() < 0.5).unwrap();
        source.read_rows(slice, 0..512, 0..512, &mut out).unwrap();
        let mut stored = vec![0; out.len()];
        file.read_exact_at(&mut stored, header.pixels.unwrap().offset).unwrap();
        Image::of(&header).unwrap().layout.decode(&mut stored);
        assert!(stored == out, "slice {z:?}");
    }
}

#[test]
fn regular_series_open_and_the_largest_of_several_is_taken() {
    for (item, dims, spacing) in [
        ("mr-sag-35", [256, 256, 35], [1.016, 1.016, 4.8]),
        ("mr-mixed-folder", [256, 256, 24], [0.898, 0.898, 6.0]),
        ("ct-short/tilt-4", [512, 512, 4], [0.418, 0.418, 5.0]),
        ("mr-encodings/explicit-le", [256, 256, 4], [1.0, 1.0, 1.0]),
        ("mr-encodings/implicit-le", [256, 256, 4], [1.0, 1.0, 1.0]),
        ("mr-mag-phase-4", [768, 768, 2], [0.299, 0.299, 1.0]),
    ] {
        let Some(folder) = real_data(item) else { continue };
        let source = open(&[folder], &infobyte::source::OpenOptions::default())
            .unwrap_or_else(|e| panic!("{item}: {e}"));
        let info = source.info();
        println!(
            "{item}: {} {} {:?} {:?} {:?}",
            info.dims, info.scalar, info.spacing_mm, info.rescale, info.warnings
        );
        assert_eq!(info.dims.to_array(), dims, "{item}");
        for (got, expected) in info.spacing_mm.into_iter().zip(spacing) {
            close(got, expected, 1e-2);
        }
        assert!(info.affine.determinant() > 0.0, "{item}");
        let warned = info.warnings.join("\n");
        let (low, high) = range_of(source.as_ref());
        match item {
            "mr-mixed-folder" => {
                assert!(warned.contains("4 sets of images") && (low, high) == (0, 780), "{warned}")
            }
            "mr-sag-35" => assert_eq!((low, high), (0, 1948)),
            "mr-mag-phase-4" => assert!(warned.contains("2 sets of images"), "{warned}"),
            "ct-short/tilt-4" => assert!(warned.contains("gantry tilt") && high == 254, "{warned}"),
            _ => assert_eq!((low, high), (0, 254), "{item}"),
        }
    }
}

#[test]
fn series_that_form_no_volume_are_refused_with_the_reason() {
    for (item, wanted) in [
        ("ct-ge-tilt-irregular", &["13 x 4.002", "13 x 6.999", "1 x 1.081"][..]),
        ("ct-short/uneven-5-5-10mm", &["1 slice(s) seem to be missing", "2 x 5.000", "1 x 10.000"]),
        ("ct-short/tilt-missing-slice", &["1 slice(s) seem to be missing"]),
        ("ct-short/same-position-4", &["all 4 images are at one position"]),
        ("raw-cthead", &["no volume is among the 113 file(s)", "--dims"]),
        ("raw-lidc-u8/lidc2_256x256x133_u8.raw", &["headerless", "--dims", "--dtype"]),
        ("mesh/bunny-open.ply", &["is a PLY mesh"]),
        ("mesh", &["no volume is among the 5 file(s)"]),
    ] {
        let Some(path) = real_data(item) else { continue };
        let error = open_error(path);
        println!("{error}");
        for part in wanted {
            assert!(error.contains(part), "{item}: {part} is not in: {error}");
        }
    }
}

/// One word for what a file is, as this reader sees it.
fn classify(path: &Path) -> String {
    let header = match scan(&File::open(path).unwrap()) {
        Ok(header) => header,
        Err(ScanError::NotDicom) => return "no DICOM".into(),
        Err(ScanError::Damaged { damage, .. }) => return format!("damaged: {damage}"),
        Err(e) => panic!("{e}"),
    };
    match Image::of(&header) {
        Ok(image) => {
            let way = if image.access == Access::Unrolled { ", unrolled" } else { "" };
            let note = image.note().map(|text| format!("; {text}")).unwrap_or_default();
            let layout = image.layout;
            let syntax = &header.transfer_syntax;
            format!("{}x{} {}, {syntax}{way}{note}", layout.columns, layout.rows, layout.scalar())
        }
        Err(obstacle) => obstacle.to_string(),
    }
}

#[test]
fn every_odd_file_is_classified() {
    let Some(root) = real_data("dicom-odd") else { return };
    let mut table = String::new();
    let mut names: Vec<_> = fs::read_dir(&root).unwrap().map(|e| e.unwrap().path()).collect();
    names.extend(fs::read_dir(root.join("../dicom-ct-15-syntaxes")).unwrap().map(|e| e.unwrap().path()));
    names.sort();
    for path in &names {
        let _ = writeln!(table, "{}\t{}", path.file_name().unwrap().display(), classify(path));
    }
    println!("{table}");
    for (name, wanted) in [
        ("bad-frame-count.dcm", "the number of frames is not a positive number"),
        ("bad-sequence-jpeg-lossless.dcm", "512x512 u16, JPEG lossless, first-order prediction, unrolled"),
        ("cr-mono1-no-preamble.dcm", "440x440 u16, implicit little-endian"),
        ("deflated-8bit.dcm", "512x512 u8, deflated, unrolled"),
        ("dicomdir", "DICOMDIR without pixels"),
        ("explicit-un-j2k.dcm", "512x512 i16, JPEG 2000 lossless, unrolled"),
        ("float-pixels.dcm", "128x128 f32, explicit little-endian"),
        ("htj2k-rgb.dcm", "640x480 u8, HTJ2K lossless, unrolled; colour is reduced to luminance"),
        ("j2k-cut-short-no-pixels.dcm", "64x64 u16, JPEG 2000 lossless, unrolled"),
        ("j2k-sign-mismatch.dcm", "512x512 i16, JPEG 2000 lossless, unrolled"),
        ("jpegls-near-16.dcm", "10x50 u16, JPEG-LS near-lossless, unrolled"),
        ("meta-missing-syntax.dcm", "there are 2 bytes of pixel data, but no image description"),
        (
            "modality-lut.dcm",
            "512x512 u16, explicit little-endian, unrolled; values went through the modality LUT",
        ),
        ("no-meta-header.dcm", "no DICOM"),
        ("no-pixel-spacing.dcm", "800x600 u16, RLE lossless, unrolled; palette colours"),
        ("padded-pixels.dcm", "64x64 i16"),
        ("palette-colour.dcm", "800x350 u16, explicit little-endian, unrolled; palette colours"),
        ("rgb-odd-length.dcm", "3x3 u8, explicit little-endian, unrolled; colour is reduced to luminance"),
        ("rtplan-truncated-no-image.dcm", "damaged: "),
        ("seg-1bit.dcm", "512x512 u8, explicit little-endian, unrolled"),
        ("signed16-full-range.dcm", "512x512 i16, explicit little-endian"),
        ("truncated-pixels.dcm", "the pixels are cut short: 8130 bytes of 8192"),
        ("deflated.dcm", "512x512 i16, deflated, unrolled"),
        ("explicit-be.dcm", "512x512 i16, explicit big-endian"),
        ("explicit-le.dcm", "512x512 i16, explicit little-endian"),
        ("implicit-le.dcm", "512x512 i16, implicit little-endian"),
        ("j2k-90.dcm", "512x512 i16, JPEG 2000 lossless, unrolled"),
        ("jpeg-extended-51.dcm", "512x512 u16, JPEG extended 12-bit, unrolled"),
        ("rle.dcm", "512x512 i16, RLE lossless, unrolled"),
    ] {
        let line = table.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix('\t')).unwrap();
        assert!(line.starts_with(wanted), "{name}: {line}");
    }
}
