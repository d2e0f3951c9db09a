//! `oct render` and `oct thumbnail`: a model on disk into pictures on disk.

use std::path::Path;

use super::render::{RenderReport, RenderRequest, render, thumbnail};
use crate::budget::mapped_rss_bytes;
use crate::error::Error;
use crate::load::Model;

/// Renders the model at `model` to `output`, and to the depth and normal images if named.
///
/// # Errors
/// The model cannot be used, the camera makes no sense, or a picture cannot be written.
pub fn render_file(
    model: &Path,
    output: &Path,
    depth: Option<&Path>,
    normals: Option<&Path>,
    request: &RenderRequest,
) -> Result<RenderReport, Error> {
    let model = Model::open(model)?;
    let request = RenderRequest { depth: depth.is_some(), normals: normals.is_some(), ..*request };
    let (image, mut report) = render(&model.view(), model.dims(), &model.affine(), &request)?;
    report.bytes_touched = mapped_rss_bytes(model.bytes());
    image.write_png(output)?;
    if let Some(path) = depth {
        image.write_depth_png(path)?;
    }
    if let Some(path) = normals {
        image.write_normals_png(path)?;
    }
    Ok(report)
}

/// Writes a square thumbnail of the model at `model` to `output`.
///
/// # Errors
/// The model cannot be used, or the picture cannot be written.
pub fn thumbnail_file(model: &Path, output: &Path, size: u32, threads: usize) -> Result<RenderReport, Error> {
    let model = Model::open(model)?;
    let (image, mut report) = thumbnail(&model.view(), model.dims(), &model.affine(), size, threads)?;
    report.bytes_touched = mapped_rss_bytes(model.bytes());
    image.write_png(output)?;
    Ok(report)
}
