//! The promise: rays traced together in tiles, rays in batches, and rays traced alone two levels at a time, hit what the
//! sealed traversal hits, bit by bit, in every form that the machine has. If this file fails, pictures
//! differ between machines, or a fast path shows what is not there.

use crate::hard_cases::rays::hard_scenes;
use crate::prelude::*;
use crate::traversal::sealed_hit;

use infobyte::render::batch::Batch;
use infobyte::render::selfcheck::Random;
use infobyte::render::surface::{Passage, Surface};

/// A camera with its eye in a grid point, looking along a vector of the grid; spacing 1.
fn camera(eye: [f64; 3], along: [f64; 3], projection: Projection, fov_deg: f64) -> Option<Camera> {
    // A voxel's centre is a whole number in the world.
    let eye = eye.map(|v| v - 0.5);
    let look_at = std::array::from_fn(|a| eye[a] + along[a]);
    Camera::new(ViewPoint::Free { eye, look_at, up: None }, projection, fov_deg, 1.0, |_| 0.0).ok()
}

fn unit_space(dims: Dims) -> GridSpace {
    GridSpace::new(dims, &Affine::from_spacing([1.0; 3])).unwrap()
}

/// Every tile of a picture, in every form, against the sealed traversal of its rays.
fn compare_picture(
    counts: &mut Mismatches,
    tree: &MemoryTree,
    dims: Dims,
    camera: &Camera,
    size: u32,
    lod_edge_log2: u32,
) {
    let (view, space) = (tree.view(), unit_space(dims));
    let sight = PixelRays::new(&space, camera, size, size);
    let size = size as usize;
    for tile in 0..size.div_ceil(TILE).pow(2) {
        let across = size.div_ceil(TILE);
        let corner = (tile % across * TILE, tile / across * TILE);
        let limits = (size - corner.0, size - corner.1);
        counts.compare_tile(&view, &sight, Tile { corner, limits, lod_edge_log2 });
    }
}

#[test]
fn eyes_on_the_lattice_looking_along_26_directions_agree() {
    let mut counts = Mismatches::default();
    for scene in hard_scenes() {
        for code in (0..27).filter(|code| *code != 13) {
            let along = [code % 3 - 1, code / 3 % 3 - 1, code / 9 - 1].map(f64::from);
            for (i, eye) in [[8.0; 3], [0.0; 3], [16.0, 8.0, 0.5], [7.5, 3.0, 12.0]].into_iter().enumerate() {
                for back in [0.0, 20.0] {
                    let eye = std::array::from_fn(|a| eye[a] - back * along[a]);
                    let projection = [Projection::Parallel, Projection::Perspective][(i + code as usize) % 2];
                    let camera = camera(eye, along, projection, 60.0).unwrap();
                    compare_picture(&mut counts, &scene.tree, scene.dims, &camera, 16, 0);
                }
            }
        }
    }
    assert_eq!(counts.total(), 0, "{counts:?}");
    assert!(counts.tile_rays > 400_000, "{counts:?}");
}

#[test]
fn lattice_aligned_parallel_pictures_run_through_edges_and_still_agree() {
    // Pixels half a cell wide whose rays run in the planes between cells, axis by axis and diagonally.
    let mut counts = Mismatches::default();
    for scene in hard_scenes() {
        for along in [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 1.0, 0.0], [-1.0, 0.0, 1.0]] {
            let eye = std::array::from_fn(|a| 8.0 - 16.0 * along[a]);
            let distance = 16.0 * along.iter().map(|v: &f64| v * v).sum::<f64>().sqrt();
            let look_at = along.map(|v| v * 16.0);
            // The picture is 16 cells high at the distance looked at.
            let fov_deg = 2.0 * (8.0 / distance).atan().to_degrees();
            for size in [33, 32] {
                let camera = camera(eye, look_at, Projection::Parallel, fov_deg).unwrap();
                compare_picture(&mut counts, &scene.tree, scene.dims, &camera, size, 0);
            }
        }
    }
    assert_eq!(counts.total(), 0, "{counts:?}");
}

