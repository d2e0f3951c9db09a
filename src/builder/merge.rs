//! Bottom-up merge: bricks in Morton order become levels of infobytes and channels (the paper, section 4), at offsets
//! fixed by the census.
//!
//! Workers take groups of bricks in Morton order; a short critical section reads the group's index entries and moves
//! the cursors, so each worker knows the offsets of its bricks' bytes and writes them without waiting for others. The
//! levels above the bricks follow in one small sequential pass with a queue of one open node per level.

use std::fs::File;
use std::path::Path;
use std::sync::Mutex;

use super::brick::{BrickReader, channel_bytes, infobytes};
use super::error::BuildError;
use super::item::ChannelForm;
use super::layout::{BRICK_LEVELS, Census, GroupCounts, Layout, StoredChannels};
use super::parts::{RecordField, RecordForm};
use super::reduce::Reduced;
use super::solid::VoxelBox;
use super::swap::{BrickEntry, Scratch};
use super::walk::{BrickWalk, WalkedBrick};
use crate::budget::costs::MIN_WORKER;
use crate::builder::BuildFault;
use crate::format::{Channel, MeanRule, SectionKind, Sum};
use crate::platform::FileExt;
use crate::progress::Progress;

/// Bytes that a run gathers before they are written.
pub(super) const RUN_BYTES: usize = 32 << 10;
/// Summaries of bricks read at a time.
const SUMMARIES: usize = 512;
/// Levels above the bricks in the largest volume.
const UPPER_LEVELS: u64 = (16 - BRICK_LEVELS) as u64;

/// Small lists of a merging worker (chains of fragments, groups of bricks, summaries) at their longest: a column
/// of bricks that are all skin, `noise` in `scripts/memory.py`.
const MERGE_LISTS: u64 = 64 << 10;

fn runs(count: u64) -> u64 {
    count * RUN_BYTES as u64
}

/// Runs of a channel: one of its items, and four of means if it has them.
fn runs_of(channel: &ChannelForm) -> u64 {
    if channel.channel.row().means.is_some() { 5 } else { 1 }
}

/// Memory of one worker: a brick, runs for five levels of infobytes, and the runs of each channel.
pub(super) fn worker_bytes(channels: &[ChannelForm]) -> u64 {
    let own: u64 = channels.iter().map(|c| channel_bytes(c) + runs(runs_of(c))).sum();
    (BrickReader::BYTES + runs(5) + own + MERGE_LISTS).max(MIN_WORKER)
}

/// Memory of the levels above the bricks: for each level a run of infobytes and one of each channel's means, and
/// summaries.
pub(super) fn upper_bytes(channels: &[ChannelForm]) -> u64 {
    let means = channels.iter().filter(|c| c.channel.row().means.is_some()).count();
    runs((1 + means as u64) * UPPER_LEVELS) + (SUMMARIES * summary_bytes(means)) as u64
}

/// A brick's code and a sum for each channel that is averaged.
fn summary_bytes(means: usize) -> usize {
    size_of::<u64>() + means * Sum::BYTES
}

/// Bytes of a brick's summary.
pub(super) fn summary_bytes_of(channels: &StoredChannels) -> usize {
    summary_bytes(averaged(channels).count())
}

/// Parses a summary: returns its code; its sums replace those in `sums`.
pub(super) fn parse_summary(summary: &[u8], sums: &mut Vec<Sum>) -> u64 {
    sums.clear();
    let Some((code, raw)) = summary.split_first_chunk::<8>() else { return 0 };
    sums.extend(raw.as_chunks().0.iter().map(Sum::parse));
    u64::from_le_bytes(*code)
}

/// The output file with the offset of every section.
pub(super) struct Target<'a> {
    pub(super) file: &'a File,
    pub(super) path: &'a Path,
    pub(super) layout: &'a Layout,
    pub(super) channels: &'a StoredChannels,
    pub(super) progress: &'a dyn Progress,
}

impl Target<'_> {
    pub(super) fn error(&self, cause: std::io::Error) -> BuildError {
        BuildError::from(BuildFault::Output { path: self.path.to_path_buf(), cause })
    }

    pub(super) fn offset(&self, kind: SectionKind, item: u64, item_bytes: usize) -> Option<u64> {
        self.layout.offset(kind).map(|offset| offset + item * item_bytes as u64)
    }
}

/// Bytes for one stretch of a section, gathered and written at increasing offsets.
pub(super) struct Run {
    at: Option<u64>,
    bytes: Vec<u8>,
}

