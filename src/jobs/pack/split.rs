//! A model of labels into a model for each of its labels.
//!
//! ```text
//!   model  --one walk-->  cells in Morton order  --label-->  chains of chunks in one scratch file
//!   chain of a label      --one after the other-->  levels, items, labels of its model; then directory, means, checksums
//! ```
//!
//! A cell goes to each of its labels, with the walls that part it from the others: neighbours share them.

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

use super::Stop;
use super::stream::Writer;
use super::strip::complete;
use crate::atomic::AtomicFile;
use crate::budget::{Budget, MemoryCap};
use crate::builder::{BuildError, BuildFault};
use crate::error::Error;
use crate::format::cell::{CornerRankBuilder, HAS_CORNERS, corner_blocks};
use crate::format::{
    Channel, Encoding, FormatError, LABEL_ENTRY, LABEL_GROUP, Label, LabelForm, SectionEntry, SectionKind,
    WALL_BYTES, WallCode, WallItem, label_directory_bytes, labels_to_bytes,
};
use crate::geom::Level;
use crate::jobs::export::with_labels;
use crate::load::{Cursor, Frame};
use crate::platform::{FileExt, PositionalFile};
use crate::progress::Progress;
use crate::scratch::{Chains, unnamed};

/// Most levels of nodes.
const MAX_LEVELS: usize = 16;
/// Bytes of a cursor over a level, and of one over items.
const LEVEL_BUFFER: usize = 16 << 10;
const ITEM_BUFFER: usize = 64 << 10;
/// Memory for reading one model and writing another: cursors, writers, the walk of means.
const STREAMS: u64 = 1536 << 10;
/// Bytes of a chunk at most, and of the chunks of all labels together, as far as a record fits.
const MAX_CHUNK: usize = 8 << 10;
const ALL_CHUNKS: usize = 256 << 10;
/// Bytes of a record's Morton code.
const WORD: usize = size_of::<u64>();

/// Writes the model of each label of the model at `input` to its path in `outputs`, and returns its cells and bytes; 0
/// for a label that has no cells, and no model.
///
/// Memory: under 2 MiB for as many labels as a thousand, and some 250 bytes for each more; a refusal names `name`. Temporary disk: 8 bytes for each label of a cell
/// and its items. Cost: some 0.1 microseconds for each, and a sync of each model.
///
/// # Errors
/// The input is not a mapped model of labels, or is damaged; an output cannot be written, or the memory is too small.
/// Models before the one that failed stay, each whole.
pub(crate) fn split(
    (input, name): (&Path, &str),
    outputs: &[PathBuf],
    scratch: &Path,
    memory: MemoryCap,
    progress: &dyn Progress,
) -> Result<Vec<[u64; 2]>, Error> {
    let unwritable = |cause| Error::Output { path: scratch.to_path_buf(), cause };
    let at = |stop, output: &Path| match stop {
        Stop::Input(fault) => Error::Load(fault.at(input)),
        Stop::Output(cause) => Error::Output { path: output.to_path_buf(), cause },
    };
    let source = PositionalFile::open(input).map_err(|cause| at(Stop::Input(cause.into()), input))?;
    let frame = Frame::read(&source).map_err(|fault| at(fault.into(), input))?;
    if frame.labels.is_empty() || frame.header.encoding != Encoding::Mapped {
        return Err(with_labels("split", input).into());
    }
    let layout = Layout::of(&frame);
    let labels = frame.labels.len();
    let held = Chains::memory_bytes(labels, layout.chunk) + (labels * size_of::<Bucket>()) as u64;
    let _memory = Budget::of(memory).reserve(STREAMS + held).map_err(|refused| {
        let limit_bytes = memory.bytes();
        let minimum_bytes = limit_bytes.saturating_add(refused.missing_bytes());
        BuildError::from(BuildFault::BudgetTooSmall { name: name.to_owned(), limit_bytes, minimum_bytes })
    })?;
    let file = unnamed(scratch).map_err(unwritable)?;
    let mut buckets = Buckets::new(file, &frame, layout);
    buckets.fill(&source, &frame, progress).map_err(|stop| at(stop, scratch))?;
    progress.check().map_err(|_| Error::Stopped)?;
    progress.stage("labels", frame.labels.len() as u64);
    let mut made = Vec::with_capacity(frame.labels.len());
    let buckets = &buckets;
    for (((number, bucket), label), output) in buckets.all.iter().enumerate().zip(&frame.labels).zip(outputs)
    {
        progress.step(1).map_err(|_| Error::Stopped)?;
        if bucket.voxels == 0 {
            made.push([0; 2]);
            continue;
        }
        let unwritable = |cause| Error::Output { path: output.clone(), cause };
        let out = AtomicFile::create(output).map_err(unwritable)?;
        let model =
            write(buckets, (number, bucket), &frame, label, out.file()).map_err(|stop| at(stop, output))?;
        out.commit().map_err(unwritable)?;
        made.push([bucket.voxels, model.header.file_bytes]);
    }
    Ok(made)
}

