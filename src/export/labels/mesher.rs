//! The surfaces of all labels, layer by layer: a vertex in each cell that a wall passes through, and around each edge
//! between two labels a polygon, which is part of the surfaces of both.
//!
//! A cell has one point for all its labels, and a polygon is cut the same way for both of its labels, so that
//! neighbours have exactly the same triangles, reversed. Each label has vertices of its own, one for each sheet of its
//! surface in a cell.

use std::collections::HashMap;
use std::io;

use super::cell::{distinct, knots, sheets};
use super::parts::Parts;
use super::walls::{Placing, WallCorner};
use crate::export::cases::{EDGES, others};
use crate::export::dual::{Near, distance, placed};
use crate::export::patch::corner_at;
use crate::export::write::unit;
use crate::format::cell::{CORNERS, Plane, at_corner};
use crate::format::{CornerLabels, Walls};
use crate::geom::Affine;
use crate::interior::{Rows, SkinVoxel};
use crate::load::ModelView;
use crate::render::normals::blend::find;

/// Columns and rows before the first cell of the box.
pub(super) const MARGIN: u32 = 4;

/// One label in a cell: the number of its first vertex, and the sheets, if there are several.
#[derive(Clone, Copy, Debug)]
struct Share {
    label: u16,
    first: u32,
    sheets: Option<u32>,
    normal: [f32; 3],
}

/// A cell that a wall passes through.
#[derive(Clone, Copy, Debug, Default)]
struct Cell {
    x: u32,
    corners: CornerLabels,
    /// Point of the cell in mm.
    at: [f32; 3],
    shares: [u32; 2],
}

/// The cells of a layer.
#[derive(Default)]
struct Layer {
    cells: Rows<Cell>,
    shares: Vec<Share>,
    sheets: Vec<[u8; EDGES]>,
}

impl Layer {
    fn clear(&mut self) {
        self.cells.clear();
        self.shares.clear();
        self.sheets.clear();
    }

    #[inline(always)]
    fn share(&self, cell: &Cell, label: u16) -> Option<&Share> {
        let shares = self.shares.get(cell.shares[0] as usize..cell.shares[1] as usize)?;
        shares.iter().find(|share| share.label == label)
    }

    /// The number of a label's vertex in a cell, for the sheet that crosses an edge.
    #[inline(always)]
    fn vertex(&self, cell: &Cell, label: u16, edge: usize) -> u32 {
        let Some(share) = self.share(cell, label) else { return 0 };
        let sheets = share.sheets.and_then(|at| self.sheets.get(at as usize));
        share.first + sheets.map_or(0, |sheet_of| u32::from(sheet_of[edge]))
    }
}

/// A slice of a model's cells between labels, row by row.
pub(super) struct Stored<'a> {
    pub(super) view: &'a ModelView<'a>,
    pub(super) cells: &'a [SkinVoxel],
    /// Coordinates of the first cell of the model's box.
    pub(super) low: [u32; 3],
    /// Columns and rows of the box, with [`MARGIN`] before it.
    pub(super) width: u32,
    pub(super) height: u32,
    /// Index in the table of labels, from 1 on, by a label's number; 0 for none.
    pub(super) part_of: &'a [u16],
}

