//! Position of a cell's corner between labels by its stored walls: on its plane, or nearest to both of its planes. On a
//! thin sheet, which has one label on both sides, each side has a corner of its own.

use super::cell::distinct;
use crate::export::cases::{Case, ENDS};
use crate::export::patch::singles;
use crate::export::write::unit;
use crate::format::cell::{CORNERS, Plane};
use crate::format::{CornerLabels, Walls};
use crate::render::GridSpace;

/// Limit to the movement of a corner along an axis: it stays in its cell, apart from corners of other cells.
const WITHIN: f64 = 0.49;
/// Weight, relative to a wall's, that keeps the vertex of several walls near the middle where they do not determine it.
const STAY: f64 = 0.05;
/// Distance of a knot from the middle of its face, as a fraction of the way to a sample; where no corner is moved, it
/// only keeps pairs of polygons apart.
const KNOT: f64 = 0.25;
const SLIGHT: f64 = 1.0 / 32.0;

/// A corner within its cell, in voxels from the middle, and the normals of the cell's labels in mm.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct WallCorner {
    pub(super) at: [f64; 3],
    pub(super) normals: [[f32; 3]; 8],
    pub(super) sheet: Option<Sheet>,
}

/// Placement of corners.
pub(super) struct Placing<'a> {
    space: &'a GridSpace,
    /// Limit to the movement of a corner from the middle of its cell, in voxels along an axis.
    most: f64,
}

impl<'a> Placing<'a> {
    /// Moves corners by at most so many voxels along each axis; at 0 walls are the faces between the samples' boxes.
    pub(super) fn new(space: &'a GridSpace, most: f64) -> Self {
        Self { space, most: most.clamp(0.0, WITHIN) }
    }

    /// Distance of a knot from the middle of its face, as a fraction of the way to a sample.
    pub(super) fn knot(&self) -> f64 {
        if self.most > 0.0 { KNOT } else { SLIGHT }
    }

    /// True if walls are the faces between the samples' boxes.
    pub(super) fn is_blocky(&self) -> bool {
        self.most == 0.0
    }

    /// A corner within the limit of its movement.
    pub(super) fn within(&self, at: [f64; 3]) -> [f64; 3] {
        at.map(|c| if c.is_finite() { c.clamp(-self.most, self.most) } else { 0.0 })
    }

    /// A unit normal in mm, from one in index space of any length.
    pub(super) fn in_mm(&self, normal: [f64; 3]) -> [f32; 3] {
        unit(singles(self.space.index_normal_to_world(normal)))
    }
}

/// The point nearest to planes, each given by its unit normal and its distance along it; near the middle where the
/// planes do not determine it.
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

/// Parts of a cell by the two planes, indexed by bits for being in front of them: behind the first, and on either side
/// of the second.
const PARTS: [usize; 4] = [0, 1, 0, 2];

/// A plane in voxels, relative to the middle of its cell: the unit normal, and the distance along it.
type InVoxels = ([f64; 3], f64);

fn in_voxels(plane: &Plane) -> InVoxels {
    let normal = plane.normal.map(f64::from);
    let length = normal.iter().map(|n| n * n).sum::<f64>().sqrt();
    // The cell's own coordinates are in half voxels.
    (normal.map(|n| n / length), f64::from(plane.offset) / (2.0 * length))
}

fn foot((normal, along): InVoxels) -> [f64; 3] {
    normal.map(|n| n * along)
}

/// The two sides of a thin sheet.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sheet {
    /// Positions of their corners, in voxels from the middle, and their planes' normals in mm.
    sides: [([f64; 3], [f32; 3]); 2],
    /// The part in which each corner of the cell lies.
    part_of: [usize; CORNERS],
}

impl Sheet {
    /// The side on which a patch of a label lies: its corner, and the normal out of the label. `None` for a patch that
    /// goes around the sheet's edge.
    pub(super) fn side(
        &self,
        case: &Case,
        patch: u8,
        is_own: impl Fn(usize) -> bool,
    ) -> Option<([f64; 3], [f32; 3])> {
        let mut found = [None; 2];
        for ([low, high], _) in ENDS.iter().zip(case.patch_of).filter(|(_, of)| *of == patch) {
            let (own, other) = if is_own(*low) { (*low, *high) } else { (*high, *low) };
            let (own, other) = (self.part_of[own], self.part_of[other]);
            found[usize::from(own > 0 && other > 0)] = Some(own < other);
        }
        let (side, is_behind) = match found {
            [Some(is_behind), None] => (0, is_behind),
            [None, Some(is_behind)] => (1, is_behind),
            _ => return None,
        };
        let (at, normal) = self.sides[side];
        Some((at, if is_behind { normal } else { normal.map(|c| -c) }))
    }
}

