//! The promise: the traversal's first hit is the exact one. If this file fails, pictures differ between
//! machines, rays slip between touching voxels, or a ray never returns.
//!
//! Every ray is compared with a walk over plain bits in exact rationals that knows no octree, and that walk with the
//! intersection of the ray with every skin voxel, by the oracle of `oracle`. The rays that others stumbled over are in
//! `hard_cases`.

use crate::common::scenes as support;
use crate::hard_cases::rays::hard_scenes;
use crate::prelude::*;
use crate::{cells, larger_leaves};

use infobyte::render::ray::Face;
use infobyte::render::selfcheck::{Random, mismatches, tile_mismatches};

/// Volumes of every kind that traversals were seen to fail on.
fn scenes() -> Vec<Scene> {
    let mut scenes = vec![
        Scene::skin("ball 64", [64; 3], |c| in_ball(c, 64)),
        Scene::skin("ball 128", [128; 3], |c| in_ball(c, 128)),
        Scene::skin("torus 128", [128; 3], |c| in_torus(c, 128)),
        Scene::skin("gyroid 64", [64; 3], |c| in_gyroid(c, 64)),
        noise("noise 0.1 %", [64; 3], 0.001, 1),
        noise("noise 1 %", [64; 3], 0.01, 2),
        noise("noise 10 %", [32; 3], 0.1, 3),
        noise("noise in 37x5x64", [37, 5, 64], 0.03, 4),
        Scene::skin("full box 37x5x64", [37, 5, 64], |_| true),
        Scene::set("comb", [32; 3], |[x, y, z]| (x % 2 == 0 && z < 31) || (z == 31 && y == 5)),
        Scene::set("1x1x1", [1; 3], |_| true),
        Scene::set("1x1x9", [1, 1, 9], |[_, _, z]| z % 4 == 3),
        Scene::set("empty", [32; 3], |_| false),
    ];
    scenes.extend(hard_scenes());
    for corner in 0..8_u32 {
        let at: [u32; 3] = std::array::from_fn(|a| (corner >> a & 1) * 31);
        scenes.push(Scene::new(format!("one voxel in corner {corner}"), [32; 3], vec![at]));
    }
    for (i, a) in [
        [1.0, 0.0, 0.0],
        [1.0, 1.0, 0.0],
        [1.0, 1.0, 1.0],
        [1.0, 0.3, -0.2],
        [-0.1, 0.05, 1.0],
        [2.0, 1.0, 0.0],
    ]
    .into_iter()
    .enumerate()
    {
        scenes.push(plane(format!("plane {i}"), 64, a));
    }
    for depth in 0..=7_u32 {
        let n = 1 << depth;
        scenes.push(noise(&format!("depth {depth}"), [n; 3], 2.0 / f64::from(n), u64::from(depth) + 50));
    }
    scenes
}

/// The sealed hit of a ray, which every form of the traversal must have, too.
pub(crate) fn sealed_hit(tree: &MemoryTree, ray: &Ray, lod_edge_log2: u32) -> Option<Hit> {
    let want = first_hit_sealed(tree, ray, lod_edge_log2).hit;
    for form in Form::available() {
        assert_eq!(
            single::trace(form, &tree.view(), &Skin, ray, lod_edge_log2).hit,
            want,
            "{form:?} {ray:?}"
        );
    }
    want
}

/// The first of some cells, by looking at every one, and the face by which the ray enters it.
fn first_of(ray: &Ray, cells: &[[u32; 3]]) -> Option<([u32; 3], Option<Face>)> {
    let hit = ExactRay::of_fixed(ray).first_of(cells.iter().copied())?;
    let face = |axis: usize| Face::new(axis, ray.direction()[axis] < 0);
    Some((hit.cell, hit.axis.map(face).or(ray.entry())))
}

