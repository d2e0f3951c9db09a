//! `oct verify`: every invariant of SPEC 6, for mapped and packed files.

use std::fs::File;
use std::io;
use std::path::Path;

use serde_json::{Value, json};

use super::pack::{Stop, unpack_to};
use super::wording::foreign::{data, shown};
use crate::error::Error;
use crate::format::Encoding;
use crate::load::{self, Fault, Frame, LoadError, open_regular};

/// A file that passed.
#[derive(Clone, Debug)]
pub struct VerifyReport {
    /// The file, as given.
    pub input: String,
    /// Its frame.
    pub frame: Frame,
}

/// Checks a file completely.
///
/// A packed file is unpacked into a nameless temporary file beside it (or, where that folder is
/// read-only, in the system's) and checked there: it needs that much free space for a moment.
/// Memory: under 24 MiB for any model.
///
/// # Errors
/// The first rule that is broken, or a failure to read.
pub fn verify_file(path: &Path) -> Result<VerifyReport, Error> {
    let unreadable = |cause| LoadError::Unreadable { path: path.to_path_buf(), cause };
    let file = open_regular(path).map_err(unreadable)?;
    let frame = Frame::read(&file).map_err(|fault| fault.at(path))?;
    if frame.header.encoding == Encoding::Packed {
        check(&unpacked(&file, path)?).map_err(|fault| fault.at(path))?;
    } else {
        check(&file).map_err(|fault| fault.at(path))?;
    }
    Ok(VerifyReport { input: data(path), frame })
}

/// The mapped form of a packed file in a nameless one.
///
/// # Errors
/// The packed file is damaged, or there is no room.
pub(super) fn unpacked(file: &File, path: &Path) -> Result<File, Error> {
    let scratch =
        scratch_beside(path).map_err(|cause| Error::Output { path: std::env::temp_dir(), cause })?;
    unpack_to(file, &scratch).map_err(|stop| match stop {
        Stop::Input(fault) => Error::Load(fault.at(path)),
        Stop::Output(cause) => Error::Output { path: path.to_path_buf(), cause },
    })?;
    Ok(scratch)
}

fn check(file: &File) -> Result<(), Fault> {
    load::verify(file).map(|_| ())
}

fn scratch_beside(path: &Path) -> io::Result<File> {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    tempfile::tempfile_in(folder).or_else(|_| tempfile::tempfile())
}

impl VerifyReport {
    /// One JSON object.
    pub fn json(&self) -> Value {
        json!({
            "input": self.input,
            "ok": true,
            "encoding": self.frame.header.encoding.name(),
            "skin_voxels": self.frame.header.voxels,
            "nodes": self.frame.header.nodes,
            "bytes": self.frame.header.file_bytes,
            "checksum": format!("{:08x}", super::info::content_checksum(&self.frame)),
        })
    }

    /// One sentence.
    pub fn text(&self) -> String {
        format!(
            "{}: sound ({} skin voxels, {} nodes, {})\n",
            shown(&self.input),
            self.frame.header.voxels,
            self.frame.header.nodes,
            self.frame.header.encoding.name()
        )
    }
}
