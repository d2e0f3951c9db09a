//! Files of triangles and points, written as they are made.
//!
//! Where a format wants counts first, or all corners before all triangles, the rest waits in a nameless file.

mod digits;
mod glb;
mod obj;
mod ply;
mod sink;
mod stl;

pub(super) use glb::Glb;
pub(super) use obj::Obj;
pub(super) use ply::Ply;
pub(super) use sink::{Sink, Vertex, unit};
pub(super) use stl::Stl;
