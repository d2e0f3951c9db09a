//! `oct build` of a mesh as a user runs it: what was chosen is told with figures, what does not fit is refused in a
//! sentence with the cure, and the whole process stays within its memory.

use crate::prelude::*;

fn put(name: &str, bytes: &[u8]) -> (tempfile::TempDir, String, String) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    let model = folder.path().join("a.oct");
    let text = |p: &std::path::Path| p.to_str().unwrap().to_owned();
    let (path, model) = (text(&path), text(&model));
    (folder, path, model)
}

fn ball() -> Body {
    Body::sphere([10.0, -3.0, 5.0], 20.0, 4)
}

#[test]
fn what_was_found_and_chosen_is_told_in_a_sentence_with_figures() {
    let (_folder, mesh, model) = put("ball.stl", &ball().stl());
    let run = oct(&["build", &mesh, "-o", &model, "--grid", "102", "--memory", "64MiB", "--json"]);
    let json = run.json();
    assert_eq!(json["dims"], serde_json::json!([102, 102, 102]));
    let told = json["warnings"][0].as_str().unwrap();
    for words in ["2048 triangles", "closed", "winds around", "voxels of 0.4 mm from -10.4, -23.4, -15.4"] {
        assert!(told.contains(words), "{words:?} is missing: {told}");
    }
    let info = oct(&["info", &model, "--json"]).json();
    assert_eq!(info["spacing_mm"], serde_json::json!([0.4, 0.4, 0.4]));
    oct(&["verify", &model, "--json"]).json();
    let picture = model.replace("a.oct", "a.png");
    oct(&["thumbnail", &model, "-o", &picture, "--json"]).json();
    // Neither the name of the file nor its format travels with the model.
    let bytes = std::fs::read(&model).unwrap();
    for name in ["ball", "stl", "STL"] {
        assert!(!bytes.windows(name.len()).any(|part| part == name.as_bytes()), "{name}");
    }
}

#[test]
fn flags_that_do_not_fit_are_refused_by_name() {
    let (_folder, mesh, model) = put("ball.ply", &ball().ply("ascii"));
    let build = |more: &[&str]| {
        let mut args = vec!["build", &mesh, "-o", &model];
        args.extend(more);
        oct(&args)
    };
    build(&["--grid", "64", "--iso", "3"]).refused(2, &["--iso is for volumes"]);
    build(&["--grid", "64", "--keep-largest", "1"]).refused(2, &["--keep-largest is for volumes"]);
    build(&["--voxel", "1", "--dims", "9x9x9"]).refused(2, &["--dims of a mesh needs --voxel and --origin"]);
    build(&["--grid", "64", "--voxel", "1"]).refused(2, &["--grid"]);
    build(&["--grid", "0"]).refused(2, &["1 to 16384"]);
    build(&["--voxel", "0"]).refused(2, &["above 0"]);
    build(&["--voxel", "1e-9"]).refused(3, &["16384"]);
    build(&["--grid", "64", "--unit", "furlong"]).refused(2, &["mm"]);
    build(&["--grid", "64", "--memory", "2MiB"]).refused(4, &["--memory"]);
    build(&["--grid", "64", "--channels", "value"]).refused(2, &["value"]);
    let (_folder, raw, model) = put("a.raw", &[1; 64]);
    oct(&["build", &raw, "-o", &model, "--dims", "4x4x4", "--dtype", "u8", "--grid", "64"])
        .refused(2, &["--grid is for meshes"]);
}

#[test]
fn sheets_and_thin_walls_are_built_where_they_are_asked_for() {
    let (_folder, mesh, model) = put("plate.stl", &Body::cuboid([2.0, 2.0, 4.8], [12.0, 12.0, 5.2]).stl());
    let grid = ["--voxel", "1", "--origin", "0,0,0", "--dims", "14x14x10", "--memory", "64MiB", "--json"];
    let build = |more: &[&str]| oct(&[&["build", &mesh, "-o", &model], &grid[..], more].concat());
    build(&[]).refused(3, &["no voxel is inside"]);
    let json = build(&["--keep-thin"]).json();
    assert_eq!(json["skin_voxels"], 100);
    assert!(json["warnings"][0].as_str().unwrap().contains("walls thinner than a voxel are kept"), "{json}");
    // Its lower face, its upper one, and its sides, which lie between voxels.
    let json = build(&["--fill", "surface"]).json();
    let told = json["warnings"][0].as_str().unwrap();
    assert!(told.contains("closed") && told.contains("the mesh itself crosses, as asked for"), "{told}");
    assert_eq!(json["skin_voxels"], 200);
    let (_folder, tree, model) = put("a.csg", b"cube(3);");
    oct(&["build", &tree, "-o", &model, "--grid", "9", "--keep-thin"]).refused(2, &["--keep-thin"]);
}

