//! A model of labels holds every label under its name and colour, whatever the format and the type of the samples, and
//! shows or hides each. If this fails, organs are lost or mixed up.
#![expect(clippy::cast_possible_truncation, reason = "numbers here are small by construction")]

use crate::common::volume::encode;
use crate::label_cells::check;
use crate::prelude::*;
use infobyte::builder::{BuildNote, LabelChoice};

/// Blocks of labels with ragged borders: `kinds` numbers from 1 on, some of them 300 and more apart, and none.
pub(crate) fn map(dims: [u32; 3], kinds: u32, block: u32, seed: u64) -> Vec<u16> {
    let mut random = Random(seed);
    let mut labels = Vec::new();
    for z in 0..dims[2] {
        for y in 0..dims[1] {
            for x in 0..dims[0] {
                let shaken = [x, y, z].map(|c| (c + u32::from(random.below(3_u8) == 0)) / block);
                let kind = (shaken[0] * 7 + shaken[1] * 13 + shaken[2] * 29) % (kinds + 1);
                labels.push((kind * if kinds > 200 { 200 } else { 1 }) as u16);
            }
        }
    }
    labels
}

fn counts(labels: &[u16], choice: &LabelChoice) -> Vec<(u16, u64)> {
    let mut counts = BTreeMap::new();
    labels.iter().filter(|label| choice.contains(**label)).for_each(|l| *counts.entry(*l).or_insert(0) += 1);
    counts.into_iter().collect()
}

/// Builds a volume within several shares of memory, `small` among them, and on several threads: the same bytes, which come
/// back packed and unpacked. The model is handed on.
pub(crate) fn built_alike(
    volume: &impl infobyte::volume::VolumeSource,
    options: &BuildOptions,
    small: u64,
    hold: impl FnOnce(&Model),
) {
    let folder = tempfile::tempdir().unwrap();
    let [path, packed, unpacked] = ["m.oct", "p.oct", "u.oct"].map(|name| folder.path().join(name));
    let mut first: Option<Vec<u8>> = None;
    for (memory, threads) in [(64 << 20, 1), (4 << 20, 2), (small, 1), (256 << 20, 5)] {
        let options =
            BuildOptions { memory: infobyte::budget::MemoryCap::Share(memory), threads, ..options.clone() };
        let least = infobyte::builder::smallest_share(volume, &options);
        if let Err(refusal) = infobyte::build(volume, &options, &path) {
            assert!(memory < least, "{refusal}");
            continue;
        }
        let bytes = std::fs::read(&path).unwrap();
        assert!(*first.get_or_insert_with(|| bytes.clone()) == bytes, "{memory} {threads}");
    }
    let model = Model::open(&path).unwrap();
    verify(&model).unwrap();
    pack::pack(&path, &packed).unwrap();
    assert_eq!(info::read_info(&packed).unwrap().frame.labels, model.frame().labels);
    pack::unpack(&packed, &unpacked).unwrap();
    assert!(Some(std::fs::read(&unpacked).unwrap()) == first);
    hold(&model);
}

