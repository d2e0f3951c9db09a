//! The voxels of one slice of a tile: bits of crossings, and those that follow.

use super::super::lattice::Triangle;
use super::half::{Window, crossings};

/// Rows of a tile with two more on either side.
pub(super) const ROWS: usize = 36;
/// Rows before a tile's first.
pub(super) const BEFORE: i32 = 2;

/// Kind of bits kept of a crossed voxel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Mark {
    /// The directions of the triangles that cross it, along every axis.
    Directions,
    /// The half in which it is crossed, along every axis.
    Halves,
}

/// Six bits for every voxel of a slice: two an axis, of the kind [`Mark`]; and the bits of the solid.
pub(super) struct Planes {
    /// The slice; no slice of a grid at first.
    pub(super) slice: i32,
    pub(super) solid: Vec<u64>,
    noted: [Vec<u64>; 6],
    words: usize,
}

impl Planes {
    pub(super) const NO_SLICE: i32 = i32::MIN;

    /// Memory of planes with rows of `words` words.
    pub(super) fn bytes(words: usize) -> u64 {
        (7 * ROWS * words * 8) as u64
    }

    pub(super) fn new(words: usize) -> Self {
        let plane = || vec![0; ROWS * words];
        Self { slice: Self::NO_SLICE, solid: plane(), noted: std::array::from_fn(|_| plane()), words }
    }

    pub(super) fn clear(&mut self, slice: i32) {
        self.slice = slice;
        self.solid.fill(0);
        self.noted.iter_mut().for_each(|plane| plane.fill(0));
    }

    /// Marks the crossings of a triangle with the slice; `left` and `top` are the voxel of the first bit.
    pub(super) fn note(&mut self, t: &Triangle, [left, top]: [i32; 2], what: Mark) {
        let last = |from: i32, count: usize| from + i32::try_from(count).unwrap_or(i32::MAX / 2) - 1;
        let window = Window { x: (left, last(left, 64 * self.words)), y: (top, last(top, ROWS)) };
        let Self { noted, words, slice, .. } = self;
        crossings(t, *slice, &window, &mut |c| {
            let bit = usize::try_from(c.x - left).unwrap_or(0);
            let row = usize::try_from(c.y - top).unwrap_or(0);
            let which = 2 * c.axis + usize::from(if what == Mark::Halves { c.upper } else { c.along });
            noted[which][row * *words + bit / 64] |= 1 << (bit % 64);
        });
    }

    fn word(&self, which: usize, row: usize, word: usize) -> u64 {
        self.noted[which].get(row * self.words + word).copied().unwrap_or(0)
    }

    pub(super) fn crossed(&self, row: usize, word: usize) -> u64 {
        (0..6).fold(0, |all, which| all | self.word(which, row, word))
    }

    /// True if a triangle looks along an axis, and true if one looks the other way.
    pub(super) fn directions(&self, axis: usize, row: usize, bit: usize) -> (bool, bool) {
        let at = |which: usize| self.word(which, row, bit / 64) >> (bit % 64) & 1 == 1;
        (at(2 * axis + 1), at(2 * axis))
    }

    pub(super) fn inside(&self, row: usize, word: usize) -> u64 {
        self.solid.get(row * self.words + word).copied().unwrap_or(0)
    }

    /// The bits of a row moved by one: bit i is the bit of the voxel before (`up`) or after.
    fn beside(&self, row: usize, word: usize, up: bool, of: &impl Fn(usize, usize) -> u64) -> u64 {
        let own = of(row, word);
        if up {
            let before = word.checked_sub(1).map_or(0, |before| of(row, before));
            own << 1 | before >> 63
        } else {
            let after = if word + 1 < self.words { of(row, word + 1) } else { 0 };
            own >> 1 | after << 63
        }
    }

    /// Voxels of the solid, and of walls between two centres that are both outside: of the two voxels the one in which
    /// the wall begins, seen from lower coordinates. `below` and `above` are the slices next to this one, `row` neither
    /// the first nor the last.
    pub(super) fn united(&self, below: &Self, above: &Self, row: usize, word: usize) -> u64 {
        let inside = self.inside(row, word);
        let lower = |axis: usize| self.word(2 * axis, row, word);
        let upper = |axis: usize| self.word(2 * axis + 1, row, word);
        let solid = |row: usize, word: usize| self.inside(row, word);
        let upper_x = |row: usize, word: usize| self.word(1, row, word);
        let x = upper(0) & !self.beside(row, word, false, &solid)
            | lower(0) & !self.beside(row, word, true, &solid) & !self.beside(row, word, true, &upper_x);
        let y = upper(1) & !self.inside(row + 1, word)
            | lower(1) & !self.inside(row - 1, word) & !self.word(3, row - 1, word);
        let z = upper(2) & !above.inside(row, word)
            | lower(2) & !below.inside(row, word) & !below.word(5, row, word);
        inside | x | y | z
    }
}
