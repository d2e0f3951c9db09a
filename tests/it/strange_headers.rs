//! What a header says is used, refused or told as what it is, never taken for something else: numbers that are none,
//! tables that are empty, pictures whose parts are tiles, lists of pictures that lie anywhere. If this fails, a
//! volume has the wrong place, the wrong values, or slices that never lay side by side, with exit code 0.

use crate::prelude::*;
use infobyte::discovery::open_unprepared;

/// Opens what lies in a folder: its notes, or why it is refused.
fn opened(folder: &Path) -> Result<Vec<String>, String> {
    open_unprepared(&[folder.to_path_buf()], &OpenOptions::default())
        .map(|volume| sentences(&volume.info().notes))
        .map_err(|error| error.to_string())
}

fn files(images: &[Vec<u8>]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (at, bytes) in images.iter().enumerate() {
        fs::write(folder.path().join(format!("{at}.dcm")), bytes).unwrap();
    }
    folder
}

/// Four slices, the third of which is made otherwise.
fn series(other: impl Fn(&mut Elements)) -> tempfile::TempDir {
    let image = |at: i32| {
        let mut image = Elements::ct(f64::from(at) * 2.5, at + 1, [1, 2, 3, 4]);
        if at == 2 {
            other(&mut image);
        }
        image.bytes()
    };
    files(&(0..4).map(image).collect::<Vec<_>>())
}

#[test]
fn numbers_of_dicom_that_are_none_are_not_missing() {
    assert_eq!(opened(series(|_| {}).path()), Ok(vec![]));
    for (tag, value, name) in [
        (0x0020_0032, "nan\\inf\\5", "Image Position (0020,0032)"),
        (0x0020_0032, "0\\0\\1e999", "Image Position (0020,0032)"),
        (0x0020_0037, "1\\0\\0\\0\\nan\\0", "Image Orientation (0020,0037)"),
        (0x0028_0030, "inf\\0.5", "Pixel Spacing (0028,0030)"),
        (0x0028_1053, "inf", "Rescale Slope"),
        (0x0028_1052, "-inf", "Rescale Slope and Intercept"),
        (0x0018_0050, "NaN", "Slice Thickness (0018,0050)"),
        (0x0018_0088, "nan", "Spacing Between Slices (0018,0088)"),
    ] {
        let one = series(|image| {
            image.set(tag, "DS", value);
        });
        let refused = opened(one.path()).unwrap_err();
        assert!(refused.contains(name) && refused.contains("not a number"), "{value}: {refused}");
        // All of them alike, which would be a series without positions.
        let all: Vec<Vec<u8>> = (0..4)
            .map(|at| Elements::ct(f64::from(at), at + 1, [1; 4]).set(tag, "DS", value).bytes())
            .collect();
        let refused = opened(files(&all).path()).unwrap_err();
        assert!(refused.contains(name), "{value}: {refused}");
    }
}

