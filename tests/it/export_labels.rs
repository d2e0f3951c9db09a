//! Labels as triangles: each label has a closed surface of its own, neighbours share the very same wall, and every sample
//! is on its side of it. If this fails, organs overlap or have holes, and meshes for simulation cannot be made of them.

#![expect(clippy::cast_possible_truncation, reason = "small volumes")]

use crate::prelude::*;
use infobyte::builder::LabelChoice;
use infobyte::jobs::export::{ExportReport, export_each};
use infobyte::scene::LabelRule;

/// Labels of all samples, x fastest.
struct Map {
    dims: [u32; 3],
    labels: Vec<u16>,
}

impl Map {
    fn new(dims: [u32; 3], label: impl Fn([u32; 3]) -> u16) -> Self {
        let [nx, ny, nz] = dims;
        let all = (0..nx * ny * nz).map(|i| label([i % nx, i / nx % ny, i / nx / ny])).collect();
        Self { dims, labels: all }
    }

    /// One of `kinds` labels or none for each sample.
    fn random(dims: [u32; 3], kinds: u16, seed: u64) -> Self {
        let mut random = Random(seed);
        let count = dims.iter().product::<u32>();
        Self { dims, labels: (0..count).map(|_| random.below(kinds + 1)).collect() }
    }

    fn at(&self, p: [i64; 3]) -> u16 {
        let [nx, ny, nz] = self.dims.map(i64::from);
        let within = p.iter().zip([nx, ny, nz]).all(|(c, n)| (0..n).contains(c));
        if within { self.labels[(p[0] + nx * (p[1] + ny * p[2])) as usize] } else { 0 }
    }

    fn build(&self, path: &Path) {
        let [nx, ny, nz] = self.dims;
        let at = |p: [u32; 3]| self.at(p.map(i64::from));
        let volume = Voxels::from_fn(Dims::new(nx, ny, nz).unwrap(), at);
        let options = BuildOptions { labels: Some(LabelChoice::All), ..BuildOptions::default() };
        infobyte::build(&volume, &options, path).unwrap();
    }

    fn voxels(&self) -> BTreeMap<u16, u64> {
        let mut counts = BTreeMap::new();
        self.labels
            .iter()
            .filter(|label| **label != 0)
            .for_each(|label| *counts.entry(*label).or_default() += 1);
        counts
    }
}

/// Balls that touch, and shells with cavities: between two labels, within one, and filled with another.
fn bodies() -> Map {
    let within = |p: [u32; 3], middle: [f64; 3], radius: f64| {
        (0..3).map(|a| (f64::from(p[a]) - middle[a]).powi(2)).sum::<f64>() <= radius * radius
    };
    Map::new([48, 40, 36], |p| {
        let ball = |middle, radius| within(p, middle, radius);
        match () {
            () if ball([11.0, 12.0, 12.0], 3.0) => 0,
            () if ball([11.0, 12.0, 12.0], 10.2) => 1,
            () if ball([29.5, 13.0, 12.4], 4.2) => 7,
            () if ball([29.5, 13.0, 12.4], 8.8) => 2,
            () if ball([24.0, 29.0, 20.0], 1.5) => 0,
            () if ball([24.0, 29.0, 20.0], 6.0) => 300,
            () if ball([24.0, 29.0, 20.0], 9.5) => 2,
            // A wall of one voxel around nothing.
            () if ball([40.0, 30.0, 27.0], 4.0) => 0,
            () if ball([40.0, 30.0, 27.0], 5.3) => 9,
            () => 0,
        }
    })
}

/// Labels thinner than what smoothes them keep their volume, whatever the smoothing; a ball is as smooth as before.
#[test]
fn thin_labels_keep_their_volume() {
    let boxes: [([u32; 3], [u32; 3]); 5] = [
        ([5, 5, 5], [1, 1, 20]),
        ([12, 5, 5], [2, 2, 20]),
        ([20, 5, 5], [1, 20, 20]),
        ([28, 5, 5], [3, 3, 3]),
        ([28, 15, 5], [1, 1, 1]),
    ];
    let ball = |p: [u32; 3]| p.iter().map(|c| (f64::from(*c) - 30.3).powi(2)).sum::<f64>() < 64.0;
    let map = Map::new([40; 3], |p| {
        let holds =
            |(low, side): &([u32; 3], [u32; 3])| (0..3).all(|a| (low[a]..low[a] + side[a]).contains(&p[a]));
        let within = boxes.iter().position(holds).map_or(0, |at| at as u16 + 1);
        if within == 0 && ball(p) { 6 } else { within }
    });
    let folder = tempfile::tempdir().unwrap();
    let model = folder.path().join("m.oct");
    map.build(&model);
    for smooth in [None, Some(0.4), Some(0.2), Some(0.05), Some(0.0)] {
        let found = Surfaces::read(&exported(&model, "m.ply", smooth).0);
        found.assert_closed("thin");
        for (label, volume) in found.volumes() {
            let part = volume / map.voxels()[&label] as f64;
            let least = 0.95;
            assert!((least..1.001).contains(&part), "{label} {smooth:?}: {part}");
        }
    }
}

