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
        (0x0028_1052, "n/a", "Rescale Slope and Intercept"),
        (0x0028_1053, "one", "Rescale Slope and Intercept"),
        (0x0028_1053, "1\\1", "Rescale Slope and Intercept"),
        (0x0028_0030, "0.5", "Pixel Spacing (0028,0030)"),
        (0x0020_0032, "0\\0\\1\\1", "Image Position (0020,0032)"),
        (0x0020_0032, "1,0,0", "Image Position (0020,0032)"),
        (0x0020_0013, "two", "Instance Number (0020,0013)"),
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
    let both = nrrd("space: LPS\nspace directions: (3,4,0) (0,2,0) (0,0,1)\nspacings: 5.001 nan 1\n");
    assert!(both.is_ok(), "{both:?}");
    let refused = nrrd("space: LPS\nspace directions: (1,0,0) (0,inf,0) (0,0,1)\n").unwrap_err();
    assert!(refused.contains("no numbers"), "{refused}");
    let refused = nrrd("spacings: 1 1 0\n").unwrap_err();
    assert!(refused.contains("a spacing of 0 along axis 3"), "{refused}");
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

#[test]
fn a_decimal_comma_of_dicom_is_a_point_and_what_a_screen_needs_refuses_nothing() {
    let all = |edit: &dyn Fn(&mut Elements, i32)| {
        let image = |at: i32| {
            let mut image = Elements::ct(f64::from(at) * 2.5, at + 1, [1, 2, 3, 4]);
            edit(&mut image, at);
            image.bytes()
        };
        let folder = files(&(0..4).map(image).collect::<Vec<_>>());
        open_unprepared(&[folder.path().to_path_buf()], &OpenOptions::default()).unwrap().info().clone()
    };
    let intercept = all(&|image, _| _ = image.set(0x0028_1052, "DS", "-1024,5"));
    assert_eq!(intercept.rescale.intercept, -1024.5);
    let spacing = all(&|image, _| _ = image.set(0x0028_0030, "DS", "0,75\\,5"));
    assert_eq!(spacing.spacing_mm, [0.5, 0.75, 2.5]);
    let position = all(&|image, at| _ = image.set(0x0020_0032, "DS", &format!("-10,5\\-20\\{at},25")));
    assert_eq!([0, 1, 2].map(|row| position.affine.rows[row][3]), [-10.5, -20.0, 0.25]);
    for info in [intercept, spacing, position] {
        let notes = sentences(&info.notes).join("; ");
        assert!(notes.contains("decimal commas of the"), "{notes}");
    }
    let flat = sentences(&all(&|image, _| _ = image.set(0x0028_0030, "DS", "0\\1")).notes).join("; ");
    assert!(flat.contains("state a pixel spacing of 0 x 1 mm"), "{flat}");
    for window in ["n/a", "40,5", "1\\2\\3", "nan"] {
        let info = all(&|image, _| _ = image.set(0x0028_1050, "DS", window).set(0x0028_1051, "DS", window));
        assert!(info.notes.is_empty(), "{:?}", info.notes);
    }
}

#[test]
fn slices_of_several_formats_are_one_volume_each_as_its_header_says() {
    let value = |volume: &dyn VolumeSource, z: u32| {
        let mut bytes = [0; 16];
        volume.read_rows(z, 0..2, 0..2, &mut bytes).unwrap();
        bytes.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect::<Vec<f32>>()
    };
    let signed = |image: &mut Elements| {
        let values = [-3_i16, 2, 3, 4].iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
        image.us(0x0028_0103, 1).raw(0x7fe0_0010, "OW", &values);
    };
    let bytes = |image: &mut Elements| {
        for (tag, bits) in [(0x0028_0100, 8), (0x0028_0101, 8), (0x0028_0102, 7)] {
            image.us(tag, bits);
        }
        image.raw(0x7fe0_0010, "OB", &[250, 2, 3, 4]);
    };
    let inverse = |image: &mut Elements| _ = image.set(0x0028_0004, "CS", "MONOCHROME1");
    type Case<'a> = (&'a dyn Fn(&mut Elements), f32, bool);
    let cases: [Case<'_>; 3] = [(&signed, -1027.0, true), (&bytes, -774.0, true), (&inverse, -1023.0, false)];
    for (edit, first, differs) in cases {
        let folder = series(edit);
        let volume = open_unprepared(&[folder.path().to_path_buf()], &OpenOptions::default()).unwrap();
        assert_eq!(volume.info().dims.to_array(), [2, 2, 4]);
        if differs {
            assert_eq!(value(&*volume, 2), [first, -1022.0, -1021.0, -1020.0]);
            assert_eq!(value(&*volume, 1), [-1023.0, -1022.0, -1021.0, -1020.0]);
            assert!(sentences(&volume.info().notes).join(";").contains("type of their samples"));
        }
    }
}