/// A sequence of one item that holds these elements.
fn sequence(elements: &[(u32, &'static str, &[u8])]) -> Vec<u8> {
    let mut inner = Writer::bare(Syntax::ExplicitLe);
    for (tag, vr, value) in elements {
        inner.element(*tag, vr, value);
    }
    let mut item = Writer::bare(Syntax::ExplicitLe);
    item.element(0xfffe_e000, "", &inner.bytes);
    item.bytes
}

#[test]
fn an_empty_modality_lut_changes_nothing() {
    let all = |value: &[u8]| {
        let image = |at: i32| {
            let mut image = Elements::ct(f64::from(at) * 2.5, at + 1, [1, 2, 3, 4]);
            image.raw(0x0028_3000, "SQ", value);
            image.bytes()
        };
        files(&(0..3).map(image).collect::<Vec<_>>())
    };
    let explained = sequence(&[(0x0028_3003, "LO", b"none")]);
    for empty in [&[][..], &sequence(&[]), &explained] {
        let folder = all(empty);
        let volume = open_unprepared(&[folder.path().to_path_buf()], &OpenOptions::default()).unwrap();
        assert_eq!((volume.info().rescale.slope, volume.info().rescale.intercept), (1.0, -1024.0));
        assert_eq!(sentences(&volume.info().notes), Vec::<String>::new());
    }
    // Half a table is not an empty one.
    let half = sequence(&[(0x0028_3002, "US", &[2, 0, 0, 0, 16, 0])]);
    let folder = all(&half);
    let mut volume = open_unprepared(&[folder.path().to_path_buf()], &OpenOptions::default()).unwrap();
    let memory = infobyte::budget::Budget::new(1 << 20);
    let progress = &infobyte::progress::Silent;
    let workspace = infobyte::volume::Workspace { scratch: folder.path(), memory, progress };
    assert!(volume.prepare(&workspace).is_err());
}

#[test]
fn tiles_of_a_picture_are_not_stacked() {
    // A whole slide: several frames, each a tile.
    let frames = |image: &mut Elements| {
        image.set(0x0028_0008, "IS", "3").raw(0x7fe0_0010, "OW", &[1; 24]);
        image.set(0x0018_0088, "DS", "1");
    };
    let slide = |tag: u32, vr: &'static str, value: &[u8]| {
        let mut image = Elements::ct(0.0, 1, [0; 4]);
        frames(&mut image);
        image.raw(tag, vr, value);
        opened(files(&[image.bytes()]).path())
    };
    for refused in [
        slide(0x0008_0016, "UI", b"1.2.840.10008.5.1.4.1.1.77.1.6\0\0"),
        slide(0x0020_9311, "CS", b"TILED_FULL"),
        slide(0x0020_9311, "CS", b"TILED_SPARSE"),
        slide(0x0048_0006, "UL", &[6, 0, 0, 0]),
        slide(0x0048_0007, "UL", &[4, 0, 0, 0]),
    ] {
        let refused = refused.unwrap_err();
        assert!(refused.contains("tiles of a larger picture"), "{refused}");
    }
    assert!(slide(0x0048_0006, "UL", &[2, 0, 0, 0]).is_ok(), "one tile is the whole picture");
    // A frame set of another vendor than Siemens: by the image type, or by the private sequence.
    let picture = || mosaic(4, [4, 3], "1\\0\\0\\0\\1\\0", &["0", "0", "1"], &|k, _, _| k);
    let mut named = picture();
    named.set(0x0008_0008, "CS", "ORIGINAL\\PRIMARY\\M\\VFRAME");
    let mut listed = picture();
    listed.set(0x0008_0008, "CS", "ORIGINAL\\PRIMARY\\M").set(0x0065_0010, "LO", "Image Private Header");
    listed.raw(0x0065_1051, "SQ", &sequence(&[(0x0020_0032, "DS", b"0\\0\\0 ")]));
    for image in [named, listed] {
        let refused = opened(files(&[image.bytes()]).path()).unwrap_err();
        assert!(refused.contains("frame set of United Imaging"), "{refused}");
    }
}

fn header(name: &str, head: &str, samples: usize) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    let mut bytes = head.as_bytes().to_vec();
    bytes.extend((0..samples).map(|i| u8::try_from(i % 251).unwrap()));
    fs::write(&path, bytes).unwrap();
    (folder, path)
}

#[test]
fn free_hand_sweeps_are_not_stacked() {
    let transform = "Seq_Frame0000_ProbeToTrackerTransform";
    let mha = |axes: usize, sizes: &str, extra: &str| {
        let head = format!(
            "ObjectType = Image\nNDims = {axes}\nDimSize = {sizes}\nElementType = MET_UCHAR\n{extra}ElementDataFile = LOCAL\n"
        );
        let (_folder, path) = header("sweep.mha", &head, 4 * 3 * 5 * 2);
        open_unprepared(&[path], &OpenOptions::default()).map(|_| ()).map_err(|e| e.to_string())
    };
    let nrrd = |axes: usize, sizes: &str, extra: &str| {
        let head = format!(
            "NRRD0004\ntype: uchar\ndimension: {axes}\nsizes: {sizes}\nencoding: raw\nspacings: 1 1 1{}\n{extra}\n",
            if axes == 4 { " nan" } else { "" }
        );
        let (_folder, path) = header("sweep.nrrd", &head, 4 * 3 * 5 * 2);
        open_unprepared(&[path], &OpenOptions::default()).map(|_| ()).map_err(|e| e.to_string())
    };
    for refused in [
        mha(3, "4 3 10", "Kinds = domain domain list\nSeq_Frame0000_Timestamp = 1\n"),
        mha(3, "4 3 10", &format!("{transform} = 1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1\n{transform}Status = OK\n")),
        nrrd(3, "4 3 10", "kinds: domain domain list\n"),
    ] {
        let refused = refused.unwrap_err();
        assert!(refused.contains("free-hand sweep"), "{refused}");
    }
    // A list of volumes is read as volumes.
    assert_eq!(mha(3, "4 3 10", ""), Ok(()));
    // So are volumes that were reconstructed of pictures: they keep the kind of the axis, and no frame has a field.
    assert_eq!(mha(3, "4 3 10", "Kinds = domain domain list\n"), Ok(()));
    assert_eq!(mha(4, "4 3 5 2", "Kinds = domain domain domain list\n"), Ok(()));
    assert_eq!(nrrd(4, "4 3 5 2", "kinds: domain domain domain list\n"), Ok(()));
}

