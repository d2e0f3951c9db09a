//! A volume with a threshold as a solid: a ring of slices, the range test, normals by the gradient.
//!
//! ```text
//!   slice z+2  --read-->  ring of 5 slices  --classify-->  bits
//!   slice z               gradient on z-2 ..= z+2 at skin voxels, values of z
//! ```
//!
//! A column reads 2 rows and 2 columns beyond its tile on every side. Memory is that of [`RingShape::bytes`],
//! whatever the volume holds.
#![expect(clippy::cast_possible_truncation, reason = "coordinates are below 2^16")]

use std::ops::Range;
use std::time::Instant;

use super::choose::Chooser;
use super::classify::classify;
use super::error::{BuildError, Sought};
use super::gradient::{
    ESTIMATOR, Gradients, NormalRule, OVERREAD, REACH, SLICE_VOXELS, SliceWindow, gradient_of_depths,
    gradients,
};
use super::item::{ItemForm, push_swapped, value_bytes, value_form, value_scale};
use super::range::{Ordered, SampleRange};
use super::ring::{RingForm, border_unit, convert};
use super::skin::Exposed;
use super::solid::{BRICK, Found, LOOKAHEAD, OccupancyRows, SkinSlice, Solid, SolidWorker, Tile, VoxelBox};
use crate::format::{Channel, Metadata, Selection, SourceMeta};
use crate::geom::Dims;
use crate::volume::{ScalarType, SourceError, VolumeInfo, VolumeSource};

const BRICK_ROWS: usize = BRICK as usize;
const RING: usize = 2 * REACH as usize + 1;
const _: () = assert!(REACH == LOOKAHEAD, "the ring holds what was asked for since slice z - 2");
/// Bytes of a cache line, on every machine of interest.
const CACHE_LINE: usize = 64;

/// The form of a channel's items, of those that a volume has.
pub(super) fn volume_form(scalar: ScalarType, channel: Channel, found: &Found) -> Option<ItemForm> {
    match channel {
        Channel::Normal => Some(ItemForm::AsIs { bytes: 2 }),
        Channel::Value => Some(value_form(scalar, found.extent)),
        _ => None,
    }
}

/// Sizes of the buffers through which a volume is read.
#[derive(Clone, Copy, Debug)]
pub(super) struct RingShape {
    pub(super) dims: Dims,
    /// Bytes of a sample in the file and in the ring.
    pub(super) file_bytes: usize,
    pub(super) ring_bytes: usize,
    /// Are slices read straight into the ring?
    pub(super) in_place: bool,
    /// Bytes of a value while it is scanned.
    pub(super) value_bytes: usize,
}

impl RingShape {
    /// The shape for the kindest range of a sample type.
    pub(super) fn kindest(dims: Dims, scalar: ScalarType) -> Self {
        let in_place = scalar.bytes() <= 2 || scalar == ScalarType::F32;
        let ring_bytes = if in_place { scalar.bytes() } else { size_of::<f32>() };
        Self { dims, file_bytes: scalar.bytes(), ring_bytes, in_place, value_bytes: value_bytes(scalar) }
    }

    fn of<F: RingForm>(info: &VolumeInfo) -> Self {
        Self {
            dims: info.dims,
            file_bytes: info.scalar.bytes(),
            ring_bytes: size_of::<F::Ring>(),
            in_place: F::IN_PLACE,
            value_bytes: value_bytes(info.scalar),
        }
    }

    /// Bytes of one worker.
    pub(super) fn bytes(&self, tile: &Tile) -> u64 {
        let values = if tile.channels.contains(Channel::Value) { self.value_bytes } else { 0 };
        let bytes = (RING * self.plane_samples(tile) + OVERREAD) * self.ring_bytes
            + self.staging_slices(tile) * self.block_samples(tile) * self.file_bytes
            + SLICE_VOXELS * (14 + values);
        bytes as u64
    }

    /// Columns and rows of a tile with its halo.
    fn block(&self, tile: &Tile) -> (usize, usize) {
        let cols = (tile.columns + 2 * REACH).min(self.dims.nx());
        let rows = (BRICK + 2 * REACH).min(self.dims.ny());
        (cols as usize, rows as usize)
    }

    /// Samples of one slice of a tile with its halo.
    fn block_samples(&self, tile: &Tile) -> usize {
        let (cols, rows) = self.block(tile);
        cols * rows
    }

    /// Samples from one row of the ring to the next: an odd number of cache lines, so that the 25 rows of a
    /// 5x5x5 window fall on different sets of the cache even when a row is 2^n bytes long.
    fn stride(&self, tile: &Tile) -> usize {
        let line = CACHE_LINE / self.ring_bytes;
        let lines = self.block(tile).0.div_ceil(line);
        (lines | 1) * line
    }

