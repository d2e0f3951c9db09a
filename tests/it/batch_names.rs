//! What a batch calls its results: names follow the content of the input, so that what is done stays done wherever
//! it lies. If this fails, models take the places of others, or are built again and again.

use crate::batch::counts;
use crate::prelude::*;

fn object() -> Object {
    Object::new([6, 5, 4], ScalarType::I16, [1.0; 3])
}

/// A series of three slices of 2x2 voxels, `at` apart.
fn series(folder: &Path, uid: &str, patient: [&str; 3], at: f64) {
    fs::create_dir_all(folder).unwrap();
    for i in 0..3 {
        let mut image = Elements::ct(f64::from(i) * at, i + 1, [2900, 20, 2900, 20]);
        image.set(0x0020_000e, "UI", uid).set(0x0010_0010, "PN", patient[0]);
        image.set(0x0010_0020, "LO", patient[1]).set(0x0010_0030, "DA", patient[2]);
        fs::write(folder.join(format!("{i}.dcm")), image.bytes()).unwrap();
    }
}

fn batch(top: &Path, out: &Path, extra: &[&str]) -> (command::Run, Value) {
    let iso: &[&str] = if extra.contains(&"--iso") { &[] } else { &["--iso", "500"] };
    let run = oct(&[&["batch", &text(top), "--out", &text(out)], iso, extra].concat());
    let report = fs::read(out.join("report.json")).unwrap_or_else(|e| panic!("{e}: {run:?}"));
    (run, serde_json::from_slice(&report).unwrap())
}

#[test]
fn names_follow_content_wherever_it_lies_and_whatever_it_is_called() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let studies = folder.path().join("a/studies");
    file(&studies.join("one"), "scan.nrrd", &nrrd(&object(), "raw", false, ""));
    file(&studies, "scan.npy", &npy(&object(), 1, false, false));
    assert_eq!(counts(&batch(&studies, &out, &[]).1), [2, 0, 0]);
    let before = names(&out);
    let moved = folder.path().join("b/deeper/others");
    fs::create_dir_all(moved.parent().unwrap()).unwrap();
    fs::rename(&studies, &moved).unwrap();
    assert_eq!(counts(&batch(&moved, &out, &[]).1), [0, 2, 0]);
    // From within.
    let here = Command::new(binary())
        .args(["batch", ".", "--surface", "skin", "--iso", "500", "--json", "--out", &text(&out)])
        .current_dir(&moved)
        .output()
        .unwrap();
    let report: Value = serde_json::from_slice(&here.stdout).unwrap_or_else(|e| panic!("{e}: {here:?}"));
    assert_eq!(counts(&report), [0, 2, 0], "{report}");
    // Under other names it is built again, into the same files.
    fs::rename(moved.join("scan.npy"), moved.join("renamed.npy")).unwrap();
    assert_eq!(counts(&batch(&moved, &out, &[]).1), [1, 1, 0]);
    assert_eq!(names(&out), before);
    // Another content of the same name does not replace it.
    let other = folder.path().join("more");
    file(&other, "scan.npy", &npy(&Object::new([5, 5, 5], ScalarType::I16, [1.0; 3]), 1, false, false));
    assert_eq!(counts(&batch(&other, &out, &[]).1), [1, 0, 0]);
    assert_eq!(names(&out).iter().filter(|name| name.ends_with(".oct")).count(), 3);
    assert_eq!(counts(&batch(&moved, &out, &[]).1), [0, 2, 0]);
}

