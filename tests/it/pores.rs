//! `oct pores`: the components that it lists are those of a flood over the samples, and their sizes are the bodies'.

#![expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "small bodies")]

use crate::prelude::*;
use std::collections::BTreeMap;

const SIDES: [u32; 3] = [44, 40, 36];

/// Labels of all samples, x fastest.
type Map = Vec<u8>;

fn map_of(label: impl Fn([f64; 3]) -> u8) -> Map {
    let [nx, ny, nz] = SIDES;
    let places =
        (0..nz).flat_map(|z| (0..ny).flat_map(move |y| (0..nx).map(move |x| [x, y, z].map(f64::from))));
    places.map(label).collect()
}

/// Is a point in a ball?
fn is_in(p: [f64; 3], middle: [f64; 3], radius: f64) -> bool {
    (0..3).map(|a| (p[a] - middle[a]).powi(2)).sum::<f64>() <= radius * radius
}

/// Label, samples and sums of coordinates of each component, by the slowest flood that there is.
fn flooded(map: &Map, bodies: bool) -> Vec<(u8, u64, [u64; 3])> {
    let [nx, ny, nz] = SIDES.map(i64::from);
    let mut seen = vec![false; map.len()];
    let mut found = Vec::new();
    for start in 0..map.len() {
        if seen[start] || (map[start] != 0) != bodies {
            continue;
        }
        let (mut waiting, mut count, mut sums, mut is_open) = (vec![start], 0, [0; 3], false);
        seen[start] = true;
        while let Some(at) = waiting.pop() {
            let p = [at as i64 % nx, at as i64 / nx % ny, at as i64 / nx / ny];
            count += 1;
            sums = std::array::from_fn(|a| sums[a] + p[a] as u64);
            for step in 0..27 {
                let by = [step % 3 - 1, step / 3 % 3 - 1, step / 9 - 1];
                if by.iter().map(|c: &i64| c.abs()).sum::<i64>() != 1 {
                    continue;
                }
                let [x, y, z] = [0, 1, 2].map(|a| p[a] + by[a]);
                if !(0..nx).contains(&x) || !(0..ny).contains(&y) || !(0..nz).contains(&z) {
                    is_open = true;
                    continue;
                }
                let next = (x + nx * (y + ny * z)) as usize;
                if !seen[next] && map[next] == map[start] {
                    seen[next] = true;
                    waiting.push(next);
                }
            }
        }
        if bodies || !is_open {
            found.push((map[start], count, sums));
        }
    }
    found.sort_unstable();
    found
}

/// Columns of the table by name.
fn table(path: &str) -> Vec<BTreeMap<String, String>> {
    let text = std::fs::read_to_string(path).unwrap();
    let mut lines = text.lines().map(|line| line.split(',').map(str::to_owned).collect::<Vec<_>>());
    let head = lines.next().unwrap();
    lines.map(|row| head.iter().cloned().zip(row).collect()).collect()
}

