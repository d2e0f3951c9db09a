use super::*;
use crate::builder::BuildOptions;
use crate::format::SurfaceKind;
use crate::geom::{Affine, Dims};
use crate::jobs::render::RenderRequest;
use crate::jobs::scene::picture_of;
use crate::progress::Silent;
use crate::random::Random;
use crate::{Threshold, Voxels};

const SIDE: u32 = 40;
const SPACING: f64 = 0.5;

/// A body about the middle of a cube, by a field below 0 inside; in voxels of half a millimetre.
fn build(folder: &Path, body: &dyn Fn([f64; 3]) -> f64, surface: SurfaceKind) -> std::path::PathBuf {
    let path = folder.join("m.oct");
    #[expect(clippy::cast_possible_truncation, reason = "samples in single precision")]
    let sample = |p: [u32; 3]| -body(p.map(|c| f64::from(c) - 19.6)) as f32;
    let dims = Dims::new(SIDE, SIDE, SIDE).unwrap();
    let volume = Voxels::from_fn(dims, sample).placed(Affine::from_spacing([SPACING; 3]));
    let options =
        BuildOptions { threshold: Threshold::Iso(0.0), surface: Some(surface), ..Default::default() };
    crate::build(&volume, &options, &path).unwrap();
    path
}

fn length(p: [f64; 3]) -> f64 {
    p.iter().map(|c| c * c).sum::<f64>().sqrt()
}

#[test]
fn plates_shells_and_tubes_are_as_thick_as_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let wall = |at: f64, thick: f64| at.abs() - thick / 2.0;
    let turned = |p: [f64; 3]| (2.0 * p[0] + 3.0 * p[1] + 6.0 * p[2]) / 7.0;
    type Body<'a> = &'a dyn Fn([f64; 3]) -> f64;
    let bodies: [(Body<'_>, f64, f64); 6] = [
        (&|p| wall(p[2], 6.0), 6.0, 0.035),
        (&|p| wall(turned(p), 6.0), 6.0, 0.035),
        (&|p| wall(turned(p), 3.0), 3.0, 0.03),
        (&|p| wall(turned(p), 2.0), 2.0, 0.03),
        (&|p| wall(length(p) - 13.0, 6.0), 6.0, 0.035),
        (&|p| wall(p[0].hypot(p[1]) - 12.0, 5.0), 5.0, 0.035),
    ];
    for (number, (body, thick, most)) in bodies.into_iter().enumerate() {
        let path = build(folder.path(), body, SurfaceKind::Cells);
        for by in [Method::Ray, Method::Ball] {
            let request = ThicknessRequest { by, max_mm: Some(9.0), ..Default::default() };
            let output = folder.path().join("out.oct");
            let outputs = ThicknessOutputs { model: Some(&output), csv: None };
            let report = thickness(&path, &request, outputs, &Silent).unwrap();
            let model = Model::open(&output).unwrap();
            // Away from the rims at the border of the volume.
            let inner = |c: &u32| (8..SIDE - 7).contains(c);
            let cells: Vec<_> = model.voxels().filter(|cell| cell.voxel.iter().all(inner)).collect();
            let values: Vec<f64> = cells.iter().filter_map(|cell| cell.value).collect();
            assert!(values.len() > 400 && values.len() == cells.len(), "{number} {by:?}: {report:?}");
            let square: f64 = values.iter().map(|v| (v / SPACING - thick).powi(2)).sum();
            let rms = (square / values.len() as f64).sqrt();
            assert!(rms < most, "{number} {by:?}: {rms}");
        }
    }
}

/// Planes of noisy cells do not meet at their faces: no ray slips out between them, through the hollow and to the far side.
/// The intervals hold what is true.
#[test]
fn rays_in_noise_leave_at_the_wall_that_they_reach_first() {
    let (folder, side, middle) = (tempfile::tempdir().unwrap(), 72, 35.3);
    for seed in 1..=3_u64 {
        let mut random = Random(seed);
        let mut noise = || (0..12).map(|_| random.unit()).sum::<f64>() - 6.0;
        let mut samples = Vec::new();
        for at in 0..side * side * side {
            let p = [at % side, at / side % side, at / side / side].map(|c| f64::from(c) - middle);
            let depth = (30.0 - length(p)).min(length(p) - 22.0);
            #[expect(clippy::cast_possible_truncation, reason = "samples in single precision")]
            samples.push((1000.0 * (0.5 + depth / 1.6).clamp(0.0, 1.0) + 40.0 * noise()) as f32);
        }
        let dims = Dims::new(side, side, side).unwrap();
        let at = |[x, y, z]: [u32; 3]| samples[((z * side + y) * side + x) as usize];
        let volume = Voxels::from_fn(dims, at).placed(Affine::from_spacing([SPACING; 3]));
        let threshold = Threshold::Iso(500.0);
        let options = BuildOptions { threshold, uncertainty: true, ..Default::default() };
        let [path, csv] = ["m.oct", "t.csv"].map(|name| folder.path().join(name));
        crate::build(&volume, &options, &path).unwrap();
        let outputs = ThicknessOutputs { model: None, csv: Some(&csv) };
        let report = thickness(&path, &ThicknessRequest::default(), outputs, &Silent).unwrap();
        assert_eq!((report.none.cells, report.thicker.cells), (0, 0), "{seed}");
        assert!(report.cells > 15_000 && report.thickness.unwrap().max < 6.0, "{seed}: {report:?}");
        let table = std::fs::read_to_string(&csv).unwrap();
        let (mut known, mut held) = (0.0, 0.0);
        for row in table.lines().skip(1) {
            let columns: Vec<Option<f64>> = row.split(',').map(|column| column.parse().ok()).collect();
            let (Some(thickness), Some(u95)) = (columns[3], columns[4]) else { continue };
            known += 1.0;
            held += f64::from(u8::from((thickness - 4.0).abs() <= u95));
        }
        let part = held / known;
        assert!(known > 15_000.0 && (0.92..=1.0).contains(&part), "{seed}: {known} {part}");
    }
}

