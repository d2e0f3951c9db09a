//! From a volume to its solid: the builder requests a [`Solid`] slice by slice, whatever it is made of, and is compiled
//! once.

use super::cells::{CellSolid, cell_dims};
use super::choose::Chooser;
use super::error::BuildError;
use super::solid::Solid;
use super::volume::VolumeSolid;
use super::{BuildOptions, Threshold};
use crate::builder::BuildFault;
use crate::format::SurfaceKind;
use crate::geom::Dims;
use crate::volume::VolumeInfo;

/// Size of the grid of a model from a volume of this size.
///
/// # Errors
/// The volume is too large for cells.
pub(super) fn grid_dims(dims: Dims, surface: SurfaceKind, name: &str) -> Result<Dims, BuildError> {
    match surface {
        SurfaceKind::Skin => Ok(dims),
        SurfaceKind::Cells => {
            cell_dims(dims).ok_or_else(|| BuildError::from(BuildFault::no_room_for_cells(name.to_owned())))
        }
    }
}

/// A volume with the rule for its inside.
#[derive(Clone, Copy)]
pub(super) struct TypedVolume<'a> {
    pub(super) chooser: Chooser<'a>,
    pub(super) threshold: Threshold,
    pub(super) surface: SurfaceKind,
    pub(super) options: &'a BuildOptions,
}

impl<'a> TypedVolume<'a> {
    /// The solid of the voxels chosen by the threshold.
    ///
    /// # Errors
    /// No sample can be chosen, the volume cannot be read, or it is too large for cells.
    pub(super) fn solid(self) -> Result<Box<dyn Solid + 'a>, BuildError> {
        let chosen = self.chooser.choose(self.threshold)?;
        let volume = VolumeSolid::new(chosen, self.options, self.chooser);
        Ok(match self.surface {
            SurfaceKind::Skin => Box::new(volume),
            SurfaceKind::Cells => {
                let VolumeInfo { dims, description, spacing_mm, .. } = self.chooser.source.info();
                let dims = grid_dims(*dims, self.surface, &description.name)?;
                let bound = self.options.error.map_or(0.0, |error| error.voxels(*spacing_mm));
                Box::new(CellSolid::new(volume, dims, bound))
            }
        })
    }
}
