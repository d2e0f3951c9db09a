//! Triangles from files, in their order, in constant memory.
//!
//! The content of a file decides its format. A mesh is read once or twice from its beginning to its end; where faces
//! name vertices by number, these are looked up in the file itself or, for text formats, in a scratch file, through
//! a small cache of pages.
//!
//! | part | what it holds |
//! |---|---|
//! | `stream` | bytes, and words and numbers of text |
//! | `stl` | STL, binary and text |
//! | `ply` | PLY, binary of either order and text |
//! | `obj`, `text` | OBJ with MTL; OFF, and the parts common to text formats |
//! | `polygon` | faces of more than three corners |
//! | `gltf` | glTF, binary and text |
//! | `threemf`, `zip`, `xml` | 3MF, its archive and its text |
//! | `linked`, `look` | files that a mesh names; colours and textures |
//! | `vertices`, `vertex_looks` | vertices, and their looks, by number |
//! | `stop` | reasons that stop a reader |

mod appearance;
mod gltf;
mod linked;
mod obj;
mod parts;
mod ply;
mod polygon;
mod stl;
mod stop;
mod stream;
mod text;
mod threemf;
mod vertex_looks;
mod vertices;
mod xml;
mod zip;

use std::path::{Path, PathBuf};

use super::UpAxis;
use super::corner::{Corner, EachCorners, PlaceVertex};
use crate::mesh::read::stop::unknown_format;
use crate::platform::PositionalFile;
use crate::text::plain_head;
use crate::volume::{SourceError, SourceFault};
pub(super) use appearance::{Appearance, Image, Material, NO_MATERIAL, Texture, Wrap, linear};
pub(super) use linked::missing;
pub(crate) use polygon::cut as cut_polygon;
use stop::{Each, EachLook};
pub(super) use stop::{Stop, not_finite};

/// Most memory that a reader holds.
pub(super) const READER_BYTES: u64 = 512 << 10;

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

    /// Format by the first bytes and the length of a file, else by its name.
    fn of(head: &[u8], bytes: u64, path: &Path) -> Option<Self> {
        let named = |suffix| has_suffix(path, suffix);
        if stl::binary_triangles(head, bytes).is_some() {
            return Some(Self::Stl);
        }
        let text = plain_head(head);
        if ply::is_ply(&text) {
            return Some(Self::Ply);
        }
        if text::is_off(&text) {
            return Some(Self::Off);
        }
        if stl::is_text(head) || named("stl") {
            return Some(Self::Stl);
        }
        if gltf::is_binary(head) || named("gltf") {
            return Some(Self::Gltf);
        }
        // A mark of UTF-16, or no word that tells.
        let by_name = [Self::ThreeMf, Self::Ply, Self::Off, Self::Obj];
        by_name.into_iter().find(|format| named(format.name()))
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

/// The format of a mesh, by its first bytes (512 are enough), its length, and its name.
pub(crate) fn format_of(head: &[u8], bytes: u64, path: &Path) -> Option<&'static str> {
    Format::of(head.get(..stream::HEAD).unwrap_or(head), bytes, path).map(Format::name)
}

pub(crate) fn is_named(path: &Path) -> bool {
    Format::ALL.iter().any(|format| has_suffix(path, format.name())) || has_suffix(path, "glb")
}

/// True for a mesh whose file, by its name, states the unit and the axis that is up.
pub fn states_place(path: &Path) -> bool {
    ["gltf", "glb", "3mf"].iter().any(|suffix| has_suffix(path, suffix))
}

fn has_suffix(path: &Path, suffix: &str) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case(suffix))
}

/// An open file, its length, its first bytes and its format.
fn open_file(path: &Path) -> Result<(PositionalFile, u64, Vec<u8>, Format), Stop> {
    let file = PositionalFile::open(path).map_err(Stop::Read)?;
    let bytes = file.metadata().map_err(Stop::Read)?.len();
    let head = stream::head(&file).map_err(Stop::Read)?;
    let format = Format::of(&head, bytes, path).ok_or_else(unknown_format)?;
    Ok((file, bytes, head, format))
}