#[test]
fn copies_are_converted_once_and_what_differs_out_of_sight_is_numbered() {
    let folder = tempfile::tempdir().unwrap();
    let (top, out) = (folder.path().join("in"), folder.path().join("out"));
    let object = Object::new([100, 100, 100], ScalarType::U8, [1.0; 3]);
    let bytes = nrrd(&object, "raw", false, "");
    for name in ["a.nrrd", "b/copy.nrrd", "z.nrrd"] {
        let path = top.join(name);
        file(path.parent().unwrap(), &path.file_name().unwrap().to_string_lossy(), &bytes);
    }
    // 256 KiB of a million bytes are looked at: of these flips one at least is not.
    let hidden = (500_000..600_000)
        .step_by(1000)
        .map(|at| {
            let mut other = bytes.clone();
            other[at] ^= 1;
            other
        })
        .find(|other| {
            let probe = folder.path().join("probe");
            file(&probe, "x.nrrd", other);
            let id = |path: &Path| oct(&["scan", &text(path), "--json"]).json()["items"][0]["name"].clone();
            id(&probe) == id(&top.join("a.nrrd"))
        })
        .expect("a place that is not looked at");
    file(&top, "m.nrrd", &hidden);
    for jobs in ["1", "4"] {
        let _ = fs::remove_dir_all(&out);
        let (run, report) = batch(&top, &out, &["--iso", "10", "--jobs", jobs]);
        assert_eq!((run.code, counts(&report)), (0, [2, 2, 0]), "{report}");
        let item = |end: &str| {
            let items = report["items"].as_array().unwrap();
            items.iter().find(|i| i["input"].as_str().unwrap().ends_with(end)).unwrap().clone()
        };
        let id = item("/a.nrrd")["name"].as_str().unwrap().to_owned();
        assert!(id.starts_with("nrrd-") && id.len() == 17, "{id}");
        for copy in ["copy.nrrd", "z.nrrd"] {
            let copy = item(copy);
            assert_eq!(
                (&copy["status"], &copy["cause"]["copy_of"]),
                (&json!("skipped"), &json!(id)),
                "{copy}"
            );
        }
        let numbered = item("m.nrrd");
        assert_eq!(
            (&numbered["status"], &numbered["name"]),
            (&json!("converted"), &json!(format!("{id}-n2")))
        );
        assert!(
            numbered["warnings"].to_string().contains("this is number 2 of the volumes with this id"),
            "{numbered}"
        );
        assert_eq!(counts(&batch(&top, &out, &["--iso", "10"]).1), [0, 4, 0]);
    }
}

#[test]
fn two_batches_do_not_write_into_one_folder_and_a_killed_one_leaves_no_lock() {
    let folder = tempfile::tempdir().unwrap();
    let (top, out) = (folder.path().join("in"), folder.path().join("out"));
    for i in 0..40 {
        let object = Object::new([6, 5, 4 + i], ScalarType::I16, [1.0; 3]);
        file(&top, &format!("{i}.nrrd"), &nrrd(&object, "raw", false, ""));
    }
    // One that takes seconds, all of it a hole of its file, so that a batch cannot end before it is held.
    let slow = file(
        &top,
        "slow.nrrd",
        b"NRRD0004\ntype: short\ndimension: 3\nsizes: 1024 1024 1024\nencoding: raw\nendian: little\n\n",
    );
    let bytes = fs::metadata(&slow).unwrap().len() + (2 << 30);
    fs::OpenOptions::new().write(true).open(&slow).unwrap().set_len(bytes).unwrap();
    let lock = out.join(".oct-lock");
    let args = ["batch", &text(&top), "--out", &text(&out), "--iso", "500", "--quiet"];
    // The file is there a moment before it is locked; whatever else is in the folder comes after the lock.
    let works = || lock.exists() && fs::read_dir(&out).is_ok_and(|entries| entries.count() > 1);
    // One that is held in the middle of its work.
    let mut child = (0..20)
        .find_map(|_| {
            let _ = fs::remove_dir_all(&out);
            let mut child = Command::new(binary()).args(args).stdin(Stdio::null()).spawn().unwrap();
            while !works() && child.try_wait().unwrap().is_none() {
                std::thread::yield_now();
            }
            let held = Command::new("kill").args(["-STOP", &child.id().to_string()]).status().unwrap();
            if held.success() && works() {
                return Some(child);
            }
            let _ = child.kill();
            child.wait().unwrap();
            None
        })
        .expect("none of 20 batches could be held while it worked");
    oct(&args).refused(5, &["out", "another batch", "wait until it has finished", "--out"]);
    fs::remove_file(&slow).unwrap();
    // Another folder is free.
    let free = folder.path().join("free");
    assert_eq!(oct(&["batch", &text(&top), "--out", &text(&free), "--quiet"]).code, 0);
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(lock.exists(), "a killed batch leaves the file, which means nothing");
    let (run, report) = batch(&top, &out, &[]);
    let [converted, skipped, failed] = counts(&report);
    assert_eq!((run.code, converted + skipped, failed), (0, 40, 0), "{report}");
    assert!(!lock.exists());
}

