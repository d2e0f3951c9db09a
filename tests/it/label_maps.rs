//! Label maps as tools write them: real ones equal what their files and tables say, label for label; each label gets a
//! model of its own; layers become one map; scan and batch know label maps by their headers and values. If this fails,
//! organs get wrong names or voxels, or a folder of segmentations is built as one lump.
#![expect(clippy::cast_possible_truncation, reason = "numbers here are small by construction")]

use std::io::Read;

use crate::label_cells::check;
use crate::prelude::*;

/// The samples of a file of this project's data: those of a NIfTI-1 (`.nii.gz`) or of a gzipped NRRD of `short`, read here
/// by hand; and its sides.
pub(crate) fn samples(path: &Path) -> ([u32; 3], Vec<u16>) {
    let bytes = fs::read(path).unwrap();
    let gunzip = |bytes: &[u8]| {
        let mut out = Vec::new();
        flate2::read::MultiGzDecoder::new(bytes).read_to_end(&mut out).unwrap();
        out
    };
    if let Some(head) =
        bytes.windows(2).position(|pair| pair == b"\n\n").filter(|_| bytes.starts_with(b"NRRD"))
    {
        let text = String::from_utf8(bytes[..head].to_vec()).unwrap();
        let sizes = text.lines().find_map(|line| line.strip_prefix("sizes: ")).unwrap();
        let sides: Vec<u32> = sizes.split(' ').map(|n| n.parse().unwrap()).collect();
        assert!(text.contains("type: short"));
        let plain = gunzip(&bytes[head + 2..]);
        let samples = plain.chunks_exact(2).map(|b| u16::from_le_bytes([b[0], b[1]])).collect();
        return ([sides[0], sides[1], sides[2]], samples);
    }
    let plain = gunzip(&bytes);
    let short = |at: usize| u16::from_le_bytes([plain[at], plain[at + 1]]);
    assert_eq!((short(70), &plain[344..347]), (2, &b"n+1"[..]));
    let sides = [42, 44, 46].map(|at| u32::from(short(at)));
    let first = f32::from_le_bytes([plain[108], plain[109], plain[110], plain[111]]) as usize;
    let samples: Vec<u16> = plain[first..].iter().map(|b| u16::from(*b)).collect();
    assert_eq!(samples.len() as u32, sides.iter().product::<u32>());
    (sides, samples)
}

/// The cells of each label: those with samples of it and others.
fn cells(map: &[u16], dims: [u32; 3]) -> BTreeMap<u16, BTreeSet<[u32; 3]>> {
    let mut found: BTreeMap<u16, BTreeSet<[u32; 3]>> = BTreeMap::new();
    for z in 0..=dims[2] {
        for y in 0..=dims[1] {
            for x in 0..=dims[0] {
                let of = |corner: i64| {
                    at(map, dims, std::array::from_fn(|a| i64::from([x, y, z][a]) - (corner >> a & 1)))
                };
                let labels: [u16; 8] = std::array::from_fn(|corner| of(corner as i64));
                for label in labels.into_iter().filter(|_| labels.iter().any(|other| *other != labels[0])) {
                    found.entry(label).or_default().insert([x, y, z]);
                }
            }
        }
    }
    found
}

/// A sample of a map, 0 beyond it.
fn at(map: &[u16], dims: [u32; 3], p: [i64; 3]) -> u16 {
    let [nx, ny, _] = dims.map(i64::from);
    let within = (0..3).all(|a| (0..i64::from(dims[a])).contains(&p[a]));
    if within { map[(p[0] + nx * (p[1] + ny * p[2])) as usize] } else { 0 }
}

