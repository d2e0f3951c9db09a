//! Solids and label maps as other programs write them, each as its folder's README says. Skipped without the data.

use crate::prelude::*;

/// Builds an input; the report.
fn build(folder: &Path, input: &Path, extra: &[&str]) -> Value {
    let (input, model) = (text(input), text(&folder.join("m.oct")));
    oct(&[&["build", &input, "-o", &model, "--json"], extra].concat()).json()
}

fn notes(report: &Value) -> String {
    report["warnings"]
        .as_array()
        .unwrap()
        .iter()
        .map(|note| note.as_str().unwrap())
        .collect::<Vec<_>>()
        .join("; ")
}

#[test]
fn solids_of_other_programs_come_out_right() {
    let Some(data) = real_data("solids") else { return };
    let folder = tempfile::tempdir().unwrap();
    let grid = ["--grid", "48"];
    for (name, words) in [
        ("lib3mf-pyramid.3mf", &["10 triangles, closed"][..]),
        ("lib3mf-box.3mf", &["48 triangles, closed"]),
        ("lib3mf-slices-2boxes.3mf", &["in 2 parts", "exact shape as slices"]),
        ("lib3mf-two-start-parts.3mf", &["10 triangles, closed", "begins with 2 texts; the first was built"]),
        ("packaging-pyramids.3mf", &["in 12 parts, closed"]),
        ("trimesh-cubevt.obj", &["12 triangles, closed", "places in a texture (vt) that it does not hold"]),
        ("suzanne.obj", &["968 triangles, open"]),
        ("03_skinned_cylinder.gltf", &["316 triangles, closed"]),
    ] {
        let notes = notes(&build(folder.path(), &data.join(name), &grid));
        assert!(words.iter().all(|words| notes.contains(words)), "{name}: {notes}");
    }
    // Open, and with more open edges than are closed: the fill has to be said. It has 7.7 million triangles.
    if long() > 1 {
        let instances = data.join("24_gpu_instancing.gltf");
        let notes = notes(&build(folder.path(), &instances, &[&grid[..], &["--fill", "parity"]].concat()));
        assert!(notes.contains("parts") && !notes.contains("1 part,"), "{notes}");
    }
    // An open OBJ takes no more memory than the same mesh in another format.
    let cap = if cfg!(debug_assertions) { "11MiB" } else { "8MiB" };
    build(folder.path(), &data.join("suzanne.obj"), &["--grid", "64", "--memory", cap]);
    // The line at which faces have more fields than the header says.
    let model = text(&folder.path().join("m.oct"));
    let bad = text(&data.join("trimesh-fuze-bad.ply"));
    oct(&["build", &bad, "-o", &model, "--grid", "48"]).refused(3, &["fuze-bad.ply: line 523"]);
}

#[test]
fn label_maps_of_other_programs_keep_all_their_labels() {
    let Some(data) = real_data("labels") else { return };
    let folder = tempfile::tempdir().unwrap();
    let labels = || {
        let info = oct(&["info", &text(&folder.path().join("m.oct")), "--json"]).json();
        let labels = info["labels"].as_array().unwrap().clone();
        labels.iter().map(|label| label["number"].as_u64().unwrap()).collect::<Vec<_>>()
    };
    for (name, count, first, last) in [
        ("totalseg-example.nii.gz", 41, 1, 117),
        ("totalseg-spine.nii.gz", 8, 26, 33),
        ("liver_spine_seg.nrrd", 2, 1, 2),
        ("partial_overlaps-1.nrrd", 3, 1, 5),
        ("sparse-labelmap-ppv5.dcm", 1, 1, 1),
        ("liver.dcm", 1, 1, 1),
    ] {
        let path = data.join(name);
        // Without a threshold all of them are inside, whatever Otsu's method would say.
        let report = build(folder.path(), &path, &["--surface", "skin"]);
        let least = if name.contains("spine.nii") { 26.0 } else { 1.0 };
        assert_eq!(report["range"]["lo"], least, "{name}: {report}");
        build(folder.path(), &path, &["--labels", "all"]);
        let found = labels();
        assert_eq!(
            (found.len(), found[0], *found.last().unwrap()),
            (count, first, last),
            "{name}: {found:?}"
        );
    }
    // Segments of one file are one map, and single masks of a folder volumes of their own.
    for (name, count, labels) in [("partial_overlaps.dcm", 1, Some(5)), ("masks", 8, None)] {
        let listed = oct(&["scan", &text(&data.join(name)), "--json"]).json();
        assert_eq!(listed["items"].as_array().unwrap().len(), count, "{name}: {listed}");
        assert_eq!(listed["items"][0]["label_count"].as_u64(), labels, "{name}: {listed}");
    }
}
