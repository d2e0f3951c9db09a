//! Bottom-up merge: bricks in Morton order become levels of infobytes and channels (the paper,
//! section 4), at places that the census has fixed before.
//!
//! Workers take groups of bricks in Morton order; a short critical section reads the group's index
//! entries and moves the cursors, so each worker knows where its bricks' bytes belong and writes them
//! without waiting for others. What lies above the bricks follows in one small sequential pass with a
//! queue of one open node per level.

use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::Path;
use std::sync::Mutex;

use super::brick::{BrickReader, Sums, infobytes};
use super::error::{BuildError, ScratchFault};
use super::layout::{BRICK_LEVELS, Census, Layout, SectionChoice, boxes_in_brick};
use super::swap::{BrickEntry, Scratch};
use super::value::ValueScale;
use super::walk::{BrickWalk, Found};
use crate::format::SectionKind;

/// Bytes that a run gathers before they are written.
const RUN_BYTES: usize = 32 << 10;
/// Runs of one worker at most: five levels of infobytes, four of means twice, two channels.
const RUNS: u64 = 15;
/// Memory of one worker.
pub(super) const WORKER_BYTES: u64 = BrickReader::BYTES + RUNS * RUN_BYTES as u64 + (64 << 10);
/// Bytes of a brick's summary in the scratch file.
const SUMMARY_BYTES: usize = 56;

/// The output file with the place of every section.
pub(super) struct Target<'a> {
    pub(super) file: &'a File,
    pub(super) path: &'a Path,
    pub(super) layout: &'a Layout,
    pub(super) choice: SectionChoice,
}

impl Target<'_> {
    pub(super) fn error(&self, cause: std::io::Error) -> BuildError {
        BuildError::Output { path: self.path.to_path_buf(), cause }
    }

    fn place(&self, kind: SectionKind, item: u64, item_bytes: u64) -> Option<u64> {
        self.layout.offset(kind).map(|offset| offset + item * item_bytes)
    }
}

/// Bytes for one stretch of a section, gathered and written at increasing offsets.
pub(super) struct Run {
    at: Option<u64>,
    bytes: Vec<u8>,
}

impl Run {
    /// A run that starts at `at`, or that drops everything when the section is not written.
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

/// Where the next group's bytes belong; advanced under a lock.
struct Cursors {
    walk: BrickWalk,
    /// Next node with an edge of 2^e, by e.
    node: [u64; BRICK_LEVELS as usize + 1],
    voxel: u64,
    brick: u64,
}

/// The merge, shared by its workers.
pub(super) struct Merge<'a> {
    scratch: &'a Scratch,
    target: &'a Target<'a>,
    census: &'a Census,
    scale: Option<ValueScale>,
    cursors: Mutex<Cursors>,
    summaries: u64,
}

/// A group of bricks with the places of its first boxes.
struct Group {
    node: [u64; BRICK_LEVELS as usize + 1],
    voxel: u64,
    brick: u64,
}

impl<'a> Merge<'a> {
    pub(super) fn new(
        dims: crate::geom::Dims,
        scratch: &'a Scratch,
        target: &'a Target<'a>,
        census: &'a Census,
        scale: Option<ValueScale>,
    ) -> Result<Self, BuildError> {
        let summaries_len = usize::try_from(census.bricks * SUMMARY_BYTES as u64)
            .map_err(|_| scratch.error(ScratchFault::TooManyBricks.into()))?;
        let mut node = [0; BRICK_LEVELS as usize + 1];
        for e in 1..=census.depth.min(BRICK_LEVELS) {
            node[e as usize] = census.first_node(e);
        }
        Ok(Self {
            scratch,
            target,
            census,
            scale,
            cursors: Mutex::new(Cursors { walk: BrickWalk::new(dims), node, voxel: 0, brick: 0 }),
            summaries: scratch.take(summaries_len),
        })
    }

    fn levels(&self) -> u32 {
        self.census.depth.min(BRICK_LEVELS)
    }

    /// Takes the next group, or `None` at the end.
    fn next(&self, found: &mut Vec<Found>) -> Result<Option<Group>, BuildError> {
        let mut cursors = self.cursors.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        if !cursors.walk.next_group(self.scratch, found)? {
            return Ok(None);
        }
        let group = Group { node: cursors.node, voxel: cursors.voxel, brick: cursors.brick };
        for (_, entry) in found.iter() {
            cursors.voxel += u64::from(entry.skin);
            cursors.brick += 1;
            for e in 1..=self.levels() {
                cursors.node[e as usize] += boxes_in_brick(entry, e);
            }
        }
        Ok(Some(group))
    }

