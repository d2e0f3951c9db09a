//! Thresholds that the program chooses: of labels, of padded slices, and else by Otsu's method.

use std::collections::BTreeSet;
use std::ops::Range;
use std::path::Path;

use infobyte::builder::Tolerance;
use infobyte::builder::{BuildNote, BuildReport, Silent, build_volume};
use infobyte::format::{SectionKind, Selection, SelectionKind, SurfaceKind};
use infobyte::jobs::measure::measure;
use infobyte::volume::{SourceError, VolumeInfo};
use infobyte::{BuildOptions, CleanOptions, Dims, Model, Threshold, VolumeSource, Voxels, clean_and_build};

use crate::common::models::skin_options;
use crate::common::random::Random;

const SIDE: u32 = 64;

fn dims() -> Dims {
    Dims::new(SIDE, SIDE, 24).unwrap()
}

fn chosen(volume: &dyn VolumeSource) -> Selection {
    report(volume).selection
}

fn report(volume: &dyn VolumeSource) -> BuildReport {
    let folder = tempfile::tempdir().unwrap();
    let options = BuildOptions { threshold: Threshold::Otsu, threads: 2, ..skin_options() };
    build_volume(volume, &options, &folder.path().join("m.oct"), &Silent).unwrap()
}

fn holds(selection: &Selection, value: f64) -> bool {
    (selection.lo..=selection.hi).contains(&value)
}

/// From the middle of a slice, as a part of the circle that it has room for.
fn away([x, y, _]: [u32; 3]) -> f64 {
    let [x, y] = [x, y].map(|c| (f64::from(c) + 0.5) / f64::from(SIDE) * 2.0 - 1.0);
    (x * x + y * y).sqrt()
}

/// Organs: blobs with a label each, by their distance to seeds.
fn label(p: [u32; 3], labels: &[u8]) -> u8 {
    let mut random = Random(5);
    for label in labels {
        let seed = [random.below(SIDE), random.below(SIDE), random.below(24)].map(f64::from);
        let r = 6.0 + 5.0 * random.unit();
        let away: f64 = (0..3).map(|a| (f64::from(p[a]) - seed[a]).powi(2)).sum();
        if away < r * r {
            return *label;
        }
    }
    0
}

#[test]
fn every_label_is_inside_and_a_note_says_so() {
    let many: Vec<u8> = (1..=40).map(|n| n * 3).collect();
    for labels in [&many[..], &[1, 2, 3, 4, 5], &[7, 200, 255]] {
        let volume = Voxels::from_fn(dims(), |p| label(p, labels));
        let selection = chosen(&volume);
        assert_eq!((selection.kind, selection.hi), (SelectionKind::Iso, f64::INFINITY), "{labels:?}");
        assert!(selection.lo > 0.0 && selection.lo <= f64::from(labels[0]), "{selection:?}");
        let report = report(&volume);
        assert!(matches!(report.notes[..], [BuildNote::Labels { count }] if count <= labels.len()));
        // As other types hold them.
        let wide = Voxels::from_fn(dims(), |p| i32::from(label(p, labels)));
        let float = Voxels::from_fn(dims(), |p| f32::from(label(p, labels)));
        assert!([chosen(&wide), chosen(&float)].iter().all(|other| other == &selection));
    }
    // A mask has one label: any threshold is right.
    let mask = Voxels::from_fn(dims(), |p| 255 * u8::from(label(p, &many) > 0));
    assert_eq!((chosen(&mask).kind, report(&mask).notes.len()), (SelectionKind::Otsu, 0));
}

