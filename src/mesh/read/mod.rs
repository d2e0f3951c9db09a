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

/// A format that is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Format {
    Stl,
    Ply,
    Obj,
    Off,
}

impl Format {
    /// By the first bytes and the length of a file; where these do not tell, by its name.
    fn of(head: &[u8], bytes: u64, path: &Path) -> Option<Self> {
        let named = |suffix: &str| path.extension().is_some_and(|e| e.eq_ignore_ascii_case(suffix));
        if stl::binary_triangles(head, bytes).is_some() {
            return Some(Self::Stl);
        }
        if head.starts_with(b"ply\n") || head.starts_with(b"ply\r") {
            return Some(Self::Ply);
        }
        if text::is_off(head) {
            return Some(Self::Off);
        }
        if stl::is_text(head) || named("stl") {
            return Some(Self::Stl);
        }
        named("obj").then_some(Self::Obj)
    }

    fn name(self) -> &'static str {
        match self {
            Self::Stl => "stl",
            Self::Ply => "ply",
            Self::Obj => "obj",
            Self::Off => "off",
        }
    }
}

/// The format of a mesh, by its first bytes (512 are enough), its length, and its name where these do not tell.
pub(crate) fn format_of(head: &[u8], bytes: u64, path: &Path) -> Option<&'static str> {
    Format::of(head.get(..stream::HEAD).unwrap_or(head), bytes, path).map(Format::name)
}

/// Looks at what a mesh states at its beginning, without reading it.
///
/// # Errors
/// It would be refused.
pub(crate) fn check(path: &Path) -> Result<(), SourceError> {
    let look = || -> Result<(), Stop> {
        let file = File::open(path).map_err(Stop::Read)?;
        let bytes = file.metadata().map_err(Stop::Read)?.len();
        let head = stream::head(&file).map_err(Stop::Read)?;
        match Format::of(&head, bytes, path) {
            Some(Format::Stl) if stl::binary_triangles(&head, bytes).is_none() && !stl::is_text(&head) => {
                Err(stl::count_lies(&head, bytes).into())
            }
            Some(Format::Ply) => ply::check(file, bytes),
            Some(Format::Stl | Format::Obj | Format::Off) => Ok(()),
            None => Err(MeshFault::Unknown.into()),
        }
    };
    look().map_err(|stop| told(path, path, stop))
}

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
        match Format::of(&head, bytes, path) {
            Some(Format::Stl) => match stl::binary_triangles(&head, bytes) {
                Some(triangles) => Ok(Kind::StlBinary { file, triangles }),
                None if stl::is_text(&head) => Ok(Kind::StlText { file }),
                None => Err(stl::count_lies(&head, bytes).into()),
            },
            Some(Format::Ply) => Ok(Kind::Ply(ply::Ply::open(file, bytes, scratch)?)),
            Some(Format::Off) => Ok(Kind::Faces(text::Faces::off(&file, bytes, scratch)?)),
            Some(Format::Obj) => Ok(Kind::Faces(text::Faces::obj(&file, bytes, scratch)?)),
            None => Err(MeshFault::Unknown.into()),
        }
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
