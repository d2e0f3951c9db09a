//! A batch is left alone overnight: every volume comes out or is explained, nothing is done twice, a killed
//! run goes on where it was.

use crate::prelude::*;

const SIDE: u16 = 32;
const SLICES: u32 = 20;

/// A series of a ball, its radius in voxels.
fn write_ball(folder: &Path, series: &str, radius: f64) {
    fs::create_dir_all(folder).unwrap();
    let middle = [15.2, 14.7, 9.6];
    for z in 0..SLICES {
        let side = u32::from(SIDE);
        let values: Vec<u32> = (0..side * side)
            .map(|i| {
                let at = [f64::from(i % side), f64::from(i / side), f64::from(z)];
                let squares: f64 = at.iter().zip(middle).map(|(a, m)| (a - m) * (a - m)).sum();
                if squares.sqrt() < radius { 1500 } else { 20 }
            })
            .collect();
        let image = Image {
            series,
            instance: z + 1,
            position: [0.0, 0.0, f64::from(z)],
            size: [SIDE, SIDE],
            values: &values,
            ..Image::default()
        };
        fs::write(folder.join(format!("i{z}.dcm")), image.bytes()).unwrap();
    }
}

/// Three good series in three folders, a bad one, a text, and a folder named like the patient.
fn studies(top: &Path) {
    write_ball(&top.join("a/one"), "1.2.3.1", 8.0);
    write_ball(&top.join("a/two"), "1.2.3.2", 6.5);
    write_ball(&top.join("Nobody_R/three"), "1.2.3.3", 9.0);
    let bad = top.join("bad");
    fs::create_dir(&bad).unwrap();
    for n in 1..4 {
        let image = Image { series: "1.2.3.4", instance: n, values: &[n, 2, 3, 4], ..Image::default() };
        fs::write(bad.join(format!("{n}.dcm")), image.bytes()).unwrap();
    }
    fs::write(top.join("readme.txt"), "nothing").unwrap();
}

fn batch(input: &Path, out: &Path, extra: &[&str]) -> (i32, Value) {
    let run = oct(&[&["batch", &text(input), "--out", &text(out), "--json"], extra].concat());
    let report = serde_json::from_str(&run.stdout).unwrap_or_else(|e| panic!("{e}: {run:?}"));
    (run.code, report)
}

/// Models made, left as they were, and failed.
pub(crate) fn counts(report: &Value) -> [u64; 3] {
    ["converted", "skipped", "failed"].map(|key| report[key].as_u64().unwrap())
}

/// Everything in the output folder that must not depend on how the batch went; reports without times,
/// memory and which run built what.
fn results(out: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    for name in names(out) {
        let bytes = fs::read(out.join(&name)).unwrap();
        let bytes = match name.as_str() {
            "index.html" | "report.csv" | "report.js" | ".oct-key" => continue,
            _ if name.ends_with(".json") => {
                let mut value: Value = serde_json::from_slice(&bytes).unwrap();
                without_times(&mut value);
                value.to_string().into_bytes()
            }
            _ => bytes,
        };
        found.insert(name, bytes);
    }
    found
}

/// The same files with the same bytes; only names are printed.
fn same(a: &BTreeMap<String, Vec<u8>>, b: &BTreeMap<String, Vec<u8>>) {
    assert_eq!(a.keys().collect::<Vec<_>>(), b.keys().collect::<Vec<_>>());
    for (name, bytes) in a {
        assert!(b[name] == *bytes, "{name} differs");
    }
}

/// What differs from run to run.
const TIMES: &str =
    "wall_s memory_bytes memory_plan_bytes peak_rss_bytes status converted skipped scratch_bytes jobs inputs";

fn without_times(value: &mut Value) {
    match value {
        Value::Object(map) => {
            for key in TIMES.split(' ') {
                map.remove(key);
            }
            map.values_mut().for_each(without_times);
        }
        Value::Array(all) => all.iter_mut().for_each(without_times),
        _ => {}
    }
}

