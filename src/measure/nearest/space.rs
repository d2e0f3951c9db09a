//! The orthonormal frame of a model: its index axes times its spacing, the low corner of the first cell at the origin.

use crate::fault::{Fault, unfit};
use crate::geom::{Affine, dot};

/// Most that the cosine of two axes may be, from 0, for axes at right angles.
const SQUARE: f64 = 1e-5;

/// Times that the spacing along one axis may be that along another.
const MAX_UNEVEN: f64 = 100.0;

/// From the world (LPS, mm) to the frame of a model and back; lengths are the same in both.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Space {
    to_frame: Affine,
    to_world: Affine,
    /// Edges of a cell, in mm.
    pub(crate) spacing: [f64; 3],
    /// Cells in a mm along each axis.
    pub(super) per_mm: [f64; 3],
    /// Least of them.
    pub(crate) finest: f64,
}

impl Space {
    /// `affine` leads from the index of a cell (its middle at integers) to LPS mm.
    ///
    /// # Errors
    /// The axes are not at right angles, a step is more than 100 times as long as another, or there is no volume.
    pub(crate) fn new(affine: &Affine) -> Result<Self, Fault> {
        let corners = affine.starting_at([-0.5; 3]);
        let spacing = corners.spacing_mm();
        let Some(mut to_frame) = corners.inverse() else {
            return Err(unfit!("has no volume in the world; build it again with a placement that has one"));
        };
        let columns = [0, 1, 2].map(|a| corners.column(a).map(|c| c / spacing[a]));
        if (0..3).any(|a| dot(columns[a], columns[(a + 1) % 3]).abs() > SQUARE) {
            return Err(unfit!(
                "has axes that are not at right angles (a tilted gantry, say), so that distances cannot be measured \
                 in it; resample the volume to right angles and build it again"
            ));
        }
        let [least, most] = spacing.iter().fold([f64::INFINITY, 0.0_f64], |[a, b], v| [a.min(*v), b.max(*v)]);
        if most > MAX_UNEVEN * least {
            return Err(unfit!(
                "has voxels more than {MAX_UNEVEN} times as long along one axis as along another, which is too coarse \
                 to measure; build it from a finer volume"
            ));
        }
        let mut to_world = corners;
        for (axis, length) in spacing.iter().enumerate() {
            to_frame.rows[axis].iter_mut().for_each(|c| *c *= length);
            to_world.rows.iter_mut().for_each(|row| row[axis] /= length);
        }
        Ok(Self { to_frame, to_world, spacing, per_mm: spacing.map(|edge| 1.0 / edge), finest: least })
    }

    /// A place of the world in the frame.
    #[inline]
    pub(crate) fn to_frame(self, world: [f64; 3]) -> [f64; 3] {
        self.to_frame.apply(world)
    }

    /// A place of the frame in the world.
    #[inline]
    pub(crate) fn to_world(self, frame: [f64; 3]) -> [f64; 3] {
        self.to_world.apply(frame)
    }

    /// A direction of the frame in the world.
    #[inline]
    pub(crate) fn direction_to_world(&self, frame: [f64; 3]) -> [f64; 3] {
        self.to_world.apply_vector(frame)
    }

    /// A direction of the world in the frame.
    #[inline]
    pub(crate) fn direction_to_frame(&self, world: [f64; 3]) -> [f64; 3] {
        self.to_frame.apply_vector(world)
    }
}
