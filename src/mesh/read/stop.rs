//! The callbacks of a reader, and its reasons to stop.

use super::appearance::Appearance;
use crate::fault::{Fault, FaultKind, bad, conversions};
use crate::text::shown;
use crate::volume::SourceError;

/// The note on faces that have a texture and no places in it.
pub(super) const UNPLACED: &str = "has faces with a texture and without places in it (texture coordinates); they have the plain colour of their material";

/// Takes the vertices of one triangle after the other.
pub(in crate::mesh) type Each<'a> = dyn FnMut(&[[f64; 3]; 3]) -> Result<(), Stop> + 'a;

/// Receives the values made of the vertices of each triangle, and its number, counted from 1.
pub(super) type EachOf<'a, P> = dyn FnMut(&[P; 3], u64) -> Result<(), Stop> + 'a;

/// Takes the vertices of each triangle, and its look.
pub(in crate::mesh) type EachLook<'a> = dyn FnMut(&[[f64; 3]; 3], &Appearance) -> Result<(), Stop> + 'a;

/// Refuses a triangle, which is counted from 1, with coordinates that are not numbers.
#[inline]
pub(super) fn finite(t: &[[f64; 3]; 3], triangle: u64) -> Result<(), Fault> {
    if t.iter().flatten().all(|c| c.is_finite()) { Ok(()) } else { Err(not_finite(triangle)) }
}

pub(super) fn cut_short() -> Fault {
    bad!("ends before all that it states; it was cut short, copy it again")
}

pub(super) fn bad_index(face: u64, vertices: u64) -> Fault {
    bad!("face {face} names a vertex that does not exist ({vertices} are stated); repair the mesh")
}

pub(super) fn count_lies(stated: u64, held: u64) -> Fault {
    bad!(
        "states {stated} elements where its bytes hold {held} at most; it was cut short or damaged, copy it again"
    )
}

pub(super) fn bad_text(line: u64) -> Fault {
    bad!("line {line} cannot be understood; repair the file")
}

pub(super) fn bad_text_because(line: u64, why: &str) -> Fault {
    bad!("line {line} cannot be understood: {why}; repair the file")
}

/// The beginning of a text from the file, between marks.
pub(super) fn quoted(text: &[u8]) -> String {
    let text: String = String::from_utf8_lossy(text).chars().take(64).collect();
    format!("`{}`", shown(&text))
}

/// Refusal of text where a number belongs.
pub(super) fn not_a_number(text: &[u8]) -> String {
    format!("{} is not a number (of digits and a decimal point)", quoted(text))
}

/// The note on colours of a format from which they are not read.
pub(super) fn unread_colors(format: &str) -> String {
    format!(
        "has colours, which are not read from {format}; the model lacks them: write it as PLY, OBJ or glTF"
    )
}

pub(super) fn bad_archive() -> Fault {
    bad!("is an archive that is damaged or cut short; copy it again")
}

pub(super) fn recursion() -> Fault {
    bad!("has parts that contain themselves, or nest too deep; repair the file")
}

pub(super) fn bad_transform() -> Fault {
    bad!("places a part by numbers that are infinite; repair the file")
}

pub(super) fn only_points() -> Fault {
    bad!("has no faces, only points or lines; make a surface of them first")
}

pub(super) fn no_faces() -> Fault {
    bad!("its faces are not lists of whole numbers (vertex_indices); write it as triangles")
}

pub(super) fn no_coordinates() -> Fault {
    bad!("its vertices have no x, y and z")
}

pub(super) fn too_many_triangles(most: u64) -> Fault {
    bad!(
        "repeats its parts to more than {most} triangles, far more than its size justifies; write the parts out"
    )
}

pub(in crate::mesh) fn not_finite(triangle: u64) -> Fault {
    bad!("triangle {triangle} has a coordinate that is infinite or not a number; repair the mesh")
}

pub(super) fn buffer_lies(stated: u64, held: u64) -> Fault {
    bad!("states {stated} bytes of data where there are {held}; it was cut short or damaged, copy it again")
}

pub(super) fn gltf_version(version: &str) -> Fault {
    bad!("is glTF of version {}, which is not read; write it as glTF 2.0", shown(version))
}

pub(super) fn bad_reference(part: &str) -> Fault {
    bad!("refers to {part} that does not exist or is not valid; repair the file")
}

pub(super) fn outside(name: &str) -> Fault {
    Fault::new(
        FaultKind::Absent,
        format!("names {}, which is not below its own folder; copy it there", shown(name)),
    )
}

pub(super) fn unread_extension(name: &str) -> Fault {
    bad!("requires the extension {}, which is not read; write it without", shown(name))
}

pub(super) fn unknown_format() -> Fault {
    bad!("is not a mesh of a known format; STL, PLY, OBJ, OFF, glTF and 3MF are read")
}

/// Reason why a reader stops: the file is wrong or unreadable, the scratch file failed, or the caller refuses a
/// triangle.
#[derive(Debug)]
pub(in crate::mesh) enum Stop {
    Mesh(Fault),
    Read(std::io::Error),
    Scratch(std::io::Error),
    /// Descriptions take more memory than there is.
    Memory {
        needed_bytes: u64,
        allowed_bytes: u64,
    },
    Caller(SourceError),
}

conversions!(Stop {
    error: SourceError => Self::Caller(error),
    fault: Fault => Self::Mesh(fault),
});

impl Stop {
    /// A fault of a file that the mesh names.
    pub(super) fn in_file(self, name: &str) -> Self {
        match self {
            Self::Mesh(fault) => {
                Self::Mesh(Fault::new(fault.kind, format!("names {}: {}", shown(name), fault.text)))
            }
            other => other,
        }
    }

    /// A failure to read; at the end of the file it was cut short.
    pub(super) fn reading(cause: std::io::Error) -> Self {
        if cause.kind() == std::io::ErrorKind::UnexpectedEof {
            Self::Mesh(cut_short())
        } else {
            Self::Read(cause)
        }
    }
}
