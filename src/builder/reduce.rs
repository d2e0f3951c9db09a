//! Cells joined into larger leaves, brick by brick, between scan and census.
//!
//! ```text
//!   scratch: cells and their sides, in the order of the scan --BrickReader--> Morton order
//!      --Joiner--> leaves and the cells that stay --> scratch: bytes as they stand in the model, index entry
//! ```
//!
//! A brick follows from its own cells alone, so neither threads nor memory change it. The swapped result is final:
//! infobytes, items and means of each level, which [`super::merge`] only copies to their places.
#![expect(clippy::cast_possible_truncation, reason = "a brick has at most 2^15 cells")]

use std::sync::{Mutex, PoisonError};

use super::bits::BitVolume;
use super::brick::{BrickReader, channel_bytes};
use super::cells::larger::{Bound, Distances, FineBrick, Joiner, LEVELS, ModelNode};
use super::error::BuildError;
use super::item::ChannelForm;
use super::layout::{BRICK_LEVELS, StoredChannels, boxes_in_brick};
use super::solid::BRICK;
use super::swap::{BrickEntry, EXTENT_BYTES, FragmentWriter, Scratch, read_fragment};
use super::walk::BrickWalk;
use crate::format::cell::{CORNERS, HAS_CORNERS};
use crate::format::{Channel, ErrorBound, Sum};
use crate::geom::{Dims, morton};
use crate::progress::Progress;

/// Bytes of a reduced brick per fragment.
const PART: usize = 128 << 10;
/// Most bytes of visibility rows that are read at once.
const SEEN_BYTES: u64 = 16 << 10;
/// Cells of a brick.
const CELLS: u64 = 1 << 15;

const _: () = assert!(LEVELS == BRICK_LEVELS as usize);

/// Memory of one worker: a brick, its corners once more, the joiner, and the payload to swap.
pub(super) fn worker_bytes(channels: &[ChannelForm]) -> u64 {
    let own: u64 = channels.iter().map(channel_bytes).sum();
    let items: u64 = channels.iter().map(|c| c.form.stored_bytes() as u64).sum();
    let corners = CELLS * (size_of::<(u16, [i8; CORNERS])>() as u64);
    BrickReader::BYTES
        + 2 * CELLS
        + own
        + corners
        + Joiner::BYTES
        + CELLS * items
        + EXTENT_BYTES as u64
        + SEEN_BYTES
        + (96 << 10)
}

/// The stage, shared by its workers.
pub(super) struct Reduce<'a> {
    scratch: &'a Scratch,
    channels: &'a StoredChannels,
    bound: Bound,
    depth: u32,
    /// Cells that can be seen, if others are dropped.
    seen: Option<&'a BitVolume>,
    walk: Mutex<BrickWalk>,
    found: Mutex<Tally>,
}

/// Results of a worker, or of all of them.
struct Tally {
    distances: Distances,
    hidden: u64,
}

impl<'a> Reduce<'a> {
    pub(super) fn new(
        dims: Dims,
        scratch: &'a Scratch,
        channels: &'a StoredChannels,
        bound: Bound,
        seen: Option<&'a BitVolume>,
    ) -> Self {
        Self {
            scratch,
            channels,
            bound,
            depth: dims.depth(),
            walk: Mutex::new(BrickWalk::new(dims)),
            seen,
            found: Mutex::new(Tally { distances: Distances::new(bound.error), hidden: 0 }),
        }
    }

    /// Runs one worker until the groups are exhausted.
    pub(super) fn work(&self, stop: &dyn Fn() -> bool, progress: &dyn Progress) -> Result<(), BuildError> {
        let mut worker = Worker {
            reader: BrickReader::with_sides(self.channels),
            joiner: Joiner::new(self.bound, self.depth),
            corners: Vec::new(),
            writer: FragmentWriter::new(self.scratch),
            payload: Vec::new(),
            rows: Vec::new(),
            found: Tally { distances: Distances::new(self.bound.error), hidden: 0 },
        };
        let mut found = Vec::new();
        while !stop() {
            let more = self
                .walk
                .lock()
                .unwrap_or_else(PoisonError::into_inner)
                .next_group(self.scratch, &mut found)?;
            if !more {
                break;
            }
            for (code, entry) in &found {
                let brick = morton::decode(*code);
                let reduced = worker.reduce(self, brick, entry)?;
                self.scratch.replace_entry(brick.map(u64::from), reduced)?;
            }
            progress.advance(found.len() as u64);
        }
        worker.writer.flush()?;
        let mut all = self.found.lock().unwrap_or_else(PoisonError::into_inner);
        all.distances.join(&worker.found.distances);
        all.hidden += worker.found.hidden;
        Ok(())
    }

    /// The bound with the measured distances, and the number of cells left out because they cannot be seen.
    pub(super) fn found(self) -> (ErrorBound, u64) {
        let found = self.found.into_inner().unwrap_or_else(PoisonError::into_inner);
        let [rms, p99, most] = found.distances.rms_p99_most();
        (ErrorBound { bound: self.bound.error, rms, p99, most }, found.hidden)
    }
}

