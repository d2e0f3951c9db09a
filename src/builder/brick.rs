//! One brick of 32^3 voxels: from its fragments in scan order to infobytes and channels in Morton order.
#![expect(clippy::cast_possible_truncation, reason = "places within a brick are below 2^15")]

use super::error::{BuildError, ScratchFault};
use super::layout::BRICK_LEVELS;
use super::simd::{Isa, Kernel, dispatch};
use super::swap::{BrickEntry, Scratch, read_fragment};
use super::value::ValueScale;
use crate::format::normal;
use crate::geom::morton;

const EDGE: usize = 32;
const _: () = assert!(EDGE == super::plan::BRICK as usize, "rows of a brick are words of 32 bits");
const VOXELS: usize = EDGE * EDGE * EDGE;
/// Boxes of 4^3 voxels: one word of 64 voxels each.
const WORDS: usize = VOXELS / 64;

/// Attributes of the voxels below a box, to be averaged.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Sums {
    /// Sum of the L1-127 normals.
    pub(super) normal: [i64; 3],
    /// Sum of the stored values.
    pub(super) value: u64,
    /// Voxels.
    pub(super) count: u64,
    /// Normal code of the first voxel.
    pub(super) first: u16,
}

impl Sums {
    /// Adds a box that follows in Morton order.
    #[inline]
    pub(super) fn add(&mut self, next: &Self) {
        if self.count == 0 {
            self.first = next.first;
        }
        for (sum, more) in self.normal.iter_mut().zip(next.normal) {
            *sum += more;
        }
        self.value += next.value;
        self.count += next.count;
    }

    /// Mean normal (SPEC 4.6).
    #[inline]
    pub(super) fn mean_normal(&self) -> u16 {
        normal::mean(self.normal, self.first)
    }

    /// Mean value (SPEC 4.7).
    #[inline]
    pub(super) fn mean_value(&self) -> u16 {
        ((2 * self.value + self.count) / (2 * self.count.max(1))) as u16
    }
}

/// Buffers for one brick at a time. Memory: [`BrickReader::BYTES`].
pub(super) struct BrickReader {
    stored: Vec<u8>,
    payload: Vec<u8>,
    chain: Vec<u64>,
    rows: Box<[u32; EDGE * EDGE]>,
    scan_normals: Vec<u16>,
    scan_values: Vec<u16>,
    /// Skin bits in Morton order, 4^3 voxels a word.
    pub(super) words: Box<[u64; WORDS]>,
    before: Box<[u32; WORDS]>,
    /// Channels in Morton order.
    pub(super) normals: Vec<u16>,
    pub(super) values: Vec<u16>,
    /// Sums of the boxes of 4^3 voxels, then (folded) of larger ones.
    pub(super) sums: Vec<Sums>,
}

impl BrickReader {
    /// All buffers at their fullest: fragments, scan and Morton order of two channels, bits and sums.
    pub(super) const BYTES: u64 =
        2 * (140 << 10) + 8 * VOXELS as u64 + 16 * WORDS as u64 + 4096 + 64 * WORDS as u64;

    pub(super) fn new() -> Self {
        Self {
            stored: Vec::new(),
            payload: Vec::new(),
            chain: Vec::new(),
            rows: Box::new([0; EDGE * EDGE]),
            scan_normals: Vec::new(),
            scan_values: Vec::new(),
            words: Box::new([0; WORDS]),
            before: Box::new([0; WORDS]),
            normals: Vec::new(),
            values: Vec::new(),
            sums: vec![Sums::default(); WORDS],
        }
    }

    /// Loads a brick and puts it into Morton order.
    pub(super) fn load(
        &mut self,
        scratch: &Scratch,
        entry: &BrickEntry,
        normals: bool,
        values: Option<&ValueScale>,
    ) -> Result<(), BuildError> {
        self.rows.fill(0);
        self.scan_normals.clear();
        self.scan_values.clear();
        // Fragments are linked from the last to the first, and the first slices must come first.
        self.chain.clear();
        let mut at = entry.last_fragment;
        while at != 0 && self.chain.len() < EDGE {
            self.chain.push(at);
            at = read_fragment(scratch, at, &mut self.stored, &mut self.payload)?;
        }
        let single = self.chain.len() == 1;
        while let Some(at) = self.chain.pop() {
            if !single {
                read_fragment(scratch, at, &mut self.stored, &mut self.payload)?;
            }
            if self.unpack(normals, values).is_none() {
                return Err(scratch.error(ScratchFault::Changed.into()));
            }
        }
        dispatch(SortKernel { reader: self, normals, values: values.is_some() });
        Ok(())
    }

