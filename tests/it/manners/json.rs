//! Every report that is printed is what its schema says, and every schema is that of a report.

use super::{ball, built, raw};
use crate::common::schema::faults;
use crate::prelude::*;

/// Every schema by its name.
fn schemas() -> BTreeMap<String, Value> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/schema");
    let read = |entry: std::io::Result<fs::DirEntry>| {
        let path = entry.unwrap().path();
        let name = path.file_stem().unwrap().to_str().unwrap().to_owned();
        (name, serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap())
    };
    fs::read_dir(folder).unwrap().map(read).collect()
}

/// Checks one report against a schema; returns the keys that it had, with their places.
fn hold(schema: &Value, report: &Value) -> BTreeSet<String> {
    let found = faults(schema, report);
    assert!(found.is_empty(), "{}: {found:#?} in {report}", schema["title"]);
    let mut keys = BTreeSet::new();
    gather(report, "", &mut keys);
    keys
}

fn gather(value: &Value, at: &str, keys: &mut BTreeSet<String>) {
    match value {
        Value::Object(members) => {
            for (name, member) in members {
                keys.insert(format!("{at}{name}"));
                gather(member, &format!("{at}{name}."), keys);
            }
        }
        Value::Array(items) => {
            items.iter().for_each(|item| gather(item, &format!("{}[].", at.trim_end_matches('.')), keys));
        }
        _ => {}
    }
}

/// Every key below a schema, with its place.
fn known(schema: &Value, at: &str, keys: &mut BTreeSet<String>) {
    for (name, member) in schema["properties"].as_object().into_iter().flatten() {
        keys.insert(format!("{at}{name}"));
        known(member, &format!("{at}{name}."), keys);
        known(&member["items"], &format!("{at}{name}[]."), keys);
    }
}