#[test]
fn results_do_not_depend_on_threads_and_flat_colours_are_those_of_the_values() {
    let folder = tempfile::tempdir().unwrap();
    let path = build(
        folder.path(),
        &|p| (length(p) - 15.0).max(9.0 - length([p[0] - 2.0, p[1], p[2]])),
        SurfaceKind::Cells,
    );
    let mut made = Vec::new();
    for threads in [1, 3] {
        let request = ThicknessRequest { thin_mm: Some(2.5), threads, ..Default::default() };
        let [model, csv] = ["t.oct", "t.csv"].map(|name| folder.path().join(name));
        let outputs = ThicknessOutputs { model: Some(&model), csv: Some(&csv) };
        let report = thickness(&path, &request, outputs, &Silent).unwrap();
        let thin = report.thin.unwrap();
        // On the outer ball and on the inner one, which do not touch.
        assert_eq!(thin.places.len(), 2);
        // The place of the outer ball nearest to the inner one: walls of 4 to 8 voxels.
        assert!((thin.places[0].thickness_mm - 2.0).abs() < 0.05, "{thin:?}");
        assert_eq!((report.none.cells, report.thicker.cells), (0, 0));
        made.push([model, csv].map(|path| std::fs::read(path).unwrap()));
    }
    assert_eq!(made[0], made[1]);
    let model = Model::from_bytes(made[0][0].clone()).unwrap();
    let colors = *model.view().value_colors().unwrap();
    let values: Vec<[u8; 3]> = model.voxels().filter_map(|cell| cell.value).map(|v| colors.at(v)).collect();
    let request = RenderRequest {
        size: Some([64, 48]),
        samples: Some(crate::render::Samples::One),
        ..Default::default()
    };
    let (image, _) = picture_of(&path, &model, &request, &Silent).unwrap();
    let pixels = image.rgba.as_chunks::<4>().0.iter().filter(|pixel| pixel[3] == 255);
    let pixels: Vec<[u8; 3]> = pixels.map(|[r, g, b, _]| [*r, *g, *b]).collect();
    let near = |a: &[u8; 3], b: &[u8; 3]| (0..3).all(|c| a[c].abs_diff(b[c]) <= 1);
    assert!(pixels.len() > 500 && pixels.iter().all(|pixel| values.iter().any(|value| near(pixel, value))));
}

#[test]
fn what_cannot_be_measured_is_refused_and_nothing_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("out.oct");
    let outputs = ThicknessOutputs { model: Some(&output), csv: None };
    let skin = build(folder.path(), &|p| length(p) - 9.0, SurfaceKind::Skin);
    let refused = |path: &Path, request: &ThicknessRequest, word: &str| {
        let error = thickness(path, request, outputs, &Silent).unwrap_err().to_string();
        assert!(error.contains(word) && !output.exists(), "{error}");
    };
    refused(&skin, &ThicknessRequest::default(), "skin of voxels");
    let nothing = ThicknessRequest { max_mm: Some(0.0), ..Default::default() };
    refused(&skin, &nothing, "above 0 mm");
    let ball = build(folder.path(), &|p| length(p) - 9.0, SurfaceKind::Cells);
    let short = ThicknessRequest { by: Method::Ball, max_mm: Some(3.0), ..Default::default() };
    let report = thickness(&ball, &short, ThicknessOutputs::default(), &Silent).unwrap();
    assert_eq!((report.thicker.cells, report.thickness), (report.cells, None));
    let beyond = ThicknessRequest { thin_mm: Some(3.5), ..short };
    refused(&ball, &beyond, "not all below 3.5 mm are found");
    // Balls of an eighth of the volume do not fill the body; with a limit of thin walls above it they do.
    let usual = ThicknessRequest { by: Method::Ball, ..Default::default() };
    let found = |request| thickness(&ball, &request, ThicknessOutputs::default(), &Silent).unwrap();
    assert_eq!((found(usual).max_mm, found(usual).thickness), (41.0 * 0.5 / 8.0, None));
    let report = found(ThicknessRequest { thin_mm: Some(12.0), ..usual });
    assert_eq!((report.max_mm, report.thicker.cells), (12.0, 0));
    assert!((report.thickness.unwrap().mean - 9.0).abs() < 0.5, "{report:?}");
    let lens = build(folder.path(), &|p| length([p[0], p[1], 2.5 * p[2]]) - 15.0, SurfaceKind::Cells);
    let text = thickness(&lens, &short, ThicknessOutputs::default(), &Silent).unwrap().text();
    assert!(text.contains("% of the area that is no thicker: mean "), "{text}");
}
