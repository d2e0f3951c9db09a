//! A packed file into the mapped one that it was made from.

use std::fs::File;
use std::io;

use crate::format::packed::cubes::NodeCoder;
use crate::format::packed::directions::DirectionCoder;
use crate::format::packed::distances::DistanceCoder;
use crate::format::packed::group::{Group, GroupCoder};
use crate::format::packed::{
    CODEC_CUBES, CODEC_DERIVED, CODEC_DIRECTIONS, CODEC_DISTANCES, CODEC_NONE, CODEC_PLANES, CUBE_DEPTH,
    CodingError, planes,
};
use crate::format::{
    Channel, ENTRY_BYTES, Encoding, FormatError, HEADER_BYTES, SectionEntry, SectionKind, align_up, damaged,
    rank,
};
use crate::geom::Level;
use crate::load::{Cursor, Fault, Frame, ReadAt, check_storage, walk, walked_channels};
use crate::platform::give_back;

use super::Stop;
use super::encode::finish_frame;
use super::follow::{Follow, StopAtEnd};
use super::groups::{Direction, Worker, each_group};
use super::stored::{LevelWriters, Stored};
use super::stream::{Normals, Shape, Subtrees, Writer, codec_of, crc_of};

/// Most voxels of eight bytes of a payload (SPEC 5.1).
const BLOCK_VOXELS: u64 = 1 << 17;
/// The walk that makes coarse means keeps its path in memory of its own.
const MEANS_STACK_BYTES: usize = 256 << 10;

/// Unpacks bytes that can be read by position into an empty file, and returns the frame of what was written; its
/// checksums are verified.
pub(crate) fn unpack_file<R: ReadAt + ?Sized>(source: &R, out: &File) -> Result<Frame, Stop> {
    let packed = Frame::read(source)?;
    if packed.header.encoding == Encoding::Mapped {
        return Err(FormatError::Said("is not packed; there is nothing to unpack".into()).into());
    }
    check_storage(source, &packed)?;
    for entry in &packed.sections {
        check_plausible(&packed, entry)?;
    }
    let mut mapped = lay_out(&packed)?;
    let first = decode_nodes(source, &packed, &mut mapped, out)?;
    decode_rest(source, &packed, &mapped, first, out)?;
    // Padding and empty ends were never written: the length makes them zeros.
    out.set_len(mapped.header.file_bytes).map_err(Stop::Output)?;
    finish_frame(&mut mapped, out)?;
    check_storage(out, &mapped)?;
    Ok(mapped)
}

/// Decodes the sections up to the infobytes, and makes the rank directory; returns the number of these sections.
fn decode_nodes<R: ReadAt + ?Sized>(
    source: &R,
    packed: &Frame,
    mapped: &mut Frame,
    out: &File,
) -> Result<usize, Stop> {
    let nodes = packed.sections.iter().position(|e| e.kind == Some(SectionKind::Nodes));
    let first = nodes.map_or(0, |at| at + 1);
    for entry in packed.sections.iter().take(first) {
        decode_section(source, packed, entry, mapped, out, None)?;
    }
    let crc = rebuild_rank(mapped, out)?;
    for e in mapped.sections.iter_mut().filter(|e| e.kind == Some(SectionKind::Rank)) {
        (e.stored_crc, e.content_crc) = (crc, crc);
    }
    Ok(first)
}

/// Decodes the sections after `first`. The coarse means are made meanwhile, from the sections that are written already.
fn decode_rest<R: ReadAt + ?Sized>(
    source: &R,
    packed: &Frame,
    mapped: &Frame,
    first: usize,
    out: &File,
) -> Result<(), Stop> {
    let follow = &Follow::new(out);
    let decode = || {
        let _stop = StopAtEnd(follow);
        for entry in packed.sections.iter().skip(first) {
            decode_section(source, packed, entry, mapped, out, Some(follow))?;
        }
        follow.reached(u64::MAX);
        Ok(())
    };
    if packed.sections.iter().all(|e| e.codec != CODEC_DERIVED) {
        return decode();
    }
    std::thread::scope(|scope| {
        let builder = std::thread::Builder::new().stack_size(MEANS_STACK_BYTES);
        let means = builder.spawn_scoped(scope, || rebuild_means(follow, mapped, out));
        decode()?;
        match means {
            Ok(means) => means.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)),
            // No more threads can be started.
            Err(_) => rebuild_means(out, mapped, out),
        }
    })
}

