//! The paper's own traversal: a discrete ray visits the voxels that its three points name, in their order, finds no
//! tunnel, and differs from the exact ray only by voxels that the line passes by. If this file fails, the mode that is
//! named after the paper is not the paper's.

use crate::common::scenes as support;
use crate::prelude::*;

use crate::common::traverse::first_hit as exact_hit;
use infobyte::render::discrete::frame::ParallelFrame;
use infobyte::render::discrete::{Line, first_hit, line::POINT_BITS};
use infobyte::render::selfcheck::Random;

fn discrete(tree: &MemoryTree, ray: &Ray) -> Option<Hit> {
    first_hit(tree, &Line::new(ray), 0, || Some(*ray)).hit
}

/// The voxels of a discrete ray, storey after storey, without a tree: in each the one of the floor, those that only one
/// coordinate of the ceiling leads to, and that of the ceiling. Of the two in the middle the first in Morton order
/// comes first.
fn voxels(ray: &Ray, mut visit: impl FnMut([u32; 3]) -> bool) -> Option<[u32; 3]> {
    let line = Line::new(ray);
    let axis = line.main_axis();
    let side = 1_i64 << ray.depth();
    let far = side << 16;
    let start: [i64; 3] = std::array::from_fn(|k| {
        let a = axis.grid_axis(k);
        if axis.is_mirrored(a) { far - ray.origin()[a] } else { ray.origin()[a] }
    });
    for w in start[2] >> 16..side {
        let [floor, _, ceiling] = line.points(u32::try_from(w).unwrap(), 1);
        let cell = |point: [i64; 2], k: usize| point[k].max(start[k] << 24) >> POINT_BITS;
        let (low, high) = ([0, 1].map(|k| cell(floor, k)), [0, 1].map(|k| cell(ceiling, k)));
        let mut path = vec![low, [high[0], low[1]], [low[0], high[1]], high];
        let place = |c: i64| u32::try_from(c).unwrap_or(0);
        path.sort_by_key(|[u, v]| infobyte::geom::morton::encode(place(*u), place(*v), 0));
        path.dedup();
        for [u, v] in path {
            let inside = [u, v].iter().all(|c| (0..side).contains(c));
            if inside {
                let mut at = [0; 3];
                for (k, c) in [u, v, w].into_iter().enumerate() {
                    let a = axis.grid_axis(k);
                    let c = if axis.is_mirrored(a) { side - 1 - c } else { c };
                    at[a] = u32::try_from(c).unwrap();
                }
                if visit(at) {
                    return Some(at);
                }
            }
        }
    }
    None
}

fn scenes() -> Vec<Scene> {
    let n = 32;
    vec![
        Scene::skin("ball", [n; 3], |c| in_ball(c, n)),
        Scene::skin("torus", [n; 3], |c| in_torus(c, n)),
        Scene::skin("gyroid", [n; 3], |c| in_gyroid(c, n)),
        noise("noise", [n; 3], 0.02, 5),
        noise("dense noise", [n; 3], 0.3, 6),
        Scene::set("full", [8; 3], |_| true),
        Scene::set("one voxel", [1; 3], |_| true),
        Scene::set("flat", [32, 2, 2], |[x, y, z]| (x ^ y ^ z) & 3 == 1),
        Scene::set("air", [16; 3], |_| false),
    ]
}

/// Rays in general position, along axes and diagonals, through corners and edges of voxels.
fn rays(random: &mut Random, depth: u32, mut each: impl FnMut(&Ray)) {
    for _ in 0..4000 {
        if let Some(ray) = random_ray(random, depth) {
            each(&ray);
        }
    }
    let side = f64::from(1_u32 << depth);
    for k in 0..27 * 40 {
        let direction = [k % 3 - 1, k / 3 % 3 - 1, k / 9 % 3 - 1].map(f64::from);
        let at: [f64; 3] = std::array::from_fn(|_| (random.range(-0.2, 1.2) * side * 2.0).floor() / 2.0);
        if let Ok(Some(ray)) = Ray::new(depth, at, direction, 0.0) {
            each(&ray);
        }
    }
}

