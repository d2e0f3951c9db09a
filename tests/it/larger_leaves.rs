//! Models within a bound of their surface keep what they promise: larger leaves stand for their cells, bytes do not
//! depend on memory or threads, damage is refused, and what cannot be done to them is refused by name. Their rays are in
//! `traversal` and `light_leaks`. If this fails, such models have holes, differ between machines, or are silently wrong.
#![expect(clippy::cast_possible_truncation, reason = "numbers here are small by construction")]

use crate::prelude::*;
use infobyte::Mesh;
use infobyte::builder::{Tolerance, ViewedFrom};
use infobyte::load::{CellShape, Fault};

/// Voxels, and is a sample inside?
pub(crate) type Body = (&'static str, Voxels<u8>);

/// Cells of values of 128 and more.
fn options(error: f64, share_mib: u64, threads: usize) -> BuildOptions {
    BuildOptions {
        threshold: Threshold::Iso(128.0),
        surface: Some(SurfaceKind::Cells),
        error: Some(Tolerance::Voxels(error)),
        memory: MemoryCap::Share(share_mib << 20),
        threads,
        ..BuildOptions::default()
    }
}

/// Builds a model of cells.
pub(crate) fn built(path: &Path, voxels: &Voxels<u8>, error: f64, share_mib: u64, threads: usize) -> Model {
    infobyte::build(voxels, &options(error, share_mib, threads), path).unwrap();
    let model = Model::open(path).unwrap();
    verify(&model).unwrap();
    model
}

/// Values that fall by 40 a voxel from a distance outwards.
fn body(n: u32, name: &'static str, outside: impl Fn([f64; 3]) -> f64) -> Body {
    let dims = Dims::new(n, n, n).unwrap();
    let value = |p: [u32; 3]| {
        (128.0 - 40.0 * outside(p.map(|c| f64::from(c) - 0.5 * f64::from(n)))).clamp(0.0, 255.0)
    };
    (name, Voxels::from_fn(dims, |p| value(p) as u8))
}

fn length(p: &[f64]) -> f64 {
    p.iter().map(|c| c * c).sum::<f64>().sqrt()
}

pub(crate) fn bodies(n: u32) -> [Body; 4] {
    let (side, mut random) = (f64::from(n), Random(9));
    let rough: Vec<f64> = (0..4096).map(|_| random.unit() - 0.5).collect();
    let bump = move |p: [f64; 3]| {
        rough[p.iter().fold(0_usize, |h, c| (h.wrapping_mul(31) ^ (c.to_bits() >> 40) as usize) & 0xffff)
            % 4096]
    };
    [
        body(n, "ball", |p| length(&[p[0] - 0.3, p[1] + 0.2, p[2]]) - 0.37 * side),
        body(n, "torus", |p| length(&[length(&[p[0], p[1] + 0.4]) - 0.28 * side, p[2] - 0.1]) - 0.11 * side),
        body(n, "box", |p| {
            let turned = [0.8 * p[0] + 0.6 * p[1], 0.8 * p[1] - 0.6 * p[0], p[2] + 0.2 * p[0]];
            turned.into_iter().fold(f64::MIN, |m, c| m.max(c.abs() - 0.24 * side))
        }),
        body(n, "noise", move |p| length(&p) - 0.33 * side + 0.4 * bump(p)),
    ]
}

/// A box of the surface: its lowest cell, its edge, its number and what is in it.
type Leaf = ([u32; 3], u32, u64, CellShape);

/// All of a model, larger and single cells.
fn leaves(model: &Model) -> Vec<Leaf> {
    let view = model.view();
    let items = view.cells().unwrap();
    let (mut found, mut waiting) = (Vec::new(), vec![(BoxIndex::ROOT, [0_u32; 3], view.depth())]);
    while let Some((number, low, level)) = waiting.pop() {
        if level == 0 {
            let cell = number.voxel(view.node_count()).get();
            found.push((low, 1, number.get(), items.shape(cell)));
        } else if view.infobyte(number.node()) == 0 {
            let plane = CellShape::Plane(view.leaf_plane(number.node()));
            found.push((low, 1 << level, number.get(), plane));
        }
        for octant in Octant::ALL.into_iter().filter(|_| level > 0) {
            if let Some(child) = view.child(number.node(), octant) {
                let at = std::array::from_fn(|a| low[a] + (octant.high()[a] << (level - 1)));
                waiting.push((child, at, level - 1));
            }
        }
    }
    found
}

/// Corners of a leaf's box that are inside, and where the plane cuts the box's edges; of a cell, its box's corners.
fn inside_corners((low, edge, _, shape): &Leaf) -> Vec<[f64; 3]> {
    let corner = |c: usize| [0, 1, 2].map(|a| f64::from(low[a] + (c as u32 >> a & 1) * edge));
    let plane = match shape {
        CellShape::Plane(plane) if *edge > 1 => plane,
        _ => return (0..8).map(corner).collect(),
    };
    let in_front: [f64; 8] = std::array::from_fn(|c| {
        (0..3)
            .map(|a| f64::from(if c >> a & 1 == 1 { plane.normal[a] } else { -plane.normal[a] }))
            .sum::<f64>()
            - f64::from(plane.offset)
    });
    let mut found: Vec<_> = (0..8).filter(|c| in_front[*c] <= 0.0).map(corner).collect();
    for (c, a) in (0..8).flat_map(|c| (0..3).map(move |a| (c, a))).filter(|(c, a)| c >> a & 1 == 0) {
        let (from, to) = (in_front[c], in_front[c | 1 << a]);
        if (from <= 0.0) != (to <= 0.0) {
            let mut at = corner(c);
            at[a] += f64::from(*edge) * from / (from - to);
            found.push(at);
        }
    }
    found
}

#[test]
fn pictures_and_boxes_are_framed_by_planes_and_not_by_boxes_of_leaves() {
    let folder = tempfile::tempdir().unwrap();
    for (name, voxels) in &bodies(58) {
        let model = built(&folder.path().join("m"), voxels, 0.3, 64, 2);
        let view = model.view();
        let space = GridSpace::new(model.dims(), &model.affine()).unwrap();
        let corners: Vec<[f64; 3]> = leaves(&model).iter().flat_map(inside_corners).collect();
        let mut random = Random(4);
        for round in 0..30 {
            let mut direction = [0; 3].map(|_: i32| 2.0 * random.unit() - 1.0);
            if round < 6 {
                direction = [0.0; 3];
                direction[round % 3] = if round < 3 { 1.0 } else { -1.0 };
            }
            let along = |p: &[f64; 3]| {
                let at = model.affine().apply(p.map(|c| c - 0.5));
                (0..3).map(|a| direction[a] * at[a]).sum::<f64>()
            };
            let want = corners.iter().map(along).fold(f64::NEG_INFINITY, f64::max);
            let found = space.support(&view, direction);
            assert!((found - want).abs() < 1e-9, "{name} {direction:?}: {found} {want}");
        }
    }
}

#[test]
fn bytes_do_not_depend_on_memory_or_threads_and_a_bound_of_nothing_changes_none() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let (_, voxels) = &bodies(90)[3];
    let bytes = |error: f64, share_mib: u64, threads: usize| {
        built(&at("m"), voxels, error, share_mib, threads);
        std::fs::read(at("m")).unwrap()
    };
    let first = bytes(0.1, 64, 1);
    for (share_mib, threads) in [(4, 1), (64, 2), (4, 2), (200, 3)] {
        assert!(bytes(0.1, share_mib, threads) == first, "{share_mib} {threads}");
    }
    let options = BuildOptions {
        threshold: Threshold::Iso(128.0),
        surface: Some(SurfaceKind::Cells),
        ..BuildOptions::default()
    };
    infobyte::build(voxels, &options, at("fine")).unwrap();
    let fine = std::fs::read(at("fine")).unwrap();
    assert!(bytes(0.0, 64, 2) == fine);
    assert!(first.len() < fine.len());
    let shown = serde_json::to_value(info::read_info(&at("m")).unwrap().json()).unwrap();
    assert!(shown.get("larger_leaves").is_none(), "{shown}");
    built(&at("m"), voxels, 0.1, 64, 2);
    let shown = serde_json::to_value(info::read_info_measured(&at("m"), true).unwrap().json()).unwrap();
    let number = |key: &str| shown["larger_leaves"][key].as_f64().unwrap();
    let [bound, rms, p99, most] = ["bound", "rms", "p99", "most"].map(number);
    assert!(bound == 0.1 && rms > 0.001 && rms < p99 && p99 <= most && most <= 0.151, "{shown}");
    assert_eq!((&shown["format_version"], &shown["not_measured"]), (&"1.0".into(), &serde_json::Value::Null));
    let run = oct(&["info", &text(&at("m"))]);
    assert!(run.stdout.contains("larger leaves") && run.stdout.contains("within 0.1 mm"), "{}", run.stdout);
    if cfg!(unix) {
        let read = Command::new("python3").arg("scripts/read_oct.py").arg(at("m")).output().unwrap();
        assert!(read.status.success(), "{}", String::from_utf8_lossy(&read.stderr));
    }
}

