//! One DICOM file, element by element, in bounded memory.
//!
//! | file | what it does |
//! |---|---|
//! | `window` | a small read window over a file; nothing is allocated by a declared length |
//! | `deflated` | a deflated file seen as if it were not |
//! | `value` | values by their representation |
//! | `element` | one element after another, and steps over sequences |
//! | `scan` | walks the elements of one file and keeps the few that matter |
//! | `header` | those few, parsed: [`header::DicomHeader`] |
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