#[test]
fn the_first_hit_is_the_first_skin_voxel_that_the_points_name() {
    let mut random = Random::new(1);
    let (mut compared, mut hits) = (0, 0);
    for scene in scenes() {
        rays(&mut random, scene.dims.depth(), |ray| {
            let want = voxels(ray, |cell| scene.bits.get(cell));
            let got = discrete(&scene.tree, ray);
            assert_eq!(got.map(|h| h.cell), want, "{} {ray:?}", scene.name);
            compared += 1;
            hits += u32::from(want.is_some());
        });
    }
    assert!(compared > 20_000 && hits > 5_000, "{hits} of {compared}");
}

#[test]
fn every_voxel_that_the_line_pierces_is_visited_and_few_others() {
    let mut random = Random::new(2);
    let (mut pierced, mut visited) = (0_u64, 0_u64);
    let empty = BitVolume::new(6).unwrap();
    for _ in 0..4000 {
        let Some(ray) = random_ray(&mut random, 6) else { continue };
        let mut seen = Vec::new();
        voxels(&ray, |cell| {
            seen.push(cell);
            false
        });
        // Connected by faces: each shares one with a voxel before it.
        for (i, cell) in seen.iter().enumerate().skip(1) {
            let near = |other: &[u32; 3]| (0..3).map(|a| cell[a].abs_diff(other[a])).sum::<u32>() == 1;
            // Where the ray leaves the grid and comes back along an edge it begins anew.
            let at_side = cell.iter().any(|c| *c == 0 || *c == 63);
            assert!(at_side || seen[..i].iter().rev().take(4).any(near), "{cell:?} of {ray:?}");
        }
        visited += seen.len() as u64;
        reference::walk(&empty, &ray, false, |cell| {
            pierced += 1;
            // The line is rounded to 2^-25 cell; a voxel that it is in for less may be missed.
            let near = |c: &[u32; 3]| (0..3).all(|a| c[a].abs_diff(cell[a]) <= 1);
            assert!(seen.contains(&cell) || seen.iter().any(near), "{cell:?} of {ray:?}");
        });
    }
    assert!(visited >= pierced && visited < pierced * 14 / 10, "{visited} visited, {pierced} pierced");
}

#[test]
fn no_ray_passes_through_a_closed_skin() {
    let n = 24;
    let mut random = Random::new(3);
    let mut solids = vec![
        (Scene::skin("ball", [n; 3], |c| in_ball(c, n)), (|c, n| in_ball(c, n)) as fn([u32; 3], u32) -> bool),
        (Scene::skin("torus", [n; 3], |c| in_torus(c, n)), |c, n| in_torus(c, n)),
    ];
    solids.push((Scene::skin("gyroid", [n; 3], |c| in_gyroid(c, n)), |c, n| in_gyroid(c, n)));
    for (scene, inside) in solids {
        let aims: Vec<_> = support::all_cells([n; 3]).filter(|c| inside(*c, n)).collect();
        for k in 0..20_000 {
            let aim = aims[usize::try_from(random.bits() % aims.len() as u64).unwrap()];
            let aim = aim.map(|c| f64::from(c) + 0.5);
            // Every other direction is one of small whole numbers, so that it meets edges and corners.
            let direction: [f64; 3] = std::array::from_fn(|_| {
                let c = random.range(-1.0, 1.0);
                if k % 2 == 0 { (c * 3.0).round() } else { c }
            });
            if direction == [0.0; 3] {
                continue;
            }
            let from = std::array::from_fn(|a| aim[a] - 64.0 * direction[a]);
            let Ok(Some(ray)) = Ray::new(scene.dims.depth(), from, direction, 0.0) else { continue };
            if ray.entry().is_none() {
                continue; // it may begin within the body
            }
            let hit = discrete(&scene.tree, &ray).unwrap_or_else(|| panic!("{ray:?}"));
            assert!(hit.t <= 64.0 + 1.0, "{}: past its aim, {ray:?}", scene.name);
        }
    }
    // Of planes in any direction.
    for k in 0..200 {
        let a = std::array::from_fn(|_| random.range(-1.0, 1.0));
        let scene = plane(format!("plane {k}"), 16, a);
        for _ in 0..200 {
            let side = |random: &mut Random, sign: f64| -> [f64; 3] {
                let length = a.iter().map(|c| c * c).sum::<f64>().sqrt();
                let at: [f64; 3] = std::array::from_fn(|_| random.range(5.0, 11.0));
                let off: f64 = (0..3).map(|i| (at[i] - 8.0) * a[i]).sum::<f64>() / length;
                std::array::from_fn(|i| at[i] - (off - sign * 3.0) * a[i] / length)
            };
            let (from, to) = (side(&mut random, 1.0), side(&mut random, -1.0));
            let direction = std::array::from_fn(|i| to[i] - from[i]);
            let ray = Ray::new(scene.dims.depth(), from, direction, 0.0).unwrap().unwrap();
            let hit = discrete(&scene.tree, &ray);
            assert!(hit.is_some_and(|h| h.t < 1.0), "{}: {ray:?}", scene.name);
        }
    }
}

