//! Meshes become models voxel by voxel as defined: a voxel is inside if its centre, moved by (-e, e^2, e^3), is.
//! Every hard case here is compared with a slow count in wide integers that shares no code with the program. If
//! this fails, parts have stray voxels, bands or holes, as those of most voxelisers do.

use crate::common::models::share as options;
use crate::prelude::*;
mod thin;

use crate::common::models::MeshReport;
use infobyte::mesh::{Boundary, Fill, MeshFacts};
use meshes::{STEPS, skin};

fn exact(dims: [u32; 3]) -> MeshOptions {
    on_grid(exact_grid(dims))
}

/// A folder with the files of a test.
struct Place(tempfile::TempDir);

impl Place {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn put(&self, name: &str, bytes: &[u8]) -> PathBuf {
        put(self.0.path(), name, bytes)
    }

    fn build(
        &self,
        inputs: &[PathBuf],
        mesh: &MeshOptions,
        build: &BuildOptions,
    ) -> Result<MeshReport, BuildError> {
        build_mesh(inputs, mesh, build, &self.path("a.oct"), &Silent)
    }

    fn model(&self) -> Model {
        let model = Model::open(self.path("a.oct")).unwrap();
        verify(&model).unwrap();
        model
    }

    fn bytes(&self) -> Vec<u8> {
        std::fs::read(self.path("a.oct")).unwrap()
    }
}

fn skin_of(model: &Model) -> BTreeSet<[u32; 3]> {
    finest(model).into_iter().map(|(at, _)| at).collect()
}

/// Builds a body and compares its skin, voxel by voxel, with that of another one (or itself) by the definition.
fn check_as(body: &Body, truth: &Body, dims: [u32; 3], rule: Fill) -> MeshFacts {
    let place = Place::new();
    let file = place.put("body.stl", &body.stl());
    let facts = place.build(&[file], &exact(dims), &options(16, 2)).unwrap().facts;
    assert_eq!(facts.fill, rule);
    let [nx, ny, nz] = dims.map(i64::from);
    let sums = truth.winding([nx, ny, nz]);
    let inside = |[x, y, z]: [i64; 3]| {
        let within = (0..nx).contains(&x) && (0..ny).contains(&y) && (0..nz).contains(&z);
        within && {
            let sum = sums[usize::try_from((z * ny + y) * nx + x).unwrap()];
            if rule == Fill::Winding { sum != 0 } else { sum % 2 != 0 }
        }
    };
    let want = skin(&inside, [nx, ny, nz]);
    let got = skin_of(&place.model());
    let wrong = got.symmetric_difference(&want).count();
    assert!(wrong == 0 && !want.is_empty(), "{wrong} of {} skin voxels are wrong", want.len());
    facts
}

fn check(body: &Body, dims: [u32; 3], rule: Fill) -> MeshFacts {
    check_as(body, body, dims, rule)
}

fn ball() -> Body {
    Body::sphere([35.137, 34.211, 36.173], 30.0, 3)
}

const GRID: [u32; 3] = [70, 70, 70];

#[test]
fn a_sphere_at_no_special_place() {
    let facts = check(&ball(), GRID, Fill::Winding);
    assert_eq!((facts.triangles, facts.flat, facts.boundary), (512, 0, Boundary::Oriented));
}