#[test]
fn volumes_of_few_slices_are_left_alone_when_asked_to() {
    let folder = tempfile::tempdir().unwrap();
    let (top, out) = (folder.path().join("in"), folder.path().join("out"));
    series(&top.join("ct"), "1.2.3.1", ["", "", ""], 1.0);
    // Two images at one position: refused, and no volume worth explaining.
    series(&top.join("bad"), "1.2.3.2", ["", "", ""], 0.0);
    fs::remove_file(top.join("bad/2.dcm")).unwrap();
    let one = Elements::ct(0.0, 1, [2900, 20, 2900, 20]).with(0x0020_000e, "UI", "1.2.3.3");
    file(&top.join("scout"), "1.dcm", &one.bytes());
    let (run, all) = batch(&top, &out, &[]);
    assert_eq!((run.code, counts(&all)), (8, [2, 0, 1]), "{all}");
    let models = names(&out);
    let (run, some) = batch(&top, &out, &["--min-slices", "3"]);
    assert_eq!((run.code, counts(&some)), (0, [0, 3, 0]), "{some}");
    let items = some["items"].as_array().unwrap();
    let left: Vec<&Value> = items.iter().filter(|item| item["model"].is_null()).collect();
    assert_eq!(left.len(), 2, "{some}");
    for item in left {
        let (status, reason) = (item["status"].as_str().unwrap(), item["reason"].as_str().unwrap());
        assert!(status == "skipped" && reason.contains("fewer than --min-slices 3"), "{item}");
        assert!(fs::read_to_string(out.join("report.csv")).unwrap().contains(reason));
        assert!(fs::read_to_string(out.join("index.html")).unwrap().contains("fewer slices than asked for"));
    }
    assert_eq!(names(&out), models, "what an earlier run made stays");
    // No voxel is as dense: the same input with other options fails, and what was built before is not lost.
    let old: Vec<_> =
        models.iter().filter(|n| n.ends_with(".oct")).map(|n| fs::read(out.join(n)).unwrap()).collect();
    let (run, failed) = batch(&top, &out, &["--iso", "1e9"]);
    assert_eq!((run.code, counts(&failed)), (8, [0, 0, 3]), "{failed}");
    assert_eq!(names(&out), models, "a build that failed leaves the old files");
    let now: Vec<_> =
        models.iter().filter(|n| n.ends_with(".oct")).map(|n| fs::read(out.join(n)).unwrap()).collect();
    assert_eq!(old, now);
    assert_eq!(failed["holds"]["models"], 2, "{failed}");
    let kept = |report: &Value| {
        let items = report["items"].as_array().unwrap().iter();
        items
            .filter(|item| item["status"] == "kept")
            .map(|item| item["input"].to_string())
            .collect::<Vec<_>>()
    };
    assert_eq!(kept(&failed).len(), 2, "{failed}");
    // Reports go on telling of what earlier runs made, once each, however often others are built.
    fs::rename(top.join("scout"), folder.path().join("scout")).unwrap();
    for _ in 0..2 {
        let (_, again) = batch(&top, &out, &["--min-slices", "3"]);
        assert_eq!(counts(&again), [0, 2, 0], "{again}");
        let told = kept(&again);
        assert!(told.len() == 1 && told[0].contains("scout"), "{again}");
        assert!(fs::read_to_string(out.join("report.csv")).unwrap().contains("yes,kept,"));
    }
    let scout = again_without(&out, &top, &models);
    assert!(kept(&scout).is_empty(), "{scout}");
    oct(&["batch", &text(&top), "--out", &text(&out), "--min-slices", "0"]).refused(2, &["--min-slices"]);
}

/// The report of a run after the models of earlier runs were taken out of the folder.
fn again_without(out: &Path, top: &Path, models: &[String]) -> Value {
    for name in models.iter().filter(|name| name.contains(".oct")) {
        fs::remove_file(out.join(name)).unwrap();
    }
    batch(top, out, &["--min-slices", "3"]).1
}
