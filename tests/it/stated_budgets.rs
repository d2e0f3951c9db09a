//! The smallest budget that a refusal names is true: the build with it works at once, one with [`TOO_LITTLE_KIB`] less is refused
//! (up to 256 KiB too many, and a step) and names the same figure, and peaks stay within whatever budget is given. If this fails, a user raises
//! --memory as the program says, is refused again, or has a machine killed. `scripts/budgets.py` does the same with
//! hundreds of inputs.

use crate::prelude::*;
use command::build;
use infobyte::budget::parse_size;
use std::fmt::Write;

/// A budget that is refused always, but for which the program has room to look at its input.
const TIGHT: &str = if cfg!(debug_assertions) { "7MiB" } else { "5MiB" };

/// By this much less a build is refused: 256 KiB and a step of 64. What of an unoptimised program's larger code is
/// resident differs by a step more from run to run.
const TOO_LITTLE_KIB: u64 = if cfg!(debug_assertions) { 384 } else { 320 };

/// Holds one input to it; gives the budget that was named.
fn judge(input: &Path, extra: &[&str]) -> u64 {
    let model = input.with_extension("oct");
    let of = |cap: &str| build(&[input], &model, &[extra, &["--memory", cap]].concat());
    let refusal = of(TIGHT);
    let name = format!("{} {extra:?}", input.display());
    assert_eq!(refusal.code, 4, "{name}: {refusal:?}");
    let named = smallest_budget(&refusal.stderr).to_owned();
    let bytes = parse_size(&named).unwrap();
    let (report, outside) = measured_build(input, &model, &[extra, &["--memory", &named]].concat());
    let peak = report["peak_rss_bytes"].as_u64().unwrap().max(outside.unwrap_or(0));
    assert!(peak <= bytes, "{name}: a peak of {peak} under {named}");
    let less = of(&format!("{}KiB", bytes / 1024 - TOO_LITTLE_KIB));
    assert_eq!(less.code, 4, "{name}: works with less than {named}, too");
    // One figure, whatever the budget was: never the one given and a bit more.
    let again = parse_size(smallest_budget(&less.stderr)).unwrap();
    assert!(again.abs_diff(bytes) <= 128 << 10, "{name}: {named} first, and then {again}");
    bytes
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
fn the_budget_of_a_mesh_is_named_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let ball = Body::sphere([0.0; 3], 30.0, 3);
    let mut open = ball.clone();
    open.faces.truncate(open.faces.len() - 30);
    for (name, body) in [("closed", &ball), ("open", &open)] {
        for (suffix, bytes) in [
            ("stl", body.stl()),
            ("ply", body.ply("binary_little_endian")),
            ("obj", body.obj()),
            ("off", body.off()),
            ("glb", glb_of(body)),
            ("gltf", containers::gltf(body)),
            ("3mf", containers::threemf(body)),
        ] {
            let input = put(at, &format!("{name}.{suffix}"), &bytes);
            judge(&input, &["--grid", "64"]);
        }
        judge(&at.join(format!("{name}.stl")), &["--grid", "90", "--surface", "cells"]);
    }
    judge(&at.join("open.stl"), &["--grid", "90", "--fill", "surface"]);
    judge(&at.join("closed.obj"), &["--grid", "90", "--channels", "normal,material"]);
}

fn glb_of(body: &Body) -> Vec<u8> {
    glb(&containers::description(body), &containers::buffer(body))
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
fn the_budget_of_a_volume_that_is_cleaned_is_named_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let raw = folder.path().join("v.raw");
    write_raw(&raw, [60, 50, 40], |[x, y, z]| [u8::try_from((x * 7 + y * 3 + z * 5) % 256).unwrap()]);
    let how = ["--dims", "60x50x40", "--dtype", "u8", "--iso", "100"];
    for extra in [&[][..], &["--keep-largest", "1"], &["--close", "2"], &["--surface", "cells"]] {
        judge(&raw, &[&how, extra].concat());
    }
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

#[test]
fn the_budget_of_a_tree_is_named_at_once_and_kept() {
    let folder = tempfile::tempdir().unwrap();
    let sphere = |x: usize| {
        format!("multmatrix([[1,0,0,{x}],[0,1,0,0],[0,0,1,0],[0,0,0,1]]) {{ sphere(r = 2.5); }}\n")
    };
    for count in [1, 400] {
        let tree = put(folder.path(), "t.csg", (0..count).map(sphere).collect::<String>().as_bytes());
        judge(&tree, &["--grid", "64"]);
        judge(&tree, &["--grid", "64", "--surface", "cells"]);
    }
    // Large ones are not read to find out: what they take is counted from their texts.
    let deep = "multmatrix([[1,0,0,0.1],[0,1,0,0],[0,0,1,0],[0,0,0,1]]) {\n";
    let deep = format!("{}cube(3);{}", deep.repeat(30_000), "}".repeat(30_000));
    let mut corners = String::new();
    let mut faces = String::new();
    for k in 0..20_000 {
        write!(corners, "[{k},0,0],[{k}.5,1,0],[{k}.5,0,1],[{k}.5,0.3,0.3],").unwrap();
        let [a, b, c, d] = [0, 1, 2, 3].map(|i| 4 * k + i);
        write!(faces, "[{a},{b},{c}],[{a},{c},{d}],[{a},{d},{b}],[{b},{d},{c}],").unwrap();
    }
    // Meshes of a tree are looked at, and one after the other is read while those before are held.
    put(folder.path(), "ball.stl", &Body::sphere([0.0; 3], 30.0, 3).stl());
    put(folder.path(), "ball.ply", &Body::sphere([0.0; 3], 25.0, 4).ply("binary_little_endian"));
    let pair = "difference() { import(file = \"ball.stl\"); import(file = \"ball.ply\"); }";
    judge(&put(folder.path(), "pair.csg", pair.as_bytes()), &["--grid", "64"]);
    let large = format!("polyhedron(points=[{corners}[0,0,0]], faces=[{faces}[0,1,2],[0,2,1]]);");
    let large = format!("{large} cube([20000, 8000, 8000]);");
    let many = |solid: &str| {
        let placed =
            |k: usize| format!("multmatrix([[0.6,0.8,0,{k}],[-0.8,0.6,0,0],[0,0,1,0]]) {{ {solid} }}\n");
        (0..2000).map(placed).collect::<String>()
    };
    for (name, text) in [
        ("deep.csg", deep),
        ("large.csg", large),
        ("boxes.csg", many("cube([2, 1, 2]);")),
        ("round.csg", many("cylinder($fn = 0, h = 3, r1 = 1, r2 = 2);")),
        ("facets.csg", many("sphere($fn = 20, r = 2);")),
        ("outlines.csg", many("linear_extrude(height = 3) { polygon([[0, 0], [2, 0], [1, 2]]); }")),
    ] {
        let tree = put(folder.path(), name, text.as_bytes());
        judge(&tree, &["--grid", "48"]);
    }
}
