//! Looks of triangles, and materials.

use std::sync::Arc;

use crate::platform::PositionalFile;

/// Marks a triangle without a material.
pub(in crate::mesh) const NO_MATERIAL: u32 = u32::MAX;

/// The look of a triangle: each part for its three corners in turn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::mesh) struct Appearance {
    /// Red, green and blue in linear light, 0 to 1.
    pub(in crate::mesh) colors: Option<[[f32; 3]; 3]>,
    /// Place in the texture of its material, 1 for its whole width and height.
    pub(in crate::mesh) places: Option<[[f32; 2]; 3]>,
    /// Directions, of any length.
    pub(in crate::mesh) normals: Option<[[f32; 3]; 3]>,
    /// Number in the file's materials, or [`NO_MATERIAL`].
    pub(in crate::mesh) material: u32,
    /// Number of its part in the file.
    pub(in crate::mesh) part: u32,
}

impl Appearance {
    /// The look for corners that begin with another one: the second, where `by` is 1, or the third.
    pub(in crate::mesh) fn rotated(mut self, by: usize) -> Self {
        if let Some(colors) = &mut self.colors {
            colors.rotate_left(by % 3);
        }
        if let Some(places) = &mut self.places {
            places.rotate_left(by % 3);
        }
        if let Some(normals) = &mut self.normals {
            normals.rotate_left(by % 3);
        }
        self
    }

    pub(in crate::mesh) const NONE: Self =
        Self { colors: None, places: None, normals: None, material: NO_MATERIAL, part: 0 };
}

/// The look of a surface: a colour, times a texture's.
#[derive(Clone, Debug)]
pub(in crate::mesh) struct Material {
    /// Colour in linear light.
    pub(in crate::mesh) color: [f32; 3],
    pub(in crate::mesh) texture: Option<Texture>,
}

/// An image laid on a surface.
#[derive(Clone, Debug)]
pub(in crate::mesh) struct Texture {
    pub(in crate::mesh) image: Arc<Image>,
    /// Continuation along its width and its height.
    pub(in crate::mesh) wraps: [Wrap; 2],
    /// True if the second coordinate runs up the image, false if down.
    pub(in crate::mesh) upwards: bool,
    /// Two rows of the affine from a place in the file to one in the image.
    pub(in crate::mesh) placed: [[f32; 3]; 2],
}

/// The placement that changes nothing.
pub(in crate::mesh) const UNPLACED: [[f32; 3]; 2] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];

/// Bytes of an image file, somewhere in a file.
#[derive(Debug)]
pub(in crate::mesh) struct Image {
    /// Name in messages.
    pub(in crate::mesh) name: String,
    pub(in crate::mesh) file: Arc<PositionalFile>,
    pub(in crate::mesh) offset: u64,
    pub(in crate::mesh) bytes: u64,
}

/// Continuation of an image beyond its edges.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::mesh) enum Wrap {
    Repeat,
    Mirror,
    Clamp,
}

/// Linear light of a stored part of a colour, 0 to 1 (IEC 61966-2-1).
pub(in crate::mesh) fn linear(stored: f32) -> f32 {
    if stored <= 0.040_45 { stored / 12.92 } else { ((stored + 0.055) / 1.055).powf(2.4) }
}
