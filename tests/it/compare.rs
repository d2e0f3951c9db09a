//! `oct compare`: deviations are the bodies' own, with their sign, and do not depend on threads; what cannot be measured is
//! refused by a sentence with a remedy.

use crate::prelude::*;
use bodies::Body as Solid;

const N: u32 = 64;

/// Identity, from voxels to mm.
const PLAIN: [[f64; 4]; 3] = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];

struct Stage {
    folder: TempDir,
}

impl Stage {
    fn new() -> Self {
        Self { folder: tempfile::tempdir().unwrap() }
    }

    fn at(&self, name: &str) -> String {
        text(&self.folder.path().join(name))
    }

    /// A model of samples of a distance in voxels of the finest spacing, below 0 inside, placed by an affine.
    fn model(&self, name: &str, rows: [[f64; 4]; 3], distance: impl Fn([f64; 3]) -> f64) -> String {
        self.with(name, rows, BuildOptions::default(), distance)
    }

    fn with(
        &self,
        name: &str,
        rows: [[f64; 4]; 3],
        options: BuildOptions,
        distance: impl Fn([f64; 3]) -> f64,
    ) -> String {
        #[expect(clippy::cast_possible_truncation, reason = "samples in single precision")]
        let sample = |p: [u32; 3]| -distance(p.map(f64::from)) as f32;
        let voxels = Voxels::from_fn(Dims::new(N, N, N).unwrap(), sample).placed(Affine { rows });
        let options = BuildOptions { threshold: Threshold::Iso(0.0), ..options };
        infobyte::build(&voxels, &options, self.at(name)).unwrap();
        self.at(name)
    }

    fn compare(&self, args: &[&str]) -> Value {
        compared(args).1
    }
}

/// Exit code and report, whatever the verdict.
fn compared(args: &[&str]) -> (i32, Value) {
    let run = oct(&[&["compare"], args, &["--json"]].concat());
    let report = serde_json::from_str(&run.stdout).unwrap_or_else(|e| panic!("{e}: {run:?}"));
    (run.code, report)
}

fn number(report: &Value, path: &str) -> f64 {
    report.pointer(path).and_then(Value::as_f64).unwrap_or_else(|| panic!("{path}: {report:#}"))
}

/// Place, deviation and area of each row of a table.
fn rows(path: &str) -> Vec<([f64; 3], Option<f64>, f64)> {
    let row = |line: &str| {
        let parts: Vec<Option<f64>> = line.split(',').map(|part| part.parse().ok()).collect();
        ([0, 1, 2].map(|a| parts[a].unwrap()), parts[3], parts[5].unwrap())
    };
    fs::read_to_string(path).unwrap().lines().skip(1).map(row).collect()
}

#[test]
fn deviations_are_the_distances_of_the_body() {
    let stage = Stage::new();
    let grown = |body: Solid, by: f64| move |p: [f64; 3]| body.distance(p) - by;
    // A torus of half the size bends within cells twice as much as one of 128 voxels, where 0.012 are due.
    for ((name, body), most) in Solid::all(f64::from(N)).into_iter().zip([0.010, 0.016, 0.012]) {
        let small = stage.model("a.oct", PLAIN, grown(body, 0.0));
        let large = stage.model("b.oct", PLAIN, grown(body, 2.3));
        for (one, other, by) in [(&small, &large, 2.3), (&large, &small, 0.0)] {
            if (name, by) == ("box", 0.0) {
                // Seen from outside, the edges of a box are rounded by the cells.
                continue;
            }
            let csv = stage.at("m.csv");
            let report = stage.compare(&[one, other, "--csv", &csv, "--radius", "5", "--both-ways"]);
            let (mut sum, mut area) = (0.0, 0.0);
            for (at, found, weight) in rows(&csv) {
                let error = found.unwrap() - (body.distance(at) - by);
                sum += weight * error * error;
                area += weight;
            }
            let rms = (sum / area).sqrt();
            assert!(rms <= most, "{name} {by}: {rms}");
            let sign = if by > 0.0 { -2.3 } else { 2.3 };
            assert!((number(&report, "/deviation/mean") - sign).abs() < 0.02, "{report:#}");
            assert!((number(&report, "/hausdorff/to_actual") - 2.3).abs() < 1.0);
            assert_eq!(report["cells"], rows(&csv).len() as u64);
        }
        // Not one cell of a model is off itself.
        let csv = stage.at("same.csv");
        let (code, report) = compared(&[&small, &small, "--tolerance", "0", "--csv", &csv]);
        assert!(rows(&csv).iter().all(|(_, found, _)| *found == Some(0.0)), "{name}");
        assert_eq!((code, &report["tolerance"]["verdict"]), (0, &json!("conforms")));
    }
}