/// Contacts and vessels two voxels wide are labels, however little of them is flat; shells one voxel thick may be greys,
/// which a note says.
#[test]
fn small_and_thin_labels_are_labels() {
    let contacts = |p: [u32; 3]| match p.map(|c| c % 8 < 2) {
        [true, true, true] => 1 + p[0] / 8 + p[1] / 8 + p[2] / 8,
        _ => 0,
    };
    let vessels = |p: [u32; 3]| match (p[0] % 10 < 2, p[1] % 10 < 2) {
        (true, true) => 1 + p[0] / 10 + 6 * (p[1] / 10),
        _ => 0,
    };
    for (map, most) in [(Voxels::from_fn(dims(), contacts), 17), (Voxels::from_fn(dims(), vessels), 43)] {
        let BuildReport { selection, notes, .. } = report(&map);
        assert_eq!((selection.kind, selection.lo), (SelectionKind::Iso, 1.0), "{most}");
        assert!(matches!(notes[..], [BuildNote::Labels { count }] if count <= most), "{most} {notes:?}");
    }
    let thin = [(20.0, 1), (19.0, 2), (18.0, 3), (17.0, 0)];
    let notes = report(&Voxels::from_fn(dims(), |p| shells(p, &thin, 0.0))).notes;
    assert!(
        matches!(notes[..], [BuildNote::Greys { count: 4 } | BuildNote::Labels { count: 3 }]),
        "{notes:?}"
    );
}

/// A mask has the same surface wherever it lies in its volume, whatever its numbers are, and thin parts stay.
#[test]
fn masks_keep_their_size_at_the_border_and_where_they_are_thin() {
    let measured = |volume: &dyn VolumeSource, threshold: Threshold| {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("m.oct");
        let options = BuildOptions { threshold, ..BuildOptions::default() };
        build_volume(volume, &options, &path, &Silent).unwrap();
        let model = Model::open(&path).unwrap();
        let found = measure(&model.view(), model.dims(), &model.affine(), false).unwrap();
        found.volume_mm3.unwrap().0
    };
    let side = Dims::new(24, 24, 24).unwrap();
    let box_at = |margin: u32, size: [u32; 3]| {
        move |p: [u32; 3]| (0..3).all(|a| (margin..margin + size[a]).contains(&p[a]))
    };
    let due = measured(&Voxels::from_fn(side, |p| u8::from(box_at(5, [14; 3])(p))), Threshold::Iso(0.5));
    assert!((due / 14.0_f64.powi(3) - 1.0).abs() < 0.02, "{due}");
    for margin in 1..=4 {
        let inside = box_at(margin, [14; 3]);
        for threshold in [Threshold::Otsu, Threshold::Iso(1.0), Threshold::Range(1.0, 1.0)] {
            let of = measured(&Voxels::from_fn(side, |p| u8::from(inside(p))), threshold);
            assert!((of - due).abs() < 1e-6, "{margin} {threshold:?}: {of}, {due}");
        }
        let float =
            measured(&Voxels::from_fn(side, |p| if inside(p) { 7.5_f32 } else { -2.0 }), Threshold::Otsu);
        let wide = measured(&Voxels::from_fn(side, |p| 255 * u16::from(inside(p))), Threshold::Otsu);
        assert!((float - due).abs() < 1e-6 && (wide - due).abs() < 1e-6, "{margin}: {float}, {wide}, {due}");
    }
    for (size, least) in [([12, 12, 1], 0.9), ([12, 12, 2], 0.85), ([12, 12, 3], 0.9)] {
        let of = measured(&Voxels::from_fn(side, |p| u8::from(box_at(6, size)(p))), Threshold::Otsu);
        let voxels = f64::from(size.iter().product::<u32>());
        assert!((least..1.02).contains(&(of / voxels)), "{size:?}: {of} of {voxels}");
    }
}

/// How far a voxel is from the middle, in voxels.
fn from_middle(p: [u32; 3]) -> f64 {
    let off = [0, 1, 2].map(|a| f64::from(p[a]) - [31.5, 31.5, 11.5][a]);
    (off[0] * off[0] + off[1] * off[1] + 4.0 * off[2] * off[2]).sqrt()
}

/// Noise of a voxel, -1 to 1.
fn noise(p: [u32; 3]) -> f64 {
    let seed = u64::from(p[0]) | u64::from(p[1]) << 16 | u64::from(p[2]) << 32;
    let mut random = Random(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1);
    (0..4).map(|_| 2.0 * random.unit() - 1.0).last().unwrap()
}

/// Labels that lie in each other, the outermost first, each within a radius that noise moves.
fn shells(p: [u32; 3], shells: &[(f64, u8)], rough: f64) -> u8 {
    let away = from_middle(p) + rough * noise(p);
    shells.iter().rev().find(|(radius, _)| away < *radius).map_or(0, |(_, label)| *label)
}