#[test]
fn every_format_gives_the_same_labels_and_other_values_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let dims = [9, 8, 7];
    let values = |scalar: ScalarType, value: &dyn Fn(usize) -> f64| {
        let mut object = Object::new(dims, scalar, [1.0; 3]);
        object.bytes.clear();
        (0..9 * 8 * 7).for_each(|i| encode(scalar, value(i), &mut object.bytes));
        object
    };
    let label = |i: usize| f64::from((i * 7 % 5) as u8);
    let labels: Vec<u16> = (0..9 * 8 * 7).map(|i| label(i) as u16).collect();
    let at = |[x, y, z]: [u32; 3]| labels[(x + dims[0] * (y + dims[1] * z)) as usize];
    let model = folder.path().join("m.oct");
    for scalar in ScalarType::ALL {
        let object = values(scalar, &label);
        let files = [
            ("a.nrrd", nrrd(&object, "raw", false, "")),
            ("a.nii", [nifti(&object, 1, false, true, 1), object.bytes.clone()].concat()),
            ("a.mha", [metaimage(&object, false, false, "LOCAL"), object.bytes.clone()].concat()),
            ("a.npy", npy(&object, 1, false, false)),
        ];
        for (name, bytes) in files {
            let input = file(folder.path(), name, &bytes);
            let run = command::build(&[&input], &model, &["--labels", "all"]);
            assert_eq!(run.code, 0, "{scalar} {name}: {}", run.stderr);
            check(&Model::open(&model).unwrap(), dims, at);
        }
    }
    let refused: [(ScalarType, f64, &[&str], i32, &str); 9] = [
        (ScalarType::F32, 1.5, &["--labels", "all"], 3, "holds the value 1.5, and labels are whole numbers"),
        (ScalarType::F64, f64::NAN, &["--labels", "1"], 3, "NaN"),
        (ScalarType::I16, -3.0, &["--labels", "all"], 3, "holds the value -3"),
        (ScalarType::U32, 65_536.0, &["--labels", "all"], 3, "holds the value 65536"),
        (ScalarType::U8, 2.0, &["--labels", "9"], 3, "no voxel has one of the labels"),
        (
            ScalarType::U8,
            2.0,
            &["--labels", "all", "--error", "0.1"],
            2,
            "does not support larger leaves yet",
        ),
        (
            ScalarType::U8,
            2.0,
            &["--labels", "all", "--keep-largest", "1"],
            2,
            "leave out the choice of components",
        ),
        (ScalarType::U8, 2.0, &["--labels", "all", "--surface", "skin"], 2, "labels are stored as cells"),
        (ScalarType::U8, 2.0, &["--labels", "all", "--gradient", "label5"], 2, "cells are built"),
    ];
    for (scalar, odd, how, code, words) in refused {
        let object = values(scalar, &|i| if i == 300 { odd } else { label(i) });
        let input = file(folder.path(), "a.nrrd", &nrrd(&object, "raw", false, ""));
        command::build(&[&input], &model, how).refused(code, &[words]);
    }
    // What is not chosen may be anything whole, and what is not there is said.
    let object = values(ScalarType::I32, &|i| if i == 300 { -70_000.0 } else { label(i) });
    let input = file(folder.path(), "a.nrrd", &nrrd(&object, "raw", false, ""));
    let run = oct(&["build", &text(&input), "-o", &text(&model), "--labels", "2..3,77"]);
    let said = format!("{}{}", run.stdout, run.stderr);
    assert!(run.code == 0 && said.contains("no voxel has the label 77"), "{said}");
    assert_eq!(BuildNote::LabelsAbsent { first: 77, others: 0 }.to_string(), "no voxel has the label 77");
}

