//! The builder's input: a solid says which voxels are inside, and describes those at its surface.
//!
//! ```text
//! driver                                    worker of a solid (one per thread)
//!   start(column)                      -->  a tile of the volume's columns, some rows high, walked along z
//!   cover(box of voxels)               -->  all outside | all inside | mixed     (once per slab of 32 slices)
//!   occupancy(rows of a slice)         -->  bits, only where the box is mixed    (slice by slice)
//!   describe(skin voxels of a slice)   -->  items(channel), only at skin voxels  (two slices behind)
//! ```
//!
//! Skin, records, swapping, merging and the file follow from that alone. A box that is all in or all out
//! is never asked for bits, so a solid that knows its boxes is built at the cost of its surface.

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
    /// Slices.
    pub z: Range<u32>,
}

impl VoxelBox {
    /// All voxels of a grid.
    pub(super) fn whole(dims: Dims) -> Self {
        Self { x: 0..dims.nx(), y: 0..dims.ny(), z: 0..dims.nz() }
    }
}

/// Where the voxels of a box lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cover {
    /// Every voxel is outside.
    Outside,
    /// Every voxel is inside.
    Inside,
    /// Some are inside and some are not, or the solid cannot tell at this price.
    Mixed,
}

/// The work of one worker: its buffers are reserved from this.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tile {
    /// Most columns (x) of a [`VoxelBox`] that is walked.
    pub columns: u32,
    /// The channels that will be asked for.
    pub channels: Channels,
}

/// Results of workers while they described the skin.
#[derive(Clone, Copy, Debug)]
pub struct ScanSummary {
    /// Smallest and largest single of a channel of [`ItemForm::Scaled`]; infinity and its negative if none.
    pub extent: (f32, f32),
    /// Time spent waiting for input.
    pub reading: Duration,
    /// Were there samples that are NaN? They are outside.
    pub not_numbers: bool,
    /// Were there infinite samples that are inside?
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
    /// The results of two workers.
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

/// A set of voxels with attributes at its surface: a volume with a threshold, or anything that can say as much.
///
/// Its answer for a voxel must not depend on the order or the size of the boxes asked for: the bytes of the
/// model would.
pub trait Solid: Sync {
    /// Size of the grid of voxels; what lies beyond is outside. Of cells, one more than the samples along each
    /// axis: occupancy is then asked of samples that do not exist, which are outside.
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

    /// Slices before a column whose occupancy its worker wants, too; at least `LOOKAHEAD`.
    fn lookbehind(&self) -> u32 {
        LOOKAHEAD
    }

    /// The model's origin, once the skin has been described. The builder fills in the program
    /// and the connectivity, and clears what belongs to channels that are not stored.
    fn metadata(&self, found: &ScanSummary) -> Metadata;

    /// How the items of a channel, as [`SolidWorker::items`] gives them, are stored; `None` for a channel that
    /// the solid does not have. Before the scan it is asked with nothing found, for the number of bytes alone.
    fn form(&self, channel: Channel, found: &ScanSummary) -> Option<ItemForm>;

    /// Bytes that one worker holds.
    fn worker_bytes(&self, tile: &Tile) -> u64;

    /// Bytes that a thread holds for the inputs of the solid, while it works and possibly after.
    fn input_bytes(&self) -> u64 {
        self.inner().map_or(0, Solid::input_bytes)
    }

    /// A worker for columns as wide as the tile at most. Called on the thread that uses it.
    fn worker(&self, tile: &Tile) -> Box<dyn SolidWorker + '_>;

    /// Name of the solid in errors; it is not stored.
    fn name(&self) -> String {
        self.inner().map_or_else(|| self.metadata(&ScanSummary::default()).source.kind, Solid::name)
    }

    /// The labels that the scan has found, of a solid that has them; their numbers rise.
    ///
    /// # Errors
    /// There are too many.
    fn labels(&self) -> Result<Vec<Label>, BuildError> {
        Ok(Vec::new())
    }

    /// Every file that the solid is made of.
    fn for_each_file(&self, each: &mut dyn FnMut(&Path)) {
        if let Some(inner) = self.inner() {
            inner.for_each_file(each);
        }
    }

    /// Is what the solid is made of still what it was? Asked before the model is given its name.
    ///
    /// # Errors
    /// The input that was changed meanwhile.
    fn check_unchanged(&self) -> Result<(), SourceError> {
        self.inner().map_or(Ok(()), Solid::check_unchanged)
    }

    /// What is odd about the choice of what is inside.
    fn note(&self) -> Option<BuildNote> {
        self.inner()?.note()
    }

    /// Why no voxel is inside, for the user.
    fn nothing_inside(&self) -> BuildError {
        let own = || BuildError::from(BuildFault::nothing_inside(self.name()));
        self.inner().map_or_else(own, Solid::nothing_inside)
    }
}

/// Where an edge between two samples meets a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EdgeCrossing {
    /// The sample at its low end; -1 before the first one.
    pub low: [i32; 3],
    /// The axis along which it runs: 0 for x, 1 for y, 2 for z.
    pub axis: usize,
    /// Part of the way from there to the next sample, 0 to 1.
    pub along: f64,
    /// Normal of the surface, against the gradient along the index axes; of either sign and any length.
    pub normal: [f64; 3],
}

