//! Trees of solids become models voxel by voxel as defined: leaves are placed on the lattice of 2^-12 voxel, a voxel
//! is inside a leaf if its middle is, and the tree joins that. Every primitive under any affine, and random trees, are
//! compared here with a slow count that shares no code with the program. If this fails, parts have stray voxels or
//! inner walls, cost what they should not, or differ from machine to machine.
#![expect(clippy::cast_possible_truncation, reason = "coordinates of small grids")]

mod faces;
mod files;
mod measures;
mod middles;
use crate::common::models::share as options;
use crate::common::vectors::sub;
use crate::prelude::*;
mod text;

use infobyte::csg::Faces;

const STEPS: f64 = 4096.0;

fn exact(dims: [u32; 3]) -> CsgOptions {
    CsgOptions { grid: Some(exact_grid(dims)), unit_mm: 1.0 }
}

fn build_to(
    (tree, root): (Tree, NodeId),
    csg: &CsgOptions,
    options: &BuildOptions,
    to: &Path,
) -> Result<BuildReport, BuildError> {
    let input = CsgInput { tree, root, name: PathBuf::from("test"), volumes: Vec::new() };
    build_csg(input, csg, options, to, &Silent)
}

/// The bytes of the model of a tree.
fn bytes_with(tree: (Tree, NodeId), csg: &CsgOptions, options: &BuildOptions) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a.oct");
    build_to(tree, csg, options, &file).unwrap();
    std::fs::read(file).unwrap()
}

fn bytes(tree: (Tree, NodeId), dims: [u32; 3]) -> Vec<u8> {
    bytes_with(tree, &exact(dims), &options(16, 2))
}

fn parsed(text: &str) -> (Tree, NodeId) {
    parse_tree(text.as_bytes(), Path::new("")).unwrap()
}

/// Skin voxels and their normals.
fn skin_of(model: &Model) -> Vec<([u32; 3], [f32; 3])> {
    let items = model.items(Channel::Normal).unwrap();
    let normal_at = |at| normal::decode(u16::from_le_bytes(items.get(at).unwrap().try_into().unwrap()));
    finest(model).into_iter().map(|(at, voxel)| (at, normal_at(voxel.get()))).collect()
}

fn round(p: [f64; 3]) -> [f64; 3] {
    p.map(|c| (c * STEPS).round_ties_even())
}

/// Is a point (lattice steps) inside a placed shape, by the definition? In f64: points nearer to the surface than
/// 1e-9 of the shape's size do not occur in these tests.
fn inside(shape: &Shape, m: &Affine, p: [f64; 3]) -> bool {
    let axis = |k: usize, by: f64| round(m.column(k).map(|c| c * by));
    // Coordinates of p in a frame.
    let local = |middle: [f64; 3], e: [[f64; 3]; 3]| {
        let d = sub(p, middle);
        let volume = dot(e[0], cross(e[1], e[2]));
        [0, 1, 2].map(|k| dot(d, cross(e[(k + 1) % 3], e[(k + 2) % 3])) / volume)
    };
    match shape {
        Shape::Cuboid { low, high } => {
            // Its three pairs of faces, by rounded corners; tests keep middles off them unless they lie along the axes.
            let corner =
                |k: [bool; 3]| round(m.apply([0, 1, 2].map(|a| if k[a] { high[a] } else { low[a] })));
            let origin = corner([false; 3]);
            let e = [
                sub(corner([true, false, false]), origin),
                sub(corner([false, true, false]), origin),
                sub(corner([false, false, true]), origin),
            ];
            local(origin, e).iter().all(|u| *u > 0.0 && *u < 1.0)
        }
        Shape::Ellipsoid { radii } => {
            let axes = [0, 1, 2].map(|k| m.column(k).map(|c| c * radii[k] * STEPS));
            let lengths = axes.map(|a| dot(a, a).sqrt());
            let is_round = (0..3).all(|k| (lengths[k] - lengths[0]).abs() < 1e-9 * lengths[0])
                && (0..3).all(|k| dot(axes[k], axes[(k + 1) % 3]).abs() < 1e-9 * lengths[0].powi(2));
            if is_round {
                let d = sub(p, round(m.origin()));
                return dot(d, d) <= lengths[0].round_ties_even().powi(2);
            }
            let u = local(round(m.origin()), [axis(0, radii[0]), axis(1, radii[1]), axis(2, radii[2])]);
            dot(u, u) <= 1.0
        }
        Shape::Cylinder { z, radii } => {
            let widest = radii[0].max(radii[1]);
            let (low, high) = (round(m.apply([0.0, 0.0, z[0]])), round(m.apply([0.0, 0.0, z[1]])));
            let u = local(low, [axis(0, widest), axis(1, widest), sub(high, low)]);
            let part = |r: f64| (r / widest * 1_048_576.0).round_ties_even() / 1_048_576.0;
            let width = part(radii[0]) + u[2] * (part(radii[1]) - part(radii[0]));
            (0.0..=1.0).contains(&u[2]) && (u[0] * u[0] + u[1] * u[1]).sqrt() <= width
        }
        Shape::Torus { major, minor } => {
            let u = local(round(m.origin()), [axis(0, *major), axis(1, *major), axis(2, *major)]);
            let ring = (u[0] * u[0] + u[1] * u[1]).sqrt() - 1.0;
            (ring * ring + u[2] * u[2]).sqrt() <= minor / major
        }
        Shape::HalfSpace { normal, offset } => {
            let length = dot(*normal, *normal).sqrt();
            let on_it = round(m.apply(normal.map(|c| c / length * offset)));
            let c = [0, 1, 2].map(|k| m.column(k));
            let cofactors = [cross(c[1], c[2]), cross(c[2], c[0]), cross(c[0], c[1])];
            let n = [0, 1, 2].map(|k| (0..3).map(|j| cofactors[j][k] * normal[j]).sum::<f64>());
            dot(n, sub(p, on_it)) * dot(c[0], cofactors[0]).signum() <= 0.0
        }
        other => panic!("{other:?} is tested elsewhere"),
    }
}