#[test]
fn what_does_not_know_labels_refuses_them_by_name_and_info_lists_them() {
    let folder = tempfile::tempdir().unwrap();
    let labels = map([40, 41, 42], 3, 8, 5);
    let volume =
        Voxels::from_fn(Dims::new(40, 41, 42).unwrap(), |[x, y, z]| labels[(x + 40 * (y + 41 * z)) as usize]);
    let path = folder.path().join("m.oct");
    let options = BuildOptions { labels: Some(LabelChoice::All), ..skin_options() };
    infobyte::build(&volume, &options, &path).unwrap();
    let info = oct(&["info", path.to_str().unwrap(), "--json"]).json();
    let table = info["labels"].as_array().unwrap();
    assert_eq!(table.len(), 3);
    for ((number, voxels), row) in counts(&labels, &LabelChoice::All).into_iter().zip(table) {
        assert_eq!((row["number"].as_u64(), row["voxels"].as_u64()), (Some(number.into()), Some(voxels)));
        assert_eq!(row["volume_mm3"].as_f64(), Some(voxels as f64));
        assert_eq!(row["color"].as_str().map(str::len), Some(7));
    }
    let names = file(
        folder.path(),
        "names.tsv",
        b"index\tname\tcolor\n1\tliver\t#102030\n3\tleft rib\tn/a\n9\tno\tn/a\n",
    );
    let mut object = Object::new([40, 41, 42], ScalarType::U16, [1.0; 3]);
    object.bytes = labels.iter().flat_map(|label| label.to_le_bytes()).collect();
    let input = file(folder.path(), "named.nrrd", &nrrd(&object, "raw", false, ""));
    let named = folder.path().join("named.oct");
    assert_eq!(
        command::build(&[&input], &named, &["--labels", "all", "--names", names.to_str().unwrap()]).code,
        0
    );
    let table = Model::open(&named).unwrap().frame().labels.clone();
    let told: Vec<_> = table.iter().map(|label| (label.number, label.name.as_str())).collect();
    assert_eq!(told, [(1, "liver"), (2, ""), (3, "left rib")]);
    assert_eq!(table[0].color, [0x10, 0x20, 0x30]);
    // 3D Slicer states names and colours in the header.
    let stated =
        "Segment0_Name:=spleen\nSegment0_Color:=1 0 0.2\nSegment0_LabelValue:=2\nSegment0_Layer:=0\n";
    let bytes = [nrrd(&object, "raw", false, stated), b"\n".to_vec(), object.bytes.clone()].concat();
    let segmented = file(folder.path(), "a.seg.nrrd", &bytes);
    let slicer = folder.path().join("slicer.oct");
    assert_eq!(command::build(&[&segmented], &slicer, &["--labels", "all"]).code, 0);
    let table = Model::open(&slicer).unwrap().frame().labels.clone();
    assert_eq!(
        (table[0].name.as_str(), table[1].name.as_str(), table[1].color),
        ("", "spleen", [255, 0, 51])
    );
    let shown = oct(&["info", named.to_str().unwrap()]);
    assert!(shown.stdout.contains("liver, #102030, "), "{}", shown.stdout);
    let text = oct(&["info", path.to_str().unwrap()]);
    assert!(text.stdout.contains("label 1 ") && text.stdout.contains("voxels, "), "{}", text.stdout);
    let heads = "colour, voxels, volume, surface; ± is the error in 19 of 20 cases";
    assert!(text.stdout.contains(heads) && shown.stdout.contains(&format!("name, {heads}\n")), "{text:?}");
    let all = oct(&["info", "--all", path.to_str().unwrap()]);
    assert!(all.stdout.contains("for volumes it is the surface times a quarter of a voxel"), "{all:?}");
    let page = folder.path().join("m.html");
    assert_eq!(oct(&["export", named.to_str().unwrap(), "-o", page.to_str().unwrap()]).code, 0);
    assert!(std::fs::read_to_string(&page).unwrap().contains("left rib"));
    let picture = folder.path().join("m.png");
    assert_eq!(oct(&["render", path.to_str().unwrap(), "-o", picture.to_str().unwrap()]).code, 0);
}