#[test]
fn labels_in_each_other_are_labels() {
    type Map<'a> = (&'a str, &'a [(f64, u8)], f64);
    let maps: [Map<'_>; 12] = [
        ("tumour", &[(21.0, 2), (14.0, 4), (8.0, 1)], 0.0),
        ("tumour, rough", &[(21.0, 2), (14.0, 4), (8.0, 1)], 1.0),
        ("tissue classes", &[(22.0, 1), (18.0, 2), (14.0, 3), (10.0, 4), (5.0, 5)], 0.0),
        ("tissue classes, rough", &[(22.0, 1), (18.0, 2), (14.0, 3), (10.0, 4), (5.0, 5)], 0.7),
        ("backwards", &[(22.0, 5), (18.0, 4), (14.0, 3), (10.0, 2), (5.0, 1)], 0.0),
        ("tooth and pulp", &[(20.0, 1), (8.0, 2)], 0.0),
        ("shell and core", &[(20.0, 1), (10.0, 10)], 0.0),
        ("gaps", &[(21.0, 3), (14.0, 17), (8.0, 40)], 0.0),
        ("even gaps", &[(21.0, 10), (14.0, 20), (8.0, 30)], 0.0),
        ("thin", &[(22.0, 1), (21.0, 2), (12.0, 3), (11.0, 4)], 0.0),
        (
            "seven of uneven widths",
            &[(31.0, 1), (28.0, 2), (20.0, 3), (18.0, 4), (12.0, 5), (9.0, 6), (3.0, 7)],
            0.0,
        ),
        ("thin, far apart", &[(22.0, 7), (21.0, 2), (12.0, 90), (11.0, 4)], 0.0),
    ];
    for (name, of, rough) in maps {
        let byte = Voxels::from_fn(dims(), |p| shells(p, of, rough));
        let short = Voxels::from_fn(dims(), |p| i16::from(shells(p, of, rough)));
        let single = Voxels::from_fn(dims(), |p| f32::from(shells(p, of, rough)));
        for volume in [&byte as &dyn VolumeSource, &short, &single] {
            let BuildReport { selection, notes, .. } = report(volume);
            let first = of.iter().map(|(_, label)| f64::from(*label)).fold(f64::INFINITY, f64::min);
            assert_eq!((selection.kind, selection.lo), (SelectionKind::Iso, first), "{name}");
            let is_all = |count: usize| count == of.len();
            assert!(matches!(notes[..], [BuildNote::Labels { count }] if is_all(count)), "{name} {notes:?}");
        }
    }
    // The volume ends within them.
    for (axis, side) in [32, 32, 12].into_iter().enumerate() {
        let cut = |mut p: [u32; 3]| {
            p[axis] += side;
            shells(p, maps[2].1, 0.0)
        };
        let BuildReport { selection, notes, .. } = report(&Voxels::from_fn(dims(), cut));
        assert_eq!((selection.kind, selection.lo), (SelectionKind::Iso, 1.0), "{axis}");
        assert!(matches!(notes[..], [BuildNote::Labels { count: 5 }]), "{axis} {notes:?}");
    }
    // Values that no map of ours has: a note says that they may be labels.
    let odd: [&dyn Fn([u32; 3]) -> f32; 2] =
        [&|p| f32::from(shells(p, maps[0].1, 0.0)) - 1.0, &|p| -f32::from(shells(p, maps[0].1, 0.0))];
    for (at, value) in odd.into_iter().enumerate() {
        let notes = report(&Voxels::from_fn(dims(), value)).notes;
        assert!(matches!(notes[..], [BuildNote::Greys { count: 4 }]), "{at} {notes:?}");
    }
}

