//! The full check of a mapped file: every invariant of SPEC 6, in one small fixed amount of memory.
//!
//! Boxes of one depth stand in Morton order, so a depth-first walk meets the nodes of every depth in
//! the order in which they are stored: one sequential cursor per depth and channel is all that is
//! needed, and no rank is ever used.

use crate::format::{Channel, Encoding, FormatError, SectionEntry, SectionKind, SelectionKind, Sum, rank};

use super::frame::Frame;
use super::stream::{Cursor, Fault, ReadAt};

/// Bytes of one cursor's buffer; a walk holds one per depth and one per channel,
/// a check of the means one more per channel and depth.
const CURSOR_BYTES: usize = 16 << 10;

/// Checks every invariant of a mapped file (SPEC I1 to I17).
///
/// Memory: under 2 MiB whatever the file. Cost: three passes over the nodes, two over the rest.
///
/// # Errors
/// The first rule that is broken, or a failure to read; [`FormatError::Packed`] for a packed file.
pub fn verify<R: ReadAt + ?Sized>(source: &R) -> Result<Frame, Fault> {
    let frame = Frame::read(source)?;
    if frame.header.encoding == Encoding::Packed {
        return Err(FormatError::Packed.into());
    }
    check_storage(source, &frame)?;
    check_metadata(&frame)?;
    check_rank(source, &frame)?;
    check_means(source, &frame)?;
    Ok(frame)
}

fn invalid<T>(what: impl Into<String>) -> Result<T, Fault> {
    Err(FormatError::invalid(what).into())
}

/// SPEC I8 and I9: checksums of the stored bytes, and zeros between the sections.
///
/// # Errors
/// The first that is wrong, or a failure to read.
pub(crate) fn check_storage<R: ReadAt + ?Sized>(source: &R, frame: &Frame) -> Result<(), Fault> {
    let table = crate::format::HEADER_BYTES + frame.sections.len() * crate::format::ENTRY_BYTES;
    let mut end = table as u64;
    for entry in &frame.sections {
        let mut padding = Cursor::new(source, end, entry.offset, CURSOR_BYTES);
        if padding.next_part()?.iter().any(|b| *b != 0) {
            return invalid("bytes between sections are not zero (SPEC I9)");
        }
        let mut cursor = Cursor::new(source, entry.offset, entry.end(), 64 << 10);
        let mut crc = 0;
        while cursor.left() > 0 {
            crc = crc32c::crc32c_append(crc, cursor.next_part()?);
        }
        if crc != entry.stored_crc {
            let what = entry.kind.map_or("a section of unknown kind", SectionKind::name);
            return Err(FormatError::Checksum { what }.into());
        }
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
            return invalid(format!("metadata and sections disagree about {} (SPEC I17)", row.items_name));
        }
    }
    let s = &m.selection;
    let open = s.kind != SelectionKind::Range;
    if s.lo.is_nan() || s.hi.is_nan() || s.lo > s.hi || (open && s.hi != f64::INFINITY) {
        return invalid("metadata has an impossible range of values (SPEC I17)");
    }
    Ok(())
}

/// SPEC I13: the directory is the one that the infobytes give.
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
    while infobytes.left() > 0 {
        builder.feed(infobytes.next_part()?, |s| due_supers.push(s), |b| due_blocks.push(b));
        for due in due_supers.drain(..) {
            if supers.take::<8>()? != Some(due.to_le_bytes()) {
                return invalid("the rank directory does not belong to the nodes (SPEC I13)");
            }
        }
        for due in due_blocks.drain(..) {
            if blocks.take::<2>()? != Some(due.to_le_bytes()) {
                return invalid("the rank directory does not belong to the nodes (SPEC I13)");
            }
        }
    }
    Ok(())
}

/// The items of one channel, read in the order of a walk.
struct ChannelReader<'a, R: ReadAt + ?Sized> {
    channel: Channel,
    item_bytes: usize,
    items: Cursor<'a, R>,
}

impl<'a, R: ReadAt + ?Sized> ChannelReader<'a, R> {
    fn new(source: &'a R, channel: Channel, entry: &SectionEntry) -> Self {
        let items = Cursor::new(source, entry.offset, entry.end(), CURSOR_BYTES);
        Self { channel, item_bytes: usize::from(entry.item_bytes), items }
    }

