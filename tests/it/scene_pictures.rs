//! Scenes whose answers are known: what a mirror shows, where glass bends to, where a shadow ends, what a cut opens. If
//! this fails, pictures of several models show what is not so.
//!
//! With INFOBYTE_PICTURES=FOLDER the golden picture is also written there, to be looked at.

use crate::prelude::*;
use infobyte::Image;
use infobyte::render::picture::Traversal;
use infobyte::scene::{
    Ambient, Clip, CutPlane, Instance, Light, LightKind, Material, Painted, PictureSettings, Placement, paint,
};

fn add_scaled(a: [f64; 3], s: f64, b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|i| a[i] + s * b[i])
}

const STAY: Affine = Affine { rows: [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]] };

/// A solid given by its depth in mm (0 at the surface, above 0 within), around the origin, in voxels of this size.
fn solid(half: f64, spacing: f64, surface: SurfaceKind, depth: impl Fn([f64; 3]) -> f64) -> Model {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "small bodies")]
    let side = (2.0 * half / spacing).ceil() as u32 + 6;
    let middle = f64::from(side - 1) / 2.0;
    #[expect(clippy::cast_possible_truncation, reason = "a depth")]
    let at = |p: [u32; 3]| depth(p.map(|c| (f64::from(c) - middle) * spacing)) as f32;
    let mut affine = Affine::from_spacing([spacing; 3]);
    affine.rows.iter_mut().for_each(|row| row[3] = -middle * spacing);
    let volume = Voxels::from_fn(Dims::new(side, side, side).unwrap(), at).placed(affine);
    let options = BuildOptions {
        threshold: Threshold::Iso(0.0),
        surface: Some(surface),
        threads: 1,
        ..BuildOptions::default()
    };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("solid.oct");
    infobyte::build(&volume, &options, &path).unwrap();
    Model::open(&path).unwrap()
}

fn ball(radius: f64, spacing: f64, surface: SurfaceKind) -> Model {
    solid(radius, spacing, surface, |p| radius - dot(p, p).sqrt())
}

/// A cube whose faces lie on the axes.
fn cube(half: f64, spacing: f64) -> Model {
    solid(half, spacing, SurfaceKind::Cells, |p| half - p.iter().fold(0.0, |most: f64, c| most.max(c.abs())))
}

fn part<'a>(
    model: &Model,
    (view, file): (&'a ModelView<'a>, usize),
    placement: Affine,
    material: Material,
) -> Instance<'a> {
    Instance::new((view, file), model.dims(), &model.affine(), &placement, material, Clip::default()).unwrap()
}

fn moved(scale: [f64; 3], at: [f64; 3]) -> Affine {
    Placement { scale, turn_deg: [0.0; 3], pivot: [0.0; 3], at }.affine()
}

/// A colour alone, in light from everywhere.
fn plain(color: [f64; 3]) -> Material {
    Material { color, ..Material::default() }
}

fn look(eye: [f64; 3], look_at: [f64; 3], projection: Projection, fov: f64, side: u32) -> PictureSettings {
    let point = ViewPoint::Free { eye, look_at, up: None };
    PictureSettings {
        width: side,
        height: side,
        camera: Camera::new(point, projection, fov, 1.0, |_| 0.0).unwrap(),
        near_mm: 0.0,
        shading: None,
        lights: vec![],
        ambient: Ambient { color: [1.0; 3], rays: 0, reach_mm: f64::INFINITY },
        background: Some([0.0, 0.0, 1.0]),
        bounces: 8,
        samples: Samples::One,
        creases: true,
        smoothing: Smoothing::Smooth,
        traversal: Traversal::Exact,
        levels: vec![],
        section: None,
        ids: false,
        seen: false,
        max_band_pixels: None,
        threads: 2,
        depth_range_mm: None,
        normals: false,
    }
}

