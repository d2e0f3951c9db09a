//! Skin by bit logic: an inside voxel with a neighbour that is not inside (the paper, section 2).
//!
//! Rows of bits carry one word of neighbours at either end, so shifts need no special case.

use std::ops::Range;

use super::solid::BRICK;
use crate::cpu::{Kernel, Lanes, dispatch};

pub(super) const BRICK_ROWS: usize = BRICK as usize;

/// Neighbours that make a voxel skin.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, serde::Deserialize)]
pub enum Connectivity {
    /// A face neighbour is outside: the thin skin, 26-connected, that no 6-connected path crosses.
    #[default]
    #[serde(rename = "26")]
    Thin26,
    /// Any of the 26 neighbours is outside: the thick skin, itself 6-connected.
    #[serde(rename = "6")]
    Thick6,
}

impl Connectivity {
    /// 26 or 6, as on the command line and in the metadata.
    pub(crate) fn code(self) -> u8 {
        match self {
            Self::Thin26 => 26,
            Self::Thick6 => 6,
        }
    }
}

/// Rule for the boxes kept in a row of inside bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum SkinRule {
    /// Skin voxels.
    Skin(Connectivity),
    /// Cells: box i lies between samples i - 1 and i along each axis, and is kept unless its eight samples are all on
    /// one side.
    Cells,
}

/// The 3 x 3 rows around a row of inside bits: `rows[dz][dy]`, each `words + 2` long with one word of
/// neighbours before and after.
pub(super) type Rows<'a> = [[&'a [u64]; 3]; 3];

/// Writes the bits of the kept boxes of the middle row.
#[inline(always)]
fn kept_row(rows: &Rows<'_>, kept: SkinRule, out: &mut [u64]) {
    match kept {
        SkinRule::Skin(Connectivity::Thin26) => thin(rows, out),
        SkinRule::Skin(Connectivity::Thick6) => thick(rows, out),
        SkinRule::Cells => cells(rows, out),
    }
}

/// The row's bits moved so that bit i holds the neighbour at x - 1.
#[inline(always)]
fn west(row: &[u64], i: usize) -> u64 {
    row[i + 1] << 1 | row[i] >> 63
}

/// The row's bits moved so that bit i holds the neighbour at x + 1.
#[inline(always)]
fn east(row: &[u64], i: usize) -> u64 {
    row[i + 1] >> 1 | row[i + 2] << 63
}

#[inline(always)]
fn thin(rows: &Rows<'_>, out: &mut [u64]) {
    let n = out.len() + 2;
    let [[_, down, _], [north, here, south], [_, up, _]] = *rows;
    let (down, north, here, south, up) = (&down[..n], &north[..n], &here[..n], &south[..n], &up[..n]);
    for (i, out) in out.iter_mut().enumerate() {
        let around = west(here, i) & east(here, i) & north[i + 1] & south[i + 1] & down[i + 1] & up[i + 1];
        *out = here[i + 1] & !around;
    }
}

#[inline(always)]
fn thick(rows: &Rows<'_>, out: &mut [u64]) {
    let all = |i: usize| rows.iter().flatten().fold(u64::MAX, |a, row| a & row[i]);
    for (i, out) in out.iter_mut().enumerate() {
        let (before, middle, after) = (all(i), all(i + 1), all(i + 2));
        let around = middle & (middle << 1 | before >> 63) & (middle >> 1 | after << 63);
        *out = rows[1][1][i + 1] & !around;
    }
}

#[inline(always)]
fn cells(rows: &Rows<'_>, out: &mut [u64]) {
    let n = out.len() + 2;
    let [[a, b, _], [c, d, _], _] = *rows;
    let (a, b, c, d) = (&a[..n], &b[..n], &c[..n], &d[..n]);
    let (any, all) = (|i: usize| a[i] | b[i] | c[i] | d[i], |i: usize| a[i] & b[i] & c[i] & d[i]);
    for (i, out) in out.iter_mut().enumerate() {
        let some = any(i + 1) | any(i + 1) << 1 | any(i) >> 63;
        let every = all(i + 1) & (all(i + 1) << 1 | all(i) >> 63);
        *out = some & !every;
    }
}

/// Samples at the corners of 32 cells in a row, those numbered `32 * half ..`: for each of the four edges along
/// x (y low and z low, y high, z high, both), bit i is the sample before cell i, bit i + 1 the one after.
#[inline(always)]
pub(super) fn corner_samples(rows: &Rows<'_>, half: usize) -> [u64; 4] {
    let (i, shift) = (half / 2, half % 2 * 32);
    let [[a, b, _], [c, d, _], _] = *rows;
    [a, b, c, d].map(|row| west(row, i) >> shift | (row[i + 1] >> shift & 1 << 31) << 1)
}

