//! Solids whose type is not known: parts of a solid that is made of several.

use super::choose::Chooser;
use super::range::Ordered;
use super::ring::{Depths, Samples};
use super::solid::{Solid, SolidWorker, Tile};
use super::volume::VolumeSolid;
use super::{BuildError, BuildOptions, Threshold, lanes};
use crate::progress::Progress;
use crate::volume::{ScalarType, SourceError, VolumeSource};

/// A solid of any type.
pub(crate) trait AnySolid: Sync {
    /// As of a [`Solid`].
    fn worker_bytes(&self, tile: &Tile) -> u64;
    /// As of a [`Solid`].
    fn input_bytes(&self) -> u64;
    /// As of a [`Solid`].
    fn worker(&self, tile: &Tile) -> Box<dyn SolidWorker + '_>;
    /// As of a [`Solid`].
    fn check_unchanged(&self) -> Result<(), SourceError>;
}

impl<S: Solid> AnySolid for S {
    fn worker_bytes(&self, tile: &Tile) -> u64 {
        Solid::worker_bytes(self, tile)
    }

    fn input_bytes(&self) -> u64 {
        Solid::input_bytes(self)
    }

    fn worker(&self, tile: &Tile) -> Box<dyn SolidWorker + '_> {
        Box::new(Solid::worker(self, tile))
    }

    fn check_unchanged(&self) -> Result<(), SourceError> {
        Solid::check_unchanged(self)
    }
}

/// The voxels of a volume of at least a value, as a part of something else.
///
/// # Errors
/// No sample can have such a value, or the value is not a number.
pub(crate) fn volume_part<'a>(
    source: &'a dyn VolumeSource,
    iso: f64,
    options: &'a BuildOptions,
    progress: &'a dyn Progress,
) -> Result<Box<dyn AnySolid + 'a>, BuildError> {
    match source.info().scalar {
        ScalarType::U8 => samples::<u8>(source, iso, options, progress),
        ScalarType::I8 => samples::<i8>(source, iso, options, progress),
        ScalarType::U16 => samples::<u16>(source, iso, options, progress),
        ScalarType::I16 => samples::<i16>(source, iso, options, progress),
        ScalarType::F32 => samples::<f32>(source, iso, options, progress),
        ScalarType::U32 => depths::<u32>(source, iso, options, progress),
        ScalarType::I32 => depths::<i32>(source, iso, options, progress),
        ScalarType::F64 => depths::<f64>(source, iso, options, progress),
    }
}

fn samples<'a, T: Ordered + lanes::RingSample>(
    source: &'a dyn VolumeSource,
    iso: f64,
    options: &'a BuildOptions,
    progress: &'a dyn Progress,
) -> Result<Box<dyn AnySolid + 'a>, BuildError> {
    let chooser = Chooser { source, memory: options.memory, threads: options.threads, progress };
    let (selection, range) = chooser.choose::<T>(Threshold::Iso(iso))?;
    if range.is_open_above() {
        Ok(Box::new(VolumeSolid::new(source, Samples(range), selection, options, chooser)))
    } else {
        Ok(Box::new(VolumeSolid::new(source, Depths(range), selection, options, chooser)))
    }
}

fn depths<'a, T: Ordered>(
    source: &'a dyn VolumeSource,
    iso: f64,
    options: &'a BuildOptions,
    progress: &'a dyn Progress,
) -> Result<Box<dyn AnySolid + 'a>, BuildError> {
    let chooser = Chooser { source, memory: options.memory, threads: options.threads, progress };
    let (selection, range) = chooser.choose::<T>(Threshold::Iso(iso))?;
    Ok(Box::new(VolumeSolid::new(source, Depths(range), selection, options, chooser)))
}
