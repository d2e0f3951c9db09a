//! Skin by bit logic: an inside voxel with a neighbour that is not inside (the paper, section 2).
//!
//! Rows of bits carry one word of neighbours at either end, so shifts need no special case.

use std::ops::Range;

use super::simd::{Isa, Kernel, dispatch};
use super::solid::BRICK;

const BRICK_ROWS: usize = BRICK as usize;

/// Which neighbours make a voxel skin.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Connectivity {
    /// A face neighbour is outside: the thin skin, 26-connected, that no 6-connected path crosses.
    #[default]
    Thin26,
    /// Any of the 26 neighbours is outside: the thick skin, itself 6-connected.
    Thick6,
}

impl Connectivity {
    /// 26 or 6, as on the command line and in the metadata.
    pub fn code(self) -> u8 {
        match self {
            Self::Thin26 => 26,
            Self::Thick6 => 6,
        }
    }
}

/// The 3 x 3 rows around a row of inside bits: `rows[dz][dy]`, each `words + 2` long with one word of
/// neighbours before and after.
pub(super) type Rows<'a> = [[&'a [u64]; 3]; 3];

/// Writes the skin bits of the middle row.
#[inline(always)]
pub(super) fn skin_row(rows: &Rows<'_>, connectivity: Connectivity, out: &mut [u64]) {
    match connectivity {
        Connectivity::Thin26 => thin(rows, out),
        Connectivity::Thick6 => thick(rows, out),
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

/// Exposed faces of 32 voxels in a row: bit i of each mask set where that face neighbour is outside.
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

/// Slices of inside bits held: z-1 ..= z+2.
pub(super) const BIT_RING: usize = 4;
/// Rows of inside bits of a slice: the tile's and one on either side.
pub(super) const BIT_ROWS: usize = BRICK_ROWS + 2;

/// Writes the skin bits of words `run` of `rows` rows of the tile to their rows of `skin`, and clears those words
/// of the other rows.
pub(super) fn find_skin(
    bits: &BitRows<'_>,
    run: Range<usize>,
    rows: usize,
    connectivity: Connectivity,
    skin: &mut [u64],
) {
    dispatch(SkinKernel { bits, run, rows, connectivity, skin });
}

/// The 32 rows of one brick out of the tile's skin words.
#[inline]
#[expect(clippy::cast_possible_truncation, reason = "the half is chosen by the shift")]
pub(super) fn brick_rows(skin: &[u64], words: usize, brick: usize) -> [u32; BRICK_ROWS] {
    let shift = brick % 2 * 32;
    std::array::from_fn(|y| (skin[y * words + brick / 2] >> shift) as u32)
}

/// Rows of inside bits of the slices around z; rows and slices outside the volume are empty.
pub(super) struct BitRows<'a> {
    pub(super) bits: &'a [u64],
    pub(super) none: &'a [u64],
    pub(super) words: usize,
    pub(super) z: u32,
    pub(super) nz: u32,
}

impl BitRows<'_> {
    /// The 3 x 3 rows around row `y` of the tile.
    #[inline(always)]
    pub(super) fn around(&self, y: usize) -> Rows<'_> {
        self.around_run(y, 0..self.words)
    }

    /// The same for words `run` of the tile.
    #[inline(always)]
    fn around_run(&self, y: usize, run: Range<usize>) -> Rows<'_> {
        let row = |dz: u32, dy: usize| {
            let slice = self.z.wrapping_add(dz).wrapping_sub(1);
            if slice >= self.nz {
                return &self.none[..run.len() + 2];
            }
            let row = slice as usize % BIT_RING * BIT_ROWS + y + dy;
            &self.bits[row * self.none.len() + run.start..][..run.len() + 2]
        };
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
    connectivity: Connectivity,
    skin: &'a mut [u64],
}

impl Kernel for SkinKernel<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run(self, _: impl Isa) {
        for (y, row) in self.skin.chunks_exact_mut(self.bits.words).enumerate() {
            let out = &mut row[self.run.clone()];
            if y < self.rows {
                skin_row(&self.bits.around_run(y, self.run.clone()), self.connectivity, out);
            } else {
                out.fill(0);
            }
        }
    }
}
