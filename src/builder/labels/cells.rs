//! Cells between labels: boxes between eight samples that do not all have one label.
//!
//! ```text
//!   slice z+3   --read-->  ring of 8 slices
//!   cells of z  labels of the eight samples differ --> walls by 8^3 samples (fit), labels behind and in front
//! ```

use super::LabelSolid;
use super::fit::{CellFit, Fitted, fit_cell};
use super::ring::{self, CHUNK, Ring, bits_of};
use super::wall::{WINDOW, Window};
use crate::builder::gradient::SLICE_VOXELS;
use crate::builder::slices::Reach;
use crate::builder::solid::{LOOKAHEAD, OccupancyRows, ScanSummary, SkinSlice, SolidWorker, Tile, VoxelBox};
use crate::cpu::{Kernel, Lanes, dispatch};
use crate::format::cell::HAS_CORNERS;
use crate::format::{Channel, WALL_BYTES};
use crate::volume::{SourceError, VolumeInfo};

/// Name recorded in the metadata.
pub(super) const ESTIMATOR: &str = "label planes";

/// A cell's samples: cell i lies between samples i - 1 and i, and reads three more on either side.
pub(super) const AROUND: Reach = Reach { low: WINDOW as u32 / 2, high: WINDOW as u32 / 2 - 1 };
const _: () = assert!(AROUND.high == LOOKAHEAD + 1);

/// Bytes of a cell's items.
const ITEM_BYTES: usize = 2 + 1 + 4 + WALL_BYTES;

/// Bytes that one worker holds.
pub(in crate::builder) fn worker_bytes(info: &VolumeInfo, tile: &Tile) -> u64 {
    ring::bytes(info, tile) + (SLICE_VOXELS * ITEM_BYTES + (16 << 10)) as u64
}

/// One thread's ring, and the cells described last.
pub(super) struct CellWorker<'a> {
    ring: Ring<'a>,
    /// The slice that is read next.
    next: u32,
    fit: CellFit,
    items: Items,
}

/// Items of cells, channel by channel.
#[derive(Default)]
struct Items {
    codes: Vec<u8>,
    offsets: Vec<u8>,
    corners: Vec<u8>,
    pairs: Vec<u8>,
}

impl Items {
    fn push(&mut self, cell: &Fitted) {
        let (code, offset, pair) = match cell {
            Fitted::Plane(code, offset, pair) => (*code, *offset, *pair),
            Fitted::Item(code, item) => {
                self.corners.extend(item.to_bytes());
                (*code, HAS_CORNERS, item.pair())
            }
        };
        self.codes.extend(code.to_le_bytes());
        self.offsets.push(offset.cast_unsigned());
        self.pairs.extend(pair.into_iter().flat_map(u16::to_le_bytes));
    }
}

impl<'a> CellWorker<'a> {
    pub(super) fn new(solid: &'a LabelSolid<'a>, tile: &Tile) -> Self {
        let items = Items {
            codes: Vec::with_capacity(2 * SLICE_VOXELS),
            offsets: Vec::with_capacity(SLICE_VOXELS),
            corners: Vec::with_capacity(WALL_BYTES * SLICE_VOXELS),
            pairs: Vec::with_capacity(4 * SLICE_VOXELS),
        };
        let fit = CellFit::new(solid.smooth);
        Self { ring: Ring::new(solid, tile), next: 0, fit, items }
    }
}

/// Test for differing labels among the eight samples of a row's cells: four rows of samples, each from the one before
/// the first cell on.
struct CellKernel<'a> {
    rows: [&'a [u16]; 4],
    out: &'a mut [u64],
}

