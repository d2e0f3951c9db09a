//! `oct render --memory` is a promise about the whole process as the operating system accounts it, for any model, size,
//! layer and number of threads. If this fails, a picture that fits a small machine on one day is killed by it on another.
//!
//! The models are hard ones: sparse noise, whose rays end far apart in the file, so that every tile wants other pages of
//! it. Each picture is made under the smallest cap that its own refusal names, and under larger ones; without a cap most
//! of them pass these. `OCT_BINARY` names another program to be measured.

use crate::prelude::*;
use infobyte::budget::parse_size;

const MIB: u64 = 1 << 20;

/// Is it the test's own program that is measured, unoptimised?
fn is_slow() -> bool {
    cfg!(debug_assertions) && std::env::var_os("OCT_BINARY").is_none()
}

/// Noise in a cube: one voxel of 6 is inside.
fn noise(folder: &Path, side: u32, surface: &str) -> PathBuf {
    let raw = folder.join(format!("noise-{side}.raw"));
    if !raw.exists() {
        let mut random = Random(7);
        let bytes: Vec<u8> = (0..side.pow(3)).map(|_| if random.below(6) == 0 { 200 } else { 0 }).collect();
        fs::write(&raw, bytes).unwrap();
    }
    let model = folder.join(format!("noise-{surface}.oct"));
    let dims = format!("{side}x{side}x{side}");
    let asked = ["--dims", &dims, "--dtype", "u8", "--iso", "100", "--surface", surface, "--memory", "64MiB"];
    let built = oct(&[&["build", &text(&raw), "-o", &text(&model)][..], &asked].concat());
    assert_eq!(built.code, 0, "{built:?}");
    model
}

/// Makes a picture under the smallest cap that works and under larger ones; each is held to.
fn held_to(model: &Path, folder: &Path, size: &str, threads: &str, extra: &[&str]) {
    // Code that is not optimised is larger than it is counted for; such a program is held to less, and shows less.
    let (size, caps, allowed) = if is_slow() { ("64x48", &[0][..], 4 * MIB) } else { (size, &[0, 2][..], 0) };
    let output = text(&folder.join("picture.png"));
    let common = ["render", &text(model), "-o", &output, "--size", size, "--threads", threads];
    let render = |cap: &str| oct(&[&common[..], extra, &["--json", "--memory", cap]].concat());
    let name = format!("{} {size} {threads} {}", model.file_name().unwrap().display(), extra.join(" "));
    let refused = render("2MiB");
    refused.refused(4, &["--memory 2MiB", "too small for this picture", "smallest that works"]);
    let least = parse_size(smallest_budget(&refused.stderr)).unwrap();
    for more in caps {
        let cap = least + more * MIB;
        let report = render(&format!("{}KiB", cap / 1024)).json();
        let peak = report["peak_rss_bytes"].as_u64().unwrap();
        assert!(peak > 0, "the system does not tell the peak");
        assert!(peak <= cap + allowed, "{name}: {peak} exceeds {cap} ({} over)", peak - cap);
        println!("{name}: {peak} of {cap}");
    }
}

#[test]
fn pictures_keep_to_their_cap() {
    let folder = tempfile::tempdir().unwrap();
    let [of_skin, of_cells] = if is_slow() { [192, 128] } else { [384; 2] };
    let (skin, cells) = (noise(folder.path(), of_skin, "skin"), noise(folder.path(), of_cells, "cells"));
    let packed = folder.path().join("packed.oct");
    assert_eq!(oct(&["pack", &text(&skin), "-o", &text(&packed)]).code, 0);
    // Larger than what is kept of it, so that pages do come and go.
    assert!(fs::metadata(&skin).unwrap().len() > 3 * MIB && fs::metadata(&cells).unwrap().len() > 5 * MIB);
    for (model, threads) in [(&skin, "1"), (&skin, "2"), (&cells, "1"), (&cells, "2"), (&packed, "2")] {
        held_to(model, folder.path(), "256x256", threads, &[]);
    }
    let large = if is_slow() { "400x400" } else { "1024x1024" };
    held_to(&skin, folder.path(), large, "2", &[]);
    held_to(&cells, folder.path(), "300x100", "5", &[]);
    let wide = if is_slow() { "16384x9" } else { "16384x2048" };
    held_to(&skin, folder.path(), wide, "1", &[]);
    held_to(&cells, folder.path(), wide, "2", &[]);
    every_kind_keeps_to_it(folder.path(), &skin);
    flat_ones_need_no_more_than_they_touch(folder.path(), &skin);
}