/// I19, and what of I1, I4, I5, I7, I10 and I14 is about larger leaves.
#[test]
fn i19_larger_leaves_and_their_directory() {
    let folder = tempfile::tempdir().unwrap();
    let model = built(&folder.path().join("m"), &bodies(40)[0].1, 0.1, 64, 1);
    let whole = model.bytes().to_vec();
    let damaged = |kind, change: &dyn Fn(&mut [u8])| fault_of(&with_section(&whole, kind, change));
    let nodes = model.section_bytes(SectionKind::Nodes).unwrap();
    let first = nodes.iter().position(|b| *b == 0).unwrap();
    let found = damaged(SectionKind::LeafRank, &|bytes| bytes[0] = 1);
    assert_eq!(found, FormatError::LeafRank { block: 0, due: 0 });
    for (kind, leaf) in [(SectionKind::LeafNormals, 0), (SectionKind::LeafOffsets, 1)] {
        let found = damaged(kind, &|bytes| bytes[leaf as usize] = 0x80);
        assert_eq!(found, FormatError::IllegalLeaf { leaf });
    }
    // A node above that has no children, and a leaf that gets one.
    for (at, infobyte) in [(0, 0), (first, 1)] {
        let found = damaged(SectionKind::Nodes, &|bytes| bytes[at] = infobyte);
        assert!(matches!(found, FormatError::RankMismatch { .. }), "{found:?}");
    }
    let apart = fault_of(&forged(&whole, |frame, _| frame.header.leaves = false));
    assert!(apart.to_string().contains("number of nodes"), "{apart}");
    // Without cells the bit is unknown.
    let mut file = whole.clone();
    file[12] = 4;
    let crc = crc32c::crc32c(&file[..60]);
    file[60..64].copy_from_slice(&crc.to_le_bytes());
    let Err(Fault::Format(fault)) = Frame::read(&file[..]) else { panic!("an unknown encoding") };
    assert!(fault.to_string().contains("encoding 4 is unknown"), "{fault}");
}

