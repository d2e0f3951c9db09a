//! Messages that once did not help: each says what is wrong, and what to do.

use crate::prelude::*;
use infobyte::jobs::batch::BatchRequest;
use infobyte::jobs::pack::StripRequest;
use infobyte::jobs::picture::Outputs;
use infobyte::jobs::view::ViewRequest;
use infobyte::text::Name;

use super::{ball, built, raw};

#[test]
fn wrong_numbers_are_called_what_they_are() {
    oct(&["batch", ".", "--out", "x", "--jobs", "0"]).refused(2, &["not a number of jobs"]);
    let folder = tempfile::tempdir().unwrap();
    let model = text(&built(folder.path(), "ball", [24, 24, 24], &[], ball(24, 9.0)));
    let source = text(&folder.path().join("ball.raw"));
    let output = text(&folder.path().join("m.oct"));
    let shape = ["--dims", "24x24x24", "--dtype", "u16", "--iso", "500"];
    let build = |extra: &[&str]| oct(&[&["build", &source, "-o", &output], &shape[..], extra].concat());
    let run = build(&["--memory", "1"]);
    run.refused(4, &["--memory 1 is too small"]);
    build(&["--memory", "1025"]).refused(4, &["--memory 1025 is too small"]);
    build(&["--memory", "2KiB"]).refused(4, &["--memory 2KiB is too small"]);
    build(&["--volume", "5"]).refused(2, &["no volume 5"]);
    assert_eq!(build(&["--volume", "1"]).code, 0);
    build(&["--surface", "cells", "--channels", "normal,value"]).refused(2, &["value is the threshold"]);
    let picture = text(&folder.path().join("p.png"));
    let seen = |eye: &str| {
        oct(&["render", &model, "-o", &picture, "--eye", eye, "--look-at", "0,0,0", "--size", "9x9"])
    };
    seen("1e308,0,0").refused(2, &["too far"]);
    seen("0,0,0").refused(2, &["at the point that it looks at"]);
    assert_eq!(seen("1e9,0,0").code, 0);
}

#[test]
fn a_header_full_of_comments_is_not_said_to_lack_a_type() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("v.nrrd");
    let comments = "# nothing to be said\n".repeat(1_000_000);
    fs::write(
        &path,
        format!("NRRD0004\n{comments}type: uchar\ndimension: 3\nsizes: 1 1 1\nencoding: raw\n\n7"),
    )
    .unwrap();
    let output = text(&folder.path().join("m.oct"));
    oct(&["build", &text(&path), "-o", &output]).refused(3, &["header does not end within", "comments"]);
}

