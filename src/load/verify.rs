//! The full check of a mapped file: every invariant of SPEC 6, in one small fixed amount of memory.
//!
//! Boxes of one depth are stored in Morton order, so a depth-first walk meets the nodes of every depth in that order:
//! one sequential cursor per depth and channel suffices, without any rank.

use crate::format::{
    Channel, FormatError, LABEL_ENTRY, LABEL_GROUP, MeanRule, SectionEntry, SectionKind, SelectionKind, Sum,
    SurfaceKind, WALL_BYTES, cell, damaged, label_directory_bytes, number, rank,
};
use crate::geom::{Level, NodeIndex, Octant, VoxelIndex};

use super::frame::{Frame, check_crc};
use super::leaves::{LeafNormals, check_leaves};
use super::stream::{Cursor, Fault, ReadAt};
use super::walls::WalledCells;

/// Bytes of one cursor's buffer; a walk holds one per depth and one per channel,
/// a check of the means one more per channel and depth.
const CURSOR_BYTES: usize = 16 << 10;

/// Checks every invariant of a mapped file (SPEC I1 to I23).
///
/// Memory: under 2 MiB for any file. Cost: three passes over the nodes, two over the rest.
///
/// # Errors
/// The first rule that is broken, or a failure to read; [`FormatError::Packed`] for a packed file.
pub fn verify<R: ReadAt + ?Sized>(source: &R) -> Result<Frame, Fault> {
    let frame = Frame::read(source)?;
    frame.refuse_packed()?;
    check_storage(source, &frame)?;
    check_metadata(&frame)?;
    check_rank(source, &frame)?;
    check_corners(source, &frame)?;
    check_leaves(source, &frame)?;
    check_labels(source, &frame)?;
    check_means(source, &frame)?;
    Ok(frame)
}

/// SPEC I8 and I9: checksums of the stored bytes, and zeros between the sections.
///
/// # Errors
/// The first fault found, or a failure to read.
pub(crate) fn check_storage<R: ReadAt + ?Sized>(source: &R, frame: &Frame) -> Result<(), Fault> {
    let table = crate::format::HEADER_BYTES + frame.sections.len() * crate::format::ENTRY_BYTES;
    let mut end = table as u64;
    for entry in &frame.sections {
        let mut padding = Cursor::new(source, end, entry.offset, CURSOR_BYTES);
        if let Some(at) = padding.next_part()?.iter().position(|b| *b != 0) {
            return Err(FormatError::PaddingNotZero { offset: end + at as u64 }.into());
        }
        let mut cursor = Cursor::new(source, entry.offset, entry.end(), 64 << 10);
        let mut crc = 0;
        while cursor.left() > 0 {
            crc = crc32c::crc32c_append(crc, cursor.next_part()?);
        }
        check_crc(entry, crc)?;
        end = entry.end();
    }
    Ok(())
}

/// SPEC I17: metadata that agrees with the sections and with itself.
fn check_metadata(frame: &Frame) -> Result<(), Fault> {
    let m = &frame.metadata;
    for channel in Channel::all() {
        let row = channel.row();
        let there = frame.section(SectionKind::Voxels(channel)).is_some();
        if row.is_stated.is_some_and(|is_stated| is_stated(m) != there) {
            let items = row.items_name;
            return Err(
                damaged(format_args!("metadata and sections disagree about {items} (SPEC I17)")).into()
            );
        }
    }
    let s = &m.selection;
    let open = s.kind != SelectionKind::Range;
    if s.lo.is_nan() || s.hi.is_nan() || s.lo > s.hi || (open && s.hi != f64::INFINITY) {
        return Err(damaged("metadata has an impossible range of values (SPEC I17)").into());
    }
    Ok(())
}

/// SPEC I13: the directory matches the infobytes.
fn check_rank<R: ReadAt + ?Sized>(source: &R, frame: &Frame) -> Result<(), Fault> {
    let (Some(nodes), Some(directory)) =
        (frame.section(SectionKind::Nodes), frame.section(SectionKind::Rank))
    else {
        return Ok(());
    };
    let supers_end = directory.offset.saturating_add(rank::directory_bytes(frame.header.nodes).0);
    let mut supers = Cursor::new(source, directory.offset, supers_end, CURSOR_BYTES);
    let mut blocks = Cursor::new(source, supers_end, directory.end(), CURSOR_BYTES);
    let mut infobytes = Cursor::new(source, nodes.offset, nodes.end(), CURSOR_BYTES);
    let mut builder = rank::RankBuilder::default();
    let (mut due_supers, mut due_blocks) = (Vec::new(), Vec::new());
    let (mut super_node, mut block_node) = (0, 0);
    while infobytes.left() > 0 {
        builder.feed(infobytes.next_part()?, |s| due_supers.push(s), |b| due_blocks.push(b));
        for due in due_supers.drain(..) {
            let found = supers.take::<8>()?.map(u64::from_le_bytes);
            check_count(super_node, due, found)?;
            super_node += rank::SUPER_NODES;
        }
        for due in due_blocks.drain(..) {
            let found = blocks.take::<2>()?.map(|b| u64::from(u16::from_le_bytes(b)));
            check_count(block_node, due.into(), found)?;
            block_node += rank::BLOCK_NODES;
        }
    }
    Ok(())
}