/// Turned, mirrored, tiny and huge frames see what a plain one sees, and nothing depends on threads.
#[test]
fn frames_and_threads_change_nothing() {
    let stage = Stage::new();
    let body = |by: f64| move |p: [f64; 3]| Solid::all(f64::from(N))[1].1.distance(p) - by;
    let (s, c) = (0.6, 0.8);
    for (rows, scale) in [
        (PLAIN, 1.0),
        ([[-1.0, 0.0, 0.0, 5.0], [0.0, 1.0, 0.0, -9.0], [0.0, 0.0, 1.0, 2.0]], 1.0),
        (
            [[0.001 * c, -0.001 * s, 0.0, 0.0], [0.001 * s, 0.001 * c, 0.0, 0.0], [0.0, 0.0, 0.001, 1.0]],
            0.001,
        ),
        ([[1000.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1000.0, 0.0], [0.0, 1000.0, 0.0, 0.0]], 1000.0),
    ] {
        let [one, other] =
            [("a.oct", 0.0), ("b.oct", 1.2)].map(|(name, by)| stage.model(name, rows, body(by)));
        let (csv, out) = (stage.at("m.csv"), stage.at("m.oct"));
        let mut before = None;
        for threads in ["1", "2", "5"] {
            let how =
                ["--threads", threads, "--csv", &csv, "-o", &out, "--radius", &format!("{}", 4.0 * scale)];
            let report = stage.compare(&[&[one.as_str(), &other], &how[..]].concat());
            assert!((number(&report, "/deviation/mean") / scale + 1.2).abs() < 0.01, "{report:#}");
            assert!((number(&report, "/deviation/p50") / scale - 1.2).abs() < 0.01);
            let mut left = report.clone();
            ["peak_rss_bytes", "wall_s"].iter().for_each(|key| left[key] = Value::Null);
            let bytes = (left, fs::read(&csv).unwrap(), fs::read(&out).unwrap());
            assert!(before.replace(bytes.clone()).is_none_or(|before| before == bytes), "{threads} threads");
        }
        oct(&["verify", &out, "--json"]).json();
        let info = oct(&["info", &out, "--json"]).json();
        assert_eq!(info["quantity"]["name"], "deviation", "{info:#}");
    }
}

