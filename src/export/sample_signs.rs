//! Samples of a slice that are inside, a bit for each.
//!
//! The samples of a model of voxels are the voxels' middles. Cells lie between samples: sample `x` touches the cells
//! `x` and `x + 1` along each axis.
//!
//! Boxes that are not skin are outside or inside. Cells may decide it by themselves: a side of a cell that is next to
//! the inside lies behind its surface (SPEC 4.8), so a run between two cells is outside if one of these sides does not.
//! If both do, a corner must lie so deep that it cannot be an outside corner that is covered, or the normals must not
//! point into the run, or a neighbouring run is inside; and neighbouring runs must agree. Otherwise, and between
//! voxels, all normals around decide ([`Sweep`]).

use super::bits::{Bits, any, set};
use crate::format::cell::{CORNERS, HAS_CORNERS, at_corner};
use crate::format::normal;
use crate::interior::{LeafCell, Rows, Side, SkinVoxel, Sweep};
use crate::load::{CellItems, ModelView, NodeView};

/// The corners of a cell at its low and its high side along x.
const LOW_SIDE: u8 = 0b0101_0101;
const HIGH_SIDE: u8 = 0b1010_1010;

/// A skin voxel, or a cell, of a row.
#[derive(Clone, Copy, Debug)]
pub(super) struct Item {
    pub(super) number: u64,
    pub(super) x: u32,
    /// Code of the normal, and offset of the plane; for cells only.
    pub(super) code: u16,
    pub(super) offset: i8,
}

/// The boxes around a model's skin, one more at every side.
#[derive(Clone, Copy, Debug)]
pub(super) struct Extent {
    /// The first boxes of the skin.
    pub(super) low: [u32; 2],
    pub(super) width: u32,
    pub(super) height: usize,
}

/// A slice of boxes: skin, and the sides of everything else.
#[derive(Debug)]
pub(super) struct Boxes {
    extent: Extent,
    pub(super) items: Rows<Item>,
    /// Boxes outside, without the skin.
    outside: Bits,
    inside: Bits,
    /// For cells: the samples of either side that touch a box outside, and a box inside.
    touched: [Bits; 2],
    /// For cells: the samples below and above that lie in front of a surface.
    front: [Bits; 2],
}

impl Boxes {
    /// An empty slice, with every box undecided.
    pub(super) fn new(extent: Extent) -> Self {
        let bits = || Bits::new(extent.width, extent.height);
        Self {
            extent,
            items: Rows::default(),
            outside: bits(),
            inside: bits(),
            touched: [bits(), bits()],
            front: [bits(), bits()],
        }
    }

    /// Takes a slice, its skin in rows. `votes` has the sides of all other boxes; without it the cells must decide.
    /// `None` if they do not.
    pub(super) fn take(
        &mut self,
        view: &ModelView<'_>,
        skin: &[SkinVoxel],
        below: &Self,
        votes: Option<&Sweep>,
    ) -> Option<()> {
        let Extent { low, height, .. } = self.extent;
        self.items.clear();
        self.front.iter_mut().for_each(|bits| bits.fill(0));
        let mut rest = skin;
        for row in 0..height {
            let y = (low[1] as usize + row).wrapping_sub(1);
            let here = rest.iter().take_while(|found| found.y as usize == y).count();
            let (now, later) = rest.split_at(here);
            rest = later;
            self.row(view, row, now, below, votes)?;
        }
        Some(())
    }

    /// Takes a row.
    fn row(
        &mut self,
        view: &ModelView<'_>,
        row: usize,
        skin: &[SkinVoxel],
        below: &Self,
        votes: Option<&Sweep>,
    ) -> Option<()> {
        let Self { extent, items, outside, inside, front, .. } = self;
        let above = row.saturating_sub(1);
        inside.row_mut(row).fill(0);
        outside.row_mut(row).fill(0);
        if let Some(sweep) = votes {
            let runs = sweep.last().runs.row(row).iter().filter(|run| sweep.side(**run) == Side::Inside);
            runs.for_each(|run| set(inside.row_mut(row), run.start, run.end));
        }
        let cells = view.cells();
        let stride = outside.stride();
        let mut last = Cell { x: 0, corners: 0, normal: [0; 3], offset: 0 };
        for found in skin {
            let (x, number) = (found.x - extent.low[0] + 1, found.voxel.get());
            set(outside.row_mut(row), x, x + 1);
            let Some(cells) = cells else {
                items.push(Item { number, x, code: 0, offset: 0 });
                continue;
            };
            let code = found.code(view).unwrap_or(0);
            let n = normal::decode_l1(code);
            let (offset, corners) = corners_of(&cells, found, n);
            let stored = found.leaf.map_or_else(|| cells.offset(number), LeafCell::clamped);
            items.push(Item { number, x, code, offset: stored });
            for (bits, high) in front.iter_mut().zip([0, 4]) {
                let rows = bits.two_rows_mut(above);
                mark(rows, x - 1, !corners >> high);
                mark(&mut rows[stride..], x - 1, !corners >> high >> 2);
            }
            let before = std::mem::replace(&mut last, Cell { x, corners, normal: n, offset });
            if votes.is_none() && x > before.x + 1 && before.covers(HIGH_SIDE) && last.covers(LOW_SIDE) {
                let start = before.x + 1;
                let is_sure = (before.normal[0] <= 0 && n[0] >= 0)
                    || before.is_deep(HIGH_SIDE)
                    || last.is_deep(LOW_SIDE)
                    || any(inside.row(above), start, x)
                    || any(below.inside.row(row), start, x);
                if !is_sure {
                    return None;
                }
                set(inside.row_mut(row), start, x);
            }
        }
        items.end_row();
        self.end_row(row, below, votes.is_none())
    }

