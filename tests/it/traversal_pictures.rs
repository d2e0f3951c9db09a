//! The promise: pictures show the model as it stands in the world, and have the same bytes at any number of
//! threads. If this file fails, heads face the wrong way, are mirrored, or differ between machines.
//!
//! With INFOBYTE_PICTURES=FOLDER the pictures are also written there, to be looked at.

use crate::prelude::*;

use infobyte::jobs::render::{render_view as render, selfcheck, thumbnail};
use infobyte::render::Image;
use infobyte::render::picture::Traversal;

/// Writes a picture where a person can see it, if asked.
fn show(image: &Image, name: &str) {
    if let Ok(folder) = std::env::var("INFOBYTE_PICTURES") {
        image.write_png(std::path::Path::new(&folder).join(format!("{name}.png"))).unwrap();
    }
}

fn unit_affine() -> Affine {
    Affine::from_spacing([1.0; 3])
}

/// A letter F that reads right from the front (stem at low x, bars towards +x, top at high z), with a foot
/// that sticks out to the front (-y) from the stem's lower end.
fn in_letter([x, y, z]: [u32; 3]) -> bool {
    let body = (40..52).contains(&y) && (4..60).contains(&z);
    let stem = body && (8..20).contains(&x);
    let bars = body
        && ((48..60).contains(&z) && (8..56).contains(&x) || (28..38).contains(&z) && (8..44).contains(&x));
    let foot = (4..12).contains(&z) && (8..20).contains(&x) && (10..52).contains(&y);
    stem || bars || foot
}

fn letter() -> Scene {
    Scene::skin("letter", [64; 3], in_letter)
}

fn torus() -> Scene {
    Scene::skin("torus", [64; 3], |c| in_torus(c, 64)).with_normals(|p| {
        let [x, y, z] = p.map(|v| v - 32.0);
        let ring = 1.0 - 0.3 * 64.0 / (x * x + y * y).sqrt();
        [x * ring, y * ring, z]
    })
}

fn request(view: NamedView, projection: Projection) -> RenderRequest {
    RenderRequest {
        size: Some([160; 2]),
        point: Some(ViewPoint::Named(view)),
        projection: Some(projection),
        threads: 2,
        ..RenderRequest::default()
    }
}

fn alpha(image: &Image, x: u32, y: u32) -> u8 {
    image.rgba[((y * image.width + x) * 4 + 3) as usize]
}

fn red(image: &Image, x: u32, y: u32) -> u8 {
    image.rgba[((y * image.width + x) * 4) as usize]
}

/// Is there something at a place of the picture, given as parts of the model's extent: right, down?
fn filled(image: &Image, right: f64, down: f64) -> bool {
    let (mut low, mut high) = ([u32::MAX; 2], [0; 2]);
    for y in 0..image.height {
        for x in 0..image.width {
            if alpha(image, x, y) > 0 {
                low = [low[0].min(x), low[1].min(y)];
                high = [high[0].max(x), high[1].max(y)];
            }
        }
    }
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "within the picture")]
    let at = |a: usize, part: f64| low[a] + (part * f64::from(high[a] - low[a])).round() as u32;
    alpha(image, at(0, right), at(1, down)) > 0
}