fn pixel(image: &Image, [x, y]: [u32; 2]) -> [u8; 3] {
    let at = 4 * (y * image.width + x) as usize;
    std::array::from_fn(|c| image.rgba[at + c])
}

/// The line of sight through a pixel.
fn line(look: &PictureSettings, [x, y]: [u32; 2]) -> ([f64; 3], [f64; 3]) {
    let at = |c: u32, side: u32| (2.0 * f64::from(c) + 1.0) / f64::from(side) - 1.0;
    let (origin, direction) = look.camera.ray(at(x, look.width), -at(y, look.height));
    let length = dot(direction, direction).sqrt();
    (origin, direction.map(|c| c / length))
}

/// Where a line meets a sphere about a point: the first t above 0.
fn sphere((origin, direction): ([f64; 3], [f64; 3]), middle: [f64; 3], radius: f64) -> Option<f64> {
    let from = add_scaled(origin, -1.0, middle);
    let (half, rest) = (dot(from, direction), dot(from, from) - radius * radius);
    let root = (half * half - rest).max(0.0).sqrt();
    (half * half >= rest)
        .then_some([-half - root, -half + root])
        .and_then(|t| t.into_iter().find(|t| *t > 1e-6))
}

/// Normals at the rim of a ball are those of the ball, within what they are stored and blended to; none leads the other
/// way.
#[test]
fn normals_at_silhouettes_are_not_negated() {
    for (spacing, radius, surface, most_deg) in [
        ([1.0; 3], 24.0_f64, SurfaceKind::Skin, 15.0),
        ([0.7, 1.3, 2.0], 24.0, SurfaceKind::Skin, 20.0),
        ([1.0; 3], 6.0, SurfaceKind::Skin, 30.0),
        ([1.0; 3], 24.0, SurfaceKind::Cells, 15.0),
        ([0.7, 1.3, 2.0], 24.0, SurfaceKind::Cells, 20.0),
    ] {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "small bodies")]
        let dims = spacing.map(|spacing| (2.0 * radius / spacing).ceil() as u32 + 6);
        let middle: [f64; 3] = std::array::from_fn(|a| f64::from(dims[a] - 1) / 2.0);
        #[expect(clippy::cast_possible_truncation, reason = "a depth")]
        let depth = |p: [u32; 3]| {
            let at: [f64; 3] = std::array::from_fn(|a| (f64::from(p[a]) - middle[a]) * spacing[a]);
            (radius - dot(at, at).sqrt()) as f32
        };
        let mut affine = Affine::from_spacing(spacing);
        (0..3).for_each(|a| affine.rows[a][3] = -middle[a] * spacing[a]);
        let [x, y, z] = dims;
        let volume = Voxels::from_fn(Dims::new(x, y, z).unwrap(), depth).placed(affine);
        let options = BuildOptions {
            threshold: Threshold::Iso(0.0),
            surface: Some(surface),
            threads: 1,
            ..BuildOptions::default()
        };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("ball.oct");
        infobyte::build(&volume, &options, &path).unwrap();
        let model = Model::open(&path).unwrap();
        let view = model.view();
        for material in [plain([1.0; 3]), Material { mirror: 0.5, ..plain([1.0; 3]) }] {
            let parts = [part(&model, (&view, 0), STAY, material)];
            let mut look = look([-90.0, -120.0, 70.0], [0.0; 3], Projection::Perspective, 25.0, 96);
            look.normals = true;
            let Painted { image, .. } = paint(&parts, &look, &|_| {}).unwrap();
            let normals = image.normals.as_ref().unwrap();
            let (mut seen, mut far, mut farthest) = (0, 0, 0.0_f64);
            for y in 0..96 {
                for x in 0..96 {
                    let at = 3 * (y * 96 + x) as usize;
                    if normals[at..at + 3] == [0; 3] {
                        continue;
                    }
                    seen += 1;
                    let n: [f64; 3] = std::array::from_fn(|a| f64::from(normals[at + a]) / 127.5 - 1.0);
                    let (origin, sight) = line(&look, [x, y]);
                    let t = sphere((origin, sight), [0.0; 3], radius).unwrap_or(-dot(origin, sight));
                    let p = add_scaled(origin, t, sight);
                    let cosine = dot(n, p) / (dot(n, n) * dot(p, p)).sqrt();
                    farthest = farthest.max(cosine.clamp(-1.0, 1.0).acos().to_degrees());
                    far += u32::from(cosine < 0.0);
                }
            }
            assert!(
                far == 0 && farthest < most_deg,
                "{spacing:?} {surface:?}: {far} of {seen} negated, {farthest} degrees off"
            );
        }
    }
}

