//! Pictures: one model, or several in their places, with lights, reflection and refraction.
//!
//! ```text
//! scene.toml --> Description --> Part (model, place, material, cut) --+--> Painter: rays fill a Band, shading reads it --> Image
//!                            '--> Look (camera, lights, background) --'
//! ```
//!
//! A model by itself is a scene with one body; there is one painter.
//!
//! | file | what it holds |
//! |---|---|
//! | `describe`, `read`, `checked`, `spec` | the text, parsed and checked |
//! | `fault` | errors in the text |
//! | `body` | a placed model, and where a line intersects it |
//! | `world` | all bodies together |
//! | `shade` | light, shadow, mirrors, glass |
//! | `paint` | rays from the eye, and the parts of a picture |
//! | `band` | the buffer that rays fill and shading reads |
//! | `supersampling` | several rays of a pixel |
//! | `section` | slices |
//! | `walls` | the parts of a line within each label |
//! | `place`, `material`, `light`, `clip`, `labels` | the elements of a scene |
#![doc = "\n"]
#![doc = include_str!("SCENES.md")]

mod band;
mod body;
mod checked;
mod clip;
mod describe;
mod fault;
mod labels;
mod light;
mod material;
mod media;
mod paint;
mod place;
mod read;
mod section;
mod shade;
mod spec;
mod supersampling;
#[cfg(test)]
mod tests;
mod walls;
mod world;

pub use body::Instance;
pub use clip::{Clip, CutPlane};
pub use fault::SceneError;
pub(crate) use fault::{Key, Table};
pub(crate) use labels::parts as label_parts;
pub use labels::{LabelPick, LabelRule, Opacity};
pub use light::{Ambient, Light, LightKind};
pub use material::{Coloring, Colors, Material};
pub use paint::{Counts, Painted, PictureSettings, Seen, paint};
pub(crate) use paint::{Watch, paint_bytes, paint_parts};
pub use place::Placement;
pub use read::MAX_BYTES;
pub(crate) use read::{flat, read};
pub use section::Section;
pub use spec::{Scene, SceneCamera, SceneModel, StatedPlacement};
