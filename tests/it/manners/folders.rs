//! What `scan` prints, `batch` does; what `batch` takes; and what both tell.

/// A DICOM series of a ball, its radius in voxels.
pub(crate) fn series(folder: &Path, uid: &str, modality: &str, radius: f64) {
    fs::create_dir_all(folder).unwrap();
    for z in 0..20_u32 {
        let values: Vec<u32> = (0..1024_u32)
            .map(|i| {
                let at = [f64::from(i % 32) - 15.5, f64::from(i / 32) - 15.5, f64::from(z) - 9.5];
                let r = at.iter().map(|c| c * c).sum::<f64>().sqrt();
                if r < radius { 1500 } else { 20 + i % 5 }
            })
            .collect();
        let image = Image {
            series: uid,
            instance: z + 1,
            position: [0.0, 0.0, f64::from(z)],
            size: [32, 32],
            values: &values,
            ..Image::default()
        };
        let mut bytes = image.bytes();
        let stated = b"CS\x02\x00CT";
        let at = bytes.windows(stated.len()).position(|w| w == stated).unwrap() + 4;
        bytes[at..at + 2].copy_from_slice(modality.as_bytes());
        fs::write(folder.join(format!("i{z}.dcm")), bytes).unwrap();
    }
}

/// Two good series, a copy of one, a refused one, a text, an empty file, and raw slices without a side-car.
pub(crate) fn mixed(top: &Path) {
    series(&top.join("a"), "1.2.3.1", "CT", 8.0);
    series(&top.join("b"), "1.2.3.2", "MR", 6.0);
    fs::create_dir(top.join("bad")).unwrap();
    for n in 1..4 {
        let image = Image { series: "1.2.3.4", instance: n, values: &[n, 2, 3, 4], ..Image::default() };
        fs::write(top.join(format!("bad/{n}.dcm")), image.bytes()).unwrap();
    }
    let header = "NRRD0004\ntype: uint16\ndimension: 3\nsizes: 4 4 4\nencoding: raw\nendian: little\nspacings: 1 1 1\n\n";
    let values: Vec<u8> = (0..64_u16).flat_map(|v| (v * 20).to_le_bytes()).collect();
    for name in ["c/one.nrrd", "d/again.nrrd"] {
        fs::create_dir_all(top.join(name).parent().unwrap()).unwrap();
        fs::write(top.join(name), [header.as_bytes(), &values].concat()).unwrap();
    }
    fs::write(top.join("readme.txt"), "nothing").unwrap();
    fs::write(top.join("empty"), "").unwrap();
}

use crate::prelude::*;

fn batch(top: &Path, out: &Path, extra: &[&str]) -> Value {
    let run = oct(&[&["batch", &text(top), "--out", &text(out), "--json"], extra].concat());
    serde_json::from_str(&run.stdout).unwrap_or_else(|e| panic!("{e}: {run:?}"))
}

fn all<'a>(report: &'a Value, key: &str) -> Vec<&'a Value> {
    report["items"].as_array().unwrap().iter().map(|item| &item[key]).collect()
}

#[test]
fn a_scan_names_and_judges_as_a_batch_does_copies_included() {
    let folder = tempfile::tempdir().unwrap();
    let (top, out) = (folder.path().join("in"), folder.path().join("out"));
    mixed(&top);
    // Another volume of the same id: the hash of the content does not look at everything.
    let listed = oct(&["scan", &text(&top), "--json"]).json();
    let done = batch(&top, &out, &[]);
    for key in ["name", "input", "kind", "files"] {
        assert_eq!(all(&listed, key), all(&done, key), "{key}");
    }
    let verdict = |item: &Value| match item["status"].as_str() {
        Some("converted") => (true, false),
        Some("skipped") => (false, true),
        _ => (false, false),
    };
    for (listed, done) in listed["items"].as_array().unwrap().iter().zip(done["items"].as_array().unwrap()) {
        assert_eq!(
            (listed["usable"] == true, listed["copy_of"].is_string()),
            verdict(done),
            "{listed} {done}"
        );
        assert_eq!(listed["reason"], done["reason"], "{listed} {done}");
    }
    assert_eq!((&listed["usable"], &listed["refused"], &listed["copies"]), (&json!(3), &json!(1), &json!(1)));
    assert_eq!(listed["pixels_looked_at"], false);
    let shown = oct(&["scan", &text(&top)]).stdout;
    assert!(shown.contains("only headers were read") && shown.contains("1 skipped as copies"), "{shown}");
    assert!(shown.contains("skipped: is a copy of"), "{shown}");
    // No two rows read the same, whatever lies in one folder.
    for name in all(&listed, "name") {
        assert!(shown.contains(name.as_str().unwrap()), "{name}: {shown}");
    }
}

