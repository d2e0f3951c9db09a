#![doc = include_str!("MESHES.md")]
//!
//! ---
//!
//! ```text
//! file --bounds--> grid --triangles on the lattice--> bins (scratch) --rows--> bits --builder--> .oct
//!                              └─> census: closed? ──no──> open edges ──> caps ──┘
//! ```
//!
//! | part | what it holds |
//! |---|---|
//! | `read` | triangles from files |
//! | `lattice` | the grid, and whole numbers for coordinates |
//! | `corner` | vertices on the lattice, each once |
//! | `edge_parity`, `boundary` | closed or not, by sums; open edges and caps |
//! | `bins` | triangles sorted by place, in a scratch file |
//! | `raster` | crossings of rows and triangles, and the bits from them |
//! | `resident`, `cells` | triangles in memory; small ones by cells of a voxel |
//! | `nearest`, `bound`, `prism` | the triangle nearest to a voxel; bounds that rule out others |
//! | `crossed` | cells instead of skin: planes at the crossings of edges and triangles |
//! | `paint` | colours, parts and smooth normals at the nearest point |
//! | `import` | conversion of files to a solid: all of the above, one after the other |
//! | `solid` | all of it as a solid of the builder |
//! | `reach` | extent of the inside, compared with the mesh's |
//! | `shell` | surfaces alone, and walls thinner than a voxel |
//!
//! Memory: [`BuildOptions::memory`]. Passes over the files: one for the bounds, unless the grid is given in full, one
//! for the bins, and one or two more where a mesh is open. Temporary disk: some 32 bytes a triangle of up to eight
//! voxels (more for longer ones, in every bin that they meet), 36 more for every triangle and vertex of formats of
//! text, and about the size of the model.

mod bins;
mod bound;
mod boundary;
mod cells;
mod corner;
mod crossed;
mod edge_parity;
mod findings;
mod import;
mod lattice;
mod nearest;
mod paint;
mod prism;
mod raster;
mod reach;
mod read;
mod resident;
mod shell;
mod solid;

pub(crate) use edge_parity::{Closed, EdgeParity};
pub(crate) use findings::length;
pub use findings::{Boundary, Fill, MeshFacts, MeshNote};
pub(crate) use lattice::{Bounds, MAX_VOXELS, STEPS, Triangle, smallest_first, span};
pub use lattice::{Grid, GridChoice};
pub(crate) use nearest::{Facet, Nearest};
pub(crate) use raster::{Crossings, Rule, cross_slice};

use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::budget::costs::{MIN_WORKER, WORKER_OVERHEAD};
use crate::budget::{Budget, MemoryCap};
use crate::builder::{BuildError, BuildFault, BuildOptions, CellEdges, FileSolid, Progress, Tile};
use crate::format::{Channel, Channels, SurfaceKind};
use crate::geom::{Affine, Dims};
use crate::platform::give_back;
use crate::volume::SourceError;
use bins::{BINNING_BYTES, Bins};
use boundary::BOUNDARY_BYTES;
pub(crate) use crossed::cross_edges;
use import::Importer;
use paint::{COLLECTING_BYTES, Painter};
pub use read::states_place;
use read::{Limits, MeshFile, READER_BYTES};
pub(crate) use read::{check, cut_polygon, format_of, is_named};
use resident::Resident;
use shell::Thin;
use solid::fixed_bytes;
pub(crate) use solid::{MeshSolid, from_faces, row_words};

/// The axis of a file's coordinates that is up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum UpAxis {
    /// The z axis, as in most models.
    #[default]
    Z,
    /// The y axis, as in glTF, whose z axis leads to the front.
    Y,
}

impl UpAxis {
    /// A place or a direction of the file with z up, and the patient's front where the file has its own.
    pub(crate) fn upright<T: std::ops::Neg<Output = T>>(self, [x, y, z]: [T; 3]) -> [T; 3] {
        match self {
            Self::Z => [x, y, z],
            Self::Y => [x, -z, y],
        }
    }
}