    /// Appends the fragment in `payload` to the scan-order buffers; `None` if it is not one.
    fn unpack(&mut self, normals: bool, values: Option<&ValueScale>) -> Option<()> {
        let (head, mut rest) = self.payload.split_first_chunk::<2>()?;
        let slices = usize::from(head[0])..usize::from(head[1]).min(EDGE);
        let mut count = 0;
        for slice in slices {
            let (filled, more) = rest.split_first_chunk::<4>()?;
            rest = more;
            let mut filled = u32::from_le_bytes(*filled);
            while filled != 0 {
                let y = filled.trailing_zeros() as usize;
                filled &= filled - 1;
                let (row, more) = rest.split_first_chunk::<4>()?;
                rest = more;
                let row = u32::from_le_bytes(*row);
                self.rows[slice * EDGE + y] = row;
                count += row.count_ones() as usize;
            }
        }
        if normals {
            let (codes, more) = rest.split_at_checked(2 * count)?;
            rest = more;
            self.scan_normals.extend(codes.as_chunks::<2>().0.iter().map(|c| u16::from_le_bytes(*c)));
        }
        if let Some(scale) = values {
            let wide = scale.swapped_bytes();
            let swapped = rest.get(..wide * count)?;
            self.scan_values.extend(swapped.chunks_exact(wide).map(|v| scale.stored(v)));
        }
        Some(())
    }

    /// Skin bits row by row to Morton words, then every record to its voxel's rank.
    #[inline(always)]
    fn sort_to_morton(&mut self, normals: bool, values: bool) {
        for (block, word) in self.words.iter_mut().enumerate() {
            let [bx, by, bz] = morton::decode(block as u64).map(|c| 4 * c as usize);
            *word = 0;
            for z in 0..4 {
                let rows = &self.rows[(bz + z) * EDGE + by..][..4];
                if rows.iter().fold(0, |a, r| a | r) >> bx & 0xf == 0 {
                    continue;
                }
                for (y, row) in rows.iter().enumerate() {
                    let place = 2 * (y & 1) + 16 * (y >> 1) + 4 * (z & 1) + 32 * (z >> 1);
                    *word |= SPREAD_X[(row >> bx & 0xf) as usize] << place;
                }
            }
        }
        let mut total = 0;
        for (before, word) in self.before.iter_mut().zip(self.words.iter()) {
            *before = total;
            total += word.count_ones();
        }
        if normals {
            self.normals.resize(total as usize, 0);
        }
        if values {
            self.values.resize(total as usize, 0);
        }
        let mut scan = 0;
        for (at, row) in self.rows.iter().enumerate() {
            let mut bits = *row;
            if bits == 0 {
                continue;
            }
            let yz = MORTON_YZ[at];
            while bits != 0 {
                let x = bits.trailing_zeros() as usize;
                bits &= bits - 1;
                let code = usize::from(yz | MORTON_X[x]);
                let below = self.words[code / 64] & ((1 << (code % 64)) - 1);
                let place = (self.before[code / 64] + below.count_ones()) as usize;
                if normals {
                    self.normals[place] = self.scan_normals[scan];
                }
                if values {
                    self.values[place] = self.scan_values[scan];
                }
                scan += 1;
            }
        }
    }

    /// Sums of the 4^3 boxes, in Morton order with empty boxes between.
    pub(super) fn sum_words(&mut self) {
        for ((sums, word), first) in self.sums.iter_mut().zip(self.words.iter()).zip(self.before.iter()) {
            *sums = Sums::default();
            let count = word.count_ones() as usize;
            if count == 0 {
                continue;
            }
            let voxels = *first as usize..*first as usize + count;
            sums.count = count as u64;
            if let Some(codes) = self.normals.get(voxels.clone()) {
                sums.first = codes[0];
                let mut sum = [0_i32; 3];
                for code in codes {
                    let v = normal::decode_l1(*code);
                    (sum[0], sum[1], sum[2]) = (sum[0] + v[0], sum[1] + v[1], sum[2] + v[2]);
                }
                sums.normal = sum.map(i64::from);
            }
            if let Some(values) = self.values.get(voxels) {
                sums.value = values.iter().map(|v| u64::from(*v)).sum();
            }
        }
    }

