//! A model that is built in parts, on any machines and within any means, is the file of one build, byte for byte, and no
//! incomplete or damaged set of parts passes for a model. If this fails, a volume that no single machine reads becomes a
//! model that cannot be trusted.

use crate::prelude::*;

/// Waves with salt, and a corner without any skin.
fn waves(path: &Path, dims: [u32; 3], scalar: ScalarType, seed: u64) {
    let mut random = Random(seed);
    let scale = dims.map(|n| 9.0 / f64::from(n.max(40)));
    let mut bytes = Vec::new();
    for z in 0..dims[2] {
        for y in 0..dims[1] {
            for x in 0..dims[0] {
                let [a, b, c] = [x, y, z].map(f64::from);
                let wave = (a * scale[0]).sin() + (b * scale[1] + 1.0).cos() + (c * scale[2] * 1.3).sin();
                let salt = [20.0, -20.0].get(random.below(500_usize)).copied().unwrap_or(0.0);
                let value = if z < 140 && y > 140 { 0.0 } else { 40.0 + wave * 12.0 + salt };
                volume::encode(scalar, value, &mut bytes);
            }
        }
    }
    fs::write(path, bytes).unwrap();
}

/// A plan in a folder of its own, and its volume.
struct Job {
    folder: TempDir,
    source: Vec<String>,
}

