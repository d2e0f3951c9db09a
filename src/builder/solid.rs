//! The builder's input: a solid determines the inside voxels, and describes those at its surface.
//!
//! ```text
//! driver                                    worker of a solid (one per thread)
//!   start(column)                      -->  a tile of the volume's columns, some rows high, walked along z
//!   cover(box of voxels)               -->  all outside | all inside | mixed     (once per slab of 32 slices)
//!   occupancy(rows of a slice)         -->  bits, only where the box is mixed    (slice by slice)
//!   describe(skin voxels of a slice)   -->  items(channel), only at skin voxels  (two slices behind)
//! ```
//!
//! Skin, records, swapping, merging and the file follow from that alone. Bits are never requested for a box that is all
//! in or all out, so a solid that knows its boxes is built at the cost of its surface.

use std::ops::Range;
use std::path::Path;
use std::time::Duration;

use super::error::BuildError;
use super::item::ItemForm;
use super::report::BuildNote;
use super::skin::{BitRows, Exposed, corner_samples, exposed};
use crate::builder::BuildFault;
use crate::format::{Channel, Channels, Label, Metadata, SurfaceKind};
use crate::geom::Dims;
use crate::volume::SourceError;

/// Edge of a brick: skin voxels are described a row of bricks at a time.
pub(super) const BRICK: u32 = 32;
const BRICK_ROWS: usize = BRICK as usize;

/// Slices by which [`SolidWorker::occupancy`] is ahead of [`SolidWorker::describe`].
pub(crate) const LOOKAHEAD: u32 = 2;

/// A box of voxels, each range below the side of the solid's dims.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct VoxelBox {
    /// Columns.
    pub x: Range<u32>,
    /// Rows.
    pub y: Range<u32>,
    /// Slices, along z.
    pub z: Range<u32>,
}

impl VoxelBox {
    /// All voxels of a grid.
    pub(super) fn whole(dims: Dims) -> Self {
        Self { x: 0..dims.nx(), y: 0..dims.ny(), z: 0..dims.nz() }
    }
}

/// Sides of the voxels of a box.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cover {
    /// Every voxel is outside.
    Outside,
    /// Every voxel is inside.
    Inside,
    /// Voxels on both sides, or too costly to tell.
    Mixed,
}

/// Size of one worker's task, from which its buffers are reserved.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tile {
    /// Most columns (x) of a [`VoxelBox`] that is walked.
    pub columns: u32,
    /// The requested channels.
    pub channels: Channels,
}

/// Results of workers from describing the skin.
#[derive(Clone, Copy, Debug)]
pub struct ScanSummary {
    /// Smallest and largest single of a channel of [`ItemForm::Scaled`], or code of [`ItemForm::Octaves`]; infinity and
    /// its negative without any.
    pub extent: (f32, f32),
    /// Time spent waiting for input.
    pub reading: Duration,
    /// True if samples are NaN, which are outside.
    pub not_numbers: bool,
    /// True if infinite samples are inside.
    pub infinite: bool,
}

impl Default for ScanSummary {
    fn default() -> Self {
        Self {
            extent: (f32::INFINITY, f32::NEG_INFINITY),
            reading: Duration::ZERO,
            not_numbers: false,
            infinite: false,
        }
    }
}

impl ScanSummary {
    /// Joins the results of two workers.
    #[must_use]
    pub fn join(self, other: Self) -> Self {
        Self {
            extent: (self.extent.0.min(other.extent.0), self.extent.1.max(other.extent.1)),
            reading: self.reading + other.reading,
            not_numbers: self.not_numbers || other.not_numbers,
            infinite: self.infinite || other.infinite,
        }
    }
}

/// A set of voxels with attributes at its surface: a volume with a threshold, or any other source of both.
///
/// The answer for a voxel must not depend on the order or the size of the requested boxes: otherwise the bytes of the
/// model would.
pub trait Solid: Sync {
    /// Size of the grid of voxels; the space beyond it is outside. For cells, one more than the samples along each
    /// axis: occupancy is then also requested of samples that do not exist, which are outside.
    fn dims(&self) -> Dims;

    /// The solid that this one describes in another way: it says what is not said here.
    fn inner(&self) -> Option<&dyn Solid> {
        None
    }

    /// The kind of the model's boxes. Items of cells describe cells: box i of an axis lies
    /// between samples i - 1 and i.
    fn surface(&self) -> SurfaceKind {
        SurfaceKind::Skin
    }

