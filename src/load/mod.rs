//! A finished `.oct` mapped into memory, checked, and offered as a read-only view.

mod error;
mod memory;
mod view;

pub use error::LoadError;
pub use memory::MemoryTree;
pub use view::NodeView;
