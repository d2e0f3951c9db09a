//! A mapped file into a packed one.

use std::fs::File;

use crate::format::packed::cubes::NodeCoder;
use crate::format::packed::directions::DirectionCoder;
use crate::format::packed::distances::DistanceCoder;
use crate::format::packed::group::{Group, GroupCoder};
use crate::format::packed::{
    CODEC_CUBES, CODEC_DERIVED, CODEC_DIRECTIONS, CODEC_DISTANCES, CODEC_NONE, CODEC_PLANES, CUBE_DEPTH,
    CodingError, GROUP_BYTES_LIMIT, planes,
};
use crate::format::{
    ENTRY_BYTES, Encoding, FormatError, HEADER_BYTES, SectionEntry, SectionKind, align_up, damaged,
    table_bytes,
};
use crate::geom::Level;
use crate::load::{Cursor, Fault, Frame, ReadAt, verify};
use crate::platform::FileExt;

use super::Stop;
use super::groups::{Direction, each_group};
use super::stream::{Normals, Shape, Subtrees, Writer, codec_of};

/// Packs into an empty file and returns the frame of what was written.
pub(super) fn pack_file<R: ReadAt + ?Sized>(source: &R, out: &File) -> Result<Frame, Stop> {
    let early = Frame::read(source)?;
    if early.header.encoding == Encoding::Packed {
        return Err(FormatError::Said("is packed already; there is nothing to do".into()).into());
    }
    let frame = verify(source)?;
    let at = |kind| frame.sections.iter().position(|e| e.kind == Some(kind));
    // Unpacking puts the directory back right after the nodes.
    if at(SectionKind::Rank) != at(SectionKind::Nodes).map(|n| n + 1) {
        return Err(damaged("a section of unknown kind parts nodes and rank").into());
    }
    let mut packed = frame.clone();
    packed.sections.retain(|e| e.kind != Some(SectionKind::Rank));
    let table_end = (HEADER_BYTES + packed.sections.len() * ENTRY_BYTES) as u64;
    let mut writer = Writer::new(out, table_end, u64::MAX);
    for entry in &mut packed.sections {
        let content = *entry;
        let offset = align_up(writer.position());
        let padding = usize::try_from(offset - writer.position()).unwrap_or(0);
        writer.write(&[0; 64][..padding.min(64)]).map_err(Stop::Output)?;
        writer.take_crc();
        entry.codec = entry.kind.map_or(CODEC_NONE, |kind| codec_of(&frame, kind));
        match entry.codec {
            CODEC_CUBES => nodes(source, &frame, &content, &mut writer)?,
            CODEC_DIRECTIONS => directions(source, &frame, &mut writer)?,
            CODEC_DISTANCES => distances(source, &frame, &content, &mut writer)?,
            CODEC_PLANES => plane_blocks(source, content.offset, &content, &mut writer)?,
            CODEC_DERIVED => {}
            _ => writer.copy(&mut Cursor::new(source, content.offset, content.end(), planes::BLOCK_BYTES))?,
        }
        entry.offset = offset;
        entry.stored_bytes = writer.position() - offset;
        entry.stored_crc = writer.take_crc();
    }
    writer.flush().map_err(Stop::Output)?;
    packed.header.encoding = Encoding::Packed;
    packed.header.file_bytes = writer.position();
    finish_frame(&mut packed, out)?;
    Ok(packed)
}

/// Writes header and table of a frame whose entries and length are known.
pub(super) fn finish_frame(frame: &mut Frame, out: &File) -> Result<(), Stop> {
    let table = table_bytes(&frame.sections);
    frame.header.sections = u16::try_from(frame.sections.len()).unwrap_or(u16::MAX);
    frame.header.table_crc = crc32c::crc32c(&table);
    out.write_all_at(&frame.header.to_bytes(), 0).map_err(Stop::Output)?;
    out.write_all_at(&table, HEADER_BYTES as u64).map_err(Stop::Output)
}

/// The content from `start` to the section's end, in blocks (SPEC 5.3).
fn plane_blocks<R: ReadAt + ?Sized>(
    source: &R,
    start: u64,
    entry: &SectionEntry,
    writer: &mut Writer,
) -> Result<(), Stop> {
    let full = planes::block_bytes(entry.item_bytes);
    let mut block = Vec::new();
    let mut at = start;
    while at < entry.end() {
        let len = (entry.end() - at).min(full as u64);
        block.resize(usize::try_from(len).unwrap_or(0), 0);
        source.read_at(&mut block, at).map_err(|e| Stop::Input(e.into()))?;
        let stored = planes::encode(&block, entry.item_bytes).map_err(Stop::Output)?;
        writer.write(&length(stored.len())?.to_le_bytes()).map_err(Stop::Output)?;
        writer.write(&stored).map_err(Stop::Output)?;
        at += len;
    }
    Ok(())
}

fn length(len: usize) -> Result<u32, CodingError> {
    let stored = u32::try_from(len).ok().filter(|len| *len <= GROUP_BYTES_LIMIT);
    stored.ok_or(CodingError("a packed group passes its limit (SPEC 5.2)"))
}

/// One group after the other (SPEC 5.2); `read` adds the codec's items to its subtrees.
fn groups<G: GroupCoder, R: ReadAt + ?Sized>(
    source: &R,
    frame: &Frame,
    writer: &mut Writer,
    mut read: impl FnMut(&mut Group) -> Result<(), Fault>,
) -> Result<(), Stop> {
    let mut subtrees = Subtrees::new(source, frame, Shape::new(frame, G::DEPTH));
    each_group::<G>(
        Direction::Encode,
        |worker| {
            subtrees.fill(&mut worker.group, G::VOXELS)?;
            read(&mut worker.group)?;
            Ok(worker.group.subtrees > 0)
        },
        |worker| {
            writer.write(&length(worker.payload.len())?.to_le_bytes()).map_err(Stop::Output)?;
            writer.write(&worker.group.subtrees.to_le_bytes()).map_err(Stop::Output)?;
            writer.write(&worker.payload).map_err(Stop::Output)
        },
    )
}

fn nodes<R: ReadAt + ?Sized>(
    source: &R,
    frame: &Frame,
    entry: &SectionEntry,
    writer: &mut Writer,
) -> Result<(), Stop> {
    let shape = Shape::new(frame, CUBE_DEPTH);
    if shape.levels == 0 {
        return Ok(());
    }
    let top = SectionEntry { stored_bytes: frame.level(Level::new(shape.root_depth)).start, ..*entry };
    plane_blocks(source, entry.offset, &top, writer)?;
    groups::<NodeCoder, R>(source, frame, writer, |_| Ok(()))
}

fn directions<R: ReadAt + ?Sized>(source: &R, frame: &Frame, writer: &mut Writer) -> Result<(), Stop> {
    let mut normals = Normals::new(source, frame)?;
    groups::<DirectionCoder, R>(source, frame, writer, |group| normals.next(group.voxels, &mut group.normals))
}

fn distances<R: ReadAt + ?Sized>(
    source: &R,
    frame: &Frame,
    entry: &SectionEntry,
    writer: &mut Writer,
) -> Result<(), Stop> {
    let mut normals = Normals::new(source, frame)?;
    let mut offsets = Cursor::new(source, entry.offset, entry.end(), planes::BLOCK_BYTES);
    groups::<DistanceCoder, R>(source, frame, writer, |group| {
        normals.next(group.voxels, &mut group.normals)?;
        while group.offsets.len() < group.voxels {
            let left = group.voxels - group.offsets.len();
            group.offsets.extend_from_slice(offsets.next_part_up_to(left)?);
        }
        Ok(())
    })
}
