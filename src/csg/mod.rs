#![doc = include_str!("CSG.md")]
//!
//! ---
//!
//! ```text
//! text --parse--> tree --flatten--> leaves on the lattice, program --boxes--> bits, normals --builder--> .oct
//! ```
//!
//! A middle that lies on a surface counts as moved by (-e, e^2, e^3), whatever the leaf: of two leaves that share a
//! face it lies in one. The bytes depend neither on memory or threads nor on boxes. Cost follows the surface: leaves
//! that are all in or all out in a box take no part in it.
//!
//! | part | what it holds |
//! |---|---|
//! | [`Tree`] | shapes, their places, and their joins |
//! | `text`, `read` | trees from OpenSCAD's evaluated text, and from files of it |
//! | `import` | conversion of a tree to a solid |
//! | `offset` | solids grown and shrunk by a distance |
//! | `normal_form`, `program` | complements pushed down to leaves; steps on a stack, pruned box by box |
//! | `place`, `bounds` | the grid and the lattice; the box that a grid is put around |
//! | `leaf`, `wide`, `facets` | placed leaves: exact membership, surfaces |
//! | `sampled` | meshes and volumes, sampled slice by slice |
//! | `resampled` | volumes that are moved: values between samples |
//! | `solid`, `describe`, `cells` | all of it as a solid of the builder; normals; cells instead of skin |
//!
//! Memory: [`BuildOptions::memory`], in which the tree has to fit, some 400 bytes a leaf. Temporary disk: about the
//! size of the model, and for meshes the size that [`crate::mesh`] states.

mod bounds;
mod cells;
mod facets;
mod fault;
mod findings;
mod import;
mod leaf;
mod normal_form;
mod offset;
mod place;
mod program;
mod read;
mod resampled;
mod sampled;
mod skin_normals;
mod solid;
mod text;
mod tree;
mod wide;

pub use findings::CsgFacts;
pub(crate) use import::unmoved_volumes;
pub(crate) use read::{check_links, is_tree, memory_bound, named_files};
pub use read::{parse_tree, read_tree};
pub use tree::{Faces, NodeId, Operation, Shape, Tree};

use std::path::{Path, PathBuf};
use std::time::Instant;

use crate::builder::{BuildError, BuildFault, BuildOptions, FileSolid, Progress, Solid, cell_dims};
use crate::format::SurfaceKind;
use crate::mesh::GridChoice;
use crate::platform::give_back;
use crate::volume::VolumeSource;
use cells::CsgCells;
use import::Importer;
use solid::CsgSolid;

/// A tree with its root, name and volumes.
pub struct CsgInput<'a> {
    /// The tree.
    pub tree: Tree,
    /// Root of the tree.
    pub root: NodeId,
    /// The file that it was read from, or a name for messages.
    pub name: PathBuf,
    /// The volumes that leaves name, ready to be read.
    pub volumes: Vec<(PathBuf, &'a dyn VolumeSource)>,
}

/// Scale and grid of a tree.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CsgOptions {
    /// Fineness of the grid; a volume in the tree brings its own grid.
    pub grid: Option<GridChoice>,
    /// Millimetres of a unit of the tree.
    pub unit_mm: f64,
}

/// Makes the solid of a tree, and hands it on; returns facts about the tree, and the notes on its files.
///
/// # Errors
/// [`BuildError`]
#[doc(hidden)]
pub fn with_tree<T>(
    input: CsgInput<'_>,
    csg: &CsgOptions,
    options: &BuildOptions,
    scratch: PathBuf,
    progress: &dyn Progress,
    then: impl FnOnce(&FileSolid<'_>) -> Result<T, BuildError>,
) -> Result<(T, CsgFacts, Vec<String>), BuildError> {
    let started = Instant::now();
    let CsgInput { tree, root, name, volumes } = input;
    let (name, volumes) = (&name, &volumes);
    let front = Importer { tree: &tree, root, volumes, name, csg, options, scratch, progress };
    let placed = front.placed()?;
    let (tree_solid, facts, notes) = front.solid(&placed)?;
    drop(tree);
    // Memory of reading and placing goes back before the build takes its own.
    give_back();
    let held_bytes = tree_solid.bytes();
    let solid = solid_of(tree_solid, name, options)?;
    let making_s = started.elapsed().as_secs_f64();
    let made = FileSolid { solid, held_bytes, scratch_bytes: 0, reading_s: 0.0, making_s };
    Ok((then(&made)?, facts, notes))
}

/// The solid whose model is built: of skin voxels, or of cells.
fn solid_of<'a>(
    tree: CsgSolid<'a>,
    name: &Path,
    options: &BuildOptions,
) -> Result<Box<dyn Solid + 'a>, BuildError> {
    match options.volume_surface() {
        SurfaceKind::Skin => Ok(Box::new(tree)),
        SurfaceKind::Cells => {
            let no_room = || BuildFault::no_room_for_cells(name.display().to_string());
            let dims = cell_dims(tree.place.dims).ok_or_else(no_room)?;
            Ok(Box::new(CsgCells { tree, dims }))
        }
    }
}
