//! Offsets of the output: counted from the index before a byte is written.

use super::error::BuildError;
use super::item::ChannelForm;
use super::solid::VoxelBox;
use super::swap::{BrickEntry, Scratch};
use super::walk::{BrickWalk, GROUP_BRICKS, WalkedBrick};
use crate::format::cell::{corner_blocks, leaf_blocks};
use crate::format::{
    ENTRY_BYTES, HEADER_BYTES, LabelForm, MeanRule, SectionEntry, SectionKind, align_up, rank,
};
use crate::geom::Dims;

/// Levels inside a brick: edges 2, 4, 8, 16, 32.
pub(super) const BRICK_LEVELS: u32 = 5;

/// Non-empty boxes with an edge of `2^e` voxels in one brick with skin, e in 1..=5.
pub(super) fn boxes_in_brick(entry: &BrickEntry, e: u32) -> u64 {
    entry.boxes.get(e as usize - 1).map_or(1, |n| u64::from(*n))
}

/// Numbers of boxes and voxels of a group of bricks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct GroupCounts {
    /// Non-empty boxes with an edge of 2, 4, 8, 16, 32 and 64 voxels.
    pub(super) boxes: [u32; BRICK_LEVELS as usize + 1],
    pub(super) voxels: u32,
    pub(super) corners: u32,
}

impl GroupCounts {
    pub(super) fn of(bricks: &[WalkedBrick]) -> Self {
        let mut counts = Self::default();
        let mut previous = None;
        for (code, entry) in bricks {
            counts.voxels += entry.skin;
            counts.corners += u32::from(entry.corners);
            for (count, e) in counts.boxes.iter_mut().zip(1..=BRICK_LEVELS) {
                #[expect(clippy::cast_possible_truncation, reason = "at most 16^3 in a brick")]
                let boxes = boxes_in_brick(entry, e) as u32;
                *count += boxes;
            }
            counts.boxes[BRICK_LEVELS as usize] += u32::from(previous != Some(code >> 3));
            previous = Some(code >> 3);
        }
        counts
    }

    /// Bricks with skin.
    pub(super) fn bricks(&self) -> u32 {
        self.boxes[BRICK_LEVELS as usize - 1]
    }
}

/// Numbers of boxes and voxels of the whole model.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Census {
    pub(super) depth: u32,
    pub(super) voxels: u64,
    /// Bricks with skin.
    pub(super) bricks: u64,
    /// Cells with corners.
    pub(super) corners: u64,
    /// Larger leaves with an edge of `2^e`, by e; index 0 is unused.
    leaves: [u64; BRICK_LEVELS as usize + 1],
    /// Nodes with an edge of `2^e`, by e; index 0 is unused.
    by_edge: [u64; 17],
    /// The last group counted.
    previous: Option<u64>,
}

impl Census {
    /// One sequential pass over the index of a box.
    pub(super) fn take(dims: Dims, region: &VoxelBox, scratch: &Scratch) -> Result<Self, BuildError> {
        let mut census = Self::new(dims.depth());
        let (mut walk, mut found) = (BrickWalk::of(region), Vec::new());
        while walk.next_group(scratch, &mut found)? {
            for (_, entry) in &found {
                for (all, leaves) in census.leaves[1..].iter_mut().zip(entry.leaves) {
                    *all += u64::from(leaves);
                }
            }
            if let Some((code, _)) = found.first() {
                census.add(code / GROUP_BRICKS as u64, &GroupCounts::of(&found));
            }
        }
        Ok(census)
    }

    /// An empty census.
    pub(super) fn new(depth: u32) -> Self {
        let (leaves, by_edge) = ([0; 6], [0; 17]);
        Self { depth, voxels: 0, bricks: 0, corners: 0, leaves, by_edge, previous: None }
    }

    /// Counts a non-empty group; their codes rise.
    pub(super) fn add(&mut self, code: u64, counts: &GroupCounts) {
        self.voxels += u64::from(counts.voxels);
        self.bricks += u64::from(counts.bricks());
        self.corners += u64::from(counts.corners);
        for (e, boxes) in (1..=self.depth).zip(counts.boxes) {
            self.by_edge[e as usize] += u64::from(boxes);
        }
        // A box of a group's edge or more is new whenever its own code changes.
        for e in BRICK_LEVELS + 2..=self.depth {
            let of = |c: u64| c >> (3 * (e - BRICK_LEVELS - 2));
            self.by_edge[e as usize] += u64::from(self.previous.map(of) != Some(of(code)));
        }
        self.previous = Some(code);
    }

    /// Number of the first node with an edge of `2^e` (nodes of longer edges come first).
    pub(super) fn first_node(&self, e: u32) -> u64 {
        (e + 1..=self.depth).map(|longer| self.by_edge[longer as usize]).sum()
    }

