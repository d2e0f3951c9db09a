//! The cells of a model, as slices.

use crate::format::cell::{CORNERS, HAS_CORNERS, Plane, corner_number, leaf_number};
use crate::format::{WALL_BYTES, WallItem, normal, wall_offset};

/// The surface within a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CellShape {
    /// A plane; points behind it are inside.
    Plane(Plane),
    /// Samples at the corners, positive inside, with trilinear interpolation between them.
    Corners([i8; CORNERS]),
}

/// Planes of larger leaves (SPEC 4.9), by leaf number: the number of childless nodes before.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LeafItems<'a> {
    normals: &'a [[u8; 2]],
    offsets: &'a [u8],
    directory: &'a [[u8; 8]],
}

impl<'a> LeafItems<'a> {
    /// Leaf items from the contents of `LNRM`, `LOFS` and `LRNK`.
    pub(super) fn new(normals: &'a [u8], offsets: &'a [u8], directory: &'a [u8]) -> Self {
        Self { normals: normals.as_chunks().0, offsets, directory: directory.as_chunks().0 }
    }

    /// Code and offset of a node's plane, by its infobytes. Any bytes are safe: a leaf without data counts as all
    /// inside.
    #[inline(always)]
    pub(super) fn of(&self, infobytes: &[u8], node: usize) -> (u16, i8) {
        let number = usize::try_from(leaf_number(infobytes, self.directory, node)).unwrap_or(usize::MAX);
        self.numbered(number)
    }

    /// Appends the planes of `count` leaves, from the leaf of `node` on, to the planes of `fine` cells.
    #[inline(always)]
    pub(super) fn append(
        &self,
        infobytes: &[u8],
        node: usize,
        (fine, count): (usize, usize),
        room: &mut BrickCodes,
    ) {
        let number = usize::try_from(leaf_number(infobytes, self.directory, node)).unwrap_or(usize::MAX);
        let BrickCodes { normals, offsets } = room;
        let to = normals.iter_mut().zip(offsets).skip(fine).take(count);
        for (i, (normal, offset)) in to.enumerate() {
            let (code, of_leaf) = self.numbered(number.saturating_add(i));
            (*normal, *offset) = (code.to_le_bytes(), of_leaf.cast_unsigned());
        }
    }

    #[inline(always)]
    fn numbered(&self, number: usize) -> (u16, i8) {
        let code = self.normals.get(number).map_or(0, |code| u16::from_le_bytes(*code));
        let offset = self.offsets.get(number).map_or(i8::MAX, |offset| offset.cast_signed());
        (code, if offset == HAS_CORNERS { i8::MAX } else { offset })
    }
}

/// Normals, offsets and corners of a model of cells (SPEC 4.8), by the number of the cell.
///
/// Any bytes are safe: a cell without data counts as all inside, or as a cell of an unknown label.
#[derive(Clone, Copy, Debug)]
pub struct CellItems<'a> {
    normals: &'a [[u8; 2]],
    offsets: &'a [u8],
    corners: &'a [u8],
    directory: &'a [[u8; 8]],
    /// True if planes separate labels (SPEC 4.12).
    walls: bool,
    /// True if they are the surface of the only label.
    alone: bool,
}

/// The normals and offsets of a brick's cells, and of larger leaves among them.
#[derive(Clone, Debug)]
pub(crate) struct BrickCodes {
    pub(crate) normals: [[u8; 2]; BRICK_CELLS],
    pub(crate) offsets: [u8; BRICK_CELLS],
}

/// Most cells of a brick of 4 x 4 x 4.
const BRICK_CELLS: usize = 64;

impl BrickCodes {
    /// Codes of cells without data: all inside.
    pub(crate) const NONE: Self =
        Self { normals: [[0; 2]; BRICK_CELLS], offsets: [i8::MAX.cast_unsigned(); BRICK_CELLS] };
}

/// Offset of a plane between two labels, made all inside where a label lies on either side.
#[inline(always)]
fn all_inside(offset: u8) -> u8 {
    if offset & 1 == 1 { i8::MAX.cast_unsigned() } else { offset }
}

/// Copies as many items as `from` has, at most 64; the rest stays unchanged.
fn copy_start<T: Copy>(to: &mut [T; BRICK_CELLS], from: &[T]) {
    to.iter_mut().zip(from).for_each(|(to, from)| *to = *from);
}

impl<'a> CellItems<'a> {
    /// Cell items from the contents of `NORM`, `OFFS`, `CORN` and `CRNK`.
    pub fn new(normals: &'a [u8], offsets: &'a [u8], corners: &'a [u8], directory: &'a [u8]) -> Self {
        Self {
            normals: normals.as_chunks().0,
            offsets,
            corners,
            directory: directory.as_chunks().0,
            walls: false,
            alone: false,
        }
    }

    /// The same items, as cells between labels (SPEC 4.12).
    pub(super) fn between_labels(self) -> Self {
        Self { walls: true, ..self }
    }

    /// The same items, of the only label: planes and corners are its surface.
    pub(super) fn of_one_label(self) -> Self {
        Self { walls: false, alone: true, ..self }
    }

    /// True if planes separate labels.
    #[inline(always)]
    pub(crate) fn has_walls(&self) -> bool {
        self.walls
    }

    /// The surface within a cell.
    #[inline(always)]
    pub fn shape(&self, cell: u64) -> CellShape {
        match self.plane(cell) {
            Some(plane) => CellShape::Plane(plane),
            None => CellShape::Corners(self.corners(cell)),
        }
    }

