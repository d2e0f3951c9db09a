//! Cells between labels hold every sample's label and every wall, whatever the type of the samples, the memory and the
//! threads; damaged ones are refused. If this fails, organs lose samples, have holes or grow into each other.
#![expect(clippy::cast_possible_truncation, reason = "numbers here are small by construction")]

use crate::labels::{built_alike, map};
use crate::prelude::*;
use crate::scene_command::samples;
use infobyte::builder::LabelChoice;
use infobyte::format::Walls;

fn options(choice: &LabelChoice, memory: u64, threads: usize) -> BuildOptions {
    BuildOptions {
        labels: Some(choice.clone()),
        memory: infobyte::budget::MemoryCap::Share(memory),
        threads,
        ..BuildOptions::default()
    }
}

/// The walls of all cells of a model.
fn walls_of(model: &Model) -> HashMap<[u32; 3], Walls> {
    let view = model.view();
    model.voxels().map(|cell| (cell.voxel, view.walls(cell.number).unwrap())).collect()
}

/// Every cell whose samples differ is there, and no other; and the samples have their labels in it.
pub(crate) fn check(model: &Model, dims: [u32; 3], label: impl Fn([u32; 3]) -> u16) {
    let cells = walls_of(model);
    let mut due = 0;
    let [nx, ny, nz] = dims;
    for at in (0..=nz).flat_map(|z| (0..=ny).flat_map(move |y| (0..=nx).map(move |x| [x, y, z]))) {
        let corner = |corner: u32| {
            let p: [u32; 3] = std::array::from_fn(|a| (at[a] + (corner >> a & 1)).wrapping_sub(1));
            if (0..3).all(|a| p[a] < dims[a]) { label(p) } else { 0 }
        };
        let corners: Vec<u16> = (0..8).map(corner).collect();
        let differ = corners.iter().any(|label| *label != corners[0]);
        let found = cells.get(&at);
        assert_eq!(found.is_some(), differ, "{at:?}");
        if let Some(walls) = found {
            due += 1;
            let own: Vec<u16> = (0..8).map(|corner| walls.corner(corner)).collect();
            assert_eq!(own, corners, "{at:?}");
        }
    }
    assert_eq!(cells.len(), due);
}

#[test]
fn every_sample_keeps_its_label_at_any_budget_and_threads() {
    let all = LabelChoice::All;
    let cases = [
        ([70, 34, 20], 2, 9, all.clone()),
        ([130, 18, 20], 5, 4, all.clone()),
        ([34, 33, 36], 300, 1, all.clone()),
        ([1, 1, 1], 3, 1, all.clone()),
        ([67, 34, 5], 40, 3, LabelChoice::Only(vec![[2, 2], [7, 19]])),
        ([40, 70, 17], 20, 5, all),
    ];
    for (seed, (dims, kinds, block, choice)) in (1..).zip(cases) {
        let mut labels = map(dims, kinds, block, seed);
        labels[0] = 2;
        let at = |[x, y, z]: [u32; 3]| labels[(x + dims[0] * (y + dims[1] * z)) as usize];
        let volume = Voxels::from_fn(Dims::new(dims[0], dims[1], dims[2]).unwrap(), at);
        let options = options(&choice, 64 << 20, 1);
        built_alike(&volume, &options, 2 << 20, |model| {
            check(model, dims, |p| if choice.contains(at(p)) { at(p) } else { 0 });
        });
    }
}

/// A shell of 1.2 voxels has both of its sides in every cell, as true as those of a ball, alone and around another label.
#[test]
fn thin_shells_have_both_of_their_sides() {
    let (side, middle, radii) = (58_u32, [28.7, 29.2, 28.9], [24.0, 25.2]);
    let distance = |p: [f64; 3]| (0..3).map(|a| (p[a] - middle[a]).powi(2)).sum::<f64>().sqrt();
    for inner in [0_u16, 2] {
        let label = |p: [u32; 3]| match distance(p.map(f64::from)) {
            r if r <= radii[0] => inner,
            r if r <= radii[1] => 1,
            _ => 0,
        };
        let volume = Voxels::from_fn(Dims::new(side, side, side).unwrap(), label);
        let options = options(&LabelChoice::All, 64 << 20, 1);
        built_alike(&volume, &options, 4 << 20, |model| {
            check(model, [side; 3], label);
            let (mut squares, mut two_sided) = (Vec::new(), 0);
            for (at, walls) in walls_of(model) {
                assert!(walls.planes().len() < 3, "{at:?}");
                two_sided += usize::from(walls.planes().len() == 2);
                for (i, plane) in walls.planes().iter().enumerate() {
                    let normal = plane.normal.map(f64::from);
                    let length = dot(normal, normal);
                    let foot = normal.map(|n| n * f64::from(plane.offset) / length);
                    let front = dot(walls.planes()[0].normal.map(f64::from), foot);
                    if foot.iter().all(|c| c.abs() <= 1.0)
                        && (i == 0 || front > f64::from(walls.planes()[0].offset))
                    {
                        let r = distance(std::array::from_fn(|a| f64::from(at[a]) - 0.5 + foot[a] / 2.0));
                        squares.push((r - radii[0]).abs().min((r - radii[1]).abs()).powi(2));
                    }
                }
            }
            let rms = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
            assert!(
                squares.len() > 15_000 && two_sided > 1_000 && rms < 0.09,
                "{} {two_sided} {rms}",
                squares.len()
            );
        });
    }
}