    /// Samples of one slice in the ring.
    fn plane_samples(&self, tile: &Tile) -> usize {
        self.stride(tile) * self.block(tile).1
    }

    /// Slices of file samples held beside the ring: enough that slice z is still there when its values
    /// are gathered.
    fn staging_slices(&self, tile: &Tile) -> usize {
        match (self.in_place, tile.channels.contains(Channel::Value)) {
            (true, _) => 0,
            (false, false) => 1,
            (false, true) => REACH as usize + 1,
        }
    }
}

/// The voxels of a volume whose samples lie in a range.
pub(super) struct VolumeSolid<'a, F> {
    pub(super) source: &'a dyn VolumeSource,
    pub(super) form: F,
    pub(super) selection: Selection,
    pub(super) rule: NormalRule,
    /// Says which values there are, if none lies in the range.
    pub(super) chooser: Chooser<'a>,
}

impl<'a, F: RingForm> VolumeSolid<'a, F> {
    /// The solid of a range that has been chosen; `form` tests for it.
    pub(super) fn new(
        source: &'a dyn VolumeSource,
        form: F,
        selection: Selection,
        chooser: Chooser<'a>,
    ) -> Self {
        let rule = NormalRule::new(source.info().spacing_mm);
        Self { source, form, selection, rule, chooser }
    }
}

impl<F: RingForm> Solid for VolumeSolid<'_, F> {
    type Worker<'w>
        = VolumeWorker<'w, F>
    where
        Self: 'w;

    fn dims(&self) -> Dims {
        self.source.info().dims
    }

    fn metadata(&self, found: &Found) -> Metadata {
        let VolumeInfo { dims, scalar, rescale, spacing_mm, affine, description, .. } = self.source.info();
        Metadata {
            program: String::new(),
            source: SourceMeta {
                format: description.format.clone(),
                kind: description.to_string(),
                files: description.files,
                bytes: description.bytes,
            },
            dims: dims.to_array(),
            scalar: scalar.code(),
            spacing_mm: *spacing_mm,
            affine: affine.rows,
            rescale: [rescale.slope, rescale.intercept],
            selection: self.selection,
            connectivity: 0,
            gradient: ESTIMATOR.into(),
            value_scale: value_scale(*scalar, found.extent, *rescale),
        }
    }

    fn name(&self) -> String {
        self.source.info().description.name.clone()
    }

    fn form(&self, channel: Channel, found: &Found) -> Option<ItemForm> {
        volume_form(self.source.info().scalar, channel, found)
    }

    fn worker_bytes(&self, tile: &Tile) -> u64 {
        RingShape::of::<F>(self.source.info()).bytes(tile)
    }

    fn input_bytes(&self) -> u64 {
        self.source.resident_bytes()
    }

    fn worker(&self, tile: &Tile) -> VolumeWorker<'_, F> {
        VolumeWorker::new(self, tile)
    }

    fn check_unchanged(&self) -> Result<(), SourceError> {
        self.source.check_unchanged()
    }

    fn nothing_inside(&self) -> BuildError {
        self.chooser.empty::<F::File>(Sought::Within(self.selection))
    }
}

/// The column at hand: its place in the volume and the layout of its buffers.
#[derive(Clone, Debug)]
struct Frame {
    column: VoxelBox,
    /// Rows and columns read: the tile and its halo, within the volume.
    rows: Range<u32>,
    cols: Range<u32>,
    /// Samples of a row, from one row of the ring to the next, and of a slice in the ring.
    width: usize,
    stride: usize,
    samples: usize,
}

/// One thread's ring of slices.
pub(super) struct VolumeWorker<'a, F: RingForm> {
    source: &'a dyn VolumeSource,
    form: F,
    rule: &'a NormalRule,
    dims: [u32; 3],
    normals: bool,
    values: bool,
    stride: usize,
    frame: Frame,
    ring: Vec<F::Ring>,
    plane_len: usize,
    staging: Vec<F::File>,
    staging_slices: usize,
    gradients: Box<Gradients>,
    codes: Box<[u16; SLICE_VOXELS]>,
    /// Voxels described last.
    count: usize,
    swapped_values: Vec<u8>,
    found: Found,
}