    /// The vector of a cell's normal: normal of its plane, or direction of its smooth gradient if it has corners.
    #[inline(always)]
    pub fn normal(&self, cell: u64) -> [i32; 3] {
        normal::decode_l1(self.code(cell))
    }

    /// The plane of a cell, unless it has corners; the space in front of it is outside. A cell with a label on either
    /// side is all inside.
    #[inline(always)]
    pub fn plane(&self, cell: u64) -> Option<Plane> {
        let offset = self.offset(cell);
        (offset != HAS_CORNERS).then(|| Plane::new(self.code(cell), offset))
    }

    /// The offset of a cell's plane, or `HAS_CORNERS`; the offset of all inside with a label on either side.
    #[inline(always)]
    pub(crate) fn offset(&self, cell: u64) -> i8 {
        let offset = self.stored_offset(cell);
        if self.walls { all_inside(offset.cast_unsigned()).cast_signed() } else { offset }
    }

    #[inline(always)]
    fn stored_offset(&self, cell: u64) -> i8 {
        let at = usize::try_from(cell).unwrap_or(usize::MAX);
        self.offsets.get(at).map_or(i8::MAX, |offset| offset.cast_signed())
    }

    /// Normals and offsets of 64 cells from `cell` on, as in [`CellItems::plane`]; `room` is used at the end of the
    /// sections.
    #[inline(always)]
    pub(crate) fn brick<'r>(
        &self,
        cell: u64,
        room: &'r mut BrickCodes,
    ) -> (&'r [[u8; 2]; BRICK_CELLS], &'r [u8; BRICK_CELLS])
    where
        'a: 'r,
    {
        let at = usize::try_from(cell).unwrap_or(usize::MAX);
        let (normals, offsets) =
            (self.normals.get(at..).unwrap_or_default(), self.offsets.get(at..).unwrap_or_default());
        match (normals.first_chunk(), offsets.first_chunk()) {
            (Some(normals), Some(offsets)) if !self.walls => (normals, offsets),
            (Some(normals), Some(offsets)) => {
                (room.normals, room.offsets) = (*normals, offsets.map(all_inside));
                (&room.normals, &room.offsets)
            }
            _ => self.last_brick(normals, offsets, room),
        }
    }

    /// Copies [`CellItems::brick`] into `room`.
    #[inline(always)]
    pub(crate) fn copy_brick(&self, cell: u64, room: &mut BrickCodes) {
        let at = usize::try_from(cell).unwrap_or(usize::MAX);
        let (normals, offsets) =
            (self.normals.get(at..).unwrap_or_default(), self.offsets.get(at..).unwrap_or_default());
        match (normals.first_chunk(), offsets.first_chunk()) {
            // Only models with larger leaves are read here, which have no walls between labels.
            (Some(normals), Some(offsets)) if !self.walls => {
                (room.normals, room.offsets) = (*normals, *offsets);
            }
            _ => _ = self.last_brick(normals, offsets, room),
        }
    }

    /// [`CellItems::brick`] at the end of the sections.
    #[cold]
    fn last_brick<'r>(
        &self,
        normals: &[[u8; 2]],
        offsets: &[u8],
        room: &'r mut BrickCodes,
    ) -> (&'r [[u8; 2]; BRICK_CELLS], &'r [u8; BRICK_CELLS]) {
        *room = BrickCodes::NONE;
        copy_start(&mut room.normals, normals);
        copy_start(&mut room.offsets, offsets);
        if self.walls {
            room.offsets = room.offsets.map(all_inside);
        }
        (&room.normals, &room.offsets)
    }

    /// The corners of a cell that has them; between labels, 1 at each corner with a label.
    #[inline]
    pub fn corners(&self, cell: u64) -> [i8; CORNERS] {
        if self.walls {
            return self.wall_item(cell).labels.map(|label| if label > 0 { 1 } else { -1 });
        }
        if self.alone {
            return self.wall_item(cell).values(self.code(cell));
        }
        self.corner_item(cell).map_or([1; CORNERS], |corners| corners.map(u8::cast_signed))
    }

    /// The plane between two labels, or a label and background, of a cell that it separates.
    #[inline]
    pub(crate) fn wall(&self, cell: u64) -> Option<Plane> {
        let offset = self.stored_offset(cell);
        (offset != HAS_CORNERS).then(|| Plane::new(self.code(cell), wall_offset(offset)))
    }

    /// The walls of a cell that one plane does not separate.
    pub(super) fn wall_item(&self, cell: u64) -> WallItem {
        let nothing = WallItem { labels: [u16::MAX; CORNERS], planes: None };
        self.corner_item::<WALL_BYTES>(cell).map_or(nothing, WallItem::parse)
    }

    /// The code of a cell's normal.
    #[inline(always)]
    pub(super) fn code(&self, cell: u64) -> u16 {
        let at = usize::try_from(cell).unwrap_or(usize::MAX);
        self.normals.get(at).map_or(0, |code| u16::from_le_bytes(*code))
    }

    #[inline]
    fn corner_item<const BYTES: usize>(&self, cell: u64) -> Option<&'a [u8; BYTES]> {
        let at = usize::try_from(cell).unwrap_or(usize::MAX);
        let number = usize::try_from(corner_number(self.offsets, self.directory, at)).ok()?;
        self.corners.as_chunks().0.get(number)
    }
}
