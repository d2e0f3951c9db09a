//! What may be wanted besides, or instead: said once, after the work is done.

use std::fmt;

use crate::clean::Preset;
use crate::text::Short;
use crate::text::names::{PRESET, SURFACE};

/// Something to know of a model that was built as asked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Hint {
    /// A CT was built by a threshold that was not chosen.
    Bone {
        /// Otsu's threshold, in HU.
        chosen: f64,
    },
    /// Voxels are several times as long along one axis as along another.
    Uneven {
        /// Distance of neighbours.
        spacing_mm: [f64; 3],
        /// The axis of the longest.
        axis: usize,
        /// How many times the shortest.
        times: f64,
    },
}

impl fmt::Display for Hint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Bone { chosen } => write!(
                f,
                "Otsu's method found {} HU for this CT; for bone, `{PRESET} {}` takes 226 HU and more",
                Short(*chosen),
                Preset::Bone.name()
            ),
            Self::Uneven { spacing_mm, axis, times } => {
                let [x, y, z] = spacing_mm.map(Short);
                write!(
                    f,
                    "voxels of {x} x {y} x {z} mm are {} times longer along {} than along their shortest side: surfaces across it look like stairs; `{SURFACE} cells` makes them smooth",
                    Short((times * 10.0).round() / 10.0),
                    ["x", "y", "z"].get(*axis).unwrap_or(&"z")
                )
            }
        }
    }
}