/// What is outside whatever it is stands for 0: NaN, minus infinity, and values that fill what was not measured.
#[test]
fn labels_lie_in_zero_in_nan_and_in_fill_values() {
    for (name, of) in [
        ("one within the other", &[(20.0, 1), (8.0, 2)][..]),
        ("three", &[(20.0, 1), (14.0, 2), (8.0, 3)]),
        ("a core apart from its shell", &[(20.0, 1), (19.0, 0), (8.0, 7)]),
        ("a thick shell", &[(20.0, 1), (17.0, 0), (8.0, 100)]),
    ] {
        let labels: BTreeSet<u8> = of.iter().map(|(_, label)| *label).filter(|label| *label > 0).collect();
        for fill in [0.0, f32::NAN, f32::NEG_INFINITY, f32::MIN, f32::MAX, -1e30] {
            let value = |p| Some(f32::from(shells(p, of, 0.0))).filter(|v| *v > 0.0).unwrap_or(fill);
            let BuildReport { selection, notes, .. } = report(&Voxels::from_fn(dims(), value));
            assert_eq!(selection.lo, 1.0, "{name} {fill}");
            assert!(!holds(&selection, f64::from(fill)), "{name} {fill}: {selection:?}");
            let is_it =
                |note: &BuildNote| matches!(note, BuildNote::Labels { count } if *count == labels.len());
            assert!(notes.iter().any(is_it), "{name} {fill}: {notes:?}");
            assert_eq!(notes.contains(&BuildNote::NotNumbers), fill.is_nan(), "{name} {fill}");
        }
    }
}

/// One voxel of 10^6 is no half of a mixture, and neither is a fill value, wherever it is and on either side.
#[test]
fn hot_samples_and_fill_values_leave_the_threshold_as_it_is() {
    let plain = |p: [u32; 3]| head(p, 60.0);
    let want = chosen(&Voxels::from_fn(dims(), plain)).lo;
    for hot in [&[1e6][..], &[-1e9], &[1e6, 3e30, 1.1e6]] {
        let value = |p: [u32; 3]| {
            hot.get(p[0] as usize).filter(|_| p[1] + p[2] == 9).map_or_else(|| plain(p), |v| *v)
        };
        let hot_voxels = |p: [u32; 3]| if p[2] == 4 { value(p) } else { plain(p) };
        let BuildReport { selection, .. } = report(&Voxels::from_fn(dims(), hot_voxels));
        assert!((selection.lo - want).abs() < 60.0, "{hot:?}: {selection:?} {want}");
    }
    let filled: [&dyn Fn([u32; 3]) -> bool; 3] = [&|p| away(p) > 0.85, &|p| p[0] < 8, &|p| p[2] < 4];
    for is_filled in filled {
        for fill in [f64::from(i32::MIN), f64::from(i32::MAX), -1e7, 1e20, -3e38] {
            let value = |p| if is_filled(p) { fill } else { plain(p) };
            let double = Voxels::from_fn(dims(), value);
            #[expect(clippy::cast_possible_truncation, reason = "below 2^31")]
            let whole = Voxels::from_fn(dims(), |p| value(p) as i32);
            let volumes: [&dyn VolumeSource; 2] = [&double, &whole];
            for volume in volumes.into_iter().take(if fill.abs() < 3e9 { 2 } else { 1 }) {
                let BuildReport { selection, notes, .. } = report(volume);
                assert!(
                    (selection.lo - want).abs() < 60.0 && !holds(&selection, fill),
                    "{fill}: {selection:?}"
                );
                let is_it = |note: &BuildNote| matches!(note, BuildNote::Padding { value } if *value == fill);
                assert!(notes.iter().any(is_it), "{fill} {notes:?}");
            }
        }
    }
}