/// One thread's view of a [`Solid`]: owns its buffers and walks one column of voxels after the other.
pub trait SolidWorker {
    /// Begins a column. Until the next call, [`SolidWorker::occupancy`] is asked for slices that rise from
    /// [`Solid::lookbehind`] before the column to `LOOKAHEAD` after it, as far as they exist.
    ///
    /// # Errors
    /// The solid cannot be read.
    fn start(&mut self, column: &VoxelBox) -> Result<(), SourceError>;

    /// Where the voxels of a box lie. [`Cover::Mixed`] is always right, other answers save work.
    fn cover(&mut self, region: &VoxelBox) -> Cover {
        let _ = region;
        Cover::Mixed
    }

    /// Sets the bits of the rows asked for.
    ///
    /// # Errors
    /// The solid cannot be read.
    fn occupancy(&mut self, rows: &mut OccupancyRows<'_>) -> Result<(), SourceError>;

    /// Sets the bits of voxels that are kept in the rows asked for, of a solid that has walls within: every bit of them.
    /// Otherwise `false`, and the skin follows from the occupancy. As for [`SolidWorker::describe`], the occupancy of
    /// the next `LOOKAHEAD` slices has been asked for.
    fn skin(&mut self, rows: &mut OccupancyRows<'_>) -> bool {
        let _ = rows;
        false
    }

    /// Computes the items of skin voxels, of all channels of the tile; the occupancy of the next
    /// `LOOKAHEAD` slices has been asked for (except for boxes whose cover was given).
    ///
    /// # Errors
    /// The solid cannot be read.
    fn describe(&mut self, skin: &SkinSlice<'_>) -> Result<(), SourceError>;

    /// The items of a channel that [`SolidWorker::describe`] has computed, in the order of
    /// [`SkinSlice::voxels`]; of a sparse channel those of the voxels that have one.
    fn items(&self, channel: Channel) -> &[u8];

    /// Calls `found` with crossings of the surface and edges between neighbouring samples of the slice's cells, as a part
    /// of a solid of cells is asked for them: at least one of every edge whose ends differ in this solid, where it is
    /// known. Asked in the place of [`SolidWorker::describe`].
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

    /// Results since the worker was made.
    fn found(&self) -> ScanSummary {
        ScanSummary::default()
    }
}

/// Rows of one slice whose occupancy is wanted, one bit a voxel.
pub struct OccupancyRows<'a> {
    /// Columns asked for.
    pub(super) x: Range<u32>,
    /// Rows asked for.
    pub(super) y: Range<u32>,
    pub(super) z: u32,
    /// x of bit 0 of a row's first word.
    pub(super) origin: i64,
    /// Words of the rows, and from one row to the next.
    pub(super) width: usize,
    pub(super) pitch: usize,
    pub(super) words: &'a mut [u64],
}

impl<'a> OccupancyRows<'a> {
    /// Rows of a slice, `width` words long each and one behind the other, whose first bit is at `origin`: to ask
    /// a solid that is a part of another one.
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
    /// Columns asked for.
    #[inline]
    pub fn x(&self) -> Range<u32> {
        self.x.clone()
    }

    /// Rows asked for.
    #[inline]
    pub fn y(&self) -> Range<u32> {
        self.y.clone()
    }

    /// The slice.
    #[inline]
    pub fn z(&self) -> u32 {
        self.z
    }

    /// x of bit 0 of a row's first word; before [`OccupancyRows::x`], below 0 at the border.
    #[inline]
    pub fn origin(&self) -> i64 {
        self.origin
    }

    /// The words of row `y`, one of those asked for: bit i of word k is the voxel at `origin + 64 k + i`. Every
    /// bit of a column asked for has to be written; the others may become anything.
    ///
    /// # Panics
    /// If the row was not asked for.
    #[inline]
    pub fn row_mut(&mut self, y: u32) -> &mut [u64] {
        assert!(self.y.contains(&y), "a row that was not asked for");
        &mut self.words[(y - self.y.start) as usize * self.pitch..][..self.width]
    }

    /// Takes out what lies beyond a grid that is smaller than that of the boxes asked for.
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
            // Bits below a position, of this word.
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
    /// Occupancy around the slice, and which brick of the tile this is.
    pub(super) bits: BitRows<'a>,
    pub(super) brick: usize,
}

impl SkinSlice<'_> {
    /// Most voxels of one.
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

    /// Some of the voxels, at least one: bit i of row j is that at `corner + (i, j, 0)`.
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

    /// Corners inside of every cell, as bits, in the order of [`SkinSlice::voxels`].
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

    /// Faces of row `j`'s voxels that look outside.
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
