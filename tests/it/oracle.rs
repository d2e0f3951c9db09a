//! Rays of any finite f64 numbers against an oracle without rounding: what a traversal answers is the truth about its
//! fixed-point ray, and a fixed-point ray is no farther from the ray that was asked for than is said.
//!
//! Would break: a fast path that decides ties wrongly, a rounding in the traversal, a ray set-up that loses bits of
//! far cameras, of tiny components or of a near limit, an octree that leaves out a box.
//!
//! The statement (see `render::ray`): in a grid of 2^L cells a side the quantised ray is at every place within
//!
//! ```text
//!   2^-16  +  2^(L-29)  +  2^-49 D      cells
//! ```
//!
//! of the given one, measured across its main axis. The first term is the rounding of the origin, the second that of
//! the direction over the whole grid, the third that of f64 on the way to the grid, where D is the greatest of the
//! grid's side, the camera's distance and that of the near limit. So for L = 10 and a camera within 10^6 cells it is
//! 1.8 * 10^-5 cell, and a hit differs from the true one only where a ray passes an edge that closely.

use crate::common::oracle;
use crate::prelude::*;
use crate::traversal::sealed_hit;

use infobyte::render::ray::{DIRECTION_BITS, FRACTION_BITS};
use infobyte::render::selfcheck::Random;
use oracle::Dyadic;

/// Rays for each scene.
fn rays(usual: u32) -> u32 {
    usual * long()
}

fn scenes() -> Vec<Scene> {
    vec![
        Scene::skin("ball", [32; 3], |c| in_ball(c, 32)),
        Scene::skin("gyroid", [32; 3], |c| in_gyroid(c, 32)),
        noise("noise 3 %", [32; 3], 0.03, 5),
        plane("plane".into(), 32, [1.0, 0.3, -0.2]),
        Scene::set("checkerboard", [8; 3], |[x, y, z]| (x + y + z) % 2 == 0),
        Scene::set("one voxel", [1; 3], |_| true),
        noise("37x5x64", [37, 5, 64], 0.05, 6),
    ]
}

#[test]
fn dyadics_are_exact() {
    let third = Dyadic::from_f64(1.0 / 3.0);
    let sum = &(&third + &third) + &third;
    // Three times the double next to a third is one less 2^-54.
    assert_eq!(&Dyadic::of(1) - &sum, Dyadic::power_of_two(-54));
    let tiny = Dyadic::from_f64(5e-324);
    let huge = Dyadic::from_f64(f64::MAX);
    assert!(&huge + &tiny > huge && &(&huge + &tiny) - &huge == tiny);
    assert_eq!(&tiny * &Dyadic::power_of_two(1074), Dyadic::of(1));
    assert_eq!(Dyadic::from_f64(-0.0), Dyadic::zero());
    assert_eq!(Dyadic::from_f64(-1.5).to_f64(), -1.5);
}

/// A ray whose numbers fixed point can hold: it stays what it is.
fn exact_ray(random: &mut Random, depth: u32) -> ([f64; 3], [f64; 3]) {
    let side = f64::from(1_u32 << depth);
    let (kind, unit) = (random.bits(), f64::from(1_u32 << FRACTION_BITS));
    let step = [1.0, 2.0, unit][(kind % 3) as usize];
    let origin = [0; 3].map(|_| (random.range(0.0, side) * step).round() / step);
    let whole = f64::from(1_u32 << (DIRECTION_BITS - 1));
    let steep = [1.0, 3.0, 64.0, whole][(kind >> 8 & 3) as usize];
    let direction = [0; 3].map(|_| (random.range(-1.0, 1.0) * steep).round());
    (origin, direction)
}