#[test]
fn named_views_show_the_letter_the_right_way_round() {
    let scene = letter();
    // Places that are filled, and places that are empty.
    type Places = &'static [(f64, f64)];
    let table: [(NamedView, Places, Places); 6] = [
        (NamedView::Front, &[(0.95, 0.05), (0.05, 0.95), (0.6, 0.5)], &[(0.95, 0.95), (0.95, 0.5)]),
        (NamedView::Back, &[(0.05, 0.05), (0.95, 0.95), (0.4, 0.5)], &[(0.05, 0.95), (0.05, 0.5)]),
        (NamedView::Left, &[(0.05, 0.95), (0.95, 0.05)], &[(0.05, 0.05), (0.5, 0.5)]),
        (NamedView::Right, &[(0.95, 0.95), (0.05, 0.05)], &[(0.95, 0.05), (0.5, 0.5)]),
        (NamedView::Top, &[(0.05, 0.95), (0.95, 0.05)], &[(0.95, 0.95), (0.5, 0.5)]),
        (NamedView::Bottom, &[(0.05, 0.05), (0.95, 0.95)], &[(0.95, 0.05), (0.5, 0.5)]),
    ];
    for (view, full, empty) in table {
        for projection in [Projection::Parallel, Projection::Perspective] {
            let one = RenderRequest { samples: Some(Samples::One), ..request(view, projection) };
            let (image, report) = render(&scene.tree.view(), scene.dims, &unit_affine(), &one).unwrap();
            show(&image, &format!("letter-{}-{projection:?}", view.name()));
            assert!(report.hits > 2000 && report.rays == 160 * 160, "{report:?}");
            if projection == Projection::Parallel {
                assert!(full.iter().all(|(r, d)| filled(&image, *r, *d)), "{view:?} lacks something");
                assert!(empty.iter().all(|(r, d)| !filled(&image, *r, *d)), "{view:?} has too much");
            }
        }
    }
    for projection in [Projection::Parallel, Projection::Perspective] {
        let (image, _) =
            render(&scene.tree.view(), scene.dims, &unit_affine(), &request(NamedView::Iso, projection))
                .unwrap();
        show(&image, &format!("letter-iso-{projection:?}"));
    }
}

#[test]
fn the_picture_does_not_depend_on_how_the_volume_was_stored() {
    let want = letter();
    for letters in ["RAI", "LAS", "RPS"] {
        let orientation = Orientation::parse(letters).unwrap();
        let affine = orientation.affine([1.0; 3]);
        // Index axes that run backwards: the same body stored from the other end.
        let flip: [bool; 3] = std::array::from_fn(|a| affine.rows[a][a] < 0.0);
        let stored = Scene::skin("stored", [64; 3], |c| {
            in_letter(std::array::from_fn(|a| if flip[a] { 63 - c[a] } else { c[a] }))
        });
        for view in NamedView::ALL {
            let request = request(view, Projection::Parallel);
            let (a, _) = render(&want.tree.view(), want.dims, &unit_affine(), &request).unwrap();
            let (b, _) = render(&stored.tree.view(), stored.dims, &affine, &request).unwrap();
            assert!(a == b, "{letters} {view:?}");
        }
    }
}

#[test]
fn a_lit_ball_is_bright_where_it_faces_the_eye() {
    let ball = Scene::skin("ball", [64; 3], |c| in_ball(c, 64)).with_normals(|p| p.map(|v| v - 32.0));
    for view in NamedView::ALL {
        for projection in [Projection::Parallel, Projection::Perspective] {
            let plain = RenderRequest { shading: Some(Shading::Plain), ..request(view, projection) };
            let (image, _) = render(&ball.tree.view(), ball.dims, &unit_affine(), &plain).unwrap();
            show(&image, &format!("ball-{}-{projection:?}", view.name()));
            let centre = red(&image, 80, 80);
            assert!(centre > 230, "{view:?} {projection:?}: {centre}");
            for (x, y) in [(10, 80), (149, 80), (80, 10), (80, 149)] {
                assert!(
                    alpha(&image, x, y) == 255 && red(&image, x, y) < centre - 40,
                    "{view:?} {projection:?}"
                );
            }
            assert_eq!(alpha(&image, 8, 8), 0);
        }
    }
}