/// SPEC I14 and I18: the offsets of cells announce their corners, and the directory counts them.
fn check_corners<R: ReadAt + ?Sized>(source: &R, frame: &Frame) -> Result<(), Fault> {
    if frame.surface() != SurfaceKind::Cells {
        return Ok(());
    }
    let cursor = |kind| {
        let entry = frame.section(kind).ok_or(FormatError::MissingSection(kind))?;
        Ok::<_, FormatError>(Cursor::new(source, entry.offset, entry.end(), CURSOR_BYTES))
    };
    let channel = Channel::Corners;
    let mut offsets = cursor(SectionKind::Voxels(Channel::Offset))?;
    let mut corners = cursor(SectionKind::Voxels(channel))?;
    let mut directory = cursor(SectionKind::CornerRank)?;
    let (mut builder, mut due_blocks, mut block) = (cell::CornerRankBuilder::default(), Vec::new(), 0);
    let mut voxel = 0;
    let item_bytes = if frame.header.walls { WALL_BYTES } else { cell::CORNERS };
    let stated = corners.left() / item_bytes as u64;
    while offsets.left() > 0 {
        let part = offsets.next_part()?;
        builder.feed(part, |b| due_blocks.push(b));
        for offset in part {
            if *offset == cell::HAS_CORNERS.cast_unsigned()
                && let Some(item) = corners.take_item(item_bytes)?
                && channel.row().illegal.is_some_and(|illegal| illegal(item))
            {
                let (voxel, item) = (VoxelIndex::new(voxel), number(item));
                return Err(FormatError::IllegalItem { channel, voxel, item }.into());
            }
            voxel += 1;
        }
        for due in due_blocks.drain(..) {
            if directory.take::<8>()?.map(u64::from_le_bytes) != Some(due) {
                return Err(FormatError::CornerRank { block, due }.into());
            }
            block += 1;
        }
    }
    let due = builder.with_corners();
    if due != stated {
        return Err(damaged(format_args!(
            "{stated} cells have corners where the offsets announce {due} (SPEC I18)"
        ))
        .into());
    }
    Ok(())
}

/// SPEC I21 and I22: the blocks of labels follow each other, their palettes rise, the table has every label, and cells
/// separate their corners by label.
fn check_labels<R: ReadAt + ?Sized>(source: &R, frame: &Frame) -> Result<(), Fault> {
    let Some(entry) = frame.section(SectionKind::Voxels(Channel::Label)) else { return Ok(()) };
    let (voxels, form) = (frame.header.voxels, frame.label_form());
    let directory_bytes = label_directory_bytes(voxels);
    let start = entry.offset.saturating_add(directory_bytes);
    let mut directory = Cursor::new(source, entry.offset, start, CURSOR_BYTES);
    let mut blocks = Cursor::new(source, start, entry.end(), CURSOR_BYTES);
    let mut cells = WalledCells::new(source, frame);
    let (mut first, mut at) = (0, directory_bytes);
    while first < voxels {
        let last = voxels.min(first.saturating_add(LABEL_GROUP as u64));
        let wrong = || FormatError::LabelBlocks { first, last: last - 1 };
        let group = directory.take::<LABEL_ENTRY>()?.ok_or_else(wrong)?;
        let (place, sizes) = group.split_first_chunk::<8>().ok_or_else(wrong)?;
        if u64::from_le_bytes(*place) != at {
            return Err(wrong().into());
        }
        let sizes = sizes.first_chunk().ok_or_else(wrong)?;
        let count = usize::try_from(last - first).unwrap_or(LABEL_GROUP);
        let room = usize::try_from(blocks.left()).unwrap_or(usize::MAX).min(4 * LABEL_GROUP);
        let decoded = blocks.peek(room)?.and_then(|bytes| form.decode_group(sizes, bytes, count));
        let (labels, used) = decoded.ok_or_else(wrong)?;
        let mut known = None;
        for label in labels {
            let numbers = match known {
                Some((same, numbers)) if same == label => numbers,
                _ => form.numbers(label, &frame.labels).ok_or_else(wrong)?,
            };
            known = Some((label, numbers));
            if let Some(cells) = &mut cells {
                cells.check(numbers, &frame.labels)?;
            }
        }
        blocks.skip(used);
        (first, at) = (last, at + used as u64);
    }
    if blocks.left() > 0 {
        return Err(FormatError::LabelBlocks { first: voxels, last: voxels }.into());
    }
    Ok(())
}

