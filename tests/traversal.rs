//! The promise: the traversal's first hit is the exact one. If this file fails, pictures differ between
//! machines, rays slip between touching voxels, or a ray never returns.
//!
//! Every ray is compared with a walk over plain bits in exact rationals that knows no octree; small volumes
//! also with the intersection of the ray with every skin voxel.

#[path = "support/scenes.rs"]
mod support;

use infobyte::geom::{BoxIndex, Dims, NodeIndex, VoxelIndex};
use infobyte::load::{MemoryTree, NodeView};
use infobyte::render::form::Form;
use infobyte::render::ray::{BadRay, Ray};
use infobyte::render::reference::{self, BitVolume};
use infobyte::render::selfcheck::{Mismatches, Random, mismatches, random_ray};
use infobyte::render::single;
use infobyte::render::surface::Skin;
use infobyte::render::traverse::{Hit, first_hit, first_hit_sealed, step_limit};
use support::{Scene, Symmetry, in_ball, in_gyroid, in_torus, noise, plane};

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
        Scene::set("checkerboard", [16; 3], |[x, y, z]| (x + y + z) % 2 == 0),
        Scene::set("full solid", [16; 3], |_| true),
        Scene::skin("full box 37x5x64", [37, 5, 64], |_| true),
        Scene::set("comb", [32; 3], |[x, y, z]| (x % 2 == 0 && z < 31) || (z == 31 && y == 5)),
        Scene::set("1x1x1", [1; 3], |_| true),
        Scene::set("1x1x9", [1, 1, 9], |[_, _, z]| z % 4 == 3),
        Scene::set("empty", [32; 3], |_| false),
    ];
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
fn sealed_hit<V: NodeView>(view: &V, ray: &Ray, lod_edge_log2: u32) -> Option<Hit> {
    let want = first_hit_sealed(view, ray, lod_edge_log2).hit;
    for form in Form::available() {
        assert_eq!(single::trace(form, view, &Skin, ray, lod_edge_log2).hit, want, "{form:?} {ray:?}");
    }
    want
}

/// Rays per scene from the environment, for longer runs than a test should take.
fn rays_asked() -> Option<u64> {
    std::env::var("INFOBYTE_RAYS").ok().map(|n| n.parse().expect("INFOBYTE_RAYS is a number of rays"))
}

#[test]
fn a_million_random_rays_hit_what_the_reference_hits() {
    let rays_each = rays_asked().unwrap_or(30_000);
    let mut all = Mismatches::default();
    for (i, scene) in scenes().iter().enumerate() {
        let seed = 1000 + i as u64;
        let counts = mismatches(&scene.tree, &scene.bits, rays_each, seed);
        assert_eq!(counts.total(), 0, "{} (seed {seed}): {counts:?}", scene.name);
        all = all.plus(counts);
    }
    println!("{all:?}");
    assert!(all.rays >= 1_000_000 && all.hits > all.rays / 5, "too few rays or hits: {all:?}");
}

#[test]
fn parallel_bundles_hit_what_the_reference_hits() {
    let scenes = [
        Scene::skin("torus 64", [64; 3], |c| in_torus(c, 64)),
        plane("plane".into(), 64, [1.0, 1.0, 0.0]),
        Scene::set("checkerboard", [16; 3], |[x, y, z]| (x + y + z) % 2 == 0),
    ];
    let mut counts = Mismatches::default();
    for scene in &scenes {
        let side = f64::from(1_u32 << scene.tree.depth());
        for direction in [
            [1.0, 0.0, 0.0],
            [0.0, -1.0, 0.0],
            [0.0, 0.0, 1.0],
            [1.0, 1.0, 0.0],
            [-1.0, 0.0, 1.0],
            [1.0, -1.0, 1.0],
            [2.0, 1.0, -1.0],
            [0.3, -0.7, 0.1],
        ] {
            // A lattice of origins in half cells, so that half of the rays run along edges and corners.
            for i in 0..80 {
                for j in 0..80 {
                    let (u, v) = (f64::from(i) * side / 80.0, f64::from(j) * side / 80.0);
                    let at: [f64; 3] = [u, v, side / 2.0];
                    let origin = std::array::from_fn(|a| {
                        at[(a + i as usize) % 3] - 2.0 * side * direction[a] * f64::from(i % 2)
                    });
                    if let Some(ray) = Ray::new(scene.tree.depth(), origin, direction, 0.0).unwrap() {
                        counts.compare(&scene.tree, &scene.bits, &ray);
                    }
                }
            }
        }
    }
    assert_eq!(counts.total(), 0, "{counts:?}");
    assert!(counts.hits > 40_000, "{counts:?}");
}

