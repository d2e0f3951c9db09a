//! Windows.

mod files;
mod machine;
mod memory;

pub(crate) use super::portable::*;
pub(crate) use files::*;
pub(crate) use machine::*;
pub use memory::*;
