//! Lattice of 2^-12 voxel on which solids are placed, and the way to it from millimetres.
//!
//! ```text
//!   model units --affine of the tree--> mm --grid--> voxels --x 4096, rounded once--> whole numbers
//! ```
//!
//! Voxel i spans `[4096 i, 4096 (i + 1))` along each axis, as for meshes.

use crate::csg::fault::{singular, too_far};
use crate::fault::Fault;
use crate::geom::{Affine, Dims};
use crate::mesh::{Bounds, Grid, GridChoice, STEPS};

/// Bound of the coordinates of placed corners and axes.
const LIMIT: f64 = (1 << 29) as f64;

/// The grid of a tree.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct LatticeGrid {
    pub(super) dims: Dims,
    /// Voxel index to mm.
    pub(super) affine: Affine,
    pub(super) spacing_mm: [f64; 3],
    /// Millimetres to lattice steps from the corner of voxel (0, 0, 0).
    pub(super) to_lattice: Affine,
}

impl LatticeGrid {
    /// The grid of a choice around bounds in mm.
    ///
    /// # Errors
    /// The grid would be too large.
    pub(super) fn around(choice: GridChoice, bounds: &Bounds) -> Result<Self, Fault> {
        let Grid { dims, voxel_mm, origin_mm, .. } = Grid::new(choice, bounds, 1.0)?;
        let mut rows = [[0.0; 4]; 3];
        let mut to_lattice = rows;
        for axis in 0..3 {
            rows[axis][axis] = voxel_mm;
            rows[axis][3] = origin_mm[axis] + voxel_mm / 2.0;
            to_lattice[axis][axis] = f64::from(STEPS) / voxel_mm;
            to_lattice[axis][3] = -(origin_mm[axis] / voxel_mm * f64::from(STEPS));
        }
        Ok(Self {
            dims,
            affine: Affine { rows },
            spacing_mm: [voxel_mm; 3],
            to_lattice: Affine { rows: to_lattice },
        })
    }

    /// The grid of a volume: sample i is the middle of voxel i.
    ///
    /// # Errors
    /// The volume's affine has no inverse.
    pub(super) fn of_volume(dims: Dims, affine: Affine, spacing_mm: [f64; 3]) -> Result<Self, Fault> {
        let mut to_lattice = affine.inverse().ok_or(singular(0))?;
        for row in &mut to_lattice.rows {
            row[3] += 0.5;
            row.iter_mut().for_each(|c| *c *= f64::from(STEPS));
        }
        Ok(Self { dims, affine, spacing_mm, to_lattice })
    }
}

/// The nearest whole number; the even one of two.
pub(super) fn whole(at: f64, line: u64) -> Result<i64, Fault> {
    if !(at > -LIMIT && at < LIMIT) {
        return Err(too_far(line));
    }
    #[expect(clippy::cast_possible_truncation, reason = "checked above")]
    let whole = at.round_ties_even() as i64;
    Ok(whole)
}

pub(super) fn point(at: [f64; 3], line: u64) -> Result<[i64; 3], Fault> {
    Ok([whole(at[0], line)?, whole(at[1], line)?, whole(at[2], line)?])
}

/// The middle of a voxel, in lattice steps.
#[inline]
pub(super) fn centre(voxel: i32) -> i64 {
    i64::from(voxel) * i64::from(STEPS) + i64::from(STEPS / 2)
}

/// First and last voxel whose middle lies in a closed range of lattice steps; the first is larger for none.
#[inline]
pub(super) fn voxels_between(low: i64, high: i64) -> (i64, i64) {
    let (steps, half) = (i64::from(STEPS), i64::from(STEPS / 2));
    ((low - half + steps - 1).div_euclid(steps), (high - half).div_euclid(steps))
}
