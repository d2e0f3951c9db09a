//! Pictures: camera, traversal, shading, image files.
//!
//! ```text
//! Camera + GridSpace --> Sight --rays (integers)--> tile, single, batch --Hit--> scene: Painter --> Image --> PNG
//! ```
//!
//! | module | what it owns |
//! |---|---|
//! | `line` | the line of a ray against the boxes of a brick: the one test of all traversals |
//! | [`ray`] | quantised rays: the only place where a ray is rounded |
//! | [`traverse`] | what a first hit is, and the oracle: the plain walk over any [`crate::load::NodeView`] |
//! | [`tile`] | the traversal of pictures: 8 x 8 rays together |
//! | [`single`] | the same for one ray alone |
//! | [`batch`] | the same for many rays without neighbours, eight in flight: secondary rays |
//! | [`surface`] | the last decision: is this box a hit |
//! | [`cells`] | the surface within a cell: `meet` decides, `predict` and `look` are its short cuts |
//! | [`discrete`] | the paper's own traversal |
//! | `pairs`, `pairs_vbmi2` | rays of a tile and the planes of a brick, sixteen pairs at a time |
//! | `occupancy`, `mirrored_ray` | two levels of the octree at once; whether a ray passes through a box, exactly |
//! | [`pixel_rays`] | the rays of a picture: one, eight in a row, or as affine functions of the pixel |
//! | [`reference`](mod@reference), [`selfcheck`] | slow exact answers, and their comparison with the traversal |
//! | [`space`] | world and grid; extents of a model |
//! | [`camera`] | named views and free cameras |
//! | `ray_offset` | rays that start at a surface, beyond the box that was hit |
//! | `ambient` | ambient occlusion, which darkens hollows |
//! | `normals` | the normal that is shown at a hit |
//! | `choices` | options for light, normals and samples |
//! | [`shade`], [`picture`], [`image`] | light; sizes, threads and codes of pictures; files. The painter is [`crate::scene`] |
//! | `ambient_filter` | openness as a mean over pixels, and where neighbours differ |
//! | `colors` | the colour of what was hit, where the model has colours |
//! | `annotate`, `font` | a scale bar, the patient's sides or the axes, letters |
//!
#![doc = include_str!("TRAVERSAL.md")]

/// Adds fields of `other` to the same fields of `$sum`.
macro_rules! add_counts {
    ($sum:ident, $other:ident: $($field:ident),+) => {{
        $($sum.$field += $other.$field;)+
    }};
}
pub(crate) use add_counts;

/// An array of an expression of 0, 1 and 2: axes, or pairs of axes. A macro, since a closure over vectors is inlined
/// too late, if at all, and then calls a function for every instruction.
macro_rules! each3 {
    ($i:ident => $e:expr) => {
        [
            {
                const $i: usize = 0;
                $e
            },
            {
                const $i: usize = 1;
                $e
            },
            {
                const $i: usize = 2;
                $e
            },
        ]
    };
}

pub(crate) mod ambient;
pub(crate) mod ambient_filter;
pub(crate) mod annotate;
pub mod batch;
pub mod camera;
mod caster;
#[doc(hidden)]
pub mod cells;
pub(crate) mod choices;
pub(crate) mod colors;
#[doc(hidden)]
pub mod discrete;
mod error;
mod font;
pub mod image;
mod leaves;
mod line;
mod mirrored_ray;
pub(crate) mod normals;
mod occupancy;
mod pairs;
#[cfg(target_arch = "x86_64")]
mod pairs_vbmi2;
pub mod picture;
#[doc(hidden)]
pub mod pixel_rays;
pub mod ray;
pub(crate) mod ray_offset;
#[doc(hidden)]
pub mod reference;
#[doc(hidden)]
pub mod selfcheck;
pub mod shade;
#[doc(hidden)]
pub mod single;
pub mod space;
#[doc(hidden)]
pub mod surface;
#[doc(hidden)]
pub mod tile;
#[doc(hidden)]
pub mod traverse;
pub(crate) mod walls;

pub use camera::{Camera, NamedView, Projection, ViewPoint};
pub use caster::{Hits, RayCaster, SurfacePoint};
pub use choices::{Samples, Shading, Smoothing};
pub use error::RenderError;
pub(crate) use error::RenderFault;
pub use image::Image;
pub use space::GridSpace;
#[cfg(feature = "python")]
pub(crate) use tile::Layout;
