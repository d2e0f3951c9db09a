//! macOS. Compiled, and never run.

mod machine;
mod memory;

pub(crate) use super::portable::*;
pub(crate) use super::unix::*;
pub(crate) use machine::*;
pub use memory::*;
