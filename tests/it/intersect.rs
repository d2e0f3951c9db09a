//! `oct intersect`: bodies whose distance is known touch when it says so. If this fails, an implant is said to fit that
//! does not.

#![expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "small bodies")]

use crate::prelude::*;

/// A ball of 20 mm radius about the origin, in voxels of some size.
fn ball(path: &str, spacing: f64, surface: SurfaceKind) {
    let side = (48.0 / spacing) as u32;
    let middle = f64::from(side - 1) / 2.0;
    let depth = |p: [u32; 3]| {
        let square: f64 = p.iter().map(|c| (f64::from(*c) - middle).powi(2)).sum();
        (20.0 - spacing * square.sqrt()) as f32
    };
    let mut affine = Affine::from_spacing([spacing; 3]);
    affine.rows.iter_mut().for_each(|row| row[3] = -middle * spacing);
    let volume = Voxels::from_fn(Dims::new(side, side, side).unwrap(), depth).placed(affine);
    let options =
        BuildOptions { threshold: Threshold::Iso(0.0), surface: Some(surface), ..BuildOptions::default() };
    infobyte::build(&volume, &options, path).unwrap();
}

#[test]
fn balls_touch_where_their_middles_are_two_radii_apart() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    ball(&at("fine.oct"), 0.5, SurfaceKind::Skin);
    ball(&at("coarse.oct"), 1.5, SurfaceKind::Skin);
    ball(&at("cells.oct"), 1.0, SurfaceKind::Cells);
    oct(&["pack", &at("coarse.oct"), "-o", &at("packed.oct"), "--json"]).json();
    for (one, other) in [("fine.oct", "coarse.oct"), ("cells.oct", "fine.oct"), ("packed.oct", "cells.oct")] {
        let touch = |distance: f64, turn: f64| {
            // The other one is turned about z, and moved along a diagonal.
            let (s, c) = turn.sin_cos();
            let by = distance / 3.0_f64.sqrt();
            let place = format!("{c},{},0,{by},{s},{c},0,{by},0,0,1,{by}", -s);
            oct(&["intersect", &at(one), &at(other), "--place", &place, "--json"]).json()
        };
        for turn in [0.0, 0.7] {
            for (distance, due) in [(0.0, true), (35.0, true), (39.0, true), (42.5, false), (60.0, false)] {
                let found = touch(distance, turn);
                assert_eq!(found["touch"], due, "{one} {other} {distance}: {found}");
                let counts = [0, 1].map(|i| found["touching_voxels"][i].as_u64().unwrap() > 0);
                assert_eq!(counts, [due; 2]);
                if due && distance > 0.0 {
                    // On the way from the one middle to the other.
                    for axis in 0..3 {
                        let [low, high] = [0, 1].map(|i| found["range_mm"][i][axis].as_f64().unwrap());
                        assert!(low > -3.0 && high < distance / 3.0_f64.sqrt() + 3.0, "{found}");
                    }
                }
            }
        }
        // One deep inside the other does not touch it.
        let small = "0.3,0,0,0,0,0.3,0,0,0,0,0.3,0";
        assert_eq!(
            oct(&["intersect", &at(one), &at(other), "--place", small, "--json"]).json()["touch"],
            false
        );
    }
}

/// Two balls of 20 mm: what they share is a lens of known volume, and what lies between them is known as well.
#[test]
fn balls_overlap_by_a_lens_or_are_apart() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    ball(&at("one.oct"), 1.0, SurfaceKind::Cells);
    ball(&at("other.oct"), 0.7, SurfaceKind::Cells);
    ball(&at("skin.oct"), 1.0, SurfaceKind::Skin);
    let intersect =
        |place: &[&str]| oct(&[&["intersect", &at("one.oct"), &at("other.oct"), "--json"], place].concat());
    let pi = std::f64::consts::PI;
    for distance in [0.0, 4.0, 19.3, 33.0, 38.5, 41.5, 44.0, 75.0_f64] {
        let by = distance / 3.0_f64.sqrt();
        let found = intersect(&["--move", &format!("{by},{by},{by}")]).json();
        let number = |key: &str| found[key].as_f64().unwrap();
        let gap = 40.0 - distance;
        let lens = pi / 12.0 * gap.max(0.0).powi(2) * (80.0 + distance);
        let close = |key: &str, due: f64, by: f64| {
            assert!((number(key) - due).abs() <= by, "{distance} {key}: due {due}: {found}");
        };
        close("overlap_mm3", lens, 0.01 * lens + 1.0);
        close("depth_mm", gap.min(distance).max(0.0), 0.06);
        close("clearance_mm", (-gap).max(0.0), 0.03);
        for (least, is_clear) in [("0", gap <= 0.0), ("3", gap <= -3.0)] {
            let run = intersect(&["--move", &format!("{by},{by},{by}"), "--clearance", least]);
            assert_eq!(run.code, if is_clear { 0 } else { 6 }, "{distance} {least}: {run:?}");
        }
    }
    // One deep inside the other.
    let found = intersect(&["--place", "0.3,0,0,0,0,0.3,0,0,0,0,0.3,0"]).json();
    let number = |key: &str| found[key].as_f64().unwrap();
    let small = 4.0 / 3.0 * pi * 216.0;
    assert!((number("overlap_mm3") - small).abs() < 0.01 * small, "{found}");
    assert!((number("depth_mm") - 14.0).abs() < 0.06 && number("clearance_mm") == 0.0, "{found}");
    // A body and itself.
    let (one, whole) = (at("one.oct"), 4.0 / 3.0 * pi * 8000.0);
    let found = oct(&["intersect", &one, &one, "--json"]).json();
    assert!((found["overlap_mm3"].as_f64().unwrap() - whole).abs() < 0.01 * whole, "{found}");
    assert_eq!((&found["depth_mm"], &found["clearance_mm"]), (&0.0.into(), &0.0.into()), "{found}");
    assert_eq!(oct(&["intersect", &one, &one, "--clearance", "0"]).code, 6);
    oct(&["intersect", &at("skin.oct"), &at("one.oct"), "--clearance", "0"])
        .refused(3, &["skin.oct", "--surface cells"]);
    let found = oct(&["intersect", &at("skin.oct"), &at("one.oct"), "--json"]).json();
    assert!(found["clearance_mm"].is_null() && found["touch"] == true, "{found}");
    oct(&["intersect", &at("one.oct"), &at("one.oct"), "--clearance", "-1"]).refused(2, &["--clearance"]);
}

#[test]
fn what_cannot_be_placed_or_read_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    ball(&at("a.oct"), 2.0, SurfaceKind::Skin);
    let a = at("a.oct");
    oct(&["intersect", &a, &a, "--place", "1,0,0,0,1,0,0,0,0,0,1,0"]).refused(2, &["a.oct", "makes it flat"]);
    oct(&["intersect", &a, &a, "--place", "1,0,0"]).refused(2, &["three rows of four"]);
    oct(&["intersect", &a, &a, "--move", "1,nan,0"]).refused(2, &["--move"]);
    oct(&["intersect", &a, &at("b.oct")]).refused(3, &["b.oct"]);
    let mut bytes = std::fs::read(&a).unwrap();
    let last = bytes.len() - 1;
    bytes[last] ^= 1;
    std::fs::write(at("bad.oct"), bytes).unwrap();
    oct(&["intersect", &a, &at("bad.oct")]).refused(3, &["bad.oct"]);
}
