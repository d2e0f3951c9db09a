//! One brick of 32^3 voxels: from its fragments in scan order to infobytes and channels in Morton order.
#![expect(clippy::cast_possible_truncation, reason = "codes within a brick are below 2^15")]

use super::error::BuildError;
use super::item::{ChannelForm, ItemForm};
use super::layout::{BRICK_LEVELS, StoredChannels};
use super::swap::{BrickEntry, Scratch, read_fragment};
use crate::cpu::{Kernel, Lanes, dispatch};
use crate::format::cell::{CORNERS, HAS_CORNERS};
use crate::format::{Channel, MeanRule, Sum};
use crate::geom::morton;

const EDGE: usize = 32;
const _: () = assert!(EDGE == super::solid::BRICK as usize, "rows of a brick are words of 32 bits");
const VOXELS: usize = EDGE * EDGE * EDGE;
/// Boxes of 4^3 voxels: one word of 64 voxels each.
const WORDS: usize = VOXELS / 64;

pub(super) struct BrickChannel {
    channel: Channel,
    form: ItemForm,
    /// Rule of its means; `None` for a channel without means.
    pub(super) rule: Option<MeanRule>,
    /// Stored items in the order of the scan.
    scan: Vec<u8>,
    /// Stored items in Morton order.
    pub(super) items: Vec<u8>,
    /// Sums of the boxes of 4^3 voxels, then (folded) of larger ones; empty without a rule.
    pub(super) sums: Vec<Sum>,
}

/// A cell with corners: its rank in Morton order among all cells of the brick, and its index in scan order among the
/// cells with corners.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Corner {
    rank: u16,
    scanned: u16,
}

impl Corner {
    pub(super) fn rank(self) -> u16 {
        self.rank
    }
}

/// Most bytes of a channel's items, in both orders, and of its sums.
pub(super) fn channel_bytes(channel: &ChannelForm) -> u64 {
    if channel.channel.row().is_sparse {
        return (VOXELS * (channel.form.stored_bytes() + size_of::<Corner>())) as u64;
    }
    (2 * VOXELS * channel.form.stored_bytes() + Sum::BYTES * WORDS) as u64
}

impl BrickChannel {
    fn new(channel: &ChannelForm, rule: Option<MeanRule>) -> Self {
        Self {
            channel: channel.channel,
            form: channel.form,
            rule,
            scan: Vec::new(),
            items: Vec::new(),
            sums: vec![Sum::default(); if rule.is_some() { WORDS } else { 0 }],
        }
    }

    pub(super) fn channel(&self) -> Channel {
        self.channel
    }

    /// True if only a part of the voxels has an item.
    pub(super) fn is_sparse(&self) -> bool {
        self.channel.row().is_sparse
    }

    pub(super) fn corner(&self, cell: Corner) -> &[u8] {
        let bytes = self.form.stored_bytes();
        self.scan.chunks_exact(bytes).nth(cell.scanned.into()).unwrap_or(&[1; CORNERS])
    }

    pub(super) fn item_bytes(&self) -> usize {
        self.form.stored_bytes()
    }

    /// Sums of the 4^3 boxes, in Morton order with empty boxes between.
    fn sum_words(&mut self, words: &[u64; WORDS], before: &[u32; WORDS]) {
        let item = self.item_bytes();
        // One loop for each rule, which the compiler then knows as a constant.
        match self.rule {
            Some(MeanRule::Direction) => {
                self.sum_words_by(words, before, 2, |sum, items| {
                    MeanRule::Direction.add_items(sum, items, 2)
                });
            }
            Some(MeanRule::Number) => self.sum_words_by(words, before, item, |sum, items| {
                MeanRule::Number.add_items(sum, items, item);
            }),
            None => {}
        }
    }

    #[inline(always)]
    fn sum_words_by(
        &mut self,
        words: &[u64; WORDS],
        before: &[u32; WORDS],
        item: usize,
        add: impl Fn(&mut Sum, &[u8]),
    ) {
        for ((sum, word), first) in self.sums.iter_mut().zip(words).zip(before) {
            *sum = Sum::default();
            let (first, count) = (*first as usize, word.count_ones() as usize);
            if count > 0 {
                add(sum, &self.items[first * item..(first + count) * item]);
            }
        }
    }

    /// Folds the sums of `boxes` boxes into the sums of their parents.
    pub(super) fn fold_sums(&mut self, boxes: usize) {
        if self.rule.is_none() {
            return;
        }
        for parent in 0..boxes / 8 {
            let mut sum = Sum::default();
            for child in &self.sums[8 * parent..8 * parent + 8] {
                if child.count() > 0 {
                    sum.join(child);
                }
            }
            self.sums[parent] = sum;
        }
    }