#[test]
fn too_many_open_files_are_not_said_to_be_changed() {
    let folder = tempfile::tempdir().unwrap();
    let mut files = Vec::new();
    for z in 0..40 {
        let path = folder.path().join(format!("{z:03}.raw"));
        raw(&path, [16, 16, 1], |_| z * 50);
        files.push(text(&path));
    }
    let output = text(&folder.path().join("m.oct"));
    let mut args =
        vec!["build".to_owned(), "-o".into(), output, "--dims".into(), "16x16x40".into(), "--dtype".into()];
    args.extend(["u16".to_owned(), "--iso".into(), "500".into()]);
    args.extend(files);
    // Just enough to begin with; what the program holds open differs, so several limits are tried.
    let mut met = 0;
    for limit in 5..24 {
        let run = shell(&format!(r#"ulimit -n {limit}; exec "$OCT" "$@""#), &args);
        if run.code == 0 || run.code < 2 || run.stderr.is_empty() {
            continue;
        }
        assert!(!run.stderr.contains("was it changed"), "{limit}: {run:?}");
        met += u32::from(run.stderr.contains("ulimit -n"));
    }
    assert!(met > 0);
}

#[test]
fn a_missing_folder_is_called_missing() {
    let folder = tempfile::tempdir().unwrap();
    let model = text(&built(folder.path(), "ball", [24, 24, 24], &[], ball(24, 9.0)));
    let nowhere = text(&folder.path().join("nowhere/x.oct"));
    oct(&["pack", &model, "-o", &nowhere]).refused(5, &["folder does not exist; make it first"]);
    let beneath = text(&folder.path().join("ball.oct/x.oct"));
    oct(&["pack", &model, "-o", &beneath]).refused(5, &["a part of its path is a file"]);
}

#[test]
fn uneven_spacing_and_a_ct_without_a_threshold_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| text(&folder.path().join(name));
    raw(&folder.path().join("v.raw"), [24, 24, 24], ball(24, 9.0));
    let (source, model) = (at("v.raw"), at("m.oct"));
    let lean = "NRRD0004\ndimension: 3\ntype: ushort\nsizes: 24 24 24\nspace: left-posterior-superior\n\
                space directions: (1,0,0) (0,1,0) (0.2,0,1)\nencoding: raw\nendian: little\ndata file: v.raw\n";
    std::fs::write(at("lean.nrrd"), lean).unwrap();
    let hints = |args: &[&str]| -> Vec<String> {
        let report = oct(&[&["build", "-o", &model, "--json"], args].concat()).json();
        report["hints"].as_array().unwrap().iter().map(|hint| hint.as_str().unwrap().to_owned()).collect()
    };
    let shape =
        |spacing| [&source, "--dims", "24x24x24", "--dtype", "u16", "--iso", "500", "--spacing", spacing];
    let told = hints(&[&at("lean.nrrd"), "--iso", "500", "--surface", "cells"]);
    assert!(
        told.len() == 1 && told[0].contains("`oct compare` refuses") && told[0].contains("resample"),
        "{told:?}"
    );
    let told = hints(&shape("0.5x0.5x5"));
    assert!(
        told.len() == 1 && told[0].contains("are 10 times longer along z") && told[0].contains("stairs"),
        "{told:?}"
    );
    assert_eq!(hints(&shape("0.5x0.5x1.2")), [""; 0]);
    let told = hints(&[&shape("0.5x0.5x5")[..], &["--surface", "cells"]].concat());
    assert!(told.len() == 1 && told[0].contains("fall into strips"), "{told:?}");
    assert_eq!(hints(&[&shape("0.5x0.5x2.5")[..], &["--surface", "cells"]].concat()), [""; 0]);
    // One slice has no stairs.
    raw(&folder.path().join("s.raw"), [24, 24, 1], ball(24, 13.0));
    assert_eq!(
        hints(&[&at("s.raw"), "--dims", "24x24x1", "--dtype", "u16", "--iso", "1", "--spacing", "1x1x9"]),
        [""; 0]
    );
    // A CT: what Otsu's method found, and what is asked for most.
    let ct = folder.path().join("ct");
    super::folders::series(&ct, "1.2.3", "CT", 8.0);
    let told = hints(&[&text(&ct)]);
    assert!(told.len() == 1 && told[0].contains("Otsu") && told[0].contains("--preset bone"), "{told:?}");
    assert_eq!(hints(&[&text(&ct), "--iso", "300"]), [""; 0]);
    assert_eq!(hints(&[&text(&ct), "--preset", "bone"]), [""; 0]);
    let mr = folder.path().join("mr");
    super::folders::series(&mr, "1.2.4", "MR", 8.0);
    assert_eq!(hints(&[&text(&mr)]), [""; 0]);
    let shown = oct(&["build", &text(&ct), "-o", &model]).stdout;
    assert!(shown.contains("  hint: "), "{shown}");
}

/// A series is called what it was called on the command line: its pseudonym says nothing to the one who typed that.
#[test]
fn errors_of_a_series_name_its_folder() {
    let folder = tempfile::tempdir().unwrap();
    let (series, model) = (folder.path().join("head of May"), text(&folder.path().join("m.oct")));
    super::folders::series(&series, "1.2.3", "CT", 8.0);
    for (extra, code, words) in [
        (["--iso", "100000"], 3, "head of May: no voxel lies in the range from 100000 up"),
        (["--memory", "5MiB"], 4, "head of May: --memory 5MiB is too small"),
        (["--roi", "0..1,0..99,0..1"], 2, "head of May"),
    ] {
        let run = oct(&[&["build", &text(&series), "-o", &model], &extra[..]].concat());
        run.refused(code, &[words]);
        assert!(!run.stderr.contains("ct-"), "{run:?}");
    }
}

#[test]
fn an_error_is_an_object_under_json_whatever_went_wrong() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| text(&folder.path().join(name));
    raw(&folder.path().join("v.raw"), [24, 24, 24], ball(24, 9.0));
    let model = text(&built(folder.path(), "ball", [24, 24, 24], &[], ball(24, 9.0)));
    let raw = [&at("v.raw"), "-o", &at("m.oct"), "--dims", "24x24x24", "--dtype", "u16"];
    for (args, code, kind) in [
        (vec!["info", "nothing.oct"], 3, "input"),
        (vec!["info"], 2, "usage"),
        (vec!["frobnicate"], 2, "usage"),
        (vec!["scan", "nowhere"], 3, "input"),
        (vec!["batch", "nowhere", "--out", &at("out")], 3, "input"),
        (vec!["render", &model, "-o", &at("nowhere/p.png")], 5, "io"),
        (vec!["render", &model, "-o", &at("p.png"), "--eye", "0,0,0", "--look-at", "0,0,0"], 2, "usage"),
        ([&["build"], &raw[..], &["--memory", "1KiB"]].concat(), 4, "budget"),
        ([&["build"], &raw[..], &["--skip", "x"]].concat(), 2, "usage"),
        (vec!["verify", &at("v.raw")], 3, "input"),
    ] {
        let plain = oct(&args);
        assert_eq!(plain.stdout, "", "{args:?}");
        let run = oct(&[&args[..], &["--json"]].concat());
        run.refused(code, &[]);
        let told: Value =
            serde_json::from_str(&run.stdout).unwrap_or_else(|e| panic!("{e}: {args:?} {run:?}"));
        assert_eq!(
            (told["kind"].as_str(), told["exit_code"].as_i64()),
            (Some(kind), Some(code.into())),
            "{args:?}"
        );
        assert_eq!(told.as_object().unwrap().len(), 3, "{told}");
    }
}