#[test]
fn every_level_of_detail_agrees() {
    let scene = Scene::skin("torus 64", [64; 3], |c| in_torus(c, 64));
    let mut counts = Mismatches::default();
    for lod in 0..=7 {
        for eye in [[32.0; 3], [-40.0, 10.0, 90.0]] {
            let along = std::array::from_fn(|a| 30.0 + 3.0 * a as f64 - eye[a]);
            for projection in [Projection::Parallel, Projection::Perspective] {
                let camera = camera(eye, along, projection, 50.0).unwrap();
                compare_picture(&mut counts, &scene.tree, scene.dims, &camera, 40, lod);
            }
        }
        let mut random = Random::new(u64::from(lod));
        let rays: Vec<Ray> = (0..3_000).filter_map(|_| random_ray(&mut random, 6)).collect();
        for ray in &rays {
            sealed_hit(&scene.tree, ray, lod.min(6));
        }
        counts.compare_batch(&scene.tree.view(), &rays, lod);
    }
    assert_eq!(counts.total(), 0, "{counts:?}");
}

#[test]
fn the_deepest_and_the_flattest_grids_agree() {
    let mut random = Random::new(31);
    let boxes: [([u32; 3], [u32; 3], [u32; 3]); 3] = [
        ([65_536; 3], [32_700; 3], [64; 3]),
        ([65_536, 2, 2], [32_700, 0, 0], [900, 2, 2]),
        ([4096; 3], [2000; 3], [90; 3]),
    ];
    for (dims, low, extent) in boxes {
        let dims = Dims::new(dims[0], dims[1], dims[2]).unwrap();
        let mut cell = || -> [u32; 3] {
            std::array::from_fn(|a| low[a] + u32::try_from(random.bits() % u64::from(extent[a])).unwrap())
        };
        let cells: Vec<[u32; 3]> = (0..2000).map(|_| cell()).collect();
        let codes: Vec<u64> = cells.iter().map(|c| morton::encode(c[0], c[1], c[2])).collect();
        let tree = MemoryTree::new(dims, &codes).unwrap();
        let middle: [f64; 3] = std::array::from_fn(|a| f64::from(low[a]) + f64::from(extent[a]) / 2.0);
        let mut counts = Mismatches::default();
        for i in 0..16 * long() as usize {
            let far = if i % 2 == 0 { 2e5 } else { 300.0 };
            let eye: [f64; 3] = std::array::from_fn(|a| middle[a] + random.range(-far, far));
            let along = std::array::from_fn(|a| middle[a] - eye[a]);
            let wide = f64::from(extent[0]) * 1.5;
            let distance = along.iter().map(|v: &f64| v * v).sum::<f64>().sqrt();
            let fov_deg = (2.0 * (wide / 2.0 / distance).atan().to_degrees()).clamp(0.1, 150.0);
            let projection = [Projection::Parallel, Projection::Perspective][i / 2 % 2];
            let camera = camera(eye, along, projection, fov_deg).unwrap();
            compare_picture(&mut counts, &tree, dims, &camera, 48, 0);
        }
        let mut lot = Vec::new();
        for i in 0..2_000 {
            let goal = cells[i % cells.len()].map(|v| f64::from(v) + random.unit());
            let origin = [0.0; 3].map(|_: f64| random.range(-1e5, 2e5));
            let direction = std::array::from_fn(|a| goal[a] - origin[a]);
            if let Some(ray) = Ray::new(tree.depth(), origin, direction, 0.0).unwrap() {
                sealed_hit(&tree, &ray, 0);
                lot.push(ray);
                // The same line from within, as rays that leave a surface start.
                let inside = std::array::from_fn(|a| goal[a] - 3.0 * direction[a].signum());
                lot.extend(Ray::new(tree.depth(), inside, direction, 0.0).unwrap());
            }
        }
        counts.compare_batch(&tree.view(), &lot, 0);
        assert_eq!(counts.total(), 0, "{dims}: {counts:?}");
    }
}

/// Every second box lets rays through; the others are met where they are left.
struct Screen;

impl Surface for Screen {
    const SOLID: bool = false;

    fn meet(&self, _: &ModelView<'_>, ray: &Ray, passage: &Passage) -> Option<Hit> {
        let [x, y, z] = passage.cell;
        let t = ray.t_after(passage.leave.distance, passage.leave.component);
        ((x + y + z) % 2 == 1).then(|| Hit { t, ..passage.entry_hit(ray) })
    }
}