#[test]
fn components_are_those_of_a_flood_over_the_samples() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| text(&folder.path().join(name));
    let mut random = Random(5);
    let mut balls: Vec<([f64; 3], f64)> = (0..90)
        .map(|_| (SIDES.map(|n| 3.0 + random.below(u64::from(n) - 6) as f64), 0.5 + random.below(4) as f64))
        .collect();
    balls.push(([20.0, 20.0, 17.0], 12.0));
    let any =
        |p: [f64; 3], each: usize| balls.iter().skip(each % 3).step_by(3).any(|(c, r)| is_in(p, *c, *r));
    let inner = |p: [f64; 3]| (0..3).all(|a| p[a] >= 1.0 && p[a] <= f64::from(SIDES[a]) - 2.0);
    let specks = Random(9);
    let speck = |p: [f64; 3]| {
        let mut one = Random(specks.0 ^ p[0] as u64 ^ (p[1] as u64) << 16 ^ (p[2] as u64) << 32);
        one.below(9) == 0
    };
    let maps = [
        ("a block with round holes", map_of(|p| u8::from(inner(p) && !any(p, 0)))),
        ("balls", map_of(|p| u8::from(any(p, 0)))),
        ("holes that touch at edges and corners", map_of(|p| u8::from(inner(p) && !speck(p)))),
        ("specks", map_of(|p| u8::from(inner(p) && speck(p)))),
        ("three labels", map_of(|p| (1..4).find(|label| any(p, *label)).unwrap_or(0) as u8)),
        (
            "a shell in three labels",
            map_of(|p| {
                let wall = is_in(p, [20.0; 3], 15.0) && !is_in(p, [20.0; 3], 11.0);
                u8::from(wall) * (1 + u8::from(p[0] > 18.0) + u8::from(p[2] > 22.0))
            }),
        ),
    ];
    let dims = SIDES.map(|n| n.to_string()).join("x");
    for (name, map) in maps {
        let labelled = map.iter().any(|label| *label > 1);
        std::fs::write(at("m.raw"), &map).unwrap();
        let how: &[&str] =
            if labelled { &["--labels", "all"] } else { &["--iso", "1", "--surface", "cells"] };
        let args = ["build", &at("m.raw"), "-o", &at("m.oct"), "--dims", &dims, "--dtype", "u8", "--json"];
        oct(&[&args[..], how].concat()).json();
        // Planes may cover single samples outside: those that are left are in the mask.
        oct(&["export", &at("m.oct"), "-o", &at("m.nii"), "--json"]).json();
        let mask = std::fs::read(at("m.nii")).unwrap().split_off(352);
        let map = if labelled { map } else { mask };
        for bodies in [false, true] {
            let what = if bodies { &["--bodies"][..] } else { &[] };
            let asked = ["pores", &at("m.oct"), "--csv", &at("m.csv"), "--json"];
            let report = oct(&[&asked[..], what].concat()).json();
            let mut found: Vec<_> = table(&at("m.csv"))
                .iter()
                .map(|row| {
                    let number = |key: &str| row[key].parse::<f64>().unwrap();
                    let samples = number("samples");
                    let sums = ["x", "y", "z"].map(|axis| (number(axis) * samples).round() as u64);
                    let label = row["label"].parse().unwrap_or(u8::from(bodies));
                    (label, samples as u64, sums)
                })
                .collect();
            found.sort_unstable();
            assert_eq!(found, flooded(&map, bodies), "{name}, bodies {bodies}");
            let solid = map.iter().filter(|label| **label != 0).count();
            assert_eq!(report["solid_volume_mm3"], solid as f64, "{name}");
            let rows = report[if bodies { "bodies" } else { "pores" }].as_u64().unwrap();
            assert_eq!(rows, found.len() as u64, "{name}");
        }
    }
}

