//! Linux.

mod files;
mod machine;
mod memory;
mod resident;

pub(crate) use super::unix::*;
pub(crate) use files::*;
pub(crate) use machine::*;
pub use memory::*;
pub(crate) use resident::{HELD_SPREAD, MAPPED_FROM, THREAD_BYTES, part_mapping};
pub use resident::{give_back, map_large_buffers};