/// Builds a model of each label, holds it against the whole, and counts cells with several walls.
fn hold_each(input: &Path, extra: &[&str]) -> usize {
    let folder = tempfile::tempdir().unwrap();
    let [all, each] = ["all.oct", "each"].map(|name| folder.path().join(name));
    let how =
        ["--labels", "all", "--surface", "cells", "--memory", "10MiB", "--each", &text(&each), "--json"];
    let report = command::build(&[input], &all, &[&how, extra].concat()).json();
    assert!(report["peak_rss_bytes"].as_u64().unwrap() <= (10 + SYSTEM_MIB) << 20, "{report}");
    let whole = Model::open(&all).unwrap();
    let cells = walls_of(&whole);
    let listed = report["each"].as_array().unwrap();
    assert_eq!(listed.len(), whole.frame().labels.len());
    let mut parted = 0;
    for (label, model) in whole.frame().labels.iter().zip(listed) {
        let opened = Model::open(model["output"].as_str().unwrap()).unwrap();
        verify(&opened).unwrap();
        assert_eq!(opened.frame().labels, std::slice::from_ref(label));
        let own = walls_of(&opened);
        parted += own.values().filter(|walls| walls.planes().len() > 1).count();
        assert_eq!(model["skin_voxels"].as_u64(), Some(own.len() as u64));
        for (place, walls) in &cells {
            let is_own = (0..8).any(|corner| walls.corner(corner) == label.number);
            let found = own.get(place);
            assert_eq!(found.is_some(), is_own, "{place:?}");
            for i in 0..if found.is_some() { 125 } else { 0 } {
                let u = [i % 5, i / 5 % 5, i / 25].map(|c| f64::from(c) / 2.0 - 0.999);
                let due = if walls.at(u) == label.number { label.number } else { 0 };
                assert_eq!(found.unwrap().at(u), due, "{place:?} {u:?} {walls:?}");
            }
        }
    }
    parted
}

/// Every point of every cell is in the model of its own label, and in no other.
#[test]
fn each_label_alone_has_its_part_of_every_cell() {
    let folder = tempfile::tempdir().unwrap();
    let mut parted = 0;
    for (seed, (dims, kinds, block)) in
        (1..).zip([([40_u32, 33, 37], 5, 7), ([36, 20, 30], 117, 1), ([1, 1, 1], 1, 1)])
    {
        let mut labels = map(dims, kinds, block, seed);
        labels[0] = 1;
        let mut object = Object::new(dims, infobyte::ScalarType::U16, [1.0, 0.5, 2.0]);
        object.bytes = labels.iter().flat_map(|label| label.to_le_bytes()).collect();
        let input = file(folder.path(), "random.nrrd", &nrrd(&object, "raw", false, ""));
        parted += hold_each(&input, &[]);
    }
    assert!(parted > 1000, "{parted}");
    if let Some(path) = real_data("labels/liver_spine_seg.nrrd") {
        hold_each(&path, &["--threads", "2"]);
    }
}