/// The sections of the mapped file: the same ones, plus the rank directory, one after the other.
fn lay_out(packed: &Frame) -> Result<Frame, Stop> {
    let mut mapped = packed.clone();
    mapped.header.encoding = Encoding::Mapped;
    if let Some(at) = mapped.sections.iter().position(|e| e.kind == Some(SectionKind::Nodes)) {
        let (_, bytes) = rank::directory_bytes(packed.header.nodes);
        mapped.sections.insert(at + 1, SectionEntry::plain(SectionKind::Rank, 1, bytes, 0));
    }
    let mut end = (HEADER_BYTES + mapped.sections.len() * ENTRY_BYTES) as u64;
    for entry in &mut mapped.sections {
        entry.codec = CODEC_NONE;
        entry.offset = align_up(end);
        entry.stored_bytes = entry.content_bytes;
        entry.stored_crc = entry.content_crc;
        end = entry.end();
        if end >= 1 << 62 {
            return Err(CodingError("its sections are too large to be true").into());
        }
    }
    mapped.header.file_bytes = end;
    Ok(mapped)
}

/// Refuses content that the stored bytes cannot hold, before any of it is decoded (SPEC 5.1).
fn check_plausible(frame: &Frame, entry: &SectionEntry) -> Result<(), Stop> {
    let blocks = |least: u64, most: u64| (entry.stored_bytes / least).saturating_mul(most);
    let ok = match entry.codec {
        CODEC_NONE => entry.stored_bytes == entry.content_bytes,
        CODEC_PLANES => entry.content_bytes <= blocks(5, planes::BLOCK_BYTES as u64),
        CODEC_DERIVED => entry.stored_bytes == 0,
        // A block of symbols has two states of 4 bytes, and nodes of at most eight voxels; an infobyte bit always costs
        // something.
        CODEC_CUBES | CODEC_DIRECTIONS | CODEC_DISTANCES => {
            frame.dims().depth() == 0 || frame.header.voxels <= blocks(8, BLOCK_VOXELS)
        }
        codec => return Err(damaged(format_args!("codec {codec} is unknown; update infobyte")).into()),
    };
    let right_kind = match (entry.codec, entry.kind) {
        (CODEC_NONE, _) => true,
        (_, None) => false,
        // Blocks of bytes are legal for any section that is not needed to open a file.
        (CODEC_PLANES, _) => true,
        (codec, Some(kind)) => codec == codec_of(frame, kind),
    };
    if ok && right_kind {
        return Ok(());
    }
    Err(CodingError("a packed section is impossible (SPEC 5.1)").into())
}

fn decode_section<R: ReadAt + ?Sized>(
    source: &R,
    packed: &Frame,
    entry: &SectionEntry,
    mapped: &Frame,
    out: &File,
    follow: Option<&Follow<'_>>,
) -> Result<(), Stop> {
    let Some(target) = mapped.sections.iter().find(|e| e.tag == entry.tag) else { return Ok(()) };
    let mut stored = Stored(Cursor::new(source, entry.offset, entry.end(), planes::BLOCK_BYTES));
    let mut writer = Writer::new(out, target.offset, target.end());
    if let Some(follow) = follow {
        // Everything before this section is written, or never read.
        follow.reached(target.offset);
        writer = writer.followed(follow);
    }
    match entry.codec {
        CODEC_NONE => {
            writer.copy(&mut stored.0)?;
            writer.flush().map_err(Stop::Output)?;
        }
        CODEC_PLANES => stored.planes(entry.item_bytes, &mut writer)?,
        CODEC_CUBES => nodes(&mut stored, packed, target, out)?,
        CODEC_DIRECTIONS => directions(&mut stored, mapped, &mut writer, out)?,
        CODEC_DISTANCES => distances(&mut stored, mapped, &mut writer, out)?,
        _ => {}
    }
    // Each section has workers and code of its own.
    give_back();
    match stored.0.left() {
        0 => Ok(()),
        _ => Err(CodingError("a packed section has bytes left over (SPEC 5.1)").into()),
    }
}

