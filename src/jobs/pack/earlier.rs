//! The groups of files up to version 1.1, coded bit by bit: read, not written any more.

use std::fs::File;

use crate::format::packed::coder::Decoder;
use crate::format::packed::normals::NormalCoder;
use crate::format::packed::offsets::OffsetCoder;
use crate::format::packed::structure::{Cell, StructureCoder, cells_of};
use crate::format::{Channel, FormatError, SectionEntry, SectionKind};
use crate::load::{Frame, ReadAt};

use super::decode::{LevelWriters, Stored};
use super::stop::Stop;
use super::stream::{Normals, Subtrees, Writer, roots, subtree_shape};

/// SPEC 5.3
pub(super) fn structure<R: ReadAt + ?Sized>(
    stored: &mut Stored<'_, R>,
    frame: &Frame,
    target: &SectionEntry,
    out: &File,
) -> Result<(), Stop> {
    let Some(mut writers) = LevelWriters::new(stored, frame, target, out)? else { return Ok(()) };
    let depth = subtree_shape(frame).1 as usize;
    let mut coder = StructureCoder::new(depth);
    let mut levels = vec![Vec::new(); depth];
    let mut cells = Vec::new();
    let mut left = roots(frame);
    while left > 0 {
        let (subtrees, payload) = stored.group(left)?;
        let mut decoder = Decoder::new(&payload)?;
        coder.restart();
        for _ in 0..subtrees {
            coder.code(&mut decoder, &mut levels, true, &mut cells)?;
            writers.write(&levels)?;
        }
        decoder.finish()?;
        left -= u64::from(subtrees);
    }
    writers.finish()
}

/// What reads the content of subtrees one after the other.
trait Contents {
    /// The section.
    const KIND: SectionKind;
    /// Bytes of an item.
    const ITEM: u64;

    /// At the start of a group.
    fn restart(&mut self);

    /// The items of one subtree's cells, instead of what `content` held.
    fn next(&mut self, decoder: &mut Decoder<'_>, cells: &[Cell], content: &mut Vec<u8>) -> Result<(), Stop>;
}

fn contents<R: ReadAt + ?Sized, C: Contents>(
    stored: &mut Stored<'_, R>,
    mapped: &Frame,
    writer: &mut Writer,
    out: &File,
    mut coder: C,
) -> Result<(), Stop> {
    let kind = C::KIND;
    let (mut levels, mut cells, mut content) = (Vec::new(), Vec::new(), Vec::new());
    let mut subtrees = Subtrees::new(out, mapped);
    let mut left = roots(mapped);
    while left > 0 {
        let (count, payload) = stored.group(left)?;
        let mut decoder = Decoder::new(&payload)?;
        coder.restart();
        for _ in 0..count {
            let voxels = subtrees.next(&mut levels)?.unwrap_or(0);
            if voxels.saturating_mul(C::ITEM) > writer.room() {
                return Err(FormatError::MissingItem { kind }.into());
            }
            cells_of(&levels, &mut cells)?;
            coder.next(&mut decoder, &cells, &mut content)?;
            writer.write(&content).map_err(Stop::Output)?;
        }
        decoder.finish()?;
        left -= u64::from(count);
    }
    if !writer.is_full() {
        return Err(FormatError::SurplusItems { kind, room: writer.room() }.into());
    }
    writer.flush().map_err(Stop::Output)
}

/// SPEC 5.4
pub(super) fn normals<R: ReadAt + ?Sized>(
    stored: &mut Stored<'_, R>,
    mapped: &Frame,
    writer: &mut Writer,
    out: &File,
) -> Result<(), Stop> {
    contents(stored, mapped, writer, out, NormalContents::default())
}

#[derive(Default)]
struct NormalContents {
    coder: NormalCoder,
    codes: Vec<u16>,
}

impl Contents for NormalContents {
    const KIND: SectionKind = SectionKind::Voxels(Channel::Normal);
    const ITEM: u64 = 2;

    fn restart(&mut self) {
        self.coder.restart();
    }

    fn next(&mut self, decoder: &mut Decoder<'_>, cells: &[Cell], content: &mut Vec<u8>) -> Result<(), Stop> {
        self.codes.clear();
        self.codes.resize(cells.len(), 0);
        self.coder.code(decoder, cells, &mut self.codes)?;
        content.clear();
        content.extend(self.codes.iter().flat_map(|code| code.to_le_bytes()));
        Ok(())
    }
}

/// SPEC 5.7
pub(super) fn offsets<R: ReadAt + ?Sized>(
    stored: &mut Stored<'_, R>,
    mapped: &Frame,
    writer: &mut Writer,
    out: &File,
) -> Result<(), Stop> {
    let normals = Normals::new(out, mapped)?;
    let coder = OffsetContents { coder: OffsetCoder::default(), normals, codes: Vec::new() };
    contents(stored, mapped, writer, out, coder)
}

struct OffsetContents<'a> {
    coder: OffsetCoder,
    normals: Normals<'a, File>,
    codes: Vec<u16>,
}

impl Contents for OffsetContents<'_> {
    const KIND: SectionKind = SectionKind::Voxels(Channel::Offset);
    const ITEM: u64 = 1;

    fn restart(&mut self) {
        self.coder.restart();
    }

    fn next(&mut self, decoder: &mut Decoder<'_>, cells: &[Cell], content: &mut Vec<u8>) -> Result<(), Stop> {
        self.normals.next(cells.len(), &mut self.codes)?;
        content.clear();
        content.resize(cells.len(), 0);
        self.coder.code(decoder, cells, &self.codes, content)?;
        Ok(())
    }
}