/// The x of the wall that a pixel sees through balls about the origin, and how far behind them the wall is. A step has
/// a radius and the indices before and behind the surface; nothing near a rim or where all is thrown back.
fn seen_through(
    look: &PictureSettings,
    at: [u32; 2],
    steps: &[(f64, f64, f64)],
    is_clear: impl Fn(usize, f64, f64) -> bool,
) -> Option<(f64, f64)> {
    let mut ray = line(look, at);
    for (number, (radius, before, behind)) in steps.iter().enumerate() {
        ray.0 = add_scaled(ray.0, sphere(ray, [0.0; 3], *radius)?, ray.1);
        let outward = ray.0.map(|c| c / radius);
        let normal = if 2 * number < steps.len() { outward } else { outward.map(|c| -c) };
        let (cosine, ratio) = (-dot(normal, ray.1), before / behind);
        // Snell: the sine across the normal is multiplied by the ratio.
        let sine = ratio * dot(cross(normal, ray.1), cross(normal, ray.1)).sqrt();
        if !is_clear(number, cosine, sine) {
            return None;
        }
        let across = add_scaled(ray.1, cosine, normal);
        ray.1 = add_scaled(across.map(|c| c * ratio), -(1.0 - sine * sine).sqrt(), normal);
    }
    let reach = (60.0 - ray.0[1]) / ray.1[1];
    Some((ray.0[0] + reach * ray.1[0], reach)).filter(|(x, reach)| *reach > 0.0 && x.abs() < 190.0)
}

/// A red ball over a mirror: what every pixel shows is what geometry says, but for those within two pixels of an edge.
#[test]
fn a_mirror_shows_the_ball_where_it_is() {
    let (floor, red) = (cube(20.0, 1.0), ball(12.0, 0.5, SurfaceKind::Cells));
    let (floor_view, red_view) = (floor.view(), red.view());
    // Its top is at z = 0.
    let parts = [
        part(
            &floor,
            (&floor_view, 0),
            moved([5.0, 5.0, 0.5], [0.0, 0.0, -10.0]),
            Material { mirror: 1.0, ..Material::preset("mirror").unwrap() },
        ),
        part(&red, (&red_view, 1), moved([1.0; 3], [0.0, 10.0, 30.0]), plain([1.0, 0.0, 0.0])),
    ];
    let look = look([0.0, -150.0, 60.0], [0.0, 0.0, 10.0], Projection::Perspective, 35.0, 160);
    let Painted { image, counts: rays, .. } = paint(&parts, &look, &|_| {}).unwrap();
    let shown = |at: [u32; 2]| {
        let sight = line(&look, at);
        let direct = sphere(sight, [0.0, 10.0, 30.0], 12.0);
        let down = -sight.0[2] / sight.1[2];
        let at = add_scaled(sight.0, down, sight.1);
        let on_floor = down > 0.0 && at[0].abs() < 100.0 && at[1].abs() < 100.0;
        let back = [sight.1[0], sight.1[1], -sight.1[2]];
        direct.is_some() || on_floor && sphere((at, back), [0.0, 10.0, 30.0], 12.0).is_some()
    };
    let (mut red, mut mirrored) = (0, 0);
    for y in 2..158 {
        for x in 2..158 {
            let due = shown([x, y]);
            let edge = (0..5).any(|dy| (0..5).any(|dx| shown([x + dx - 2, y + dy - 2]) != due));
            let [r, _, b] = pixel(&image, [x, y]);
            if !edge {
                assert_eq!(r > b, due, "{x} {y}: {:?}", pixel(&image, [x, y]));
                red += u32::from(due);
                mirrored += u32::from(due && sphere(line(&look, [x, y]), [0.0, 10.0, 30.0], 12.0).is_none());
            }
        }
    }
    assert!(red > 600 && mirrored > 250, "{red} {mirrored}");
    assert!(rays.mirrored > 5000 && rays.refracted == 0 && rays.shadow == 0);
}

