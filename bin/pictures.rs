//! The sentences on a picture.

use std::path::Path;
use std::process::ExitCode;

use infobyte::Error;
use infobyte::jobs::picture::PictureReport;
use infobyte::jobs::render::RenderReport;
use infobyte::jobs::scene::SceneReport;
use infobyte::text::shown;

use crate::print;

/// Warning of a picture that shows nothing.
const NO_HIT: &str = "no ray meets the model, so the picture is empty; check --eye, --look-at and --fov";

/// The same of a scene.
const NO_HIT_IN_SCENE: &str = "no ray meets a model, so the picture is empty; check what [clip] and the models' clip leave, and --eye, --look-at and --fov or the scene's [camera]";

/// Lines behind the first of both.
fn notes<R>(report: &PictureReport<R>, has_depth: bool, [near_mm, far_mm]: [f64; 2]) -> String {
    let mut notes: String = report.warnings.iter().map(|note| format!("  note: {note}\n")).collect();
    if has_depth {
        notes += &format!("  distances: grey 1 is {near_mm:.3} mm, grey 65535 {far_mm:.3} mm, 0 nothing\n");
    }
    notes
}

fn warnings(hits: u64, sentence: &str) -> Vec<String> {
    if hits == 0 { vec![sentence.to_owned()] } else { Vec::new() }
}

pub(crate) fn print_picture(
    as_json: bool,
    (model, output): (&Path, &Path),
    has_depth: bool,
    picture: RenderReport,
) -> Result<ExitCode, Error> {
    let warnings = warnings(picture.hits, NO_HIT);
    let report = PictureReport::new(model, output, picture, warnings);
    let text = || {
        let p = &report.picture;
        format!(
            "{}: {}x{}, {} rays, {} hits, {:.3} s\n{}",
            shown(output),
            p.width,
            p.height,
            p.rays,
            p.hits,
            p.wall_s,
            notes(&report, has_depth, [p.depth_near_mm, p.depth_far_mm])
        )
    };
    print(as_json, || &report, text)
}

pub(crate) fn print_scene(
    as_json: bool,
    (scene, output): (&Path, &Path),
    has_depth: bool,
    picture: SceneReport,
) -> Result<ExitCode, Error> {
    let warnings = warnings(picture.hits, NO_HIT_IN_SCENE);
    let report = PictureReport::new(scene, output, picture, warnings);
    let text = || {
        let p = &report.picture;
        format!(
            "{}: {}x{}, {} model(s) in {} file(s), {} rays, {} hits; {} to lights, {} mirrored, {} bent, {} for ambient occlusion; {:.3} s\n{}",
            shown(output),
            p.width,
            p.height,
            p.models,
            p.files,
            p.rays,
            p.hits,
            p.shadow_rays,
            p.mirrored_rays,
            p.refracted_rays,
            p.ambient_rays,
            p.wall_s,
            notes(&report, has_depth, [p.depth_near_mm, p.depth_far_mm])
        )
    };
    print(as_json, || &report, text)
}