/// A line that is not along an axis keeps most of its volume, too.
#[test]
fn thin_oblique_labels_keep_their_volume() {
    let away = |p: [u32; 3], from: [f64; 3], way: [f64; 3]| {
        let q: [f64; 3] = std::array::from_fn(|a| f64::from(p[a]) - from[a]);
        let length = way.iter().map(|c| c * c).sum::<f64>().sqrt();
        let along = (0..3).map(|a| q[a] * way[a]).sum::<f64>() / length;
        let square = q.iter().map(|c| c * c).sum::<f64>() - along * along;
        if (0.0..36.0).contains(&along) { square.max(0.0).sqrt() } else { f64::INFINITY }
    };
    let lines = [([5.0; 3], [1.0, 0.3, 0.2], 0.87), ([5.0, 15.0, 5.0], [1.0, 1.0, 0.4], 1.2)];
    let map = Map::new([48; 3], |p| {
        lines
            .iter()
            .position(|(from, way, radius)| away(p, *from, *way) <= *radius)
            .map_or(0, |at| at as u16 + 1)
    });
    let folder = tempfile::tempdir().unwrap();
    let model = folder.path().join("m.oct");
    map.build(&model);
    for smooth in [None, Some(0.2), Some(0.0)] {
        for (label, volume) in Surfaces::read(&exported(&model, "m.ply", smooth).0).volumes() {
            let part = volume / map.voxels()[&label] as f64;
            assert!((0.9..1.1).contains(&part), "{label} {smooth:?}: {part}");
        }
    }
}

/// Parts are described one after the other: thousands of labels cost a GLB no more than a PLY but for what is kept of each.
#[test]
fn a_glb_of_many_labels_takes_little_more_memory_than_a_ply() {
    let folder = tempfile::tempdir().unwrap();
    let model = folder.path().join("m.oct");
    let map = Map::new([40; 3], |p| {
        let [x, y, z] = p.map(|c| c / 2);
        if (x + y + z) % 2 == 0 { ((z * 20 + y) * 20 + x + 2) as u16 / 2 } else { 0 }
    });
    map.build(&model);
    let peak = |name: &str| measured(|| exported(&model, name, None)).1.peak;
    let (ply, glb) = (peak("m.ply"), peak("m.glb"));
    let labels = map.voxels().len();
    assert!(labels == 4000 && glb < ply + 1024 * labels, "{labels}: {glb} and {ply}");
}

/// A PLY of labels.
struct Surfaces {
    corners: Vec<[f32; 3]>,
    /// With their labels.
    triangles: Vec<([u32; 3], u16)>,
}

impl Surfaces {
    fn read(path: &Path) -> Self {
        let bytes = fs::read(path).unwrap();
        let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
        let head = str::from_utf8(&bytes[..end]).unwrap();
        let count = |what: &str| {
            let line = head.lines().find_map(|line| line.strip_prefix(what)).unwrap();
            line.trim().parse::<usize>().unwrap()
        };
        assert!(head.contains("property uchar red") && head.contains("property ushort label"), "{head}");
        let vertex = if head.contains("float nx") { 27 } else { 15 };
        let (corners, triangles) = bytes[end..].split_at(vertex * count("element vertex "));
        let float = |b: &[u8]| f32::from_le_bytes(b.try_into().unwrap());
        let place = |v: &[u8]| [0, 4, 8].map(|at| float(&v[at..at + 4]));
        let triangle = |f: &[u8]| {
            let corners = [1, 5, 9].map(|at| u32::from_le_bytes(f[at..at + 4].try_into().unwrap()));
            (corners, u16::from_le_bytes(f[13..15].try_into().unwrap()))
        };
        let found = Self {
            corners: corners.chunks_exact(vertex).map(place).collect(),
            triangles: triangles.chunks_exact(15).map(triangle).collect(),
        };
        assert_eq!((triangles.len() % 15, found.triangles.len()), (0, count("element face ")));
        found
    }

