//! The grid of a subtree's voxels, and the 26 neighbours of one (SPEC 5.4).

use super::structure::Cell;

/// Boxes along a side of the grid: 64 cells and a border.
const SIDE: usize = 66;
/// Places of the grid.
pub(super) const PLACES: usize = SIDE * SIDE * SIDE;

/// Weight of a neighbour that shares a face, an edge, a corner.
const WEIGHTS: [i32; 3] = [8, 3, 1];

/// A neighbour: how far it is in the grid and along each axis, and its weight.
#[derive(Clone, Copy, Debug)]
pub(super) struct Neighbour {
    pub(super) step: isize,
    pub(super) away: [i32; 3],
    pub(super) weight: i32,
}

/// Place of a cell in the grid.
#[inline]
pub(super) fn place(cell: &Cell) -> usize {
    let [x, y, z] = cell.map(|c| usize::from(c) + 1);
    (z * SIDE + y) * SIDE + x
}

/// The 26 neighbours, by z, y, x.
pub(super) fn neighbours() -> [Neighbour; 26] {
    let mut all = [Neighbour { step: 0, away: [0; 3], weight: 0 }; 26];
    let side = SIDE.cast_signed();
    let steps = (0..27_i32).filter(|i| *i != 13).map(|i| [i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1]);
    for (slot, away) in all.iter_mut().zip(steps) {
        let [x, y, z] = away.map(|a| a as isize);
        let axes = away.iter().filter(|a| **a != 0).count();
        *slot = Neighbour { step: (z * side + y) * side + x, away, weight: WEIGHTS[(axes - 1) % 3] };
    }
    all
}

/// Empties the places of a subtree's cells.
pub(super) fn clear<T: Copy>(grid: &mut [T], cells: &[Cell], empty: T) {
    for cell in cells {
        if let Some(slot) = grid.get_mut(place(cell)) {
            *slot = empty;
        }
    }
}
