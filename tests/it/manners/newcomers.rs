//! Stumbles of users on their first day, and the sentences that help now.

use super::{ball, built, raw};
use crate::prelude::*;

#[test]
fn a_text_apart_from_its_option_and_topics_of_help_are_understood() {
    oct(&["render", "a.oct", "-o", "a.png", "--title", "My skull"])
        .refused(2, &["My skull", "--title='My text'"]);
    for (page, words) in [("measuring", "Hausdorff distance"), ("synthetic", "synthetic:torus@192")] {
        let shown = oct(&["help", page]);
        assert!(shown.code == 0 && shown.stdout.contains(words), "{shown:?}");
    }
    let help = oct(&["--help"]).stdout;
    assert!(help.contains("oct help measuring") && !help.contains("(s)"), "{help}");
    // Options that are not about meshes stand above their heading.
    for (command, options) in [("build", &["--resume", "--each"][..]), ("plan", &["--parts"])] {
        let help = oct(&[command, "--help"]).stdout;
        let meshes = help.find("Meshes (STL").unwrap();
        for option in options {
            assert!(help.find(&format!("\n      {option} ")).unwrap() < meshes, "{option}: {help}");
        }
    }
}

#[test]
fn downsampling_of_thick_slices_states_what_is_left() {
    let folder = tempfile::tempdir().unwrap();
    raw(&folder.path().join("v.raw"), [24, 24, 24], ball(24, 9.0));
    let build = |spacing: &str| {
        let shape = ["--dims", "24x24x24", "--dtype", "u16", "--iso", "500", "--downsample", "2", "--json"];
        let (input, output) = (folder.path().join("v.raw"), folder.path().join("m.oct"));
        let report = oct(&[
            &["build", &text(&input), "-o", &text(&output), "--spacing", spacing],
            &shape[..],
        ]
        .concat());
        report.json()["warnings"].to_string()
    };
    assert!(build("0.7x0.7x5").contains("voxels of 1.4 x 1.4 x 10 mm"));
    assert_eq!(build("1x1x1.5"), "[]");
}

#[test]
fn bodies_below_the_resolution_are_said_to_be_with_its_length() {
    let folder = tempfile::tempdir().unwrap();
    let thick = built(
        folder.path(),
        "thick",
        [24, 24, 24],
        &["--spacing", "1x1x9", "--surface", "cells"],
        ball(24, 5.0),
    );
    let said = |extra: &[&str]| oct(&[&["pores", &text(&thick), "--bodies"], extra].concat()).stdout;
    let shown = said(&[]);
    assert!(
        shown.contains("1 body of a diameter below 27 mm, three voxels along their longest side"),
        "{shown}"
    );
    let shown = said(&["--least", "9000"]);
    assert!(shown.contains("0 bodies") && shown.contains("1 body of fewer voxels left out"), "{shown}");
    assert!(!shown.contains("diameter below"), "{shown}");
    let thin = built(folder.path(), "thin", [24, 24, 24], &["--surface", "cells"], ball(24, 9.0));
    let shown = oct(&["pores", &text(&thin), "--bodies"]).stdout;
    assert!(!shown.contains("three voxels"), "{shown}");
}

#[test]
fn a_threshold_that_was_not_chosen_is_doubted_and_parts_of_a_mesh_lose_their_names_aloud() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| text(&folder.path().join(name));
    raw(&folder.path().join("v.raw"), [24, 24, 24], |p| if p[0] < 3 { 0 } else { u16::from(p[0] < 12) + 1 });
    let build = |more: &[&str]| {
        let shape =
            ["build", &at("v.raw"), "-o", &at("m.oct"), "--dims", "24x24x24", "--dtype", "u16", "--json"];
        oct(&[&shape[..], more].concat()).json()
    };
    for (how, is_doubted) in [(&["--otsu"][..], true), (&["--iso", "0.5"], false)] {
        oct(&[&["build", "synthetic:sphere@24", "-o", &at("m.oct"), "--json"], how].concat()).json();
        let shown = oct(&["info", &at("m.oct")]).stdout;
        assert_eq!(shown.contains("sizes depend on it"), is_doubted, "{shown}");
    }
    build(&["--labels", "all"]);
    oct(&["export", &at("m.oct"), "-o", &at("m.glb"), "--json"]).json();
    let again = oct(&["build", &at("m.glb"), "-o", &at("again.oct"), "--grid", "32", "--json"]).json();
    assert!(again["warnings"].to_string().contains("parts become one solid, without their names"), "{again}");
}

#[test]
fn a_legend_without_room_says_how_to_see_the_rest() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| text(&folder.path().join(name));
    raw(&folder.path().join("v.raw"), [32, 8, 8], |[x, y, z]| {
        let is_inner = (2..30).contains(&x) && (2..6).contains(&y) && (2..6).contains(&z);
        if is_inner { 1 + u16::try_from(x / 2).unwrap() } else { 0 }
    });
    let build =
        ["build", &at("v.raw"), "-o", &at("m.oct"), "--dims", "32x8x8", "--dtype", "u16", "--labels", "all"];
    assert_eq!(oct(&build).code, 0);
    let notes = |size: &str| {
        let render = ["render", &at("m.oct"), "-o", &at("m.png"), "--legend", "--size", size, "--json"];
        oct(&render).json()["warnings"].to_string()
    };
    assert!(
        notes("128x96").contains("more labels; a higher picture (--size) lists them"),
        "{}",
        notes("128x96")
    );
    assert_eq!(notes("400x600"), "[]");
}

/// A segmentation is one volume with the numbers of its segments, which a build can choose: the numbers have no gap, and
/// the totals are the last number.
#[test]
fn a_scan_counts_without_gaps_and_names_body_parts() {
    let Some(labels) = real_data("labels") else { return };
    let shown = oct(&["scan", &text(&labels)]).stdout;
    let mut next = 1;
    for line in shown.lines().filter(|line| line.contains(" file)") || line.contains(" files)")) {
        let Some((numbers, _)) = line.split_once(". ") else { continue };
        let mut numbers = numbers.split(" to ").map(|number| number.trim().parse::<u64>().unwrap());
        let first = numbers.next().unwrap();
        assert_eq!(first, next, "{line}");
        next = numbers.next().unwrap_or(first) + 1;
    }
    assert!(shown.contains(", a map of 5 labels,"), "{shown}");
    let totals = shown.lines().find(|line| line.contains("would be converted")).unwrap();
    let sum = totals.split(';').next().unwrap().split(|c: char| !c.is_ascii_digit());
    let sum: u64 = sum.filter_map(|number| number.parse::<u64>().ok()).sum();
    assert_eq!(sum, next - 1, "{totals}");
    let folder = tempfile::tempdir().unwrap();
    for z in 0..2 {
        let image = Elements::ct(f64::from(z), z + 1, [1, 2, 3, 4]).with(0x0018_0015, "CS", "CHEST");
        fs::write(folder.path().join(format!("{z}.dcm")), image.bytes()).unwrap();
    }
    let shown = oct(&["scan", &text(folder.path())]).stdout;
    assert!(shown.contains("(dicom, CT image, CHEST, 2 files)"), "{shown}");
}
