//! Suggestions of other options, made once, after the work is done.

use std::fmt;
use std::ops::RangeInclusive;

use crate::clean::Preset;
use crate::text::Short;
use crate::text::names::{KEEP_LARGEST, PRESET, SURFACE, UNIT};

/// A suggestion for a model that was built as asked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Hint {
    /// A CT was built by a threshold that was not chosen.
    Bone {
        /// Otsu's threshold, in HU.
        chosen: f64,
    },
    /// Voxels are several times as long along one axis as along another.
    Uneven {
        /// True for a skin of voxels, false for cells.
        is_skin: bool,
        /// Distance of neighbouring voxels.
        spacing_mm: [f64; 3],
        /// The axis with the longest spacing.
        axis: usize,
        /// Ratio of the longest to the shortest spacing.
        times: f64,
    },
    /// A mesh or a tree is smaller than a millimetre, or larger than a house.
    Size {
        /// The longest side of the grid.
        longest_mm: f64,
    },
}

/// Longest sides of plausible bodies, in millimetres; others suggest a wrong unit.
const LIKELY_MM: RangeInclusive<f64> = 1.0..=1e5;

impl Hint {
    /// The hint for a mesh or a tree on a grid of this size.
    pub(super) fn of_size(dims: [u32; 3], spacing_mm: [f64; 3]) -> Option<Self> {
        let longest_mm =
            dims.iter().zip(spacing_mm).map(|(n, step)| f64::from(*n) * step).fold(0.0, f64::max);
        (!LIKELY_MM.contains(&longest_mm)).then_some(Self::Size { longest_mm })
    }
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
            Self::Uneven { is_skin, spacing_mm, axis, times } => {
                let [x, y, z] = spacing_mm.map(Short);
                write!(
                    f,
                    "voxels of {x} x {y} x {z} mm are {} times longer along {} than along their shortest side: ",
                    Short((times * 10.0).round() / 10.0),
                    ["x", "y", "z"].get(*axis).unwrap_or(&"z")
                )?;
                if *is_skin {
                    return write!(
                        f,
                        "surfaces across it look like stairs; `{SURFACE} cells` makes them smooth"
                    );
                }
                write!(
                    f,
                    "thin walls that slope across it fall into strips, which `{KEEP_LARGEST}` leaves out, and surfaces \
                     are off by tenths of the shortest side; build a series of thinner slices if there is one"
                )
            }
            Self::Size { longest_mm } => write!(
                f,
                "the longest side is {} mm; if that is wrong, say with `{UNIT}` what one unit of the file is",
                Short(*longest_mm)
            ),
        }
    }
}
