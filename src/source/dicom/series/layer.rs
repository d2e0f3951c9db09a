//! Slices of a volume, and the images that they come from.

use crate::geom::Affine;
use crate::volume::Note;

/// Images in order, with their place in the patient.
#[derive(Debug)]
pub(crate) struct Stack {
    /// The slices of the volume, by increasing position.
    pub(crate) layers: Vec<Layer>,
    pub(crate) affine: Affine,
    pub(crate) notes: Vec<Note>,
}

/// A slice of the volume; numbers are indices into the group's slices.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Layer {
    /// An image.
    Image(usize),
    /// A tile of an image.
    Tile(usize, u32),
    /// An empty slice that a segmentation leaves out.
    Empty,
    /// A missing slice: part of the way from the first image to the second.
    Between(usize, usize, f64),
}