/// Rays alone, in batches, for any hit, and in tiles, by every instruction set, against the reference.
fn conforms(name: &str, view: &ModelView<'_>, bits: &BitVolume, seed: u64) -> Mismatches {
    let times = u64::from(long());
    let counts =
        mismatches(view, bits, 15_000 * times, seed).plus(tile_mismatches(view, 12_500 * times, seed));
    assert_eq!(counts.total(), 0, "{name} (seed {seed}): {counts:?}");
    counts
}

fn model_conforms(name: &str, model: &Model) {
    let mut bits = BitVolume::new(model.depth()).unwrap();
    finest(model).iter().for_each(|(cell, _)| bits.set(*cell));
    let counts = conforms(name, &model.view(), &bits, 1);
    assert!(counts.cell_hits > counts.rays / 100, "{name}: {counts:?}");
}

#[test]
fn every_entry_and_instruction_set_hits_the_voxels_of_the_reference() {
    let mut all = Mismatches::default();
    for (i, scene) in scenes().iter().enumerate() {
        all = all.plus(conforms(&scene.name, &scene.tree.view(), &scene.bits, 1000 + i as u64));
    }
    println!("{all:?}");
    assert!(all.rays >= 500_000 && all.hits > all.rays / 5 && all.tile_rays > 500_000, "{all:?}");
}

#[test]
fn every_entry_and_instruction_set_hits_the_cells_of_the_reference() {
    let folder = tempfile::tempdir().unwrap();
    for (name, voxels) in [
        ("ball", cells::ball(50, 9)),
        ("noise", cells::noise([24; 3], 10)),
        ("flat noise", cells::noise([5, 30, 9], 7)),
        ("one sample", Voxels::from_fn(Dims::new(1, 1, 1).unwrap(), |_| 200)),
    ] {
        model_conforms(name, &cells::built(folder.path(), &voxels, SurfaceKind::Cells));
    }
}

#[test]
fn every_entry_and_instruction_set_hits_the_larger_leaves_of_the_reference() {
    let folder = tempfile::tempdir().unwrap();
    for (name, voxels) in &larger_leaves::bodies(58) {
        for error in [0.1, 0.5] {
            let model = larger_leaves::built(&folder.path().join("m"), voxels, error, 64, 2);
            model_conforms(name, &model);
        }
    }
}

#[test]
fn walk_and_oracle_are_of_one_opinion() {
    let scenes = [
        noise("noise 1 %", [16; 3], 0.01, 7),
        noise("noise 10 %", [16; 3], 0.1, 8),
        Scene::skin("ball 16", [16; 3], |c| in_ball(c, 16)),
        Scene::set("checkerboard 8", [8; 3], |[x, y, z]| (x + y + z) % 2 == 0),
    ];
    let mut random = Random::new(11);
    let (mut rays, mut hits) = (0, 0);
    for scene in &scenes {
        for _ in 0..400 * long() {
            let Some(ray) = random_ray(&mut random, scene.tree.depth()) else { continue };
            let walked = reference::walk(&scene.bits, &ray, false, |_| {}).map(|hit| (hit.cell, hit.face));
            let truth = first_of(&ray, &scene.cells);
            assert_eq!(walked, truth, "{} {ray:?}", scene.name);
            rays += 1;
            hits += u32::from(truth.is_some());
        }
    }
    assert!(rays > 800 && hits > 200, "{rays} rays, {hits} hits");
}

#[test]
fn rays_that_are_no_rays_are_refused() {
    let o = [1.0; 3];
    assert_eq!(Ray::new(4, o, [0.0, -0.0, 0.0], 0.0), Err(BadRay::NoDirection));
    assert_eq!(Ray::new(4, o, [f64::NAN, 1.0, 0.0], 0.0), Err(BadRay::NotFinite));
    assert_eq!(Ray::new(4, [f64::INFINITY, 1.0, 0.0], o, 0.0), Err(BadRay::NotFinite));
}