/// A tree as the oracle walks it.
enum Plain {
    Leaf(Shape, Affine),
    Joined(Operation, Vec<Plain>),
}

impl Plain {
    fn inside(&self, p: [f64; 3]) -> bool {
        match self {
            Self::Leaf(shape, m) => inside(shape, m, p),
            Self::Joined(Operation::Union, all) => all.iter().any(|one| one.inside(p)),
            Self::Joined(Operation::Intersection, all) => all.iter().all(|one| one.inside(p)),
            Self::Joined(Operation::Complement, all) => !all.iter().any(|one| one.inside(p)),
            Self::Joined(Operation::Difference, all) => {
                all[0].inside(p) && !all[1..].iter().any(|one| one.inside(p))
            }
        }
    }

    fn put(&self, tree: &mut Tree) -> NodeId {
        match self {
            Self::Leaf(shape, m) => {
                let leaf = tree.leaf(shape.clone());
                tree.placed(*m, leaf)
            }
            Self::Joined(operation, all) => {
                let nodes: Vec<NodeId> = all.iter().map(|one| one.put(tree)).collect();
                tree.join(*operation, &nodes)
            }
        }
    }

    fn tree(&self) -> (Tree, NodeId) {
        let mut tree = Tree::new();
        let root = self.put(&mut tree);
        (tree, root)
    }
}

/// Skin by the definition.
fn skin(inside: impl Fn([f64; 3]) -> bool, dims: [u32; 3]) -> BTreeSet<[u32; 3]> {
    let [nx, ny, nz] = dims.map(|n| n as usize);
    let mut bits = vec![false; nx * ny * nz];
    for (at, bit) in bits.iter_mut().enumerate() {
        let voxel = [at % nx, at / nx % ny, at / nx / ny];
        // Middles on a surface are moved.
        let moved = [-1e-4, 1e-6, 1e-8];
        *bit = inside([0, 1, 2].map(|k| (voxel[k] as f64 + 0.5) * STEPS + moved[k]));
    }
    let value = |p: [i64; 3]| {
        let exists = p.iter().zip([nx, ny, nz]).all(|(c, n)| (0..n as i64).contains(c));
        exists && bits[(p[0] + nx as i64 * (p[1] + ny as i64 * p[2])) as usize]
    };
    let mut all = BTreeSet::new();
    for (at, bit) in bits.iter().enumerate() {
        let voxel = [at % nx, at / nx % ny, at / nx / ny].map(|c| c as i64);
        let open = (0..3).any(|k| {
            [-1, 1].into_iter().any(|way| {
                let mut beside = voxel;
                beside[k] += way;
                !value(beside)
            })
        });
        if *bit && open {
            all.insert(voxel.map(|c| c as u32));
        }
    }
    all
}

/// Builds a tree and compares its skin with the oracle's.
fn check(plain: &Plain, dims: [u32; 3], what: &str) -> usize {
    let want = skin(|p| plain.inside(p), dims);
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a.oct");
    let built = build_to(plain.tree(), &exact(dims), &options(16, 2), &file);
    if want.is_empty() {
        assert!(built.unwrap_err().to_string().contains("no voxel is inside"), "{what}");
        return 0;
    }
    built.unwrap();
    let model = Model::open(&file).unwrap();
    verify(&model).unwrap();
    let got: BTreeSet<[u32; 3]> = skin_of(&model).into_iter().map(|(voxel, _)| voxel).collect();
    let wrong = got.symmetric_difference(&want).count();
    assert!(wrong == 0, "{what}: {wrong} of {} skin voxels are wrong", want.len());
    want.len()
}

/// Any affine: turned, stretched, sheared, mirrored.
fn any_affine(random: &mut Random, about: [f64; 3]) -> Affine {
    let mut rows = [[0.0; 4]; 3];
    loop {
        for (row, at) in rows.iter_mut().zip(about) {
            for c in row.iter_mut().take(3) {
                *c = 2.0 * random.unit() - 1.0;
            }
            row[3] = at + 10.0 * (random.unit() - 0.5);
        }
        let affine = Affine { rows };
        if affine.determinant().abs() > 0.2 {
            return affine;
        }
    }
}

