//! Lines that leave bodies, and bodies in one place.

use tempfile::TempDir;

use super::body::{Body, RayKind, Side, Start, SurfaceHit};
use super::world::World;
use super::*;
use crate::builder::LabelChoice;
use crate::cpu::Form;
use crate::format::SurfaceKind;
use crate::geom::{Affine, Dims, add_scaled, dot};
use crate::load::{Model, ModelView, NodeView};
use crate::memory_tree::MemoryTree;
use crate::random::Random;
use crate::render::cells::Cells;
use crate::render::picture::Traversal;
use crate::render::ray::Ray;
use crate::render::walls::Hidden;
use crate::render::{Camera, NamedView, Projection, Samples, Shading, Smoothing, ViewPoint, single};
use crate::volume::{VolumeSource, Voxels};
use crate::{BuildOptions, Threshold};

const ALL: [f64; 2] = [0.0, f64::INFINITY];

fn ball(radius: f64, spacing: f64, surface: SurfaceKind) -> Model {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "small bodies")]
    let side = (2.0 * radius / spacing).ceil() as u32 + 6;
    let middle = f64::from(side - 1) / 2.0;
    let depth = |p: [u32; 3]| {
        let at = p.map(|c| (f64::from(c) - middle) * spacing);
        #[expect(clippy::cast_possible_truncation, reason = "a depth")]
        let depth = (radius - dot(at, at).sqrt()) as f32;
        depth
    };
    let mut affine = Affine::from_spacing([spacing; 3]);
    affine.rows.iter_mut().for_each(|row| row[3] = -middle * spacing);
    let volume = Voxels::from_fn(Dims::new(side, side, side).unwrap(), depth).placed(affine);
    built(&volume, BuildOptions { threshold: Threshold::Iso(0.0), ..options(surface) })
}

fn options(surface: SurfaceKind) -> BuildOptions {
    BuildOptions { surface: Some(surface), threads: 1, ..BuildOptions::default() }
}

fn built(volume: &dyn VolumeSource, options: BuildOptions) -> Model {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("model.oct");
    crate::build(volume, &options, &path).unwrap();
    Model::open(&path).unwrap()
}

fn part<'a>(model: &Model, view: &'a ModelView<'a>, placement: &Affine) -> Instance<'a> {
    let material = Material::default();
    Instance::new((view, 0), model.dims(), &model.affine(), placement, material, Clip::default()).unwrap()
}

fn unit(random: &mut Random) -> [f64; 3] {
    loop {
        let v = [0.0; 3].map(|_: f64| 2.0 * random.unit() - 1.0);
        let square = dot(v, v);
        if (0.01..=1.0).contains(&square) {
            return v.map(|c| c / square.sqrt());
        }
    }
}

/// A million lines leave a ball and never meet it; as many run through it and exit on the other side, in the right
/// place, for skin and cells, and for any placement.
#[test]
fn lines_from_a_ball_do_not_meet_it_and_lines_through_it_do_once() {
    let turn_deg = [20.0, -35.0, 50.0];
    let placements = [
        Placement { scale: [1.3; 3], turn_deg, pivot: [0.0; 3], at: [7.0, -3.0, 11.0] }.affine(),
        Placement { scale: [1.0, 2.0, 0.7], turn_deg, pivot: [0.0; 3], at: [7.0, -3.0, 11.0] }.affine(),
    ];
    let mut random = Random(29);
    for surface in [SurfaceKind::Skin, SurfaceKind::Cells] {
        let model = ball(24.0, 1.0, surface);
        let view = model.view();
        for placement in placements {
            let (mut lines, mut met_itself) = (0, 0);
            let part = part(&model, &view, &placement);
            let body = Body::of(&part, Form::best(), Smoothing::Smooth, 0);
            let inverse = placement.inverse().unwrap();
            for _ in 0..4096 {
                let middle = placement.apply([0.0; 3]);
                let outward = unit(&mut random);
                let from = add_scaled(middle, 200.0, outward);
                let aim = add_scaled(middle, 0.9 * 24.0 * 0.7, unit(&mut random));
                let sight = add_scaled(aim, -1.0, from);
                let Some(SurfaceHit::Surface(hit)) = body.meet(RayKind::PixelRays, (from, sight), ALL, None)
                else {
                    panic!("missed")
                };
                let point = add_scaled(from, hit.t, sight);
                // The true normal, out of the ball.
                let own = inverse.apply(point);
                let outward: [f64; 3] = std::array::from_fn(|a| dot(own, inverse.column(a)));
                for number in 0..150 {
                    let mut direction = unit(&mut random);
                    if number % 4 > 0 && dot(direction, outward) < 0.0 {
                        direction = direction.map(|c| -c);
                    }
                    let out = dot(direction, outward) > 0.0;
                    let side = if out { Side::Outside } else { Side::Inside };
                    let met = body.meet(
                        RayKind::PixelRays,
                        (point, direction),
                        ALL,
                        Some(&Start::Surface { hit, side }),
                    );
                    if out {
                        (lines, met_itself) = (lines + 1, met_itself + u32::from(met.is_some()));
                        continue;
                    }
                    // A line through the ball, in its own millimetres, more than a voxel below its surface.
                    let way = inverse.apply_vector(direction);
                    let length = dot(way, way).sqrt();
                    let chord = -2.0 * dot(own, way) / length;
                    if chord > 16.0 {
                        let Some(SurfaceHit::Surface(exit)) = met else {
                            panic!("{surface:?} {hit:?} {direction:?}")
                        };
                        let out = add_scaled(own, exit.t, way);
                        let apart = (dot(out, out).sqrt() - 24.0).abs();
                        assert!(apart < 3.0, "{surface:?}: {apart}");
                    }
                }
            }
            assert!(lines > 500_000 && met_itself == 0, "{surface:?} {placement:?}: {met_itself} of {lines}");
        }
    }
}

