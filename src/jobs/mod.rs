//! What the commands do: one function each, from plain options to a report.
#![doc = "\n"]
#![doc = include_str!("COMMANDS.md")]

pub mod batch;
pub mod build;
pub mod demo;
pub mod info;
pub mod pack;
pub mod picture;
pub mod render;
pub mod scan;
pub mod verify;
pub mod wording;

pub use crate::resident::map_large_buffers;
pub use wording::foreign::shown;