/// Reads a group's header into a group of so many levels, and its payload.
fn next_group<R: ReadAt + ?Sized, G: GroupCoder>(
    stored: &mut Stored<'_, R>,
    left: &mut u64,
    worker: &mut Worker<G>,
) -> Result<u32, Stop> {
    let (subtrees, payload) = stored.group(*left)?;
    *left -= u64::from(subtrees);
    worker.payload = payload;
    Ok(subtrees)
}

/// The infobytes of each group, written to their depths (SPEC 5.6).
fn nodes<R: ReadAt + ?Sized>(
    stored: &mut Stored<'_, R>,
    frame: &Frame,
    target: &SectionEntry,
    out: &File,
) -> Result<(), Stop> {
    let shape = Shape::new(frame, CUBE_DEPTH);
    let Some(mut levels) = LevelWriters::new(stored, frame, shape, target, out)? else { return Ok(()) };
    let mut left = shape.subtrees;
    each_group::<NodeCoder>(
        Direction::Decode,
        |worker| {
            if left == 0 {
                return Ok(false);
            }
            shape.clear(&mut worker.group);
            worker.group.subtrees = next_group(stored, &mut left, worker)?;
            Ok(true)
        },
        |worker| levels.write(&worker.group.levels),
    )?;
    levels.finish()
}

/// Items of each voxel (SPEC 5.7, 5.8); `read` adds the context of the decoder to a group, `content` returns the
/// decoded items.
fn voxels<G: GroupCoder, R: ReadAt + ?Sized>(
    stored: &mut Stored<'_, R>,
    mapped: &Frame,
    writer: &mut Writer,
    out: &File,
    kind: SectionKind,
    mut read: impl FnMut(&mut Group) -> Result<(), Stop>,
    mut content: impl FnMut(&Group, &mut Writer) -> io::Result<()>,
) -> Result<(), Stop> {
    let shape = Shape::new(mapped, G::DEPTH);
    let mut subtrees = Subtrees::new(out, mapped, shape);
    let (mut left, mut due) = (shape.subtrees, mapped.header.voxels);
    each_group::<G>(
        Direction::Decode,
        |worker| {
            if left == 0 {
                return Ok(false);
            }
            let stated = next_group(stored, &mut left, worker)?;
            subtrees.fill(&mut worker.group, G::VOXELS)?;
            if worker.group.subtrees != stated {
                return Err(CodingError::GROUP_SUBTREES.into());
            }
            // The infobytes may have more voxels than the header states.
            due = due.checked_sub(worker.group.voxels as u64).ok_or(FormatError::MissingItem { kind })?;
            read(&mut worker.group)?;
            Ok(true)
        },
        |worker| content(&worker.group, writer).map_err(Stop::Output),
    )?;
    if !writer.is_full() {
        let items = kind.items_name();
        return Err(damaged(format_args!("there are more {items} than voxels (SPEC I11)")).into());
    }
    writer.flush().map_err(Stop::Output)
}