/// Through a ball of glass a wall, red on one side and green on the other, is seen as Snell's law has it.
#[test]
fn glass_bends_as_snell_says() {
    let (wall, glass) = (cube(20.0, 1.0), ball(20.0, 0.4, SurfaceKind::Cells));
    let (wall_view, glass_view) = (wall.view(), glass.view());
    let side =
        |x: f64, color| part(&wall, (&wall_view, 0), moved([5.0, 0.5, 10.0], [x, 70.0, 0.0]), plain(color));
    for index in [1.1, 1.33, 1.5, 2.0] {
        let material = Material { index, specular: 0.0, ..Material::preset("glass").unwrap() };
        let parts = [
            side(-100.0, [1.0, 0.0, 0.0]),
            side(100.0, [0.0, 1.0, 0.0]),
            part(&glass, (&glass_view, 1), STAY, material),
        ];
        let look = look([8.0, -100.0, 5.0], [3.0, 0.0, 0.0], Projection::Perspective, 26.0, 160);
        let Painted { image, .. } = paint(&parts, &look, &|_| {}).unwrap();
        let steps = [(20.0, 1.0, index), (20.0, index, 1.0)];
        let is_clear = |step, cosine, sine| (step > 0 || cosine >= 0.45) && sine < 1.0;
        let (mut seen, mut inverted) = (0, 0);
        for y in 0..160 {
            for x in 0..160 {
                let Some((due, reach)) = seen_through(&look, [x, y], &steps, is_clear) else { continue };
                let [r, g, _] = pixel(&image, [x, y]);
                // Normals of cells of a clean ball are within a degree; each surface turns a line by some of it.
                if due.abs() > 0.05 * reach {
                    assert_eq!(g > r, due > 0.0, "{index}: {x} {y} sees {due}: {:?}", pixel(&image, [x, y]));
                    seen += 1;
                    inverted += u32::from((due > 0.0) != (line(&look, [x, y]).1[0] * 160.0 > -8.0));
                }
            }
        }
        assert!(seen > 3000, "{index}: {seen}");
        // A strong lens turns left and right.
        assert_eq!(inverted > 1500, index > 1.2, "{index}: {inverted} of {seen}");
    }
}