#[test]
fn labels_are_shown_alone_hidden_or_let_light_through() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| text(&folder.path().join(name));
    // A ball within a box, and a bar beside them.
    let label = |p: [u32; 3]| {
        let r = p.map(|c| (f64::from(c) - 15.5).powi(2)).iter().sum::<f64>();
        match p {
            _ if r < 81.0 => 7_u8,
            [3..28, 3..28, 3..28] => 5,
            [33..38, 10..20, 2..30] => 20,
            _ => 0,
        }
    };
    let mut object = Object::new([40, 36, 32], ScalarType::U8, [1.0; 3]);
    object.bytes = (0..40 * 36 * 32).map(|i| label([i % 40, i / 40 % 36, i / 40 / 36])).collect();
    let input = file(folder.path(), "a.nrrd", &nrrd(&object, "raw", false, ""));
    let names = file(folder.path(), "names.csv", b"index,name\n7,ball\n5,The Box\n");
    let how = ["--labels", "all", "--names", &text(&names), "--each", &at("each")];
    assert_eq!(command::build(&[&input], Path::new(&at("all.oct")), &how).code, 0);
    // The colours and normals of a model, and how many rays hit.
    let seen = |model: &str, how: &[&str]| {
        let (picture, normals) = (at("p.png"), at("n.png"));
        let files = ["render", &at(model), "-o", &picture, "--normals", &normals, "--json"];
        let fine = ["--projection", "perspective", "--size", "48x40", "--samples", "4"];
        let json = oct(&[&files[..], &fine, how].concat()).json();
        let read = |name: &str| std::fs::read(at(name)).unwrap();
        (read("n.png"), read("p.png"), json["hits"].as_u64().unwrap())
    };
    // From a fixed place.
    let shown = |model: &str, how: &[&str]| {
        let camera = ["--eye", "-70,-90,60", "--look-at", "18,16,16", "--fov", "20"];
        seen(model, &[&camera, how].concat())
    };
    // What is left of the whole is what a model of that alone shows.
    let ball = shown("each/ball.oct", &["--only", "7"]);
    let rest = shown("all.oct", &["--only", "5,20"]);
    assert!(ball.2 > 500 && rest.2 > ball.2 && ball.0 != rest.0);
    for how in [
        &["--only", "7"][..],
        &["--only", "BALL"],
        &["--hide", "The Box,20"],
        &["--hide", "5..6", "--opacity", "20=0"],
        &["--opacity", "all=0", "--opacity", "6..8=1"],
    ] {
        let found = shown("all.oct", how);
        assert!((&found.0, found.2) == (&ball.0, ball.2), "{how:?}");
        // A camera without a place frames what is visible.
        for view in [&["--view", "iso"][..], &["--view", "top", "--annotate"]] {
            let [own, found] = [seen("each/ball.oct", view), seen("all.oct", &[view, how].concat())];
            assert!((&found.0, found.2) == (&own.0, own.2), "{view:?} {how:?}");
        }
    }
    for how in [&["--hide", "ball"][..], &["--only", "5,10..20"]] {
        let found = shown("all.oct", how);
        assert!((&found.0, found.2) == (&rest.0, rest.2), "{how:?}");
    }
    let keys = "[[model]]\nfile = 'all.oct'\npivot = 'origin'\n";
    for (name, text) in [
        ("only", "only = [7]"),
        ("hide", "hide = [5, 'all', 20]\nopacity = { 7 = 1 }"),
        ("rule", "hide = ['the box', 20]"),
    ] {
        std::fs::write(at("s.toml"), format!("samples = 2\n{keys}{text}\n")).unwrap();
        let found = shown("s.toml", &[]);
        assert!(name == "hide" || (&found.0, found.2) == (&ball.0, ball.2), "{name}");
        // What is hidden stays so, however much of the light it would stop.
        assert!(name != "hide" || found.2 == 0, "{name}");
    }
    // Through a box of glass its ball is seen, in colours of both.
    let solid = shown("all.oct", &["--opacity", "all=1"]);
    let glass = shown("all.oct", &["--opacity", "5=0.3"]);
    assert!(glass.2 == solid.2 && glass.0 == solid.0 && glass.1 != solid.1);
    assert!(glass.1 != shown("all.oct", &["--hide", "7", "--opacity", "5=0.3"]).1);
    for (model, how, words) in [
        ("all.oct", &["--only", "8"][..], &["all.oct", "has no label 8", "oct info"][..]),
        ("all.oct", &["--hide", "7,liver"], &["has no label 'liver'"]),
        (
            "all.oct",
            &["--only", "the bx"],
            &["has no label 'the bx'", "did you mean 'The Box'?; oct info lists"],
        ),
        ("all.oct", &["--opacity", "7=2"], &["'7=2'", "from 0 to 1"]),
        ("all.oct", &["--hide", "9..3"], &["'9..3'", "lower number first"]),
        ("s.toml", &["--only", "8"], &["s.toml", "has no label 8"]),
    ] {
        let picture = at("refused.png");
        oct(&[&["render", &at(model), "-o", &picture][..], how].concat()).refused(2, words);
        assert!(!std::path::Path::new(&picture).exists());
    }
    let plain = at("plain.oct");
    assert_eq!(oct(&["build", "synthetic:sphere@20", "-o", &plain]).code, 0);
    oct(&["render", &plain, "-o", &at("refused.png"), "--hide", "1"]).refused(2, &["no labels", "--labels"]);
    std::fs::write(at("s.toml"), format!("{keys}opacity = {{ 7 = 3.0 }}\n")).unwrap();
    oct(&["render", &at("s.toml"), "-o", &at("refused.png")])
        .refused(3, &["[[model]] 1, opacity", "out of range"]);
}