fn any_shape(random: &mut Random, kind: u32) -> Shape {
    let mut size = || 4.0 + 12.0 * random.unit();
    match kind {
        0 => Shape::Ellipsoid { radii: [size(), size(), size()] },
        1 => Shape::Cylinder { z: [-size(), size()], radii: [size(), size()] },
        2 => Shape::Cylinder { z: [-size(), size()], radii: [0.0, size()] },
        3 => {
            let major = size();
            Shape::Torus { major, minor: major * 0.3 }
        }
        4 => Shape::HalfSpace { normal: [size() - 10.0, size() - 10.0, size()], offset: size() - 10.0 },
        _ => Shape::Cuboid { low: [-size(), -size(), -size()], high: [size(), size(), size()] },
    }
}

const KINDS: u32 = 6;
const GRID: [u32; 3] = [70, 45, 50];

#[test]
fn every_primitive_is_built_as_it_is_defined_wherever_it_lies() {
    let mut random = Random(1);
    for round in 0..4 * KINDS {
        let shape = any_shape(&mut random, round % KINDS);
        let affine = match round / KINDS {
            // Along the axes, but at no special place.
            0 => Affine { rows: [[1.0, 0.0, 0.0, 31.37], [0.0, 1.0, 0.0, 20.91], [0.0, 0.0, 1.0, 26.13]] },
            _ => any_affine(&mut random, [35.0, 22.0, 25.0]),
        };
        let what = format!("{shape:?} {affine:?}");
        check(&Plain::Leaf(shape, affine), GRID, &what);
    }
}

fn any_tree(random: &mut Random, depth: u32) -> Plain {
    if depth == 0 || random.below(4_u32) == 0 {
        let kind = random.below(KINDS);
        let about = [70.0 * random.unit(), 45.0 * random.unit(), 50.0 * random.unit()];
        return Plain::Leaf(any_shape(random, kind), any_affine(random, about));
    }
    let operation = random.pick(&[
        Operation::Union,
        Operation::Union,
        Operation::Intersection,
        Operation::Difference,
        Operation::Difference,
        Operation::Complement,
    ]);
    let count = 1 + random.below(4_u32);
    Plain::Joined(operation, (0..count).map(|_| any_tree(random, depth - 1)).collect())
}

#[test]
fn random_trees_are_built_as_they_are_defined() {
    let mut random = Random(2);
    let mut seen = 0;
    for round in 0..16 {
        let plain = any_tree(&mut random, 4);
        seen += check(&plain, GRID, &format!("round {round}"));
    }
    assert!(seen > 10_000, "{seen}");
}

#[test]
fn a_mirrored_or_turned_tree_gives_a_mirrored_or_turned_model() {
    const SIDE: u32 = 56;
    let mut random = Random(9);
    let mut seen = 0;
    for round in 0..8 {
        let plain = any_tree(&mut random, 3);
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.oct");
        let built = |tree| build_to(tree, &exact([SIDE; 3]), &options(16, 2), &file).map(|_| skin_at(&file));
        // Some hold nothing.
        let Ok(wanted) = built(plain.tree()) else { continue };
        for symmetry in Symmetry::all().skip(1).step_by(5) {
            let (mut tree, root) = plain.tree();
            let mut rows = [[0.0; 4]; 3];
            for (k, row) in rows.iter_mut().enumerate() {
                row[symmetry.from[k]] = if symmetry.mirror[k] { -1.0 } else { 1.0 };
                row[3] = if symmetry.mirror[k] { f64::from(SIDE) } else { 0.0 };
            }
            let root = tree.placed(Affine { rows }, root);
            let found = built((tree, root)).unwrap();
            assert_eq!(found.len(), wanted.len(), "round {round}: {symmetry:?}");
            let mut alike = 0;
            for (voxel, normal) in &wanted {
                let own = found.get(&symmetry.cell(*voxel, SIDE));
                let own = own.unwrap_or_else(|| panic!("round {round}: {symmetry:?}, {voxel:?}"));
                alike += usize::from(dot(*own, symmetry.vector(*normal)) > 0.999);
            }
            assert!(
                alike * 100 >= wanted.len() * 99,
                "round {round}: {symmetry:?}: {alike} of {}",
                wanted.len()
            );
            seen += wanted.len();
        }
    }
    assert!(seen > 50_000, "{seen}");
}

/// Skin voxels of a file, and their normals.
fn skin_at(file: &Path) -> BTreeMap<[u32; 3], [f64; 3]> {
    let model = Model::open(file).unwrap();
    model.voxels().map(|found| (found.voxel, found.normal.unwrap())).collect()
}

const BALLS: &str = "sphere(r = 14.2); multmatrix([[1,0,0,9],[0,1,0,4],[0,0,1,1],[0,0,0,1]]) { sphere(r = 10.7); }
    multmatrix([[1,0,0,-3],[0,1,0.2,14],[0,0,1,1],[0,0,0,1]]) { cylinder(h = 25, r1 = 9, r2 = 4, center = true); }";

fn around(text: &str) -> (Tree, NodeId) {
    parsed(&format!("multmatrix([[1,0,0,30.3],[0,1,0,22.2],[0,0,1,25.1],[0,0,0,1]]) {{ {text} }}"))
}