/// A ridge of three voxels on a plate: lines that start a voxel or two from it are stopped by it, those that run away
/// from it or over it are not.
#[test]
fn details_right_next_to_the_start_of_a_line_stop_it() {
    let inside = |[x, _, z]: [u32; 3]| z < 6 || ((14..18).contains(&x) && z < 9);
    let volume = Voxels::from_fn(Dims::new(32, 32, 16).unwrap(), |p| u8::from(inside(p)));
    for surface in [SurfaceKind::Skin, SurfaceKind::Cells] {
        let model = built(&volume, BuildOptions { threshold: Threshold::Iso(0.5), ..options(surface) });
        let view = model.view();
        let part = part(&model, &view, &Affine::from_spacing([1.0, 2.0, 0.5]));
        let body = Body::of(&part, Form::best(), Smoothing::Smooth, 0);
        for x in [11.1, 11.9, 12.4] {
            let down = ([x, 30.0, 20.0], [0.0, 0.0, -1.0]);
            let Some(SurfaceHit::Surface(hit)) = body.meet(RayKind::PixelRays, down, ALL, None) else {
                panic!("missed")
            };
            let point = add_scaled(down.0, hit.t, down.1);
            let start = Start::Surface { hit, side: Side::Outside };
            let met = |direction| {
                body.meet(RayKind::PixelRays, (point, direction), ALL, Some(&start)).map(|met| met.t())
            };
            let along = met([1.0, 0.3, 0.1]);
            assert!(along.is_some_and(|t| t < 3.5), "{surface:?} {x}: {along:?}");
            assert_eq!((met([-1.0, 0.3, 0.02]), met([1.0, 0.3, 2.5])), (None, None), "{surface:?} {x}");
        }
    }
}

#[test]
fn of_bodies_in_one_place_the_first_is_met() {
    let model = ball(10.0, 1.0, SurfaceKind::Skin);
    let view = model.view();
    let moved =
        |x| Placement { scale: [1.0; 3], turn_deg: [0.0; 3], pivot: [0.0; 3], at: [x, 0.0, 0.0] }.affine();
    let parts = [1, 0, 2].map(|x| part(&model, &view, &moved(f64::from(x.min(1)))));
    let world = World::of(&parts, Smoothing::Smooth, &[]);
    let (number, met) = world.nearest(([-50.0, 0.3, 0.2], [1.0, 0.0, 0.0]), ALL, &None).unwrap();
    assert!((met.t() - 40.0).abs() < 1.0 && number == 1);
    let (number, _) = world.nearest(([50.0, 0.3, 0.2], [-1.0, 0.0, 0.0]), ALL, &None).unwrap();
    assert_eq!(number, 0);
}

/// A cube's side, and the labels of its samples.
type Labels<'a> = (u32, &'a dyn Fn([u32; 3]) -> u16);

/// A model of cells between the labels of a cube.
fn labelled(side: u32, label: &dyn Fn([u32; 3]) -> u16) -> Model {
    let volume = Voxels::from_fn(Dims::new(side, side, side).unwrap(), label);
    let options = BuildOptions { labels: Some(LabelChoice::All), ..options(SurfaceKind::Cells) };
    let model = built(&volume, options);
    crate::load::verify(&model).unwrap();
    model
}

