//! Pictures: camera, the one traversal kernel, shading, image files.

mod error;

pub use error::RenderError;
