//! Corners of triangles on the lattice: a vertex is placed and hashed once, for all triangles that name it.

use super::edge_parity::vertex_hash;
use super::lattice::MAX_VOXELS;
use super::read::{Stop, not_finite};
use crate::fault::{Fault, bad};

/// Brings a vertex onto the lattice.
pub(super) type PlaceVertex<'a> = dyn Fn([f64; 3]) -> Option<[i32; 3]> + 'a;

/// Takes the corners of one triangle after the other.
pub(super) type EachCorners<'a> = dyn FnMut(&[Corner; 3]) -> Result<(), Stop> + 'a;

/// A vertex on the lattice.
#[derive(Clone, Copy, Debug)]
pub(super) struct Corner {
    pub(super) at: [i32; 3],
    state: State,
    pub(super) hash: [u64; 2],
}

/// Soundness of a vertex. Vertices that no triangle names may be anything.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    Sound,
    NotFinite,
    TooLarge,
}

pub(super) fn too_far() -> Fault {
    bad!(
        "reaches more than {MAX_VOXELS} voxels from the corner of the grid; choose larger voxels, or an origin nearer to the mesh"
    )
}

impl Corner {
    #[inline]
    pub(super) fn new(p: [f64; 3], place: &PlaceVertex<'_>) -> Self {
        let none = Self { at: [0; 3], state: State::NotFinite, hash: [0; 2] };
        if !p.iter().all(|c| c.is_finite()) {
            return none;
        }
        match place(p) {
            Some(at) => Self { at, state: State::Sound, hash: vertex_hash(&at) },
            None => Self { state: State::TooLarge, ..none },
        }
    }

    /// Refuses a triangle, counted from 1, with a corner that is not sound.
    #[inline]
    pub(super) fn check(corners: &[Self; 3], triangle: u64) -> Result<(), Fault> {
        let any = |state: State| corners.iter().any(|corner| corner.state == state);
        if corners.iter().all(|corner| corner.state == State::Sound) {
            Ok(())
        } else if any(State::NotFinite) {
            Err(not_finite(triangle))
        } else {
            Err(too_far())
        }
    }
}