    /// Writes the means of the first `boxes` boxes to `out`, skipping boxes without skin.
    pub(super) fn means(&self, boxes: usize, out: &mut Vec<u8>) {
        out.clear();
        let (Some(rule), item) = (self.rule, self.item_bytes()) else { return };
        for sum in self.sums.iter().take(boxes).filter(|sum| sum.count() > 0) {
            let mean = rule.mean(sum);
            match item {
                1 => out.push(mean[0]),
                2 => out.extend_from_slice(&[mean[0], mean[1]]),
                _ => out.extend_from_slice(&mean[..item]),
            }
        }
    }
}

/// Buffers for one brick at a time. Memory: [`BrickReader::BYTES`] and [`channel_bytes`] of each channel.
pub(super) struct BrickReader {
    stored: Vec<u8>,
    payload: Vec<u8>,
    chain: Vec<u64>,
    rows: Box<[u32; EDGE * EDGE]>,
    /// Skin bits in Morton order, 4^3 voxels a word.
    pub(super) words: Box<[u64; WORDS]>,
    before: Box<[u32; WORDS]>,
    /// Cells with corners, in Morton order.
    pub(super) corners: Vec<Corner>,
    pub(super) channels: Vec<BrickChannel>,
    /// Masks of each cell's inside corners, in scan order and in Morton order; `None` unless they are swapped.
    sides: Option<[Vec<u8>; 2]>,
}

impl BrickReader {
    /// Memory of the fragments and the bits at their largest.
    pub(super) const BYTES: u64 = 2 * (140 << 10) + 16 * WORDS as u64 + 4096;

    pub(super) fn new(channels: &StoredChannels) -> Self {
        Self {
            stored: Vec::new(),
            payload: Vec::new(),
            chain: Vec::new(),
            rows: Box::new([0; EDGE * EDGE]),
            words: Box::new([0; WORDS]),
            before: Box::new([0; WORDS]),
            corners: Vec::new(),
            channels: channels.with_means().map(|(c, rule)| BrickChannel::new(c, rule)).collect(),
            sides: None,
        }
    }

    /// A reader of cells whose corner masks are swapped as well.
    pub(super) fn with_sides(channels: &StoredChannels) -> Self {
        Self { sides: Some(Default::default()), ..Self::new(channels) }
    }

    /// Masks of each cell's inside corners, in Morton order.
    pub(super) fn sides(&self) -> &[u8] {
        self.sides.as_ref().map_or(&[], |[_, items]| items)
    }