#[test]
fn thin_walls_borders_gaps_and_verdicts() {
    let stage = Stage::new();
    let wall = |low: f64, high: f64| {
        move |p: [f64; 3]| {
            let across = (p[0] - 31.7).abs().max((p[1] - 31.7).abs()) - 20.0;
            (low - p[2]).max(p[2] - high).max(across)
        }
    };
    // A wall of 3 moved by 2: the nearest side of the other one is often the wrong one.
    let one = stage.model("a.oct", PLAIN, wall(22.2, 25.2));
    let other = stage.model("b.oct", PLAIN, wall(20.2, 23.2));
    let report = stage.compare(&[&one, &other, "--radius", "5"]);
    assert!((number(&report, "/deviation/p50") - 2.0).abs() < 0.02, "{report:#}");
    let any = stage.compare(&[&one, &other, "--radius", "5", "--angle", "180"]);
    assert!(number(&any, "/deviation/p50") < 1.1);
    assert!(number(&report, "/deviation/max") < 2.1 && number(&report, "/deviation/min") > -2.1);
    // Moved back, it is the same; far away nothing has a counterpart.
    let back = ["--move", "0,0,-2", "--tolerance", "0.05"];
    assert_eq!(compared(&[&[one.as_str(), &other], &back[..]].concat()).0, 0);
    let (code, beyond) = compared(&[&one, &other, "--tolerance=-3..1"]);
    assert_eq!((code, &beyond["tolerance"]["verdict"]), (6, &json!("does_not_conform")));
    assert!((number(&beyond, "/worst/0/d_mm") - 2.0).abs() < 0.05);
    let far = ["--move", "500,0,0"];
    let (code, report) = compared(&[&[one.as_str(), &other], &far[..]].concat());
    assert_eq!(
        (code, &report["deviation"], number(&report, "/without_counterpart/share")),
        (0, &Value::Null, 1.0)
    );
    let near = stage.compare(&[&one, &other, "--radius", "1.5"]);
    assert!(near["hausdorff"]["to_nominal"].is_null() && number(&near, "/deviation/max") < 1.5, "{near:#}");
    // A void 1 below the top of a block: deviations face the bottom, 9 away, where the Hausdorff distance is 3.
    let block = wall(20.2, 30.2);
    let hollow = move |p: [f64; 3]| {
        let sides = (p[0] - 31.7).abs().max((p[1] - 31.7).abs()) - 5.0;
        block(p).max(-sides.max((p[2] - 28.2).abs() - 1.0))
    };
    let [hollow, block] = [stage.model("g.oct", PLAIN, hollow), stage.model("h.oct", PLAIN, block)];
    let report = stage.compare(&[&hollow, &block, "--radius", "12", "--both-ways"]);
    let farthest = number(&report, "/deviation/max").max(-number(&report, "/deviation/min"));
    assert!(farthest > 8.9, "{report:#}");
    assert!((number(&report, "/hausdorff/to_nominal") - 3.0).abs() < 0.1, "{report:#}");
    assert!(number(&report, "/hausdorff/to_actual") < 0.1, "{report:#}");
    let text = oct(&["compare", &hollow, &block, "--radius", "12"]).stdout;
    assert!(text.contains("Hausdorff distance, one way, from ACTUAL to NOMINAL: 3"), "{text}");
    let text = oct(&["compare", &hollow, &block, "--radius", "12", "--both-ways"]).stdout;
    assert!(text.contains("Hausdorff distance, both ways: 3"), "{text}");
    let (code, report) = compared(&[&[one.as_str(), &other, "--tolerance", "1"], &far[..]].concat());
    assert_eq!((code, &report["tolerance"]["verdict"]), (7, &json!("undecided")));
    // A ball that the volume cuts: its caps are not compared.
    let cut = |by: f64| move |p: [f64; 3]| Solid::Ball([31.5, 31.5, 60.0], 26.0).distance(p) - by;
    let [one, other] = [("c.oct", 0.0), ("d.oct", 0.7)].map(|(name, by)| stage.model(name, PLAIN, cut(by)));
    let report = stage.compare(&[&one, &other]);
    assert!(number(&report, "/border/cells") > 500.0, "{report:#}");
    assert!(
        (number(&report, "/deviation/max") + 0.7).abs() < 0.1 && number(&report, "/deviation/min") > -0.8
    );
    // A ball in a shell.
    let nested = |by: f64| {
        move |p: [f64; 3]| {
            let from = Solid::Ball([31.4; 3], 0.0).distance(p);
            (from - 12.0 - by).min((from - 22.0).abs() - 2.0 - by)
        }
    };
    let [one, other] =
        [("e.oct", 0.0), ("f.oct", 0.5)].map(|(name, by)| stage.model(name, PLAIN, nested(by)));
    let report = stage.compare(&[&one, &other]);
    assert!(
        (number(&report, "/deviation/mean") + 0.5).abs() < 0.02 && number(&report, "/deviation/max") < -0.4
    );
}