impl<'a, F: RingForm> VolumeWorker<'a, F> {
    fn new(solid: &'a VolumeSolid<'_, F>, tile: &Tile) -> Self {
        let info = solid.source.info();
        let shape = RingShape::of::<F>(info);
        let (plane_len, staging_slices) = (shape.plane_samples(tile), shape.staging_slices(tile));
        let values = tile.channels.contains(Channel::Value);
        let nothing = VoxelBox { x: 0..0, y: 0..0, z: 0..0 };
        Self {
            source: solid.source,
            form: solid.form,
            rule: &solid.rule,
            dims: info.dims.to_array(),
            normals: tile.channels.contains(Channel::Normal),
            values,
            stride: shape.stride(tile),
            frame: Frame { column: nothing, rows: 0..0, cols: 0..0, width: 0, stride: 0, samples: 0 },
            ring: vec![bytemuck::Zeroable::zeroed(); RING * plane_len + OVERREAD],
            plane_len,
            staging: vec![bytemuck::Zeroable::zeroed(); staging_slices * shape.block_samples(tile)],
            staging_slices,
            gradients: Gradients::new(),
            codes: Box::new([0; SLICE_VOXELS]),
            count: 0,
            swapped_values: Vec::with_capacity(if values { SLICE_VOXELS * shape.value_bytes } else { 0 }),
            found: Found::default(),
        }
    }

    /// The samples of slice `z` as they are in the file, and from one row to the next.
    fn file_samples(&self, z: u32) -> (&[F::File], usize) {
        if F::IN_PLACE {
            let plane = &self.ring[z as usize % RING * self.plane_len..][..self.plane_len];
            (bytemuck::cast_slice(plane), self.frame.stride)
        } else {
            let len = self.staging.len() / self.staging_slices;
            (&self.staging[z as usize % self.staging_slices * len..][..len], self.frame.width)
        }
    }

    /// Fills `codes` with the normals of skin voxels.
    fn find_normals(&mut self, skin: &SkinSlice<'_>) {
        let f = &self.frame;
        let [x0, _, z] = skin.corner();
        let interior = self.interior(z, x0, skin.rows());
        let row0 = (f.column.y.start - f.rows.start) as usize;
        let planes: [&[F::Ring]; RING] = std::array::from_fn(|k| {
            let slice = (z as usize + k + RING - REACH as usize) % RING;
            &self.ring[slice * self.plane_len..][..self.plane_len + OVERREAD]
        });
        let origin = row0 * f.stride + (x0 - f.cols.start) as usize;
        let window = SliceWindow { planes, stride: f.stride, origin, skin: skin.rows(), interior: &interior };
        gradients(&window, self.rule.taps, &mut self.gradients);
        let faces: [Exposed; BRICK_ROWS] = std::array::from_fn(|y| skin.exposed(y));
        let (dims, form) = (self.dims, self.form);
        let (unit, taps) = (border_unit::<F>(), self.rule.taps);
        self.rule.codes(&window, &faces, &mut self.gradients, &mut self.codes, |y, x| {
            let (cx, cy) = (i64::from(x0 + x), i64::from(f.column.y.start) + y as i64);
            let depths = std::array::from_fn(|k| {
                std::array::from_fn(|j| {
                    std::array::from_fn(|i| {
                        let (px, py) = (cx + i as i64 - 2, cy + j as i64 - 2);
                        let pz = i64::from(z) + k as i64 - 2;
                        let (qx, qy) =
                            (px.clamp(0, i64::from(dims[0]) - 1), py.clamp(0, i64::from(dims[1]) - 1));
                        let qz = pz.clamp(0, i64::from(dims[2]) - 1);
                        let at = (qy as usize - f.rows.start as usize) * f.stride
                            + (qx as usize - f.cols.start as usize);
                        let depth = form.depth(window.planes[(qz - i64::from(z) + 2) as usize][at]);
                        // Beyond the border the volume is as far outside as it is inside before it.
                        if (px, py, pz) == (qx, qy, qz) { depth } else { -depth.abs() - unit }
                    })
                })
            });
            gradient_of_depths(taps, &depths)
        });
    }

    /// Skin voxels whose 5x5x5 neighbourhood lies in the volume.
    fn interior(&self, z: u32, x0: u32, skin: &[u32; BRICK_ROWS]) -> [u32; BRICK_ROWS] {
        let inside = |p: u32, n: u32| p >= REACH && p + REACH < n;
        if !inside(z, self.dims[2]) {
            return [0; BRICK_ROWS];
        }
        let mut columns = u32::MAX;
        if x0 < REACH || x0 + BRICK + REACH > self.dims[0] {
            columns = (0..BRICK).filter(|x| inside(x0 + x, self.dims[0])).fold(0, |m, x| m | 1 << x);
        }
        std::array::from_fn(|y| {
            let here = self.frame.column.y.start + y as u32;
            if inside(here, self.dims[1]) { skin[y] & columns } else { 0 }
        })
    }

