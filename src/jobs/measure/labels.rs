//! Area of each label of a model of cells.
//!
//! A wall counts for both labels that it parts: in a cell with one plane with the mean area of such a plane, in other
//! cells with the area of their walls. Errors come from an experiment: 320 balls, boxes, tori and cylinders of 4 to 28
//! voxels, turned anyhow and along the axes. Areas of balls and tori are 0.5 and 2 % off; edges are rounded, as labels
//! say nothing between samples: turned boxes lack 2 % and boxes along the axes, the worst, 20. 96 of 100 true values
//! lie within the error. Thin labels keep the steps of their voxels in meshes, which have up to 1.6 times the area
//! then.

use super::{Bend, Bends, Bounds, Weights, are_uneven, bounds};
use crate::enclosed::SkinSlices;
use crate::format::cell::Plane;
use crate::format::{Label, Walls};
use crate::geom::{Affine, Dims, cross, dot};
use crate::load::ModelView;
use crate::render::GridSpace;

/// Measures of a model of labels, in millimetres.
#[derive(Clone, Debug, PartialEq)]
pub struct LabelMeasures {
    /// As [`Measures::voxels`](super::Measures::voxels), of all labels.
    pub voxels: [[u32; 3]; 2],
    /// As [`Measures::box_mm`](super::Measures::box_mm), of all labels.
    pub box_mm: [[f64; 3]; 2],
    /// Area of each label of the table with its error, walls to other labels and of cavities included; `None` where
    /// voxels are too uneven.
    pub areas_mm2: Vec<Option<(f64, f64)>>,
}

/// Measures the labels of a model with this table; `None` for one without a voxel, without a volume, or damaged.
pub(in crate::jobs) fn measure_labels(
    view: &ModelView<'_>,
    table: &[Label],
    dims: Dims,
    affine: &Affine,
) -> Option<LabelMeasures> {
    let space = GridSpace::new(dims, affine).ok()?;
    let Bounds { voxels, box_mm: cells_mm } = bounds(view, &space)?;
    let mut box_mm = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
    let weights = Weights::new(affine, &space, true);
    let mut slices = SkinSlices::new(view, voxels);
    let mut bends = Bends::new(table.len(), EDGE);
    let mut walls = vec![WallArea::default(); table.len()];
    let place = |number: u16| table.binary_search_by_key(&number, |label| label.number).ok();
    let known = !are_uneven(affine);
    for z in if known { voxels[0][2]..voxels[1][2] } else { 0..0 } {
        bends.begin();
        for voxel in slices.slice(z)? {
            let Some(found) = view.walls(voxel.voxel.get()) else { continue };
            let patch = voxel.code(view).and_then(|code| weights.patch(code, None, [voxel.y, voxel.x]));
            let patch = patch.filter(|_| found.planes().len() == 1);
            let faces = faces(&found);
            let middle = [voxel.x, voxel.y, z].map(f64::from);
            for u in labelled(&found, &faces) {
                let at = affine.apply(std::array::from_fn(|a| middle[a] + u[a] / 2.0));
                for (a, value) in at.into_iter().enumerate() {
                    (box_mm[0][a], box_mm[1][a]) = (value.min(box_mm[0][a]), value.max(box_mm[1][a]));
                }
            }
            for (labels, face) in faces {
                let area = area(&face, &weights.columns);
                for (label, front) in labels.into_iter().zip([false, true]) {
                    let Some(at) = place(label) else { continue };
                    walls[at].within += area;
                    walls[at].usual += patch.as_ref().map_or(area, |patch| patch.part);
                    bends.now.extend(patch.as_ref().map(|patch| patch.of_label(at, front)));
                }
            }
        }
        bends.end(&weights);
    }
    let voxel = affine.determinant().abs();
    let of = |((WallArea { usual, within }, bend), label): ((WallArea, &Bend), &Label)| {
        // 0 for labels at least as thick as a sheet of three voxels.
        let thick = label.voxels as f64 * voxel / voxel.cbrt();
        let steps = STEPS * (3.0 * usual - 2.0 * thick).clamp(0.0, usual);
        let error = 1.5 * (usual - within).abs() + 3.0 * bend.edges + 0.01 * usual + steps;
        known.then_some((usual, error))
    };
    let areas_mm2 = walls.into_iter().zip(&bends.of_area).zip(table).map(of).collect();
    let box_mm = if box_mm[0][0].is_finite() { box_mm } else { cells_mm };
    Some(LabelMeasures { voxels, box_mm, areas_mm2 })
}

/// Area that steps add to a sheet of one or two voxels, as a fraction of its own.
const STEPS: f64 = 0.6;

/// The error of a label's volume: its surface lies a quarter of a voxel at most from the faces of its voxels on average,
/// however a mesh is smoothed. Balls of two to three voxels' radius come nearest to that, with .2.
pub(in crate::jobs) fn label_volume_error(area_mm2: f64, voxel_mm3: f64) -> f64 {
    0.25 * area_mm2 * voxel_mm3.cbrt()
}

/// Neighbours whose normals are at least 11 degrees apart (as a cosine) lie at an edge, which is rounded.
const EDGE: f64 = 0.98;

/// Area of the walls of a label, in mm2.
#[derive(Clone, Copy, Debug, Default)]
struct WallArea {
    usual: f64,
    /// Area of the planes in the cells.
    within: f64,
}