#[test]
fn normals_are_turned_into_the_world() {
    // A slab tilted in the index frame, under an affine that is sheared, anisotropic and mirrored.
    let affine = Affine { rows: [[-0.7, 0.0, 0.4, 5.0], [0.0, 0.9, 0.0, -8.0], [0.0, 0.0, 2.0, 1.0]] };
    let spacing = affine.spacing_mm();
    let gradient = [0.5 / spacing[0], 0.8 / spacing[1], -0.3 / spacing[2]];
    let slab = Scene::skin("slab", [48; 3], |c| {
        (0..3).map(|a| [0.5, 0.8, -0.3][a] * (f64::from(c[a]) - 23.5)).sum::<f64>().abs() < 5.0
    })
    .with_normals(|p| {
        let side: f64 = (0..3).map(|a| [0.5, 0.8, -0.3][a] * (p[a] - 24.0)).sum();
        gradient.map(|g| g * side.signum())
    });
    let mut request = request(NamedView::Front, Projection::Parallel);
    request.normals = true;
    let (image, _) = render(&slab.tree.view(), slab.dims, &affine, &request).unwrap();
    let normals = image.normals.unwrap();
    let at = (80 * 160 + 80) * 3;
    let got: [f64; 3] = std::array::from_fn(|c| (f64::from(normals[at + c]) - 128.0) / 127.0);
    // Independent of B: the plane's world normal is perpendicular to two world vectors within it.
    let within = [affine.apply_vector([8.0, -5.0, 0.0]), affine.apply_vector([0.0, 3.0, 8.0])];
    for w in within {
        let length = w.iter().map(|c| c * c).sum::<f64>().sqrt();
        let cosine: f64 = (0..3).map(|c| w[c] * got[c] / length).sum();
        assert!(cosine.abs() < 0.02, "{got:?} {cosine}");
    }
    assert!(got[1] < 0.0, "the side that faces the front viewer: {got:?}");
}

#[test]
fn pictures_have_the_same_bytes_at_any_number_of_threads() {
    let torus = torus();
    for projection in [Projection::Parallel, Projection::Perspective] {
        let mut asked = request(NamedView::Iso, projection);
        asked.size = Some([203, 117]);
        (asked.depth, asked.normals) = (true, true);
        asked.threads = 1;
        let (one, report) = render(&torus.tree.view(), torus.dims, &unit_affine(), &asked).unwrap();
        show(&one, &format!("torus-iso-{projection:?}"));
        assert!(report.rays > 203 * 117);
        for threads in [2, 3, 8] {
            asked.threads = threads;
            let (many, again) = render(&torus.tree.view(), torus.dims, &unit_affine(), &asked).unwrap();
            assert!(one == many, "{threads} threads");
            assert_eq!((report.rays, report.hits, report.steps), (again.rays, again.hits, again.steps));
        }
    }
}

#[test]
fn pictures_have_the_same_bytes_on_every_machine() {
    // Checksums of pixels, depth and normals as first made; they change only with the camera, the light or
    // the definition of a hit, and then on purpose.
    let torus = torus();
    let affine = Affine { rows: [[0.7, 0.1, 0.0, 3.0], [-0.1, 0.8, 0.05, -4.0], [0.0, 0.0, 1.3, 9.0]] };
    let mut sums = Vec::new();
    for projection in [Projection::Parallel, Projection::Perspective] {
        let mut asked = request(NamedView::Iso, projection);
        (asked.depth, asked.normals) = (true, true);
        let (image, _) = render(&torus.tree.view(), torus.dims, &affine, &asked).unwrap();
        show(&image, &format!("torus-sheared-{projection:?}"));
        let depth: Vec<u8> = image.depth.unwrap().iter().flat_map(|d| d.to_le_bytes()).collect();
        sums.extend([image.rgba, depth, image.normals.unwrap()].map(|bytes| crc32c::crc32c(&bytes)));
    }
    assert_eq!(
        sums,
        [0xd603_4b2a, 0x96e3_fded, 0xac56_dc24, 0x82f4_9211, 0xc3ba_de5e, 0xc84e_31e2],
        "{sums:#x?}"
    );
}