impl Stored<'_> {
    fn column(&self, coordinate: u32, axis: usize) -> Option<u32> {
        Some(coordinate.checked_sub(self.low[axis])? + MARGIN)
    }

    fn corners(&self, walls: &Walls) -> CornerLabels {
        let part = |number: u16| self.part_of.get(usize::from(number)).copied().unwrap_or(0);
        std::array::from_fn(|corner| part(walls.corner(corner)))
    }

    /// True if a wall of a cell comes so close to the centre of a voxel of a thin label that little is left of it.
    fn would_lose(&self, cell: [u32; 3], walls: &Walls, corners: &CornerLabels) -> bool {
        let thin = |corner: usize, axis: usize, voxels: u32| {
            corners[corner ^ 1 << axis] != corners[corner] && self.is_thin(cell, corner, axis, voxels)
        };
        let of_plane = |corner: usize, plane: &Plane| {
            let n = plane.normal;
            let ahead = at_corner(n, corner) - plane.offset;
            let across = (0..3).fold(0, |most, axis| if n[axis].abs() > n[most].abs() { axis } else { most });
            if ahead.abs() <= TOUCHING {
                // The edge of something thin is equally thin further in, unlike a step of a body.
                let is_edge =
                    |axis: usize| thin(corner, axis, 2) && self.is_thin_within(cell, corner, [across, axis]);
                return thin(corner, across, 3) || (0..3).any(|axis| axis != across && is_edge(axis));
            }
            // Components of a stored normal are in half voxels.
            let square = n.iter().map(|n| n * n).sum::<i32>();
            let is_near = |most: f64| f64::from(ahead * ahead) < 4.0 * most * most * f64::from(square);
            is_near(NEAR) && thin(corner, across, 2) || is_near(NEARER) && thin(corner, across, 3)
        };
        let mut own = (0..CORNERS).filter(|corner| corners[*corner] != 0);
        own.any(|corner| walls.planes().iter().any(|plane| of_plane(corner, plane)))
    }

    /// True if the label of a cell's corner is equally thin along the second axis two voxels further in along the
    /// first.
    #[cold]
    fn is_thin_within(&self, cell: [u32; 3], corner: usize, [across, axis]: [usize; 2]) -> bool {
        let is_high = corner >> across & 1 == 1;
        let mut cell = cell;
        cell[across] = if is_high { cell[across] + 2 } else { cell[across].saturating_sub(2) };
        let Some(walls) = find(self.view, cell).and_then(|voxel| self.view.walls(voxel.get())) else {
            return false;
        };
        let corners = self.corners(&walls);
        corners[corner ^ 1 << axis] != corners[corner] && self.is_thin(cell, corner, axis, 2)
    }

    /// True if the label of a cell's corner ends within so many voxels, from the corner on along an axis.
    #[cold]
    fn is_thin(&self, cell: [u32; 3], corner: usize, axis: usize, voxels: u32) -> bool {
        let mut cell = cell;
        // The cell beyond the corner, which holds the label's next voxels.
        for _ in 0..voxels {
            let is_high = corner >> axis & 1 == 1;
            let Some(next) = (if is_high { cell[axis].checked_add(1) } else { cell[axis].checked_sub(1) })
            else {
                return true;
            };
            cell[axis] = next;
            let Some(walls) = find(self.view, cell).and_then(|voxel| self.view.walls(voxel.get())) else {
                continue;
            };
            let corners = self.corners(&walls);
            if corners[corner ^ 1 << axis] != corners[corner] {
                return true;
            }
        }
        false
    }
}

/// A wall touches a corner of its cell within this distance, in components of its stored normal: labels up to three
/// voxels thick across it, or at an edge up to two, are outweighed by the samples around them there. Labels up to two
/// voxels thick across the wall (`NEAR`), or three (`NEARER`), also lose most of their thickness within these distances
/// from the corner, in voxels.
const TOUCHING: i32 = 2;
const NEAR: f64 = 0.5;
const NEARER: f64 = 0.25;

/// A knot: the axis across its face, the cell above the face, and the corner of that cell that it goes around.
type Knot = (usize, [u32; 3], usize);

/// For each cell around an edge ([`Near::around`]), 1 for each of the two other axes along which it is one less.
const AROUND: [[usize; 2]; 4] = [[1, 1], [0, 1], [0, 0], [1, 0]];

/// Makes the polygons of one layer of cells after the other.
pub(super) struct Mesher<'a> {
    /// Maps the middle of a cell, by its numbers, to mm.
    to_mm: Affine,
    placing: Placing<'a>,
    mirrored: bool,
    here: Layer,
    below: Layer,
    near: Near<Cell>,
    knots: HashMap<(Knot, u16), u32>,
    pub(super) parts: Parts,
}

/// An edge between two labels, and the cells around it.
struct Edge {
    axis: usize,
    cell: [u32; 3],
    around: [Cell; 4],
}

impl Edge {
    /// True for a cell in the layer below.
    fn is_below(&self, which: usize) -> bool {
        let [b, c] = others(self.axis);
        (AROUND[which][0] << b | AROUND[which][1] << c) >> 2 & 1 == 1
    }

    /// The cells on the two sides of a face between consecutive cells around the edge, the higher one last.
    fn sides(side: usize) -> [usize; 2] {
        [[0, 1], [1, 2], [3, 2], [0, 3]][side]
    }