/// Channels with an item for each voxel, with the bytes of an item.
fn items_of(frame: &Frame) -> impl Iterator<Item = (Channel, usize)> + '_ {
    frame
        .channels()
        .filter(|(channel, _)| !matches!(channel, Channel::Label | Channel::Corners))
        .map(|(channel, bytes)| (channel, bytes.into()))
}

/// Layout of a record: the voxel's Morton code and items, and the item of walls of a cell whose offset marks one.
#[derive(Clone, Copy)]
struct Layout {
    /// Bytes of the code and the items.
    record: usize,
    /// Most bytes of the records of a chunk.
    chunk: usize,
    /// Positions of the normal's code and of the offset.
    normal: usize,
    offset: usize,
}

impl Layout {
    fn of(frame: &Frame) -> Self {
        let place = |wanted| {
            let before = items_of(frame).take_while(|(channel, _)| *channel != wanted);
            WORD + before.map(|(_, bytes)| bytes).sum::<usize>()
        };
        let record = WORD + items_of(frame).map(|(_, bytes)| bytes).sum::<usize>();
        let [normal, offset] = [Channel::Normal, Channel::Offset].map(place);
        let chunk = (ALL_CHUNKS / frame.labels.len().max(1)).clamp(record + WALL_BYTES, MAX_CHUNK);
        Self { record, chunk, normal, offset }
    }

    /// True if the record of a cell has an item of walls.
    fn has_item(&self, record: &[u8]) -> bool {
        record.get(self.offset) == Some(&HAS_CORNERS.cast_unsigned())
    }

    /// The walls of a cell.
    fn read(&self, record: &[u8]) -> Option<WallCode> {
        let item = record.get(self.record..).and_then(|rest| rest.first_chunk());
        Some(WallCode {
            code: u16::from_le_bytes(*record.get(self.normal..)?.first_chunk()?),
            offset: record.get(self.offset)?.cast_signed(),
            item: item.map(WallItem::parse),
        })
    }

    /// Replaces the walls of a cell.
    fn put(&self, cell: &WallCode, record: &mut Vec<u8>) {
        let Self { normal, offset, .. } = *self;
        record.truncate(self.record);
        record.splice(normal..normal + 2, cell.code.to_le_bytes());
        record.splice(offset..=offset, [cell.offset.cast_unsigned()]);
        record.extend(cell.item.into_iter().flat_map(WallItem::to_bytes));
    }
}

/// The voxels of a model in Morton order, from one cursor for each level and channel.
struct Voxels<'a> {
    levels: Vec<Cursor<'a, PositionalFile>>,
    /// Path of open nodes: octants still to be visited, and the node's code.
    path: Vec<(u8, u64)>,
    items: Vec<(usize, Cursor<'a, PositionalFile>)>,
    corners: Cursor<'a, PositionalFile>,
    directory: Cursor<'a, PositionalFile>,
    blocks: Cursor<'a, PositionalFile>,
    form: LabelForm,
    left: u64,
    /// Labels of the present group in the order of the blocks, reversed.
    group: Vec<u32>,
}

