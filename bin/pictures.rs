//! What is told of a picture.

use std::path::Path;
use std::process::ExitCode;

use infobyte::Error;
use infobyte::jobs::render::RenderReport;
use infobyte::jobs::scene::SceneReport;
use infobyte::text::{data, shown};
use serde_json::{Value, json};

use crate::print;

/// What is said of a picture that shows nothing.
const NO_HIT: &str = "no ray meets the model, so the picture is empty; check --eye, --look-at and --fov";

/// The same of a scene.
const NO_HIT_IN_SCENE: &str = "no ray meets a model, so the picture is empty; check what [clip] and the models' clip leave, and --eye, --look-at and --fov or the scene's [camera]";

pub(crate) fn print_picture(
    as_json: bool,
    (model, output): (&Path, &Path),
    has_depth: bool,
    report: &RenderReport,
) -> Result<ExitCode, Error> {
    let warnings: &[&str] = if report.hits == 0 { &[NO_HIT] } else { &[] };
    let json = || {
        let report = serde_json::to_value(report).unwrap_or_default();
        with_files(report, model, output, warnings)
    };
    let text = || {
        let mut notes: String = warnings.iter().map(|note| format!("  note: {note}\n")).collect();
        notes += &depths(has_depth, report.depth_near_mm, report.depth_far_mm);
        format!(
            "{}: {}x{}, {} rays, {} hits, {:.3} s\n{notes}",
            shown(output),
            report.width,
            report.height,
            report.rays,
            report.hits,
            report.wall_s
        )
    };
    print(as_json, json, text)
}

/// What the greys of a picture of distances mean.
fn depths(is_written: bool, near_mm: f64, far_mm: f64) -> String {
    if !is_written {
        return String::new();
    }
    format!("  distances: grey 1 is {near_mm:.3} mm, grey 65535 {far_mm:.3} mm, 0 nothing\n")
}

/// The keys of every report of a picture.
fn with_files(mut report: Value, input: &Path, output: &Path, warnings: &[&str]) -> Value {
    if let Value::Object(map) = &mut report {
        map.insert("input".into(), json!(data(input)));
        map.insert("output".into(), json!(data(output)));
        map.insert("warnings".into(), json!(warnings));
        map.insert("peak_rss_bytes".into(), json!(infobyte::budget::peak_rss_bytes()));
    }
    report
}

pub(crate) fn print_scene(
    as_json: bool,
    (scene, output): (&Path, &Path),
    has_depth: bool,
    report: &SceneReport,
) -> Result<ExitCode, Error> {
    let warnings: &[&str] = if report.hits == 0 { &[NO_HIT_IN_SCENE] } else { &[] };
    let json = || with_files(serde_json::to_value(report).unwrap_or_default(), scene, output, warnings);
    let text = || {
        let mut notes: String = warnings.iter().map(|note| format!("  note: {note}\n")).collect();
        notes += &depths(has_depth, report.depth_near_mm, report.depth_far_mm);
        format!(
            "{}: {}x{}, {} model(s) in {} file(s), {} rays, {} hits; {} to lights, {} mirrored, {} bent, {} for ambient occlusion; {:.3} s\n{notes}",
            shown(output),
            report.width,
            report.height,
            report.models,
            report.files,
            report.rays,
            report.hits,
            report.shadow_rays,
            report.mirrored_rays,
            report.refracted_rays,
            report.ambient_rays,
            report.wall_s
        )
    };
    print(as_json, json, text)
}
