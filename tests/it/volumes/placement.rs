//! Spacing and directions that a file does not state can be stated for it, on the command line and in a side-car;
//! what a file does state is replaced only with a warning that tells both. If this fails, stacks of pictures are
//! shown squeezed, or the geometry of a scanner is overwritten in silence.

use crate::prelude::*;

const STEP: [f64; 3] = [0.5, 0.25, 2.0];

fn object() -> Object {
    Object::new([12, 9, 7], ScalarType::U16, STEP)
}

/// Builds beside the input and gives back the report, with the affine that the model states.
fn built(input: &Path, extra: &[&str]) -> Value {
    let model = text(&input.with_file_name("model.oct"));
    let build = oct(&[&["build", &text(input), "-o", &model, "--iso", "100", "--json"], extra].concat());
    let mut report = build.json();
    report["affine"] = oct(&["info", &model, "--json"]).json()["affine"].clone();
    report
}

/// The warnings that speak of spacing or directions.
fn said(report: &Value) -> Vec<String> {
    let all = report["warnings"].as_array().unwrap().iter().map(|w| w.as_str().unwrap().to_owned());
    all.filter(|w| ["spacing", "directions", "orientation", " mm"].iter().any(|s| w.contains(s))).collect()
}

#[test]
fn what_nothing_states_is_taken_from_the_command_line_in_silence() {
    let folder = tempfile::tempdir().unwrap();
    let array = file(folder.path(), "a.npy", &npy(&object(), 1, false, false));
    let turned = file(folder.path(), "f.npy", &npy(&object(), 1, false, true));
    let pictures = folder.path().join("pictures");
    pngs(&object(), &pictures);
    let pages = file(folder.path(), "a.tif", &Tiff::default().write(&object()));
    for input in [&array, &turned, &pictures, &pages] {
        let plain = built(input, &[]);
        assert_eq!(plain["spacing_mm"], json!([1.0, 1.0, 1.0]));
        assert_eq!(said(&plain).len(), 2, "{plain}");
        let placed = built(input, &["--spacing", "0.5x0.25x2", "--orientation", "LPI"]);
        assert_eq!(placed["spacing_mm"], json!(STEP), "{placed}");
        let third = |row: usize| placed["affine"][row][2].as_f64().unwrap();
        assert_eq!([third(0), third(1), third(2)], [0.0, 0.0, -2.0], "{placed}");
        assert_eq!(said(&placed), Vec::<String>::new());
        let half = built(input, &["--spacing", "0.5,0.25,2"]);
        assert!(matches!(said(&half).as_slice(), [only] if only.contains("directions")), "{half}");
    }
}