impl Kernel for CellKernel<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self, isa: impl Lanes) {
        let low = self.rows.map(|row| row.as_chunks::<CHUNK>().0);
        let high = self.rows.map(|row| row.get(1..).unwrap_or_default().as_chunks::<CHUNK>().0);
        for (i, out) in self.out.iter_mut().enumerate() {
            *out = 0;
            for half in 0..2 {
                let at = 2 * i + half;
                let Some(own) = high[0].get(at) else { continue };
                let mut differ = [0_u16; CHUNK];
                for samples in low.iter().chain(&high) {
                    let Some(samples) = samples.get(at) else { continue };
                    for (differ, (a, b)) in differ.iter_mut().zip(own.iter().zip(samples)) {
                        *differ |= a ^ b;
                    }
                }
                *out |= u64::from(bits_of(isa, &differ)) << (32 * half);
            }
        }
    }
}

/// The cells of one brick in one slice.
struct FitKernel<'a, 's> {
    slices: [&'a [u16]; WINDOW],
    /// Index of the first cell's upper sample, and distance between rows.
    at: usize,
    stride: usize,
    skin: &'a SkinSlice<'s>,
    fit: &'a CellFit,
    items: &'a mut Items,
}

impl Kernel for FitKernel<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run(self, isa: impl Lanes) {
        let Self { slices, at, stride, skin, fit, items } = self;
        let half = WINDOW / 2;
        for (row, bits) in skin.rows().iter().enumerate() {
            let mut left = *bits;
            while left != 0 {
                let x = left.trailing_zeros() as usize;
                left &= left - 1;
                let upper = at + row * stride + x;
                let mut corners = [0; 8];
                for (corner, label) in corners.iter_mut().enumerate() {
                    let back = (1 - (corner & 1)) + (1 - (corner >> 1 & 1)) * stride;
                    *label = slices[half - 1 + (corner >> 2)].get(upper - back).copied().unwrap_or(0);
                }
                let window = Window { slices, first: upper - half * stride - half, stride };
                items.push(&fit_cell(isa, fit, &window, &corners));
            }
        }
    }
}

impl SolidWorker for CellWorker<'_> {
    fn start(&mut self, column: &VoxelBox) -> Result<(), SourceError> {
        self.ring.column = column.clone();
        self.next = column.z.start.saturating_sub(AROUND.low);
        Ok(())
    }

    fn occupancy(&mut self, wanted: &mut OccupancyRows<'_>) -> Result<(), SourceError> {
        // One slice more than the builder's look-ahead.
        let end = (wanted.z() + 2).min(self.ring.solid.source.info().dims.nz());
        while self.next < end {
            self.ring.load(self.next)?;
            self.next += 1;
        }
        self.ring.occupancy(wanted);
        Ok(())
    }

    fn skin(&mut self, wanted: &mut OccupancyRows<'_>) -> bool {
        let (ring, stride) = (&self.ring, self.ring.stride);
        let [below, here] = ring.slices(i64::from(wanted.z()) - 1);
        for y in wanted.y() {
            let row = ring.at(ring.column.x.start, y) - 1;
            let part = |from: usize| from..from + stride - AROUND.low as usize;
            let north = row - stride;
            let rows = [&here[part(row)], &here[part(north)], &below[part(row)], &below[part(north)]];
            dispatch(CellKernel { rows, out: wanted.row_mut(y) });
        }
        true
    }

    fn describe(&mut self, skin: &SkinSlice<'_>) -> Result<(), SourceError> {
        let Items { codes, offsets, corners, pairs } = &mut self.items;
        [codes, offsets, corners, pairs].into_iter().for_each(Vec::clear);
        let (ring, [x, y, z]) = (&self.ring, skin.corner());
        let slices = ring.slices(i64::from(z) - i64::from(AROUND.low));
        let (at, stride) = (ring.at(x, y), ring.stride);
        dispatch(FitKernel { slices, at, stride, skin, fit: &self.fit, items: &mut self.items });
        Ok(())
    }

    fn items(&self, channel: Channel) -> &[u8] {
        match channel {
            Channel::Normal => &self.items.codes,
            Channel::Offset => &self.items.offsets,
            Channel::Corners => &self.items.corners,
            Channel::Label => &self.items.pairs,
            _ => &[],
        }
    }

    fn found(&self) -> ScanSummary {
        self.ring.found()
    }
}