#[test]
fn the_grid_in_full_moves_and_scales_nothing() {
    let body = Body::cuboid([2.0, 3.0, 4.0], [12.0, 13.0, 14.0]);
    let (_folder, mesh, model) = put("box.obj", &body.obj());
    let whole = ["--voxel", "0.5", "--origin", "-1,0,1.5", "--dims", "40x50x60"];
    let mut args = vec!["build", &mesh, "-o", &model, "--json", "--memory", "64MiB"];
    args.extend(whole);
    let json = oct(&args).json();
    assert_eq!(json["dims"], serde_json::json!([40, 50, 60]));
    // 20 voxels a side.
    assert_eq!(json["skin_voxels"], 20 * 20 * 20 - 18 * 18 * 18);
}

#[test]
fn without_a_grid_512_voxels_lie_along_the_longest_side() {
    let (_folder, mesh, model) = put("plate.stl", &Body::cuboid([2.0, 2.0, 4.8], [12.0, 12.0, 5.2]).stl());
    let json = oct(&["build", &mesh, "-o", &model, "--json"]).json();
    assert_eq!(json["dims"], serde_json::json!([512, 512, 23]));
    let json = oct(&["build", &mesh, "-o", &model, "--margin", "6", "--json"]).json();
    assert_eq!(json["dims"], serde_json::json!([512, 512, 32]));
    let (_folder, tree, model) = put("a.csg", b"cube(size = [10, 10, 0.4]);");
    let json = oct(&["build", &tree, "-o", &model, "--json"]).json();
    assert_eq!(json["dims"], serde_json::json!([512, 512, 23]));
}

#[test]
fn a_body_of_an_unlikely_size_has_a_hint_at_its_unit() {
    let (_folder, mesh, model) = put("ball.stl", &Body::sphere([0.0; 3], 0.08, 3).stl());
    let hints = |more: &[&str]| {
        let line = [&["build", &mesh, "-o", &model, "--grid", "40", "--json"], more].concat();
        oct(&line).json()["hints"].clone()
    };
    let said = hints(&[]).to_string();
    assert!(said.contains("longest side is 0.1") && said.contains("--unit"), "{said}");
    assert_eq!(hints(&["--unit", "m"]), serde_json::json!([]));
}

#[test]
fn y_may_be_up_in_files_that_do_not_say_what_is() {
    let corners = [[0.0, 0.0, 0.0], [10.0, 2.0, 1.0], [1.0, 30.0, 3.0], [2.0, 4.0, 15.0]];
    let faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
    let upright = corners.map(|[x, y, z]| [x, -z, y]);
    let [lying, standing] = [corners, upright].map(|corners| Body::new(&corners, &faces));
    // Normals of vertices, which a skin keeps.
    let looks = |corners: [[f64; 3]; 4]| {
        let line = |kind: &str, [x, y, z]: [f64; 3]| format!("{kind} {x} {y} {z}\n");
        let vertices: String = corners.iter().map(|v| line("v", *v)).collect();
        let normals: String = corners.iter().map(|v| line("vn", v.map(|c| c + 1.0))).collect();
        let face = |f: [usize; 3]| f.map(|k| format!("{0}//{0}", k + 1)).join(" ");
        let faces: String = faces.iter().map(|f| format!("f {}\n", face(*f))).collect();
        (vertices + &normals + &faces).into_bytes()
    };
    let shifted = corners.map(|v| v.map(|c| c - 1.0));
    let upright_looks = {
        let text = String::from_utf8(looks(shifted)).unwrap();
        let turned = |line: &str| match line.split(' ').collect::<Vec<_>>()[..] {
            [kind @ ("v" | "vn"), x, y, z] => format!("{kind} {x} {} {y}\n", -z.parse::<f64>().unwrap()),
            _ => format!("{line}\n"),
        };
        text.lines().map(turned).collect::<String>().into_bytes()
    };
    for (name, lying, standing) in [
        ("a.stl", lying.stl(), standing.stl()),
        ("b.stl", lying.stl_text(), standing.stl_text()),
        ("a.ply", lying.ply("binary_little_endian"), standing.ply("binary_little_endian")),
        ("a.obj", looks(shifted), upright_looks),
        ("a.off", lying.off(), standing.off()),
    ] {
        for surface in ["skin", "cells"] {
            let content = |bytes: &[u8], more: &[&str]| {
                let (_folder, mesh, model) = put(name, bytes);
                let line = ["build", &mesh, "-o", &model, "--grid", "60", "--json", "--surface", surface];
                oct(&[&line[..], more].concat()).json();
                oct(&["info", &model, "--json"]).json()["checksum"].clone()
            };
            let set_up = content(&lying, &["--up", "y"]);
            assert_eq!(set_up, content(&standing, &[]), "{name}, {surface}");
            assert_ne!(set_up, content(&lying, &["--up", "z"]), "{name}, {surface}");
        }
    }
}

