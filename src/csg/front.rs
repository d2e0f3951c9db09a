//! From a tree to a solid: the grid, the leaves placed on it, and what they are read from.

use std::path::{Path, PathBuf};

use super::CsgOptions;
use super::bounds;
use super::flat::{self, Flat, Make};
use super::leaf::{self, Leaf};
use super::place::Place;
use super::program;
use super::read::{too_small, unusable};
use super::solid::CsgSolid;
use super::tree::{NodeId, Shape, Tree};
use super::turned::{self, Turned};
use super::walked::WalkedLeaf;
use crate::budget::Budget;
use crate::builder::{BuildError, BuildOptions, Progress, Threshold, volume_solid};
use crate::facts::{CsgFacts, CsgFault, Fault, Misuse, SourceError};
use crate::geom::{Affine, Dims};
use crate::identity::file_identity;
use crate::mesh::{Bounds, GridChoice, STEPS, mesh_bounds, mesh_part};
use crate::volume::VolumeSource;

/// Does a leaf lie where its file says?
fn is_unmoved(affine: &Affine) -> bool {
    *affine == Affine::from_spacing([1.0; 3])
}

/// The grid of a tree, whether it is that of a volume, the number of meshes, and the volumes that are moved, by the
/// number of their leaves.
pub(super) struct Placed<'a> {
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
pub(super) struct Front<'a> {
    pub(super) name: &'a Path,
    pub(super) csg: &'a CsgOptions,
    pub(super) options: &'a BuildOptions,
    pub(super) scratch: PathBuf,
    pub(super) progress: &'a dyn Progress,
}

impl<'a> Front<'a> {
    fn wrong(&self, fault: CsgFault) -> BuildError {
        unusable(self.name, fault).into()
    }

    /// Places the tree, and lays the volumes that it moves.
    pub(super) fn placed(
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

    pub(super) fn solid(
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
        let text = Some((self.name.to_path_buf(), file_identity(self.name)));
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