#[test]
fn walk_and_slabs_are_of_one_opinion() {
    let scenes = [
        noise("noise 1 %", [16; 3], 0.01, 7),
        noise("noise 10 %", [16; 3], 0.1, 8),
        Scene::skin("ball 16", [16; 3], |c| in_ball(c, 16)),
        Scene::set("checkerboard 8", [8; 3], |[x, y, z]| (x + y + z) % 2 == 0),
    ];
    let mut random = Random::new(11);
    let (mut rays, mut hits) = (0, 0);
    for scene in &scenes {
        for _ in 0..20_000 {
            let Some(ray) = random_ray(&mut random, scene.tree.depth()) else { continue };
            let walked = reference::walk(&scene.bits, &ray, false, |_| {});
            let slabs = reference::nearest_by_slabs(scene.cells.iter().copied(), &ray);
            assert_eq!(walked, slabs, "{} {ray:?}", scene.name);
            rays += 1;
            hits += u32::from(slabs.is_some());
        }
    }
    assert!(rays > 40_000 && hits > 10_000, "{rays} rays, {hits} hits");
}

/// One hard ray in a grid of 16 cells a side, and the voxel that it must hit first when all are skin.
struct Hard {
    name: &'static str,
    origin: [f64; 3],
    direction: [f64; 3],
    t_min: f64,
    /// First voxel on the ray; `None` when the ray visits none.
    first: Option<[u32; 3]>,
}

const fn hard(name: &'static str, origin: [f64; 3], direction: [f64; 3], first: Option<[u32; 3]>) -> Hard {
    Hard { name, origin, direction, t_min: 0.0, first }
}

