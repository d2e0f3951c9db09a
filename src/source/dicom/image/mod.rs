//! The pixels of one file.
//!
//! | file | what it does |
//! |---|---|
//! | `pixels` | how stored values are cut out of cells: [`pixels::PixelLayout`] |
//! | `describe` | what the pixels of a file are, and how they are reached: [`describe::Image`] |
//! | `encapsulated` | which fragments make which frame |
//! | `lut` | modality tables and palettes |
//! | `convert` | rows of cells, or of decoded samples, into delivered ones |
//! | `unroll` | decodes frames row by row: [`unroll`](fn@unroll::unroll) |

pub(super) mod convert;
pub(super) mod describe;
pub(super) mod encapsulated;
pub(super) mod lut;
pub(super) mod pixels;
pub(super) mod unroll;