impl<'a> Voxels<'a> {
    fn new(source: &'a PositionalFile, frame: &Frame) -> Result<Self, FormatError> {
        let entry = |kind| frame.section(kind).ok_or(FormatError::MissingSection(kind));
        let (nodes, labels) = (entry(SectionKind::Nodes)?, entry(SectionKind::Voxels(Channel::Label))?);
        let level = |d| {
            let level = frame.level(Level::new(d));
            Cursor::new(source, nodes.offset + level.start, nodes.offset + level.end, LEVEL_BUFFER)
        };
        let cursor = |entry: &SectionEntry| Cursor::new(source, entry.offset, entry.end(), ITEM_BUFFER);
        let items = |(channel, bytes)| Ok((bytes, cursor(entry(SectionKind::Voxels(channel))?)));
        let middle = labels.offset + label_directory_bytes(frame.header.voxels);
        Ok(Self {
            levels: (0..frame.dims().depth()).map(level).collect(),
            path: Vec::with_capacity(MAX_LEVELS),
            items: items_of(frame).map(items).collect::<Result<_, FormatError>>()?,
            corners: cursor(entry(SectionKind::Voxels(Channel::Corners))?),
            directory: Cursor::new(source, labels.offset, middle, LEVEL_BUFFER),
            blocks: Cursor::new(source, middle, labels.end(), ITEM_BUFFER),
            form: frame.label_form(),
            left: frame.header.voxels,
            group: Vec::new(),
        })
    }

    /// Appends the record of the next voxel, and returns its labels as the blocks have them; `None` at the end.
    fn next(&mut self, layout: &Layout, record: &mut Vec<u8>) -> Result<Option<u32>, Stop> {
        let missing = |channel| Stop::from(FormatError::MissingItem { kind: SectionKind::Voxels(channel) });
        if self.left == 0 {
            return Ok(None);
        }
        if self.group.is_empty() {
            self.next_group()?;
        }
        self.left -= 1;
        let code = self.next_code()?.ok_or(FormatError::MissingItem { kind: SectionKind::Nodes })?;
        record.extend(code.to_le_bytes());
        for (bytes, items) in &mut self.items {
            record.extend(items.take_item(*bytes)?.ok_or(missing(Channel::Normal))?);
        }
        if layout.has_item(record) {
            record.extend(self.corners.take_item(WALL_BYTES)?.ok_or(missing(Channel::Corners))?);
        }
        Ok(self.group.pop())
    }

    fn next_code(&mut self) -> Result<Option<u64>, Stop> {
        if self.levels.is_empty() {
            return Ok(Some(0));
        }
        if self.path.is_empty() {
            self.enter(0)?;
        }
        while let Some((rest, code)) = self.path.last_mut() {
            if *rest == 0 {
                self.path.pop();
                continue;
            }
            let child = *code << 3 | u64::from(rest.trailing_zeros());
            *rest &= rest.wrapping_sub(1);
            if self.path.len() == self.levels.len() {
                return Ok(Some(child));
            }
            self.enter(child)?;
        }
        Ok(None)
    }

    fn enter(&mut self, code: u64) -> Result<(), Stop> {
        let node = match self.levels.get_mut(self.path.len()) {
            Some(level) => level.take::<1>()?,
            None => None,
        };
        let [infobyte] = node.ok_or(FormatError::MissingItem { kind: SectionKind::Nodes })?;
        self.path.push((infobyte, code));
        Ok(())
    }