#[test]
fn packed_files_come_back_byte_for_byte() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    for ((name, voxels), error) in bodies(48).into_iter().zip([0.1, 0.5, 0.1, 1.0]) {
        built(&at("m"), &voxels, error, 64, 1);
        pack::pack(&at("m"), &at("p")).unwrap();
        pack::unpack(&at("p"), &at("back")).unwrap();
        assert!(fs::read(at("back")).unwrap() == fs::read(at("m")).unwrap(), "{name}");
        assert!(fs::metadata(at("p")).unwrap().len() < fs::metadata(at("m")).unwrap().len(), "{name}");
        infobyte::jobs::verify::verify_file(&at("p")).unwrap();
    }
}

/// Edges of a mesh, each with the triangles that have it.
fn edges(mesh: &Mesh) -> HashMap<[u32; 2], u32> {
    let mut edges = HashMap::new();
    for face in &mesh.faces {
        for (a, b) in [(0, 1), (1, 2), (2, 0)] {
            let (a, b) = (face[a], face[b]);
            *edges.entry([a.min(b), a.max(b)]).or_insert(0) += 1;
        }
    }
    edges
}

/// Volume that triangles enclose.
fn enclosed(mesh: &Mesh) -> f64 {
    let corner = |at: u32| mesh.vertices[at as usize].map(f64::from);
    let six = |[a, b, c]: [[f64; 3]; 3]| {
        a[0] * (b[1] * c[2] - b[2] * c[1])
            + a[1] * (b[2] * c[0] - b[0] * c[2])
            + a[2] * (b[0] * c[1] - b[1] * c[0])
    };
    mesh.faces.iter().map(|face| six(face.map(corner))).sum::<f64>() / 6.0
}

