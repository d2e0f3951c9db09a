//! Buffered writing at positions, and subtrees out of breadth-first levels.

use std::fs::File;
use std::io;

use crate::format::packed::CODEC_DISTANCES;
use crate::format::packed::group::Group;
use crate::format::{Channel, FormatError, SectionEntry, SectionKind, SurfaceKind, cell, damaged};
use crate::geom::Level;
use crate::load::{Cursor, Fault, Frame, ReadAt};
use crate::platform::FileExt;

use super::Stop;
use super::follow::Follow;

/// Bytes of a writer's or a cursor's buffer.
pub(super) const BUFFER_BYTES: usize = 64 << 10;
/// Bytes of the buffer of a cursor over one depth.
const LEVEL_BUFFER_BYTES: usize = 16 << 10;

/// Sequential writer to one place of a file; [`Writer::flush`] must be called at the end.
pub(super) struct Writer<'a> {
    file: &'a File,
    at: u64,
    /// Position that must not be passed.
    end: u64,
    buffer: Vec<u8>,
    crc: u32,
    /// Follower to be notified of the writer's position.
    follow: Option<&'a Follow<'a>>,
}

impl<'a> Writer<'a> {
    /// A writer for `start..end`.
    pub(super) fn new(file: &'a File, start: u64, end: u64) -> Self {
        Self { file, at: start, end, buffer: Vec::new(), crc: 0, follow: None }
    }

    /// The same writer, notifying a follower of its position.
    pub(super) fn followed(self, follow: &'a Follow<'a>) -> Self {
        Self { follow: Some(follow), ..self }
    }

    /// Position of the next byte.
    pub(super) fn position(&self) -> u64 {
        self.at + self.buffer.len() as u64
    }

    /// CRC of the bytes written since the last call.
    pub(super) fn take_crc(&mut self) -> u32 {
        std::mem::take(&mut self.crc)
    }

    /// Appends bytes.
    pub(super) fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        if self.room() < bytes.len() as u64 {
            return Err(io::Error::other("more content than its place has room for"));
        }
        self.crc = crc32c::crc32c_append(self.crc, bytes);
        self.buffer.extend_from_slice(bytes);
        if self.buffer.len() >= BUFFER_BYTES { self.flush() } else { Ok(()) }
    }

    /// Appends the rest of what a cursor reads.
    pub(super) fn copy<R: ReadAt + ?Sized>(&mut self, from: &mut Cursor<'_, R>) -> Result<(), Stop> {
        while from.left() > 0 {
            self.write(from.next_part()?).map_err(Stop::Output)?;
        }
        Ok(())
    }

    /// True if the writer has reached its end.
    pub(super) fn is_full(&self) -> bool {
        self.position() == self.end
    }

    /// Bytes left.
    pub(super) fn room(&self) -> u64 {
        self.end.saturating_sub(self.position())
    }

    /// Hands the buffer to the system.
    pub(super) fn flush(&mut self) -> io::Result<()> {
        self.file.write_all_at(&self.buffer, self.at)?;
        self.at += self.buffer.len() as u64;
        self.buffer.clear();
        if let Some(follow) = self.follow {
            follow.reached(self.at);
        }
        Ok(())
    }
}

/// The subtrees of a model.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shape {
    /// Depth of the subtrees' roots.
    pub(super) root_depth: u32,
    /// Levels of nodes in each subtree.
    pub(super) levels: u32,
    /// The first level that may have larger leaves.
    first_leaves: usize,
    /// Number of subtrees: the nodes (or, at depth 0, the voxel) that are their roots.
    pub(super) subtrees: u64,
}

impl Shape {
    /// Subtrees of at most `most` levels.
    pub(super) fn new(frame: &Frame, most: u32) -> Self {
        let depth = frame.dims().depth();
        let levels = depth.min(most);
        let root_depth = depth - levels;
        let roots = frame.level(Level::new(root_depth));
        let subtrees = if levels == 0 { frame.header.voxels } else { roots.end - roots.start };
        let first = cell::first_leaf_depth(depth).saturating_sub(root_depth) as usize;
        Self {
            root_depth,
            levels,
            first_leaves: if frame.header.leaves { first } else { usize::MAX },
            subtrees,
        }
    }

    /// Makes a group empty, for these subtrees.
    pub(super) fn clear(self, group: &mut Group) {
        group.clear(self.levels as usize, self.first_leaves);
    }
}