#[test]
fn rays_that_need_no_rounding_hit_what_the_oracle_hits() {
    let mut random = Random::new(1);
    let (mut compared, mut hits) = (0, 0);
    for scene in scenes() {
        let depth = scene.tree.depth();
        for i in 0..rays(1500) {
            let (origin, direction) = exact_ray(&mut random, depth);
            let Ok(Some(ray)) = Ray::new(depth, origin, direction, 0.0) else { continue };
            let exact = ExactRay::new(origin, direction, 0.0);
            // The fixed form is this very ray.
            assert!(exact.is(&ExactRay::of_fixed(&ray)), "{origin:?} {direction:?}");

            let want = exact.first_in(&scene.tree);
            let got = first_hit(&scene.tree, &ray, 0).hit;
            let label = format!("{} ray {i}: {origin:?} {direction:?}", scene.name);
            assert_eq!(got.map(|h| h.cell), want.as_ref().map(|h| h.cell), "{label}");
            let axis = got.and_then(|h| h.face).map(|f| usize::from(f.axis));
            assert_eq!(axis, want.as_ref().and_then(|h| h.axis), "{label}");
            if let (Some(got), Some(want)) = (got, &want) {
                let t = want.time.to_f64();
                assert!((got.t - t).abs() <= 1e-12 * t.abs().max(1.0), "{label}: {} {t}", got.t);
            }
            // All cells one by one, without the octree: the oracle's own oracle.
            if i % 16 == 0 {
                let all = exact.first_of(scene.cells.iter().copied());
                assert_eq!(all.map(|h| h.cell), want.as_ref().map(|h| h.cell), "{label}");
            }
            compared += 1;
            hits += u32::from(want.is_some());
        }
    }
    println!("{compared} exact rays, {hits} hits");
    assert!(compared > rays(1500) * 6 && hits > compared / 5, "{compared} {hits}");
}

/// Any finite ray: far and near cameras, numbers of all sizes, neighbours of lattice points.
fn any_ray(random: &mut Random, depth: u32) -> ([f64; 3], [f64; 3], f64) {
    let side = f64::from(1_u32 << depth);
    let kind = random.bits();
    let goal = [0.0; 3].map(|_: f64| random.range(0.0, side));
    let away = [1.0, 4.0, 1e3, 1e6][(kind & 3) as usize];
    let mut origin = goal.map(|g| g + away * side * random.range(-1.0, 1.0));
    let mut goal = goal;
    if kind >> 2 & 3 == 0 {
        // A hair off the lattice.
        goal = goal.map(|g| if random.bits() & 1 == 0 { g.round().next_up() } else { g.round().next_down() });
    }
    if kind >> 4 & 7 == 0 {
        origin = origin.map(f64::round);
    }
    let mut direction: [f64; 3] = std::array::from_fn(|a| goal[a] - origin[a]);
    match kind >> 8 & 15 {
        0 => direction = direction.map(|d| if random.bits() & 1 == 0 { d * 5e-324 } else { d }),
        1 => {
            let small = 2.0_f64.powi(-i32::try_from(random.bits() % 60).unwrap());
            direction[(kind >> 20 & 1) as usize] = direction[2] * small;
        }
        _ => {}
    }
    let scale = [1.0, 1e-12, 1e12, 1e-300, 1e290][(kind >> 32).rem_euclid(5) as usize];
    let t_min = if kind >> 16 & 7 == 0 { random.range(0.0, 1.0) / scale } else { 0.0 };
    (origin, direction.map(|d| d * scale), t_min)
}

/// The statement of the head of this file, as a sum of powers of two.
fn bound(depth: u32, origin: [f64; 3], direction: [f64; 3], t_min: f64) -> Dyadic {
    let side = f64::from(1_u32 << depth);
    let reach = (0..3).fold(side, |reach: f64, a| {
        reach.max((origin[a] - side / 2.0).abs()).max((t_min * direction[a]).abs())
    });
    let rounding = &Dyadic::power_of_two(-16) + &Dyadic::power_of_two(i64::from(depth) - 29);
    &rounding + &Dyadic::from_f64(reach).times_power_of_two(-49)
}