    /// Slices before a column whose occupancy its worker needs as well; at least `LOOKAHEAD`.
    fn lookbehind(&self) -> u32 {
        LOOKAHEAD
    }

    /// The model's origin, once the skin has been described. The builder fills in the program and the connectivity, and
    /// clears fields of channels that are not stored.
    fn metadata(&self, found: &ScanSummary) -> Metadata;

    /// Storage form of the items of a channel, as [`SolidWorker::items`] gives them; `None` for a channel that the
    /// solid lacks. Before the scan it is called with an empty summary, for the number of bytes alone.
    fn form(&self, channel: Channel, found: &ScanSummary) -> Option<ItemForm>;

    /// Bytes that one worker holds.
    fn worker_bytes(&self, tile: &Tile) -> u64;

    /// Bytes that a thread holds for the inputs of the solid, while it works and possibly after.
    fn input_bytes(&self) -> u64 {
        self.inner().map_or(0, Solid::input_bytes)
    }

    /// A worker for columns at most as wide as the tile. Called on the thread that uses it.
    fn worker(&self, tile: &Tile) -> Box<dyn SolidWorker + '_>;

    /// Name of the solid in errors; it is not stored.
    fn name(&self) -> String {
        self.inner().map_or_else(|| self.metadata(&ScanSummary::default()).source.kind, Solid::name)
    }

    /// The labels found by the scan, for a solid that has them, by ascending number.
    ///
    /// # Errors
    /// There are too many labels.
    fn labels(&self) -> Result<Vec<Label>, BuildError> {
        Ok(Vec::new())
    }

    /// Every file that the solid is made of.
    fn for_each_file(&self, each: &mut dyn FnMut(&Path)) {
        if let Some(inner) = self.inner() {
            inner.for_each_file(each);
        }
    }

    /// Checks that the inputs of the solid are unchanged. Called before the model is given its name.
    ///
    /// # Errors
    /// The input that was changed meanwhile.
    fn check_unchanged(&self) -> Result<(), SourceError> {
        self.inner().map_or(Ok(()), Solid::check_unchanged)
    }

    /// Oddity of the choice of the inside, for the user.
    fn note(&self) -> Option<BuildNote> {
        self.inner()?.note()
    }

    /// The error for a solid without inside voxels, for the user.
    fn nothing_inside(&self) -> BuildError {
        let own = || BuildError::from(BuildFault::nothing_inside(self.name()));
        self.inner().map_or_else(own, Solid::nothing_inside)
    }
}

/// Crossing of an edge between two samples with a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EdgeCrossing {
    /// The sample at the edge's low end; -1 before the first one.
    pub low: [i32; 3],
    /// Axis of the edge: 0 for x, 1 for y, 2 for z.
    pub axis: usize,
    /// Fraction of the way from `low` to the next sample, 0 to 1.
    pub along: f64,
    /// Normal of the surface, against the gradient along the index axes; of either sign and any length.
    pub normal: [f64; 3],
}

/// One thread's view of a [`Solid`]: owns its buffers and walks one column of voxels after the other.
pub trait SolidWorker {
    /// Begins a column. Until the next call, [`SolidWorker::occupancy`] is called for rising slices, from
    /// [`Solid::lookbehind`] before the column to `LOOKAHEAD` after it, as far as they exist.
    ///
    /// # Errors
    /// The solid cannot be read.
    fn start(&mut self, column: &VoxelBox) -> Result<(), SourceError>;

    /// Sides of the voxels of a box. [`Cover::Mixed`] is always correct, other answers save work.
    fn cover(&mut self, region: &VoxelBox) -> Cover {
        let _ = region;
        Cover::Mixed
    }

