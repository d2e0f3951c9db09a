//! Meshes and trees of solids as cells are true below the voxel: hits of rays against bodies known in closed form, for
//! meshes fine enough to be such, and for trees. If this fails, printed parts get stairs, edges fray, or models depend
//! on memory, threads or the order of triangles.

use crate::prelude::*;
use bodies::Body;

const SIDE: u32 = 96;

type Triangles = Vec<[[f64; 3]; 3]>;

/// Voxel i has its middle at i mm, as in the frame of the bodies.
fn grid(side: u32) -> GridChoice {
    GridChoice::Exact { edge_mm: 1.0, origin_mm: [-0.5; 3], dims: Dims::new(side, side, side).unwrap() }
}

fn options(share_mib: u64, threads: usize, surface: SurfaceKind) -> BuildOptions {
    BuildOptions { surface: Some(surface), lod: false, ..share(share_mib, threads) }
}

fn stl(triangles: &Triangles) -> Vec<u8> {
    let mut out = vec![0; 80];
    out.extend(u32::try_from(triangles.len()).unwrap().to_le_bytes());
    for t in triangles {
        out.extend([0; 12]);
        #[expect(clippy::cast_possible_truncation, reason = "the format has singles")]
        t.iter().flatten().for_each(|c| out.extend((*c as f32).to_le_bytes()));
        out.extend([0; 2]);
    }
    out
}

/// A closed sheet of steps by steps points, round in both directions or from pole to pole.
fn sheet([nu, nv]: [u32; 2], closed: bool, at: impl Fn(f64, f64) -> [f64; 3]) -> Triangles {
    let mut out = Vec::new();
    let rows = if closed { nv } else { nv + 1 };
    let point = |i: u32, j: u32| at(f64::from(i % nu) / f64::from(nu), f64::from(j % rows) / f64::from(nv));
    for j in 0..nv {
        for i in 0..nu {
            let [a, b, c, d] = [point(i, j), point(i + 1, j), point(i + 1, j + 1), point(i, j + 1)];
            out.extend(
                [[a, b, c], [a, c, d]].into_iter().filter(|t| t[0] != t[1] && t[1] != t[2] && t[0] != t[2]),
            );
        }
    }
    out
}

fn across(axis: [f64; 3]) -> [[f64; 3]; 2] {
    let e = unit(cross(axis, [1.0, 0.0, 0.0]));
    [e, cross(axis, e)]
}

fn triangles_of(body: &Body, fine: u32) -> Triangles {
    let turn = std::f64::consts::TAU;
    match *body {
        Body::Ball(c, r) => sheet([2 * fine, fine], false, |u, v| {
            let (u, v) = (u * turn, (v - 0.5) * turn / 2.0);
            // The poles are points.
            let ring = if v.cos() < 1e-6 { 0.0 } else { v.cos() };
            [c[0] + r * ring * u.cos(), c[1] + r * ring * u.sin(), c[2] + r * v.sin()]
        }),
        Body::Torus(c, axis, ring, tube) => {
            let [e, f] = across(axis);
            sheet([2 * fine, fine], true, |u, v| {
                let (u, v) = (u * turn, v * turn);
                let wide = ring + tube * v.cos();
                std::array::from_fn(|k| {
                    c[k] + wide * (e[k] * u.cos() + f[k] * u.sin()) + axis[k] * tube * v.sin()
                })
            })
        }
        Body::Box(c, rows, half) => cuboid(half.map(|h| -h), half)
            .into_iter()
            .map(|t| {
                t.map(|p| std::array::from_fn(|k| c[k] + (0..3).map(|j| rows[j][k] * p[j]).sum::<f64>()))
            })
            .collect(),
    }
}

fn cuboid(low: [f64; 3], high: [f64; 3]) -> Triangles {
    let corner = |i: usize| std::array::from_fn(|k| if i >> k & 1 == 1 { high[k] } else { low[k] });
    let faces = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]]
        .map(|f| f.map(corner));
    faces.into_iter().flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]]).collect()
}