#[test]
fn every_volume_is_converted_or_explained_and_nothing_is_done_twice() {
    let folder = tempfile::tempdir().unwrap();
    let (top, out) = (folder.path().join("in"), folder.path().join("out"));
    studies(&top);
    let (code, report) = batch(&top, &out, &["--memory", "16MiB", "--jobs", "2"]);
    assert_eq!((code, counts(&report)), (8, [3, 0, 1]), "{report}");
    assert!(report["peak_rss_bytes"].as_u64().unwrap() <= (16 + SYSTEM_MIB) << 20, "{report}");
    assert_eq!(report["left_out"][0]["first"], text(&top.join("readme.txt")), "{report}");
    let items = report["items"].as_array().unwrap();
    let failed = items.iter().find(|item| item["status"] == "failed").unwrap();
    assert!(failed["reason"].as_str().unwrap().contains("one position"), "{failed}");
    for item in items.iter().filter(|item| item["status"] == "converted") {
        let model = text(&out.join(item["model"]["file"].as_str().unwrap()));
        assert_eq!(item["model"]["dims"], serde_json::json!([SIDE, SIDE, SLICES]));
        assert_eq!(oct(&["verify", &model]).code, 0);
        assert!(out.join(item["model"]["thumbnail"].as_str().unwrap()).is_file());
    }
    assert_eq!(fs::read_to_string(out.join("report.csv")).unwrap().lines().count(), 6);

    let before = results(&out);
    let (code, again) = batch(&top, &out, &["--memory", "16MiB", "--jobs", "1"]);
    assert_eq!((code, counts(&again)), (8, [0, 3, 1]), "{again}");
    same(&results(&out), &before);

    // Other options, a missing result, a changed input: what is concerned is built again.
    let (_, other) = batch(&top, &out, &["--iso", "0"]);
    assert_eq!(counts(&other), [3, 0, 1], "{other}");
    batch(&top, &out, &[]);
    let model = names(&out).into_iter().find(|name| name.ends_with(".oct")).unwrap();
    fs::remove_file(out.join(model)).unwrap();
    assert_eq!(counts(&batch(&top, &out, &[]).1), [1, 2, 1]);
    write_ball(&top.join("a/two"), "1.2.3.2", 7.5);
    assert_eq!(counts(&batch(&top, &out, &[]).1), [1, 2, 1]);
    assert!(results(&out) != before);
}

