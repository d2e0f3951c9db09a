//! Every folder of real DICOM data, and every odd file: which volumes are found, with which size, place and
//! values, and which are refused and why. The figures are those of an independent reader (see README.md and
//! EXPECTED.tsv beside the data).

use crate::prelude::*;
use std::fmt::Write as _;

use infobyte::discovery::open_unprepared as open;
use infobyte::source::dicom::Image;

fn findings(path: PathBuf, gaps: GapPolicy) -> Vec<Finding> {
    let options = OpenOptions { gaps, ..OpenOptions::default() };
    let scratch = tempfile::tempdir().unwrap();
    let found = Catalogue::survey(&[path], &options, scratch.path()).unwrap();
    (0..found.len()).flat_map(|i| found.open(i)).collect()
}

/// Smallest and largest stored value, after unrolling.
fn range_of(source: &mut dyn VolumeSource) -> (i64, i64) {
    let scratch = tempfile::tempdir().unwrap();
    let needs = source.preparation();
    let memory = Budget::new(needs.memory_bytes.max(8 << 20));
    source.prepare(&Workspace { scratch: scratch.path(), memory, progress: &Silent }).unwrap();
    let info = source.info().clone();
    let [nx, ny, nz] = info.dims.to_array();
    let width = info.scalar.bytes();
    let mut out = vec![0; nx as usize * ny as usize * width];
    let (mut low, mut high) = (i64::MAX, i64::MIN);
    for z in 0..nz {
        source.read_rows(z, 0..ny, 0..nx, &mut out).unwrap();
        for sample in out.chunks_exact(width) {
            let value = match info.scalar {
                ScalarType::U8 => sample[0].into(),
                ScalarType::I16 => bytemuck::pod_read_unaligned::<i16>(sample).into(),
                ScalarType::U16 => bytemuck::pod_read_unaligned::<u16>(sample).into(),
                other => panic!("{other}"),
            };
            (low, high) = (low.min(value), high.max(value));
        }
    }
    (low, high)
}

/// Item, part, dims, spacing in mm, stored range (`None`: not compared).
type Row = (&'static str, &'static str, [u32; 3], [f64; 3], Option<(i64, i64)>);

const VOLUMES: &[Row] = &[
    ("ct-philips-28", "", [512, 512, 28], [0.451, 0.451, 5.0], None),
    ("ct-short/tilt-4", "", [512, 512, 4], [0.418, 0.418, 5.0], Some((0, 254))),
    ("mr-sag-35", "", [256, 256, 35], [1.016, 1.016, 4.8], Some((0, 1948))),
    ("mr-mixed-folder", "", [512, 512, 2], [0.449, 0.449, 6.0], Some((0, 730))),
    ("mr-mixed-folder", "", [512, 512, 2], [0.469, 0.469, 6.0], Some((0, 357))),
    ("mr-mixed-folder", "", [512, 512, 2], [0.469, 0.469, 12.0], Some((0, 819))),
    ("mr-mixed-folder", "", [256, 256, 24], [0.898, 0.898, 6.0], Some((0, 780))),
    ("mr-mag-phase-4", "magnitude", [768, 768, 2], [0.299, 0.299, 1.0], Some((0, 254))),
    ("mr-mag-phase-4", "phase", [768, 768, 2], [0.299, 0.299, 1.0], Some((0, 254))),
    ("mr-encodings/explicit-le", "", [256, 256, 4], [1.0, 1.0, 1.0], Some((0, 254))),
    ("mr-encodings/implicit-le", "", [256, 256, 4], [1.0, 1.0, 1.0], Some((0, 254))),
    ("mr-encodings/j2k-lossless", "", [256, 256, 4], [1.0, 1.0, 1.0], Some((0, 254))),
    ("mr-encodings/jpeg-lossless", "", [256, 256, 4], [1.0, 1.0, 1.0], Some((0, 254))),
    ("mr-encodings/jpeg-ls", "", [256, 256, 4], [1.0, 1.0, 1.0], Some((0, 254))),
    ("mr-encodings/rle", "", [256, 256, 4], [1.0, 1.0, 1.0], Some((0, 254))),
    ("ct-j2k-2", "", [512, 512, 2], [0.488, 0.488, 1.0], None),
    ("multiframe/ct-enhanced-2f.dcm", "", [512, 512, 2], [0.389, 0.389, 10.0], Some((0, 1196))),
    ("multiframe/mr-xa30-t1-96f.dcm", "", [128, 128, 96], [2.0, 2.0, 2.0], Some((0, 2927))),
    ("multiframe/emri-10f.dcm", "", [64, 64, 10], [0.0; 3], Some((0, 467))),
    ("multiframe/emri-10f-rle.dcm", "", [64, 64, 10], [0.0; 3], Some((0, 467))),
    ("multiframe/emri-10f-bigendian.dcm", "", [64, 64, 10], [0.0; 3], Some((0, 467))),
    ("multiframe/emri-10f-jpegls.dcm", "", [64, 64, 10], [0.0; 3], Some((0, 467))),
    ("multiframe/ct-2f-fragmented-no-bot-jpeg12.dcm", "", [512, 512, 2], [0.0; 3], Some((1010, 2223))),
];

