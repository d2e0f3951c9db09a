//! The displayed normal where a ray hit a box.
//!
//! | module | its part of the decision |
//! |---|---|
//! | `shading_normal` | the hit of a pixel, and its normal by all that follows |
//! | `repair` | stored normals that the skin around contradicts give way to a plane fitted to that skin |
//! | `many` | the normals of a tile's pixels together |
//! | `neighborhood` | the 5 x 5 x 5 boxes around a hit, from kept bricks |
//! | `smooth` | normals of cells: a mean over those around a hit that belong to the same surface |
//! | `blend` | normals of voxels blended between the boxes around a hit, where that is asked for |
//! | `larger` | the same between larger leaves |

pub(crate) mod blend;
mod larger;
pub(crate) mod many;
pub(crate) mod neighborhood;
pub(super) mod repair;
pub(crate) mod shading_normal;
mod smooth;
