//! The pixels of one file.
//!
//! | file | content |
//! |---|---|
//! | `pixels` | values in the cells of a frame: [`pixels::PixelLayout`] |
//! | `describe` | the image of a file, and access to its pixels: [`describe::Image`] |
//! | `encapsulated` | the fragments of each frame |
//! | `lut` | modality tables and palettes |
//! | `convert` | conversion of rows into delivered samples |
//! | `unroll` | decoding of frames row by row: [`unroll`](fn@unroll::unroll) |

pub(super) mod convert;
pub(super) mod describe;
pub(super) mod encapsulated;
pub(super) mod lut;
pub(super) mod pixels;
pub(super) mod unroll;
