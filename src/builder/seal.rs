//! The last pass over the output: directories, checksums, section table, header.

use super::error::BuildError;
use super::layout::{Census, Layout};
use super::merge::{RUN_BYTES, Run, Target};
use crate::format::cell::{CornerRankBuilder, HAS_CORNERS};
use crate::format::rank::{RankBuilder, directory_bytes};
use crate::format::{
    Channel, Encoding, HEADER_BYTES, Header, LABEL_BYTES, LABEL_GROUP, Label, LabelForm, SectionEntry,
    SectionKind, SurfaceKind, VERSION_MINOR, align_up, label_directory_bytes, labels_to_bytes, table_bytes,
};
use crate::geom::Dims;
use crate::platform::FileExt;

/// Bytes read at a time.
const STEP: usize = 128 << 10;
/// Memory of this pass: the buffer, and the runs of the rank directory.
pub(super) const MEMORY_BYTES: u64 = (STEP + 2 * RUN_BYTES) as u64;

/// Writes the small sections, builds the rank directory, reads every section back for its CRC, and
/// writes table and header last.
pub(super) fn seal(
    target: &Target<'_>,
    dims: Dims,
    surface: SurfaceKind,
    census: &Census,
    metadata: &[u8],
    labels: &[Label],
) -> Result<Vec<SectionEntry>, BuildError> {
    let mut buffer = vec![0; STEP];
    let mut entries = target.layout.entries.clone();
    let of_labels = SectionKind::Voxels(Channel::Label);
    let coded = entries.iter().position(|entry| entry.kind == Some(of_labels));
    if let Some(at) = coded {
        let form = LabelForm::of(labels.len());
        let bytes = code_labels(target, (entries[at].offset, census.voxels), (form, labels), &mut buffer)?;
        entries[at] = SectionEntry::plain(of_labels, 1, bytes, entries[at].offset);
        // Sections behind move up to the end of the blocks.
        for next in at + 1..entries.len() {
            entries[next].offset = align_up(entries[next - 1].end());
        }
    }
    let layout = Layout { entries: entries.clone(), ..Layout::default() };
    let file_bytes = entries.last().map_or(0, SectionEntry::end);
    // The space between sections reads as zeros, as required.
    target.file.set_len(file_bytes).map_err(|e| target.error(e))?;
    let put = |kind, bytes: &[u8]| match layout.offset(kind) {
        Some(at) => target.file.write_all_at(bytes, at).map_err(|e| target.error(e)),
        None => Ok(()),
    };
    put(SectionKind::Meta, metadata)?;
    put(SectionKind::LabelTable, &labels_to_bytes(labels)?)?;
    put(SectionKind::Levels, &census.levels())?;
    let target = &Target { layout: &layout, ..*target };
    let nodes_crc = rank_directory(target, census.nodes(), &mut buffer)?;
    let offsets = SectionKind::Voxels(Channel::Offset);
    directory(
        target,
        (offsets, census.voxels),
        HAS_CORNERS.cast_unsigned(),
        SectionKind::CornerRank,
        &mut buffer,
    )?;
    directory(target, (SectionKind::Nodes, census.nodes()), 0, SectionKind::LeafRank, &mut buffer)?;
    for entry in &mut entries {
        let crc = if entry.kind == Some(SectionKind::Nodes) {
            nodes_crc
        } else {
            let mut crc = 0;
            for_each_part(target, entry.offset, entry.stored_bytes, &mut buffer, |part| {
                crc = crc32c::crc32c_append(crc, part);
                Ok(())
            })?;
            crc
        };
        (entry.stored_crc, entry.content_crc) = (crc, crc);
    }
    let table = table_bytes(&entries);
    let header = Header {
        minor: VERSION_MINOR,
        encoding: Encoding::Mapped,
        surface,
        leaves: target.channels.leaves,
        walls: !labels.is_empty(),
        #[expect(clippy::cast_possible_truncation, reason = "at most one entry for each kind")]
        sections: entries.len() as u16,
        file_bytes,
        nodes: census.nodes(),
        voxels: census.voxels,
        dims,
        table_crc: crc32c::crc32c(&table),
    };
    target.file.write_all_at(&table, HEADER_BYTES as u64).map_err(|e| target.error(e))?;
    target.file.write_all_at(&header.to_bytes(), 0).map_err(|e| target.error(e))?;
    Ok(entries)
}

