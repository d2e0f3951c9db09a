//! `oct build` of triangle meshes.

use std::path::{Path, PathBuf};
use std::time::Instant;

use super::build::{BuildSummary, refuse_own_input};
use super::info::read_info;
use crate::builder::{BuildOptions, Progress};
use crate::error::Error;
use crate::facts::{Misuse, SourceError};
use crate::format::{Channel, Channels, SurfaceKind};
use crate::mesh::{MeshOptions, build_mesh};
use crate::platform::give_back;
use crate::text::data;

/// Suffixes of the formats that are read.
const SUFFIXES: [&str; 7] = ["stl", "ply", "obj", "off", "gltf", "glb", "3mf"];

/// Are these meshes, by their names? Several are parts of one model.
pub fn are_meshes(inputs: &[PathBuf]) -> bool {
    let is_mesh = |path: &PathBuf| {
        let named = |e: &std::ffi::OsStr| SUFFIXES.iter().any(|suffix| e.eq_ignore_ascii_case(suffix));
        path.extension().is_some_and(named) && !path.is_dir()
    };
    !inputs.is_empty() && inputs.iter().all(is_mesh)
}

/// What is stored of a mesh where nothing else is asked for: normals, and of skin colours if it has them.
pub fn usual_channels(surface: SurfaceKind) -> Channels {
    match surface {
        SurfaceKind::Skin => Channels::default().with(Channel::Color),
        SurfaceKind::Cells => Channels::default(),
    }
}

/// Builds the model of a mesh.
///
/// # Errors
/// As [`build_mesh`]; without options for the grid, a sentence that says what to add.
pub fn convert(
    inputs: &[PathBuf],
    mesh: Option<&MeshOptions>,
    options: &BuildOptions,
    output: &Path,
    progress: &dyn Progress,
) -> Result<BuildSummary, Error> {
    let started = Instant::now();
    give_back();
    refuse_own_input(inputs, output)?;
    let Some(mesh) = mesh else {
        let path = inputs.first().cloned().unwrap_or_default();
        return Err(SourceError::Usage { path, misuse: Misuse::NoGrid }.into());
    };
    let report = build_mesh(inputs, mesh, options, output, progress)?;
    let wall_s = started.elapsed().as_secs_f64();
    Ok(BuildSummary {
        input: inputs.iter().map(|p| data(p)).collect::<Vec<_>>().join(" "),
        output: output.to_path_buf(),
        memory_bytes: options.memory.bytes(),
        report: report.build,
        info: read_info(output)?,
        cleaning: None,
        warnings: std::iter::once(report.facts.to_string())
            .chain(report.notes.iter().map(ToString::to_string))
            .collect(),
        hints: Vec::new(),
        wall_s,
    })
}