/// Lines from sample to sample, half of them along axes and diagonals: they begin and end in the samples' labels, meet
/// a wall exactly where the label changes, and are in the right label in every box that has only one.
#[test]
fn walls_between_labels_are_met_in_order_none_missed_and_none_twice() {
    let lines = match std::env::var("INFOBYTE_LONG") {
        Ok(_) => 2_000_000,
        Err(_) => 8000,
    };
    let mut random = Random(7);
    let noise: Vec<u16> = (0..20_u32.pow(3)).map(|_| random.below(40_000_u16)).collect();
    let of = |[x, y, z]: [u32; 3]| noise[(x + 20 * (y + 20 * z)) as usize];
    let far = |p: [u32; 3], c: [f64; 3]| {
        let d: [f64; 3] = std::array::from_fn(|a| f64::from(p[a]) - c[a]);
        dot(d, d).sqrt()
    };
    let balls = [([12.0, 15.0, 16.0], 9.5), ([24.0, 15.0, 15.0], 7.0), ([17.0, 23.0, 18.0], 6.0)];
    let ball = |p| (1..).zip(balls).filter(|(_, (c, r))| far(p, *c) < *r).map(|(label, _)| label).last();
    let shells = |p| match far(p, [15.3, 15.1, 14.8]) {
        r if r < 6.0 => 0,
        r if r < 7.2 => 4,
        r if r < 8.4 => 2,
        r if r < 9.6 => 0,
        r if r < 10.8 => 9,
        _ => 0,
    };
    let bodies: [Labels<'_>; 5] = [
        (20, &|p| of(p) % 2),
        (20, &|p| of(p) % 5),
        (20, &|p| of(p) % 300),
        (32, &|p| ball(p).unwrap_or(0)),
        (32, &shells),
    ];
    for (side, label) in bodies {
        let model = labelled(side, label);
        let (view, at_home) = (model.view(), Affine { rows: Affine::from_spacing([1.0; 3]).rows });
        let opacity = Opacity::of(&[], view.labels().unwrap(), &model.frame().labels).unwrap();
        let part = part(&model, &view, &at_home).labelled(Some(opacity));
        let body = Body::of(&part, Form::best(), Smoothing::Smooth, 0);
        let none = Hidden::of(std::iter::empty());
        let space = &part.space;
        let sample = |p: [i64; 3]| {
            let within = p.iter().all(|c| (0..i64::from(side)).contains(c));
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "within")]
            if within { label(p.map(|c| c as u32)) } else { 0 }
        };
        let (mut met, mut boxes, mut slivers) = (0_u64, 0_u64, 0_u64);
        for round in 0..lines {
            let mut place = || std::array::from_fn(|_| random.below(side));
            let (from, mut to): ([u32; 3], [u32; 3]) = (place(), place());
            if round % 2 == 0 {
                // Along an axis or a diagonal.
                let (axes, steps) = (1 + random.below(7_u32), to[0]);
                let run = |a: usize| if axes >> a & 1 == 1 { from[a].saturating_add(steps) } else { from[a] };
                to = std::array::from_fn(|a| run(a).min(side - 1));
            }
            if from == to {
                continue;
            }
            let aside: [f64; 3] = std::array::from_fn(|_| 0.002 * random.unit() - 0.001);
            let [p, q] = [from, to].map(|s| std::array::from_fn(|a| f64::from(s[a]) + aside[a]));
            let line = (p, add_scaled(q, -1.0, p));
            let mut state = label(from);
            let cells = Cells::new(view.cells().unwrap()).hiding(&none, state);
            let way = space.world_to_grid().apply_vector(line.1);
            let ray = Ray::new(space.dims().depth(), space.to_grid(p), way, 0.0).unwrap().unwrap();
            let mut next = single::trace(Form::best(), &view, &cells, &ray, 0).hit;
            let mut changes = vec![(0.0, state)];
            while let Some(hit) = next.filter(|hit| hit.t <= 1.0) {
                let walls = view.walls(hit.voxel(&view).unwrap()).unwrap();
                let [_, behind] = part.beside(&walls, line, &hit);
                // The last of several planes crossed at once, to within the rounding of rays, counts.
                slivers += u64::from(behind == state);
                state = behind;
                changes.push((hit.t, state));
                next = body.beyond(line, &hit);
            }
            assert_eq!(state, label(to), "{from:?} {to:?} {changes:?}");
            met += changes.len() as u64 - 1;
            for _ in 0..16 {
                let t = random.unit();
                let at = space.to_grid(add_scaled(line.0, t, line.1));
                #[expect(clippy::cast_possible_truncation, reason = "within the grid")]
                let low = at.map(|c| c.floor() as i64 - 1);
                let first = sample(low);
                let alike =
                    (1..8_i64).all(|c| sample(std::array::from_fn(|a| low[a] + (c >> a & 1))) == first);
                if alike && at.iter().all(|c| (c - c.round()).abs() > 1e-6) {
                    let here = changes.iter().rev().find(|change| change.0 <= t).unwrap().1;
                    assert_eq!(here, first, "{from:?} {to:?} at {t}, {changes:?}");
                    boxes += 1;
                }
            }
        }
        assert!(10 * slivers <= met, "{slivers} of {met}");
        assert!(met > lines / 4 && (boxes > lines / 4 || side == 20), "{met} {boxes}");
    }
}