/// A NIfTI-1 file of 4 x 3 x 5 bytes, with singles at these offsets.
fn nifti(singles: &[(usize, f32)], forms: [i16; 2]) -> Result<Vec<String>, String> {
    let mut head = vec![0; 352];
    let mut put = |at: usize, bytes: &[u8]| head[at..at + bytes.len()].copy_from_slice(bytes);
    put(0, &348_i32.to_le_bytes());
    for (at, n) in [3_i16, 4, 3, 5, 1, 1, 1, 1].into_iter().enumerate() {
        put(40 + 2 * at, &n.to_le_bytes());
    }
    put(70, &2_i16.to_le_bytes());
    put(72, &8_i16.to_le_bytes());
    for at in 0..4 {
        put(76 + 4 * at, &1_f32.to_le_bytes());
    }
    put(108, &352_f32.to_le_bytes());
    put(112, &1_f32.to_le_bytes());
    put(123, &[2]);
    put(252, &forms[0].to_le_bytes());
    put(254, &forms[1].to_le_bytes());
    for axis in 0..3 {
        put(280 + 20 * axis, &1_f32.to_le_bytes());
    }
    put(344, b"n+1\0");
    for (at, value) in singles {
        put(*at, &value.to_le_bytes());
    }
    head.extend([7; 60]);
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("a.nii"), head).unwrap();
    opened(folder.path())
}

#[test]
fn numbers_of_other_headers_that_are_none_are_refused_or_told() {
    assert_eq!(nifti(&[], [0, 1]), Ok(vec![]));
    for (slope, intercept) in
        [(f32::INFINITY, 0.0), (f32::NEG_INFINITY, 0.0), (1.0, f32::INFINITY), (2.0, f32::NAN)]
    {
        let refused = nifti(&[(112, slope), (116, intercept)], [0, 1]).unwrap_err();
        assert!(refused.contains("give no values"), "{slope} {intercept}: {refused}");
    }
    let told = |singles: &[(usize, f32)], forms| nifti(singles, forms).unwrap().join("; ");
    assert!(told(&[(112, f32::NAN), (116, f32::NAN)], [0, 1]).contains("a slope of NaN"));
    assert!(
        told(&[(280, f32::NAN)], [0, 1]).contains("the sform of the header has numbers that are not finite")
    );
    assert!(
        told(&[(256, f32::NAN)], [1, 0]).contains("the qform of the header has numbers that are not finite")
    );
    let spacing = told(&[(88, f32::INFINITY)], [0, 0]);
    assert!(spacing.contains("a spacing of inf along axis 3; 1 mm is assumed"), "{spacing}");

    let nrrd = |extra: &str| {
        let head = format!("NRRD0004\ntype: uchar\ndimension: 3\nsizes: 4 3 5\nencoding: raw\n{extra}\n");
        let (folder, _) = header("a.nrrd", &head, 60);
        opened(folder.path())
    };
    let told = nrrd("spacings: 1 nan 2\n").unwrap().join("; ");
    assert!(told.contains("a spacing of NaN along axis 2; 1 mm is assumed"), "{told}");
    assert!(!told.contains("states no spacing"), "{told}");
    let refused = nrrd("space: LPS\nspace directions: (1,0,0) (0,inf,0) (0,0,1)\n").unwrap_err();
    assert!(refused.contains("no numbers"), "{refused}");
    for absurd in ["1e300 1e-300 1", "1e-9 1 10"] {
        let refused = nrrd(&format!("spacings: {absurd}\n")).unwrap_err();
        assert!(refused.contains("correct spacing"), "{refused}");
    }
}