impl Job {
    fn new(dims: [u32; 3], scalar: ScalarType, extra: &[&str]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let raw = folder.path().join("v.raw");
        waves(&raw, dims, scalar, u64::from(dims[0]));
        let size = dims.map(|n| n.to_string()).join("x");
        let kind = format!("{scalar:?}").to_lowercase();
        let words = [text(&raw), "--dims".into(), size, "--dtype".into(), kind];
        let source = words.into_iter().chain(extra.iter().map(|word| (*word).to_owned())).collect();
        Self { folder, source }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn run(&self, first: &[&str], last: &[&str]) -> Run {
        let source = self.source.iter().map(String::as_str);
        oct(&first.iter().copied().chain(source).chain(last.iter().copied()).collect::<Vec<_>>())
    }

    /// The bytes of one build.
    fn whole(&self) -> Vec<u8> {
        let output = text(&self.path("one.oct"));
        self.run(&["build"], &["-o", &output, "--json"]).json();
        fs::read(output).unwrap()
    }

    fn plan(&self, parts: u32) -> Value {
        let (out, parts) = (text(&self.path("job")), parts.to_string());
        self.run(&["plan"], &["--out", &out, "--parts", &parts, "--json"]).json()
    }

    fn part(&self, number: u32, extra: &[&str]) -> Run {
        let (plan, number) = (text(&self.path("job/plan.json")), number.to_string());
        oct(&[&["part", &plan, &number, "--json"], extra].concat())
    }

    fn merge(&self) -> Run {
        let (plan, output) = (text(&self.path("job/plan.json")), text(&self.path("all.oct")));
        oct(&["merge", &plan, "-o", &output, "--json"])
    }

    /// All stages and parts of a plan, within means that differ, and the merged bytes.
    fn all(&self, plan: &Value) -> Vec<u8> {
        let count = u32::try_from(plan["parts"].as_u64().unwrap()).unwrap();
        let means: [&[&str]; 2] = [&["--memory", "16MiB", "--threads", "1"], &["--threads", "3"]];
        for stage in plan["stages"].as_array().unwrap() {
            let stage = ["--stage", stage.as_str().unwrap()];
            for (number, means) in (0..count).rev().zip(means.iter().cycle()) {
                let report = self.part(number, &[&stage[..], *means].concat()).json();
                assert_eq!((&report["was_there"], &report["stage"]), (&json!(false), &json!(stage[1])));
            }
            let plan = text(&self.path("job/plan.json"));
            oct(&["merge", &plan, stage[0], stage[1], "--json"]).json();
        }
        for (number, means) in (0..count).zip(means.iter().cycle()) {
            self.part(number, means).json();
        }
        self.merge().json();
        fs::read(self.path("all.oct")).unwrap()
    }

    /// Names of the parts that are there.
    fn parts(&self) -> Vec<String> {
        names(&self.path("job")).into_iter().filter(|name| name != "plan.json").collect()
    }
}

#[test]
fn parts_of_any_number_join_into_the_file_of_one_build() {
    use ScalarType::{F32, I8, I16, U8, U16};
    let cells = ["--surface", "cells"];
    let rich = ["--surface", "skin", "--channels", "normal,value"];
    let thick = ["--surface", "skin", "--connectivity", "6", "--gradient", "auto", "--lod", "off"];
    let bare = ["--surface", "skin", "--channels", "none"];
    let cut = ["--surface", "cells", "--roi", "3..150,0..260,10..290"];
    let half = ["--surface", "skin", "--downsample", "2"];
    type Row<'a> = (&'a [&'a str], [u32; 3], ScalarType, &'a [u32]);
    let table: [Row<'_>; 11] = [
        (&["--surface", "skin"], [150, 270, 300], U16, if long() > 1 { &[1, 2, 3, 7, 256] } else { &[40] }),
        (&cells, [150, 270, 300], I16, if long() > 1 { &[1, 2, 3, 7, 64] } else { &[7] }),
        // Cells reach one further than samples.
        (&cells, [40, 128, 256], U8, &[2, 3, 7]),
        (&rich, [129, 257, 140], U8, &[3, 7]),
        (&rich, [64, 200, 280], I8, &[4]),
        (&thick, [70, 140, 270], I16, &[3, 7]),
        (&bare, [70, 140, 270], U16, &[2]),
        (&cells, [64, 200, 280], F32, &[2]),
        (&cut, [150, 270, 300], U16, &[5]),
        (&half, [160, 300, 600], U8, &[3]),
        (&["--surface", "skin"], [3, 5, 2], U8, &[1, 3]),
    ];
    let means: [&[&str]; 3] = [
        &["--memory", "16MiB", "--threads", "1"],
        &["--memory", "1GiB", "--threads", "5"],
        &["--memory", "24MiB", "--threads", "2"],
    ];
    for (options, dims, scalar, counts) in table {
        let job = Job::new(dims, scalar, &[options, &["--iso", "40"]].concat());
        let whole = job.whole();
        for &count in counts {
            let plan = job.plan(count);
            assert_eq!(plan["parts"], count);
            let mut voxels = 0;
            // The order of the parts does not matter.
            for (number, means) in (0..count).rev().zip(means.iter().cycle()) {
                let report = job.part(number, means).json();
                assert_eq!(report["was_there"], false);
                voxels += report["part_voxels"].as_u64().unwrap();
            }
            let report = job.merge().json();
            assert_eq!(report["skin_voxels"], voxels);
            let joined = fs::read(job.path("all.oct")).unwrap();
            assert!(joined == whole, "{options:?} {dims:?} {scalar:?} in {count} parts");
        }
        assert_eq!(oct(&["verify", &text(&job.path("all.oct"))]).code, 0);
    }
}

#[test]
fn the_threshold_of_all_parts_is_that_of_one_build() {
    use ScalarType::{F32, F64, I8, I16, I32, U8, U16};
    let skin = ["--surface", "skin"];
    let half = ["--surface", "skin", "--downsample", "2"];
    let cut = ["--surface", "cells", "--roi", "3..50,0..130,10..290"];
    let table: [(&[&str], ScalarType, u32); 9] = [
        (&skin, U8, 1),
        (&skin, I8, 3),
        (&cut, U16, 5),
        (&skin, I16, if long() > 1 { 40 } else { 9 }),
        (&half, U8, 7),
        (&skin, I32, 3),
        (&skin, F32, 4),
        (&half, F32, 2),
        (&["--surface", "cells"], F64, if long() > 1 { 300 } else { 24 }),
    ];
    for (options, scalar, count) in table {
        let job = Job::new([60, 140, 300], scalar, options);
        let whole = job.whole();
        let plan = job.plan(count);
        let wide = ["extremes", "histogram"];
        // Means of blocks are wide, whatever they are of.
        let is_wide = scalar.bytes() > 2 || options.contains(&"--downsample");
        let stages: &[&str] = if is_wide { &wide } else { &wide[1..] };
        assert_eq!(plan["stages"], json!(stages));
        assert!(job.all(&plan) == whole, "{options:?} {scalar:?} in {count} parts");
    }
}

#[test]
fn any_options_give_the_bytes_of_one_build_with_components_and_cavities_across_cuts() {
    use ScalarType::{F32, I8, I16, I32, U8, U16};
    let mut random = Random(29);
    for round in 0..5 * long() {
        let mut pick = |words: &[&str]| words[random.below(words.len())].to_owned();
        let groups = [
            pick(&["--surface skin", "--surface cells", "--surface skin --connectivity 6 --gradient auto"]),
            pick(&["", "--iso 40", "--range 30..48", "--otsu"]),
            pick(&["", "--roi 2..50,5..180,20..260", "--downsample 2"]),
            pick(&["", "--close 1", "--close 2"]),
            pick(&["", "--fill-cavities"]),
            pick(&["", "--keep-largest 1", "--keep-largest 7", "--drop-below 40", "--drop-below 0.1%"]),
            pick(&["", "--component-connectivity 26"]),
            pick(&["", "--lod off", "--channels none"]),
        ];
        let joined = groups.join(" ");
        let is_cleaned = ["--keep", "--drop"].iter().any(|word| joined.contains(word));
        // What says nothing about what is built is refused.
        let words = joined.split_whitespace().filter(|word| !word.is_empty());
        let mut words: Vec<&str> = words.collect();
        if !is_cleaned && let Some(at) = words.iter().position(|word| *word == "--component-connectivity") {
            words.drain(at..at + 2);
        }
        if joined.contains("cells")
            && let Some(at) = words.iter().position(|word| *word == "--channels")
        {
            words.drain(at..at + 2);
        }
        let scalar = [U8, I8, U16, I16, I32, F32][random.below(6_usize)];
        let side = |from: u64, random: &mut Random| u32::try_from(from + random.below(60)).unwrap();
        let dims = [side(55, &mut random), side(185, &mut random), side(265, &mut random)];
        let job = Job::new(dims, scalar, &words);
        let count = [1, 2, 3, 5, 9][random.below(5_usize)];
        let output = text(&job.path("one.oct"));
        let whole = job.run(&["build"], &["-o", &output, "--json"]);
        assert_eq!(whole.code, 0, "round {round}: {words:?} {scalar:?} {dims:?}");
        let joined = job.all(&job.plan(count));
        assert!(
            joined == fs::read(&output).unwrap(),
            "round {round}: {words:?} {scalar:?} {dims:?} in {count}"
        );
        let resumed = text(&job.path("resumed.oct"));
        let report = job.run(&["build"], &["-o", &resumed, "--resume", "--json"]).json();
        assert_eq!(report["warnings"], whole.json()["warnings"], "round {round}: {words:?}");
        assert!(
            fs::read(&resumed).unwrap() == joined,
            "round {round}: {words:?} {scalar:?} {dims:?} resumed"
        );
    }
}

#[test]
fn a_damaged_occupancy_is_refused_by_the_parts_that_read_its_slices() {
    let options = ["--surface", "skin", "--iso", "40", "--keep-largest", "1", "--fill-cavities"];
    let job = Job::new([30, 40, 400], ScalarType::U8, &options);
    let whole = job.whole();
    assert_eq!(job.plan(3)["stages"], json!(["occupancy"]));
    job.part(0, &[]).refused(3, &["'occupancy' is not done"]);
    for number in 0..3 {
        assert_eq!(job.part(number, &["--stage", "occupancy"]).json()["was_there"], false);
        assert_eq!(job.part(number, &["--stage", "occupancy"]).json()["was_there"], true);
    }
    let plan = text(&job.path("job/plan.json"));
    let merge = || oct(&["merge", &plan, "--stage", "occupancy", "--json"]);
    let file = |ends: &str| {
        let name = job.parts().into_iter().find(|name| name.ends_with(ends)).unwrap();
        job.path("job").join(name)
    };
    let damage = |path: &Path, place: usize| {
        let mut bytes = fs::read(path).unwrap();
        bytes[place] ^= 4;
        fs::write(path, bytes).unwrap();
    };
    let share = file("occupancy-0001.part");
    damage(&share, 777);
    merge().refused(3, &["occupancy-0001.part", "damaged"]);
    assert_eq!(job.part(1, &["--stage", "occupancy"]).json()["was_there"], false);
    let report = merge().json();
    assert!(
        report["components"].as_u64() > Some(100) && report["voxels_added"].as_u64() > Some(0),
        "{report}"
    );
    // A byte of the first slices: only the first part reads them.
    let cleaned = file("occupancy.part");
    damage(&cleaned, 100);
    job.part(0, &[]).refused(3, &["occupancy.part", "damaged"]);
    for number in 1..3 {
        job.part(number, &[]).json();
    }
    merge().json();
    job.part(0, &[]).json();
    job.merge().json();
    assert!(fs::read(job.path("all.oct")).unwrap() == whole);
}

#[test]
fn padding_and_labels_are_recognised_by_all_parts_together() {
    let dims = [70_u32, 80, 260];
    let round = |x: u32, y: u32| {
        (f64::from(x) - 34.5).powi(2) / 1190.0 + (f64::from(y) - 39.5).powi(2) / 1560.0 < 1.0
    };
    let of = |value: &dyn Fn(u32, u32, u32) -> i16| {
        let mut bytes = Vec::new();
        for at in 0..dims.iter().product::<u32>() {
            let (x, y, z) = (at % dims[0], at / dims[0] % dims[1], at / dims[0] / dims[1]);
            bytes.extend(value(x, y, z).to_le_bytes());
        }
        bytes
    };
    let wave =
        |x, y, z| i16::try_from((x * 7 + y * 3 + z) % 400).unwrap() + if x / 20 == 1 { 900 } else { 0 };
    let padded = of(&|x, y, z| if round(x, y) { wave(x, y, z) } else { -3024 });
    // Labels in boxes, some of which only one part sees.
    let labels = of(&|x, y, z| {
        if (x / 9 + y / 11) % 2 == 0 { i16::try_from((x / 9 + z / 50) % 7).unwrap() } else { 0 }
    });
    // A threshold between labels is that of a mask in every part.
    let job = Job::new(dims, ScalarType::I16, &["--surface", "cells", "--range", "2..4"]);
    fs::write(job.path("v.raw"), &labels).unwrap();
    assert!(job.all(&job.plan(6)) == job.whole());
    let numbers = labels.as_chunks::<2>().0.iter().map(|b| if *b == [0; 2] { f32::NAN } else { 1.0 });
    let nan = numbers.flat_map(f32::to_le_bytes).collect();
    let (whole, half) = (["--surface", "cells"], ["--surface", "cells", "--downsample", "2"]);
    let cases: [(_, _, &[&str], _); 4] = [
        (padded, ScalarType::I16, &whole, "-3024"),
        (labels.clone(), ScalarType::I16, &whole, "label"),
        (labels, ScalarType::I16, &half, "label"),
        (nan, ScalarType::F32, &whole, ""),
    ];
    for (bytes, scalar, how, word) in cases {
        let job = Job::new(dims, scalar, how);
        fs::write(job.path("v.raw"), bytes).unwrap();
        let whole = job.whole();
        let plan = job.plan(6);
        assert!(job.all(&plan) == whole, "{word}");
        let merge = oct(&["merge", &text(&job.path("job/plan.json")), "--stage", "histogram", "--json"]);
        assert!(merge.json()["warnings"].to_string().contains(word), "{word}");
    }
}

#[test]
fn stages_that_are_missing_damaged_or_of_no_use_are_refused_by_name() {
    let job = Job::new([40, 50, 300], ScalarType::F32, &["--surface", "skin"]);
    job.plan(3);
    let plan = text(&job.path("job/plan.json"));
    let merge = |stage: &str| oct(&["merge", &plan, "--stage", stage, "--json"]);
    job.part(0, &[]).refused(3, &["'histogram' is not done", "--stage histogram", "oct merge"]);
    job.part(0, &["--stage", "histogram"]).refused(3, &["'extremes' is not done"]);
    job.part(3, &["--stage", "extremes"]).refused(2, &["no part 3"]);
    job.part(0, &["--stage", "otsu"]).refused(2, &["--stage", "extremes, histogram and occupancy"]);
    job.part(1, &["--stage", "extremes"]).json();
    merge("extremes").refused(3, &["2 of 3 parts missing", "0, 2"]);
    for number in 0..3 {
        assert_eq!(job.part(number, &["--stage", "extremes"]).json()["was_there"], number == 1);
    }
    let name = job.parts().into_iter().find(|name| name.contains("extremes-0001")).unwrap();
    let path = job.path("job").join(&name);
    let sound = fs::read(&path).unwrap();
    for place in 0..sound.len() {
        let mut bytes = sound.clone();
        bytes[place] ^= 1 << (place % 8);
        fs::write(&path, &bytes).unwrap();
        merge("extremes").refused(3, &[&name, "damaged"]);
        fs::write(&path, &sound[..place]).unwrap();
        merge("extremes").refused(3, &[&name, "damaged"]);
    }
    // What is damaged is found again.
    assert_eq!(job.part(1, &["--stage", "extremes"]).json()["was_there"], false);
    assert!(fs::read(&path).unwrap() == sound);
    merge("extremes").json();
    job.part(0, &[]).refused(3, &["'histogram' is not done"]);

    let given = Job::new([30, 30, 30], ScalarType::U8, &["--iso", "40"]);
    assert_eq!(given.plan(2)["stages"], json!([]));
    given.part(0, &["--stage", "histogram"]).refused(2, &["no stage 'histogram'", "at once"]);
    // All values are alike.
    let flat = Job::new([30, 30, 30], ScalarType::U8, &[]);
    fs::write(flat.path("v.raw"), vec![7; 27_000]).unwrap();
    flat.plan(2);
    for number in 0..2 {
        flat.part(number, &["--stage", "histogram"]).json();
    }
    let plan = text(&flat.path("job/plan.json"));
    oct(&["merge", &plan, "--stage", "histogram"]).refused(3, &["v.raw", "Otsu", "7"]);
}

#[test]
fn parts_of_meshes_and_of_trees_join_into_the_file_of_one_build() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| text(&folder.path().join(name));
    let waves_at = at("v.raw");
    waves(Path::new(&waves_at), [40, 50, 60], ScalarType::U8, 3);
    let dims = ["--dims", "40x50x60", "--dtype", "u8", "--iso", "40"];
    oct(&[&["build", &waves_at, "-o", &at("v.oct"), "--json"], &dims[..]].concat()).json();
    assert_eq!(oct(&["export", &at("v.oct"), "-o", &at("v.stl")]).code, 0);
    fs::write(
        at("a.csg"),
        "difference() { sphere(r = 20, $fn = 40); cube([30, 9, 50], center = true); mesh(\"v.stl\"); }",
    )
    .unwrap();
    let table: [(&str, &[&str], u32); 5] = [
        ("v.stl", &["--grid", "300", "--surface", "cells"], 3),
        ("v.stl", &["--grid", "200", "--surface", "skin"], 7),
        ("v.stl", &["--grid", "150", "--surface", "skin", "--keep-thin", "--connectivity", "6"], 4),
        ("a.csg", &["--grid", "200", "--surface", "cells"], 5),
        ("a.csg", &["--grid", "140", "--surface", "skin", "--lod", "off"], 20),
    ];
    for (input, options, count) in table {
        let (input, one, all, out) = (at(input), at("one.oct"), at("all.oct"), at("job"));
        let whole = oct(&[&["build", &input, "-o", &one, "--json"], options].concat()).json();
        let count = count.to_string();
        let planned =
            oct(&[&["plan", &input, "--out", &out, "--parts", &count, "--json"], options].concat()).json();
        assert_eq!(planned["warnings"], whole["warnings"], "{input} {options:?}");
        let plan = at("job/plan.json");
        for number in 0..count.parse::<u32>().unwrap() {
            let threads = (1 + number % 3).to_string();
            oct(&["part", &plan, &number.to_string(), "--threads", &threads, "--json"]).json();
        }
        oct(&["merge", &plan, "-o", &all, "--json"]).json();
        assert!(fs::read(&all).unwrap() == fs::read(&one).unwrap(), "{input} {options:?} in {count} parts");
        fs::remove_dir_all(&out).unwrap();
        oct(&[&["build", &input, "-o", &all, "--resume", "--json"], options].concat()).json();
        assert!(fs::read(&all).unwrap() == fs::read(&one).unwrap(), "{input} {options:?} resumed");
    }
    // A file that the tree names belongs to the input.
    oct(&["plan", &at("a.csg"), "--out", &at("job"), "--parts", "2", "--grid", "40", "--json"]).json();
    let stl = File::options().append(true).open(at("v.stl")).unwrap();
    stl.set_modified(std::time::SystemTime::UNIX_EPOCH + Duration::from_secs(1)).unwrap();
    oct(&["part", &at("job/plan.json"), "0"]).refused(3, &["plan.json", "oct plan"]);
}

