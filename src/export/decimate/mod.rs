//! Fewer triangles: to a number, or within a distance that is measured.
//!
//! ```text
//!   layers --> a slab in memory --fewer triangles (whole)--> slabs --once more (whole)--> repaired (sheets) --> file
//! ```
//!
//! A surface of up to eight million triangles is reduced as a whole. Of a larger one slabs of whole layers, whose
//! borders stay, are reduced within a part of the distance, and then all of them once more.

mod sheets;
mod tree;
mod whole;

pub(super) use sheets::Surface;
pub(super) use whole::{Goal, Whole, reduce};

/// A number of corners, of triangles or of nodes; `u32::MAX` beyond that.
fn number(count: usize) -> u32 {
    u32::try_from(count).unwrap_or(u32::MAX)
}