#[test]
fn what_a_file_states_is_replaced_with_both_figures_and_tilt_stays() {
    let folder = tempfile::tempdir().unwrap();
    let series = folder.path().join("series");
    fs::create_dir(&series).unwrap();
    let values: Vec<u32> = (0..64).map(|i| if i % 8 < 4 { 1500 } else { 20 }).collect();
    for z in 0..5_u32 {
        // Slices that are shifted along y as a tilted gantry shifts them.
        let at = f64::from(z);
        let image = Image {
            instance: z + 1,
            position: [-7.0, 3.0 + 0.5 * at, 2.0 * at],
            size: [8, 8],
            values: &values,
            ..Image::default()
        };
        fs::write(series.join(format!("{z}.dcm")), image.bytes()).unwrap();
    }
    let run = |extra: &[&str]| built(&series, extra);
    let stated = run(&[]);
    let number = |report: &Value, row: usize, column: usize| report["affine"][row][column].as_f64().unwrap();
    let long = 4.25_f64.sqrt();
    assert!((number(&stated, 1, 2) - 0.5).abs() < 1e-9, "{stated}");
    let placed = run(&["--spacing", "1x1x3"]);
    assert_eq!(placed["spacing_mm"], json!([1.0, 1.0, 3.0]));
    for row in 0..3 {
        let old = number(&stated, row, 2) / long;
        assert!((number(&placed, row, 2) / 3.0 - old).abs() < 1e-9, "the tilt stays: {placed}");
        assert_eq!(number(&placed, row, 3), number(&stated, row, 3), "and so does the first voxel");
    }
    let both =
        |w: &String| w.contains("--spacing gives 1 x 1 x 3 mm") && w.contains("states 0.5 x 0.75 x 2.06");
    assert!(said(&placed).iter().any(both), "{placed}");
    let turned = run(&["--orientation", "LPI"]);
    assert!(said(&turned).iter().any(|w| w.contains("LPI") && w.contains("LPS")), "{turned}");
    let same = run(&["--orientation", "LPS"]);
    assert_eq!(same["affine"], stated["affine"]);

    // A header that states it, and a raw file that a side-car describes.
    let header = file(folder.path(), "v.nrrd", &nrrd(&object(), "raw", false, ""));
    assert!(said(&built(&header, &["--spacing", "0.5x0.25x2"])).is_empty());
    let other = built(&header, &["--spacing", "0.5x0.25x1"]);
    assert!(said(&other).iter().any(|w| w.contains("states 0.5 x 0.25 x 2 mm")), "{other}");
    let raw = file(folder.path(), "r.raw", &object().ordered(false));
    let describe = |more: &str| {
        let text = format!(r#"{{"dims": [12, 9, 7], "dtype": "u16"{more}}}"#);
        fs::write(folder.path().join("r.json"), text).unwrap();
    };
    describe("");
    let placed = built(&raw, &["--spacing", "0.5x0.25x2"]);
    assert_eq!((placed["spacing_mm"].clone(), said(&placed).len()), (json!(STEP), 0), "{placed}");
    describe(r#", "spacing": [1, 1, 3]"#);
    let placed = built(&raw, &["--spacing", "0.5x0.25x2"]);
    assert!(placed["spacing_mm"] == json!(STEP) && said(&placed)[0].contains("1 x 1 x 3 mm"), "{placed}");
    // Where voxels begin is told of raw files only.
    oct(&["build", &text(&header), "-o", "x.oct", "--skip", "3"]).refused(2, &["--skip"]);
}

#[test]
fn side_cars_place_stacks_and_arrays_of_a_batch() {
    let folder = tempfile::tempdir().unwrap();
    let (top, out) = (folder.path().join("in"), folder.path().join("out"));
    let at = |name: &str| top.join(name);
    // Copies would be converted once.
    let thick = |more: u32| Object::new([12, 9, 7 + more], ScalarType::U16, [1.0; 3]);
    pngs(&thick(0), &at("beside"));
    pngs(&thick(1), &at("inside"));
    pngs(&thick(2), &at("named"));
    pngs(&thick(3), &at("none"));
    pngs(&thick(4), &at("wrong"));
    file(&top, "a.npy", &npy(&object(), 1, false, false));
    file(&top, "b.tif", &Tiff::default().write(&object()));
    let says = r#"{"spacing": [0.5, 0.25, 2], "orientation": "LPI"}"#;
    for name in ["beside.json", "inside/stack.json", "named/named.json", "a.json"] {
        fs::write(at(name), says).unwrap();
    }
    fs::write(at("b.tif.toml"), "spacing_mm = '0.5x0.25x2'\norientation = 'LPI'\nnotes = 1\n").unwrap();
    fs::write(at("wrong.json"), r#"{"spacing": [0.5, 0, 2]}"#).unwrap();
    // Neither describes anything.
    fs::write(at("lonely.json"), says).unwrap();
    fs::write(at("none.json"), r#"{"Modality": "CT"}"#).unwrap();
    let run = || {
        let run = oct(&["batch", &text(&top), "--out", &text(&out), "--iso", "1000", "--json"]);
        assert_eq!(run.code, 8, "{run:?}");
        serde_json::from_str::<Value>(&run.stdout).unwrap()
    };
    let report = run();
    assert_eq!((&report["converted"], &report["failed"]), (&json!(6), &json!(1)), "{report}");
    let find = |report: &Value, name: &str| {
        let items = report["items"].as_array().unwrap();
        items.iter().find(|i| i["input"].as_str().unwrap().starts_with(&text(&at(name)))).unwrap().clone()
    };
    for name in ["beside", "inside", "named", "a.npy", "b.tif"] {
        let item = find(&report, name);
        assert_eq!(item["model"]["spacing_mm"], json!(STEP), "{item}");
        let expected = usize::from(name == "b.tif");
        assert_eq!(item["warnings"].as_array().unwrap().len(), expected, "{item}");
    }
    assert!(find(&report, "b.tif")["warnings"][0].as_str().unwrap().contains("notes"));
    assert_eq!(find(&report, "none")["model"]["spacing_mm"], json!([1.0, 1.0, 1.0]));
    let reason = find(&report, "wrong")["reason"].as_str().unwrap().to_owned();
    assert!(reason.contains("wrong.json") && reason.contains("three positive numbers"), "{reason}");
    let left = &report["left_out"];
    assert_eq!((left[0]["count"].clone(), left.as_array().unwrap().len()), (json!(2), 1), "{left}");
    // A side-car is a part of its volume: what it says anew is built anew.
    assert_eq!(run()["skipped"], json!(6));
    fs::write(at("inside/stack.json"), r#"{"spacing": [0.5, 0.25, 2.5]}"#).unwrap();
    let again = run();
    assert_eq!((&again["converted"], &again["skipped"]), (&json!(1), &json!(5)), "{again}");
    assert_eq!(find(&again, "inside")["model"]["spacing_mm"], json!([0.5, 0.25, 2.5]));
    // One that was meant, and cannot be parsed, is told.
    fs::write(at("named/named.json"), r#"{"spacing": [0.5, 0.25 2]}"#).unwrap();
    let left = run()["left_out"].to_string();
    assert!(left.contains("side-car that cannot be parsed") && left.contains("named.json"), "{left}");
}