impl Run {
    /// A run that starts at `at`, or, with `None`, drops everything.
    pub(super) fn new(at: Option<u64>) -> Self {
        Self { at, bytes: Vec::new() }
    }

    fn restart(&mut self, at: Option<u64>) {
        debug_assert!(self.bytes.is_empty());
        self.at = at;
    }

    pub(super) fn put(&mut self, target: &Target<'_>, bytes: &[u8]) -> Result<(), BuildError> {
        if self.at.is_none() {
            return Ok(());
        }
        if self.bytes.len() + bytes.len() > RUN_BYTES {
            self.flush(target)?;
        }
        if bytes.len() < RUN_BYTES {
            self.bytes.reserve_exact(RUN_BYTES.saturating_sub(self.bytes.capacity()));
            self.bytes.extend_from_slice(bytes);
        } else if let Some(at) = &mut self.at {
            target.file.write_all_at(bytes, *at).map_err(|e| target.error(e))?;
            *at += bytes.len() as u64;
        }
        Ok(())
    }

    pub(super) fn flush(&mut self, target: &Target<'_>) -> Result<(), BuildError> {
        if let Some(at) = &mut self.at {
            target.file.write_all_at(&self.bytes, *at).map_err(|e| target.error(e))?;
            *at += self.bytes.len() as u64;
            self.bytes.clear();
        }
        Ok(())
    }
}

/// The state before the next group; advanced under a lock.
struct Cursors {
    walk: BrickWalk,
    next: Firsts,
}

pub(super) struct Merge<'a> {
    scratch: &'a Scratch,
    target: &'a Target<'a>,
    census: &'a Census,
    cursors: Mutex<Cursors>,
    /// Offset of the summaries of bricks in the scratch file, and length of one.
    summaries: u64,
    summary_bytes: usize,
    /// Form of the records when a part is built: each holds all bytes of a group.
    record: Option<&'a RecordForm>,
}

/// Numbers of the first boxes of a group of bricks.
#[derive(Clone, Copy)]
struct Firsts {
    /// First node with an edge of 2^e, by e.
    node: [u64; BRICK_LEVELS as usize + 1],
    voxel: u64,
    corners: u64,
    brick: u64,
    /// First larger leaf with an edge of 2^(i + 1).
    leaf: [u64; BRICK_LEVELS as usize],
    /// Offset of the group's record, in a part.
    record: u64,
}

/// A group of bricks.
struct Group {
    first: Firsts,
    counts: GroupCounts,
}

fn averaged(channels: &StoredChannels) -> impl Iterator<Item = (Channel, usize, MeanRule)> {
    channels.with_means().filter_map(|(c, rule)| Some((c.channel, c.form.stored_bytes(), rule?)))
}

impl<'a> Merge<'a> {
    pub(super) fn new(
        dims: crate::geom::Dims,
        scratch: &'a Scratch,
        target: &'a Target<'a>,
        census: &'a Census,
    ) -> Result<Self, BuildError> {
        let summary_bytes = summary_bytes_of(target.channels);
        let summaries_len = usize::try_from(census.bricks * summary_bytes as u64).map_err(|_| {
            scratch.error(std::io::Error::other("the model has too many bricks for this machine"))
        })?;
        let mut node = [0; BRICK_LEVELS as usize + 1];
        for e in 1..=census.depth.min(BRICK_LEVELS) {
            node[e as usize] = census.first_node(e);
        }
        Ok(Self {
            scratch,
            target,
            census,
            cursors: Mutex::new(Cursors {
                walk: BrickWalk::new(dims),
                next: Firsts {
                    node,
                    voxel: 0,
                    corners: 0,
                    brick: 0,
                    leaf: LEAF_EDGES.map(|e| census.first_leaf(e)),
                    record: 0,
                },
            }),
            summaries: scratch.take(summaries_len),
            summary_bytes,
            record: None,
        })
    }