/// Codes the labels stored behind the longest possible section of blocks, and returns the length of that section.
fn code_labels(
    target: &Target<'_>,
    (section, voxels): (u64, u64),
    (form, table): (LabelForm, &[Label]),
    buffer: &mut [u8],
) -> Result<u64, BuildError> {
    let mut at = label_directory_bytes(voxels);
    let (mut directory, mut blocks) = (Run::new(Some(section)), Run::new(Some(section + at)));
    let (mut labels, mut coded) = (Vec::with_capacity(LABEL_GROUP), Vec::new());
    // Parts are whole groups, except the last.
    const { assert!(STEP.is_multiple_of(LABEL_BYTES * LABEL_GROUP)) };
    for_each_part(target, target.layout.labels, LABEL_BYTES as u64 * voxels, buffer, |part| {
        for group in part.chunks(LABEL_BYTES * LABEL_GROUP) {
            labels.clear();
            let mut last: Option<(&[u8], u32)> = None;
            for bytes in group.chunks_exact(LABEL_BYTES) {
                // Every label of an item has been counted.
                let entry = match last {
                    Some((same, entry)) if same == bytes => entry,
                    _ => form.entry(bytes, table).unwrap_or(0),
                };
                last = Some((bytes, entry));
                labels.push(entry);
            }
            coded.clear();
            directory.put(target, &form.encode_group(&labels, at, &mut coded))?;
            blocks.put(target, &coded)?;
            at += coded.len() as u64;
        }
        Ok(())
    })?;
    directory.flush(target)?;
    blocks.flush(target)?;
    Ok(at)
}

/// Builds the directory from the infobytes written before; returns their CRC.
fn rank_directory(target: &Target<'_>, nodes: u64, buffer: &mut [u8]) -> Result<u32, BuildError> {
    let at = |kind| target.layout.offset(kind);
    let directory = at(SectionKind::Rank);
    let mut supers = Run::new(directory);
    let mut blocks = Run::new(directory.map(|offset| offset + directory_bytes(nodes).0));
    let mut builder = RankBuilder::default();
    let mut crc = 0;
    let mut new_supers = Vec::new();
    let mut new_blocks = Vec::new();
    for_each_part(target, at(SectionKind::Nodes).unwrap_or(0), nodes, buffer, |part| {
        crc = crc32c::crc32c_append(crc, part);
        new_supers.clear();
        new_blocks.clear();
        builder.feed(part, |s| new_supers.extend(s.to_le_bytes()), |b| new_blocks.extend(b.to_le_bytes()));
        supers.put(target, &new_supers)?;
        blocks.put(target, &new_blocks)
    })?;
    supers.flush(target)?;
    blocks.flush(target)?;
    Ok(crc)
}

/// Builds the directory, if the format has it, for the bytes of a value in a section written before.
fn directory(
    target: &Target<'_>,
    (of, count): (SectionKind, u64),
    value: u8,
    directory: SectionKind,
    buffer: &mut [u8],
) -> Result<(), BuildError> {
    let at = |kind| target.layout.offset(kind);
    let (Some(directory), Some(bytes)) = (at(directory), at(of)) else {
        return Ok(());
    };
    let mut blocks = Run::new(Some(directory));
    let mut builder = CornerRankBuilder::of(value);
    let mut new = Vec::new();
    for_each_part(target, bytes, count, buffer, |part| {
        new.clear();
        builder.feed(part, |block| new.extend(block.to_le_bytes()));
        blocks.put(target, &new)
    })?;
    blocks.flush(target)
}

pub(super) fn for_each_part(
    target: &Target<'_>,
    offset: u64,
    len: u64,
    buffer: &mut [u8],
    mut work: impl FnMut(&[u8]) -> Result<(), BuildError>,
) -> Result<(), BuildError> {
    let mut done = 0;
    while done < len {
        target.progress.check()?;
        let now = usize::try_from(len - done).unwrap_or(usize::MAX).min(buffer.len());
        let part = &mut buffer[..now];
        target.file.read_exact_at(part, offset + done).map_err(|e| target.error(e))?;
        work(part)?;
        done += now as u64;
    }
    Ok(())
}
