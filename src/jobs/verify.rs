//! `oct verify`: every invariant of SPEC 6, for mapped and packed files.

use std::path::Path;

use serde::Serialize;

use super::info::content_checksum;
use super::open_model::unpacked;
use crate::error::Error;
use crate::format::{Encoding, SurfaceKind};
use crate::load::{self, FileIdentity, Frame, LoadError, LoadFault};
use crate::platform::PositionalFile;
use crate::text::{Count, data, shown};

/// A file that passed.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct VerifyReport {
    /// Input as named on the command line; several separated by blanks; `-` for standard input.
    pub input: String,
    /// Always true: a damaged file is an error.
    pub ok: bool,
    /// How the file is encoded.
    pub encoding: Encoding,
    /// Skin voxels of the model.
    pub skin_voxels: u64,
    /// Nodes of the octree, one infobyte each.
    pub nodes: u64,
    /// Size of the file that was written or read.
    pub bytes: u64,
    #[serde(skip)]
    pub(crate) surface: SurfaceKind,
    /// Eight hex digits; the same for the mapped and the packed file of one model.
    pub checksum: String,
}

/// Checks a file completely.
///
/// A packed file is unpacked into an unnamed temporary file next to it (or, where that folder is
/// read-only, in the system's) and checked there: it needs that much free space for a moment.
/// Memory: under 24 MiB for any model.
///
/// # Errors
/// The first rule that is broken, or a failure to read.
pub fn verify_file(path: &Path) -> Result<VerifyReport, Error> {
    let (file, frame) = opened(path)?;
    if frame.header.encoding == Encoding::Packed {
        check(&unpacked(&file, path)?, path)?;
    } else {
        check(&file, path)?;
    }
    Ok(VerifyReport {
        input: data(path),
        ok: true,
        encoding: frame.header.encoding,
        skin_voxels: frame.header.voxels,
        nodes: frame.header.nodes,
        bytes: frame.header.file_bytes,
        surface: frame.surface(),
        checksum: format!("{:08x}", content_checksum(&frame)),
    })
}

/// Checks a model that is about to be mapped; a packed one is checked as it is unpacked.
///
/// # Errors
/// As [`verify_file`].
pub(super) fn verify_unless_packed(path: &Path) -> Result<(), Error> {
    let (file, frame) = opened(path)?;
    if frame.header.encoding == Encoding::Packed {
        return Ok(());
    }
    check(&file, path)
}

fn opened(path: &Path) -> Result<(PositionalFile, Frame), LoadError> {
    let unreadable = |cause| LoadError::from(LoadFault::Unreadable { path: path.to_path_buf(), cause });
    let file = PositionalFile::open(path).map_err(unreadable)?;
    let frame = Frame::read(&file).map_err(|fault| fault.at(path))?;
    Ok((file, frame))
}

/// Checks a file, and that it is not written to meanwhile.
fn check(file: &PositionalFile, path: &Path) -> Result<(), Error> {
    let then = FileIdentity::of(file)
        .map_err(|cause| LoadError::from(LoadFault::Unreadable { path: path.to_path_buf(), cause }))?;
    let sound = load::verify(file);
    then.check(file, path)?;
    sound.map_err(|fault| fault.at(path))?;
    Ok(())
}

impl VerifyReport {
    /// Report in one sentence.
    pub fn text(&self) -> String {
        format!(
            "{}: sound ({}, {}, {})\n",
            shown(&self.input),
            Count(self.skin_voxels, super::info::noun(self.surface)),
            Count(self.nodes, "node"),
            self.encoding.name()
        )
    }
}
