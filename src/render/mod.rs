//! Pictures: camera, the one traversal kernel, shading, image files.
//!
//! ```text
//! Camera --world ray--> GridSpace --Ray (integers)--> traverse --Hit--> shade --> Image --> PNG
//! ```
//!
//! | module | what it owns |
//! |---|---|
//! | [`ray`] | quantised rays: the only place where a ray is rounded |
//! | [`traverse`] | the one traversal, over any [`crate::load::NodeView`] |
//! | [`reference`](mod@reference), [`selfcheck`] | slow exact answers, and their comparison with the traversal |
//! | [`space`] | world and grid; extents of a model |
//! | [`camera`] | named views and free cameras |
//! | [`shade`], [`picture`], [`image`] | colours, pixels, files |

pub mod camera;
mod error;
pub mod image;
pub mod picture;
pub mod ray;
pub mod reference;
pub mod selfcheck;
pub mod shade;
pub mod space;
pub mod traverse;

pub use camera::{Camera, NamedView, Projection, ViewPoint};
pub use error::{CameraFault, Layer, RenderError};
pub use image::Image;
pub use space::GridSpace;
