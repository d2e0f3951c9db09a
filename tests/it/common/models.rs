//! How tests build models, and what these hold.

use std::path::{Path, PathBuf};

use infobyte::budget::MemoryCap;
use infobyte::builder::{BuildError, BuildOptions, BuildReport, FileSolid};
use infobyte::csg::{CsgInput, CsgOptions, with_tree};
use infobyte::format::SurfaceKind;
use infobyte::geom::{BoxIndex, Dims, Octant, VoxelIndex};
use infobyte::load::NodeView;
use infobyte::mesh::{GridChoice, MeshFacts, MeshNote, MeshOptions, UpAxis, with_mesh};
use infobyte::progress::Progress;

/// The usual options, for skin voxels.
pub(crate) fn skin_options() -> BuildOptions {
    BuildOptions { surface: Some(SurfaceKind::Skin), ..BuildOptions::default() }
}

/// What a build of skin voxels may allocate, in MiB, and its threads.
pub(crate) fn share(mib: u64, threads: usize) -> BuildOptions {
    BuildOptions { memory: MemoryCap::Share(mib << 20), threads, ..skin_options() }
}

/// Voxels of 1 mm from the origin on.
pub(crate) fn exact_grid([x, y, z]: [u32; 3]) -> GridChoice {
    GridChoice::Exact { edge_mm: 1.0, origin_mm: [0.0; 3], dims: Dims::new(x, y, z).unwrap() }
}

/// A mesh in mm, filled by the rule that it asks for.
pub(crate) fn on_grid(grid: GridChoice) -> MeshOptions {
    MeshOptions { grid, unit_mm: 1.0, up: UpAxis::Z, fill: None, keep_thin: false, follow_links: false }
}

/// What is known of a mesh whose model was built.
#[derive(Clone, Debug)]
pub(crate) struct MeshReport {
    pub(crate) facts: MeshFacts,
    pub(crate) notes: Vec<MeshNote>,
}

pub(crate) fn build_mesh(
    inputs: &[PathBuf],
    mesh: &MeshOptions,
    options: &BuildOptions,
    output: &Path,
    progress: &dyn Progress,
) -> Result<MeshReport, BuildError> {
    let scratch = options.scratch_folder(output);
    let (_, facts, notes) = with_mesh(inputs, mesh, options, scratch, progress, |made, options| {
        made.build(options, output, progress)
    })?;
    Ok(MeshReport { facts, notes })
}

pub(crate) fn build_csg(
    input: CsgInput<'_>,
    csg: &CsgOptions,
    options: &BuildOptions,
    output: &Path,
    progress: &dyn Progress,
) -> Result<BuildReport, BuildError> {
    let scratch = options.scratch_folder(output);
    let then = |made: &FileSolid<'_>| made.build(options, output, progress);
    Ok(with_tree(input, csg, options, scratch, progress, then)?.0)
}

/// Writes a file into a folder.
pub(crate) fn put(folder: &Path, name: &str, bytes: &[u8]) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, bytes).unwrap();
    path
}

/// The skin voxels (or cells) and their numbers, in the order in which they are stored.
pub(crate) fn finest(model: &impl NodeView) -> Vec<([u32; 3], VoxelIndex)> {
    let mut level = vec![(BoxIndex::ROOT, [0_u32; 3])];
    for edge in (0..model.depth()).rev().map(|k| 1_u32 << k) {
        let children = level.into_iter().flat_map(|(number, low)| {
            Octant::ALL.into_iter().filter_map(move |octant| {
                let at = std::array::from_fn(|a| low[a] + octant.high()[a] * edge);
                Some((model.child(number.node(), octant)?, at))
            })
        });
        level = children.collect();
    }
    level.into_iter().map(|(number, at)| (at, number.voxel(model.node_count()))).collect()
}