#[test]
fn trees_that_mean_the_same_give_the_same_bytes() {
    let parts: Vec<&str> = BALLS.splitn(2, ';').collect();
    let (a, rest) = (format!("{};", parts[0]), parts[1]);
    let same =
        |one: &str, other: &str| assert!(bytes(around(one), GRID) == bytes(around(other), GRID), "{one}");
    // De Morgan.
    same(
        &format!("intersection() {{ {BALLS} }}"),
        &format!("complement() {{ complement() {{ {a} }} complement() {{ intersection() {{ {rest} }} }} }}"),
    );
    same(BALLS, &format!("complement() {{ complement() {{ {BALLS} }} }}"));
    same(
        &format!("difference() {{ {BALLS} }}"),
        &format!("intersection() {{ {a} complement() {{ {rest} }} }}"),
    );
    // Associativity, and what means nothing.
    same(BALLS, &format!("union() {{ {a} group() {{ union() {{ {rest} }} group(); }} }}"));
    same(
        &format!("difference() {{ {BALLS} }}"),
        &format!("difference() {{ difference() {{ {BALLS} }} group(); }}"),
    );
}

#[test]
fn a_solid_less_itself_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    for text in ["difference() { sphere(r = 9); sphere(r = 9); }", "group();", ""] {
        let built = build_to(around(text), &exact(GRID), &options(16, 1), &folder.path().join("a.oct"));
        assert!(built.unwrap_err().to_string().contains("no voxel is inside"), "{text}");
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

/// No picture could be taken of them, nor a mesh be written.
#[test]
fn solids_that_are_far_too_small_or_large_are_refused_with_their_size() {
    let folder = tempfile::tempdir().unwrap();
    let csg = CsgOptions { grid: Some(GridChoice::Side { voxels: 32, margin: 1 }), unit_mm: 1.0 };
    for (size, refused) in [("1e-20", true), ("1e20", true), ("1e-12", false), ("1e12", false)] {
        let tree = parsed(&format!("cube({size});"));
        match build_to(tree, &csg, &options(16, 1), &folder.path().join("a.oct")) {
            Err(error) => {
                let text = error.to_string();
                assert!(refused && text.contains("mm long") && text.contains("1.06667e"), "{size}: {text}");
            }
            Ok(_) => assert!(!refused, "{size}"),
        }
    }
}

#[test]
fn boxes_that_share_a_face_are_one() {
    let halves = "cube(size = [11, 20, 30]); multmatrix([[1,0,0,11],[0,1,0,0],[0,0,1,0],[0,0,0,1]]) {
        cube(size = [9, 20, 30]); }";
    assert!(bytes(around(halves), GRID) == bytes(around("cube(size = [20, 20, 30]);"), GRID));
    // Also where the face lies on middles of voxels, along every axis.
    for axis in 0..3 {
        let mut size = ["20.0"; 3];
        size[axis] = "10.5";
        let mut at = [0.0; 3];
        at[axis] = 10.5;
        let mut rest = ["20.0"; 3];
        rest[axis] = "9.5";
        let text = format!(
            "cube(size = [{}]); multmatrix([[1,0,0,{}],[0,1,0,{}],[0,0,1,{}],[0,0,0,1]]) {{ cube(size = [{}]); }}",
            size.join(","),
            at[0],
            at[1],
            at[2],
            rest.join(",")
        );
        let whole = "cube(size = [20, 20, 20]);";
        let place = |text: &str| {
            parsed(&format!("multmatrix([[1,0,0,20],[0,1,0,15],[0,0,1,20],[0,0,0,1]]) {{ {text} }}"))
        };
        assert!(bytes(place(&text), GRID) == bytes(place(whole), GRID), "{axis}");
    }
}

#[test]
fn budgets_threads_and_tiles_change_nothing() {
    let mut random = Random(3);
    let tree = any_tree(&mut random, 3);
    let all = Plain::Joined(
        Operation::Union,
        vec![tree, Plain::Leaf(any_shape(&mut random, 3), any_affine(&mut random, [150.0, 60.0, 300.0]))],
    );
    let grid = exact([300, 100, 330]);
    let reference = bytes_with(all.tree(), &grid, &options(256, 5));
    for (share, threads) in [(4, 1), (8, 2), (64, 1)] {
        assert!(bytes_with(all.tree(), &grid, &options(share, threads)) == reference, "{share} {threads}");
    }
}

