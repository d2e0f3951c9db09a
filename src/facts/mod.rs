//! What readers find, assume and refuse, as values with their fields.
//!
//! | part | what it holds |
//! |---|---|
//! | [`SourceError`] | why a volume cannot be used |
//! | [`SystemError`] | what the operating system said |
//! | [`codec`] | why compressed frames cannot be decoded |
//! | [`dicom`] | what is wrong with DICOM, and what has to be said of it |

pub mod codec;
pub mod dicom;
mod error;
mod system;

pub use error::SourceError;
pub use system::SystemError;
