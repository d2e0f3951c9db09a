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
//! | `text` | trees from OpenSCAD's evaluated text |
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
mod leaf;
mod offset;
mod place;
mod program;
mod solid;
mod text;
mod tree;
mod turned;
mod walked;
mod wide;

pub use tree::{Faces, NodeId, Operation, Shape, Tree};

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::time::Instant;

use crate::budget::costs::{LEAST_WORKER, WORKER_OVERHEAD};
use crate::budget::{Budget, MemoryCap};
use crate::builder::{
    BuildError, BuildOptions, BuildReport, Progress, Threshold, build_solid, cell_dims, volume_solid,
};
use crate::facts::{CsgFacts, CsgFault, Fault, Misuse, SourceError};
use crate::format::SurfaceKind;
use crate::geom::{Affine, Dims};
use crate::mesh::{Bounds, GridChoice, STEPS, mesh_bounds, mesh_part};
use crate::resident::give_back;
use crate::stamp::stamp;
use crate::volume::VolumeSource;
use cells::CsgCells;
use flat::{Flat, Make};
use leaf::Leaf;
use place::Place;
use solid::CsgSolid;
use text::Stop;
use turned::Turned;
use walked::WalkedLeaf;

/// Bytes of a text that are read at a time.
const READ_BYTES: usize = 16 << 10;

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

/// Reads a tree from a text in OpenSCAD's evaluated form.
///
/// Memory: what the cap leaves beside a build, at most. Files that it names are not opened.
///
/// # Errors
/// [`CsgFault`], with the line; the file cannot be read; the tree does not fit.
pub fn read_tree(path: &Path, memory: MemoryCap) -> Result<(Tree, NodeId), BuildError> {
    let unreadable = |cause| SourceError::Unreadable { path: path.to_path_buf(), cause };
    let file = File::open(path).map_err(unreadable)?;
    if file.metadata().map_err(unreadable)?.is_dir() {
        return Err(SourceError::Unusable { path: path.to_path_buf(), fault: Fault::NotAFile }.into());
    }
    let least = LEAST_WORKER + WORKER_OVERHEAD;
    let most = Budget::of_job(memory).left_bytes().saturating_sub(least);
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut input = BufReader::with_capacity(READ_BYTES, file);
    text::parse(&mut input, folder, most).map_err(|stop| match stop {
        Stop::Text(fault) => unusable(path, fault).into(),
        Stop::Read(cause) => unreadable(cause).into(),
        Stop::Memory { bytes } => too_small(path, memory, bytes + least),
    })
}

/// Reads a tree from text in memory; files that it names lie in `folder`.
///
/// # Errors
/// [`CsgFault`], with the line.
pub fn parse_tree(text: &[u8], folder: &Path) -> Result<(Tree, NodeId), CsgFault> {
    text::parse(&mut { text }, folder, u64::MAX).map_err(|stop| match stop {
        Stop::Text(fault) => fault,
        // Memory can be read, and nothing was said of how much the tree may take.
        Stop::Read(_) | Stop::Memory { .. } => CsgFault::Nothing,
    })
}

/// Refuses files of a tree that do not stay in the folder of its text: a text that came from elsewhere must not make
/// the program read whatever file a link leads to.
pub(crate) fn check_links(
    tree: &Tree,
    text: &Path,
    stays: impl Fn(&Path, &Path) -> bool,
) -> Result<(), SourceError> {
    let named = tree.files().filter_map(|shape| match shape {
        Shape::Mesh { path } | Shape::Volume { path, .. } => Some(path),
        _ => None,
    });
    match named.into_iter().find(|path| !stays(text, path)) {
        None => Ok(()),
        Some(path) => {
            let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            Err(unusable(text, CsgFault::Linked { name }))
        }
    }
}

fn unusable(path: &Path, fault: CsgFault) -> SourceError {
    SourceError::Unusable { path: path.to_path_buf(), fault: Fault::Csg(fault) }
}

/// Does a leaf lie where its file says?
fn is_unmoved(affine: &Affine) -> bool {
    *affine == Affine::from_spacing([1.0; 3])
}

