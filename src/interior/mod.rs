//! The inside of a skin: a model holds the skin only, and the deep inside follows from it.
//!
//! A voxel that is neither skin nor reached from outside by steps through faces is enclosed: either deep inside, or in a
//! cavity. The normals of the skin around it tell which, as they point out of the object.
//!
//! ```text
//!   octree --four slices at a time--> skin of a slice, in rows --> runs between skin voxels --> components
//! ```
//!
//! | part | content |
//! |---|---|
//! | [`skin`] | the skin of a model, slice by slice |
//! | [`rows`] | items of a slice, row by row |
//! | [`sweep`] | components outside the skin, followed from slice to slice |
//!
//! "Voxel" means a box of the finest level, either a voxel or a cell.

mod rows;
mod skin;
mod sweep;

pub(crate) use rows::Rows;
pub(crate) use skin::{LeafCell, SkinSlices, SkinVoxel, extent};
pub(crate) use sweep::{ComponentSides, Sweep};

use crate::format::normal;

/// Voxels that the skin encloses.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Enclosed {
    /// Voxels inside the object.
    pub inside: u64,
    /// Voxels in cavities.
    pub cavities: u64,
    /// Undecided voxels: the normals around contradict each other or are missing.
    pub unknown: u64,
}

/// Side of a part of the grid that is not skin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Side {
    Outside,
    Inside,
}

/// Normals as components along the axes of the grid.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Outward {
    scale: [f64; 3],
}

impl Outward {
    /// Scales normals of cells, which are of index space, or of voxels, which are of millimetres along the volume's
    /// axes.
    pub(crate) fn new(cells: bool, spacing_mm: [f64; 3]) -> Self {
        Self { scale: if cells { [1.0; 3] } else { spacing_mm } }
    }

    /// The normal of a code in voxels, scaled to a sum of absolute components of 1; zeros for none.
    pub(crate) fn of(&self, code: u16) -> [f64; 3] {
        let n = normal::decode_l1(code).map(f64::from);
        let n: [f64; 3] = std::array::from_fn(|a| n[a] * self.scale[a]);
        let size = n.iter().map(|c| c.abs()).sum::<f64>();
        if size > 0.0 && size.is_finite() { n.map(|c| c / size) } else { [0.0; 3] }
    }
}
