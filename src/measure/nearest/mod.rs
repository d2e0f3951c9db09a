//! The nearest point of a model's surface, and the side of it that a point lies on.
//!
//! ```text
//!   cell with a plane, larger leaf --> one facet
//!   cell with corners -------------> up to eight: each octant with the linear fit to its eight interpolated values
//! ```
//!
//! A [`Surface`] is a model of cells in its orthonormal frame ([`Space`]); a [`Search`] asks it for one point after the
//! other. An answer depends on the point and the surface only: facets that are as near go by their number and part.
//!
//! | part | what it holds |
//! |---|---|
//! | [`facet`] | a plane clipped to its box: bound, nearest point, area |
//! | [`space`] | the frame |
//! | [`tree`] | the search: from the last answer's cell, nearest child first |
//! | [`samples`] | the places that stand for cells, a block at once |
//! | [`bricks`] | decoded facets of the bricks that were asked last |
//! | [`side`] | inside or outside |
//! | [`overlap`] | how far two bodies overlap, or are apart |

mod bricks;
mod facet;
mod overlap;
mod samples;
mod side;
mod space;
#[cfg(test)]
mod tests;
mod tree;

pub(crate) use facet::Facet;
pub(crate) use overlap::Gap;
pub(crate) use samples::{BLOCK, Sample};
pub(crate) use side::Side;
pub(crate) use space::Space;
pub(crate) use tree::{Found, Query, Search};

use crate::fault::{Fault, unfit};
use crate::format::cell::CORNERS;
use crate::geom::{Affine, BoxIndex, Dims};
use crate::load::{CellItems, CellShape, Model, ModelView, NodeView};
use crate::text::names::{LABELS, SURFACE};

/// A distance below this many voxels is 0: there the side is rounding.
pub(crate) const ON: f64 = 1e-9;

/// A box of the octree: number, lowest cell, and base-2 logarithm of its edge in cells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct OctreeBox {
    pub(crate) number: BoxIndex,
    pub(crate) low: [u32; 3],
    pub(crate) level: u32,
}

/// The surface of a model of cells.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Surface<'a> {
    pub(crate) view: &'a ModelView<'a>,
    cells: CellItems<'a>,
    pub(crate) space: Space,
    /// Cells along each axis.
    pub(crate) dims: [u32; 3],
    /// Models of which searches give pages back.
    models: &'a [&'a Model],
}

impl<'a> Surface<'a> {
    /// The surface of a model; `affine` leads from the index of a cell (its middle at integers) to LPS mm.
    ///
    /// # Errors
    /// A model without cells or with several labels; a frame that [`Space::new`] refuses.
    pub(crate) fn open(view: &'a ModelView<'a>, affine: &Affine, dims: Dims) -> Result<Self, Fault> {
        let Some(cells) = view.cells() else {
            return Err(unfit!(
                "is a skin of voxels, which is too coarse to measure; build it with {SURFACE} cells"
            ));
        };
        if cells.has_walls() {
            return Err(unfit!(
                "has several labels, and one alone can be measured; build it by itself ({LABELS})"
            ));
        }
        Ok(Self { view, cells, space: Space::new(affine)?, dims: dims.to_array(), models: &[] })
    }