#[test]
fn a_skin_of_edges_alone_is_a_tunnel_without_widening_only() {
    // Two voxels that touch by an edge, in all twelve places of a box and from both sides: 24 passages (the paper, 3.3).
    let mut passages = 0;
    for axis in 0..3_usize {
        let (a, b) = ((axis + 1) % 3, (axis + 2) % 3);
        for storey in [0, 1] {
            for (first, second) in [([0, 0], [1, 1]), ([0, 1], [1, 0])] {
                for reversed in [false, true] {
                    let place = |[p, q]: [u32; 2]| {
                        let mut cell = [0; 3];
                        (cell[axis], cell[a], cell[b]) = (storey, p, q);
                        cell
                    };
                    let skin = [place(first), place(second)];
                    let scene = Scene::set("edge", [2; 3], |c| skin.contains(&c));
                    // Through the common edge, from one of the two other quadrants into the other.
                    let (from, to) = (place([first[0], second[1]]), place([second[0], first[1]]));
                    let (from, to) = if reversed { (to, from) } else { (from, to) };
                    let direction = std::array::from_fn(|i| f64::from(to[i]) - f64::from(from[i]));
                    let origin = std::array::from_fn(|i| f64::from(from[i]) + 0.5 - 0.25 * direction[i]);
                    let ray = Ray::new(1, origin, direction, 0.0).unwrap().unwrap();
                    assert!(discrete(&scene.tree, &ray).is_some(), "{from:?} to {to:?}");
                    passages += 1;
                }
            }
        }
    }
    assert_eq!(passages, 24);
}

#[test]
fn it_differs_from_the_exact_ray_by_voxels_that_the_line_passes_by() {
    let mut random = Random::new(4);
    let (mut hits, mut other, mut more) = (0, 0, 0);
    for scene in scenes() {
        rays(&mut random, scene.dims.depth(), |ray| {
            let (exact, seed) = (exact_hit(&scene.tree, ray, 0).hit, discrete(&scene.tree, ray));
            match (exact, seed) {
                (Some(exact), Some(seed)) => {
                    hits += 1;
                    if exact.cell == seed.cell {
                        assert_eq!((exact.face, exact.box_number), (seed.face, seed.box_number), "{ray:?}");
                        assert!((exact.t - seed.t).abs() <= 1e-12 * exact.t.abs().max(1.0), "{ray:?}");
                    } else {
                        other += 1;
                    }
                }
                (None, Some(_)) => more += 1,
                (Some(exact), None) => panic!("{}: {exact:?} is missed by {ray:?}", scene.name),
                (None, None) => {}
            }
        });
    }
    assert!(hits > 5_000 && other > 0 && more > 0 && other + more < hits / 4, "{hits} {other} {more}");
}