#[test]
fn what_parts_cannot_know_is_refused_by_name() {
    let job = Job::new([20, 20, 20], ScalarType::F32, &[]);
    let out = text(&job.path("job"));
    let table: [(&[&str], &str); 4] = [
        (&["--iso", "40", "--visible-from", "outside"], "--visible-from"),
        (&["--iso", "40", "--error", "0.1"], "--error"),
        (&["--iso", "40", "--channels", "normal,value"], "'value'"),
        (&["--labels", "all"], "--labels"),
    ];
    for (options, word) in table {
        let last = [options, &["--out", &out, "--parts", "3"]].concat();
        job.run(&["plan"], &last).refused(2, &[word, "v.raw"]);
        assert!(!Path::new(&out).exists(), "{options:?} left something");
    }
    // Of plans themselves.
    job.run(&["plan"], &["--iso", "40", "--out", &out, "--parts", "0"]).refused(2, &["--parts"]);
    let options = ["--iso", "40", "--out", &out, "--parts", "3", "--json"];
    job.run(&["plan"], &options).json();
    job.part(3, &[]).refused(2, &["no part 3", "3 parts"]);
    fs::write(job.path("job/plan.json"), "{}").unwrap();
    job.part(0, &[]).refused(3, &["plan.json", "oct plan"]);
    job.merge().refused(3, &["plan.json", "oct plan"]);
}