struct Worker<'a> {
    reader: BrickReader,
    joiner: Joiner,
    corners: Vec<(u16, [i8; CORNERS])>,
    writer: FragmentWriter<'a>,
    payload: Vec<u8>,
    /// Rows of visibility bits.
    rows: Vec<u8>,
    found: Tally,
}

impl Worker<'_> {
    /// Reduces a brick and swaps it back; returns its new entry in the index.
    fn reduce(
        &mut self,
        stage: &Reduce<'_>,
        place: [u32; 3],
        entry: &BrickEntry,
    ) -> Result<BrickEntry, BuildError> {
        let Self { reader, joiner, corners, writer, payload, rows, found } = self;
        reader.load(stage.scratch, entry)?;
        corners.clear();
        if let Some(channel) = reader.channels.iter().find(|c| c.is_sparse()) {
            corners.extend(reader.corners.iter().map(|corner| {
                (corner.rank(), std::array::from_fn(|c| channel.corner(*corner)[c].cast_signed()))
            }));
        }
        let items = |channel| reader.channels.iter().find(|c| c.channel() == channel).map(|c| &c.items[..]);
        let (Some(codes), Some(offsets)) = (items(Channel::Normal), items(Channel::Offset)) else {
            return Ok(*entry);
        };
        let brick = FineBrick {
            words: &reader.words,
            codes: codes.as_chunks().0,
            offsets,
            corners,
            sides: reader.sides(),
        };
        joiner.join(&brick);
        if let Some(seen) = stage.seen {
            let hidden = joiner.hide(&brick, &seen_in(seen, place, rows)?);
            found.hidden += hidden;
            if hidden == offsets.len() as u64 {
                return Ok(BrickEntry::default());
            }
        }
        joiner.measure(&brick, &mut found.distances);

        let levels = stage.depth.min(BRICK_LEVELS) as usize;
        let mut reduced = BrickEntry::default();
        payload.clear();
        for e in 1..=LEVELS {
            let mut boxes = 0;
            joiner.for_each_kept(e, |_, kept| {
                boxes += 1;
                if e <= levels {
                    payload.push(if let ModelNode::Inner(infobyte) = kept { infobyte } else { 0 });
                }
                reduced.leaves[e - 1] += u16::from(matches!(kept, ModelNode::Leaf(_)));
            });
            if let Some(count) = reduced.boxes.get_mut(e - 1) {
                *count = boxes;
            }
        }
        for e in 1..=levels {
            joiner.for_each_kept(e, |_, kept| {
                if let ModelNode::Leaf(leaf) = kept {
                    payload.extend(leaf.code.to_le_bytes());
                }
            });
            joiner.for_each_kept(e, |_, kept| {
                if let ModelNode::Leaf(leaf) = kept {
                    payload.push(leaf.offset.cast_unsigned());
                }
            });
        }
        joiner.for_each_run(&brick, |cells| {
            reduced.skin += cells.len() as u32;
            let has_corners = offsets[cells].iter().filter(|o| **o == HAS_CORNERS.cast_unsigned()).count();
            reduced.corners += has_corners as u16;
        });
        for at in 0..reader.channels.len() {
            put_items(reader, joiner, corners, at, payload);
            put_means(reader, joiner, corners, (at, levels), payload);
        }
        for channel in &reader.channels {
            if let Some(whole) = channel.sums.first() {
                payload.extend(whole.to_bytes());
            }
        }
        for part in payload.chunks(PART) {
            reduced.last_fragment = writer.append(reduced.last_fragment, part, 0)?;
        }
        Ok(reduced)
    }
}

/// Visibility of a brick's cells, in Morton order; `rows` is a buffer for the stored bits.
fn seen_in(seen: &BitVolume, place: [u32; 3], rows: &mut Vec<u8>) -> Result<[u64; 512], BuildError> {
    const AT_ONCE: usize = SEEN_BYTES as usize / 8;
    let mut words = [0; 512];
    let low = place.map(|c| c * BRICK);
    let sides = seen.dims().to_array();
    let [width, height, depth] = [0, 1, 2].map(|a| sides[a].saturating_sub(low[a]).min(BRICK));
    let whole = seen.row_words * height as usize <= AT_ONCE;
    let (first, across) = if whole { (0, seen.row_words) } else { (low[0] as usize / 64, 1) };
    let at_once = if whole { height } else { 1 };
    rows.resize(8 * across * at_once as usize, 0);
    for z in 0..depth {
        for y in 0..height {
            if y % at_once == 0 {
                let row = seen.row(low[1] + y, low[2] + z);
                seen.read_bytes(row, first, rows).map_err(|e| seen.failed(e))?;
            }
            let at = (y % at_once) as usize * across + low[0] as usize / 64 - first;
            let word = bytemuck::pod_read_unaligned::<u64>(&rows[8 * at..8 * at + 8]) >> (low[0] % 64);
            for x in (0..width).filter(|x| word >> x & 1 == 1) {
                let code = morton::encode(x, y, z);
                words[code as usize / 64] |= 1 << (code % 64);
            }
        }
    }
    Ok(words)
}