#[test]
fn parts_that_are_added_or_lacking_do_not_conform_and_are_placed() {
    let stage = Stage::new();
    let block = |p: [f64; 3], half: f64, low: f64, high: f64| {
        let across = (p[0] - 31.7).abs().max((p[1] - 31.7).abs()) - half;
        (low - p[2]).max(p[2] - high).max(across)
    };
    let plain = stage.model("plain.oct", PLAIN, |p| block(p, 20.0, 20.2, 30.2));
    let bossed =
        stage.model("bossed.oct", PLAIN, |p| block(p, 20.0, 20.2, 30.2).min(block(p, 5.0, 25.0, 50.2)));
    let drawing = stage.at("plain.csg");
    fs::write(&drawing, "translate([11.7, 11.7, 20.2]) cube([40, 40, 10]);").unwrap();
    // Up to the radius the boss has counterparts, above it none: one place, whether the nominal is a volume or a tree.
    let given = ["--radius", "4", "--tolerance", "1"];
    for nominal in [&plain, &drawing] {
        let (code, report) = compared(&[&[bossed.as_str(), nominal], &given[..]].concat());
        let worst = report["worst"].as_array().unwrap();
        assert_eq!((code, &report["tolerance"]["verdict"]), (6, &json!("does_not_conform")), "{report:#}");
        assert!(number(&report, "/tolerance/outside") > 0.1, "{report:#}");
        assert!(worst.iter().filter(|place| place["area_mm2"].as_f64() > Some(20.0)).count() == 1);
        let first = &worst[0];
        // From the top of the boss, or nearly.
        assert!(
            first["has_counterpart"] == false && (18.0..20.5).contains(&number(first, "/d_mm")),
            "{first:#}"
        );
        assert!((number(first, "/box_mm/1/2") - 50.2).abs() < 1.0, "{first:#}");
        assert!(report["lacking"].as_array().unwrap().is_empty());
    }
    let text = oct(&[&["compare", &bossed, &plain], &given[..]].concat()).stdout;
    assert!(text.contains(" mm2, outside without counterpart\n"), "{text}");
    let far = "one way, from ACTUAL to NOMINAL: more than 4 mm";
    assert!(text.contains(far) && text.contains("; a larger radius finds it"), "{text}");
    let both = [&["compare", &plain, &bossed, "--both-ways"], &given[..]].concat();
    let (code, report) = compared(&both[1..]);
    assert_eq!((code, report["lacking"].as_array().unwrap().len()), (6, 1), "{report:#}");
    let place = &report["lacking"][0];
    assert!((number(place, "/box_mm/1/2") - 50.2).abs() < 1.0 && number(place, "/d_mm") > 18.0, "{place:#}");
    let text = oct(&both).stdout;
    assert!(text.contains("mm and more than 4 mm back") && text.contains("that ACTUAL lacks: "), "{text}");
    // How many places are listed decides nothing.
    assert_eq!(compared(&[&both[1..], &["--worst", "0"]].concat()).0, 6);
    // What it covers it does not lack; a place within it is inside.
    let (code, report) = compared(&[&[bossed.as_str(), &plain, "--both-ways"], &given[..]].concat());
    assert_eq!((code, &report["lacking"]), (6, &json!([])), "{report:#}");
    let (_, report) = compared(&[&plain, &bossed, "--radius", "2.5", "--tolerance", "0.5"]);
    assert!(report["worst"].to_string().contains("\"d_mm\":-"), "{report:#}");
    // A bar through both volumes: nothing is known of it beyond the nominal one.
    let along = |row: [f64; 4]| [row, PLAIN[1], PLAIN[2]];
    let bar = |p: [f64; 3]| (p[1] - 31.7).abs().max((p[2] - 31.7).abs()) - 8.2;
    let one = stage.model("one.oct", along([1.0, 0.0, 0.0, 40.0]), bar);
    let other = stage.model("other.oct", PLAIN, bar);
    for both in [&[][..], &["--both-ways"]] {
        let (code, report) = compared(&[&[one.as_str(), &other], &given[..], both].concat());
        assert_eq!((code, number(&report, "/tolerance/outside")), (7, 0.0), "{report:#}");
        assert!(number(&report, "/tolerance/undecided") > 0.5 && report["worst"] == json!([]), "{report:#}");
        assert_eq!(report["lacking"], json!([]));
    }
    // A drawing that goes on beyond the scan: what the scan holds conforms.
    let long = stage.at("long.csg");
    fs::write(&long, "translate([-40, 23.5, 23.5]) cube([150, 16.4, 16.4]);").unwrap();
    assert_eq!(compared(&[&[other.as_str(), &long], &given[..]].concat()).0, 0);
    let (code, report) = compared(&[&[other.as_str(), &long, "--both-ways"], &given[..]].concat());
    assert_eq!((code, &report["lacking"]), (7, &json!([])), "{report:#}");
    assert!((0.4..0.7).contains(&number(&report, "/outside_volume/share")), "{report:#}");
    assert!(report["warnings"].to_string().contains("beyond ACTUAL's volume"), "{report:#}");
}