#[test]
fn a_set_that_is_not_whole_and_sound_is_refused_by_name_and_leaves_the_old_model() {
    let job = Job::new([70, 140, 300], ScalarType::U8, &["--surface", "skin", "--iso", "40"]);
    let whole = job.whole();
    job.plan(5);
    for number in 0..5 {
        job.part(number, &[]).json();
    }
    let parts = job.parts();
    let at = |number: usize| job.path("job").join(&parts[number]);
    fs::write(job.path("all.oct"), "old").unwrap();
    let refused = |words: &[&str]| {
        job.merge().refused(3, words);
        assert_eq!(fs::read(job.path("all.oct")).unwrap(), b"old");
    };
    let sound: Vec<Vec<u8>> = (0..5).map(|number| fs::read(at(number)).unwrap()).collect();

    fs::remove_file(at(1)).unwrap();
    fs::remove_file(at(4)).unwrap();
    refused(&["2 of 5 parts missing", "1, 4", "oct part"]);
    fs::write(at(4), &sound[4]).unwrap();
    fs::write(at(1), &sound[2]).unwrap();
    refused(&[&parts[1], "part 2 under the name of part 1"]);

    // Parts of another plan under the names of these.
    let other = Job::new([70, 140, 300], ScalarType::U8, &["--surface", "skin", "--iso", "41"]);
    other.plan(5);
    other.part(1, &[]).json();
    fs::copy(other.path("job").join(&other.parts()[0]), at(1)).unwrap();
    refused(&[&parts[1], "another job"]);

    // Every kind of place of a part is covered by a checksum.
    let mut random = Random(7);
    let longest = (0..5).max_by_key(|number| sound[*number].len()).unwrap();
    fs::write(at(1), &sound[1]).unwrap();
    let length = sound[longest].len();
    let some = (0..60).map(|_| random.below(length));
    for place in (0..60).chain(length - 100..length).chain(some) {
        let mut bytes = sound[longest].clone();
        bytes[place] ^= 1 << (place % 8);
        fs::write(at(longest), &bytes).unwrap();
        refused(&[&parts[longest]]);
    }
    for place in [0, 1, 11, 12, 60, length / 2, length - 25, length - 1] {
        fs::write(at(longest), &sound[longest][..place]).unwrap();
        refused(&[&parts[longest], "damaged"]);
    }
    // What is damaged is built again; what is sound is not, and what is not of the job does no harm.
    fs::write(job.path("job/000000000000000000000000-0001.part"), "foreign").unwrap();
    for (number, sound) in sound.iter().enumerate() {
        let part = u32::try_from(number).unwrap();
        let was_there = job.part(part, &[]).json()["was_there"].as_bool().unwrap();
        assert_eq!(was_there, number != longest);
        assert!(fs::read(at(number)).unwrap() == *sound);
    }
    job.merge().json();
    assert!(fs::read(job.path("all.oct")).unwrap() == whole);
}

