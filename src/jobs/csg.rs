//! `oct build` of trees of solids.

use std::path::{Path, PathBuf};
use std::time::Instant;

use super::build::{BuildSummary, prepare, refuse_own_input};
use super::info::read_info;
use crate::budget::{Budget, costs};
use crate::builder::{BuildOptions, Progress};
use crate::catalogue;
use crate::clean::CleanOptions;
use crate::csg::{CsgInput, CsgOptions, Shape, Tree, build_csg, check_links, read_tree};
use crate::error::Error;
use crate::platform::give_back;
use crate::source::{OpenOptions, stays};
use crate::text::data;
use crate::volume::VolumeSource;

/// Is this a tree of solids, by its name?
pub fn is_csg(inputs: &[PathBuf]) -> bool {
    let named = |path: &PathBuf| path.extension().is_some_and(|e| e.eq_ignore_ascii_case("csg"));
    matches!(inputs, [only] if named(only) && !only.is_dir())
}

/// A volume, and the name by which leaves know it.
type Named = (PathBuf, Box<dyn VolumeSource>);

/// Opens the volumes that leaves name, each once, ready to be read.
fn open_volumes(
    tree: &Tree,
    follow_links: bool,
    options: &BuildOptions,
    output: &Path,
    progress: &dyn Progress,
) -> Result<Vec<Named>, Error> {
    let mut open: Vec<Named> = Vec::new();
    for shape in tree.files() {
        let Shape::Volume { path, .. } = shape else { continue };
        if open.iter().any(|(known, _)| known == path) {
            continue;
        }
        let opening_bytes = Budget::of(options.memory).left_bytes().max(costs::LEAST_OPENING);
        let how = OpenOptions { opening_bytes: Some(opening_bytes), follow_links, ..OpenOptions::default() };
        let scratch = options.scratch_folder(output);
        let mut source = catalogue::open_unprepared_in(std::slice::from_ref(path), &how, &scratch)?;
        prepare(&mut *source, &CleanOptions::default(), options, output, progress)?;
        open.push((path.clone(), source));
    }
    Ok(open)
}

/// Builds the model of a tree.
///
/// # Errors
/// As [`read_tree`] and [`build_csg`].
pub fn convert(
    inputs: &[PathBuf],
    csg: &CsgOptions,
    follow_links: bool,
    options: &BuildOptions,
    output: &Path,
    progress: &dyn Progress,
) -> Result<BuildSummary, Error> {
    let started = Instant::now();
    give_back();
    refuse_own_input(inputs, output)?;
    let path = inputs.first().cloned().unwrap_or_default();
    let (tree, root) = read_tree(&path, options.memory)?;
    if !follow_links {
        check_links(&tree, &path, stays)?;
    }
    let volumes = open_volumes(&tree, follow_links, options, output, progress)?;
    give_back();
    let volumes = volumes.iter().map(|(path, source)| (path.clone(), &**source)).collect();
    let input = CsgInput { tree, root, name: path.clone(), volumes };
    let report = build_csg(input, csg, options, output, progress)?;
    let wall_s = started.elapsed().as_secs_f64();
    Ok(BuildSummary {
        input: data(&path).to_string(),
        output: output.to_path_buf(),
        memory_bytes: options.memory.bytes(),
        report: report.build,
        info: read_info(output)?,
        cleaning: None,
        warnings: vec![report.facts.to_string()],
        hints: Vec::new(),
        wall_s,
    })
}