fn check_count(node: u64, due: u64, found: Option<u64>) -> Result<(), FormatError> {
    let node = NodeIndex::new(node);
    match found {
        Some(found) if found == due => Ok(()),
        Some(found) => Err(FormatError::RankMismatch { node, due, found }),
        None => Err(FormatError::MissingItem { kind: SectionKind::Rank }),
    }
}

/// The items of one channel, read in the order of a walk.
struct ChannelReader<'a, R: ReadAt + ?Sized> {
    channel: Channel,
    item_bytes: usize,
    items: Cursor<'a, R>,
    /// Number of items of the channel.
    count: u64,
}

impl<'a, R: ReadAt + ?Sized> ChannelReader<'a, R> {
    fn new(source: &'a R, channel: Channel, entry: &SectionEntry) -> Self {
        let items = Cursor::new(source, entry.offset, entry.end(), CURSOR_BYTES);
        Self { channel, item_bytes: usize::from(entry.item_bytes), items, count: entry.items }
    }

    /// Checks the next item (SPEC I11, I14) and adds it to the sum of its parent.
    fn next(&mut self, sum: Option<&mut Sum>) -> Result<(), Fault> {
        let row = self.channel.row();
        let Some(item) = self.items.take_item(self.item_bytes)? else {
            return Err(FormatError::MissingItem { kind: SectionKind::Voxels(self.channel) }.into());
        };
        if row.illegal.is_some_and(|is_illegal| is_illegal(item)) {
            let item = number(item);
            let voxel = VoxelIndex::new(number_of_last(&self.items, self.item_bytes, self.count));
            return Err(FormatError::IllegalItem { channel: self.channel, voxel, item }.into());
        }
        if let (Some(sum), Some(means)) = (sum, &row.means) {
            means.rule.add_items(sum, item, self.item_bytes);
        }
        Ok(())
    }

    /// Like `next`, for `items` items of one parent.
    fn next_few(&mut self, sum: &mut Sum, items: usize) -> Result<(), Fault> {
        let row = self.channel.row();
        let bytes = items * self.item_bytes;
        if let Some(run) = self.items.peek(bytes)?
            && !row.illegal.is_some_and(|is_illegal| run.chunks_exact(self.item_bytes.max(1)).any(is_illegal))
        {
            if let Some(means) = &row.means {
                means.rule.add_items(sum, run, self.item_bytes);
            }
            self.items.skip(bytes);
            return Ok(());
        }
        // One of them is wrong or missing: the single checks name it.
        (0..items).try_for_each(|_| self.next(Some(sum)))
    }
}

/// Number of the item taken last, where `end` is one past the last item.
fn number_of_last<R: ReadAt + ?Sized>(items: &Cursor<'_, R>, item_bytes: usize, end: u64) -> u64 {
    end.saturating_sub(items.left() / item_bytes.max(1) as u64 + 1)
}

/// The channels that a walk reads: those with rules for their items or means.
pub(crate) fn walked_channels(frame: &Frame) -> Vec<Channel> {
    let says_something =
        |c: &Channel| !c.row().is_sparse && (c.row().illegal.is_some() || c.row().means.is_some());
    frame.channels().map(|(channel, _)| channel).filter(says_something).collect()
}

fn per_depth<'a, R: ReadAt + ?Sized>(
    source: &'a R,
    frame: &Frame,
    entry: Option<&SectionEntry>,
    depths: u32,
) -> Vec<Cursor<'a, R>> {
    let Some(entry) = entry else { return Vec::new() };
    let item = u64::from(entry.item_bytes);
    (0..depths)
        .map(|d| {
            let level = frame.level(Level::new(d));
            let at = |node: u64| entry.offset.saturating_add(node.saturating_mul(item));
            Cursor::new(source, at(level.start), at(level.end), CURSOR_BYTES)
        })
        .collect()
}