    /// The same surface, of which searches give pages of these models back where they have read many.
    pub(crate) fn relieved(self, models: &'a [&'a Model]) -> Self {
        Self { models, ..self }
    }

    /// A search that starts anywhere.
    pub(crate) fn search(&self) -> Search<'a> {
        Search::new(*self)
    }

    /// True for a larger leaf.
    #[inline]
    fn is_leaf(&self, place: OctreeBox) -> bool {
        place.level > 0 && self.view.has_leaves() && self.view.is_leaf(place.number.node())
    }

    /// Number of a cell.
    #[inline]
    pub(crate) fn cell(&self, number: BoxIndex) -> u64 {
        number.voxel(self.view.node_count()).get()
    }

    /// Middle and half edges of a box.
    #[inline]
    fn middle(&self, low: [u32; 3], level: u32) -> ([f64; 3], [f64; 3]) {
        let half = f64::from(1_u32 << level) / 2.0;
        let spacing = self.space.spacing;
        (std::array::from_fn(|a| (f64::from(low[a]) + half) * spacing[a]), spacing.map(|s| half * s))
    }

    /// The plane in a box.
    #[inline]
    fn facet(&self, low: [u32; 3], level: u32, normal: [i32; 3], offset: f64) -> Facet {
        let (middle, half) = self.middle(low, level);
        let halves = 2.0 / f64::from(1_u32 << level);
        Facet::new(middle, [half, self.space.per_mm.map(|c| halves * c)], normal, offset)
    }

    /// The surface in a cell or a larger leaf, facet by facet with the number of its part.
    #[inline]
    pub(crate) fn facets(&self, place: OctreeBox, mut each: impl FnMut(u8, Facet)) {
        let OctreeBox { low, level, .. } = place;
        match self.shape(place) {
            CellShape::Plane(plane) => {
                each(0, self.facet(low, level, plane.normal, f64::from(plane.offset)));
            }
            CellShape::Corners(corners) => {
                let (middle, half) = self.middle(low, level);
                octants(&corners, middle, [half, self.space.per_mm.map(|c| 2.0 * c)], each);
            }
        }
    }

    /// The surface in a cell or a larger leaf.
    #[inline]
    fn shape(&self, OctreeBox { number, level, .. }: OctreeBox) -> CellShape {
        match level {
            0 => self.cells.shape(self.cell(number)),
            _ => CellShape::Plane(self.view.leaf_plane(number.node())),
        }
    }

    /// The place of a cell, by its number and index.
    pub(crate) fn cell_place(&self, cell: u64, low: [u32; 3]) -> OctreeBox {
        OctreeBox { number: BoxIndex::new(self.view.node_count().saturating_add(cell)), low, level: 0 }
    }

    /// True for a cell with corners, whose surface may be two sheets.
    #[inline]
    fn has_corners(&self, place: OctreeBox) -> bool {
        place.level == 0 && self.cells.plane(self.cell(place.number)).is_none()
    }

    /// True for a cell at the border of the volume.
    pub(crate) fn touches_border(&self, cell: [u32; 3]) -> bool {
        (0..3).any(|a| cell[a] == 0 || cell[a] + 1 >= self.dims[a])
    }

    /// True where a place of the frame lies in a cell at the border of the volume, whose surface may be a cap of the build.
    pub(crate) fn is_border(&self, at: [f64; 3]) -> bool {
        (0..3).any(|a| {
            let cell = at[a] * self.space.per_mm[a];
            cell < 1.0 || cell >= f64::from(self.dims[a].saturating_sub(1))
        })
    }
}

/// The facets of a cell with corners.
#[inline(never)]
#[expect(clippy::cast_possible_truncation, reason = "numbers of corners")]
fn octants(
    corners: &[i8; CORNERS],
    middle: [f64; 3],
    [half, per_mm]: [[f64; 3]; 2],
    mut each: impl FnMut(u8, Facet),
) {
    let (small, per_mm) = (half.map(|h| h / 2.0), per_mm.map(|c| 2.0 * c));
    // Of the values at two corners and midway: the sums of the low two and of the high two, and what both fall by.
    let along = |a: i32, b: i32| [3 * a + b, a + 3 * b, a - b];
    let mut sums = [[[0; 3]; 3]; 3];
    let rows = [0, 2, 4, 6].map(|c: usize| along(i32::from(corners[c]), i32::from(corners[c + 1])));
    for x in 0..3 {
        let [near, far] = [0, 2].map(|r| along(rows[r][x], rows[r + 1][x]));
        for y in 0..3 {
            sums[x][y] = along(near[y], far[y]);
        }
    }
    for octant in 0..CORNERS as u8 {
        let [x, y, z] = [0, 1, 2].map(|a| usize::from(octant >> a & 1));
        // Sums over the eight corners of the octant.
        let (total, falls) = (sums[x][y][z], [sums[2][y][z], sums[x][2][z], sums[x][y][2]]);
        if total.abs() < falls.iter().map(|f| f.abs()).sum() {
            let at =
                std::array::from_fn(|a| middle[a] + if octant >> a & 1 == 1 { small[a] } else { -small[a] });
            each(octant, Facet::new(at, [small, per_mm], falls, f64::from(total)));
        }
    }
}