#[test]
fn position_and_scale_of_the_world_do_not_matter() {
    let ball = Scene::skin("ball", [32; 3], |c| in_ball(c, 32)).with_normals(|p| p.map(|v| v - 16.0));
    let hits = |scale: f64, offset: f64| {
        let mut affine = Affine::from_spacing([scale; 3]);
        affine.rows.iter_mut().for_each(|row| row[3] = offset * scale);
        render(&ball.tree.view(), ball.dims, &affine, &request(NamedView::Iso, Projection::Perspective))
            .unwrap()
            .1
            .hits
    };
    let want = hits(1.0, 0.0);
    // A box 1e6 voxels away, at a millionth of the size, and other extremes.
    for (scale, offset) in [(1e-6, 1e6), (1e-12, 0.0), (1e12, 0.0), (1.0, 1e7), (1e3, -1e6)] {
        let got = hits(scale, offset);
        assert!(got.abs_diff(want) <= 20, "{scale} {offset}: {got} for {want}");
    }
}

#[test]
fn depth_is_measured_along_the_camera() {
    // A wall at y = 40 seen from the front, and from a free camera in mm.
    let wall = Scene::set("wall", [64; 3], |[_, y, _]| y == 40);
    let affine = Affine::from_spacing([0.5, 0.25, 1.0]);
    let mut asked = request(NamedView::Front, Projection::Perspective);
    asked.point = Some(ViewPoint::Free { eye: [16.0, -30.0, 32.0], look_at: [16.0, 0.0, 32.0], up: None });
    asked.fov_deg = Some(80.0);
    asked.depth = true;
    let (image, report) = render(&wall.tree.view(), wall.dims, &affine, &asked).unwrap();
    let depth = image.depth.unwrap();
    let (near, far) = (report.depth_near_mm, report.depth_far_mm);
    // The voxel's near face: index 40, so grid 40, so 39.5 * 0.25 mm.
    assert!((near - (30.0 + 39.5 * 0.25)).abs() < 0.01 && (far - near - 0.25).abs() < 0.02, "{near} {far}");
    assert!(depth.iter().filter(|d| **d > 0).count() > 1000);
    assert!(depth.iter().all(|d| *d < 300), "all of the wall is at the same depth, not distance");
}

#[test]
fn an_eye_in_a_voxel_sees_it_at_depth_0() {
    let full = Scene::set("full", [8; 3], |_| true);
    let mut asked = request(NamedView::Front, Projection::Perspective);
    asked.point = Some(ViewPoint::Free { eye: [3.0; 3], look_at: [3.0, 4.0, 3.0], up: None });
    asked.depth = true;
    let (image, report) = render(&full.tree.view(), full.dims, &unit_affine(), &asked).unwrap();
    assert_eq!(report.hits, report.rays);
    assert!(image.depth.unwrap().iter().all(|d| *d == 1), "the eye's own voxel is hit at depth 0");
}

#[test]
fn coarse_boxes_are_as_large_as_is_asked() {
    let ball = Scene::skin("ball", [128; 3], |c| in_ball(c, 128)).with_normals(|p| p.map(|v| v - 64.0));
    let of = |lod: bool, lod_bias: i8| {
        let exact = request(NamedView::Iso, Projection::Parallel);
        let asked = RenderRequest { size: Some([32; 2]), lod, lod_bias, ..exact };
        render(&ball.tree.view(), ball.dims, &unit_affine(), &asked).unwrap()
    };
    assert_eq!([0, 1].map(|bias| of(true, bias).1.smallest_box), [4, 8]);
    // Below four voxels there are no mean normals: voxels are shown.
    assert_eq!(of(true, -1).0.rgba, of(false, 0).0.rgba);
}

/// Pixels of which a colour differs by more than this, and pixels on the other side of the silhouette.
fn differing(a: &Image, b: &Image, more_than: u8) -> (usize, usize) {
    let pairs = || a.rgba.as_chunks::<4>().0.iter().zip(b.rgba.as_chunks::<4>().0);
    let color = pairs().filter(|(a, b)| (0..3).any(|c| a[c].abs_diff(b[c]) > more_than)).count();
    (color, pairs().filter(|(a, b)| a[3] != b[3]).count())
}

