//! The samples of a model, slice by slice, as runs of one label each, with the cells between two slices.
//!
//! Columns and rows count from one sample before the surface. A cell at column `x` and row `y` lies between the samples
//! `x - 1` and `x`, the rows `y - 1` and `y`, and the slice before and this one.

use std::io;

use super::bits::Bits;
use super::sample_signs::Item;
use super::{Bounds, ExportStop, Exporter, SampleSlice};
use crate::format::cell::{HAS_CORNERS, Plane};
use crate::interior::{Rows, SkinVoxel, extent};
use crate::load::{CellShape, ModelView, NodeView};
use crate::progress::Progress;

/// Neighbouring samples of a row with one label, 0 outside: from `start` up to `end`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Run {
    pub(crate) start: u32,
    pub(crate) end: u32,
    pub(crate) label: u16,
}

/// A cell between two slices of samples.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LayerCell {
    pub(crate) x: u32,
    pub(crate) row: usize,
    /// Number of the cell; of a cell of a larger leaf, a number that no cell has.
    pub(crate) number: u64,
    /// The surface within it; `None` for a cell with walls between labels.
    pub(crate) shape: Option<CellShape>,
}

/// A slice of samples, and the cells between it and the slice before.
#[derive(Debug, Default)]
pub(crate) struct RegionSlice {
    pub(crate) runs: Rows<Run>,
    pub(crate) cells: Vec<LayerCell>,
}

/// Position of the slices.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RegionFrame {
    /// The voxel of the volume at the first sample of the first slice.
    pub(crate) origin: [i64; 3],
    pub(crate) width: u32,
    pub(crate) height: usize,
    pub(crate) slices: u32,
}

impl RegionFrame {
    fn of([low, end]: Bounds) -> Self {
        let [width, height, slices] = [0, 1, 2].map(|a| end[a] - low[a] + 1);
        Self { origin: low.map(|low| i64::from(low) - 1), width, height: height as usize, slices }
    }
}

impl RegionSlice {
    fn clear(&mut self) {
        self.runs.clear();
        self.cells.clear();
    }

    /// Adds a run, if it has a sample.
    fn run(&mut self, start: u32, end: u32, label: u16) {
        if start < end {
            self.runs.push(Run { start, end, label });
        }
    }

    /// Fills the slice from samples inside or outside.
    fn of_bits(&mut self, view: &ModelView<'_>, samples: &Bits, items: &Rows<Item>, frame: RegionFrame) {
        self.clear();
        for row in 0..frame.height {
            let mut at = 0;
            for [start, end] in samples.stretches(row) {
                self.run(at, start, 0);
                self.run(start, end, 1);
                at = end;
            }
            self.run(at, frame.width, 0);
            self.runs.end_row();
            self.cells.extend(items.row(row).iter().map(|item| {
                let corners = view.cells().filter(|_| item.offset == HAS_CORNERS);
                let shape = match corners {
                    Some(cells) => CellShape::Corners(cells.corners(item.number)),
                    None => CellShape::Plane(Plane::new(item.code, item.offset)),
                };
                LayerCell { x: item.x, row, number: item.number, shape: Some(shape) }
            }));
        }
    }

    /// Fills the slice with the labels of samples, from the cells that end at them: between two cells of a row the
    /// label stays.
    fn of_cells(&mut self, view: &ModelView<'_>, cells: &[SkinVoxel], frame: RegionFrame) {
        self.clear();
        let place = |at: u32, axis: usize| u32::try_from(i64::from(at) - frame.origin[axis]).unwrap_or(0);
        let mut rest = cells.iter().peekable();
        for row in 0..frame.height {
            let (mut from, mut label) = (0, 0);
            while let Some(cell) = rest.next_if(|cell| place(cell.y, 1) as usize <= row) {
                let Some(walls) = view.walls(cell.voxel.get()) else { continue };
                let x = place(cell.x, 0);
                let next = walls.corner(super::labels::HIGH);
                if next != label {
                    self.run(from, x, label);
                    (from, label) = (x, next);
                }
                self.cells.push(LayerCell { x, row, number: cell.voxel.get(), shape: None });
            }
            self.run(from, frame.width, label);
            self.runs.end_row();
        }
    }
}

impl Exporter<'_> {
    /// Calls `work` with each slice of samples, from the one before the surface to the one after it. `begin` makes the
    /// state that `work` fills; it is called again if all slices have to be swept once more. `labelled` is set for a
    /// model of labels. Returns the state, and the number of enclosed boxes that may be inside or outside.
    ///
    /// # Errors
    /// The model is damaged, the caller stops it, and errors of `begin` and `work`.
    pub(crate) fn regions<T>(
        &self,
        labelled: bool,
        progress: &dyn Progress,
        begin: &dyn Fn(RegionFrame) -> io::Result<T>,
        work: &dyn Fn(&mut T, &RegionSlice) -> io::Result<()>,
    ) -> Result<(T, u64), ExportStop> {
        let bounds = extent(self.view).ok_or(ExportStop::Damaged)?;
        let frame = RegionFrame::of(bounds);
        let mut slice = RegionSlice::default();
        if labelled {
            let mut state = begin(frame)?;
            slice.of_cells(self.view, &[], frame);
            work(&mut state, &slice)?;
            self.label_slices(bounds, progress, &mut |cells| {
                slice.of_cells(self.view, cells, frame);
                work(&mut state, &slice)
            })?;
            return Ok((state, 0));
        }
        self.knowing_inside(bounds, progress, &mut |fates| {
            let mut state = begin(frame)?;
            let swept =
                self.sweep(bounds, fates, progress, &mut |SampleSlice { samples, items, .. }| {
                    slice.of_bits(self.view, samples[1], items[0], frame);
                    work(&mut state, &slice)
                })?;
            Ok(swept.map(|unknown| (state, unknown)))
        })
    }
}