#[test]
fn normals_are_those_of_the_leaf_that_makes_the_skin() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a.oct");
    let middle = [30.3, 22.2, 25.1];
    let text =
        "difference() { sphere(r = 19.3); sphere(r = 9.4); halfspace(normal = [0, 0, -1], offset = 0.4); }";
    for connectivity in [Connectivity::Thin26, Connectivity::Thick6] {
        let how = BuildOptions { connectivity, ..options(16, 1) };
        build_to(around(text), &exact([60, 45, 50]), &how, &file).unwrap();
        let model = Model::open(&file).unwrap();
        let mut seen = [0; 4];
        for (voxel, n) in skin_of(&model) {
            let d: [f64; 3] = std::array::from_fn(|k| f64::from(voxel[k]) + 0.5 - middle[k]);
            let length = dot(d, d).sqrt();
            let n = n.map(f64::from);
            let radial = dot(d, n) / length;
            let (which, good) = if radial > 0.999 && length > 17.0 {
                (0, length < 19.31)
            } else if radial < -0.999 {
                (1, length < 11.9)
            } else if d[2] > -2.2
                && ((length - 19.3).abs() < 1.8 || (length - 9.4).abs() < 1.8)
                && n[2] < 0.999
            {
                // Where the cut meets a sphere, between both.
                let side = if length > 14.0 { radial } else { -radial };
                (3, n[2] > -0.1 && side > -0.1)
            } else {
                (2, n[2] > 0.999 && d[2] > -1.6)
            };
            seen[which] += 1;
            assert!(good, "{voxel:?} {n:?} {length}");
        }
        assert!(seen[..3].iter().all(|n| *n > 300) && (50..400).contains(&seen[3]), "{seen:?}");
    }
}

#[test]
fn ten_thousand_leaves_and_a_depth_of_ten_thousand() {
    let mut flat = String::from("difference() { cube(size = [70, 45, 50]);");
    let mut random = Random(4);
    for _ in 0..10_000 {
        let [x, y, z] = [70.0, 45.0, 50.0].map(|n| n * random.unit());
        flat +=
            &format!("multmatrix([[1,0,0,{x}],[0,1,0,{y}],[0,0,1,{z}],[0,0,0,1]]) {{ sphere(r = 1.6); }}\n");
    }
    flat += "}";
    let built = bytes(parsed(&flat), GRID);
    assert!(built.len() > 10_000);
    // As deep, and of alternating kinds so that nothing can be merged.
    let mut deep = String::new();
    for at in 0..10_000 {
        let kind = if at % 2 == 0 { "difference" } else { "union" };
        deep += &format!("{kind}() {{ group() {{ color([1, 0, 0]) {{\n");
    }
    deep += "multmatrix([[1,0,0,30],[0,1,0,20],[0,0,1,20],[0,0,0,1]]) { sphere(r = 12.3); }";
    for at in 0..10_000 {
        let x = 70.0 * random.unit();
        let radius = if at % 2 == 0 { 1.1 } else { 0.9 };
        deep += &format!(
            "}} }} multmatrix([[1,0,0,{x}],[0,1,0,20],[0,0,1,20],[0,0,0,1]]) {{ sphere(r = {radius}); }} }}"
        );
    }
    let built = bytes(parsed(&deep), GRID);
    assert!(built.len() > 2_000);
}

/// Boxes see only the leaves near them: with many small ones of every kind that is most of the work.
#[test]
fn many_small_leaves_are_built_as_they_are_defined() {
    let dims = [48, 40, 44];
    let mut random = Random(21);
    let mut some = |count: u32, size: f64| -> Vec<Plain> {
        let leaf = |at: u32| {
            let shape = any_shape(&mut random, at % KINDS);
            let place = [48.0, 40.0, 44.0].map(|n| n * random.unit());
            let mut affine = any_affine(&mut random, place);
            for row in &mut affine.rows {
                row.iter_mut().take(3).for_each(|c| *c *= size);
            }
            Plain::Leaf(shape, affine)
        };
        (0..count).filter(|at| at % KINDS != 4).map(leaf).collect()
    };
    let united = Plain::Joined(Operation::Union, some(120, 0.25));
    assert!(check(&united, dims, "a union") > 1000);
    let mut parts = vec![Plain::Joined(Operation::Union, some(90, 0.4))];
    parts.extend(some(90, 0.15));
    assert!(check(&Plain::Joined(Operation::Difference, parts), dims, "a difference") > 1000);
}

/// What holds no middle of a voxel changes nothing, but is asked wherever it may matter: normals by blocks with many
/// leaves are those of the few that count.
#[test]
fn dust_between_the_middles_changes_nothing() {
    let mut random = Random(22);
    let leaf = |tree: &mut Tree, shape, affine| {
        let leaf = tree.leaf(shape);
        tree.placed(affine, leaf)
    };
    let at = |place: [f64; 3]| {
        let mut affine = Affine::from_spacing([1.0; 3]);
        affine.rows.iter_mut().zip(place).for_each(|(row, c)| row[3] = c);
        affine
    };
    let mut built = |dust: u32| {
        let mut tree = Tree::new();
        let ball = leaf(&mut tree, Shape::Ellipsoid { radii: [17.3; 3] }, at([30.1, 22.2, 25.3]));
        let box_ = Shape::Cuboid { low: [-30.2, -9.1, -7.7], high: [30.2, 9.1, 7.7] };
        let turned = Affine { rows: [[0.9, 0.3, 0.1, 35.0], [-0.3, 0.9, 0.2, 22.0], [0.0, -0.2, 0.9, 25.0]] };
        let bar = leaf(&mut tree, box_, turned);
        let ring = leaf(&mut tree, Shape::Torus { major: 16.2, minor: 4.3 }, at([33.3, 21.1, 25.2]));
        let mut added = Vec::new();
        let mut taken = Vec::new();
        for k in 0..dust {
            let corner = [70.0, 45.0, 50.0].map(|n| (n * random.unit()).floor());
            let small =
                Affine { rows: any_affine(&mut random, [0.0; 3]).rows.map(|row| row.map(|c| 0.1 * c)) };
            let mut affine = small;
            affine.rows.iter_mut().zip(corner).for_each(|(row, c)| row[3] = c + 0.1);
            let shape =
                [Shape::Ellipsoid { radii: [1.0, 1.5, 2.0] }, Shape::Torus { major: 1.0, minor: 0.4 }];
            let one = leaf(&mut tree, shape[k as usize % 2].clone(), affine);
            if k % 3 == 0 { taken.push(one) } else { added.push(one) }
        }
        let mut parts = vec![ball, bar];
        parts.extend(added);
        let mut whole = vec![tree.join(Operation::Union, &parts), ring];
        whole.extend(taken);
        let root = tree.join(Operation::Difference, &whole);
        bytes((tree, root), GRID)
    };
    let plain = built(0);
    assert!(built(3000) == plain && built(40) == plain);
}