/// Greys in few steps, however smooth or noisy, stay greys; a note says so of those that are as flat as labels.
#[test]
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 255")]
fn pictures_in_few_steps_are_not_labels() {
    let wave = |p: [u32; 3]| {
        let [x, y, z] = p.map(f64::from);
        1.0 + (x / 6.0).sin() * (y / 7.0).cos() * (z / 5.0 + 1.0).sin()
    };
    let blobs = |p: [u32; 3]| {
        let mut random = Random(9);
        (0..14)
            .map(|_| {
                let [x, y, z] = [64, 64, 24].map(|side| f64::from(random.below(side)));
                let (size, peak) = (2.0 + 3.0 * random.unit(), 0.3 + 0.7 * random.unit());
                let away: f64 = [x, y, z].iter().zip(p).map(|(c, at)| (c - f64::from(at)).powi(2)).sum();
                peak * (-0.5 * away / size / size).exp()
            })
            .sum::<f64>()
            .min(0.999)
    };
    let scan =
        |p: [u32; 3], rough: f64| ((head(p, 0.0) + 1100.0 + rough * noise(p)) / 2200.0).clamp(0.0, 0.999);
    let steps = |part: f64, n: f64, step: u8| (part * n).clamp(0.0, n - 1.0) as u8 * step;
    type Picture<'a> = (&'a str, &'a dyn Fn([u32; 3]) -> u8);
    let are_rough = ["slightly noisy scan", "noisy scan", "noise", "noise of three"];
    let pictures: [Picture<'_>; 13] = [
        ("ramp", &|p| steps(f64::from(p[0]) / 64.0, 6.0, 1)),
        ("short ramp", &|p| steps(f64::from(p[0]) / 64.0, 4.0, 1)),
        ("slanted ramp", &|p| steps(p.iter().map(|c| f64::from(*c)).sum::<f64>() / 152.0, 6.0, 1)),
        ("from the middle", &|p| steps(1.0 - from_middle(p) / 52.0, 6.0, 1)),
        ("to the middle", &|p| steps(from_middle(p) / 52.0, 6.0, 1)),
        ("waves", &|p| steps(0.5 * wave(p), 6.0, 1)),
        ("waves of a display", &|p| steps(0.5 * wave(p), 8.0, 36)),
        ("scan", &|p| steps(scan(p, 0.0), 8.0, 1)),
        ("slightly noisy scan", &|p| steps(scan(p, 120.0), 8.0, 1)),
        ("noisy scan", &|p| steps(scan(p, 400.0), 8.0, 1)),
        ("noise", &|p| u8::from(noise(p) > 0.0)),
        ("noise of three", &|p| steps(0.5 + 0.5 * noise(p), 3.0, 1)),
        ("microscopy", &|p| steps(blobs(p), 4.0, 64)),
    ];
    // As wide regions as labels, but one after the other.
    let greys = |levels: f64, rough: f64| {
        move |p: [u32; 3]| (((head(p, rough) + 1100.0) / 2100.0).clamp(0.0, 0.999) * levels) as u8
    };
    for (levels, rough) in [(4.0, 0.0), (8.0, 0.0), (16.0, 0.0), (16.0, 100.0), (64.0, 30.0), (256.0, 5.0)] {
        let BuildReport { selection, notes, .. } = report(&Voxels::from_fn(dims(), greys(levels, rough)));
        assert_eq!(selection.kind, SelectionKind::Otsu, "{levels} {rough}");
        let are_noted = matches!(notes[..], [BuildNote::Greys { count: 4..=16 }]);
        assert!(are_noted == (rough == 0.0) && notes.len() <= 1, "{levels} {rough} {notes:?}");
    }
    for (name, grey) in pictures {
        let volume = Voxels::from_fn(dims(), grey);
        let short = Voxels::from_fn(dims(), |p| u16::from(grey(p)));
        for volume in [&volume as &dyn VolumeSource, &short] {
            let BuildReport { selection, notes, .. } = report(volume);
            let is_noted = matches!(notes[..], [BuildNote::Greys { count: 4..=8 }]);
            assert!(selection.kind == SelectionKind::Otsu && notes.len() < 2, "{name} {notes:?}");
            assert_eq!(is_noted, !are_rough.contains(&name), "{name} {notes:?}");
        }
    }
    // Greys that fall to 0 on all sides could be labels that lie in each other, which a note says.
    let ramps: [Picture<'_>; 5] = [
        ("ball", &|p| steps(1.0 - from_middle(p) / 31.0, 8.0, 1)),
        ("ball of a display", &|p| steps(1.0 - from_middle(p) / 31.0, 8.0, 20)),
        ("cylinder", &|p| steps(1.0 - away(p), 12.0, 1)),
        ("plateau", &|p| steps(1.6 - from_middle(p) / 19.0, 8.0, 1)),
        ("wedge", &|p| steps((f64::from(p[0]) - 8.0) / 48.0, 8.0, 1) * u8::from((8..56).contains(&p[0]))),
    ];
    for (name, grey) in ramps {
        let BuildReport { selection, notes, .. } = report(&Voxels::from_fn(dims(), grey));
        let is_noted = matches!(notes[..], [BuildNote::Greys { count: 8 | 12 }]);
        assert!(selection.kind == SelectionKind::Otsu && is_noted, "{name} {notes:?}");
    }
}