    /// Writes the bricks of a box as records of a part, the first of them at `start`.
    pub(super) fn into_records(self, region: &VoxelBox, form: &'a RecordForm, start: u64) -> Self {
        let mut cursors = self.cursors.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner);
        cursors.walk = BrickWalk::of(region);
        cursors.next.record = start;
        Self { cursors: Mutex::new(cursors), record: Some(form), ..self }
    }

    /// Offset of a stretch of a group's bytes; `None` if it is not written.
    fn offset(&self, group: &Group, stretch: RecordField) -> Option<u64> {
        let Group { first, counts } = group;
        if let Some(form) = self.record {
            return form.offset(counts, stretch).map(|offset| first.record + offset);
        }
        let of = |at: usize| self.target.channels.forms.get(at);
        match stretch {
            RecordField::Nodes(e) => self.target.offset(SectionKind::Nodes, first.node[e], 1),
            RecordField::Items(at) => of(at).and_then(|ChannelForm { channel, form }| {
                let (row, bytes) = (channel.row(), form.stored_bytes());
                let item = if row.is_sparse { first.corners } else { first.voxel };
                match row.is_coded {
                    true => Some(self.target.layout.labels + item * bytes as u64),
                    false => self.target.offset(SectionKind::Voxels(*channel), item, bytes),
                }
            }),
            RecordField::Means(at, e) => of(at).and_then(|ChannelForm { channel, form }| {
                self.target.offset(SectionKind::Means(*channel), first.node[e], form.stored_bytes())
            }),
            RecordField::Summaries => Some(self.summaries + first.brick * self.summary_bytes as u64),
        }
    }

    fn levels(&self) -> u32 {
        self.census.depth.min(BRICK_LEVELS)
    }

    /// Takes the next group, or `None` at the end.
    fn next(&self, found: &mut Vec<WalkedBrick>) -> Result<Option<Group>, BuildError> {
        let mut cursors = self.cursors.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        if !cursors.walk.next_group(self.scratch, found)? {
            return Ok(None);
        }
        let group = Group { first: cursors.next, counts: GroupCounts::of(found) };
        let Group { counts, .. } = &group;
        let next = &mut cursors.next;
        next.voxel += u64::from(counts.voxels);
        next.corners += u64::from(counts.corners);
        next.brick += u64::from(counts.bricks());
        next.record += self.record.map_or(0, |form| form.bytes(counts));
        for (node, boxes) in next.node[1..].iter_mut().zip(counts.boxes) {
            *node += u64::from(boxes);
        }
        for (_, entry) in found.iter() {
            for (leaf, leaves) in next.leaf.iter_mut().zip(entry.leaves) {
                *leaf += u64::from(leaves);
            }
        }
        Ok(Some(group))
    }

    /// Runs one worker until the groups are exhausted. Calls `progress` with the bricks done.
    pub(super) fn work(&self, stop: &dyn Fn() -> bool, progress: &dyn Fn(u64)) -> Result<(), BuildError> {
        let mut worker = MergeWorker::new(self.target.channels);
        let mut found = Vec::new();
        while let (false, Some(group)) = (stop(), self.next(&mut found)?) {
            if !found.is_empty() {
                worker.emit(self, &group, &found)?;
                progress(found.len() as u64);
            }
        }
        Ok(())
    }

    /// Writes the levels above the bricks, after all workers are done.
    pub(super) fn finish_upper_levels(&self) -> Result<(), BuildError> {
        let mut queue = MergeQueue::new(self.target, self.census);
        let mut bytes = vec![0; self.summary_bytes * SUMMARIES];
        let mut sums = Vec::new();
        let mut done = 0;
        while done < self.census.bricks {
            self.target.progress.check()?;
            let now = usize::try_from(self.census.bricks - done).unwrap_or(SUMMARIES).min(SUMMARIES);
            let part = &mut bytes[..now * self.summary_bytes];
            self.scratch.read(part, self.summaries + done * self.summary_bytes as u64)?;
            for summary in part.chunks_exact(self.summary_bytes) {
                let code = parse_summary(summary, &mut sums);
                queue.push(code, &sums)?;
            }
            done += now as u64;
        }
        queue.finish()
    }
}

/// Base-2 logarithms of the edges of larger leaves.
const LEAF_EDGES: [u32; BRICK_LEVELS as usize] = [1, 2, 3, 4, 5];

struct ChannelRuns {
    items: Run,
    means: [Run; BRICK_LEVELS as usize],
}

struct MergeWorker {
    reader: BrickReader,
    infobytes: [Vec<u8>; BRICK_LEVELS as usize],
    nodes: [Run; BRICK_LEVELS as usize],
    /// Runs of each channel, in the reader's order.
    channels: Vec<ChannelRuns>,
    means: Vec<u8>,
    summaries: Vec<u8>,
    /// Runs of larger leaves: normals and offsets, by edge.
    leaves: [[Run; 2]; BRICK_LEVELS as usize],
    reduced: Reduced,
}

impl MergeWorker {
    fn new(channels: &StoredChannels) -> Self {
        let runs = || std::array::from_fn(|_| Run::new(None));
        Self {
            reader: BrickReader::new(channels),
            infobytes: Default::default(),
            nodes: runs(),
            channels: channels
                .forms
                .iter()
                .map(|_| ChannelRuns { items: Run::new(None), means: runs() })
                .collect(),
            means: Vec::new(),
            summaries: Vec::new(),
            leaves: std::array::from_fn(|_| [Run::new(None), Run::new(None)]),
            reduced: Reduced::default(),
        }
    }

