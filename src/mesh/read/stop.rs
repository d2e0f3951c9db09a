//! The callers of a reader, and what stops it.

use super::look::Look;
use crate::facts::{MeshFault, SourceError};

/// Takes the vertices of one triangle after the other.
pub(in crate::mesh) type Each<'a> = dyn FnMut(&[[f64; 3]; 3]) -> Result<(), Stop> + 'a;

/// Takes what was made of the vertices of each triangle, and its number, counted from 1.
pub(super) type EachOf<'a, P> = dyn FnMut(&[P; 3], u64) -> Result<(), Stop> + 'a;

/// Takes the vertices of each triangle, and its look.
pub(in crate::mesh) type EachLook<'a> = dyn FnMut(&[[f64; 3]; 3], &Look) -> Result<(), Stop> + 'a;

/// Refuses a triangle, which is counted from 1, with coordinates that are not numbers.
#[inline]
pub(super) fn finite(t: &[[f64; 3]; 3], triangle: u64) -> Result<(), MeshFault> {
    if t.iter().flatten().all(|c| c.is_finite()) { Ok(()) } else { Err(MeshFault::NotFinite { triangle }) }
}

/// Why a reader stops: the file is wrong or unreadable, the scratch file failed, or the caller refuses a triangle.
#[derive(Debug)]
pub(in crate::mesh) enum Stop {
    Mesh(MeshFault),
    Read(std::io::Error),
    Scratch(std::io::Error),
    Caller(SourceError),
}

impl From<SourceError> for Stop {
    fn from(error: SourceError) -> Self {
        Self::Caller(error)
    }
}

impl From<MeshFault> for Stop {
    fn from(fault: MeshFault) -> Self {
        Self::Mesh(fault)
    }
}

impl Stop {
    /// A failure to read; at the end of the file it was cut short.
    pub(super) fn reading(cause: std::io::Error) -> Self {
        if cause.kind() == std::io::ErrorKind::UnexpectedEof {
            Self::Mesh(MeshFault::CutShort)
        } else {
            Self::Read(cause)
        }
    }
}