#[test]
fn a_part_of_an_input_that_was_changed_is_refused_and_a_plan_without_skin_gives_no_model() {
    let job = Job::new([30, 30, 140], ScalarType::U8, &["--surface", "skin", "--iso", "200"]);
    job.plan(2);
    for number in 0..2 {
        assert_eq!(job.part(number, &[]).json()["part_voxels"], 0);
    }
    job.merge().refused(3, &["no voxel", "--iso"]);
    assert!(!job.path("all.oct").exists());
    let raw = File::options().write(true).open(job.path("v.raw")).unwrap();
    raw.set_modified(std::time::SystemTime::UNIX_EPOCH + Duration::from_secs(1)).unwrap();
    job.part(0, &[]).refused(3, &["plan.json", "oct plan"]);
    // A plan that someone edits is none, whatever of it.
    job.plan(2);
    let plan = job.path("job/plan.json");
    let whole = fs::read_to_string(&plan).unwrap();
    for (what, other) in
        [("\"200\"", "\"20\""), ("infobyte 0", "infobyte 1"), ("\"folder\": \"/", "\"folder\": \"/x")]
    {
        assert!(whole.contains(what), "{whole}");
        fs::write(&plan, whole.replace(what, other)).unwrap();
        job.part(0, &[]).refused(3, &["plan.json", "edited", "oct plan"]);
        job.merge().refused(3, &["plan.json", "edited", "oct plan"]);
    }
    // What is no file is refused at once.
    fs::write(&plan, whole).unwrap();
    let name = PathBuf::from(job.part(0, &[]).json()["output"].as_str().unwrap());
    fs::remove_file(&name).unwrap();
    assert!(Command::new("mkfifo").arg(&name).status().unwrap().success());
    job.part(0, &[]).refused(3, &[&text(&name), "not a regular file"]);
    fs::remove_file(&name).unwrap();
    fs::create_dir(&name).unwrap();
    job.part(0, &[]).refused(3, &[&text(&name), "not a regular file"]);
    fs::remove_file(&plan).unwrap();
    assert!(Command::new("mkfifo").arg(&plan).status().unwrap().success());
    job.part(0, &[]).refused(3, &["plan.json", "not a regular file"]);
    job.merge().refused(3, &["plan.json", "not a regular file"]);
}

