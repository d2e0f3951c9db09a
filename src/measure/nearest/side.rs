//! The side of a surface that a point lies on.
//!
//! | rule | where |
//! |---|---|
//! | 1 | nearer than 1e-9 voxel: on it |
//! | 2 | in a cell or a larger leaf: its plane, or its interpolation, says |
//! | 3 | the nearest facet is of a plane and the way to it runs along its normal: the normal says |
//! | 4 | else the first cell along each of the six axes: inside only if all six exist, and their four corners towards the point lie behind their surface (SPEC 4.8) |
//!
//! The normal alone errs at edges and in noise, by as much as the distance; ways to a centroid meet the steps between cells.

use crate::format::cell::{CORNERS, at_corner};
use crate::geom::{BoxIndex, Octant, dot};
use crate::load::{CellShape, NodeView, PlanePart};

use super::tree::{ALONG, Pages};
use super::{Found, ON, OctreeBox, Search, Surface};

/// Cosine of the angle between the normals of face neighbours from which on there is a sharp edge: 11.5 degrees, where an
/// arc has a radius of 5 voxels. Cells of bodies with less lie within 0.05 voxel of them, and with more up to 0.45.
const BEND: f64 = 0.98;

/// Where a point lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Side {
    On,
    Inside,
    Outside,
}

impl Side {
    fn of(is_inside: bool) -> Self {
        if is_inside { Self::Inside } else { Self::Outside }
    }

    /// Factor of a distance: positive outside.
    pub(crate) fn sign(self) -> f64 {
        match self {
            Self::On => 0.0,
            Self::Inside => -1.0,
            Self::Outside => 1.0,
        }
    }
}

impl Search<'_> {
    /// The side of a point of the frame whose nearest point is known.
    pub(crate) fn side(&mut self, point: [f64; 3], found: &Found) -> Side {
        let surface = self.surface;
        if found.square < (ON * surface.space.finest).powi(2) {
            return Side::On;
        }
        let Some(cell) = surface.cell_at(point) else { return Side::Outside };
        if let Some(is_behind) = self.behind_own(cell, point) {
            return Side::of(is_behind);
        }
        if found.height.abs() > ALONG * found.distance() && !surface.has_corners(found.place) {
            return Side::of(found.height < 0.0);
        }
        let root = OctreeBox { number: BoxIndex::ROOT, low: [0; 3], level: surface.view.depth() };
        let pages = self.pages();
        Side::of((0..3).all(|axis| {
            [false, true]
                .into_iter()
                .all(|up| surface.first_along(pages, root, (cell, axis, up)) == Some(true))
        }))
    }

    /// Signed distance in mm: positive outside, 0 on the surface.
    pub(crate) fn signed(&mut self, point: [f64; 3], found: &Found) -> f64 {
        match self.side(point, found) {
            Side::On => 0.0,
            side => side.sign() * found.distance(),
        }
    }
}

