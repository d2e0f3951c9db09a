//! What is called with triangles, and what stops a reader.

use super::look::Look;
use crate::facts::MeshFault;

/// Is called with the vertices of one triangle after the other.
pub(in crate::mesh) type Each<'a> = dyn FnMut(&[[f64; 3]; 3]) -> Result<(), MeshFault> + 'a;

/// Is called with what was made of the vertices of each triangle, and its number, counted from 1.
pub(super) type EachOf<'a, P> = dyn FnMut(&[P; 3], u64) -> Result<(), MeshFault> + 'a;

/// The same with what each triangle carries.
pub(in crate::mesh) type EachLook<'a> = dyn FnMut(&[[f64; 3]; 3], &Look) -> Result<(), MeshFault> + 'a;

/// Refuses a triangle, which is counted from 1, with coordinates that are not numbers.
#[inline]
pub(super) fn finite(t: &[[f64; 3]; 3], triangle: u64) -> Result<(), MeshFault> {
    if t.iter().flatten().all(|c| c.is_finite()) { Ok(()) } else { Err(MeshFault::NotFinite { triangle }) }
}

/// What stops a reader: the file is wrong, or it cannot be read, or the scratch file cannot.
#[derive(Debug)]
pub(super) enum Stop {
    Mesh(MeshFault),
    Read(std::io::Error),
    Scratch(std::io::Error),
}

impl From<MeshFault> for Stop {
    fn from(fault: MeshFault) -> Self {
        Self::Mesh(fault)
    }
}

impl Stop {
    /// Of a failure to read: where the file ended, it was cut short.
    pub(super) fn reading(cause: std::io::Error) -> Self {
        if cause.kind() == std::io::ErrorKind::UnexpectedEof {
            Self::Mesh(MeshFault::CutShort)
        } else {
            Self::Read(cause)
        }
    }
}