    /// Number of the first larger leaf with an edge of `2^e` (longer ones come first).
    pub(super) fn first_leaf(&self, e: u32) -> u64 {
        (e + 1..=BRICK_LEVELS).map(|longer| self.leaves[longer as usize]).sum()
    }

    /// Larger leaves.
    pub(super) fn leaves(&self) -> u64 {
        self.first_leaf(0)
    }

    pub(super) fn nodes(&self) -> u64 {
        self.first_node(0)
    }

    /// Nodes that carry means: an edge of 4 or more.
    pub(super) fn lod_nodes(&self) -> u64 {
        self.first_node(1)
    }

    /// Content of the `LEVL` section.
    pub(super) fn levels(&self) -> Vec<u8> {
        let starts = (0..=self.depth).map(|d| self.first_node(self.depth - d));
        starts.flat_map(u64::to_le_bytes).collect()
    }
}

/// The written channels, and whether coarse nodes have means.
#[derive(Clone, Debug)]
pub(super) struct StoredChannels {
    pub(super) forms: Vec<ChannelForm>,
    pub(super) lod: bool,
    /// True with larger leaves.
    pub(super) leaves: bool,
}

impl StoredChannels {
    /// True if the offsets announce corners.
    pub(super) fn has_corners(&self) -> bool {
        self.forms.iter().any(|c| c.channel.row().is_sparse)
    }

    /// Each channel with the rule of its means, if it has means.
    pub(super) fn with_means(&self) -> impl Iterator<Item = (&ChannelForm, Option<MeanRule>)> {
        let rule = |c: &ChannelForm| c.channel.row().means.as_ref().filter(|_| self.lod).map(|m| m.rule);
        self.forms.iter().map(move |c| (c, rule(c)))
    }
}

/// The section table of the output, with offsets, before any CRC.
#[derive(Clone, Debug, Default)]
pub(super) struct Layout {
    pub(super) entries: Vec<SectionEntry>,
    /// Offset of the labels of all voxels until their blocks are coded: behind all sections at their longest.
    pub(super) labels: u64,
}

impl Layout {
    pub(super) fn new(
        census: &Census,
        [metadata_bytes, table_bytes]: [u64; 2],
        labels: usize,
        channels: &StoredChannels,
    ) -> Self {
        let nodes = census.nodes();
        let fixed = [
            (SectionKind::Meta, 1, metadata_bytes),
            (SectionKind::LabelTable, 1, table_bytes),
            (SectionKind::Levels, 8, u64::from(census.depth) + 1),
            (SectionKind::Nodes, 1, nodes),
            (SectionKind::Rank, 1, rank::directory_bytes(nodes).1),
        ];
        #[expect(clippy::cast_possible_truncation, reason = "an item has at most 20 bytes")]
        let item_bytes = |c: &ChannelForm| c.form.stored_bytes() as u8;
        let means = channels
            .with_means()
            .filter(|(_, rule)| rule.is_some() && census.lod_nodes() > 0)
            .map(|(c, _)| (SectionKind::Means(c.channel), item_bytes(c), census.lod_nodes()));
        let voxels = channels.forms.iter().map(|c| {
            let kind = SectionKind::Voxels(c.channel);
            match c.channel.row() {
                row if row.is_sparse => (kind, item_bytes(c), census.corners),
                // Its length is known when the blocks are coded.
                row if row.is_coded => (kind, 1, LabelForm::of(labels).most_bytes(census.voxels)),
                _ => (kind, item_bytes(c), census.voxels),
            }
        });
        let corner_rank =
            channels.has_corners().then(|| (SectionKind::CornerRank, 8, corner_blocks(census.voxels)));
        let leaves = [
            (SectionKind::LeafNormals, 2, census.leaves()),
            (SectionKind::LeafOffsets, 1, census.leaves()),
            (SectionKind::LeafRank, 8, leaf_blocks(nodes)),
        ];
        let leaves = leaves.into_iter().filter(|_| channels.leaves);
        // Kind, bytes per item, items.
        let wanted: Vec<_> = fixed
            .into_iter()
            .filter(|f| f.0 != SectionKind::LabelTable || f.2 > 0)
            .chain(means)
            .chain(voxels)
            .chain(corner_rank)
            .chain(leaves)
            .collect();
        let mut end = (HEADER_BYTES + wanted.len() * ENTRY_BYTES) as u64;
        let mut entries = Vec::with_capacity(wanted.len());
        for (kind, item_bytes, items) in wanted {
            let entry = SectionEntry::plain(kind, item_bytes, items, align_up(end));
            end = entry.end();
            entries.push(entry);
        }
        Self { entries, labels: align_up(end) }
    }

    pub(super) fn offset(&self, kind: SectionKind) -> Option<u64> {
        self.entries.iter().find(|e| e.kind == Some(kind)).map(|e| e.offset)
    }
}