/// Models of one label are measured as solids; of several, the refusal names a way to such a model.
#[test]
fn a_label_by_itself_is_measured_and_several_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| text(&folder.path().join(name));
    // A hollow ball within a box, and a bar 6 mm away from the ball.
    let label = |p: [u32; 3]| {
        let r = p.map(|c| (f64::from(c) - 15.5).powi(2)).iter().sum::<f64>().sqrt();
        match p {
            _ if r < 5.0 => 0_u8,
            _ if r < 11.0 => 7,
            [3..29, 3..29, 3..29] => 5,
            [33..38, 8..24, 4..28] => 20,
            _ => 0,
        }
    };
    let mut object = Object::new([42, 33, 32], ScalarType::U8, [1.0; 3]);
    object.bytes = (0..42 * 33 * 32).map(|i| label([i % 42, i / 42 % 33, i / 42 / 33])).collect();
    let input = file(folder.path(), "a.nrrd", &nrrd(&object, "raw", false, ""));
    let names = file(folder.path(), "names.csv", b"index,name\n7,ball\n20,bar\n");
    let how = ["--labels", "all", "--names", &text(&names), "--each", &at("each")];
    assert_eq!(command::build(&[&input], Path::new(&at("all.oct")), &how).code, 0);
    assert_eq!(command::build(&[&input], Path::new(&at("one.oct")), &["--labels", "7"]).code, 0);
    assert_eq!(
        command::build(&[&input], Path::new(&at("solid.oct")), &["--range", "7..7", "--surface", "cells"])
            .code,
        0
    );
    let near = |value: &Value, due: f64, off: f64| {
        assert!((value.as_f64().unwrap() - due).abs() < off, "{value}, not {due}");
    };
    for ball in ["each/ball.oct", "one.oct"].map(at) {
        let walls = oct(&["thickness", &ball, "-o", &at("t.oct"), "--force", "--json"]).json();
        near(&walls["thickness"]["mean"], 6.0, 0.3);
        assert_eq!((&walls["none"]["cells"], oct(&["verify", &at("t.oct")]).code), (&0.into(), 0));
        let pores = oct(&["pores", &ball, "--gap", "--json"]).json();
        assert_eq!(pores["pores"], 1, "{pores}");
        near(&pores["largest"][0]["gap_mm"], 6.0, 0.7);
        for pair in [[&ball, &at("solid.oct")], [&at("solid.oct"), &ball]] {
            let both = oct(&["compare", pair[0], pair[1], "--json"]).json();
            near(&both["deviation"]["rms"], 0.0, 0.3);
        }
        near(&oct(&["intersect", &ball, &at("each/bar.oct"), "--json"]).json()["clearance_mm"], 6.0, 0.3);
        let found =
            Model::open(&ball).unwrap().nearest(&[[15.5; 3], [23.5, 15.5, 15.5], [-10.0; 3]]).unwrap();
        assert_eq!(found.side, [1, -1, 1]);
    }
    for how in [&["thickness"][..], &["pores", "--gap"], &["compare", &at("solid.oct")]] {
        oct(&[how, &[&at("all.oct")]].concat()).refused(3, &["has several labels", "--labels"]);
    }
}

/// NIfTI files of masks, and the samples of each.
fn masks(folder: &Path, dims: [u32; 3], names: &[&str]) -> Vec<(PathBuf, Vec<u8>)> {
    let mut random = Random(8);
    let middle = |random: &mut Random| dims.map(|n| f64::from(n) * (0.3 + 0.4 * random.unit()));
    names
        .iter()
        .map(|name| {
            let (at, radius) = (middle(&mut random), 4.0 + 4.0 * random.unit());
            let inside = |i: u32| {
                let p = [i % dims[0], i / dims[0] % dims[1], i / dims[0] / dims[1]].map(f64::from);
                (0..3).map(|a| (p[a] - at[a]).powi(2)).sum::<f64>() < radius * radius
            };
            let samples: Vec<u8> = (0..dims.iter().product()).map(|i| u8::from(inside(i))).collect();
            let path = folder.join(name);
            let mut object = Object::new(dims, infobyte::ScalarType::U8, [1.0; 3]);
            object.bytes.clone_from(&samples);
            let bytes = [nifti(&object, 1, false, true, 1), object.bytes.clone()].concat();
            fs::write(&path, if name.ends_with(".gz") { gzip(&bytes) } else { bytes }).unwrap();
            (path, samples)
        })
        .collect()
}