    /// Checks the next item (SPEC I11, I14) and adds it to the sum of its parent.
    fn next(&mut self, sum: Option<&mut Sum>) -> Result<(), Fault> {
        let row = self.channel.row();
        let Some(item) = self.items.take_item(self.item_bytes)? else {
            return invalid(format!("there are more voxels than {} (SPEC I11)", row.items_name));
        };
        if let Some((is_illegal, what)) = row.illegal
            && is_illegal(item)
        {
            return invalid(what);
        }
        if let (Some(sum), Some(means)) = (sum, &row.means) {
            means.rule.add_items(sum, item, self.item_bytes);
        }
        Ok(())
    }
}

/// The channels that a walk reads: all but those whose items nothing is known of but their number.
pub(crate) fn walked_channels(frame: &Frame) -> Vec<Channel> {
    let says_something = |c: &Channel| c.row().illegal.is_some() || c.row().means.is_some();
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
            let level = frame.level(d);
            let at = |node: u64| entry.offset.saturating_add(node.saturating_mul(item));
            Cursor::new(source, at(level.start), at(level.end), CURSOR_BYTES)
        })
        .collect()
}

/// SPEC I15 and I16: the coarse means are those of their voxels.
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
    walk(source, frame, &mut |depth, sums| {
        for ((channel, item_bytes, cursors), sum) in stored.iter_mut().zip(sums) {
            let (Some(cursor), Some(means)) = (cursors.get_mut(depth), &channel.row().means) else {
                continue;
            };
            if cursor.take_item(*item_bytes)? != means.rule.mean(sum).get(..*item_bytes) {
                return invalid(format!(
                    "a mean {channel} at depth {depth} is not that of its voxels (SPEC {})",
                    means.invariant
                ));
            }
        }
        Ok(())
    })
}

/// A node on the path from the root to the present box.
#[derive(Clone, Copy, Default)]
struct Open {
    /// Octants still to visit.
    rest: u8,
    corner: [u32; 3],
}

/// The walk's place in the nodes of every depth and in the items of every channel.
struct Walk<'a, R: ReadAt + ?Sized> {
    dims: [u32; 3],
    depth: usize,
    nodes: Vec<Cursor<'a, R>>,
    channels: Vec<ChannelReader<'a, R>>,
    voxels: u64,
    path: [Open; 17],
    /// Sums of the open nodes: one of each channel by depth.
    sums: Vec<Sum>,
}

impl<R: ReadAt + ?Sized> Walk<'_, R> {
    /// Enters the box at depth `d`: a voxel is added to the sums of its parent at once, a node is opened.
    fn enter(&mut self, d: usize, corner: [u32; 3]) -> Result<(), Fault> {
        if corner.iter().zip(self.dims).any(|(c, n)| *c >= n) {
            return invalid(format!("a box at depth {d} lies outside the volume (SPEC I12)"));
        }
        let count = self.channels.len();
        if d == self.depth {
            self.voxels += 1;
            self.path[d] = Open { rest: 0, corner };
            for (i, reader) in self.channels.iter_mut().enumerate() {
                let parent = d.checked_sub(1).map(|above| above * count + i);
                reader.next(parent.and_then(|at| self.sums.get_mut(at)))?;
            }
            return Ok(());
        }
        let Some([rest]) = self.nodes.get_mut(d).map_or(Ok(None), Cursor::take::<1>)? else {
            return invalid(format!("depth {d} has fewer nodes than their parents have children (SPEC I11)"));
        };
        if rest == 0 {
            return invalid(format!("a node at depth {d} has no children (SPEC I10)"));
        }
        self.path[d] = Open { rest, corner };
        self.sums[d * count..][..count].fill(Sum::default());
        Ok(())
    }

    /// Leaves the box at depth `d`, of which everything is known, for its parent.
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