fn directions<R: ReadAt + ?Sized>(
    stored: &mut Stored<'_, R>,
    mapped: &Frame,
    writer: &mut Writer,
    out: &File,
) -> Result<(), Stop> {
    let kind = SectionKind::Voxels(Channel::Normal);
    let mut bytes = Vec::new();
    let read = |_: &mut Group| Ok(());
    voxels::<DirectionCoder, R>(stored, mapped, writer, out, kind, read, |group, writer| {
        // In parts, so as not to hold them twice.
        group.normals.chunks(1 << 12).try_for_each(|part| {
            bytes.clear();
            bytes.extend(part.iter().flat_map(|code| code.to_le_bytes()));
            writer.write(&bytes)
        })
    })
}

fn distances<R: ReadAt + ?Sized>(
    stored: &mut Stored<'_, R>,
    mapped: &Frame,
    writer: &mut Writer,
    out: &File,
) -> Result<(), Stop> {
    let kind = SectionKind::Voxels(Channel::Offset);
    let mut normals = Normals::new(out, mapped)?;
    let read = |group: &mut Group| Ok(normals.next(group.voxels, &mut group.normals)?);
    voxels::<DistanceCoder, R>(stored, mapped, writer, out, kind, read, |group, writer| {
        group.offsets.chunks(1 << 14).try_for_each(|part| writer.write(part))
    })
}

/// Writes the rank directory of the nodes that are in `out`, and returns its CRC.
pub(super) fn rebuild_rank(mapped: &Frame, out: &File) -> Result<u32, Stop> {
    let (Some(nodes), Some(target)) = (mapped.section(SectionKind::Nodes), mapped.section(SectionKind::Rank))
    else {
        return Ok(0);
    };
    let middle = target.offset + rank::directory_bytes(mapped.header.nodes).0;
    let mut supers = Writer::new(out, target.offset, middle);
    let mut blocks = Writer::new(out, middle, target.end());
    let mut infobytes = Cursor::new(out, nodes.offset, nodes.end(), planes::BLOCK_BYTES);
    let mut builder = rank::RankBuilder::default();
    let mut result: io::Result<()> = Ok(());
    while infobytes.left() > 0 {
        let part = infobytes.next_part()?;
        let (mut due_supers, mut due_blocks) = (Vec::new(), Vec::new());
        builder.feed(part, |s| due_supers.extend(s.to_le_bytes()), |b| due_blocks.extend(b.to_le_bytes()));
        result = result.and_then(|()| supers.write(&due_supers)).and_then(|()| blocks.write(&due_blocks));
    }
    result.and_then(|()| supers.flush()).and_then(|()| blocks.flush()).map_err(Stop::Output)?;
    crc_of(out, target)
}

/// Writes the coarse means of the voxels in `source` to their place in `out` (SPEC 5.4).
pub(super) fn rebuild_means<R: ReadAt + ?Sized>(source: &R, mapped: &Frame, out: &File) -> Result<(), Stop> {
    let coarse = mapped.dims().depth().saturating_sub(1);
    let mut writers: Vec<(Channel, usize, Vec<Writer>)> = walked_channels(mapped)
        .into_iter()
        .map(|channel| {
            let Some(entry) = mapped.section(SectionKind::Means(channel)) else {
                return (channel, 0, Vec::new());
            };
            let item = u64::from(entry.item_bytes);
            let levels = (0..coarse).map(|d| {
                let level = mapped.level(Level::new(d));
                Writer::new(out, entry.offset + level.start * item, entry.offset + level.end * item)
            });
            (channel, usize::from(entry.item_bytes), levels.collect())
        })
        .collect();
    walk(source, mapped, coarse, &mut |level, sums| {
        for ((channel, item, levels), sum) in writers.iter_mut().zip(sums) {
            if let (Some(writer), Some(means)) = (levels.get_mut(level.index()), &channel.row().means) {
                writer.write(means.rule.mean(sum).get(..*item).unwrap_or_default())?;
            }
        }
        Ok::<(), Fault>(())
    })?;
    writers.iter_mut().flat_map(|(.., levels)| levels).try_for_each(Writer::flush).map_err(Stop::Output)
}