#[test]
fn hard_places_and_nested_shells_have_the_skin_of_the_definition() {
    let cuboid = |low: f64, high: f64| Body::cuboid([low; 3], [high; 3]);
    let inner = Body::sphere([35.0; 3], 12.0, 2);
    let needle = Body::new(
        &[[1.2, 1.3, 1.1], [68.7, 67.9, 66.8], [68.9, 68.3, 67.4], [68.3, 68.8, 67.1]],
        &[[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]],
    );
    let sliver = Body::new(
        &[[1.0, 20.0, 20.0], [69.0, 50.0, 20.0005], [69.0, 50.0, 60.0], [1.0, 20.001, 20.0]],
        &[[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]],
    );
    for (name, body, side) in [
        // All six faces, and their diagonals, through voxel centres: 40 voxels a side by the shift.
        ("coplanar at centres", cuboid(5.5, 45.5), 50),
        ("coplanar at the grid", cuboid(5.0, 45.0), 50),
        ("edges through centres, vertices on centres", Body::octahedron([30.5; 3], 25.0), 61),
        ("a diagonal through centres", Body::cuboid([4.5, 3.0, 2.5], [36.5, 35.0, 34.5]), 40),
        ("a needle across all columns", needle, 70),
        ("a sliver", sliver.with(&ball()), 70),
        ("larger than the grid", Body::octahedron([20.0, 33.0, 40.0], 60.0), 70),
        ("around the grid", Body::sphere([35.0; 3], 120.0, 1).with(&ball().reversed()), 70),
        ("inside out", ball().reversed(), 70),
        ("nested in one orientation, full", ball().with(&inner), 70),
        ("nested and reversed, a cavity", ball().with(&inner.reversed()), 70),
        ("overlapping shells, united", ball().with(&Body::cuboid([30.2; 3], [66.4, 50.7, 60.1])), 70),
        (
            "four faces at an edge",
            cuboid(5.0, 20.0).with(&Body::cuboid([20.0, 20.0, 5.0], [35.0, 35.0, 20.0])),
            40,
        ),
        ("touching at a vertex", cuboid(5.0, 20.0).with(&cuboid(20.0, 35.0)), 40),
    ] {
        println!("{name}");
        check(&body, [side; 3], Fill::Winding);
    }
}

#[test]
fn degenerate_duplicate_and_opposite_triangles() {
    let mut body = ball();
    let [a, b, _] = body.faces[7];
    // Twice the same vertex, and a face in both directions: they cancel.
    body.faces.extend([[a, a, b], [a, b, b]]);
    let face = body.faces[100];
    body.faces.extend([face, [face[0], face[2], face[1]]]);
    let facts = check(&body, GRID, Fill::Winding);
    assert_eq!((facts.flat, facts.boundary), (2, Boundary::Oriented));
}

#[test]
fn duplicate_faces_are_undone_by_caps() {
    let mut body = ball();
    let double: Vec<[usize; 3]> = body.faces.iter().copied().step_by(10).collect();
    body.faces.extend(double);
    let facts = check_as(&body, &ball(), GRID, Fill::Winding);
    assert!(matches!(facts.boundary, Boundary::Open { edges: 146, loops: 47 }), "{facts:?}");
}

#[test]
fn t_junction() {
    // The top of a box in two triangles, a side of it in three that meet in the middle of the top's edge.
    let mut body = Body::cuboid([5.3; 3], [30.7, 28.1, 26.9]).snapped(2);
    let [a, b, c] = body.faces[4];
    let middle = std::array::from_fn(|k| (body.vertices[a][k] + body.vertices[b][k]) / 2);
    body.vertices.push(middle);
    body.faces[4] = [a, 8, c];
    body.faces.push([8, b, c]);
    check_as(&body, &Body::cuboid([5.3; 3], [30.7, 28.1, 26.9]).snapped(2), [40, 40, 40], Fill::Winding);
}

#[test]
fn sub_voxel_soup_overflows_its_bin() {
    // More triangles in one voxel than any worker has room for.
    let mut body = ball();
    let crumb = Body::octahedron([10.4, 11.3, 12.6], 0.3);
    for at in 0..3000 {
        let mut crumb = crumb.clone();
        crumb.vertices.iter_mut().for_each(|v| v[0] += at % 300);
        body = body.with(&crumb);
    }
    check(&body, GRID, Fill::Winding);
}

#[test]
fn open_hole() {
    let whole = Body::cuboid([5.3; 3], [30.7, 28.1, 26.9]);
    let mut body = whole.clone();
    body.faces.truncate(10);
    let facts = check_as(&body, &whole, [40, 40, 40], Fill::Winding);
    assert_eq!(facts.boundary, Boundary::Open { edges: 4, loops: 1 });
}

#[test]
fn missing_1pc() {
    let mut body = ball();
    let mut at = 0;
    body.faces.retain(|_| {
        at += 1;
        at % 100 != 50
    });
    let facts = check_as(&body, &ball(), GRID, Fill::Winding);
    assert_eq!(facts.boundary, Boundary::Open { edges: 15, loops: 5 });
}