#[test]
fn a_mesh_is_built_within_a_small_cap_of_the_whole_process() {
    // Two MiB more where the code is not optimised.
    let cap = if cfg!(debug_assertions) { "11MiB" } else { "8MiB" };
    let (_folder, mesh, model) = put("ball.off", &Body::sphere([0.0; 3], 100.0, 6).off());
    for threads in ["1", "2"] {
        let line = format!("build {mesh} -o {model} --grid 512 --memory {cap} --threads {threads} --json");
        let json = oct(&line.split(' ').collect::<Vec<_>>()).json();
        let (peak, limit) = (json["peak_rss_bytes"].as_u64(), json["memory_budget_bytes"].as_u64());
        assert!(peak <= limit, "{peak:?} of {limit:?}");
    }
}

#[test]
fn scan_and_batch_take_meshes() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    std::fs::create_dir(at("in")).unwrap();
    let put = |name: &str, bytes: &[u8]| std::fs::write(at(&format!("in/{name}")), bytes).unwrap();
    put("ball.stl", &ball().stl());
    put("again.stl", &ball().stl());
    put("ball.obj", &ball().obj());
    put("cut.stl", &ball().stl()[..700]);
    put("notes.txt", b"nothing");
    let (input, out) = (at("in"), at("out"));
    // The grid needs not be said.
    let scan = oct(&["scan", &input, "--json"]).json();
    assert_eq!(scan["items"], oct(&["scan", &input, "--grid", "40", "--json"]).json()["items"]);
    let said = |key: &str| scan[key].as_u64().unwrap();
    assert_eq!((said("usable"), said("refused"), said("copies")), (2, 1, 1));
    let names = |report: &serde_json::Value| {
        let named = |item: &serde_json::Value| {
            let input = std::path::Path::new(item["input"].as_str().unwrap());
            (input.file_name().unwrap().to_str().unwrap().to_owned(), item["name"].to_string())
        };
        report["items"].as_array().unwrap().iter().map(named).collect::<Vec<_>>()
    };
    let batch = |grid: &str| {
        let grid = if grid.is_empty() { vec![] } else { vec!["--grid", grid] };
        let run = oct(&[&["batch", &input, "--out", &out, "--memory", "24MiB", "--json"], &*grid].concat());
        assert_eq!(run.code, 8, "{}", run.stderr);
        serde_json::from_str::<serde_json::Value>(&run.stdout).unwrap()
    };
    let report = batch("40");
    assert_eq!(names(&report), names(&scan));
    let counts = |r: &serde_json::Value| ["converted", "skipped", "failed"].map(|k| r[k].as_u64().unwrap());
    assert_eq!(counts(&report), [2, 1, 1]);
    // The same bytes as one by one.
    let model = at("one.oct");
    for item in report["items"].as_array().unwrap().iter().filter(|i| i["status"] == "converted") {
        assert!(item["name"].as_str().unwrap().len() == 16 && item["kind"] == "triangle mesh", "{item}");
        oct(&["build", item["input"].as_str().unwrap(), "-o", &model, "--grid", "40", "--json"]).json();
        let beside = |key: &str| at(&format!("out/{}", item["model"][key].as_str().unwrap()));
        assert!(std::fs::read(beside("file")).unwrap() == std::fs::read(&model).unwrap(), "{item}");
        assert!(std::path::Path::new(&beside("thumbnail")).is_file());
    }
    assert_eq!(counts(&batch("40")), [0, 3, 1]);
    assert_eq!(counts(&batch("48")), [2, 1, 1]);
    // By itself as fine as a model that is built alone in this memory.
    let report = batch("");
    assert_eq!((counts(&report), counts(&batch(""))), ([2, 1, 1], [0, 3, 1]));
    let item = report["items"].as_array().unwrap().iter().find(|item| item["status"] == "converted").unwrap();
    let own = ["build", item["input"].as_str().unwrap(), "-o", &model, "--memory", "24MiB", "--json"];
    oct(&own).json();
    let batched = at(&format!("out/{}", item["model"]["file"].as_str().unwrap()));
    assert!(std::fs::read(batched).unwrap() == std::fs::read(&model).unwrap());
}