fn tree_of(body: &Body) -> (Tree, NodeId) {
    let mut tree = Tree::new();
    let mut placed = |shape, columns: [[f64; 3]; 3], c: [f64; 3]| {
        let rows = std::array::from_fn(|k| [columns[0][k], columns[1][k], columns[2][k], c[k]]);
        let leaf = tree.leaf(shape);
        tree.placed(Affine { rows }, leaf)
    };
    let straight = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let root = match *body {
        Body::Ball(c, r) => placed(Shape::Ellipsoid { radii: [r; 3] }, straight, c),
        Body::Torus(c, axis, ring, tube) => {
            let [e, f] = across(axis);
            placed(Shape::Torus { major: ring, minor: tube }, [e, f, axis], c)
        }
        Body::Box(c, rows, half) => placed(Shape::Cuboid { low: half.map(|h| -h), high: half }, rows, c),
    };
    (tree, root)
}

fn build_triangles(
    triangles: &Triangles,
    side: u32,
    options: &BuildOptions,
    to: &Path,
) -> Result<(), BuildError> {
    let file = to.with_extension("stl");
    std::fs::write(&file, stl(triangles)).unwrap();
    build_mesh(&[file], &on_grid(grid(side)), options, to, &Silent).map(|_| ())
}

fn build_tree((tree, root): (Tree, NodeId), side: u32, options: &BuildOptions, to: &Path) {
    let input = CsgInput { tree, root, name: PathBuf::from("test"), volumes: Vec::new() };
    let csg = CsgOptions { grid: Some(grid(side)), unit_mm: 1.0 };
    build_csg(input, &csg, options, to, &Silent).unwrap();
}

/// Distance of hits from a surface (RMS, 99th percentile), normals (mean angle), and rays that hit on one side only.
#[derive(Debug)]
struct Found {
    rms: f64,
    p99: f64,
    angle: f64,
    wrong: f64,
}

/// Rays from three sides.
fn compare(
    path: &Path,
    distance: impl Fn([f64; 3]) -> f64,
    normal: impl Fn([f64; 3]) -> [f64; 3],
    first_hit: impl Fn([f64; 3], [f64; 3]) -> bool,
) -> Found {
    let model = Model::open(path).unwrap();
    verify(&model).unwrap();
    let caster = RayCaster::new(&model).unwrap();
    let (mut off, mut angles, mut wrong, mut rays) = (Vec::new(), 0.0, 0.0, 0.0);
    let span = f64::from(SIDE);
    for side in [[0.3, -0.9, 0.25], [0.85, 0.4, -0.3], [-0.2, 0.3, 0.93]] {
        let l = dot(side, side).sqrt();
        let forward: [f64; 3] = side.map(|c| -c / l);
        let [right, up] = across(forward);
        for v in 0..120 {
            for u in 0..120 {
                let at = |i: u32| (f64::from(2 * i + 1) / 120.0 - 1.0) * 0.5 * span;
                let eye: [f64; 3] = std::array::from_fn(|k| {
                    span / 2.0 - 2.0 * span * forward[k] + at(u) * right[k] + at(v) * up[k]
                });
                let hit = caster.first_hit(eye, forward).unwrap();
                let want = first_hit(eye, forward);
                rays += f64::from(u8::from(want));
                wrong += f64::from(u8::from(want != hit.is_some()));
                if let Some(hit) = hit {
                    off.push(distance(hit.position_mm).abs());
                    let cosine = dot(hit.normal.unwrap(), normal(hit.position_mm));
                    angles += cosine.clamp(-1.0, 1.0).acos().to_degrees();
                }
            }
        }
    }
    off.sort_by(f64::total_cmp);
    #[expect(clippy::cast_precision_loss, reason = "a count")]
    let count = off.len() as f64;
    Found {
        rms: (off.iter().map(|d| d * d).sum::<f64>() / count).sqrt(),
        p99: off[off.len() * 99 / 100],
        angle: angles / count,
        wrong: 100.0 * wrong / rays,
    }
}

