//! Placed leaves: which voxels are inside, exactly, and where their surface faces.
//!
//! | part | leaves | decided by |
//! |---|---|---|
//! | `plain` | sphere, box along the axes, half-space | whole numbers, a row at a time |
//! | `curved` | ellipsoid, cylinder, cone, torus under any affine | intervals; where they leave doubt, whole numbers |
//! | `body` | triangles | crossings of rows, as of meshes |
//! | `near` | triangles of a body by where they lie | |
//! | `extent` | boxes of voxels around leaves, beyond which they are not asked | |
//! | `nested` | leaves that lie within others in a box | |
//!
//! A leaf is placed once: corners, middles and axes are rounded to the lattice of 2^-12 voxel (radii along with the
//! axes). From then on a voxel is inside if its middle is, decided in whole numbers for that placed solid; only a
//! torus rounds once more, middles to 2^-26 of its major radius. A middle that lies on a surface is moved by
//! (-e, e^2, e^3), as for meshes: of two leaves that share a face it lies in one, whatever they are.

mod body;
mod cross;
mod curved;
mod extent;
mod make;
mod near;
mod nested;
mod plain;

use super::place::centre;
use super::tree::boxed;
use crate::builder::{Cover, VoxelBox};
use crate::mesh::Crossings;
pub(super) use body::{BINNED, Body};
pub(super) use curved::{Curved, Round};
pub(super) use extent::Extent;
pub(super) use make::place;
pub(super) use nested::Nested;
pub(super) use plain::{Ball, Block, Half};

/// A placed leaf.
#[derive(Debug)]
pub(super) enum Leaf {
    /// A leaf without a voxel.
    Nothing,
    Ball(Ball),
    Block(Box<Block>),
    Half(Box<Half>),
    Curved(Box<Curved>),
    Body(Box<Body>),
    /// A mesh or a volume that is sampled slice by slice, by its number.
    Sampled(u32),
}

/// 64 voxels of each of some rows of a slice.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rows {
    /// The first of the 64 voxels.
    pub(super) x: i32,
    /// The first row.
    pub(super) y: i32,
    pub(super) z: i32,
}

/// The surface of a leaf next to a voxel.
#[derive(Clone, Copy, Debug)]
pub(super) struct Face {
    /// Normal out of the leaf, in lattice coordinates (like a gradient), of any length.
    pub(super) outwards: [f64; 3],
    /// Approximate distance from the voxel's middle, in lattice steps.
    pub(super) distance: f64,
}

/// The lowest and highest middles of a box, in lattice steps.
pub(super) fn middles(region: &VoxelBox) -> [(i64, i64); 3] {
    [&region.x, &region.y, &region.z].map(|r| {
        let at = |v: u32| centre(i32::try_from(v).unwrap_or(i32::MAX));
        (at(r.start), at(r.end.max(1) - 1))
    })
}

/// Bits `first..=last` of a word.
#[inline]
pub(super) fn bits(first: i64, last: i64) -> u64 {
    let (first, last) = (first.max(0), last.min(63));
    if first > last { 0 } else { u64::MAX << first & u64::MAX >> (63 - last) }
}

/// Largest part of a gradient that may be rounding.
const ROUNDING: f64 = 1e-9;

/// True if a point on a surface with this normal is inside, moved by (-e, e^2, e^3).
#[inline]
pub(super) fn leads_in(outwards: [f64; 3]) -> bool {
    let size = outwards.iter().fold(0.0, |most: f64, c| most.max(c.abs()));
    let moved = [-outwards[0], outwards[1], outwards[2]];
    moved.into_iter().find(|c| c.abs() > ROUNDING * size).is_some_and(|along| along < 0.0)
}

impl Leaf {
    /// Cover of a box.
    pub(super) fn cover(&self, region: &VoxelBox) -> Cover {
        match self {
            Self::Nothing => Cover::Outside,
            Self::Ball(ball) => ball.cover(&middles(region)),
            Self::Block(block) => block.cover(&middles(region)),
            Self::Half(half) => half.cover(&middles(region)),
            Self::Curved(curved) => curved.cover(&middles(region)),
            Self::Body(body) => body.cover(region),
            Self::Sampled(_) => Cover::Mixed,
        }
    }

    /// Bits of 64 voxels of every row; not of leaves that are sampled.
    pub(super) fn fill(&self, at: Rows, out: &mut [u64], crossings: &mut Crossings) {
        match self {
            Self::Nothing | Self::Sampled(_) => out.fill(0),
            Self::Ball(ball) => ball.fill(at, out),
            Self::Block(block) => block.fill(at, out),
            Self::Half(half) => half.fill(at, out),
            Self::Curved(curved) => curved.fill(at, out),
            Self::Body(body) => body.fill(at, out, crossings),
        }
    }

    /// True for a voxel inside. Not asked of sampled leaves.
    pub(super) fn contains(&self, voxel: [i32; 3]) -> bool {
        match self {
            Self::Nothing | Self::Sampled(_) => false,
            Self::Ball(ball) => ball.contains(voxel.map(centre)),
            Self::Block(block) => block.contains(voxel.map(centre)),
            Self::Half(half) => half.contains(voxel.map(centre)),
            Self::Curved(curved) => curved.contains(voxel.map(centre)),
            Self::Body(body) => body.contains(voxel),
        }
    }

    /// The surface between two neighbours, one of them inside; `None` where it is not found.
    pub(super) fn face(&self, voxel: [i32; 3], beside: [i32; 3], is_inside: bool) -> Option<Face> {
        match self {
            Self::Nothing | Self::Sampled(_) => None,
            Self::Ball(ball) => Some(ball.face(voxel)),
            Self::Block(block) => Some(block.face(voxel, beside, is_inside)),
            Self::Half(half) => Some(half.face(voxel)),
            Self::Curved(curved) => Some(curved.face(voxel.map(centre), beside.map(centre), is_inside)),
            Self::Body(body) => body.face(voxel, beside, is_inside),
        }
    }

    /// True if its surface next to a voxel is the same for all neighbours.
    pub(super) fn has_one_face(&self) -> bool {
        matches!(self, Self::Ball(_) | Self::Half(_) | Self::Sampled(_))
    }

    /// Memory that it holds outside itself.
    pub(super) fn bytes(&self) -> u64 {
        let bytes = match self {
            Self::Nothing | Self::Ball(_) | Self::Sampled(_) => 0,
            Self::Block(_) => boxed::<Block>(),
            Self::Half(_) => boxed::<Half>(),
            Self::Curved(_) => boxed::<Curved>(),
            Self::Body(body) => boxed::<Body>() + body.held_bytes(),
        };
        bytes as u64
    }
}
