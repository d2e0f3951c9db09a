//! A finished `.oct` mapped into memory, checked, and offered as a read-only view.

mod error;
mod view;

pub use error::LoadError;
pub use view::NodeView;