#[test]
fn a_fit_finds_back_and_names_what_is_free() {
    let stage = Stage::new();
    let [(_, ball), _, (_, block)] = Solid::all(f64::from(N));
    let block = stage.model("a.oct", PLAIN, |p| block.distance(p));
    let ball = stage.model("b.oct", PLAIN, |p| ball.distance(p));
    // About the middle, by 10 degrees, and moved.
    let (s, c) = 10.0_f64.to_radians().sin_cos();
    let place =
        format!("{c},{},0,{},{s},{c},0,{},0,0,1,1.5", -s, 32.0 - 32.0 * (c - s) + 1.0, 32.0 - 32.0 * (c + s));
    let report = stage.compare(&[&block, &block, "--fit", "--place", &place]);
    assert!(
        number(&report, "/placement/rms_before") > 0.5 && number(&report, "/deviation/rms") < 0.001,
        "{report:#}"
    );
    assert_eq!(report["placement"]["free"], json!([]));
    let report = stage.compare(&[&ball, &ball, "--fit", "--place", &place]);
    let free = report["placement"]["free"].as_array().unwrap();
    assert!(
        free.len() == 3 && free.iter().all(|name| name.as_str().unwrap().contains("rotation")),
        "{report:#}"
    );
    assert!(number(&report, "/deviation/rms") < 0.05);
    let far = ["--fit", "--move", "300,0,0", "--radius", "0.1"];
    oct(&[&["compare", &ball, &block], &far[..]].concat()).refused(3, &["after the fit", "placement"]);
}

#[test]
fn meshes_are_built_twice_as_fine_and_volumes_by_their_threshold() {
    let stage = Stage::new();
    let [(_, ball), ..] = Solid::all(f64::from(N));
    let model = stage.model("a.oct", PLAIN, |p| ball.distance(p));
    let mesh = stage.at("a.stl");
    oct(&["export", &model, "-o", &mesh, "--json"]).json();
    let report = stage.compare(&[&model, &mesh, "--tolerance", "0.2"]);
    assert_eq!(number(&report, "/nominal_grid_mm"), 0.5);
    assert!(number(&report, "/deviation/rms") < 0.03, "{report:#}");
    let volume = "synthetic:sphere@64?radius=20";
    let report = stage.compare(&[volume, volume, "--iso", "0.5", "--tolerance", "0"]);
    let mut before = None;
    for cap in ["12MiB", "20MiB", "1GiB"] {
        let csv = stage.at("cap.csv");
        let how = ["--iso", "0.5", "--move", "0.3,0,0", "--memory", cap, "--threads", "1", "--csv", &csv];
        stage.compare(&[&[volume, volume], &how[..]].concat());
        let bytes = fs::read(&csv).unwrap();
        assert!(before.replace(bytes.clone()).is_none_or(|before| before == bytes), "{cap}");
        fs::remove_file(csv).unwrap();
    }
    assert_eq!(number(&report, "/deviation/rms"), 0.0);
    assert_eq!(names(stage.folder.path()), ["a.oct", "a.stl"], "nothing is left");
}