/// Where the last voxel lies, in LPS mm, by the positions and orientations that pydicom reads.
const LAST_CORNERS: &[(&str, u32, [f64; 3])] = &[
    ("ct-j2k-2", 2, [158.7559, -39.2441, -230.0]),
    ("ct-short/tilt-4", 4, [106.791, -49.3811, -98.6221]),
    ("mr-mixed-folder", 24, [120.7349, 124.9686, 87.0219]),
    ("mr-sag-35", 35, [-81.6, 128.9844, -128.9844]),
    ("multiframe/ct-enhanced-2f.dcm", 2, [-99.1114, -102.8886, -159.0]),
    ("multiframe/mr-xa30-t1-96f.dcm", 96, [-100.424, 97.906, -140.776]),
];

#[test]
fn every_volume_has_the_size_place_and_values_of_another_reader() {
    let mut item = ("", Vec::new());
    let mut compared = 0;
    for (name, part, dims, spacing, range) in VOLUMES {
        if item.0 != *name {
            assert!(item.1.is_empty(), "{}: more than expected: {:?}", item.0, item.1);
            let Some(path) = real_data(name) else { continue };
            item = (name, findings(path, GapPolicy::Error));
        }
        assert!(!item.1.is_empty(), "{name}: fewer than expected");
        let finding = item.1.remove(0);
        println!("{name}: {finding:?}");
        assert_eq!(
            (finding.part.as_deref().unwrap_or_default(), finding.size),
            (*part, Some(*dims)),
            "{name}"
        );
        let subject = finding.subject.unwrap_or_else(|e| panic!("{name}: {e}"));
        let mut volume = subject.into_volume().unwrap();
        let info = volume.info().clone();
        assert_eq!(info.dims.to_array(), *dims, "{name}");
        assert!(info.affine.determinant() > 0.0, "{name}");
        for (got, expected) in info.spacing_mm.into_iter().zip(spacing) {
            assert!(*expected == 0.0 || (got - expected).abs() < 1e-2, "{name}: {:?}", info.spacing_mm);
        }
        let last = info.affine.apply(dims.map(|n| f64::from(n - 1)));
        for (_, _, expected) in LAST_CORNERS.iter().filter(|(n, nz, _)| n == name && *nz == dims[2]) {
            assert!(last.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-3), "{name}: {last:?}");
        }
        if let Some(range) = range {
            assert_eq!(range_of(&mut *volume), *range, "{name}");
        }
        assert!(
            !finding.id.contains("IM-") && info.description.to_string().starts_with(&finding.kind),
            "{name}"
        );
        compared += 1;
    }
    assert!(compared == 0 || compared == VOLUMES.len());
}

