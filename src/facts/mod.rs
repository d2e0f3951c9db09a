//! What readers find, assume and refuse, as values with their fields.
//!
//! Sentences are made of them in [`crate::jobs::wording`], and nowhere else.
//!
//! | part | what it holds |
//! |---|---|
//! | [`Note`] | what was guessed, left out, replaced or odd |
//! | [`DicomNote`] | the same of DICOM series |
//! | [`SourceError`] | why a volume cannot be used |
//! | [`SystemError`] | what the operating system said |
//! | [`codec`] | why compressed frames cannot be decoded |
//! | [`dicom`] | what is wrong with DICOM, and what has to be said of it |

pub mod codec;
pub mod dicom;
mod error;
mod note;
mod system;

pub use dicom::DicomNote;
pub use error::SourceError;
pub use note::{Carrier, Form, Note, Packing, StatedBy};
pub use system::SystemError;
