//! From a volume, whose samples have a type that is known at run time only, to its solid.
//!
//! This is the one place that knows every type: behind it a [`Solid`] is asked slice by slice, no matter what it is
//! made of, and the builder exists once.

use super::cells::{CellSolid, cell_dims};
use super::choose::{Chooser, Chosen};
use super::error::BuildError;
use super::lanes::RingSample;
use super::range::Ordered;
use super::report::BuildNote;
use super::ring::{Depths, RingForm, Samples};
use super::solid::Solid;
use super::volume::VolumeSolid;
use super::{BuildOptions, Threshold};
use crate::builder::BuildFault;
use crate::format::{Selection, SurfaceKind};
use crate::geom::Dims;
use crate::volume::{ScalarType, VolumeInfo};

/// Size of the grid of a model of a volume of this size.
///
/// # Errors
/// The volume is too large for cells.
pub(super) fn grid_dims(dims: Dims, surface: SurfaceKind, name: &str) -> Result<Dims, BuildError> {
    match surface {
        SurfaceKind::Skin => Ok(dims),
        SurfaceKind::Cells => cell_dims(dims)
            .ok_or_else(|| BuildError::from(BuildFault::NoRoomForCells { name: name.to_owned() })),
    }
}

/// A volume, and what of it is inside.
#[derive(Clone, Copy)]
pub(super) struct TypedVolume<'a> {
    pub(super) chooser: Chooser<'a>,
    pub(super) threshold: Threshold,
    pub(super) surface: SurfaceKind,
    pub(super) options: &'a BuildOptions,
}

impl<'a> TypedVolume<'a> {
    /// The solid of the voxels that the threshold chooses.
    ///
    /// # Errors
    /// No sample can be chosen, the volume cannot be read, or it is too large for cells.
    pub(super) fn solid(self) -> Result<Box<dyn Solid + 'a>, BuildError> {
        match self.chooser.source.info().scalar {
            ScalarType::U8 => self.samples::<u8>(),
            ScalarType::I8 => self.samples::<i8>(),
            ScalarType::U16 => self.samples::<u16>(),
            ScalarType::I16 => self.samples::<i16>(),
            ScalarType::F32 => self.samples::<f32>(),
            ScalarType::U32 => self.depths::<u32>(),
            ScalarType::I32 => self.depths::<i32>(),
            ScalarType::F64 => self.depths::<f64>(),
        }
    }

    /// Types that can stand in the ring as they are, if the range has only a lower end.
    fn samples<T: Ordered + RingSample>(self) -> Result<Box<dyn Solid + 'a>, BuildError> {
        let Chosen { selection, range, note } = self.chooser.choose::<T>(self.threshold)?;
        if range.is_open_above() {
            self.solid_of(Samples(range), selection, note)
        } else {
            self.solid_of(Depths(range), selection, note)
        }
    }

    fn depths<T: Ordered>(self) -> Result<Box<dyn Solid + 'a>, BuildError> {
        let Chosen { selection, range, note } = self.chooser.choose::<T>(self.threshold)?;
        self.solid_of(Depths(range), selection, note)
    }

    fn solid_of<F: RingForm + 'a>(
        self,
        form: F,
        selection: Selection,
        note: Option<BuildNote>,
    ) -> Result<Box<dyn Solid + 'a>, BuildError> {
        let mut volume = VolumeSolid::new(form, selection, self.options, self.chooser);
        volume.note = note;
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