/// Between labels whose numbers are far apart there is no ridge: the model is that of the mask.
#[test]
fn the_surface_of_labels_is_that_of_their_mask() {
    let sections = |volume: &dyn VolumeSource, options: &BuildOptions| {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("m.oct");
        build_volume(volume, options, &path, &Silent).unwrap();
        sections_of(&path)
    };
    // Two halves with numbers far apart, and one within the other.
    let label = |p: [u32; 3]| match from_middle(p) {
        away if away < 8.0 => 9,
        away if away < 20.0 => {
            if p[0] < 32 {
                1
            } else {
                200
            }
        }
        _ => 0,
    };
    let map = Voxels::from_fn(dims(), label);
    for threshold in [
        Threshold::Otsu,
        Threshold::Iso(1.0),
        Threshold::Iso(5.0),
        Threshold::Range(1.0, 10.0),
        Threshold::Range(9.0, 9.0),
    ] {
        let range = match threshold {
            Threshold::Iso(lo) => (lo, 255.0),
            Threshold::Range(lo, hi) => (lo, hi),
            _ => (1.0, 255.0),
        };
        let mask = Voxels::from_fn(dims(), |p| u8::from((range.0..=range.1).contains(&f64::from(label(p)))));
        for (surface, error) in
            [(SurfaceKind::Cells, 0.0), (SurfaceKind::Cells, 0.2), (SurfaceKind::Skin, 0.0)]
        {
            let error = Some(Tolerance::Voxels(error));
            let options =
                BuildOptions { threshold, surface: Some(surface), error, ..BuildOptions::default() };
            let whole = BuildOptions { threshold: Threshold::Range(1.0, 1.0), ..options.clone() };
            assert_eq!(sections(&map, &options), sections(&mask, &whole), "{threshold:?} {surface:?}");
        }
    }
}

/// The sections of a model, except its text.
fn sections_of(path: &Path) -> Vec<(Option<SectionKind>, u32)> {
    let model = Model::open(path).unwrap();
    let all = model.sections().iter().filter(|entry| entry.kind != Some(SectionKind::Meta));
    all.map(|entry| (entry.kind, entry.content_crc)).collect()
}

#[test]
fn averages_of_labels_are_those_of_their_mask() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.oct");
    let maps: [&[(f64, u8)]; 2] = [&[(21.0, 1), (14.0, 200), (8.0, 3)], &[(20.0, 1), (8.0, 2)]];
    for map in maps {
        for factor in [2, 4] {
            let clean = CleanOptions { downsample: Some(factor), ..CleanOptions::default() };
            let built = |value: &dyn Fn([u32; 3]) -> u8, threshold| {
                let mut volume = Voxels::from_fn(dims(), value);
                let options = BuildOptions { threshold, ..BuildOptions::default() };
                let (report, _) = clean_and_build(&mut volume, &clean, &options, &path, &Silent).unwrap();
                (sections_of(&path), report)
            };
            let (found, report) = built(&|p| shells(p, map, 0.0), Threshold::Otsu);
            let (mask, _) = built(&|p| u8::from(shells(p, map, 0.0) > 0), Threshold::Iso(0.5));
            assert_eq!(found, mask, "{map:?} {factor}");
            assert!(matches!(report.notes[..], [BuildNote::Labels { count }] if count == map.len()));
            assert_eq!((report.selection.kind, report.selection.lo), (SelectionKind::Iso, 0.5));
        }
    }
}

#[test]
fn one_number_in_nan_is_a_mask() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.oct");
    let built = |value: &dyn Fn(bool) -> f32, threshold| {
        let volume = Voxels::from_fn(dims(), |p| value(from_middle(p) < 20.0));
        let options = BuildOptions { threshold, ..BuildOptions::default() };
        build_volume(&volume, &options, &path, &Silent).map(|report| (sections_of(&path), report.notes))
    };
    let (mask, _) = built(&|inside| f32::from(u8::from(inside)), Threshold::Otsu).unwrap();
    for number in [1.0, 255.0, -3.0] {
        let (found, notes) =
            built(&|inside| if inside { number } else { f32::NAN }, Threshold::Otsu).unwrap();
        assert!(found == mask && notes == [BuildNote::NotNumbers], "{number} {notes:?}");
    }
    // One number alone, or 0, is not a mask.
    assert!(built(&|_| 1.0, Threshold::Otsu).is_err());
    assert!(built(&|inside| if inside { 0.0 } else { f32::NAN }, Threshold::Otsu).is_err());
}