#[test]
fn discrete_rays_show_nearly_the_same_picture() {
    let ball = Scene::skin("ball", [64; 3], |c| in_ball(c, 64)).with_normals(|p| p.map(|v| v - 32.0));
    for projection in [Projection::Parallel, Projection::Perspective] {
        let exact = RenderRequest { depth: true, ..request(NamedView::Iso, projection) };
        let discrete = RenderRequest { traversal: Traversal::Discrete, ..exact.clone() };
        let (a, _) = render(&ball.tree.view(), ball.dims, &unit_affine(), &exact).unwrap();
        let (b, report) = render(&ball.tree.view(), ball.dims, &unit_affine(), &discrete).unwrap();
        assert_eq!(report.traversal, Traversal::Discrete);
        show(&b, "discrete");
        let (color, silhouette) = differing(&a, &b, 0);
        // A voxel that the line passes by may come first: every fifth hit, and a few more at the silhouette.
        assert!(color > 0 && color < 160 * 160 / 5 && silhouette < 160 * 160 / 50, "{color} {silhouette}");
        let lost = a
            .rgba
            .as_chunks::<4>()
            .0
            .iter()
            .zip(b.rgba.as_chunks::<4>().0)
            .filter(|(a, b)| a[3] > b[3])
            .count();
        assert_eq!(lost, 0, "what the line pierces is never missed");
        let one = RenderRequest { threads: 1, ..discrete };
        assert_eq!(render(&ball.tree.view(), ball.dims, &unit_affine(), &one).unwrap().0, b);
    }
}

#[test]
fn thumbnails_use_the_coarser_levels_and_look_alike() {
    let ball = Scene::skin("ball", [128; 3], |c| in_ball(c, 128)).with_normals(|p| p.map(|v| v - 64.0));
    let (coarse, report) = thumbnail(&ball.tree.view(), ball.dims, &unit_affine(), 32, 1).unwrap();
    assert_eq!(report.smallest_box, 4);
    assert_eq!((coarse.width, coarse.height), (32, 32));
    let exact = RenderRequest { size: Some([32; 2]), ..RenderRequest::default() };
    let (fine, exact_report) = render(&ball.tree.view(), ball.dims, &unit_affine(), &exact).unwrap();
    assert_eq!(exact_report.smallest_box, 1);
    assert!(report.steps < exact_report.steps);
    let both = coarse.rgba.as_chunks::<4>().0.iter().zip(fine.rgba.as_chunks::<4>().0);
    let (mut sum, mut count) = (0, 0);
    for (a, b) in both.filter(|(a, b)| a[3] == 255 && b[3] == 255) {
        sum += u32::from(a[0].abs_diff(b[0]));
        count += 1;
    }
    assert!(count > 500 && sum / count < 8, "{sum} {count}");
    assert!(coarse.rgba.as_chunks::<4>().0.iter().any(|p| (1..255).contains(&p[3])), "soft edges");
    // Without mean normals the voxels' own are shown.
    let codes = vec![0x1234; ball.tree.voxels().len()];
    let bare = MemoryTree::new(ball.dims, ball.tree.voxels()).unwrap().with_normals(codes).unwrap();
    assert_eq!(thumbnail(&bare.view(), ball.dims, &unit_affine(), 32, 1).unwrap().1.smallest_box, 1);
    let (large, _) = thumbnail(&ball.tree.view(), ball.dims, &unit_affine(), 256, 2).unwrap();
    show(&large, "ball-thumbnail");
}