    /// By places, as bits.
    fn places(&self, corners: [u32; 3]) -> [[u32; 3]; 3] {
        corners.map(|corner| self.corners[corner as usize].map(f32::to_bits))
    }

    /// Every edge of a label has one triangle on each side, by the numbers of its corners and by their places.
    fn assert_closed(&self, name: &str) {
        let (mut by_number, mut by_place) = (HashMap::new(), HashMap::new());
        for (corners, label) in &self.triangles {
            let places = self.places(*corners);
            for i in 0..3 {
                let next = (i + 1) % 3;
                *by_number.entry((*label, corners[i], corners[next])).or_insert(0) += 1;
                *by_place.entry((*label, places[i], places[next])).or_insert(0) += 1;
            }
        }
        for ((label, a, b), count) in &by_number {
            assert!(*count == 1 && by_number.contains_key(&(*label, *b, *a)), "{name}: label {label}");
        }
        for ((label, a, b), count) in &by_place {
            assert!(*count == 1 && by_place.contains_key(&(*label, *b, *a)), "{name}: label {label} {a:?}");
        }
    }

    /// Six times the volume of each label, in voxels of 1 mm.
    fn volumes(&self) -> BTreeMap<u16, f64> {
        let mut volumes = BTreeMap::new();
        for (corners, label) in &self.triangles {
            let [a, b, c] = corners.map(|corner| self.corners[corner as usize].map(f64::from));
            let cross = |i: usize, j: usize| b[i] * c[j] - b[j] * c[i];
            *volumes.entry(*label).or_insert(0.0) +=
                (a[0] * cross(1, 2) + a[1] * cross(2, 0) + a[2] * cross(0, 1)) / 6.0;
        }
        volumes
    }

    /// How often each label's surface is crossed on the way from a sample to the next along an axis: +1 where it is left,
    /// and -1 where it is entered. Lines pass the samples at a distance of 1/500, so that they meet no edge.
    fn crossings(&self, axis: usize) -> HashMap<(u16, [i64; 3]), i64> {
        let [u, v] = [(axis + 1) % 3, (axis + 2) % 3];
        let aside = [0.0013, 0.0017];
        let mut found = HashMap::new();
        for (corners, label) in &self.triangles {
            let p = corners.map(|corner| {
                let at = self.corners[corner as usize].map(f64::from);
                [at[u] - aside[0], at[v] - aside[1], at[axis]]
            });
            let range = |a: usize| {
                let low = p.iter().map(|p| p[a]).fold(f64::INFINITY, f64::min);
                let high = p.iter().map(|p| p[a]).fold(f64::NEG_INFINITY, f64::max);
                low.ceil() as i64..=high.floor() as i64
            };
            for (j, i) in range(1).flat_map(|j| range(0).map(move |i| (j, i))) {
                let side = |k: usize| {
                    let (a, b) = (p[k], p[(k + 1) % 3]);
                    (b[0] - a[0]) * (j as f64 - a[1]) - (b[1] - a[1]) * (i as f64 - a[0])
                };
                let sides = [side(0), side(1), side(2)];
                let sign = if sides.iter().all(|s| *s > 0.0) {
                    1
                } else if sides.iter().all(|s| *s < 0.0) {
                    -1
                } else {
                    continue;
                };
                let sum: f64 = sides.iter().sum();
                let along = (0..3).map(|k| sides[k] * p[(k + 2) % 3][2]).sum::<f64>() / sum;
                let mut at = [0; 3];
                (at[u], at[v], at[axis]) = (i, j, along.floor() as i64);
                *found.entry((*label, at)).or_insert(0) += sign;
            }
        }
        found.retain(|_, count| *count != 0);
        found
    }
}

fn exported(model: &Path, name: &str, smooth: Option<f64>) -> (PathBuf, ExportReport) {
    let path = model.with_file_name(name);
    let request = ExportRequest { smooth, ..ExportRequest::of(ExportForm::of(&path).unwrap()) };
    let report = export(model, &path, request, &Silent).unwrap();
    assert_eq!(report.closed, request.form.has_triangles().then_some(true));
    (path, report)
}