    /// The knot in such a face that the polygon passes, if the face has knots.
    #[inline(always)]
    fn knot(&self, side: usize) -> Option<Knot> {
        let [b, c] = others(self.axis);
        let across = if side.is_multiple_of(2) { b } else { c };
        let [_, high] = Self::sides(side);
        let less = AROUND[high];
        let around = knots(&self.around[high].corners, across, 0)?;
        let low_end = less[0] << b | less[1] << c;
        let corner = if around.contains(&low_end) { low_end } else { low_end | 1 << self.axis };
        let mut cell = self.cell;
        cell[b] -= u32::from(less[0] == 1);
        cell[c] -= u32::from(less[1] == 1);
        Some((across, cell, corner))
    }
}

impl<'a> Mesher<'a> {
    pub(super) fn new(to_mm: Affine, placing: Placing<'a>, parts: Parts) -> Self {
        Self {
            mirrored: to_mm.determinant() < 0.0,
            to_mm,
            placing,
            here: Layer::default(),
            below: Layer::default(),
            near: Near::default(),
            knots: HashMap::new(),
            parts,
        }
    }

    /// Takes the cells of the next slice of a model.
    ///
    /// # Errors
    /// Errors of the disk, and [`ExportFault::TooLong`](super::super::ExportFault::TooLong).
    pub(super) fn next(&mut self, cells: &Stored<'_>, z: u32) -> io::Result<()> {
        std::mem::swap(&mut self.below, &mut self.here);
        self.here.clear();
        self.knots.retain(|((_, cell, _), _), _| cell[2] + 1 >= z);
        self.here.cells.end_row();
        self.rows_of(cells, z)?;
        self.join(cells.height as usize, cells.width as usize, z)
    }

    /// Makes the vertices of a layer.
    fn rows_of(&mut self, stored: &Stored<'_>, z: u32) -> io::Result<()> {
        let mut rows = 1;
        for cell in stored.cells {
            let [Some(x), Some(y)] = [(cell.x, 0), (cell.y, 1)].map(|(c, a)| stored.column(c, a)) else {
                continue;
            };
            let Some(walls) = stored.view.walls(cell.voxel.get()) else { continue };
            while rows < y {
                self.here.cells.end_row();
                rows += 1;
            }
            let corners = stored.corners(&walls);
            if corners.iter().any(|label| *label != corners[0]) {
                let place = [cell.x, cell.y, stored.low[2] + z];
                let spot = match stored.would_lose(place, &walls, &corners) {
                    false => self.placing.by_walls(&walls, &corners),
                    true => self.placing.in_the_middle(&walls, &corners),
                };
                self.cell([x, y, z], corners, &spot)?;
            }
        }
        while rows < stored.height {
            self.here.cells.end_row();
            rows += 1;
        }
        Ok(())
    }

    #[inline(always)]
    fn cell(&mut self, cell: [u32; 3], corners: CornerLabels, spot: &WallCorner) -> io::Result<()> {
        let (labels, count) = distinct(&corners);
        let at = self.mm(cell, spot.at);
        let begin = self.here.shares.len();
        for (label, normal) in labels[..count].iter().zip(spot.normals) {
            let case = sheets(&corners, *label).filter(|case| case.patches > 1);
            let part = usize::from(*label) - 1;
            let mut share = Share { label: *label, first: 0, sheets: None, normal };
            if let Some(case) = case {
                let is_own = |corner: usize| corners[corner] == *label;
                for patch in 0..case.patches {
                    let side = spot.sheet.as_ref().and_then(|sheet| sheet.side(&case, patch, is_own));
                    let point = side.map_or([at, normal], |(at, normal)| [self.mm(cell, at), normal]);
                    let number = self.parts.vertex(part, &point)?;
                    share.first = if patch == 0 { number } else { share.first };
                }
                share.sheets = u32::try_from(self.here.sheets.len()).ok();
                self.here.sheets.push(case.patch_of);
            } else {
                share.first = self.parts.vertex(part, &[at, normal])?;
            }
            self.here.shares.push(share);
        }
        let shares = [begin, self.here.shares.len()].map(|at| u32::try_from(at).unwrap_or(u32::MAX));
        self.here.cells.push(Cell { x: cell[0], corners, at, shares });
        Ok(())
    }

    #[inline(always)]
    fn mm(&self, cell: [u32; 3], within: [f64; 3]) -> [f32; 3] {
        placed(&self.to_mm, cell, within)
    }