    /// One worker: groups until there are none. Calls `progress` with the bricks done.
    pub(super) fn work(&self, stop: &dyn Fn() -> bool, progress: &dyn Fn(u64)) -> Result<(), BuildError> {
        let mut worker = MergeWorker::new();
        let mut found = Vec::new();
        while let (false, Some(group)) = (stop(), self.next(&mut found)?) {
            if !found.is_empty() {
                worker.emit(self, &group, &found)?;
                progress(found.len() as u64);
            }
        }
        Ok(())
    }

    /// What lies above the bricks, after all workers are done.
    pub(super) fn crown(&self) -> Result<(), BuildError> {
        let mut queue = MergeQueue::new(self.target, self.census);
        let mut bytes = vec![0; SUMMARY_BYTES * 512];
        let mut done = 0;
        while done < self.census.bricks {
            let now = (self.census.bricks - done).min(512) as usize;
            let part = &mut bytes[..now * SUMMARY_BYTES];
            self.scratch.read(part, self.summaries + done * SUMMARY_BYTES as u64)?;
            for raw in part.as_chunks::<SUMMARY_BYTES>().0 {
                let (code, sums) = parse_summary(raw);
                queue.push(code, &sums)?;
            }
            done += now as u64;
        }
        queue.finish()
    }
}

/// Buffers of one worker.
struct MergeWorker {
    reader: BrickReader,
    infobytes: [Vec<u8>; BRICK_LEVELS as usize],
    nodes: [Run; BRICK_LEVELS as usize],
    normal_lod: [Run; BRICK_LEVELS as usize],
    value_lod: [Run; BRICK_LEVELS as usize],
    normals: Run,
    values: Run,
    summaries: Vec<u8>,
}

impl MergeWorker {
    fn new() -> Self {
        let runs = || std::array::from_fn(|_| Run::new(None));
        Self {
            reader: BrickReader::new(),
            infobytes: Default::default(),
            nodes: runs(),
            normal_lod: runs(),
            value_lod: runs(),
            normals: Run::new(None),
            values: Run::new(None),
            summaries: Vec::new(),
        }
    }

    fn emit(&mut self, merge: &Merge<'_>, group: &Group, found: &[Found]) -> Result<(), BuildError> {
        let target = merge.target;
        let value_bytes = u64::from(target.choice.value_bytes);
        for e in 1..=merge.levels() as usize {
            let node = group.node[e];
            self.nodes[e - 1].restart(target.place(SectionKind::Nodes, node, 1));
            let coarse = e >= 2;
            self.normal_lod[e - 1].restart(target.place(SectionKind::NormalLod, node, 2).filter(|_| coarse));
            self.value_lod[e - 1]
                .restart(target.place(SectionKind::ValueLod, node, value_bytes).filter(|_| coarse));
        }
        self.normals.restart(target.place(SectionKind::Normal, group.voxel, 2));
        self.values.restart(target.place(SectionKind::Value, group.voxel, value_bytes));
        self.summaries.clear();
        for (code, entry) in found {
            self.emit_brick(merge, *code, entry)?;
        }
        let runs = self.nodes.iter_mut().chain(&mut self.normal_lod).chain(&mut self.value_lod);
        for run in runs.chain([&mut self.normals, &mut self.values]) {
            run.flush(target)?;
        }
        merge.scratch.write(&self.summaries, merge.summaries + group.brick * SUMMARY_BYTES as u64)
    }

