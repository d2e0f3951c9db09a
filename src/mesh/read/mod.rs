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
//! | `obj`, `text` | OBJ with MTL; OFF, and what text has in common |
//! | `gltf` | glTF, binary and text |
//! | `threemf`, `zip`, `xml` | 3MF, its archive and its text |
//! | `beside`, `look` | files that a mesh names; colours and textures |
//! | `limits` | what a reader may take and is asked for |
//! | `vertices`, `vertex_looks` | vertices, and what they carry, by number |
//! | `stop` | what stops a reader |

mod beside;
mod gltf;
mod limits;
mod look;
mod obj;
mod parts;
mod ply;
mod stl;
mod stop;
mod stream;
mod text;
mod threemf;
mod vertex_looks;
mod vertices;
mod xml;
mod zip;

use std::fs::File;
use std::path::{Path, PathBuf};

use super::corner::{Corner, EachCorners, Place};
use crate::facts::{Fault, MeshFault, SourceError};
pub(super) use limits::Limits;
pub(super) use look::{Image, Look, Material, NO_MATERIAL, Texture, Wrap, linear};
use stop::{Each, EachLook, Stop};

/// Most memory that a reader holds.
pub(super) const READER_BYTES: u64 = 512 << 10;

/// A format that is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Format {
    Stl,
    Ply,
    Obj,
    Off,
    Gltf,
    ThreeMf,
}

impl Format {
    const ALL: [Self; 6] = [Self::Stl, Self::Ply, Self::Obj, Self::Off, Self::Gltf, Self::ThreeMf];

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
        if gltf::is_binary(head) || named("gltf") {
            return Some(Self::Gltf);
        }
        // Other archives are no meshes.
        if named("3mf") {
            return Some(Self::ThreeMf);
        }
        named("obj").then_some(Self::Obj)
    }

    fn name(self) -> &'static str {
        match self {
            Self::Stl => "stl",
            Self::Ply => "ply",
            Self::Obj => "obj",
            Self::Off => "off",
            Self::Gltf => "gltf",
            Self::ThreeMf => "3mf",
        }
    }
}

/// The format of a mesh, by its first bytes (512 are enough), its length, and its name where these do not tell.
pub(crate) fn format_of(head: &[u8], bytes: u64, path: &Path) -> Option<&'static str> {
    Format::of(head.get(..stream::HEAD).unwrap_or(head), bytes, path).map(Format::name)
}

/// Is this the name of a mesh?
pub(crate) fn is_named(path: &Path) -> bool {
    let named = |suffix: &str| path.extension().is_some_and(|e| e.eq_ignore_ascii_case(suffix));
    Format::ALL.iter().any(|format| named(format.name())) || named("glb")
}

