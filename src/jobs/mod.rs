//! What the commands do: one function each, from plain options to a report.

pub mod render;