#[test]
fn samples_that_change_beside_their_header_are_converted_again() {
    let folder = tempfile::tempdir().unwrap();
    let (top, out) = (folder.path().join("in"), folder.path().join("out"));
    fs::create_dir_all(top.join("slices")).unwrap();
    let header = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 4 4 4\nspacings: 1 1 1\nencoding: raw\n\
                  data file: a.raw\n\n";
    fs::write(top.join("a.nhdr"), header).unwrap();
    fs::write(top.join("slices.json"), r#"{"dims": [4, 4, 2], "dtype": "u8"}"#).unwrap();
    let write = |name: &str, inside: u8, n: usize| {
        let samples: Vec<u8> = (0..n).map(|i| if i % 16 < 8 { inside } else { 0 }).collect();
        fs::write(top.join(name), samples).unwrap();
    };
    write("a.raw", 200, 64);
    write("slices/1.raw", 200, 16);
    write("slices/2.raw", 200, 16);
    let run = || counts(&batch(&top, &out, &["--iso", "100"]).1);
    assert_eq!((run(), run()), ([2, 0, 0], [0, 2, 0]));
    write("a.raw", 201, 64);
    assert_eq!(run(), [1, 1, 0]);
    write("slices/2.raw", 201, 16);
    assert_eq!(run(), [1, 1, 0]);
}

#[test]
fn files_whose_names_look_the_same_or_are_no_text_are_converted() {
    let folder = tempfile::tempdir().unwrap();
    let (top, out) = (folder.path().join("in"), folder.path().join("out"));
    fs::create_dir(&top).unwrap();
    let header = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 4 4 4\nspacings: 1 1 1\nencoding: raw\n\n";
    for (name, inside) in [(&b"M\xfcller.nrrd"[..], 200), (b"M\xf6ller.nrrd", 201), (b"<b>\"&\n.nrrd", 202)] {
        let samples = (0..64).map(|i| if i % 16 < 8 { inside } else { 0 });
        let bytes: Vec<u8> = header.bytes().chain(samples).collect();
        fs::write(top.join(latin1(name)), &bytes).unwrap();
    }
    let (_, report) = batch(&top, &out, &["--iso", "100", "--keep-names"]);
    assert_eq!(counts(&report), [3, 0, 0], "{report}");
    let page = fs::read_to_string(out.join("index.html")).unwrap();
    assert!(!page.contains("<b>\"") && page.contains("&lt;b&gt;"), "{page}");
}

#[test]
fn long_series_that_are_opened_by_several_jobs_stay_within_the_cap() {
    let folder = tempfile::tempdir().unwrap();
    let (top, out) = (folder.path().join("in"), folder.path().join("out"));
    for series in 1..=4 {
        let inside = top.join(series.to_string());
        fs::create_dir_all(&inside).unwrap();
        for n in 0..3000_u32 {
            let image = Image {
                series: &format!("1.2.3.{series}"),
                instance: n + 1,
                position: [0.0, 0.0, f64::from(n)],
                values: &[1500, 20, 1500, 20],
                ..Image::default()
            };
            fs::write(inside.join(format!("{n}.dcm")), image.bytes()).unwrap();
        }
    }
    let refused = oct(&["batch", &text(&top), "--out", &text(&out), "--memory", "2MiB"]);
    refused.refused(4, &["is too small"]);
    let least = smallest_budget(&refused.stderr);
    // With the least memory one job at a time, with more of it several.
    for (cap, jobs) in [(least, 1), ("20MiB", 2)] {
        let allowed = infobyte::budget::parse_size(cap).unwrap();
        let _ = fs::remove_dir_all(&out);
        let report = batch(&top, &out, &["--iso", "100", "--jobs", "4", "--memory", cap]).1;
        assert_eq!(counts(&report), [4, 0, 0], "{report}");
        let (peak, used) = (report["peak_rss_bytes"].as_u64().unwrap(), report["jobs"].as_u64().unwrap());
        assert!(peak <= allowed && used >= jobs, "{cap} allowed, peak {peak}, {used} jobs");
    }
}

#[test]
fn a_small_file_of_very_many_frames_is_refused_before_they_are_looked_at() {
    let folder = tempfile::tempdir().unwrap();
    let (top, out) = (folder.path().join("in"), folder.path().join("out"));
    write_ball(&top.join("good"), "1.2.3.1", 8.0);
    let film = top.join("film.dcm");
    let mut image = Elements::ct(0.0, 1, [0; 4]);
    for tag in [0x0028_0010, 0x0028_0011] {
        image.us(tag, 1);
    }
    for (tag, bits) in [(0x0028_0100, 8), (0x0028_0101, 8), (0x0028_0102, 7)] {
        image.us(tag, bits);
    }
    image.set(0x0008_0016, "UI", "1.2.840.10008.5.1.4.1.1.7.2").set(0x0020_000e, "UI", "1.2.3.2");
    let frames = 1 << 20;
    image.set(0x0028_0008, "IS", &frames.to_string()).raw(0x7fe0_0010, "OB", &vec![1; frames]);
    fs::write(&film, image.bytes()).unwrap();

    let sentence = &["film.dcm", "1048576 images", "--memory"];
    let model = folder.path().join("m.oct");
    let cap = (10 + SYSTEM_MIB) << 20;
    let run = oct(&["build", &text(&film), "-o", &text(&model), "--memory", "10MiB"]);
    run.refused(4, sentence);
    let (code, report) = batch(&top, &out, &["--iso", "100", "--memory", "10MiB"]);
    assert_eq!((code, counts(&report)), (8, [1, 0, 1]), "{report}");
    assert!(report.to_string().contains("1048576 images"), "{report}");
    let peak = report["peak_rss_bytes"].as_u64().unwrap();
    assert!(peak <= cap, "{peak} of {cap}");
    // A scan has no cap, and lists it.
    let listed = oct(&["scan", &text(&top)]);
    assert!(listed.stdout.contains("1048576 images"), "{listed:?}");
}

#[test]
fn a_tree_that_does_not_fit_the_cap_fails_alone() {
    let folder = tempfile::tempdir().unwrap();
    let (top, out) = (folder.path().join("in"), folder.path().join("out"));
    fs::create_dir(&top).unwrap();
    fs::write(top.join("ball.stl"), Body::sphere([20.0; 3], 15.0, 3).stl()).unwrap();
    let places = "multmatrix([[1,0,0,0.00001],[0,1,0,0],[0,0,1,0],[0,0,0,1]]) {\n";
    let deep = format!("{}cube(3);{}", places.repeat(100_000), "}".repeat(100_000));
    fs::write(top.join("deep.csg"), deep).unwrap();
    let (code, report) = batch(&top, &out, &["--memory", "12MiB"]);
    assert_eq!((code, counts(&report)), (8, [1, 0, 1]), "{report}");
    assert!(report.to_string().contains("--memory"), "{report}");
    let peak = report["peak_rss_bytes"].as_u64().unwrap();
    assert!(peak <= (12 + SYSTEM_MIB) << 20, "{peak}");
}

#[test]
fn jobs_share_the_file_descriptors() {
    let folder = tempfile::tempdir().unwrap();
    let (top, out) = (folder.path().join("in"), folder.path().join("out"));
    for n in 1..=6 {
        write_ball(&top.join(n.to_string()), &format!("1.2.3.{n}"), 8.0);
    }
    // Six volumes of 20 files in 48 descriptors: each could keep 12 open, and not all of them can.
    let command = "ulimit -n 48; exec \"$0\" batch \"$1\" --out \"$2\" --jobs 6 --iso 100 --json";
    let run = Command::new("sh").args(["-c", command]).arg(binary()).arg(&top).arg(&out).output().unwrap();
    let report: Value = serde_json::from_slice(&run.stdout).unwrap_or_else(|e| panic!("{e}: {run:?}"));
    assert_eq!(counts(&report), [6, 0, 0], "{report}");
}

#[test]
fn work_is_done_where_no_thread_can_be_started() {
    let folder = tempfile::tempdir().unwrap();
    let (top, out) = (folder.path().join("in"), text(&folder.path().join("out")));
    write_ball(&top, "1.2.3.1", 8.0);
    let (top, model) = (text(&top), text(&folder.path().join("m.oct")));
    assert_eq!(oct(&["build", "synthetic:sphere@48", "-o", &model, "--surface", "cells"]).code, 0);
    for args in [
        &["batch", &top, "--out", &out, "--jobs", "2", "--iso", "100"][..],
        &["thickness", &model, "--threads", "2"],
        &["compare", &model, &model, "--threads", "2"],
    ] {
        // A stack longer than any address space.
        let run = Command::new(binary()).args(args).env("RUST_MIN_STACK", "1000000000000000").output();
        let run = Run::of(&run.unwrap());
        assert_eq!(run.code, 0, "{args:?}: {run:?}");
    }
}

#[test]
fn results_inside_the_searched_folder_are_not_inputs() {
    let folder = tempfile::tempdir().unwrap();
    write_ball(&folder.path().join("one"), "1.2.3.1", 8.0);
    let out = folder.path().join("results");
    for expected in [[1, 0, 0], [0, 1, 0]] {
        let (code, report) = batch(folder.path(), &out, &[]);
        assert_eq!((code, counts(&report)), (0, expected), "{report}");
        assert_eq!(report["left_out"], serde_json::json!([]), "{report}");
    }
}

/// What people read calls cells cells, tells rows of one folder apart, and says where the names of files are.
#[test]
fn lists_and_pages_say_what_is_there() {
    let folder = tempfile::tempdir().unwrap();
    let top = folder.path().join("in");
    fs::create_dir(&top).unwrap();
    write_ball(&top, "1.2.3", 9.0);
    let out = folder.path().join("out");
    let run = oct(&["batch", &text(&top), "--out", &text(&out), "--iso", "100", "--surface", "cells"]);
    assert!(run.code == 0 && run.stderr.contains(" cells, "), "{run:?}");
    let page = fs::read_to_string(out.join("index.html")).unwrap();
    assert!(page.contains("<dt>cells</dt>") && !page.contains("skin voxels"));
    let demo =
        oct(&["demo", "--size", "32", "--memory", "16MiB", "-o", &text(&folder.path().join("demo.oct"))]);
    assert!(demo.stdout.contains("\ncells ") && !demo.stdout.contains("skin voxel"), "{demo:?}");
    // Slices at one place form no volume: of two series it is said which.
    let flat = folder.path().join("flat");
    fs::create_dir(&flat).unwrap();
    for (name, series, instance) in
        [("a", "1.2.7", 1), ("b", "1.2.7", 2), ("c", "1.2.8", 1), ("d", "1.2.8", 2)]
    {
        let image = Image { series, instance, values: &[instance, 2, 3, 4], ..Image::default() };
        fs::write(flat.join(name), image.bytes()).unwrap();
    }
    let listed = oct(&["scan", &text(&flat), "--json"]).json();
    let names: Vec<&str> =
        listed["items"].as_array().unwrap().iter().map(|i| i["name"].as_str().unwrap()).collect();
    assert!(names.len() == 2 && names[0] != names[1], "{names:?}");
    let rows = oct(&["scan", &text(&flat)]).stdout;
    assert!(rows.contains("CT image") && names.iter().all(|name| rows.contains(name)), "{rows}");
    let _ = oct(&["batch", &text(&flat), "--out", &text(&out), "--iso", "1"]);
    let page = fs::read_to_string(out.join("index.html")).unwrap();
    assert!(page.contains("Files are named in report.csv") && !page.contains(&text(&flat)), "{page}");
    // At home the page has their files and reasons from a script that lies next to it.
    assert!(page.contains("<script src=\"report.js\"></script>"), "{page}");
    let home = fs::read_to_string(out.join("report.js")).unwrap();
    assert!(home.starts_with("// This file names files and folders"), "{home}");
    for name in &names {
        let row = home.lines().find(|line| line.contains(&format!("[\"{name}\",")));
        assert!(
            row.is_some_and(|row| row.contains(&text(&flat)) && row.contains("at one position")),
            "{home}"
        );
    }
    let sheet = fs::read_to_string(out.join("report.csv")).unwrap();
    assert!(sheet.lines().any(|line| line.contains(names[0]) && line.contains(&text(&flat))), "{sheet}");
}

#[test]
fn a_scan_lists_what_a_batch_does() {
    let folder = tempfile::tempdir().unwrap();
    let (top, out) = (folder.path().join("in"), folder.path().join("out"));
    studies(&top);
    let scan = oct(&["scan", &text(&top), "--json"]).json();
    assert_eq!((&scan["usable"], &scan["refused"]), (&3.into(), &1.into()), "{scan}");
    assert_eq!(names(&top), ["Nobody_R", "a", "bad", "readme.txt"]);
    let (_, report) = batch(&top, &out, &[]);
    let pairs = scan["items"].as_array().unwrap().iter().zip(report["items"].as_array().unwrap());
    for (listed, done) in pairs {
        assert_eq!(listed["input"], done["input"]);
        assert_eq!(listed["usable"].as_bool().unwrap(), done["status"] == "converted");
        if listed["usable"].as_bool().unwrap() {
            assert_eq!(listed["dims"], done["model"]["dims"]);
        }
    }
}

#[test]
fn a_folder_without_volumes_is_refused_and_a_missing_one_too() {
    let folder = tempfile::tempdir().unwrap();
    let (top, out) = (folder.path().join("in"), folder.path().join("out"));
    fs::create_dir(&top).unwrap();
    fs::write(top.join("readme.txt"), "nothing").unwrap();
    oct(&["batch", &text(&top), "--out", &text(&out)]).refused(3, &["no volume"]);
    oct(&["batch", &text(&top.join("x")), "--out", &text(&out)]).refused(3, &["x"]);
    // No folder is left where nothing was converted, nor around it; one that was there stays.
    assert!(!out.exists());
    oct(&["batch", &text(&top), "--out", &text(&out.join("a/b"))]).refused(3, &["no volume"]);
    assert!(!out.exists());
    fs::create_dir(&out).unwrap();
    oct(&["batch", &text(&top), "--out", &text(&out)]).refused(3, &["no volume"]);
    assert!(names(&out).is_empty());
    oct(&["scan", &text(&top.join("x"))]).refused(3, &["x"]);
    write_ball(&top, "1.2.3.1", 8.0);
    oct(&["batch", &text(&top), "--out", &text(&out), "--memory", "3MiB"]).refused(4, &["is too small"]);
    // A picture that does not fit is left out, and made when there is room.
    let big = ["--thumbnails", "2000", "--quiet"];
    let (code, report) = batch(&top, &out, &[&big[..], &["--memory", "16MiB"]].concat());
    assert_eq!((code, counts(&report)), (0, [1, 0, 0]), "{report}");
    assert!(report["items"][0]["warnings"][0].as_str().unwrap().contains("thumbnail"), "{report}");
    assert!(report["peak_rss_bytes"].as_u64().unwrap() <= (16 + SYSTEM_MIB) << 20, "{report}");
    let (_, report) = batch(&top, &out, &[&big[..], &["--memory", "512MiB"]].concat());
    assert!(counts(&report) == [1, 0, 0] && report["items"][0]["model"]["thumbnail"].is_string(), "{report}");
    // What a changed input gave before does not stay as if it were its result.
    for entry in fs::read_dir(&top).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|end| end == "dcm") {
            let file = fs::File::options().write(true).open(&path).unwrap();
            file.set_len(fs::metadata(&path).unwrap().len() / 2).unwrap();
        }
    }
    let (code, report) = batch(&top, &out, &[]);
    assert_eq!((code, counts(&report)), (8, [0, 0, 1]), "{report}");
    assert_eq!(names(&out), [".oct-key", "index.html", "report.csv", "report.js", "report.json"]);
}

