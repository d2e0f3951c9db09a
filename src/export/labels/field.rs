//! The labels of all samples, slice by slice: those of the skin, and of what it encloses.
//!
//! Memory: the last eight slices of the model's box, two bytes a sample.

use crate::enclosed::{Side, SkinVoxel, Sweep};
use crate::export::ExportFault;
use crate::load::ModelView;

use crate::wall::{WINDOW, Window};

/// Columns and rows without labels around the box, and slices before and behind it: half of a window.
pub(super) const MARGIN: usize = WINDOW / 2;

/// The corner of a cell that is high along all axes.
const HIGH: usize = 7;

/// Most samples of a slice, of which eight are held.
const MAX_SAMPLES: u64 = 1 << 27;

/// The last slices; samples are parts of a table of labels, from 1 on, and 0 for none.
pub(super) struct Field {
    width: usize,
    height: usize,
    ring: [Vec<u16>; WINDOW],
    /// Which slices have labels.
    filled: [bool; WINDOW],
    /// Slices so far.
    taken: usize,
}

impl Field {
    /// A box of so many samples, behind [`MARGIN`] slices without labels.
    ///
    /// # Errors
    /// [`ExportFault::BroadLabels`]
    pub(super) fn new([width, height]: [usize; 2]) -> Result<Self, ExportFault> {
        let [width, height] = [width, height].map(|side| side + 2 * MARGIN);
        let samples = width as u64 * height as u64;
        if samples > MAX_SAMPLES {
            return Err(ExportFault::BroadLabels { samples });
        }
        Ok(Self {
            width,
            height,
            ring: std::array::from_fn(|_| vec![0; width * height]),
            filled: [false; WINDOW],
            taken: 0,
        })
    }

    pub(super) fn height(&self) -> usize {
        self.height
    }

    pub(super) fn width(&self) -> usize {
        self.width
    }

    /// Slices so far.
    pub(super) fn taken(&self) -> usize {
        self.taken
    }

    /// Takes the next slice: the one that the sweep took last, or one without labels. `part_of` gives the parts of
    /// labels by number.
    pub(super) fn take(&mut self, sweep: Option<&Sweep>, part_of: &[u16]) {
        let at = self.taken % WINDOW;
        self.taken += 1;
        let slice = &mut self.ring[at];
        if std::mem::take(&mut self.filled[at]) {
            slice.fill(0);
        }
        let Some(sweep) = sweep else { return };
        let found = sweep.last();
        // A sweep begins one sample before the box.
        for (row, samples) in slice.chunks_exact_mut(self.width).skip(MARGIN - 1).enumerate() {
            let part = |number: u16| part_of.get(usize::from(number)).copied().unwrap_or(0);
            let mut runs = found.runs.row(row).iter().peekable();
            for item in found.skin.row(row) {
                self.filled[at] = true;
                let x = item.x as usize + MARGIN - 1;
                let label = part(item.label);
                if let Some(sample) = samples.get_mut(x) {
                    *sample = label;
                }
                // What lies inside behind a voxel has its label.
                while runs.next_if(|run| run.end <= item.x).is_some() {}
                if let Some(run) = runs.next_if(|run| run.start == item.x + 1)
                    && sweep.side(*run) == Side::Inside
                    && let Some(inside) = samples.get_mut(x + 1..run.end as usize + MARGIN - 1)
                {
                    inside.fill(label);
                }
            }
        }
    }

    /// Takes the next slice of a model of cells between labels: those of one slice, ordered by rows, of which the first box
    /// has these coordinates. Samples have the numbers of the cells that end at them.
    pub(super) fn take_cells(
        &mut self,
        view: &ModelView<'_>,
        cells: &[SkinVoxel],
        low: [u32; 3],
        part_of: &[u16],
    ) {
        self.take(None, part_of);
        let at = (self.taken - 1) % WINDOW;
        let part = |number: u16| part_of.get(usize::from(number)).copied().unwrap_or(0);
        let rows = cells.chunk_by(|a, b| a.y == b.y);
        for row in rows {
            let Some(y) = row.first().and_then(|cell| cell.y.checked_sub(low[1])) else { continue };
            let first = (y as usize + MARGIN) * self.width + MARGIN;
            let Some(samples) = self.ring[at].get_mut(first..first + self.width - 2 * MARGIN) else {
                continue;
            };
            let mut before = (0, 0);
            for cell in row {
                let Some(walls) = view.walls(cell.voxel.get()) else { continue };
                let Some(x) = cell.x.checked_sub(low[0]).map(|x| x as usize) else { continue };
                // Samples between two cells of a row are alike: the label changes in cells alone.
                let (from, label) = before;
                if let Some(between) = samples.get_mut(from..x).filter(|_| label > 0) {
                    between.fill(label);
                    self.filled[at] = true;
                }
                before = (x, part(walls.corner(HIGH)));
            }
            if let (Some(sample), label) = (samples.get_mut(before.0), before.1)
                && label > 0
            {
                *sample = label;
                self.filled[at] = true;
            }
        }
    }

    /// A row of the box in the slice that was taken last.
    pub(super) fn last_row(&self, y: usize) -> Option<&[u16]> {
        let first = (y + MARGIN) * self.width + MARGIN;
        let slice = &self.ring[self.taken.checked_sub(1)? % WINDOW];
        slice.get(first..first + self.width - 2 * MARGIN).filter(|_| y + 2 * MARGIN < self.height)
    }

    /// Has none of the two middle slices a label? Then no wall passes between them.
    pub(super) fn is_void(&self) -> bool {
        [3, 4].iter().all(|z| !self.filled[(self.taken + z) % WINDOW])
    }

    /// A row of a slice of the window, from the oldest one on.
    #[inline(always)]
    fn row(&self, z: usize, y: usize) -> &[u16] {
        let slice = &self.ring[(self.taken + z) % WINDOW];
        slice.get(y * self.width..(y + 1) * self.width).unwrap_or_default()
    }

    /// The four rows of samples around a row of cells, whose upper ones are row `y`; bit 0 and 1 of their number say
    /// which lies higher along y and z.
    #[inline(always)]
    pub(super) fn around(&self, y: usize) -> [&[u16]; 4] {
        [(3, y - 1), (3, y), (4, y - 1), (4, y)].map(|(z, y)| self.row(z, y))
    }

    /// The samples around a cell.
    #[inline(always)]
    pub(super) fn window(&self, [x, y]: [usize; 2]) -> Window<'_> {
        let slices = std::array::from_fn(|z| &self.ring[(self.taken + z) % WINDOW][..]);
        Window { slices, first: (y - MARGIN) * self.width + x - MARGIN, stride: self.width }
    }
}
