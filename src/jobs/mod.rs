//! The commands: one function each, from plain options to a report.
#![doc = "\n"]
#![doc = include_str!("COMMANDS.md")]
#![doc = "\n"]
#![doc = include_str!("../../docs/JSON.md")]

pub mod batch;
pub mod build;
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
pub mod opened;
pub mod pack;
pub mod parts;
mod pass;
pub mod picture;
pub mod pores;
mod relief;
pub mod render;
#[doc(hidden)]
pub mod report;
pub mod scan;
pub mod scene;
mod schema;
#[doc(hidden)]
pub mod shots;
pub mod thickness;
pub mod verify;
pub mod view;
mod within;

pub use crate::platform::{give_back, map_large_buffers};