#[test]
fn flipped_half() {
    let mut body = ball();
    body.faces.iter_mut().step_by(2).for_each(|f| f.swap(0, 1));
    assert_eq!(check_as(&body, &ball(), GRID, Fill::Parity).boundary, Boundary::Mixed);
}

#[test]
fn moebius_and_klein() {
    // A strip of quads around a circle that turns over once; a bottle is such a strip closed across.
    let (n, m) = (48, 16);
    let mut body = Body::default();
    for i in 0..n {
        let u = f64::from(i) / f64::from(n) * std::f64::consts::TAU;
        for j in 0..m {
            let v = f64::from(j) / f64::from(m) * std::f64::consts::TAU;
            let across = (u / 2.0).cos() * v.sin() - (u / 2.0).sin() * (2.0 * v).sin();
            let up = (u / 2.0).sin() * v.sin() + (u / 2.0).cos() * (2.0 * v).sin();
            let r = 20.0 + 9.0 * across;
            let p = [35.1 + r * u.cos(), 35.2 + r * u.sin(), 35.3 + 9.0 * up];
            body.vertices.extend(Body::new(&[p], &[]).vertices);
        }
    }
    let at = |i: i32, j: i32| {
        let j = if i >= n { -j } else { j };
        usize::try_from(i % n * m + j.rem_euclid(m)).unwrap()
    };
    for i in 0..n {
        for j in 0..m {
            let (a, b, c, d) = (at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1));
            body.faces.extend([[a, b, c], [a, c, d]]);
        }
    }
    assert_eq!(check(&body, GRID, Fill::Parity).boundary, Boundary::Mixed);
}

#[test]
fn a_plate_on_centres_is_built_and_nothing_inside_is_refused() {
    check(&Body::cuboid([5.0, 5.0, 20.3], [35.0, 35.0, 20.7]), [40; 3], Fill::Winding);
    // A plate between centres, and a body beyond the grid.
    for (low, high) in [([5.0, 5.0, 19.8], [35.0, 35.0, 20.2]), ([500.0; 3], [600.0; 3])] {
        let place = Place::new();
        let file = place.put("a.stl", &Body::cuboid(low, high).stl());
        let refused = place.build(&[file], &exact([40; 3]), &options(16, 1)).unwrap_err();
        assert!(refused.to_string().contains("no voxel is inside"), "{refused}");
    }
}

#[test]
fn negative_zero_is_zero() {
    let body = Body::cuboid([0.0; 3], [20.0; 3]);
    let place = Place::new();
    let file = place.put("a.stl", &body.stl());
    place.build(&[file], &exact([30; 3]), &options(16, 1)).unwrap();
    let plain = place.bytes();
    let mut bytes = body.stl();
    for at in (96..bytes.len() - 4).step_by(2) {
        if bytes[at..at + 4] == [0; 4] && (at - 96) % 50 < 36 && (at - 96) % 50 % 4 == 0 {
            bytes[at + 3] = 0x80;
        }
    }
    assert_ne!(bytes, body.stl());
    let file = place.put("b.stl", &bytes);
    place.build(&[file], &exact([30; 3]), &options(16, 1)).unwrap();
    assert!(place.bytes() == plain);
}

/// The sentence of a refusal without its path.
fn fault(refused: BuildError) -> String {
    let path = format!("{}: ", refused.path().unwrap().display());
    refused.to_string().strip_prefix(&path).unwrap().to_owned()
}