#[test]
fn a_head_ct_is_ordered_by_position_with_its_spacing_and_rescale() {
    let Some(folder) = real_data("ct-philips-28") else { return };
    let source = open(std::slice::from_ref(&folder), &OpenOptions::default()).unwrap();
    let info = source.info();
    assert_eq!(info.scalar, ScalarType::U16);
    assert_eq!((info.rescale.slope, info.rescale.intercept), (1.0, -1024.0));
    for (got, expected) in info.spacing_mm.into_iter().zip([0.451, 0.451, 5.0]) {
        assert!((got - expected).abs() < 5e-4, "{got} is not {expected}");
    }
    assert!(info.affine.determinant() > 0.0);
    // Each slice must lie where its own header says, and hold its own pixels.
    let mut out = vec![0; 512 * 512 * 2];
    for entry in fs::read_dir(&folder).unwrap() {
        let file = File::open(entry.unwrap().path()).unwrap();
        let header = scan(&file).unwrap();
        let position = header.position.unwrap();
        let z = info.affine.inverse().unwrap().apply(position);
        assert!([z[0], z[1], z[2] - z[2].round()].iter().all(|off| off.abs() <= 1e-3), "{z:?}");
        let slice = (0..28_u32).find(|i| (f64::from(*i) - z[2]).abs() < 0.5).unwrap();
        source.read_rows(slice, 0..512, 0..512, &mut out).unwrap();
        let mut stored = vec![0; out.len()];
        file.read_exact_at(&mut stored, header.pixels.unwrap().offset).unwrap();
        Image::of(&header).unwrap().layout.decode(&mut stored);
        assert!(stored == out, "slice {z:?}");
    }
}

#[test]
fn of_several_volumes_the_largest_is_opened_with_a_warning() {
    for (item, dims, words) in [
        ("mr-mixed-folder", [256, 256, 24], "4 sets of images"),
        ("mr-mag-phase-4", [768, 768, 2], "2 sets of images"),
        ("ct-short/tilt-4", [512, 512, 4], "gantry tilt"),
    ] {
        let Some(folder) = real_data(item) else { continue };
        let source = open(&[folder], &OpenOptions::default()).unwrap_or_else(|e| panic!("{item}: {e}"));
        let warned = sentences(&source.info().notes).join("\n");
        assert_eq!(source.info().dims.to_array(), dims, "{item}");
        assert!(warned.contains(words), "{item}: {warned}");
    }
}

#[test]
fn what_is_no_volume_is_refused_with_the_reason() {
    for (item, wanted) in [
        ("raw-cthead", &["no volume is among 113 files", "add dims"][..]),
        ("raw-lidc-u8/lidc2_256x256x133_u8.raw", &["headerless", "dims", "scalar"]),
        ("mesh/bunny-open.ply", &["is a PLY mesh"]),
        ("mesh", &["no volume is among 5 files"]),
    ] {
        let Some(path) = real_data(item) else { continue };
        let error = open(&[path], &OpenOptions::default()).unwrap_err().to_string();
        for part in wanted {
            assert!(error.contains(part), "{item}: {part} is not in: {error}");
        }
    }
}

#[test]
fn gaps_of_real_series_are_refused_filled_or_kept() {
    // Slices and step when filled, and when kept.
    for (item, words, filled, kept) in [
        ("ct-ge-tilt-irregular", "13 x 4.002, 13 x 6.999, 1 x 1.081", (37, 4.2203), (28, 5.6270)),
        ("ct-short/uneven-5-5-10mm", "probably missing: 1 slice in", (5, 5.0), (4, 6.6667)),
        ("ct-short/tilt-missing-slice", "probably missing: 1 slice in", (5, 0.7780), (4, 1.0373)),
    ] {
        let Some(path) = real_data(item) else { continue };
        let one = |gaps| findings(path.clone(), gaps).pop().unwrap().subject;
        let error = one(GapPolicy::Error).unwrap_err().to_string();
        assert!(error.contains(words), "{item}: {error}");
        for (policy, (slices, step)) in [(GapPolicy::Fill, filled), (GapPolicy::Keep, kept)] {
            let mut volume = one(policy).unwrap().into_volume().unwrap();
            let info = volume.info().clone();
            println!("{item} {policy:?}: {} {:?} {:?}", info.dims, info.spacing_mm, sentences(&info.notes));
            assert_eq!(info.dims.nz(), slices, "{item}");
            assert!((info.spacing_mm[2] - step).abs() < 1e-3, "{item}: {:?}", info.spacing_mm);
            range_of(&mut *volume);
        }
    }
    let Some(path) = real_data("ct-short/same-position-4") else { return };
    for policy in [GapPolicy::Error, GapPolicy::Fill, GapPolicy::Keep] {
        let error = findings(path.clone(), policy).pop().unwrap().subject.unwrap_err().to_string();
        assert!(error.contains("all 4 images are at one position"), "{error}");
    }
}