#[test]
fn parts_are_closed_share_their_walls_and_keep_every_sample_on_its_side() {
    let folder = tempfile::tempdir().unwrap();
    let model = folder.path().join("m.oct");
    let mut maps = vec![("bodies".to_owned(), bodies())];
    for (seed, kinds) in (5..).zip([1, 2, 3, 7, 300]) {
        maps.push((format!("random {kinds}"), Map::random([11, 12, 10], kinds, seed)));
    }
    let full = Map::random([9, 9, 9], 1, 3);
    maps.push(("two, no background".into(), Map::new([9; 3], |p| 1 + full.at(p.map(i64::from)))));
    maps.push(("one".into(), Map::new([1, 1, 1], |_| 65_535)));
    for (name, map) in &maps {
        map.build(&model);
        for smooth in [None, Some(0.2), Some(0.0)] {
            let (path, report) = exported(&model, "m.ply", smooth);
            let found = Surfaces::read(&path);
            let name = format!("{name} {smooth:?}");
            assert_eq!(report.unknown_voxels, 0, "{name}");
            found.assert_closed(&name);
            let numbers: Vec<u16> = map.voxels().into_keys().collect();
            assert_eq!(report.surfaces.iter().map(|part| part.number).collect::<Vec<_>>(), numbers, "{name}");
            for (part, (label, volume)) in report.surfaces.iter().zip(found.volumes()) {
                let triangles = found.triangles.iter().filter(|(_, of)| *of == label).count() as u64;
                assert_eq!((part.number, part.triangles), (label, triangles), "{name}");
                let voxels = map.voxels()[&label] as f64;
                // Slight knots keep pairs of polygons apart where labels touch along edges.
                let exact = if name.starts_with("bodies") { 1e-3 } else { 0.05 };
                assert!(
                    smooth != Some(0.0) || (volume / voxels - 1.0).abs() < exact,
                    "{name} {label} {volume}"
                );
            }
            let mut walls: HashMap<[[u32; 3]; 3], [u16; 2]> = HashMap::new();
            let mut shared = 0;
            for (corners, label) in &found.triangles {
                let mut places = found.places(*corners);
                let least = (0..3).min_by_key(|i| places[*i]).unwrap();
                places.rotate_left(least);
                assert!(!walls.contains_key(&places), "{name}: twice the same triangle");
                let [a, b, c] = places;
                shared += u64::from(walls.contains_key(&[a, c, b]));
                walls.insert(places, [*label, 0]);
            }
            let mut expected = 0;
            for axis in 0..3 {
                let mut wanted = HashMap::new();
                let [nx, ny, nz] = map.dims.map(i64::from);
                for p in (-1..nz).flat_map(|z| (-1..ny).flat_map(move |y| (-1..nx).map(move |x| [x, y, z]))) {
                    let mut next = p;
                    next[axis] += 1;
                    let (here, there) = (map.at(p), map.at(next));
                    if here != there {
                        expected += u64::from(here != 0 && there != 0);
                        wanted.insert((here, p), 1);
                        wanted.insert((there, p), -1);
                    }
                }
                wanted.retain(|(label, _), _| *label != 0);
                assert!(found.crossings(axis) == wanted, "{name}: axis {axis}");
            }
            assert!(shared >= 2 * expected, "{name}: {shared} of {expected}");
        }
    }
}

#[test]
fn smooth_walls_lie_on_the_balls_that_were_sampled() {
    let folder = tempfile::tempdir().unwrap();
    let model = folder.path().join("m.oct");
    let (middle, radius) = ([33.3, 32.8, 33.1], 26.0);
    let distance = |p: [f64; 3]| (0..3).map(|a| (p[a] - middle[a]).powi(2)).sum::<f64>().sqrt() - radius;
    // Two halves, so that there is an inner wall, too.
    let label = |p: [u32; 3]| if distance(p.map(f64::from)) > 0.0 { 0 } else { 1 + u16::from(p[0] > 33) };
    let map = Map::new([67; 3], label);
    map.build(&model);
    let found = Surfaces::read(&exported(&model, "m.ply", None).0);
    let (mut sum, mut count) = (0.0, 0.0);
    for corner in &found.corners {
        let p = corner.map(f64::from);
        let off = distance(p);
        // Not at the rim of the inner wall.
        if (p[0] - 33.5).abs() < 4.0 {
            continue;
        }
        sum += off * off;
        count += 1.0;
        assert!(off.abs() < 0.6, "{p:?} {off}");
    }
    let rms = f64::sqrt(sum / count);
    assert!(rms < 0.095, "{rms}");
    let volumes = found.volumes();
    let ball = 4.0 / 3.0 * std::f64::consts::PI * f64::powi(radius, 3);
    assert!(((volumes[&1] + volumes[&2]) / ball - 1.0).abs() < 0.0045, "{volumes:?}");
}