#[test]
fn huge_coordinates_and_offsets_are_fitted_or_refused() {
    let place = Place::new();
    let side = on_grid(GridChoice::Side { voxels: 64, margin: 1 });
    let text = |low: f64, high: f64| {
        let corner = |i: usize, a: usize| if i >> a & 1 == 1 { high } else { low };
        let mut out = String::from("OFF 8 12 0\n");
        for i in 0..8 {
            out += &format!("{:e} {:e} {:e}\n", corner(i, 0), corner(i, 1), corner(i, 2));
        }
        for f in Body::cuboid([0.0; 3], [1.0; 3]).faces {
            out += &format!("3 {} {} {}\n", f[0], f[1], f[2]);
        }
        out
    };
    for (low, high) in [(1e12, 2e12), (1e7, 1e7 + 1e-6), (-1e-9, 1e-9)] {
        let file = place.put("a.off", text(low, high).as_bytes());
        place.build(&[file], &side, &options(16, 1)).unwrap();
        assert_eq!(place.model().dims().to_array(), [64; 3], "{low}");
        let corner = skin_of(&place.model());
        assert_eq!((corner.first(), corner.last()), (Some(&[1; 3]), Some(&[62; 3])), "{low}");
    }
    let file = place.put("a.off", text(1e9, 2e9).as_bytes());
    let refused = place.build(&[file], &exact([40; 3]), &options(16, 1)).unwrap_err();
    assert!(fault(refused).contains("voxels from the corner of the grid"));
    for (low, high, words) in [(1e200, 3e200, "mm long"), (3.0, 3.0, "lies in one point")] {
        let file = place.put("a.off", text(low, high).as_bytes());
        let refused = place.build(&[file], &side, &options(16, 1)).unwrap_err();
        assert!(fault(refused).contains(words), "{low}");
    }
}

#[test]
fn the_same_bytes_whatever_the_budget_the_threads_and_the_order() {
    let place = Place::new();
    // A shape with long and short edges on even lattice points, so that it can be refined.
    let body = Body::sphere([70.0; 3], 60.0, 4).with(&Body::cuboid([5.5, 60.0, 60.0], [139.0, 80.0, 75.0]));
    let body = body.snapped(4);
    let mesh = exact([150, 140, 145]);
    let file = place.put("a.stl", &body.stl());
    place.build(std::slice::from_ref(&file), &mesh, &options(32, 1)).unwrap();
    let first = place.bytes();
    let same = |what: &str, inputs: &[PathBuf], options: &BuildOptions| {
        std::fs::remove_file(place.path("a.oct")).unwrap();
        place.build(inputs, &mesh, options).unwrap();
        assert!(place.bytes() == first, "{what}");
    };
    for (share_mib, threads) in [(5, 1), (8, 2), (16, 5), (1024, 2)] {
        same("budget and threads", std::slice::from_ref(&file), &options(share_mib, threads));
    }
    let mut shuffled = body.clone();
    shuffled.faces.reverse();
    let n = shuffled.faces.len();
    for at in 0..n {
        shuffled.faces.swap(at, at * 7919 % n);
        shuffled.faces[at].rotate_left(at % 3);
    }
    let put = |name: &str, bytes: Vec<u8>| [place.put(name, &bytes)];
    same("shuffled", &put("b.stl", shuffled.stl()), &options(16, 2));
    same("refined", &put("c.stl", body.refined().stl()), &options(16, 2));
    let (mut one, mut other) = (body.clone(), body);
    other.faces = one.faces.split_off(1000);
    let parts = [place.put("h.stl", &one.stl()), place.put("i.ply", &other.ply("ascii"))];
    same("parts", &parts, &options(16, 2));
}

#[test]
fn a_mesh_moved_by_whole_voxels_is_the_model_moved() {
    let (a, b) = (ball(), {
        let mut moved = ball();
        moved.vertices.iter_mut().for_each(|v| *v = [v[0] + 5 * STEPS, v[1] + 33 * STEPS, v[2] + 2 * STEPS]);
        moved
    });
    let place = Place::new();
    let built = |body: &Body| {
        let file = place.put("a.stl", &body.stl());
        place.build(&[file], &exact([110; 3]), &options(16, 2)).unwrap();
        skin_of(&place.model())
    };
    let moved: BTreeSet<[u32; 3]> = built(&a).iter().map(|p| [p[0] + 5, p[1] + 33, p[2] + 2]).collect();
    assert!(moved == built(&b));
}

