//! Trees of solids (CSG): unions, differences, intersections and complements of primitives, meshes and volumes.
//!
//! ```text
//! text --parse--> tree --flatten--> leaves on the lattice, program --boxes--> bits, normals --builder--> .oct
//! ```
//!
//! A voxel is inside a leaf if its middle is, decided in whole numbers for the leaf as it is placed: corners, middles
//! and axes are rounded once to 2^-12 voxel. A middle that lies on a surface counts as moved by (-e, e^2, e^3), whatever
//! the leaf: of two that share a face it lies in one. So the bytes depend neither on memory or threads nor on boxes. Cost
//! follows the surface: leaves that are all in or all out in a box take no part in it.
//!
//! | part | what it holds |
//! |---|---|
//! | [`Tree`] | shapes, where they lie, and how they are joined |
//! | `text`, `read` | trees from OpenSCAD's evaluated text, and from files of it |
//! | `front` | from a tree to a solid |
//! | `offset` | solids grown and shrunk by a distance |
//! | `flat`, `program` | complements pushed down to leaves; steps on a stack, pruned box by box |
//! | `place`, `bounds` | the grid and the lattice; the box that a grid is put around |
//! | `leaf`, `wide`, `facets` | placed leaves: exact membership, surfaces |
//! | `walked` | meshes and volumes, walked slice by slice |
//! | `turned` | volumes that are moved: values between samples |
//! | `solid`, `describe`, `cells` | all of it as a solid of the builder; normals; cells instead of skin |
//!
//! A leaf that is a volume has its voxels inside whose sample is at least its value, and the grid of the tree is then
//! the volume's: voxel i is sample i, nothing is resampled, and other leaves are placed in the volume's millimetres.
//! A volume that the tree moves has those inside where the trilinear interpolation of its samples is at least that
//! (`turned`); where all are moved, the grid is chosen as without volumes.
//!
//! Memory: [`BuildOptions::memory`], in which the tree has to fit, some 400 bytes a leaf. Temporary disk: about the size
//! of the model, and of meshes what [`crate::mesh`] says.

mod bounds;
mod cells;
mod describe;
mod facets;
mod flat;
mod front;
mod leaf;
mod offset;
mod place;
mod program;
mod read;
mod solid;
mod text;
mod tree;
mod turned;
mod walked;
mod wide;

pub(crate) use read::{check_links, is_tree, named_files};
pub use read::{parse_tree, read_tree};
pub use tree::{Faces, NodeId, Operation, Shape, Tree};

use std::path::{Path, PathBuf};
use std::time::Instant;

use crate::builder::{BuildError, BuildOptions, BuildReport, Made, Progress, Solid, cell_dims};
use crate::facts::CsgFacts;
use crate::format::SurfaceKind;
use crate::mesh::GridChoice;
use crate::platform::give_back;
use crate::volume::VolumeSource;
use cells::CsgCells;
use front::Front;

/// A tree, and what goes with it.
pub struct CsgInput<'a> {
    /// The tree.
    pub tree: Tree,
    /// Its root.
    pub root: NodeId,
    /// The file that it was read from, or a name for messages.
    pub name: PathBuf,
    /// The volumes that leaves name, ready to be read.
    pub volumes: Vec<(PathBuf, &'a dyn VolumeSource)>,
}

/// How a tree is put on a grid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CsgOptions {
    /// How fine the grid is; with a volume in the tree it is that of the volume.
    pub grid: Option<GridChoice>,
    /// Millimetres of a unit of the tree.
    pub unit_mm: f64,
}

/// What was built, and what was found about the tree.
#[derive(Clone, Debug)]
pub struct CsgReport {
    /// Figures of the build.
    pub build: BuildReport,
    /// What was found.
    pub facts: CsgFacts,
}

/// Builds the skin octree of a tree into `output`.
///
/// # Errors
/// [`BuildError`]; the old output, if any, is untouched then and no temporary file remains.
pub fn build_csg(
    input: CsgInput<'_>,
    csg: &CsgOptions,
    options: &BuildOptions,
    output: &Path,
    progress: &dyn Progress,
) -> Result<CsgReport, BuildError> {
    let started = Instant::now();
    let CsgInput { tree, root, name, volumes } = input;
    let front = Front { name: &name, csg, options, scratch: options.scratch_folder(output), progress };
    let placed = front.placed((&tree, root), &volumes)?;
    let (tree_solid, facts) = front.solid((&tree, root), &volumes, &placed)?;
    drop(tree);
    // What reading and placing took is not left beside what the build takes.
    give_back();
    let held_bytes = tree_solid.bytes();
    let solid: Box<dyn Solid + '_> = match options.volume_surface() {
        SurfaceKind::Skin => Box::new(tree_solid),
        SurfaceKind::Cells => {
            let dims = cell_dims(tree_solid.place.dims)
                .ok_or_else(|| BuildError::NoRoomForCells { name: name.display().to_string() })?;
            Box::new(CsgCells { tree: tree_solid, dims })
        }
    };
    let making_s = started.elapsed().as_secs_f64();
    let made = Made { solid, held_bytes, scratch_bytes: 0, reading_s: 0.0, making_s };
    Ok(CsgReport { build: made.build(options, output, progress)?, facts })
}