    fn emit_brick(&mut self, merge: &Merge<'_>, code: u64, entry: &BrickEntry) -> Result<(), BuildError> {
        let target = merge.target;
        let choice = target.choice;
        self.reader.load(merge.scratch, entry, choice.normals, merge.scale.as_ref())?;
        infobytes(&self.reader.words, &mut self.infobytes);
        for e in 1..=merge.levels() as usize {
            self.nodes[e - 1].put(target, squeeze(&mut self.infobytes[e - 1]))?;
        }
        if choice.normals {
            self.normals.put(target, bytemuck::cast_slice(&self.reader.normals))?;
        }
        if choice.value_bytes == 1 {
            let narrow = self.reader.values.iter().map(|v| v.to_le_bytes()[0]);
            let narrow: &mut Vec<u8> = &mut narrow.collect();
            self.values.put(target, narrow)?;
        } else if choice.value_bytes == 2 {
            self.values.put(target, bytemuck::cast_slice(&self.reader.values))?;
        }
        let mut whole = Sums::default();
        if choice.lod {
            self.reader.sum_words();
            let mut boxes = self.reader.sums.len();
            for e in 2..=BRICK_LEVELS as usize {
                if e > 2 {
                    self.reader.fold_sums(boxes);
                    boxes /= 8;
                }
                for sums in self.reader.sums[..boxes].iter().filter(|s| s.count > 0) {
                    if e <= merge.levels() as usize {
                        self.normal_lod[e - 1].put(target, &sums.mean_normal().to_le_bytes())?;
                        let value = sums.mean_value().to_le_bytes();
                        self.value_lod[e - 1].put(target, &value[..usize::from(choice.value_bytes)])?;
                    }
                }
            }
            whole = self.reader.sums[0];
        }
        push_summary(&mut self.summaries, code, &whole);
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
            // Written whether it stays or not: no branch, and never beyond what was read already.
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

fn push_summary(out: &mut Vec<u8>, code: u64, sums: &Sums) {
    out.extend(code.to_le_bytes());
    sums.normal.iter().for_each(|c| out.extend(c.to_le_bytes()));
    out.extend(sums.value.to_le_bytes());
    out.extend(sums.count.to_le_bytes());
    out.extend(u64::from(sums.first).to_le_bytes());
}

fn parse_summary(raw: &[u8; SUMMARY_BYTES]) -> (u64, Sums) {
    let word = |i: usize| u64::from_le_bytes(std::array::from_fn(|k| raw[8 * i + k]));
    let sums = Sums {
        normal: std::array::from_fn(|a| word(1 + a).cast_signed()),
        value: word(4),
        count: word(5),
        #[expect(clippy::cast_possible_truncation, reason = "written from a u16")]
        first: word(6) as u16,
    };
    (word(0), sums)
}

/// One open node per level above the bricks: at most eight children arrive, in Morton order, before the
/// next sibling's first; then the node is complete and moves up. Memory does not depend on the tree.
struct MergeQueue<'a> {
    target: &'a Target<'a>,
    /// Levels of edge 2^6, 2^7 ... 2^depth.
    levels: Vec<OpenLevel>,
}

struct OpenLevel {
    code: u64,
    mask: u8,
    sums: Sums,
    nodes: Run,
    normals: Run,
    values: Run,
}

impl<'a> MergeQueue<'a> {
    fn new(target: &'a Target<'a>, census: &Census) -> Self {
        let levels = (BRICK_LEVELS + 1..=census.depth).map(|e| {
            let first = census.first_node(e);
            OpenLevel {
                code: 0,
                mask: 0,
                sums: Sums::default(),
                nodes: Run::new(target.place(SectionKind::Nodes, first, 1)),
                normals: Run::new(target.place(SectionKind::NormalLod, first, 2)),
                values: Run::new(target.place(
                    SectionKind::ValueLod,
                    first,
                    u64::from(target.choice.value_bytes),
                )),
            }
        });
        Self { target, levels: levels.collect() }
    }

    /// A finished brick.
    fn push(&mut self, code: u64, sums: &Sums) -> Result<(), BuildError> {
        self.push_from(0, code, sums)
    }

    /// A finished box below level `from`: joins its parent, and if that opens a new parent, the one
    /// before it is complete and moves up in turn.
    fn push_from(&mut self, from: usize, code: u64, sums: &Sums) -> Result<(), BuildError> {
        let (mut code, mut sums) = (code, *sums);
        for level in &mut self.levels[from..] {
            let parent = code >> 3;
            let finished = (level.mask != 0 && level.code != parent).then(|| level.take());
            level.code = parent;
            level.mask |= 1 << (code & 7);
            level.sums.add(&sums);
            let Some((done_code, mask, done_sums)) = finished else { return Ok(()) };
            level.write(self.target, mask, &done_sums)?;
            (code, sums) = (done_code, done_sums);
        }
        Ok(())
    }

    /// Completes the open nodes from the bottom up.
    fn finish(mut self) -> Result<(), BuildError> {
        for at in 0..self.levels.len() {
            let (code, mask, sums) = self.levels[at].take();
            if mask != 0 {
                self.levels[at].write(self.target, mask, &sums)?;
                self.push_from(at + 1, code, &sums)?;
            }
            let level = &mut self.levels[at];
            level.nodes.flush(self.target)?;
            level.normals.flush(self.target)?;
            level.values.flush(self.target)?;
        }
        Ok(())
    }
}

impl OpenLevel {
    fn take(&mut self) -> (u64, u8, Sums) {
        (self.code, std::mem::take(&mut self.mask), std::mem::take(&mut self.sums))
    }

    fn write(&mut self, target: &Target<'_>, mask: u8, sums: &Sums) -> Result<(), BuildError> {
        self.nodes.put(target, &[mask])?;
        self.normals.put(target, &sums.mean_normal().to_le_bytes())?;
        let value = sums.mean_value().to_le_bytes();
        self.values.put(target, &value[..usize::from(target.choice.value_bytes)])
    }
}