fn too_small(path: &Path, memory: MemoryCap, bytes: u64) -> BuildError {
    let dry = Budget::dry(memory);
    drop(dry.reserve(2 * bytes));
    let limit_bytes = memory.bytes();
    BuildError::BudgetTooSmall {
        name: path.display().to_string(),
        limit_bytes,
        minimum_bytes: dry.smallest_limit(1).max(limit_bytes + 1),
    }
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
    let (solid, facts) = front.solid((&tree, root), &volumes, &placed)?;
    drop(tree);
    // What reading and placing took is not left beside what the build takes.
    give_back();
    let placing_s = started.elapsed().as_secs_f64();
    // In a share nobody else counts what the solid holds.
    let memory = match options.memory {
        MemoryCap::Share(bytes) => MemoryCap::Share(bytes.saturating_sub(solid.bytes())),
        whole @ MemoryCap::Process(_) => whole,
    };
    let options = BuildOptions { memory, ..options.clone() };
    let mut build = match options.volume_surface() {
        SurfaceKind::Skin => build_solid(&solid, &options, output, progress)?,
        SurfaceKind::Cells => {
            let dims = cell_dims(solid.place.dims)
                .ok_or_else(|| BuildError::NoRoomForCells { name: name.display().to_string() })?;
            build_solid(&CsgCells { tree: solid, dims }, &options, output, progress)?
        }
    };
    build.seconds.scan += placing_s;
    Ok(CsgReport { build, facts })
}

/// The grid of a tree, whether it is that of a volume, the number of meshes, and the volumes that are moved, by the
/// number of their leaves.
struct Placed<'a> {
    place: Place,
    of_volume: bool,
    meshes: usize,
    turned: Vec<(usize, Turned<'a>)>,
}

/// A volume that is moved: the number of its leaf, the value, and how it lies.
struct Moved<'a> {
    leaf: usize,
    source: &'a dyn VolumeSource,
    iso: f64,
    affine: Affine,
    line: u64,
}

/// From a tree to a solid.
struct Front<'a> {
    name: &'a Path,
    csg: &'a CsgOptions,
    options: &'a BuildOptions,
    scratch: PathBuf,
    progress: &'a dyn Progress,
}

impl<'a> Front<'a> {
    fn wrong(&self, fault: CsgFault) -> BuildError {
        unusable(self.name, fault).into()
    }