    /// Loads a brick and puts it into Morton order.
    pub(super) fn load(&mut self, scratch: &Scratch, entry: &BrickEntry) -> Result<(), BuildError> {
        self.rows.fill(0);
        for channel in &mut self.channels {
            channel.scan.clear();
        }
        if let Some([scan, _]) = &mut self.sides {
            scan.clear();
        }
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
            if self.unpack().is_none() {
                return Err(scratch.changed());
            }
        }
        dispatch(WordsKernel { reader: self });
        self.sort_corners();
        for BrickChannel { channel, form, scan, items, .. } in &mut self.channels {
            if channel.row().is_sparse {
                continue;
            }
            let order = MortonOrder { rows: &self.rows, words: &self.words, before: &self.before };
            match form.stored_bytes() {
                1 => dispatch(SortKernel::<1> { order, scan, items }),
                2 => dispatch(SortKernel::<2> { order, scan, items }),
                3 => dispatch(SortKernel::<3> { order, scan, items }),
                4 => dispatch(SortKernel::<4> { order, scan, items }),
                wide => order.sort(scan, items, wide),
            }
        }
        if let Some([scan, items]) = &mut self.sides {
            let order = MortonOrder { rows: &self.rows, words: &self.words, before: &self.before };
            dispatch(SortKernel::<1> { order, scan, items });
        }
        Ok(())
    }

    /// Finds the cells with corners, and puts them into Morton order.
    fn sort_corners(&mut self) {
        self.corners.clear();
        let sparse = self.channels.iter().find(|c| c.is_sparse());
        if sparse.is_none_or(|c| c.scan.is_empty()) {
            return;
        }
        let Some(offsets) = self.channels.iter().find(|c| c.channel == Channel::Offset) else { return };
        let order = MortonOrder { rows: &self.rows, words: &self.words, before: &self.before };
        let (mut announced, mut scanned) = (offsets.scan.iter(), 0);
        order.for_each_rank(|rank| {
            if announced.next() == Some(&HAS_CORNERS.cast_unsigned()) {
                self.corners.push(Corner { rank: rank as u16, scanned });
                scanned += 1;
            }
        });
        self.corners.sort_unstable();
    }

    /// Appends the fragment in `payload` to the scan-order buffers; `None` if it is invalid.
    fn unpack(&mut self) -> Option<()> {
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
        let tail = count * self.channels.iter().map(|channel| channel.form.tail_bytes()).sum::<usize>();
        let mut tail = rest.split_off(rest.len().checked_sub(tail)?..)?;
        let mut corners = 0;
        for channel in &mut self.channels {
            let items = if channel.channel.row().is_sparse { corners } else { count };
            let apart = channel.form.tail_bytes();
            let (swapped, more) = rest.split_at_checked((channel.form.swapped_bytes() - apart) * items)?;
            rest = more;
            let (first, more) = tail.split_at_checked(apart * items)?;
            tail = more;
            if channel.channel == Channel::Offset {
                corners = swapped.iter().filter(|o| **o == HAS_CORNERS.cast_unsigned()).count();
            }
            channel.form.store([first, swapped], &mut channel.scan);
        }
        if let Some([scan, _]) = &mut self.sides {
            scan.extend_from_slice(rest.get(..count)?);
        }
        Some(())
    }

    /// Converts skin bits by row to Morton words.
    #[inline(always)]
    fn words_of_rows(&mut self) {
        for (block, word) in self.words.iter_mut().enumerate() {
            let [bx, by, bz] = morton::decode(block as u64).map(|c| 4 * c as usize);
            *word = 0;
            for z in 0..4 {
                let rows = &self.rows[(bz + z) * EDGE + by..][..4];
                if rows.iter().fold(0, |a, r| a | r) >> bx & 0xf == 0 {
                    continue;
                }
                for (y, row) in rows.iter().enumerate() {
                    let bit = 2 * (y & 1) + 16 * (y >> 1) + 4 * (z & 1) + 32 * (z >> 1);
                    *word |= SPREAD_X[(row >> bx & 0xf) as usize] << bit;
                }
            }
        }
        let mut total = 0;
        for (before, word) in self.before.iter_mut().zip(self.words.iter()) {
            *before = total;
            total += word.count_ones();
        }
    }

    /// Sums the 4^3 boxes of every averaged channel.
    pub(super) fn sum_words(&mut self) {
        for channel in &mut self.channels {
            channel.sum_words(&self.words, &self.before);
        }
    }
}

struct WordsKernel<'a> {
    reader: &'a mut BrickReader,
}

impl Kernel for WordsKernel<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self, _: impl Lanes) {
        self.reader.words_of_rows();
    }
}

/// Mapping from the scan order of voxels to their rank in Morton order.
#[derive(Clone, Copy)]
struct MortonOrder<'a> {
    rows: &'a [u32; EDGE * EDGE],
    words: &'a [u64; WORDS],
    before: &'a [u32; WORDS],
}

impl MortonOrder<'_> {
    #[inline(always)]
    fn voxels(&self) -> usize {
        self.before[WORDS - 1] as usize + self.words[WORDS - 1].count_ones() as usize
    }

    /// Calls `put` with the rank of every voxel, in the order of the scan.
    #[inline(always)]
    fn for_each_rank(&self, mut put: impl FnMut(usize)) {
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
                put((self.before[code / 64] + below.count_ones()) as usize);
            }
        }
    }

    /// Puts items of any width into Morton order.
    fn sort(&self, scan: &[u8], items: &mut Vec<u8>, width: usize) {
        items.resize(self.voxels() * width, 0);
        let mut from = scan.chunks_exact(width);
        self.for_each_rank(|rank| {
            if let Some(item) = from.next() {
                items[rank * width..][..width].copy_from_slice(item);
            }
        });
    }
}

/// Puts items of `W` bytes into Morton order.
struct SortKernel<'a, const W: usize> {
    order: MortonOrder<'a>,
    scan: &'a [u8],
    items: &'a mut Vec<u8>,
}

impl<const W: usize> Kernel for SortKernel<'_, W> {
    type Output = ();

    #[inline(always)]
    fn run(self, _: impl Lanes) {
        self.items.resize(self.order.voxels() * W, 0);
        let (from, to) = (self.scan.as_chunks::<W>().0, self.items.as_chunks_mut::<W>().0);
        let mut at = 0;
        self.order.for_each_rank(|rank| {
            to[rank] = from[at];
            at += 1;
        });
    }
}

/// Infobytes of all boxes of a brick, empty ones included: `[e - 1]` holds those with an edge of 2^e.
///
/// The infobyte of a box of 2^3 voxels is a byte of the Morton words; at every longer edge a bit is set for each of the
/// eight child infobytes that is not zero.
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

/// Bits of a word of 4^3 voxels in Morton order for four bits of a row.
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
}
