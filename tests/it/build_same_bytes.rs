//! The same volume and options give the same file, byte for byte, whatever the budget, the number of
//! threads, the width of tiles, and the way the voxels came in. If this fails, models cannot be compared
//! by checksum, and a small machine makes something else than a large one.

use crate::cleaning::number;
use crate::prelude::*;

/// Writes 16-bit samples of waves with some salt: curved surfaces at every angle, and lone voxels.
fn waves(path: &Path, dims: [u32; 3], seed: u64) {
    let mut random = Random(seed);
    let scale = dims.map(|n| 9.0 / f64::from(n.max(40)));
    write_raw(path, dims, |at| {
        let [a, b, c] = at.map(f64::from);
        let wave = (a * scale[0]).sin() + (b * scale[1] + 1.0).cos() + (c * scale[2] * 1.3).sin();
        let salt = if random.below(500) == 0 { 900.0 } else { 0.0 };
        #[expect(clippy::cast_possible_truncation, reason = "between -3000 and 3900")]
        let sample = (wave * 1000.0 + salt) as i16;
        sample.to_le_bytes()
    });
}

fn build(input: &[PathBuf], output: &Path, extra: &[&str]) -> command::Run {
    command::build(input, output, &[&["--json"], extra].concat())
}

/// Builds with budgets and thread counts, and holds all files to the first.
fn same_at(raw: &Path, dims: [u32; 3], extra: &[&str], budgets: &[&str], threads: &[&str]) -> Vec<Value> {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("m.oct");
    let size = dims.map(|n| n.to_string()).join("x");
    let mut reports = Vec::new();
    let mut first: Option<Vec<u8>> = None;
    for (budget, count) in caps_and_threads(budgets, threads) {
        let mut args = vec!["--dims", &size, "--dtype", "i16", "--memory", budget, "--threads", count];
        args.extend(extra);
        let report = build(&[raw.to_path_buf()], &output, &args).json();
        let bytes = fs::read(&output).unwrap();
        let is_same = *first.get_or_insert_with(|| bytes.clone()) == bytes;
        assert!(is_same, "{size} at {budget} with {count} threads differs: {report}");
        reports.push(report);
    }
    reports
}

#[test]
fn any_budget_and_thread_count_give_the_same_file_at_256_cubed() {
    let folder = tempfile::tempdir().unwrap();
    let raw = folder.path().join("v.raw");
    assert_eq!(oct(&["demo", "--size", "256", "--write-raw", &text(&raw)]).code, 0);
    // The program of the tests is larger than the one that is released, which does with 8 MiB.
    let reports = same_at(&raw, [256; 3], &["--iso", "400"], &["10MiB", "64MiB", "1GiB"], &["1", "2", "5"]);
    // The plans must have differed, or nothing was compared.
    let threads: Vec<u64> = reports.iter().map(|r| number(r, "threads")).collect();
    assert!(threads.contains(&1) && threads.contains(&5), "{threads:?}");
    assert!(number(&reports[0], "skin_voxels") > 10_000);
    let values = ["--iso", "400", "--channels", "normal,value", "--connectivity", "6"];
    same_at(&raw, [256; 3], &values, &["10MiB", "1GiB"], &["5"]);
    let cells = ["--iso", "400", "--surface", "cells"];
    same_at(&raw, [256; 3], &cells, &["12MiB", "64MiB", "1GiB"], &["1", "2", "5"]);
}

#[test]
fn odd_volumes_give_the_same_file_at_any_budget_and_thread_count() {
    for (seed, dims) in [[1, 1, 1], [3, 2, 270], [37, 5, 64], [65, 63, 131], [129, 97, 33], [200, 33, 300]]
        .into_iter()
        .enumerate()
    {
        let folder = tempfile::tempdir().unwrap();
        let raw = folder.path().join("v.raw");
        waves(&raw, dims, seed as u64);
        let extra = ["--iso", "-2000", "--channels", "normal,value"];
        // The unoptimised program's own code takes more than 8 MiB leaves.
        same_at(&raw, dims, &extra, &["10MiB", "1GiB"], &["1", "2", "5"]);
        let cells = ["--iso", "-2000", "--surface", "cells"];
        same_at(&raw, dims, &cells, &["12MiB", "1GiB"], &["1", "2", "5"]);
    }
}

