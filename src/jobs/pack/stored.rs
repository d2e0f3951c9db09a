//! Stored bytes of a packed section, and the writers of its infobytes.

use std::fs::File;

use crate::format::SectionEntry;
use crate::format::packed::{CodingError, GROUP_BYTES_LIMIT, planes};
use crate::geom::Level;
use crate::load::{Cursor, Frame, ReadAt};

use super::Stop;
use super::stream::{Shape, Writer};

/// Stored bytes of one section, read from front to back.
pub(super) struct Stored<'a, R: ReadAt + ?Sized>(pub(super) Cursor<'a, R>);

impl<R: ReadAt + ?Sized> Stored<'_, R> {
    pub(super) fn number(&mut self) -> Result<u32, Stop> {
        let bytes = self.0.take::<4>()?.ok_or(CodingError("a packed section ends early (SPEC 5.1)"))?;
        Ok(u32::from_le_bytes(bytes))
    }

    /// The next `len` bytes; a length beyond the section or the limit is refused before allocating.
    pub(super) fn bytes(&mut self, len: u32, limit: u32) -> Result<Vec<u8>, Stop> {
        if len > limit || u64::from(len) > self.0.left() {
            let sentence = "a packed block is longer than its section or its limit (SPEC 5.1)";
            return Err(CodingError(sentence).into());
        }
        let mut bytes = Vec::with_capacity(len as usize);
        while bytes.len() < len as usize {
            let left = len as usize - bytes.len();
            let part = self.0.next_part_up_to(left)?;
            bytes.extend_from_slice(part);
        }
        Ok(bytes)
    }

    /// Decodes blocks until the writer is full (SPEC 5.3).
    pub(super) fn planes(&mut self, item: u8, writer: &mut Writer) -> Result<(), Stop> {
        while !writer.is_full() {
            let len = usize::try_from(writer.room()).unwrap_or(usize::MAX).min(planes::block_bytes(item));
            let stored_len = self.number()?;
            let stored = self.bytes(stored_len, planes::STORED_LIMIT)?;
            writer.write(&planes::decode(&stored, item, len)?).map_err(Stop::Output)?;
        }
        writer.flush().map_err(Stop::Output)
    }

    /// The number of subtrees of a group, and its payload (SPEC 5.2).
    pub(super) fn group(&mut self, left: u64) -> Result<(u32, Vec<u8>), Stop> {
        let (len, subtrees) = (self.number()?, self.number()?);
        if subtrees == 0 || u64::from(subtrees) > left {
            return Err(CodingError::GROUP_SUBTREES.into());
        }
        Ok((subtrees, self.bytes(len, GROUP_BYTES_LIMIT)?))
    }
}

/// Writers to the depths of the subtrees in the output, each from front to back.
pub(super) struct LevelWriters<'a>(Vec<Writer<'a>>);

impl<'a> LevelWriters<'a> {
    /// Writes the infobytes above the subtrees, and positions the writers at the first subtree; `None` without any
    /// nodes.
    pub(super) fn new<R: ReadAt + ?Sized>(
        stored: &mut Stored<'_, R>,
        frame: &Frame,
        shape: Shape,
        target: &SectionEntry,
        out: &'a File,
    ) -> Result<Option<Self>, Stop> {
        let Shape { root_depth, levels, .. } = shape;
        if levels == 0 {
            return Ok(None);
        }
        let top = frame.level(Level::new(root_depth)).start;
        stored.planes(1, &mut Writer::new(out, target.offset, target.offset + top))?;
        let writers = (root_depth..root_depth + levels)
            .map(|d| {
                let level = frame.level(Level::new(d));
                Writer::new(out, target.offset + level.start, target.offset + level.end)
            })
            .collect();
        Ok(Some(Self(writers)))
    }

    /// Appends to each depth.
    pub(super) fn write(&mut self, levels: &[Vec<u8>]) -> Result<(), Stop> {
        for (writer, level) in self.0.iter_mut().zip(levels) {
            if level.len() as u64 > writer.room() {
                return Err(CodingError::SUBTREE_NODES.into());
            }
            // In parts, so as not to hold them twice.
            level.chunks(1 << 14).try_for_each(|part| writer.write(part)).map_err(Stop::Output)?;
        }
        Ok(())
    }

    /// Checks that every depth is full.
    pub(super) fn finish(mut self) -> Result<(), Stop> {
        for writer in &mut self.0 {
            if !writer.is_full() {
                return Err(CodingError::SUBTREE_NODES.into());
            }
            writer.flush().map_err(Stop::Output)?;
        }
        Ok(())
    }
}
