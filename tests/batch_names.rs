//! What a batch calls its results: nothing of a patient is in them unless it is asked for, wherever it was found;
//! and a volume keeps its name, so that what is done stays done. If this fails, a shared folder tells whom it shows.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};

use infobyte::volume::ScalarType;
use serde_json::{Value, json};

#[path = "support/command.rs"]
mod command;
#[path = "support/dicom.rs"]
mod dicom;
#[path = "support/formats.rs"]
mod formats;
#[path = "support/volume.rs"]
mod volume;

use command::{binary, names, oct, text};
use dicom::Elements;
use formats::{Object, file, npy, nrrd};

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
    let run = oct(&[&["batch", &text(top), "--out", &text(out), "--iso", "500"], extra].concat());
    let report = fs::read(out.join("report.json")).unwrap_or_else(|e| panic!("{e}: {run:?}"));
    (run, serde_json::from_slice(&report).unwrap())
}

fn counts(report: &Value) -> [u64; 3] {
    ["converted", "skipped", "failed"].map(|key| report[key].as_u64().unwrap())
}

#[test]
fn nothing_of_a_patient_is_in_any_byte_of_any_output() {
    let folder = tempfile::tempdir().unwrap();
    let (top, out) = (folder.path().join("in"), folder.path().join("out"));
    let at = |name: &str| top.join(name);
    let patient = ["Zimmermann^Annegret", "P-471199", "19700102"];
    series(&at("Zimmermann_Annegret/ct"), "1.2.3.1", patient, 1.0);
    // A refused series of somebody else in a folder of the first one's name.
    series(&at("annegret/19700102"), "1.2.3.2", ["Slices^Positions", "one", ""], 0.0);
    // Other files in folders below the patient's, and far away.
    file(&at("Zimmermann_Annegret/derived"), "seg.nrrd", &nrrd(&object(), "raw", false, ""));
    file(&at("Zimmermann_Annegret/derived"), "ZimmermannMask.npy", &npy(&object(), 1, false, false));
    file(&at("other"), "head_1970-01-02_471199.nrrd", &nrrd(&object(), "raw", false, ""));
    file(&at("other"), "annegret-broken.nrrd", b"NRRD0004\n");
    file(&at("other/2.1.1970"), "zimmermann.txt", b"nothing");
    let stacked = at("other/Annegret Zimmermann");
    formats::pngs(&Object::new([6, 5, 4], ScalarType::U16, [1.0; 3]), &stacked);

    let secrets = ["zimmermann", "annegret", "471199", "19700102", "1970-01-02", "2.1.1970"];
    let (run, report) = batch(&top, &out, &[]);
    assert_eq!((run.code, counts(&report)), (8, [5, 0, 2]), "{report}");
    let clean = |what: &str, bytes: &[u8]| {
        let text = String::from_utf8_lossy(bytes).to_lowercase();
        for secret in secrets {
            assert!(!text.contains(secret), "{secret} in {what}");
        }
    };
    clean("stdout", run.stdout.as_bytes());
    clean("stderr", run.stderr.as_bytes());
    for name in names(&out) {
        clean("a name", name.as_bytes());
        clean(&name, &fs::read(out.join(&name)).unwrap());
    }
    let paths: Vec<&str> =
        report["items"].as_array().unwrap().iter().map(|i| i["input"].as_str().unwrap()).collect();
    for path in [
        "[name]_[name]/ct",
        "[name]/[name]",
        "[name]_[name]/derived/seg.nrrd",
        "other/head_[name]_[name].nrrd",
    ] {
        assert!(paths.contains(&path), "{path} in {paths:?}");
    }
    assert_eq!(report["left_out"][0]["first"], "other/[name]/[name].txt");
    let scan = oct(&["scan", &text(&top), "--json"]);
    clean("the scan", scan.stdout.as_bytes());

    // Sentences of our own stay, whatever the patient is called.
    let refused = |item: &&Value| item["status"] == "failed" && item["format"] == "dicom";
    let reason = |report: &Value| {
        let items = report["items"].as_array().unwrap();
        items.iter().find(refused).unwrap()["reason"].as_str().unwrap().to_owned()
    };
    series(&at("annegret/19700102"), "1.2.3.2", ["Nobody", "4711", ""], 0.0);
    let plain = folder.path().join("plain");
    let (_, other) = batch(&top, &plain, &[]);
    assert!(reason(&report).contains("slices") || reason(&report).contains("one position"), "{report}");
    assert_eq!(reason(&report), reason(&other));

    // What is asked for is told, and costs nothing to ask for.
    let (_, kept) = batch(&top, &plain, &["--keep-names"]);
    assert_eq!(counts(&kept), [0, 5, 2], "{kept}");
    assert!(kept.to_string().contains("Zimmermann_Annegret/derived/seg.nrrd"), "{kept}");
    let (_, again) = batch(&top, &plain, &[]);
    assert_eq!(counts(&again), [0, 5, 2], "{again}");
    for name in names(&plain) {
        clean(&name, &fs::read(plain.join(&name)).unwrap());
    }
}

