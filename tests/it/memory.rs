//! `--memory` is a promise about the whole process as the operating system accounts it, for any volume,
//! type and number of threads. If this fails, a conversion that fits a small machine on one day is killed
//! by it on another.
//!
//! Two figures are held to the cap: the high-water mark that the program reports of itself, and the one
//! that GNU time takes of it from outside (where it is installed). The library is in use as it is in the
//! test's own binary, whose code is larger than a release; `OCT_BINARY` names another to be measured.

use crate::prelude::*;
use volume::encode;

const MIB: u64 = 1 << 20;

/// The cap that the smallest machines set, in MiB: 8, and for the test's own unoptimised binary, whose code
/// alone is larger by 2 MiB, 10.
fn small_cap() -> u64 {
    if cfg!(debug_assertions) && std::env::var_os("OCT_BINARY").is_none() { 10 } else { 8 }
}

/// Builds within `cap_mib` and holds every figure to it; returns what was left, in bytes.
fn held_to(input: &Path, output: &Path, cap_mib: u64, extra: &[&str]) -> u64 {
    let cap = format!("{cap_mib}MiB");
    let (report, outside) = measured_build(input, output, &[extra, &["--memory", &cap]].concat());
    let number = |key: &str| report[key].as_u64().unwrap_or_else(|| panic!("{key} of {report}"));
    let limit = (cap_mib + if cap_mib <= 24 { SYSTEM_MIB } else { 0 }) * MIB;
    let inside = number("peak_rss_bytes");
    assert_eq!(number("memory_budget_bytes"), limit);
    assert!(inside > 0, "the system does not tell the peak");
    let name = format!("{} {}", input.file_name().unwrap().display(), extra.join(" "));
    for (what, bytes) in [("plan", number("memory_plan_bytes")), ("VmHWM", inside)]
        .into_iter()
        .chain(outside.map(|bytes| ("GNU time", bytes)))
    {
        assert!(bytes <= limit, "{name}: {what} {bytes} exceeds {limit} ({} over)", bytes - limit);
    }
    let worst = inside.max(outside.unwrap_or(0));
    println!("{name}: {worst} of {limit}, plan {}", number("memory_plan_bytes"));
    limit - worst
}

/// What a volume is filled with.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Fill {
    /// Curved surfaces with noise on them.
    Waves,
    /// Half of all voxels are skin: most records per brick.
    Checkerboard,
    /// Everything is inside: skin at the border only.
    Solid,
}

fn raw(path: &Path, dims: [u32; 3], scalar: ScalarType, fill: Fill) {
    let mut random = Random(3);
    let mut bytes = Vec::new();
    for z in 0..dims[2] {
        for y in 0..dims[1] {
            // One wave a row and a cheap ramp along it: rows are long here.
            let wave = (f64::from(y) * 0.11).sin() * 30.0 + (f64::from(z) * 0.17).cos() * 20.0 + 60.0;
            let noise = random.below(2) as f64;
            for x in 0..dims[0] {
                let v = match fill {
                    Fill::Waves => wave + noise + f64::from(x % 256) * 0.15,
                    Fill::Checkerboard => f64::from((x + y + z) % 2) * 100.0 + f64::from(x % 20),
                    Fill::Solid => 100.0,
                };
                encode(scalar, v, &mut bytes);
            }
        }
    }
    fs::write(path, bytes).unwrap();
}

/// Caps and thread counts for one volume.
fn volume(dims: [u32; 3], scalar: ScalarType, fill: Fill, caps_mib: &[u64], extra: &[&str]) {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join(format!("{fill:?}-{scalar}.raw"));
    raw(&input, dims, scalar, fill);
    let size = dims.map(|n| n.to_string()).join("x");
    for (cap, threads) in caps_and_threads(caps_mib, &["1", "2", "5"]) {
        let all = ["--dims", &size, "--dtype", scalar.name(), "--threads", threads];
        held_to(&input, &folder.path().join("m.oct"), cap, &[&all, extra].concat());
    }
}

