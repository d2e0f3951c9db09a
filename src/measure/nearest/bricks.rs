//! Bricks of 4 x 4 x 4 cells, whose facets are kept once they are decoded: neighbouring points ask for the same ones.
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
    /// A bit for each cell that is there, and for each of those that is decoded.
    cells: u64,
    decoded: u64,
    first: u64,
    places: [Place; 64],
    facets: Vec<(u8, Facet)>,
}

/// A cell that is decoded: the cells before it, and its facets.
#[derive(Clone, Copy, Debug, Default)]
struct Place {
    before: u8,
    has_corners: bool,
    start: u16,
    end: u16,
}

impl Brick {
    /// A brick outside every grid.
    const NOWHERE: Self = Self {
        at: [u32::MAX; 3],
        cells: 0,
        decoded: 0,
        first: 0,
        places: [Place { before: 0, has_corners: false, start: 0, end: 0 }; 64],
        facets: Vec::new(),
    };

    /// Finds the cells of a brick, which may have none.
    #[inline(never)]
    fn fill(&mut self, surface: &Surface<'_>, way: &mut NodePath<'_>, at: [u32; 3]) {
        (self.at, self.cells, self.decoded) = (at, 0, 0);
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
    }

    /// Decodes cells that are not decoded yet, before any is asked for: each waits for its own division and root, but not for
    /// the others.
    #[inline]
    fn decode_all(&mut self, surface: &Surface<'_>, cells: u64) {
        let mut missing = cells & !self.decoded;
        while missing != 0 {
            self.decode(surface, missing.trailing_zeros());
            missing &= missing - 1;
        }
    }

    /// Decodes a cell that is there.
    #[expect(clippy::cast_possible_truncation, reason = "at most 8 facets of 64 cells")]
    fn decode(&mut self, surface: &Surface<'_>, v: u32) {
        let before = (self.cells & ((1 << v) - 1)).count_ones() as u8;
        let start = self.facets.len() as u16;
        let place = self.place(v, before);
        surface.facets(place, |part, facet| self.facets.push((part, facet)));
        let (has_corners, end) = (surface.has_corners(place), self.facets.len() as u16);
        self.places[v as usize & 63] = Place { before, has_corners, start, end };
        self.decoded |= 1 << v;
    }

    /// The cell at a place, with so many before it.
    #[inline]
    fn place(&self, v: u32, before: u8) -> OctreeBox {
        let low = std::array::from_fn(|a| self.at[a] << LEVELS | (v >> a & 1) | (v >> (a + 3) & 1) << 1);
        OctreeBox { number: BoxIndex::new(self.first + u64::from(before)), low, level: 0 }
    }
}

/// A cell of a brick that is kept.
#[derive(Clone, Copy, Debug)]
pub(super) struct Kept<'b> {
    brick: &'b Brick,
    v: u32,
}

impl<'b> Kept<'b> {
    fn decoded(self) -> Place {
        self.brick.places[self.v as usize & 63]
    }

    #[inline]
    pub(super) fn number(self) -> BoxIndex {
        BoxIndex::new(self.brick.first + u64::from(self.decoded().before))
    }

    #[inline]
    pub(super) fn place(self) -> OctreeBox {
        self.brick.place(self.v, self.decoded().before)
    }

    #[inline]
    pub(super) fn facets(self) -> &'b [(u8, Facet)] {
        let Place { start, end, .. } = self.decoded();
        self.brick.facets.get(usize::from(start)..usize::from(end)).unwrap_or_default()
    }

    /// The only facet of a cell without corners.
    #[inline]
    pub(super) fn plane(self) -> Option<&'b Facet> {
        match self.facets() {
            [(_, facet)] if !self.decoded().has_corners => Some(facet),
            _ => None,
        }
    }
}

/// The bricks of a surface that were asked for last.
///
/// Memory: 200 KiB where most cells have planes.
#[derive(Clone, Debug, Default)]
pub(super) struct Bricks(Vec<Brick>);

impl Bricks {
    #[inline(always)]
    fn brick(&mut self, surface: &Surface<'_>, way: &mut NodePath<'_>, at: [u32; 3]) -> &mut Brick {
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
        way: &mut NodePath<'_>,
        cell: [u32; 3],
    ) -> Option<Kept<'_>> {
        let brick = self.brick(surface, way, cell.map(|c| c >> LEVELS));
        let v = place_in(cell);
        brick.decode_all(surface, brick.cells & 1 << v);
        (brick.cells >> v & 1 == 1).then_some(Kept { brick, v })
    }

    /// Hands over the cells of a range.
    #[inline]
    pub(super) fn range(
        &mut self,
        surface: &Surface<'_>,
        way: &mut NodePath<'_>,
        range: [[u32; 3]; 2],
        mut each: impl FnMut(Kept<'_>),
    ) {
        let [first, last] = range.map(|cell| cell.map(|c| c >> LEVELS));
        for z in first[2]..=last[2] {
            for y in first[1]..=last[1] {
                for x in first[0]..=last[0] {
                    let brick = self.brick(surface, way, [x, y, z]);
                    let mut rest = brick.cells & within(brick.at, range);
                    brick.decode_all(surface, rest);
                    while rest != 0 {
                        each(Kept { brick, v: rest.trailing_zeros() });
                        rest &= rest - 1;
                    }
                }
            }
        }
    }
}
