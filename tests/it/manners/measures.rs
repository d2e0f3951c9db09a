//! What `info` measures, against bodies whose measures are known.

use super::{ball, built};
use crate::prelude::*;

fn info(model: &std::path::Path, extra: &[&str]) -> Value {
    oct(&[&["info", "--json", &text(model)], extra].concat()).json()
}

fn close(report: &Value, value: &str, error: &str, truth: f64) {
    let (value, error) = (report[value].as_f64().unwrap(), report[error].as_f64().unwrap());
    assert!((value - truth).abs() <= error, "{value} ± {error}, but {truth}");
    assert!(error < 0.2 * truth, "{error} of {truth}");
    assert!((value - truth).abs() < 0.03 * truth, "{value} is far from {truth}");
}

#[test]
fn a_ball_in_uneven_voxels_has_its_area_volume_and_extent() {
    let folder = tempfile::tempdir().unwrap();
    // Radius 20 mm in voxels of 0.5 x 0.5 x 1 mm.
    let middle = [47.5, 47.5, 23.5];
    let spacing = [0.5, 0.5, 1.0];
    let model = built(folder.path(), "ball", [96, 96, 48], &["--spacing", "0.5x0.5x1"], |p| {
        let squares: f64 = (0..3).map(|a| ((f64::from(p[a]) - middle[a]) * spacing[a]).powi(2)).sum();
        let depth = ((20.0 - squares.sqrt()) / 0.7 + 0.5).clamp(0.0, 1.0);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 1000")]
        let value = (depth * 1000.0) as u16;
        value
    });
    let report = info(&model, &[]);
    let pi = std::f64::consts::PI;
    close(&report, "volume_mm3", "volume_error_mm3", 4.0 / 3.0 * pi * 8000.0);
    close(&report, "surface_area_mm2", "surface_area_error_mm2", 4.0 * pi * 400.0);
    assert_eq!(report["not_measured"], Value::Null);
    assert_eq!(report["enclosed_voxels"]["cavities"], 0);
    // Mm are counted from the middle of the first voxel.
    for (side, truth) in [(0, [3.75, 3.75, 3.5]), (1, [43.75, 43.75, 43.5])] {
        for axis in 0..3 {
            let got = report["bounding_box_mm"][side][axis].as_f64().unwrap();
            assert!((got - truth[axis]).abs() <= spacing[axis] * 0.6 + 0.1, "{report}");
        }
    }
    assert_eq!(report["bounding_box_voxels"][0].as_array().unwrap().len(), 3);
    let table = oct(&["info", &text(&model)]).stdout;
    for word in
        ["size", "surface area", "volume", "extent", "mm²", "mm³", "±", "no cavities wider than a voxel"]
    {
        assert!(table.contains(word), "{table}");
    }
    // What its author asks comes with --all, after what users ask.
    let all = oct(&["info", "--all", &text(&model)]).stdout;
    for word in ["against paper", "checksum", "levels"] {
        assert!(all.contains(word) && !table.contains(word), "{all}");
    }
}

#[test]
fn a_surface_of_cells_has_the_same_measures() {
    let folder = tempfile::tempdir().unwrap();
    let args = ["--surface", "cells", "--spacing", "0.5x0.5x0.5"];
    let report = info(&built(folder.path(), "ball", [64, 64, 64], &args, ball(64, 24.0)), &[]);
    let pi = std::f64::consts::PI;
    close(&report, "volume_mm3", "volume_error_mm3", 4.0 / 3.0 * pi * 12.0_f64.powi(3));
    close(&report, "surface_area_mm2", "surface_area_error_mm2", 4.0 * pi * 12.0 * 12.0);
    for (side, truth) in [(0, 3.75), (1, 27.75)] {
        let got = report["bounding_box_mm"][side][2].as_f64().unwrap();
        assert!((got - truth).abs() <= 0.05, "{report}");
    }
}

#[test]
fn what_cannot_be_known_is_said_to_be_unknown() {
    let folder = tempfile::tempdir().unwrap();
    let bare = built(folder.path(), "bare", [40, 40, 40], &["--channels", "none"], ball(40, 15.0));
    let report = info(&bare, &[]);
    assert_eq!((&report["volume_mm3"], &report["surface_area_mm2"]), (&Value::Null, &Value::Null));
    assert_eq!(report["bounding_box_voxels"], json!([[5, 5, 5], [35, 35, 35]]));
    assert!(report["enclosed_voxels"]["unknown"].as_u64().unwrap() > 1000, "{report}");
    assert!(oct(&["info", &text(&bare)]).stdout.contains("not known without normals"));
    // A packed model is measured if that is asked for: as it was before, and without a trace.
    let packed = folder.path().join("packed.oct");
    assert_eq!(oct(&["pack", &text(&bare), "-o", &text(&packed)]).code, 0);
    assert_eq!(info(&packed, &[])["not_measured"], "packed");
    assert!(oct(&["info", &text(&packed)]).stdout.contains("--measure"));
    let before = crate::common::command::names(folder.path());
    let measured = info(&packed, &["--measure"]);
    for key in ["not_measured", "bounding_box_mm", "bounding_box_voxels", "enclosed_voxels", "volume_mm3"] {
        assert_eq!(measured[key], report[key], "{key}");
    }
    assert_eq!(crate::common::command::names(folder.path()), before);
    // A hollow body: the cavity is no part of it.
    let thick = |p: [u32; 3]| {
        let r = p.iter().map(|c| (f64::from(*c) - 23.5).powi(2)).sum::<f64>().sqrt();
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 1000")]
        let value = ((4.5 - (r - 16.0).abs()).clamp(0.0, 1.0) * 1000.0) as u16;
        value
    };
    let report = info(&built(folder.path(), "hollow", [48, 48, 48], &[], thick), &[]);
    let (inner, outer) = (12.0_f64.powi(3), 20.0_f64.powi(3));
    close(&report, "volume_mm3", "volume_error_mm3", 4.0 / 3.0 * std::f64::consts::PI * (outer - inner));
    assert!(report["enclosed_voxels"]["cavities"].as_u64().unwrap() > 5000, "{report}");
}

#[test]
fn numbers_for_people_have_the_digits_that_mean_something() {
    let folder = tempfile::tempdir().unwrap();
    let model = text(&folder.path().join("m.oct"));
    let source = folder.path().join("m.raw");
    super::raw(&source, [20, 20, 20], ball(20, 7.0));
    let spacing = "0.48828125x0.48828125x1.3333333333333333";
    let sized = ["--dims", "20x20x20", "--dtype", "u16", "--spacing", spacing];
    let run = command::build(
        &[&source],
        Path::new(&model),
        &[&sized[..], &["--iso", "471.43565323565247"]].concat(),
    );
    let table = oct(&["info", &model]).stdout;
    for text in [&run.stdout, &table] {
        assert!(text.contains("471.436") && !text.contains("471.4356"), "{text}");
    }
    assert!(table.contains("0.488281 x 0.488281 x 1.33333 mm"), "{table}");
    // Programs have all of them.
    assert_eq!(oct(&["info", &model, "--json"]).json()["range"]["lo"], 471.435_653_235_652_47);
}