const BOTH: [&str; 2] = ["--channels", "normal,value"];

#[test]
fn wide_volumes_of_every_width_of_sample_stay_within_the_cap() {
    for scalar in [ScalarType::U8, ScalarType::U16, ScalarType::F32] {
        let extra = [&BOTH[..], &["--iso", "80"]].concat();
        volume([1024, 160, 10], scalar, Fill::Waves, &[small_cap(), 64], &extra);
    }
    let range = [&BOTH[..], &["--range", "60..90", "--connectivity", "6"]].concat();
    volume([2048, 160, 8], ScalarType::F64, Fill::Waves, &[small_cap(), 16, 32, 64], &range);
}

#[test]
fn the_worst_volumes_stay_within_the_cap() {
    let extra = [&BOTH[..], &["--iso", "50"]].concat();
    volume([1024, 160, 16], ScalarType::U8, Fill::Checkerboard, &[small_cap(), 64], &extra);
    volume([512, 160, 16], ScalarType::F64, Fill::Checkerboard, &[small_cap(), 64], &extra);
    volume([2048, 160, 12], ScalarType::U16, Fill::Solid, &[small_cap(), 64], &extra);
}

#[test]
fn the_threshold_is_found_within_the_cap() {
    for scalar in [ScalarType::U8, ScalarType::I16, ScalarType::F64] {
        volume([1024, 160, 10], scalar, Fill::Waves, &[small_cap(), 64], &["--otsu"]);
    }
}

/// 20 MiB of 16-bit samples, twice what the cap leaves room for: streams, pages in one strip and pictures are unrolled with
/// small buffers, whatever their size.
#[test]
fn packed_volumes_stay_within_the_cap() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let object = Object::new([512, 512, 40], ScalarType::I16, [1.0; 3]);
    let tiff = |compression| Tiff { compression, ..Tiff::default() }.write(&object);
    let whole = [nifti(&object, 1, false, true, 1), object.bytes.clone()].concat();
    formats::pngs(&object, &at.join("png"));
    let held = |name: &str, threads: &str| {
        let extra = [&BOTH[..], &["--iso", "1100", "--threads", threads]].concat();
        held_to(&at.join(name), &at.join("m.oct"), small_cap(), &extra);
    };
    held("png", "2");
    for (name, bytes) in [
        ("v.nii.gz", gzip(&whole)),
        ("v.nrrd", nrrd(&object, "bzip2", false, "")),
        ("plain.tif", tiff(1)),
        ("lzw.tif", tiff(5)),
        ("deflate.tif", tiff(8)),
    ] {
        file(at, name, &bytes);
        held(name, "2");
    }
    held("v.nii.gz", "1");
}

#[test]
fn a_dicom_series_stays_within_the_cap() {
    let folder = tempfile::tempdir().unwrap();
    let series = folder.path().join("series");
    fs::create_dir(&series).unwrap();
    for z in 0..40_u32 {
        let values: Vec<u32> = (0..512 * 512_u32)
            .map(|i| {
                let (x, y) = (f64::from(i % 512), f64::from(i / 512));
                let wave = (x * 0.05).sin() + (y * 0.04).cos() + (f64::from(z) * 0.2).sin();
                #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0..=4000")]
                {
                    (2000.0 + wave * 600.0) as u32
                }
            })
            .collect();
        let image = Image {
            instance: z + 1,
            position: [0.0, 0.0, f64::from(z)],
            size: [512, 512],
            clutter: z == 7,
            values: &values,
            ..Image::default()
        };
        fs::write(series.join(format!("{z}.dcm")), image.bytes()).unwrap();
    }
    for threads in ["1", "2", "5"] {
        let extra = [&BOTH[..], &["--iso", "1000", "--threads", threads]].concat();
        held_to(&series, &folder.path().join("m.oct"), small_cap(), &extra);
    }
    held_to(&series, &folder.path().join("m.oct"), small_cap(), &["--threads", "2"]);
}