#[test]
fn numbers_of_text_headers_that_are_none_or_one_too_many_are_refused_by_name() {
    let mhd = |field: &str, value: &str| {
        let mut fields = [
            ("ObjectType", "Image"),
            ("NDims", "3"),
            ("DimSize", "4 3 5"),
            ("ElementType", "MET_UCHAR"),
            ("ElementSpacing", "1 1 1"),
            ("Offset", "0 0 0"),
            ("TransformMatrix", "1 0 0 0 1 0 0 0 1\nOrientation = 1 0 0 0 1 0 0 0 1"),
            ("BinaryDataByteOrderMSB", "False\nElementByteOrderMSB = False"),
            ("DistanceUnits", "mm"),
        ];
        fields.iter_mut().filter(|(name, _)| *name == field).for_each(|found| found.1 = value);
        let lines: Vec<String> = fields.iter().map(|(name, value)| format!("{name} = {value}\n")).collect();
        format!("{}ElementDataFile = LOCAL\n", lines.concat())
    };
    let nrrd = |field: &str, value: &str| {
        let mut fields = [
            ("type", "uchar"),
            ("dimension", "3"),
            ("sizes", "4 3 5"),
            ("encoding", "raw"),
            ("space", "LPS"),
            ("space directions", "(1,0,0) (0,1,0) (0,0,1)"),
            ("space origin", "(0,0,0)"),
            ("centers", "cell node ???"),
            ("kinds", "domain space ???"),
        ];
        fields.iter_mut().filter(|(name, _)| *name == field).for_each(|found| found.1 = value);
        let lines: Vec<String> = fields.iter().map(|(name, value)| format!("{name}: {value}\n")).collect();
        format!("NRRD0004\n{}\n", lines.concat())
    };
    let vtk = |field: &str, value: &str| {
        let mut fields = [
            ("DIMENSIONS", "4 3 5"),
            ("SPACING", "1 1 1"),
            ("ORIGIN", "0 0 0"),
            ("POINT_DATA", "60"),
            ("SCALARS", "s unsigned_char 1"),
        ];
        fields.iter_mut().filter(|(name, _)| *name == field).for_each(|found| found.1 = value);
        let lines: Vec<String> = fields.iter().map(|(name, value)| format!("{name} {value}\n")).collect();
        format!(
            "# vtk DataFile Version 3.0\nt\nBINARY\nDATASET STRUCTURED_POINTS\n{}LOOKUP_TABLE default\n",
            lines.concat()
        )
    };
    let amira = |field: &str, value: &str| {
        let [mut size, mut bounds] = ["4 3 5", "0 3 0 2 0 4"];
        *(if field == "Lattice" { &mut size } else { &mut bounds }) = value;
        format!(
            "# AmiraMesh BINARY 2.1\ndefine Lattice {size}\nParameters {{\n BoundingBox {bounds},\n CoordType \"uniform\"\n}}\nLattice {{ byte Data }} @1\n@1\n"
        )
    };
    let read = |name: &str, head: &str| {
        let (_folder, path) = header(name, head, 60);
        open_unprepared(&[path], &OpenOptions::default()).map(|_| ()).map_err(|error| error.to_string())
    };
    type Case<'a> = (&'a str, &'a dyn Fn(&str, &str) -> String, &'a [(&'a str, &'a str)]);
    let cases: [Case<'_>; 4] = [
        (
            "a.mha",
            &mhd,
            &[
                ("DimSize", "4 3,0 5"),
                ("DimSize", "4 3 5 1"),
                ("ElementSpacing", "1,5 1 1"),
                ("ElementSpacing", "1 1 1 1"),
                ("ElementSpacing", "n/a 1 1"),
                ("ElementSpacing", ""),
                ("Offset", " "),
                ("ElementSpacing", "1 -1 1"),
                ("ElementSpacing", "1 1 0"),
                ("Offset", "0 0"),
                ("Offset", "0, 0, 0"),
                ("Offset", "0 0 0\nOrigin = 1 0 0"),
                ("NDims", "3 3"),
                ("TransformMatrix", "1 0 0 0 1 0 0 0 1 0"),
                ("TransformMatrix", "1 0 0 0 1 0 0 0 one"),
                ("TransformMatrix", "1 0 0 0 1 0 0 0 1\nRotation = 0 1 0 1 0 0 0 0 1"),
                ("BinaryDataByteOrderMSB", "False\nElementByteOrderMSB = True"),
                ("DistanceUnits", "mm\nDistanceUnits = cm"),
            ],
        ),
        (
            "a.nrrd",
            &nrrd,
            &[
                ("sizes", "4 3.0 5"),
                ("dimension", "three"),
                ("space directions", "(1,5,0,0) (0,1,0) (0,0,1)"),
                ("space directions", "(1,0,0) (0,a,0) (0,0,1)"),
                ("space directions", "(1,0,0) (0,1,0) (0,0,1)\nspacings: 1 2 1"),
                ("space origin", "(0,0,0,0)"),
                ("space origin", "0 0 0"),
                ("space origin", "(0,0,0) (1,1,1)"),
                ("space origin", ""),
                ("centers", "cell nod cell"),
                ("kinds", "domain domian domain"),
            ],
        ),
        (
            "a.vtk",
            &vtk,
            &[
                ("DIMENSIONS", "4 3 5 1"),
                ("SPACING", "1,5 1 1"),
                ("ORIGIN", "0 0"),
                ("SPACING", "1 1 one"),
                ("SPACING", "1 -1 1"),
                ("POINT_DATA", "6o"),
                ("POINT_DATA", "59"),
                ("DIMENSIONS", "4 3 5\nDIMENSIONS 5 3 4"),
                ("SPACING", "1 1 1\nASPECT_RATIO 9 9 9"),
                ("ORIGIN", "0 0 0\nORIGIN 1 0 0"),
            ],
        ),
        (
            "a.am",
            &amira,
            &[
                ("Lattice", "4 3,5 5"),
                ("Lattice", "4 3 5 2"),
                ("Lattice", "4 3 5\ndefine Lattice 4 3 5\ndefine Lattice 5 3 4"),
                ("BoundingBox", "0 3 0 2,5 0 4"),
                ("BoundingBox", "0 3 0 2 0 4 1"),
                ("BoundingBox", "0 3 0 2 0"),
            ],
        ),
    ];
    for (name, write, wrong) in cases {
        assert_eq!(read(name, &write("", "0 3 0 2 0 4")), Ok(()), "{name}");
        for (field, value) in wrong {
            let refused = read(name, &write(field, value)).expect_err(value).to_lowercase();
            let named = refused.contains(&field.to_lowercase()) || refused.contains("a vector in space");
            assert!(named, "{field} {value}: {refused}");
        }
    }
}