#[test]
fn any_finite_ray_is_as_near_to_its_fixed_form_as_is_said() {
    let mut random = Random::new(2);
    let (mut compared, mut hits, mut differ, mut worst, mut most) = (0_u32, 0_u32, 0_u32, 0.0_f64, 0.0_f64);
    for scene in scenes() {
        let depth = scene.tree.depth();
        for i in 0..rays(1200) {
            let (origin, direction, t_min) = any_ray(&mut random, depth);
            let Ok(made) = Ray::new(depth, origin, direction, t_min) else { continue };
            let exact = ExactRay::new(origin, direction, t_min);
            let label = format!("{} ray {i}: {origin:?} {direction:?} from {t_min:?}", scene.name);
            let margin = bound(depth, origin, direction, t_min);
            let want = exact.first_in(&scene.tree);
            compared += 1;
            hits += u32::from(want.is_some());
            let Some(ray) = made else {
                // Said to miss the grid: then it touches at most the margin around it.
                if let Some(want) = want {
                    differ += 1;
                    let side = 1_u32 << depth;
                    let near = (0..3).any(|a| want.cell[a] == 0 || want.cell[a] == side - 1);
                    assert!(near, "{label}: misses the grid and {want:?}");
                }
                continue;
            };
            let fixed = ExactRay::of_fixed(&ray);
            if let Some(off) = exact.deviation(&fixed, depth) {
                let share = off / margin.to_f64();
                assert!(share <= 1.0, "{label}: {off} of {}", margin.to_f64());
                (worst, most) = (worst.max(share), most.max(off));
            }
            // The traversal is exact about the fixed ray, and every form agrees.
            let got = first_hit(&scene.tree, &ray, 0).hit;
            let truth = fixed.first_in(&scene.tree);
            assert_eq!(got.map(|h| h.cell), truth.map(|h| h.cell), "{label}");
            sealed_hit(&scene.tree, &ray, 0);
            // Where the hits differ, each ray comes within the margin of the other's voxel.
            let cell = want.map(|h| h.cell);
            if got.map(|h| h.cell) != cell {
                differ += 1;
                if let Some(got) = got {
                    assert!(exact.passes(got.cell, &margin), "{label}: {got:?}");
                }
                if let Some(cell) = cell {
                    assert!(fixed.passes(cell, &margin), "{label}: {cell:?}");
                }
            }
        }
    }
    println!(
        "{compared} rays, {hits} hits: {differ} hit another voxel than without rounding; at most {most:.2e} cell off, {:.0} % of the bound",
        100.0 * worst
    );
    assert!(hits > 1000 && hits > compared / 8, "{compared} {hits}");
    assert!(differ < compared / 10, "{differ} of {compared}");
}

#[test]
fn rays_of_the_world_are_as_near_in_voxels() {
    // What comes on top: the affine and its inverse, in f64.
    let affines = [
        Affine::from_spacing([1.0; 3]),
        Affine { rows: [[0.4, 0.0, 0.0, -102.3], [0.0, 0.4, 0.0, -98.7], [0.0, 0.0, 5.0, 713.0]] },
        Affine { rows: [[0.5, 0.0, 0.3, 10.0], [0.0, -0.5, 0.2, -20.0], [0.0, 0.1, 2.0, 30.0]] },
        Affine { rows: [[1e-6, 0.0, 0.0, 1.0], [0.0, 1e-6, 0.0, 1.0], [0.0, 0.0, 1e-6, 1.0]] },
    ];
    let scene = Scene::skin("ball", [64; 3], |c| in_ball(c, 64));
    let (mut random, mut worst) = (Random::new(3), 0.0_f64);
    for affine in affines {
        let space = GridSpace::new(scene.dims, &affine).unwrap();
        let rows = affine.rows.map(|row| row.map(Dyadic::from_f64));
        // A grid place in the world, exactly: the affine maps indices, which are half a cell less.
        let half = Dyadic::power_of_two(-1);
        let vector = |v: &[Dyadic; 3]| -> [Dyadic; 3] {
            std::array::from_fn(|i| (0..3).fold(Dyadic::zero(), |sum, a| &sum + &(&rows[i][a] * &v[a])))
        };
        let point = |p: &[Dyadic; 3]| -> [Dyadic; 3] {
            let index: [Dyadic; 3] = std::array::from_fn(|a| &p[a] - &half);
            let turned = vector(&index);
            std::array::from_fn(|i| &turned[i] + &rows[i][3])
        };
        let smallest = affine.spacing_mm().into_iter().fold(f64::INFINITY, f64::min);
        for _ in 0..rays(300) {
            let inside = [0.0; 3].map(|_: f64| random.range(0.0, 63.0));
            let outside = [0.0; 3].map(|_: f64| random.range(-300.0, 300.0));
            let (from, to) = (affine.apply(outside), affine.apply(inside));
            let direction: [f64; 3] = std::array::from_fn(|a| to[a] - from[a]);
            let Ok(Some(ray)) = space.ray(from, direction) else { continue };
            // The fixed ray's line in the world against the given one: its distance at its start and 64 cells on.
            let fixed = ExactRay::of_fixed(&ray);
            let (o, d) = (from.map(Dyadic::from_f64), direction.map(Dyadic::from_f64));
            let start = point(&fixed.origin);
            let step = vector(&fixed.direction.clone().map(|c| c.times_power_of_two(-24)));
            for k in [0, 1] {
                let at: [Dyadic; 3] =
                    std::array::from_fn(|i| &(&start[i] + &(&step[i] * &Dyadic::of(k))) - &o[i]);
                let cross = |i: usize, j: usize| &(&at[i] * &d[j]) - &(&at[j] * &d[i]);
                let off: f64 = [(1, 2), (2, 0), (0, 1)]
                    .iter()
                    .map(|(i, j)| cross(*i, *j).to_f64())
                    .map(|c| c * c)
                    .sum::<f64>()
                    .sqrt();
                let length = direction.iter().map(|c| c * c).sum::<f64>().sqrt();
                worst = worst.max(off / length / smallest);
            }
        }
    }
    println!("rays of the world: at most {worst:.2e} of the finest spacing off");
    // At 5 mm slices of 0.4 mm pixels an error along z counts 12.5 times in finest voxels.
    assert!(worst < 16.0 * 2.0_f64.powi(-16), "{worst}");
}