#[test]
fn parts_of_a_synthetic_volume_join_into_the_file_of_one_build() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| text(&folder.path().join(name));
    let input = ["synthetic:gyroid@40", "--iso", "0.5", "--surface", "cells"];
    oct(&[&["build"], &input[..], &["-o", &at("one.oct"), "--json"]].concat()).json();
    oct(&[&["plan"], &input[..], &["--parts", "2", "--out", &at("job"), "--json"]].concat()).json();
    let plan = at("job/plan.json");
    ["0", "1"].iter().for_each(|number| drop(oct(&["part", &plan, number, "--json"]).json()));
    oct(&["merge", &plan, "-o", &at("all.oct"), "--json"]).json();
    assert!(fs::read(at("one.oct")).unwrap() == fs::read(at("all.oct")).unwrap());
}

#[test]
fn parts_and_merges_that_are_killed_leave_nothing_and_the_bytes_are_the_same_in_the_end() {
    // `INFOBYTE_KILLS=100` kills so many times, over 64 parts that all hold something.
    let asked = std::env::var("INFOBYTE_KILLS").ok().and_then(|kills| kills.parse().ok());
    let (kills, parts, dims) = match asked {
        Some(kills) => (kills, 64, [96, 1024, 1024]),
        None => (40, 9, [200, 270, 300]),
    };
    let job = Job::new(dims, ScalarType::I16, &["--surface", "cells", "--iso", "40"]);
    let whole = job.whole();
    job.plan(parts);
    let plan = text(&job.path("job/plan.json"));
    let mut random = Random(11);
    let victims: Vec<u32> = (0..kills - kills / 5).map(|_| random.below(parts)).collect();
    let mut killed = 0;
    let mut kill = |args: &[&str]| {
        let mut child = started(args);
        sleep(Duration::from_millis(random.below(60)));
        let _ = child.kill();
        killed += u32::from(child.wait().unwrap().code().is_none());
    };
    for number in victims {
        kill(&["part", &plan, &number.to_string(), "--scratch", &text(job.folder.path())]);
    }
    let found: Vec<bool> =
        (0..parts).map(|number| job.part(number, &[]).json()["was_there"].as_bool().unwrap()).collect();
    let output = text(&job.path("all.oct"));
    for _ in 0..kills / 5 {
        kill(&["merge", &plan, "-o", &output]);
    }
    job.merge().json();
    assert!(fs::read(&output).unwrap() == whole);
    println!(
        "{killed} of {kills} died, {} of {parts} parts were there",
        found.iter().filter(|is| **is).count()
    );
    // Parts that were finished before have the names of those that were built now.
    assert_eq!(job.parts().len(), found.len(), "{found:?}");
    assert_eq!(names(job.folder.path()), ["all.oct", "job", "one.oct", "v.raw"]);
}