/// The cadaver head of the Stanford archive, if it is there: 256 x 256 x 113, i16 big-endian, 1 : 1 : 2.
fn cadaver_head() -> Option<Vec<i16>> {
    let folder = std::env::var("INFOBYTE_DATA")
        .unwrap_or_else(|_| concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/data").into());
    let mut samples = Vec::new();
    for slice in 1..=113 {
        let bytes = std::fs::read(format!("{folder}/raw-cthead/CThead.{slice}")).ok()?;
        samples.extend(bytes.as_chunks::<2>().0.iter().map(|b| i16::from_be_bytes(*b)));
    }
    (samples.len() == 256 * 256 * 113).then_some(samples)
}

#[test]
fn a_real_head_shows_its_face_to_the_front() {
    let Some(samples) = cadaver_head() else {
        println!("skipped: the cadaver head is not there; set INFOBYTE_DATA");
        return;
    };
    let dims = [256, 256, 113];
    let at = |c: [u32; 3]| samples[((c[2] * 256 + c[1]) * 256 + c[0]) as usize];
    let value = |c: [f64; 3]| {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
        let cell = std::array::from_fn(|a| c[a].clamp(0.0, f64::from(dims[a] - 1)) as u32);
        f64::from(at(cell))
    };
    // Scanned from the head down, the face to low y, columns from the patient's right to the left.
    let affine = Orientation::parse("LPI").unwrap().affine([1.0, 1.0, 2.0]);
    for (name, iso) in [("skin", 600), ("bone", 1300)] {
        let head = Scene::skin(name, dims, |c| at(c) >= iso).with_normals(|p| {
            let low = p.map(|v| v - 0.5);
            std::array::from_fn(|a| {
                let step = |by: f64| {
                    let mut c = low;
                    c[a] += by;
                    value(c)
                };
                let difference = (step(-1.0) - step(1.0)) / [1.0, 1.0, 2.0][a];
                if difference == 0.0 { 1e-3 } else { difference }
            })
        });
        for view in NamedView::ALL {
            let mut asked = request(view, Projection::Parallel);
            asked.size = Some([320; 2]);
            let (image, report) = render(&head.tree.view(), head.dims, &affine, &asked).unwrap();
            show(&image, &format!("head-{name}-{}", view.name()));
            assert!(report.hits > 20_000, "{report:?}");
        }
        let (image, report) = thumbnail(&head.tree.view(), head.dims, &affine, 128, 2).unwrap();
        show(&image, &format!("head-{name}-thumbnail"));
        println!("{name}: {report:?}");
        let counts = selfcheck(&head.tree.view(), 50_000, 3, 2).unwrap();
        assert_eq!(counts.total(), 0, "{counts:?}");
    }
}

#[test]
fn smallest_models_and_senseless_requests() {
    let one = Scene::set("1x1x1", [1; 3], |_| true);
    let (image, report) = thumbnail(&one.tree.view(), one.dims, &unit_affine(), 16, 1).unwrap();
    assert!(report.hits > 100 && alpha(&image, 8, 8) == 255);
    let empty = Scene::set("empty", [8; 3], |_| false);
    assert_eq!(thumbnail(&empty.tree.view(), empty.dims, &unit_affine(), 16, 1).unwrap().1.hits, 0);
    for (width, height) in [(0, 5), (5, 0), (u32::MAX, 1), (32_768, 32_768)] {
        let asked = RenderRequest { size: Some([width, height]), ..RenderRequest::default() };
        let refused = render(&one.tree.view(), one.dims, &unit_affine(), &asked);
        assert!(refused.unwrap_err().to_string().contains("is not possible"));
    }
    let flat = Affine::from_spacing([1.0, 0.0, 1.0]);
    let refused = render(&one.tree.view(), one.dims, &flat, &RenderRequest::default());
    assert!(refused.unwrap_err().to_string().contains("axes are (nearly) parallel"));
}

#[test]
fn the_self_check_counts_every_ray_at_any_number_of_threads() {
    let torus = Scene::skin("torus", [32; 3], |c| in_torus(c, 32));
    let one = selfcheck(&torus.tree.view(), 100_000, 7, 1).unwrap();
    assert_eq!((one.total(), one.rays), (0, 100_000));
    assert!(one.hits > 10_000);
    assert_eq!(selfcheck(&torus.tree.view(), 100_000, 7, 3).unwrap(), one);
    let deep = MemoryTree::new(Dims::new(2000, 1, 1).unwrap(), &[0]).unwrap();
    assert!(selfcheck(&deep.view(), 1, 1, 1).unwrap_err().to_string().contains("too large"));
}