#[test]
fn a_surface_within_the_boxes_is_asked_about_each_box_in_turn() {
    let scenes = [Scene::set("full solid", [16; 3], |_| true), noise("noise 20 %", [16; 3], 0.2, 6)];
    let mut met = 0;
    for scene in &scenes {
        // The sealed walk over plain bits, with only those boxes that the surface is met in.
        let cells = scene.cells.iter().filter(|c| c.iter().sum::<u32>() % 2 == 1).copied().collect();
        let odd = Scene::new("odd", [16; 3], cells);
        let check = |ray: &Ray, got: Option<Hit>| {
            let want = reference::walk(&odd.bits, ray, true, |_| {}).map(|hit| hit.cell);
            assert_eq!(got.map(|hit| hit.cell), want, "{ray:?}");
            if let Some(hit) = got {
                let entry = first_hit_sealed(&odd.tree, ray, 0).hit.unwrap();
                assert!(hit.t >= entry.t && hit.face == entry.face, "{hit:?} {entry:?}");
            }
            u32::from(got.is_some())
        };
        let mut random = Random::new(3);
        for form in Form::available() {
            let mut lot = vec![];
            for _ in 0..10_000 {
                let Some(ray) = random_ray(&mut random, 4) else { continue };
                met += check(&ray, single::trace(form, &scene.tree.view(), &Screen, &ray, 0).hit);
                lot.push(ray);
            }
            let (mut hits, mut any) = (vec![], vec![]);
            let mut batch = Batch::new(form);
            batch.nearest(&scene.tree.view(), &Screen, &lot, 0, &mut hits);
            batch.any(&scene.tree.view(), &Screen, &lot, 0, &mut any);
            for (ray, (hit, any)) in lot.iter().zip(hits.iter().zip(&any)) {
                assert_eq!(hit.is_some(), *any);
                check(ray, *hit);
            }
            let space = unit_space(scene.dims);
            for eye in [[-9.0, -12.0, 30.0], [8.25, 8.0, 7.5]] {
                let along = std::array::from_fn(|a| 8.5 - eye[a]);
                let camera = camera(eye, along, Projection::Perspective, 60.0).unwrap();
                let sight = PixelRays::new(&space, &camera, 64, 64);
                let mut tracer = Tracer::new(form);
                for tile in 0..64 {
                    let corner = (tile % 8 * TILE, tile / 8 * TILE);
                    let tile = Tile { corner, limits: (8, 8), lod_edge_log2: 0 };
                    let hits = tracer.trace(&scene.tree.view(), &Screen, &sight, tile);
                    for ray in 0..RAYS {
                        let (x, y) = (corner.0 + ray % TILE, corner.1 + ray / TILE);
                        if let Some(exact) = sight.ray(x as f64 + 0.5, y as f64 + 0.5) {
                            met += check(&exact, hits.hit(ray));
                        }
                    }
                }
            }
        }
    }
    assert!(met > 10_000, "{met}");
}

#[test]
fn damaged_trees_neither_panic_nor_hold_a_tile() {
    let space = unit_space(Dims::new(65_536, 65_536, 65_536).unwrap());
    let start = std::time::Instant::now();
    for seed in 0..12 {
        let garbage = Garbage::new(seed);
        let view = garbage.view(16);
        for projection in [Projection::Parallel, Projection::Perspective] {
            let camera = camera([-7e4, -5e4, 9e4], [1.0, 0.9, -0.8], projection, 60.0).unwrap();
            let sight = PixelRays::new(&space, &camera, 16, 16);
            for form in Form::available() {
                for lod_edge_log2 in [0, 5] {
                    let tile = Tile { corner: (0, 8), limits: (8, 8), lod_edge_log2 };
                    let _ = Tracer::new(form).trace(&view, &Skin, &sight, tile);
                    let rays: Vec<Ray> =
                        (0..64_u8).filter_map(|i| sight.ray((i % 8).into(), (8 + i / 8).into())).collect();
                    Batch::new(form).nearest(&view, &Skin, &rays, lod_edge_log2, &mut vec![]);
                    Batch::new(form).any(&view, &Skin, &rays, lod_edge_log2, &mut vec![]);
                }
            }
        }
    }
    assert!(start.elapsed().as_secs() < 60, "{:?}", start.elapsed());
}

#[test]
fn a_form_that_the_environment_names_is_one_of_the_machine() {
    let told = |form: &str| {
        let mut info = std::process::Command::new(binary());
        Run::of(&info.args(["info", "none.oct"]).env("INFOBYTE_FORM", form).output().unwrap())
    };
    for form in Form::available().map(Form::name).chain([""]) {
        let run = told(form);
        assert!(run.code == 3 && run.stderr.contains("none.oct"), "{form}: {run:?}");
    }
    for form in ["avx2", "AVX9", " "] {
        let run = told(form);
        assert!(run.code == 2 && run.stderr.contains("portable") && run.stderr.contains(form), "{run:?}");
    }
}