impl Surface<'_> {
    /// The cell of the grid that a place of the frame lies in.
    pub(super) fn cell_at(&self, point: [f64; 3]) -> Option<[u32; 3]> {
        let cell: [f64; 3] = std::array::from_fn(|a| point[a] * self.space.per_mm[a]);
        let is_within = (0..3).all(|a| cell[a] >= 0.0 && cell[a] < f64::from(self.dims[a]));
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "within the grid")]
        is_within.then(|| cell.map(|c| c as u32))
    }

    /// The cell or larger leaf that holds a cell of the grid. Cost: a step a level.
    fn holder(&self, cell: [u32; 3]) -> Option<OctreeBox> {
        let depth = self.view.depth();
        let mut place = OctreeBox { number: BoxIndex::ROOT, low: [0; 3], level: depth };
        (cell.iter().all(|c| u64::from(*c) < 1 << depth)).then_some(())?;
        while place.level > 0 && !self.is_leaf(place) {
            let level = place.level - 1;
            let high = cell.map(|c| c >> level & 1);
            let octant = Octant::low_bits(high[0] | high[1] << 1 | high[2] << 2);
            let number = self.view.child(place.number.node(), octant)?;
            place = OctreeBox { number, low: cell.map(|c| c >> level << level), level };
        }
        Some(place)
    }

    /// True if the surface turns by more than [`BEND`] between a cell and a face neighbour, as it does at a sharp edge, which
    /// cells cut off.
    pub(crate) fn is_at_edge(&self, place: OctreeBox) -> bool {
        let own = self.sample(place).normal;
        (0..3).flat_map(|axis| [(axis, 1 << place.level), (axis, u32::MAX)]).any(|(axis, step)| {
            let mut cell = place.low;
            cell[axis] = cell[axis].wrapping_add(step);
            self.holder(cell).is_some_and(|next| dot(own, self.sample(next).normal) < BEND)
        })
    }

    /// True if a point of a cell, or of a larger leaf, is behind the surface in it.
    pub(super) fn is_behind(&self, place: OctreeBox, point: [f64; 3]) -> bool {
        if place.level == 0
            && let CellShape::Corners(corners) = self.cells.shape(self.cell(place.number))
        {
            let at: [f64; 3] =
                std::array::from_fn(|a| point[a] / self.space.spacing[a] - f64::from(place.low[a]));
            let weight = |c: usize, a: usize| if c >> a & 1 == 1 { at[a] } else { 1.0 - at[a] };
            let value = (0..CORNERS)
                .fold(0.0, |sum, c| sum + weight(c, 0) * weight(c, 1) * weight(c, 2) * f64::from(corners[c]));
            return value >= 0.0;
        }
        let mut is_behind = false;
        self.facets(place, |_, facet| is_behind = facet.height(point) <= 0.0);
        is_behind
    }

    /// True if the side towards an empty cell of the first cell from there along an axis lies behind its surface; `None`
    /// if there is no cell in the box. The nearer half of a box goes first.
    fn first_along(
        &self,
        pages: &mut Pages<'_>,
        place: OctreeBox,
        line @ (from, axis, up): ([u32; 3], usize, bool),
    ) -> Option<bool> {
        pages.read(place.level, place.number.get());
        if place.level == 0 || self.is_leaf(place) {
            return Some(self.covers(place, from, axis, up));
        }
        let (node, level) = (place.number.node(), place.level - 1);
        [!up, up].into_iter().find_map(|is_high| {
            let high: [u32; 3] =
                std::array::from_fn(|a| if a == axis { u32::from(is_high) } else { from[a] >> level & 1 });
            let low: [u32; 3] = std::array::from_fn(|a| place.low[a] + (high[a] << level));
            let is_past = if up { low[axis] + (1 << level) <= from[axis] } else { low[axis] > from[axis] };
            let octant = Octant::low_bits(high[0] | high[1] << 1 | high[2] << 2);
            let number = (!is_past).then(|| self.view.child(node, octant))??;
            self.first_along(pages, OctreeBox { number, low, level }, line)
        })
    }

    /// True if the four corners of a cell that face a point lie behind its surface; a larger leaf counts by its cell next
    /// to that side.
    fn covers(&self, place: OctreeBox, from: [u32; 3], axis: usize, up: bool) -> bool {
        let mut facing = (0..CORNERS).filter(|corner| (corner >> axis & 1 == 1) != up);
        if place.level > 0 {
            let edge = 1_u32 << place.level;
            let plane = self.view.leaf_plane(place.number.node());
            let side = if up { 0 } else { edge - 1 };
            let at = std::array::from_fn(|a| if a == axis { side } else { from[a] - place.low[a] });
            let offset = PlanePart::of(plane).cell(edge, at).offset();
            return facing.all(|corner| at_corner(plane.normal, corner) <= offset);
        }
        match self.cells.shape(self.cell(place.number)) {
            CellShape::Plane(plane) => facing.all(|corner| at_corner(plane.normal, corner) <= plane.offset),
            CellShape::Corners(corners) => facing.all(|corner| corners[corner] > 0),
        }
    }
}
