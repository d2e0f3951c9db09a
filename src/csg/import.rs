//! Conversion of a tree to a solid: the grid, the leaves placed on it, and their files.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use super::CsgOptions;
use super::bounds;
use super::leaf::{self, BINNED, Leaf};
use super::normal_form::{self, Make, NormalForm};
use super::place::LatticeGrid;
use super::program;
use super::read::{read_tree, too_small, unusable};
use super::resampled::{self, ResampledVolume};
use super::sampled::SampledLeaf;
use super::solid::CsgSolid;
use super::tree::{Faces, Node, NodeId, Shape, Tree};
use crate::budget::{Budget, MemoryCap};
use crate::builder::{BuildError, BuildNote, BuildOptions, Progress, Threshold, is_map, volume_solid};
use crate::csg::CsgFacts;
use crate::csg::fault::{grid_of_volume, nothing, singular};
use crate::fault::{Fault, bad};
use crate::format::SurfaceKind;
use crate::geom::{Affine, Dims};
use crate::identity::file_identity;
use crate::mesh::{
    Bounds, GridChoice, MeshNote, STEPS, mesh_bounds, mesh_part, parts_with_room, triangles_part,
};
use crate::platform::give_back;
use crate::source::base_name;
use crate::text::names::{DIMS, GRID, ORIGIN, VOXEL};
use crate::text::shown;
use crate::volume::{SourceError, VolumeSource, sentences};

/// Bytes of triangles that a leaf may take without a check of memory.
const FEW_BYTES: u64 = 64 << 10;

/// Most bodies that go through bins.
const MAX_BINNED: usize = 64;

/// True if a leaf lies where its file says.
fn is_unmoved(affine: &Affine) -> bool {
    *affine == Affine::from_spacing([1.0; 3])
}

/// Files of the volumes that lie where these say; none of a tree that cannot be read.
pub(crate) fn unmoved_volumes(path: &Path, memory: MemoryCap) -> Vec<PathBuf> {
    let (mut found, most_bytes) = (Vec::new(), Budget::of_job(memory).left_bytes());
    if let Ok((tree, root)) = read_tree(path, memory) {
        let _ = NormalForm::new((&tree, root), Affine::from_spacing([1.0; 3]), most_bytes, &mut |met| {
            let mut bytes = 0;
            if let Some(Shape::Volume { path, .. }) = met.shape
                && is_unmoved(met.affine)
                && !found.contains(path)
            {
                bytes = (size_of::<PathBuf>() + path.as_os_str().len()) as u64;
                found.push(path.clone());
            }
            Ok(((), bytes))
        });
    }
    found
}

/// The grid of a tree, true if it is a volume's, the number of meshes, and the volumes that are moved, by the number of
/// their leaves.
pub(super) struct PlacedTree<'a> {
    place: LatticeGrid,
    of_volume: bool,
    meshes: usize,
    resampled: Vec<(usize, ResampledVolume<'a>)>,
}

/// A volume that is moved: the number of its leaf, its value, and its affine.
struct MovedVolume<'a> {
    leaf: usize,
    source: &'a dyn VolumeSource,
    iso: f64,
    affine: Affine,
    line: u64,
}

pub(super) struct Importer<'a, 't> {
    pub(super) tree: &'t Tree,
    pub(super) root: NodeId,
    /// The volumes that leaves name.
    pub(super) volumes: &'t [(PathBuf, &'a dyn VolumeSource)],
    pub(super) name: &'a Path,
    pub(super) csg: &'a CsgOptions,
    pub(super) options: &'a BuildOptions,
    pub(super) scratch: PathBuf,
    pub(super) progress: &'a dyn Progress,
}

impl<'a, 't> Importer<'a, 't> {
    /// Units of the tree to millimetres.
    fn unit(&self) -> Affine {
        Affine::from_spacing([self.csg.unit_mm; 3])
    }

    fn wrong(&self, fault: Fault) -> BuildError {
        unusable(self.name, fault).into()
    }