/// Builds a model of each label, and holds every one against the definition.
fn hold_each(input: &Path, dims: [u32; 3], map: &[u16], memory: &str) -> Value {
    let folder = tempfile::tempdir().unwrap();
    let each = folder.path().join("each");
    let run = |extra: &[&str]| {
        oct(&[&["build", &text(input), "--labels", "all", "--each", &text(&each), "--memory", memory], extra]
            .concat())
    };
    let report = run(&["--json"]).json();
    assert!(
        report["peak_rss_bytes"].as_u64().unwrap() <= report["memory_budget_bytes"].as_u64().unwrap(),
        "{report}"
    );
    let listed = report["each"].as_array().unwrap();
    let numbers: BTreeSet<u16> = map.iter().copied().filter(|label| *label > 0).collect();
    let due = cells(map, dims);
    assert_eq!(names(&each).len(), numbers.len(), "{:?}", names(&each));
    for (number, model) in numbers.into_iter().zip(listed) {
        let path = PathBuf::from(model["output"].as_str().unwrap());
        let voxels = map.iter().filter(|label| **label == number).count() as u64;
        assert_eq!((model["number"].as_u64(), model["voxels"].as_u64()), (Some(number.into()), Some(voxels)));
        let opened = Model::open(&path).unwrap();
        verify(&opened).unwrap();
        let found: BTreeSet<[u32; 3]> = opened.voxels().map(|voxel| voxel.voxel).collect();
        assert!(found == due[&number], "{number}");
        assert_eq!(model["skin_voxels"].as_u64(), Some(found.len() as u64));
        let labels = &opened.frame().labels;
        assert_eq!((labels.len(), labels[0].number, labels[0].voxels), (1, number, voxels));
        assert_eq!(Some(labels[0].name.as_str()), model["name"].as_str());
    }
    // What is there stays, unless it is to go.
    let before = fs::read(each.join(&names(&each)[0])).unwrap();
    run(&[]).refused(2, &["already exists", "--force", ".oct"]);
    assert!(fs::read(each.join(&names(&each)[0])).unwrap() == before);
    assert_eq!(run(&["--force"]).code, 0);
    assert_eq!(names(&each).len(), listed.len());
    report
}

#[test]
fn every_label_of_real_maps_has_a_model_of_its_own_cells() {
    for name in ["totalseg-example.nii.gz", "totalseg-spine.nii.gz", "liver_spine_seg.nrrd"] {
        let Some(path) = real_data(&format!("labels/{name}")) else { return };
        let (dims, map) = samples(&path);
        hold_each(&path, dims, &map, "10MiB");
    }
}

#[test]
fn models_of_random_labels_are_taken_from_one_build_whatever_their_shape() {
    let folder = tempfile::tempdir().unwrap();
    for (dims, kinds, block) in [
        ([70, 33, 40], if long() > 1 { 117 } else { 30 }, 3),
        ([1, 1, 1], 1, 1),
        ([5, 1, 64], 3, 2),
        ([40, 40, 40], 300, 1),
    ] {
        let mut random = Random(7);
        let mut object = Object::new(dims, infobyte::ScalarType::U16, [1.0, 0.5, 2.0]);
        let shuffled: Vec<u16> = (0..64 * 64 * 64).map(|_| random.below(kinds) + 1).collect();
        let place = |i: u32| [i % dims[0], i / dims[0] % dims[1], i / dims[0] / dims[1]].map(|c| c / block);
        let map: Vec<u16> = (0..dims.iter().product::<u32>())
            .map(place)
            .map(
                |[x, y, z]| if (x + y + z) % 7 == 6 { 0 } else { shuffled[(x + 64 * (y + 64 * z)) as usize] },
            )
            .collect();
        object.bytes = map.iter().flat_map(|label| label.to_le_bytes()).collect();
        let input = file(folder.path(), "random.nrrd", &nrrd(&object, "raw", false, ""));
        // Of very many labels a few are looked at.
        if kinds < 300 {
            hold_each(&input, dims, &map, "64MiB");
            continue;
        }
        let each = folder.path().join("each");
        let all = folder.path().join("all.oct");
        let how = ["--labels", "all", "--memory", "10MiB", "--each", &text(&each), "--json"];
        let report = command::build(&[&input], &all, &how).json();
        assert!(report["peak_rss_bytes"].as_u64().unwrap() <= (10 + SYSTEM_MIB) << 20, "{report}");
        let whole = Model::open(&all).unwrap();
        assert_eq!(names(&each).len(), whole.frame().labels.len());
        let mut together = 0;
        for model in report["each"].as_array().unwrap() {
            let one = Model::open(model["output"].as_str().unwrap()).unwrap();
            together += one.voxels().count();
        }
        let due = cells(&map, dims);
        assert_eq!(
            together,
            whole.frame().labels.iter().map(|label| due[&label.number].len()).sum::<usize>()
        );
    }
}