fn of_body(path: &Path, body: &Body) -> Found {
    compare(
        path,
        |p| body.distance(p),
        |p| body.normal(p),
        |eye, d| body.first_hit(eye, d, 6.0 * f64::from(SIDE)).is_some(),
    )
}

/// Body; most RMS, 99th percentile, mean angle and percent of wrong rays. Edges of the box are cut off by planes.
const BOUNDS: [(usize, [f64; 4]); 3] =
    [(0, [0.008, 0.016, 0.75, 0.1]), (1, [0.013, 0.025, 1.5, 0.15]), (2, [0.03, 0.17, 2.1, 0.8])];

#[test]
fn meshes_are_true_below_the_voxel() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.oct");
    for (at, bounds) in BOUNDS {
        let (name, body) = Body::all(f64::from(SIDE))[at];
        let triangles = triangles_of(&body, 200);
        build_triangles(&triangles, SIDE, &options(16, 2, SurfaceKind::Skin), &path).unwrap();
        let skin = of_body(&path, &body);
        build_triangles(&triangles, SIDE, &options(16, 2, SurfaceKind::Cells), &path).unwrap();
        let cells = of_body(&path, &body);
        println!("mesh {name:6} {cells:?}; skin {skin:?}");
        let Found { rms, p99, angle, wrong } = cells;
        assert!([rms, p99, angle, wrong].iter().zip(bounds).all(|(got, most)| *got <= most), "{name}");
        assert!(rms < skin.rms / 5.0, "{name}");
    }
}

#[test]
fn trees_are_true_below_the_voxel() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.oct");
    for (at, bounds) in BOUNDS {
        let (name, body) = Body::all(f64::from(SIDE))[at];
        build_tree(tree_of(&body), SIDE, &options(16, 2, SurfaceKind::Cells), &path);
        let found = of_body(&path, &body);
        println!("tree {name:6} {found:?}");
        let Found { rms, p99, angle, wrong } = found;
        assert!([rms, p99, angle, wrong].iter().zip(bounds).all(|(got, most)| *got <= most), "{name}");
    }
}

#[test]
fn a_cut_body_has_the_surface_of_both() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.oct");
    let [(_, ball), (_, torus), (_, cuboid)] = Body::all(f64::from(SIDE));
    let mut tree = Tree::new();
    let nodes = [cuboid, ball].map(|body| {
        let (own, _) = tree_of(&body);
        assert_eq!(own.len(), 2);
        match body {
            Body::Box(c, rows, half) => {
                let leaf = tree.leaf(Shape::Cuboid { low: half.map(|h| -h), high: half });
                let rows = std::array::from_fn(|k| [rows[0][k], rows[1][k], rows[2][k], c[k]]);
                tree.placed(Affine { rows }, leaf)
            }
            Body::Ball(c, r) => {
                let leaf = tree.leaf(Shape::Ellipsoid { radii: [0.7 * r; 3] });
                let rows = std::array::from_fn(|k| {
                    let mut row = [0.0, 0.0, 0.0, c[k]];
                    row[k] = 1.0;
                    row
                });
                tree.placed(Affine { rows }, leaf)
            }
            Body::Torus(..) => unreachable!("not among them: {torus:?}"),
        }
    });
    let root = tree.join(Operation::Difference, &nodes);
    build_tree((tree, root), SIDE, &options(16, 2, SurfaceKind::Cells), &path);
    let Body::Ball(c, r) = ball else { panic!("a ball") };
    let hole = Body::Ball(c, 0.7 * r);
    let distance = |p| f64::max(cuboid.distance(p), -hole.distance(p));
    let normal = |p| {
        if cuboid.distance(p) > -hole.distance(p) {
            cuboid.normal(p)
        } else {
            hole.normal(p).map(|c: f64| -c)
        }
    };
    let hits = |eye: [f64; 3], d: [f64; 3]| {
        (300..1200).any(|t| distance(std::array::from_fn(|k| eye[k] + 0.25 * f64::from(t) * d[k])) <= 0.0)
    };
    let found = compare(&path, distance, normal, hits);
    println!("cut {found:?}");
    assert!(found.rms < 0.05 && found.p99 < 0.25 && found.angle < 4.5 && found.wrong < 2.0, "{found:?}");
}