#[test]
fn every_report_is_what_its_schema_says() {
    let schemas = schemas();
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| text(&folder.path().join(name));
    let model =
        text(&built(folder.path(), "ball", [40, 40, 40], &["--channels", "normal,value"], ball(40, 15.0)));
    let hollow = |p| ball(40, 15.0)(p) - ball(40, 6.0)(p);
    let hollow = text(&built(folder.path(), "hollow", [40, 40, 40], &["--surface", "cells"], hollow));
    let source = at("ball.raw");
    let shape = ["--dims", "40x40x40", "--dtype", "u16", "--json"];
    let cleaned = ["--keep-largest", "1", "--fill-cavities", "--close", "1"];
    let build =
        |extra: &[&str]| oct(&[&["build", &source, "-o", &at("m.oct")], &shape[..], extra].concat()).json();
    let studies = folder.path().join("studies");
    super::folders::mixed(&studies);
    let batch = |out: &str, extra: &[&str]| {
        let run = oct(&[&["batch", &text(&studies), "--out", &at(out), "--json"], extra].concat());
        let report: Value = serde_json::from_str(&run.stdout).unwrap_or_else(|e| panic!("{e}: {run:?}"));
        report
    };
    let scene = at("scene.toml");
    fs::write(&scene, "model = [{ file = 'ball.oct' }, { file = 'ball.oct', move = [50, 0, 0] }]").unwrap();
    let parts = ["--keep-largest", "1", "--parts", "1", "--out", &at("job")];
    let planned = oct(&[&["plan", &source], &shape[..], &parts].concat());
    let failed = oct(&["info", "nothing.oct", "--json"]);
    let synthetic = ["--synthetic", "sphere@24", "--out", &at("more"), "--pixels", "16", "--json"];
    let synthetic = oct(&[&["report"][..], &synthetic].concat());
    crate::uncertainty::noisy(Path::new(&at("noisy.raw")), 40.0);
    let noisy = ["--dims", "70x66x68", "--dtype", "i16", "--iso", "0", "--surface", "cells", "--uncertainty"];
    assert_eq!(oct(&[&["build", &at("noisy.raw"), "-o", &at("noisy.oct")], &noisy[..]].concat()).code, 0);
    let moved = ["--move", "1,0,0", "--threshold-sigma", "9", "--tolerance", "0.1", "--json"];
    let moved =
        oct(&[&["compare", &at("noisy.oct"), &at("noisy.oct"), "-o", &at("d.oct")], &moved[..]].concat());
    let apart = ["--move", "12,0,0", "--radius", "8", "--both-ways", "--tolerance", "0.1", "--json"];
    let apart = oct(&[&["compare", &at("noisy.oct"), &at("noisy.oct")], &apart[..]].concat());
    let reports = [
        ("build", build(&["--otsu", "--spacing", "1x1x4"])),
        ("build", build(&["--iso", "500", "--surface", "cells", "--uncertainty"])),
        ("info", oct(&["info", &at("m.oct"), "--json"]).json()),
        ("compare", oct(&["compare", &at("m.oct"), &at("m.oct"), "--tolerance", "0.1", "--json"]).json()),
        ("compare", serde_json::from_str(&moved.stdout).unwrap()),
        ("compare", serde_json::from_str(&apart.stdout).unwrap()),
        ("info", oct(&["info", &at("d.oct"), "--json"]).json()),
        ("thickness", oct(&["thickness", &at("m.oct"), "--thin", "900", "--json"]).json()),
        ("pores", oct(&["pores", &hollow, "--gap", "--json"]).json()),
        ("pores", oct(&["pores", &at("m.oct"), "--bodies", "--json"]).json()),
        ("build", build(&[&["--iso", "500"], &cleaned[..]].concat())),
        ("build", build(&["--range", "200..900", "--channels", "none", "--lod", "off"])),
        ("build", build(&["--iso", "500", "--visible-from", "outside"])),
        ("build", build(&["--iso", "500", "--surface", "cells", "--error", "0.2"])),
        ("export", oct(&["export", &at("m.oct"), "-o", &at("leaves.stl"), "--json"]).json()),
        ("plan", planned.json()),
        ("part", oct(&["part", &at("job/plan.json"), "0", "--json", "--stage", "histogram"]).json()),
        ("merge-stage", oct(&["merge", &at("job/plan.json"), "--json", "--stage", "histogram"]).json()),
        ("part", oct(&["part", &at("job/plan.json"), "0", "--json", "--stage", "occupancy"]).json()),
        ("merge-stage", oct(&["merge", &at("job/plan.json"), "--json", "--stage", "occupancy"]).json()),
        ("part", oct(&["part", &at("job/plan.json"), "0", "--json"]).json()),
        ("merge", oct(&["merge", &at("job/plan.json"), "-o", &at("j.oct"), "--json"]).json()),
        ("info", oct(&["info", &at("m.oct"), "--json"]).json()),
        ("build", build(&["--labels", "500..2000", "--each", &at("models")])),
        ("info", oct(&["info", &at("m.oct"), "--json"]).json()),
        ("export", oct(&["export", &at("m.oct"), "--each", &at("each"), "--json"]).json()),
        ("pores", oct(&["pores", &at("m.oct"), "--bodies", "--json"]).json()),
        ("pack", oct(&["strip", &model, "-o", &at("s.oct"), "--levels", "1", "--json"]).json()),
        ("info", oct(&["info", &model, "--json"]).json()),
        ("verify", oct(&["verify", &model, "--json"]).json()),
        ("pack", oct(&["pack", &model, "-o", &at("p.oct"), "--json"]).json()),
        ("info", oct(&["info", &at("p.oct"), "--json"]).json()),
        ("pack", oct(&["unpack", &at("p.oct"), "-o", &at("u.oct"), "--json"]).json()),
        ("intersect", oct(&["intersect", &model, &model, "--move", "3,0,0", "--json"]).json()),
        ("export", oct(&["export", &model, "-o", &at("m.stl"), "--error", "0.1", "--json"]).json()),
        ("export", oct(&["export", &model, "-o", &at("m.stl"), "--triangles", "500", "--json"]).json()),
        ("render", oct(&["render", &model, "-o", &at("p.png"), "--size", "30x20", "--json"]).json()),
        ("render", oct(&["render", &scene, "-o", &at("q.png"), "--size", "30x20", "--json"]).json()),
        ("render", oct(&["thumbnail", &model, "-o", &at("t.png"), "--json"]).json()),
        ("demo", oct(&["demo", "-o", &at("d.oct"), "--size", "24", "--json", "--memory", "16MiB"]).json()),
        ("intersect", oct(&["intersect", &at("d.oct"), &at("d.oct"), "--move", "999,0,0", "--json"]).json()),
        ("selfcheck", oct(&["selfcheck", &model, "--rays", "1000", "--json"]).json()),
        ("report", oct(&["report", &model, "--out", &at("figures"), "--pixels", "16", "--json"]).json()),
        ("report", synthetic.json()),
        ("scan", oct(&["scan", &text(&studies), "--json"]).json()),
        ("batch", batch("out", &[])),
        (
            "batch",
            batch("out", &["--iso", "700", "--modality", "CT", "--spacing", "1x1x2", "--min-slices", "2"]),
        ),
        ("batch", batch("third", &["--iso", "500", "--surface", "cells", "--error", "0.2"])),
        ("batch", batch("other", &["--range", "200..900", "--keep-largest", "1"])),
        ("error", serde_json::from_str(&failed.stdout).unwrap()),
    ];
    let mut seen: BTreeMap<&str, BTreeSet<String>> = BTreeMap::new();
    for (name, report) in &reports {
        seen.entry(name).or_default().extend(hold(&schemas[*name], report));
    }
    // Nothing is described that no report has.
    assert_eq!(
        seen.keys().map(|name| (*name).to_owned()).collect::<Vec<_>>(),
        schemas.keys().cloned().collect::<Vec<_>>()
    );
    for (name, schema) in &schemas {
        let mut keys = BTreeSet::new();
        known(schema, "", &mut keys);
        // A demo is never cleaned, and keeps the whole skin.
        let never = |key: &str| {
            name == "demo"
                && (key.starts_with("cleaning")
                    || key.starts_with("each")
                    || key.starts_with("sight")
                    || key.starts_with("larger_leaves"))
        };
        let missing: Vec<_> = keys.difference(&seen[name.as_str()]).filter(|key| !never(key)).collect();
        assert!(missing.is_empty(), "{name}: {missing:?}");
    }
}

#[test]
fn a_list_without_volumes_is_an_object_too() {
    let folder = tempfile::tempdir().unwrap();
    raw(&folder.path().join("a.raw"), [4, 4, 4], |_| 7);
    let run = oct(&["scan", &text(folder.path()), "--json"]);
    let report = run.json();
    assert!(hold(&schemas()["scan"], &report).contains("left_out_files[].reason"), "{report}");
}