/// Rays from outside to a point inside that meet no skin on their way.
fn passes(scene: &Scene, inside: impl Fn([u32; 3]) -> bool, rays: u32, seed: u64) -> u32 {
    let side = f64::from(1_u32 << scene.tree.depth());
    let goals: Vec<[u32; 3]> =
        support::all_cells(scene.dims.to_array()).filter(|c| inside(*c) && !scene.bits.get(*c)).collect();
    assert!(!goals.is_empty(), "{} has no inside", scene.name);
    let mut random = Random::new(seed);
    let mut passed = 0;
    for i in 0..rays {
        let goal = goals[usize::try_from(random.bits()).unwrap() % goals.len()].map(|c| f64::from(c) + 0.5);
        let mut origin = [0.0; 3].map(|_: f64| random.range(-side, 2.0 * side));
        origin[i as usize % 3] = if i % 2 == 0 { -1.0 - random.unit() } else { side + 1.0 + random.unit() };
        let on_lattice = i % 4 == 0;
        if on_lattice {
            // Towards a voxel's centre along whole-number slopes: through edges and corners.
            let slope = [0.0; 3].map(|_: f64| random.range(-3.0, 3.0).round());
            let far = if slope == [0.0; 3] { [2.0 * side, 0.0, 0.0] } else { slope.map(|s| s * side) };
            origin = std::array::from_fn(|a| goal[a] + far[a]);
        }
        let direction = std::array::from_fn(|a| goal[a] - origin[a]);
        let ray = Ray::new(scene.tree.depth(), origin, direction, 0.0).unwrap().expect("aims at the grid");
        // Exactly tied rays are the sealed walk's affair; on all others both must stop.
        let stops = |hit: Option<Hit>| hit.is_some_and(|hit| hit.t < 1.0);
        let sealed = stops(sealed_hit(&scene.tree, &ray, 0));
        passed += u32::from(!sealed || (!on_lattice && !stops(first_hit(&scene.tree, &ray, 0).hit)));
    }
    passed
}

#[test]
fn closed_thin_skins_have_no_tunnels_and_a_holed_one_is_caught() {
    let ball = |c| in_ball(c, 64);
    let torus = |c| in_torus(c, 64);
    let gyroid = |c| in_gyroid(c, 64);
    assert_eq!(passes(&Scene::skin("ball", [64; 3], ball), ball, 200_000, 1), 0);
    assert_eq!(passes(&Scene::skin("torus", [64; 3], torus), torus, 200_000, 2), 0);
    assert_eq!(passes(&Scene::skin("gyroid", [64; 3], gyroid), gyroid, 200_000, 3), 0);
    let mut random = Random::new(4);
    for i in 0..300 * u64::from(long()) {
        let a = [0.0; 3].map(|_: f64| random.range(-1.0, 1.0));
        let length = a.iter().map(|v| v * v).sum::<f64>().sqrt();
        let slab = |c: [u32; 3]| {
            let at: f64 = (0..3).map(|k| a[k] / length * (f64::from(c[k]) - 15.5)).sum();
            at.abs() < 4.0
        };
        assert_eq!(passes(&Scene::skin("slab", [32; 3], slab), slab, 400, i), 0, "slab {a:?}");
    }
    // Every second voxel of the skin missing: still 18-connected, but 6-connected paths cross it.
    let whole = Scene::skin("ball", [64; 3], ball);
    let half = whole.cells.into_iter().filter(|[x, y, z]| (x + y + z) % 2 == 0).collect();
    let holed = Scene::new("holed ball", [64; 3], half);
    assert!(passes(&holed, ball, 20_000, 5) > 1_000, "the tunnel test does not see holes");
}

#[test]
fn an_edge_between_two_voxels_is_open_by_definition_and_sealed_for_pictures() {
    // Looking down z: a ray from (2, 2) along (1, 1) between voxels (3, 2) and (2, 3), touching both.
    let scene = Scene::new("two voxels", [8; 3], vec![[3, 2, 4], [2, 3, 4]]);
    let ray = Ray::new(3, [2.0, 2.0, 4.5], [1.0, 1.0, 0.0], 0.0).unwrap().unwrap();
    assert_eq!(first_hit(&scene.tree, &ray, 0).hit, None);
    let hit = sealed_hit(&scene.tree, &ray, 0).unwrap();
    assert_eq!((hit.cell, hit.t), ([3, 2, 4], 1.0));
    // One unit of 2^-16 beside the edge both definitions agree.
    let ray = Ray::new(3, [2.0, 2.0 + 1.0 / 65536.0, 4.5], [1.0, 1.0, 0.0], 0.0).unwrap().unwrap();
    assert_eq!(first_hit(&scene.tree, &ray, 0), first_hit_sealed(&scene.tree, &ray, 0));
    assert_eq!(first_hit(&scene.tree, &ray, 0).hit.map(|h| h.cell), Some([2, 3, 4]));
}