#[test]
fn triangles_are_closed_and_lie_as_near_as_the_leaves_and_measures_agree_with_them() {
    let folder = tempfile::tempdir().unwrap();
    for (name, voxels) in &bodies(58) {
        built(&folder.path().join("f"), voxels, 0.0, 64, 1);
        let fine = infobyte::triangles(&Model::open(folder.path().join("f")).unwrap(), &Silent).unwrap();
        for error in [0.1, 0.5, 1.0] {
            let path = folder.path().join("m");
            let model = built(&path, voxels, error, 64, 1);
            let mesh = infobyte::triangles(&model, &Silent).unwrap();
            assert!(
                edges(&mesh).values().all(|count| *count == 2),
                "{name} {error}: every edge has two triangles"
            );
            // No farther from the fine mesh than the leaves, and what a cell's middle is off its plane.
            let most = model.metadata().error.unwrap().most;
            let mut places: HashMap<[i32; 3], Vec<[f32; 3]>> = HashMap::new();
            let key = |p: &[f32; 3]| p.map(|c| c.floor() as i32);
            for vertex in &fine.vertices {
                places.entry(key(vertex)).or_default().push(*vertex);
            }
            let nearest = |p: &[f32; 3]| {
                let at = key(p);
                let mut least = f32::INFINITY;
                for i in 0..125 {
                    let near = [at[0] + i % 5 - 2, at[1] + i / 5 % 5 - 2, at[2] + i / 25 - 2];
                    for q in places.get(&near).into_iter().flatten() {
                        least = least.min((0..3).map(|a| (p[a] - q[a]).powi(2)).sum::<f32>().sqrt());
                    }
                }
                f64::from(least)
            };
            let apart = mesh.vertices.iter().map(nearest).fold(0.0, f64::max);
            assert!(apart <= most + 1.0, "{name} {error}: {apart}");
            let (volume, due) = (enclosed(&mesh), enclosed(&fine));
            assert!(
                (volume - due).abs() < 0.01 * due + 0.3 * error * fine.faces.len() as f64 * 0.5,
                "{name} {error}: {volume} {due}"
            );
            let shown = serde_json::to_value(info::read_info_measured(&path, true).unwrap().json()).unwrap();
            let [found, bar] = ["volume_mm3", "volume_error_mm3"].map(|key| shown[key].as_f64().unwrap());
            assert!(
                (found - volume).abs() < bar.max(0.002 * volume) && bar < 0.1 * volume,
                "{name} {error}: {found} +- {bar}, mesh {volume}, fine {due}"
            );
        }
    }
}

#[test]
fn masks_hold_every_inside_sample_and_points_lie_on_planes() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| text(&folder.path().join(name));
    let (_, voxels) = &bodies(58)[1];
    let model = built(&folder.path().join("m.oct"), voxels, 0.3, 64, 1);
    let report = oct(&["export", &at("m.oct"), "-o", &at("m.nii"), "--json"]).json();
    let bytes = fs::read(at("m.nii")).unwrap();
    let mask = &bytes[bytes.len() - voxels.samples().len()..];
    let (mut inside, mut more) = (0, 0);
    for (sample, set) in voxels.samples().iter().zip(mask) {
        assert!(*sample < 128 || *set > 0, "an inside sample is lost");
        inside += u64::from(*sample >= 128);
        more += u64::from(*sample < 128 && *set > 0);
    }
    assert!(more * 50 < inside, "{more} of {inside} covered");
    assert!(report["apart_voxels"].as_f64().unwrap() <= 0.45, "{report}");
    let points = oct(&["export", &at("m.oct"), "-o", &at("m.ply"), "--as", "points", "--json"]).json();
    let boxes = model.header().voxels + leaves(&model).iter().filter(|leaf| leaf.1 > 1).count() as u64;
    assert!(points["vertices"].as_u64().unwrap() > boxes, "{points}");
}