/// Conversion of a mesh to a solid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeshOptions {
    /// Fineness of the grid.
    pub grid: GridChoice,
    /// Millimetres of a unit of the files.
    pub unit_mm: f64,
    /// Up axis of files that do not state it: all but glTF and 3MF.
    pub up: UpAxis,
    /// Rule for inside; `None` to choose the one that fits the mesh.
    pub fill: Option<Fill>,
    /// True to keep walls thinner than a voxel. Of every two neighbours whose centres are both outside, with the mesh
    /// passing between them, one voxel is then inside, too. Without effect where the fill is [`Fill::Surface`].
    pub keep_thin: bool,
    /// True to follow links that lead from files that a mesh names out of its folder.
    pub follow_links: bool,
}

impl MeshOptions {
    fn thin(&self) -> Option<Thin> {
        match self.fill {
            Some(Fill::Surface) => Some(Thin::Surface),
            _ => self.keep_thin.then_some(Thin::Walls),
        }
    }
}

/// Fewest triangles that a worker has room for.
const MIN_RESIDENT: usize = 2048;
/// Approximate bytes of a worker of the builder without its part of the solid.
const COLUMN_BYTES: u64 = 768 << 10;
/// Approximate bytes that joining cells takes in addition.
const JOINING_BYTES: u64 = 1 << 20;

/// The default channels of a mesh: normals, and colours if it has them; larger leaves hold none.
pub(crate) fn usual_channels(options: &BuildOptions) -> Channels {
    if options.joins() { Channels::default() } else { Channels::default().with(Channel::Color) }
}