#[test]
fn killed_at_any_moment_and_started_again_the_results_are_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let (top, whole, killed) =
        (folder.path().join("in"), folder.path().join("whole"), folder.path().join("killed"));
    studies(&top);
    let started = std::time::Instant::now();
    batch(&top, &whole, &[]);
    let usual = started.elapsed();
    let mut random = Random(4);
    let mut interrupted = 0;
    for round in 0..20 {
        // A fresh start now and then, so that every moment of a run is met.
        if round % 2 == 0 && killed.exists() {
            fs::remove_dir_all(&killed).unwrap();
        }
        let mut child = Command::new(binary())
            .args(["batch", &text(&top), "--out", &text(&killed), "--quiet"])
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        std::thread::sleep(Duration::from_micros(
            random.below(u64::try_from(usual.as_micros() * 3 / 4).unwrap()),
        ));
        let _ = child.kill();
        interrupted += u32::from(child.wait().unwrap().signal() == Some(9));
        if killed.exists() {
            // Nothing half-written has a name.
            // A whole file may be left under the hidden name by which it was to replace another.
            for name in names(&killed).into_iter().filter(|name| !name.starts_with(".oct-")) {
                let path = killed.join(&name);
                let known =
                    [".oct", ".png", ".json", ".csv", ".html", ".js"].iter().any(|end| name.ends_with(end));
                assert!(known && fs::metadata(&path).unwrap().len() > 0, "{name}");
                if name.ends_with(".oct") {
                    assert_eq!(oct(&["verify", &text(&path)]).code, 0, "{name}");
                }
            }
        }
    }
    assert!(interrupted >= 5, "only {interrupted} of 20 runs were interrupted");
    batch(&top, &killed, &[]);
    same(&results(&killed), &results(&whole));
}

#[test]
fn all_of_the_real_data_within_16_mib() {
    if long() == 1 {
        println!("skipped: it takes a minute of both cores; INFOBYTE_LONG=2 runs it");
        return;
    }
    let Some(top) = data::real_data("") else { return };
    let folder = tempfile::tempdir().unwrap();
    let out: PathBuf = folder.path().join("out");
    let (code, report) = batch(&top, &out, &["--memory", "16MiB", "--jobs", "2"]);
    let [converted, _, failed] = counts(&report);
    assert!(code == 8 && converted >= 30 && failed >= 5, "{code}: {converted} converted, {failed} failed");
    for item in report["items"].as_array().unwrap() {
        let reason = item["reason"].as_str().unwrap_or_default();
        assert_eq!(item["status"] == "failed", !reason.is_empty(), "{item}");
        assert!(!reason.contains("internal error"), "{item}");
    }
}