fn every_kind_keeps_to_it(folder: &Path, model: &Path) {
    let layer = |name: &str| text(&folder.join(name));
    let layers = ["--depth", &layer("d.png"), "--normals", &layer("n.png"), "--ids", &layer("i.png")];
    held_to(model, folder, "300x300", "2", &layers);
    held_to(model, folder, "200x200", "2", &["--shading", "blended"]);
    held_to(model, folder, "64x64", "2", &["--shading", "ao"]);
    held_to(model, folder, "300x300", "1", &["--lod", "on"]);
    held_to(model, folder, "300x200", "2", &["--contact"]);
    held_to(model, folder, "200x200", "2", &["--turntable", "2"]);
}

/// A picture of one row sees little, and no picture more than the model has.
fn flat_ones_need_no_more_than_they_touch(folder: &Path, model: &Path) {
    let whole = fs::metadata(model).unwrap().len();
    let output = text(&folder.join("picture.png"));
    for size in ["1024x1", "1x1024", "1024x1024"] {
        let refused = oct(&["render", &text(model), "-o", &output, "--size", size, "--memory", "2MiB"]);
        refused.refused(4, &["too small for this picture"]);
        let least = parse_size(smallest_budget(&refused.stderr)).unwrap();
        // The program, a band of the picture, and all of the model.
        assert!(least < 12 * MIB + whole, "{size}: {least}");
    }
    held_to(model, folder, "1024x1", "2", &[]);
}

/// What is given back comes again, and shows the same.
#[test]
fn a_cap_changes_no_pixel() {
    let folder = tempfile::tempdir().unwrap();
    let model = noise(folder.path(), 128, "cells");
    // Openness and edges are found over the bands of rows that a cap makes, and over their borders.
    for light in ["blended", "soft", "ao"] {
        let render = |name: &str, cap: &[&str]| {
            let output = text(&folder.path().join(name));
            let common = ["render", &text(&model), "-o", &output, "--size", "100x170", "--shading", light];
            oct(&[&common[..], cap].concat())
        };
        let refused = render("none.png", &["--memory", "1MiB"]);
        refused.refused(4, &["too small for this picture"]);
        let least = smallest_budget(&refused.stderr).to_owned();
        for (name, cap) in [("a.png", &[][..]), ("b.png", &["--memory", &least])] {
            let run = render(name, cap);
            assert_eq!(run.code, 0, "{run:?}");
        }
        let read = |name: &str| fs::read(folder.path().join(name)).unwrap();
        assert_eq!(read("a.png"), read("b.png"), "{light}");
    }
    assert_eq!(command::names(folder.path()).iter().filter(|name| name.ends_with(".png")).count(), 2);
}

/// Thumbnails hold a part of a model's pages, however large it is: two at a time of noise, one of several sides.
#[test]
fn a_batch_with_thumbnails_keeps_to_its_cap() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| text(&folder.path().join(name));
    fs::create_dir(at("in")).unwrap();
    for side in [128, 136] {
        let mut random = Random(u64::from(side));
        let bytes: Vec<u8> =
            (0..u32::pow(side, 3)).map(|_| if random.below(6) == 0 { 200 } else { 0 }).collect();
        fs::write(at(&format!("in/{side}.raw")), bytes).unwrap();
        let sidecar = json!({"dims": [side, side, side], "dtype": "u8"}).to_string();
        fs::write(at(&format!("in/{side}.json")), sidecar).unwrap();
    }
    let allowed = if is_slow() { 5 * MIB } else { 0 };
    for (cap, jobs) in [("16MiB", "2"), ("64MiB", "8")].into_iter().take(if long() > 1 { 2 } else { 1 }) {
        let out = at(cap);
        let asked = ["--memory", cap, "--jobs", jobs, "--iso", "100", "--surface", "cells", "--json"];
        let report = oct(&[&["batch", &at("in"), "--out", &out][..], &asked].concat()).json();
        let peak = report["peak_rss_bytes"].as_u64().unwrap();
        let sizes = fs::read_dir(&out).unwrap().map(|file| file.unwrap().metadata().unwrap().len());
        assert!(sizes.max() > Some(11 * MIB), "the models are too small to show anything");
        assert!(peak <= parse_size(cap).unwrap() + allowed, "{cap}: {peak}");
        println!("batch {cap}: {peak}");
    }
}