/// Makes the solid of a mesh, which several files may hold together, and hands it on with the options that fit it;
/// returns facts about the meshes.
///
/// Channels: normals, smooth where files have normals of vertices; colours, left out where files have none; and as
/// material the number of the part, from 0, numbers beyond 255 as 255: files count as parts one after the other, and
/// within them objects and groups of OBJ, nodes of glTF with a mesh, and meshes of 3MF where they are placed.
///
/// # Errors
/// [`BuildError`]
#[doc(hidden)]
pub fn with_mesh<T>(
    inputs: &[PathBuf],
    mesh: &MeshOptions,
    options: &BuildOptions,
    scratch: PathBuf,
    progress: &dyn Progress,
    then: impl FnOnce(&FileSolid<'_>, &BuildOptions) -> Result<T, BuildError>,
) -> Result<(T, MeshFacts, Vec<MeshNote>), BuildError> {
    let front = Importer { inputs, mesh, options, scratch, progress, placed: None, reach: Arc::default() };
    let (made, channels, facts, mut notes) = front.made()?;
    // Memory of reading goes back before the build takes its own.
    give_back();
    let done = then(&made, &BuildOptions { channels: Some(channels), ..options.clone() })?;
    notes.extend(front.short());
    Ok((done, facts, notes))
}

/// A mesh as a part of something else, with notes on it: `placed` leads from the units of the file to voxels, counted
/// from the low corner of the first. The memory is shared by `parts` parts.
///
/// # Errors
/// The errors of [`with_mesh`].
pub(crate) fn mesh_part(
    path: &Path,
    (placed, dims): (Affine, Dims),
    parts: usize,
    options: &BuildOptions,
    scratch: &Path,
    progress: &dyn Progress,
) -> Result<(MeshSolid, Vec<MeshNote>), BuildError> {
    let mesh = part_options(dims);
    let (inputs, scratch) = ([path.to_path_buf()], scratch.to_path_buf());
    let (placed, reach) = (Some(placed), Arc::default());
    let front = Importer { inputs: &inputs, mesh: &mesh, options, scratch, progress, placed, reach };
    let (mut solid, facts, mut notes) = front.solid()?;
    solid.resident = (solid.resident / parts.max(1)).max(MIN_RESIDENT);
    if let Boundary::Open { edges, loops } = facts.boundary {
        let lack = format!("is open: {edges} edges in {loops} loops were closed by caps");
        notes.push(MeshNote { mesh: front.mesh_name(), lack });
    }
    Ok((solid, notes))
}

fn part_options(dims: Dims) -> MeshOptions {
    let grid = GridChoice::Exact { edge_mm: 1.0, origin_mm: [0.0; 3], dims };
    MeshOptions { grid, unit_mm: 1.0, up: UpAxis::Z, fill: None, keep_thin: false, follow_links: false }
}

/// Surfaces of [`triangles_part`] that have ample room.
pub(crate) fn parts_with_room(dims: Dims, options: &BuildOptions) -> usize {
    let ample = 4 * least_share(&part_options(dims), options);
    usize::try_from(Budget::of_job(options.memory).left_bytes() / ample.max(1)).unwrap_or(usize::MAX)
}

/// A closed surface of triangles in memory, on the lattice, as [`mesh_part`] has one of a file, among `parts` parts.
///
/// # Errors
/// The scratch file cannot be written.
pub(crate) fn triangles_part(
    (triangles, rule): (&[Triangle], Rule),
    dims: Dims,
    parts: usize,
    options: &BuildOptions,
    scratch: &Path,
    progress: &dyn Progress,
) -> Result<MeshSolid, BuildError> {
    let mesh = part_options(dims);
    let (scratch, reach) = (scratch.to_path_buf(), Arc::default());
    let front = Importer { inputs: &[], mesh: &mesh, options, scratch, progress, placed: None, reach };
    let mut solid = front.of_triangles(triangles, rule)?;
    solid.resident = (solid.resident / parts.max(1)).max(MIN_RESIDENT);
    Ok(solid)
}

/// Memory in which a mesh of nearly any kind is built.
pub(crate) fn least_share(mesh: &MeshOptions, options: &BuildOptions) -> u64 {
    let side = match mesh.grid {
        GridChoice::Side { voxels, .. } => voxels,
        GridChoice::Voxel { .. } => 1024,
        GridChoice::Exact { dims, .. } => dims.to_array().into_iter().max().unwrap_or(1),
    };
    let cells = options.volume_surface() == SurfaceKind::Cells;
    let side = side.max(1) + if cells { SurfaceKind::Cells.grown() } else { 0 };
    let bins = Dims::new(side, side, side).map_or(0, Bins::memory_bytes);
    let tile = Tile { columns: side.min(1024), channels: options.channels() };
    let painted =
        options.channels().contains(Channel::Color) || options.channels().contains(Channel::Material);
    let (collecting, painter) = if painted { (COLLECTING_BYTES, Painter::BYTES) } else { (0, 0) };
    let thin = mesh.thin().map_or(0, |_| shell::fixed_bytes(&tile) + Resident::bytes(MIN_RESIDENT, 0));
    let edges = if cells { CellEdges::BYTES } else { 0 };
    let column =
        COLUMN_BYTES + fixed_bytes(&tile) + Resident::bytes(MIN_RESIDENT, 32) + painter + thin + edges;
    bins + (READER_BYTES + collecting + BINNING_BYTES.max(BOUNDARY_BYTES))
        .max(column.max(MIN_WORKER) + WORKER_OVERHEAD)
}

/// Memory in which a mesh of nearly any kind is built with any options.
pub(crate) fn sufficient_share(mesh: &MeshOptions, options: &BuildOptions) -> u64 {
    least_share(mesh, options) + if options.joins() { JOINING_BYTES } else { 0 }
}

/// The refusal of a memory cap that has no room for these bytes.
pub(crate) fn too_small(name: String, memory: MemoryCap, bytes: u64) -> BuildError {
    let dry = Budget::dry(memory);
    let _most = dry.reserve(bytes);
    let limit_bytes = memory.bytes();
    let minimum_bytes = dry.smallest_limit(1);
    BuildError::from(BuildFault::BudgetTooSmall { name, limit_bytes, minimum_bytes })
}

/// The bounds of a mesh at another place.
///
/// # Errors
/// The mesh cannot be read.
pub(crate) fn mesh_bounds(path: &Path, placed: &Affine, scratch: &Path) -> Result<Bounds, SourceError> {
    let mut bounds = Bounds::EMPTY;
    MeshFile::open(path, &Limits::plain(scratch))?.for_each(scratch, &mut |t| {
        t.iter().for_each(|p| bounds.add(placed.apply(*p)));
        Ok(())
    })?;
    Ok(bounds)
}