#[test]
fn scan_and_batch_take_trees_of_solids_as_they_take_meshes() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    std::fs::create_dir_all(at("in/parts")).unwrap();
    let put = |name: &str, bytes: &[u8]| std::fs::write(at(&format!("in/{name}")), bytes).unwrap();
    put("parts/ball.stl", &ball().stl());
    put("a.csg", b"difference() { cube(10); sphere(6); }");
    put("copy.csg", b"difference() { cube(10); sphere(6); }");
    put("cut.csg", b"difference() { cube(10);");
    put("odd.csg", b"\xff\xfe\x00\x01");
    put("held.csg", b"difference() { import(\"parts/ball.stl\"); sphere(6); }");
    put("gone.csg", b"import(\"parts/gone.stl\");");
    put("text", b"// no suffix\nunion() { torus(8, 2); }");
    let inside = |i: usize| [i % 8, i / 8 % 8, i / 64].iter().all(|c| (2..6).contains(c));
    put("ct.raw", &(0..512).map(|i| if inside(i) { 9 } else { 0 }).collect::<Vec<u8>>());
    put("ct.json", br#"{"dims": [8, 8, 8], "dtype": "u8", "spacing_mm": [1, 1, 1]}"#);
    put("own.csg", b"difference() { volume(\"ct.raw\", iso = 5); sphere(2); }");
    let (input, out) = (at("in"), at("out"));
    let scan = oct(&["scan", &input, "--json"]).json();
    let said = |key: &str| scan[key].as_u64().unwrap();
    assert_eq!((said("usable"), said("refused"), said("copies")), (6, 3, 1), "{scan}");
    let reason_of = |name: &str| {
        let items = scan["items"].as_array().unwrap().iter();
        let item = items.clone().find(|item| item["input"].as_str().unwrap().ends_with(name)).unwrap();
        item["reason"].as_str().unwrap().to_owned()
    };
    for (name, words) in [("/cut.csg", "before the end"), ("/odd.csg", "line 1"), ("/gone.csg", "gone.stl")] {
        assert!(reason_of(name).contains(words), "{}", reason_of(name));
    }
    let text = oct(&["scan", &input, "--grid", "40"]).stdout;
    assert!(text.contains("a tree of solids, on the grid that is asked for -> csg-"), "{text}");
    let batch = |memory: &str| {
        let run = oct(&["batch", &input, "--out", &out, "--grid", "40", "--memory", memory, "--json"]);
        assert_eq!(run.code, 8, "{}", run.stderr);
        serde_json::from_str::<serde_json::Value>(&run.stdout).unwrap()
    };
    let counts = |r: &serde_json::Value| ["converted", "skipped", "failed"].map(|k| r[k].as_u64().unwrap());
    let report = batch("32MiB");
    assert_eq!(counts(&report), [6, 1, 3], "{report}");
    // The same bytes as one by one; a tree on the grid of its volume takes no other.
    let model = at("one.oct");
    let mut trees = 0;
    for item in report["items"].as_array().unwrap().iter().filter(|i| i["status"] == "converted") {
        let path = item["input"].as_str().unwrap();
        let grid = ["--grid", "40"];
        let own = ["own.csg", "ct.json"].iter().any(|name| path.ends_with(name));
        let mut args = vec!["build", path, "-o", &model, "--json"];
        args.extend(grid.iter().filter(|_| !own));
        oct(&args).json();
        trees += u32::from(item["kind"] == "tree of solids" && item["format"] == "csg");
        let built = at(&format!("out/{}", item["model"]["file"].as_str().unwrap()));
        assert!(std::fs::read(built).unwrap() == std::fs::read(&model).unwrap(), "{item}");
    }
    assert_eq!(trees, 4);
    assert_eq!(counts(&batch("32MiB")), [0, 7, 3]);
    // What a tree names is a part of it.
    put("parts/ball.stl", &Body::sphere([10.0, -3.0, 5.0], 19.0, 4).stl());
    assert_eq!(counts(&batch("32MiB")), [2, 5, 3]);
}