/// The list of bugs that others shipped, and its additions.
const HARD: &[Hard] = &[
    hard("zero components", [-3.0, 4.5, 7.5], [1.0, 0.0, 0.0], Some([0, 4, 7])),
    hard("negative zero components", [-3.0, 4.5, 7.5], [1.0, -0.0, -0.0], Some([0, 4, 7])),
    hard("negative zero origin", [-0.0, -0.0, -0.0], [1.0, 2.0, 3.0], Some([0, 0, 0])),
    hard("along a grid edge", [-3.0, 4.0, 7.0], [1.0, 0.0, 0.0], Some([0, 4, 7])),
    hard("along a grid edge with negative zeros", [-3.0, 4.0, 7.0], [1.0, -0.0, -0.0], Some([0, 4, 7])),
    hard("along the grid's own lowest edge", [-3.0, 0.0, 0.0], [1.0, 0.0, 0.0], Some([0, 0, 0])),
    hard("along the grid's own highest edge", [-3.0, 16.0, 16.0], [1.0, 0.0, 0.0], None),
    hard("axis-parallel through a node face", [8.0, -4.0, 8.5], [0.0, 1.0, 0.0], Some([8, 0, 8])),
    hard("starts on a corner", [4.0, 4.0, 4.0], [1.0, 1.0, 1.0], Some([4, 4, 4])),
    hard("starts on a corner, backwards", [4.0, 4.0, 4.0], [-1.0, -1.0, -1.0], Some([3, 3, 3])),
    hard("starts on a corner, mixed signs", [4.0, 4.0, 4.0], [1.0, -2.0, 0.0], Some([4, 3, 4])),
    hard("starts a hair off a corner", [4.0 + 1e-9, 4.0, 4.0 - 1e-9], [1.0, 1.0, 1.0], Some([4, 4, 4])),
    hard("enters by a corner", [-2.0, -2.0, -2.0], [1.0, 1.0, 1.0], Some([0, 0, 0])),
    hard("leaves by a corner", [14.5, 14.5, 14.5], [1.0, 1.0, 1.0], Some([14, 14, 14])),
    hard("touches a corner only", [-1.0, 1.0, 8.5], [1.0, -1.0, 0.0], None),
    hard("touches an edge from outside", [15.0, 17.0, 8.5], [1.0, -1.0, 0.0], None),
    hard("starts on the last corner, outwards", [16.0, 16.0, 16.0], [1.0, 1.0, 1.0], None),
    hard("starts on the last corner, inwards", [16.0, 16.0, 16.0], [-1.0, -1.0, -1.0], Some([15, 15, 15])),
    hard("negative coordinates", [-5.5, -7.25, -3.0], [7.0, 9.0, 5.0], Some([0, 0, 1])),
    hard("two crossings at once", [-1.0, 3.0, 2.5], [1.0, 1.0, 0.0], Some([0, 4, 2])),
    hard("three crossings at once", [2.0, 3.0, 4.0], [1.0, 1.0, 1.0], Some([2, 3, 4])),
    hard("three crossings at once, mixed signs", [2.0, 13.0, 4.0], [1.0, -1.0, 1.0], Some([2, 12, 4])),
    hard("slope exactly 1", [0.5, 0.5, 8.5], [1.0, 1.0, 0.0], Some([0, 0, 8])),
    hard("slope exactly -1", [0.5, 15.5, 8.5], [1.0, -1.0, 0.0], Some([0, 15, 8])),
    hard("slopes of small whole numbers", [0.0, 0.0, 0.0], [3.0, 2.0, 1.0], Some([0, 0, 0])),
    hard("grazes the low x face", [0.0, -2.0, 3.5], [0.0, 1.0, 0.0], Some([0, 0, 3])),
    hard("grazes the high x face", [16.0, -2.0, 3.5], [0.0, 1.0, 0.0], None),
    hard("grazes the low y face", [3.5, 0.0, -2.0], [0.0, 0.0, 1.0], Some([3, 0, 0])),
    hard("grazes the high y face", [3.5, 16.0, -2.0], [0.0, 0.0, 1.0], None),
    hard("grazes the low z face", [-2.0, 3.5, 0.0], [1.0, 0.0, 0.0], Some([0, 3, 0])),
    hard("grazes the high z face", [-2.0, 3.5, 16.0], [1.0, 0.0, 0.0], None),
    hard("just inside a face", [-2.0, 3.5, 16.0 - 1.0 / 65536.0], [1.0, 0.0, 0.0], Some([0, 3, 15])),
    hard("just outside a face", [-2.0, 3.5, 16.0 + 1.0 / 65536.0], [1.0, 0.0, 0.0], None),
    hard("in the plane between two voxels", [-2.0, 5.0, 3.25], [1.0, 0.0, 0.125], Some([0, 5, 3])),
    hard("in the plane between two bricks", [-2.0, 8.0, 3.25], [1.0, 0.0, -0.0625], Some([0, 8, 3])),
    hard("a component of 1e-38", [-2.0, 5.0, 3.5], [1.0, 1e-38, -1e-38], Some([0, 5, 3])),
    hard("a denormal component", [-2.0, 5.5, 3.5], [1.0, 5e-324, -5e-324], Some([0, 5, 3])),
    hard("a direction of denormals", [-2.0, 5.5, 3.5], [5e-324, 0.0, 0.0], Some([0, 5, 3])),
    hard("a direction of 1e-12", [-2.0, 5.5, 3.5], [4e-12, 1e-12, 0.0], Some([0, 6, 3])),
    hard("a direction of 1e12", [-2.0, 5.5, 3.5], [4e12, 1e12, 0.0], Some([0, 6, 3])),
    hard("nearly along an axis", [-2.0, 8.0, 8.0], [1.0, 1e-4, -1e-4], Some([0, 8, 7])),
    hard(
        "a long shallow ray to the last voxel",
        [0.0, 15.0, 15.0],
        [16.0, 0.9999, 0.9999],
        Some([0, 15, 15]),
    ),
    hard("camera 1e7 voxels away", [-1e7, 5.5, 3.5], [1.0, 0.0, 0.0], Some([0, 5, 3])),
    hard("camera 1e7 voxels away, diagonal", [1e7, 1e7, 1e7], [-1.0, -1.0, -1.0], Some([15, 15, 15])),
    hard("reversed at a tile boundary", [8.0, 8.5, 8.5], [-1.0, 0.0, 0.0], Some([7, 8, 8])),
    hard("reversed, on all tile boundaries", [8.0, 8.0, 8.0], [-1.0, -1.0, -0.5], Some([7, 7, 7])),
    hard("origin in a voxel", [5.25, 6.5, 7.75], [-0.25, 1.0, 0.5], Some([5, 6, 7])),
    hard("origin at zero, along x", [0.0, 0.0, 0.0], [1.0, 0.0, 0.0], Some([0, 0, 0])),
    hard("leaves at once", [0.0, 5.5, 5.5], [-1.0, 0.0, 0.0], None),
    hard("first voxel of the grid", [-1.0, 0.5, 0.5], [1.0, 0.0, 0.0], Some([0, 0, 0])),
    hard("last voxel of the grid", [17.0, 15.5, 15.5], [-1.0, 0.0, 0.0], Some([15, 15, 15])),
    hard("behind the grid", [20.0, 5.5, 5.5], [1.0, 0.0, 0.0], None),
    hard("beside the grid", [-3.0, 17.0, 5.5], [1.0, 0.5, 0.0], None),
    Hard {
        name: "t_min within a voxel",
        origin: [-3.0, 5.5, 5.5],
        direction: [1.0, 0.0, 0.0],
        t_min: 7.5,
        first: Some([4, 5, 5]),
    },
    Hard {
        name: "t_min on a face",
        origin: [-3.0, 5.5, 5.5],
        direction: [2.0, 0.0, 0.0],
        t_min: 4.0,
        first: Some([5, 5, 5]),
    },
    Hard {
        name: "t_min on a face, backwards",
        origin: [19.0, 5.5, 5.5],
        direction: [-1.0, 0.0, 0.0],
        t_min: 7.0,
        first: Some([11, 5, 5]),
    },
    Hard {
        name: "t_min behind the grid",
        origin: [-3.0, 5.5, 5.5],
        direction: [1.0, 0.0, 0.0],
        t_min: 19.0,
        first: None,
    },
    Hard {
        name: "t_min before the grid",
        origin: [-3.0, 5.5, 5.5],
        direction: [1.0, 0.0, 0.0],
        t_min: 1.0,
        first: Some([0, 5, 5]),
    },
];