/// Checks the beginning of a mesh, without reading the rest.
///
/// # Errors
/// The mesh would be refused.
pub(crate) fn check(path: &Path, follow_links: bool) -> Result<(), SourceError> {
    let check = || -> Result<(), Stop> {
        let (file, bytes, head, format) = open_file(path)?;
        match format {
            Format::Stl => stl::triangles(&head, bytes).map(drop),
            Format::Ply => ply::check(file, bytes),
            Format::Gltf => {
                let scratch = std::env::temp_dir();
                gltf::open(file, bytes, path, &Limits { follow_links, ..Limits::plain(&scratch) }).map(drop)
            }
            Format::ThreeMf => threemf::check(&file, bytes),
            Format::Obj | Format::Off => stream::mark(&head).map(drop).map_err(Stop::from),
        }
    };
    check().map_err(|stop| error_of(path, path, stop))
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Limits<'a> {
    pub(super) scratch: &'a Path,
    /// Memory for the description of a file, in addition to [`READER_BYTES`].
    pub(super) most_bytes: u64,
    /// True to follow links that lead from a file that a mesh names out of its folder.
    pub(super) follow_links: bool,
    /// True if looks of vertices are wanted; and colours and textures among them.
    pub(super) looks: bool,
    pub(super) colors: bool,
    /// Millimetres of the unit that callers assume: coordinates of files that state their unit are brought to it.
    pub(super) unit_mm: f64,
    /// Up axis of files that do not state it.
    pub(super) up: UpAxis,
}

impl<'a> Limits<'a> {
    /// Shapes in millimetres, and a few MiB.
    pub(super) fn plain(scratch: &'a Path) -> Self {
        Self {
            scratch,
            most_bytes: 4 << 20,
            follow_links: false,
            looks: false,
            colors: false,
            unit_mm: 1.0,
            up: UpAxis::Z,
        }
    }
}

/// Facts about an open file, besides its triangles.
#[derive(Debug, Default)]
pub(super) struct Summary {
    pub(super) materials: Vec<Material>,
    /// Other files that the mesh is read from.
    pub(super) files: Vec<PathBuf>,
    /// Lacks of the mesh, and parts of it that are not read.
    pub(super) lacks: Vec<String>,
    /// Memory of its description.
    pub(super) held_bytes: u64,
    parts: u64,
    /// True where it has colours, and normals of vertices; as far as it shows, for a mesh that was opened without
    /// looks.
    pub(super) looks: [bool; 2],
}

pub(super) struct MeshFile {
    path: PathBuf,
    unit_mm: f64,
    up: UpAxis,
    kind: Kind,
    pub(super) summary: Summary,
}

enum Kind {
    StlBinary { file: PositionalFile, triangles: u64, colored: Option<stl::LateLack> },
    StlText { file: PositionalFile, tail: stl::LateLack },
    Ply(ply::Ply),
    Off(text::Faces),
    Obj(Box<obj::Obj>),
    Gltf(Box<gltf::Gltf>),
    ThreeMf(Box<threemf::ThreeMf>),
}

impl MeshFile {
    /// Opens a mesh; vertices of text formats are written to a scratch file.
    ///
    /// # Errors
    /// The file cannot be read, or its format is unknown.
    pub(super) fn open(path: &Path, limits: &Limits<'_>) -> Result<Self, SourceError> {
        let (kind, summary) =
            Self::open_kind(path, limits).map_err(|stop| error_of(path, limits.scratch, stop))?;
        Ok(Self { path: path.to_path_buf(), unit_mm: limits.unit_mm, up: limits.up, kind, summary })
    }

    fn open_kind(path: &Path, limits: &Limits<'_>) -> Result<(Kind, Summary), Stop> {
        let (file, bytes, head, format) = open_file(path)?;
        let kind = match format {
            Format::Stl => match stl::triangles(&head, bytes)? {
                Some((triangles, behind)) => {
                    let lacks = stl::lack(triangles, behind).into_iter().collect();
                    let colored = limits.colors.then(stl::LateLack::new);
                    if let Some(colored) = colored.as_ref().filter(|_| stl::is_colored(&head)) {
                        colored.get_or_init(|| stop::unread_colors("STL"));
                    }
                    return Ok((
                        Kind::StlBinary { file, triangles, colored },
                        Summary { lacks, ..Summary::default() },
                    ));
                }
                None => Kind::StlText { file, tail: stl::LateLack::new() },
            },
            Format::Ply => {
                let (open, lacks) = ply::Ply::open(file, bytes, limits)?;
                let looks = open.has_looks();
                return Ok((Kind::Ply(open), Summary { looks, lacks, ..Summary::default() }));
            }
            Format::Off => {
                let (faces, lacks) = text::Faces::off(&file, bytes, limits)?;
                return Ok((Kind::Off(faces), Summary { lacks, ..Summary::default() }));
            }
            Format::Obj => return obj::open(&file, path, limits).map(|(o, s)| (Kind::Obj(Box::new(o)), s)),
            Format::Gltf => {
                return gltf::open(file, bytes, path, limits).map(|(o, s)| (Kind::Gltf(Box::new(o)), s));
            }
            Format::ThreeMf => {
                return threemf::open(file, bytes, limits).map(|(o, s)| (Kind::ThreeMf(Box::new(o)), s));
            }
        };
        Ok((kind, Summary::default()))
    }

