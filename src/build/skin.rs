//! Skin by bit logic: an inside voxel with a neighbour that is not inside (the paper, section 2).
//!
//! Rows of bits carry one word of neighbours at either end, so shifts need no special case.

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
pub(super) struct Exposed {
    /// Faces towards -x, +x, -y, +y, -z, +z.
    pub(super) faces: [u32; 6],
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