/// The scenes that hard rays are sent into; all have a grid of 16.
fn hard_scenes() -> Vec<Scene> {
    vec![
        Scene::set("full solid", [16; 3], |_| true),
        Scene::set("empty", [16; 3], |_| false),
        Scene::set("checkerboard", [16; 3], |[x, y, z]| (x + y + z) % 2 == 0),
        noise("noise 2 %", [16; 3], 0.02, 5),
        noise("noise 20 %", [16; 3], 0.2, 6),
        Scene::skin("ball", [16; 3], |c| in_ball(c, 16)),
        Scene::set("walls beside the middle", [16; 3], |c| c.contains(&7)),
        Scene::set("far corner", [16; 3], |c| c == [15; 3]),
        Scene::set("near corner", [16; 3], |c| c == [0; 3]),
        Scene::set("two voxels with a seam", [16; 3], |[x, y, z]| x == 9 && (y == 4 || y == 5) && z == 3),
        Scene::set("non-cubic dims beside padding", [16, 3, 9], |[x, y, z]| x == 15 || y == 2 || z == 8),
    ]
}

#[test]
fn hard_cases_hit_the_expected_voxel_under_all_symmetries() {
    let scenes = hard_scenes();
    let mut compared = 0;
    for symmetry in Symmetry::all() {
        let turned: Vec<Scene> = scenes
            .iter()
            .map(|s| {
                Scene::new(s.name.clone(), [16; 3], s.cells.iter().map(|c| symmetry.cell(*c, 16)).collect())
            })
            .collect();
        for case in HARD {
            let straight = Ray::new(4, case.origin, case.direction, case.t_min).unwrap();
            let turned_ray =
                Ray::new(4, symmetry.point(case.origin, 16.0), symmetry.vector(case.direction), case.t_min)
                    .unwrap();
            // A ray that runs within a plane of cells belongs to the cells above it (d = 0: floor), also
            // after a mirror: there the hit does not permute, by definition.
            let in_plane = |r: &Ray| (0..3).any(|a| r.direction()[a] == 0 && r.origin()[a] % 65536 == 0);
            let permutes = !straight.as_ref().is_some_and(in_plane) || symmetry.mirror == [false; 3];
            for (scene, turned) in scenes.iter().zip(&turned) {
                let label = format!("{} in {} under {symmetry:?}", case.name, scene.name);
                let hit = straight.and_then(|ray| first_hit(&scene.tree, &ray, 0).hit);
                let turned_hit = turned_ray.and_then(|ray| first_hit(&turned.tree, &ray, 0).hit);
                if scene.name == "full solid" {
                    assert_eq!(hit.map(|h| h.cell), case.first, "{label}");
                }
                if permutes {
                    assert_eq!(
                        turned_hit.map(|h| h.cell),
                        hit.map(|h| symmetry.cell(h.cell, 16)),
                        "{label}: the hit must turn with the scene"
                    );
                    assert_eq!(turned_hit.map(|h| h.t), hit.map(|h| h.t), "{label}");
                }
                if let Some(ray) = turned_ray {
                    let trace = first_hit(&turned.tree, &ray, 0);
                    assert!(trace.steps <= step_limit(4), "{label}");
                    let got = trace.hit.map(|h| (h.cell, h.face));
                    let walked = reference::walk(&turned.bits, &ray, false, |_| {}).map(|h| (h.cell, h.face));
                    let slabs = reference::nearest_by_slabs(turned.cells.iter().copied(), &ray)
                        .map(|h| (h.cell, h.face));
                    assert_eq!(got, walked, "{label}");
                    assert_eq!(got, slabs, "{label}");
                    let sealed = sealed_hit(&turned.tree, &ray, 0).map(|h| h.cell);
                    let want = reference::walk(&turned.bits, &ray, true, |_| {}).map(|h| h.cell);
                    assert_eq!(sealed, want, "{label}, sealed");
                    compared += 1;
                }
            }
        }
    }
    assert!(compared > 48 * 40 * scenes.len(), "{compared}");
}