#[test]
fn normals_point_out_of_the_nearest_triangle() {
    let place = Place::new();
    let center = [64.137, 63.211, 65.173];
    let ball = Body::sphere(center, 50.0, 5);
    for body in [ball.clone(), ball.reversed()] {
        let file = place.put("a.stl", &body.stl());
        place.build(&[file], &exact([130; 3]), &options(16, 2)).unwrap();
        let model = place.model();
        let items = model.items(Channel::Normal).unwrap();
        let mut codes: Vec<u64> = skin_of(&model).iter().map(|p| morton::encode(p[0], p[1], p[2])).collect();
        codes.sort_unstable();
        let mut worst = 1.0_f64;
        for (at, code) in (0..).zip(codes) {
            let p = morton::decode(code);
            let d: [f64; 3] = std::array::from_fn(|k| f64::from(p[k]) + 0.5 - center[k]);
            let length = d.iter().map(|c| c * c).sum::<f64>().sqrt();
            let n = normal::decode(u16::from_le_bytes(items.get(at).unwrap().try_into().unwrap()));
            worst = worst.min(d.iter().zip(n).map(|(d, n)| d * f64::from(n)).sum::<f64>() / length);
        }
        // The largest triangles are four degrees across, and codes are off by 0.64 at most.
        assert!(worst > 3.2_f64.to_radians().cos(), "{worst}");
    }
    // A box: every normal is that of a face, also where voxels lie on it and beside its edges.
    let file = place.put("a.stl", &Body::cuboid([5.5; 3], [45.5, 40.0, 40.25]).stl());
    place.build(&[file], &exact([50; 3]), &options(16, 2)).unwrap();
    let model = place.model();
    let items = model.items(Channel::Normal).unwrap();
    for at in 0..model.header().voxels {
        let n = normal::decode(u16::from_le_bytes(items.get(at).unwrap().try_into().unwrap()));
        assert!(n.iter().any(|c| c.abs() == 1.0), "{n:?}");
    }
}

#[test]
fn the_grid_is_placed_in_millimetres() {
    let place = Place::new();
    let file = place.put("a.stl", &Body::cuboid([10.0, 20.0, 30.0], [20.0, 24.0, 31.0]).stl());
    let mesh = MeshOptions { unit_mm: 10.0, ..on_grid(GridChoice::Voxel { edge_mm: 0.5, margin: 2 }) };
    let facts = place.build(&[file], &mesh, &options(16, 2)).unwrap().facts;
    assert_eq!((facts.voxel_mm, facts.origin_mm), (0.5, [99.0, 199.0, 299.0]));
    let model = place.model();
    assert_eq!(model.dims().to_array(), [204, 84, 24]);
    assert_eq!(model.affine().rows[0], [0.5, 0.0, 0.0, 99.25]);
    assert_eq!(model.affine().rows[2], [0.0, 0.0, 0.5, 299.25]);
}

/// Builds bytes under a name; whatever happens, it is a model or an error.
fn attempt(place: &Place, name: &str, bytes: &[u8]) -> Result<MeshReport, BuildError> {
    let file = place.put(name, bytes);
    place.build(&[file], &exact([40; 3]), &options(8, 1))
}