/// Two balls that touch, and a box in one of them: areas are true, a picture has the numbers of what it shows, and a bound
/// on walls is kept, stated and refused where there are none.
#[test]
fn balls_have_their_areas_and_numbers_and_walls_their_bound() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| text(&folder.path().join(name));
    let side = 64;
    let mut object = Object::new([side, side, side], infobyte::ScalarType::U16, [0.5, 0.5, 0.5]);
    let radius = |p: [u32; 3], middle: [f64; 3]| -> f64 {
        (0..3).map(|a| (f64::from(p[a]) - middle[a]).powi(2)).sum::<f64>().sqrt()
    };
    let label = |p: [u32; 3]| match p {
        _ if radius(p, [16.2, 31.7, 30.1]) < 14.0 => 3_u16,
        _ if radius(p, [44.6, 31.7, 30.1]) < 15.0 => 300,
        _ => 0,
    };
    let place = |i: u32| [i % side, i / side % side, i / side / side];
    object.bytes = (0..side.pow(3)).flat_map(|i| label(place(i)).to_le_bytes()).collect();
    let input = file(folder.path(), "balls.nrrd", &nrrd(&object, "raw", false, ""));
    assert_eq!(command::build(&[&input], Path::new(&at("m.oct")), &["--labels", "all"]).code, 0);
    let info = oct(&["info", &at("m.oct"), "--json"]).json();
    assert_eq!(info["not_measured"], "labels");
    assert!((info["bounding_box_mm"][1][0].as_f64().unwrap() - 29.8).abs() < 0.15, "{info}");
    for (label, radius) in info["labels"].as_array().unwrap().iter().zip([7.0_f64, 7.5]) {
        let due = 4.0 * std::f64::consts::PI * radius * radius;
        let [area, error] = ["area_mm2", "area_error_mm2"].map(|key| label[key].as_f64().unwrap());
        assert!((area - due).abs() < 0.02 * due && error < 0.15 * due, "{label} {due}");
        let due = due * radius / 3.0;
        let [volume, error] = ["volume_mm3", "volume_error_mm3"].map(|key| label[key].as_f64().unwrap());
        assert!((volume - due).abs() < error && error < 0.06 * due, "{label} {due}");
    }
    let picture = ["render", &at("m.oct"), "-o", &at("p.png"), "--view", "front", "--size", "96x64"];
    oct(&[&picture[..], &["--ids", &at("i.png"), "--legend", "--json"]].concat()).json();
    let ids = samples(Path::new(&at("i.png")));
    let shown: BTreeSet<u64> =
        ids.chunks(6).map(|id| id.iter().fold(0, |n, b| n << 8 | u64::from(*b))).collect();
    assert_eq!(shown, BTreeSet::from([0, 3, 300]));
    let bound = |smooth: &str| {
        let how = ["--labels", "all", "--force", "--smooth", smooth];
        command::build(&[&input], &folder.path().join("s.oct"), &how)
    };
    for (smooth, stated) in [("0.5", "label planes"), ("0.1", "label planes within 0.1 voxel")] {
        assert_eq!(bound(smooth).code, 0);
        assert_eq!(oct(&["info", &at("s.oct"), "--json"]).json()["gradient"], stated);
    }
    bound("0.7").refused(2, &["'0.7' is not a distance from 0 to 0.5"]);
}

/// SPEC I22: a cell that gives a corner another label, or says so of its labels, is found.
#[test]
fn i22_cells_between_labels() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.oct");
    let labels = map([40, 40, 40], 5, 6, 3);
    let dims = Dims::new(40, 40, 40).unwrap();
    let volume = Voxels::from_fn(dims, |[x, y, z]| labels[(x + 40 * (y + 40 * z)) as usize]);
    infobyte::build(&volume, &options(&LabelChoice::All, 64 << 20, 1), &path).unwrap();
    let file = std::fs::read(&path).unwrap();
    let frame = Frame::read(&file[..]).unwrap();
    let content = |kind| {
        let entry = frame.section(kind).unwrap();
        &file[entry.offset as usize..entry.end() as usize]
    };
    let refused = |kind: SectionKind, at: usize, value: u8| {
        assert_ne!(content(kind)[at], value);
        fault_of(&with_section(&file, kind, |bytes| bytes[at] = value))
    };
    let offsets = SectionKind::Voxels(Channel::Offset);
    let corners = SectionKind::Voxels(Channel::Corners);
    let own = content(offsets);
    let plane = own.iter().position(|offset| *offset != 0x80).unwrap();
    let walls = |fault: FormatError| assert!(fault.to_string().contains("walls do not agree"), "{fault}");
    // The other parity, and another label of a corner.
    walls(refused(offsets, plane, own[plane] ^ 1));
    walls(refused(corners, 0, 9));
    // An odd offset of a second plane, or bytes behind octants.
    let fault = refused(corners, 17, content(corners)[17] | 1);
    assert!(matches!(fault, FormatError::IllegalItem { channel: Channel::Corners, .. }), "{fault:?}");
    // Neither the encoding without labels nor labels without the encoding.
    let plain = forged(&file, |frame, _| frame.header.walls = false);
    assert!(Frame::read(&plain[..]).is_err());
}
