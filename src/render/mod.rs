//! Pictures: camera, the one traversal kernel, shading, image files.

mod error;
pub mod ray;
pub mod reference;
pub mod selfcheck;
pub mod traverse;

pub use error::RenderError;
