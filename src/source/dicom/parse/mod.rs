//! One DICOM file, element by element, in bounded memory.
//!
//! | file | content |
//! |---|---|
//! | `window` | a small read window over a file; no declared length is allocated |
//! | `deflated` | view of a deflated file as a plain one |
//! | `value` | values by their representation |
//! | `element` | one element after another, and steps over sequences |
//! | `scan` | walk over the elements of one file, keeping the few that matter |
//! | `header` | the kept elements, parsed: [`header::DicomHeader`] |
//! | `private` | the private ones among them |
//! | `syntax` | transfer syntaxes by name |
//! | `frames` | position and meaning of every frame of a file: [`frames::visit`] |
//! | `segments` | the segments of a segmentation |
//! | `csa` | the private header of Siemens MR images |

pub(super) mod csa;
pub(super) mod deflated;
pub(super) mod element;
pub(super) mod error;
pub(super) mod frames;
pub(super) mod header;
pub(super) mod private;
pub(super) mod scan;
pub(super) mod segments;
pub(super) mod syntax;
pub(super) mod value;
pub(super) mod window;

/// Result of reading elements.
pub(super) type Result<T = (), E = crate::source::dicom::parse::error::ScanError> = std::result::Result<T, E>;