    /// Sets the bits of the requested rows.
    ///
    /// # Errors
    /// The solid cannot be read.
    fn occupancy(&mut self, rows: &mut OccupancyRows<'_>) -> Result<(), SourceError>;

    /// Sets the bits of the kept voxels in the requested rows, every bit of them, for a solid with walls within.
    /// Otherwise returns `false`, and the skin follows from the occupancy. As with [`SolidWorker::describe`], the
    /// occupancy of the next `LOOKAHEAD` slices has been requested.
    fn skin(&mut self, rows: &mut OccupancyRows<'_>) -> bool {
        let _ = rows;
        false
    }

    /// Computes the items of skin voxels, for all channels of the tile; the occupancy of the next `LOOKAHEAD` slices
    /// has been requested (except for boxes whose cover was given).
    ///
    /// # Errors
    /// The solid cannot be read.
    fn describe(&mut self, skin: &SkinSlice<'_>) -> Result<(), SourceError>;

    /// The items of a channel computed by [`SolidWorker::describe`], in the order of [`SkinSlice::voxels`]; for a
    /// sparse channel only those of the voxels that have one.
    fn items(&self, channel: Channel) -> &[u8];

    /// Calls `found` with crossings between the surface and edges of neighbouring samples in the slice's cells: at
    /// least one for every edge whose ends differ in this solid, where it is known. Called instead of
    /// [`SolidWorker::describe`] for a part of a solid of cells.
    ///
    /// # Errors
    /// The solid cannot be read.
    fn crossings(
        &mut self,
        skin: &SkinSlice<'_>,
        found: &mut dyn FnMut(&EdgeCrossing),
    ) -> Result<(), SourceError> {
        let _ = (skin, found);
        Ok(())
    }

    /// Results since the worker was created.
    fn found(&self) -> ScanSummary {
        ScanSummary::default()
    }
}

/// Requested rows of one slice's occupancy, one bit a voxel.
pub struct OccupancyRows<'a> {
    /// Requested columns.
    pub(super) x: Range<u32>,
    /// Requested rows.
    pub(super) y: Range<u32>,
    pub(super) z: u32,
    /// x of bit 0 of a row's first word.
    pub(super) origin: i64,
    /// Words of a row, and words from one row to the next.
    pub(super) width: usize,
    pub(super) pitch: usize,
    pub(super) words: &'a mut [u64],
}

impl<'a> OccupancyRows<'a> {
    /// Contiguous rows of a slice, each `width` words long with its first bit at `origin`: a request to a solid that is
    /// a part of another one.
    pub(crate) fn of_slice(
        [x, y]: [Range<u32>; 2],
        z: u32,
        origin: i64,
        width: usize,
        words: &'a mut [u64],
    ) -> Self {
        Self { x, y, z, origin, width, pitch: width, words }
    }
}

impl OccupancyRows<'_> {
    /// The requested columns.
    #[inline]
    pub fn x(&self) -> Range<u32> {
        self.x.clone()
    }

    /// The requested rows.
    #[inline]
    pub fn y(&self) -> Range<u32> {
        self.y.clone()
    }

    /// The slice.
    #[inline]
    pub fn z(&self) -> u32 {
        self.z
    }

    /// x of bit 0 of a row's first word; less than the start of [`OccupancyRows::x`], and negative at the border.
    #[inline]
    pub fn origin(&self) -> i64 {
        self.origin
    }

    /// The words of a requested row `y`: bit i of word k is the voxel at `origin + 64 k + i`. Every bit of a requested
    /// column has to be written; the others are ignored.
    ///
    /// # Panics
    /// If the row was not requested.
    #[inline]
    pub fn row_mut(&mut self, y: u32) -> &mut [u64] {
        assert!(self.y.contains(&y), "a row that was not asked for");
        &mut self.words[(y - self.y.start) as usize * self.pitch..][..self.width]
    }

    /// Clears the bits beyond a grid that is smaller than the grid of the requested boxes.
    pub(crate) fn clear_beyond(&mut self, dims: Dims) {
        let (nx, slice_exists) = (i64::from(dims.nx()), self.z < dims.nz());
        for y in self.y.clone() {
            let exists = slice_exists && y < dims.ny();
            let left = nx - self.origin;
            for (word, base) in self.row_mut(y).iter_mut().zip((0..).step_by(64)) {
                *word &= match left - base {
                    bits if bits <= 0 || !exists => 0,
                    bits if bits >= 64 => u64::MAX,
                    bits => (1 << bits) - 1,
                };
            }
        }
    }

    /// Writes row `y`: the columns of `inside` are inside, those before and after are not.
    ///
    /// # Panics
    /// Like [`OccupancyRows::row_mut`].
    pub fn set_row(&mut self, y: u32, inside: Range<u32>) {
        let (start, end) = (inside.start.max(self.x.start), inside.end.min(self.x.end));
        let bit = |x: u32| u64::try_from(i64::from(x) - self.origin).unwrap_or(0);
        let (first, last) = (bit(start), bit(end.max(start)));
        for (word, base) in self.row_mut(y).iter_mut().zip((0..).step_by(64)) {
            // Bits of this word below a position.
            let below = |at: u64| match at.saturating_sub(base) {
                0 => 0,
                n => u64::MAX >> 64_u64.saturating_sub(n),
            };
            *word = below(last) & !below(first);
        }
    }
}