    /// Fills `swapped_values` with the values of skin voxels.
    fn gather_values(&mut self, skin: &SkinSlice<'_>) {
        let [x0, _, z] = skin.corner();
        // Taken out while the samples are borrowed.
        let (mut values, mut extent) = (std::mem::take(&mut self.swapped_values), self.found.extent);
        values.clear();
        let (plane, stride) = self.file_samples(z);
        let f = &self.frame;
        let (x0, y0) = ((x0 - f.cols.start) as usize, (f.column.y.start - f.rows.start) as usize);
        for (y, row) in skin.rows().iter().enumerate() {
            let mut bits = *row;
            while bits != 0 {
                let x = bits.trailing_zeros() as usize;
                bits &= bits - 1;
                push_swapped(plane[(y0 + y) * stride + x0 + x], &mut values, &mut extent);
            }
        }
        (self.swapped_values, self.found.extent) = (values, extent);
    }
}

impl<F: RingForm> SolidWorker for VolumeWorker<'_, F> {
    fn start(&mut self, column: &VoxelBox) -> Result<(), SourceError> {
        let widen = |r: &Range<u32>, n: u32| r.start.saturating_sub(REACH)..(r.end + REACH).min(n);
        let (rows, cols) = (widen(&column.y, self.dims[1]), widen(&column.x, self.dims[0]));
        self.frame = Frame {
            column: column.clone(),
            samples: self.stride * (rows.len() - 1) + cols.len(),
            width: cols.len(),
            stride: self.stride,
            rows,
            cols,
        };
        Ok(())
    }

    /// Reads a slice of the column into its slot of the ring and classifies it.
    fn occupancy(&mut self, wanted: &mut OccupancyRows<'_>) -> Result<(), SourceError> {
        let (f, z, range) = (&self.frame, wanted.z(), self.form.range());
        let plane = &mut self.ring[z as usize % RING * self.plane_len..][..f.samples];
        let (rows, cols) = (f.rows.clone(), f.cols.clone());
        let started = Instant::now();
        if F::IN_PLACE {
            let pitch = f.stride * size_of::<F::Ring>();
            self.source.read_pitched(z, rows, cols, pitch, bytemuck::cast_slice_mut(plane))?;
            self.found.reading += started.elapsed();
            self.found.not_numbers =
                self.found.not_numbers || holds_nan::<F::File>(bytemuck::cast_slice(plane));
            classify_rows(f, bytemuck::cast_slice(plane), f.stride, range, wanted);
        } else {
            let len = self.staging.len() / self.staging_slices;
            let staged =
                &mut self.staging[z as usize % self.staging_slices * len..][..f.width * f.rows.len()];
            self.source.read_rows(z, rows, cols, bytemuck::cast_slice_mut(staged))?;
            self.found.reading += started.elapsed();
            self.found.not_numbers = self.found.not_numbers || holds_nan(staged);
            classify_rows(f, staged, f.width, range, wanted);
            for (from, to) in staged.chunks_exact(f.width).zip(plane.chunks_mut(f.stride)) {
                convert(&self.form, from, &mut to[..f.width]);
            }
        }
        Ok(())
    }

    fn describe(&mut self, skin: &SkinSlice<'_>) -> Result<(), SourceError> {
        self.count = skin.len();
        if self.normals {
            self.find_normals(skin);
        }
        if self.values {
            self.gather_values(skin);
        }
        Ok(())
    }

    fn items(&self, channel: Channel) -> &[u8] {
        match channel {
            Channel::Normal => bytemuck::cast_slice(&self.codes[..self.count]),
            Channel::Value => &self.swapped_values,
            _ => &[],
        }
    }

    fn found(&self) -> Found {
        self.found
    }
}

/// Is one of some samples NaN? Asked in parts without a branch, at the speed of memory.
fn holds_nan<T: Ordered>(samples: &[T]) -> bool {
    const PART: usize = 256;
    let in_part = |part: &[T]| part.iter().fold(false, |found, v| found | v.partial_cmp(v).is_none());
    T::NO_NUMBER.is_some() && samples.chunks(PART).any(in_part)
}

/// Inside bits of the rows wanted, from samples whose rows are `stride` apart; a word of each row stands before
/// the column and one after it.
fn classify_rows<T: Ordered>(
    f: &Frame,
    plane: &[T],
    stride: usize,
    range: SampleRange<T>,
    wanted: &mut OccupancyRows<'_>,
) {
    let x0 = (f.column.x.start - f.cols.start) as usize;
    let width = f.column.x.len();
    for y in wanted.y() {
        let samples = &plane[(y - f.rows.start) as usize * stride..][..f.width];
        let [before, words @ .., after] = wanted.row_mut(y) else { continue };
        classify(&samples[x0..x0 + width], range, words);
        *before = if x0 > 0 { u64::from(range.contains(samples[x0 - 1])) << 63 } else { 0 };
        *after = samples.get(x0 + width).map_or(0, |v| u64::from(range.contains(*v)));
    }
}
