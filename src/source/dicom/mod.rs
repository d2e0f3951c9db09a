//! DICOM series as volumes: a bounded header scanner, series assembly, native pixels by position.
//!
//! | file | what it does |
//! |---|---|
//! | `window` | a small read window over a file; nothing is allocated by a declared length |
//! | `scan` | walks the elements of one file and keeps the few that matter |
//! | `header` | those few, parsed: [`DicomHeader`] |
//! | `syntax` | transfer syntaxes by name |
//! | `pixels` | how stored values lie in the file, or why they cannot be read: [`PixelLayout`] |
//! | `survey` | finds the images of a folder by content and groups them |
//! | `series` | orders a group by position and judges its gaps |
//! | `volume` | [`DicomVolume`], the source itself |
//!
//! Read so far: classic images, one frame a file, uncompressed. What else is found is named, not
//! guessed at. The standard is cited as PS3.x.

mod header;
mod pixels;
mod scan;
mod series;
mod survey;
mod syntax;
mod volume;
mod window;

pub use header::{DicomHeader, PixelData, PixelElement};
pub use pixels::{Obstacle, PixelLayout};
pub use scan::{ScanError, scan};
pub use syntax::TransferSyntax;
pub use volume::DicomVolume;
pub use window::ReadAt;
