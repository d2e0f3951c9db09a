//! `-` is standard input or output where that makes sense, and never a file of that name; a file is not written
//! under a name that says it is something else.

use crate::prelude::*;
use std::io::Write;
use std::process::Output;

use super::{ball, built, raw};

/// Runs `oct` in a folder with bytes on standard input.
fn fed(folder: &Path, args: &[&str], input: &[u8]) -> Output {
    let mut child = Command::new(binary())
        .args(args)
        .current_dir(folder)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // A command that refuses does not read.
    let _ = child.stdin.take().unwrap().write_all(input);
    child.wait_with_output().unwrap()
}

fn good(folder: &Path, args: &[&str], input: &[u8]) -> Vec<u8> {
    let done = fed(folder, args, input);
    assert!(done.status.success() && done.stderr.is_empty(), "{args:?}: {done:?}");
    done.stdout
}

#[test]
fn models_come_from_standard_input_and_go_to_standard_output() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let model = fs::read(built(here, "ball", [40, 40, 40], &[], ball(40, 15.0))).unwrap();
    let packed = good(here, &["pack", "-", "-o", "-"], &model);
    assert!(packed.len() < model.len());
    assert_eq!(good(here, &["unpack", "-", "-o", "-"], &packed), model);
    for command in ["info", "verify"] {
        let named: Value =
            serde_json::from_slice(&good(here, &[command, "ball.oct", "--json"], &[])).unwrap();
        let mut fed: Value = serde_json::from_slice(&good(here, &[command, "-", "--json"], &model)).unwrap();
        assert_eq!(fed["input"], "-");
        fed["input"] = named["input"].clone();
        assert_eq!(fed, named);
    }
    let size = ["--size", "60x50"];
    let picture = good(here, &[&["render", "-", "-o", "-"], &size[..]].concat(), &model);
    good(here, &[&["render", "ball.oct", "-o", "p.png"], &size[..]].concat(), &[]);
    assert_eq!(picture, fs::read(here.join("p.png")).unwrap());
    let thumbnail = good(here, &["thumbnail", "ball.oct", "-o", "-", "--size", "64"], &[]);
    assert_eq!(thumbnail[1..4], *b"PNG");
    // What is not a model is refused by a sentence, and told as an object on demand.
    let wrong = fed(here, &["info", "-", "--json"], b"no model");
    assert_eq!(wrong.status.code(), Some(3), "{wrong:?}");
    assert!(String::from_utf8_lossy(&wrong.stderr).contains("standard input"), "{wrong:?}");
    assert_eq!(serde_json::from_slice::<Value>(&wrong.stdout).unwrap()["kind"], "input");
    assert_eq!(names(here), ["ball.oct", "ball.raw", "p.png"]);
    // A reader that goes away is not a failure.
    let gone = r#"cd "$1"; "$OCT" render ball.oct -o - --size 900x900 | head -c 10 > /dev/null; echo $?"#;
    if cfg!(unix) {
        assert_eq!(shell(gone, &[text(here)]).stderr, "");
    }
}

#[test]
fn a_headerless_volume_comes_from_standard_input_and_gives_the_same_model() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    raw(&here.join("v.raw"), [24, 24, 24], ball(24, 9.0));
    let bytes = fs::read(here.join("v.raw")).unwrap();
    let shape = ["--dims", "24x24x24", "--dtype", "u16", "--iso", "500", "--json"];
    good(here, &[&["build", "v.raw", "-o", "a.oct"], &shape[..]].concat(), &[]);
    let report = good(here, &[&["build", "-", "-o", "b.oct"], &shape[..]].concat(), &bytes);
    let report: Value = serde_json::from_slice(&report).unwrap();
    assert_eq!(report["input"], "-");
    let info = |name: &str| oct(&["info", &text(&here.join(name)), "--json"]).json();
    assert_eq!(info("a.oct")["checksum"], info("b.oct")["checksum"]);
    let short = fed(here, &[&["build", "-", "-o", "c.oct"], &shape[..]].concat(), &bytes[..100]);
    assert_eq!(short.status.code(), Some(3), "{short:?}");
    assert_eq!(names(here), ["a.oct", "b.oct", "v.raw"]);
}

#[test]
fn where_a_dash_makes_no_sense_it_is_refused_and_never_a_file() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    built(here, "ball", [24, 24, 24], &[], ball(24, 9.0));
    let before = names(here);
    for (args, word) in [
        (&["build", "-", "-o", "m.oct"][..], "--dims"),
        (&["build", "ball.raw", "-", "-o", "m.oct"], "several inputs"),
        (&["build", "ball.raw", "-o", "-", "--dims", "24x24x24", "--dtype", "u16"], "name a file"),
        (&["batch", "-", "--out", "out"], "searched"),
        (&["batch", ".", "--out", "-"], "folder"),
        (&["scan", "-"], "searched"),
        (&["demo", "-o", "-", "--size", "16"], "name a file"),
        (&["demo", "-o", "m.oct", "--size", "16", "--write-raw", "-"], "name a file"),
        (&["render", "ball.oct", "-o", "p.png", "--depth", "-"], "one picture"),
        (&["render", "ball.oct", "-o", "-", "--json"], "both"),
        (&["pores", "ball.oct", "--csv", "-"], "a table"),
        (&["thickness", "ball.oct", "--csv", "-"], "a table"),
        (&["man", "-"], "folder"),
    ] {
        let done = fed(here, args, b"");
        let told = String::from_utf8_lossy(&done.stderr).into_owned();
        assert_eq!(done.status.code(), Some(2), "{args:?}: {told}");
        assert!(told.contains(word) && told.matches('\n').count() == 1, "{args:?}: {told}");
        assert_eq!(names(here), before, "{args:?}");
    }
}

#[test]
fn names_that_say_something_else_are_refused_unless_insisted_on() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    built(here, "ball", [24, 24, 24], &[], ball(24, 9.0));
    let before = names(here);
    let shape = ["--dims", "24x24x24", "--dtype", "u16", "--iso", "500"];
    for args in [
        &[&["build", "ball.raw", "-o", "x.png"], &shape[..]].concat()[..],
        &["pack", "ball.oct", "-o", "x.nrrd"],
        &["render", "ball.oct", "-o", "x.jpg", "--size", "20x20"],
        &["render", "ball.oct", "-o", "x.png", "--depth", "d.TIFF", "--size", "20x20"],
        &["thumbnail", "ball.oct", "-o", "x.oct"],
        &["demo", "-o", "x.png", "--size", "16"],
    ] {
        let refused = fed(here, args, b"");
        let told = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert_eq!((refused.status.code(), names(here) == before), (Some(2), true), "{args:?}: {told}");
        assert!(told.contains("--force"), "{told}");
        if args[0] != "demo" {
            good(here, &[args, &["--force"]].concat(), &[]);
            names(here).iter().filter(|name| !before.contains(name)).for_each(|name| {
                fs::remove_file(here.join(name)).unwrap();
            });
        }
    }
}
