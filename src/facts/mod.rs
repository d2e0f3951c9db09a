//! Notes and refusals of readers, as values with their fields.
//!
//! Each has its sentence with it; no code reads a sentence.
//!
//! | part | what it holds |
//! |---|---|
//! | [`Note`] | what was guessed, left out, replaced or odd |
//! | [`SourceError`] | why a volume cannot be used: which file, and a [`Fault`] of it or a [`Misuse`] by the caller |
//! | [`NotVolume`], [`Choice`] | why files are left out, and which of several volumes is taken |
//! | [`SystemError`] | what the operating system said |
//! | [`dicom`] | what is odd or wrong about DICOM |
//! | [`header`], [`nrrd`], [`metaimage`], [`nifti`], [`npy`], [`tiff`], [`png`] | the faults of each format |
//! | [`MeshFault`], [`MeshFacts`], [`MeshNote`] | what is wrong with a mesh, what was found and chosen, what it lacks |
//! | [`CsgFault`], [`CsgFacts`] | the same of a tree of solids |
//! | [`samples`] | faults of samples in files, with a header and without |
//! | [`numbered`] | slices numbered by the names of their files |
//! | [`sidecar`] | faults of side-cars |
//! | [`Fault`] | why a text describes no synthetic volume |

mod csg;
pub(crate) mod dicom;
mod error;
mod found;
mod left_out;
mod mesh;
mod note;
pub(crate) mod numbered;
pub(crate) mod samples;
pub(crate) mod sidecar;
mod stated;
mod system;

pub use csg::CsgFacts;
pub(crate) use dicom::DicomNote;
pub(crate) use error::OtherVolume;
pub use error::SourceError;
pub(crate) use error::SourceFault;
pub(crate) use found::{Candidate, Choice, Refusal};
pub(crate) use left_out::{Known, NotVolume};
pub use mesh::{Boundary, Fill, MeshFacts, MeshNote};
pub(crate) use note::Note;
pub use note::sentences;
pub(crate) use stated::{Carrier, Form, Packing, StatedBy, StatedNumber};
pub(crate) use system::SystemError;
