//! Triangles from files, in their order, in constant memory.
//!
//! What a file is, is told by its content. A mesh is read once or twice from its beginning to its end; where faces
//! name vertices by number, these are looked up in the file itself or, for formats of text, in a nameless file
//! through a small cache of pages.
//!
//! | part | what it holds |
//! |---|---|
//! | `stream` | bytes, and words and numbers of text |
//! | `stl` | STL, binary and text |
//! | `ply` | PLY, binary of either order and text |
//! | `text` | OBJ and OFF |
//! | `vertices` | vertices by number |
//! | `stop` | what stops a reader |

mod ply;
mod stl;
mod stop;
mod stream;
mod text;
mod vertices;

use std::fs::File;
use std::path::{Path, PathBuf};

use crate::facts::{Fault, MeshFault, SourceError};
use stop::{Each, Stop};

/// Most memory that a reader holds.
pub(super) const READER_BYTES: u64 = 512 << 10;

/// An open mesh.
#[derive(Debug)]
pub(super) struct MeshFile {
    path: PathBuf,
    kind: Kind,
}

#[derive(Debug)]
enum Kind {
    StlBinary { file: File, triangles: u64 },
    StlText { file: File },
    Ply(ply::Ply),
    Faces(text::Faces),
}

impl MeshFile {
    /// Opens a mesh; vertices of formats of text wait in a nameless file in `scratch`.
    ///
    /// # Errors
    /// It cannot be read, or is no mesh of a format that is known.
    pub(super) fn open(path: &Path, scratch: &Path) -> Result<Self, SourceError> {
        Self::open_kind(path, scratch)
            .map(|kind| Self { path: path.to_path_buf(), kind })
            .map_err(|stop| told(path, scratch, stop))
    }

    fn open_kind(path: &Path, scratch: &Path) -> Result<Kind, Stop> {
        let file = File::open(path).map_err(Stop::Read)?;
        let bytes = file.metadata().map_err(Stop::Read)?.len();
        let head = stream::head(&file).map_err(Stop::Read)?;
        if let Some(triangles) = stl::binary_triangles(&head, bytes) {
            return Ok(Kind::StlBinary { file, triangles });
        }
        if head.starts_with(b"ply\n") || head.starts_with(b"ply\r") {
            return Ok(Kind::Ply(ply::Ply::open(file, bytes, scratch)?));
        }
        if text::is_off(&head) {
            return Ok(Kind::Faces(text::Faces::off(&file, bytes, scratch)?));
        }
        if stl::is_text(&head) {
            return Ok(Kind::StlText { file });
        }
        let named = |suffix: &str| path.extension().is_some_and(|e| e.eq_ignore_ascii_case(suffix));
        if named("obj") {
            return Ok(Kind::Faces(text::Faces::obj(&file, bytes, scratch)?));
        }
        if named("stl") {
            return Err(stl::count_lies(&head, bytes).into());
        }
        Err(MeshFault::Unknown.into())
    }

    /// Calls `each` with every triangle; faces with more vertices are cut into a fan.
    ///
    /// # Errors
    /// The file is wrong, or `each` says so.
    pub(super) fn for_each(&self, scratch: &Path, each: &mut Each<'_>) -> Result<(), SourceError> {
        let read = match &self.kind {
            Kind::StlBinary { file, triangles } => stl::for_each_binary(file, *triangles, each),
            Kind::StlText { file } => stl::for_each_text(file, each),
            Kind::Ply(ply) => ply.for_each(each),
            Kind::Faces(faces) => faces.for_each(each),
        };
        read.map_err(|stop| told(&self.path, scratch, stop))
    }
}

fn told(path: &Path, scratch: &Path, stop: Stop) -> SourceError {
    match stop {
        Stop::Mesh(fault) => {
            SourceError::Unusable { path: path.to_path_buf(), fault: Fault::MeshFile(fault) }
        }
        Stop::Read(cause) => SourceError::Unreadable { path: path.to_path_buf(), cause },
        Stop::Scratch(cause) => SourceError::Scratch { path: scratch.to_path_buf(), cause },
    }
}
