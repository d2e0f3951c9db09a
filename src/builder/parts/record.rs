//! The record of a group of bricks: stretches of bytes in the model's form, and its entry in the footer.

use crate::builder::layout::{BRICK_LEVELS, GroupCounts, StoredChannels};
use crate::builder::merge::summary_bytes_of;
use crate::builder::walk::{GROUP_BRICKS, GROUP_VOXELS};

/// Bytes of an entry in the footer.
pub(crate) const ENTRY_BYTES: usize = 56;

/// A stretch of a record, which belongs to one level of one section of the model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::builder) enum RecordField {
    /// Code and sums of every brick, for the levels above.
    Summaries,
    /// Infobytes of boxes with an edge of 2^e.
    Nodes(usize),
    /// Items of a channel, by its index in the list.
    Items(usize),
    /// Means of a channel of boxes with an edge of 2^e.
    Means(usize, usize),
}

/// Source of a number of items in the counts of a group.
#[derive(Clone, Copy, Debug)]
enum Number {
    /// Boxes with an edge of 2^e.
    Boxes(usize),
    Voxels,
    Corners,
}

/// The stretches of records, in order, each with the bytes of an item.
#[derive(Clone, Debug)]
pub(in crate::builder) struct RecordForm {
    stretches: Vec<(RecordField, Number, usize)>,
}

impl RecordForm {
    pub(super) fn new(channels: &StoredChannels, depth: u32) -> Self {
        let levels = depth.min(BRICK_LEVELS) as usize;
        let brick = BRICK_LEVELS as usize;
        let mut stretches = vec![(RecordField::Summaries, Number::Boxes(brick), summary_bytes_of(channels))];
        stretches.extend((1..=levels).map(|e| (RecordField::Nodes(e), Number::Boxes(e), 1)));
        for (at, (channel, rule)) in channels.with_means().enumerate() {
            let item = channel.form.stored_bytes();
            let number = if channel.channel.row().is_sparse { Number::Corners } else { Number::Voxels };
            stretches.push((RecordField::Items(at), number, item));
            if rule.is_some() {
                stretches.extend((2..=levels).map(|e| (RecordField::Means(at, e), Number::Boxes(e), item)));
            }
        }
        Self { stretches }
    }

    /// The stretches of a group, each with its bytes.
    pub(super) fn lengths(&self, counts: GroupCounts) -> impl Iterator<Item = (RecordField, u64)> {
        let GroupCounts { boxes, voxels, corners } = counts;
        self.stretches.iter().map(move |(stretch, number, item)| {
            let count = match number {
                Number::Boxes(e) => boxes.get(e - 1).copied().unwrap_or(0),
                Number::Voxels => voxels,
                Number::Corners => corners,
            };
            (*stretch, u64::from(count) * *item as u64)
        })
    }

    /// Offset of a stretch in the record; `None` if it is not stored.
    pub(in crate::builder) fn offset(&self, counts: &GroupCounts, of: RecordField) -> Option<u64> {
        let mut offset = 0;
        for (stretch, bytes) in self.lengths(*counts) {
            if stretch == of {
                return Some(offset);
            }
            offset += bytes;
        }
        None
    }

    /// Bytes of a record.
    pub(in crate::builder) fn bytes(&self, counts: &GroupCounts) -> u64 {
        self.lengths(*counts).map(|(_, bytes)| bytes).sum()
    }
}

/// A group in the footer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Entry {
    /// Morton code of the group.
    pub(super) code: u64,
    /// Offset of its record.
    pub(super) offset: u64,
    pub(super) crc: u32,
    pub(super) counts: GroupCounts,
}

impl Entry {
    pub(super) fn to_bytes(self) -> [u8; ENTRY_BYTES] {
        let GroupCounts { boxes, voxels, corners } = self.counts;
        let mut bytes = [0; ENTRY_BYTES];
        bytes[..8].copy_from_slice(&self.code.to_le_bytes());
        bytes[8..16].copy_from_slice(&self.offset.to_le_bytes());
        let words = [self.crc].into_iter().chain(boxes).chain([voxels, corners]);
        for (at, word) in bytes[16..].as_chunks_mut::<4>().0.iter_mut().zip(words) {
            *at = word.to_le_bytes();
        }
        bytes
    }

    pub(super) fn parse(bytes: &[u8; ENTRY_BYTES]) -> Self {
        let number = |at: usize| u64::from_le_bytes(std::array::from_fn(|i| bytes[at + i]));
        let word = |k: usize| u32::from_le_bytes(std::array::from_fn(|i| bytes[16 + 4 * k + i]));
        let counts =
            GroupCounts { boxes: std::array::from_fn(|e| word(1 + e)), voxels: word(7), corners: word(8) };
        Self { code: number(0), offset: number(8), crc: word(0), counts }
    }

    /// True if a group can have these numbers.
    pub(super) fn is_sound(&self) -> bool {
        let GroupCounts { boxes, voxels, corners } = self.counts;
        let fits = |(count, e): (u32, u32)| (1..=(GROUP_VOXELS >> e).pow(3)).contains(&count);
        boxes.into_iter().zip(1..).all(fits)
            && (1..=GROUP_VOXELS.pow(3)).contains(&voxels)
            && corners <= voxels
            && boxes[BRICK_LEVELS as usize - 1] as usize <= GROUP_BRICKS
    }
}