#[test]
fn a_build_that_is_killed_goes_on_from_its_parts() {
    for (surface, budget) in [("cells", "16MiB"), ("skin", "12MiB")] {
        let job = Job::new([60, 140, 700], ScalarType::U16, &["--surface", surface, "--iso", "40"]);
        let whole = job.whole();
        let output = text(&job.path("all.oct"));
        let resume = ["-o", &output, "--resume", "--memory", budget, "--scratch"];
        let scratch = text(job.folder.path());
        let arguments: Vec<&str> = ["build"]
            .into_iter()
            .chain(job.source.iter().map(String::as_str))
            .chain(resume)
            .chain([&*scratch])
            .collect();
        let mut random = Random(5);
        let (mut most, mut tries) = (0, 0_u64);
        while !job.path("all.oct").exists() {
            let mut child = started(&arguments);
            // Longer each time, so that it ends on any machine.
            tries += 1;
            sleep(Duration::from_millis(5 + random.below(20 + 10 * tries)));
            let _ = child.kill();
            child.wait().unwrap();
            let parts =
                if job.path("all.oct.parts").exists() { names(&job.path("all.oct.parts")).len() } else { 0 };
            // What was finished is not lost, and nothing is half-written.
            assert!(parts >= most || job.path("all.oct").exists());
            most = parts.max(most);
        }
        assert!(fs::read(&output).unwrap() == whole);
        // Once more: over the old model, and over parts of other options that were left.
        fs::create_dir_all(job.path("all.oct.parts")).unwrap();
        fs::write(job.path("all.oct.parts/0123456789abcdef01234567-0000.part"), [1; 50]).unwrap();
        let report = oct(&[&arguments[..], &["--json"]].concat()).json();
        assert_eq!((&report["parts"], &report["output"]), (&json!(6), &json!(output)));
        assert!(fs::read(&output).unwrap() == whole);
        assert_eq!(names(job.folder.path()), ["all.oct", "one.oct", "v.raw"]);
    }
    let job = Job::new([30, 30, 200], ScalarType::U8, &["--otsu"]);
    let whole = job.whole();
    job.run(&["build"], &["-o", &text(&job.path("all.oct")), "--resume", "--json"]).json();
    assert!(fs::read(job.path("all.oct")).unwrap() == whole);
    assert_eq!(names(job.folder.path()), ["all.oct", "one.oct", "v.raw"]);
}

#[test]
fn the_script_for_slurm_builds_what_its_array_is_given_and_passes_the_exit_code_on() {
    let job = Job::new([70, 140, 300], ScalarType::U8, &["--surface", "skin", "--iso", "40"]);
    let whole = job.whole();
    job.plan(4);
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/scripts/parts.slurm");
    // An array as SLURM runs it: a task after the other, each with its number; one is asked for that does not exist.
    let array = "cd / && for task in 3 1 0 2; do SLURM_ARRAY_TASK_ID=$task SLURM_CPUS_PER_TASK=1 sh \"$1\" \"$2\" || exit; done
        SLURM_ARRAY_TASK_ID=4 sh \"$1\" \"$2\"";
    let plan = text(&job.path("job/plan.json"));
    let run = shell(array, &[script, &plan]);
    run.refused(2, &["no part 4"]);
    job.merge().json();
    assert!(fs::read(job.path("all.oct")).unwrap() == whole);
}