/// Gives the subtrees of a mapped file in Morton order, with one cursor per depth.
pub(super) struct Subtrees<'a, R: ReadAt + ?Sized> {
    cursors: Vec<Cursor<'a, R>>,
    shape: Shape,
    left: u64,
}

impl<'a, R: ReadAt + ?Sized> Subtrees<'a, R> {
    pub(super) fn new(source: &'a R, frame: &Frame, shape: Shape) -> Self {
        let nodes = frame.section(SectionKind::Nodes).map_or(0, |e| e.offset);
        let cursors = (shape.root_depth..shape.root_depth + shape.levels)
            .map(|d| {
                let level = frame.level(Level::new(d));
                Cursor::new(source, nodes + level.start, nodes + level.end, LEVEL_BUFFER_BYTES)
            })
            .collect();
        Self { cursors, shape, left: shape.subtrees }
    }

    /// Appends the next subtree's infobytes by depth to a group, and counts its voxels and larger leaves.
    fn append(&mut self, group: &mut Group) -> Result<(), Fault> {
        let mut count = 1_u64;
        let cut =
            || Fault::from(damaged("a depth has fewer nodes than their parents have children (SPEC I11)"));
        for (depth, (cursor, level)) in self.cursors.iter_mut().zip(&mut group.levels).enumerate() {
            if count > cursor.left() {
                return Err(cut());
            }
            let (mut left, mut children) = (count, 0);
            while left > 0 {
                let part = cursor.next_part_up_to(usize::try_from(left).unwrap_or(usize::MAX))?;
                let leaves = part.iter().filter(|m| **m == 0).count();
                if leaves > 0 && depth < self.shape.first_leaves {
                    return Err(cut());
                }
                group.leaves += leaves;
                children += part.iter().map(|m| u64::from(m.count_ones())).sum::<u64>();
                left -= part.len() as u64;
                level.extend_from_slice(part);
            }
            count = children;
        }
        group.subtrees += 1;
        group.voxels += usize::try_from(count).unwrap_or(usize::MAX);
        Ok(())
    }

    /// Fills a group with the next subtrees (SPEC 5.2), until it is full or none is left.
    pub(super) fn fill(&mut self, group: &mut Group, full: usize) -> Result<(), Fault> {
        self.shape.clear(group);
        while group.voxels + group.leaves < full && self.left > 0 {
            self.left -= 1;
            self.append(group)?;
        }
        Ok(())
    }
}

/// Codec of a section in the packed encoding (SPEC 5.1).
pub(super) fn codec_of(frame: &Frame, kind: SectionKind) -> u8 {
    let is_of_cells = frame.header.surface == SurfaceKind::Cells;
    if is_of_cells && kind == SectionKind::Voxels(Channel::Offset) { CODEC_DISTANCES } else { kind.codec() }
}

/// CRC of a section's bytes in a mapped file.
pub(super) fn crc_of(file: &File, entry: &SectionEntry) -> Result<u32, Stop> {
    let mut bytes = Cursor::new(file, entry.offset, entry.end(), BUFFER_BYTES);
    let mut crc = 0;
    while bytes.left() > 0 {
        crc = crc32c::crc32c_append(crc, bytes.next_part()?);
    }
    Ok(crc)
}

/// Reads the normals of a mapped file from front to back.
pub(super) struct Normals<'a, R: ReadAt + ?Sized>(Cursor<'a, R>);

impl<'a, R: ReadAt + ?Sized> Normals<'a, R> {
    const KIND: SectionKind = SectionKind::Voxels(Channel::Normal);

    pub(super) fn new(source: &'a R, frame: &Frame) -> Result<Self, FormatError> {
        let entry = frame.section(Self::KIND).ok_or(FormatError::MissingItem { kind: Self::KIND })?;
        Ok(Self(Cursor::new(source, entry.offset, entry.end(), BUFFER_BYTES)))
    }

    /// Replaces `codes` by the next `count` codes.
    pub(super) fn next(&mut self, count: usize, codes: &mut Vec<u16>) -> Result<(), Fault> {
        codes.clear();
        while codes.len() < count {
            // Buffers and sections hold whole codes only.
            let missing = FormatError::MissingItem { kind: Self::KIND };
            let (part, rest) = match self.0.left() {
                0 | 1 => return Err(missing.into()),
                _ => self.0.next_part_up_to(2 * (count - codes.len()))?.as_chunks::<2>(),
            };
            if !rest.is_empty() {
                return Err(missing.into());
            }
            codes.extend(part.iter().map(|code| u16::from_le_bytes(*code)));
        }
        Ok(())
    }
}