/// A head with a bright skull in noise, as air, tissue and bone.
#[expect(clippy::cast_possible_truncation, reason = "below 2^11")]
fn head(p: [u32; 3], noise: f64) -> f64 {
    let seed = u64::from(p[0]) | u64::from(p[1]) << 16 | u64::from(p[2]) << 32;
    let mut random = Random(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1);
    let wobble = (0..4).map(|_| random.unit() - 0.5).sum::<f64>() * noise;
    let smooth = |edge: f64| ((edge - away(p)) * 16.0).clamp(0.0, 1.0);
    let value = -1000.0 + 1040.0 * smooth(0.7) + 900.0 * (smooth(0.7) - smooth(0.6));
    ((value + wobble) as i32).into()
}

#[test]
fn padding_is_left_out() {
    #[expect(clippy::cast_possible_truncation, reason = "below 2^15")]
    let of = |padding: Option<i16>| {
        Voxels::from_fn(dims(), move |p| match padding {
            Some(padding) if away(p) > 1.0 => padding,
            _ => head(p, 60.0) as i16,
        })
    };
    let plain = of(None);
    let want = chosen(&plain).lo;
    assert!((-700.0..-300.0).contains(&want) && report(&plain).notes.is_empty(), "{want}");
    for padding in [-3024, -2048, -2000, -32768, 32767, 4095] {
        let volume = of(Some(padding));
        let lo = chosen(&volume).lo;
        assert!((lo - want).abs() < 60.0, "{padding}: {lo} {want}");
        let notes = report(&volume).notes;
        assert!(
            matches!(notes[..], [BuildNote::Padding { value }] if value == f64::from(padding)),
            "{notes:?}"
        );
        assert!(!holds(&chosen(&volume), f64::from(padding)), "{padding}");
    }
    // Wherever it is, where a CT cannot measure so little and has air besides.
    let elsewhere: [&dyn Fn([u32; 3]) -> bool; 3] =
        [&|p| away(p) > 0.85, &|p| p[0] < dims().nx() / 8, &|p| p[2] < dims().nz() / 6];
    for (at, is_padded) in elsewhere.into_iter().enumerate() {
        let volume = Voxels::from_fn(dims(), |p| if is_padded(p) { -2059.0 } else { head(p, 60.0) });
        let lo = chosen(&volume).lo;
        assert!((lo - want).abs() < 60.0, "{at}: {lo} {want}");
        assert!(matches!(report(&volume).notes[..], [BuildNote::Padding { value: -2059.0 }]), "{at}");
    }
    // What is as air does no harm, and a body that was cut out of its picture stays as it is.
    let cut = Voxels::from_fn(dims(), |p| if away(p) < 0.65 { head(p, 60.0) } else { -3024.0 });
    assert!(report(&of(Some(-1024))).notes.is_empty() && report(&cut).notes.is_empty());
}

/// A picture that a device has taken, in a few flat greys.
struct Taken(Voxels<u8>, &'static str);

impl VolumeSource for Taken {
    fn info(&self) -> &VolumeInfo {
        self.0.info()
    }

    fn read_rows(
        &self,
        z: u32,
        rows: Range<u32>,
        cols: Range<u32>,
        out: &mut [u8],
    ) -> Result<(), SourceError> {
        self.0.read_rows(z, rows, cols, out)
    }

    fn modality(&self) -> Option<&str> {
        Some(self.1)
    }
}

#[test]
fn pictures_of_a_device_are_not_taken_for_labels() {
    let labels: Vec<u8> = (1..=40).map(|n| n * 3).collect();
    for (modality, kind) in
        [("US", SelectionKind::Otsu), ("CT", SelectionKind::Otsu), ("SEG", SelectionKind::Iso)]
    {
        let volume = Taken(Voxels::from_fn(dims(), |p| label(p, &labels)), modality);
        assert_eq!(chosen(&volume).kind, kind, "{modality}");
    }
}