    fn next_group(&mut self) -> Result<(), Stop> {
        let wrong = || FormatError::MissingItem { kind: SectionKind::Voxels(Channel::Label) };
        let entry = self.directory.take::<LABEL_ENTRY>()?.ok_or_else(wrong)?;
        let sizes = entry.last_chunk().ok_or_else(wrong)?;
        let count = usize::try_from(self.left).unwrap_or(LABEL_GROUP).min(LABEL_GROUP);
        let room = usize::try_from(self.blocks.left()).unwrap_or(usize::MAX).min(4 * LABEL_GROUP);
        let bytes = self.blocks.peek(room)?.ok_or_else(wrong)?;
        let (labels, used) = self.form.decode_group(sizes, bytes, count).ok_or_else(wrong)?;
        self.blocks.skip(used);
        self.group = labels;
        self.group.reverse();
        Ok(())
    }
}

/// Totals of the records of one label.
struct Bucket {
    /// Code of the last record.
    last: u64,
    voxels: u64,
    /// Cells with an item of walls.
    items: u64,
    /// Nodes of each level.
    nodes: [u64; MAX_LEVELS],
}

/// The records of all labels.
struct Buckets {
    records: Chains,
    depth: usize,
    layout: Layout,
    all: Vec<Bucket>,
}

/// Number of levels of nodes that two codes of voxels share, out of `depth`.
fn shared_levels(a: u64, b: u64, depth: usize) -> usize {
    let bits = (u64::BITS - (a ^ b).leading_zeros()) as usize;
    (depth + 1).saturating_sub(bits.div_ceil(3)).min(depth)
}

impl Buckets {
    fn new(file: File, frame: &Frame, layout: Layout) -> Self {
        let bucket = || Bucket { last: 0, voxels: 0, items: 0, nodes: [0; MAX_LEVELS] };
        let labels = frame.labels.len();
        let all = std::iter::repeat_with(bucket).take(labels).collect();
        let records = Chains::new(file, labels, layout.chunk);
        Self { records, depth: frame.dims().depth() as usize, layout, all }
    }

    /// Adds every cell of a model to the records of each of its labels.
    fn fill(&mut self, source: &PositionalFile, frame: &Frame, progress: &dyn Progress) -> Result<(), Stop> {
        let mut voxels = Voxels::new(source, frame)?;
        let (form, layout) = (frame.label_form(), self.layout);
        let (mut record, mut own) = (Vec::with_capacity(self.layout.chunk), Vec::new());
        let (mut known, mut count) = (None::<(u32, [u16; 2], usize)>, 0_u64);
        while let Some(entry) = voxels.next(&layout, &mut record)? {
            let wrong = || FormatError::LabelBlocks { first: count, last: count };
            let place = |number: u16| {
                frame.labels.binary_search_by_key(&number, |label| label.number).map_err(|_| wrong())
            };
            let (_, numbers, at) = match known {
                Some(same) if same.0 == entry => same,
                _ => {
                    let numbers = form.numbers(entry, &frame.labels).ok_or_else(wrong)?;
                    *known.insert((entry, numbers, place(numbers[0])?))
                }
            };
            let Some(cell) = layout.read(&record) else { return Err(wrong().into()) };
            for label in cell.labels(numbers) {
                own.clone_from(&record);
                layout.put(&cell.alone(label, numbers[0]), &mut own);
                self.push(if label == numbers[0] { at } else { place(label)? }, &own)?;
            }
            record.clear();
            count += 1;
            if count.is_multiple_of(1 << 16) {
                progress.check().map_err(io::Error::other).map_err(Stop::Output)?;
            }
        }
        Ok(())
    }

    fn push(&mut self, at: usize, record: &[u8]) -> Result<(), Stop> {
        let (depth, layout) = (self.depth, self.layout);
        let Some((bucket, code)) = self.all.get_mut(at).zip(record.first_chunk()) else { return Ok(()) };
        let code = u64::from_le_bytes(*code);
        let shared = if bucket.voxels == 0 { 0 } else { shared_levels(bucket.last, code, depth) };
        bucket.nodes[shared..depth].iter_mut().for_each(|nodes| *nodes += 1);
        (bucket.last, bucket.voxels) = (code, bucket.voxels + 1);
        bucket.items += u64::from(layout.has_item(record));
        self.records.push(at, record).map_err(Stop::Output)
    }

