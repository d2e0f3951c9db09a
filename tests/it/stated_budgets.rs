//! The memory cap that a refusal names works, whatever the input: the build with it succeeds, and its plan and its peak
//! stay within. If this fails, a user raises --memory as the program says, and is refused again or has a machine killed.

use crate::prelude::*;
use command::build;
use infobyte::budget::parse_size;
use std::fmt::Write;

/// A cap that is always refused, but for which the program has room to look at its input.
const TIGHT: &str = if cfg!(debug_assertions) { "7MiB" } else { "5MiB" };

/// Builds an input with the cap that the refusal of a tight one names.
fn judge(input: &Path, extra: &[&str]) {
    judge_from(TIGHT, input, extra);
}

fn judge_from(tight: &str, input: &Path, extra: &[&str]) {
    let model = input.with_extension("oct");
    let refusal = build(&[input], &model, &[extra, &["--memory", tight]].concat());
    let name = format!("{} {extra:?}", input.display());
    assert_eq!(refusal.code, 4, "{name}: {refusal:?}");
    let named = smallest_budget(&refusal.stderr);
    let bytes = parse_size(named).unwrap();
    let (report, outside) = measured_build(input, &model, &[extra, &["--memory", named]].concat());
    let peak = report["peak_rss_bytes"].as_u64().unwrap().max(outside.unwrap_or(0));
    println!("{name}: {named}, peak {peak}");
    assert!(report["memory_plan_bytes"].as_u64() <= Some(bytes), "{name}: {report}");
    assert!(peak <= bytes, "{name}: a peak of {peak} under {named}");
}

/// A PNG in colours whose rows are not filtered, of four texels a pixel's number; interlaced by Adam7 or not.
fn png(side: usize, interlaced: bool) -> Vec<u8> {
    let passes: &[[usize; 4]] = if interlaced {
        &[[0, 0, 8, 8], [4, 0, 8, 8], [0, 4, 4, 8], [2, 0, 4, 4], [0, 2, 2, 4], [1, 0, 2, 2], [0, 1, 1, 2]]
    } else {
        &[[0, 0, 1, 1]]
    };
    let mut rows = Vec::new();
    for &[x0, y0, dx, dy] in passes {
        for y in (y0..side).step_by(dy).filter(|_| x0 < side) {
            rows.push(0);
            for x in (x0..side).step_by(dx) {
                rows.extend([x * 3 % 251, y * 5 % 241, (x + y) % 239].map(|c| u8::try_from(c).unwrap()));
            }
        }
    }
    let mut file = b"\x89PNG\r\n\x1a\n".to_vec();
    let mut chunk = |name: &[u8; 4], data: &[u8]| {
        file.extend(u32::try_from(data.len()).unwrap().to_be_bytes());
        let checked = [&name[..], data].concat();
        file.extend(&checked);
        let crc = checked.iter().fold(u32::MAX, |crc, byte| {
            (0..8)
                .fold(crc ^ u32::from(*byte), |crc, _| crc >> 1 ^ if crc & 1 == 1 { 0xedb8_8320 } else { 0 })
        });
        file.extend((!crc).to_be_bytes());
    };
    let size = u32::try_from(side).unwrap().to_be_bytes();
    chunk(b"IHDR", &[&size[..], &size, &[8, 2, 0, 0, u8::from(interlaced)]].concat());
    chunk(b"IDAT", &crate::common::compress::zlib(&rows));
    chunk(b"IEND", &[]);
    file
}

/// A ball with texture coordinates, and the texture.
fn textured(folder: &Path, name: &str, texture: &str) -> PathBuf {
    let mut obj = format!("mtllib {name}.mtl\nvt 0 0\nvt 0.9 0.1\nvt 0.3 0.8\nusemtl m\n");
    for line in String::from_utf8(Body::sphere([0.0; 3], 30.0, 3).obj()).unwrap().lines() {
        if let Some(corners) = line.strip_prefix("f ") {
            let all: Vec<_> = corners.split_whitespace().map(|c| c.split('/').next().unwrap()).collect();
            writeln!(obj, "f {}/1 {}/2 {}/3", all[0], all[1], all[2]).unwrap();
        } else if line.starts_with("v ") {
            writeln!(obj, "{line}").unwrap();
        }
    }
    put(folder, &format!("{name}.mtl"), format!("newmtl m\nmap_Kd {texture}\n").as_bytes());
    put(folder, &format!("{name}.obj"), obj.as_bytes())
}