    /// Places the tree, and lays the volumes that it moves.
    pub(super) fn placed(&self) -> Result<PlacedTree<'a>, BuildError> {
        let (own, meshes, moved) = self.files()?;
        let place = self.place(own)?;
        let mut resampled = Vec::new();
        for MovedVolume { leaf, source, iso, affine, line } in moved {
            let laying = resampled::LAYING_BYTES;
            let budget = Budget::of_job(self.options.memory);
            let _laying =
                budget.reserve(laying).map_err(|_| too_small(self.name, self.options.memory, laying))?;
            let value = (iso, is_map(source)?);
            let laid = ResampledVolume::new(source, &affine, &place, value, &self.scratch, self.progress)?;
            resampled.push((leaf, laid.ok_or_else(|| self.wrong(singular(line)))?));
        }
        Ok(PlacedTree { place, of_volume: own.is_some(), meshes, resampled })
    }

    pub(super) fn solid(
        &self,
        PlacedTree { place, of_volume, meshes, resampled }: &'a PlacedTree<'a>,
    ) -> Result<(CsgSolid<'a>, CsgFacts, Vec<String>), BuildError> {
        let (place, of_volume, meshes) = (*place, *of_volume, *meshes);
        let (mut number, mut bodies) = (0, 0);
        let mut sampled = Vec::new();
        let mut notes = self.volume_notes();
        let of_nan = |source: &dyn VolumeSource| {
            format!("{}: {}", shown(&source.info().description.name), BuildNote::NotNumbers)
        };
        let with_nan = resampled.iter().filter(|(_, volume)| volume.has_nan);
        notes.extend(with_nan.map(|(_, volume)| of_nan(volume)));
        let flat = self.flat(self.unit(), &mut |met| {
            let to_lattice = place.to_lattice.after(met.affine);
            let own = resampled.iter().find(|(at, _)| *at == number).map(|(_, resampled)| resampled);
            number += 1;
            let leaf = match met.shape {
                None => Leaf::Nothing,
                Some(Shape::Mesh { path }) => {
                    let (solid, found) = self.mesh(path, &to_lattice, &place, meshes)?;
                    sampled.push(solid);
                    notes.extend(found.iter().map(ToString::to_string));
                    Leaf::Sampled(u32::try_from(sampled.len() - 1).unwrap_or(u32::MAX))
                }
                Some(Shape::Volume { path, iso }) => {
                    let source = match own {
                        Some(resampled) => resampled as &dyn VolumeSource,
                        None => self.volume(path)?,
                    };
                    let (chosen, surface) = (Threshold::Iso(*iso), self.options.volume_surface());
                    let solid = volume_solid(source, chosen, surface, self.options, self.progress)?;
                    sampled.push(SampledLeaf { solid, gives_outwards: true });
                    Leaf::Sampled(u32::try_from(sampled.len() - 1).unwrap_or(u32::MAX))
                }
                Some(shape) => {
                    if let Shape::Faces(faces) = shape {
                        self.check_room(faces)?;
                    }
                    let leaf = leaf::place(shape, &to_lattice, met.line)?;
                    match self.binned(&leaf, &place, (meshes, &mut bodies))? {
                        Some(solid) => {
                            sampled.push(solid);
                            Leaf::Sampled(u32::try_from(sampled.len() - 1).unwrap_or(u32::MAX))
                        }
                        None => leaf,
                    }
                }
            };
            let held = leaf.bytes();
            Ok((leaf, held))
        })?;
        let [x, y, z] = [0, 1, 2].map(|k| place.affine.rows[k][3]);
        let half = if of_volume { [0.0; 3] } else { place.spacing_mm.map(|s| s / 2.0) };
        let facts = CsgFacts {
            leaves: flat.leaves.len() as u64,
            files: (sampled.len() - bodies) as u64,
            voxel_mm: place.spacing_mm,
            origin_mm: [x - half[0], y - half[1], z - half[2]],
            cut: if of_volume { self.cut(&place)? } else { [[false; 3]; 2] },
        };
        let program = program::compile(&flat);
        let leaves = flat.leaves;
        let extents = leaves.iter().map(Leaf::extent).collect();
        let text = Some((self.name.to_path_buf(), file_identity(self.name)));
        let name = self.name.display().to_string();
        let counts = [leaves.len(), program.len()];
        let mut known = HashSet::new();
        notes.retain(|note| known.insert(note.clone()));
        Ok((CsgSolid { name, place, leaves, extents, program, sampled, counts, text }, facts, notes))
    }

    /// The notes on the volumes that leaves name.
    fn volume_notes(&self) -> Vec<String> {
        let of = |(path, source): &(PathBuf, &'a dyn VolumeSource)| {
            let name = base_name(path);
            let sentences = sentences(&source.info().notes).into_iter();
            sentences.map(|note| format!("{}: {note}", shown(&name))).collect::<Vec<_>>()
        };
        self.volumes.iter().flat_map(of).collect()
    }

    fn volume(&self, path: &Path) -> Result<&'a dyn VolumeSource, BuildError> {
        let known = self.volumes.iter().find(|(own, _)| own == path).map(|(_, source)| *source);
        known.ok_or_else(|| SourceError::from(Fault::no_volume().at(path)).into())
    }

    fn mesh(
        &self,
        path: &Path,
        to_lattice: &Affine,
        place: &LatticeGrid,
        meshes: usize,
    ) -> Result<(SampledLeaf<'a>, Vec<MeshNote>), BuildError> {
        let rows = to_lattice.rows.map(|row| row.map(|c| c / f64::from(STEPS)));
        let (to_voxels, scratch) = ((Affine { rows }, place.dims), &self.scratch);
        let (solid, notes) = mesh_part(path, to_voxels, meshes, self.options, scratch, self.progress)?;
        Ok((SampledLeaf { solid: Box::new(solid), gives_outwards: false }, notes))
    }

    /// A body of many triangles in the bins of a mesh, if cells are built and there is room; it has the crossings of
    /// the body. `bodies` counts the bodies in bins.
    fn binned(
        &self,
        leaf: &Leaf,
        place: &LatticeGrid,
        (meshes, bodies): (usize, &mut usize),
    ) -> Result<Option<SampledLeaf<'a>>, BuildError> {
        let Leaf::Body(body) = leaf else { return Ok(None) };
        let surface = body.surface();
        let most = parts_with_room(place.dims, self.options).saturating_sub(meshes).min(MAX_BINNED);
        if !body.is_large() || *bodies >= most || self.options.volume_surface() != SurfaceKind::Cells {
            return Ok(None);
        }
        let large = |node: &Node| match node {
            Node::Leaf { shape, .. } => matches!(&**shape, Shape::Faces(f) if f.triangles.len() >= BINNED),
            _ => false,
        };
        let parts = meshes + self.tree.nodes.iter().filter(|node| large(node)).count().min(most);
        let solid = triangles_part(surface, place.dims, parts, self.options, &self.scratch, self.progress)?;
        *bodies += 1;
        Ok(Some(SampledLeaf { solid: Box::new(solid), gives_outwards: false }))
    }

    /// A flat tree, with leaves made by `make`.
    fn flat<T>(&self, first: Affine, make: &mut Make<'t, '_, T>) -> Result<NormalForm<T>, BuildError> {
        if let MemoryCap::Process(_) = self.options.memory {
            // Returns the lists of an earlier flat tree to the system.
            give_back();
        }
        let flat = NormalForm::new((self.tree, self.root), first, self.left_bytes(), make);
        flat.map_err(|stop| match stop {
            normal_form::Stop::Fault(fault) => self.wrong(fault),
            normal_form::Stop::Memory { bytes } => {
                too_small(self.name, self.options.memory, bytes + self.tree.bytes())
            }
            normal_form::Stop::Build(error) => error,
        })
    }

    /// Memory left beside the tree.
    fn left_bytes(&self) -> u64 {
        let memory = self.options.memory;
        let left = Budget::of_job(memory).left_bytes();
        // A process has the tree in its resident memory; in a share its size is subtracted.
        left.saturating_sub(if let MemoryCap::Share(_) = memory { self.tree.bytes() } else { 0 })
    }

    /// Refuses a leaf if its triangles and their corners do not fit into memory.
    fn check_room(&self, faces: &Faces) -> Result<(), BuildError> {
        // A triangle, and its place among the others.
        let bytes = (36 * faces.points.len() + 60 * faces.triangles.len()) as u64;
        if bytes > FEW_BYTES && bytes > self.left_bytes() {
            return Err(too_small(self.name, self.options.memory, bytes));
        }
        Ok(())
    }

    /// The grid of the volumes that lie where their files say, the number of meshes, and the volumes that are moved.
    fn files(&self) -> Result<(Option<VolumeGrid>, usize, Vec<MovedVolume<'a>>), BuildError> {
        let (mut own, mut meshes, mut moved, mut leaf) = (None, 0, Vec::new(), 0);
        if self.tree.files().next().is_none() {
            return Ok((own, meshes, moved));
        }
        self.flat(self.unit(), &mut |met| {
            meshes += usize::from(matches!(met.shape, Some(Shape::Mesh { .. })));
            if let Some(Shape::Volume { path, iso }) = met.shape {
                // The millimetres of a file stay millimetres.
                if self.csg.unit_mm != 1.0 {
                    return Err(grid_of_volume().into());
                }
                let source = self.volume(path)?;
                let info = source.info();
                let grid = (info.dims, info.affine, info.spacing_mm);
                if !is_unmoved(met.affine) {
                    moved.push(MovedVolume { leaf, source, iso: *iso, affine: *met.affine, line: met.line });
                } else if own.is_some_and(|own| own != grid) {
                    return Err(bad!("has volumes at the positions stated by their files, on different grids; place all but one with multmatrix, or all, and choose the grid with {GRID} or {VOXEL}").into());
                } else {
                    own = Some(grid);
                }
            }
            leaf += 1;
            Ok(((), 0))
        })?;
        Ok((own, meshes, moved))
    }

    /// The grid of the volumes that lie where their files say, or the chosen one.
    fn place(&self, own: Option<VolumeGrid>) -> Result<LatticeGrid, BuildError> {
        match (own, self.csg.grid) {
            (Some(_), Some(_)) => Err(self.wrong(grid_of_volume())),
            (Some((dims, affine, spacing_mm)), None) => {
                LatticeGrid::of_volume(dims, affine, spacing_mm).map_err(|fault| self.wrong(fault))
            }
            (None, choice) => {
                let choice = choice.unwrap_or(GridChoice::USUAL);
                let bounds = match choice {
                    GridChoice::Exact { .. } => Bounds::EMPTY,
                    _ => self.bounds()?,
                };
                let refused = |fault: Fault| SourceError::from(fault.at(self.name));
                Ok(LatticeGrid::around(choice, &bounds).map_err(refused)?)
            }
        }
    }

    /// Sides on which the bounds of a tree reach out of its volumes' grid, by a voxel's middle at least.
    fn cut(&self, place: &LatticeGrid) -> Result<[[bool; 3]; 2], BuildError> {
        let rows = place.to_lattice.rows.map(|row| row.map(|c| c / f64::from(STEPS)));
        let to_voxels = Affine { rows }.after(&self.unit());
        let dims = place.dims.to_array().map(f64::from);
        let found = bounds::of_tree(&self.flat_bounds(to_voxels)?);
        Ok([found.low.map(|low| low < -0.5), [0, 1, 2].map(|k| found.high[k] > dims[k] + 0.5)])
    }

    /// The bounds of all leaves; volumes reach half a voxel beyond their outermost samples.
    fn flat_bounds(&self, first: Affine) -> Result<NormalForm<Bounds>, BuildError> {
        self.flat(first, &mut |met| {
            let file = match met.shape {
                Some(Shape::Volume { path, .. }) => {
                    let info = self.volume(path)?.info();
                    let placed = met.affine.after(&info.affine);
                    let high = info.dims.to_array().map(|side| f64::from(side) - 0.5);
                    let mut bounds = Bounds::EMPTY;
                    bounds::corners([-0.5; 3], high).for_each(|corner| bounds.add(placed.apply(corner)));
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

    fn bounds(&self) -> Result<Bounds, BuildError> {
        let bounds = bounds::of_tree(&self.flat_bounds(self.unit())?);
        let sides = || bounds.low.iter().zip(&bounds.high);
        if sides().any(|(low, high)| low >= high) {
            return Err(self.wrong(nothing()));
        }
        if sides().any(|(low, high)| !(high - low).is_finite()) {
            return Err(self.wrong(bad!("is not bounded, so that no grid can be put around it; give the grid in full with {VOXEL}, {ORIGIN} and {DIMS}")));
        }
        Ok(bounds)
    }
}

/// Size, place and spacing of a volume.
type VolumeGrid = (Dims, Affine, [f64; 3]);