/// A `.seg.nrrd` of layers, each a volume of `u8`.
fn layered(layers: &[Vec<u8>], dims: [u32; 3], together: bool, segments: &str) -> Vec<u8> {
    let [nx, ny, nz] = dims;
    let count = layers.len();
    let (sizes, directions, kinds) = if together {
        (format!("{count} {nx} {ny} {nz}"), "none (1,0,0) (0,1,0) (0,0,2)", "list domain domain domain")
    } else {
        (format!("{nx} {ny} {nz} {count}"), "(1,0,0) (0,1,0) (0,0,2) none", "domain domain domain list")
    };
    let head = format!(
        "NRRD0004\ntype: uchar\ndimension: 4\nspace: left-posterior-superior\nsizes: {sizes}\nspace directions: \
         {directions}\nkinds: {kinds}\nencoding: gzip\nspace origin: (3,4,5)\n{segments}\n"
    );
    let all: Vec<u8> = match together {
        true => (0..layers[0].len()).flat_map(|i| layers.iter().map(move |layer| layer[i])).collect(),
        false => layers.concat(),
    };
    [head.into_bytes(), gzip(&all)].concat()
}

#[test]
fn layers_of_a_segmentation_become_one_map_and_overlaps_are_counted() {
    let folder = tempfile::tempdir().unwrap();
    let dims = [20, 17, 9];
    let ball = |centre: [f64; 3], radius: f64, value: u8| {
        move |p: [u32; 3]| {
            let r: f64 = (0..3).map(|a| (f64::from(p[a]) - centre[a]).powi(2)).sum();
            if r < radius * radius { value } else { 0 }
        }
    };
    let volume = |of: &dyn Fn([u32; 3]) -> u8| -> Vec<u8> {
        (0..dims.iter().product::<u32>())
            .map(|i| of([i % dims[0], i / dims[0] % dims[1], i / dims[0] / dims[1]]))
            .collect()
    };
    let (a, b, c) =
        (ball([6.0, 8.0, 4.0], 5.0, 1), ball([15.0, 8.0, 4.0], 3.0, 2), ball([10.0, 9.0, 4.0], 4.0, 1));
    // Two segments that do not overlap in the first layer, one in the second with a value of the first.
    let layers = [volume(&|p| a(p).max(b(p))), volume(&c)];
    let segments = "Segmentation_MasterRepresentation:=Binary labelmap\nSegment0_Name:=a\nSegment0_LabelValue:=1\n\
                    Segment0_Layer:=0\nSegment0_Color:=1 0 0\nSegment1_Name:=b\nSegment1_LabelValue:=2\n\
                    Segment1_Layer:=0\nSegment2_Name:=c\nSegment2_LabelValue:=1\nSegment2_Layer:=1\n";
    let model = folder.path().join("m.oct");
    for together in [true, false] {
        let input = file(folder.path(), "s.seg.nrrd", &layered(&layers, dims, together, segments));
        for (policy, first) in [("first", true), ("last", false)] {
            let how = ["--labels", "all", "--overlap", policy, "--json"];
            let report = command::build(&[&input], &model, &how).json();
            let mut overlaps = 0;
            let map: Vec<u16> = (0..layers[0].len())
                .map(|i| {
                    let held = [u16::from(layers[0][i]), u16::from(layers[1][i]) * 3];
                    overlaps += usize::from(held[0] > 0 && held[1] > 0);
                    let kept = if first { held } else { [held[1], held[0]] };
                    kept.into_iter().find(|label| *label > 0).unwrap_or(0)
                })
                .collect();
            let opened = Model::open(&model).unwrap();
            check(&opened, dims, |p| at(&map, dims, p.map(i64::from)));
            let told: Vec<_> = opened.frame().labels.iter().map(|label| label.name.as_str()).collect();
            assert_eq!((told, opened.frame().labels[0].color), (vec!["a", "b", "c"], [255, 0, 0]));
            assert_eq!(opened.metadata().spacing_mm, [1.0, 1.0, 2.0]);
            let said = report["warnings"].to_string();
            assert!(
                overlaps > 20 && said.contains(&format!("several masks share {overlaps} voxels")),
                "{said}"
            );
        }
        let refused = ["--labels", "all", "--overlap", "refuse"];
        command::build(&[&input], &model, &refused).refused(2, &["several masks share", "--overlap"]);
    }
    // Values keep their numbers where no two segments share one; a value without a segment is not passed over.
    let own = segments.replace("Segment2_LabelValue:=1", "Segment2_LabelValue:=9");
    let nine = [layers[0].clone(), layers[1].iter().map(|v| v * 9).collect()];
    let input = file(folder.path(), "s.seg.nrrd", &layered(&nine, dims, true, &own));
    assert_eq!(command::build(&[&input], &model, &["--labels", "all"]).code, 0);
    let numbers: Vec<u16> = Model::open(&model).unwrap().frame().labels.iter().map(|l| l.number).collect();
    assert_eq!(numbers, [1, 2, 9]);
    let input = file(folder.path(), "s.seg.nrrd", &layered(&layers, dims, true, &own));
    command::build(&[&input], &model, &["--labels", "all"])
        .refused(3, &["s.seg.nrrd", "layer 1", "the value 1"]);
    let empty = file(folder.path(), "e.seg.nrrd", &layered(&[vec![0], vec![0]], [1; 3], true, segments));
    command::build(&[&empty], &model, &["--labels", "all"]).refused(3, &["e.seg.nrrd", "empty segmentation"]);
}