#[test]
fn ten_thousand_leaves_take_little_memory() {
    let mut random = Random(23);
    let mut tree = Tree::new();
    let mut deep = None;
    let mut all = Vec::new();
    for k in 0..10_000_u32 {
        let leaf = tree.leaf(Shape::Ellipsoid { radii: [1.5; 3] });
        let mut affine = Affine::from_spacing([1.0; 3]);
        affine.rows.iter_mut().zip([70.0, 45.0, 50.0]).for_each(|(row, n)| row[3] = n * random.unit());
        let leaf = tree.placed(affine, leaf);
        all.push(leaf);
        let operation = if k % 2 == 0 { Operation::Union } else { Operation::Difference };
        deep = Some(deep.map_or(leaf, |deep| tree.join(operation, &[deep, leaf])));
    }
    let flat = tree.join(Operation::Union, &all);
    // The tree itself, of some 2 MiB, counts.
    for root in [flat, deep.unwrap()] {
        let small = bytes_with((tree.clone(), root), &exact(GRID), &options(5, 1));
        assert!(small == bytes_with((tree.clone(), root), &exact(GRID), &options(64, 2)));
    }
}

#[test]
fn solids_without_bounds_need_the_grid_in_full() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a.oct");
    let side = CsgOptions { grid: Some(GridChoice::Side { voxels: 30, margin: 1 }), unit_mm: 1.0 };
    let fault = |text: &str| match build_to(parsed(text), &side, &options(16, 1), &file) {
        Err(refused) => refused.to_string(),
        other => panic!("{text}: {other:?}"),
    };
    let unbounded = "is not bounded, so that no grid can be put around it";
    assert!(fault("complement() { sphere(r = 3); }").contains(unbounded));
    assert!(fault("halfspace([0, 0, 1]);").contains(unbounded));
    assert!(
        fault("intersection() { sphere(r = 3); halfspace([0, 0, 1], -9); }").contains("has nothing inside")
    );
    // A half-space across an axis bounds what it cuts.
    let cut = parsed("difference() { sphere(r = 10); halfspace([0, 0, 1], 5); }");
    build_to(cut, &side, &options(16, 1), &file).unwrap();
    assert_eq!(Model::open(&file).unwrap().dims().to_array(), [30, 30, 9]);
}