#[test]
fn files_that_lie_are_refused_by_name() {
    let place = Place::new();
    let ply = |v: u64, f: u64, rest: &[u8]| {
        let mut out = format!(
            "ply\nformat binary_little_endian 1.0\nelement vertex {v}\nproperty float x\nproperty float y\nproperty float z\nelement face {f}\nproperty list uint int vertex_indices\nend_header\n"
        )
        .into_bytes();
        out.extend(rest);
        out
    };
    let refused = |name: &str, bytes: &[u8]| fault(attempt(&place, name, bytes).unwrap_err());
    assert!(refused("a.ply", &ply(1 << 32, 0, &[])).starts_with("states "));
    assert!(refused("a.ply", &ply(1 << 63, 1, &[])).starts_with("states "));
    assert!(refused("a.ply", &ply(0, u64::from(u32::MAX), &[])).starts_with("states "));
    assert!(refused("a.ply", &ply(0, 1, &[255; 4])).starts_with("ends before all that it states"));
    let noprops = b"ply\nformat binary_little_endian 1.0\nelement vertex 4294967295\nelement face 0\nproperty list uchar int vertex_indices\nend_header\n";
    let told = refused("a.ply", noprops);
    assert!(told.starts_with("states ") || told.contains("have no x, y and z"), "{told}");
    let mut stl = vec![0; 84];
    stl[80..].copy_from_slice(&u32::MAX.to_le_bytes());
    stl.extend([0; 50]);
    assert!(refused("a.stl", &stl).contains("elements where its bytes hold 1 at most"));
    let nan = {
        let mut bytes = Body::cuboid([1.0; 3], [9.0; 3]).stl();
        bytes[96 + 50..96 + 54].copy_from_slice(&f32::NAN.to_le_bytes());
        bytes
    };
    assert!(refused("a.stl", &nan).starts_with("triangle 2 has a coordinate that is infinite"));
    for text in
        ["v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -99999\n", "v 0 0 0\nf 1 1 4294967295\n", "v 0 0 0\nf 1 1 2\n"]
    {
        assert!(
            refused("a.obj", text.as_bytes()).starts_with("face 1 names a vertex that does not exist"),
            "{text}"
        );
    }
    assert!(refused("a.obj", b"v 0 0 0\nf 1 x 1\n").starts_with("line 2 cannot be understood"));
    assert!(refused("a.obj", b"hello").starts_with("is not a mesh of a known format"));
    assert!(
        refused("a.off", b"OFF\n9999999 1 0\n")
            .starts_with("states 9999999 elements where its bytes hold 2 at most")
    );
    assert!(refused("a.stl", b"").starts_with("ends before all that it states"));
    assert!(refused("a.obj", b"v 0 0 0\n").starts_with("has no faces"));
    // A binary file whose comment begins like text is binary.
    let mut solid = Body::cuboid([1.3; 3], [9.3; 3]).stl();
    solid[..12].copy_from_slice(b"solid made b");
    attempt(&place, "a.stl", &solid).unwrap();
    // A quadrilateral is cut into triangles, open as it is.
    attempt(
        &place,
        "a.obj",
        b"v 0 0 0\nv 9 0 0\nv 9 9 0\nv 0 9 0\nv 4.5 4.5 9\nf 1 2 3 4\nf 1 2 5\nf 2 3 5\n",
    )
    .unwrap();
}

#[test]
fn too_open_a_mesh_is_refused_unless_the_fill_is_said() {
    let place = Place::new();
    let mut body = Body::default();
    for at in 0..20_000_i64 {
        // Each before the first centre of a row, so that all of it would be inside.
        let (y, z) = (at % 40 * STEPS, at / 40 % 40 * STEPS);
        let x = 1000 + at / 1600;
        let first = body.vertices.len();
        body.vertices.extend([[x, y + 100, z + 100], [x, y + 4000, z + 100], [x, y + 2000, z + 4000]]);
        body.faces.push([first, first + 1, first + 2]);
    }
    let file = place.put("a.stl", &body.stl());
    let refused = place.build(std::slice::from_ref(&file), &exact([40; 3]), &options(8, 1)).unwrap_err();
    assert!(fault(refused).contains("open edges, too many to close"));
    let said = MeshOptions { fill: Some(Fill::Winding), ..exact([40; 3]) };
    assert!(place.build(&[file], &said, &options(8, 1)).unwrap().facts.asked_for);
}

#[test]
fn truncations_and_changed_bytes_are_refused_or_built() {
    let place = Place::new();
    let body = Body::sphere([20.3, 20.1, 19.8], 12.0, 2);
    let files: [(&str, Vec<u8>); 7] = [
        ("a.stl", body.stl()),
        ("a.stl", body.stl_text()),
        ("a.ply", body.ply("ascii")),
        ("a.ply", body.ply("binary_little_endian")),
        ("a.ply", body.ply("binary_big_endian")),
        ("a.obj", body.obj()),
        ("a.off", body.off()),
    ];
    let mut state = 20_261_122_u64;
    let mut next = |n: usize| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        usize::try_from(state >> 33).unwrap() % n
    };
    for (name, bytes) in files {
        for at in 0..60 {
            let cut = bytes.len() * at / 60;
            let _ = attempt(&place, name, &bytes[..cut]);
        }
        for _ in 0..150 {
            let mut changed = bytes.clone();
            for _ in 0..1 + next(3) {
                // The header, and anywhere.
                let at = if next(2) == 0 { next(changed.len().min(300)) } else { next(changed.len()) };
                changed[at] = u8::try_from(next(256)).unwrap();
            }
            let _ = attempt(&place, name, &changed);
        }
    }
    assert!(Path::new(&place.path("a.oct")).exists());
}
