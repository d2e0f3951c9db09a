//! What the commands do: one function each, from plain options to a report.

pub mod info;
pub mod pack;
pub mod render;
pub mod verify;