#[test]
fn prisms_and_polyhedra_are_what_their_faces_enclose() {
    // A frame with a hole, whose outline is not convex, as one polygon with paths and as a difference.
    let frame =
        "linear_extrude(height = 20.3) { polygon(points = [[0,0],[30.3,0],[30.3,20.4],[15,10.2],[0,20.4],
        [3,3],[9,3],[9,8],[3,8]], paths = [[0,1,2,3,4],[5,6,7,8]], convexity = 1); }";
    let parts = "linear_extrude(height = 20.3) { difference() { polygon(points = [[0,0],[30.3,0],[30.3,20.4],[15,10.2],
        [0,20.4]], paths = undef); multmatrix([[1,0,0,3],[0,1,0,3],[0,0,1,5],[0,0,0,1]]) { square(size = [6, 5]); } } }";
    let skins = |text: &str| {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.oct");
        build_to(around(text), &exact(GRID), &options(16, 1), &file).unwrap();
        skin_of(&Model::open(&file).unwrap()).into_iter().map(|(v, _)| v).collect::<BTreeSet<_>>()
    };
    let got = skins(frame);
    assert_eq!(got, skins(parts));
    // As people write it, without braces around one module.
    let bare = parts
        .replace("3) { difference", "3) difference")
        .replace("]]) { square(size = [6, 5]); } } }", "]]) square(size = [6, 5]); }");
    assert_ne!(bare.len(), parts.len());
    assert_eq!(got, skins(&bare));
    let side =
        |p: [f64; 2], a: [f64; 2], b: [f64; 2]| (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]);
    let want = skin(
        |p| {
            let [x, y, z] = [p[0] / STEPS - 30.3, p[1] / STEPS - 22.2, p[2] / STEPS - 25.1];
            let notch = side([x, y], [30.3, 20.4], [15.0, 10.2]) > 0.0 && x > 15.0
                || side([x, y], [15.0, 10.2], [0.0, 20.4]) > 0.0 && x <= 15.0;
            let hole = x > 3.0 && x < 9.0 && y > 3.0 && y < 8.0;
            (0.0..30.3).contains(&x) && y > 0.0 && (0.0..20.3).contains(&z) && notch && !hole
        },
        GRID,
    );
    assert_eq!(got, want);
    let corner = "polyhedron(points = [[0,0,0],[20.3,0,0],[0,17.7,0],[0,0,15.1]],
        faces = [[0,1,2],[0,3,1],[1,3,2],[0,2,3]], convexity = 1);";
    let want = skin(
        |p| {
            let [x, y, z] = [p[0] / STEPS - 30.3, p[1] / STEPS - 22.2, p[2] / STEPS - 25.1];
            x > 0.0 && y > 0.0 && z > 0.0 && x / 20.3 + y / 17.7 + z / 15.1 < 1.0
        },
        GRID,
    );
    assert_eq!(skins(corner), want);
    // Facets lie within the sphere that they stand for.
    let (facets, smooth) = (skins("sphere($fn = 24, r = 12.3);"), skins("sphere($fn = 0, r = 12.3);"));
    assert!(facets != smooth && facets.len().abs_diff(smooth.len()) < smooth.len() / 20);
    let faces = Faces { points: vec![[0.0; 3]], triangles: vec![[0, 1, 2]], odd: false };
    let mut tree = Tree::new();
    let root = tree.leaf(Shape::Faces(faces));
    let folder = tempfile::tempdir().unwrap();
    assert!(build_to((tree, root), &exact(GRID), &options(16, 1), &folder.path().join("a.oct")).is_err());
}

#[test]
fn what_is_grown_or_shrunk_is_what_lies_within_a_distance() {
    // Shapes with their exact signed distance, below 0 inside.
    type Distance = Box<dyn Fn([f64; 3]) -> f64>;
    let of_box = |[a, b, c]: [f64; 3]| -> Distance {
        Box::new(move |p: [f64; 3]| {
            let q = [p[0].abs() - a, p[1].abs() - b, p[2].abs() - c];
            let out = q.map(|c| c.max(0.0));
            dot(out, out).sqrt() + q[0].max(q[1]).max(q[2]).min(0.0)
        })
    };
    // A convex outline around the z axis, by its corners in (radius, z), from the axis to the axis, anticlockwise.
    let around = |outline: Vec<[f64; 2]>| -> Distance {
        Box::new(move |p: [f64; 3]| {
            let (x, y) = (p[0].hypot(p[1]), p[2]);
            let (mut deepest, mut nearest) = (f64::NEG_INFINITY, f64::INFINITY);
            for pair in outline.windows(2) {
                let ([ax, ay], [bx, by]) = (pair[0], pair[1]);
                let (dx, dy) = (bx - ax, by - ay);
                let length = dx.hypot(dy);
                deepest = deepest.max(((x - ax) * dy - (y - ay) * dx) / length);
                let along = (((x - ax) * dx + (y - ay) * dy) / length.powi(2)).clamp(0.0, 1.0);
                nearest = nearest.min((x - ax - along * dx).hypot(y - ay - along * dy));
            }
            if deepest > 0.0 { nearest } else { deepest }
        })
    };
    let cone = |z: [f64; 2], r: [f64; 2]| around(vec![[0.0, z[0]], [r[0], z[0]], [r[1], z[1]], [0.0, z[1]]]);
    let shapes: Vec<(&str, Distance)> = vec![
        ("sphere(r = 7.3);", Box::new(|p| dot(p, p).sqrt() - 7.3)),
        ("cube(size = [9, 12, 15], center = true);", of_box([4.5, 6.0, 7.5])),
        ("scale3() cube(size = [3, 4, 5], center = true);", of_box([4.5, 6.0, 7.5])),
        ("torus(8, 3.1);", Box::new(|p: [f64; 3]| (p[0].hypot(p[1]) - 8.0).hypot(p[2]) - 3.1)),
        ("cylinder(h = 9, r = 5.2);", cone([0.0, 9.0], [5.2; 2])),
        ("cylinder(h = 8, r1 = 7, r2 = 2.4);", cone([0.0, 8.0], [7.0, 2.4])),
        ("cylinder(h = 4, r1 = 0, r2 = 9);", cone([0.0, 4.0], [0.0, 9.0])),
        ("cylinder(h = 9, r1 = 1.1, r2 = 4);", cone([0.0, 9.0], [1.1, 4.0])),
        (
            "intersection() { sphere(r = 90); halfspace([1, 2, -3], 2); cube(size = 18, center = true); }",
            Box::new(move |p| {
                let plane = dot(p, [1.0, 2.0, -3.0]) / 14.0_f64.sqrt() - 2.0;
                plane.max(of_box([9.0; 3])(p))
            }),
        ),
    ];
    let turned = "[[0.36,0.48,-0.8,18.3],[-0.8,0.6,0,19.1],[0.48,0.64,0.6,20.7],[0,0,0,1]]";
    let turn = |p: [f64; 3]| {
        let d = sub(p, [18.3, 19.1, 20.7]);
        [[0.36, -0.8, 0.48], [0.48, 0.6, 0.64], [-0.8, 0.0, 0.6]].map(|row| dot(row, d))
    };
    for (text, distance) in &shapes {
        let text = text.replace("scale3()", "multmatrix([[3,0,0,0],[0,3,0,0],[0,0,3,0],[0,0,0,1]])");
        for by in [2.3, -1.2] {
            if by > 0.0 && text.starts_with("intersection") {
                continue;
            }
            let tree = parsed(&format!("multmatrix({turned}) {{ offset3d(r = {by}) {{ {text} }} }}"));
            let folder = tempfile::tempdir().unwrap();
            let file = folder.path().join("a.oct");
            build_to(tree, &exact([40; 3]), &options(16, 2), &file).unwrap();
            let skin: BTreeSet<[u32; 3]> =
                skin_of(&Model::open(&file).unwrap()).into_iter().map(|(voxel, _)| voxel).collect();
            let depth = |voxel: [i64; 3]| distance(turn(voxel.map(|c| c as f64 + 0.5))) - by;
            let (mut sure, mut wrong) = (0, 0);
            for at in 0..40_i64.pow(3) {
                let voxel = [at % 40, at / 40 % 40, at / 1600];
                let beside = (0..6).map(|k| {
                    let mut other = voxel;
                    other[k / 2] += if k % 2 == 0 { 1 } else { -1 };
                    depth(other)
                });
                let all: Vec<f64> = beside.chain([depth(voxel)]).collect();
                // What the lattice may move across the surface says nothing.
                if all.iter().any(|d| d.abs() < 2e-3) {
                    continue;
                }
                let is_skin = depth(voxel) < 0.0 && all.iter().any(|d| *d > 0.0);
                sure += usize::from(is_skin);
                wrong += usize::from(is_skin != skin.contains(&voxel.map(|c| c as u32)));
            }
            assert!(wrong == 0 && sure > 10, "{text} by {by}: {wrong} wrong, {sure} right");
        }
    }
}