#[test]
fn symmetries_of_the_cube_permute_its_hits() {
    // Rays in general position: of two voxels that widening adds, the first axis decides, so hits may move between them.
    let scene = noise("noise", [16; 3], 0.05, 9);
    let mut random = Random::new(5);
    let (mut same, mut compared) = (0, 0);
    for symmetry in Symmetry::all() {
        let turned = Scene::set("turned", [16; 3], |_| false);
        let cells: Vec<_> = scene.cells.iter().map(|c| symmetry.cell(*c, 16)).collect();
        let turned = Scene::new("turned", [16; 3], {
            let mut c = cells;
            c.extend(turned.cells);
            c
        });
        for _ in 0..500 {
            let from = std::array::from_fn(|_| random.range(-4.0, 20.0));
            let direction = std::array::from_fn(|_| random.range(-1.0, 1.0));
            let ray = |o, d| Ray::new(4, o, d, 0.0).unwrap();
            let (Some(a), Some(b)) =
                (ray(from, direction), ray(symmetry.point(from, 16.0), symmetry.vector(direction)))
            else {
                continue;
            };
            let (a, b) = (discrete(&scene.tree, &a), discrete(&turned.tree, &b));
            assert_eq!(a.is_some(), b.is_some());
            if let (Some(a), Some(b)) = (a, b) {
                compared += 1;
                same += u32::from(symmetry.cell(a.cell, 16) == b.cell);
            }
        }
    }
    assert!(compared > 5_000 && same > compared * 98 / 100, "{same} of {compared}");
}

#[test]
fn rows_by_increments_are_the_rays_of_their_pixels() {
    let scene = Scene::skin("torus", [64; 3], |c| in_torus(c, 64));
    let space = GridSpace::new(scene.dims, &Affine::from_spacing([1.0; 3])).unwrap();
    let (width, height) = (4096, 16);
    let (mut frames, mut pixels, mut other) = (0, 0_u32, 0);
    let camera = |point| {
        Camera::new(point, Projection::Parallel, 35.0, 256.0, |d| space.support(&scene.tree.view(), d))
            .unwrap()
    };
    // From afar, and from within the grid.
    let eyes = [
        [300.0, -200.0, 150.0],
        [-251.0, 170.5, 97.25],
        [31.0, 402.5, -17.5],
        [5.5, -90.25, -333.0],
        [20.25, 9.5, 40.75],
    ];
    for eye in eyes {
        let camera = camera(ViewPoint::Free { eye, look_at: [32.3, 31.9, 32.7], up: None });
        let sight = PixelRays::new(&space, &camera, width, height);
        let frame =
            ParallelFrame::new(&sight, width, height).expect("a parallel projection of something near");
        frames += 1;
        for y in 0..height {
            for (x, line) in (0..width).zip(frame.row(0, y)) {
                let ray = sight.ray(f64::from(x) + 0.5, f64::from(y) + 0.5);
                let alone = ray.and_then(|ray| discrete(&scene.tree, &ray));
                let row = first_hit(&scene.tree, &line, 0, || ray).hit;
                pixels += u32::from(alone.is_some());
                other += u32::from(alone.map(|h| h.cell) != row.map(|h| h.cell));
                // No drift: at the end of the row the points are those of a row that begins there.
                if x == width - 1 {
                    let anew = frame.row(x, y).next().unwrap();
                    for (a, b) in line.points(0, 64).iter().zip(anew.points(0, 64)) {
                        assert!((0..2).all(|k| (a[k] - b[k]).abs() < 1 << (POINT_BITS - 20)), "{a:?} {b:?}");
                    }
                }
            }
        }
    }
    // Where a pixel's ray passes an edge within 2^-16 voxel.
    assert!(frames == 5 && pixels > 500 && other * 1000 < pixels, "{other} of {pixels}");
    for view in NamedView::ALL {
        let camera = camera(ViewPoint::Named(view));
        assert!(ParallelFrame::new(&PixelRays::new(&space, &camera, 512, 2), 512, 2).is_some(), "{view:?}");
    }
    let camera =
        Camera::new(ViewPoint::Named(NamedView::Front), Projection::Perspective, 35.0, 1.0, |_| 32.0)
            .unwrap();
    assert!(ParallelFrame::new(&PixelRays::new(&space, &camera, 8, 8), 8, 8).is_none());
}