/// A ball of one glass around a ball of another, or of air: a line is bent at all four surfaces as Snell's law has it.
#[test]
fn glass_within_glass_bends_by_both_indices() {
    const RADII: [f64; 2] = [20.0, 12.0];
    let (wall, outer, inner) =
        (cube(20.0, 1.0), ball(RADII[0], 0.4, SurfaceKind::Cells), ball(RADII[1], 0.25, SurfaceKind::Cells));
    let views = (wall.view(), outer.view(), inner.view());
    let side =
        |x: f64, color| part(&wall, (&views.0, 0), moved([5.0, 0.5, 10.0], [x, 70.0, 0.0]), plain(color));
    let glass = |index| Material { index, specular: 0.0, ..Material::preset("glass").unwrap() };
    for indices in [[1.5, 1.0], [1.1, 1.6], [1.6, 1.2], [1.4, 1.4]] {
        let parts = [
            side(-100.0, [1.0, 0.0, 0.0]),
            side(100.0, [0.0, 1.0, 0.0]),
            part(&outer, (&views.1, 1), STAY, glass(indices[0])),
            part(&inner, (&views.2, 2), STAY, glass(indices[1])),
        ];
        let look = look([8.0, -100.0, 5.0], [3.0, 0.0, 0.0], Projection::Perspective, 26.0, 160);
        let Painted { image, .. } = paint(&parts, &look, &|_| {}).unwrap();
        let steps = [
            (RADII[0], 1.0, indices[0]),
            (RADII[1], indices[0], indices[1]),
            (RADII[1], indices[1], indices[0]),
            (RADII[0], indices[0], 1.0),
        ];
        let is_clear = |_, cosine, sine| cosine >= 0.45 && sine < 0.95;
        let mut seen = 0;
        for y in 0..160 {
            for x in 0..160 {
                let Some((due, reach)) = seen_through(&look, [x, y], &steps, is_clear) else { continue };
                let [r, g, _] = pixel(&image, [x, y]);
                if due.abs() > 0.08 * reach {
                    assert_eq!(
                        g > r,
                        due > 0.0,
                        "{indices:?}: {x} {y} sees {due}: {:?}",
                        pixel(&image, [x, y])
                    );
                    seen += 1;
                }
            }
        }
        assert!(seen > 800, "{indices:?}: {seen}");
    }
}

/// Between two mirrors that throw back half a line goes to and fro as often as it may, and brings what it met.
#[test]
fn lines_are_thrown_back_as_often_as_they_may() {
    let wall = cube(20.0, 1.0);
    let view = wall.view();
    let color = [0.9, 0.6, 0.3];
    let half = Material { mirror: 0.5, ..plain(color) };
    let parts = [
        part(&wall, (&view, 0), moved([60.0, 1.0, 60.0], [0.0, 70.0, 0.0]), half),
        part(&wall, (&view, 0), moved([60.0, 1.0, 60.0], [0.0, -70.0, 0.0]), half),
    ];
    for bounces in 0..7 {
        let mut look = look([0.0; 3], [3.0, 50.0, 5.0], Projection::Perspective, 30.0, 24);
        look.bounces = bounces;
        let Painted { image, counts: rays, .. } = paint(&parts, &look, &|_| {}).unwrap();
        assert_eq!(rays.mirrored, 24 * 24 * u64::from(bounces));
        let want = color.map(|c: f64| {
            let light: f64 = (0..=bounces).map(|k| (0.5 * c).powi(k.cast_signed()) * 0.5 * c).sum();
            let code =
                if light <= 0.003_130_8 { 12.92 * light } else { 1.055 * light.powf(1.0 / 2.4) - 0.055 };
            255.0 * code
        });
        for at in [[0, 0], [12, 12], [23, 5], [3, 23]] {
            let got = pixel(&image, at).map(f64::from);
            assert!((0..3).all(|c| (got[c] - want[c]).abs() < 1.5), "{bounces}: {got:?} {want:?}");
        }
    }
}