    fn emit(&mut self, merge: &Merge<'_>, group: &Group, bricks: &[WalkedBrick]) -> Result<(), BuildError> {
        let target = merge.target;
        for e in 1..=merge.levels() as usize {
            self.nodes[e - 1].restart(merge.offset(group, RecordField::Nodes(e)));
        }
        for (at, runs) in self.channels.iter_mut().enumerate() {
            runs.items.restart(merge.offset(group, RecordField::Items(at)));
            for e in 2..=merge.levels() as usize {
                runs.means[e - 1].restart(merge.offset(group, RecordField::Means(at, e)));
            }
        }
        for ([normals, offsets], first) in self.leaves.iter_mut().zip(group.first.leaf) {
            normals.restart(target.offset(SectionKind::LeafNormals, first, 2));
            offsets.restart(target.offset(SectionKind::LeafOffsets, first, 1));
        }
        self.summaries.clear();
        for (code, entry) in bricks {
            if target.channels.leaves {
                self.emit_reduced(merge, *code, entry)?;
            } else {
                self.emit_brick(merge, *code, entry)?;
            }
        }
        for run in self.leaves.iter_mut().flatten() {
            run.flush(target)?;
        }
        for run in &mut self.nodes {
            run.flush(target)?;
        }
        for runs in &mut self.channels {
            runs.items.flush(target)?;
            runs.means.iter_mut().try_for_each(|run| run.flush(target))?;
        }
        let at = merge.offset(group, RecordField::Summaries).unwrap_or(0);
        match merge.record {
            Some(_) => target.file.write_all_at(&self.summaries, at).map_err(|e| target.error(e)),
            None => merge.scratch.write(&self.summaries, at),
        }
    }

    /// Writes a brick whose bytes have their final form in the scratch file.
    fn emit_reduced(&mut self, merge: &Merge<'_>, code: u64, entry: &BrickEntry) -> Result<(), BuildError> {
        let (target, scratch, levels) = (merge.target, merge.scratch, merge.levels() as usize);
        let Self { reduced, nodes, leaves, channels, summaries, reader, .. } = self;
        reduced.load(scratch, entry)?;
        for (run, e) in nodes.iter_mut().zip(1..=levels) {
            run.put(target, reduced.take(scratch, Reduced::nodes(entry, e))?)?;
        }
        for ([normals, offsets], count) in leaves.iter_mut().zip(entry.leaves).take(levels) {
            normals.put(target, reduced.take(scratch, 2 * usize::from(count))?)?;
            offsets.put(target, reduced.take(scratch, usize::from(count))?)?;
        }
        for (runs, channel) in channels.iter_mut().zip(&reader.channels) {
            let items = if channel.is_sparse() { entry.corners.into() } else { entry.skin };
            let item = channel.item_bytes();
            runs.items.put(target, reduced.take(scratch, items as usize * item)?)?;
            if channel.rule.is_some() {
                for (run, e) in runs.means[1..].iter_mut().zip(2..=levels) {
                    run.put(target, reduced.take(scratch, Reduced::nodes(entry, e) * item)?)?;
                }
            }
        }
        summaries.extend(code.to_le_bytes());
        let sums = merge.summary_bytes - size_of::<u64>();
        summaries.extend_from_slice(reduced.take(scratch, sums)?);
        Ok(())
    }

    fn emit_brick(&mut self, merge: &Merge<'_>, code: u64, entry: &BrickEntry) -> Result<(), BuildError> {
        let target = merge.target;
        let levels = merge.levels() as usize;
        self.reader.load(merge.scratch, entry)?;
        infobytes(&self.reader.words, &mut self.infobytes);
        for (run, infobytes) in self.nodes.iter_mut().zip(&mut self.infobytes).take(levels) {
            run.put(target, squeeze(infobytes))?;
        }
        if target.channels.lod {
            self.reader.sum_words();
        }
        self.summaries.extend(code.to_le_bytes());
        for (runs, channel) in self.channels.iter_mut().zip(&mut self.reader.channels) {
            if channel.is_sparse() {
                self.reader.corners.iter().try_for_each(|c| runs.items.put(target, channel.corner(*c)))?;
                continue;
            }
            runs.items.put(target, &channel.items)?;
            let mut boxes = channel.sums.len();
            for e in 2..=BRICK_LEVELS as usize {
                if e > 2 {
                    channel.fold_sums(boxes);
                    boxes /= 8;
                }
                if e <= levels {
                    channel.means(boxes, &mut self.means);
                    runs.means[e - 1].put(target, &self.means)?;
                }
            }
            if let Some(whole) = channel.sums.first() {
                self.summaries.extend(whole.to_bytes());
            }
        }
        Ok(())
    }
}

