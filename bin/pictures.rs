//! Notes on a picture.

use std::path::Path;
use std::process::ExitCode;

use infobyte::Error;
use infobyte::jobs::picture::PictureReport;
use infobyte::jobs::render::RenderReport;
use infobyte::jobs::scene::is_scene;
use infobyte::text::{Count, shown};

use crate::print;

/// Warnings of an empty picture of a model, of a slice, and of a scene.
const NO_HIT: &str = "no ray meets the model, so the picture is empty; check --eye, --look-at and --fov";
const NO_CUT: &str =
    "the plane meets nothing that is shown, so the picture is empty; choose another place with --section";
const NO_HIT_IN_SCENE: &str = "no ray meets a model, so the picture is empty; check what [clip] and the models' clip leave, and --eye, --look-at and --fov or the scene's [camera]";

pub(crate) fn print_picture(
    as_json: bool,
    (input, output): (&Path, &Path),
    [has_depth, is_slice]: [bool; 2],
    picture: RenderReport,
) -> Result<ExitCode, Error> {
    let sentence = match is_scene(input) {
        _ if is_slice => NO_CUT,
        true => NO_HIT_IN_SCENE,
        false => NO_HIT,
    };
    let mut warnings = if picture.hits == 0 { vec![sentence.to_owned()] } else { Vec::new() };
    if picture.unlisted > 0 {
        let labels = Count(picture.unlisted, "more label");
        warnings.push(format!("the legend has no room for {labels}; a higher picture (--size) lists them"));
    }
    let report = PictureReport::new(input, output, picture, warnings);
    let text = || {
        let p = &report.picture;
        let mut text = format!("{}: {}x{}, ", shown(output), p.width, p.height);
        if is_scene(input) {
            text += &format!("{} in {}, ", Count(p.models, "model"), Count(p.files, "file"));
        }
        text += &format!("{} rays, {} hits", p.rays, p.hits);
        if p.shadow_rays + p.mirrored_rays + p.refracted_rays > 0 {
            text += &format!(
                "; {} to lights, {} mirrored, {} bent, {} for ambient occlusion",
                p.shadow_rays, p.mirrored_rays, p.refracted_rays, p.ambient_rays
            );
        }
        text += &format!(", {:.3} s\n", p.wall_s);
        text.extend(report.warnings.iter().map(|note| format!("  note: {note}\n")));
        if has_depth {
            let (near_mm, far_mm) = (p.depth_near_mm, p.depth_far_mm);
            text +=
                &format!("  distances: grey 1 is {near_mm:.3} mm, grey 65535 {far_mm:.3} mm, 0 nothing\n");
        }
        text
    };
    print(as_json, || &report, text)
}