/// The shadow of a cube on a floor, in light from the side, ends where geometry says, to half a voxel.
#[test]
fn shadows_end_where_the_light_passes_the_edge() {
    let stone = cube(10.0, 0.5);
    let view = stone.view();
    let white = plain([1.0; 3]);
    let parts = [
        // Top at z = 0; and a cube from z = 4 to z = 24, |x|, |y| < 10.
        part(&stone, (&view, 0), moved([10.0, 10.0, 1.0], [0.0, 0.0, -10.0]), white),
        part(&stone, (&view, 0), moved([1.0; 3], [0.0, 0.0, 14.0]), white),
    ];
    let mut look = look([0.0, 0.0, 200.0], [0.0, 0.0, 0.0], Projection::Parallel, 35.0, 252);
    let half_mm = 200.0 * (17.5_f64).to_radians().tan();
    look.ambient.color = [0.05; 3];
    let towards = [0.6, 0.0, 0.8];
    look.lights = vec![Light { kind: LightKind::Directional { towards }, color: [0.9; 3], shadows: true }];
    let Painted { image, counts: rays, .. } = paint(&parts, &look, &|_| {}).unwrap();
    assert!(rays.shadow > 30_000);
    // Light from +x throws the shadow to -x: from the lower edge at x = 10 to the upper edge at x = -10.
    let far = -10.0 - 24.0 * 0.75;
    let column = |x: f64| {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "in the picture")]
        let x = ((x / half_mm + 1.0) * 126.0) as u32;
        x
    };
    let dark = |x: f64, y: f64| {
        let at = [column(x), 251 - column(y)];
        pixel(&image, at)[0] < 120
    };
    for y in [-8.0, -3.3, 0.0, 5.1, 9.0] {
        assert!(dark(far + 0.6, y) && !dark(far - 0.6, y), "{y}");
        // Beside the cube on the side of the light nothing is dark.
        assert!(!dark(11.0, y) && !dark(14.0, y));
    }
    for x in [-26.0, -20.0, -12.0] {
        assert!(dark(x, 9.4) && !dark(x, 10.6) && dark(x, -9.4) && !dark(x, -10.6), "{x}");
    }
    // A light that throws no shadows.
    look.lights[0].shadows = false;
    let Painted { image, counts: rays, .. } = paint(&parts, &look, &|_| {}).unwrap();
    assert!(rays.shadow == 0 && pixel(&image, [column(-20.0), 126])[0] > 180);
}

/// What is cut open is closed where it is solid, and open where it is hollow.
#[test]
fn cuts_are_closed_where_matter_is() {
    // A shell, 12 to 20 mm.
    let shell = solid(20.0, 0.5, SurfaceKind::Cells, |p| 4.0 - (dot(p, p).sqrt() - 16.0).abs());
    let view = shell.view();
    let cap = Some([0.0, 1.0, 0.0]);
    let clip = Clip::new(vec![CutPlane { normal: [0.0, -1.0, 0.0], limit: 3.0, cap }]);
    let red = plain([1.0, 0.0, 0.0]);
    let part = Instance::new((&view, 0), shell.dims(), &shell.affine(), &STAY, red, clip).unwrap();
    let look = look([0.0, -100.0, 0.0], [0.0, 0.0, 0.0], Projection::Parallel, 35.0, 128);
    let half_mm = 100.0 * (17.5_f64).to_radians().tan();
    let Painted { image, .. } = paint(&[part], &look, &|_| {}).unwrap();
    let at_cut = |radius: f64| (radius * radius - 9.0).sqrt();
    for y in 0..128 {
        for x in 0..128 {
            let (px, py) = ((f64::from(x) + 0.5) / 64.0 - 1.0, (f64::from(y) + 0.5) / 64.0 - 1.0);
            let radius = px.hypot(py) * half_mm;
            let [r, g, b] = pixel(&image, [x, y]);
            let due = if radius > at_cut(20.0) {
                b
            } else if radius > at_cut(12.0) {
                g
            } else {
                r
            };
            if [12.0, 20.0].iter().all(|edge| (radius - at_cut(*edge)).abs() > 1.0) {
                assert_eq!(due, r.max(g).max(b), "{x} {y} at {radius}: {r} {g} {b}");
            }
        }
    }
}

