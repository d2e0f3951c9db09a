//! Larger leaves in the full check: their directory and planes, and their part in coarse means (SPEC I14, I15, I19).

use crate::format::{FormatError, SectionKind, cell, damaged};
use crate::geom::Level;

use super::frame::Frame;
use super::stream::{Cursor, Fault, ReadAt};

const CURSOR_BYTES: usize = 16 << 10;

fn cursor<'a, R: ReadAt + ?Sized>(
    source: &'a R,
    frame: &Frame,
    kind: SectionKind,
) -> Result<Cursor<'a, R>, FormatError> {
    let entry = frame.section(kind).ok_or(FormatError::MissingSection(kind))?;
    Ok(Cursor::new(source, entry.offset, entry.end(), CURSOR_BYTES))
}

/// SPEC I14 and I19: a plane for each infobyte of 0, and the directory that counts these.
pub(super) fn check_leaves<R: ReadAt + ?Sized>(source: &R, frame: &Frame) -> Result<(), Fault> {
    if !frame.header.leaves {
        return Ok(());
    }
    let mut nodes = cursor(source, frame, SectionKind::Nodes)?;
    let mut directory = cursor(source, frame, SectionKind::LeafRank)?;
    let (mut builder, mut due_blocks, mut block) = (cell::CornerRankBuilder::of(0), Vec::new(), 0);
    while nodes.left() > 0 {
        builder.feed(nodes.next_part()?, |b| due_blocks.push(b));
        for due in due_blocks.drain(..) {
            if directory.take::<8>()?.map(u64::from_le_bytes) != Some(due) {
                return Err(FormatError::LeafRank { block, due }.into());
            }
            block += 1;
        }
    }
    let found = frame.section(SectionKind::LeafNormals).map_or(0, |entry| entry.items);
    let due = builder.with_corners();
    if due != found {
        return Err(damaged(format_args!(
            "{found} larger leaves are described where the nodes have {due} (SPEC I19)"
        ))
        .into());
    }
    for (kind, bytes) in [(SectionKind::LeafNormals, 2), (SectionKind::LeafOffsets, 1)] {
        let (mut items, mut before) = (cursor(source, frame, kind)?, 0);
        while items.left() > 0 {
            let part = items.next_part()?;
            if let Some(at) = part.iter().position(|c| *c == 0x80) {
                return Err(FormatError::IllegalLeaf { leaf: (before + at as u64) / bytes }.into());
            }
            before += part.len() as u64;
        }
    }
    Ok(())
}

/// The normals of larger leaves, one cursor a depth.
pub(super) struct LeafNormals<'a, R: ?Sized> {
    first_depth: usize,
    depths: Vec<Cursor<'a, R>>,
}

impl<'a, R: ReadAt + ?Sized> LeafNormals<'a, R> {
    /// The leaf normals of a model; `None` without larger leaves. Cost: a pass over the nodes.
    pub(super) fn new(source: &'a R, frame: &Frame) -> Result<Option<Self>, Fault> {
        if !frame.header.leaves {
            return Ok(None);
        }
        let nodes =
            frame.section(SectionKind::Nodes).ok_or(FormatError::MissingSection(SectionKind::Nodes))?;
        let kind = SectionKind::LeafNormals;
        let entry = frame.section(kind).ok_or(FormatError::MissingSection(kind))?;
        let (mut depths, mut first) = (Vec::new(), 0_u64);
        for d in 0..frame.dims().depth() {
            let level = frame.level(Level::new(d));
            let at = |node: u64| nodes.offset.saturating_add(node);
            let mut infobytes = Cursor::new(source, at(level.start), at(level.end), CURSOR_BYTES);
            let before = first;
            while infobytes.left() > 0 {
                first += infobytes.next_part()?.iter().filter(|b| **b == 0).count() as u64;
            }
            let at = |leaf: u64| entry.offset.saturating_add(leaf.saturating_mul(2)).min(entry.end());
            depths.push(Cursor::new(source, at(before), at(first), CURSOR_BYTES));
        }
        let first_depth = cell::first_leaf_depth(frame.dims().depth()) as usize;
        Ok(Some(Self { first_depth, depths }))
    }

    /// The next normal of a depth; `None` for depths without larger leaves.
    pub(super) fn next(&mut self, depth: usize) -> Result<Option<[u8; 2]>, Fault> {
        match self.depths.get_mut(depth) {
            Some(cursor) if depth >= self.first_depth => cursor.take::<2>(),
            _ => Ok(None),
        }
    }
}
