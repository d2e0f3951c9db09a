//! Integer boxes and their numbers, Morton codes and affine transforms; independent of files and voxel values.
//!
//! Axes: a voxel index is `(x, y, z)` with x fastest in memory; the affine takes an index (voxel
//! *centres* at integer indices) to millimetres in DICOM's patient system, LPS: +x to the patient's
//! left, +y to the back, +z to the head.

mod affine;
pub(crate) mod angle;
mod dims;
pub mod morton;
mod number;
mod vector;

pub use affine::{Affine, Orientation};
pub use dims::Dims;
pub use number::{BoxIndex, Level, NodeIndex, Octant, VoxelIndex};
pub(crate) use vector::{Nearest, add_scaled, cross, dot, nearest_on_triangle};