#[test]
fn planes_in_cells_are_met_where_the_oracle_meets_them() {
    let folder = tempfile::tempdir().unwrap();
    let mut random = Random::new(4);
    let (mut compared, mut entries, mut crossings, mut unsaid, mut worst) = (0, 0, 0, 0, 0.0_f64);
    for text in
        ["torus@24", "box@24?noise=0.05", "sphere@24?spacing=1x1x3,slab=1", "salt@10?sample=binary,share=0.2"]
    {
        let volume = infobyte::synthetic::analytic(text).unwrap();
        let path = folder.path().join("cells.oct");
        let options = infobyte::BuildOptions {
            threshold: infobyte::Threshold::Iso(0.5),
            surface: Some(SurfaceKind::Cells),
            ..Default::default()
        };
        infobyte::build(&volume, &options, &path).unwrap();
        let model = infobyte::Model::open(&path).unwrap();
        let view = model.view();
        let (items, depth) = (view.cells().unwrap(), view.depth());
        let surface = Cells::new(items);
        let cells: Vec<([u32; 3], u64)> =
            finest(&view).into_iter().map(|(at, cell)| (at, cell.get())).collect();
        for i in 0..rays(600) {
            let (origin, direction) = exact_ray(&mut random, depth);
            let Ok(Some(ray)) = Ray::new(depth, origin, direction, 0.0) else { continue };
            let exact = ExactRay::new(origin, direction, 0.0);
            let label = format!("{text} ray {i}: {origin:?} {direction:?}");
            assert!(exact.is(&ExactRay::of_fixed(&ray)), "{label}");
            let Some(want) = exact.first_in_cells(&cells, &view, &items) else {
                unsaid += 1;
                continue;
            };
            for form in Form::available() {
                let got = single::trace(form, &view, &surface, &ray, 0).hit;
                // Pictures take crossings of several planes one by one; a cell that is touched in an edge is theirs only.
                let tied = got.map(|h| h.cell) != want.as_ref().map(|h| h.cell)
                    && got.is_some_and(|h| !exact.passes(h.cell, &Dyadic::zero()));
                if tied {
                    continue;
                }
                assert_eq!(got.map(|h| h.cell), want.as_ref().map(|h| h.cell), "{form:?} {label}");
                if let (Some(got), Some(want)) = (got, &want) {
                    let t = want.time.to_f64();
                    let step = direction.iter().fold(0.0_f64, |m, d| m.max(d.abs()));
                    worst = worst.max((got.t - t).abs() * step);
                }
            }
            compared += 1;
            if let Some(want) = want {
                if want.axis.is_some() { entries += 1 } else { crossings += 1 }
            }
        }
    }
    println!(
        "{compared} rays and planes in cells: {crossings} cross within, {entries} enter behind, {unsaid} come to corners first; at most {worst:.1e} cell off along the ray"
    );
    assert!(crossings > 100 && entries > 30 && worst < 1e-9, "{crossings} {entries} {worst}");
}