/// Moves the bytes that are not zero to the front and returns them.
fn squeeze(bytes: &mut [u8]) -> &[u8] {
    let mut kept = 0;
    for at in 0..bytes.len() / 8 {
        let eight: [u8; 8] = std::array::from_fn(|i| bytes[8 * at + i]);
        if eight == [0; 8] {
            continue;
        }
        for byte in eight {
            // Written in any case: no branch, and never beyond the bytes already read.
            bytes[kept] = byte;
            kept += usize::from(byte != 0);
        }
    }
    for at in bytes.len() / 8 * 8..bytes.len() {
        let byte = bytes[at];
        bytes[kept] = byte;
        kept += usize::from(byte != 0);
    }
    &bytes[..kept]
}

/// One open node per level above the bricks: at most eight children arrive, in Morton order, before the
/// next sibling's first; then the node is complete and moves up. Memory does not depend on the tree.
pub(super) struct MergeQueue<'a> {
    target: &'a Target<'a>,
    /// Levels of edge 2^6, 2^7 ... 2^depth.
    levels: Vec<OpenLevel>,
}

struct OpenLevel {
    code: u64,
    mask: u8,
    /// Sums of each averaged channel.
    sums: Vec<Sum>,
    nodes: Run,
    means: Vec<Run>,
}

impl<'a> MergeQueue<'a> {
    pub(super) fn new(target: &'a Target<'a>, census: &Census) -> Self {
        let levels = (BRICK_LEVELS + 1..=census.depth).map(|e| {
            let first = census.first_node(e);
            let means = averaged(target.channels);
            OpenLevel {
                code: 0,
                mask: 0,
                sums: vec![Sum::default(); averaged(target.channels).count()],
                nodes: Run::new(target.offset(SectionKind::Nodes, first, 1)),
                means: means
                    .map(|(c, item, _)| Run::new(target.offset(SectionKind::Means(c), first, item)))
                    .collect(),
            }
        });
        Self { target, levels: levels.collect() }
    }

    pub(super) fn push(&mut self, code: u64, sums: &[Sum]) -> Result<(), BuildError> {
        self.push_from(0, code, sums.to_vec())
    }

    /// Adds a finished box below level `from` to its parent; if that opens a new parent, the previous one is complete
    /// and moves up in turn.
    fn push_from(&mut self, from: usize, code: u64, sums: Vec<Sum>) -> Result<(), BuildError> {
        let (mut code, mut sums) = (code, sums);
        for level in &mut self.levels[from..] {
            let parent = code >> 3;
            let finished = (level.mask != 0 && level.code != parent).then(|| level.take());
            level.code = parent;
            level.mask |= 1 << (code & 7);
            for (sum, more) in level.sums.iter_mut().zip(&sums) {
                sum.join(more);
            }
            let Some((done_code, mask, done_sums)) = finished else { return Ok(()) };
            level.write(self.target, mask, &done_sums)?;
            (code, sums) = (done_code, done_sums);
        }
        Ok(())
    }

    /// Completes the open nodes from the bottom up.
    pub(super) fn finish(mut self) -> Result<(), BuildError> {
        for at in 0..self.levels.len() {
            let (code, mask, sums) = self.levels[at].take();
            if mask != 0 {
                self.levels[at].write(self.target, mask, &sums)?;
                self.push_from(at + 1, code, sums)?;
            }
            let level = &mut self.levels[at];
            level.nodes.flush(self.target)?;
            level.means.iter_mut().try_for_each(|run| run.flush(self.target))?;
        }
        Ok(())
    }
}

impl OpenLevel {
    fn take(&mut self) -> (u64, u8, Vec<Sum>) {
        let empty = vec![Sum::default(); self.sums.len()];
        (self.code, std::mem::take(&mut self.mask), std::mem::replace(&mut self.sums, empty))
    }

    fn write(&mut self, target: &Target<'_>, mask: u8, sums: &[Sum]) -> Result<(), BuildError> {
        self.nodes.put(target, &[mask])?;
        for ((run, sum), (_, item, rule)) in self.means.iter_mut().zip(sums).zip(averaged(target.channels)) {
            run.put(target, &rule.mean(sum)[..item])?;
        }
        Ok(())
    }
}