/// The walls of a cell whose edges are these axes: the labels behind and in front, and the area.
pub(in crate::jobs) fn areas(walls: &Walls, axes: &[[f64; 3]; 3]) -> Vec<([u16; 2], f64)> {
    faces(walls).into_iter().map(|(labels, face)| (labels, area(&face, axes))).collect()
}

/// Corners of the labelled part of a cell, in its own coordinates.
fn labelled(walls: &Walls, faces: &[([u16; 2], Vec<[f64; 3]>)]) -> Vec<[f64; 3]> {
    let corners = (0..8).filter(|corner| walls.corner(*corner) > 0);
    let at = |corner: usize| std::array::from_fn(|a| if corner >> a & 1 == 1 { 1.0 } else { -1.0 });
    let ends = faces.iter().filter(|(labels, _)| labels.contains(&0)).flat_map(|(_, face)| face);
    corners.map(at).chain(ends.copied()).collect()
}

/// The walls of a cell: the labels behind and in front, and the polygon in the cell's own coordinates.
fn faces(walls: &Walls) -> Vec<([u16; 2], Vec<[f64; 3]>)> {
    let planes = walls.planes();
    let mut found = Vec::new();
    for (i, plane) in planes.iter().enumerate() {
        // The other planes cut it into parts.
        for others in (0..1_usize << planes.len()).filter(|bits| bits >> i & 1 == 0) {
            let labels = [others, others | 1 << i].map(|fronts| walls.label(fronts));
            if labels[0] == labels[1] {
                continue;
            }
            let mut face = square(plane);
            for (j, other) in planes.iter().enumerate().filter(|(j, _)| *j != i) {
                face = clipped(&face, other, others >> j & 1 == 1);
            }
            for side in [0, 1, 2, 3, 4, 5] {
                let mut normal = [0; 3];
                normal[side / 2] = if side % 2 == 0 { 1 } else { -1 };
                face = clipped(&face, &Plane { normal, offset: 1 }, false);
            }
            found.push((labels, face));
        }
    }
    found
}

/// A part of a plane that covers the cell.
fn square(plane: &Plane) -> Vec<[f64; 3]> {
    let n = plane.normal.map(f64::from);
    let longest = (0..3).fold(0, |best, a| if n[a].abs() > n[best].abs() { a } else { best });
    let (u, v) = ((longest + 1) % 3, (longest + 2) % 3);
    let corner = |[p, q]: [f64; 2]| {
        let mut at = [0.0; 3];
        (at[u], at[v]) = (p, q);
        at[longest] = (f64::from(plane.offset) - n[u] * p - n[v] * q) / n[longest];
        at
    };
    [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(corner).to_vec()
}

/// The part of a polygon behind a plane, or in front of it (Sutherland and Hodgman 1974).
fn clipped(face: &[[f64; 3]], plane: &Plane, front: bool) -> Vec<[f64; 3]> {
    let sign = if front { 1.0 } else { -1.0 };
    let kept = |at: &[f64; 3]| sign * (dot(plane.normal.map(f64::from), *at) - f64::from(plane.offset));
    let mut left = Vec::with_capacity(face.len() + 1);
    for (at, next) in face.iter().zip(face.iter().cycle().skip(1)) {
        let (here, there) = (kept(at), kept(next));
        if here >= 0.0 {
            left.push(*at);
        }
        if (here >= 0.0) != (there >= 0.0) {
            let t = here / (here - there);
            left.push(std::array::from_fn(|a| at[a] + t * (next[a] - at[a])));
        }
    }
    left
}

/// Area of a flat polygon in a cell's own coordinates, whose edges, two long there, are these axes.
fn area(face: &[[f64; 3]], axes: &[[f64; 3]; 3]) -> f64 {
    let world = |u: &[f64; 3]| -> [f64; 3] {
        std::array::from_fn(|row| axes.iter().zip(u).map(|(axis, u)| axis[row] * u / 2.0).sum())
    };
    let Some((first, rest)) = face.split_first() else { return 0.0 };
    let origin = world(first);
    let from_origin = |at: &[f64; 3]| -> [f64; 3] {
        let at = world(at);
        std::array::from_fn(|a| at[a] - origin[a])
    };
    let twice = rest.windows(2).fold([0.0; 3], |sum: [f64; 3], pair| {
        let across = cross(from_origin(&pair[0]), from_origin(&pair[1]));
        std::array::from_fn(|a| sum[a] + across[a])
    });
    dot(twice, twice).sqrt() / 2.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::{WallItem, normal};

    const CUBE: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

    #[test]
    fn walls_have_the_area_that_their_planes_have_in_the_cell() {
        let [x, y] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]].map(normal::encode);
        let one = Walls::of_pair(Plane::new(x, 0), [5, 2]);
        assert_eq!(areas(&one, &CUBE), [([5, 2], 1.0)]);
        // Label 7 at low x; else 3 at low y, none at high y.
        let labels = [7, 3, 7, 0, 7, 3, 7, 0];
        let two = Walls::of_item(x, &WallItem { labels, planes: Some((0, y, 0)) });
        let axes = [[2.0, 0.0, 0.0], [0.0, 3.0, 0.0], [0.0, 0.0, 5.0]];
        assert_eq!(areas(&two, &axes), [([7, 3], 7.5), ([7, 0], 7.5), ([3, 0], 5.0)]);
        let octants = Walls::of_item(x, &WallItem { labels: [1, 0, 0, 0, 0, 0, 0, 0], planes: None });
        assert_eq!(areas(&octants, &CUBE).iter().map(|(_, area)| area).sum::<f64>(), 0.75);
    }
}