#[test]
fn what_cannot_be_grown_or_shrunk_exactly_is_refused_by_name_and_line() {
    let refused = |text: &str| match parse_tree(text.as_bytes(), Path::new("")) {
        Err(refused) => refused.to_string(),
        other => panic!("{text}: {other:?}"),
    };
    let stretched = "multmatrix([[2,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]])";
    for (text, fault) in [
        (format!("offset3d(1) {stretched}\n sphere(3);"), "an ellipsoid"),
        (format!("offset3d(1) {stretched}\n cylinder(3);"), "a solid that is stretched or sheared"),
        ("offset3d(1) \n cylinder($fn = 6, h = 3);".into(), "a solid of facets"),
        ("offset3d(1) \n mesh(\"a.stl\");".into(), "a mesh"),
        ("offset3d(1) \n volume(\"a.nrrd\", 3);".into(), "a volume"),
        (
            "\noffset3d(1) difference() { cube(3); sphere(1); }".into(),
            "an intersection, difference or complement of several parts",
        ),
        ("\noffset3d(-1) { cube(3); sphere(1); }".into(), "a union of several parts to shrink it"),
        ("offset3d(99) \n cylinder(r = 2);".into(), "a rim that would become wider"),
    ] {
        let expected = format!("line 2: offset3d does not take {fault}");
        assert!(refused(&text).starts_with(&expected), "{text}: {}", refused(&text));
    }
    let refused = refused("offset3d(r = nan) cube(3);");
    assert!(["makes no sense", "a size is below 0"].iter().any(|told| refused.contains(told)), "{refused}");
    // Shrunk away, and grown again and again: more than there is room for.
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a.oct");
    let gone = build_to(parsed("offset3d(-2) cube(3);"), &exact([9; 3]), &options(16, 1), &file);
    assert!(gone.unwrap_err().to_string().contains("no voxel is inside"));
    std::fs::write(folder.path().join("a.csg"), "offset3d(1) ".repeat(9) + "cube(3);").unwrap();
    let memory = MemoryCap::Process(16 << 20);
    let refused = infobyte::csg::read_tree(&folder.path().join("a.csg"), memory);
    assert_eq!(refused.err().map(|error| error.kind()), Some(ExitKind::Budget));
    // A shell: its inside is empty.
    let shell = parsed(
        "multmatrix([[1,0,0,20],[0,1,0,20],[0,0,1,20],[0,0,0,1]]) difference() { offset3d(2) sphere(9); sphere(9); }",
    );
    build_to(shell, &exact([40; 3]), &options(16, 1), &file).unwrap();
    for (voxel, _) in skin_of(&Model::open(&file).unwrap()) {
        let d = voxel.map(|c| f64::from(c) + 0.5 - 20.0);
        assert!((9.0..11.01).contains(&dot(d, d).sqrt()));
    }
}