#[test]
fn every_format_has_a_part_a_label_with_its_name_and_colour() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| text(&folder.path().join(name));
    let map = bodies();
    let mut object = Object::new(map.dims, ScalarType::U16, [1.0; 3]);
    object.bytes = map.labels.iter().flat_map(|label| label.to_le_bytes()).collect();
    let input = file(folder.path(), "map.nrrd", &nrrd(&object, "raw", false, ""));
    let names = file(
        folder.path(),
        "names.tsv",
        b"index\tname\tcolor\n1\tliver\t#ff0080\n2\tleft <rib> & more\t#102030\n7\tLiver\tn/a\n",
    );
    let model = folder.path().join("m.oct");
    assert_eq!(command::build(&[&input], &model, &["--labels", "all", "--names", &text(&names)]).code, 0);

    let glb = exported(&model, "m.glb", None).0;
    let bytes = fs::read(&glb).unwrap();
    let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    let json: serde_json::Value = serde_json::from_slice(&bytes[20..20 + length]).unwrap();
    let named: Vec<_> = json["nodes"].as_array().unwrap().iter().filter_map(|n| n["name"].as_str()).collect();
    assert_eq!(named, ["liver", "left <rib> & more", "Liver", "label 9", "label 300"]);
    assert_eq!(json["nodes"][5]["children"], serde_json::json!([0, 1, 2, 3, 4]));
    assert_eq!(json["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"][0], 1.0);
    assert_eq!(json["buffers"][0]["byteLength"].as_u64(), Some((bytes.len() - 28 - length) as u64));

    let obj = fs::read_to_string(exported(&model, "m.obj", None).0).unwrap();
    let objects: Vec<_> = obj.lines().filter(|line| line.starts_with("o ")).collect();
    assert_eq!(objects, ["o liver", "o left_<rib>_&_more", "o Liver", "o label_9", "o label_300"]);
    assert!(obj.lines().any(|line| line.starts_with("v ") && line.ends_with(" 1.0000 0.0000 0.5020")));

    // What the program's own reader makes of them is the solid of all labels.
    let [x, y, z] = map.dims;
    let size = format!("{x}x{y}x{z}");
    let nodes = |input: &str, more: &[&str]| {
        let out = at("again.oct");
        let run = oct(&[&["build", input, "-o", &out, "--json", "--surface", "skin"], more].concat());
        assert_eq!(run.code, 0, "{}{}", run.stdout, run.stderr);
        Model::open(&out).unwrap().section_bytes(SectionKind::Nodes).unwrap().to_vec()
    };
    let grid = ["--voxel", "1", "--origin", "-0.5,-0.5,-0.5", "--dims", &size];
    let of = |range: &str| nodes(&text(&input), &["--range", range]);
    exported(&model, "m.3mf", None);
    assert!(nodes(&at("m.3mf"), &grid) == of("1..300"));
    let request = ExportRequest::of(ExportForm::Stl);
    let report = export_each(&model, &folder.path().join("each"), request, &Silent).unwrap();
    let files: Vec<_> = report.surfaces.iter().map(|part| part.output.clone().unwrap()).collect();
    let expected = ["liver", "left__rib____more", "Liver_7", "label_9", "label_300"];
    assert_eq!(files, expected.map(|name| at(&format!("each/{name}.stl"))));
    for (number, path) in [1, 2, 7, 9, 300].iter().zip(&files) {
        assert!(nodes(path, &grid) == of(&format!("{number}..{number}")), "{number}");
    }
}