impl Placing<'_> {
    /// Places the corner of a cell; `corners` hold indices into a table in place of labels.
    pub(super) fn by_walls(&self, walls: &Walls, corners: &CornerLabels) -> WallCorner {
        if self.is_blocky() {
            return WallCorner::default();
        }
        let (labels, count) = distinct(corners);
        let labels = &labels[..count];
        let mut spot = match walls.planes() {
            [plane] => self.on_plane(plane, labels[0] == label_of(walls, corners, [0, 0])),
            [first, second] => {
                let parts = [[0, 2], [1, 1], [3, 3]].map(|fronts| label_of(walls, corners, fronts));
                if parts[1] == parts[2] {
                    self.on_plane(first, labels[0] == parts[0])
                } else {
                    self.on_two([*first, *second].map(|plane| in_voxels(&plane)), parts, labels)
                }
            }
            _ => self.in_octants(corners, labels),
        };
        spot.at = self.within(spot.at);
        if let Some(sheet) = &mut spot.sheet {
            sheet.part_of = std::array::from_fn(|corner| PARTS[walls.corner_fronts(corner)]);
            sheet.sides = sheet.sides.map(|(at, normal)| (self.within(at), normal));
        }
        spot
    }

    /// A corner at the point where the walls of voxels meet, with the normals of the stored walls.
    pub(super) fn in_the_middle(&self, walls: &Walls, corners: &CornerLabels) -> WallCorner {
        WallCorner { at: [0.0; 3], sheet: None, ..self.by_walls(walls, corners) }
    }

    fn on_plane(&self, plane: &Plane, is_behind: bool) -> WallCorner {
        let plane = in_voxels(plane);
        let out = self.in_mm(plane.0);
        let turned = out.map(|c| -c);
        let mut spot = WallCorner { at: foot(plane), ..WallCorner::default() };
        [spot.normals[0], spot.normals[1]] = if is_behind { [out, turned] } else { [turned, out] };
        spot
    }

    fn on_two(&self, planes: [InVoxels; 2], parts: [u16; 3], labels: &[u16]) -> WallCorner {
        let mut spot = WallCorner { at: nearest(planes), ..WallCorner::default() };
        let [(first, _), (second, _)] = planes;
        for (label, normal) in labels.iter().zip(&mut spot.normals) {
            let has = parts.map(|part| part == *label);
            let by_first = if has[0] { 1.0 } else { -1.0 };
            let by_second = f64::from(u8::from(has[1])) - f64::from(u8::from(has[2]));
            *normal = self.in_mm(std::array::from_fn(|a| by_first * first[a] + by_second * second[a]));
        }
        if parts[0] == parts[1] || parts[0] == parts[2] {
            let sides = planes.map(|plane| (foot(plane), self.in_mm(plane.0)));
            spot.sheet = Some(Sheet { sides, part_of: [0; CORNERS] });
        }
        spot
    }

    /// A corner in the middle of its cell, with normals from the octants of each label.
    fn in_octants(&self, corners: &CornerLabels, labels: &[u16]) -> WallCorner {
        let mut spot = WallCorner::default();
        for (label, normal) in labels.iter().zip(&mut spot.normals) {
            let mut out = [0.0; 3];
            for corner in (0..CORNERS).filter(|corner| corners[*corner] == *label) {
                (0..3).for_each(|a| out[a] += if corner >> a & 1 == 1 { -1.0 } else { 1.0 });
            }
            *normal = self.in_mm(out);
        }
        spot
    }
}

/// The label of the corners with either of these bits for being in front of the planes.
fn label_of(walls: &Walls, corners: &CornerLabels, fronts: [usize; 2]) -> u16 {
    (0..CORNERS)
        .find(|corner| fronts.contains(&walls.corner_fronts(*corner)))
        .map_or(0, |corner| corners[corner])
}