    /// Completes a row from the one before: boxes outside, and touched samples. `None` if runs disagree and must not.
    fn end_row(&mut self, row: usize, below: &Self, must_agree: bool) -> Option<()> {
        let Self { extent, outside, inside, touched, .. } = self;
        let mut disagree = 0;
        let above = row.saturating_sub(1);
        for at in 0..outside.stride() {
            let within = inside.row(row)[at];
            let without = !(outside.row(row)[at] | within) & first_bits(at, extent.width);
            outside.row_mut(row)[at] = without;
            disagree |= within & (below.outside.row(row)[at] | outside.row(above)[at])
                | without & (below.inside.row(row)[at] | inside.row(above)[at]);
        }
        if row > 0 {
            for (touched, bits) in touched.iter_mut().zip([outside, inside]) {
                let mut later = 0;
                let (one, other) = (bits.row(row - 1), bits.row(row));
                for (at, touched) in touched.row_mut(row - 1).iter_mut().enumerate().rev() {
                    let both = one[at] | other[at];
                    *touched = both | both >> 1 | later << 63;
                    later = both;
                }
            }
        }
        (disagree == 0 || !must_agree).then_some(())
    }

    /// The samples of a slice of voxels: skin is inside.
    pub(super) fn of_voxels(&self, skin_only: bool, samples: &mut Bits) {
        let Extent { width, height, .. } = self.extent;
        for row in 0..height {
            let (outside, inside) = (self.outside.row(row), self.inside.row(row));
            for (at, sample) in samples.row_mut(row).iter_mut().enumerate() {
                let not = outside[at] | if skin_only { inside[at] } else { 0 };
                *sample = !not & first_bits(at, width);
            }
        }
    }

    /// The samples between this slice of cells and the next; row `y` lies between the cells' rows `y` and `y + 1`.
    ///
    /// A sample behind the surfaces of all cells around it is inside; where it touches boxes without a surface, these
    /// decide, the outside ones first.
    pub(super) fn of_cells(&self, next: &Self, samples: &mut Bits) {
        let Extent { width, height, .. } = self.extent;
        for row in 0..height - 1 {
            let both = |bits: fn(&Self) -> &Bits| [bits(self).row(row), bits(next).row(row)];
            let (outside, inside) = (both(|boxes| &boxes.touched[0]), both(|boxes| &boxes.touched[1]));
            let front = [self.front[1].row(row), next.front[0].row(row)];
            for (at, sample) in samples.row_mut(row).iter_mut().enumerate() {
                let [outside, inside, front] =
                    [outside, inside, front].map(|[one, other]| one[at] | other[at]);
                *sample = !outside & (inside | !front) & first_bits(at, width - 1);
            }
        }
    }
}

/// A cell next to a run of boxes.
struct Cell {
    x: u32,
    /// Corners that are inside, as bits.
    corners: u8,
    normal: [i32; 3],
    offset: i32,
}

/// The offset of a cell that has corners.
const SAMPLED: i32 = HAS_CORNERS as i32;

impl Cell {
    /// True if the side lies behind the surface.
    #[inline(always)]
    fn covers(&self, side: u8) -> bool {
        self.corners & side == side
    }

    /// True if a corner of the side is farther behind the plane than an outside corner may be (SPEC 4.8). Corners by
    /// samples are always right.
    #[cold]
    fn is_deep(&self, side: u8) -> bool {
        let square = self.normal.iter().map(|c| c * c).sum::<i32>();
        let is_deep = |corner: usize| {
            let depth = self.offset - at_corner(self.normal, corner);
            depth > 0 && depth * depth > square
        };
        self.offset == SAMPLED || (0..CORNERS).any(|corner| side >> corner & 1 == 1 && is_deep(corner))
    }
}

/// Mask of the bits in use in a word of a row with so many bits.
fn first_bits(word: usize, used: u32) -> u64 {
    match (used as usize).checked_sub(64 * word) {
        Some(left) if left >= 64 => u64::MAX,
        Some(left) => (1 << left) - 1,
        None => 0,
    }
}

/// Sets the samples at `x` and after it by the two low bits.
#[inline(always)]
fn mark(row: &mut [u64], x: u32, pair: u8) {
    let (at, bits) = (x as usize / 64, u64::from(pair & 3));
    row[at] |= bits << (x % 64);
    if x % 64 == 63 {
        row[at + 1] |= bits >> 1;
    }
}

/// The offset of a cell's plane, and its corners that are inside, as bits.
#[inline(always)]
fn corners_of(cells: &CellItems<'_>, found: &SkinVoxel, normal: [i32; 3]) -> (i32, u8) {
    let offset = found.offset(cells).into();
    if found.leaf.is_none() && offset == SAMPLED {
        let samples = cells.corners(found.voxel.get());
        return (offset, bits(|corner| samples[corner] > 0));
    }
    (offset, bits(|corner| at_corner(normal, corner) <= offset))
}

/// A bit for each corner.
#[inline(always)]
fn bits(is_inside: impl Fn(usize) -> bool) -> u8 {
    (0..CORNERS).fold(0, |bits, corner| bits | u8::from(is_inside(corner)) << corner)
}