#[test]
fn all_26_sign_and_tie_directions_are_exact() {
    let scenes = hard_scenes();
    let mut counts = Mismatches::default();
    for code in (0..27).filter(|code| *code != 13) {
        let direction = [code % 3 - 1, code / 3 % 3 - 1, code / 9 - 1].map(f64::from);
        for scene in &scenes {
            for at in support::all_cells([9; 3]) {
                // Lattice points inside and on the grid, and the same pushed back outside it.
                for back in [0.0, 20.0] {
                    let origin = std::array::from_fn(|a| f64::from(at[a]) * 2.0 - back * direction[a]);
                    if let Some(ray) = Ray::new(4, origin, direction, 0.0).unwrap() {
                        counts.compare(&scene.tree, &scene.bits, &ray);
                    }
                }
            }
        }
    }
    assert_eq!(counts.total(), 0, "{counts:?}");
    assert!(counts.rays > 200_000, "{counts:?}");
}

#[test]
fn quantising_a_ray_rarely_changes_its_hit_and_never_by_far() {
    // Ideal rays: origins in units of 2^-30 cell, also outside the grid, directions of 2^-40. Their exact
    // hits are compared with those of the quantised rays; traversal itself has no part in the difference.
    let scene = Scene::skin("ball", [32; 3], |c| in_ball(c, 32));
    let (unit, fine) = ((1_i64 << 30) as f64, (1_i64 << 40) as f64);
    let mut random = Random::new(77);
    let (mut rays, mut hits, mut other, mut far) = (0_u32, 0_u32, 0_u32, 0_u32);
    for _ in 0..30_000 {
        let origin = [0; 3].map(|_| (random.range(-32.0, 64.0) * unit).round() / unit);
        let goal = [0.0; 3].map(|_: f64| random.range(0.0, 32.0));
        let direction: [f64; 3] = std::array::from_fn(|a| ((goal[a] - origin[a]) * fine).round() / fine);
        #[expect(clippy::cast_possible_truncation, reason = "whole numbers")]
        let whole = |v: [f64; 3], unit: f64| v.map(|v| (v * unit) as i128);
        let ideal = reference::nearest_ideal(
            scene.cells.iter().copied(),
            whole(origin, unit),
            whole(direction, fine),
            1 << 30,
            None,
        );
        let ray = Ray::new(5, origin, direction, 0.0).unwrap();
        let hit = ray.and_then(|ray| first_hit(&scene.tree, &ray, 0).hit).map(|h| h.cell);
        rays += 1;
        hits += u32::from(hit.is_some());
        if hit != ideal.map(|h| h.cell) {
            other += 1;
            if let (Some(a), Some(b)) = (hit, ideal) {
                far += u32::from((0..3).any(|i| a[i].abs_diff(b.cell[i]) > 1));
            }
        }
    }
    println!(
        "quantised against ideal: {rays} rays, {hits} hits, {other} differ, {far} by more than a neighbour"
    );
    assert!(hits > 15_000 && other <= rays / 3_000 && far == 0, "{rays} {hits} {other} {far}");
}

