//! Which samples of a slice are inside, as the places where rows change sides.
//!
//! The samples of a model of voxels are the middles of these. Cells lie between samples: sample `x` touches the cells
//! `x` and `x + 1` along each axis.

use crate::enclosed::{Rows, Side, Sweep};
use crate::format::cell::{CORNERS, at_corner};
use crate::load::{CellItems, CellShape};

/// Samples of a slice: in each row the first sample of every stretch, inside and outside in turns, from the first
/// inside one on.
pub(super) type Signs = Rows<u32>;

/// A stretch of boxes between skin, and where it lies.
#[derive(Clone, Copy, Debug)]
struct Stretch {
    start: u32,
    end: u32,
    side: Side,
}

/// A slice of boxes: skin, and where everything else lies.
#[derive(Debug, Default)]
pub(super) struct Boxes {
    /// Skin boxes: x and number.
    pub(super) skin: Rows<(u32, u64)>,
    runs: Rows<Stretch>,
    /// Length of the rows, where there is no skin: then all is outside, and rows are left out.
    void: Option<u32>,
}

impl Boxes {
    /// The slice that a sweep took last.
    pub(super) fn of(sweep: &Sweep) -> Self {
        let mut boxes = Self::default();
        let slice = sweep.last();
        if sweep.is_void() {
            boxes.void = Some(sweep.width());
            return boxes;
        }
        for row in 0..sweep.height() {
            slice.skin.row(row).iter().for_each(|item| boxes.skin.push((item.x, item.voxel.get())));
            for run in slice.runs.row(row) {
                boxes.runs.push(Stretch { start: run.start, end: run.end, side: sweep.side(*run) });
            }
            boxes.skin.end_row();
            boxes.runs.end_row();
        }
        boxes
    }

    /// The samples of a slice of voxels: skin is inside.
    pub(super) fn signs(&self, height: usize, skin_only: bool) -> Signs {
        let mut signs = Signs::default();
        if self.void.is_some() {
            return signs;
        }
        for row in 0..height {
            let mut outside = self.runs.row(row).iter().filter(|run| skin_only || run.side == Side::Outside);
            let mut inside_from = outside.next().map_or(0, |run| run.end);
            for run in outside {
                if run.start > inside_from {
                    signs.push(inside_from);
                    signs.push(run.start);
                }
                inside_from = run.end;
            }
            signs.end_row();
        }
        signs
    }
}

/// A statement about a stretch of samples. Later ones give way to earlier ones.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Claim {
    /// Touches what lies outside.
    Outside,
    /// Touches what lies inside.
    Inside,
    /// A cell's surface says that it is outside.
    InFront,
}

/// The samples between two slices of cells, in each row `y` those between the cells' rows `y` and `y + 1`.
///
/// A sample behind the surfaces of all the cells around is inside; where it touches cells without a surface, these
/// decide.
pub(super) fn signs_of_cells(below: &Boxes, above: &Boxes, items: CellItems<'_>, height: usize) -> Signs {
    let mut signs = Signs::default();
    if below.void.is_some() && above.void.is_some() {
        return signs;
    }
    let mut claims = Vec::new();
    for y in 0..height - 1 {
        claims.clear();
        for (boxes, z) in [(below, 0), (above, 1)] {
            claims.extend(boxes.void.map(|width| (0, width, Claim::Outside)));
            for (row, dy) in [(y, 0), (y + 1, 1)] {
                for run in boxes.runs.row(row) {
                    let claim = if run.side == Side::Outside { Claim::Outside } else { Claim::Inside };
                    claims.push((run.start.saturating_sub(1), run.end, claim));
                }
                for (x, cell) in boxes.skin.row(row) {
                    // The sample is the cell's high corner along an axis where the cell is the low one.
                    let corner = (1 - dy) << 1 | (1 - z) << 2;
                    let outside = outside_corners(items.shape(*cell));
                    for (sample, corner) in [(*x - 1, corner), (*x, corner | 1)] {
                        if outside >> corner & 1 == 1 {
                            claims.push((sample, sample + 1, Claim::InFront));
                        }
                    }
                }
            }
        }
        claims.sort_unstable();
        toggles(&claims, &mut signs);
        signs.end_row();
    }
    signs
}

/// Corners of a cell that its surface says are outside, as bits.
fn outside_corners(shape: CellShape) -> u8 {
    let is_outside = |corner: usize| match shape {
        CellShape::Plane(plane) => at_corner(plane.normal, corner) > plane.offset,
        CellShape::Corners(samples) => samples[corner] <= 0,
    };
    (0..CORNERS).filter(|corner| is_outside(*corner)).fold(0, |bits, corner| bits | 1 << corner)
}

/// Where a row of samples changes sides, of claims ordered by where they begin.
fn toggles(claims: &[(u32, u32, Claim)], signs: &mut Signs) {
    // How far each kind of claim reaches; where none does, the sample is inside.
    let mut reach = [0_u32; 3];
    let (mut at, mut next, mut inside) = (0_u32, 0_usize, false);
    loop {
        while let Some((_, end, claim)) = claims.get(next).filter(|(start, ..)| *start <= at) {
            let known = &mut reach[*claim as usize];
            *known = (*known).max(*end);
            next += 1;
        }
        let [outside, within, front] = reach.map(|end| end > at);
        let now = !outside && (within || !front);
        // Behind the last claim there is nothing.
        let ends = next == claims.len() && !outside && !within && !front;
        let now = now && !ends;
        if now != inside {
            signs.push(at);
            inside = now;
        }
        if ends {
            return;
        }
        let start = claims.get(next).map(|(start, ..)| *start);
        let Some(change) = reach.into_iter().filter(|end| *end > at).chain(start).min() else { return };
        at = change;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(claims: &[(u32, u32, Claim)]) -> Vec<u32> {
        let mut sorted = claims.to_vec();
        sorted.sort_unstable();
        let mut signs = Signs::default();
        toggles(&sorted, &mut signs);
        signs.end_row();
        signs.row(0).to_vec()
    }

    #[test]
    fn what_no_claim_reaches_is_inside() {
        use Claim::{InFront, Inside, Outside};
        assert_eq!(row(&[(0, 3, Outside), (5, 9, Outside)]), [3, 5]);
        assert_eq!(row(&[(0, 3, Outside), (3, 4, InFront), (4, 6, Inside), (7, 9, Outside)]), [4, 7]);
        // Cells that are outside come before those inside, and these before surfaces.
        assert_eq!(row(&[(0, 3, Outside), (2, 6, Inside), (4, 5, InFront), (6, 9, Outside)]), [3, 6]);
        assert_eq!(row(&[(0, 9, Outside)]), Vec::<u32>::new());
        assert_eq!(row(&[]), Vec::<u32>::new());
    }
}
