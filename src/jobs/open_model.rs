//! A model for use, mapped or packed.

use std::fs::File;
use std::io;
use std::path::Path;

use super::pack::{Stop, unpack_file};
use crate::error::Error;
use crate::fault::unfit;
use crate::format::Encoding;
use crate::load::{Fault, FileIdentity, Frame, LoadError, LoadFault, Mapping, Model};
use crate::platform::PositionalFile;
use crate::text::names::ERROR;

/// Opens a model. A packed one is unpacked into an unnamed temporary file next to it (or, where that folder is
/// read-only, in the system's) for as long as it is open: that takes as much disk as the mapped file, and the time
/// of `oct unpack`.
///
/// # Errors
/// The file is unreadable, foreign or damaged, or there is no room.
pub fn open_model(path: &Path) -> Result<Model, Error> {
    let unreadable = |cause| LoadError::from(LoadFault::Unreadable { path: path.to_path_buf(), cause });
    let file = PositionalFile::open(path).map_err(unreadable)?;
    if Frame::read(&file).map_err(|fault| fault.at(path))?.header.encoding == Encoding::Mapped {
        return Ok(Model::map(path)?);
    }
    let scratch = unpacked(&file, path)?;
    let model = Model::from_bytes(Mapping::of(&scratch).map_err(unreadable)?);
    Ok(model.map_err(|cause| Fault::Format(cause).at(path))?)
}

/// Refuses a model with larger leaves for an operation on single cells; `what` is a subject and its verb for the
/// sentence.
///
/// # Errors
/// The model has larger leaves.
pub(super) fn refuse_larger_leaves(model: &Model, path: &Path, what: &str) -> Result<(), Error> {
    if model.header().leaves {
        return Err(unfit!("has larger leaves, and {what} of single cells; build it without {ERROR}")
            .at(path)
            .into());
    }
    Ok(())
}

/// The mapped form of a packed file, in an unnamed file.
///
/// # Errors
/// The packed file is damaged, or is written to meanwhile, or there is no room.
pub(crate) fn unpacked(file: &PositionalFile, path: &Path) -> Result<PositionalFile, Error> {
    let then = FileIdentity::of(file)
        .map_err(|cause| LoadError::from(LoadFault::Unreadable { path: path.to_path_buf(), cause }))?;
    let scratch =
        scratch_beside(path).map_err(|cause| Error::Output { path: std::env::temp_dir(), cause })?;
    let unpacked = unpack_file(file, &scratch);
    then.check(file, path)?;
    unpacked.map_err(|stop| match stop {
        Stop::Input(fault) => Error::Load(fault.at(path)),
        Stop::Output(cause) => Error::Output { path: path.to_path_buf(), cause },
    })?;
    Ok(scratch.into())
}

/// An unnamed file in the folder of another one, or where that is read-only in the system's.
pub(super) fn scratch_beside(path: &Path) -> io::Result<File> {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    tempfile::tempfile_in(folder).or_else(|_| tempfile::tempfile())
}