/// Looks at what a mesh states at its beginning, without reading it.
///
/// # Errors
/// It would be refused.
pub(crate) fn check(path: &Path, follow_links: bool) -> Result<(), SourceError> {
    let look = || -> Result<(), Stop> {
        let file = File::open(path).map_err(Stop::Read)?;
        let bytes = file.metadata().map_err(Stop::Read)?.len();
        let head = stream::head(&file).map_err(Stop::Read)?;
        match Format::of(&head, bytes, path) {
            Some(Format::Stl) if stl::binary_triangles(&head, bytes).is_none() && !stl::is_text(&head) => {
                Err(stl::count_lies(&head, bytes).into())
            }
            Some(Format::Ply) => ply::check(file, bytes),
            Some(Format::Gltf) => {
                let scratch = std::env::temp_dir();
                gltf::Gltf::open(file, bytes, path, &Limits { follow_links, ..Limits::plain(&scratch) })
                    .map(drop)
            }
            Some(Format::ThreeMf) => threemf::check(&file, bytes),
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
    unit_mm: f64,
    kind: Kind,
}

#[derive(Debug)]
enum Kind {
    StlBinary { file: File, triangles: u64 },
    StlText { file: File },
    Ply(ply::Ply),
    Off(text::Faces),
    Obj(Box<obj::Obj>),
    Gltf(Box<gltf::Gltf>),
    ThreeMf(Box<threemf::ThreeMf>),
}

impl MeshFile {
    /// Opens a mesh; vertices of formats of text wait in a nameless file in `scratch`.
    ///
    /// # Errors
    /// It cannot be read, or is no mesh of a format that is known.
    pub(super) fn open(path: &Path, limits: &Limits<'_>) -> Result<Self, SourceError> {
        Self::open_kind(path, limits)
            .map(|kind| Self { path: path.to_path_buf(), unit_mm: limits.unit_mm, kind })
            .map_err(|stop| told(path, limits.scratch, stop))
    }

    fn open_kind(path: &Path, limits: &Limits<'_>) -> Result<Kind, Stop> {
        let scratch = limits.scratch;
        let file = File::open(path).map_err(Stop::Read)?;
        let bytes = file.metadata().map_err(Stop::Read)?.len();
        let head = stream::head(&file).map_err(Stop::Read)?;
        match Format::of(&head, bytes, path) {
            Some(Format::Stl) => match stl::binary_triangles(&head, bytes) {
                Some(triangles) => Ok(Kind::StlBinary { file, triangles }),
                None if stl::is_text(&head) => Ok(Kind::StlText { file }),
                None => Err(stl::count_lies(&head, bytes).into()),
            },
            Some(Format::Ply) => Ok(Kind::Ply(ply::Ply::open(file, bytes, limits)?)),
            Some(Format::Off) => Ok(Kind::Off(text::Faces::off(&file, bytes, scratch)?)),
            Some(Format::Obj) => obj::Obj::open(&file, path, limits).map(|open| Kind::Obj(Box::new(open))),
            Some(Format::Gltf) => {
                gltf::Gltf::open(file, bytes, path, limits).map(|open| Kind::Gltf(Box::new(open)))
            }
            Some(Format::ThreeMf) => {
                threemf::ThreeMf::open(file, bytes, limits).map(|open| Kind::ThreeMf(Box::new(open)))
            }
            None => Err(MeshFault::Unknown.into()),
        }
    }

    /// Memory that it holds for what it says of its parts.
    pub(super) fn held_bytes(&self) -> u64 {
        match &self.kind {
            Kind::Obj(open) => open.held_bytes(),
            Kind::Gltf(open) => open.held_bytes(),
            Kind::ThreeMf(open) => open.held_bytes(),
            _ => 0,
        }
    }

    /// Files beside it that it is read from, too.
    pub(super) fn beside(&self) -> &[PathBuf] {
        match &self.kind {
            Kind::Obj(open) => open.beside(),
            Kind::Gltf(open) => open.beside(),
            _ => &[],
        }
    }

    /// Files that it takes its colours from, and that are not there.
    pub(super) fn missing(&self) -> &[String] {
        match &self.kind {
            Kind::Obj(open) => open.missing(),
            _ => &[],
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
            Kind::Off(faces) => faces.for_each(each),
            Kind::Obj(open) => open.for_each(each),
            Kind::Gltf(_) | Kind::ThreeMf(_) => {
                return self.for_each_look(scratch, &mut |t, _| each(t));
            }
        };
        read.map_err(|stop| told(&self.path, scratch, stop))
    }
}

impl MeshFile {
    /// As [`MeshFile::for_each`], with vertices brought to their place: each once, where faces name them by number.
    ///
    /// # Errors
    /// As [`MeshFile::for_each`]; a vertex of a triangle has no place.
    pub(super) fn for_each_corner(
        &self,
        scratch: &Path,
        place: &Place<'_>,
        each: &mut EachCorners<'_>,
    ) -> Result<(), SourceError> {
        let make = |p| Corner::new(p, place);
        let mut checked = |t: &[Corner; 3], number: u64| Corner::check(t, number).and_then(|()| each(t));
        let read = match &self.kind {
            Kind::Ply(ply) => ply.for_each_of(&make, &mut checked),
            Kind::Off(faces) => faces.for_each_of(&make, &mut checked),
            _ => return self.for_each(scratch, &mut |t| checked(&t.map(make), 0)),
        };
        read.map_err(|stop| told(&self.path, scratch, stop))
    }

    /// As [`MeshFile::for_each`], with what each triangle carries, if that was asked for.
    ///
    /// # Errors
    /// As [`MeshFile::for_each`].
    pub(super) fn for_each_look(&self, scratch: &Path, each: &mut EachLook<'_>) -> Result<(), SourceError> {
        let mut in_units = |t: &[[f64; 3]; 3], look: &Look| {
            if self.unit_mm == 1.0 {
                each(t, look)
            } else {
                each(&t.map(|p| p.map(|c| c / self.unit_mm)), look)
            }
        };
        let read = match &self.kind {
            // Faces whose vertices carry nothing are read faster.
            Kind::Ply(_) if self.has_looks() == [false; 2] => {
                return self.for_each(scratch, &mut |t| each(t, &Look::NONE));
            }
            Kind::Ply(open) => open.for_each_look(each),
            Kind::Obj(open) => open.for_each_look(each),
            Kind::Gltf(open) => open.for_each(&mut in_units),
            Kind::ThreeMf(open) => open.for_each(&mut in_units),
            _ => return self.for_each(scratch, &mut |t| each(t, &Look::NONE)),
        };
        read.map_err(|stop| told(&self.path, scratch, stop))
    }

    /// What triangles' materials are.
    pub(super) fn materials(&self) -> &[Material] {
        match &self.kind {
            Kind::Obj(open) => open.materials(),
            Kind::Gltf(open) => open.materials(),
            Kind::ThreeMf(open) => open.materials(),
            _ => &[],
        }
    }

    /// Parts that it has, at least one.
    pub(super) fn parts(&self) -> u64 {
        match &self.kind {
            Kind::Obj(open) => open.parts(),
            Kind::Gltf(open) => open.parts(),
            Kind::ThreeMf(open) => open.parts(),
            _ => 1,
        }
    }

    /// Has it colours, and normals of vertices? Asked of a mesh that was opened with looks.
    pub(super) fn has_looks(&self) -> [bool; 2] {
        match &self.kind {
            Kind::Ply(open) => [open.has_colors(), open.looks().normals.is_some()],
            Kind::Obj(open) => open.has_looks(),
            Kind::Gltf(open) => open.has_looks(),
            Kind::ThreeMf(open) => [open.has_colors(), false],
            _ => [false; 2],
        }
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
