//! What the commands do: one function each, from plain options to a report.

pub mod build;
pub mod demo;
pub mod info;
pub mod pack;
pub mod picture;
pub mod render;
pub mod verify;