#[test]
fn level_of_detail_stops_at_the_first_non_empty_node() {
    let scene = Scene::skin("torus", [64; 3], |c| in_torus(c, 64));
    let empty = BitVolume::new(6).unwrap();
    for k in 0..=6_u32 {
        let parents: std::collections::HashSet<[u32; 3]> =
            scene.cells.iter().map(|c| c.map(|v| v >> k)).collect();
        let mut random = Random::new(u64::from(k));
        for _ in 0..5_000 {
            let Some(ray) = random_ray(&mut random, 6) else { continue };
            let mut first = None;
            reference::walk(&empty, &ray, false, |cell| {
                let parent = cell.map(|v| v >> k);
                if first.is_none() && parents.contains(&parent) {
                    first = Some(parent);
                }
            });
            let hit = first_hit(&scene.tree, &ray, k).hit;
            sealed_hit(&scene.tree, &ray, k);
            assert_eq!(hit.map(|h| h.cell.map(|v| v >> k)), first, "{k} {ray:?}");
            assert!(hit.is_none_or(|h| h.edge_log2 == k && h.voxel(&scene.tree).is_some() == (k == 0)));
        }
    }
}

#[test]
fn damaged_trees_neither_panic_nor_hold_a_ray() {
    let mut random = Random::new(9);
    for seed in 0..1_000 {
        let garbage = Garbage::new(seed);
        let view = garbage.view(u32::MAX);
        for depth in [0, 1, 5, 9, 16] {
            if let Some(ray) = random_ray(&mut random, depth) {
                assert!(first_hit(&view, &ray, 0).steps <= step_limit(depth));
                for form in Form::available() {
                    let _ = single::trace(form, &view, &Skin, &ray, 0);
                }
            }
        }
    }
}

#[test]
fn the_deepest_grid_is_walked_exactly() {
    // 65536 cells a side have no plain bits; a few voxels can be looked at one by one.
    let mut random = Random::new(31);
    let cells: Vec<[u32; 3]> =
        (0..300).map(|_| [0; 3].map(|_| 32_700 + u32::try_from(random.bits() % 64).unwrap())).collect();
    let dims = Dims::new(65_536, 65_536, 65_536).unwrap();
    let codes: Vec<u64> = cells.iter().map(|c| infobyte::geom::morton::encode(c[0], c[1], c[2])).collect();
    let tree = MemoryTree::new(dims, &codes).unwrap();
    let mut hits = 0;
    for i in 0..1000 * long() as usize {
        let goal = cells[i % cells.len()].map(f64::from);
        let goal = goal.map(|v| v + if i % 3 == 0 { 0.5 } else { random.unit() });
        let mut origin = [0.0; 3].map(|_: f64| random.range(-1e5, 2e5));
        if i % 5 == 0 {
            origin = goal.map(|v| v + if random.bits() & 1 == 0 { 30_000.0 } else { -30_000.0 });
        }
        let direction = std::array::from_fn(|a| goal[a] - origin[a]);
        let Some(ray) = Ray::new(16, origin, direction, 0.0).unwrap() else { continue };
        let trace = first_hit(&tree, &ray, 0);
        sealed_hit(&tree, &ray, 0);
        let want = first_of(&ray, &cells);
        assert_eq!(trace.hit.map(|h| (h.cell, h.face)), want, "{ray:?}");
        hits += u32::from(want.is_some());
    }
    assert!(hits > 600 * long(), "{hits}");
}