#[test]
fn neither_memory_nor_threads_nor_the_order_of_triangles_change_a_byte() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.oct");
    let mut triangles = triangles_of(&Body::all(f64::from(SIDE))[1].1, 48);
    // An overlapping body, and a face twice.
    triangles.extend(cuboid([20.3, 20.0, 20.5], [70.5, 48.0, 60.5]));
    triangles.push(triangles[7]);
    triangles.push([7, 7, 7].map(|t: usize| triangles[t][0]));
    let mut first = None;
    let mut random = Random(7);
    for (share, threads) in [(64, 1), (6, 2), (8, 5), (5, 1)] {
        build_triangles(&triangles, SIDE, &options(share, threads, SurfaceKind::Cells), &path).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        assert_eq!(*first.get_or_insert_with(|| bytes.clone()), bytes, "{share} MiB, {threads} threads");
        for at in (1..triangles.len()).rev() {
            triangles.swap(at, random.below(at + 1));
            triangles[at].rotate_left(at % 3);
        }
    }
    let text = "difference() { cube([60, 50, 40.5]); multmatrix([[1,0,0,30],[0,1,0,25],[0,0,1,40],[0,0,0,1]]) \
                sphere(r = 22); cylinder(h = 90, r1 = 12, r2 = 4, $fn = 9); }";
    let mut first = None;
    for (share, threads) in [(64, 1), (6, 2), (8, 5), (5, 1)] {
        let tree = parse_tree(text.as_bytes(), Path::new("")).unwrap();
        build_tree(tree, SIDE, &options(share, threads, SurfaceKind::Cells), &path);
        let bytes = std::fs::read(&path).unwrap();
        assert_eq!(*first.get_or_insert_with(|| bytes.clone()), bytes, "{share} MiB, {threads} threads");
    }
}

/// Faces through centres, edges through centres, corners on centres: what crossings would miss that hold for one side
/// of a triangle's border only.
#[test]
fn faces_on_centres_lie_where_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.oct");
    for (low, high) in [([10.0; 3], [80.0; 3]), ([10.0, 20.5, 30.25], [80.0, 60.0, 70.5])] {
        for of_mesh in [true, false] {
            if of_mesh {
                build_triangles(&cuboid(low, high), SIDE, &options(16, 1, SurfaceKind::Cells), &path)
                    .unwrap();
            } else {
                let mut tree = Tree::new();
                let root = tree.leaf(Shape::Cuboid { low, high });
                build_tree((tree, root), SIDE, &options(16, 1, SurfaceKind::Cells), &path);
            }
            let model = Model::open(&path).unwrap();
            let caster = RayCaster::new(&model).unwrap();
            for axis in 0..3 {
                for (from, to) in [(-50.0, low[axis]), (150.0, high[axis])] {
                    for (u, v) in [(0.1, 0.2), (0.5, 0.5), (0.93, 0.77), (0.3, 0.96)] {
                        let mut eye = [0.0; 3];
                        let (b, c) = ((axis + 1) % 3, (axis + 2) % 3);
                        eye[b] = low[b] + u * (high[b] - low[b]);
                        eye[c] = low[c] + v * (high[c] - low[c]);
                        eye[axis] = from;
                        let mut d = [0.0; 3];
                        d[axis] = if from < 0.0 { 1.0 } else { -1.0 };
                        let hit = caster.first_hit(eye, d).unwrap().unwrap();
                        let off = (hit.position_mm[axis] - to).abs();
                        assert!(off < 0.006, "axis {axis}, {of_mesh}: {off}");
                    }
                }
            }
        }
    }
}

