//! The check of cells between labels (SPEC I22), in the order of the file, with the labels of each cell.

use crate::format::cell::{CORNERS, HAS_CORNERS, Plane};
use crate::format::{
    Channel, FormatError, Label, SectionKind, WALL_BYTES, WallItem, Walls, damaged, wall_offset,
};

use super::frame::Frame;
use super::stream::{Cursor, Fault, ReadAt};

/// Bytes of each of the three buffers.
const CURSOR_BYTES: usize = 16 << 10;

/// The normals, offsets and items of the cells that are not checked yet.
pub(super) struct WalledCells<'a, R: ReadAt + ?Sized> {
    normals: Cursor<'a, R>,
    offsets: Cursor<'a, R>,
    corners: Cursor<'a, R>,
    cell: u64,
}

impl<'a, R: ReadAt + ?Sized> WalledCells<'a, R> {
    /// The cells of a file; `None` unless they lie between labels.
    pub(super) fn new(source: &'a R, frame: &Frame) -> Option<Self> {
        let cursor = |channel| {
            let entry = frame.section(SectionKind::Voxels(channel)).filter(|_| frame.header.walls)?;
            Some(Cursor::new(source, entry.offset, entry.end(), CURSOR_BYTES))
        };
        Some(Self {
            normals: cursor(Channel::Normal)?,
            offsets: cursor(Channel::Offset)?,
            corners: cursor(Channel::Corners)?,
            cell: 0,
        })
    }

    /// Checks the next cell; `pair` holds its labels behind and in front.
    pub(super) fn check(&mut self, pair: [u16; 2], table: &[Label]) -> Result<(), Fault> {
        let cell = self.cell;
        self.cell += 1;
        let missing = |channel| FormatError::MissingItem { kind: SectionKind::Voxels(channel) };
        let code = self.normals.take::<2>()?.ok_or(missing(Channel::Normal))?;
        let [offset] = self.offsets.take::<1>()?.ok_or(missing(Channel::Offset))?.map(u8::cast_signed);
        let (code, [behind, front]) = (u16::from_le_bytes(code), pair);
        let is_sound = if offset == HAS_CORNERS {
            let item = self.corners.take::<WALL_BYTES>()?.ok_or(missing(Channel::Corners))?;
            let item = WallItem::parse(&item);
            let known = |label: &u16| *label == 0 || table.binary_search_by_key(label, |l| l.number).is_ok();
            let walls = Walls::of_item(code, &item);
            item.pair() == pair
                && item.labels.iter().all(known)
                && (0..CORNERS).all(|corner| walls.corner(corner) == item.labels[corner])
                && walls.has_all_parts()
        } else {
            let inside = Plane::new(code, wall_offset(offset)).inside();
            behind > front && (offset % 2 == 0) == (front == 0) && inside != 0 && inside != u8::MAX
        };
        let wrong =
            || damaged(format_args!("the labels of cell {cell} and its walls do not agree (SPEC I22)"));
        if is_sound { Ok(()) } else { Err(wrong().into()) }
    }
}