#[test]
fn codes_name_the_segments_of_a_nrrd_and_typed_names_are_taken_on_request() {
    let folder = tempfile::tempdir().unwrap();
    let model = folder.path().join("m.oct");
    let mut object = Object::new([6, 6, 6], infobyte::ScalarType::U8, [1.0; 3]);
    object.bytes = (0..216).map(|i| (i % 6 / 2) as u8).collect();
    let segments = "Segment0_Name:=John Smith's lung\nSegment0_LabelValue:=1\nSegment0_Tags:=TerminologyEntry:Segmentation \
                    category and type - 3D Slicer General Anatomy list~SCT^123037004^Anatomical \
                    Structure~SCT^39607008^Lung~SCT^7771000^Left~Anatomic codes - DICOM master list~^^~^^|\n\
                    Segment1_Name:=heart\nSegment1_LabelValue:=2\n";
    let bytes = [nrrd(&object, "raw", false, segments), b"\n".to_vec(), object.bytes.clone()].concat();
    let input = file(folder.path(), "a.seg.nrrd", &bytes);
    for (extra, due, noted) in
        [(&[][..], ["Left Lung", "heart"], true), (&["--keep-names"], ["John Smith's lung", "heart"], false)]
    {
        let how = [&["--labels", "all", "--json"], extra].concat();
        let report = command::build(&[&input], &model, &how).json();
        let labels = Model::open(&model).unwrap().frame().labels.clone();
        assert_eq!(labels.iter().map(|label| label.name.as_str()).collect::<Vec<_>>(), due);
        assert_eq!(report["warnings"].to_string().contains("--keep-names uses those"), noted, "{report}");
        let stored = fs::read(&model).unwrap();
        assert_eq!(stored.windows(10).any(|part| part == b"John Smith"), !noted);
    }
}

/// Blocks of four labels with flat regions.
fn blocks(i: u32) -> u8 {
    let [x, y, z] = [i % 24, i / 24 % 24, i / 576].map(|c| c / 8);
    [0, 3, 7, 12, 0, 3, 0, 7, 12][((x + 3 * y + z) % 9) as usize]
}