#[test]
fn a_mask_of_labels_is_the_map_that_was_built() {
    let folder = tempfile::tempdir().unwrap();
    let model = folder.path().join("m.oct");
    let mut maps = vec![bodies(), Map::random([19, 7, 12], 5, 1), Map::random([8; 3], 300, 2)];
    maps.push(Map::new([40, 3, 21], |p| 1 + (p[0] / 7 + p[2] / 5) as u16 % 4));
    maps.push(Map::new([1, 1, 1], |_| 65_535));
    // Runs of one label between cells, and labels that touch along edges and corners alone.
    maps.push(Map::new(
        [30, 30, 30],
        |p| if p.map(|c| c / 10 % 2).iter().sum::<u32>() % 2 == 0 { 9 } else { 0 },
    ));
    if let Some(path) = real_data("labels/liver_spine_seg.nrrd") {
        let (dims, labels) = crate::label_maps::samples(&path);
        maps.push(Map { dims, labels });
    }
    for map in &maps {
        map.build(&model);
        let path = folder.path().join("m.nii");
        let request = ExportRequest::of(ExportForm::Nifti);
        let report = export(&model, &path, request, &Silent).unwrap();
        let bytes = fs::read(path).unwrap();
        assert_eq!((bytes[70], bytes[71], bytes[72]), (0, 2, 16));
        let labels: Vec<u16> =
            bytes[352..].chunks_exact(2).map(|b| u16::from_le_bytes([b[0], b[1]])).collect();
        assert_eq!(report.inside_voxels, labels.iter().filter(|label| **label != 0).count() as u64);
        assert_eq!(report.unknown_voxels, 0);
        assert_eq!(labels.len(), map.labels.len());
        let differ = labels.iter().zip(&map.labels).filter(|(found, due)| found != due).count();
        assert_eq!(differ, 0, "of {} voxels", labels.len());
    }
    // What the program writes it reads again, and builds the same of it.
    bodies().build(&model);
    exported(&model, "m.nrrd", None);
    let again = folder.path().join("again.oct");
    let input = folder.path().join("m.nrrd");
    assert_eq!(command::build(&[&input], &again, &["--labels", "all"]).code, 0);
    let sections = |path: &Path| {
        let model = Model::open(path).unwrap();
        [SectionKind::Nodes, SectionKind::Voxels(Channel::Normal), SectionKind::Voxels(Channel::Label)]
            .map(|kind| model.section_bytes(kind).unwrap().to_vec())
    };
    assert!(sections(&model) == sections(&again));
}

/// Several labels share a number of triangles, or keep within a distance: each is closed, and as large as before.
#[test]
fn labels_share_a_number_of_triangles_and_are_closed() {
    let folder = tempfile::tempdir().unwrap();
    let model = folder.path().join("m.oct");
    bodies().build(&model);
    let (path, fine) = exported(&model, "fine.ply", None);
    let whole = Surfaces::read(&path).volumes();
    for (wanted, error, [least, most]) in [
        (Some(2000), None, [1900, 2000]),
        (Some(6000), Some(0.3), [5000, 7000]),
        (None, Some(0.3), [1000, fine.triangles / 2]),
    ] {
        let path = folder.path().join("few.ply");
        let error = error.map(|voxels: f64| voxels.to_string().parse().unwrap());
        let request = ExportRequest { triangles: wanted, error, ..ExportRequest::of(ExportForm::Ply) };
        let few = export(&model, &path, request, &Silent).unwrap();
        let figures = (few.closed, few.fine_triangles, few.parts_gone);
        assert_eq!(figures, (Some(true), Some(fine.triangles), Some(0)));
        assert!((least..=most).contains(&few.triangles), "{few:?}");
        assert!(few.distance_mm.unwrap() <= error.map_or(1.0, |_| 0.3), "{few:?}");
        assert!(few.warnings.iter().any(|note| note.contains("each label was reduced by itself")), "{few:?}");
        let found = Surfaces::read(&path);
        found.assert_closed("few");
        let volumes = found.volumes();
        assert_eq!(volumes.len(), 5);
        for (label, volume) in volumes {
            let part = volume / whole[&label];
            assert!((part - 1.0).abs() < 0.1, "{label}: {part}");
        }
    }
    // Fewer than 4 for each label; as many as there are.
    let reduced = |triangles: u64| {
        let path = folder.path().join("few.ply");
        let request = ExportRequest { triangles: Some(triangles), ..ExportRequest::of(ExportForm::Ply) };
        let few = export(&model, &path, request, &Silent).unwrap();
        let found = Surfaces::read(&path);
        found.assert_closed("few");
        assert_eq!(found.volumes().len(), 5);
        few
    };
    let few = reduced(3);
    assert!((20..60).contains(&few.triangles), "{few:?}");
    assert!(few.warnings.iter().any(|note| note.contains("each label keeps 4 at least")), "{few:?}");
    let all = reduced(fine.triangles);
    assert_eq!((all.triangles, all.distance_mm), (fine.triangles, Some(0.0)));
    assert!(all.warnings.iter().any(|note| note.contains("none was left out")), "{all:?}");
}