/// The eye within a body sees its walls, and what is nearer than the near plane is not seen.
#[test]
fn the_eye_may_be_within_and_near_things_are_left_out() {
    let model = ball(20.0, 0.5, SurfaceKind::Skin);
    let view = model.view();
    let parts = [part(&model, (&view, 0), STAY, plain([1.0, 0.0, 0.0]))];
    let mut inside = look([0.0; 3], [0.0, 10.0, 0.0], Projection::Perspective, 90.0, 64);
    let Painted { counts: rays, .. } = paint(&parts, &inside, &|_| {}).unwrap();
    assert_eq!((rays.rays, rays.hits), (4096, 4096));
    inside.near_mm = 25.0;
    assert_eq!(paint(&parts, &inside, &|_| {}).unwrap().counts.hits, 0);
    let mut before = look([0.0, -60.0, 0.0], [0.0, 0.0, 0.0], Projection::Perspective, 20.0, 64);
    before.depth_range_mm = Some((0.0, 100.0));
    let depth = |look: &PictureSettings| {
        let Painted { image, .. } = paint(&parts, look, &|_| {}).unwrap();
        f64::from(image.depth.unwrap()[32 * 64 + 32] - 1) / 65534.0 * 100.0
    };
    assert!((depth(&before) - 40.0).abs() < 0.6);
    before.near_mm = 50.0;
    assert!((depth(&before) - 80.0).abs() < 0.6);
}

/// Three bodies, two of them instances of one file, with mirrors, glass, shadows, occlusion, and several lines a pixel.
/// The picture is the same on every machine and at any number of threads.
#[test]
fn three_bodies_give_this_picture() {
    let (stone, round) = (cube(10.0, 0.5), ball(10.0, 0.4, SurfaceKind::Cells));
    let (stone_view, round_view) = (stone.view(), round.view());
    let chrome = Material { color: [0.9, 0.8, 0.6], ..Material::preset("metal").unwrap() };
    let floor = Material { mirror: 0.3, ..plain([0.6, 0.7, 0.8]) };
    let parts = [
        part(&stone, (&stone_view, 0), moved([8.0, 8.0, 0.5], [0.0, 0.0, -15.0]), floor),
        part(&round, (&round_view, 1), moved([1.0; 3], [-12.0, 8.0, 0.0]), chrome),
        part(
            &round,
            (&round_view, 1),
            moved([0.9; 3], [11.0, -8.0, -1.0]),
            Material::preset("glass").unwrap(),
        ),
    ];
    let mut look = look([-20.0, -110.0, 45.0], [0.0, 0.0, -4.0], Projection::Perspective, 32.0, 96);
    look.height = 72;
    look.camera = Camera::new(
        ViewPoint::Free { eye: [-20.0, -110.0, 45.0], look_at: [0.0, 0.0, -4.0], up: None },
        Projection::Perspective,
        15.0,
        96.0 / 72.0,
        |_| 0.0,
    )
    .unwrap();
    look.ambient = Ambient { color: [0.25; 3], rays: 8, reach_mm: 60.0 };
    look.background = Some([0.25, 0.4, 0.5]);
    look.samples = Samples::Four;
    look.lights =
        vec![Light { kind: LightKind::Point { at: [-80.0, -90.0, 120.0] }, color: [0.8; 3], shadows: true }];
    let pictures = [1, 3].map(|threads| {
        look.threads = threads;
        paint(&parts, &look, &|_| {}).unwrap()
    });
    assert_eq!(pictures[0].image, pictures[1].image);
    let [one, three] = [0, 1].map(|at| (pictures[at].counts.rays, pictures[at].counts.secondary()));
    assert_eq!(one, three);
    let Painted { image, counts: rays, .. } = &pictures[0];
    if let Ok(folder) = std::env::var("INFOBYTE_PICTURES") {
        image.write_png(std::path::Path::new(&folder).join("three-bodies.png")).unwrap();
    }
    assert!(rays.mirrored > 1000 && rays.refracted > 1000 && rays.shadow > 1000 && rays.ambient > 1000);
    assert_eq!(crc32c::crc32c(&image.rgba), GOLDEN, "{rays:?}");
}

/// Checksum of the picture of [`three_bodies_give_this_picture`].
const GOLDEN: u32 = 2_518_205_866;
