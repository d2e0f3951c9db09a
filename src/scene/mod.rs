//! Scenes: several placed models with lights, reflection and refraction.
//!
//! ```text
//! scene.toml --> Description --> Part (model, place, material, cut) --+--> World: the nearest of all --> Stage: light --> Image
//!                            '--> Look (camera, lights, background) --'
//! ```
//!
//! | file | what it holds |
//! |---|---|
//! | `describe`, `read`, `checked`, `spec` | the text, parsed and checked |
//! | `fault` | errors in the text |
//! | `body` | a placed model, and where a line intersects it |
//! | `world` | all bodies together |
//! | `shade` | light, shadow, mirrors, glass |
//! | `paint` | pixels |
//! | `section` | slices |
//! | `walls` | the parts of a line within each label |
//! | `rays` | ray counts |
//! | `place`, `material`, `light`, `clip`, `labels` | the elements of a scene |
#![doc = "\n"]
#![doc = include_str!("SCENES.md")]

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
mod rays;
mod read;
mod section;
mod shade;
mod spec;
#[cfg(test)]
mod tests;
mod walls;
mod world;

pub use body::Part;
pub use clip::{Clip, CutPlane};
pub use fault::SceneError;
pub(crate) use fault::{Key, SceneFault, Table};
pub use labels::{LabelPick, LabelRule, Opacity};
pub use light::{Ambient, Light, LightKind};
pub use material::{Coloring, Colors, Material};
pub use paint::{Look, Painted, Seen, paint};
pub use place::Placement;
pub use rays::Rays;
pub use read::MAX_BYTES;
pub(crate) use read::read;
pub use section::{Section, slice};
pub use spec::{Place, Scene, SceneCamera, SceneModel};
