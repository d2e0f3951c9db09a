//! What readers find, assume and refuse, as values with their fields.
//!
//! | part | what it holds |
//! |---|---|
//! | [`SourceError`] | why a volume cannot be used |

mod error;

pub use error::SourceError;