#[test]
fn files_left_out_are_named_one_by_one_with_their_reasons() {
    let folder = tempfile::tempdir().unwrap();
    let (top, out) = (folder.path().join("in"), folder.path().join("out"));
    mixed(&top);
    fs::write(top.join("a/notes.txt"), "nothing").unwrap();
    let expected = json!([
        { "path": text(&top.join("a/notes.txt")), "reason": "not a volume" },
        { "path": text(&top.join("empty")), "reason": "empty file" },
        { "path": text(&top.join("readme.txt")), "reason": "not a volume" },
    ]);
    assert_eq!(oct(&["scan", &text(&top), "--json"]).json()["left_out_files"], expected);
    assert_eq!(batch(&top, &out, &[])["left_out_files"], expected);
    let table = fs::read_to_string(out.join("report.csv")).unwrap();
    let columns = table.lines().next().unwrap().matches(',').count();
    for file in expected.as_array().unwrap() {
        let (path, reason) = (file["path"].as_str().unwrap(), file["reason"].as_str().unwrap());
        let line = table.lines().find(|line| line.contains(path) && line.contains(reason));
        let line = line.unwrap_or_else(|| panic!("{path} in {table}"));
        assert!(line.starts_with("yes,left_out,") && line.matches(',').count() == columns, "{line}");
    }
}

#[test]
fn a_batch_takes_what_a_build_takes() {
    let folder = tempfile::tempdir().unwrap();
    let (top, out) = (folder.path().join("in"), folder.path().join("out"));
    mixed(&top);
    let count = |report: &Value| ["converted", "skipped", "failed"].map(|key| report[key].as_u64().unwrap());
    let report = batch(
        &top,
        &out,
        &["--modality", "ct", "--lod", "off", "--spacing", "0.5x0.5x2", "--channels", "normal,value"],
    );
    // What is not asked for is not a failure; the refused CT is one.
    assert_eq!(count(&report), [1, 3, 1], "{report}");
    let model = &report["items"][0]["model"];
    assert_eq!(model["spacing_mm"], json!([0.5, 0.5, 2.0]));
    let info = oct(&["info", &text(&out.join(model["file"].as_str().unwrap())), "--json"]).json();
    assert_eq!(info["channels"], json!(["normal", "value"]));
    assert!(info["channel_bytes"].get("normal_lod").is_none(), "{info}");
    let left = &report["items"][1];
    assert_eq!((&left["cause"], &left["model"]), (&json!("not_asked_for"), &Value::Null), "{left}");
    assert!(left["reason"].as_str().unwrap().contains("not of the modalities"), "{left}");
    // By name, or what a name begins with.
    let name = report["items"][1]["name"].as_str().unwrap().to_owned();
    let (start, _) = name.split_once('-').unwrap();
    for wanted in [name.as_str(), start, &format!("nothing,{name}")] {
        let report = batch(&top, &folder.path().join(wanted.replace(',', "_")), &["--series", wanted]);
        assert_eq!(report["converted"], 1, "{wanted}: {report}");
        assert_eq!(report["items"][1]["status"], "converted", "{wanted}: {report}");
    }
    let none = batch(&top, &folder.path().join("none"), &["--series", &name[..name.len() - 1]]);
    assert_eq!(count(&none), [0, 5, 0], "{none}");
    let turned = batch(&top, &folder.path().join("turned"), &["--orientation", "RAI", "--series", "nrrd"]);
    let file = turned["items"].as_array().unwrap().iter().find(|item| item["model"].is_object()).unwrap();
    let file = text(&folder.path().join("turned").join(file["model"]["file"].as_str().unwrap()));
    assert_eq!(oct(&["info", &file, "--json"]).json()["orientation"], "RAI");
}