#[test]
fn bodies_touch_as_the_cells_in_whose_place_leaves_are() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| text(&folder.path().join(name));
    let all = bodies(58);
    built(&folder.path().join("f.oct"), &all[0].1, 0.0, 64, 1);
    built(&folder.path().join("m.oct"), &all[0].1, 0.3, 64, 1);
    built(&folder.path().join("other.oct"), &all[2].1, 0.3, 64, 1);
    let count = |name: &str, by: f64| {
        let place = format!("1,0,0,{by},0,1,0,0,0,0,1,3.5");
        let found = oct(&["intersect", &at(name), &at("other.oct"), "--place", &place, "--json"]).json();
        found["touching_voxels"][0].as_f64().unwrap()
    };
    for (by, due) in [(0.0, true), (20.0, true), (33.0, true), (80.0, false)] {
        let (fine, joined) = (count("f.oct", by), count("m.oct", by));
        assert_eq!((fine > 0.0, joined > 0.0), (due, due), "{by}: {fine} {joined}");
        assert!((fine - joined).abs() <= 0.2 * fine + 12.0, "{by}: {fine} {joined}");
    }
}

#[test]
fn scenes_and_cuts_show_them_as_the_cells_in_whose_place_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| text(&folder.path().join(name));
    let (_, voxels) = &bodies(58)[1];
    built(&folder.path().join("m.oct"), voxels, 0.1, 64, 1);
    built(&folder.path().join("f.oct"), voxels, 0.0, 64, 1);
    let depths = |name: &str, scene: bool| {
        let (input, clip) = if scene {
            let scene =
                format!("[[model]]\nfile = \"{name}\"\n[[model]]\nfile = \"f.oct\"\nmove = [70, 0, 0]\n");
            fs::write(at("scene.toml"), scene).unwrap();
            (at("scene.toml"), &[][..])
        } else {
            (at(name), &["--clip", "x=20.."][..])
        };
        let (picture, depth) = (at("p.png"), at("d.png"));
        let args = [
            "render",
            &input,
            "-o",
            &picture,
            "--depth",
            &depth,
            "--size",
            "160x120",
            "--json",
            "--samples",
            "1",
        ];
        let report = oct(&[&args[..], clip].concat()).json();
        let near = report["depth_near_mm"].as_f64().unwrap();
        let far = report["depth_far_mm"].as_f64().unwrap();
        (report["hits"].as_u64().unwrap(), near, far)
    };
    for scene in [true, false] {
        let (hits, near, far) = depths("m.oct", scene);
        let (due, fine_near, fine_far) = depths("f.oct", scene);
        assert!(hits.abs_diff(due) * 50 <= due && due > 1000, "{scene}: {hits} {due}");
        assert!(
            (near - fine_near).abs() < 2.0 && (far - fine_far).abs() < 2.0,
            "{near} {fine_near} {far} {fine_far}"
        );
    }
}

#[test]
fn what_cannot_be_seen_is_left_out_leaf_by_leaf_and_nothing_else_changes() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    // A shell, whose inner wall is hidden from outside, and half of whose outer one from a point.
    let (_, voxels) = &body(70, "shell", |p| (length(&p) - 24.0).abs() - 4.0);
    let whole = built(&path("whole"), voxels, 0.2, 64, 2);
    let seen_from = |name: &str, from: ViewedFrom, share_mib, threads| {
        let options = BuildOptions { visible_from: vec![from], ..options(0.2, share_mib, threads) };
        let report = infobyte::build(voxels, &options, path(name)).unwrap();
        let model = Model::open(path(name)).unwrap();
        verify(&model).unwrap();
        (model, report.hidden.unwrap())
    };
    let all: HashMap<[u32; 3], (u32, CellShape)> =
        leaves(&whole).into_iter().map(|(low, edge, _, shape)| (low, (edge, shape))).collect();
    for (name, from, eye) in [
        ("outside", ViewedFrom::Outside, None),
        ("point", ViewedFrom::Point([-60.0, 20.0, 30.0]), Some([-59.5, 20.5, 30.5])),
    ] {
        let (model, hidden) = seen_from(name, from, 64, 2);
        let left = leaves(&model);
        assert!(hidden > 2000 && left.len() * 4 < all.len() * 3, "{name}: {hidden} {}", left.len());
        assert!(left.iter().filter(|leaf| leaf.1 > 1).count() > 100, "{name}");
        for (low, edge, _, shape) in &left {
            assert_eq!(all[low], (*edge, *shape), "{name}: {low:?}");
        }
        let (again, _) = seen_from("again", from, 6, 1);
        assert_eq!(again.bytes(), model.bytes(), "{name}");
        let (before, after) = (whole.view(), model.view());
        let (mut random, mut hits) = (Random(9), 0);
        for _ in 0..20_000 {
            let side = f64::from(1_u32 << model.depth());
            let goal: [f64; 3] = std::array::from_fn(|_| 71.0 * random.unit());
            // Beyond the volume.
            let far = || -> [f64; 3] {
                std::array::from_fn(|a| if a == 1 { -0.3 * side } else { 71.0 * random.unit() })
            };
            let origin = eye.unwrap_or_else(far);
            let direction = std::array::from_fn(|a| goal[a] - origin[a]);
            let Some(ray) = Ray::new(model.depth(), origin, direction, 0.0).ok().flatten() else { continue };
            let first = |view: &ModelView<'_>| {
                single::trace(Form::best(), view, &Cells::new(view.cells().unwrap()), &ray, 0).hit
            };
            let [want, got] = [first(&before), first(&after)];
            let place = |hit: Option<Hit>| hit.map(|hit| (hit.cell, hit.edge_log2, hit.t.to_bits()));
            assert_eq!(place(got), place(want), "{name}: {ray:?}");
            hits += u32::from(got.is_some());
        }
        assert!(hits > 5000, "{name}: {hits}");
    }
}

