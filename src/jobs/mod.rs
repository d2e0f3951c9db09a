//! The commands: one function each, from plain options to a report.
#![doc = "\n"]
#![doc = include_str!("COMMANDS.md")]
#![doc = "\n"]
#![doc = include_str!("../../docs/JSON.md")]

pub mod batch;
pub mod build;
mod cell_volume;
pub mod compare;
#[doc(hidden)]
pub mod demo;
pub mod export;
mod frame;
mod hint;
pub mod info;
pub mod intersect;
mod labels;
#[doc(hidden)]
pub mod measure;
pub mod names;
pub(crate) mod nearest;
#[doc(hidden)]
pub mod open_model;
pub mod pack;
pub mod parts;
mod pass;
pub mod picture;
mod picture_memory;
#[doc(hidden)]
pub mod picture_set;
pub mod pores;
pub mod render;
#[doc(hidden)]
pub mod report;
pub mod scan;
pub mod scene;
mod schema;
pub mod thickness;
pub mod verify;
pub mod view;

pub use crate::platform::{give_back, map_large_buffers};