/// Builds raw singles.
fn build(folder: &Path, singles: &[f32], extra: &[&str]) -> (Run, PathBuf) {
    let raw = folder.join("a.raw");
    fs::write(&raw, singles.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>()).unwrap();
    let model = folder.join("m.oct");
    let run = command::build(&[raw], &model, &[&["--dims", "6x5x4", "--dtype", "f32"], extra].concat());
    (run, model)
}

#[test]
fn what_a_threshold_does_to_the_whole_volume_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let mut ball: Vec<f32> = (0..120).map(|i| if i % 7 == 3 { 9.0 } else { 1.0 }).collect();
    let (run, model) = build(folder.path(), &ball, &["--iso", "5"]);
    assert!(run.code == 0 && !run.stdout.contains("note:"), "{run:?}");
    // All.
    let (run, _) = build(folder.path(), &ball, &["--iso", "0.5"]);
    assert!(run.stdout.contains("note: all 120 voxels are inside"), "{run:?}");
    let (run, _) = build(folder.path(), &ball, &["--iso", "0.5", "--json", "--connectivity", "6"]);
    assert!(run.json()["warnings"].to_string().contains("all 120 voxels are inside"), "{run:?}");
    // Nothing.
    build(folder.path(), &ball, &["--iso", "10"]).0.refused(3, &["9", "--iso"]);
    // Values near the largest double are cut as all others are.
    let huge: Vec<f64> = ball.iter().map(|value| if *value > 5.0 { 1e308 } else { -1e308 }).collect();
    let at = folder.path().join("huge.raw");
    fs::write(&at, huge.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<_>>()).unwrap();
    let count = |surface: &str, how: &[&str]| {
        let model = folder.path().join("huge.oct");
        let all = ["--dims", "6x5x4", "--dtype", "f64", "--surface", surface];
        let run = command::build(&[&at], &model, &[&all[..], how].concat());
        assert_eq!(run.code, 0, "{run:?}");
        run.stdout.split(' ').nth(1).unwrap().to_owned()
    };
    for how in [
        &["--iso", "5"][..],
        &["--iso", "1e308"],
        &["--iso=-9.9e307"],
        &["--otsu"],
        &["--range", "0..1.5e308"],
    ] {
        assert_eq!(count("skin", how), "17", "{how:?}");
        assert_eq!(count("cells", how), count("cells", &["--iso", "0"]), "{how:?}");
    }
    // NaN: anywhere, and in doubles, too.
    for at in [0, 61, 119] {
        let old = std::mem::replace(&mut ball[at], f32::NAN);
        for range in [&["--iso", "5"][..], &["--range", "5..10"]] {
            let (run, _) = build(folder.path(), &ball, range);
            assert!(run.stdout.contains("not numbers (NaN)"), "{at}: {run:?}");
        }
        ball[at] = old;
    }
    // A picture without the model.
    assert_eq!(build(folder.path(), &ball, &["--iso", "5"]).0.code, 0);
    let picture = text(&folder.path().join("p.png"));
    let model = text(&model);
    let away = ["--eye", "0,-100,0", "--look-at", "0,-200,0"];
    let all = |more: &[&str]| {
        oct(&[&["render", model.as_str(), "-o", &picture, "--size", "8x8"][..], more].concat())
    };
    let run = all(&away);
    assert!(run.code == 0 && run.stdout.contains("no ray meets the model"), "{run:?}");
    let told = all(&[&away[..], &["--json"]].concat()).json();
    assert_eq!(told["hits"], 0);
    assert!(told["warnings"][0].as_str().is_some_and(|w| w.contains("no ray meets the model")), "{told}");
    assert_eq!(all(&["--json"]).json()["warnings"], serde_json::json!([]));
    let run = all(&[]);
    assert!(run.code == 0 && !run.stdout.contains("note:"), "{run:?}");
}