    /// Places the tree, and lays the volumes that it moves.
    fn placed(
        &self,
        tree: (&Tree, NodeId),
        volumes: &[(PathBuf, &'a dyn VolumeSource)],
    ) -> Result<Placed<'a>, BuildError> {
        let unit = Affine::from_spacing([self.csg.unit_mm; 3]);
        let (own, meshes, moved) = self.files(tree, unit, volumes)?;
        let place = self.place(tree, unit, own, volumes)?;
        let mut turned = Vec::new();
        for Moved { leaf, source, iso, affine, line } in moved {
            let laying = turned::LAYING_BYTES;
            let budget = Budget::of_job(self.options.memory);
            let _laying =
                budget.reserve(laying).map_err(|_| too_small(self.name, self.options.memory, laying))?;
            let laid = Turned::new(source, &affine, &place, iso, &self.scratch, self.progress)?;
            turned.push((leaf, laid.ok_or_else(|| self.wrong(CsgFault::Singular { line }))?));
        }
        Ok(Placed { place, of_volume: own.is_some(), meshes, turned })
    }

    fn solid(
        &self,
        (tree, root): (&Tree, NodeId),
        volumes: &[(PathBuf, &'a dyn VolumeSource)],
        Placed { place, of_volume, meshes, turned }: &'a Placed<'a>,
    ) -> Result<(CsgSolid<'a>, CsgFacts), BuildError> {
        let unit = Affine::from_spacing([self.csg.unit_mm; 3]);
        let (place, of_volume, meshes) = (*place, *of_volume, *meshes);
        let mut number = 0;
        let mut walked = Vec::new();
        let flat = self.flat((tree, root), unit, &mut |met| {
            let to_lattice = place.to_lattice.after(met.affine);
            let own = turned.iter().find(|(at, _)| *at == number).map(|(_, turned)| turned);
            number += 1;
            let leaf = match met.shape {
                None => Leaf::Nothing,
                Some(Shape::Mesh { path }) => {
                    walked.push(self.mesh(path, &to_lattice, &place, meshes)?);
                    Leaf::Walked(u32::try_from(walked.len() - 1).unwrap_or(u32::MAX))
                }
                Some(Shape::Volume { path, iso }) => {
                    let source = match own {
                        Some(turned) => turned as &dyn VolumeSource,
                        None => self.volume(path, volumes)?,
                    };
                    let (chosen, surface) = (Threshold::Iso(*iso), self.options.volume_surface());
                    let solid = volume_solid(source, chosen, surface, self.options, self.progress)?;
                    walked.push(WalkedLeaf { solid, gives_outwards: true });
                    Leaf::Walked(u32::try_from(walked.len() - 1).unwrap_or(u32::MAX))
                }
                Some(shape) => leaf::place(shape, &to_lattice, met.line)?,
            };
            let held = leaf.bytes();
            Ok((leaf, held))
        })?;
        let [x, y, z] = [0, 1, 2].map(|k| place.affine.rows[k][3]);
        let half = if of_volume { [0.0; 3] } else { place.spacing_mm.map(|s| s / 2.0) };
        let facts = CsgFacts {
            leaves: flat.leaves.len() as u64,
            files: walked.len() as u64,
            voxel_mm: place.spacing_mm,
            origin_mm: [x - half[0], y - half[1], z - half[2]],
            cut: if of_volume { self.cut((tree, root), &place, volumes)? } else { [[false; 3]; 2] },
        };
        let program = program::compile(&flat);
        let leaves = flat.leaves;
        let extents = leaves.iter().map(Leaf::extent).collect();
        let text = Some((self.name.to_path_buf(), stamp(self.name)));
        let name = self.name.display().to_string();
        Ok((CsgSolid { name, place, leaves, extents, program, walked, text }, facts))
    }

    fn volume(
        &self,
        path: &Path,
        volumes: &[(PathBuf, &'a dyn VolumeSource)],
    ) -> Result<&'a dyn VolumeSource, BuildError> {
        let known = volumes.iter().find(|(own, _)| own == path).map(|(_, source)| *source);
        known.ok_or_else(|| SourceError::Usage { path: path.to_path_buf(), misuse: Misuse::NoneFound }.into())
    }

    fn mesh(
        &self,
        path: &Path,
        to_lattice: &Affine,
        place: &Place,
        meshes: usize,
    ) -> Result<WalkedLeaf<'a>, BuildError> {
        let rows = to_lattice.rows.map(|row| row.map(|c| c / f64::from(STEPS)));
        let to_voxels = (Affine { rows }, place.dims);
        let (solid, _) = mesh_part(path, to_voxels, meshes, self.options, &self.scratch, self.progress)?;
        Ok(WalkedLeaf { solid: Box::new(solid), gives_outwards: false })
    }

    /// A flat tree of what is made of leaves.
    fn flat<'t, T>(
        &self,
        tree: (&'t Tree, NodeId),
        first: Affine,
        make: &mut Make<'t, '_, T>,
    ) -> Result<Flat<T>, BuildError> {
        let left = Budget::of_job(self.options.memory).left_bytes();
        Flat::new(tree, first, left, make).map_err(|stop| match stop {
            flat::Stop::Fault(fault) => self.wrong(fault),
            flat::Stop::Memory { bytes } => too_small(self.name, self.options.memory, bytes),
            flat::Stop::Build(error) => error,
        })
    }

    /// The grid of the volumes that lie where their files say, the number of meshes, and the volumes that are moved.
    fn files(
        &self,
        tree: (&Tree, NodeId),
        unit: Affine,
        volumes: &[(PathBuf, &'a dyn VolumeSource)],
    ) -> Result<(Option<VolumeGrid>, usize, Vec<Moved<'a>>), BuildError> {
        let (mut own, mut meshes, mut moved, mut leaf) = (None, 0, Vec::new(), 0);
        if tree.0.files().next().is_none() {
            return Ok((own, meshes, moved));
        }
        self.flat(tree, unit, &mut |met| {
            meshes += usize::from(matches!(met.shape, Some(Shape::Mesh { .. })));
            if let Some(Shape::Volume { path, iso }) = met.shape {
                // The millimetres of a file stay millimetres.
                if self.csg.unit_mm != 1.0 {
                    return Err(CsgFault::GridOfVolume.into());
                }
                let source = self.volume(path, volumes)?;
                let info = source.info();
                let grid = (info.dims, info.affine, info.spacing_mm);
                if !is_unmoved(met.affine) {
                    moved.push(Moved { leaf, source, iso: *iso, affine: *met.affine, line: met.line });
                } else if own.is_some_and(|own| own != grid) {
                    return Err(CsgFault::Volumes.into());
                } else {
                    own = Some(grid);
                }
            }
            leaf += 1;
            Ok(((), 0))
        })?;
        Ok((own, meshes, moved))
    }

    /// The grid: that of the volumes that lie where their files say, or the one asked for.
    fn place(
        &self,
        tree: (&Tree, NodeId),
        unit: Affine,
        own: Option<VolumeGrid>,
        volumes: &[(PathBuf, &'a dyn VolumeSource)],
    ) -> Result<Place, BuildError> {
        match (own, self.csg.grid) {
            (Some(_), Some(_)) => Err(self.wrong(CsgFault::GridOfVolume)),
            (Some((dims, affine, spacing_mm)), None) => {
                Place::of_volume(dims, affine, spacing_mm).map_err(|fault| self.wrong(fault))
            }
            (None, None) => {
                let path = self.name.to_path_buf();
                Err(SourceError::Usage { path, misuse: Misuse::NoGrid }.into())
            }
            (None, Some(choice)) => {
                let bounds = match choice {
                    GridChoice::Exact { .. } => Bounds::EMPTY,
                    _ => self.bounds(tree, unit, volumes)?,
                };
                let refused = |fault| SourceError::Unusable {
                    path: self.name.to_path_buf(),
                    fault: Fault::MeshFile(fault),
                };
                Ok(Place::around(choice, &bounds).map_err(refused)?)
            }
        }
    }

    /// On which sides the bounds of a tree reach out of its volumes' grid, by a voxel's middle at least.
    fn cut(
        &self,
        tree: (&Tree, NodeId),
        place: &Place,
        volumes: &[(PathBuf, &'a dyn VolumeSource)],
    ) -> Result<[[bool; 3]; 2], BuildError> {
        let rows = place.to_lattice.rows.map(|row| row.map(|c| c / f64::from(STEPS)));
        let to_voxels = Affine { rows }.after(&Affine::from_spacing([self.csg.unit_mm; 3]));
        let dims = place.dims.to_array().map(f64::from);
        let found = bounds::of_tree(&self.flat_bounds(tree, to_voxels, volumes)?);
        Ok([found.low.map(|low| low < -0.5), [0, 1, 2].map(|k| found.high[k] > dims[k] + 0.5)])
    }

    /// The bounds of all leaves; volumes reach half a voxel beyond their outermost samples.
    fn flat_bounds(
        &self,
        tree: (&Tree, NodeId),
        first: Affine,
        volumes: &[(PathBuf, &'a dyn VolumeSource)],
    ) -> Result<Flat<Bounds>, BuildError> {
        self.flat(tree, first, &mut |met| {
            let file = match met.shape {
                Some(Shape::Volume { path, .. }) => {
                    let info = self.volume(path, volumes)?.info();
                    let (placed, sides) =
                        (met.affine.after(&info.affine), info.dims.to_array().map(f64::from));
                    let mut bounds = Bounds::EMPTY;
                    for corner in 0..8_u32 {
                        let at = |k: usize| if corner >> k & 1 == 1 { sides[k] - 0.5 } else { -0.5 };
                        bounds.add(placed.apply([at(0), at(1), at(2)]));
                    }
                    Some(bounds)
                }
                Some(Shape::Mesh { path }) if !met.negated => {
                    Some(mesh_bounds(path, met.affine, &self.scratch)?)
                }
                _ => None,
            };
            Ok((bounds::of_leaf(&met, file), 0))
        })
    }

    fn bounds(
        &self,
        tree: (&Tree, NodeId),
        unit: Affine,
        volumes: &[(PathBuf, &'a dyn VolumeSource)],
    ) -> Result<Bounds, BuildError> {
        let bounds = bounds::of_tree(&self.flat_bounds(tree, unit, volumes)?);
        let sides = || bounds.low.iter().zip(&bounds.high);
        if sides().any(|(low, high)| low >= high) {
            return Err(self.wrong(CsgFault::Nothing));
        }
        if sides().any(|(low, high)| !(high - low).is_finite()) {
            return Err(self.wrong(CsgFault::Unbounded));
        }
        Ok(bounds)
    }
}

/// Size, place and spacing of a volume.
type VolumeGrid = (Dims, Affine, [f64; 3]);
