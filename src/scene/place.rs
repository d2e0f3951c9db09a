//! Placement of a body: affine maps of its millimetres to the scene's.

use crate::geom::{Affine, angle};

/// Placement of a body: scaled, turned about x, then y, then z, and moved, about a fixed point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// Factor along each axis of the body's own millimetres.
    pub scale: [f64; 3],
    /// Degrees about x, then y, then z, counter-clockwise as seen against the axis.
    pub turn_deg: [f64; 3],
    /// The point of the body that scaling and turning leave in place.
    pub pivot: [f64; 3],
    /// Position of that point in the scene.
    pub at: [f64; 3],
}

/// Rotation about an axis.
fn turn(axis: usize, degrees: f64) -> Affine {
    let [sin, cos] = angle::sin_cos_deg(degrees);
    let (a, b) = ((axis + 1) % 3, (axis + 2) % 3);
    let mut turned = Affine::from_spacing([1.0; 3]);
    (turned.rows[a][a], turned.rows[a][b]) = (cos, -sin);
    (turned.rows[b][a], turned.rows[b][b]) = (sin, cos);
    turned
}

impl Placement {
    /// The map from the body's millimetres to the scene's.
    pub fn affine(&self) -> Affine {
        let mut all = Affine::from_spacing(self.scale);
        for (axis, degrees) in self.turn_deg.into_iter().enumerate() {
            all = turn(axis, degrees).after(&all);
        }
        let pivot = all.apply(self.pivot);
        for (axis, row) in all.rows.iter_mut().enumerate() {
            row[3] += self.at[axis] - pivot[axis];
        }
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bodies_are_scaled_turned_and_moved_about_their_pivot() {
        let placement = Placement {
            scale: [2.0, 1.0, 1.0],
            turn_deg: [0.0, 0.0, 90.0],
            pivot: [1.0, 1.0, 1.0],
            at: [10.0, 20.0, 30.0],
        };
        let affine = placement.affine();
        assert_eq!(affine.apply([1.0; 3]), [10.0, 20.0, 30.0]);
        // One step along x becomes two, and lies along y after the turn.
        assert_eq!(affine.apply([2.0, 1.0, 1.0]), [10.0, 22.0, 30.0]);
        assert_eq!(affine.apply([1.0, 2.0, 1.0]), [9.0, 20.0, 30.0]);
        // x before y before z.
        let both = Placement { turn_deg: [90.0, 90.0, 0.0], scale: [1.0; 3], pivot: [0.0; 3], at: [0.0; 3] };
        assert_eq!(both.affine().apply([0.0, 1.0, 0.0]).map(|v| v + 0.0), [1.0, 0.0, 0.0]);
    }
}
