//! Items of the cells that were described last.

use super::single_fit::CellShape;
use crate::builder::gradient::SLICE_VOXELS;
use crate::format::Channel;
use crate::format::cell::{CORNERS, HAS_CORNERS};

pub(super) struct CellItems {
    codes: Vec<u8>,
    offsets: Vec<u8>,
    corners: Vec<u8>,
    /// Codes of steepness (`Batch::steepness`); empty unless the channel is built.
    steepness: Vec<u8>,
}

impl CellItems {
    pub(super) const BYTES: usize = SLICE_VOXELS * (3 + CORNERS + size_of::<u16>());

    pub(super) fn new() -> Self {
        Self {
            codes: Vec::with_capacity(2 * SLICE_VOXELS),
            offsets: Vec::with_capacity(SLICE_VOXELS),
            corners: Vec::with_capacity(CORNERS * SLICE_VOXELS),
            steepness: Vec::new(),
        }
    }

    pub(super) fn clear(&mut self) {
        self.codes.clear();
        self.offsets.clear();
        self.corners.clear();
        self.steepness.clear();
    }

    #[inline]
    pub(super) fn push_plane(&mut self, code: u16, offset: i8) {
        self.codes.extend(code.to_le_bytes());
        self.offsets.push(offset.cast_unsigned());
    }

    pub(super) fn extend_steepness(&mut self, codes: &[u16]) {
        self.steepness.extend(codes.iter().flat_map(|code| code.to_le_bytes()));
    }

    pub(super) fn push(&mut self, cell: CellShape) {
        match cell {
            CellShape::Plane(code, offset) => self.push_plane(code, offset),
            CellShape::Corners(code, corners) => {
                self.corners.extend(corners.map(i8::cast_unsigned));
                self.push_plane(code, HAS_CORNERS);
            }
        }
    }

    pub(super) fn of(&self, channel: Channel) -> &[u8] {
        match channel {
            Channel::Normal => &self.codes,
            Channel::Offset => &self.offsets,
            Channel::Corners => &self.corners,
            Channel::Steepness => &self.steepness,
            _ => &[],
        }
    }
}