/// A mesh in a tree is crossed as it is by itself.
#[test]
fn a_mesh_in_a_tree_has_the_cells_of_the_mesh() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.oct");
    let triangles = triangles_of(&Body::all(f64::from(SIDE))[2].1, 1);
    let cells = options(16, 2, SurfaceKind::Cells);
    build_triangles(&triangles, SIDE, &cells, &path).unwrap();
    let items = |path: &Path| {
        let model = Model::open(path).unwrap();
        [Channel::Normal, Channel::Offset].map(|channel| {
            let items = model.items(channel).unwrap();
            (0..model.voxel_count()).map(|at| items.get(at).unwrap().to_vec()).collect::<Vec<_>>()
        })
    };
    let mesh = items(&path);
    let mut tree = Tree::new();
    let root = tree.leaf(Shape::Mesh { path: path.with_extension("stl") });
    let tree_path = folder.path().join("t.oct");
    build_tree((tree, root), SIDE, &cells, &tree_path);
    assert!(items(&tree_path) == mesh);
}

/// What is taken out of a body has its surface where it was.
#[test]
fn a_mesh_taken_away_leaves_its_surface() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.oct");
    let (_, body) = Body::all(f64::from(SIDE))[0];
    let file = folder.path().join("ball.stl");
    std::fs::write(&file, stl(&triangles_of(&body, 200))).unwrap();
    let mut tree = Tree::new();
    let all = tree.leaf(Shape::Cuboid { low: [-5.0; 3], high: [120.0; 3] });
    let mesh = tree.leaf(Shape::Mesh { path: file });
    let half = tree.leaf(Shape::HalfSpace { normal: [0.0, 0.0, -1.0], offset: -f64::from(SIDE) / 2.0 });
    let root = tree.join(Operation::Difference, &[all, mesh, half]);
    build_tree((tree, root), SIDE, &options(16, 2, SurfaceKind::Cells), &path);
    let caster = Model::open(&path).unwrap();
    let caster = RayCaster::new(&caster).unwrap();
    let Body::Ball(c, _) = body else { panic!("a ball") };
    for (dx, dy) in [(0.0, 0.0), (10.0, 3.0), (-7.3, 20.1), (-15.0, -15.0)] {
        let hit = caster.first_hit([c[0] + dx, c[1] + dy, 150.0], [0.0, 0.0, -1.0]).unwrap().unwrap();
        assert!(body.distance(hit.position_mm).abs() < 0.03, "{hit:?}");
        assert!(dot(hit.normal.unwrap(), body.normal(hit.position_mm)) < -0.99, "{hit:?}");
    }
}

#[test]
fn a_body_cut_by_the_grid_ends_at_its_wall() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.oct");
    build_triangles(&cuboid([-30.0; 3], [130.0; 3]), 40, &options(16, 1, SurfaceKind::Cells), &path).unwrap();
    let model = Model::open(&path).unwrap();
    verify(&model).unwrap();
    let caster = RayCaster::new(&model).unwrap();
    let hit = caster.first_hit([-20.0, 11.3, 7.9], [1.0, 0.0, 0.0]).unwrap().unwrap();
    assert!((hit.position_mm[0] + 0.5).abs() < 0.01, "{hit:?}");
    let hit = caster.first_hit([11.3, 7.9, 90.0], [0.0, 0.0, -1.0]).unwrap().unwrap();
    assert!((hit.position_mm[2] - 39.5).abs() < 0.01, "{hit:?}");
}

#[test]
fn voxels_that_lie_outside_are_not_made_cells() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.oct");
    let file = folder.path().join("m.stl");
    std::fs::write(&file, stl(&cuboid([10.0; 3], [20.0; 3]))).unwrap();
    let mesh = MeshOptions { keep_thin: true, ..on_grid(grid(32)) };
    let refused =
        build_mesh(&[file], &mesh, &options(16, 1, SurfaceKind::Cells), &path, &Silent).unwrap_err();
    assert!(refused.to_string().contains("which add voxels that lie outside"), "{refused}");
}