/// A ball with three pores, in voxels of several shapes: volumes, areas and places are the bodies'.
#[test]
fn pores_have_the_volume_the_area_and_the_place_of_the_balls_that_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| text(&folder.path().join(name));
    let pores = [([-6.21, 2.13, 1.37], 4.5), ([7.4, -1.15, -3.3], 3.5), ([1.3, 3.2, 9.4], 1.2)];
    for spacing in [[1.0, 1.0, 1.0], [0.6, 0.6, 1.2]] {
        let dims = spacing.map(|s: f64| (40.0 / s) as u32);
        let depth = |p: [u32; 3]| {
            let place: [f64; 3] = std::array::from_fn(|a| (f64::from(p[a]) + 0.5) * spacing[a] - 20.0);
            let from = |c: [f64; 3]| (0..3).map(|a| (place[a] - c[a]).powi(2)).sum::<f64>().sqrt();
            pores.iter().fold(16.0 - from([0.0; 3]), |depth, (c, r)| depth.min(from(*c) - r)) as f32
        };
        write_raw(Path::new(&at("m.raw")), dims, |p| depth(p).to_le_bytes());
        let (size, step) = (dims.map(|n| n.to_string()).join("x"), spacing.map(|s| s.to_string()).join("x"));
        let args =
            ["build", &at("m.raw"), "-o", &at("m.oct"), "--dims", &size, "--dtype", "f32", "--iso", "0"];
        oct(&[&args[..], &["--spacing", &step, "--surface", "cells", "--json"]].concat()).json();
        let asked = ["pores", &at("m.oct"), "--csv", &at("m.csv"), "--json"];
        let report = oct(&[&asked[..], &["--gap"]].concat()).json();
        assert_eq!(report["pores"], 3);
        for ((middle, radius), pore) in pores.iter().zip(report["largest"].as_array().unwrap()) {
            let near = |key: &str, due: f64, within: f64| {
                let value = pore[key].as_f64().unwrap();
                assert!((value / due - 1.0).abs() < within, "{spacing:?} {radius} {key}: {value}, not {due}");
            };
            let is_small = *radius < 2.0;
            near(
                "volume_mm3",
                4.0 / 3.0 * std::f64::consts::PI * radius.powi(3),
                if is_small { 0.45 } else { 0.04 },
            );
            near("area_mm2", 4.0 * std::f64::consts::PI * radius.powi(2), if is_small { 0.35 } else { 0.04 });
            near("equivalent_diameter_mm", 2.0 * radius, if is_small { 0.2 } else { 0.02 });
            assert_eq!(
                pore["below_resolution"],
                is_small || *radius < 3.6 && spacing[2] > 1.0 && 2.0 * radius < 3.6
            );
            let gap = pore["gap_mm"].as_f64().unwrap();
            let due = 16.0 - dot(*middle, *middle).sqrt() - radius;
            assert!((gap - due).abs() < 0.25, "{spacing:?} {radius}: a gap of {gap}, not {due}");
            let row = &table(&at("m.csv"))[pore["id"].as_u64().unwrap() as usize - 1];
            assert_eq!(row["gap_mm"], gap.to_string());
            for axis in 0..3 {
                let due = middle[axis] + 20.0 - spacing[axis] / 2.0;
                let place = pore["at_mm"][axis].as_f64().unwrap();
                assert!((place - due).abs() < 0.3, "{spacing:?} {radius}: {place}, not {due}");
                let reach = [0, 1].map(|side| pore["box_mm"][side][axis].as_f64().unwrap());
                let width = reach[1] - reach[0];
                assert!(
                    (width - 2.0 * radius).abs() < 1.6 * spacing[axis],
                    "{spacing:?} {radius}: {reach:?}"
                );
            }
        }
        let few = oct(&[&asked[..], &["--least", "60"]].concat()).json();
        assert_eq!((few["pores"].as_u64(), few["below_least"].as_u64()), (Some(2), Some(1)));
        assert_eq!(table(&at("m.csv")).len(), 2);
    }
}

#[test]
fn what_cannot_be_measured_is_refused_and_leaves_the_table_as_it_was() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| text(&folder.path().join(name));
    write_raw(Path::new(&at("m.raw")), [20; 3], |p| [u8::from(p.iter().all(|c| (4..16).contains(c))) * 200]);
    let build = |extra: &[&str]| {
        let args =
            ["build", &at("m.raw"), "-o", &at("m.oct"), "--dims", "20x20x20", "--dtype", "u8", "--iso", "99"];
        oct(&[&args[..], extra, &["--json"]].concat()).json();
    };
    std::fs::write(at("t.csv"), "kept").unwrap();
    let refused = |words: &[&str]| oct(&["pores", &at("m.oct"), "--csv", &at("t.csv")]).refused(2, words);
    build(&["--surface", "skin"]);
    refused(&["m.oct", "skin of voxels", "--surface cells"]);
    build(&["--surface", "skin", "--visible-from", "outside"]);
    refused(&["m.oct", "keeps only what can be seen"]);
    assert_eq!(std::fs::read_to_string(at("t.csv")).unwrap(), "kept");
    build(&["--surface", "cells"]);
    oct(&["pores", &at("m.oct"), "--csv", &at("m.oct")]).refused(2, &["m.oct"]);
    build(&["--surface", "cells", "--error", "0.3"]);
    oct(&["pores", &at("m.oct"), "--gap"]).refused(3, &["m.oct", "larger leaves", "without --error"]);
    build(&["--surface", "cells"]);
    let whole = oct(&["pores", &at("m.oct"), "--gap"]);
    assert!(whole.stdout.contains("0 pores") && whole.code == 0, "{whole:?}");
}
