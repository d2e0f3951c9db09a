//! DICOM series as volumes: a bounded header scanner, series assembly, native pixels by position.
//!
//! | file | what it does |
//! |---|---|
//! | `window` | a small read window over a file; nothing is allocated by a declared length |
//! | `element` | one element after another, and steps over sequences |
//! | `scan` | walks the elements of one file and keeps the few that matter |
//! | `deflated` | a deflated file seen as if it were not |
//! | `header` | those few, parsed: [`DicomHeader`] |
//! | `syntax` | transfer syntaxes by name |
//! | `pixels` | how stored values are cut out of cells: [`PixelLayout`] |
//! | `image` | what the pixels of a file are, and how they are reached: [`Image`] |
//! | `csa` | the private header of Siemens MR images |
//! | `mosaic` | slices tiled into one picture |
//! | `frames` | position and meaning of every frame of a file: [`visit`] |
//! | `encapsulated` | which fragments make which frame |
//! | `lut` | modality tables and palettes |
//! | `convert` | rows of cells, or of decoded samples, into delivered ones |
//! | `unroll` | decodes frames row by row: [`unroll`](fn@unroll) |
//! | `survey` | tells images from other files, and loads the images of one series |
//! | `group` | groups them by what must be equal, drops copies |
//! | `split` | tells images that repeat positions apart: echoes, phases, ... |
//! | `series` | orders a group by position, judges and fills its gaps |
//! | `gaps` | uneven and missing slices |
//! | `findings` | the volumes of a series, named without patient data |
//! | `volume` | [`DicomVolume`], the source itself |
//!
//! What is found and cannot be read is named, not guessed at. The standard is cited as PS3.x.

mod convert;
mod csa;
mod deflated;
mod element;
mod encapsulated;
mod findings;
mod frames;
mod gaps;
mod group;
mod header;
mod image;
mod lut;
mod mosaic;
mod pixels;
mod scan;
mod series;
mod split;
mod survey;
mod syntax;
mod unroll;
mod volume;
mod window;

pub(crate) use findings::open_series;
pub use frames::{FrameGeometry, Origin, visit};
pub use header::{DicomHeader, Encoding, PixelData, PixelElement, Places};
pub use image::{Access, Image, Obstacle};
pub use mosaic::Private;
pub use pixels::{Padding, PixelLayout, StatedPadding};
pub use scan::{ScanError, scan};
pub(crate) use survey::{Recognised, recognise};
pub use syntax::TransferSyntax;
pub use unroll::{FrameSink, unroll};
pub use volume::DicomVolume;
pub use window::ReadAt;