#[test]
fn scan_and_batch_know_label_maps_and_a_threshold_that_is_asked_for_comes_before() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("in");
    fs::create_dir(&input).unwrap();
    let mut object = Object::new([24, 24, 24], infobyte::ScalarType::U8, [1.0; 3]);
    object.bytes = (0..24 * 24 * 24).map(blocks).collect();
    file(&input, "plain.nii", &[nifti(&object, 1, false, true, 1), object.bytes.clone()].concat());
    let stated = "Segment0_Name:=a\nSegment0_LabelValue:=3\nSegment1_Name:=b\nSegment1_LabelValue:=7\n\
                  Segment2_Name:=c\nSegment2_LabelValue:=12\n";
    let bytes = [nrrd(&object, "raw", false, stated), b"\n".to_vec(), object.bytes.clone()].concat();
    file(&input, "stated.seg.nrrd", &bytes);
    let mut ramp = Object::new([24, 24, 24], infobyte::ScalarType::U8, [1.0; 3]);
    ramp.bytes = (0..24 * 24 * 24_u32).map(|i| (i % 24 * 9 + i / 576) as u8).collect();
    file(&input, "grey.nrrd", &nrrd(&ramp, "raw", false, ""));
    let labels = |report: &Value| -> BTreeMap<String, Value> {
        let items = report["items"].as_array().unwrap();
        let name = |item: &Value| {
            text(Path::new(Path::new(item["input"].as_str().unwrap()).file_name().unwrap().to_str().unwrap()))
        };
        items.iter().map(|item| (name(item), item["label_count"].clone())).collect()
    };
    let scan = |extra: &[&str]| oct(&[&["scan", &text(&input), "--json"], extra].concat()).json();
    let found = scan(&[]);
    assert_eq!(found["pixels_looked_at"], false);
    let found = labels(&found);
    assert_eq!((&found["stated.seg.nrrd"], &found["plain.nii"]), (&Value::from(3), &Value::Null));
    let found = scan(&["--values"]);
    assert_eq!(found["pixels_looked_at"], true);
    let found = labels(&found);
    assert_eq!((&found["plain.nii"], &found["grey.nrrd"]), (&Value::from(3), &Value::Null));
    let shown = oct(&["scan", &text(&input), "--values"]);
    assert!(
        shown.stdout.contains("u8, a map of 3 labels, ") && shown.stdout.contains("values were read"),
        "{shown:?}"
    );

    let batch = |out: &str, extra: &[&str]| {
        let out = folder.path().join(out);
        let report = oct(&[&["batch", &text(&input), "--out", &text(&out), "--json"], extra].concat()).json();
        let items = report["items"].as_array().unwrap().clone();
        let facts = |item: &Value| {
            let model = &item["model"];
            let opened = Model::open(out.join(model["file"].as_str().unwrap())).unwrap();
            assert_eq!(model["label_count"].as_u64(), Some(opened.frame().labels.len() as u64));
            (text(Path::new(item["input"].as_str().unwrap())), opened.frame().labels.clone())
        };
        let page = fs::read_to_string(out.join("index.html")).unwrap();
        let table = fs::read_to_string(out.join("report.csv")).unwrap();
        (items.iter().map(facts).collect::<Vec<_>>(), page, table, out)
    };
    let (found, page, table, out) = batch("out", &[]);
    assert_eq!(found.len(), 3);
    for (name, labels) in &found {
        let due = if name.ends_with("grey.nrrd") { 0 } else { 3 };
        assert_eq!(labels.len(), due, "{name}");
        assert!(!name.contains("stated") || labels[0].name == "a", "{labels:?}");
    }
    assert_eq!(page.matches("<dt>labels</dt><dd>3</dd>").count(), 2);
    assert!(
        table.lines().next().unwrap().ends_with(",label_count")
            && table.lines().filter(|l| l.ends_with(",3")).count() == 2
    );
    // Pictures have the colours of labels.
    let picture = fs::read_dir(&out)
        .unwrap()
        .map(|e| e.unwrap().path())
        .find(|p| p.extension().is_some_and(|e| e == "png"));
    assert!(picture.is_some());
    // The same model as a build that asks for labels.
    let alone = folder.path().join("alone.oct");
    assert_eq!(command::build(&[&input.join("plain.nii")], &alone, &["--labels", "all"]).code, 0);
    let bytes = fs::read(&alone).unwrap();
    assert!(
        names(&out).iter().filter(|n| n.ends_with(".oct")).any(|n| fs::read(out.join(n)).unwrap() == bytes)
    );
    // What is done is not done again.
    let again = oct(&["batch", &text(&input), "--out", &text(&out), "--json"]).json();
    assert_eq!((again["converted"].as_u64(), again["skipped"].as_u64()), (Some(0), Some(3)));
    for (out, asked) in
        [("iso", &["--iso", "1"][..]), ("otsu", &["--otsu"]), ("clean", &["--keep-largest", "1"])]
    {
        let (found, page, ..) = batch(out, asked);
        assert!(found.iter().all(|(_, labels)| labels.is_empty()) && !page.contains("<dt>labels"), "{out}");
    }
}

