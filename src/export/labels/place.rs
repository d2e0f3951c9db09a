//! Where the walls of a cell have their corner, and the normals of its labels there: by the samples around it.

use super::field::Field;
use super::walls::Sheet;
use crate::cpu::Isa;
use crate::export::patch::singles;
use crate::export::write::unit;
use crate::render::GridSpace;
use crate::wall::{Corners, Fit, Wall};

/// Most that a corner is moved along an axis: it stays in its cell, apart from those of other cells.
const WITHIN: f64 = 0.49;
/// Keeps the corner of several walls near the middle where they do not say more, as a part of a wall's weight.
const STAY: f64 = 0.05;
/// How far a knot lies from the middle of its face towards a sample, in parts of the way; where no corner is moved,
/// it only keeps pairs of polygons apart.
const KNOT: f64 = 0.5;
const SLIGHT: f64 = 1.0 / 32.0;

/// A corner within its cell, in voxels from the middle, and the normals of the cell's labels in mm.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Spot {
    pub(super) at: [f64; 3],
    pub(super) normals: [[f32; 3]; 8],
    pub(super) sheet: Option<Sheet>,
}

/// How corners are placed.
pub(super) struct Placing<'a> {
    space: &'a GridSpace,
    fit: Fit,
    /// Most voxels along an axis that a corner is moved from the middle of its cell.
    most: f64,
}

impl<'a> Placing<'a> {
    /// Corners are moved by at most so many voxels along each axis; at 0 walls are those between the samples' boxes.
    pub(super) fn new(space: &'a GridSpace, most: f64) -> Self {
        Self { space, fit: Fit::new(), most: most.clamp(0.0, WITHIN) }
    }

    /// How far a knot lies from the middle of its face, in parts of the way to a sample.
    pub(super) fn knot(&self) -> f64 {
        if self.most > 0.0 { KNOT } else { SLIGHT }
    }

    /// Places the corner of the cell before sample `at` of the field's middle; `labels` are those of `corners`.
    #[inline(always)]
    pub(super) fn place(
        &self,
        isa: impl Isa,
        field: &Field,
        at: [usize; 2],
        corners: &Corners,
        labels: &[u16],
    ) -> Spot {
        if self.is_blocky() {
            return Spot::default();
        }
        let with_none = corners.contains(&0);
        let mut spot = match (labels, with_none) {
            ([label], _) => self.between(isa, field, at, corners, [*label, 0]),
            ([one, other], false) => self.between(isa, field, at, corners, [*one, *other]),
            _ => self.among(isa, field, at, corners, labels),
        };
        spot.at = self.within(spot.at);
        spot
    }

    /// Are walls those between the samples' boxes?
    pub(super) fn is_blocky(&self) -> bool {
        self.most == 0.0
    }

    /// A corner that is moved no farther than it may be.
    pub(super) fn within(&self, at: [f64; 3]) -> [f64; 3] {
        at.map(|c| if c.is_finite() { c.clamp(-self.most, self.most) } else { 0.0 })
    }

    /// A normal in mm, by one in index space of any length.
    pub(super) fn in_mm(&self, normal: [f64; 3]) -> [f32; 3] {
        unit(singles(self.space.index_normal_to_world(normal)))
    }

    /// The wall between two labels.
    #[inline(always)]
    fn between(
        &self,
        isa: impl Isa,
        field: &Field,
        at: [usize; 2],
        corners: &Corners,
        [one, other]: [u16; 2],
    ) -> Spot {
        let Some(wall) = self.fit.between(isa, &field.window(at), corners, one, Some(other)) else {
            return Spot::default();
        };
        let mut spot = Spot { at: wall.normal.map(|c| f64::from(c * wall.along)), ..Spot::default() };
        let normal = self.normal(&wall);
        spot.normals[0] = normal;
        spot.normals[1] = normal.map(|c| -c);
        spot
    }

    /// The point nearest to the walls of several labels, each against all others.
    #[inline(never)]
    fn among(&self, isa: impl Isa, field: &Field, at: [usize; 2], corners: &Corners, labels: &[u16]) -> Spot {
        let mut spot = Spot::default();
        let walls =
            labels.iter().chain(corners.contains(&0).then_some(&0)).enumerate().filter_map(|(i, label)| {
                let wall = self.fit.between(isa, &field.window(at), corners, *label, None)?;
                if let Some(of_label) = spot.normals.get_mut(i).filter(|_| *label != 0) {
                    *of_label = self.normal(&wall);
                }
                Some((wall.normal.map(f64::from), f64::from(wall.along)))
            });
        spot.at = nearest(walls);
        spot
    }

    fn normal(&self, wall: &Wall) -> [f32; 3] {
        self.in_mm(wall.normal.map(f64::from))
    }
}

/// The point nearest to planes, each by its unit normal and its distance along it; near the middle where they do not
/// say more.
pub(super) fn nearest(planes: impl IntoIterator<Item = ([f64; 3], f64)>) -> [f64; 3] {
    let (mut matrix, mut right) = ([[0.0; 3]; 3], [0.0; 3]);
    (0..3).for_each(|a| matrix[a][a] = STAY);
    for (normal, along) in planes {
        for a in 0..3 {
            (0..3).for_each(|b| matrix[a][b] += normal[a] * normal[b]);
            right[a] += normal[a] * along;
        }
    }
    solved(&matrix, right)
}

/// The solution of three equations, by Cramer's rule.
fn solved(matrix: &[[f64; 3]; 3], right: [f64; 3]) -> [f64; 3] {
    let determinant = |m: &[[f64; 3]; 3]| {
        let minor = |a: usize, b: usize| m[1][a] * m[2][b] - m[1][b] * m[2][a];
        m[0][0] * minor(1, 2) - m[0][1] * minor(0, 2) + m[0][2] * minor(0, 1)
    };
    let whole = determinant(matrix);
    std::array::from_fn(|column| {
        let mut with = *matrix;
        (0..3).for_each(|row| with[row][column] = right[row]);
        determinant(&with) / whole
    })
}