    /// Folds the sums of `boxes` boxes into those of their parents.
    pub(super) fn fold_sums(&mut self, boxes: usize) {
        for parent in 0..boxes / 8 {
            let mut sum = Sums::default();
            for child in &self.sums[8 * parent..8 * parent + 8] {
                if child.count > 0 {
                    sum.add(child);
                }
            }
            self.sums[parent] = sum;
        }
    }
}

struct SortKernel<'a> {
    reader: &'a mut BrickReader,
    normals: bool,
    values: bool,
}

impl Kernel for SortKernel<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self, _: impl Isa) {
        self.reader.sort_to_morton(self.normals, self.values);
    }
}

/// Infobytes of all boxes of a brick, empty ones included: `[e - 1]` holds those with an edge of 2^e.
///
/// The infobyte of a box of 2^3 voxels is a byte of the Morton words; every longer edge asks which of
/// eight neighbouring infobytes are not zero.
pub(super) fn infobytes(words: &[u64; WORDS], out: &mut [Vec<u8>; BRICK_LEVELS as usize]) {
    let [finest, coarser @ ..] = out;
    finest.clear();
    finest.extend(words.iter().flat_map(|w| w.to_le_bytes()));
    let mut below: &[u8] = finest;
    for level in coarser {
        level.clear();
        level.extend(
            below
                .as_chunks::<8>()
                .0
                .iter()
                .map(|eight| eight.iter().enumerate().fold(0, |mask, (i, b)| mask | u8::from(*b != 0) << i)),
        );
        below = level;
    }
}

/// Four bits of a row to their places in a word of 4^3 voxels in Morton order.
const SPREAD_X: [u64; 16] = {
    let mut table = [0; 16];
    let mut bits = 0_u64;
    while bits < 16 {
        table[bits as usize] = (bits & 3) | (bits >> 2) << 8;
        bits += 1;
    }
    table
};

/// Morton code of (x, 0, 0) within a brick.
const MORTON_X: [u16; EDGE] = {
    let mut table = [0; EDGE];
    let mut x = 0;
    while x < EDGE {
        table[x] = morton::spread(x as u32) as u16;
        x += 1;
    }
    table
};

/// Morton code of (0, y, z) within a brick, at `32 z + y`.
const MORTON_YZ: [u16; EDGE * EDGE] = {
    let mut table = [0; EDGE * EDGE];
    let mut at = 0;
    while at < EDGE * EDGE {
        table[at] = morton::encode(0, (at % EDGE) as u32, (at / EDGE) as u32) as u16;
        at += 1;
    }
    table
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_are_morton_codes() {
        for bits in 0..16_u64 {
            let want = (0..4).filter(|x| bits >> x & 1 == 1).fold(0, |w, x| w | 1 << morton::encode(x, 0, 0));
            assert_eq!(SPREAD_X[bits as usize], want);
        }
    }

    #[test]
    fn infobytes_of_every_level_say_which_children_exist() {
        let mut words = Box::new([0_u64; WORDS]);
        words[0] = 1;
        words[511] = 1 << 63;
        words[9] = 0xff << 8;
        let mut out: [Vec<u8>; BRICK_LEVELS as usize] = Default::default();
        infobytes(&words, &mut out);
        assert_eq!(out.each_ref().map(Vec::len), [4096, 512, 64, 8, 1]);
        assert_eq!((out[0][0], out[0][4095], out[0][73]), (1, 0x80, 0xff));
        assert_eq!((out[1][0], out[1][9], out[1][511]), (1, 2, 0x80));
        assert_eq!((out[2][0], out[2][1], out[2][63]), (1, 2, 0x80));
        assert_eq!((out[3][0], out[3][7], out[4][0]), (3, 0x80, 0x81));
    }

    #[test]
    fn means_round_half_up_and_fall_back_to_the_first() {
        let mut sums = Sums { normal: [5, 0, 0], value: 1, count: 1, first: 7 };
        sums.add(&Sums { normal: [-5, 0, 0], value: 2, count: 1, first: 9 });
        assert_eq!((sums.mean_normal(), sums.mean_value(), sums.count), (7, 2, 2));
    }
}