    /// Calls `found` with the records of a label, in their order: code, items and item of walls.
    fn for_each(
        &self,
        label: usize,
        mut found: impl FnMut(u64, &[u8], &[u8]) -> Result<(), Stop>,
    ) -> Result<(), Stop> {
        let record = self.layout.record;
        self.records.for_each_chunk(label, Stop::Output, |mut rest| {
            while rest.len() >= record {
                let length = if self.layout.has_item(rest) { record + WALL_BYTES } else { record };
                let (one, after) = rest.split_at(length.min(rest.len()));
                let (items, walls) = one.split_at(record);
                let (code, items) = items.split_first_chunk().unwrap_or((&[0; WORD], &[]));
                found(u64::from_le_bytes(*code), items, walls)?;
                rest = after;
            }
            Ok(())
        })
    }
}

/// The frame of a label's model, without checksums.
fn lay_out(bucket: &Bucket, frame: &Frame, label: &Label) -> Result<Frame, Stop> {
    let mut own = frame.clone();
    let depth = frame.dims().depth() as usize;
    let mut first = 0;
    own.levels = vec![0];
    for nodes in &bucket.nodes[..depth] {
        first += nodes;
        own.levels.push(first);
    }
    (own.header.voxels, own.header.nodes) = (bucket.voxels, first);
    let number = f64::from(label.number);
    (own.metadata.selection.lo, own.metadata.selection.hi) = (number, number);
    own.metadata_bytes = own.metadata.to_bytes()?;
    own.labels = vec![label.clone()];
    let table = labels_to_bytes(&own.labels)?.len() as u64;
    // A palette of one label takes two bytes a block.
    let coded = label_directory_bytes(bucket.voxels) + 2 * bucket.voxels.div_ceil(LABEL_BLOCK);
    for entry in &mut own.sections {
        match entry.kind {
            Some(SectionKind::LabelTable) => entry.items = table,
            Some(SectionKind::Voxels(Channel::Label)) => entry.items = coded,
            Some(SectionKind::Voxels(Channel::Corners)) => entry.items = bucket.items,
            Some(SectionKind::CornerRank) => entry.items = corner_blocks(bucket.voxels),
            _ => {}
        }
    }
    own.place_sections();
    Ok(own)
}

/// Voxels of a block of labels.
const LABEL_BLOCK: u64 = (LABEL_GROUP / 8) as u64;