/// SPEC I15 and I16: coarse means equal the means of their voxels.
fn check_means<R: ReadAt + ?Sized>(source: &R, frame: &Frame) -> Result<(), Fault> {
    let coarse = frame.dims().depth().saturating_sub(1);
    let mut stored: Vec<_> = walked_channels(frame)
        .into_iter()
        .map(|channel| {
            let entry = frame.section(SectionKind::Means(channel));
            let item_bytes = entry.map_or(0, |e| usize::from(e.item_bytes));
            (channel, item_bytes, per_depth(source, frame, entry, coarse))
        })
        .collect();
    walk(source, frame, coarse, &mut |level, sums| {
        for ((channel, item_bytes, cursors), sum) in stored.iter_mut().zip(sums) {
            let (Some(cursor), Some(means)) = (cursors.get_mut(level.index()), &channel.row().means) else {
                continue;
            };
            let mean = means.rule.mean(sum);
            let due = mean.get(..*item_bytes).unwrap_or_default();
            let found = cursor.take_item(*item_bytes)?;
            if found != Some(due) {
                let found = found.map(number);
                let node = number_of_last(cursor, *item_bytes, frame.level(level).end);
                return Err(wrong_mean(*channel, means.rule, level, node, number(due), found).into());
            }
        }
        Ok(())
    })
}

/// The rule that a wrong mean breaks, one for each rule of means.
fn wrong_mean(
    channel: Channel,
    rule: MeanRule,
    level: Level,
    node: u64,
    due: u64,
    found: Option<u64>,
) -> FormatError {
    let node = NodeIndex::new(node);
    match (rule, found) {
        (MeanRule::Direction, found) => {
            let code = |item| u16::try_from(item).unwrap_or(u16::MAX);
            FormatError::MeanNormal { channel, level, node, due: code(due), found: found.map(code) }
        }
        (MeanRule::Number, Some(found)) => FormatError::MeanValue { channel, level, node, due, found },
        (MeanRule::Number, None) => FormatError::MissingItem { kind: SectionKind::Means(channel) },
    }
}

/// A node on the path from the root to the current box.
#[derive(Clone, Copy, Default)]
struct OpenNode {
    /// Octants still to visit.
    rest: u8,
    corner: [u32; 3],
}

/// Position of the walk in the nodes of every depth and in the items of every channel.
struct Walk<'a, R: ReadAt + ?Sized> {
    frame: &'a Frame,
    dims: [u32; 3],
    depth: usize,
    /// True if nodes directly above voxels are taken with their parent.
    takes_bricks: bool,
    nodes: Vec<Cursor<'a, R>>,
    channels: Vec<ChannelReader<'a, R>>,
    leaves: Option<LeafNormals<'a, R>>,
    voxels: u64,
    path: [OpenNode; 17],
    /// Sums of the open nodes: one per channel and depth.
    sums: Vec<Sum>,
}

impl<R: ReadAt + ?Sized> Walk<'_, R> {
    /// Enters the box at depth `d`: a voxel is added to the sums of its parent at once, a node is opened; a node
    /// directly above voxels takes all of them.
    fn enter(&mut self, d: usize, corner: [u32; 3]) -> Result<(), Fault> {
        if corner.iter().zip(self.dims).any(|(c, n)| *c >= n) {
            return Err(FormatError::OutsideVolume { level: level_of(d), corner }.into());
        }
        let count = self.channels.len();
        if d == self.depth {
            self.voxels += 1;
            self.path[d] = OpenNode { rest: 0, corner };
            for (i, reader) in self.channels.iter_mut().enumerate() {
                let parent = d.checked_sub(1).map(|above| above * count + i);
                reader.next(parent.and_then(|at| self.sums.get_mut(at)))?;
            }
            return Ok(());
        }
        let Some([rest]) = self.nodes.get_mut(d).map_or(Ok(None), Cursor::take::<1>)? else {
            return Err(FormatError::MissingNode { level: level_of(d), corner }.into());
        };
        if rest == 0
            && let Some(normal) = self.leaves.as_mut().map_or(Ok(None), |leaves| leaves.next(d))?
        {
            self.path[d] = OpenNode { rest: 0, corner };
            let sums = &mut self.sums[d * count..][..count];
            for (reader, sum) in self.channels.iter().zip(sums) {
                *sum = Sum::default();
                if let (Channel::Normal, Some(means)) = (reader.channel, &reader.channel.row().means) {
                    means.rule.add_repeated(sum, &normal, 1 << (2 * (self.depth - d)));
                }
            }
            return Ok(());
        }
        if rest == 0 {
            let level = level_of(d);
            let node = NodeIndex::new(number_of_last(&self.nodes[d], 1, self.frame.level(level).end));
            return Err(FormatError::EmptyNode { level, node, corner }.into());
        }
        self.path[d] = OpenNode { rest, corner };
        self.sums[d * count..][..count].fill(Sum::default());
        let edge = 1_u32 << (self.depth - d).min(2);
        if d + 2 >= self.depth && corner.iter().zip(self.dims).all(|(c, n)| c + (edge - 1) < n) {
            self.take_voxels(d, rest)?;
        }
        Ok(())
    }

    /// Takes all voxels of a node together, which lie in the volume, if the node is directly above them or is a brick.
    fn take_voxels(&mut self, d: usize, octants: u8) -> Result<(), Fault> {
        let mut voxels = octants.count_ones();
        if d + 1 < self.depth {
            let children = voxels as usize;
            let Some(below) = self.nodes.get_mut(d + 1).filter(|_| self.takes_bricks) else { return Ok(()) };
            let Some(infobytes) = below.peek(children)? else { return Ok(()) };
            if infobytes.contains(&0) {
                return Ok(());
            }
            voxels = infobytes.iter().map(|infobyte| infobyte.count_ones()).sum();
            below.skip(children);
        }
        self.path[d].rest = 0;
        self.voxels += u64::from(voxels);
        let count = self.channels.len();
        let sums = &mut self.sums[d * count..][..count];
        self.channels.iter_mut().zip(sums).try_for_each(|(reader, sum)| reader.next_few(sum, voxels as usize))
    }

    /// Leaves the finished box at depth `d` for its parent.
    fn leave(&mut self, d: usize) {
        let count = self.channels.len();
        let (above, own) = self.sums.split_at_mut(d * count);
        if d < self.depth {
            for (parent, own) in above[(d - 1) * count..].iter_mut().zip(own) {
                parent.join(own);
            }
        }
    }
}