#[test]
fn the_named_cap_of_meshes_and_trees_works() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let ball = Body::sphere([0.0; 3], 30.0, 3);
    let mut open = ball.clone();
    open.faces.truncate(open.faces.len() - 30);
    let glb = glb(&containers::description(&open), &containers::buffer(&open));
    for (name, bytes, extra) in [
        (
            "closed.obj",
            ball.obj(),
            &["--grid", "90", "--surface", "skin", "--channels", "normal,material"][..],
        ),
        ("closed.3mf", containers::threemf(&ball), &["--grid", "64"]),
        ("open.stl", open.stl(), &["--grid", "90", "--fill", "surface", "--surface", "skin"]),
        ("open.glb", glb, &["--voxel", "0.05"]),
        (
            "fine.ply",
            Body::sphere([0.0; 3], 30.0, 6).ply("binary_little_endian"),
            &["--error", "0.1", "--surface", "cells"],
        ),
    ] {
        judge(&put(at, name, &bytes), extra);
    }
    let placed = |solid: &str, count: usize| {
        let each =
            |k: usize| format!("multmatrix([[0.6,0.8,0,{k}],[-0.8,0.6,0,0],[0,0,1,0]]) {{ {solid} }}\n");
        (0..count).map(each).collect::<String>()
    };
    let deep = "multmatrix([[1,0,0,0.1],[0,1,0,0],[0,0,1,0],[0,0,0,1]]) {\n";
    let deep = format!("{}cube(3);{}", deep.repeat(30_000), "}".repeat(30_000));
    let (mut corners, mut faces) = (String::new(), String::new());
    for k in 0..20_000 {
        write!(corners, "[{k},0,0],[{k}.5,1,0],[{k}.5,0,1],[{k}.5,0.3,0.3],").unwrap();
        let [a, b, c, d] = [0, 1, 2, 3].map(|i| 4 * k + i);
        write!(faces, "[{a},{b},{c}],[{a},{c},{d}],[{a},{d},{b}],[{b},{d},{c}],").unwrap();
    }
    let large = format!("polyhedron(points=[{corners}[0,0,0]], faces=[{faces}[0,1,2],[0,2,1]]);");
    for (name, text, extra) in [
        ("one.csg", placed("sphere(r = 2.5);", 1), &[][..]),
        ("round.csg", placed("cylinder($fn = 0, h = 3, r1 = 1, r2 = 2);", 2000), &["--surface", "skin"]),
        ("boxes.csg", placed("cube([2, 1, 2]);", 2000), &[]),
        ("facets.csg", placed("sphere($fn = 20, r = 2);", 2000), &[]),
        (
            "outlines.csg",
            placed("linear_extrude(height = 3) { polygon([[0, 0], [2, 0], [1, 2]]); }", 2000),
            &[],
        ),
        ("grown.csg", placed("offset3d(r = 0.5) cube([2, 1, 2]);", 200), &[]),
        ("deep.csg", deep, &[]),
        ("large.csg", format!("{large} cube([20000, 8000, 8000]);"), &[]),
        (
            "pair.csg",
            "difference() { import(file = \"fine.ply\"); import(file = \"closed.obj\"); }".to_owned(),
            &[],
        ),
    ] {
        judge(&put(at, name, text.as_bytes()), &[&["--grid", "48"], extra].concat());
    }
}

#[test]
fn the_named_cap_of_volumes_works() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    for (name, dims, len, dtype, channels) in [
        ("wide.raw", "3000x40x40", 9_600_000, "u16", "normal,value"),
        ("cube.raw", "100x100x100", 8_000_000, "f64", "normal,value"),
        ("dot.raw", "1x1x1", 1, "u8", "normal"),
    ] {
        // Zeros that take no space.
        File::create(at.join(name)).unwrap().set_len(len).unwrap();
        let raw = ["--dims", dims, "--dtype", dtype, "--iso", "0", "--channels", channels];
        judge_from("64KiB", &at.join(name), &raw);
    }
}

/// The cap is named before they are unrolled.
#[test]
fn the_named_cap_of_packed_volumes_works() {
    let folder = tempfile::tempdir().unwrap();
    let object = Object::new([60, 50, 40], ScalarType::U16, [0.5, -0.75, 2.0]);
    for encoding in ["gzip", "bzip2"] {
        let input = file(folder.path(), &format!("{encoding}.nrrd"), &nrrd(&object, encoding, false, ""));
        for cleaning in [&[][..], &["--close", "1", "--keep-largest", "1"]] {
            judge_from("64KiB", &input, &[&["--iso", "300"], cleaning].concat());
        }
    }
}

#[test]
fn images_of_textures_stay_within_the_budget() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    put(at, "plain.png", &png(1201, false));
    put(at, "passes.png", &png(1201, true));
    let [plain, passes] = ["plain", "passes"].map(|name| textured(at, name, &format!("{name}.png")));
    judge(&plain, &["--grid", "48"]);
    judge(&passes, &["--grid", "48"]);
    // The samples come in another order only.
    let of = |input: &Path| {
        let model = Model::read(input.with_extension("oct")).unwrap();
        assert!(model.items(Channel::Color).is_some());
        model.section_bytes(SectionKind::Voxels(Channel::Color)).unwrap().to_vec()
    };
    assert!(of(&plain) == of(&passes));
}

#[test]
fn the_budget_of_jpeg_2000_is_named_at_once() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["dicom-ct-15-syntaxes/j2k-90.dcm", "dicom-ct-15-syntaxes/j2k-lossy-91.dcm"] {
        let Some(real) = real_data(name) else { return };
        let copy = put(folder.path(), "slice.dcm", &fs::read(real).unwrap());
        judge(&copy, &[]);
    }
}