/// The cells in the joiner's form.
fn brick_of<'a>(reader: &'a BrickReader, corners: &'a [(u16, [i8; CORNERS])]) -> FineBrick<'a> {
    let items =
        |channel| reader.channels.iter().find(|c| c.channel() == channel).map_or(&[][..], |c| &c.items[..]);
    FineBrick {
        words: &reader.words,
        codes: items(Channel::Normal).as_chunks().0,
        offsets: items(Channel::Offset),
        corners,
        sides: reader.sides(),
    }
}

/// Appends the items of channel `at` for the cells that stay.
fn put_items(
    reader: &BrickReader,
    joiner: &Joiner,
    corners: &[(u16, [i8; CORNERS])],
    at: usize,
    payload: &mut Vec<u8>,
) {
    let (channel, brick) = (&reader.channels[at], brick_of(reader, corners));
    let item = channel.item_bytes();
    joiner.for_each_run(&brick, |cells| {
        if channel.is_sparse() {
            let from = corners.partition_point(|(cell, _)| usize::from(*cell) < cells.start);
            let own = corners[from..].iter().take_while(|(cell, _)| usize::from(*cell) < cells.end);
            own.for_each(|(_, corners)| payload.extend(corners.map(i8::cast_unsigned)));
        } else {
            payload.extend_from_slice(&channel.items[cells.start * item..cells.end * item]);
        }
    });
}

/// Appends the means of a channel's boxes with an edge of 4 and more, and leaves the sum of the brick. The weight of a
/// leaf is the square of its edge in cells (SPEC 4.9).
fn put_means(
    reader: &mut BrickReader,
    joiner: &Joiner,
    corners: &[(u16, [i8; CORNERS])],
    (at, levels): (usize, usize),
    payload: &mut Vec<u8>,
) {
    let Some(rule) = reader.channels[at].rule else { return };
    let mut sums = std::mem::take(&mut reader.channels[at].sums);
    sums.fill(Sum::default());
    let brick = brick_of(reader, corners);
    let item = reader.channels[at].item_bytes();
    joiner.for_each_kept(1, |of, kept| match kept {
        ModelNode::Leaf(leaf) => rule.add_repeated(&mut sums[of / 8], &leaf.code.to_le_bytes(), 4),
        ModelNode::Inner(_) => joiner.for_each_run_of(&brick, of, |cells| {
            let items = &reader.channels[at].items[cells.start * item..cells.end * item];
            rule.add_items(&mut sums[of / 8], items, item);
        }),
    });
    let mut means = Vec::new();
    for e in 2..=LEVELS {
        if e > 2 {
            fold(&mut sums, CELLS as usize >> (3 * e));
        }
        joiner.for_each_kept(e, |of, kept| {
            if let ModelNode::Leaf(leaf) = kept {
                rule.add_repeated(&mut sums[of], &leaf.code.to_le_bytes(), 1 << (2 * e));
            }
        });
        if e <= levels {
            joiner.for_each_kept(e, |of, _| means.extend_from_slice(&rule.mean(&sums[of])[..item]));
        }
    }
    payload.extend(means);
    reader.channels[at].sums = sums;
}

/// Folds sums into the sums of `parents` parents.
fn fold(sums: &mut [Sum], parents: usize) {
    for parent in 0..parents {
        let mut sum = Sum::default();
        for child in sums[8 * parent..8 * parent + 8].iter().filter(|child| child.count() > 0) {
            sum.join(child);
        }
        sums[parent] = sum;
    }
}

/// A reduced brick from the scratch file, read piece by piece.
#[derive(Default)]
pub(super) struct Reduced {
    chain: Vec<u64>,
    stored: Vec<u8>,
    part: Vec<u8>,
    bytes: Vec<u8>,
    used: usize,
}

impl Reduced {
    /// Loads the brick of an entry.
    pub(super) fn load(&mut self, scratch: &Scratch, entry: &BrickEntry) -> Result<(), BuildError> {
        let mut at = entry.last_fragment;
        while at != 0 && self.chain.len() < 64 {
            self.chain.push(at);
            at = read_fragment(scratch, at, &mut self.stored, &mut self.part)?;
        }
        self.bytes.clear();
        self.used = 0;
        while let Some(at) = self.chain.pop() {
            read_fragment(scratch, at, &mut self.stored, &mut self.part)?;
            self.bytes.extend_from_slice(&self.part);
        }
        Ok(())
    }

    /// The next `len` bytes.
    pub(super) fn take(&mut self, scratch: &Scratch, len: usize) -> Result<&[u8], BuildError> {
        let from = self.used;
        self.used += len;
        self.bytes.get(from..self.used).ok_or_else(|| scratch.changed())
    }

    /// Number of nodes with an edge of 2^e of an entry.
    pub(super) fn nodes(entry: &BrickEntry, e: usize) -> usize {
        boxes_in_brick(entry, e as u32) as usize
    }
}