/// Receives the level of a node and the sums of its [`walked_channels`].
pub(crate) type Finished<'a> = dyn FnMut(Level, &[Sum]) -> Result<(), Fault> + 'a;

/// SPEC I10 to I12 and I14: one depth-first walk over everything. `finished` receives the level of every node of the first
/// `levels` levels, and perhaps of others, and the sums of its [`walked_channels`]; within a depth in the stored order of
/// nodes.
pub(crate) fn walk<R: ReadAt + ?Sized>(
    source: &R,
    frame: &Frame,
    levels: u32,
    finished: &mut Finished<'_>,
) -> Result<(), Fault> {
    let depth = frame.dims().depth() as usize;
    let channels: Vec<_> = walked_channels(frame)
        .into_iter()
        .filter_map(|channel| {
            let entry = frame.section(SectionKind::Voxels(channel))?;
            Some(ChannelReader::new(source, channel, entry))
        })
        .collect();
    let count = channels.len();
    let mut walk = Walk {
        frame,
        dims: frame.dims().to_array(),
        depth,
        takes_bricks: levels < frame.dims().depth(),
        nodes: per_depth(source, frame, frame.section(SectionKind::Nodes), frame.dims().depth()),
        sums: vec![Sum::default(); (depth + 1) * count],
        channels,
        leaves: LeafNormals::new(source, frame)?,
        voxels: 0,
        path: [OpenNode::default(); 17],
    };
    let mut at = 0;
    walk.enter(0, [0; 3])?;
    loop {
        let open = &mut walk.path[at];
        if open.rest == 0 {
            if at < depth {
                finished(level_of(at), &walk.sums[at * count..][..count])?;
            }
            if at == 0 {
                break;
            }
            walk.leave(at);
            at -= 1;
            continue;
        }
        let octant = Octant::low_bits(open.rest.trailing_zeros());
        open.rest &= open.rest - 1;
        let half = 1_u32 << (depth - at - 1);
        let mut corner = open.corner;
        for (c, high) in corner.iter_mut().zip(octant.high()) {
            *c += half * high;
        }
        at += 1;
        walk.enter(at, corner)?;
    }
    for (d, nodes) in walk.nodes.iter().enumerate() {
        if nodes.left() > 0 {
            let level = level_of(d);
            let stated = frame.level(level).end - frame.level(level).start;
            return Err(FormatError::SurplusBoxes { level, stated, found: stated - nodes.left() }.into());
        }
    }
    if walk.voxels != frame.header.voxels {
        let (stated, found) = (frame.header.voxels, walk.voxels);
        return Err(FormatError::SurplusBoxes { level: level_of(depth), stated, found }.into());
    }
    Ok(())
}

/// The level of a depth, at most 16.
fn level_of(depth: usize) -> Level {
    Level::new(u32::try_from(depth).unwrap_or(u32::MAX))
}
