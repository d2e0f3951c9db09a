//! The full check of a mapped file: every invariant of SPEC 6, in one small fixed amount of memory.
//!
//! Boxes of one depth stand in Morton order, so a depth-first walk meets the nodes of every depth in
//! the order in which they are stored: one sequential cursor per depth and channel is all that is
//! needed, and no rank is ever used.

use crate::format::{Encoding, FormatError, SectionEntry, SectionKind, SelectionKind, normal, rank};
use crate::geom::{Level, NodeIndex, Octant, VoxelIndex};

use super::frame::{Frame, check_crc};
use super::stream::{Cursor, Fault, ReadAt};

/// Bytes of one cursor's buffer; a walk holds one per depth and 2 for the voxels,
/// a check of the means two more per depth.
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

/// SPEC I8 and I9: checksums of the stored bytes, and zeros between the sections.
///
/// # Errors
/// The first that is wrong, or a failure to read.
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
    let named = !m.gradient.is_empty();
    if named != frame.section(SectionKind::Normal).is_some() {
        return Err(FormatError::GradientName { named }.into());
    }
    let stated = m.value_scale != [0.0, 0.0];
    if stated != frame.section(SectionKind::Value).is_some() {
        return Err(FormatError::ValueScale { stated }.into());
    }
    let s = &m.selection;
    let open = s.kind != SelectionKind::Range;
    if s.lo.is_nan() || s.hi.is_nan() || s.lo > s.hi || (open && s.hi != f64::INFINITY) {
        return Err(FormatError::SelectionRange { selection: *s }.into());
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

fn check_count(node: u64, due: u64, found: Option<u64>) -> Result<(), FormatError> {
    let node = NodeIndex::new(node);
    match found {
        Some(found) if found == due => Ok(()),
        Some(found) => Err(FormatError::RankMismatch { node, due, found }),
        None => Err(FormatError::MissingItem { kind: SectionKind::Rank }),
    }
}

/// What a node gathers from the voxels below it.
#[derive(Clone, Copy, Default)]
pub(crate) struct Gather {
    normal_sum: [i64; 3],
    first_normal: Option<u16>,
    value_sum: u64,
    voxels: u64,
}

impl Gather {
    fn add(&mut self, other: &Self) {
        for (sum, more) in self.normal_sum.iter_mut().zip(other.normal_sum) {
            *sum += more;
        }
        self.first_normal = self.first_normal.or(other.first_normal);
        self.value_sum += other.value_sum;
        self.voxels += other.voxels;
    }

    /// SPEC 4.6: mean normal code.
    pub(crate) fn normal(&self) -> u16 {
        normal::mean(self.normal_sum, self.first_normal.unwrap_or(0))
    }

    /// SPEC 4.7: mean value, rounded half up.
    pub(crate) fn value(&self) -> u128 {
        let voxels = u128::from(self.voxels.max(1));
        (2 * u128::from(self.value_sum) + voxels) / (2 * voxels)
    }
}

/// A node on the path from the root to the present box.
#[derive(Clone, Copy, Default)]
struct Open {
    /// Octants still to visit.
    rest: u8,
    corner: [u32; 3],
    gather: Gather,
}

/// Per-voxel and per-node readers of a walk.
struct Readers<'a, R: ReadAt + ?Sized> {
    nodes: Vec<Cursor<'a, R>>,
    normals: Option<Cursor<'a, R>>,
    values: Option<(Cursor<'a, R>, u8)>,
    /// Skin voxels of the file, hence items of each channel.
    voxels: u64,
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

impl<'a, R: ReadAt + ?Sized> Readers<'a, R> {
    fn new(source: &'a R, frame: &Frame) -> Self {
        let depth = frame.dims().depth();
        let whole = |e: &SectionEntry| Cursor::new(source, e.offset, e.end(), CURSOR_BYTES);
        Self {
            nodes: per_depth(source, frame, frame.section(SectionKind::Nodes), depth),
            normals: frame.section(SectionKind::Normal).map(whole),
            values: frame.section(SectionKind::Value).map(|e| (whole(e), e.item_bytes)),
            voxels: frame.header.voxels,
        }
    }

    fn voxel(&mut self) -> Result<Gather, Fault> {
        let mut g = Gather { voxels: 1, ..Gather::default() };
        if let Some(cursor) = &mut self.normals {
            let Some(bytes) = cursor.take::<2>()? else {
                return Err(FormatError::MissingItem { kind: SectionKind::Normal }.into());
            };
            let code = u16::from_le_bytes(bytes);
            if bytes.contains(&0x80) {
                let voxel = VoxelIndex::new(self.voxels.saturating_sub(cursor.left() / 2 + 1));
                return Err(FormatError::IllegalNormal { voxel, code }.into());
            }
            g.first_normal = Some(code);
            g.normal_sum = normal::decode_l1(code).map(i64::from);
        }
        if let Some((cursor, item)) = &mut self.values {
            g.value_sum = take_value(cursor, *item, SectionKind::Value)?;
        }
        Ok(g)
    }
}

fn take_value<R: ReadAt + ?Sized>(
    cursor: &mut Cursor<'_, R>,
    item: u8,
    kind: SectionKind,
) -> Result<u64, Fault> {
    let value = match item {
        1 => cursor.take::<1>()?.map(|b| u64::from(b[0])),
        _ => cursor.take::<2>()?.map(|b| u64::from(u16::from_le_bytes(b))),
    };
    value.ok_or(Fault::Format(FormatError::MissingItem { kind }))
}

/// SPEC I15 and I16: the coarse means are those of their voxels.
fn check_means<R: ReadAt + ?Sized>(source: &R, frame: &Frame) -> Result<(), Fault> {
    let coarse = frame.dims().depth().saturating_sub(1);
    let mut normals = per_depth(source, frame, frame.section(SectionKind::NormalLod), coarse);
    let mut values = per_depth(source, frame, frame.section(SectionKind::ValueLod), coarse);
    let value_bytes = frame.section(SectionKind::Value).map_or(1, |e| e.item_bytes);
    walk(source, frame, &mut |level, means| {
        // Nodes of a depth end with its level, so what is left of the cursor says which one was read.
        let node = |left: u64| NodeIndex::new(frame.level(level).end.saturating_sub(left + 1));
        if let Some(cursor) = normals.get_mut(level.index()) {
            let (due, found) = (means.normal(), cursor.take::<2>()?.map(u16::from_le_bytes));
            if found != Some(due) {
                let node = node(cursor.left() / 2);
                return Err(FormatError::MeanNormal { level, node, due, found }.into());
            }
        }
        if let Some(cursor) = values.get_mut(level.index()) {
            let (due, found) = (means.value(), take_value(cursor, value_bytes, SectionKind::ValueLod)?);
            if u128::from(found) != due {
                let due = u64::try_from(due).unwrap_or(u64::MAX);
                let node = node(cursor.left() / u64::from(value_bytes.max(1)));
                return Err(FormatError::MeanValue { level, node, due, found }.into());
            }
        }
        Ok(())
    })
}

/// SPEC I10 to I12 and I14: one depth-first walk over everything. `finished` is told the depth and the
/// means of every node, within a depth in the order in which nodes are stored.
pub(crate) fn walk<R: ReadAt + ?Sized>(
    source: &R,
    frame: &Frame,
    finished: &mut dyn FnMut(Level, &Gather) -> Result<(), Fault>,
) -> Result<(), Fault> {
    let depth = frame.dims().depth() as usize;
    let dims = frame.dims().to_array();
    let mut readers = Readers::new(source, frame);
    let mut path = [Open::default(); 17];
    let mut at = 0;
    let mut voxels = 0_u64;
    // Enters the box at depth `d`; a voxel is gathered at once, a node is opened.
    let mut enter =
        |readers: &mut Readers<'_, R>, d: usize, corner: [u32; 3], slot: &mut Open| -> Result<(), Fault> {
            if corner.iter().zip(dims).any(|(c, n)| *c >= n) {
                return Err(FormatError::OutsideVolume { level: level_of(d), corner }.into());
            }
            if d == depth {
                voxels += 1;
                *slot = Open { rest: 0, corner, gather: readers.voxel()? };
                return Ok(());
            }
            let Some([rest]) = readers.nodes.get_mut(d).map_or(Ok(None), Cursor::take::<1>)? else {
                return Err(FormatError::MissingNode { level: level_of(d), corner }.into());
            };
            if rest == 0 {
                let level = level_of(d);
                let node = frame.level(level).end.saturating_sub(readers.nodes[d].left() + 1);
                return Err(FormatError::EmptyNode { level, node: NodeIndex::new(node), corner }.into());
            }
            *slot = Open { rest, corner, gather: Gather::default() };
            Ok(())
        };
    enter(&mut readers, 0, [0; 3], &mut path[0])?;
    loop {
        if path[at].rest == 0 {
            if at < depth {
                finished(level_of(at), &path[at].gather)?;
            }
            if at == 0 {
                break;
            }
            let gather = path[at].gather;
            at -= 1;
            path[at].gather.add(&gather);
            continue;
        }
        let octant = Octant::low_bits(path[at].rest.trailing_zeros());
        path[at].rest &= path[at].rest - 1;
        let half = 1_u32 << (depth - at - 1);
        let mut corner = path[at].corner;
        for (c, high) in corner.iter_mut().zip(octant.high()) {
            *c += half * high;
        }
        at += 1;
        enter(&mut readers, at, corner, &mut path[at])?;
    }
    for (d, nodes) in readers.nodes.iter().enumerate() {
        if nodes.left() > 0 {
            let level = level_of(d);
            let stated = frame.level(level).end - frame.level(level).start;
            return Err(FormatError::SurplusBoxes { level, stated, found: stated - nodes.left() }.into());
        }
    }
    if voxels != frame.header.voxels {
        let (stated, found) = (frame.header.voxels, voxels);
        return Err(FormatError::SurplusBoxes { level: level_of(depth), stated, found }.into());
    }
    Ok(())
}

/// Depths are at most 16.
fn level_of(depth: usize) -> Level {
    Level::new(u32::try_from(depth).unwrap_or(u32::MAX))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::Metadata;
    use crate::format::assemble::{AssembledVoxel, Channels, assemble, plain_metadata};
    use crate::geom::BoxIndex;
    use crate::load::{Model, NodeView};

    fn metadata(dims: [u32; 3], channels: Channels) -> Metadata {
        Metadata { scalar: 2, ..plain_metadata(dims, channels) }
    }

    const FULL: Channels = Channels { normal: true, value_bytes: 1, lod: true };

    #[test]
    fn sound_files_of_every_shape_pass_and_walk_back_to_their_voxels() {
        for side in [1, 2, 3, 5, 16, 21, 40] {
            for channels in [
                FULL,
                Channels { normal: false, value_bytes: 0, lod: true },
                Channels { normal: true, value_bytes: 2, lod: false },
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
                walk_view(&model, BoxIndex::ROOT, [0; 3], model.depth(), &mut found);
                let mut due: Vec<_> =
                    voxels.iter().map(|v| (v.cell, channels.normal.then_some(v.normal))).collect();
                due.sort();
                found.sort();
                assert_eq!(found, due, "side {side}");
                if channels.value_bytes > 0 {
                    assert!((0..model.voxel_count()).all(|v| model.value(VoxelIndex::new(v)).is_some()));
                }
                assert_eq!(model.value(VoxelIndex::new(model.voxel_count())), None);
            }
        }
    }

    fn walk_view(
        m: &impl NodeView,
        b: BoxIndex,
        corner: [u32; 3],
        left: u32,
        out: &mut Vec<([u32; 3], Option<u16>)>,
    ) {
        if left == 0 {
            out.push((corner, m.voxel_normal(b.voxel(m.node_count()))));
            return;
        }
        for octant in Octant::ALL {
            if let Some(child) = m.child(b.node(), octant) {
                let half = 1 << (left - 1);
                let at = std::array::from_fn(|a| corner[a] + half * octant.high()[a]);
                walk_view(m, child, at, left - 1, out);
            }
        }
    }
}