/// SPEC I10 to I12 and I14: one depth-first walk over everything. `finished` is told the depth of every node
/// and the sums of its [`walked_channels`], within a depth in the order in which nodes are stored.
pub(crate) fn walk<R: ReadAt + ?Sized>(
    source: &R,
    frame: &Frame,
    finished: &mut dyn FnMut(usize, &[Sum]) -> Result<(), Fault>,
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
        dims: frame.dims().to_array(),
        depth,
        nodes: per_depth(source, frame, frame.section(SectionKind::Nodes), frame.dims().depth()),
        sums: vec![Sum::default(); (depth + 1) * count],
        channels,
        voxels: 0,
        path: [Open::default(); 17],
    };
    let mut at = 0;
    walk.enter(0, [0; 3])?;
    loop {
        let open = &mut walk.path[at];
        if open.rest == 0 {
            if at < depth {
                finished(at, &walk.sums[at * count..][..count])?;
            }
            if at == 0 {
                break;
            }
            walk.leave(at);
            at -= 1;
            continue;
        }
        let octant = open.rest.trailing_zeros();
        open.rest &= open.rest - 1;
        let half = 1_u32 << (depth - at - 1);
        let mut corner = open.corner;
        for (axis, c) in corner.iter_mut().enumerate() {
            *c += half * (octant >> axis & 1);
        }
        at += 1;
        walk.enter(at, corner)?;
    }
    if walk.voxels != frame.header.voxels || walk.nodes.iter().any(|c| c.left() > 0) {
        return invalid("a depth has more boxes than their parents have children (SPEC I11)");
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::assemble::{AssembledVoxel, OptionalSections, assemble, plain_metadata};
    use crate::format::{HEADER_BYTES, Metadata, normal, table_bytes};
    use crate::load::{Model, NodeView};

    fn metadata(dims: [u32; 3], channels: OptionalSections) -> Metadata {
        Metadata { scalar: 2, ..plain_metadata(dims, channels) }
    }

    fn ball(side: u32, channels: OptionalSections) -> Vec<u8> {
        let (c, r) = (f64::from(side) / 2.0 - 0.5, f64::from(side) / 2.0 - 1.0);
        let mut voxels = Vec::new();
        for (z, y, x) in
            (0..side).flat_map(|z| (0..side).flat_map(move |y| (0..side).map(move |x| (z, y, x))))
        {
            let d = [f64::from(x) - c, f64::from(y) - c, f64::from(z) - c];
            let len = d.iter().map(|v| v * v).sum::<f64>().sqrt();
            if (len - r).abs() < 0.7 {
                #[expect(clippy::cast_possible_truncation, reason = "test directions")]
                let normal = normal::encode(d.map(|v| v as f32));
                voxels.push(AssembledVoxel { cell: [x, y, z], normal, value: u16::try_from(x + y).unwrap() });
            }
        }
        assemble(&metadata([side; 3], channels), &voxels, channels).unwrap()
    }

    const FULL: OptionalSections = OptionalSections { normal: true, value_bytes: 1, lod: true };

    /// Changes bytes of one section and makes every checksum right again.
    fn forge(file: &[u8], kind: SectionKind, change: impl FnOnce(&mut [u8])) -> Vec<u8> {
        let mut file = file.to_vec();
        let frame = Frame::read(file.as_slice()).unwrap();
        let mut sections = frame.sections.clone();
        let entry = sections.iter_mut().find(|e| e.kind == Some(kind)).unwrap();
        let range = usize::try_from(entry.offset).unwrap()..usize::try_from(entry.end()).unwrap();
        change(&mut file[range.clone()]);
        entry.stored_crc = crc32c::crc32c(&file[range]);
        entry.content_crc = entry.stored_crc;
        let table = table_bytes(&sections);
        let mut header = frame.header;
        header.table_crc = crc32c::crc32c(&table);
        file[HEADER_BYTES..HEADER_BYTES + table.len()].copy_from_slice(&table);
        file[..HEADER_BYTES].copy_from_slice(&header.to_bytes());
        file
    }

    fn broken_rule(file: &[u8]) -> String {
        match verify(file).unwrap_err() {
            Fault::Format(e) => e.to_string(),
            Fault::Io(e) => panic!("{e}"),
        }
    }

    #[test]
    fn sound_files_of_every_shape_pass_and_walk_back_to_their_voxels() {
        for side in [1, 2, 3, 5, 16, 21, 40] {
            for channels in [
                FULL,
                OptionalSections { normal: false, value_bytes: 0, lod: true },
                OptionalSections { normal: true, value_bytes: 2, lod: false },
            ] {
                let voxels: Vec<AssembledVoxel> = (0..side)
                    .map(|i| AssembledVoxel {
                        cell: [i, side - 1 - i, i / 2],
                        normal: normal::encode([1.0, 2.0, f32::from(u16::try_from(i).unwrap()) - 9.0]),
                        value: u16::try_from(i).unwrap(),
                    })
                    .collect();
                let file = assemble(&metadata([side; 3], channels), &voxels, channels).unwrap();
                verify(file.as_slice()).unwrap();
                let model = Model::from_bytes(file).unwrap();
                let mut found = Vec::new();
                walk_view(&model, 0, [0; 3], model.depth(), &mut found);
                let mut due: Vec<_> =
                    voxels.iter().map(|v| (v.cell, channels.normal.then_some(v.normal))).collect();
                due.sort();
                found.sort();
                assert_eq!(found, due, "side {side}");
                if channels.value_bytes > 0 {
                    assert!((0..model.voxel_count()).all(|v| model.value(v).is_some()));
                }
                assert_eq!(model.value(model.voxel_count()), None);
            }
        }
    }

    fn walk_view(
        m: &impl NodeView,
        b: u64,
        corner: [u32; 3],
        left: u32,
        out: &mut Vec<([u32; 3], Option<u16>)>,
    ) {
        if left == 0 {
            out.push((corner, m.voxel_normal(b - m.node_count())));
            return;
        }
        for octant in 0..8 {
            if let Some(child) = m.child(b, octant) {
                let half = 1 << (left - 1);
                let at = std::array::from_fn(|a| corner[a] + half * (octant >> a & 1));
                walk_view(m, child, at, left - 1, out);
            }
        }
    }

    #[test]
    fn every_invariant_beyond_opening_has_a_file_that_breaks_it() {
        let file = ball(20, FULL);
        verify(file.as_slice()).unwrap();
        let rule = |kind, change: fn(&mut [u8])| broken_rule(&forge(&file, kind, change));
        assert!(rule(SectionKind::Nodes, |b| b[9] = 0).contains("I13"), "the directory notices first");
        assert!(rule(SectionKind::Rank, |b| b[0] = 1).contains("I13"));
        assert!(rule(SectionKind::Voxels(Channel::Normal), |b| b[4] = 0x80).contains("I14"));
        assert!(rule(SectionKind::Voxels(Channel::Normal), |b| b[4] ^= 0x40).contains("I15"));
        assert!(rule(SectionKind::Means(Channel::Normal), |b| b[0] ^= 1).contains("I15"));
        assert!(rule(SectionKind::Voxels(Channel::Value), |b| b[0] = 255).contains("I16"));
        assert!(rule(SectionKind::Means(Channel::Value), |b| b[0] ^= 1).contains("I16"));
        // The same number of bits elsewhere leaves ranks right and moves a box out of the volume.
        let moved = broken_rule(&forge(&file, SectionKind::Nodes, |b| {
            let last = b.len() - 1;
            b[last] = b[last].rotate_left(1);
            let low = b.iter().position(|m| m.count_ones() == 4).unwrap();
            b[low] = 0xf0;
        }));
        assert!(moved.contains("I12") || moved.contains("I15"), "{moved}");
        let mut padded = file.clone();
        let gap = Frame::read(file.as_slice()).unwrap().sections[0].end();
        padded[usize::try_from(gap).unwrap()] = 1;
        assert!(broken_rule(&padded).contains("I9"));
    }

    #[test]
    fn zero_infobytes_wrong_counts_and_outside_boxes_are_told_apart() {
        // One voxel in 3x1x1: two nodes, root 0b10 and its child; the directory cannot see the rest.
        let plain = OptionalSections { normal: false, value_bytes: 0, lod: false };
        let voxel = AssembledVoxel { cell: [2, 0, 0], normal: 0, value: 0 };
        let file = assemble(&metadata([3, 1, 1], plain), &[voxel], plain).unwrap();
        let rule = |change: fn(&mut [u8])| broken_rule(&forge(&file, SectionKind::Nodes, change));
        assert!(rule(|b| b[1] = 0).contains("I10"));
        assert!(rule(|b| b[1] = 0b10).contains("I12"), "x = 3 is outside");
        assert!(rule(|b| b[1] = 0b100).contains("I12"), "y = 1 is outside");
        let counts = rule(|b| b[0] = 0b11);
        assert!(counts.contains("I11"), "{counts}");
        assert!(rule(|b| b[0] = 0b10_0000).contains("I12"));
    }
}
