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

pub use attribute::Attribute;
pub use fault::DicomFault;
pub use image::{Combination, CsaCount, CsaFault, ImageFault, MosaicFault, Obstacle, Required};
pub use note::{DicomNote, FilledGaps, Hole, SliceOrder};
pub use scan::{Damage, DeflateFault, ReadFault, ScanError};
pub use series::{ImageName, MissingSlices, SeriesFault, SetApart, UnevenGaps};
pub use syntax::TransferSyntax;