/// Sizes and notes of the volumes of a file, and whether the samples of the last volume are these.
fn volumes_of(path: &Path, samples: &[u8]) -> Result<(Vec<[u32; 3]>, String), String> {
    let options = OpenOptions::default();
    let first = open_unprepared(&[path.to_path_buf()], &options).map_err(|error| error.to_string())?;
    let notes = sentences(&first.info().notes).join("; ");
    let (mut sizes, mut read) = (vec![first.info().dims.to_array()], Vec::new());
    let mut number = 1;
    let mut last = first;
    while notes.contains("this is volume 1 of") {
        number += 1;
        let options = OpenOptions { volume: Some(number), ..OpenOptions::default() };
        let Ok(next) = open_unprepared(&[path.to_path_buf()], &options) else { break };
        sizes.push(next.info().dims.to_array());
        last = next;
    }
    let scratch = tempfile::tempdir().unwrap();
    let workspace = infobyte::volume::Workspace {
        scratch: scratch.path(),
        memory: infobyte::budget::Budget::new(64 << 20),
        progress: &infobyte::progress::Silent,
    };
    last.prepare(&workspace).unwrap();
    let [nx, ny, nz] = last.info().dims.to_array();
    for z in 0..nz {
        let mut slice = vec![0; (nx * ny) as usize * last.info().scalar.bytes()];
        last.read_rows(z, 0..ny, 0..nx, &mut slice).unwrap();
        read.extend(slice);
    }
    assert!(samples.is_empty() || read == samples, "{}: {read:?}", path.display());
    Ok((sizes, notes))
}