/// Exposed faces of 32 voxels in a row: bit i of each mask is set where that face neighbour is outside.
#[derive(Clone, Copy, Debug, Default)]
pub struct Exposed {
    /// Faces towards -x, +x, -y, +y, -z, +z.
    pub faces: [u32; 6],
}

/// Exposed faces of voxels `32 * half ..` of the middle row.
#[inline(always)]
pub(super) fn exposed(rows: &Rows<'_>, half: usize) -> Exposed {
    let (i, shift) = (half / 2, half % 2 * 32);
    let [[_, down, _], [north, here, south], [_, up, _]] = *rows;
    #[expect(clippy::cast_possible_truncation, reason = "the half is chosen by the shift")]
    let faces = [west(here, i), east(here, i), north[i + 1], south[i + 1], down[i + 1], up[i + 1]]
        .map(|inside| !(inside >> shift) as u32);
    Exposed { faces }
}

/// Number of slices of inside bits held: z-1 ..= z+2.
pub(super) const BIT_RING: usize = 4;
/// Number of rows of inside bits of a slice: the tile's and one on either side.
pub(super) const BIT_ROWS: usize = BRICK_ROWS + 2;

/// Writes the skin bits of words `run` of `rows` rows of the tile to their rows of `skin`, and clears those words
/// of the other rows.
pub(super) fn find_skin(
    bits: &BitRows<'_>,
    run: Range<usize>,
    rows: usize,
    kept: SkinRule,
    skin: &mut [u64],
) {
    dispatch(SkinKernel { bits, run, rows, kept, skin });
}

/// The 32 rows of one brick out of the tile's skin words.
#[inline]
#[expect(clippy::cast_possible_truncation, reason = "the half is chosen by the shift")]
pub(super) fn brick_rows(skin: &[u64], words: usize, brick: usize) -> [u32; BRICK_ROWS] {
    let shift = brick % 2 * 32;
    std::array::from_fn(|y| (skin[y * words + brick / 2] >> shift) as u32)
}

/// Rows of inside bits of the slices around z; rows and slices outside the volume are empty.
#[derive(Clone, Copy)]
pub(super) struct BitRows<'a> {
    pub(super) bits: &'a [u64],
    pub(super) none: &'a [u64],
    pub(super) words: usize,
    pub(super) z: u32,
    pub(super) nz: u32,
}

impl BitRows<'_> {
    /// Words `run` of row `row` (the tile's first is 1) of slice `z - 1 + dz`, with a word of neighbours at either end.
    #[inline(always)]
    fn row(&self, dz: u32, row: usize, run: &Range<usize>) -> &[u64] {
        let slice = self.z.wrapping_add(dz).wrapping_sub(1);
        let len = run.end - run.start + 2;
        if slice >= self.nz {
            return &self.none[..len];
        }
        let row = slice as usize % BIT_RING * BIT_ROWS + row;
        &self.bits[row * self.none.len() + run.start..][..len]
    }

    /// The 3 x 3 rows around row `y` of the tile.
    #[inline(always)]
    pub(super) fn around(&self, y: usize) -> Rows<'_> {
        let all = 0..self.words;
        let row = |dz: u32, dy: usize| self.row(dz, y + dy, &all);
        [
            [row(0, 0), row(0, 1), row(0, 2)],
            [row(1, 0), row(1, 1), row(1, 2)],
            [row(2, 0), row(2, 1), row(2, 2)],
        ]
    }
}

struct SkinKernel<'a, 'b> {
    bits: &'a BitRows<'b>,
    run: Range<usize>,
    rows: usize,
    kept: SkinRule,
    skin: &'a mut [u64],
}

impl Kernel for SkinKernel<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run(self, _: impl Lanes) {
        let (bits, run) = (self.bits, &self.run);
        let slice = |row: usize| [bits.row(0, row, run), bits.row(1, row, run), bits.row(2, row, run)];
        let (mut north, mut here) = (slice(0), slice(1));
        for (y, row) in self.skin.chunks_exact_mut(bits.words).enumerate() {
            let out = &mut row[run.start..run.end];
            if y < self.rows {
                let south = slice(y + 2);
                let rows = [
                    [north[0], here[0], south[0]],
                    [north[1], here[1], south[1]],
                    [north[2], here[2], south[2]],
                ];
                kept_row(&rows, self.kept, out);
                (north, here) = (here, south);
            } else {
                out.fill(0);
            }
        }
    }
}