#[test]
fn narrow_tiles_of_a_wide_volume_give_the_same_file() {
    let folder = tempfile::tempdir().unwrap();
    let raw = folder.path().join("v.raw");
    let dims = [5000, 40, 40];
    waves(&raw, dims, 1);
    for extra in [
        &["--iso", "0", "--channels", "normal,value"][..],
        &["--range", "-500..500", "--channels", "normal,value", "--connectivity", "6"],
    ] {
        // The smallest budget means the narrowest tiles.
        let mut args = vec!["--dims", "5000x40x40", "--dtype", "i16", "--memory", "1MiB"];
        args.extend(extra);
        let refusal = build(std::slice::from_ref(&raw), &folder.path().join("m.oct"), &args);
        refusal.refused(4, &["--memory"]);
        let smallest = smallest_budget(&refusal.stderr);
        let reports = same_at(&raw, dims, extra, &[smallest, "10MiB", "64MiB", "1GiB"], &["1", "2"]);
        let tiles: Vec<u64> = reports.iter().map(|r| number(r, "tile_columns")).collect();
        assert!(tiles[0] < 2600 && tiles.last() == Some(&5000), "{tiles:?}");
    }
}

/// Holds every section but the metadata to that of another file.
fn assert_same_sections(one: &Path, other: &Path) {
    let (a, b) = (Model::open(one).unwrap(), Model::open(other).unwrap());
    let kinds = |m: &Model| m.sections().iter().map(|e| e.kind).collect::<Vec<_>>();
    assert_eq!(kinds(&a), kinds(&b), "{other:?}");
    for (x, y) in a.sections().iter().zip(b.sections()) {
        let kind = x.kind.unwrap();
        if kind != SectionKind::Meta {
            assert!(a.section_bytes(kind) == b.section_bytes(kind), "{} of {other:?}", kind.name());
            assert_eq!(x.content_crc, y.content_crc, "{} of {other:?}", kind.name());
        }
    }
}

#[test]
fn one_file_slice_files_either_byte_order_and_a_dicom_series_give_the_same_sections() {
    let dims = [61, 47, 22];
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    waves(&at("v.raw"), dims, 3);
    let little = fs::read(at("v.raw")).unwrap();
    let mut big = little.clone();
    big.chunks_exact_mut(2).for_each(<[u8]>::reverse);
    fs::write(at("big.raw"), big).unwrap();
    let slice_bytes = 61 * 47 * 2;
    fs::create_dir(at("slices")).unwrap();
    let mut given = Vec::new();
    for (i, slice) in little.chunks(slice_bytes).enumerate() {
        given.push(at("slices").join(format!("slice{}.raw", i + 1)));
        fs::write(&given[i], slice).unwrap();
    }
    let raw = ["--spacing", "0.5x0.75x2", "--channels", "normal,value", "--iso", "-100"];
    let with = |dtype: &'static str| [&["--dims", "61x47x22", "--dtype", dtype][..], &raw].concat();
    build(&[at("v.raw")], &at("one.oct"), &with("i16")).json();
    build(&[at("big.raw")], &at("big.oct"), &with("i16be")).json();
    build(&[at("slices")], &at("folder.oct"), &with("i16")).json();
    build(&given, &at("given.oct"), &with("i16")).json();
    for other in ["big.oct", "folder.oct", "given.oct"] {
        assert_same_sections(&at("one.oct"), &at(other));
    }
    for (round, syntax) in Syntax::ALL.into_iter().enumerate() {
        let series = at(&format!("series{round}"));
        fs::create_dir(&series).unwrap();
        for (z, slice) in little.chunks(slice_bytes).enumerate() {
            let values: Vec<u32> =
                slice.as_chunks::<2>().0.iter().map(|b| u32::from(u16::from_le_bytes(*b))).collect();
            let image = Image {
                syntax,
                instance: u32::try_from(z).unwrap() + 1,
                position: [0.0, 0.0, 2.0 * z as f64],
                size: [61, 47],
                signed: true,
                // Another scale of the same samples: the threshold moves with it.
                rescale: Some(["2", "-1000"]),
                values: &values,
                ..Image::default()
            };
            // Names run against positions, which decide.
            fs::write(series.join(format!("{}.dcm", 99 - z)), image.bytes()).unwrap();
        }
        let model = at(&format!("series{round}.oct"));
        build(&[series], &model, &["--channels", "normal,value", "--iso", "-1200"]).json();
        assert_same_sections(&at("one.oct"), &model);
    }
}
