//! What the commands do: one function each, from plain options to a report.
#![doc = "\n"]
#![doc = include_str!("COMMANDS.md")]
#![doc = "\n"]
#![doc = include_str!("JSON.md")]

pub mod batch;
pub mod build;
pub mod csg;
pub mod demo;
pub mod export;
pub mod info;
pub mod intersect;
pub mod measure;
pub mod mesh;
pub mod opened;
pub mod pack;
pub mod picture;
mod relief;
pub mod render;
pub mod report;
pub mod scan;
pub mod scene;
pub mod shots;
pub mod verify;
mod within;
pub mod wording;

pub use crate::resident::{give_back, map_large_buffers};
pub use wording::foreign::shown;