#[test]
fn the_command_checks_rays_against_planes_in_whole_numbers() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.oct");
    for (name, voxels) in &bodies(58) {
        let model = built(&path, voxels, 0.3, 64, 1);
        let run = oct(&["selfcheck", &text(&path), "--rays", "20000", "--json"]);
        let found: serde_json::Value = serde_json::from_str(&run.stdout).unwrap();
        assert_eq!(run.code, 0, "{name}: {found}");
        assert!(found["cell_hits"].as_u64().unwrap() > 4000 && found["hits"] == 0, "{name}: {found}");
        // A plane that is moved is noticed.
        let mut bytes = std::fs::read(&path).unwrap();
        let offsets = model.frame().section(SectionKind::LeafOffsets).unwrap();
        let range = usize::try_from(offsets.offset).unwrap()..usize::try_from(offsets.end()).unwrap();
        bytes[range].iter_mut().for_each(|offset| *offset = offset.wrapping_add(40) & 0x7f);
        let damaged = infobyte::load::Model::from_bytes(bytes).unwrap();
        let intact = Model::open(&path).unwrap();
        let mut random = infobyte::render::selfcheck::Random::new(3);
        let (view, other) = (intact.view(), damaged.view());
        let moved = Cells::new(other.cells().unwrap());
        let rays = (0..2000).filter_map(|_| random_ray(&mut random, intact.depth()));
        let differ = rays.filter(|ray| {
            let traced = single::trace(Form::best(), &other, &moved, ray, 0).hit;
            infobyte::render::reference::planes::first_box(&view, ray) != traced.map(|hit| hit.box_number)
        });
        assert!(differ.count() > 20, "{name}");
    }
}

#[test]
fn what_cannot_be_done_is_refused_with_a_sentence() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| text(&folder.path().join(name));
    built(&folder.path().join("m.oct"), &bodies(40)[0].1, 0.1, 64, 1);
    let (model, other) = (at("m.oct"), at("other"));
    for (args, said) in [
        (&["build", "synthetic:sphere@40", "-o", &other, "--force", "--error", "0.1"][..], "--surface cells"),
        (
            &[
                "build",
                "synthetic:sphere@40",
                "-o",
                &other,
                "--force",
                "--surface",
                "cells",
                "--error",
                "1.5",
            ],
            "up to 1 voxel",
        ),
        (
            &["build", "synthetic:sphere@40", "-o", &other, "--force", "--surface", "cells", "--error", "-1"],
            "is not a bound",
        ),
    ] {
        let run = oct(args);
        assert_eq!(run.code, 2, "{args:?}: {}", run.stderr);
        assert!(run.stderr.contains(said), "{args:?}: {}", run.stderr);
        assert!(!Path::new(&other).exists());
    }
    for args in [
        &["render", &model, "-o", &at("m.png"), "--size", "64x64"][..],
        &["strip", &model, "-o", &at("stripped.oct"), "--lod", "off"],
        &["verify", &at("stripped.oct")],
        &["info", &model, "--measure"],
    ] {
        let run = oct(args);
        assert_eq!(run.code, 0, "{args:?}: {}", run.stderr);
    }
}