/// Cells cut sharp edges off by up to half a voxel, which is no defect of the part; a face that is moved is.
#[test]
fn sharp_edges_of_trees_are_not_beyond_a_tolerance_for_certain() {
    let stage = Stage::new();
    let [block, lower] = [("block.scad", 20.0), ("lower.scad", 19.4)].map(|(name, height)| {
        fs::write(stage.at(name), format!("rotate([10,20,30]) cube([40,30,{height}]);")).unwrap();
        stage.at(name)
    });
    let model = stage.at("block.oct");
    assert_eq!(oct(&["build", &block, "-o", &model, "--grid", "64", "--surface", "cells"]).code, 0);
    for (nominal, tolerance, verdict) in [
        (&block, "0.1", (7, "undecided")),
        (&block, "1", (0, "conforms")),
        (&lower, "0.1", (6, "does_not_conform")),
    ] {
        let (code, report) = compared(&[&model, nominal, "--tolerance", tolerance]);
        let found = report["tolerance"]["verdict"].as_str();
        assert_eq!((code, found), (verdict.0, Some(verdict.1)), "{tolerance}: {report:#}");
        let is_told = report["warnings"].to_string().contains("at sharp edges");
        assert_eq!(is_told, verdict.0 == 7, "{report:#}");
        let sure = number(&report, "/uncertainty/median_u95_mm");
        assert!(sure < 0.05, "faces are sharp: {sure}");
    }
    let pillar = stage.at("pillar.scad");
    let scad = "rotate([10,20,30]) union() { cube([40,30,20]); translate([45,10,5]) cube(5); }";
    fs::write(&pillar, scad).unwrap();
    let one_way = ["--tolerance", "1"];
    let (code, report) = compared(&[&[model.as_str(), pillar.as_str()], &one_way[..]].concat());
    assert_eq!(code, 0);
    assert!(report["warnings"].to_string().contains("--both-ways"), "{report:#}");
    assert_eq!(compared(&[&model, &pillar, "--tolerance", "1", "--both-ways"]).0, 6);
    assert_eq!(compared(&[&model, &block, "--tolerance", "1", "--both-ways"]).0, 0);
}

#[test]
fn inputs_that_cannot_be_measured_are_refused_with_a_remedy() {
    let stage = Stage::new();
    let [(_, ball), ..] = Solid::all(f64::from(N));
    let fine = stage.model("a.oct", PLAIN, |p| ball.distance(p));
    let skin = stage.with("s.oct", PLAIN, skin_options(), |p| ball.distance(p));
    let error = Some(infobyte::builder::Tolerance::Voxels(0.3));
    let options = BuildOptions { error, ..BuildOptions::default() };
    let leaves = stage.with("l.oct", PLAIN, options, |p| ball.distance(p));
    let mut tilted = PLAIN;
    tilted[1][2] = 0.2;
    let tilted = stage.model("t.oct", tilted, |p| ball.distance(p));
    // A volume of zeros, and one without the samples that its header states.
    let volume = |name: &str, lean: &str, bytes: usize| {
        let head = format!(
            "NRRD0004\ndimension: 3\ntype: float\nsizes: 9 9 9\nspace: left-posterior-superior\n\
             space directions: (1,0,0) (0,1,0) ({lean},0,1)\nencoding: raw\nendian: little\n\n"
        );
        fs::write(stage.at(name), [head.as_bytes(), &vec![0; bytes]].concat()).unwrap();
        stage.at(name)
    };
    let [cut, lean] = [volume("v.nrrd", "0", 9), volume("w.nrrd", "0.2", 4 * 9 * 9 * 9)];
    let refused = |args: &[&str], code: i32, words: &[&str]| {
        oct(&[&["compare"], args].concat()).refused(code, words);
    };
    refused(&[&fine, &skin], 3, &["s.oct", "skin", "cells"]);
    refused(&[&skin, &fine], 3, &["s.oct", "skin", "cells"]);
    refused(&[&leaves, &fine], 3, &["l.oct", "larger leaves"]);
    refused(&[&fine, &tilted], 3, &["t.oct", "right angles", "resample"]);
    fs::write(stage.at("far.obj"), "v 0 0 0\nv 9e9 0 0\nv 0 9e9 0\nf 1 2 3\n").unwrap();
    refused(&[&fine, &stage.at("far.obj")], 3, &["far.obj", "half as long as those of ACTUAL"]);
    // Headers say so, before either is built.
    refused(&[&fine, &cut], 3, &["v.nrrd", "bytes"]);
    for nominal in [&tilted, &lean] {
        refused(&[&cut, nominal], 3, &[&nominal[nominal.len() - 5..], "right angles", "resample"]);
    }
    let tree = |name: &str, place: &str| {
        fs::write(stage.at(name), format!("{place}volume(\"w.nrrd\", iso = 1);\n")).unwrap();
        stage.at(name)
    };
    refused(&[&cut, &tree("lean.csg", "")], 3, &["w.nrrd", "right angles", "resample"]);
    // A volume that is moved lies on the tree's own grid.
    refused(&[&cut, &tree("moved.csg", "translate([1, 0, 0]) ")], 3, &["v.nrrd", "bytes"]);
    refused(&[&fine, &fine, "--place", "2,0,0,0,0,2,0,0,0,0,2,0"], 2, &["scales"]);
    refused(&[&fine, &fine, "--angle", "400"], 2, &["0 to 180 degrees"]);
    refused(&[&fine, &fine, "-o", &fine], 2, &["a.oct"]);
    // As the nominal, larger leaves are measured within their bound.
    let report = stage.compare(&[&fine, &leaves]);
    assert!(number(&report, "/hausdorff/to_nominal") < 0.4, "{report:#}");
    let before = names(stage.folder.path());
    let cut = fs::read(&fine).unwrap();
    fs::write(stage.at("d.oct"), &cut[..cut.len() / 2]).unwrap();
    refused(
        &[&fine, &stage.at("d.oct"), "--csv", &stage.at("x.csv"), "-o", &stage.at("x.oct")],
        3,
        &["d.oct"],
    );
    assert_eq!(names(stage.folder.path()).len(), before.len() + 1);
}