#[test]
fn more_words_than_are_kept_are_told_and_do_not_take_memory() {
    let folder = tempfile::tempdir().unwrap();
    let (top, out) = (folder.path().join("in"), folder.path().join("out"));
    fs::create_dir(&top).unwrap();
    for i in 0..2100 {
        let mut image = Elements::ct(0.0, 1, [2900, 20, 2900, 20]);
        image.set(0x0020_000e, "UI", "1.2.3").set(0x0010_0010, "PN", &format!("Someone{i:05}^Called{i:05}"));
        fs::write(top.join(format!("{i}.dcm")), image.bytes()).unwrap();
    }
    file(&top.join("x"), "Someone00000-Called00000.nrrd", &nrrd(&object(), "raw", false, ""));
    let (_, report) = batch(&top, &out, &["--memory", "16MiB"]);
    assert!(report["warnings"][0].as_str().unwrap().contains("more than 4096 words"), "{report}");
    assert!(report["peak_rss_bytes"].as_u64().unwrap() <= 16 << 20, "{report}");
    let find = |i: &&Value| i["format"] == "nrrd";
    let item = report["items"].as_array().unwrap().iter().find(find).unwrap().clone();
    assert_eq!(item["input"], "x/[name]-Called00000.nrrd", "the longest are masked");
    let (_, kept) = batch(&top, &out, &["--keep-names"]);
    assert_eq!(kept["warnings"], json!([]));
}

#[test]
fn a_moved_folder_keeps_its_names_and_folders_of_two_names_do_not_meet() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let studies = folder.path().join("a/studies");
    file(&studies.join("one"), "scan.nrrd", &nrrd(&object(), "raw", false, ""));
    file(&studies, "scan.npy", &npy(&object(), 1, false, false));
    assert_eq!(counts(&batch(&studies, &out, &[]).1), [2, 0, 0]);
    let before = names(&out);
    let moved = folder.path().join("b/deeper/studies");
    fs::create_dir_all(moved.parent().unwrap()).unwrap();
    fs::rename(&studies, &moved).unwrap();
    assert_eq!(counts(&batch(&moved, &out, &[]).1), [0, 2, 0]);
    // From within, by the name that it has.
    let here = Command::new(binary())
        .args(["batch", ".", "--iso", "500", "--json", "--out", &text(&out)])
        .current_dir(&moved)
        .output()
        .unwrap();
    let report: Value = serde_json::from_slice(&here.stdout).unwrap_or_else(|e| panic!("{e}: {here:?}"));
    assert_eq!(counts(&report), [0, 2, 0], "{report}");
    assert_eq!(names(&out), before);
    // Studies that are searched one after the other often hold files of the same names.
    let other = folder.path().join("others");
    file(&other, "scan.npy", &npy(&Object::new([5, 5, 5], ScalarType::I16, [1.0; 3]), 1, false, false));
    assert_eq!(counts(&batch(&other, &out, &[]).1), [1, 0, 0]);
    assert_eq!(names(&out).iter().filter(|name| name.ends_with(".oct")).count(), 3);
    assert_eq!(counts(&batch(&moved, &out, &[]).1), [0, 2, 0]);
}

#[test]
fn two_batches_do_not_write_into_one_folder_and_a_killed_one_leaves_no_lock() {
    let folder = tempfile::tempdir().unwrap();
    let (top, out) = (folder.path().join("in"), folder.path().join("out"));
    for i in 0..40 {
        file(&top, &format!("{i}.nrrd"), &nrrd(&object(), "raw", false, ""));
    }
    let lock = out.join(".oct-lock");
    let args = ["batch", &text(&top), "--out", &text(&out), "--iso", "500", "--quiet"];
    // One that is held in the middle of its work.
    let mut child = (0..20)
        .find_map(|_| {
            let _ = fs::remove_dir_all(&out);
            let mut child = Command::new(binary()).args(args).stdin(Stdio::null()).spawn().unwrap();
            while !lock.exists() && child.try_wait().unwrap().is_none() {
                std::thread::yield_now();
            }
            let held = Command::new("kill").args(["-STOP", &child.id().to_string()]).status().unwrap();
            if held.success() && lock.exists() {
                return Some(child);
            }
            let _ = child.kill();
            child.wait().unwrap();
            None
        })
        .expect("none of 20 batches could be held while it worked");
    oct(&args).refused(5, &["out", "another batch", "wait until it has finished", "--out"]);
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
        assert!(fs::read_to_string(out.join("index.html")).unwrap().contains(reason));
    }
    assert_eq!(names(&out), models, "what an earlier run made stays");
    oct(&["batch", &text(&top), "--out", &text(&out), "--min-slices", "0"]).refused(2, &["--min-slices"]);
}