/// Skin voxels of one brick in one slice: at most 32 x 32, row by row.
pub struct SkinSlice<'a> {
    pub(super) corner: [u32; 3],
    pub(super) rows: &'a [u32; BRICK_ROWS],
    pub(super) count: usize,
    /// Occupancy around the slice, and index of the brick in the tile.
    pub(super) bits: BitRows<'a>,
    pub(super) brick: usize,
}

impl SkinSlice<'_> {
    /// Most voxels of a slice of a brick.
    pub const MAX_VOXELS: usize = BRICK_ROWS * BRICK_ROWS;

    /// Voxel of bit 0 of the first row.
    #[inline]
    pub fn corner(&self) -> [u32; 3] {
        self.corner
    }

    /// Skin voxels of every row: bit i of row j is the voxel at `corner + (i, j, 0)`.
    #[inline]
    pub fn rows(&self) -> &[u32; BRICK_ROWS] {
        self.rows
    }

    /// Number of voxels; never 0.
    #[inline]
    #[expect(clippy::len_without_is_empty, reason = "it is never empty")]
    pub fn len(&self) -> usize {
        self.count
    }

    /// A subset of the voxels, not empty: bit i of row j is the voxel at `corner + (i, j, 0)`.
    pub(crate) fn only<'b>(&'b self, rows: &'b [u32; BRICK_ROWS]) -> SkinSlice<'b> {
        let count = rows.iter().map(|row| row.count_ones() as usize).sum();
        SkinSlice { corner: self.corner, rows, count, bits: self.bits, brick: self.brick }
    }

    /// The voxels: x fastest, then y.
    pub fn voxels(&self) -> impl Iterator<Item = [u32; 3]> + '_ {
        let [x, y, z] = self.corner;
        (y..).zip(self.rows).flat_map(move |(y, row)| {
            let mut left = *row;
            std::iter::from_fn(move || {
                let at = left.trailing_zeros();
                left &= left.wrapping_sub(1);
                (at < BRICK).then_some([x + at, y, z])
            })
        })
    }

    /// Samples at the corners of row `j`'s cells: for each of their edges along x (y and z low, y high, z high,
    /// both high), bit i is the sample before cell i of the row, bit i + 1 the one after; 1 is inside.
    #[inline]
    pub fn corner_samples(&self, j: usize) -> [u64; 4] {
        if self.rows[j] == 0 { [0; 4] } else { corner_samples(&self.bits.around(j), self.brick) }
    }

    /// Mask of each cell's inside corners, in the order of [`SkinSlice::voxels`].
    pub(super) fn sides(&self) -> impl Iterator<Item = u8> + '_ {
        self.rows.iter().enumerate().flat_map(move |(j, row)| {
            let corners = self.corner_samples(j);
            let mut left = *row;
            std::iter::from_fn(move || {
                let x = left.trailing_zeros();
                left &= left.wrapping_sub(1);
                let pair = |edge: usize| (corners[edge] >> x & 3) as u8;
                (x < BRICK).then(|| pair(0) | pair(1) << 2 | pair(2) << 4 | pair(3) << 6)
            })
        })
    }

    /// Exposed faces of row `j`'s voxels.
    #[inline]
    pub fn exposed(&self, j: usize) -> Exposed {
        if self.rows[j] == 0 { Exposed::default() } else { exposed(&self.bits.around(j), self.brick) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_is_written_within_what_was_asked_for() {
        let mut words = [u64::MAX; 6];
        let mut rows =
            OccupancyRows { x: 63..200, y: 5..7, z: 0, origin: 0, width: 3, pitch: 3, words: &mut words };
        rows.set_row(5, 0..500);
        rows.set_row(6, 70..70);
        assert_eq!(words, [1 << 63, u64::MAX, u64::MAX, 0, 0, 0]);
        let mut rows = OccupancyRows {
            x: 0..200,
            y: 0..1,
            z: 0,
            origin: -64,
            width: 5,
            pitch: 5,
            words: &mut words[..5],
        };
        rows.set_row(0, 3..130);
        assert_eq!(words[..5], [0, u64::MAX << 3, u64::MAX, 0b11, 0]);
    }
}