    /// Parts of the file that are left out; all are known once the triangles have been read.
    pub(super) fn lacks(&self) -> impl Iterator<Item = String> {
        let late = match &self.kind {
            Kind::Ply(ply) => ply.lack(),
            Kind::StlBinary { colored, .. } => colored.as_ref().and_then(|late| late.get().cloned()),
            Kind::StlText { tail, .. } => tail.get().cloned(),
            _ => None,
        };
        self.summary.lacks.iter().cloned().chain(late)
    }

    /// Number of parts, at least one.
    pub(super) fn parts(&self) -> u64 {
        self.summary.parts.max(1)
    }

    /// Calls `each` with every triangle; faces with more vertices are cut.
    ///
    /// # Errors
    /// The file is wrong, or `each` fails.
    pub(super) fn for_each(&self, scratch: &Path, each: &mut Each<'_>) -> Result<(), SourceError> {
        let mut upright = |t: &[[f64; 3]; 3]| match self.up {
            UpAxis::Z => each(t),
            up => each(&t.map(|p| up.upright(p))),
        };
        let read = match &self.kind {
            Kind::StlBinary { file, triangles, colored } => {
                stl::for_each_binary(file, *triangles, colored.as_ref(), &mut upright)
            }
            Kind::StlText { file, tail } => stl::for_each_text(file, tail, &mut upright),
            Kind::Ply(ply) => ply.for_each(&mut upright),
            Kind::Off(faces) => faces.for_each(&mut upright),
            Kind::Obj(open) => open.for_each(&mut upright),
            Kind::Gltf(_) | Kind::ThreeMf(_) => {
                return self.for_each_look(scratch, &mut |t, _| each(t));
            }
        };
        read.map_err(|stop| error_of(&self.path, scratch, stop))
    }

    /// Calls `each` with every triangle, its vertices placed: each vertex once, where faces name it by number.
    ///
    /// # Errors
    /// The file is wrong, `each` fails, or a vertex of a triangle cannot be placed.
    pub(super) fn for_each_corner(
        &self,
        scratch: &Path,
        place: &PlaceVertex<'_>,
        each: &mut EachCorners<'_>,
    ) -> Result<(), SourceError> {
        let make = |p| Corner::new(self.up.upright(p), place);
        let mut checked = |t: &[Corner; 3], number: u64| {
            Corner::check(t, number)?;
            each(t)
        };
        let read = match &self.kind {
            Kind::Ply(ply) => ply.for_each_of(&make, &mut checked),
            Kind::Off(faces) => faces.for_each_of(&make, &mut checked),
            _ => return self.for_each(scratch, &mut |t| checked(&t.map(|p| Corner::new(p, place)), 0)),
        };
        read.map_err(|stop| error_of(&self.path, scratch, stop))
    }

    /// Calls `each` with every triangle and its look, if looks were asked for.
    ///
    /// # Errors
    /// The file is wrong, or `each` fails.
    pub(super) fn for_each_look(&self, scratch: &Path, each: &mut EachLook<'_>) -> Result<(), SourceError> {
        let is_placed = matches!(self.kind, Kind::Gltf(_) | Kind::ThreeMf(_));
        let (unit_mm, up) = if is_placed { (self.unit_mm, UpAxis::Z) } else { (1.0, self.up) };
        let mut placed = |t: &[[f64; 3]; 3], look: &Appearance| {
            if unit_mm == 1.0 && up == UpAxis::Z {
                return each(t, look);
            }
            let normals = look.normals.map(|all| all.map(|n| up.upright(n)));
            each(&t.map(|p| up.upright(p.map(|c| c / unit_mm))), &Appearance { normals, ..*look })
        };
        let read = match &self.kind {
            // Faces of vertices without looks are read faster.
            Kind::Ply(open) if self.summary.looks != [false; 2] => open.for_each_look(&mut placed),
            Kind::Obj(open) => open.for_each_look(&mut placed),
            Kind::Gltf(open) => open.for_each(&mut placed),
            Kind::ThreeMf(open) => open.for_each(&mut placed),
            _ => return self.for_each(scratch, &mut |t| each(t, &Appearance::NONE)),
        };
        read.map_err(|stop| error_of(&self.path, scratch, stop))
    }
}

fn error_of(path: &Path, scratch: &Path, stop: Stop) -> SourceError {
    match stop {
        Stop::Mesh(fault) => fault.at(path).into(),
        Stop::Read(cause) => SourceError::from(SourceFault::Unreadable { path: path.to_path_buf(), cause }),
        Stop::Scratch(cause) => {
            SourceError::from(SourceFault::Scratch { path: scratch.to_path_buf(), cause })
        }
        Stop::Memory { needed_bytes, allowed_bytes } => {
            SourceFault::Description { path: path.to_path_buf(), needed_bytes, allowed_bytes }.into()
        }
        Stop::Caller(error) => error,
    }
}