/// Writes the model of one label.
fn write(
    buckets: &Buckets,
    (number, bucket): (usize, &Bucket),
    frame: &Frame,
    label: &Label,
    out: &File,
) -> Result<Frame, Stop> {
    let mut own = lay_out(bucket, frame, label)?;
    let depth = buckets.depth;
    let place = |kind| own.section(kind).ok_or(FormatError::MissingSection(kind));
    let nodes = place(SectionKind::Nodes)?.offset;
    let mut levels: Vec<Writer<'_>> =
        own.levels.windows(2).take(depth).map(|l| Writer::new(out, nodes + l[0], nodes + l[1])).collect();
    let writer = |entry: &SectionEntry| Writer::new(out, entry.offset, entry.end());
    let mut items: Vec<(usize, Writer<'_>)> = items_of(frame)
        .map(|(channel, bytes)| Ok((bytes, writer(place(SectionKind::Voxels(channel))?))))
        .collect::<Result<_, FormatError>>()?;
    let mut walls = Walls::new(&own, out)?;
    let (mut open, mut last) = ([0_u8; MAX_LEVELS], None);
    let mut close = |open: &mut [u8; MAX_LEVELS], from: usize| {
        (from..depth)
            .rev()
            .try_for_each(|d| levels[d].write(&[std::mem::take(&mut open[d])]))
            .map_err(Stop::Output)
    };
    buckets.for_each(number, |code, bytes, item| {
        let shared = last.replace(code).map_or(0, |last| shared_levels(last, code, depth));
        if bucket.voxels > 0 && open[0] != 0 {
            close(&mut open, shared)?;
        }
        // The path down to a shared node is shared, too; the node above the difference has one more child.
        for (d, node) in open.iter_mut().enumerate().take(depth).skip(shared.saturating_sub(1)) {
            *node |= 1 << (code >> (3 * (depth - 1 - d)) & 7);
        }
        walls.put(bytes[buckets.layout.offset - WORD], item).map_err(Stop::Output)?;
        let mut rest = bytes;
        items.iter_mut().try_for_each(|(bytes, writer)| {
            let (item, after) = rest.split_at(*bytes);
            rest = after;
            writer.write(item).map_err(Stop::Output)
        })
    })?;
    walls.flush().map_err(Stop::Output)?;
    close(&mut open, 0)?;
    levels.iter_mut().try_for_each(Writer::flush).map_err(Stop::Output)?;
    items.iter_mut().try_for_each(|(_, writer)| writer.flush()).map_err(Stop::Output)?;
    write_labels(&own, &mut writer(place(SectionKind::Voxels(Channel::Label))?))?;
    let small = [
        (SectionKind::Meta, own.metadata_bytes.clone()),
        (SectionKind::Levels, own.levels.iter().flat_map(|level| level.to_le_bytes()).collect()),
        (SectionKind::LabelTable, labels_to_bytes(&own.labels)?),
    ];
    let quantity = own.quantity.as_ref().map(|quantity| (SectionKind::Quantity, quantity.to_bytes()));
    for (kind, bytes) in small.into_iter().chain(quantity) {
        out.write_all_at(&bytes, place(kind)?.offset).map_err(Stop::Output)?;
    }
    complete(&mut own, out)?;
    Ok(own)
}

/// Writers of the items of walls and of their directory.
struct Walls<'a> {
    items: Writer<'a>,
    directory: Writer<'a>,
    rank: CornerRankBuilder,
}

impl<'a> Walls<'a> {
    fn new(own: &Frame, out: &'a File) -> Result<Self, FormatError> {
        let entry = |kind| own.section(kind).ok_or(FormatError::MissingSection(kind));
        let writer = |kind| entry(kind).map(|entry| Writer::new(out, entry.offset, entry.end()));
        let items = writer(SectionKind::Voxels(Channel::Corners))?;
        Ok(Self { items, directory: writer(SectionKind::CornerRank)?, rank: CornerRankBuilder::default() })
    }

    /// The next cell, by its offset.
    fn put(&mut self, offset: u8, item: &[u8]) -> io::Result<()> {
        let mut due = None;
        self.rank.feed(&[offset], |block| due = Some(block.to_le_bytes()));
        due.map_or(Ok(()), |block| self.directory.write(&block))?;
        self.items.write(item)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.items.flush()?;
        self.directory.flush()
    }
}

/// Writes directory and blocks of voxels that all have the single label of a model.
fn write_labels(own: &Frame, writer: &mut Writer<'_>) -> Result<(), Stop> {
    let mut left = own.header.voxels;
    let mut at = label_directory_bytes(left);
    let form = own.label_form();
    let [low, high] = own.labels.first().map_or(0, |label| label.number).to_le_bytes();
    let entry = form.entry(&[low, high, 0, 0], &own.labels).unwrap_or(0);
    let (mut blocks, mut group) = (Vec::new(), vec![entry; LABEL_GROUP]);
    let mut all = Vec::new();
    while left > 0 {
        let count = usize::try_from(left).unwrap_or(LABEL_GROUP).min(LABEL_GROUP);
        group.truncate(count);
        blocks.clear();
        writer.write(&form.encode_group(&group, at, &mut blocks)).map_err(Stop::Output)?;
        at += blocks.len() as u64;
        all.extend_from_slice(&blocks);
        left -= count as u64;
    }
    writer.write(&all).and_then(|()| writer.flush()).map_err(Stop::Output)
}