#[test]
fn the_library_finds_nearest_points_of_many() {
    let stage = Stage::new();
    let [(_, ball), ..] = Solid::all(f64::from(N));
    let model = Model::open(stage.model("a.oct", PLAIN, |p| ball.distance(p))).unwrap();
    let mut random = Random(3);
    let points: Vec<[f64; 3]> = (0..5000).map(|_| [0; 3].map(|_: u32| random.unit() * 90.0 - 13.0)).collect();
    let found = model.nearest(&points).unwrap();
    for (i, point) in points.iter().enumerate() {
        let due = ball.distance(*point);
        assert!((found.distance_mm[i] - due).abs() < 0.1, "{point:?}: {} {due}", found.distance_mm[i]);
        assert!(found.cell[i].is_some() && ball.distance(found.position_mm[i]).abs() < 0.1);
        assert!(due.abs() < 0.1 || f64::from(found.side[i]) * due > 0.0);
        assert!(dot(found.normal[i], ball.normal(found.position_mm[i])) > 0.99);
    }
    assert!(model.nearest(&[[f64::NAN; 3]]).unwrap_err().to_string().contains("point 0"));
    assert!(model.nearest(&[]).unwrap().cell.is_empty());
}

/// A mesh that is built for a comparison has the notes of `oct build` on what is too thin for its voxels.
#[test]
fn what_is_thinner_than_the_voxels_of_a_mesh_is_noted() {
    let stage = Stage::new();
    let [(_, ball), ..] = Solid::all(f64::from(N));
    let fine = stage.model("a.oct", PLAIN, |p| ball.distance(p));
    let faces = [[1, 3, 4, 2], [5, 6, 8, 7], [1, 2, 6, 5], [3, 7, 8, 4], [1, 5, 7, 3], [2, 4, 8, 6]];
    let mut obj = String::new();
    for (number, [from, to]) in
        [[[5.0; 3], [20.0; 3]], [[30.2, 6.0, 6.0], [30.2001, 19.0, 19.0]]].iter().enumerate()
    {
        obj += &format!("o part{number}\n");
        for corner in 0..8 {
            let [x, y, z] = [0, 1, 2].map(|a| if corner >> a & 1 == 1 { to[a] } else { from[a] });
            obj += &format!("v {x} {y} {z}\n");
        }
        for face in faces {
            let [a, b, c, d] = face.map(|corner: usize| corner + 8 * number);
            obj += &format!("f {a} {b} {c} {d}\n");
        }
    }
    fs::write(stage.at("n.obj"), obj).unwrap();
    let note = "n.obj has 2 parts, of which 1 is thinner than a voxel and not in the model";
    let args = ["compare", &fine, &stage.at("n.obj"), "--radius", "20"];
    let told = oct(&args).stdout;
    let report = oct(&[&args[..], &["--json"]].concat()).stdout;
    assert!(told.contains(note) && report.contains(note), "{told}\n{report}");
}