#[test]
fn random_rays_turn_with_the_scene() {
    let scene = noise("noise 3 %", [32; 3], 0.03, 21);
    let mut random = Random::new(22);
    for symmetry in Symmetry::all() {
        let turned =
            Scene::new("turned", [32; 3], scene.cells.iter().map(|c| symmetry.cell(*c, 32)).collect());
        for _ in 0..2_000 {
            // Multiples of 2^-16 turn without rounding; the rest of the set-up is symmetric.
            let origin = [0; 3].map(|_| (random.range(-40.0, 70.0) * 65536.0).round() / 65536.0);
            let direction = [0; 3].map(|_| random.range(-1.0, 1.0));
            let hit = |scene: &Scene, o, d| {
                let ray = Ray::new(5, o, d, 0.0).unwrap()?;
                sealed_hit(&scene.tree, &ray, 0);
                first_hit(&scene.tree, &ray, 0).hit.map(|h| (h.cell, h.t))
            };
            let straight = hit(&scene, origin, direction).map(|(c, t)| (symmetry.cell(c, 32), t));
            let after = hit(&turned, symmetry.point(origin, 32.0), symmetry.vector(direction));
            assert_eq!(after, straight, "{symmetry:?} {origin:?} {direction:?}");
        }
    }
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
    for i in 0..1_000 {
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

/// Bytes of a damaged file: every answer is a hash of the question.
struct Garbage(u64);

impl NodeView for Garbage {
    fn depth(&self) -> u32 {
        u32::MAX
    }
    fn node_count(&self) -> u64 {
        self.0
    }
    fn voxel_count(&self) -> u64 {
        u64::MAX
    }
    fn infobyte(&self, node: NodeIndex) -> u8 {
        let [a, b, ..] = Random::new(node.get() ^ self.0).bits().to_le_bytes();
        a & b
    }
    fn first_child(&self, node: NodeIndex) -> BoxIndex {
        BoxIndex::new(Random::new(node.get().wrapping_add(self.0)).bits())
    }
    fn voxel_normal(&self, _: VoxelIndex) -> Option<u16> {
        None
    }
    fn node_normal(&self, _: NodeIndex) -> Option<u16> {
        None
    }
}

#[test]
fn damaged_trees_neither_panic_nor_hold_a_ray() {
    let mut random = Random::new(9);
    for seed in 0..2_000 {
        for depth in [0, 1, 5, 9, 16] {
            if let Some(ray) = random_ray(&mut random, depth) {
                assert!(first_hit(&Garbage(seed), &ray, 0).steps <= step_limit(depth));
                for form in Form::available() {
                    let _ = single::trace(form, &Garbage(seed), &Skin, &ray, 0);
                }
            }
        }
    }
}

#[test]
fn the_deepest_grid_is_walked_exactly() {
    // 65536 cells a side cannot be decoded; the slabs of a few voxels can be.
    let mut random = Random::new(31);
    let cells: Vec<[u32; 3]> =
        (0..300).map(|_| [0; 3].map(|_| 32_700 + u32::try_from(random.bits() % 64).unwrap())).collect();
    let dims = Dims::new(65_536, 65_536, 65_536).unwrap();
    let codes: Vec<u64> = cells.iter().map(|c| infobyte::geom::morton::encode(c[0], c[1], c[2])).collect();
    let tree = MemoryTree::new(dims, &codes).unwrap();
    let mut hits = 0;
    for i in 0..3_000 {
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
        let want = reference::nearest_by_slabs(cells.iter().copied(), &ray);
        assert_eq!(trace.hit.map(|h| (h.cell, h.face)), want.map(|h| (h.cell, h.face)), "{ray:?}");
        hits += u32::from(want.is_some());
    }
    assert!(hits > 2_000, "{hits}");
}