/// Labels that are chosen have the triangles that they have among all, whatever their neighbours; a single one has fewer of
/// them where that is asked for.
#[test]
fn chosen_labels_are_as_among_all() {
    let folder = tempfile::tempdir().unwrap();
    let model = folder.path().join("m.oct");
    let map = bodies();
    map.build(&model);
    let rules = |texts: &[&str]| -> Vec<LabelRule> {
        let rule = |(at, text): (usize, &&str)| LabelRule {
            labels: text.parse().unwrap(),
            opacity: if at == 0 { 0.0 } else { 1.0 },
        };
        texts.iter().enumerate().map(rule).collect()
    };
    let written = |name: &str, labels: &[LabelRule], triangles: Option<u64>| {
        let path = folder.path().join(name);
        let request =
            ExportRequest { labels, triangles, ..ExportRequest::of(ExportForm::of(&path).unwrap()) };
        (export(&model, &path, request, &Silent).unwrap(), path)
    };
    let some = rules(&["all", "2", "7"]);
    let all = Surfaces::read(&exported(&model, "m.ply", None).0);
    let found = Surfaces::read(&written("some.ply", &some, None).1);
    let triangles = |of: &Surfaces| -> Vec<_> {
        let chosen = of.triangles.iter().filter(|(_, label)| [2, 7].contains(label));
        chosen.map(|(corners, label)| (of.places(*corners), *label)).collect()
    };
    assert!(triangles(&found) == triangles(&all) && found.triangles.len() < all.triangles.len());
    let one = rules(&["all", "300"]);
    let fine = written("one.ply", &one, None).0;
    for form in ["ply", "stl", "obj", "glb", "3mf"] {
        let (report, _) = written(&format!("some.{form}"), &some, None);
        let numbers: Vec<u16> = report.surfaces.iter().map(|part| part.number).collect();
        assert_eq!((numbers, report.closed), (vec![2, 7], Some(true)), "{form}");
        let (few, path) = written(&format!("one.{form}"), &one, Some(200));
        assert_eq!((few.closed, few.fine_triangles), (Some(true), Some(fine.triangles)), "{form}");
        assert!((150..=200).contains(&few.triangles) && few.distance_mm.unwrap() < 1.0, "{form}: {few:?}");
        assert_eq!((few.surfaces[0].number, few.surfaces[0].triangles), (300, few.triangles), "{form}");
        if form == "ply" {
            let found = Surfaces::read(&path);
            found.assert_closed("few");
            let volume = found.volumes()[&300] / map.voxels()[&300] as f64;
            assert!((volume - 1.0).abs() < 0.1, "{volume}");
        }
    }
    let labels = fs::read(written("some.nii", &some, None).1).unwrap();
    for (stored, label) in labels[352..].chunks_exact(2).zip(&map.labels) {
        let due = if [2, 7].contains(label) { *label } else { 0 };
        assert_eq!(u16::from_le_bytes([stored[0], stored[1]]), due);
    }
    // A page holds all labels, and shows these first, from the front.
    let page = fs::read_to_string(written("some.html", &some, None).1).unwrap();
    let head = page.split("id=\"head\">").nth(1).and_then(|rest| rest.split("</script>").next()).unwrap();
    let head: serde_json::Value = serde_json::from_str(head).unwrap();
    let start: Vec<_> = head["start"].as_str().unwrap().split('&').collect();
    let hidden: Vec<u64> =
        start[2].strip_prefix("x=").unwrap().split(',').map(|n| n.parse().unwrap()).collect();
    let numbers = head["labels"].as_array().unwrap().iter().map(|label| label["number"].as_u64().unwrap());
    assert!(numbers.eq(map.voxels().keys().map(|number| u64::from(*number))), "{head}");
    assert!(
        map.voxels().keys().map(|n| u64::from(*n)).filter(|n| ![2, 7].contains(n)).eq(hidden),
        "{start:?}"
    );
    let numbers = |text: &str| -> Vec<f64> { text[2..].split(',').map(|n| n.parse().unwrap()).collect() };
    let (low, high) = found.triangles.iter().flat_map(|(corners, _)| found.places(*corners)).fold(
        ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]),
        |(low, high), at| {
            let at = at.map(|bits| f64::from(f32::from_bits(bits)));
            (std::array::from_fn(|a| at[a].min(low[a])), std::array::from_fn(|a| at[a].max(high[a])))
        },
    );
    let (middle, half) = (numbers(start[0]), numbers(start[1])[0]);
    assert!((0..3).all(|a| (middle[a] - f64::midpoint(low[a], high[a])).abs() < 1.0), "{start:?}");
    let reach = (high[0] - low[0]).max(high[2] - low[2]) / 2.0;
    assert!((1.0..1.3).contains(&(half / reach)), "{half} {reach}");
    let m = text(&model);
    for (flags, told) in [
        (&["-o", "x.stl", "--only", "5"][..], "has no label 5"),
        (&["-o", "x.stl", "--only", "2", "--hide", "1..9"], "no label is left"),
        (&["-o", "x.html", "--only", "5"], "has no label 5"),
        (&["-o", "x.html", "--as", "linked", "--only", "2"], "holds all labels"),
        (&["--each", "x", "--only", "5"], "has no label 5"),
    ] {
        oct(&[&["export", &m][..], flags].concat()).refused(2, &[told]);
    }
    assert!(!Path::new("x.stl").exists() && !Path::new("x").exists());
    let each = text(&folder.path().join("each"));
    let run = oct(&["export", &m, "--each", &each, "--hide", "2", "--only", "2,9", "--triangles", "40"]);
    assert!(run.stdout.contains("1 label, ") && run.stdout.contains("fine triangles"), "{}", run.stderr);
    assert_eq!(fs::read_dir(&each).unwrap().count(), 1);
}

