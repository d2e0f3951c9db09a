//! What is wrong with DICOM files and series, and what has to be said of them.
//!
//! | file | what it holds |
//! |---|---|
//! | `syntax` | transfer syntaxes |
//! | `attribute` | attributes that images are told apart by |
//! | `scan` | why a file cannot be followed: [`ScanError`] |
//! | `image` | why an image cannot be a slice: [`ImageFault`] |
//! | `series` | why images form no volume: [`SeriesFault`] |
//! | `fault` | all of these: [`DicomFault`] |
//! | `note` | what was assumed, dropped or changed: [`DicomNote`] |

mod attribute;
mod fault;
mod image;
mod note;
mod scan;
mod series;
mod syntax;

pub(crate) use attribute::Attribute;
pub(crate) use fault::DicomFault;
pub use image::Obstacle;
pub(crate) use image::{Combination, CsaCount, CsaFault, ImageFault, MosaicFault, Required};
pub(crate) use note::{DicomNote, FilledGaps, Hole, SliceOrder};
pub use scan::ScanError;
pub(crate) use scan::{Damage, DeflateFault, ReadFault};
pub(crate) use series::{ImageName, MissingSlices, SeriesFault, SetApart, UnevenGaps};
pub use syntax::TransferSyntax;