#[test]
fn fifteen_copies_of_one_slice_are_one_slice() {
    let Some(path) = real_data("dicom-ct-15-syntaxes") else { return };
    let found = findings(path, GapPolicy::Error);
    for finding in &found {
        println!("{finding:?}");
    }
    // Nine lossless files of one instance; six lossy ones, which are derived images of other bits or values.
    let whole: Vec<&Finding> = found.iter().filter(|f| f.files.count == 1 && f.subject.is_ok()).collect();
    assert!(whole.iter().any(|f| f.subject.as_ref().ok().and_then(|s| s.volume()).is_some_and(|v| {
        sentences(&v.info().notes)
            .iter()
            .any(|w| w.contains("8 images left out for being in the series twice"))
    })));
}

#[test]
fn odd_files_are_opened_or_refused_by_name() {
    for (name, expected) in [
        ("bad-frame-count.dcm", Err("Number of Frames (0028,0008)")),
        ("bad-sequence-jpeg-lossless.dcm", Ok([512, 512, 1])),
        ("cr-mono1-no-preamble.dcm", Ok([440, 440, 1])),
        ("deflated-8bit.dcm", Ok([512, 512, 1])),
        ("explicit-un-j2k.dcm", Ok([512, 512, 1])),
        ("float-pixels.dcm", Ok([128, 128, 1])),
        ("j2k-sign-mismatch.dcm", Ok([512, 512, 1])),
        ("jpegls-near-16.dcm", Ok([10, 50, 1])),
        ("modality-lut.dcm", Ok([512, 512, 1])),
        ("padded-pixels.dcm", Ok([64, 64, 1])),
        ("palette-colour.dcm", Ok([800, 350, 1])),
        ("rgb-odd-length.dcm", Ok([3, 3, 1])),
        ("rtplan-truncated-no-image.dcm", Err("is a damaged DICOM file")),
        ("seg-1bit.dcm", Ok([512, 512, 1])),
        ("signed16-full-range.dcm", Ok([512, 512, 1])),
        ("truncated-pixels.dcm", Err("the pixels are cut short: 8130 bytes of 8192")),
    ] {
        let Some(path) = real_data(&format!("dicom-odd/{name}")) else { return };
        let mut found = findings(path, GapPolicy::Error);
        assert_eq!(found.len(), 1, "{name}");
        match (found.pop().unwrap().subject, expected) {
            (Ok(subject), Ok(dims)) => {
                assert_eq!(subject.volume().unwrap().info().dims.to_array(), dims, "{name}")
            }
            (Err(error), Err(words)) => assert!(error.to_string().contains(words), "{name}: {error}"),
            (got, expected) => panic!("{name}: {got:?}, not {expected:?}"),
        }
    }
    for (name, reason) in [("dicomdir", "DICOMDIR without pixels"), ("no-meta-header.dcm", "not a volume")] {
        let Some(path) = real_data(&format!("dicom-odd/{name}")) else { return };
        let scratch = tempfile::tempdir().unwrap();
        let found = Catalogue::survey(&[path], &OpenOptions::default(), scratch.path()).unwrap();
        assert!(found.is_empty() && found.left_out()[0].why.to_string() == reason, "{:?}", found.left_out());
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
        ("bad-frame-count.dcm", "its Number of Frames (0028,0008) is `1A`, which is not a positive number"),
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