    /// Makes the polygons whose last cell is in this layer.
    fn join(&mut self, height: usize, width: usize, z: u32) -> io::Result<()> {
        self.near.widen(width);
        for row in 1..height {
            self.near.take([self.here.cells.row(row), self.below.cells.row(row)], |cell| cell.x);
            for at in 0..self.here.cells.row(row).len() {
                let cell = self.here.cells.row(row)[at];
                for axis in 0..3 {
                    let ends = [cell.corners[0], cell.corners[1 << axis]];
                    if ends[0] != ends[1] {
                        let number = [cell.x, u32::try_from(row).unwrap_or(u32::MAX), z];
                        self.polygon(axis, number, ends)?;
                    }
                }
            }
        }
        Ok(())
    }

    /// The polygon around the edge along an axis in the lowest corner of a cell, for both labels at its ends.
    #[inline(always)]
    fn polygon(&mut self, axis: usize, cell: [u32; 3], ends: [u16; 2]) -> io::Result<()> {
        let around @ [p, q, r, s] = self.near.around(cell[0] as usize, axis);
        let edge = Edge { axis, cell, around };
        let found = [edge.knot(0), edge.knot(1), edge.knot(2), edge.knot(3)];
        let is_across = distance(q.at, s.at) < distance(p.at, r.at);
        for (which, label) in ends.into_iter().enumerate().filter(|(_, label)| *label != 0) {
            let mut corners = [0; 4];
            for (i, corner) in corners.iter_mut().enumerate() {
                // The edge by its number in the cell: high along the axes where the cell is one less.
                let within = 4 * axis + AROUND[i][0] + 2 * AROUND[i][1];
                *corner = self.layer_of(&edge, i).vertex(&edge.around[i], label, within);
            }
            let mut between = [None; 4];
            for (side, number) in between.iter_mut().enumerate() {
                *number = found[side].map(|knot| self.knot(&edge, side, knot, label)).transpose()?;
            }
            let reversed = (which == 1) ^ (axis == 1) ^ self.mirrored;
            self.cut(usize::from(label) - 1, corners, between, [is_across, reversed])?;
        }
        Ok(())
    }

    fn layer_of(&self, edge: &Edge, which: usize) -> &Layer {
        if edge.is_below(which) { &self.below } else { &self.here }
    }

    /// Cuts the polygon of four cells' corners, and of knots between them, into triangles.
    #[inline(always)]
    fn cut(
        &mut self,
        part: usize,
        [p, q, r, s]: [u32; 4],
        [pq, qr, rs, sp]: [Option<u32>; 4],
        [is_across, reversed]: [bool; 2],
    ) -> io::Result<()> {
        let halves = if is_across {
            [(q, qr, r, rs, s), (s, sp, p, pq, q)]
        } else {
            [(p, pq, q, qr, r), (r, rs, s, sp, p)]
        };
        for (a, ab, b, bc, c) in halves {
            let triangles = match (ab, bc) {
                (None, None) => [Some([a, b, c]), None, None],
                (Some(ab), None) => [Some([ab, b, c]), Some([a, ab, c]), None],
                (None, Some(bc)) => [Some([a, b, bc]), Some([a, bc, c]), None],
                (Some(ab), Some(bc)) => [Some([ab, b, bc]), Some([a, ab, bc]), Some([a, bc, c])],
            };
            for [x, y, z] in triangles.into_iter().flatten() {
                self.parts.triangle(part, if reversed { [x, z, y] } else { [x, y, z] })?;
            }
        }
        Ok(())
    }

    /// The vertex of a knot for a label.
    #[inline(never)]
    fn knot(&mut self, edge: &Edge, side: usize, knot: Knot, label: u16) -> io::Result<u32> {
        if let Some(known) = self.knots.get(&(knot, label)) {
            return Ok(*known);
        }
        let (across, cell, corner) = knot;
        let mut within = corner_at(corner).map(|c| c * self.placing.knot());
        within[across] = -0.5;
        let normals = Edge::sides(side).map(|which| {
            let share = self.layer_of(edge, which).share(&edge.around[which], label);
            share.map_or([0.0; 3], |share| share.normal)
        });
        let normal = unit(std::array::from_fn(|a| normals[0][a] + normals[1][a]));
        let number = self.parts.vertex(usize::from(label) - 1, &[self.mm(cell, within), normal])?;
        self.knots.insert((knot, label), number);
        Ok(number)
    }
}