#[test]
fn what_other_programs_leave_out_or_add_is_read() {
    let object = Object::new([4, 3, 5], ScalarType::U8, [1.0; 3]);
    let whole = [[4, 3, 5]];
    let folder = tempfile::tempdir().unwrap();
    let read = |name: &str, bytes: &[u8], sizes: &[[u32; 3]], note: &str| {
        let found = volumes_of(&file(folder.path(), name, bytes), &object.bytes);
        assert!(
            found.as_ref().is_ok_and(|(s, notes)| s == sizes && notes.contains(note)),
            "{name}: {found:?}"
        );
    };
    let marked = mrc(&object, false);
    let mut unmarked = marked.clone();
    unmarked[208..216].fill(0);
    read("old.mrc", &unmarked, &whole, "no mark (MAP)");
    read("old.map.gz", &gzip(&unmarked), &whole, "no mark (MAP)");
    read("a.map.gz", &gzip(&marked), &whole, "");
    let text = String::from_utf8_lossy(&vtk(&object)).into_owned();
    assert!(text.contains("POINT_DATA"));
    let plain = vtk(&object);
    let at = plain.windows(10).position(|w| w == b"DIMENSIONS").unwrap();
    let field = [
        b"FIELD FieldData 2\nTimeValue 1 1 double\n\x3f\xf8\0\0\0\0\0\0\nCycle 2 1 int\n".as_slice(),
        &[10; 8],
        b"\n",
    ]
    .concat();
    read("field.vtk", &[&plain[..at], &field, &plain[at..]].concat(), &whole, "");
    let head = "NRRD0004\ntype: uchar\ndimension: 3\nsizes: 4 3 5\nencoding: gzip\nspacings: 1 1 1\nbyte skip: -1\n\n";
    let packed = gzip(&[&[7; 100], object.bytes.as_slice()].concat());
    read("skip.nrrd", &[head.as_bytes(), &packed].concat(), &whole, "");
    let plus = "ObjectType = Image\nNDims = 3\nDimSize = 4 3 5\nKinds = domain domain domain\nSeq_Frame0000_ImageStatus = OK\n\
                Seq_Frame0000_ProbeToTrackerTransform = 1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1\nElementType = MET_UCHAR\nElementDataFile = LOCAL\n";
    read("plus.mha", &[plus.as_bytes(), &object.bytes].concat(), &whole, "");
    // Two volumes in one file; the second is the object.
    let two =
        Object { dims: [4, 3, 10], bytes: [vec![0; 60], object.bytes.clone()].concat(), ..object.clone() };
    for (name, description) in [
        ("shaped.tif", r#"{"shape": [2, 5, 3, 4]}"#.to_owned()),
        ("frames.tif", "ImageJ=1.53\nimages=10\nslices=5\nframes=2\n".to_owned()),
        ("ome.tif", "<?xml?><OME><Image><Pixels DimensionOrder=\"XYZCT\" SizeZ=\"5\" SizeC=\"2\" SizeT=\"1\" ></Pixels></Image></OME>".to_owned()),
    ] {
        for contiguous in [false, name == "frames.tif"] {
            let bytes = Tiff { description: description.clone(), contiguous, ..Tiff::default() }.write(&two);
            read(name, &bytes, &[[4, 3, 5], [4, 3, 5]], "this is volume 1 of 2");
        }
    }
    for (description, words) in [
        (r#"{"shape": [3, 5, 3, 4]}"#, "10 pages do not make"),
        (r#"{"shape": [2, 5, 4, 4]}"#, "whose last sides are not those of a page"),
        ("ImageJ=1.53\nimages=10\nslices=5\nframes=2,0\n", "`2,0` for frames"),
        ("ImageJ=1.53\nimages=10\nslices=10\ncf=1\nc0=0\nc1=1\nc2=2\n", "by ImageJ's function 1 (cf)"),
        ("\u{feff}ImageJ=1.53\nimages=10\nslices=5\nframes=3\n", "10 pages do not make"),
        (
            "<OME><Pixels SizeZ=\"20\" SizeC=\"1\" SizeT=\"1\"></Pixels></OME>",
            "10 pages do not make: T 1, C 1, Z 20",
        ),
        ("<OME><Pixels SizeX=\"5\" SizeZ=\"10\"></Pixels></OME>", "states 5 for SizeX, and its pages have 4"),
        ("<OME><Pixels SizeZ=\"10\"><TiffData IFD=\"0\" FirstZ=\"9\"/></Pixels></OME>", "in another order"),
        ("<OME><Pixels SizeZ=\"10\"><TiffData FirstZ=\"3,0\"/></Pixels></OME>", "`3,0` for FirstZ"),
    ] {
        let bytes = Tiff { description: description.to_owned(), ..Tiff::default() }.write(&two);
        let refused = volumes_of(&file(folder.path(), "wrong.tif", &bytes), &[]).unwrap_err();
        assert!(refused.contains(words), "{refused}");
    }
    let metadata = r#"{"zarr_format": 2, "shape": [5, 3, 4], "chunks": [5, 3, 4], "dtype": "|u1", "compressor": null, "fill_value": 9, "order": "C", "filters": null}"#;
    file(folder.path(), "a.zarr/.zarray", metadata.as_bytes());
    let refused = volumes_of(&folder.path().join("a.zarr"), &[]).unwrap_err();
    assert!(
        refused.contains("none of its chunks is there under its name") && refused.contains("0.0.0"),
        "{refused}"
    );
    for fill in ["256", "-1", "\"Infinity\"", "\"NaN\""] {
        let metadata = metadata.replace("fill_value\": 9", &format!("fill_value\": {fill}"));
        file(folder.path(), "fill.zarr/.zarray", metadata.as_bytes());
        let refused = volumes_of(&folder.path().join("fill.zarr"), &[]).unwrap_err();
        assert!(refused.contains("`fill_value`"), "{fill}: {refused}");
    }
    file(folder.path(), "a.zarr/0/0/0", &object.bytes);
    assert_eq!(volumes_of(&folder.path().join("a.zarr"), &object.bytes).unwrap().0, whole);
    for (chunk, words) in [
        ([&object.bytes[..], &[0]].concat(), "61 bytes, and its array states 60"),
        (vec![0; 59], "cut short"),
    ] {
        file(folder.path(), "a.zarr/0/0/0", &chunk);
        let volume = open_unprepared(&[folder.path().join("a.zarr")], &OpenOptions::default()).unwrap();
        let refused = volume.read_rows(0, 0..3, 0..4, &mut [0; 12]).unwrap_err().to_string();
        assert!(refused.contains(words), "{refused}");
    }
}

#[test]
fn frames_with_one_position_are_slices_as_far_apart_as_they_are_thick() {
    for (thickness, step, note) in [
        (Some("2"), 2.0, "by the slice thickness"),
        (None, 1.0, "1 mm is assumed between them"),
        (Some("-2"), 1.0, "1 mm is assumed between them"),
    ] {
        let mut image = Elements::ct(0.0, 1, [0; 4]);
        image.without(0x0018_0050).set(0x0028_0008, "IS", "4");
        thickness.into_iter().for_each(|mm| _ = image.set(0x0018_0050, "DS", mm));
        image.raw(0x7fe0_0010, "OW", &[1; 32]);
        let folder = files(&[image.bytes()]);
        let volume = open_unprepared(&[folder.path().to_path_buf()], &OpenOptions::default()).unwrap();
        let info = volume.info();
        assert_eq!((info.dims.to_array(), info.spacing_mm[2]), ([2, 2, 4], step));
        assert!(sentences(&info.notes).join("; ").contains(note), "{:?}", info.notes);
    }
}