#[test]
fn masks_of_one_grid_become_one_map_and_overlaps_are_counted() {
    let folder = tempfile::tempdir().unwrap();
    let dims = [24, 30, 20];
    let all = masks(folder.path(), dims, &["liver.nii.gz", "spleen.nii", "kidney_left.nii.gz"]);
    let paths: Vec<String> = all.iter().map(|(path, _)| text(path)).collect();
    let out = text(&folder.path().join("m.oct"));
    // In the order of their names, as folders are searched.
    let mut order: Vec<usize> = (0..3).collect();
    order.sort_by_key(|i| all[*i].0.clone());
    for (policy, last) in [("last", true), ("first", false)] {
        let args: Vec<&str> = ["build"].into_iter().chain(paths.iter().map(String::as_str)).collect();
        let run = oct(&[&args[..], &["-o", &out, "--labels", "all", "--overlap", policy, "--json"]].concat());
        let report = run.json();
        let count = dims.iter().product::<u32>() as usize;
        let (mut labels, mut overlaps) = (vec![0_u16; count], 0);
        for (at, label) in labels.iter_mut().enumerate() {
            let held: Vec<u16> =
                (1..).zip(&order).filter(|(_, i)| all[**i].1[at] > 0).map(|(number, _)| number).collect();
            overlaps += usize::from(held.len() > 1);
            *label = (if last { held.last() } else { held.first() }).copied().unwrap_or(0);
        }
        assert!(overlaps > 20);
        let model = Model::open(&out).unwrap();
        check(&model, dims, |[x, y, z]| labels[(x + dims[0] * (y + dims[1] * z)) as usize]);
        let names: Vec<&str> = model.frame().labels.iter().map(|label| label.name.as_str()).collect();
        assert_eq!(names, ["kidney_left", "liver", "spleen"]);
        let said = report["warnings"].to_string();
        assert!(
            said.contains(&format!("several masks share {overlaps} voxels")) && said.contains(policy),
            "{said}"
        );
    }
    let args: Vec<&str> = ["build"].into_iter().chain(paths.iter().map(String::as_str)).collect();
    let build = |extra: &[&str]| oct(&[&args[..], &["-o", &out, "--labels", "all"], extra].concat());
    build(&["--overlap", "refuse"]).refused(2, &["several masks share", "--overlap"]);
    assert_eq!(build(&["--volume", "2", "--force"]).code, 0);
    let other = masks(folder.path(), [24, 30, 21], &["other.nii"]);
    let other = text(&other[0].0);
    build(&[&other]).refused(2, &["lies on another grid", "--volume"]);
    // A map is no mask.
    let object = {
        let mut object = Object::new(dims, infobyte::ScalarType::U8, [1.0; 3]);
        object.bytes = (0..dims.iter().product::<u32>()).map(|i| (i % 3) as u8).collect();
        object
    };
    fs::write(
        folder.path().join("other.nii"),
        [nifti(&object, 1, false, true, 1), object.bytes.clone()].concat(),
    )
    .unwrap();
    build(&[&other]).refused(3, &["where a mask has one"]);
}

#[test]
fn real_masks_and_segments_are_counted_as_their_files_say() {
    let (Some(folder), Some(seg)) = (real_data("labels/masks"), real_data("labels/partial_overlaps.dcm"))
    else {
        return;
    };
    let out = tempfile::tempdir().unwrap();
    let path = text(&out.path().join("m.oct"));
    oct(&["build", &text(&folder), "-o", &path, "--labels", "all", "--json"]).json();
    let names: Vec<String> =
        Model::open(&path).unwrap().frame().labels.iter().map(|label| label.name.clone()).collect();
    assert!(names.len() == 8 && names.contains(&"spleen".to_owned()), "{names:?}");
    let report = oct(&["build", &text(&seg), "-o", &path, "--force", "--labels", "all", "--json"]).json();
    assert_eq!(Model::open(&path).unwrap().frame().labels.len(), 5);
    assert!(report["warnings"].to_string().contains("several masks share"), "{report}");
}