#[test]
fn tables_and_maps_that_do_not_fit_are_told_apart_from_those_that_do() {
    let folder = tempfile::tempdir().unwrap();
    let model = folder.path().join("m.oct");
    let mut object = Object::new([32, 32, 32], infobyte::ScalarType::U16, [1.0; 3]);
    let put = |object: &Object| file(folder.path(), "a.nrrd", &nrrd(object, "raw", false, ""));
    object.bytes = (0..32_u32.pow(3)).flat_map(|i| ((i / 1024 / 8) as u16).to_le_bytes()).collect();
    let input = put(&object);
    let table =
        |rows: &str| text(&file(folder.path(), "names.tsv", format!("index\tname\n{rows}").as_bytes()));
    let warned = |rows: &str| {
        let names = table(rows);
        command::build(&[&input], &model, &["--labels", "all", "--names", &names, "--json"]).json()["warnings"].to_string()
    };
    assert_eq!(warned("1\ta\n2\tb\n"), "[]");
    assert!(warned("1\ta\n9\tb\n").contains("no voxel has the label 9, which has a name\""));
    assert!(
        warned("1\ta\n8\tc\n9\tb\n")
            .contains("no voxel has the label 8, which has a name, nor 1 more that have one")
    );
    assert!(warned("8\tc\n9\tb\n").contains("none has a name"));
    // More different numbers than a model has room for: a limit, not a wait.
    object.bytes = (0..32_u32.pow(3)).flat_map(|i| (1 + i as u16 % 20_000).to_le_bytes()).collect();
    command::build(&[&put(&object)], &model, &["--labels", "all"])
        .refused(3, &["a.nrrd", "holds more than 16384 labels; choose some of them"]);
    let chosen = command::build(&[&input], &model, &["--labels", "1..16"]);
    assert_eq!(chosen.code, 0, "{}", chosen.stderr);
    let wide: Vec<u8> = (0..32_u32.pow(3)).flat_map(|i| (i * 4).to_le_bytes()).collect();
    let mut object = Object::new([32, 32, 32], infobyte::ScalarType::U32, [1.0; 3]);
    object.bytes = wide;
    command::build(&[&put(&object)], &model, &["--labels", "all"])
        .refused(3, &["a.nrrd", "labels are numbers from 1 to 65535", "--iso, --range or --preset"]);
    oct(&["build", &text(&input), "--labels", "all"]).refused(2, &["--output"]);
    oct(&["build", &text(&input), "--each", &text(folder.path())]).refused(2, &["--labels"]);
}

/// A colour as the standard says of what DCMTK writes for `rgb`: it takes D65 for the white of L, a and b, which is D50.
fn read_with_d50(rgb: [f64; 3]) -> [f64; 3] {
    type Rows = [[f64; 3]; 3];
    let times = |rows: Rows, v: [f64; 3]| rows.map(|r| r[0] * v[0] + r[1] * v[1] + r[2] * v[2]);
    // IEC 61966-2-1, and Bradford's adaptation of D50 to D65.
    let to_xyz = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]];
    let to_rgb = [[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.204, 1.057]];
    let adapt =
        [[0.955_58, -0.023_04, 0.063_16], [-0.028_29, 1.009_94, 0.021_01], [0.012_3, -0.020_48, 1.329_91]];
    let linear =
        rgb.map(|c| c / 255.0).map(|c| if c > 0.04045 { ((c + 0.055) / 1.055).powf(2.4) } else { c / 12.92 });
    let [x, y, z] = times(to_xyz, linear);
    // What is relative to one white becomes relative to the other.
    let d50 = [x / 0.9505 * 0.9642, y, z / 1.089 * 0.8251];
    let coded = |c: f64| if c > 0.003_130_8 { 1.055 * c.powf(1.0 / 2.4) - 0.055 } else { 12.92 * c };
    times(to_rgb, times(adapt, d50)).map(|c| coded(c.clamp(0.0, 1.0)) * 255.0)
}

