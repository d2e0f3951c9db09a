//! What is told of a picture.

use std::path::Path;
use std::process::ExitCode;

use infobyte::Error;
use infobyte::jobs::render::RenderReport;
use infobyte::jobs::scene::SceneReport;
use infobyte::jobs::wording::foreign::{data, shown};
use serde_json::{Value, json};

use crate::print;

/// What is said of a picture that shows nothing.
const NO_HIT: &str = "no ray meets the model, so the picture is empty; check --eye, --look-at and --fov";

pub(crate) fn print_picture(
    as_json: bool,
    model: &Path,
    output: &Path,
    report: &RenderReport,
) -> Result<ExitCode, Error> {
    let warnings: &[&str] = if report.hits == 0 { &[NO_HIT] } else { &[] };
    let json = || {
        let report = serde_json::to_value(report).unwrap_or_default();
        with_files(report, model, output, warnings)
    };
    let text = || {
        let notes: String = warnings.iter().map(|note| format!("  note: {note}\n")).collect();
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
    scene: &Path,
    output: &Path,
    report: &SceneReport,
) -> Result<ExitCode, Error> {
    let warnings: &[&str] = if report.hits == 0 { &[NO_HIT] } else { &[] };
    let json = || with_files(serde_json::to_value(report).unwrap_or_default(), scene, output, warnings);
    let text = || {
        let notes: String = warnings.iter().map(|note| format!("  note: {note}\n")).collect();
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