#[test]
fn the_contact_sheet_tells_how_the_threshold_came_and_what_the_folder_holds() {
    let folder = tempfile::tempdir().unwrap();
    let (top, out) = (folder.path().join("in"), folder.path().join("out"));
    mixed(&top);
    batch(&top, &out, &[]);
    let page = || fs::read_to_string(out.join("index.html")).unwrap();
    for words in ["(Otsu)", "CT image", "holds 3 models", "of the whole process", "copy of"] {
        assert!(page().contains(words), "{words}: {}", page());
    }
    // Another run over a part of it: the page says what is there besides.
    let again = oct(&["batch", &text(&top.join("a")), "--out", &text(&out), "--quiet"]);
    assert!(
        again.stdout.contains("0 converted, 1 skipped") && again.stdout.contains("holds 3 models"),
        "{again:?}"
    );
    assert!(page().contains("holds 3 models"));
    let report: Value = serde_json::from_str(&fs::read_to_string(out.join("report.json")).unwrap()).unwrap();
    let bytes: u64 = names(&out)
        .iter()
        .filter(|name| name.ends_with(".oct"))
        .map(|name| fs::metadata(out.join(name)).unwrap().len())
        .sum();
    assert_eq!(report["holds"], json!({ "models": 3, "thumbnails": 3, "bytes": bytes }));
    let asked = batch(&top, &folder.path().join("asked"), &["--iso", "300", "--series", "ct"]);
    assert_eq!(asked["items"][0]["model"]["selection"], "iso");
    assert!(fs::read_to_string(folder.path().join("asked/index.html")).unwrap().contains("(as asked)"));
    // What a build had in use is part of what its job was granted.
    let model = &report["items"][0]["model"];
    let [used, granted] = ["memory_plan_bytes", "memory_bytes"].map(|key| model[key].as_u64().unwrap());
    assert!(used > 0 && used <= granted, "{model}");
}

#[test]
fn raw_files_that_lack_a_side_car_only_are_told_so_with_the_text_to_write() {
    let folder = tempfile::tempdir().unwrap();
    let top = folder.path().join("in");
    fs::create_dir_all(top.join("stack")).unwrap();
    for z in 0..5 {
        fs::write(top.join(format!("stack/s{z:02}.raw")), vec![7; 32 * 32 * 2]).unwrap();
    }
    fs::write(top.join("notes.txt"), "nothing").unwrap();
    let told = oct(&["scan", &text(&top)]).stdout;
    assert!(
        told.starts_with("0 volumes would be converted, 0 refused: no DICOM,")
            && told.contains("oct help formats"),
        "{told}"
    );
    let listed = oct(&["scan", &text(&top), "--json"]).json();
    let left: Vec<&str> =
        listed["left_out"].as_array().unwrap().iter().map(|l| l["reason"].as_str().unwrap()).collect();
    let told = left.iter().find(|reason| reason.contains("side-car")).unwrap_or_else(|| panic!("{listed}"));
    for words in ["headerless", "dims", "dtype", ".json"] {
        assert!(told.contains(words), "{told}");
    }
    // The text that it tells is understood.
    let example = told.split_once('{').unwrap().1.split_once('}').unwrap().0;
    fs::write(top.join("stack.json"), format!("{{{example}}}").replace("512, 512, 300", "32, 32, 5"))
        .unwrap();
    let listed = oct(&["scan", &text(&top), "--json"]).json();
    assert_eq!(listed["usable"], 1, "{listed}");
}