#[test]
fn a_spacing_that_no_picture_can_be_made_of_is_refused_where_it_is_given() {
    let folder = tempfile::tempdir().unwrap();
    let ball: Vec<f32> = (0..120).map(|i| if i % 7 == 3 { 9.0 } else { 1.0 }).collect();
    for absurd in
        ["1e300x1e-300x1", "1e-6x1x1e4", "1e-20x1e-20x1e-20", "infx1x1", "nanx1x1", "1e16x1e16x1e16"]
    {
        let (run, model) = build(folder.path(), &ball, &["--iso", "5", "--spacing", absurd]);
        run.refused(2, &[absurd, "is not a spacing in mm"]);
        assert!(!model.exists());
    }
    // What is accepted can be shown.
    for odd in ["1e-15x1e-15x1e-15", "1e15x1e15x1e15", "1e-6x1x900", "1e-4x1e-4x9e4"] {
        let (run, model) = build(folder.path(), &ball, &["--iso", "5", "--spacing", odd]);
        assert_eq!(run.code, 0, "{odd}: {run:?}");
        let picture = text(&folder.path().join("p.png"));
        let run = oct(&["render", &text(&model), "-o", &picture, "--size", "16x16", "--view", "iso"]);
        assert_eq!(run.code, 0, "{odd}: {run:?}");
        assert_eq!(oct(&["selfcheck", &text(&model), "--rays", "200"]).code, 0, "{odd}");
    }
}

/// Text in UTF-16, low byte first, with its mark.
fn wide(text: &[u8]) -> Vec<u8> {
    let units = text.iter().flat_map(|byte| [*byte, 0]);
    [0xff, 0xfe].into_iter().chain(units).collect()
}

#[test]
fn a_byte_order_mark_changes_no_header_and_utf_16_is_named() {
    let headers = [
        (
            "a.mhd",
            "ObjectType = Image\nNDims = 3\nDimSize = 2 2 2\nElementType = MET_UCHAR\nElementDataFile = a.raw\n",
        ),
        (
            "a.nhdr",
            "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 2 2 2\nencoding: raw\nspacings: 1 1 1\ndata file: a.raw\n",
        ),
        (
            "a.vgi",
            "{volume1}\n[representation]\nsize = 2 2 2\ndatatype = unsigned integer\nbitsperelement = 8\n[file1]\n\
             name = a.raw\n{volumeprimitive1}\n[geometry]\nresolution = 1 1 1\n",
        ),
        ("a.json", r#"{"dims": [2, 2, 2], "dtype": "u8"}"#),
        ("a.toml", "dims = [2, 2, 2]\ndtype = \"u8\"\n"),
        (
            ".zarray",
            r#"{"zarr_format": 2, "shape": [2, 2, 2], "chunks": [2, 2, 2], "dtype": "|u1", "compressor": null, "fill_value": 0, "order": "C", "filters": null}"#,
        ),
    ];
    let read = |name: &str, header: &[u8]| {
        let folder = tempfile::tempdir().unwrap();
        for data in ["a.raw", "0.0.0"] {
            fs::write(folder.path().join(data), [0, 1, 2, 3, 4, 5, 6, 7]).unwrap();
        }
        fs::write(folder.path().join(name), header).unwrap();
        let input =
            if name.starts_with('.') { folder.path().to_path_buf() } else { folder.path().join(name) };
        let volume = open_unprepared(&[input], &OpenOptions::default()).map_err(|error| error.to_string())?;
        let mut bytes = [0; 8];
        (0..2_u32).for_each(|z| {
            let at = 4 * z as usize;
            volume.read_rows(z, 0..2, 0..2, &mut bytes[at..at + 4]).unwrap();
        });
        Ok::<_, String>(bytes)
    };
    for (name, header) in headers {
        for mark in [&b""[..], b"\xef\xbb\xbf"] {
            let marked = [mark, header.as_bytes()].concat();
            assert_eq!(read(name, &marked), Ok([0, 1, 2, 3, 4, 5, 6, 7]), "{name} {mark:?}");
        }
        let refused = read(name, &wide(header.as_bytes())).unwrap_err();
        assert!(refused.contains("UTF-16"), "{name}: {refused}");
    }
    // Data next to a side-car that cannot be read is not taken for data without one.
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("a.raw");
    fs::write(&data, [0; 8]).unwrap();
    fs::write(folder.path().join("a.json"), wide(headers[3].1.as_bytes())).unwrap();
    let refused = open_unprepared(&[data], &OpenOptions::default()).err().unwrap().to_string();
    assert!(refused.contains("UTF-16"), "{refused}");
}