/// As every cell with a visible label says, in any direction.
#[test]
fn the_extent_of_visible_labels_is_exact() {
    let mut random = Random(5);
    let blocks: Vec<u16> = (0..6_u32.pow(3)).map(|_| random.below(7_u16)).collect();
    let model = labelled(24, &|[x, y, z]| blocks[(x / 4 + 6 * (y / 4 + 6 * (z / 4))) as usize]);
    let placement = Affine { rows: [[0.9, 0.0, 0.3, 5.0], [0.1, -1.2, 0.2, -7.0], [0.0, 0.1, 2.0, 3.0]] };
    let view = model.view();
    for number in 1..=6 {
        let hide = |labels| LabelRule { labels, opacity: 0.0 };
        let show = LabelRule { labels: LabelPick::Numbers([number; 2]), opacity: 1.0 };
        for rules in [vec![hide(LabelPick::All), show], vec![hide(LabelPick::Numbers([number, 6]))]] {
            let opacity = Opacity::of(&rules, view.labels().unwrap(), &model.frame().labels).unwrap();
            let part = part(&model, &view, &placement).labelled(Some(opacity.clone()));
            let is_visible = |label: u16| opacity.part(label) > 0.0;
            let shown =
                model.voxels().places().filter(|(cell, _)| view.walls(*cell).unwrap().holds(is_visible));
            let shown: Vec<[u32; 3]> = shown.map(|(_, low)| low).collect();
            for _ in 0..20 {
                let direction = unit(&mut random);
                let corners = shown.iter().flat_map(|low| {
                    (0..8_u32).map(|c| std::array::from_fn(|a| f64::from(low[a] + (c >> a & 1)) - 0.5))
                });
                let along = |corner| dot(direction, placement.apply(model.affine().apply(corner)));
                let want = corners.map(along).fold(f64::NEG_INFINITY, f64::max);
                let found = part.support_to(direction, 0, &|| {});
                assert!(
                    found == want || (found - want).abs() < 1e-9,
                    "{rules:?} {direction:?}: {found} {want}"
                );
            }
        }
    }
}

/// A plate seen from above, with a wall around its middle.
#[test]
fn walls_darken_what_they_surround_and_a_plate_alone_stays() {
    let dims = Dims::new(32, 32, 32).unwrap();
    let picture = |wall: u32, rays, threads| {
        let around = |c: u32| (10..22).contains(&c);
        let edge = |x: u32, y: u32| around(x) && around(y) && [x, y].iter().any(|c| *c == 10 || *c == 21);
        let all = (0..32_u32 * 32 * 32).map(|i| [i % 32, i / 32 % 32, i / 1024]);
        let is_skin = |[x, y, z]: &[u32; 3]| *z == 4 || (edge(*x, *y) && (5..5 + wall).contains(z));
        let tree = MemoryTree::of_cells(dims, all.filter(is_skin));
        let view = tree.view();
        let part = Instance::alone(&view, dims, &Affine::from_spacing([1.0; 3])).unwrap();
        let top = ViewPoint::Named(NamedView::Top);
        let camera =
            Camera::new(top, Projection::Parallel, 35.0, 1.0, |direction| part.support(direction)).unwrap();
        let shading = Some(if rays > 0 { Shading::Ao } else { Shading::Plain });
        let look = PictureSettings {
            width: 48,
            height: 48,
            camera,
            near_mm: 0.0,
            shading,
            lights: Vec::new(),
            ambient: Ambient { color: [0.0; 3], rays, reach_mm: f64::INFINITY },
            background: None,
            bounces: 0,
            samples: Samples::Auto,
            creases: true,
            smoothing: Smoothing::Smooth,
            traversal: Traversal::Exact,
            levels: Vec::new(),
            section: None,
            threads,
            depth_range_mm: None,
            normals: false,
            ids: false,
            seen: false,
            max_band_pixels: None,
        };
        paint(&[part], &look, &|_| {}).unwrap().image.rgba
    };
    assert_eq!(picture(0, 16, 1), picture(0, 0, 2));
    let (plain, dark) = (picture(8, 0, 1), picture(8, 16, 1));
    assert_eq!(dark, picture(8, 16, 3));
    let middle = 4 * (24 * 48 + 24);
    assert!(dark[middle] < plain[middle] - 30, "{} {}", dark[middle], plain[middle]);
    assert!(plain.iter().zip(&dark).all(|(plain, dark)| dark <= plain));
}
