//! Notes and refusals of readers, as values with their fields.
//!
//! Each has its sentence beside it; no code reads a sentence.
//!
//! | part | what it holds |
//! |---|---|
//! | [`Note`] | what was guessed, left out, replaced or odd |
//! | [`SourceError`] | why a volume cannot be used: which file, and a [`Fault`] of it or a [`Misuse`] by the caller |
//! | [`NotVolume`], [`Choice`] | why files are left out, and which of several volumes is taken |
//! | [`SystemError`] | what the operating system said |
//! | [`dicom`] | what is odd or wrong about DICOM |
//! | [`codec`] | why compressed frames cannot be decoded |
//! | [`header`], [`nrrd`], [`metaimage`], [`nifti`], [`npy`], [`tiff`], [`png`] | the faults of each format |
//! | [`MeshFault`], [`MeshFacts`], [`MeshNote`] | what is wrong with a mesh, what was found and chosen, what it lacks |
//! | [`CsgFault`], [`CsgFacts`] | the same of a tree of solids |
//! | [`samples`] | faults of samples in files, with a header and without |
//! | [`numbered`] | slices numbered by the names of their files |
//! | [`sidecar`] | faults of side-cars |
//! | [`SyntheticFault`] | why a text describes no synthetic volume |

#![expect(missing_docs, reason = "the sentence of each variant says it")]

pub mod codec;
mod csg;
pub mod dicom;
mod error;
mod found;
pub mod header;
mod left_out;
mod mesh;
pub mod metaimage;
pub mod nifti;
mod note;
pub mod npy;
pub mod nrrd;
pub mod numbered;
pub mod png;
mod raw;
pub mod samples;
pub mod sidecar;
mod stated;
mod synthetic;
mod system;
pub mod tiff;

pub use csg::{CsgFacts, CsgFault, CsgToken, OffsetFault, SurplusArgument};
pub use dicom::DicomNote;
pub use error::{Fault, Instead, Misuse, OtherVolume, SourceError};
pub use found::{Candidate, Choice, Refusal};
pub use left_out::{Known, NotVolume};
pub use mesh::{Boundary, Feature, Fill, ImageFault, MeshFacts, MeshFault, MeshNote, Part};
pub use note::{Note, sentences};
pub use stated::{Carrier, Form, Packing, StatedBy, StatedNumber};
pub use synthetic::{SyntheticFault, SyntheticValue};
pub use system::SystemError;