#[test]
fn real_segments_have_the_voxels_codes_and_colours_of_the_files_that_they_were_made_of() {
    let Some(seg) = real_data("labels/partial_overlaps.dcm") else { return };
    let folder = seg.parent().unwrap();
    let table: Value =
        serde_json::from_slice(&fs::read(folder.join("partial_overlaps.json")).unwrap()).unwrap();
    let out = tempfile::tempdir().unwrap();
    let model = out.path().join("m.oct");
    // Each segment by the name that was typed in: the file that it is in, and its value there.
    let mut due: BTreeMap<String, (Vec<u16>, Value)> = BTreeMap::new();
    let mut dims = [0; 3];
    for (file, segments) in (1..).zip(table["segmentAttributes"].as_array().unwrap()) {
        let map = samples(&folder.join(format!("partial_overlaps-{file}.nrrd")));
        dims = map.0;
        for segment in segments.as_array().unwrap() {
            let value = segment["labelID"].as_u64().unwrap() as u16;
            let inside = map.1.iter().map(|v| u16::from(*v == value)).collect();
            due.insert(segment["SegmentLabel"].as_str().unwrap().into(), (inside, segment.clone()));
        }
    }
    let build = |extra: &[&str]| {
        command::build(&[&seg], &model, &[&["--labels", "all", "--json"], extra].concat()).json()
    };
    build(&["--keep-names"]);
    let typed = Model::open(&model).unwrap().frame().labels.clone();
    let report = build(&[]);
    let opened = Model::open(&model).unwrap();
    let coded = opened.frame().labels.clone();
    assert_eq!((typed.len(), due.len()), (5, 5));
    assert!(report["warnings"].to_string().contains("--keep-names uses those"));
    let held = |i: usize| due.values().filter(|(inside, _)| inside[i] > 0).count();
    let overlaps = (0..due["GREEN"].0.len()).filter(|i| held(*i) > 1).count();
    assert!(
        overlaps > 0
            && report["warnings"].to_string().contains(&format!("several masks share {overlaps} voxels")),
        "{report}"
    );
    for (typed, coded) in typed.iter().zip(&coded) {
        let (_, segment) = &due[&typed.name];
        assert_eq!(
            Some(coded.name.as_str()),
            segment["SegmentedPropertyTypeCodeSequence"]["CodeMeaning"].as_str()
        );
        let color = segment["recommendedDisplayRGBValue"].as_array().unwrap();
        let color: Vec<f64> = color.iter().map(|part| part.as_f64().unwrap()).collect();
        let due = read_with_d50([color[0], color[1], color[2]]);
        let near = coded.color.iter().zip(due).all(|(found, due)| (f64::from(*found) - due).abs() < 1.5);
        assert!(near, "{}: {:?}, {due:?} of {color:?}", typed.name, coded.color);
    }
    // Segment by segment, in a build of its own: what the file that it comes from has.
    let listed = oct(&["scan", &text(&seg), "--json"]).json();
    let item = &listed["items"][0];
    assert_eq!((item["label_count"].as_u64(), item["part"].as_str()), (Some(5), Some("")), "{listed}");
    let affine = |model: &Model| model.affine();
    for (at, label) in typed.iter().enumerate() {
        let which = (at + 1).to_string();
        let how = ["--labels", "all", "--volume", &which, "--keep-names"];
        let run = command::build(&[&seg], &model, &how);
        assert_eq!(run.code, 0, "{}", run.stderr);
        let own = Model::open(&model).unwrap();
        let labels = &own.frame().labels;
        assert_eq!((labels.len(), labels[0].number, &labels[0].name), (1, label.number, &label.name));
        let (inside, _) = &due[&label.name];
        assert_eq!(labels[0].voxels, inside.iter().map(|v| u64::from(*v)).sum::<u64>(), "{}", label.name);
        // The NRRDs place voxel 0 here, 0.810547 mm and 1 mm apart.
        let to_nrrd = |v: [u32; 3]| {
            let p = affine(&own).apply(v.map(f64::from));
            // Cells begin half a voxel before their samples.
            [(p[0] + 235.199_997) / 0.810_547, (p[1] + 226.800_003) / 0.810_547, p[2] + 128.690_002]
                .map(|c| c + 0.5)
        };
        let whole = |c: f64| {
            assert!((c - c.round()).abs() < 0.01, "{c}");
            c.round() as u32
        };
        let found: BTreeSet<[u32; 3]> = own.voxels().map(|v| to_nrrd(v.voxel).map(whole)).collect();
        // Slices beyond those of the segment are empty, so that its cells are the same in either grid.
        assert!(found == cells(inside, dims)[&1], "{}", label.name);
    }
    for (name, code) in [("liver.dcm", "Liver"), ("sparse-labelmap-ppv5.dcm", "Liver")] {
        let path = folder.join(name);
        assert_eq!(command::build(&[&path], &model, &["--labels", "all"]).code, 0, "{name}");
        let labels = Model::open(&model).unwrap().frame().labels.clone();
        assert_eq!((labels.len(), labels[0].number, labels[0].name.as_str()), (1, 1, code), "{name}");
    }
}
