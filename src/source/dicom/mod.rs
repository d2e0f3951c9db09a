//! DICOM series as volumes: a bounded header scanner, series assembly, native pixels by position.
//!
//! | folder | content |
//! |---|---|
//! | `attribute` | attributes that distinguish images |
//! | `parse` | one file, element by element: [`scan`](fn@scan), [`DicomHeader`], [`visit`] |
//! | `image` | the pixels of one file: [`Image`], [`PixelLayout`], [`unroll`](fn@unroll) |
//! | `series` | the images of one series, and their volumes: `DicomVolume` |
//!
//! Each sees those before it. Content that is found and cannot be read is named, not guessed at. The standard is cited
//! as PS3.x.

mod attribute;
mod image;
mod parse;
mod series;

pub use image::describe::{Access, Image, Obstacle};
pub use image::pixels::{Padding, PaddingAttributes, PixelLayout};
pub use image::unroll::{FrameSink, unroll};
pub use parse::error::ScanError;
pub use parse::frames::{FrameGeometry, Origin, visit};
pub(crate) use parse::header::SEGMENTATION;
pub use parse::header::{DicomHeader, ElementOffsets, Encoding, PixelData, PixelElement};
pub use parse::private::Private;
pub use parse::scan::scan;
pub use parse::syntax::TransferSyntax;
pub use parse::window::ReadAt;
pub(crate) use series::findings::open_series;
pub(crate) use series::survey::{Recognition, recognise};