#[test]
fn a_part_is_asked_for_of_labels_only_and_distances_make_sense() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| text(&folder.path().join(name));
    bodies().build(&folder.path().join("m.oct"));
    let plain =
        Voxels::from_fn(Dims::new(9, 9, 9).unwrap(), |p| u8::from(p.iter().all(|c| (2..6).contains(c))));
    let options = BuildOptions { threshold: Threshold::Iso(0.5), ..skin_options() };
    infobyte::build(&plain, &options, folder.path().join("p.oct")).unwrap();
    let (m, p) = (at("m.oct"), at("p.oct"));
    oct(&["export", &p, "--each", &at("each")]).refused(2, &["no labels"]);
    oct(&["export", &p, "-o", &at("p.stl"), "--only", "1"]).refused(2, &["no labels to choose from"]);
    oct(&["export", &p, "-o", &at("p.stl"), "--smooth", "0"]).refused(2, &["no labels"]);
    oct(&["export", &m, "-o", &at("m.stl"), "--smooth", "0.6"]).refused(2, &["from 0 to 0.5"]);
    oct(&["export", &m, "--each", &at("each"), "--as", "nrrd"]).refused(2, &["--each is for triangles"]);
    oct(&["export", &m]).refused(2, &["--output"]);
    let nan = ExportRequest { smooth: Some(f64::NAN), ..ExportRequest::of(ExportForm::Stl) };
    let refused = export(Path::new(&m), Path::new(&at("m.stl")), nan, &Silent).unwrap_err();
    assert!(refused.to_string().contains("0 to half a voxel"), "{refused}");
    // What is kept in part has no inside, of labels neither.
    let raw = at("map.raw");
    let solid = |i: u32| u8::from([i % 24, i / 24 % 24, i / 576].iter().all(|c| (4..20).contains(c)));
    fs::write(&raw, (0..24 * 24 * 24).map(solid).collect::<Vec<_>>()).unwrap();
    let (part, args) = (at("part.oct"), ["--dims", "24x24x24", "--dtype", "u8", "--labels", "all"]);
    let built = oct(&[&["build", &raw, "-o", &part, "--visible-from", "0,-90,0"][..], &args].concat());
    assert_eq!(built.code, 0, "{}", built.stderr);
    oct(&["export", &part, "-o", &at("m.stl")]).refused(2, &["keeps only what can be seen"]);
    oct(&["export", &part, "--each", &at("each")]).refused(2, &["keeps only what can be seen"]);
    assert!(!folder.path().join("each").exists() && !folder.path().join("m.stl").exists());
    let run = oct(&["export", &m, "--each", &at("each"), "--as", "obj"]);
    let told = ["5 labels, ", " corners, closed, "].iter().all(|part| run.stdout.contains(part));
    assert!(run.code == 0 && told, "{}{}", run.stdout, run.stderr);
    assert_eq!(fs::read_dir(folder.path().join("each")).unwrap().count(), 5);
}
