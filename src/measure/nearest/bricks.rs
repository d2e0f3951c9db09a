//! The facets of 4 x 4 x 4 cells at once, kept decoded: neighbouring points ask for the same ones.
//!
//! Cells of a node two levels above them have numbers in a row, in Morton order, so that a bit for each place and the first
//! number are enough to find all of them.

use super::tree::NodePath;
use super::{Facet, OctreeBox, Surface};
use crate::geom::BoxIndex;
use crate::load::NodeView;

/// Bricks that are kept: 4 x 4 x 4 neighbours have different places.
const KEPT: usize = 64;

/// Levels of a brick.
pub(super) const LEVELS: u32 = 2;

/// Bits of the cells whose coordinate along an axis is at least so much.
const FROM: [[u64; 4]; 3] = {
    let mut masks = [[0; 4]; 3];
    let mut v = 0;
    while v < 64 {
        let mut a = 0;
        while a < 3 {
            let at = (v >> a & 1) | (v >> (a + 3) & 1) << 1;
            let mut least = 0;
            while least <= at {
                masks[a][least] |= 1 << v;
                least += 1;
            }
            a += 1;
        }
        v += 1;
    }
    masks
};

/// The cells of a brick within a range of cells that meets it.
#[inline]
fn within(brick: [u32; 3], [first, last]: [[u32; 3]; 2]) -> u64 {
    (0..3).fold(u64::MAX, |mask, a| {
        let low = brick[a] << LEVELS;
        let from = FROM[a][first[a].saturating_sub(low).min(3) as usize];
        let beyond = (last[a] - low + 1).min(4);
        mask & from & !FROM[a].get(beyond as usize).copied().unwrap_or(0)
    })
}

/// Place of a cell within its brick, in Morton order.
#[inline]
fn place_in(cell: [u32; 3]) -> u32 {
    (0..3).fold(0, |v, a| v | (cell[a] & 1) << a | (cell[a] >> 1 & 1) << (a + 3))
}

/// A brick.
#[derive(Clone, Debug)]
struct Brick {
    /// Its low cell, in bricks.
    at: [u32; 3],
    /// A bit for each cell that is there, and for each of those that has corners.
    cells: u64,
    corners: u64,
    first: u64,
    /// Cells before each place, for places with a cell.
    ranks: [u8; 64],
    /// Number of the first facet of each cell, and of their end.
    starts: Vec<u16>,
    facets: Vec<(u8, Facet)>,
}

impl Brick {
    /// A brick outside every grid.
    const NOWHERE: Self = Self {
        at: [u32::MAX; 3],
        cells: 0,
        corners: 0,
        first: 0,
        ranks: [0; 64],
        starts: Vec::new(),
        facets: Vec::new(),
    };

    /// Decodes a brick, which may be empty.
    #[expect(clippy::cast_possible_truncation, reason = "at most 8 facets of 64 cells")]
    fn fill(&mut self, surface: &Surface<'_>, way: &mut NodePath, at: [u32; 3]) {
        (self.at, self.cells, self.corners) = (at, 0, 0);
        self.starts.clear();
        self.facets.clear();
        let Some(place) = way.go(surface, at.map(|c| c << LEVELS), LEVELS) else { return };
        let node = place.number.node();
        let below = surface.view.first_child(node).node();
        let (mut octants, mut infobytes) = (surface.view.infobyte(node), surface.view.infobytes(below));
        while octants != 0 {
            self.cells |= (infobytes & 0xff) << (8 * octants.trailing_zeros());
            (octants, infobytes) = (octants & (octants - 1), infobytes >> 8);
        }
        self.first = surface.view.first_child(below).get();
        way.pages.read(1, below.get());
        way.pages.read(0, self.first);
        let mut rest = self.cells;
        while rest != 0 {
            let v = rest.trailing_zeros();
            rest &= rest - 1;
            self.ranks[v as usize & 63] = self.starts.len() as u8;
            let place = self.place(v);
            self.starts.push(self.facets.len() as u16);
            if surface.has_corners(place) {
                self.corners |= 1 << v;
            }
            surface.facets(place, |part, facet| self.facets.push((part, facet)));
        }
        self.starts.push(self.facets.len() as u16);
    }

    /// Cells before a place with a cell.
    #[inline]
    fn before(&self, v: u32) -> u8 {
        self.ranks[v as usize & 63]
    }

    /// The cell at a place.
    #[inline]
    fn place(&self, v: u32) -> OctreeBox {
        let low = std::array::from_fn(|a| self.at[a] << LEVELS | (v >> a & 1) | (v >> (a + 3) & 1) << 1);
        OctreeBox { number: BoxIndex::new(self.first + u64::from(self.before(v))), low, level: 0 }
    }

    /// The facets of a cell that is there.
    #[inline]
    fn facets(&self, v: u32) -> &[(u8, Facet)] {
        let at = usize::from(self.before(v));
        let range =
            self.starts.get(at..at + 2).map_or(0..0, |ends| usize::from(ends[0])..usize::from(ends[1]));
        self.facets.get(range).unwrap_or_default()
    }
}

/// A cell of a brick that is kept, with its facets.
#[derive(Clone, Copy, Debug)]
pub(super) struct Kept<'b> {
    pub(super) place: OctreeBox,
    pub(super) has_corners: bool,
    pub(super) facets: &'b [(u8, Facet)],
}

/// The bricks of a surface that were asked for last.
///
/// Memory: 200 KiB where most cells have planes.
#[derive(Clone, Debug, Default)]
pub(super) struct Bricks(Vec<Brick>);

impl Bricks {
    #[inline]
    fn brick(&mut self, surface: &Surface<'_>, way: &mut NodePath, at: [u32; 3]) -> &Brick {
        let slot = (at[0] & 3 | (at[1] & 3) << 2 | (at[2] & 3) << 4) as usize;
        if self.0.is_empty() {
            self.0.resize(KEPT, Brick::NOWHERE);
        }
        let brick = &mut self.0[slot];
        if brick.at != at {
            brick.fill(surface, way, at);
        }
        brick
    }

    /// A cell, if it is there.
    #[inline]
    pub(super) fn cell(
        &mut self,
        surface: &Surface<'_>,
        way: &mut NodePath,
        cell: [u32; 3],
    ) -> Option<Kept<'_>> {
        let brick = self.brick(surface, way, cell.map(|c| c >> LEVELS));
        let v = place_in(cell);
        let has_corners = brick.corners >> v & 1 == 1;
        (brick.cells >> v & 1 == 1).then(|| Kept {
            place: brick.place(v),
            has_corners,
            facets: brick.facets(v),
        })
    }

    /// Hands over the cells of a range.
    #[inline]
    pub(super) fn range(
        &mut self,
        surface: &Surface<'_>,
        way: &mut NodePath,
        range: [[u32; 3]; 2],
        mut each: impl FnMut(Kept<'_>),
    ) {
        let [first, last] = range.map(|cell| cell.map(|c| c >> LEVELS));
        for z in first[2]..=last[2] {
            for y in first[1]..=last[1] {
                for x in first[0]..=last[0] {
                    let brick = self.brick(surface, way, [x, y, z]);
                    let mut rest = brick.cells & within(brick.at, range);
                    while rest != 0 {
                        let v = rest.trailing_zeros();
                        rest &= rest - 1;
                        let has_corners = brick.corners >> v & 1 == 1;
                        each(Kept { place: brick.place(v), has_corners, facets: brick.facets(v) });
                    }
                }
            }
        }
    }
}