/// Without a speller sentences name what a Rust caller sets: fields of the options, as `Debug` writes them.
#[test]
fn the_library_names_its_own_options() {
    let dims = Dims::new(2, 2, 2).unwrap();
    let raw = RawOptions {
        dims,
        scalar: ScalarType::U8,
        endian: Endian::Little,
        spacing_mm: [1.0; 3],
        skip: 0,
        orientation: Orientation::LPS,
    };
    let grid = GridChoice::Exact { edge_mm: 1.0, origin_mm: [0.0; 3], dims };
    let mesh = MeshOptions {
        grid,
        unit_mm: 1.0,
        up: Default::default(),
        fill: None,
        keep_thin: false,
        follow_links: false,
    };
    let open = OpenOptions { raw: Some(raw), ..Default::default() };
    let _ = |batch: &BatchRequest| (batch.out.is_dir(), batch.min_slices, batch.thumbnails_of_all);
    let point = ViewPoint::Free { eye: [0.0; 3], look_at: [0.0; 3], up: None };
    let picture = RenderRequest { point: Some(point), ..Default::default() };
    let export = ExportRequest::of(ExportForm::Stl);
    let (build, clean, strip) = (BuildOptions::default(), CleanOptions::default(), StripRequest::default());
    let (view, outputs) = (ViewRequest::default(), Outputs::of(Path::new("p.png")));
    let each = infobyte::jobs::build::EachLabel { folder: Path::new(""), replace: false, keep_whole: false };
    let fields = format!("{open:?} {mesh:?} {build:?} {clean:?} {picture:?} {export:?} {strip:?} {view:?}")
        + &format!(" {outputs:?} {each:?} {:?}", infobyte::jobs::compare::CompareRequest::default());
    // Values of fields, arguments of functions, and functions.
    let others =
        ["GridChoice::Voxel", "Threshold::Iso", "Threshold::Range", "anyway", "output", "build", "only"];
    let of_batch = ["min_slices", "out", "thumbnails_of_all"];
    for name in Name::ALL {
        if others.contains(name) || of_batch.contains(name) || name.starts_with("jobs::") {
            continue;
        }
        assert!(fields.contains(&format!(" {name}: ")), "{name}: {fields}");
    }
    let told = infobyte::open("/dev/null").err().unwrap().to_string();
    assert!(!told.contains("--"), "{told}");
}