#[test]
fn content_decides_what_is_built_and_names_count_where_it_is_silent() {
    let (_folder, mesh, model) = put("part.dat", &ball().stl());
    oct(&["build", &mesh, "-o", &model, "--grid", "40", "--json"]).json();
    oct(&["build", &mesh, "-o", &model, "--grid", "40", "--iso", "3"]).refused(2, &["--iso is for volumes"]);
    let json = oct(&["build", &mesh, "-o", &model, "--json"]).json();
    assert_eq!(json["dims"], serde_json::json!([512, 512, 512]));
    let (_folder, tree, model) = put("tree.txt", b"cube(3);");
    oct(&["build", &tree, "-o", &model, "--grid", "9", "--json"]).json();
    oct(&["build", &tree, "-o", &model, "--grid", "9", "--otsu"]).refused(2, &["a tree of solids"]);
    for (name, words) in [("a.stl", "a.stl"), ("a.ply", "a.ply"), ("a.off", "a.off"), ("a.csg", "line 1")] {
        let (_folder, junk, model) = put(name, &[7; 300]);
        oct(&["build", &junk, "-o", &model, "--grid", "9"]).refused(3, &[words]);
    }
    let (_folder, volume, model) = put(
        "a.stl",
        b"NRRD0004\ntype: uint8\ndimension: 3\nsizes: 2 2 2\nencoding: raw\n\n\0\x01\0\0\0\0\0\0",
    );
    oct(&["build", &volume, "-o", &model, "--iso", "1", "--json"]).json();
    oct(&["build", &volume, "-o", &model, "--grid", "9"]).refused(2, &["--grid is for meshes"]);
}

/// What is built where nothing is said: cells, but skin for what only that has.
#[test]
fn cells_are_the_default_but_for_what_only_skin_has() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| text(&folder.path().join(name));
    let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let faces = "f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";
    for (name, color) in [("plain.obj", ""), ("red.obj", " 1 0 0")] {
        let lines: String = corners.iter().map(|[x, y, z]| format!("v {x} {y} {z}{color}\n")).collect();
        fs::write(at(name), lines + faces).unwrap();
    }
    let sphere = "synthetic:sphere@24 --iso 0.5";
    for (what, surface) in [
        (sphere.to_owned(), "cells"),
        (format!("{sphere} --channels normal"), "cells"),
        (format!("{sphere} --surface skin"), "skin"),
        (format!("{sphere} --channels value"), "skin"),
        (format!("{sphere} --channels normal,offset"), "cells"),
        (format!("{sphere} --gradient central"), "skin"),
        (format!("{sphere} --connectivity 6"), "skin"),
        (format!("{} --grid 12", at("plain.obj")), "cells"),
        (format!("{} --grid 12", at("red.obj")), "cells"),
        (format!("{} --grid 12 --keep-thin", at("plain.obj")), "skin"),
    ] {
        let script =
            format!("\"$OCT\" build {what} -o \"$1\" --force --quiet && \"$OCT\" info \"$1\" --json");
        let info = shell(&script, &[at("m.oct")]).json();
        assert_eq!(info["surface"].as_str(), Some(surface), "{what}");
    }
    for (what, channels, is_said) in [
        ("plain.obj", "normal", false),
        ("red.obj", "normal color", false),
        ("plain.obj --error 0.1", "normal", false),
        ("red.obj --error 0.1", "normal", true),
    ] {
        let script = format!(
            "\"$OCT\" build {} --grid 12 -o \"$1\" --force --json && \"$OCT\" info --all \"$1\"",
            at(what)
        );
        let said = shell(&script, &[at("n.oct")]).stdout;
        assert_eq!(said.contains("which larger leaves do not hold; leave out --error"), is_said, "{what}");
        assert_eq!(said.contains("\ncolor "), channels.contains("color"), "{what}: {said}");
    }
}
